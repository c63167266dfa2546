"""Writes tiny files with other programs into written/: what the test data has no files of. splats.mjs reads and writes splats.

Headers are rotated, flipped or contradict themselves, and all samples are different, so that nothing can be confused.
"""

import laspy
import nibabel
import nrrd
import numpy as np
import plyfile
import SimpleITK
import trimesh
import vtk
from PIL import Image
from vtk.util.numpy_support import numpy_to_vtk

from common import HERE

WRITTEN = HERE / "written"
DIMS = (5, 4, 3)
# x fastest.
SAMPLES = np.arange(10, 70).reshape(DIMS, order="F")
# No axis of the grid is one of the world; the columns are unit vectors, right-handed.
TURNED = np.array([[0.6, -0.48, 0.64], [0.8, 0.36, -0.48], [0.0, 0.8, 0.6]])
FLIPPED = TURNED @ np.diag([1, 1, -1])
SPACING = np.array([0.5, 1.25, 2.0])
ORIGIN = np.array([-7.5, 3.25, 11.0])


def affine(direction):
    matrix = np.eye(4)
    matrix[:3, :3] = direction * SPACING
    matrix[:3, 3] = ORIGIN
    return matrix


def nifti(name, samples, kind=nibabel.Nifti1Image, endian="<"):
    """Without codes: the caller says which of the two transforms holds."""
    header = kind.header_class(endianness=endian)
    header.set_data_dtype(samples.dtype)
    image = kind(samples, None, header)
    image.header.set_zooms(SPACING)
    return image, WRITTEN / name


def write_nifti():
    # Both are there and differ; the s-form holds, sheared as only it can be.
    image, path = nifti("sform_and_qform.nii.gz", SAMPLES.astype("i2"))
    sheared = affine(TURNED)
    sheared[0, 1] += 0.25
    image.set_sform(sheared, 2)
    image.set_qform(affine(FLIPPED), 1)
    # Making an image of values forgets how its header scales them.
    image = nibabel.Nifti1Image(image.get_fdata() * 0.5 - 100, None, image.header)
    image.header.set_slope_inter(0.5, -100)
    image.to_filename(path)
    image, path = nifti("qform_flipped.nii", SAMPLES.astype("f4") / 8)
    image.set_qform(affine(FLIPPED), 1)
    image.set_sform(None, 0)
    image.to_filename(path)
    image, path = nifti("big_endian.nii", SAMPLES.astype(">u2") * 1000, endian=">")
    image.set_sform(affine(TURNED), 1)
    image.to_filename(path)
    image, path = nifti("second.nii", SAMPLES.astype("f8") / 8, nibabel.Nifti2Image)
    image.set_sform(affine(TURNED), 1)
    image.to_filename(path)


def write_nrrd():
    header = {"space": "right-anterior-superior", "space directions": (TURNED * SPACING).T, "space origin": ORIGIN}
    nrrd.write(str(WRITTEN / "turned.nrrd"), SAMPLES.astype("i2") - 40, {**header, "encoding": "gzip"}, index_order="F")
    detached = {**header, "space": "left-posterior-superior", "space directions": (FLIPPED * SPACING).T, "encoding": "raw", "endian": "big"}
    nrrd.write(str(WRITTEN / "detached.nhdr"), SAMPLES.astype(">u2"), detached, detached_header=True, index_order="F")


def write_metaimage():
    for name, kind, direction, compress in [
        ("turned.mha", "i2", TURNED, True),
        ("flipped.mhd", "f4", FLIPPED, False),
        ("bytes.mha", "u1", np.eye(3), False),
    ]:
        image = SimpleITK.GetImageFromArray(np.ascontiguousarray(SAMPLES.astype(kind).T))
        image.SetSpacing(SPACING.tolist())
        image.SetOrigin(ORIGIN.tolist())
        image.SetDirection(direction.ravel().tolist())
        SimpleITK.WriteImage(image, str(WRITTEN / name), compress)


def vtk_image(samples):
    image = vtk.vtkImageData()
    image.SetDimensions(*DIMS)
    image.SetSpacing(*SPACING)
    image.SetOrigin(*ORIGIN)
    array = numpy_to_vtk(samples.ravel(order="F"), deep=True)
    array.SetName("density")
    image.GetPointData().SetScalars(array)
    return image


def vtk_rectilinear(samples):
    """Evenly spaced."""
    grid = vtk.vtkRectilinearGrid()
    grid.SetDimensions(*DIMS)
    for axis, setter in enumerate([grid.SetXCoordinates, grid.SetYCoordinates, grid.SetZCoordinates]):
        setter(numpy_to_vtk(ORIGIN[axis] + SPACING[axis] * np.arange(DIMS[axis]), deep=True))
    array = numpy_to_vtk(samples.ravel(order="F"), deep=True)
    array.SetName("density")
    grid.GetPointData().SetScalars(array)
    return grid


