"""What every pose that inspects an item fulfils: the home of each necessary condition of the bound. Compiled loops.

Of nodal points only a ball or a box is known. A condition fails there if it fails for all of them. A ``view`` is
anything that has the ``near`` and ``far`` sharp depths and the tangents ``tan_x`` and ``tan_y`` of the half angles.
"""

from __future__ import annotations

import math

from compiled.decorators import entry_kernel, kernel_without_refcounts

# more than the rounding of planes, corners and viewpoints: cells that only touch count as meeting
TOUCH_MM = 1e-6
# for rounding, relative
_EPS = 1e-9


@kernel_without_refcounts
def slant(view):
    """Return how much farther away than deep a corner of the view is: 1 / cos(cone)."""
    return math.sqrt(1.0 + view.tan_x**2 + view.tan_y**2)


@entry_kernel
def focus_reach(view):
    """Return how far from the nodal point a point in view and in focus can be, mm."""
    return view.far * slant(view)


@kernel_without_refcounts
def out_of_focus(distance, radius, view):
    """Tell whether a point is too near or too far for a ball of nodal points, given its distance from the middle."""
    return distance - radius > focus_reach(view) or distance + radius < view.near


@kernel_without_refcounts
def ends_out_of_focus(ends, eye, view):
    """Tell whether one of two ends is too near or too far for a box (2, 3) of nodal points."""
    reach = focus_reach(view)
    for i in range(2):
        least = 0.0
        most = 0.0
        for k in range(3):
            least += max(eye[0, k] - ends[i, k], ends[i, k] - eye[1, k], 0.0) ** 2
            most += max(eye[1, k] - ends[i, k], ends[i, k] - eye[0, k]) ** 2
        if least > reach * reach or most < view.near * view.near:
            return True
    return False


@kernel_without_refcounts
def too_short(ends, length, ratio, c, radius, view):
    """Tell whether an image is too short from every nodal point of a ball: a depth is at least distance cos(cone).

    ``ratio`` is the length that it must have at least, over the image distance; 0 asks for none.
    """
    if ratio <= 0.0:
        return False
    depths = 1.0
    for i in range(2):
        distance = math.sqrt(
            (ends[i, 0] - c[0]) ** 2 + (ends[i, 1] - c[1]) ** 2 + (ends[i, 2] - c[2]) ** 2
        )
        depths *= max(view.near, (distance - radius) / slant(view))
    return too_short_at(ends, length, ratio, c, radius, depths)


@kernel_without_refcounts
def too_short_at(ends, length, ratio, c, radius, depths):
    """Tell whether an image is too short from a ball, given the product of the least depths of its ends.

    By eq 16 with ||w x v|| <= ||w||, the image over the image distance is at most twice the area of the triangle of
    nodal point and ends, over that product.
    """
    w0 = ends[1, 0] - ends[0, 0]
    w1 = ends[1, 1] - ends[0, 1]
    w2 = ends[1, 2] - ends[0, 2]
    o0 = c[0] - ends[0, 0]
    o1 = c[1] - ends[0, 1]
    o2 = c[2] - ends[0, 2]
    area = math.sqrt((o1 * w2 - o2 * w1) ** 2 + (o2 * w0 - o0 * w2) ** 2 + (o0 * w1 - o1 * w0) ** 2)
    return area + radius * length < ratio * depths * (1.0 - _EPS)


@kernel_without_refcounts
def outside(planes, first, last, middle, half):
    """Tell whether a box lies wholly outside of a cell, that of the planes from ``first`` to ``last``."""
    for p in range(first, last):
        p0 = planes[p, 0]
        p1 = planes[p, 1]
        p2 = planes[p, 2]
        value = planes[p, 3] + p0 * middle[0] + p1 * middle[1] + p2 * middle[2]
        if value - abs(p0) * half[0] - abs(p1) * half[1] - abs(p2) * half[2] > TOUCH_MM:
            return True
    return False
