"""Meshes: PLY by plyfile, OBJ by VTK, GLB and STL by trimesh; what does not depend on an order is computed here."""

from importlib.metadata import version

import numpy as np
import plyfile
import trimesh
import vtk
from vtk.util.numpy_support import vtk_to_numpy

from common import numbers, rows, spot_indices


def read_mesh(path, file):
    return {".ply": by_plyfile, ".obj": by_vtk, ".glb": by_trimesh, ".stl": facets_by_trimesh}[file.suffix](file)


def fans(polygons):
    """Triangles (p0, pk, pk+1) of polygons, in the order of the file."""
    return np.array([[p[0], p[k], p[k + 1]] for p in polygons for k in range(1, len(p) - 1)], np.int64)


def described(positions, triangles, facts):
    """`positions` in the mesh's space, `triangles` as indices into them."""
    positions = np.asarray(positions, np.float64)
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    crossed = np.cross(b - a, c - a)
    areas = np.linalg.norm(crossed, axis=1) / 2
    middle = (positions.min(axis=0) + positions.max(axis=0)) / 2
    volume = np.einsum("ij,ij->i", a - middle, np.cross(b - middle, c - middle)).sum() / 6
    return {
        "kind": "mesh",
        **facts,
        "triangles": len(triangles),
        "bounds": rows([positions.min(axis=0), positions.max(axis=0)]),
        "area": float(areas.sum()),
        "area_centroid": numbers((areas[:, None] * (a + b + c) / 3).sum(axis=0) / areas.sum()),
        # Positive where triangles are counter-clockwise seen from outside.
        "signed_volume": float(volume),
        "spot_triangles": [{"index": i, "corners": rows(positions[triangles[i]].astype(np.float32))} for i in spot_indices(len(triangles))],
    }


def by_plyfile(file):
    ply = plyfile.PlyData.read(str(file))
    vertex = ply["vertex"]
    positions = np.stack([vertex["x"], vertex["y"], vertex["z"]], axis=1)
    polygons = ply["face"]["vertex_indices"]
    columns = [p.name for p in vertex.properties]
    facts = {"format": "ply", "reader": f"plyfile {version('plyfile')}"}
    return described(positions, fans(polygons), {**facts, "columns": columns, "vertices": len(positions)})


def by_vtk(file):
    """VTK gives texture coordinates that differ at one position a point of its own, as renderers need it."""
    reader = vtk.vtkOBJReader()
    reader.SetFileName(str(file))
    reader.Update()
    surface = reader.GetOutput()
    cells = surface.GetPolys()
    offsets, corners = vtk_to_numpy(cells.GetOffsetsArray()), vtk_to_numpy(cells.GetConnectivityArray())
    polygons = [corners[a:b] for a, b in zip(offsets[:-1], offsets[1:])]
    lines = [line.split() for line in file.read_text().splitlines()]
    faces = [line[1:] for line in lines if line[:1] == ["f"]]
    assert len(faces) == len(polygons)
    facts = {
        "format": "obj",
        "reader": f"vtk {vtk.vtkVersion.GetVTKVersion()}",
        "polygons": len(polygons),
        # Counted from the text: `v` lines, and the different corners that faces name.
        "vertices": sum(line[:1] == ["v"] for line in lines),
        "corners": len({corner for face in faces for corner in face}),
    }
    return described(vtk_to_numpy(surface.GetPoints().GetData()), fans(polygons), facts)


def by_trimesh(file):
    """All nodes of the default scene in its space."""
    scene = trimesh.load_scene(file, process=False)
    positions, triangles, textures = [], [], []
    for node in scene.graph.nodes_geometry:
        node_to_scene, name = scene.graph[node]
        mesh = scene.geometry[name]
        triangles.append(mesh.faces + sum(map(len, positions)))
        positions.append(trimesh.transform_points(mesh.vertices, node_to_scene))
        image = mesh.visual.material.baseColorTexture
        texels = np.asarray(image.convert("RGB"), np.float64)
        textures.append({"width": image.width, "height": image.height, "mean": numbers(texels.mean(axis=(0, 1)))})
    facts = {"format": "glb", "reader": f"trimesh {trimesh.__version__}", "textures": textures}
    facts["vertices"] = sum(map(len, positions))
    return described(np.concatenate(positions), np.concatenate(triangles), facts)


def facets_by_trimesh(file):
    """Each facet has corners of its own: how many positions that makes is up to the reader."""
    mesh = trimesh.load_mesh(file, process=False)
    facts = {"format": "stl", "reader": f"trimesh {trimesh.__version__}", "vertices": None}
    return described(mesh.vertices, np.asarray(mesh.faces), facts)
