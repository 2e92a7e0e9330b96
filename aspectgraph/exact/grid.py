"""The integer grid of a part: exact signs, points and planes on it, and the axes in which it is laid."""

from __future__ import annotations

import reprlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numpy.typing import ArrayLike

from aspectgraph.exceptions import ResolutionError, SolidError, WorkspaceError
from aspectgraph.solid.checks import segment_distance, side_distances
from aspectgraph.solid.solid import Solid
from aspectgraph.solid.topology import Face, describe_edge, describe_point
from ground.decorators import entry_kernel, kernel_without_refcounts
from ground.short_repr import short_repr

# The integer grid of a part: exact signs, points and planes on it.


# Exact signs: the only geometric decisions the cell complex makes.
#
# Notation
# --------
# plane h = (a, b, c, d)
#     int64, the set a·x + b·y + c·z = d; positive side a·x + b·y + c·z > d.
# vertex v = (X, Y, Z, W)
#     homogeneous 256-bit integers with W > 0, the common point X/W, Y/W, Z/W of three planes, stored as four 64-bit
#     limbs each (least significant first, two's complement).
# point p = (x, y, z) with the common denominator 2**POINT_BITS
#     int64, a query viewpoint on a lattice 2**POINT_BITS times finer than the grid of the part.
#
# Guarantee: with |a|, |b|, |c| < 2**43 and |d| < 2**63 no intermediate exceeds 2**200, so every
# sign is exact. Numbers are decided by a floating-point filter with a proven error bound first,
# and by 256-bit integers where that fails.


POINT_BITS = 20
LIMBS = 4

# a·x + b·y + c·z - d in doubles: 4 rounded coefficients, 3 coordinates of relative error < 4 ulp, 3 products, 3 sums;
# the sum of magnitudes times 16 units in the last place bounds them all
_FILTER = 16 * np.finfo(np.float64).eps

_WIDE = ir.IntType(64 * LIMBS)


def _element(context, builder, signature, args, array, indices):
    """Pointer to array[indices...], for int64 arrays in C order."""
    array_type = signature.args[array]
    struct = context.make_array(array_type)(context, builder, args[array])
    return cgutils.get_item_pointer(context, builder, array_type, struct, indices, wraparound=False)


def _load_plane(context, builder, signature, args, array, row):
    """Coefficients of one plane, sign-extended."""
    coefficients = []
    for column in range(4):
        pointer = _element(
            context, builder, signature, args, array, [row, ir.Constant(ir.IntType(64), column)]
        )
        coefficients.append(builder.sext(builder.load(pointer), _WIDE))
    return coefficients


def _wide_pointer(context, builder, signature, args, array, row, column):
    zero = ir.Constant(ir.IntType(64), 0)
    pointer = _element(
        context, builder, signature, args, array, [row, ir.Constant(ir.IntType(64), column), zero]
    )
    return builder.bitcast(pointer, _WIDE.as_pointer())


def _det2(builder, a, b, c, d):
    return builder.sub(builder.mul(a, d), builder.mul(b, c))


def _det3(builder, rows):
    (a, b, c), (d, e, f), (g, h, i) = rows
    terms = [
        builder.mul(a, _det2(builder, e, f, h, i)),
        builder.mul(b, _det2(builder, d, f, g, i)),
        builder.mul(c, _det2(builder, d, e, g, h)),
    ]
    return builder.add(builder.sub(terms[0], terms[1]), terms[2])


def _sign(builder, value):
    zero = ir.Constant(_WIDE, 0)
    byte = ir.IntType(64)
    positive = builder.zext(builder.icmp_signed(">", value, zero), byte)
    negative = builder.zext(builder.icmp_signed("<", value, zero), byte)
    return builder.sub(positive, negative)


@intrinsic
def _meet(typingctx, planes, p, q, r, vertices, v):
    """Write the common point of planes p, q, r to vertices[v] (Cramer's rule); return the sign of the determinant."""
    signature = types.int64(planes, types.int64, types.int64, types.int64, vertices, types.int64)

    def codegen(context, builder, signature, args):
        rows = [_load_plane(context, builder, signature, args, 0, args[k]) for k in (1, 2, 3)]
        w = _det3(builder, [row[:3] for row in rows])
        zero = ir.Constant(_WIDE, 0)
        negative = builder.icmp_signed("<", w, zero)
        for column in range(4):
            if column == 3:
                value = w
            else:
                replaced = [[row[3] if k == column else row[k] for k in range(3)] for row in rows]
                value = _det3(builder, replaced)
            # W > 0 by convention
            value = builder.select(negative, builder.sub(zero, value), value)
            pointer = _wide_pointer(context, builder, signature, args, 4, args[5], column)
            builder.store(value, pointer, align=8)
        return _sign(builder, w)

    return signature, codegen


@intrinsic
def _sign_at_vertex_exact(typingctx, planes, h, vertices, v):
    """Sign of plane h at vertices[v]."""
    signature = types.int64(planes, types.int64, vertices, types.int64)

    def codegen(context, builder, signature, args):
        plane = _load_plane(context, builder, signature, args, 0, args[1])
        total = ir.Constant(_WIDE, 0)
        for column in range(4):
            pointer = _wide_pointer(context, builder, signature, args, 2, args[3], column)
            product = builder.mul(plane[column], builder.load(pointer, align=8))
            total = builder.sub(total, product) if column == 3 else builder.add(total, product)
        return _sign(builder, total)

    return signature, codegen


