"""The request: what is asked, in one frozen value that travels from the public call to the bound."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.checks import relation_text
from errors.model import Model
from planner.argument_kinds import check_fraction
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty
from planner.exceptions import RequestError
from planner.request.camera_limits import widest_view_mm
from planner.request.constraints import Constraints, Requirements
from planner.request.edge_state import SHARP, EdgeState
from planner.request.models import Means, OwnEdges
from planner.request.reach import Space, TargetSpace, entity_space
from planner.request.reads import Reads
from planner.request.registration import PoseKnowledge
from planner.request.targets import (
    PREFERRED,
    Target,
    WitnessChoice,
    edge_target,
    edge_targets,
    knowledge_of,
    witness_name,
)
from planner.text_table import digits_text

if TYPE_CHECKING:
    from errors.measurands import Localisation, Prediction


# The objective: how probable it is that every target is measured accurately from a pose.


ObjectiveKind = Literal["sum", "min"]


class Objective:
    """Success probabilities of poses, and the fitness made of them.

    Parameters
    ----------
    targets : sequence of Target
        What is measured (k targets).
    means : Means
        With what, and how accurately.
    kind : {"sum", "min"}
        Fitness: the sum of the probabilities (the paper), or the smallest.

    Raises
    ------
    RequestError
        If the accuracy or the kind breaks its rule.
    """

    def __init__(self, targets: Sequence[Target], means: Means, kind: ObjectiveKind = "sum"):
        check_fraction("accuracy", means.accuracy)
        if kind not in ("sum", "min"):
            raise RequestError.of_rule("objective", "must be 'sum' or 'min'", repr(kind))
        self.n_targets = len(targets)
        self.means = means
        self.kind = kind
        # targets of one kind are evaluated together
        self._models = []
        for target_kind in dict.fromkeys(type(target) for target in targets):
            columns = [i for i, target in enumerate(targets) if type(target) is target_kind]
            self._models.append((columns, target_kind.models([targets[i] for i in columns], means)))

    @classmethod
    def of_edges(cls, ends: np.ndarray, means: Means, kind: ObjectiveKind = "sum") -> Objective:
        """Return the objective of edges whose ends (k, 2, 3) are given, mm."""
        return cls([edge_target(f"edge {i}", pair) for i, pair in enumerate(ends)], means, kind)

    def probability(self, cam2world: np.ndarray) -> np.ndarray:
        """Return P (n, k) of poses (n, 4, 4); 0 for a target not wholly in front of the camera."""
        everything = np.ones((len(cam2world), self.n_targets), dtype=bool)
        return self.probability_where(cam2world, everything).reshape(everything.shape)

    def probability_where(self, cam2world: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Return P of poses (n, 4, 4) for those targets that are wanted (n, k), one after the other, row by row."""
        result = np.zeros(wanted.shape)
        for columns, models in self._models:
            mask = np.zeros_like(wanted)
            mask[:, columns] = wanted[:, columns]
            if mask.any():
                result[mask] = models.probability_where(cam2world, mask[:, columns])
        return result[wanted]

    @property
    def highest(self) -> float:
        """The fitness when every probability is 1."""
        return float(self.n_targets) if self.kind == "sum" else 1.0

    def fitness(self, cam2world: np.ndarray) -> np.ndarray:
        """Return the fitness (n,) of poses (n, 4, 4): eq 22, or the smallest probability."""
        probability = self.probability(cam2world)
        return probability.sum(axis=1) if self.kind == "sum" else probability.min(axis=1)


# Which witness of a target a pose shows best, and why the others are not used.


# what a constraint that is not met says of a witness
_WHY = {
    "visibility": "hidden",
    "resolution_mm": "too short in the image",
    "focus_mm": "out of focus",
    "field_of_view_px": "outside the image",
    "field_of_view_mm": "outside the image",
    "separation_px": "another line is too near",
    "corner_deg": "the corner at an end is too flat",
    "workspace_mm": "outside the workspace",
    "clearance_mm": "too close to the part",
    "reach": "out of reach",
}
_OTHER = "a constraint is not met"
_SIGNS = ("visibility", "reach")
OF_SHOWING = ("separation_px", "corner_deg")
"""Constraints that say how a target shows in the image; they mean nothing where it is hidden."""


