"""Poses to begin with, and their local refinement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from ga import Chromosome
from planner.camera.camera import Camera
from planner.camera.pose import aim, aimed_poses, moved
from planner.request.camera_limits import boxes_reach, focus_reach_mm
from planner.request.constraints import Constraints
from planner.request.problem import Objective

if TYPE_CHECKING:
    from aspectgraph import CellSet

# Feasible poses to begin with: the paper's restricted sampling, and a repair for requests where
# draws hardly ever fit.
#
# Draws come from the covering domains (`ViewpointSampler`). Where too few of them satisfy all
# constraints, the least violating ones are moved step by step towards feasibility: each round
# keeps the best poses and tries normal steps around them, ever smaller. A pose that leaves the
# covering domains fails the visibility constraint, so it is never among the feasible ones.


# viewpoints drawn at a time
_DRAW_BATCH = 512
# poses kept from one round of the repair to the next: those that violate least
_POOL = 32
# poses tried near them in each round
_CHILDREN = 256
# size of the changes in the first and the last round, as shares of the parameters' ranges
_FIRST_STEP = 0.2
_LAST_STEP = 1e-3
# number of rounds. The steps shrink by a constant factor.
_REPAIR_ROUNDS = 24
# the search stops after this many poses that meet all constraints, if the robot reaches none of
# them
_MOST_UNREACHED = 500


# Viewpoints drawn uniformly from the covering domains, as far as the lens can focus there.
#
# An entity's end at depth z is at most z / cos(θ) away, θ being the angle of the sensor's corner.
# So in every feasible setting each end is between D_min and D_max / cos(θ) from the nodal point:
# the viewpoint lies in the *shell*, the intersection of one spherical shell per end. In a wide
# workspace the shell is a small part of the covering domains and plain volume-weighted draws
# would hardly ever hit it.
#
# Guarantee: every viewpoint returned lies in the covering domains and in the shell, and is
# uniform there. That holds because each of the four ways to propose viewpoints is uniform on a
# set that contains the intersection, and what lies outside the intersection is rejected. The way
# with the smallest such set is taken.
#
# Where the depth of field is thin, that is the intersection of the shells of two ends that are far
# apart. A viewpoint there is given by its distances r1 and r2 from them, and its angle φ about the
# line through them. With d between the ends, dV = r1 r2 / d · dr1 dr2 dφ. So the squares of both
# distances are drawn evenly, and those that make no triangle with d are rejected.
#
# Where proposals hardly ever lie in the intersection, the boxes are halved as long as that helps:
# halves outside the shells or their cell are left out. If none is left, the intersection is empty.


_BATCH = 4096
# proposals until the boxes are halved, if fewer viewpoints than asked for were found
_PATIENCE = 8 * _BATCH
# boxes after halving, about
_MOST_BOXES = 4096
_HALVINGS = 24


class ViewpointSampler:
    """Uniform draws from the intersection of convex cells and the focus shell.

    Parameters
    ----------
    cells : CellSet
        The covering domains.
    ends : array (k, 2, 3)
        Ends of the entities, mm.
    camera : Camera
        Gives D_min, D_max and θ.

    Attributes
    ----------
    bounds : array (2, 3)
        Box that contains the intersection, mm; `empty` if it is known to be empty.
    proposal : {"cells", "shell", "shells", "boxes"}
        How viewpoints are proposed.
    """

    def __init__(self, cells: CellSet, ends: np.ndarray, camera: Camera) -> None:
        self.cells = cells
        self.points = ends.reshape(-1, 3)
        self.near, self.far = focus_reach_mm(camera)
        # a mean of the ends: no viewpoint is farther from it than from the farthest end
        self._centre = self.points.mean(axis=0)
        spread = np.linalg.norm(self.points - self._centre, axis=1).max()
        self._radii = max(self.near - spread, 0.0), self.far
        # two ends that are about as far apart as any two
        far_out = self.points[np.argmax(((self.points - self._centre) ** 2).sum(axis=1))]
        apart = np.linalg.norm(self.points - far_out, axis=1)
        self._pair = far_out, self.points[np.argmax(apart)]
        self._apart_mm = float(apart.max())
        self._clip_boxes()
        if not self.empty:
            self._choose_proposal()

    def _clip_boxes(self) -> None:
        """Clip the bounding box of every cell to the box that contains the shell."""
        boxes = self.cells.boxes
        low = np.maximum(boxes[:, 0], (self.points - self.far).max(axis=0))
        high = np.minimum(boxes[:, 1], (self.points + self.far).min(axis=0))
        self._kept = np.flatnonzero(
            (low < high).all(axis=1) & boxes_reach(low, high, self.points, self.near, self.far)
        )
        self._low = low[self._kept]
        self._high = high[self._kept]
        self._cell_of_box = np.arange(len(self._kept))
        self._is_halved = False
        self.empty = not len(self._kept)
        self.bounds = (
            np.empty((2, 0))
            if self.empty
            else np.array([self._low.min(axis=0), self._high.max(axis=0)])
        )

    def _choose_proposal(self) -> None:
        inner, outer = self._radii
        sizes = {
            "cells": float(self.cells.volume),
            "shell": 4 / 3 * np.pi * (outer**3 - inner**3) if np.isfinite(outer) else np.inf,
            "boxes": float(np.prod(self._high - self._low, axis=1).sum()),
            "shells": self._size_of_shells(),
        }
        self.proposal = min(sizes, key=sizes.__getitem__)

    def _size_of_shells(self) -> float:
        """Return how much proposals from two shells cover, mm³, what no triangle has included."""
        if self._apart_mm <= 0.0 or not np.isfinite(self.far):
            return np.inf
        return 2.0 * np.pi / self._apart_mm * ((self.far**2 - self.near**2) / 2.0) ** 2

    def in_shell(self, positions: np.ndarray) -> np.ndarray:
        """Return which positions (n, 3) have every end at a distance that can be in focus; (n,) bool."""
        local = positions - self._centre
        (inner, outer) = self._radii
        squared = (local**2).sum(axis=1)
        result = (squared >= inner**2) & (squared <= outer**2)
        rows = np.flatnonzero(result)
        ends = self.points - self._centre
        of_ends = squared[rows, None] - 2 * local[rows] @ ends.T + (ends**2).sum(axis=1)
        result[rows] = (of_ends.min(axis=1) >= self.near**2) & (of_ends.max(axis=1) <= self.far**2)
        return result

    def sample(self, n: int, rng: np.random.Generator, max_proposals: int = 500_000) -> np.ndarray:
        """Draw up to n viewpoints (m, 3); fewer (perhaps none) if so many proposals do not yield more."""
        positions = []
        total = 0
        proposed = 0
        while not self.empty and total < n and proposed < max_proposals:
            batch = self._propose(_BATCH, rng)
            proposed += _BATCH
            positions.append(batch)
            total += len(batch)
            if proposed >= _PATIENCE and not self._is_halved:
                self._halve_boxes()
        return np.concatenate(positions)[:n] if positions else np.empty((0, 3))

    def _halve_boxes(self) -> None:
        """Halve the boxes, leave out what is outside, and propose from the others if they are the smallest set."""
        self._is_halved = True
        for _ in range(_HALVINGS):
            if self.empty or len(self._low) > _MOST_BOXES:
                break
            rows = np.arange(len(self._low))
            axis = np.argmax(self._high - self._low, axis=1)
            middle = (self._low[rows, axis] + self._high[rows, axis]) / 2.0
            low = np.concatenate([self._low, self._low])
            high = np.concatenate([self._high, self._high])
            cell_of_box = np.concatenate([self._cell_of_box, self._cell_of_box])
            high[rows, axis] = middle
            low[len(rows) + rows, axis] = middle
            remain = boxes_reach(low, high, self.points, self.near, self.far)
            remain &= self._may_reach_both(low, high)
            # the corner of a box that is deepest inside a half-space
            planes = self._half_spaces[cell_of_box]
            deepest = np.where(planes[..., :3] > 0, low[:, None], high[:, None])
            remain &= ((planes[..., :3] * deepest).sum(axis=-1) + planes[..., 3] <= 0).all(axis=1)
            self._low = low[remain]
            self._high = high[remain]
            self._cell_of_box = cell_of_box[remain]
            self.empty = not remain.any()
        if not self.empty:
            self._choose_proposal()

    def _may_reach_both(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Return which boxes (m, 3) may hold viewpoints whose distances from two ends both are in the range; (m,).

        Along a way of length s, the difference of two distances changes by no more than s times the angle between the
        ends, as seen from the nearest that the box comes to one of them.
        """
        if self._apart_mm <= 0.0:
            return np.ones(len(low), dtype=bool)
        centre = (low + high) / 2.0
        closest = np.full(len(low), np.inf)
        distances = []
        for point in self._pair:
            aside = np.maximum(np.maximum(low - point, point - high), 0.0)
            closest = np.minimum(closest, np.linalg.norm(aside, axis=1))
            distances.append(np.linalg.norm(centre - point, axis=1))
        # of two directions, so no longer than 2
        chord = self._apart_mm / np.maximum(closest, self._apart_mm / 2.0)
        slack = np.linalg.norm(high - low, axis=1) / 2.0 * chord
        return np.asarray(np.abs(distances[0] - distances[1]) - slack <= self.far - self.near)

    def _propose(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Propose n viewpoints and return those in cells and shell."""
        if self.proposal == "cells":
            positions = self.cells.sample(n, rng)
            return positions[self.in_shell(positions)]
        if self.proposal in ("shell", "shells"):
            points = self._shell_points if self.proposal == "shell" else self._points_of_shells
            positions = points(n, rng)
            positions = positions[self.in_shell(positions)]
            return positions[self.cells.contains(positions)] if len(positions) else positions
        return self._box_points(n, rng)

    def _shell_points(self, n: int, rng: np.random.Generator) -> np.ndarray:
        direction = rng.normal(size=(n, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        inner, outer = self._radii
        radius = np.cbrt(rng.uniform(inner**3, outer**3, n))
        return self._centre + radius[:, None] * direction

    def _points_of_shells(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Draw n points evenly from what two shells have in common, less those that no triangle has."""
        origin, end = self._pair
        distance = self._apart_mm
        squares = rng.uniform(self.near**2, self.far**2, (n, 2))
        angle = rng.uniform(0.0, 2.0 * np.pi, n)
        along = (squares[:, 0] - squares[:, 1] + distance**2) / (2.0 * distance)
        off = squares[:, 0] - along**2
        is_triangle = off >= 0.0
        off = np.sqrt(off[is_triangle])
        angle = angle[is_triangle]
        axis = (end - origin) / distance
        across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        across /= np.linalg.norm(across)
        up = np.cross(axis, across)
        return np.asarray(
            origin
            + along[is_triangle, None] * axis
            + (off * np.cos(angle))[:, None] * across
            + (off * np.sin(angle))[:, None] * up
        )

    def _box_points(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Draw from the cells' boxes by volume; keep what lies in that very cell (cells do not overlap)."""
        volumes = np.prod(self._high - self._low, axis=1)
        chosen = rng.choice(len(volumes), size=n, p=volumes / volumes.sum())
        positions = rng.uniform(self._low[chosen], self._high[chosen])
        keep = self.in_shell(positions)
        positions = positions[keep]
        chosen = chosen[keep]
        planes = self._half_spaces[self._cell_of_box[chosen]]
        return positions[
            ((planes[..., :3] @ positions[:, :, None])[..., 0] + planes[..., 3] <= 0).all(axis=1)
        ]

    @property
    def _half_spaces(self) -> np.ndarray:
        """Half-spaces (m, s, 4) of the kept cells, padded with 0·x − 1 <= 0, which always holds."""
        if not hasattr(self, "_padded"):
            planes = [np.asarray(self.cells[int(i)].half_spaces, dtype=float) for i in self._kept]
            self._padded = np.tile([0.0, 0.0, 0.0, -1.0], (len(planes), max(map(len, planes)), 1))
            for row, half_spaces in zip(self._padded, planes, strict=True):
                row[: len(half_spaces)] = half_spaces
        return self._padded

    def cell_of(self, position: np.ndarray) -> np.ndarray | None:
        """Return the half-spaces (s, 4) of the cell that contains a position (3,), or None."""
        inside = (self._half_spaces[..., :3] @ position + self._half_spaces[..., 3] <= 0).all(
            axis=1
        )
        return self._half_spaces[np.argmax(inside)] if inside.any() else None


class WorkspaceSampler(ViewpointSampler):
    """Uniform draws from the whole workspace: what the restriction to the covering domains is measured against."""

    def __init__(
        self, cells: CellSet, ends: np.ndarray, camera: Camera, workspace: np.ndarray
    ) -> None:
        super().__init__(cells, ends, camera)
        if not self.empty:
            self.bounds = np.array(workspace, dtype=np.float64)
            self.proposal = "workspace"

    def _halve_boxes(self) -> None:
        """Do nothing: the whole workspace is drawn from, whatever is found there."""

    def _propose(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return rng.uniform(self.bounds[0], self.bounds[1], (n, 3))


# Bits to poses and back: six genes of M bits, the paper's section 4.1.
#
# Genes 1–3 are the position of the front nodal point in a box around the viewpoints that may be
# used. Genes 4–6 are pan, tilt and roll away from looking straight at the entities. Pan and tilt
# end at the angle of the sensor's corner: turned farther, the entities would leave the image.
# Roll is a full turn.


class PoseEncoding:
    """A box of positions and a range of angles, written as bits.

    Parameters
    ----------
    bounds : array (2, 3)
        Lowest and highest position, mm.
    target : array (3,)
        Point that pan = tilt = 0 looks at, mm.
    max_turn_rad : float
        Largest pan and tilt.
    gene_bits : int
        Bits per gene (M).
    gray : bool
        Gray code instead of plain binary.

    Guarantee
    ---------
    ``decode(encode(x))`` differs from x by at most half a step, range / (2^M − 1) / 2, in every parameter.
    """

    def __init__(
        self,
        bounds: np.ndarray,
        target: np.ndarray,
        max_turn_rad: float,
        gene_bits: int = 16,
        gray: bool = True,
    ) -> None:
        self.chromosome = Chromosome(6, gene_bits, gray)
        self.target = np.asarray(target, dtype=np.float64)
        turn = [max_turn_rad, max_turn_rad, np.pi]
        self.low = np.concatenate([bounds[0], np.negative(turn)])
        self.high = np.concatenate([bounds[1], turn])

    @property
    def n_bits(self) -> int:
        """Length of a chromosome."""
        return self.chromosome.n_bits

    def parameters(self, bits: np.ndarray) -> np.ndarray:
        """Return (x, y, z in mm, pan, tilt, roll in rad) (n, 6) of chromosomes (n, 6·M)."""
        return self.chromosome.decode(bits, self.low, self.high)

    def poses(self, parameters: np.ndarray) -> np.ndarray:
        """Return cam2world (n, 4, 4) of parameters (n, 6)."""
        return aimed_poses(parameters[:, :3], self.target, *parameters[:, 3:].T)

    def parameters_of(self, cam2world: np.ndarray) -> np.ndarray:
        """Return the parameters (n, 6) of poses (n, 4, 4), the inverse of `poses`; they may be outside the range."""
        positions = cam2world[:, :3, 3]
        turned = np.swapaxes(aim(positions, self.target), 1, 2) @ cam2world[:, :3, :3]
        angles = Rotation.from_matrix(turned).as_euler("YXZ") if len(turned) else np.empty((0, 3))
        return np.hstack([positions, angles])

    def decode(self, bits: np.ndarray) -> np.ndarray:
        """Return cam2world (n, 4, 4) of chromosomes (n, 6·M)."""
        return self.poses(self.parameters(bits))

    def encode(self, parameters: np.ndarray) -> np.ndarray:
        """Return the chromosomes (n, 6·M) nearest to parameters (n, 6); values outside the range are clipped."""
        span = self.high - self.low
        fractions = (parameters - self.low) / np.where(span > 0, span, 1.0)
        return self.chromosome.encode(np.clip(fractions, 0.0, 1.0))

    def draw_turns(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Draw pan, tilt and roll (n, 3): every second one looks straight at the target, the others anywhere."""
        turns = rng.uniform(self.low[3:], self.high[3:], (n, 3))
        turns[::2, :2] = 0.0
        return turns


@dataclass
class Start:
    """Feasible chromosomes, and what was tried to find them.

    Attributes
    ----------
    bits : array (n, n_bits)
        Feasible chromosomes.
    tried : array (m, 6)
        Parameters of poses that were tried and kept for an explanation: the least violating first.
    drawn, feasible_drawn : int
        Poses drawn from the covering domains, and how many of them were feasible.
    """

    bits: np.ndarray
    tried: np.ndarray
    drawn: int
    feasible_drawn: int


def draw_start(
    n: int,
    sampler: ViewpointSampler,
    encoding: PoseEncoding,
    constraints: Constraints,
    rng: np.random.Generator,
    max_draws: int = 8192,
    known: np.ndarray | None = None,
) -> Start:
    """Return up to n feasible chromosomes: known poses (m, 4, 4) first, then draws, then the repair."""
    tried = [np.empty((0, 6)) if known is None else encoding.parameters_of(known)]
    bits, ok = snap(tried[0], encoding, constraints)
    encoded = [bits[ok]]
    drawn = 0
    hits = int(ok.sum())
    n_known = hits
    while hits < n and drawn < max_draws and not _gives_up(constraints):
        positions = sampler.sample(_DRAW_BATCH, rng)
        if not len(positions):
            break
        parameters = np.hstack([positions, encoding.draw_turns(len(positions), rng)])
        bits, ok = snap(parameters, encoding, constraints)
        drawn += len(bits)
        hits += int(ok.sum())
        encoded.append(bits[ok])
        tried.append(parameters)
        if len(positions) < _DRAW_BATCH:
            # viewpoints are so rare that more draws would take long
            break
    nearest = np.concatenate(tried)
    if hits < n and len(nearest) and not _gives_up(constraints):
        nearest = _least_violating(nearest, encoding, constraints)
        repaired, nearest = repair(n - hits, nearest, encoding, constraints, rng)
        encoded.append(repaired)
    return Start(np.concatenate(encoded)[:n], nearest, drawn, hits - n_known)


def snap(
    parameters: np.ndarray, encoding: PoseEncoding, constraints: Constraints
) -> tuple[np.ndarray, np.ndarray]:
    """Encode parameters (m, 6); return the bits and whether the pose *they* stand for is feasible."""
    bits = encoding.encode(parameters)
    return bits, constraints.feasible(encoding.decode(bits))


def repair(
    n: int,
    tried: np.ndarray,
    encoding: PoseEncoding,
    constraints: Constraints,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Move the least violating parameters towards feasibility; return up to n feasible bits, and the last pool."""
    pool = tried[:_POOL]
    repaired = []
    missed = _violation(pool, encoding, constraints)
    for step in np.geomspace(_FIRST_STEP, _LAST_STEP, _REPAIR_ROUNDS):
        children = neighbours(pool, _CHILDREN, step, encoding, rng)
        bits, ok = snap(children, encoding, constraints)
        repaired.append(bits[ok])
        if sum(map(len, repaired)) >= n or _gives_up(constraints):
            break
        both = np.concatenate([missed, _violation(children, encoding, constraints)])
        best = np.argsort(both, kind="stable")[:_POOL]
        pool = np.concatenate([pool, children])[best]
        missed = both[best]
    return np.concatenate(repaired)[:n], pool


def _gives_up(constraints: Constraints) -> bool:
    """Return whether so many poses met all else and none was reached by the robot that no more are tried.

    Whether a pose is reached is a yes or no, which gives the repair no slope.
    """
    arm = constraints.arm
    return arm.n_reached == 0 and arm.n_asked >= _MOST_UNREACHED


def neighbours(
    pool: np.ndarray, n: int, step: float, encoding: PoseEncoding, rng: np.random.Generator
) -> np.ndarray:
    """Return n normal steps (n, 6) around members of the pool, of `step` times the range; roll wraps around."""
    span = encoding.high - encoding.low
    children = pool[rng.integers(len(pool), size=n)] + rng.normal(size=(n, 6)) * span * step
    children[:, 5] = (children[:, 5] + np.pi) % (2 * np.pi) - np.pi
    return np.clip(children, encoding.low, encoding.high)


def _least_violating(
    parameters: np.ndarray, encoding: PoseEncoding, constraints: Constraints
) -> np.ndarray:
    """Return those of the parameters (m, 6) whose poses violate least, sorted; at most so many as repair keeps.

    Images of ends cost little. What they miss is missed at least, so the costly rest is asked of the hopeful only.
    """
    at_least = constraints.violation(encoding.poses(parameters), images_only=True)
    best_first = np.argsort(at_least, kind="stable")
    first = best_first[:_CHILDREN]
    enough = np.sort(_violation(parameters[first], encoding, constraints))[:_POOL][-1]
    hopeful = np.flatnonzero(at_least <= enough)
    violation = _violation(parameters[hopeful], encoding, constraints)
    return parameters[hopeful[np.argsort(violation, kind="stable")[:_POOL]]]


def _violation(
    parameters: np.ndarray, encoding: PoseEncoding, constraints: Constraints
) -> np.ndarray:
    return constraints.violation(encoding.poses(parameters))


# Local refinement of a pose in pose space, by sequential quadratic programming.
#
# The pose moves by x (6,): a translation along the camera's axes and a rotation vector about
# them, both in units that change the view by about the same amount. Objective and constraints are
# smooth inside one convex cell of the covering domains, whose half-spaces stand in for
# visibility; all derivatives come from one batch of 12 neighbouring poses.
#
# The method needs no feasible pose to begin with, and of the many constraints few matter
# anywhere. So the costly one, the clearance, is left out far from the part, and put in if the
# pose found breaks it.


# starts differ by at least this share of the distance or of a parameter's range, or this angle
# in rad. Nearer ones would be refined to the same optimum.
_APART = 0.1
# positions drawn for each one kept, so that those kept are spread out
_DRAWN_PER_START = 8
# largest number of ends that are refined
_FOLLOWED = 3
# the refinement follows an end that reaches this share of the best merit
_PROMISING = 0.98
# steps from a start, and from a mirrored pose, which may be far from its optimum
_STEPS = 8
_STEPS_MIRRORED = 20
# largest number of refinements of one pose, the first in its cell
_ONWARD_ROUNDS = 5
# a refinement that gains no more than this share is the last
_ONWARD_GAIN = 1e-6
# half the step of the central differences
_DIFFERENCE = 1e-4
# the solver stops at this change of the fitness, on the scale of a probability
_TOLERANCE = 1e-7
# margin kept at every inequality, because the solver accepts violations below its tolerance
_BACK_OFF = 2e-7
# largest move along each of the six directions. The cell of the pose nearly always ends sooner.
_LARGEST_MOVE = 0.5
# upper limit of every slack. A lens in focus to infinity has an infinite slack, without a
# derivative.
_NEVER_BROKEN = 1e3
# number of inequalities of one kind that the solver uses, the tightest ones. Its time grows with
# the square of their number.
_MOST_SLACKS = 24

_SMOOTH = (
    "resolution_mm",
    "focus_mm",
    "field_of_view_px",
    "field_of_view_mm",
    "workspace_mm",
    "reach",
    "clearance_mm",
)


class _Neighbourhood:
    """Fitness and slacks around a pose, with central differences, evaluated once per point."""

    def __init__(
        self,
        cam2world: np.ndarray,
        half_spaces: np.ndarray,
        objective: Objective,
        constraints: Constraints,
    ) -> None:
        step = _DIFFERENCE * np.eye(6)
        self._around = np.vstack([np.zeros(6), step, -step])
        self.start = cam2world
        self.objective = objective
        self.constraints = constraints
        self.distance = float(np.linalg.norm(cam2world[:3, 3] - constraints.sphere_centre)) or 1.0
        norms = np.linalg.norm(half_spaces[:, :3], axis=1)
        self._normals = half_spaces[:, :3]
        self._scales = np.where(norms > 0, norms * self.distance, 1.0)
        self._offsets = half_spaces[:, 3] + constraints.requirements.visibility_radius_mm * norms
        self.names = [name for name in _SMOOTH if name in constraints.constraint_names]
        self._units = {name: constraints.scale(name) for name in self.names}
        self.nfev = 0
        self._values: tuple[float, np.ndarray, np.ndarray, np.ndarray]
        self._kept: dict[str, np.ndarray] = {}
        self._x: np.ndarray | None = None

    def without(self, name: str) -> None:
        """Leave a constraint out."""
        self.names = [other for other in self.names if other != name]

    def poses(self, moves: np.ndarray) -> np.ndarray:
        """Return the poses (n, 4, 4) after moves (n, 6)."""
        return moved(self.start, moves, self.distance)

    def at(self, x: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Return (fitness, gradient (6,), slacks (m,), their Jacobian (m, 6)) at a move x (6,)."""
        if self._x is None or (x != self._x).any():
            moves = x + self._around
            poses = self.poses(moves)
            fitness = self.objective.fitness(poses)
            slacks = self._slacks(moves, poses)
            self.nfev += len(poses)
            self._x = x.copy()
            self._values = (
                fitness[0],
                (fitness[1:7] - fitness[7:]) / (2 * _DIFFERENCE),
                slacks[0],
                (slacks[1:7] - slacks[7:]).T / (2 * _DIFFERENCE),
            )
        return self._values

    def _slacks(self, moves: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Return all smooth slacks of poses (n, 4, 4) in units of their scale, and of the moves' limits; (n, m)."""
        columns = [
            self._nearest(name, value.reshape(len(poses), -1)) / self._units[name]
            for name, value in self.constraints.slacks(poses, self.names).items()
        ]
        inside = -(poses[:, :3, 3] @ self._normals.T + self._offsets) / self._scales
        slacks = (
            np.hstack(
                [
                    *columns,
                    inside,
                    _LARGEST_MOVE - moves,
                    _LARGEST_MOVE + moves,
                ]
            )
            - _BACK_OFF
        )
        return np.minimum(slacks, _NEVER_BROKEN)

    def _nearest(self, name: str, slacks: np.ndarray) -> np.ndarray:
        """Return the columns of slacks (n, m) that were smallest when this was first asked."""
        if slacks.shape[1] <= _MOST_SLACKS:
            return slacks
        if name not in self._kept:
            self._kept[name] = np.argsort(slacks[0], kind="stable")[:_MOST_SLACKS]
        return slacks[:, self._kept[name]]

    def climb(self, max_iterations: int) -> np.ndarray:
        """Return the move (6,) to which the optimiser came."""
        result = minimize(
            lambda x: -self.at(x)[0],
            np.zeros(6),
            jac=lambda x: -self.at(x)[1],
            constraints={
                "type": "ineq",
                "fun": lambda x: self.at(x)[2],
                "jac": lambda x: self.at(x)[3],
            },
            method="SLSQP",
            options={"maxiter": max_iterations, "ftol": _TOLERANCE},
        )
        return result.x if np.isfinite(result.x).all() else np.zeros(6)


def approach(
    cam2world: np.ndarray,
    half_spaces: np.ndarray,
    objective: Objective,
    constraints: Constraints,
    iterations: int,
) -> tuple[np.ndarray, float, int]:
    """Take a few steps from a pose, feasible or not, towards the nearest local optimum.

    Parameters
    ----------
    cam2world, half_spaces, objective, constraints
        As `refine`.
    iterations : int
        How many steps.

    Returns
    -------
    cam2world : array (4, 4)
        Where the steps lead, feasible or nearly so.
    merit : float
        Its fitness, less the largest violation in units of its scale times the highest fitness there can be.
    nfev : int
        Poses evaluated.
    """
    near = _Neighbourhood(cam2world, half_spaces, objective, constraints)
    near.without("clearance_mm")
    x = near.climb(iterations)
    fitness, _, slacks, _ = near.at(x)
    return (
        near.poses(x[None])[0],
        float(fitness + objective.highest * min(slacks.min(), 0.0)),
        near.nfev,
    )


def refine(
    cam2world: np.ndarray,
    half_spaces: np.ndarray,
    objective: Objective,
    constraints: Constraints,
    max_iterations: int = 60,
) -> tuple[np.ndarray, float, int]:
    """Improve a pose locally.

    Parameters
    ----------
    cam2world : array (4, 4)
        A pose, feasible or not.
    half_spaces : array (s, 4)
        Rows (a, b) with a·x + b <= 0: the convex cell of the covering domains that holds the pose.
    objective, constraints : Objective, Constraints
        What is maximised, and what must hold.
    max_iterations : int
        Cap on iterations.

    Returns
    -------
    cam2world : array (4, 4)
        The best feasible pose found, never worse than the given one; the given one if none is feasible.
    fitness : float
        Its fitness; −inf if none is feasible.
    nfev : int
        Poses evaluated.
    """
    near = _Neighbourhood(cam2world, half_spaces, objective, constraints)
    evaluated = 0
    if _clearance(constraints, cam2world) > constraints.requirements.stand_off_mm:
        far = _Neighbourhood(cam2world, half_spaces, objective, constraints)
        far.without("clearance_mm")
        x = far.climb(max_iterations)
        if _clearance(constraints, far.poses(x[None])[0]) >= 0:
            return _best_of_the_way(far, x)
        evaluated = far.nfev
    pose, fitness, nfev = _best_of_the_way(near, near.climb(max_iterations))
    return pose, fitness, nfev + evaluated


def _clearance(constraints: Constraints, cam2world: np.ndarray) -> float:
    return float(constraints.slacks(cam2world[None], ["clearance_mm"])["clearance_mm"].min())


def _best_of_the_way(near: _Neighbourhood, x: np.ndarray) -> tuple[np.ndarray, float, int]:
    """Return the best feasible pose between start and end of a move (6,), its fitness and the poses evaluated.

    The end may break a constraint by rounding or where it is not smooth; only then are those before it looked at.
    """
    shares = np.array([0.0, 1.0])
    mask = near.constraints.feasible(near.poses(shares[:, None] * x))
    if not mask[1]:
        shares = np.linspace(0.0, 1.0, 41)[:-1]
        mask = np.concatenate(
            [mask[:1], near.constraints.feasible(near.poses(shares[1:, None] * x))]
        )
    poses = near.poses(shares[mask, None] * x)
    if not len(poses):
        return near.start, -np.inf, near.nfev
    fitness = near.objective.fitness(poses)
    best = int(np.argmax(fitness))
    return poses[best], float(fitness[best]), near.nfev + len(poses)


# Local refinement from many starts: which poses to begin with, which to follow, and where to look
# again.
#
# A sum of probabilities has few local optima, but some of them hide. Between two optima with the
# view turned to either side of the entities lies the straight view, and most feasible draws are
# straight views. So there are four kinds of starts: the best of the genetic algorithm; the best
# of its first population around positions far from each other; poses drawn in the covering
# domains with the view turned anyhow, feasible or not; and, once an optimum is found, the same
# with its pan and tilt to the other side.
#
# From every start a few steps are taken (`approach`). The most promising ends that are apart are
# refined, first inside their convex cell of the covering domains and then onward as far as all
# constraints hold.


# turned views: shares of the encoded range of pan, tilt and roll
_TURN = np.array([0.5, 0.5, 1.0])
_MIRRORINGS = ((-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))
_NO_WALLS = np.empty((0, 4))


@dataclass
class Ascent:
    """Refinement of poses with an account of the best one.

    Attributes
    ----------
    sampler, encoding, objective, constraints
        The request.
    enough : float
        Fitness at which to stop.
    cam2world, fitness : array (4, 4), float
        The best feasible pose so far.
    nfev : int
        Poses evaluated so far.
    """

    sampler: ViewpointSampler
    encoding: PoseEncoding
    objective: Objective
    constraints: Constraints
    enough: float
    cam2world: np.ndarray
    fitness: float
    nfev: int = 0

    def consider(self, poses: np.ndarray) -> None:
        """Take the best of feasible poses (m, 4, 4) if it is better."""
        if len(poses):
            values = self.objective.fitness(poses)
            self.nfev += len(poses)
            self._keep(poses[values.argmax()], float(values.max()))

    def climb(self, starts: np.ndarray) -> None:
        """Refine the most promising of the starts (m, 4, 4), feasible or not, and the best pose."""
        ends = [(self.fitness, self.cam2world)]
        for pose in starts:
            walls = self.sampler.cell_of(pose[:3, 3])
            if self.fitness < self.enough and walls is not None:
                ends.append(self._approach(pose, walls))
        for pose in self._promising(ends):
            self._follow(pose)

    def mirror(self) -> None:
        """Try the best pose with the view turned to the other side, as long as that gains."""
        before = -np.inf
        while before < self.fitness < self.enough:
            before = self.fitness
            for signs in _MIRRORINGS:
                parameters = self.encoding.parameters_of(self.cam2world[None])
                parameters[:, 3:5] *= signs
                merit, pose = self._approach(
                    self.encoding.poses(parameters)[0], _NO_WALLS, _STEPS_MIRRORED
                )
                if merit > _PROMISING * self.fitness and self._is_apart(pose, [self.cam2world]):
                    self._follow(pose)

    def _approach(
        self, pose: np.ndarray, walls: np.ndarray, steps: int = _STEPS
    ) -> tuple[float, np.ndarray]:
        pose, merit, nfev = approach(pose, walls, self.objective, self.constraints, steps)
        self.nfev += nfev
        return merit, pose

    def _promising(self, ends: list[Any]) -> list[np.ndarray]:
        """Return the best few poses of (merit, pose), nearly equally good and apart."""
        chosen: list[np.ndarray] = []
        ranked = sorted(ends, key=lambda end: -end[0])
        for merit, pose in ranked:
            if merit < _PROMISING * ranked[0][0] or len(chosen) == _FOLLOWED:
                break
            if self._is_apart(pose, chosen):
                chosen.append(pose)
        return chosen

    def _is_apart(self, pose: np.ndarray, others: list[Any]) -> bool:
        """Whether position or direction of view, or both, differ by a tenth from those of all other poses."""
        far = _APART * np.linalg.norm(pose[:3, 3] - self.constraints.sphere_centre)
        return all(
            np.linalg.norm(pose[:3, 3] - other[:3, 3]) > far
            or np.linalg.norm(pose[:3, 2] - other[:3, 2]) > _APART
            for other in others
        )

    def _follow(self, pose: np.ndarray) -> None:
        """Refine a pose in its cell, and then again and again without walls while it gains."""
        fitness = -np.inf
        walls = self.sampler.cell_of(pose[:3, 3])
        for _ in range(_ONWARD_ROUNDS):
            if self.fitness >= self.enough:
                return
            last = fitness
            pose, fitness, nfev = refine(
                pose,
                _NO_WALLS if walls is None else walls,
                self.objective,
                self.constraints,
            )
            self.nfev += nfev
            self._keep(pose, fitness)
            if walls is None and fitness <= last * (1.0 + _ONWARD_GAIN):
                return
            walls = None

    def _keep(self, pose: np.ndarray, fitness: float) -> None:
        if fitness > self.fitness:
            self.cam2world = pose
            self.fitness = fitness


def best_apart(
    bits: np.ndarray,
    fitness: np.ndarray,
    encoding: PoseEncoding,
    n: int,
) -> np.ndarray:
    """Return up to n chromosomes, best first, that are apart from each other.

    Apart means by a tenth of some parameter's range: neighbours would be refined to the same optimum.
    """
    bits = bits[np.argsort(-fitness, kind="stable")]
    places = encoding.parameters(bits) / np.where(
        encoding.high > encoding.low, encoding.high - encoding.low, 1.0
    )
    chosen: list[int] = []
    for i in range(len(bits)):
        if len(chosen) < n and np.all(
            np.abs(places[chosen] - places[i]).max(axis=1, initial=0.0) > _APART
        ):
            chosen.append(i)
    return bits[chosen]


def best_around(poses: np.ndarray, fitness: np.ndarray, n: int) -> np.ndarray:
    """Return up to n of the poses (m, 4, 4): the best of each group around positions as far apart as can be."""
    centres, group = spread(poses[:, :3, 3], n, int(fitness.argmax()))
    members = [np.flatnonzero(group == g) for g in range(len(centres))]
    return poses[[group_members[fitness[group_members].argmax()] for group_members in members]]


def spread(positions: np.ndarray, n: int, first: int = 0) -> tuple[list[int], np.ndarray]:
    """Choose up to n of positions (m, 3), each the farthest from those before; return them and the nearest of each."""
    centres = [first][:n]
    distance = np.linalg.norm(positions - positions[centres].sum(axis=0), axis=1)
    group = np.zeros(len(positions), dtype=int)
    while len(centres) < n and distance.max() > 0:
        centres.append(int(distance.argmax()))
        to_new = np.linalg.norm(positions - positions[centres[-1]], axis=1)
        group[to_new < distance] = len(centres) - 1
        distance = np.minimum(distance, to_new)
    return centres, group


def turned_views(
    n: int,
    sampler: ViewpointSampler,
    encoding: PoseEncoding,
    rng: np.random.Generator,
) -> np.ndarray:
    """Draw up to n poses (m, 4, 4), feasible or not, in the covering domains.

    Positions are far apart; pan and tilt are at most half of what they may be, roll is anything.
    """
    positions = sampler.sample(_DRAWN_PER_START * n, rng)
    if n == 0 or not len(positions):
        return np.empty((0, 4, 4))
    positions = positions[spread(positions, n)[0]]
    turns = rng.uniform(encoding.low[3:], encoding.high[3:], (len(positions), 3)) * _TURN
    return encoding.poses(np.hstack([positions, turns]))