@intrinsic
def _sign_at_point_exact(typingctx, planes, h, x, y, z):
    """Sign of plane h at the point (x, y, z) / 2**POINT_BITS."""
    signature = types.int64(planes, types.int64, types.int64, types.int64, types.int64)

    def codegen(context, builder, signature, args):
        a, b, c, d = _load_plane(context, builder, signature, args, 0, args[1])
        total = builder.sub(ir.Constant(_WIDE, 0), builder.shl(d, ir.Constant(_WIDE, POINT_BITS)))
        for coefficient, coordinate in zip((a, b, c), args[2:5], strict=True):
            total = builder.add(total, builder.mul(coefficient, builder.sext(coordinate, _WIDE)))
        return _sign(builder, total)

    return signature, codegen


@kernel_without_refcounts
def _magnitude(limbs):
    """Double nearest to a 256-bit integer, to a relative error below 4 ulp."""
    negative = limbs[LIMBS - 1] < 0
    total = 0.0
    scale = 1.0
    carry = np.uint64(1)
    for k in range(LIMBS):
        limb = np.uint64(limbs[k])
        if negative:
            # two's complement: all bits turned, plus one that carries
            limb = ~limb + carry
            carry = (
                np.uint64(1) if (carry == np.uint64(1) and limb == np.uint64(0)) else np.uint64(0)
            )
        total += np.float64(limb) * scale
        scale *= 18446744073709551616.0
    return -total if negative else total


@kernel_without_refcounts
def meet(planes, p, q, r, vertices, coordinates, v):
    """Write the common point of three planes as vertex v, exactly and in doubles; False where they have none."""
    if _meet(planes, p, q, r, vertices, v) == 0:
        return False
    w = _magnitude(vertices[v, 3])
    for k in range(3):
        coordinates[v, k] = _magnitude(vertices[v, k]) / w
    return True


@kernel_without_refcounts
def sign_at_vertex(planes, h, vertices, coordinates, v):
    """Sign (-1, 0, 1) of plane h at vertex v."""
    x = planes[h, 0] * coordinates[v, 0]
    y = planes[h, 1] * coordinates[v, 1]
    z = planes[h, 2] * coordinates[v, 2]
    d = np.float64(planes[h, 3])
    value = x + y + z - d
    bound = (abs(x) + abs(y) + abs(z) + abs(d)) * _FILTER
    if value > bound:
        return 1
    if value < -bound:
        return -1
    return _sign_at_vertex_exact(planes, h, vertices, v)


@kernel_without_refcounts
def sign_at_point(planes, h, point):
    """Sign (-1, 0, 1) of plane h at an int64 point of denominator 2**POINT_BITS."""
    scale = 1.0 / (1 << POINT_BITS)
    x = planes[h, 0] * (point[0] * scale)
    y = planes[h, 1] * (point[1] * scale)
    z = planes[h, 2] * (point[2] * scale)
    d = np.float64(planes[h, 3])
    value = x + y + z - d
    bound = (abs(x) + abs(y) + abs(z) + abs(d)) * _FILTER
    if value > bound:
        return 1
    if value < -bound:
        return -1
    return _sign_at_point_exact(planes, h, point[0], point[1], point[2])


# The integer grid: a part snapped once, in its own frame and its own unit.
#
# A part is laid on its grid in the frame of `canonical_axes.own_frame`, about 2**20 steps over
# its largest extent, so a copy that was turned, moved, scaled or listed in another order gets the
# same integers. From then on every vertex is an integer triple and every plane through three of
# them an integer quadruple (a, b, c, d), a·x + b·y + c·z = d (see `planes`).
#
# The step is a whole part of the extent. Where the coordinates in the own frame are whole
# multiples of some length, as in parts drawn in round numbers, the step divides that length and
# snapping displaces nothing: one step for all three axes, or else one for each (a prism whose
# longest side has length √5). Where there is no such length, coordinates are rounded to 2**-20 of
# the extent, and vertices that ought to lie in one plane need not any more. `Grid.resolution`
# says how far, in steps, a vertex may lie from a plane and still count as lying on it; it is 0
# where snapping was exact.
#
# What tells "a multiple" from "not a multiple" is the rounding of the input alone. It chooses a
# step, no topology.


GRID_BITS = 20
"""The largest extent takes more than half of 2²⁰ steps and at most all: a step is about a micrometre on a metre."""

# a vertex is displaced by at most sqrt(3)/2 steps; so is the plane it is compared with, at each of its three points
DISPLACED_RESOLUTION = 4.0
# of vertices and of workspaces, from the origin
_LARGEST_COORDINATE_STEPS = 1 << 40
# leaves room for workspaces of 4,000 extents
_FINEST_SCALE = 1 << 8
# Rounding of the own coordinates against that of the largest of the user's, half a unit in the last place.
_NOISE = 16 * 2.0**-53
# Denominators so large that random coordinates would fit one of them this often are none.
_BY_ACCIDENT = 1e-3
# Planes of the workspace: largest coefficient, and room for their distance in 63 bits.
_BOX_BITS = 40
_BOX_ROOM = 60
# least reach, in steps as a power of two, of the cube in which cells are cut before they are cropped
_CUBE_BITS = 31


