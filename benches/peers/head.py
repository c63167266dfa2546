"""The scene `head`, cast by VTK's fixed-point ray caster."""

import os

import numpy as np
import vtk
from vtk.util import numpy_support

from timing import Peer

# Entries of the tables that stand for the transfer function.
ENTRIES = 4096


def peers(scene, folder):
    """Steps of one voxel, VTK's default, and of half a voxel."""
    version = vtk.vtkVersion().GetVTKVersion()
    for voxels, stem in [(1.0, "head_vtk_1"), (0.5, "head_vtk_0.5")]:
        window = prepared(scene, folder, voxels)
        yield Peer(
            scene="head",
            name=f"VTK {version} ray caster, step {voxels:g} voxel",
            stem=stem,
            draw=lambda window=window: draw(window),
            picture=lambda window=window: picture(window),
        )


def draw(window):
    """Everything that depends on the view is made anew."""
    camera = window.GetRenderers().GetFirstRenderer().GetActiveCamera()
    camera.Modified()
    window.Render()


def picture(window):
    """What the window holds is in linear light."""
    filter = vtk.vtkWindowToImageFilter()
    filter.SetInput(window)
    filter.ReadFrontBufferOff()
    filter.Update()
    image = filter.GetOutput()
    width, height, _ = image.GetDimensions()
    rows = numpy_support.vtk_to_numpy(image.GetPointData().GetScalars()).reshape(height, width, 3)
    return np.round(255 * encoded(rows[::-1] / 255)).astype(np.uint8)


def encoded(linear):
    """Linear light to sRGB (IEC 61966-2-1)."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def decoded(srgb):
    """sRGB to linear light (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def look(scene, spacing):
    """The transfer function, colours in linear light; opacities are of a voxel's length."""
    points = np.array(scene["transfer"]["points"])
    values = np.linspace(0, 1, ENTRIES)
    colors = decoded(np.stack([np.interp(values, points[:, 0], points[:, 1 + c]) for c in range(3)], axis=1))
    opacities = -np.expm1(-spacing * np.interp(values, points[:, 0], points[:, 4]))
    color, opacity = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction()
    color.BuildFunctionFromTable(0, 1, ENTRIES, colors.ravel())
    opacity.BuildFunctionFromTable(0, 1, ENTRIES, opacities)
    light = scene["headlight"]
    property = vtk.vtkVolumeProperty()
    property.SetColor(color)
    property.SetScalarOpacity(opacity)
    property.SetScalarOpacityUnitDistance(spacing)
    property.SetInterpolationTypeToLinear()
    property.ShadeOn()
    property.SetAmbient(light["ambient"])
    property.SetDiffuse(light["diffuse"])
    property.SetSpecular(light["specular"])
    property.SetSpecularPower(light["exponent"])
    return property


def prepared(scene, folder, voxels):
    """A window that draws the scene with a step of so many voxels."""
    reader = vtk.vtkNrrdReader()
    reader.SetFileName(str(folder / scene["volume"]))
    reader.Update()
    spacing = reader.GetOutput().GetSpacing()[0]

    mapper = vtk.vtkFixedPointVolumeRayCastMapper()
    mapper.SetInputConnection(reader.GetOutputPort())
    mapper.SetAutoAdjustSampleDistances(False)
    mapper.SetSampleDistance(voxels * spacing)
    mapper.SetInteractiveSampleDistance(voxels * spacing)
    mapper.SetImageSampleDistance(1)
    mapper.SetIntermixIntersectingGeometry(False)
    mapper.SetNumberOfThreads(os.cpu_count())
    volume = vtk.vtkVolume()
    volume.SetMapper(mapper)
    volume.SetProperty(look(scene, spacing))

    renderer = vtk.vtkRenderer()
    renderer.AddVolume(volume)
    renderer.SetBackground(*scene["background"])
    camera, place = renderer.GetActiveCamera(), scene["camera"]
    camera.SetPosition(*place["eye"])
    camera.SetFocalPoint(*place["target"])
    camera.SetViewUp(*place["up"])
    camera.SetViewAngle(place["vertical_angle"])
    renderer.ResetCameraClippingRange()
    # VTK's own headlight has no ambient light.
    light = vtk.vtkLight()
    light.SetLightTypeToHeadlight()
    light.SetAmbientColor(1, 1, 1)
    renderer.AddLight(light)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(0)
    window.SetSize(*scene["size"])
    window.AddRenderer(renderer)
    return window
