"""The integer grid: a part snapped once, in its own frame and its own unit.

A part is laid on its grid in the frame of `canonical_axes.own_frame`, about 2**20 steps over its largest extent, so a
copy that was turned, moved, scaled or listed in another order gets the same integers. From then on every vertex is an
integer triple and every plane through three of them an integer quadruple (a, b, c, d), a·x + b·y + c·z = d (see
`planes`).

The step is a whole part of the extent. Where the coordinates in the own frame are whole multiples of some length, as in
parts drawn in round numbers, the step divides that length and snapping displaces nothing: one step for all three axes,
or else one for each (a prism whose longest side has length √5). Where there is no such length, coordinates are rounded
to 2**-20 of the extent, and vertices that ought to lie in one plane need not any more. `Grid.resolution` says how far,
in steps, a vertex may lie from a plane and still count as lying on it; it is 0 where snapping was exact.

What tells "a multiple" from "not a multiple" is the rounding of the input alone. It chooses a step, no topology.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aspectgraph.exact.predicates import POINT_BITS
from aspectgraph.exceptions import SolidError, WorkspaceError

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
                "must contain the part with room on all sides",
                f"{workspace[0].tolist()} to {workspace[1].tolist()} mm for a part from "
                f"{part.min(axis=0).tolist()} to {part.max(axis=0).tolist()} mm",
            )


def turned(matrix: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Apply a (3, 3) matrix to (..., 3) vectors, each alone, so that its rounding depends on no other."""
    return sum(vectors[..., k : k + 1] * matrix[:, k] for k in range(3))


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
