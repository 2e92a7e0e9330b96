"""Convex cells in plain rational arithmetic.

Notation
--------
point   (x, y, z, w), w > 0: the rational point (x, y, z) / w. Integers without common factor, or Fractions and w = 1
plane   (n0, n1, n2, d) integers: value at a point n·(x, y, z) − d·w, positive in front
loop    corners of a convex polygon in order
cell    list of (plane, loop): value ≤ 0 in the cell, loop counter-clockwise seen from outside
"""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from math import gcd, lcm

from exact_checker import cross, dot, minus


def reduced(numbers) -> tuple[int, ...]:
    """Return the integers divided by their greatest common divisor."""
    divisor = gcd(*numbers)
    return tuple(x // divisor for x in numbers)


def at(plane, point) -> int:
    """Return the value of a plane at a point (times the point's w)."""
    return plane[0] * point[0] + plane[1] * point[1] + plane[2] * point[2] - plane[3] * point[3]


def opposite(plane) -> tuple[int, ...]:
    """Return the same plane facing the other way."""
    return tuple(-x for x in plane)


def key(plane) -> tuple[int, ...]:
    """Return the plane facing the way that makes its first non-zero coefficient positive."""
    return max(plane, opposite(plane))


def between(p, value_p, q, value_q) -> tuple[int, ...]:
    """Return the point of pq where a plane with values of opposite sign at p and q vanishes."""
    a = abs(value_q)
    b = abs(value_p)
    numbers = [a * x + b * y for x, y in zip(p, q, strict=True)]
    return (
        tuple(x / numbers[3] for x in numbers) if isinstance(p[3], Fraction) else reduced(numbers)
    )


def through(p, q, r) -> tuple[int, ...] | None:
    """Return the plane through three points, or None if they are collinear."""
    normal = cross(difference(q, p), difference(r, p))
    if normal == (0, 0, 0):
        return None
    coefficients = [*(n * p[3] for n in normal), dot(normal, p)]
    common = lcm(*(Fraction(x).denominator for x in coefficients))
    return reduced([int(x * common) for x in coefficients])


def difference(q, p) -> tuple[int, int, int]:
    return tuple(x * p[3] - y * q[3] for x, y in zip(q[:3], p[:3], strict=True))


def clip(loop, plane) -> list | None:
    """Return the part of a convex polygon where value ≥ 0, or None if none of it has value > 0."""
    values = [at(plane, p) for p in loop]
    if max(values) <= 0:
        return None
    if min(values) >= 0:
        return loop
    part = []
    for i, (p, value) in enumerate(zip(loop, values, strict=True)):
        if value * values[i - 1] < 0:
            part.append(between(loop[i - 1], values[i - 1], p, value))
        if value >= 0:
            part.append(p)
    return part


# --------------------------------------------------------------------------------------------------------- cells


def box_cell(low, high, number=int) -> list:
    """Return the box between two integer corners as a cell, its points of the given kind of number."""
    corner = [
        (x, y, z, 1)
        for x in (low[0], high[0])
        for y in (low[1], high[1])
        for z in (low[2], high[2])
    ]
    corner = [tuple(map(number, p)) for p in corner]
    loops = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    planes = [
        (*(side * (k == axis) for k in range(3)), side * (low, high)[side > 0][axis])
        for axis in range(3)
        for side in (-1, 1)
    ]
    return [(plane, [corner[i] for i in loop]) for plane, loop in zip(planes, loops, strict=True)]


def split(cell, plane) -> tuple[list | None, list | None]:
    """Return the parts of a cell in front of a plane and behind it; None where there is no such part."""
    values = [at(plane, p) for _, loop in cell for p in loop]
    if max(values) <= 0:
        return None, cell
    if min(values) >= 0:
        return cell, None
    return half(cell, plane), half(cell, opposite(plane))


def half(cell, plane) -> list:
    """Return the part of a cell in front of a plane that cuts it."""
    part = []
    follows = {}
    for outward, loop in cell:
        kept = clip(loop, plane)
        if kept is not None:
            part.append((outward, kept))
            for p, q in pairwise((*kept, kept[0])):
                if at(plane, p) == 0 == at(plane, q):
                    follows[q] = p
    lid = [next(iter(follows))]
    while (corner := follows[lid[-1]]) != lid[0]:
        lid.append(corner)
    return [*part, (opposite(plane), lid)]


def cut_out(cell, obstacle) -> tuple[list | None, list]:
    """Return the part of a cell inside an obstacle (or None), and the parts outside."""
    corners = {p for _, loop in cell for p in loop}
    if any(max(at(plane, p) for p in corners) <= 0 for plane in obstacle):
        return None, [cell]
    inside = cell
    outside = []
    for plane in obstacle:
        inside, rest = split(inside, plane)
        if inside is None:
            return None, [cell]
        if rest is not None:
            outside.append(rest)
    return inside, outside


def volume(cell) -> Fraction:
    """Return the exact volume of a cell."""
    first = plain(cell[0][1][0])
    total = Fraction(0)
    for _, loop in cell:
        p, *rest = (minus(plain(corner), first) for corner in loop)
        total += sum(dot(p, cross(q, r)) for q, r in pairwise(rest))
    return total / 6


def plain(point) -> tuple[Fraction, Fraction, Fraction]:
    return tuple(Fraction(x, point[3]) for x in point[:3])


def centre(cell) -> tuple[Fraction, Fraction, Fraction]:
    """Return the mean of a cell's corners, an inner point."""
    corners = [plain(p) for p in {p for _, loop in cell for p in loop}]
    return tuple(sum(c) / len(corners) for c in zip(*corners, strict=True))


def overlaps(polygon, cell, shared=None) -> bool:
    """Return whether a polygon and a cell (but for its facet in the plane `shared`) have an area in common."""
    for outward, _ in cell:
        if outward != shared:
            polygon = clip(polygon, opposite(outward))
            if polygon is None:
                return False
    return True
