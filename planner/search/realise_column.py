"""One column's run of the genetic algorithm, as a task for any executor, and the reasons when it fails."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, pairwise
from typing import NamedTuple

import numpy as np

from ground.shared import Shared
from planner.camera.pose import pose_between
from planner.exceptions import InfeasibleError
from planner.executors import check_on_the_way
from planner.request.problem import Problem
from planner.request.registration import PoseKnowledge
from planner.search.columns import Judge, derive_seed, perturbed
from planner.search.evolution import Centring, centred, least_share
from planner.search.plan_setting import best_setting, missing_corners, setting_at, without
from planner.search.surer_poses import surer_pose
from planner.sensor_setting import Outcome, Reason, ReasonKind, SensorSetting
from planner.verify.joint_counts import (
    JOINT_POSES,
    JOINT_SURE_POSES,
    MOST_REQUIRED,
    DisplacedChecks,
    JointCounts,
    confidence_of_looks,
    looks_of,
    lower_bound,
    poses_needed,
    successes_needed,
)
from planner.verify.simulate_setting import MODEL_TOLERANCE, Posed, simulate_setting

# displaced poses simulated to check a pose
_TRIAL_POSES = 4000
# poses drawn near a contradicted one
_NEIGHBOURS = 2000
# neighbours evaluated at a time. Often simulation confirms one of the first.
_NEIGHBOUR_BATCH = 250
# largest number of simulated neighbours that inspect the same entities
_MOST_TRIALS = 100
# the same for all settings of a plan together. They share it equally.
ALL_TRIALS = 1000
# displaced poses simulated if the first ones contradict a probability. The standard error of the
# frequency is then at most 0.0025.
_SURE_POSES = 40_000
# displaced poses times measurements, at most, for all that a plan or a prediction states
_STATED_POSES = 400_000

# a shortfall is more than nothing
_LEAST = 1e-9

MEANING = {
    "visibility": ReasonKind.UNOBSERVABLE,
    "light": ReasonKind.NOT_SHOWN,
    "resolution_mm": ReasonKind.TOO_SHORT,
    "focus_mm": ReasonKind.OUT_OF_FOCUS,
    "field_of_view_px": ReasonKind.TOO_LARGE,
    "field_of_view_mm": ReasonKind.TOO_LARGE,
    "workspace_mm": ReasonKind.OUT_OF_REACH,
    "reach": ReasonKind.OUT_OF_REACH,
    "robot": ReasonKind.OUT_OF_REACH,
    "clearance_mm": ReasonKind.TOO_NEAR,
    "corner_deg": ReasonKind.NO_CORNER,
    "separation_px": ReasonKind.LINE_NEARBY,
}
"""What a failing constraint means to the person who reads the plan."""


def realise(
    shared: Shared, names: Sequence[str], seed: int, start: np.ndarray | None = None
) -> Outcome:
    """Look for a setting that inspects a set of entities: first by the sum of probabilities, then by the smallest.

    Parameters
    ----------
    shared : Shared of Judge
        Holds the request.
    names : tuple of str
        The column.
    seed : int
        Seed of the run.
    start : array (m, 4, 4), optional
        Poses to begin with, such as the candidate that promised the column.

    Returns
    -------
    Outcome
        The setting (it may miss the threshold for some entities), or the reason why there is none.
    """
    judge: Judge = shared.value
    if start is not None:
        return _realised(judge, judge.problem.at_pose(start[0], names), seed, start)
    # without a pose to go by, each witness of the target is tried until one serves
    outcome = Outcome()
    for k in range(max(len(judge.problem.find_target(name).witnesses) for name in names)):
        chosen = {
            name: min(k, len(judge.problem.find_target(name).witnesses) - 1) for name in names
        }
        tried = _realised(judge, judge.problem.choosing(chosen, names), seed, start)
        if outcome.setting is None or _least(tried) > _least(outcome):
            outcome = outcome if tried.setting is None and k else tried
        if _least(outcome) >= judge.problem.probability:
            break
    return outcome


def _least(outcome: Outcome) -> float:
    """Return the least probability that a run reached; below 0 if it found no setting."""
    return -1.0 if outcome.setting is None else min(outcome.setting.probability.values())


def _realised(judge: Judge, problem: Problem, seed: int, start: np.ndarray | None) -> Outcome:
    """Look for a setting that inspects all targets of a request, each by its only witness."""
    names = problem.names
    best = None
    for objective in ("sum", "min"):
        try:
            # only of a single entity it is told why it is not inspected
            search = replace(judge.effort.search, explain=len(names) == 1)
            setting = best_setting(problem, seed, objective=objective, search=search, start=start)
        except InfeasibleError as error:
            return Outcome(reason=Reason.of(meaning(error), error.why))
        if best is None or min(setting.probability.values()) > min(best.probability.values()):
            best = setting
        if min(best.probability.values()) >= problem.probability or len(names) == 1:
            break
    return Outcome(best)


def without_corners(judge: Judge) -> dict[str, Reason]:
    """Return the entities that no pose can inspect as they lack a corner that is asked for, and the reason."""
    return {
        name: Reason.of(meaning(error), error.why)
        for name, error in missing_corners(judge.problem.first.constraints).items()
    }


def meaning(error: InfeasibleError) -> ReasonKind:
    """Return what keeps entities from being inspected."""
    if error.together or not error.constraint:
        return ReasonKind.NO_FEASIBLE_VIEW
    if error.constraint == "visibility" and not error.proven:
        return ReasonKind.IN_VIEW_FROM_NO_POSE_TRIED
    return MEANING[error.constraint]


class Supported(NamedTuple):
    """A setting, and what simulation supports of it.

    Attributes
    ----------
    setting : SensorSetting
    entities : frozenset of str
        Those of its entities that simulation does not contradict, and that have the required P_all.
    """

    setting: SensorSetting
    entities: frozenset[str]


class _Tried(NamedTuple):
    """A pose that was simulated: by how much it promises too much, and what falls short, if that was asked."""

    pose: SensorSetting | PosedOnly
    excess: dict[str, float]
    short: dict[str, float] | None

    def supported(self, judge: Judge, seed: int) -> frozenset[str]:
        """Return the entities that simulation supports."""
        entities = tuple(
            name for name, too_much in self.excess.items() if too_much <= MODEL_TOLERANCE
        )
        short = self.short
        if short is None and entities:
            short = shortfalls(judge, self.pose.cam2world, entities, seed)
        return frozenset(entities) - frozenset(short or ())


def best_supported(
    judge: Judge, options: Sequence[SensorSetting], seed: int, settings: int = 1
) -> Supported:
    """Return the first setting that simulation does not contradict, or a pose near the first that it supports.

    The probability is of second order in the displacement and does not count ends that leave the image, so a pose may
    succeed less often. If all are contradicted, the least contradicted is returned.

    Parameters
    ----------
    judge : Judge
    options : sequence of SensorSetting
        For the same entities, the best first.
    seed : int
        Of the poses tried and displaced.
    settings : int
        How many settings share the trials that a plan may make.
    """
    rng = np.random.default_rng([seed, _TRIAL_POSES])
    best: _Tried | None = None
    lowest = np.inf
    poses: Iterable[SensorSetting | PosedOnly] = chain(
        options,
        _surer(judge, options[0], seed),
        _near(judge, options[0], rng, _trials_of(settings)),
    )
    for pose in poses:
        tried = _Tried(pose, _excess(judge, pose, rng), None)
        too_much = max(tried.excess.values())
        if too_much <= MODEL_TOLERANCE:
            short = _shortfalls_below(judge, pose, seed, lowest - MODEL_TOLERANCE)
            tried = tried._replace(short=short)
            too_much = max([too_much, *(MODEL_TOLERANCE + miss for miss in short.values())])
        if best is None or too_much < lowest:
            best = tried
            lowest = too_much
        if lowest <= MODEL_TOLERANCE:
            break
    assert best is not None
    supported = best.supported(judge, seed)
    if isinstance(best.pose, SensorSetting):
        return Supported(best.pose, supported)
    message = "pose near the best, supported by simulation"
    pose_found = best.pose
    return Supported(
        setting_at(
            judge.problem, pose_found.cam2world, pose_found.entities, message, seed=options[0].seed
        ),
        supported,
    )


def supported_pose(
    shared: Shared, options: Sequence[SensorSetting], seed: int, settings: int
) -> Supported:
    """Return what `best_supported` returns, as a task for any executor; ``shared`` holds the judge."""
    return best_supported(shared.value, options, seed, settings)


def without_contradicted(problem: Problem, settings: Sequence[Supported]) -> list[SensorSetting]:
    """Take from settings the entities that simulation contradicts there and supports in another one.

    Parameters
    ----------
    problem : Problem
    settings : sequence of Supported
    """
    result = []
    for k, (setting, supported) in enumerate(settings):
        others = (*settings[:k], *settings[k + 1 :])
        elsewhere = frozenset().union(*(other.entities for other in others))
        needless = [n for n in setting.entities if n in elsewhere and n not in supported]
        result.append(without(problem, setting, needless) if needless else setting)
    return result


def promised_too_much(judge: Judge, setting: Posed, seed: int) -> dict[str, float]:
    """Return the entities that simulation contradicts in a setting, and by how much they promise too much."""
    excess = _excess(judge, setting, np.random.default_rng([seed, _TRIAL_POSES]))
    suspected = tuple(name for name, too_much in excess.items() if too_much > MODEL_TOLERANCE)
    if not suspected:
        return {}
    posed = PosedOnly(
        setting.cam2world, suspected, {name: setting.probability[name] for name in suspected}
    )
    rng = np.random.default_rng([seed, _SURE_POSES])
    excess = _excess(judge, posed, rng, _SURE_POSES)
    return {name: too_much for name, too_much in excess.items() if too_much > MODEL_TOLERANCE}


def joint_counts(
    judge: Judge,
    cam2world: np.ndarray,
    names: Sequence[str],
    seed: int,
    at_least: int = 0,
    needed: float = 0.0,
) -> JointCounts:
    """Count over displaced poses how often all that is asked of targets holds at a pose.

    Parameters
    ----------
    judge : Judge
        Has the request.
    cam2world : array (4, 4)
        The pose.
    names : sequence of str
        The targets. What is counted for one depends on no other.
    seed : int
        Of the displaced poses.
    at_least : int
        Displaced poses at least.
    needed : float
        The count ends as soon as the bound of a target cannot become this large any more, and states too much then.
    """
    checks = DisplacedChecks(judge.problem.at_pose(cam2world, names), names)
    n = poses_needed(judge.threshold, max(at_least, JOINT_POSES))
    return checks.count(cam2world, n, seed, successes_needed(needed, n))


def poses_stated(measurements: int) -> int:
    """Return over how many displaced poses each stated P_all is counted; fewer for thousands of measurements.

    Parameters
    ----------
    measurements : int
        How many are stated together.
    """
    return min(JOINT_SURE_POSES, max(_STATED_POSES // max(measurements, 1), JOINT_POSES))


def joint_bounds(
    judge: Judge,
    cam2world: np.ndarray,
    names: Sequence[str],
    seed: int,
    needed: float = 0.0,
) -> dict[str, tuple[float, int]]:
    """Return a lower bound of the P_all of each target at a pose, and over how many displaced poses it was counted.

    Where the first displaced poses do not decide whether a target has the required probability, more are drawn and
    counted together with them. That any look at the count decides wrongly is as improbable as it is of a single one
    (Bonferroni).

    Parameters
    ----------
    judge, cam2world, names, seed
        As `joint_counts` takes them.
    needed : float
        As soon as one bound is surely below this, others may state too much.
    """
    bounds: dict[str, tuple[float, int]] = {}
    hits = dict.fromkeys(names, 0)
    looks = looks_of(judge.threshold)
    confidence = confidence_of_looks(len(looks))
    undecided = tuple(names)
    for before, n in pairwise([0, *looks]):
        # a count that ends early states too much of others, so another look must not follow it
        required = successes_needed(needed, n, confidence) if n == looks[-1] else 0
        missing_hits = max(required - min(hits[name] for name in undecided), 0)
        checks = DisplacedChecks(judge.problem.at_pose(cam2world, undecided), undecided)
        counts = checks.count(cam2world, n - before, derive_seed(seed, [str(n)]), missing_hits)
        for name, more in zip(counts.names, counts.successes, strict=True):
            hits[name] += more
            bounds[name] = (lower_bound(hits[name], n, confidence), n)
        undecided = tuple(
            name
            for name in undecided
            if hits[name] >= judge.threshold * n and not keeps(judge, bounds[name][0])
        )
        decided = [lower for name, (lower, _) in bounds.items() if name not in undecided]
        if not undecided or min(decided, default=1.0) < needed:
            break
    return bounds


def _shortfalls_below(judge: Judge, pose: Posed, seed: int, most: float) -> dict[str, float]:
    """Return the `shortfalls` of a pose; if one of them is ``most`` or more, others may be too small."""
    # a rounding error less than what cannot be below
    needed = min(judge.threshold - most - _LEAST, MOST_REQUIRED)
    return missing(judge, joint_bounds(judge, pose.cam2world, pose.entities, seed, needed))


def shortfalls(
    judge: Judge, cam2world: np.ndarray, names: Sequence[str], seed: int
) -> dict[str, float]:
    """Return the targets that do not surely have the required P_all at a pose, and by how much they miss it.

    Parameters
    ----------
    judge, cam2world, names, seed
        As `joint_counts` takes them.
    """
    bounds = joint_bounds(judge, cam2world, names, seed)
    return missing(judge, bounds)


def missing(judge: Judge, bounds: Mapping[str, tuple[float, int]]) -> dict[str, float]:
    """Return the targets whose bounds of P_all are below what is required, and by how much; see `joint_bounds`."""
    return {
        name: max(judge.threshold - lower, _LEAST)
        for name, (lower, _) in bounds.items()
        if not keeps(judge, lower)
    }


def keeps(judge: Judge, lower: float) -> bool:
    """Tell whether a lower bound of P_all is what is required, `MOST_REQUIRED` at most."""
    return lower >= min(judge.threshold, MOST_REQUIRED)


class PosedOnly(NamedTuple):
    """What simulation asks of a setting; to state a pose's margins, too, takes longer than to simulate it."""

    cam2world: np.ndarray
    entities: tuple[str, ...]
    probability: dict[str, float]
    registered: PoseKnowledge | None = None


