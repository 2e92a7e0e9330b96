"""Points to pixels of displaced cameras, and pixels back to planes, as compiled loops."""

from __future__ import annotations

from typing import Any

import numpy as np

from compiled.decorators import entry_kernel


@entry_kernel(error_model="numpy")
def image_points(points: Any, poses: Any, scale: Any, found: Any) -> None:
    """Write the images of points, without distortion.

    Parameters
    ----------
    points : array (m, 3)
        In the part's frame, mm.
    poses : array (n, 4, 4)
        Cam2world.
    scale : array (4,)
        Focal lengths and principal point, px.
    found : array (n, m, 2)
        Gets the pixels; no numbers behind the camera.
    """
    for k in range(len(poses)):
        for j in range(len(points)):
            x = points[j, 0] - poses[k, 0, 3]
            y = points[j, 1] - poses[k, 1, 3]
            z = points[j, 2] - poses[k, 2, 3]
            depth = x * poses[k, 0, 2] + y * poses[k, 1, 2] + z * poses[k, 2, 2]
            if not depth > 0.0:
                found[k, j, 0] = np.nan
                found[k, j, 1] = np.nan
                continue
            across = x * poses[k, 0, 0] + y * poses[k, 1, 0] + z * poses[k, 2, 0]
            down = x * poses[k, 0, 1] + y * poses[k, 1, 1] + z * poses[k, 2, 1]
            found[k, j, 0] = across / depth * scale[0] + scale[2]
            found[k, j, 1] = down / depth * scale[1] + scale[3]


@entry_kernel(error_model="numpy")
def carry_back(pixels: Any, planned: Any, scale: Any, frame: Any, found: Any) -> None:
    """Write where rays of the planned pose meet a plane.

    Parameters
    ----------
    pixels : array (n, m, 2)
        Images without distortion.
    planned : array (4, 4)
        Cam2world.
    scale : array (4,)
        Focal lengths and principal point, px.
    frame : array (3, 3)
        Origin of the plane, and its axes.
    found : array (n, m, 2)
        Gets the coordinates in the plane, mm.
    """
    normal = np.empty(3)
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        normal[i] = frame[1, j] * frame[2, k] - frame[1, k] * frame[2, j]
    height = 0.0
    off = np.empty(3)
    for i in range(3):
        off[i] = planned[i, 3] - frame[0, i]
        height -= off[i] * normal[i]
    local = np.empty(3)
    for k in range(len(pixels)):
        for j in range(pixels.shape[1]):
            x = (pixels[k, j, 0] - scale[2]) / scale[0]
            y = (pixels[k, j, 1] - scale[3]) / scale[1]
            along = 0.0
            for i in range(3):
                local[i] = x * planned[i, 0] + y * planned[i, 1] + planned[i, 2]
                along += local[i] * normal[i]
            depth = height / along
            first = 0.0
            second = 0.0
            for i in range(3):
                place = off[i] + depth * local[i]
                first += place * frame[1, i]
                second += place * frame[2, i]
            found[k, j, 0] = first
            found[k, j, 1] = second