def save(writer, name, data, prepare=lambda writer: None):
    writer.SetFileName(str(WRITTEN / name))
    writer.SetInputData(data)
    prepare(writer)
    writer.Write()


def write_vtk():
    turned = vtk_image(SAMPLES.astype("f4") / 8)
    turned.SetDirectionMatrix(*TURNED.ravel())
    save(vtk.vtkXMLImageDataWriter(), "turned.vti", turned, lambda w: w.SetDataModeToAscii())
    save(vtk.vtkXMLImageDataWriter(), "appended.vti", vtk_image(SAMPLES.astype("u2")), lambda w: w.SetCompressorTypeToZLib())
    save(vtk.vtkXMLRectilinearGridWriter(), "even.vtr", vtk_rectilinear(SAMPLES.astype("u1")))
    save(vtk.vtkDataSetWriter(), "binary.points.vtk", vtk_image(SAMPLES.astype("i2")), lambda w: w.SetFileTypeToBinary())
    save(vtk.vtkDataSetWriter(), "ascii.points.vtk", vtk_image(SAMPLES.astype("f4") / 8), lambda w: w.SetFileTypeToASCII())
    save(vtk.vtkDataSetWriter(), "even.rectilinear.vtk", vtk_rectilinear(SAMPLES.astype("f4")), lambda w: w.SetFileTypeToBinary())


def write_tiff():
    slices = [Image.fromarray((SAMPLES[:, :, z].T * 1000).astype("u2")) for z in range(DIMS[2])]
    slices[0].save(WRITTEN / "stack.tif", save_all=True, append_images=slices[1:])


def write_points():
    for name, version, form in [("colored.laz", "1.4", 7), ("plain.las", "1.2", 0)]:
        header = laspy.LasHeader(version=version, point_format=form)
        header.scales, header.offsets = [0.001, 0.002, 0.0005], [500_000, 5_000_000, 100]
        las = laspy.LasData(header)
        k = np.arange(40)
        las.x, las.y, las.z = 500_000 + 0.25 * k, 5_000_000 - 0.5 * k, 100 + 0.125 * (k % 7)
        las.intensity = 1500 * k
        if form == 7:
            las.red, las.green, las.blue = 1600 * k, 65535 - 1600 * k, 257 * k
        las.write(WRITTEN / name)


def write_ply_points():
    k = np.arange(40)
    columns = {"x": 0.25 * k - 3, "y": 7 - 0.5 * k, "z": 0.125 * (k % 7), "nx": 0.6 * (k % 2), "ny": 0 * k, "nz": 1 - 0.2 * (k % 2)}
    vertex = np.zeros(40, [(name, "f4") for name in columns] + [(name, "u1") for name in ("red", "green", "blue")])
    for name, values in columns.items():
        vertex[name] = values
    vertex["red"], vertex["green"], vertex["blue"] = 6 * k, 255 - 6 * k, k % 5 * 50
    plyfile.PlyData([plyfile.PlyElement.describe(vertex, "vertex")]).write(str(WRITTEN / "points.ply"))


def write_meshes():
    box = trimesh.creation.box(extents=[1, 2, 3], transform=trimesh.transformations.translation_matrix([4, 5, 6]))
    box.export(WRITTEN / "binary.stl")
    (WRITTEN / "ascii.stl").write_text(trimesh.exchange.stl.export_stl_ascii(box))
    # Polygons of three to five corners, big-endian, with a column between and one behind.
    corners = [(0, 0, 0), (2, 0, 0.5), (3, 1, 0), (1, 3, 0), (-1, 1, 0.25), (5, 5, 1)]
    vertex = np.array([(x, 7, y, z) for x, y, z in corners], [("x", "f4"), ("label", "u1"), ("y", "f4"), ("z", "f4")])
    face = np.empty(3, [("vertex_indices", "O"), ("quality", "f4")])
    face["vertex_indices"] = [np.array(p, "i4") for p in ([0, 1, 2, 3, 4], [2, 5, 3], [1, 5, 2, 0])]
    face["quality"] = [0.5, 1.5, 2.5]
    elements = [plyfile.PlyElement.describe(vertex, "vertex"), plyfile.PlyElement.describe(face, "face", len_types={"vertex_indices": "u1"})]
    plyfile.PlyData(elements, byte_order=">").write(str(WRITTEN / "polygons.ply"))


WRITTEN.mkdir(exist_ok=True)
for write in [write_nifti, write_nrrd, write_metaimage, write_vtk, write_tiff, write_points, write_ply_points, write_meshes]:
    write()
