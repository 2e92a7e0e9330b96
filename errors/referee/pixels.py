"""A straight edge on the pixel grid: its image, the pixels that belong to it, and the length read off them.

The paper's rule: a pixel belongs to the edge when more than half of it is covered. Two ways to apply it:

* "axes": per image axis, as in the paper's one-dimensional figure. A column belongs when more than half of its width
  lies between the two ends, a row likewise; the extents are whole columns and rows.
* "area": as a detector meets it. The edge is a band a few pixels wide, a pixel's value is the exact covered area; of
  the pixels above one half the thin chain is kept, one per column (per row for steep edges), and each end of the chain
  is taken to lie half a column beyond the centre of its last pixel.

Pixel (i, j) covers [i r_x, (i + 1) r_x] x [j r_y, (j + 1) r_y]: the optical axis meets a corner of four pixels.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.checks import FloatArray, check_finite, check_pixel_pitch, check_positive
from errors.exceptions import InvalidParameterError, InvalidShapeError
from ground.loop_cache import njit

DETECTORS = ("axes", "area")

# Columns looked at on each side of an end; the chain's last pixel is within two of it.
_SEARCH = 4


def measure_lengths(
    segments: ArrayLike, *, pixel_pitch_mm: ArrayLike, detector: str = "axes", band_px: float = 3.0
) -> NDArray[np.float64]:
    """Return the lengths a detector reads off the pixel images of straight segments.

    Parameters
    ----------
    segments : array-like, shape (..., 2, 2)
        Image end points (u, v) in mm.
    pixel_pitch_mm : array-like, shape (2,)
        Pixel pitch (r_x, r_y) in mm.
    detector : {"axes", "area"}
        See the module's description.
    band_px : float
        Width of the edge's image in the larger pitch, for "area".

    Returns
    -------
    array, shape (...)
        Lengths in mm; NaN where no pixel of a segment is above one half.

    Raises
    ------
    InvalidParameterError
        If a value is not finite or out of range, or the detector is unknown.

    Examples
    --------
    >>> from errors import measure_lengths
    >>> segment = [[0.003, 0.003], [0.103, 0.003]]
    >>> round(float(measure_lengths(segment, pixel_pitch_mm=(0.005, 0.005))), 6)
    0.1
    """
    segments = check_finite(segments, "segments")
    pitch = check_pixel_pitch(pixel_pitch_mm)
    band = check_positive(band_px, "band_px") * pitch.max()
    if segments.ndim < 2 or segments.shape[-2:] != (2, 2):
        raise InvalidShapeError(
            f"segments must have shape (..., 2, 2). Got shape {segments.shape}."
        )
    if detector not in DETECTORS:
        raise InvalidParameterError(f"detector must be one of {DETECTORS}. Got {detector!r}.")
    if detector == "axes":
        extents = _whole_pixels(segments / pitch) * pitch
        return np.hypot(extents[..., 0], extents[..., 1])
    flat = np.ascontiguousarray(segments).reshape(-1, 2, 2)
    out = np.empty(len(flat))
    _measure_chains(flat, pitch, band, out)
    return out.reshape(segments.shape[:-2])


def coverage_image(
    segment: ArrayLike, *, pixel_pitch_mm: ArrayLike, band_px: float = 3.0, margin_px: int = 3
) -> tuple[NDArray[np.float64], tuple[int, int]]:
    """Return the image of a segment: the covered fraction of every pixel, exact.

    Parameters
    ----------
    segment : array-like, shape (2, 2)
        Image end points (u, v) in mm.
    pixel_pitch_mm : array-like, shape (2,)
        Pixel pitch (r_x, r_y) in mm.
    band_px : float
        Width of the band in the larger pitch.
    margin_px : int
        Pixels around the segment's bounding box.

    Returns
    -------
    image : array, shape (rows, columns)
        Covered fractions in [0, 1]; the row index grows with v.
    origin : tuple of int
        Indices (i, j) of the pixel in column 0, row 0.

    Raises
    ------
    InvalidParameterError
        If a value is not finite, or a pitch is not positive.

    Examples
    --------
    >>> from errors import coverage_image
    >>> band = [[0.0, 0.005], [0.1, 0.005]]
    >>> image, origin = coverage_image(band, pixel_pitch_mm=(0.005, 0.005), band_px=2.0, margin_px=1)
    >>> image.shape, origin, [round(float(x), 3) for x in image[:, 10]]
    ((3, 23), (-1, 0), [1.0, 1.0, 0.0])
    """
    segment = check_finite(segment, "segment")
    pitch = check_pixel_pitch(pixel_pitch_mm)
    low = np.floor(segment.min(axis=0) / pitch).astype(int) - margin_px
    high = np.ceil(segment.max(axis=0) / pitch).astype(int) + margin_px
    image = np.empty((high[1] - low[1] + 1, high[0] - low[0] + 1))
    _render(np.ascontiguousarray(segment), pitch, band_px * pitch.max(), low[0], low[1], image)
    return image, (int(low[0]), int(low[1]))


def _whole_pixels(ends: FloatArray) -> FloatArray:
    """Count, per axis, the pixels more than half of which lies between the two ends; ends (..., 2, 2) in pixels."""
    low = ends.min(axis=-2)
    high = ends.max(axis=-2)
    # More than half covered means that the pixel's centre lies between the ends, unless both are within half a pixel.
    centres = np.ceil(high - 0.5) - np.floor(low - 0.5) - 1.0
    return np.where(high - low > 0.5, centres, 0.0)


@njit(error_model="numpy")
def _render(segment, pitch, band, first_i, first_j, image):
    corners = _band_corners(segment, band)
    scratch = np.empty((2, 12, 2))
    for j in range(image.shape[0]):
        for i in range(image.shape[1]):
            image[j, i] = _coverage(
                corners,
                (first_i + i + 0.5) * pitch[0],
                (first_j + j + 0.5) * pitch[1],
                pitch,
                scratch,
            )


@njit(error_model="numpy")
def _band_corners(segment, band):
    """Return the four corners of the band, counter-clockwise."""
    du = segment[1, 0] - segment[0, 0]
    dv = segment[1, 1] - segment[0, 1]
    scale = 0.5 * band / math.hypot(du, dv)
    nu = -dv * scale
    nv = du * scale
    corners = np.empty((4, 2))
    corners[0, 0] = segment[0, 0] - nu
    corners[0, 1] = segment[0, 1] - nv
    corners[1, 0] = segment[1, 0] - nu
    corners[1, 1] = segment[1, 1] - nv
    corners[2, 0] = segment[1, 0] + nu
    corners[2, 1] = segment[1, 1] + nv
    corners[3, 0] = segment[0, 0] + nu
    corners[3, 1] = segment[0, 1] + nv
    return corners


@njit(error_model="numpy")
def _coverage(corners, u, v, pitch, scratch):
    """Return the fraction of the pixel centred at (u, v) inside a convex counter-clockwise quadrangle, by clipping."""
    polygon = scratch[0]
    clipped = scratch[1]
    n = 4
    for k in range(4):
        polygon[k, 0] = u + pitch[0] * (0.5 if k in (1, 2) else -0.5)
        polygon[k, 1] = v + pitch[1] * (0.5 if k >= 2 else -0.5)
    for k in range(4):
        a = corners[k]
        b = corners[(k + 1) % 4]
        m = 0
        for i in range(n):
            p = polygon[i]
            q = polygon[(i + 1) % n]
            # twice a signed area: positive inside, left of the side from a to b
            sp = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
            sq = (b[0] - a[0]) * (q[1] - a[1]) - (b[1] - a[1]) * (q[0] - a[0])
            if sp >= 0.0:
                clipped[m, 0] = p[0]
                clipped[m, 1] = p[1]
                m += 1
            if (sp > 0.0 and sq < 0.0) or (sp < 0.0 and sq > 0.0):
                w = sp / (sp - sq)
                clipped[m, 0] = p[0] + w * (q[0] - p[0])
                clipped[m, 1] = p[1] + w * (q[1] - p[1])
                m += 1
        polygon, clipped, n = clipped, polygon, m
    area = 0.0
    for i in range(n):
        p = polygon[i]
        q = polygon[(i + 1) % n]
        # triangles about the centre of the pixel
        area += 0.5 * ((p[0] - u) * (q[1] - v) - (p[1] - v) * (q[0] - u))
    return area / (pitch[0] * pitch[1])


@njit(error_model="numpy")
def _measure_chains(segments, pitch, band, out):
    last = np.empty((2, 2))
    scratch = np.empty((2, 12, 2))
    for n in range(len(segments)):
        segment = segments[n]
        du = segment[1, 0] - segment[0, 0]
        dv = segment[1, 1] - segment[0, 1]
        major = 0 if abs(du) * pitch[1] >= abs(dv) * pitch[0] else 1
        corners = _band_corners(segment, band)
        is_complete = True
        for end in range(2):
            is_complete = (
                _last_pixel(segment, corners, pitch, major, end, scratch, last[end]) and is_complete
            )
        if not is_complete:
            out[n] = np.nan
            continue
        cu = last[1, 0] - last[0, 0]
        cv = last[1, 1] - last[0, 1]
        # Half a column beyond each end pixel's centre, along the chain.
        extent = abs(cu) if major == 0 else abs(cv)
        length = math.hypot(cu, cv)
        out[n] = length * (1.0 + pitch[major] / extent) if extent > 0.0 else pitch[major]


@njit(error_model="numpy")
def _last_pixel(segment, corners, pitch, major, end, scratch, centre):
    """Write the centre of the chain's last pixel at one end; False when no pixel near it belongs to the edge."""
    minor = 1 - major
    here = segment[end]
    other = segment[1 - end]
    outward = 1 if here[major] > other[major] else -1
    slope = (other[minor] - here[minor]) / (other[major] - here[major])
    start = math.floor(here[major] / pitch[major])
    for step in range(_SEARCH, -_SEARCH - 1, -1):
        centre[major] = (start + outward * step + 0.5) * pitch[major]
        on_line = here[minor] + slope * (centre[major] - here[major])
        centre[minor] = (math.floor(on_line / pitch[minor]) + 0.5) * pitch[minor]
        if _coverage(corners, centre[0], centre[1], pitch, scratch) > 0.5:
            return True
    return False
