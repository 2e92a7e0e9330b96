"""Ends of edges as two common detectors find them, in rendered images: OpenCV's `cornerSubPix`, and the trace of Canny.

Both are told where the end should be, to a whole pixel, as the image is taken as registered. What OpenCV makes of it is
taken as it is, with parameters as in its own examples: no lines are fitted, and nothing is known of the part.
"""

import cv2
import numpy as np
from rendered_images import PATCH, Lamp, Renderer

# tiles of the picture around an end, to each side
_TILES = 1
# half a window for corners, px; the ends of Canny's thresholds, in grey levels of Sobel's gradient
_WINDOW = 5
_THRESHOLDS = (20, 60)
# a trace is followed from so far inside to so far outside of where the end should be, and may be so far off, px
_INSIDE = 14.0
_OUTSIDE = 10.0
_OFF = 1.0


def picture(
    renderer: Renderer, pose: np.ndarray, centre: np.ndarray, lamp: Lamp, rng
) -> tuple[np.ndarray, np.ndarray]:
    """Return grey values (s, s) of 255 around a place of the image, and the whole px (2,) of the first one."""
    side = 2 * PATCH + 1
    first = np.rint(centre).astype(int) - PATCH - _TILES * side
    n = 2 * _TILES + 1
    corners = first + side * np.stack(np.meshgrid(np.arange(n), np.arange(n)), axis=-1).reshape(
        -1, 2
    )
    tiles = renderer.patches(pose, corners, lamp, rng).reshape(n, n, side, side)
    return np.rint(255 * tiles.swapaxes(1, 2).reshape(n * side, n * side)).astype(np.uint8), first


def corner_sub_pix(grey: np.ndarray, first: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Return the corner (2,) that `cornerSubPix` finds from a whole pixel on, px."""
    start = (np.rint(expected) - first).astype(np.float32).reshape(1, 1, 2)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 0.001)
    return cv2.cornerSubPix(grey, start, (_WINDOW, _WINDOW), (-1, -1), stop).reshape(2) + first


def traced_end(
    grey: np.ndarray, first: np.ndarray, expected: np.ndarray, outward: np.ndarray
) -> np.ndarray:
    """Return where Canny's trace of an edge ends, whole px (2,); nan if there is none where the edge should be.

    The trace is followed in the direction ``outward`` (2,) as long as there is a pixel of it near the edge's line.
    """
    edges = np.argwhere(cv2.Canny(grey, *_THRESHOLDS, L2gradient=True) > 0)[:, ::-1] + first
    from_end = edges - expected
    along = from_end @ outward
    off = np.abs(from_end @ [-outward[1], outward[0]])
    near = (off <= _OFF) & (along >= -_INSIDE) & (along <= _OUTSIDE)
    if not near.any():
        return np.full(2, np.nan)
    order = np.flatnonzero(near)[np.argsort(along[near])]
    if along[order[0]] > -_INSIDE + 3.0:
        return np.full(2, np.nan)
    gap = np.flatnonzero(np.diff(along[order]) > 2.0)
    return edges[order[gap[0] if gap.size else -1]].astype(float)
