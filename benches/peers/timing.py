"""What a peer takes and draws."""

import statistics
import time
from dataclasses import dataclass

import numpy as np
from PIL import Image


@dataclass
class Peer:
    """A program's way of drawing a scene."""

    scene: str
    # The program and its version.
    name: str
    # The file's name without its ending.
    stem: str
    # Draws, as often as it is called.
    draw: callable
    # The picture that was drawn last: rows from the top, red, green, blue, display-encoded 8-bit levels.
    picture: callable


def measured(peer, frames, folder):
    """Draws once to warm up, then so often; writes the picture, gives what `oblate chart` reads."""
    peer.draw()
    times = []
    for _ in range(frames):
        begun = time.perf_counter()
        peer.draw()
        times.append(1e3 * (time.perf_counter() - begun))
    picture = f"{peer.stem}.png"
    Image.fromarray(np.ascontiguousarray(peer.picture())).save(folder / picture)
    return {
        "scene": peer.scene,
        "name": peer.name,
        "median_ms": round(statistics.median(times), 3),
        "spread_ms": [round(min(times), 3), round(max(times), 3)],
        "picture": picture,
    }
