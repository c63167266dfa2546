"""Point clouds: LAS and LAZ by laspy (LAZ through lazrs), PLY by plyfile."""

from importlib.metadata import version

import laspy
import numpy as np
import plyfile

from common import numbers, rows, spot_indices


def read_points(path, file):
    return (by_plyfile if file.suffix == ".ply" else by_laspy)(file)


def described(xyz, colors, intensities, facts):
    """Colours and intensities may be None."""

    def spot(i):
        point = {"index": i, "xyz": numbers(xyz[i])}
        if intensities is not None:
            point["intensity"] = int(intensities[i])
        if colors is not None:
            point["rgb"] = numbers(colors[i])
        return point

    def ranges(values):
        return {"range": rows([values.min(axis=0), values.max(axis=0)]), "mean": numbers(values.mean(axis=0, dtype=np.float64))}

    return {
        "kind": "points",
        **facts,
        "count": len(xyz),
        "bounds": rows([xyz.min(axis=0), xyz.max(axis=0)]),
        "mean": numbers(xyz.mean(axis=0)),
        "intensity": None if intensities is None else ranges(intensities[:, None]),
        # Of 8 or 16 bits, as the file has them.
        "rgb": None if colors is None else ranges(colors),
        "spots": [spot(i) for i in spot_indices(len(xyz))],
    }


def by_plyfile(file):
    vertex = plyfile.PlyData.read(str(file))["vertex"]
    xyz, colors = (np.stack([vertex[name] for name in names], axis=1) for names in [("x", "y", "z"), ("red", "green", "blue")])
    facts = {"format": "ply", "reader": f"plyfile {version('plyfile')}", "columns": [p.name for p in vertex.properties]}
    return described(xyz.astype(np.float64), colors, None, facts)


def by_laspy(file):
    las = laspy.read(file)
    header = las.header
    # x = X · scale + offset in f64.
    xyz = np.stack([las.x.scaled_array(), las.y.scaled_array(), las.z.scaled_array()], axis=1)
    has_colors = "red" in las.point_format.dimension_names
    colors = np.stack([las.red, las.green, las.blue], axis=1) if has_colors else None
    facts = {
        "format": file.suffix[1:],
        "reader": f"laspy {laspy.__version__}" + (f", lazrs {version('lazrs')}" if file.suffix == ".laz" else ""),
        "version": str(header.version),
        "point_format": header.point_format.id,
        "scale": numbers(header.scales),
        "offset": numbers(header.offsets),
        "header_bounds": rows([header.mins, header.maxs]),
    }
    return described(xyz, colors, np.asarray(las.intensity), facts)
