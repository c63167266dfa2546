"""What all of the readers here share: where data is, which samples are looked at, how results are written."""

import json
import os
import pathlib

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
DATA = pathlib.Path(os.environ.get("OBLATE_DATA", HERE / "../../../shared/data"))
SPOTS = 16


def place(path):
    """Files that write.py made lie here."""
    return (HERE if path.startswith("written/") else DATA) / path


def spot_indices(count, spots=SPOTS):
    """Both ends and, between them, places that no period of a file meets again and again."""
    if count <= spots:
        return list(range(count))
    golden = (5**0.5 - 1) / 2
    inner = {int((k * golden) % 1 * count) for k in range(1, 4 * spots)} - {0, count - 1}
    return sorted([0, count - 1, *sorted(inner, key=lambda i: (i * 2654435761) % 2**32)[: spots - 2]])


def voxel_spots(dims):
    """The eight corners, the middle and seven others, as (x, y, z)."""
    last = [d - 1 for d in dims]
    corners = [[last[a] * (c >> a & 1) for a in range(3)] for c in range(8)]
    shares = [(1, 1, 1, 2), (1, 2, 3, 7), (3, 1, 2, 5), (2, 5, 3, 7), (5, 3, 4, 9), (4, 4, 3, 11), (2, 6, 5, 8), (7, 5, 6, 13)]
    inner = [[last[a] * share[a] // share[3] for a in range(3)] for share in shares]
    return corners + inner


def number(value):
    """A number for JSON: f32 in the nine digits that tell every one apart, everything else exactly."""
    if isinstance(value, np.float32):
        return float(f"{value:.9g}")
    return value.item() if isinstance(value, np.generic) else value


def numbers(values):
    return [number(v) for v in np.asarray(values).ravel()]


def rows(matrix):
    return [numbers(row) for row in np.asarray(matrix)]


def file_name(path):
    return "".join(c if c.isalnum() else "_" for c in path) + ".json"


def _text(value, depth=0):
    """JSON with one line for everything that holds no objects and for every object in a list."""
    if isinstance(value, dict) and depth == 0:
        lines = [f"  {json.dumps(k)}: {_text(v, 1)}" for k, v in value.items()]
        return "{\n" + ",\n".join(lines) + "\n}"
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return "[\n" + ",\n".join("    " + json.dumps(v) for v in value) + "\n  ]"
    return json.dumps(value)


def write(path, facts):
    target = HERE / "expected" / file_name(path)
    text = _text({"file": path, **facts}) + "\n"
    json.loads(text)
    assert len(text) < 20_000, f"{target.name} has {len(text)} bytes"
    target.write_text(text)
    print(target.name, len(text))
