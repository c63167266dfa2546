"""Point clouds: LAS and LAZ by laspy (LAZ through lazrs)."""

from importlib.metadata import version

import laspy
import numpy as np

from common import numbers, rows, spot_indices


def read_points(path, file):
    las = laspy.read(file)
    header = las.header
    # x = X · scale + offset in f64.
    xyz = np.stack([las.x.scaled_array(), las.y.scaled_array(), las.z.scaled_array()], axis=1)
    has_colors = "red" in las.point_format.dimension_names
    colors = np.stack([las.red, las.green, las.blue], axis=1) if has_colors else None
    reader = f"laspy {laspy.__version__}" + (f", lazrs {version('lazrs')}" if file.suffix == ".laz" else "")

    def spot(i):
        point = {"index": i, "xyz": numbers(xyz[i]), "intensity": int(las.intensity[i])}
        return {**point, "rgb16": numbers(colors[i])} if has_colors else point

    return {
        "kind": "points",
        "format": file.suffix[1:],
        "reader": reader,
        "version": str(header.version),
        "point_format": header.point_format.id,
        "count": len(xyz),
        "scale": numbers(header.scales),
        "offset": numbers(header.offsets),
        "bounds": rows([xyz.min(axis=0), xyz.max(axis=0)]),
        "header_bounds": rows([header.mins, header.maxs]),
        "mean": numbers(xyz.mean(axis=0)),
        "intensity": {"range": numbers([las.intensity.min(), las.intensity.max()]), "mean": float(np.mean(las.intensity, dtype=np.float64))},
        "rgb16": {"ranges": rows(np.stack([colors.min(axis=0), colors.max(axis=0)])), "mean": numbers(colors.mean(axis=0))} if has_colors else None,
        "spots": [spot(i) for i in spot_indices(len(xyz))],
    }
