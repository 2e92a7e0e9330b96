"""Which entities a pose inspects, judged for many poses at once.

Notation: k entities, n poses. A pose *inspects* an entity if every constraint holds for it and its probability reaches
the threshold. It *nearly* inspects it if it can be seen from there and the other margins miss by little; a set of
entities that some pose nearly inspects is an optimistic column, worth a run of the genetic algorithm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from planner.camera.pose import look_at, moved
from planner.cover.set_cover import maximal_columns
from planner.effort import NORMAL, Effort
from planner.request.reach import visible_where
from planner.request.request import Request
from planner.search.evolution import triangular_factor

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
# Poses evaluated at a time. It limits the memory.
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
    local = look_at(
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
        some = membership.any(axis=1)
        membership = membership[some]
        poses = poses[some]
        probability = probability[some]
        quality = _mean_probability(membership, probability)
        kept = self._maximal(membership, quality)
        membership = np.concatenate([self.membership, membership])
        poses = np.concatenate([self.poses, poses])
        quality = np.concatenate([self.quality, quality])
        self.membership = membership[kept]
        self.poses = poses[kept]
        self.quality = quality[kept]

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
        left = np.asarray(membership.any(axis=1))
        while True:
            stays = np.zeros(len(membership), dtype=bool)
            kept = self._maximal(membership, _mean_probability(membership, probability))
            stays[kept[kept >= len(self)] - len(self)] = True
            asked = np.flatnonzero(stays & left)
            if not asked.size:
                membership[left] = False
                return membership
            membership[asked] = steady(poses[asked], membership[asked])
            left[asked] = False

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
    probability : array (n, k)
        Success probability; 0 where the constraints rule the entity out.
    promise : array (n, k)
        1 where the constraints hold, falling to 0 as they are missed by more: a slope for a search to climb.
    """

    inspects: np.ndarray
    nearly: np.ndarray
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
    request : Request
        What is asked; its entities (k) are the columns of every result.
    effort : Effort
        How closely poses are judged; what works with a judge takes its own numbers from it, too.
    """

    def __init__(self, request: Request, effort: Effort = NORMAL):
        self.request = request
        self.effort = effort
        self.space = request.space
        self.names = request.names
        self.camera = request.camera
        self.accuracy = request.accuracy
        self.threshold = request.probability
        self.requirements = request.requirements
        # each witness is judged for itself; a pose inspects a target by any of them
        self.single = request.single
        self.constraints = self.single.constraints
        self.ends = request.ends
        self._by_witness = _ByWitness(request.owner) if request.has_choice else None
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
        """Keep request and effort only: the rest is made from them again."""
        return {"request": self.request, "effort": self.effort}

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
            return Judgement(empty.astype(bool), empty.astype(bool), empty, empty)
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
        kept = membership.copy()
        rows = np.flatnonzero(membership.any(axis=1))
        for first in range(0, len(rows), _ROWS):
            some = rows[first : first + _ROWS]
            displaced = np.concatenate([moved(cam2world[row], self._moves, 1.0) for row in some])
            wanted = np.repeat(membership[some][:, self.request.owner], _DISPLACED, axis=0)
            shown = self.constraints.image.shown(displaced, wanted)
            if self._by_witness is not None:
                shown = self._by_witness.any(shown)
            often = shown.reshape(len(some), _DISPLACED, -1).sum(axis=1) >= enough
            kept[some] &= often | ~membership[some]
        return kept

    @cached_property
    def _moves(self) -> np.ndarray:
        """Displacements (d, 6) of the camera, mm and rad: the same draws for all poses, each also the other way."""
        n = _DISPLACED
        normal = np.random.default_rng(n).standard_normal((-(-n // 2), 6))
        factor = triangular_factor(self.request.pose_uncertainty.covariance)
        # sums of few products, in one order on all machines
        moves = np.stack(
            [sum(normal[:, j] * factor[i, j] for j in range(i + 1)) for i in range(6)], axis=1
        )
        return np.ascontiguousarray(np.concatenate([moves, -moves])[:n])

    def _judge(self, cam2world: np.ndarray, prices: np.ndarray | None) -> Judgement:
        missed = self._missed(cam2world)
        nearly = missed <= 1.0
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
        judged = Judgement(inspects, nearly, probability, np.exp(-missed))
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
            left = np.flatnonzero((missed < _HOPELESS).any(axis=1))
            if not left.size:
                break
            if name == "visibility":
                self._mask_invisible(cam2world, missed)
                continue
            margin = self.constraints.margins(cam2world[left], [name])[name]
            missed[left] = np.maximum(missed[left], self._short(name, margin))
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
            for some in worth.most_worthy_first(
                nearly, _FIRST_CORNERS if name == "corner_deg" else 0
            ):
                wanted = nearly & some
                margin = (
                    image.corners(cam2world, wanted)
                    if name == "corner_deg"
                    else image.separations(cam2world, wanted, 0.0)
                )
                shown &= margin >= 0.0
                hopeless = wanted & (margin < -self._tolerance[name])
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
        wanted = nearly[rows]
        seen = cell.inspectable(cam2world[rows], constraints.segments, constraints.owner, wanted)
        probability[rows] = np.where(wanted & ~seen, 0.0, probability[rows])
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
            inspects, self.any(judged.nearly), probability, self.largest(judged.promise)
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
        for some in (first, ~first) if n else (~first,):
            self.drop_worthless(nearly)
            yield some

    def drop_worthless(self, nearly: np.ndarray) -> None:
        """Clear the rows of what poses nearly inspect (n, w) that are worth no more than 1."""
        if self._prices is None:
            return
        targets = nearly if self._by_witness is None else self._by_witness.any(nearly)
        nearly &= (targets @ self._prices > 1.0 + 1e-6)[:, None]