def unjudged(margins: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the constraints whose margins mean nothing at a pose.

    Regions end at the walls of the workspace. So nobody knows what hides a target from outside of it.

    Parameters
    ----------
    margins : mapping of str to float or array
        Of one pose, by constraint.

    Returns
    -------
    tuple of str
        Empty inside the workspace.
    """
    if np.min(margins["workspace_mm"]) < 0:
        return ("visibility", *OF_SHOWING)
    return ()


def why_missed(name: str, amount: float) -> str:
    """Return in words what it says of a target that a constraint is not met.

    Parameters
    ----------
    name : str
        The constraint, as in the keys of `SensorSetting.margins`.
    amount : float
        By how much it is missed, in the unit that its name ends with.

    Returns
    -------
    str
        Such as "out of focus by 3.2 mm".
    """
    unit = name.rpartition("_")[2]
    if name in _SIGNS or unit not in ("mm", "px", "deg"):
        return _WHY.get(name, _OTHER)
    return f"{_WHY.get(name, _OTHER)} by {digits_text(amount, 3)} {unit}"


class Witnesses(NamedTuple):
    """The witnesses (w) of targets (k), each as a target of its own.

    Attributes
    ----------
    constraints : Constraints
        Of all witnesses.
    objective : Objective
        How surely each is measured.
    owner : array of int (w,)
        The target that each belongs to, ascending.
    """

    constraints: Constraints
    objective: Objective
    owner: NDArray[np.int_]


class WitnessStates(NamedTuple):
    """What a pose says of the witnesses (w) of a request.

    Attributes
    ----------
    missed : array (w,)
        How far the worst constraint is missed, as a share of its scale; 0 if all are met.
    worst : list of str
        That constraint.
    amount : array (w,)
        By how much it is missed, in its unit.
    probability : array (w,)
        P where all are met, else 0.
    """

    missed: NDArray[np.float64]
    worst: list[str]
    amount: NDArray[np.float64]
    probability: NDArray[np.float64]


def choice_for(camera: Camera, most: int, *, apart: bool = False) -> WitnessChoice:
    """Return which witnesses to offer to a camera.

    Stretches are a quarter of the shorter side of its field, in focus.

    Parameters
    ----------
    camera : Camera
        The camera.
    most : int
        Witnesses of a dimension at most. With 1 it is the preferred one, of whole entities.
    apart : bool
        Whether two images may show the entities of a dimension.
    """
    if most == 1:
        return PREFERRED
    across = min(camera.sensor_size_mm) * camera.focus_distance_mm / camera.image_distance_mm
    return WitnessChoice(most, widest_view_mm(camera), across / 4, apart)


def best_witnesses(witnesses: Witnesses, cam2world: NDArray[np.float64]) -> list[int]:
    """Return which witness of each target a pose (4, 4) shows best.

    Of those that meet all constraints it is the one with the largest P; of several, the first. If none meets them it
    is the one that misses them by least.

    Parameters
    ----------
    witnesses : Witnesses
        Of all targets.
    cam2world : array (4, 4)
        The pose.

    Returns
    -------
    list of int
        Of each target, counted from 0 among its own.
    """
    states = witness_states(witnesses, cam2world)
    result = []
    for target in range(witnesses.owner[-1] + 1):
        indices = np.flatnonzero(witnesses.owner == target)
        order = np.lexsort(
            (np.arange(len(indices)), -states.probability[indices], states.missed[indices])
        )
        result.append(int(order[0]))
    return result


def witness_reasons(witnesses: Witnesses, cam2world: NDArray[np.float64]) -> list[list[str]]:
    """Return what keeps a pose from measuring targets by each of their witnesses; if nothing does, its P.

    Parameters
    ----------
    witnesses : Witnesses
        Of all targets.
    cam2world : array (4, 4)
        The pose.
    """
    states = witness_states(witnesses, cam2world)
    texts = [
        f"P {relation_text(float(p))}" if missed == 0.0 else _WHY.get(name, _OTHER)
        for missed, name, p in zip(states.missed, states.worst, states.probability, strict=True)
    ]
    return [
        [texts[w] for w in np.flatnonzero(witnesses.owner == target)]
        for target in range(witnesses.owner[-1] + 1)
    ]


def witness_states(witnesses: Witnesses, cam2world: NDArray[np.float64]) -> WitnessStates:
    """Return what a pose (4, 4) says of all witnesses of a request.

    Parameters
    ----------
    witnesses : Witnesses
        Of all targets.
    cam2world : array (4, 4)
        The pose.
    """
    pose = np.asarray(cam2world, dtype=np.float64)[None]
    constraints, objective, owner = witnesses
    n = len(owner)
    missed = np.zeros(n)
    worst = [""] * n
    amount = np.zeros(n)
    margins = constraints.margins(pose)
    unknown = unjudged(margins)
    for name, margin in margins.items():
        if name in unknown:
            continue
        short = np.maximum(-margin[0], 0.0) / constraints.scale(name)
        for w in np.flatnonzero(np.broadcast_to(short, (n,)) > missed).tolist():
            worst[w] = name
            amount[w] = -float(np.broadcast_to(margin[0], (n,))[w])
        missed = np.maximum(missed, short)
    probability = np.zeros(n)
    met = missed == 0.0
    if met.any():
        probability[met] = objective.probability_where(pose, met[None])
    return WitnessStates(missed, worst, amount, probability)


@dataclass(frozen=True, eq=False)
class Problem:
    """What is asked: which entities are to be measured, by which camera, how accurately and how surely.

    Parameters
    ----------
    space : VisibilityRegions or EntityAspectGraph
        Tells from where which entities are observable.
    names : sequence of str
        What is wanted (k entities); the columns of every result are in this order.
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        How far its real pose may be from the planned one.
    accuracy : float
        Required accuracy A in (0, 1).
    probability : float
        Required probability of it, in (0, 1); the search for a single setting does not use it.
    requirements : Requirements
        What is asked of a setting beside that.
    targets : tuple of Target, optional
        What is measured, in the order of the names. Default: the lengths of edges.
    localisation : Localisation, optional
        How well points are found in the image. Default: the paper's, both ends of an edge on whole pixels.
    surfaces_mm : float
        Standard deviation of a face's position along its normal, mm; for dimensions.
    registered : OwnEdges or PoseUncertainty, optional
        How poses are known when values are read; the pose uncertainty says where images are taken. Default: no better.
    edges : EdgeState
        By how much edges are broken; for dimensions. Default: not at all.
    reads : Reads, optional
        What measuring will find in the images, for lamps; default: lamps are chosen by the faces beside edges alone.
    unlit : frozenset of str
        Targets of `single` that no lamp lights. No pose inspects them.
    chosen : mapping of str to int
        Which of its witnesses a target has here, where it had several; see `at_pose`.

    Raises
    ------
    RequestError
        If the accuracy or the probability breaks its rule.
    """

    space: Space
    names: tuple[str, ...]
    camera: Camera
    pose_uncertainty: PoseUncertainty
    accuracy: float = 0.98
    probability: float = 0.9
    requirements: Requirements = field(default_factory=Requirements)
    targets: tuple[Target, ...] = ()
    localisation: Localisation | None = None
    surfaces_mm: float = 0.0
    registered: OwnEdges | PoseUncertainty | None = None
    edges: EdgeState = SHARP
    reads: Reads | None = None
    unlit: frozenset[str] = frozenset()
    chosen: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        for name in ("accuracy", "probability"):
            object.__setattr__(self, name, check_fraction(name, getattr(self, name)))
        targets = self.targets or edge_targets(self.space.entities, self.names)
        object.__setattr__(self, "targets", targets)

    def __getstate__(self) -> dict[str, object]:
        """Leave what is computed behind: the constraints' scene cannot cross a process boundary."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def ends(self) -> NDArray[np.float64]:
        """Ends of the entities in the part's frame, shape (k, 2, 3), mm; of a target's first witness."""
        return np.array([target.witnesses[0].ends for target in self.targets], dtype=np.float64)

    @cached_property
    def constraints(self) -> Constraints:
        """The constraints of a setting that inspects all that is wanted; each target has one witness."""
        return Constraints(self.space, self.names, self.camera, self.requirements, self.targets)

    @cached_property
    def objective(self) -> Objective:
        """The success probabilities of all that is wanted, and their sum."""
        return self.objective_of("sum", "joint")

    def objective_of(self, kind: ObjectiveKind, model: Model) -> Objective:
        """Return the objective of another kind or error model, see `Objective`."""
        return Objective(self.targets, replace(self.means, model=model), kind)

    @property
    def means(self) -> Means:
        """What the targets are measured with, and how accurately."""
        knowledge = self.registered
        uncertainty = knowledge if isinstance(knowledge, PoseUncertainty) else None
        own_edges = knowledge if isinstance(knowledge, OwnEdges) else None
        return Means(
            self.camera,
            uncertainty or self.pose_uncertainty,
            self.accuracy,
            self.localisation,
            surfaces_mm=self.surfaces_mm,
            own_edges=own_edges,
            edges=self.edges,
        )

    def known_at(
        self, cam2world: NDArray[np.float64], names: Sequence[str]
    ) -> PoseKnowledge | None:
        """Return what registration will tell of a pose; None without registration.

        Parameters
        ----------
        cam2world : array (4, 4)
            The pose.
        names : sequence of str
            The targets that are measured there.
        """
        if self.registered is None:
            return None
        if isinstance(self.registered, PoseUncertainty):
            return PoseKnowledge(self.registered.covariance)
        return knowledge_of(self.at_pose(cam2world, names).targets, self.means, cam2world)

    def restricted_to(self, names: Sequence[str]) -> Problem:
        """Return the same request for some of the entities."""
        by_name = dict(zip(self.names, self.targets, strict=True))
        return replace(self, names=tuple(names), targets=tuple(by_name[name] for name in names))

    @property
    def has_choice(self) -> bool:
        """Whether a target has several witnesses."""
        return any(len(target.witnesses) > 1 for target in self.targets)

    @cached_property
    def single(self) -> Problem:
        """The same request with each witness a target of its own; itself, where no target has several."""
        if not self.has_choice:
            return self
        targets = [
            target.choosing(k, witness_name(target, k))
            for target in self.targets
            for k in range(len(target.witnesses))
        ]
        return self._of_targets(targets, {})

    @cached_property
    def owner(self) -> NDArray[np.int_]:
        """Which target each of those is a witness of, as a column of the request; ascending, (w,)."""
        return np.repeat(
            np.arange(len(self.targets)), [len(target.witnesses) for target in self.targets]
        )

    @property
    def witnesses(self) -> Witnesses:
        """All witnesses with what is asked of them."""
        return Witnesses(self.single.constraints, self.single.objective, self.owner)

    @cached_property
    def first(self) -> Problem:
        """The same request with the first witness of each target."""
        return self.choosing(dict.fromkeys(self.names, 0))

    def choosing(self, chosen: Mapping[str, int], names: Sequence[str] | None = None) -> Problem:
        """Return the same request, for some of the targets, with one witness of each.

        Parameters
        ----------
        chosen : mapping of str to int
            The witness of each target that has several.
        names : sequence of str, optional
            The targets. Default: all.
        """
        problem = self if names is None else self.restricted_to(names)
        if not problem.has_choice:
            return problem
        choice = {t.name: chosen[t.name] for t in problem.targets if len(t.witnesses) > 1}
        targets = [target.choosing(choice.get(target.name, 0)) for target in problem.targets]
        return self._of_targets(targets, {**problem.chosen, **choice})

    def at_pose(self, cam2world: NDArray[np.float64], names: Sequence[str]) -> Problem:
        """Return the same request for some of the targets, each with the witness that a pose shows best.

        Which one that is depends on the pose and the target alone; see `best_witnesses`.

        Parameters
        ----------
        cam2world : array (4, 4)
            The pose.
        names : sequence of str
            The targets.
        """
        problem = self.restricted_to(names)
        if not problem.has_choice:
            return problem
        choice = self._witnesses_at.setdefault(np.asarray(cam2world).tobytes(), {})
        new = [t.name for t in problem.targets if len(t.witnesses) > 1 and t.name not in choice]
        if new:
            best = best_witnesses(self.restricted_to(new).witnesses, cam2world)
            choice.update(zip(new, best, strict=True))
        return self.choosing(choice, names)

    @cached_property
    def _witnesses_at(self) -> dict[bytes, dict[str, int]]:
        """The witnesses of targets at poses, as far as they were asked for."""
        return {}

    def _of_targets(self, targets: Sequence[Target], chosen: Mapping[str, int]) -> Problem:
        """Return the same request for other targets of the same entities."""
        space = TargetSpace.of(entity_space(self.space), targets)
        names = tuple(target.name for target in targets)
        return replace(self, space=space, names=names, targets=tuple(targets), chosen=chosen)

    def find_target(self, name: str) -> Target:
        """Return the target of this name."""
        return self.targets[self.names.index(name)]

    def described_at(self, cam2world: NDArray[np.float64], name: str) -> Prediction:
        """Return how accurately a pose measures a target, by the witness that it shows best.

        Parameters
        ----------
        cam2world : array (4, 4)
            The pose.
        name : str
            The target.
        """
        problem = self.at_pose(cam2world, [name])
        knowledge = self.known_at(cam2world, [name])
        means = self.means if knowledge is None else knowledge.of_target(self.means, name)
        return problem.measured[name].describe(cam2world, means)

    @cached_property
    def measured(self) -> dict[str, Target]:
        """What is measured, by name, with what plans and simulation need of the request."""
        return {target.name: target.measured_with(self.means) for target in self.targets}
