"""Curvilinear grids, by VTK: PLOT3D (a file of positions, a file of the flow) and legacy VTK."""

import vtk
from vtk.util.numpy_support import vtk_to_numpy

from common import numbers, number, rows, voxel_spots


def read_grid(path, file):
    grid = legacy(file) if file.suffix == ".vtk" else plot3d(file)
    dims = [0, 0, 0]
    grid.GetDimensions(dims)
    positions = vtk_to_numpy(grid.GetPoints().GetData())
    arrays = [grid.GetPointData().GetArray(i) for i in range(grid.GetPointData().GetNumberOfArrays())]
    arrays = [(array.GetName(), vtk_to_numpy(array)) for array in arrays]
    scalars = [(name, values) for name, values in arrays if values.ndim == 1]

    def spot(index):
        place = (index[2] * dims[1] + index[1]) * dims[0] + index[0]
        return {"index": index, "xyz": numbers(positions[place]), **{name: number(values[place]) for name, values in scalars}}

    return {
        "kind": "structured_grid",
        "format": "vtk" if file.suffix == ".vtk" else "plot3d",
        "reader": f"vtk {vtk.vtkVersion.GetVTKVersion()}",
        "dims": dims,
        "bounds": rows([positions.min(axis=0), positions.max(axis=0)]),
        "arrays": [{"name": name, "components": 1 if v.ndim == 1 else v.shape[1], "range": numbers([v.min(), v.max()])} for name, v in arrays],
        "spots": [spot(index) for index in voxel_spots(dims)],
    }


def legacy(file):
    reader = vtk.vtkStructuredGridReader()
    reader.SetFileName(str(file))
    reader.ReadAllScalarsOn()
    reader.ReadAllVectorsOn()
    reader.Update()
    return reader.GetOutput()


def plot3d(file):
    """Big-endian, one grid, no byte counts; the flow lies beside the positions."""
    reader = vtk.vtkMultiBlockPLOT3DReader()
    reader.SetXYZFileName(str(file))
    reader.SetQFileName(str(file.with_name(file.name.replace("xyz", "q"))))
    reader.SetScalarFunctionNumber(100)
    reader.SetVectorFunctionNumber(202)
    reader.AutoDetectFormatOn()
    reader.Update()
    return reader.GetOutput().GetBlock(0)
