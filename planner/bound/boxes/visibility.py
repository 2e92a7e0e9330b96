"""Which cells the nodal points of a box may enter, and which ends are out of range. Compiled loops.

The notation is that of `windows`.
"""

from __future__ import annotations

from compiled.decorators import kernel_without_refcounts
from planner.bound.boxes.box_conditions import TOUCH_MM, outside


@kernel_without_refcounts
def keep_cells(entities, cells, c, h, swing, rest, eye):
    """Move to the front the cells that some nodal point of a box, or a point around it, may lie in; return how many.

    0 if no nodal point itself lies in one; -1 if all of them, with the points around them, lie in one: that one is the
    first then. The nodal points are those about c, given how far the point looked at and the turn move them, that are
    in the box ``eye`` (2, 3).
    """
    # by their own names: else much of the time goes into counting references
    around = entities.around
    planes = entities.planes
    plane_start = entities.plane_start
    boxes = entities.boxes
    kept = 0
    met = False
    for cell in cells:
        apart = False
        holds = True
        for k in range(3):
            if boxes[cell, 0, k] > eye[1, k] + around or boxes[cell, 1, k] < eye[0, k] - around:
                apart = True
        inside = not apart
        for p in range(plane_start[cell], plane_start[cell + 1]):
            if apart:
                break
            p0 = planes[p, 0]
            p1 = planes[p, 1]
            p2 = planes[p, 2]
            low = high = planes[p, 3]
            value = low + p0 * c[0] + p1 * c[1] + p2 * c[2]
            slack = abs(p0) * h[0] + abs(p1) * h[1] + abs(p2) * h[2] + rest
            for k in range(3):
                slack += abs(p0 * swing[k, 0] + p1 * swing[k, 1] + p2 * swing[k, 2])
            if p0 > 0.0:
                low = low + p0 * eye[0, 0]
                high = high + p0 * eye[1, 0]
            else:
                low = low + p0 * eye[1, 0]
                high = high + p0 * eye[0, 0]
            if p1 > 0.0:
                low = low + p1 * eye[0, 1]
                high = high + p1 * eye[1, 1]
            else:
                low = low + p1 * eye[1, 1]
                high = high + p1 * eye[0, 1]
            if p2 > 0.0:
                low = low + p2 * eye[0, 2]
                high = high + p2 * eye[1, 2]
            else:
                low = low + p2 * eye[1, 2]
                high = high + p2 * eye[0, 2]
            low = max(low, value - slack)
            high = min(high, value + slack)
            apart = low > around + TOUCH_MM
            holds = holds and low <= TOUCH_MM
            inside = inside and high + around <= 0.0
        if not apart:
            cells[kept] = cell
            kept += 1
            met = met or holds
            if inside:
                cells[0] = cell
                return -1
    return kept if met else 0


@kernel_without_refcounts
def holds_point(entities, cell, c):
    """Tell whether a cell contains a nodal point."""
    for p in range(entities.plane_start[cell], entities.plane_start[cell + 1]):
        plane = entities.planes[p]
        if plane[3] + plane[0] * c[0] + plane[1] * c[1] + plane[2] * c[2] > TOUCH_MM:
            return False
    return True


@kernel_without_refcounts
def hidden_around(entities, cells, eye):
    """Tell whether for every nodal point of a small box (2, 3) the same point around it is in none of the cells."""
    if (
        max(eye[1, 0] - eye[0, 0], eye[1, 1] - eye[0, 1], eye[1, 2] - eye[0, 2])
        > 2.0 * entities.around
    ):
        return False
    for d in range(len(entities.directions)):
        x = (eye[0, 0] + eye[1, 0]) / 2 + entities.around * entities.directions[d, 0]
        y = (eye[0, 1] + eye[1, 1]) / 2 + entities.around * entities.directions[d, 1]
        z = (eye[0, 2] + eye[1, 2]) / 2 + entities.around * entities.directions[d, 2]
        half = (eye[1, 0] - eye[0, 0]) / 2, (eye[1, 1] - eye[0, 1]) / 2, (eye[1, 2] - eye[0, 2]) / 2
        seen = False
        for cell in cells:
            first = entities.plane_start[cell]
            last = entities.plane_start[cell + 1]
            if not outside(entities.planes, first, last, (x, y, z), half):
                seen = True
                break
        if not seen:
            return True
    return False


@kernel_without_refcounts
def out_of_range(ends, q, h, radius):
    """Tell whether an end is farther from the whole box of q than any point in view is from the point looked at."""
    for i in range(2):
        square = 0.0
        for k in range(3):
            square += max(abs(ends[i, k] - q[k]) - h[k], 0.0) ** 2
        if square > radius * radius:
            return True
    return False