@dataclass(frozen=True)
class Grid:
    """An integer grid laid over a part.

    Attributes
    ----------
    frame : ndarray, shape (3, 3)
        Rotation from the user's frame to the grid's: rows are the grid's axes.
    step_mm : float
        Unit in which cells are measured: the step along the axis of the largest extent.
    scale : ndarray, shape (3,)
        Step along each axis, in units of `step_mm`; exactly 1 if there is one step for all.
    origin_mm : ndarray, shape (3,)
        The grid's zero, near the part's centre, in mm along the grid's axes.
    points : ndarray of int64, shape (n, 3)
        The part's vertices; magnitudes below 2**20.
    snapping_mm : float
        Largest displacement of a vertex; 0 where it is below the rounding of the input.
    resolution : float
        Distance in steps up to which a vertex counts as lying on a plane; 0 where snapping displaced nothing.
    """

    frame: np.ndarray
    step_mm: float
    scale: np.ndarray
    origin_mm: np.ndarray
    points: np.ndarray
    snapping_mm: float
    resolution: float

    __repr__ = short_repr

    @classmethod
    def over(
        cls,
        vertices: np.ndarray,
        frame: np.ndarray | None = None,
        used: np.ndarray | None = None,
        *,
        finest: bool = False,
    ) -> Grid:
        """Lay a grid over (n, 3) vertices in mm.

        Parameters
        ----------
        vertices : ndarray, shape (n, 3)
        frame : ndarray, shape (3, 3), optional
            Rotation; default: the user's frame.
        used : ndarray of int, optional
            The vertices that belong to the part; default: all.
        finest : bool
            Where vertices must be displaced, take 2**20 steps along every axis instead of the same step for all, but
            steps of no less than 2**-8 of the largest.

        Raises
        ------
        SolidError
            If the part lies so far from the origin that its coordinates do not fit the grid.
        """
        frame = np.eye(3) if frame is None else frame
        coordinates = turned(frame, vertices)
        low = coordinates.min(axis=0) if used is None else coordinates[used].min(axis=0)
        coordinates -= low
        part = coordinates if used is None else coordinates[used]
        extents = part.max(axis=0)
        largest = int(np.argmax(extents >= (1.0 - 1e-9) * extents.max()))
        noise = _NOISE * max(float(np.abs(vertices).max()), extents[largest])
        steps, exact = _steps(part, extents, noise)
        if finest and not exact:
            steps = np.maximum(extents, extents[largest] / _FINEST_SCALE) / (1 << GRID_BITS)
        if np.abs(vertices).max() / steps[largest] > _LARGEST_COORDINATE_STEPS:
            raise SolidError(
                f"vertices must lie within {_LARGEST_COORDINATE_STEPS * steps[largest]:g} mm of the origin, 2**40 grid "
                f"steps. Got {np.abs(vertices).max():g} mm."
            )
        snapped = np.rint(coordinates / steps).astype(np.int64)
        displacement = (
            0.0 if exact else float(np.linalg.norm(snapped * steps - coordinates, axis=1).max())
        )
        centre = np.rint(extents / steps).astype(np.int64) // 2
        return cls(
            frame,
            float(steps[largest]),
            steps / steps[largest],
            low + centre * steps,
            snapped - centre,
            displacement,
            DISPLACED_RESOLUTION if displacement else 0.0,
        )

    @property
    def steps_mm(self) -> np.ndarray:
        """Step along each of the grid's axes in mm, shape (3,)."""
        return self.step_mm * self.scale

    def to_mm(self, coordinates: np.ndarray) -> np.ndarray:
        """Convert (..., 3) grid coordinates to mm in the user's frame."""
        return turned(self.frame.T, np.asarray(coordinates) * self.steps_mm + self.origin_mm) + 0.0

    def measured_to_mm(self, coordinates: np.ndarray) -> np.ndarray:
        """Convert (..., 3) coordinates of a complex as `measure.measured` to mm in the user's frame."""
        return self.to_mm(np.asarray(coordinates) / self.scale)

    def to_points(self, viewpoints_mm: np.ndarray) -> np.ndarray:
        """Convert (n, 3) viewpoints in mm to int64 query points, 2**POINT_BITS to a step."""
        return as_queries(
            (turned(self.frame, np.asarray(viewpoints_mm)) - self.origin_mm) / self.steps_mm
        )

    def planes_to_mm(self, planes: np.ndarray) -> np.ndarray:
        """Convert planes (a, b, c, d) in grid steps, a·x + b·y + c·z = d, to mm: same form, unit normals, (n, 4)."""
        normals = planes[:, :3] / self.scale
        offsets = planes[:, 3] * self.step_mm + (normals * self.origin_mm).sum(axis=1)
        rows = np.column_stack([turned(self.frame.T, normals), offsets])
        return rows / np.linalg.norm(normals, axis=1, keepdims=True) + 0.0

    def box_planes(self, workspace: np.ndarray) -> np.ndarray:
        """Planes x_min, x_max, y_min, y_max, z_min, z_max of a (2, 3) workspace in mm, in the user's frame.

        They are turned and rounded so that they contain the workspace and reach beyond it by less than a step, in a
        workspace of up to 500 extents of the part; opposite planes are exactly parallel, and exactly normal to a grid
        axis where the user's axis is.

        Raises
        ------
        WorkspaceError
            If the workspace does not contain the part, or is too large for the grid.
        """
        corners = self._corners(workspace)
        reach = float(np.abs(corners).max())
        if reach > _LARGEST_COORDINATE_STEPS:
            limit = _LARGEST_COORDINATE_STEPS * self.step_mm
            raise WorkspaceError.of_rule(
                "workspace",
                f"must reach at most {limit:g} mm from the part, 2**40 grid steps",
                f"{workspace[0].tolist()} to {workspace[1].tolist()} mm",
            )
        bits = min(_BOX_BITS, _BOX_ROOM - int(np.ceil(np.log2(reach))))
        aligned = (self.frame == np.rint(self.frame)).all()
        planes = np.zeros((6, 4), np.int64)
        for axis in range(3):
            normal = self.frame[:, axis] * self.scale
            normal = np.rint(normal / np.abs(normal).max() * 2.0**bits)
            levels = (corners * normal).sum(axis=1)
            margin = 0.0 if aligned else 2.0**-48 * reach * 2.0**bits
            ends = int(np.floor(levels.min() - margin)), int(np.ceil(levels.max() + margin))
            for side, end in enumerate(ends):
                planes[2 * axis + side] = [*map(int, normal), end]
        self._check_room(planes, workspace)
        return planes // np.gcd.reduce(planes, axis=1)[:, None]

    def cube_planes(self, workspace: np.ndarray) -> np.ndarray:
        """Planes x_min, x_max, y_min, y_max, z_min, z_max along the grid's axes, the same for all but huge workspaces.

        The cube reaches 2**31 steps from the grid's zero, 2,000 extents of the part or more; if half of that does not
        hold a (2, 3) workspace in mm, the next power of two whose half does.
        """
        needed = float(np.abs(self._corners(workspace)).max())
        reach = 1 << max(_CUBE_BITS, int(np.ceil(np.log2(needed))) + 1)
        planes = np.zeros((6, 4), np.int64)
        for axis in range(3):
            planes[2 * axis : 2 * axis + 2, axis] = 1
            planes[2 * axis : 2 * axis + 2, 3] = -reach, reach
        return planes

    def _corners(self, workspace: np.ndarray) -> np.ndarray:
        """Corners of a box in mm, in grid steps, shape (8, 3)."""
        at = np.array(
            [[workspace[i, 0], workspace[j, 1], workspace[k, 2]] for i, j, k in np.ndindex(2, 2, 2)]
        )
        return (turned(self.frame, at) - self.origin_mm) / self.steps_mm

    def _check_room(self, planes: np.ndarray, workspace: np.ndarray) -> None:
        heights = self.points @ planes[:, :3].T
        if (heights <= planes[:, 3])[:, ::2].any() or (heights >= planes[:, 3])[:, 1::2].any():
            part = self.to_mm(self.points)
            raise WorkspaceError.of_rule(
                "workspace",
                "must contain the part with a margin on all sides",
                f"{workspace[0].tolist()} to {workspace[1].tolist()} mm for a part from "
                f"{part.min(axis=0).tolist()} to {part.max(axis=0).tolist()} mm",
            )


