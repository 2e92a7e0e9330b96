"""Poses are judged for what they inspect, and candidate poses are drawn and improved: each is a column of the cover."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ground.shared import Shared
from planner.callbacks import NOBODY, Callbacks, Checkpoint
from planner.camera.pose import aimed_poses, moved
from planner.cover import exchange_columns, fractional_cover, maximal_columns
from planner.effort import NORMAL, Effort
from planner.executors import check_on_the_way, in_order
from planner.request.problem import Problem
from planner.request.reach import cells_of, visible_where
from planner.search.evolution import triangular_factor
from planner.search.poses import ViewpointSampler
from planner.verify.joint_counts import share_to_show

# Which entities a pose inspects, judged for many poses at once.
#
# Notation: k entities, n poses. A pose *inspects* an entity if every constraint holds for it and
# its probability reaches the threshold. It *nearly* inspects it if it can be seen from there and
# the other margins miss by little; a set of entities that some pose nearly inspects is an
# optimistic column, worth a run of the genetic algorithm.


# tolerance of the field of view, as a share of the sensor's larger side
_FIELD_TOLERANCE = 0.06
# tolerance of the image's length, as a share of the smallest permitted length
_LENGTH_TOLERANCE = 0.1
# tolerance of the depth, as a share of the depth of field. That counts up to nine times its near
# limit, because it may be infinite.
_FOCUS_TOLERANCE = 0.1
# tolerance of the separation, as a share of the required one
_SEPARATION_TOLERANCE = 0.5
# tolerance of the angle of corners, degrees
_CORNER_TOLERANCE_DEG = 5.0
# tolerance of the probability
_PROBABILITY_TOLERANCE = 0.05
# skip an entity that misses a constraint by this many tolerances. The program then does not
# compute its visibility, which costs most.
_HOPELESS = 6.0
# before a column is kept, its pose is displaced this many times. A target stays in it if enough
# of these images show it.
_DISPLACED = 24
# check corners first for this many entities of a pose, those of the highest price. Most of them
# have none.
_FIRST_CORNERS = 2
# poses evaluated at a time. It limits the memory.
BATCH = 2048

# Poses near given ones, far and fine changes mixed.


def perturbed(cam2world: np.ndarray, distance_mm: float, rng: np.random.Generator) -> np.ndarray:
    """Perturb poses (n, 4, 4): swing about the point in focus, shift across the view and along it, turn, roll.

    Every pose draws its own scale, so that both far and fine changes are tried.
    """
    n = len(cam2world)
    scale = 10.0 ** rng.uniform(-2.3, 0.0, (n, 1))
    shift = rng.normal(size=(n, 3)) * scale * distance_mm * [0.3, 0.3, 0.2]
    pivot = cam2world[:, :3, 3] + distance_mm * cam2world[:, :3, 2]
    swing = rng.normal(size=(n, 2)) * scale * 0.6 * (rng.random((n, 1)) < 0.6)
    roll = np.where(
        rng.random(n) < 0.3, rng.uniform(-np.pi, np.pi, n), rng.normal(size=n) * scale[:, 0]
    )
    # looking along z from the origin is the identity, so this is the turn in the camera's own axes
    local = aimed_poses(
        np.zeros((n, 3)), np.array([0.0, 0.0, 1.0]), pan=swing[:, 0], tilt=swing[:, 1], roll=roll
    )
    moved = cam2world.copy()
    moved[:, :3, :3] = cam2world[:, :3, :3] @ local[:, :3, :3]
    moved[:, :3, 3] = pivot - distance_mm * moved[:, :3, 2]
    moved[:, :3, 3] += np.einsum("nij,nj->ni", moved[:, :3, :3], shift)
    return moved


# The columns found so far: distinct sets of entities, each with the best pose found for it.


Steady = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""``steady(poses, membership)``: what of columns (n, k) still holds where their poses (n, 4, 4) are displaced."""


