"""Volumes: raw samples by NumPy, NIfTI by nibabel, NRRD by pynrrd, VTK's by VTK, MetaImage by ITK, TIFF by Pillow; NIfTI and
NRRD by ITK as well."""

import gzip
import re

import nibabel
import nrrd
import numpy as np
import PIL.Image
import SimpleITK
import vtk
from vtk.util.numpy_support import vtk_to_numpy

from common import number, numbers, rows, voxel_spots


def read_volume(path, file):
    readers = {
        ".raw.gz": by_numpy,
        ".nii.gz": by_nibabel,
        ".nii": by_nibabel,
        ".vti": by_vtk,
        ".vtr": by_vtk,
        ".vtk": by_vtk,
        ".nrrd": by_pynrrd,
        ".nhdr": by_pynrrd,
        ".mha": by_itk,
        ".mhd": by_itk,
        ".tif": by_pillow,
    }
    ending = next(ending for ending in readers if path.endswith(ending))
    return readers[ending](file)


KINDS = {"uint8": "u8", "uint16": "u16", "int16": "i16", "float32": "f32", "float64": "f64"}


def described(samples, facts):
    """Samples are indexed [x, y, z]."""
    spots = [[*index, number(samples[tuple(index)])] for index in voxel_spots(samples.shape)]
    return {
        "kind": "volume",
        **facts,
        "dims": list(samples.shape),
        "range": [number(samples.min()), number(samples.max())],
        "mean": float(samples.mean(dtype=np.float64)),
        "spots": spots,
    }


def frame(spacing, origin, direction=np.eye(3)):
    """Columns of the direction are the axes of the grid."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.asarray(direction, float) * np.asarray(spacing, float)
    matrix[:3, 3] = origin
    return {
        "spacing": numbers(np.asarray(spacing, float)),
        "origin": numbers(np.asarray(origin, float)),
        "direction": rows(np.asarray(direction, float)),
        "index_to_world": rows(matrix),
    }


def by_numpy(file):
    """The layout is the one that the name tells; a file that says no spacing has a spacing of 1."""
    dims = [int(n) for n in re.search(r"_(\d+)x(\d+)x(\d+)_", file.name).groups()]
    kind = {"uint8": ("u8", "u1"), "uint16be": ("u16", ">u2")}[re.search(r"_(uint\d+(be)?)\.", file.name)[1]]
    samples = np.frombuffer(gzip.decompress(file.read_bytes()), kind[1]).reshape(dims, order="F")
    facts = {"format": "raw.gz", "reader": f"numpy {np.__version__}", "sample_type": kind[0]}
    return described(samples, {**facts, "frame": "as in file", **frame([1, 1, 1], [0, 0, 0])})


def by_vtk(file):
    legacy = vtk.vtkRectilinearGridReader if "rectilinear" in file.name else vtk.vtkStructuredPointsReader
    reader = {".vti": vtk.vtkXMLImageDataReader, ".vtr": vtk.vtkXMLRectilinearGridReader, ".vtk": legacy}[file.suffix]()
    reader.SetFileName(str(file))
    reader.Update()
    data = reader.GetOutput()
    array = data.GetPointData().GetArray(0)
    samples = vtk_to_numpy(array).reshape(data.GetDimensions(), order="F")
    facts = {"format": file.suffix[1:], "reader": f"vtk {vtk.vtkVersion.GetVTKVersion()}", "sample_type": KINDS[samples.dtype.name]}
    if isinstance(data, vtk.vtkRectilinearGrid):
        axes = [vtk_to_numpy(a) for a in (data.GetXCoordinates(), data.GetYCoordinates(), data.GetZCoordinates())]
        where = frame([a[1] - a[0] for a in axes], [a[0] for a in axes])
    else:
        matrix = data.GetDirectionMatrix()
        direction = [[matrix.GetElement(r, c) for c in range(3)] for r in range(3)]
        where = frame(data.GetSpacing(), data.GetOrigin(), direction)
    return described(samples, {**facts, "array": array.GetName(), "frame": "as in file", **where})


def by_pillow(file):
    """Pages are slices; a file that says no spacing has a spacing of 1."""
    image = PIL.Image.open(file)
    pages = []
    for page in range(image.n_frames):
        image.seek(page)
        pages.append(np.asarray(image).T)
    samples = np.stack(pages, axis=2)
    facts = {"format": "tif", "reader": f"Pillow {PIL.__version__}", "sample_type": KINDS[samples.dtype.name]}
    return described(samples, {**facts, "frame": "x along rows, y down, z by page", **frame([1, 1, 1], [0, 0, 0])})


def by_nibabel(file):
    image = nibabel.load(file)
    header = image.header
    samples = np.asanyarray(image.dataobj)
    spacing = np.linalg.norm(image.affine[:3, :3], axis=0)
    facts = {
        "format": "".join(file.suffixes)[1:],
        "reader": f"nibabel {nibabel.__version__}",
        "stored_type": KINDS[header.get_data_dtype().name],
        # Scaled values are in double precision.
        "sample_type": KINDS[samples.dtype.name],
        "slope_intercept": [image.dataobj.slope, image.dataobj.inter],
        "codes": {"sform": int(header["sform_code"]), "qform": int(header["qform_code"])},
        "qform": rows(header.get_qform()),
        "sform": rows(header.get_sform()),
        "pixdim": numbers(header["pixdim"]),
        "frame": "RAS+ (x to the right, y to the front, z up, of a patient)",
        **frame(spacing, image.affine[:3, 3], image.affine[:3, :3] / spacing),
    }
    return {**described(samples, facts), "also": [briefly_by_itk(file)]}


def by_pynrrd(file):
    samples, header = nrrd.read(str(file), index_order="F")
    directions = np.asarray(header["space directions"], float).T
    spacing = np.linalg.norm(directions, axis=0)
    facts = {
        "format": file.suffix[1:],
        "reader": f"pynrrd {nrrd.__version__}",
        "sample_type": KINDS[samples.dtype.name],
        "frame": f"as in file ({header['space']})",
        **frame(spacing, header["space origin"], directions / spacing),
    }
    return {**described(samples, facts), "also": [briefly_by_itk(file)]}


def itk(file):
    """ITK's world is LPS+ whatever the file's is; MetaImage's is that, too."""
    image = SimpleITK.ReadImage(str(file))
    where = frame(image.GetSpacing(), image.GetOrigin(), np.reshape(image.GetDirection(), (3, 3)))
    facts = {"reader": f"SimpleITK {SimpleITK.__version__}", "frame": "LPS+", **where}
    return SimpleITK.GetArrayFromImage(image).T, facts


def by_itk(file):
    samples, facts = itk(file)
    return described(samples, {"format": file.suffix[1:], "sample_type": KINDS[samples.dtype.name], **facts})


def briefly_by_itk(file):
    try:
        facts = described(*itk(file))
    except RuntimeError as error:
        return {"reader": f"SimpleITK {SimpleITK.__version__}", "refused": str(error).splitlines()[-1].split(' "')[0]}
    return {name: facts[name] for name in ("reader", "frame", "dims", "range", "mean", "index_to_world")}