def turned(matrix: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Apply a (3, 3) matrix to (..., 3) vectors, each alone, so that its rounding depends on no other."""
    return sum(vectors[..., k : k + 1] * matrix[:, k] for k in range(3))


def as_points(points: ArrayLike) -> np.ndarray:
    """Return points as an array (n, 3) of doubles.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        Points in mm. One point alone, (3,), counts as one row, and an empty list as none.

    Raises
    ------
    WorkspaceError
        If they have another shape.
    """
    try:
        array = np.asarray(points, dtype=np.float64)
    except (OverflowError, TypeError, ValueError):
        raise WorkspaceError.of_rule(
            "points", "must be an array of numbers", reprlib.repr(points)
        ) from None
    # six numbers are two points, but (3, 2) are three points that lack a coordinate
    if array.size and (array.ndim not in (1, 2) or array.shape[-1] != 3):
        raise WorkspaceError.of_rule("points", "must have the shape (n, 3)", str(array.shape))
    return array.reshape(-1, 3)


def as_queries(coordinates: np.ndarray) -> np.ndarray:
    """Round (..., 3) grid coordinates to int64 query points, 2**POINT_BITS to a step."""
    whole = np.floor(coordinates)
    fraction = np.rint((coordinates - whole) * 2.0**POINT_BITS).astype(np.int64)
    return (whole.astype(np.int64) << POINT_BITS) + fraction


def _steps(coordinates: np.ndarray, extents: np.ndarray, noise: float) -> tuple[np.ndarray, bool]:
    """Steps along the axes, in mm, and whether all coordinates (n, 3), counted from 0, are multiples of them."""
    largest = float(extents.max())
    divisions = _common_denominator(coordinates.ravel() / largest, noise / largest)
    if divisions:
        n_steps = divisions << (GRID_BITS - (divisions - 1).bit_length())
        return np.full(3, largest / n_steps), True
    finest = np.full(3, largest / (1 << GRID_BITS))
    steps = finest.copy()
    for axis, extent in enumerate(extents):
        divisions = _common_denominator(coordinates[:, axis] / extent, noise / extent)
        if not divisions:
            return finest, False
        # nearly the same step along all axes; the margin lets rounding of the extents change nothing
        times = max(1, int(2**GRID_BITS * (extent / largest) * (1.0 + 1e-9) / divisions))
        steps[axis] = extent / (divisions * times)
    return steps, True


def _common_denominator(shares: np.ndarray, tolerance: float) -> int:
    """Least d <= 2**GRID_BITS such that numbers in [0, 1] are all multiples of 1/d, to a tolerance; 0 if none."""
    inner = np.unique(shares[(shares > tolerance) & (shares < 1.0 - tolerance)])
    distinct = inner[np.diff(inner, prepend=-1.0) > 4.0 * tolerance]
    start = 1
    # most parts in round numbers have a small one
    for end in (1 << 10, 1 << 15, (1 << GRID_BITS) + 1):
        candidates = np.arange(start, end, dtype=float)
        for share in distinct:
            multiple = share * candidates
            candidates = candidates[np.abs(multiple - np.rint(multiple)) <= tolerance * candidates]
        if len(candidates):
            denominator = float(candidates[0])
            n = len(distinct)
            expected = (2.0 * tolerance * denominator) ** n * denominator / (n + 1)
            return int(denominator) if n == 0 or expected < _BY_ACCIDENT else 0
        start = end
    return 0


# Planes on the integer grid.
#
# A plane through three vertices of a part (integer triples, see `grid`) is an integer quadruple
# (a, b, c, d), a·x + b·y + c·z = d, reduced by its greatest common divisor. Where snapping
# displaced vertices, one within the grid's resolution of a plane counts as lying on it; that is
# decided once, when planes are built, and everything after is exact.


@entry_kernel
def plane_through(p, q, r):
    """Plane through three integer points, reduced and oriented by the turn p, q, r; all zero if they are collinear."""
    plane = np.zeros(4, np.int64)
    for k in range(3):
        i = (k + 1) % 3
        j = (k + 2) % 3
        # cross product of two sides
        plane[k] = (q[i] - p[i]) * (r[j] - p[j]) - (q[j] - p[j]) * (r[i] - p[i])
    divisor = np.gcd(np.gcd(plane[0], plane[1]), plane[2])
    if divisor:
        for k in range(3):
            plane[k] //= divisor
            plane[3] += plane[k] * p[k]
    return plane


@kernel_without_refcounts
def height(plane, point):
    """a·x + b·y + c·z - d at an integer point of the part, exact in int64."""
    return plane[0] * point[0] + plane[1] * point[1] + plane[2] * point[2] - plane[3]


@kernel_without_refcounts
def side_of(plane, point, resolution):
    """Sign of a plane at an integer point of the part; 0 within `resolution` steps of it."""
    h = height(plane, point)
    if resolution > 0.0:
        square = np.float64(plane[0]) ** 2 + np.float64(plane[1]) ** 2 + np.float64(plane[2]) ** 2
        # the distance is h over the length of (a, b, c)
        if np.float64(h) ** 2 <= resolution * resolution * square:
            return 0
    if h > 0:
        return 1
    return -1 if h < 0 else 0


@entry_kernel
def find_plane(planes, n, points, trio, resolution):
    """Number of the first of the first n planes through all three points, or -1."""
    for k in range(n):
        if (
            side_of(planes[k], points[trio[0]], resolution) == 0
            and side_of(planes[k], points[trio[1]], resolution) == 0
            and side_of(planes[k], points[trio[2]], resolution) == 0
        ):
            return k
    return -1


@entry_kernel
def find_parallel(planes, points, trio, resolution, plane):
    """The plane through the three points exactly parallel to that of `planes` nearest to parallel, or `plane`.

    Near enough is half the resolution: it must leave some to other vertices on the plane.
    """
    best = -1
    best_spread = 0.5 * resolution
    level = np.int64(0)
    for k in range(len(planes)):
        low = high = height(planes[k], points[trio[0]])
        for i in range(1, 3):
            h = height(planes[k], points[trio[i]])
            low = min(low, h)
            high = max(high, h)
        square = (
            np.float64(planes[k, 0]) ** 2
            + np.float64(planes[k, 1]) ** 2
            + np.float64(planes[k, 2]) ** 2
        )
        # how far apart the three points lie across the parallel planes
        spread = np.float64(high - low) / np.sqrt(square)
        if spread <= best_spread:
            best = k
            best_spread = spread
            level = low + (high - low) // 2
    if best < 0:
        return plane
    parallel = planes[best].copy()
    # halfway between the outermost of the three points
    parallel[3] += level
    return parallel


@entry_kernel
def _widest_triangle(points, loop):
    """Three of the loop's points that span nearly the largest triangle, in the loop's cyclic order."""
    # the farthest vertex from the farthest one: nearly the longest chord
    a = loop[0]
    for _ in range(2):
        b = a
        best = -1.0
        for v in loop:
            length = 0.0
            for k in range(3):
                length += np.float64(points[v, k] - points[a, k]) ** 2
            if length > best:
                b = v
                best = length
        a, b = b, a
    # and the farthest from that chord
    c = a
    best = -1.0
    for v in loop:
        area = 0.0
        for k in range(3):
            i = (k + 1) % 3
            j = (k + 2) % 3
            area += (
                np.float64(points[b, i] - points[a, i]) * np.float64(points[v, j] - points[a, j])
                - np.float64(points[b, j] - points[a, j]) * np.float64(points[v, i] - points[a, i])
            ) ** 2
        if area > best:
            c = v
            best = area
    return a, b, c


def face_planes(
    grid: Grid, loops: list[np.ndarray], normals: np.ndarray, order: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Integer planes of all faces, coplanar faces sharing one, larger faces first.

    Where snapping displaced vertices, a face that is parallel to a larger one to within the resolution gets an exactly
    parallel plane; otherwise the two would meet far away, and domains that they part would touch there.

    Parameters
    ----------
    grid : Grid
    loops : list of f int arrays
        Vertices of each face's outer loop.
    normals : ndarray, shape (f, 3)
        Outward unit normals in the grid's frame.
    order : ndarray of int, shape (f,), optional
        Order of equally large faces, last first. Default: as they are listed.

    Returns
    -------
    planes : ndarray of int64, shape (p, 4)
    plane_of_face : ndarray of int, shape (f,)
    side_of_face : ndarray of int8, shape (f,)
        1 where the face's outward side is the plane's positive side, else -1.

    Raises
    ------
    SolidError
        If a face vanishes on the grid.
    """
    planes = np.empty((len(loops), 4), np.int64)
    n_planes = 0
    plane_of_face = np.empty(len(loops), np.int64)
    side_of_face = np.empty(len(loops), np.int8)
    sizes = np.array([np.ptp(grid.points[loop], axis=0).sum() for loop in loops])
    order = np.arange(len(loops)) if order is None else order
    for face in order[np.argsort(sizes[order], kind="stable")[::-1]]:
        loop = np.asarray(loops[face], np.int64)
        trio = _widest_triangle(grid.points, loop)
        plane = plane_through(*grid.points[list(trio)])
        if not plane.any():
            raise SolidError(
                f"face {face} must be wider than the grid step of {grid.step_mm:g} mm. It vanishes on it."
            )
        table = planes[:n_planes]
        number = _same_plane(table, grid.points[loop], grid.resolution)
        if number < 0:
            number = n_planes
            planes[number] = _made_parallel(plane, table, grid.points[loop], grid.resolution)
            n_planes += 1
        plane_of_face[face] = number
        side_of_face[face] = 1 if normals[face] @ planes[number][:3] > 0 else -1
    return planes[:n_planes].copy(), plane_of_face, side_of_face


def _made_parallel(
    plane: np.ndarray, planes: np.ndarray, points: np.ndarray, resolution: float
) -> np.ndarray:
    """The plane parallel to one of `planes` nearest to all the points, or `plane` if none is near enough."""
    # half the resolution, to leave some to other vertices on the plane
    heights = points @ planes[:, :3].T
    low = heights.min(axis=0)
    high = heights.max(axis=0)
    near = high - low <= resolution * np.linalg.norm(planes[:, :3].astype(float), axis=1)
    if resolution == 0.0 or not near.any():
        return plane
    k = int(np.argmax(near))
    return np.array([*planes[k, :3], low[k] + (high[k] - low[k]) // 2])


@entry_kernel
def _same_plane(planes, points, resolution):
    for k in range(len(planes)):
        contains = True
        for i in range(len(points)):
            if side_of(planes[k], points[i], resolution) != 0:
                contains = False
                break
        if contains:
            return k
    return -1


# Details of a part against its grid: nothing that is apart may come so near that snapping could
# make it one.
#
# Where snapping displaces vertices, by less than a step each, whatever lies within the grid's
# resolution (four steps) of a plane counts as lying on it. A gap, a step or a wall of that size
# would vanish, and with it what it hides or shows. So vertices, edges and faces that do not meet
# must be at least `LEAST_STEPS` apart on the grid.
#
# Then the snapped solid has the shape of the given one: move every vertex on a straight line from
# its given place to its snapped one. Two places of the surface come nearer by less than two steps
# on the way, so nothing that is apart touches, crosses, flips or vanishes. Where snapping
# displaces nothing, every decision is exact and no distance is too small.
#
# Notation
# --------
# p   vertices in steps of the grid, (n, 3) doubles of whole numbers
# A pair is (kind, i, j): of two edges, of a vertex and an edge, or of a vertex and a triangle over
# whose inside it lies.
# Pairs that share a vertex do not count, nor do a vertex and a face that it belongs to.


# The part's own axes: a frame that turns with the part, so that a turned copy is laid on its grid
# the same way.
#
# The first axis is the direction in which most of the surface looks; the second, across it, that
# in which most of the rest does, or else the longest edges run. Of directions that tie, and of
# the two senses of each, those are taken in which a generic sum over the edges, the entities
# among them counting more, is largest; where the sums tie too, the part is symmetric and any will
# do.
#
# Tolerances stand here only to tell equal from different in the presence of rounding. They choose
# between frames that are all valid: whatever the choice, everything after it is exact, and none
# of them decides topology.


# Directions closer than this (radians) are one; sums of areas or lengths closer than this share tie.
_SAME_DIRECTION = 1e-7
_TIE = 1e-7
# entries of the frame that differ from 0 or 1 by less are rounding
_AXIS_ALIGNED = 1e-12
_MAX_CANDIDATES = 4096

# generic linear forms of the two ends of an edge
_FORMS = np.array(
    [
        [1.618034, 0.701711, 2.236068, 0.447214, 1.154701, 0.309017],
        [0.577350, 1.879385, 0.267949, 1.414214, 0.351207, 2.080084],
        [2.094551, 0.414214, 1.324718, 0.754878, 1.732051, 0.861500],
    ]
)


def own_frame(solid: Solid, marks: Sequence[Sequence[int]] = ()) -> np.ndarray:
    """Rows are the part's own axes in the user's frame: own = frame @ user, a rotation, shape (3, 3).

    Of an axis-aligned part it is exactly a signed permutation.

    Parameters
    ----------
    solid : Solid
    marks : sequence of sequence of int
        Groups of edges, each told from all others: what the part is symmetric but for.
    """
    directions, weights = _classes(_area_vectors(solid))
    edges = np.array([edge.vertices for edge in solid.edges])
    runs = solid.vertices[edges[:, 1]] - solid.vertices[edges[:, 0]]
    frames: list[np.ndarray] = []
    for first in directions[_ties(weights)]:
        across = np.abs(directions @ first) < _SAME_DIRECTION
        seconds = directions[across]
        their_weights = weights[across]
        if not len(seconds):
            lengths = np.linalg.norm(runs, axis=1)
            seconds, their_weights = _classes(
                runs[np.abs(runs @ first) < _SAME_DIRECTION * lengths]
            )
        for second in seconds[_ties(their_weights)]:
            frames += _right_handed(first, second)
    candidates = np.array(frames[:_MAX_CANDIDATES])
    ends = solid.vertices[edges]
    ends = ends - ends.mean(axis=(0, 1))
    weights = np.ones(len(edges))
    for k, mark in enumerate(marks):
        weights[list(mark)] += (k + 1) / len(marks)
    return _exact_where_aligned(candidates[np.argmax(_signatures(candidates, ends, weights))])


def _area_vectors(solid: Solid) -> np.ndarray:
    corners = solid.vertices[solid.triangles]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros((len(solid.faces), 3))
    np.add.at(total, solid.triangle_face, 0.5 * doubled)
    return total


def _classes(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions of vectors, up to sign, and the sum of lengths of each."""
    lengths = np.linalg.norm(vectors, axis=1)
    rows = np.argsort(-lengths, kind="stable")
    directions = []
    weights = []
    while len(rows):
        leader = vectors[rows[0]] / lengths[rows[0]]
        cosine = vectors[rows] @ leader
        off = np.linalg.norm(vectors[rows] - cosine[:, None] * leader, axis=1)
        alike = off <= _SAME_DIRECTION * lengths[rows]
        total = (vectors[rows[alike]] * np.sign(cosine[alike])[:, None]).sum(axis=0)
        directions.append(total / np.linalg.norm(total))
        weights.append(lengths[rows[alike]].sum())
        rows = rows[~alike]
    return np.array(directions), np.array(weights)


def _ties(weights: np.ndarray) -> np.ndarray:
    return weights >= (1.0 - _TIE) * weights.max()


def _right_handed(first: np.ndarray, second: np.ndarray) -> list[np.ndarray]:
    """The four frames with z along the first and x along the second direction."""
    second = second - (second @ first) * first
    second /= np.linalg.norm(second)
    third = np.cross(first, second)
    return [np.array([s * second, r * s * third, r * first]) for r in (1, -1) for s in (1, -1)]


def _signatures(candidates: np.ndarray, ends: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """A generic smooth function of each edge in each frame, weighted and summed over the edges of the part."""
    size = np.linalg.norm(ends, axis=-1).max()
    sums = np.empty(len(candidates))
    for k, frame in enumerate(candidates):
        local_ends = (ends @ frame.T) / size
        forward = local_ends.reshape(-1, 6)
        backward = local_ends[:, ::-1].reshape(-1, 6)
        sums[k] = weights @ (
            np.sin(forward @ _FORMS.T + 0.3) + np.sin(backward @ _FORMS.T + 0.3)
        ).sum(axis=1)
    return sums


def _exact_where_aligned(frame: np.ndarray) -> np.ndarray:
    rounded = np.rint(frame)
    return rounded if np.abs(frame - rounded).max() < _AXIS_ALIGNED else frame


# One order for the vertices and faces of a part, whatever order its user lists them in.
#
# Vertices are ranked by their places on the grid, loops start at their least vertex, and faces
# and holes are sorted by the ranks of theirs. Whatever depends on an order of work (which plane
# of several that agree is kept, how a face is cut into pieces, in which order cells are cut) then
# depends on the part alone. Numbers stay the user's everywhere.


class Listing(NamedTuple):
    """The part's own order.

    Attributes
    ----------
    rank : ndarray of int, shape (n,)
        Of each vertex.
    vertex : ndarray of int, shape (n,)
        The vertex of each rank.
    faces : tuple of Face
        The user's faces, sorted, their loops in ranks.
    face : ndarray of int, shape (f,)
        The user's number of each of them.
    """

    rank: np.ndarray
    vertex: np.ndarray
    faces: tuple[Face, ...]
    face: np.ndarray


def list_solid(solid: Solid, points: np.ndarray) -> Listing:
    """Order a solid by its vertices' places on the grid, (n, 3) integers."""
    vertex = np.lexsort(points.T[::-1])
    rank = np.empty_like(vertex)
    rank[vertex] = np.arange(len(vertex))
    faces = []
    for number, face in enumerate(solid.faces):
        outer, *holes = (_from_least(loop, rank) for loop in face.loops)
        faces.append((outer, tuple(sorted(holes)), number))
    faces.sort()
    return Listing(
        rank,
        vertex,
        tuple(Face(outer, holes) for outer, holes, _ in faces),
        np.array([number for *_, number in faces]),
    )


def _from_least(loop: Iterable[int], rank: np.ndarray) -> tuple[int, ...]:
    ranks = rank[list(loop)].tolist()
    start = ranks.index(min(ranks))
    return (*ranks[start:], *ranks[:start])


LEAST_STEPS = 16.0
"""Features nearer than this, in grid steps, cannot be told apart where snapping displaces vertices.

Four times the resolution. Measured: answers for small steps, slots, walls, bumps and pockets were those for the snapped
solid from 10 steps on, and wrong in places up to 9; real parts have no two features nearer than 120.
"""

EDGE_EDGE, VERTEX_EDGE, VERTEX_FACE = range(3)


class Nearest(NamedTuple):
    """The nearest pair of features.

    Attributes
    ----------
    steps : float
        Their distance in grid steps; infinite if no pair is nearer than asked for.
    kind : int
        EDGE_EDGE, VERTEX_EDGE or VERTEX_FACE.
    i, j : int
        Edge or vertex, and edge or triangle.
    n : int
        How many pairs are nearer than asked for.
    """

    steps: float
    kind: int = -1
    i: int = -1
    j: int = -1
    n: int = 0


def resolving_grid(solid: Solid, frame: np.ndarray) -> Grid:
    """Lay a grid over a solid that tells its features apart: the usual one, or else the finest.

    Raises
    ------
    ResolutionError
        If features are too near each other for both; the message tells where, how near, and the grid's step.
    """
    used = np.unique(solid.triangles)
    for finest in (False, True):
        grid = Grid.over(solid.vertices, frame, used, finest=finest)
        nearest = nearest_features(solid, grid.points) if grid.resolution else Nearest(np.inf)
        if not nearest.n:
            return grid
    raise ResolutionError(_complaint(solid, grid, nearest))


def nearest_features(solid: Solid, points: np.ndarray, within: float = LEAST_STEPS) -> Nearest:
    """Return the nearest two features of a solid that do not meet and are nearer than `within`.

    Parameters
    ----------
    solid : Solid
    points : ndarray, shape (n, 3)
        Places of its vertices in grid steps.
    within : float
        Distance in grid steps.
    """
    shape = _Shape(solid)
    points = np.asarray(points, float)
    vertices, edges, triangles = (_Boxes(points[corners], within) for corners in shape.corners)
    vertex_by_edge = vertices.meeting(edges)
    vertex_by_triangle = vertices.meeting(triangles)
    pairs = {
        EDGE_EDGE: shape.edges_apart(*edges.meeting(edges)),
        VERTEX_EDGE: (shape.used[vertex_by_edge[0]], vertex_by_edge[1]),
        VERTEX_FACE: shape.off_the_face(shape.used[vertex_by_triangle[0]], vertex_by_triangle[1]),
    }
    best = Nearest(np.inf)
    n = 0
    for kind, (i, j) in pairs.items():
        distance = shape.distance(kind, points, i, j)
        near = np.flatnonzero(distance < within)
        n += len(near)
        if len(near) and distance[near].min() < best.steps:
            first = near[np.argmin(distance[near])]
            best = Nearest(float(distance[first]), kind, int(i[first]), int(j[first]))
    return best._replace(n=n)


class _Boxes:
    """Bounding boxes of features, grown by half the distance looked for."""

    def __init__(self, corners: np.ndarray, within: float) -> None:
        self.low = corners.min(axis=1) - 0.5 * within
        self.high = corners.max(axis=1) + 0.5 * within
        self.shapes = shapely.box(self.low[:, 0], self.low[:, 1], self.high[:, 0], self.high[:, 1])

    def meeting(self, other: _Boxes) -> tuple[np.ndarray, np.ndarray]:
        """Return the pairs of own and other boxes that meet."""
        boxes, others = shapely.STRtree(other.shapes).query(self.shapes)
        keep = (self.low[boxes, 2] <= other.high[others, 2]) & (
            self.high[boxes, 2] >= other.low[others, 2]
        )
        return boxes[keep], others[keep]


class _Shape:
    """Features of a solid, their pairs and distances."""

    def __init__(self, solid: Solid) -> None:
        self.solid = solid
        self.ends = np.array([edge.vertices for edge in solid.edges])
        self.used = np.unique(self.ends)
        self.corners = self.used[:, None], self.ends, solid.triangles

    def edges_apart(self, i: np.ndarray, j: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of pairs of edges, keep those without a common vertex, each once."""
        keep = (i < j) & (self.ends[i][:, :, None] != self.ends[j][:, None, :]).all(axis=(1, 2))
        return i[keep], j[keep]

    def off_the_face(
        self, vertex: np.ndarray, triangle: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Of pairs of vertex and triangle, keep those whose vertex is none of the triangle's face."""
        member = {
            (v, f) for f, face in enumerate(self.solid.faces) for loop in face.loops for v in loop
        }
        pairs = zip(vertex.tolist(), self.solid.triangle_face[triangle].tolist(), strict=True)
        keep = np.fromiter((pair not in member for pair in pairs), bool, len(vertex))
        return vertex[keep], triangle[keep]

    def distance(self, kind: int, at: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        """Return the distances of pairs, vertices being at (n, 3) places."""
        if kind == EDGE_EDGE:
            return segment_distance(*(at[self.ends[edge, k]] for edge in (i, j) for k in (0, 1)))
        if kind == VERTEX_EDGE:
            start = at[self.ends[j, 0]]
            end = at[self.ends[j, 1]]
            is_end = (self.ends[j] == i[:, None]).any(axis=1)
            return np.where(
                is_end,
                np.linalg.norm(end - start, axis=1),
                segment_distance(at[i], at[i], start, end),
            )
        corners = at[self.solid.triangles[j]]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        height = np.abs(np.einsum("ij,ij->i", at[i] - corners[:, 0], normals))
        return np.where((side_distances(at[i], corners, normals) >= 0).all(axis=1), height, np.inf)

    def describe(self, nearest: Nearest) -> tuple[str, str]:
        """Return the two features of a pair in words."""
        at = self.solid.vertices
        i = nearest.i
        j = nearest.j
        feature = (
            describe_edge(at, *self.ends[i])
            if nearest.kind == EDGE_EDGE
            else f"vertex {describe_point(at[i])}"
        )
        if nearest.kind == VERTEX_FACE:
            return feature, f"face {self.solid.triangle_face[j]}"
        return feature, describe_edge(at, *self.ends[j])

    def are_of_two_shells(self, nearest: Nearest) -> bool:
        """Whether the features of a pair belong to different pieces of surface."""
        shell = np.empty(len(self.solid.vertices), int)
        shell[self.solid.triangles] = self.solid.face_shell[self.solid.triangle_face][:, None]
        vertex = self.ends[nearest.i, 0] if nearest.kind == EDGE_EDGE else nearest.i
        other = (
            self.solid.triangles[nearest.j, 0]
            if nearest.kind == VERTEX_FACE
            else self.ends[nearest.j, 0]
        )
        return bool(shell[vertex] != shell[other])


def _complaint(solid: Solid, grid: Grid, nearest: Nearest) -> str:
    """What is too near to what, how near it was given, and what can be done."""
    shape = _Shape(solid)
    distance_mm = shape.distance(
        nearest.kind, solid.vertices, np.array([nearest.i]), np.array([nearest.j])
    )[0]
    feature, other = shape.describe(nearest)
    more = f" ({nearest.n} such pairs)" if nearest.n > 1 else ""
    cure = "leave the detail out, or make it larger"
    if shape.are_of_two_shells(nearest):
        cure = "merge the solids in the CAD model, leave one out, or widen the gap"
    steps = " x ".join(dict.fromkeys(f"{step:.3g}" for step in grid.steps_mm))
    return (
        f"parts of the surface must be at least {LEAST_STEPS:g} grid steps of {steps} mm apart. "
        f"Got {distance_mm:.3g} mm between {feature} and {other}{more}; {cure}."
    )