class ColumnPool:
    """Distinct sets of entities, each with the best pose found for it.

    **Guarantee.** The pool depends on what was added in which order, on nothing else.
    """

    def __init__(self, n_entities: int):
        self.membership = np.zeros((0, n_entities), dtype=bool)
        self.poses = np.zeros((0, 4, 4))
        self.quality = np.zeros(0)

    def __len__(self) -> int:
        return len(self.membership)

    @property
    def inspected(self) -> np.ndarray:
        """Which entities (k,) are in some column."""
        return np.asarray(self.membership.any(axis=0))

    def to_dict(self) -> dict[str, Any]:
        """Return the arrays, for `from_dict`; they are not changed when something is added."""
        return {"membership": self.membership, "poses": self.poses, "quality": self.quality}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> ColumnPool:
        """Build from the result of `to_dict`."""
        pool = cls(data["membership"].shape[1])
        pool.membership = data["membership"]
        pool.poses = data["poses"]
        pool.quality = data["quality"]
        return pool

    def add(
        self,
        membership: np.ndarray,
        poses: np.ndarray,
        probability: np.ndarray,
        steady: Steady | None = None,
    ) -> None:
        """Add columns (n, k) with their poses (n, 4, 4) and probabilities (n, k); keep the maximal ones.

        Of poses for the same set the one with the largest mean probability stays. ``steady(poses, membership)`` says
        what of columns can be kept; only those that would stay are asked for.
        """
        if steady is not None:
            membership = self._steady(membership, poses, probability, steady)
        inspecting = membership.any(axis=1)
        membership = membership[inspecting]
        poses = poses[inspecting]
        probability = probability[inspecting]
        quality = _mean_probability(membership, probability)
        maximal = self._maximal(membership, quality)
        membership = np.concatenate([self.membership, membership])
        poses = np.concatenate([self.poses, poses])
        quality = np.concatenate([self.quality, quality])
        self.membership = membership[maximal]
        self.poses = poses[maximal]
        self.quality = quality[maximal]

    def _maximal(self, membership: np.ndarray, quality: np.ndarray) -> np.ndarray:
        """Return the indices of the columns that stay, of those that are here and then of new ones."""
        both = np.concatenate([self.membership, membership])
        best_first = np.argsort(-np.concatenate([self.quality, quality]), kind="stable")
        return np.asarray(best_first[maximal_columns(both[best_first])])

    def _steady(
        self, membership: np.ndarray, poses: np.ndarray, probability: np.ndarray, steady: Steady
    ) -> np.ndarray:
        """Return new columns without what cannot be kept of them; those that would not stay are empty.

        A column that becomes smaller may no longer contain others, so these are asked for next.
        """
        membership = membership.copy()
        nonempty = np.asarray(membership.any(axis=1))
        while True:
            stays = np.zeros(len(membership), dtype=bool)
            maximal = self._maximal(membership, _mean_probability(membership, probability))
            stays[maximal[maximal >= len(self)] - len(self)] = True
            unsteady = np.flatnonzero(stays & nonempty)
            if not unsteady.size:
                membership[nonempty] = False
                return membership
            membership[unsteady] = steady(poses[unsteady], membership[unsteady])
            nonempty[unsteady] = False

    def best_containing(self, column: np.ndarray) -> int | None:
        """Return the index of the best pose whose set contains a column (k,), or None."""
        containing = np.flatnonzero(self.membership[:, column].all(axis=1))
        return int(containing[np.argmax(self.quality[containing])]) if containing.size else None