def _excess(
    judge: Judge, setting: Posed, rng: np.random.Generator, n: int | None = None
) -> dict[str, float]:
    """Simulate a setting; return by how much it promises too much for each entity."""
    names = tuple(setting.entities)
    registered = judge.problem.known_at(setting.cam2world, names)
    rates = simulate_setting(
        PosedOnly(setting.cam2world, names, dict(setting.probability), registered),
        judge.problem.at_pose(setting.cam2world, setting.entities).measured,
        judge.camera,
        judge.problem.pose_uncertainty,
        accuracy=judge.accuracy,
        n=_TRIAL_POSES if n is None else n,
        rng=rng,
    )
    return {name: rate.predicted - rate.frequency for name, rate in rates.items()}


def _trials_of(settings: int) -> int:
    """Return how many neighbours each of so many settings may simulate, one at least."""
    return min(_MOST_TRIALS, max(ALL_TRIALS // max(settings, 1), 1))


def _surer(judge: Judge, setting: SensorSetting, seed: int) -> Iterator[PosedOnly]:
    """Yield the pose near a setting of which counts show more, if there is one."""
    pose = surer_pose(judge, setting.cam2world, setting.probability, seed)
    if pose is not None:
        yield _posed(judge, pose, setting.entities, judge(pose[None]).probability[0])


def _posed(
    judge: Judge, cam2world: np.ndarray, names: tuple[str, ...], probability: np.ndarray
) -> PosedOnly:
    """Return a pose for some targets, of a judgement of all of them (k,)."""
    stated = dict(zip(judge.names, probability.tolist(), strict=True))
    return PosedOnly(cam2world, names, {name: stated[name] for name in names})


def _near(
    judge: Judge, setting: SensorSetting, rng: np.random.Generator, most: int
) -> Iterator[PosedOnly]:
    """Yield poses near a setting that inspect the same entities, so many at most."""
    poses = perturbed(
        np.repeat(setting.cam2world[None], _NEIGHBOURS, axis=0),
        judge.camera.focus_distance_mm,
        rng,
    )
    is_wanted = np.isin(judge.names, setting.entities)
    tried = 0
    # worth more than 1 is only what nearly inspects all of them: no more is looked at of the others
    prices = is_wanted / (is_wanted.sum() - 0.5)
    for first in range(0, len(poses), _NEIGHBOUR_BATCH):
        neighbours = poses[first : first + _NEIGHBOUR_BATCH]
        judged = judge(neighbours, prices)
        for k in np.flatnonzero(judged.inspects[:, is_wanted].all(axis=1))[: most - tried]:
            tried += 1
            yield _posed(judge, neighbours[k], setting.entities, judged.probability[k])


# What simulation finds of what poses promise: each promise is simulated once, in any process.


class SimulatedPromise(NamedTuple):
    """What a simulation of a pose found.

    Attributes
    ----------
    excess : dict of str to float
        By how much simulation contradicts what is stated of an entity, or P_all falls short; 0 if neither.
    bounds : dict of str to (float, int)
        Lower bound of P_all, and over how many displaced poses, of entities that are not contradicted.
    """

    excess: dict[str, float]
    bounds: dict[str, tuple[float, int]]


def simulate_promises(
    shared: Shared, cam2world: np.ndarray, stated: Mapping[str, float], seed: int
) -> SimulatedPromise:
    """Simulate what is stated of entities at a pose, as a task for any executor.

    What comes out for an entity depends on nothing that is stated of others.

    Parameters
    ----------
    shared : Shared of Judge
        Holds the request.
    cam2world : array (4, 4)
        The pose.
    stated : mapping of str to float
        Probabilities by entity.
    seed : int
        Of the displaced poses.
    """
    judge: Judge = shared.value
    # edges see the same displaced poses, whichever they are; a dimension is displaced by draws of its own
    composed = [name for name in stated if not judge.problem.find_target(name).in_image]
    excess = dict.fromkeys(stated, 0.0)
    for names in (
        tuple(name for name in stated if name not in composed),
        *((name,) for name in composed),
    ):
        if names:
            # of hundreds of dimensions, all of them take long
            check_on_the_way()
            posed = PosedOnly(cam2world, names, {name: stated[name] for name in names})
            excess.update(promised_too_much(judge, posed, seed))
    upheld = tuple(name for name in stated if excess[name] <= 0.0)
    bounds = joint_bounds(judge, cam2world, upheld, seed) if upheld else {}
    return SimulatedPromise({**excess, **missing(judge, bounds)}, bounds)


class Promises:
    """What is known of the promises of poses so far.

    Parameters
    ----------
    shared : Shared of Judge
        Holds the request.
    seed : int
        Of the displaced poses.
    """

    def __init__(self, shared: Shared, seed: int):
        self._shared = shared
        self._seed = seed
        self._excess: dict[tuple[bytes, str, float], float] = {}
        self._bounds: dict[tuple[bytes, str], tuple[float, int]] = {}

    def task(self, setting: SensorSetting) -> tuple[Shared, np.ndarray, dict[str, float], int]:
        """Return the arguments of `simulate_promises` for what a setting states and was not simulated."""
        pose = setting.cam2world.tobytes()
        stated = {name: setting.probability[name] for name in setting.entities}
        new = {n: p for n, p in stated.items() if (pose, n, p) not in self._excess}
        return self._shared, setting.cam2world, new, self._seed

    def take(self, setting: SensorSetting, found: SimulatedPromise) -> None:
        """Remember what was found of what a setting states."""
        pose = setting.cam2world.tobytes()
        for name, excess in found.excess.items():
            self._excess[pose, name, setting.probability[name]] = excess
        self._bounds.update({(pose, name): bound for name, bound in found.bounds.items()})

    def contradicted_in(self, setting: SensorSetting) -> dict[str, float]:
        """Return the entities of a setting that simulation contradicts or that lack P_all, and by how much."""
        task = self.task(setting)
        if task[2]:
            self.take(setting, simulate_promises(*task))
        pose = setting.cam2world.tobytes()
        excess = {n: self._excess[pose, n, setting.probability[n]] for n in setting.entities}
        return {name: too_much for name, too_much in excess.items() if too_much > 0.0}

    def bound(self, cam2world: np.ndarray, name: str) -> float:
        """Return the bound of P_all that was counted for an entity at a pose (4, 4); 0 without one."""
        p_all, _ = self._bounds.get((cam2world.tobytes(), name), (0.0, 0))
        return p_all

    def with_bounds(self, setting: SensorSetting) -> SensorSetting:
        """Return a setting that states the P_all that was counted for its entities."""
        pose = setting.cam2world.tobytes()
        if not all((pose, name) in self._bounds for name in setting.entities):
            return setting
        bounds = {name: self._bounds[pose, name] for name in setting.entities}
        stated = {
            name: min(lower, setting.probability[name]) for name, (lower, _) in bounds.items()
        }
        # what is missed by one at least is missed by no more than all of them miss
        together = max(1.0 - sum(1.0 - p for p in stated.values()), 0.0)
        poses = min((n for _, n in bounds.values()), default=0)
        return replace(setting, p_all=stated, p_all_together=together, p_all_poses=poses)


# The margin step for one setting, as a task for any executor, and what the moved pose promises.


_MOVED = "moved off its limits"
# displaced poses in which a moved pose may not do worse, and those displaced twice as far
_NEAR_POSES = 1000
_FAR_POSES = 400
_FAR_SIGMAS = 2.0
_WORSE = 0.01
# of the way to a pose that loses, one after the other
_PARTS = (0.5, 0.25, 0.125)


def centre_setting(
    shared: Shared,
    setting: SensorSetting,
    seed: int,
    poses: int,
    centring: Centring,
    settings: int = 1,
    until: float = math.inf,
) -> SensorSetting:
    """Move a setting off its limits, and count what it promises.

    Parameters
    ----------
    shared : Shared of Judge
        Holds the request.
    setting : SensorSetting
        A setting that simulation supports.
    seed : int
        Of the search, and of the displaced poses.
    poses : int
        Displaced poses to count over, at least.
    centring : Centring
        How long to search.
    settings : int
        How many settings share the trials that a plan may make.
    until : float
        When the search ends, as `time.time` counts: a setting whose turn comes later stays where it is, and is counted
        only if it was not.

    Returns
    -------
    SensorSetting
        For the same targets, with their P_all.
    """
    judge: Judge = shared.value
    late = time.time() > until
    if late and is_counted(setting):
        return setting
    before = setting
    loses = _Losses(judge, setting, seed, centring.give_up)
    for pose in () if late else _off_limits(judge, setting, seed, centring):
        if time.time() > until:
            break
        if not _inspects(judge, pose, setting.entities):
            continue
        moved = setting_at(judge.problem, pose, setting.entities, _MOVED, seed=setting.seed)
        if loses(moved):
            continue
        if time.time() <= until:
            setting = best_supported(judge, [moved, setting], seed, settings).setting
        break
    if until < math.inf and setting is before and is_counted(setting):
        return setting
    return with_p_all(judge, setting, seed, poses)


def is_counted(setting: SensorSetting) -> bool:
    """Return whether a setting states the P_all of all its targets."""
    return set(setting.entities) <= set(setting.p_all)


def _off_limits(
    judge: Judge, setting: SensorSetting, seed: int, centring: Centring
) -> Iterator[np.ndarray]:
    """Yield poses with a larger least share: a line may come into view beyond a cliff.

    The first is the best one of a search. Where it loses something, poses on the way to it follow, and at last the best
    one nearby: a second search of full length would take as long as the first, and mostly lose the same.
    """
    problem = judge.problem.at_pose(setting.cam2world, setting.entities)
    start = setting.cam2world
    best = centred(problem, start, centring, seed)
    if (best == start).all():
        return
    yield best
    before = least_share(problem, start)
    for part in _PARTS if before is not None else ():
        between = pose_between(start, best, part)
        after = least_share(problem, between)
        if before is not None and after is not None and after.share > before.share:
            yield between
    near = centred(problem, start, centring._replace(steps=centring.steps[-1:]), seed)
    if (near != start).any():
        yield near


def with_p_all(judge: Judge, setting: SensorSetting, seed: int, poses: int) -> SensorSetting:
    """Return a setting with the P_all of its targets, counted over so many displaced poses at least."""
    if not setting.entities:
        return setting
    counts = joint_counts(judge, setting.cam2world, setting.entities, seed, poses)
    if poses < JOINT_SURE_POSES and not all(keeps(judge, lower) for lower in counts.lower.values()):
        counts = joint_counts(judge, setting.cam2world, setting.entities, seed, JOINT_SURE_POSES)
    # no more is promised than the model says of the error alone
    stated = {name: min(counts.lower[name], setting.probability[name]) for name in counts.names}
    together = min(counts.lower_together, *stated.values())
    return replace(setting, p_all=stated, p_all_together=together, p_all_poses=counts.n)


def _inspects(judge: Judge, pose: np.ndarray, names: Sequence[str]) -> bool:
    judged = judge(pose[None]).inspects[0]
    return bool(judged[np.isin(judge.names, names)].all())


class _Losses:
    """Tells whether a target is measured less often from a moved pose: by more than is given up, or far away.

    Both poses are displaced by the same draws.

    Parameters
    ----------
    judge : Judge
        Holds the request.
    before : SensorSetting
        The setting as it was.
    seed : int
        Of the displaced poses.
    give_up : float
        Share of them that may be lost.
    """

    def __init__(self, judge: Judge, before: SensorSetting, seed: int, give_up: float):
        self._judge = judge
        self._before = before
        self._seed = seed
        self._counts = ((1.0, _NEAR_POSES, give_up), (_FAR_SIGMAS, _FAR_POSES, _WORSE))
        self._known: dict[float, np.ndarray] = {}

    def __call__(self, after: SensorSetting) -> bool:
        for sigmas, poses, lost in self._counts:
            if sigmas not in self._known:
                self._known[sigmas] = self._times_measured(self._before, sigmas, poses)
            now = self._times_measured(after, sigmas, poses)
            if (self._known[sigmas] - now > lost * poses + 1).any():
                return True
        return False

    def _times_measured(self, setting: SensorSetting, sigmas: float, poses: int) -> np.ndarray:
        """Return in how many poses, displaced so many times as far, each target of a setting is measured (k,)."""
        problem = self._judge.problem
        wide = type(problem.pose_uncertainty)(sigmas**2 * problem.pose_uncertainty.covariance)
        request_here = problem.at_pose(setting.cam2world, setting.entities)
        checks = DisplacedChecks(replace(request_here, pose_uncertainty=wide), setting.entities)
        return np.array(checks.count(setting.cam2world, poses, self._seed).successes)
