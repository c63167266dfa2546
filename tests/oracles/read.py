"""Reads the test data with the readers that their communities use and writes what these say into expected/.

    python read.py [part of a path ...]

Trained splats are read by splats.mjs.
"""

import sys

from grids import read_grid
from meshes import read_mesh
from points import read_points
from volumes import read_volume

from common import place, write

FILES = {
    read_volume: [
        "volumes/CThead_256x256x113_uint16be.raw.gz",
        "volumes/LIDC2.vti",
        "volumes/aneurism_256x256x256_uint8.raw.gz",
        "volumes/bonsai_256x256x256_uint8.raw.gz",
        "volumes/engine.vti",
        "volumes/engine_256x256x128_uint8.raw.gz",
        "volumes/mricron_ch2better.nii.gz",
        "volumes/tooth.nrrd",
        "volumes/vtk_hydrogen.vti",
        "written/appended.vti",
        "written/ascii.points.vtk",
        "written/big_endian.nii",
        "written/binary.points.vtk",
        "written/bytes.mha",
        "written/detached.nhdr",
        "written/even.rectilinear.vtk",
        "written/even.vtr",
        "written/flipped.mhd",
        "written/qform_flipped.nii",
        "written/second.nii",
        "written/sform_and_qform.nii.gz",
        "written/stack.tif",
        "written/turned.mha",
        "written/turned.nrrd",
        "written/turned.vti",
    ],
    read_mesh: [
        "meshes/DamagedHelmet.glb",
        "meshes/Duck.glb",
        "meshes/armadillo.obj",
        "meshes/bunny.ply",
        "meshes/fuze_wood/fuze.obj",
        "meshes/fuze_wood/wood.obj",
        "meshes/lucy.ply",
        "meshes/spot/spot_control_mesh.obj",
        "meshes/spot/spot_quadrangulated.obj",
        "meshes/spot/spot_triangulated.obj",
        "written/ascii.stl",
        "written/binary.stl",
        "written/polygons.ply",
    ],
    read_points: [
        "pointclouds/autzen_trim.las",
        "pointclouds/lone-star.laz",
        "written/colored.laz",
        "written/plain.las",
        "written/points.ply",
    ],
    read_grid: ["irregular/bluntfinxyz.bin", "irregular/combxyz.bin", "irregular/office.binary.vtk"],
}


def main():
    wanted = sys.argv[1:]
    for read, paths in FILES.items():
        for path in paths:
            if not wanted or any(part in path for part in wanted):
                write(path, read(path, place(path)))


main()