def _mean_probability(membership: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """Return the mean probability (n,) of what columns (n, k) contain; 0 of an empty one."""
    n_members = np.maximum(membership.sum(axis=1), 1)
    return np.asarray(np.where(membership, probability, 0.0).sum(axis=1) / n_members)


# poses whose displaced images are made at a time
_ROWS = 64


@dataclass(frozen=True)
class Judgement:
    """What poses inspect.

    Attributes
    ----------
    inspects : array of bool (n, k)
        All constraints hold and the probability reaches the threshold.
    nearly : array of bool (n, k)
        The same with some slack; contains ``inspects``.
    countable : array of bool (n, k)
        Those of ``inspects`` that a count of displaced poses will probably show: chance takes a share of what it finds,
        so the probability has to be above the threshold by as much.
    probability : array (n, k)
        Success probability; 0 where the constraints rule the entity out.
    promise : array (n, k)
        1 where the constraints hold, falling to 0 as they are missed by more: a slope for a search to climb.
    """

    inspects: np.ndarray
    nearly: np.ndarray
    countable: np.ndarray
    probability: np.ndarray
    promise: np.ndarray

    @classmethod
    def joined(cls, parts: Sequence[Judgement]) -> Judgement:
        """Return the judgements of several groups of poses as one; there must be one at least."""
        return cls(
            *(
                np.concatenate([getattr(part, field.name) for part in parts])
                for field in fields(cls)
            )
        )


class Judge:
    """Judges poses against all entities of a request.

    Parameters
    ----------
    problem : Problem
        What is asked; its entities (k) are the columns of every result.
    effort : Effort
        How long to search; what works with a judge takes its numbers from it.
    to_be_counted : bool
        Whether a count follows, so that a probability has to be above the threshold by what chance may take. Not for a
        proof: all that a pose inspects is a column there.
    """

    def __init__(self, problem: Problem, effort: Effort = NORMAL, to_be_counted: bool = True):
        self.problem = problem
        self.effort = effort
        self.to_be_counted = to_be_counted
        self.space = problem.space
        self.names = problem.names
        self.camera = problem.camera
        self.accuracy = problem.accuracy
        self.threshold = problem.probability
        self._share_to_show = share_to_show(self.threshold) if to_be_counted else self.threshold
        self.requirements = problem.requirements
        # each witness is judged for itself; a pose inspects a target by any of them
        self.single = problem.single
        self.constraints = self.single.constraints
        self.ends = problem.ends
        self._by_witness = _ByWitness(problem.owner) if problem.has_choice else None
        self._unlit = np.isin(self.single.names, sorted(problem.unlit))
        nearest, farthest = self.camera.depth_of_field_mm
        depth = min(farthest, 10 * nearest) - nearest
        self._tolerance = {
            "resolution_mm": _LENGTH_TOLERANCE * self.constraints.min_length_mm,
            "focus_mm": _FOCUS_TOLERANCE * depth,
            "field_of_view_px": _FIELD_TOLERANCE * max(self.camera.resolution),
            "separation_px": _SEPARATION_TOLERANCE * self.requirements.showing.separation_px,
            "corner_deg": _CORNER_TOLERANCE_DEG,
        }

    def __getstate__(self) -> dict[str, Any]:
        """Keep what it was made with: the rest is made from that again."""
        return {
            "problem": self.problem,
            "effort": self.effort,
            "to_be_counted": self.to_be_counted,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)  # type: ignore[misc]

    def __call__(self, cam2world: np.ndarray, prices: np.ndarray | None = None) -> Judgement:
        """Judge poses (n, 4, 4).

        Parameters
        ----------
        cam2world : array (n, 4, 4)
        prices : array (k,), optional
            Worth of the entities; probabilities, and whether edges show, are computed only for poses that nearly
            inspect a worth of more than 1, the others inspect nothing.
        """
        parts = [
            self._judge(cam2world[i : i + BATCH], prices) for i in range(0, len(cam2world), BATCH)
        ]
        if not parts:
            empty = np.zeros((0, len(self.names)))
            nothing = empty.astype(bool)
            return Judgement(nothing, nothing, nothing, empty, empty)
        return Judgement.joined(parts)

    def steady(self, cam2world: np.ndarray, membership: np.ndarray) -> np.ndarray:
        """Return what of columns (n, k) still shows in enough images of displaced poses.

        Lines may come into view, or too near, when the camera is displaced; no other reserve counts that. So each pose
        (n, 4, 4) is displaced by the same few draws. A target is kept if it shows in the required share of them: the
        margin of chance is the count's, which follows for what a plan chooses.

        Parameters
        ----------
        cam2world : array (n, 4, 4)
            Poses.
        membership : array of bool (n, k)
            What they inspect.
        """
        if not (self.constraints.shows and membership.any()):
            return membership
        enough = math.floor(self.threshold * _DISPLACED)
        columns = membership.copy()
        rows = np.flatnonzero(membership.any(axis=1))
        for first in range(0, len(rows), _ROWS):
            check_on_the_way()
            batch = rows[first : first + _ROWS]
            displaced = np.concatenate([moved(cam2world[row], self._moves, 1.0) for row in batch])
            promised = np.repeat(membership[batch][:, self.problem.owner], _DISPLACED, axis=0)
            shown = self.constraints.image.shown(displaced, promised)
            if self._by_witness is not None:
                shown = self._by_witness.any(shown)
            often = shown.reshape(len(batch), _DISPLACED, -1).sum(axis=1) >= enough
            columns[batch] &= often | ~membership[batch]
        return columns

    @cached_property
    def _moves(self) -> np.ndarray:
        """Displacements (d, 6) of the camera, mm and rad: the same draws for all poses, each also the other way."""
        n = _DISPLACED
        normal = np.random.default_rng(n).standard_normal((-(-n // 2), 6))
        factor = triangular_factor(self.problem.pose_uncertainty.covariance)
        # sums of few products, in one order on all machines
        moves = np.stack(
            [sum(normal[:, j] * factor[i, j] for j in range(i + 1)) for i in range(6)], axis=1
        )
        return np.ascontiguousarray(np.concatenate([moves, -moves])[:n])

    def _judge(self, cam2world: np.ndarray, prices: np.ndarray | None) -> Judgement:
        check_on_the_way()
        missed = self._missed(cam2world)
        nearly = (missed <= 1.0) & ~self._unlit
        worth = _Worth(prices, self._by_witness)
        worth.drop_worthless(nearly)
        probability = np.zeros(nearly.shape)
        if nearly.any():
            probability[nearly] = self.single.objective.probability_where(cam2world, nearly)
        # required is that all holds: field and visibility keep reserves, lines nearby are left to the count
        sure = self._with_focus(cam2world, nearly, probability)
        nearly &= sure >= self.threshold - _PROBABILITY_TOLERANCE
        self._mask_invisible_around(cam2world, nearly, probability)
        shown = self._detectable(cam2world, nearly, probability, worth)
        self._keep_reachable(cam2world, nearly, probability)
        inspects = (missed == 0.0) & nearly & shown & (sure >= self.threshold)
        countable = inspects & (sure >= self._share_to_show)
        judged = Judgement(inspects, nearly, countable, probability, np.exp(-missed))
        return judged if self._by_witness is None else self._by_witness.of_targets(judged)

    def _with_focus(
        self, cam2world: np.ndarray, nearly: np.ndarray, probability: np.ndarray
    ) -> np.ndarray:
        """Return probabilities (n, k) times that of being in focus, where that may matter."""
        sure = probability.copy()
        rows = np.flatnonzero(nearly.any(axis=1))
        if rows.size:
            sure[rows] *= self.constraints.focus_probability(cam2world[rows])
        return sure

    def _missed(self, cam2world: np.ndarray) -> np.ndarray:
        """Return how far the worst constraint of each entity is missed, in units of its tolerance; (n, k), 0 is met."""
        missed = np.zeros((len(cam2world), len(self.single.names)))
        for name, margin in self.constraints.margins(cam2world, self.constraints.of_image).items():
            missed = np.maximum(missed, self._short(name, margin))
        for name in self.constraints.constraint_names:
            if name in self.constraints.shows or name in self.constraints.of_image:
                continue
            hopeful_poses = np.flatnonzero((missed < _HOPELESS).any(axis=1))
            if not hopeful_poses.size:
                break
            if name == "visibility":
                self._mask_invisible(cam2world, missed)
                continue
            margin = self.constraints.margins(cam2world[hopeful_poses], [name])[name]
            missed[hopeful_poses] = np.maximum(missed[hopeful_poses], self._short(name, margin))
        return missed

    def _short(self, name: str, margin: np.ndarray) -> np.ndarray:
        """Return how far margins miss, in units of the tolerance; infinite where there is none."""
        short = np.maximum(-margin, 0.0)
        tolerance = self._tolerance.get(name)
        return np.where(short > 0, np.inf, 0.0) if tolerance is None else short / tolerance

    def _mask_invisible(self, cam2world: np.ndarray, missed: np.ndarray) -> None:
        """Ask for visibility, the costly constraint, only where the others leave hope."""
        hopeful = missed < _HOPELESS
        seen = visible_where(self.single.space, cam2world[:, :3, 3], self.single.names, hopeful)
        missed[hopeful & ~seen] = np.inf

    def _mask_invisible_around(
        self, cam2world: np.ndarray, nearly: np.ndarray, probability: np.ndarray
    ) -> None:
        """Ask for visibility all around the positions, which costs most, only of what would otherwise be inspected."""
        radius = self.requirements.visibility_radius_mm
        if radius <= 0 or not nearly.any():
            return
        single = self.single
        seen = visible_where(single.space, cam2world[:, :3, 3], single.names, nearly, radius)
        probability[nearly & ~seen] = 0.0
        nearly &= seen

    def _detectable(
        self,
        cam2world: np.ndarray,
        nearly: np.ndarray,
        probability: np.ndarray,
        worth: _Worth,
    ) -> np.ndarray:
        """Return who can be found in the image (n, k), asked only of what would otherwise be inspected."""
        shown = np.ones_like(nearly)
        for name in self.constraints.shows if nearly.any() else ():
            image = self.constraints.image
            for turn in worth.most_worthy_first(
                nearly, _FIRST_CORNERS if name == "corner_deg" else 0
            ):
                candidates = nearly & turn
                margin = (
                    image.corners(cam2world, candidates)
                    if name == "corner_deg"
                    else image.separations(cam2world, candidates, 0.0)
                )
                shown &= margin >= 0.0
                hopeless = candidates & (margin < -self._tolerance[name])
                nearly[hopeless] = False
                probability[hopeless] = 0.0
        return shown

    def _keep_reachable(
        self, cam2world: np.ndarray, nearly: np.ndarray, probability: np.ndarray
    ) -> None:
        """Ask a robot's cell, which takes long, only of poses that would otherwise nearly inspect something."""
        cell = self.requirements.cell
        rows = np.flatnonzero(nearly.any(axis=1))
        if cell is None or not rows.size:
            return
        constraints = self.constraints
        promised = nearly[rows]
        seen = cell.inspectable(cam2world[rows], constraints.segments, constraints.owner, promised)
        probability[rows] = np.where(promised & ~seen, 0.0, probability[rows])
        nearly[rows] = seen


class _ByWitness:
    """From witnesses (w) to the targets (k) that they are of."""

    def __init__(self, owner: np.ndarray):
        self.owner = owner
        self._first = np.flatnonzero(np.diff(owner, prepend=-1))

    def any(self, flags: np.ndarray) -> np.ndarray:
        """Return for which targets a witness is flagged; (n, k) of (n, w)."""
        return np.asarray(np.logical_or.reduceat(flags, self._first, axis=1))

    def largest(self, values: np.ndarray) -> np.ndarray:
        """Return the largest value of any witness; (n, k) of (n, w)."""
        return np.asarray(np.maximum.reduceat(values, self._first, axis=1))

    def of_targets(self, judged: Judgement) -> Judgement:
        """Return what poses inspect by any witness, with the probability of the best one that counts."""
        inspects = self.any(judged.inspects)
        sure = self.largest(np.where(judged.inspects, judged.probability, 0.0))
        probability = np.where(inspects, sure, self.largest(judged.probability))
        return Judgement(
            inspects,
            self.any(judged.nearly),
            self.any(judged.countable),
            probability,
            self.largest(judged.promise),
        )


class _Worth:
    """What the targets of poses are worth; without prices everything is worth looking at."""

    def __init__(self, prices: np.ndarray | None, by_witness: _ByWitness | None):
        self._prices = prices
        self._by_witness = by_witness

    def most_worthy_first(self, nearly: np.ndarray, n: int) -> Iterator[np.ndarray]:
        """Yield who is to be asked of (n, w), and drop what is worth too little by then.

        First the n of each pose that are worth most, if any, then the others.
        """
        if self._prices is None:
            yield np.ones_like(nearly)
            return
        prices = self._prices if self._by_witness is None else self._prices[self._by_witness.owner]
        by_worth = np.argsort(-prices, kind="stable")
        first = np.zeros_like(nearly)
        first[:, by_worth] = nearly[:, by_worth] & (np.cumsum(nearly[:, by_worth], axis=1) <= n)
        for mask in (first, ~first) if n else (~first,):
            self.drop_worthless(nearly)
            yield mask

    def drop_worthless(self, nearly: np.ndarray) -> None:
        """Clear the rows of what poses nearly inspect (n, w) that are worth no more than 1."""
        if self._prices is None:
            return
        targets = nearly if self._by_witness is None else self._by_witness.any(nearly)
        nearly &= (targets @ self._prices > 1.0 + 1e-6)[:, None]


# Candidate poses: drawn from the domains, then improved where the cover would profit.
#
# Column generation (Gilmore & Gomory 1961): the linear relaxation of the cover over the columns
# found so far prices each entity; a pose whose inspected entities are worth more than 1 together
# improves the cover. Such poses are looked for by random perturbation of the best ones, and drawn
# anew, by the prices: near known poses only, the search would miss what no known pose is near to.


# viewing directions for each drawn viewpoint. The first looks at the entity itself.
_AXES_PER_VIEWPOINT = 6
# a round starts from up to one and a half times this number of poses. A quarter of the number is
# drawn from the pool, and a quarter is the best of the pool by price. Up to half nearly inspect
# a set that would improve the cover. Up to half are the best of the round before. More that nearly
# inspect such a set join them where fewer poses are drawn anew.
_PARENTS = 64
# number of perturbations of every parent
_CHILDREN = 16
# poses evaluated at a time, in every process, because the last digits depend on it
_BATCH = 768
# rounds between two checks of the relaxation
_ROUNDS_PER_CHECK = 10
# the search ends after this many checks with too little gain
_CHECKS = 5
# least sufficient gain, as a share of the relaxation's value
_LEAST_GAIN = 2e-3
# steps of the exchange search for a cover that would end the search
_LAST_EXCHANGES = 300
# at first, this many times as many directions look at the whole part as at an entity
_WHOLE = 16
# the search improves a pose for an entity only if it nearly inspects it to this degree (1:
# inspected)
_PROMISING = 0.3
# poses drawn anew in a round: for each of so many entities, drawn by their prices, so many poses
# that have it in focus together with others
_DRAWN_ENTITIES = 64
_DRAWN_POSES = 12
# entities that poses are drawn for in any round, however long none has improved the cover
_LEAST_DRAWN = 4
# entities in focus together, the first one included. It may be drawn again, so they may be fewer.
_IN_FOCUS = 3
# of a depth of field, this much is the standard deviation of depth that counts as flat
_FLAT = 0.25
# price of an entity without a column. It exceeds the weight of a column, because a column of its
# own is worth a setting.
_UNCOVERED = 2.0


def derive_seed(seed: int, labels: Iterable[str]) -> int:
    """Derive the seed of a piece of work from the plan's seed and a set of labels, whatever the order of the work."""
    text = "\x1f".join([str(seed), *sorted(labels)])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:7], "big")


def entity_poses(judge: Judge, name: str, n_viewpoints: int, seed: int) -> np.ndarray:
    """Draw poses that look at an entity and at what else can be seen from there.

    Parameters
    ----------
    judge : Judge
    name : str
        The entity.
    n_viewpoints : int
        Viewpoints drawn uniformly from where the entity is observable and can be in focus.
    seed : int
        The plan's seed.

    Returns
    -------
    array (n, 4, 4)
        Poses; none if no such viewpoint was found.
    """
    rng = np.random.default_rng(derive_seed(seed, [name]))
    witnesses = np.flatnonzero(judge.problem.owner == judge.names.index(name)).tolist()
    # as many viewpoints altogether, whichever witness they look at
    each = -(-n_viewpoints // len(witnesses))
    poses = [_witness_poses(judge, witness, each, rng) for witness in witnesses]
    return np.concatenate(poses)


def _witness_poses(
    judge: Judge, own: int, n_viewpoints: int, rng: np.random.Generator
) -> np.ndarray:
    """Draw poses that look at one witness, a column of the single request."""
    single = judge.single
    cells = cells_of(single.space, [single.names[own]])
    sampler = ViewpointSampler(cells, single.ends[own : own + 1], judge.camera)
    viewpoints = sampler.sample(n_viewpoints, rng)
    if not len(viewpoints):
        return np.zeros((0, 4, 4))
    viewpoints = np.repeat(viewpoints, _AXES_PER_VIEWPOINT, axis=0)
    return aimed_poses(
        viewpoints,
        _targets(judge, viewpoints, own, rng),
        roll=rng.uniform(-np.pi, np.pi, len(viewpoints)),
    )


def first_poses(judge: Judge, n_directions: int, seed: int) -> np.ndarray:
    """Draw poses that look at the middle of every entity from the focus distance, and at the whole part, from anywhere.

    They take no regions to draw, so most of them see nothing; but they come at once.

    Parameters
    ----------
    judge : Judge
    n_directions : int
        Poses for every entity; the part gets more, see `_WHOLE`.
    seed : int
        The plan's seed.

    Returns
    -------
    array (n, 4, 4)
        Those in the workspace.
    """
    rng = np.random.default_rng(derive_seed(seed, ["first"]))
    low, high = np.asarray(judge.space.solid.bounds, dtype=float)
    radius = float(np.linalg.norm(high - low)) / 2
    (nearest, farthest) = judge.camera.depth_of_field_mm
    focus = judge.camera.focus_distance_mm
    # as close as all of the part is in focus, if it ever is
    whole = nearest + radius if nearest + 2 * radius <= farthest else focus
    targets = np.concatenate(
        [judge.ends.mean(axis=1), np.repeat([(low + high) / 2], _WHOLE, axis=0)]
    )
    distances = np.repeat(
        np.append(np.full(len(judge.ends), focus), np.full(_WHOLE, whole)), n_directions
    )
    targets = np.repeat(targets, n_directions, axis=0)
    away = rng.normal(size=targets.shape)
    positions = targets + (distances / np.linalg.norm(away, axis=1))[:, None] * away
    low, high = np.asarray(judge.space.workspace, dtype=float)
    inside = ((positions >= low) & (positions <= high)).all(axis=1)
    return aimed_poses(
        positions[inside], targets[inside], roll=rng.uniform(-np.pi, np.pi, int(inside.sum()))
    )


def poses_in_focus(
    judge: Judge, prices: np.ndarray, n_entities: int, n_poses: int, rng: np.random.Generator
) -> np.ndarray:
    """Draw poses, from anywhere, that have an entity in focus together with others near it.

    Where the depth of field is thin, few directions have three entities in focus, and poses near known ones seldom come
    across them. So a direction is drawn from the angular central Gaussian distribution (D. E. Tyler, Biometrika 74,
    1987) of the matrix (C + s² I)⁻¹, where C is the covariance of the ends of some entities: directions along which
    these are less deep than s are all about as likely, and others are the rarer the deeper the entities are.

    Parameters
    ----------
    judge : Judge
    prices : array (k,)
        Worth of the entities, not negative, and of one at least positive. An entity is drawn as often as it is worth.
    n_entities : int
        So many entities are drawn, with others near each.
    n_poses : int
        Poses for each of them.
    rng : numpy.random.Generator

    Returns
    -------
    array (n_entities * n_poses, 4, 4)
        Poses. Nothing but focus is looked at: most of them may inspect nothing.
    """
    ends = judge.single.ends
    middles = ends.mean(axis=1)
    worth = prices[judge.problem.owner]
    first = _drawn(np.cumsum(worth)[None], np.zeros(n_entities, dtype=int), rng)
    apart = np.linalg.norm(middles[first][:, None] - middles, axis=2)
    # of each of these the running sum of what is worth something and near it
    sums = np.cumsum(np.where(apart < _width_mm(judge), worth, 0.0), axis=1)
    row = np.repeat(np.arange(n_entities), n_poses)
    others = [_drawn(sums, row, rng) for _ in range(_IN_FOCUS - 1)]
    points = ends[np.stack([first[row], *others], axis=1)].reshape(len(row), -1, 3)
    centre = points.mean(axis=1)
    nearest, farthest = judge.camera.depth_of_field_mm
    farthest = min(farthest, 10 * nearest)
    flat = _FLAT * (farthest - nearest) * 10.0 ** rng.uniform(-0.5, 0.5, len(row))
    axis = _flat_directions(points - centre[:, None], flat, rng)
    depth = ((points - centre[:, None]) * axis[:, None]).sum(axis=2)
    # the distances at which all ends are in focus; if there are none, some between
    low = nearest - depth.min(axis=1)
    high = farthest - depth.max(axis=1)
    distance = low + (high - low) * rng.random(len(row))
    return aimed_poses(
        centre - distance[:, None] * axis,
        centre,
        roll=rng.uniform(-np.pi, np.pi, len(row)),
    )


def _drawn(sums: np.ndarray, row: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw an index for each of some rows (n,) of running sums (m, k), as often as it adds to the sum."""
    drawn = np.zeros(len(row), dtype=int)
    level = rng.random(len(row))
    for k, running in enumerate(sums):
        here = row == k
        drawn[here] = np.searchsorted(running, level[here] * running[-1], side="right")
    return np.minimum(drawn, sums.shape[1] - 1)


def _flat_directions(points: np.ndarray, flat: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw directions (n, 3) along which points (n, p, 3) about the origin are seldom deeper than lengths (n,)."""
    spread = (points[:, :, :, None] * points[:, :, None, :]).mean(axis=1)
    spread = spread + (flat**2)[:, None, None] * np.eye(3)
    # Cholesky's factor, and a normal draw divided by its transpose
    a = np.sqrt(spread[:, 0, 0])
    b = spread[:, 1, 0] / a
    c = spread[:, 2, 0] / a
    d = np.sqrt(spread[:, 1, 1] - b * b)
    e = (spread[:, 2, 1] - c * b) / d
    f = np.sqrt(spread[:, 2, 2] - c * c - e * e)
    draws = rng.normal(size=(len(points), 3))
    z = draws[:, 2] / f
    y = (draws[:, 1] - e * z) / d
    x = (draws[:, 0] - b * y - c * z) / a
    axis = np.stack([x, y, z], axis=1)
    return np.asarray(axis / np.linalg.norm(axis, axis=1)[:, None])


def _width_mm(judge: Judge) -> float:
    """Return how wide the picture is about, where the lens is focused."""
    return 2 * judge.camera.focus_distance_mm * float(np.tan(judge.camera.half_diagonal_rad))


def judged_poses(
    shared: Shared, name: str, n_viewpoints: int, seed: int
) -> tuple[np.ndarray, Judgement]:
    """Draw poses for an entity and judge them: `entity_poses` as a task; ``shared`` holds the judge."""
    poses = entity_poses(shared.value, name, n_viewpoints, seed)
    return poses, shared.value(poses)


def _judged(shared: Shared, poses: np.ndarray, prices: np.ndarray) -> Judgement:
    return shared.value(poses, prices)


def _targets(
    judge: Judge, viewpoints: np.ndarray, own: int, rng: np.random.Generator
) -> np.ndarray:
    """Choose points to look at: the entity's middle, or a point between it and the middle of another one near it."""
    middles = judge.single.ends.mean(axis=1)
    near = np.flatnonzero(np.linalg.norm(middles - middles[own], axis=1) < _width_mm(judge))
    other = rng.choice(near, len(viewpoints))
    share = rng.uniform(0.0, 1.0, (len(viewpoints), 1))
    share[::_AXES_PER_VIEWPOINT] = 0.0
    return middles[own] + share * (middles[other] - middles[own])


class Pools(NamedTuple):
    """Columns found so far.

    Attributes
    ----------
    realised : ColumnPool
        What poses inspect, as far as a count will probably show it.
    near : ColumnPool
        Optimistic columns: what they nearly inspect.
    """

    realised: ColumnPool
    near: ColumnPool

    def add(self, poses: np.ndarray, judged: Judgement, steady: Steady | None = None) -> None:
        """Add poses (n, 4, 4) as judged; what is not steady, see `ColumnPool.add`, only to the near columns."""
        self.realised.add(judged.countable, poses, judged.probability, steady)
        self.near.add(judged.nearly, poses, judged.probability)

    def add_missing(self, poses: np.ndarray, judged: Judgement) -> None:
        """Add for each target that is in no column the surest of poses (n, 4, 4) that inspects it.

        A count will probably not show it, but there may be no better pose.
        """
        missing = judged.inspects.any(axis=0) & ~self.realised.inspected
        for target in np.flatnonzero(missing).tolist():
            sure = np.where(judged.inspects[:, target], judged.probability[:, target], -1.0)
            best = [int(np.argmax(sure))]
            column = judged.countable[best]
            column[:, target] = True
            self.realised.add(column, poses[best], judged.probability[best])

    def to_dict(self) -> dict[str, Any]:
        """Return the arrays, for `from_dict`."""
        return {"realised": self.realised.to_dict(), "near": self.near.to_dict()}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Pools:
        """Build from the result of `to_dict`; other keys do not matter."""
        return cls(*(ColumnPool.from_dict(data[name]) for name in cls._fields))


class WarmStart(NamedTuple):
    """What column generation begins with.

    Attributes
    ----------
    seed_poses : array (m, 4, 4), optional
        Poses to breed from first; they join the pools.
    coverable : array of bool (k,), optional
        Targets that the cover may come to contain. The search also looks for those of them that no pose inspects yet.
        Default: the targets that are inspected at the beginning.
    """

    seed_poses: np.ndarray | None = None
    coverable: np.ndarray | None = None


def price_poses(
    shared: Shared,
    pools: Pools,
    seed: int,
    rounds: int,
    executor: Executor | None = None,
    callbacks: Callbacks = NOBODY,
    warm_start: WarmStart | None = None,
    checkpoint: Checkpoint | None = None,
) -> None:
    """Improve both pools by column generation.

    Parameters
    ----------
    shared : Shared of Judge
    pools : Pools
        Changed in place.
    seed : int
        The plan's seed.
    rounds : int
        Rounds at most; fewer if more are not worth it, or one column covers everything.
    executor : concurrent.futures.Executor, optional
        Judges poses; the result does not depend on it.
    callbacks : Callbacks
        Progress is reported to them.
    warm_start : WarmStart, optional
        Poses to begin with, and targets to look for.
    checkpoint : Checkpoint, optional
        Keeps after each round how far this has got. If it holds an entry, this goes on from there, with the pools of
        then.
    """
    parents, coverable = warm_start or WarmStart()
    breed = _Breed(pools.realised.poses[:0] if parents is None else parents[:_PARENTS])
    if parents is not None:
        pools.add(parents, shared.value(parents), shared.value.steady)
    rng = np.random.default_rng(derive_seed(seed, ["pricing"]))
    covered = pools.realised.inspected
    values: list[float] = []
    first = 0
    prices = np.zeros(len(covered))
    checkpoint = checkpoint or Checkpoint()
    if (entry := checkpoint.get("pricing")) is not None:
        first, values, prices, covered = (entry[k] for k in ("done", "values", "prices", "covered"))
        breed = _Breed(entry["breed"], entry.get("in_vain", 0))
        rng.bit_generator.state = entry["rng"]
    for done in range(first, rounds):
        if coverable is not None and (now := pools.realised.inspected).sum() > covered.sum():
            # a cover of more is another one: its relaxation is not compared with those before
            covered = now
            values = []
        missing = np.zeros(len(covered), dtype=bool)
        if coverable is not None:
            missing = coverable & ~covered
        membership = pools.realised.membership[:, covered]
        if not len(pools.near) or (
            not missing.any() and (not covered.any() or membership.all(axis=1).any())
        ):
            break
        if done % _ROUNDS_PER_CHECK == 0 and covered.any():
            values = [*values, fractional_cover(membership)[0]]
            if _is_settled(values, membership, rounds - done):
                break
        # the optimal prices are seldom unique: other ones every round keep the search from staring at one corner
        bias = 1.0 + 0.5 * rng.random(int(covered.sum()))
        guess = prices[covered] if done else None
        prices = np.zeros(len(covered))
        prices[covered] = fractional_cover(membership, bias, guess)[1]
        prices[missing] = _UNCOVERED
        breed = _improve(shared, pools, breed, prices, rng, executor)
        so_far = {
            "done": done + 1,
            "breed": breed.parents,
            "in_vain": breed.in_vain,
            "values": values,
            "prices": prices,
            "covered": covered,
        }
        checkpoint.put("pricing", {**so_far, "rng": rng.bit_generator.state})
        callbacks.report(done + 1, rounds, "combining targets")
    callbacks.report(rounds, rounds, "combining targets")


def _is_settled(values: list[float], membership: np.ndarray, left: int) -> bool:
    """Tell whether more columns are not worth it: the relaxation's value no longer falls, or too slowly.

    Too slowly means that, with the gain of late, it would not get to the next whole number in the rounds that are left,
    and a cover of as few columns as the value allows is there already.
    """
    if len(values) <= _CHECKS:
        return False
    gain = values[-1 - _CHECKS] - values[-1]
    if gain <= _LEAST_GAIN * values[-1]:
        return True
    fewest = int(np.ceil(values[-1] - 1e-6))
    hopeless = values[-1] - gain * left / (_CHECKS * _ROUNDS_PER_CHECK) > fewest - 1
    return hopeless and not exchange_columns(membership, fewest, steps=_LAST_EXCHANGES).missing


class _Breed(NamedTuple):
    """What a round begins with: parents (m, 4, 4), and in how many rounds drawn poses have improved nothing."""

    parents: np.ndarray
    in_vain: int = 0

    @property
    def n_drawn(self) -> int:
        """For how many entities poses are drawn: half as many after each round in vain."""
        return max(_DRAWN_ENTITIES >> self.in_vain, _LEAST_DRAWN)

    @property
    def n_hopeful(self) -> int:
        """How many near misses are tried, so that a round has about as many poses as ever."""
        return _PARENTS // 2 + (_DRAWN_ENTITIES - self.n_drawn) * _DRAWN_POSES // _CHILDREN


def _improve(
    shared: Shared,
    pools: Pools,
    breed: _Breed,
    prices: np.ndarray,
    rng: np.random.Generator,
    executor: Executor | None,
) -> _Breed:
    """Breed from the most promising poses, and draw others; return what the next round begins with."""
    pool, near = pools
    at_random = pool.poses[rng.integers(len(pool), size=_PARENTS // 4)] if len(pool) else pool.poses
    worthy = pool.poses[np.argsort(-(pool.membership @ prices), kind="stable")[: _PARENTS // 4]]
    # what is nearly inspected and worth more than 1 would improve the cover if only the pose were put right
    rows = np.flatnonzero(near.membership @ prices > 1.0)
    hopeful = near.poses[rows[rng.permutation(len(rows))[: breed.n_hopeful]]]
    parents = np.concatenate([breed.parents, at_random, worthy, hopeful])
    children = perturbed(
        np.repeat(parents, _CHILDREN, axis=0), shared.value.camera.focus_distance_mm, rng
    )
    drawn = poses_in_focus(shared.value, prices, breed.n_drawn, _DRAWN_POSES, rng)
    children = np.concatenate([drawn, children])
    # batches of one size, whoever judges them: the last digits must not depend on the executor
    batches = [(shared, children[i : i + _BATCH], prices) for i in range(0, len(children), _BATCH)]
    judged = Judgement.joined(list(in_order(executor, _judged, batches)))
    pools.add(children, judged, shared.value.steady)
    improving = judged.countable[: len(drawn)] @ prices > 1.0 + 1e-6
    in_vain = 0 if improving.any() else breed.in_vain + 1
    return _Breed(children[_champions(judged.promise, prices, rng)], in_vain)


def _champions(promise: np.ndarray, prices: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Choose poses of much promised worth, each for another entity, so that the search stays spread over the part."""
    worth = promise @ prices
    entities = rng.permutation(np.flatnonzero(prices > 0))[: _PARENTS // 2]
    best = [int(np.argmax(np.where(promise[:, e] > _PROMISING, worth, -1.0))) for e in entities]
    return np.unique(best)
