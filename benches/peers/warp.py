"""The scene `warp`: a photograph with depths, seen from elsewhere."""

import cv2
import numba
import numpy as np
from PIL import Image

from timing import Peer


class Warp:
    """What is read, once, and what was drawn last."""

    def __init__(self, scene, folder):
        width, height = scene["size"]
        self.photograph = np.asarray(Image.open(folder / scene["photograph"]).convert("RGB"))
        self.depths = np.fromfile(folder / scene["depths"], "<f4").reshape(height, width)
        self.focal = np.array(scene["intrinsics"]["focal"], np.float32)
        self.center = np.array(scene["intrinsics"]["center"], np.float32)
        here, there = (np.vstack([scene[name], [0, 0, 0, 1]]) for name in ("world_to_camera", "world_to_view"))
        self.camera_to_view = there @ np.linalg.inv(here)
        self.background = np.round(255 * np.array(scene["background"])).astype(np.uint8)
        self.picture = np.empty_like(self.photograph)
        self.nearest = np.empty_like(self.depths)

    def write_nearest(self, reach):
        """Every pixel over the (2 reach + 1)² that it falls on, the nearest in front."""
        matrix = self.camera_to_view[:3].astype(np.float32)
        self.picture[:] = self.background
        self.nearest[:] = np.inf
        write(self.depths, self.photograph, (matrix, self.focal, self.center), (self.nearest, self.picture), reach)

    def write_opencv(self):
        """OpenCV counts pixels from the centre of the first; but warpFrame rounds down, so that its pose adds half a pixel."""
        (fx, fy), (cx, cy) = self.focal, self.center - 0.5
        intrinsics = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], np.float64)
        by_half = np.array([[1, 0, 0.5 / fx, 0], [0, 1, 0.5 / fy, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        pose = by_half @ self.camera_to_view
        _, warped, shown = cv2.warpFrame(self.depths, self.photograph, None, pose, intrinsics)
        warped[shown == 0] = self.background
        self.picture = warped


@numba.njit(fastmath=True)
def write(depths, photograph, camera, out, reach):
    (matrix, focal, center), (nearest, picture) = camera, out
    height, width = depths.shape
    half = np.float32(0.5)
    for row in range(height):
        for column in range(width):
            depth = depths[row, column]
            x = (column + half - center[0]) / focal[0] * depth
            y = (row + half - center[1]) / focal[1] * depth
            z = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * depth + matrix[2, 3]
            if not z > 0:
                continue
            across = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * depth + matrix[0, 3]
            down = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * depth + matrix[1, 3]
            left = int(np.floor(focal[0] * across / z + center[0]))
            top = int(np.floor(focal[1] * down / z + center[1]))
            for j in range(max(top - reach, 0), min(top + reach + 1, height)):
                for i in range(max(left - reach, 0), min(left + reach + 1, width)):
                    if z < nearest[j, i]:
                        nearest[j, i] = z
                        for channel in range(3):
                            picture[j, i, channel] = photograph[row, column, channel]


def peers(scene, folder):
    """Nearest writes by Numba and by OpenCV."""
    warp = Warp(scene, folder)
    ways = [
        (f"Numba {numba.__version__}, nearest writes", "warp_numba_1", lambda: warp.write_nearest(0)),
        (f"Numba {numba.__version__}, 3×3 writes", "warp_numba_3", lambda: warp.write_nearest(1)),
        (f"OpenCV {cv2.__version__} warpFrame", "warp_opencv", warp.write_opencv),
    ]
    for name, stem, draw in ways:
        yield Peer(scene="warp", name=name, stem=stem, draw=draw, picture=lambda: warp.picture)
