"""Volumes: raw samples by NumPy, NIfTI by nibabel, NRRD by pynrrd, VTI by VTK; NIfTI and NRRD by SimpleITK as well."""

import gzip
import re

import nibabel
import nrrd
import numpy as np
import SimpleITK
import vtk
from vtk.util.numpy_support import vtk_to_numpy

from common import number, numbers, rows, voxel_spots


def read_volume(path, file):
    readers = {".gz": by_numpy, ".vti": by_vtk, ".nrrd": by_pynrrd}
    return (by_nibabel if path.endswith(".nii.gz") else readers[file.suffix])(file)


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
    reader = vtk.vtkXMLImageDataReader()
    reader.SetFileName(str(file))
    reader.Update()
    image = reader.GetOutput()
    array = image.GetPointData().GetArray(0)
    samples = vtk_to_numpy(array).reshape(image.GetDimensions(), order="F")
    direction = [[image.GetDirectionMatrix().GetElement(r, c) for c in range(3)] for r in range(3)]
    kind = {"uint8": "u8", "float32": "f32"}[samples.dtype.name]
    facts = {"format": "vti", "reader": f"vtk {vtk.vtkVersion.GetVTKVersion()}", "sample_type": kind}
    where = frame(image.GetSpacing(), image.GetOrigin(), direction)
    return described(samples, {**facts, "array": array.GetName(), "frame": "as in file", **where})


def by_nibabel(file):
    image = nibabel.load(file)
    header = image.header
    samples = np.asanyarray(image.dataobj)
    spacing = np.linalg.norm(image.affine[:3, :3], axis=0)
    facts = {
        "format": "nii.gz",
        "reader": f"nibabel {nibabel.__version__}",
        "sample_type": {"uint8": "u8", "int16": "i16", "float64": "f64"}[header.get_data_dtype().name],
        "slope_intercept": [None if v is None else float(v) for v in header.get_slope_inter()],
        "codes": {"sform": int(header["sform_code"]), "qform": int(header["qform_code"])},
        "qform": rows(header.get_qform()),
        "sform": rows(header.get_sform()),
        "pixdim": numbers(header["pixdim"]),
        "frame": "RAS+ (x to the right, y to the front, z up, of a patient)",
        **frame(spacing, image.affine[:3, 3], image.affine[:3, :3] / spacing),
    }
    return {**described(samples, facts), "also": [by_itk(file)]}


def by_pynrrd(file):
    samples, header = nrrd.read(str(file), index_order="F")
    directions = np.asarray(header["space directions"], float).T
    spacing = np.linalg.norm(directions, axis=0)
    facts = {
        "format": "nrrd",
        "reader": f"pynrrd {nrrd.__version__}",
        "sample_type": {"uint8": "u8"}[samples.dtype.name],
        "frame": f"as in file ({header['space']})",
        **frame(spacing, header["space origin"], directions / spacing),
    }
    return {**described(samples, facts), "also": [by_itk(file)]}


def by_itk(file):
    """ITK's world is LPS+ whatever the file's is."""
    image = SimpleITK.ReadImage(str(file))
    samples = SimpleITK.GetArrayViewFromImage(image).T
    direction = np.reshape(image.GetDirection(), (3, 3))
    return {
        "reader": f"SimpleITK {SimpleITK.__version__}",
        "frame": "LPS+",
        "dims": list(image.GetSize()),
        "range": [number(samples.min()), number(samples.max())],
        "mean": float(samples.mean(dtype=np.float64)),
        "index_to_world": frame(image.GetSpacing(), image.GetOrigin(), direction)["index_to_world"],
    }
