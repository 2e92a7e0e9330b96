"""The stages of a plan, in order.

Each stage adds to the state: columns, what excludes each other, a bound, settings. The state is kept when a stage ends,
and within the long ones. A planning that is resumed goes on with the stage that its state names.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ground.shared import Shared
from planner.bound.lower_bound import (
    ProvenBound,
    exclusion_proof,
    exclusive_entities,
    lower_bound,
    of_all,
)
from planner.cover import few_columns, sets_to_realise
from planner.executors import in_order
from planner.light.lighting import Lighting
from planner.plan import InspectionPlan
from planner.progress import report
from planner.request.problem import Problem
from planner.request.split import ends_apart
from planner.request.targets import PlannedDimension
from planner.search.columns import (
    ColumnPool,
    Judge,
    Pools,
    WarmStart,
    derive_seed,
    judged_poses,
    price_poses,
)
from planner.search.counted_columns import CountedColumns, already_there, chosen_settings
from planner.search.evolution import Centring
from planner.search.incumbents import (
    REFUTING_SHARE,
    SO_FAR,
    Incumbents,
    Needed,
    PlanState,
    SearchRun,
    as_simulated,
    assembled,
    candidate_settings,
    empty_pools,
    in_order_of_arm,
    may_split,
)
from planner.search.lit_poses import never_lit, with_lamps
from planner.search.plan_setting import setting_at, without
from planner.search.realise_column import (
    ALL_TRIALS,
    centre_setting,
    is_counted,
    joint_bounds,
    keeps,
    poses_stated,
    with_p_all,
    without_corners,
)
from planner.sensor_setting import Outcome, Reason, ReasonKind, SensorSetting
from planner.verify.joint_counts import JOINT_POSES, MOST_REQUIRED

if TYPE_CHECKING:
    pass

# Last step: the final cover is chosen, and every setting in it gets the best pose that simulation
# supports.
#
# That pose is moved off its limits, and what it promises is counted.


# for a target that lacks the required P_all in the final settings: poses of other columns that
# are simulated for it
_RETRIED = 8

# Another try for targets that lack the required P_all in the final settings, before they are
# given up.
#
# In this order, and only as long as some are left:
#
# 1. The poses of the other settings: one of them may measure the target as well. 2. The poses of
# other columns that contain it, as simulation supports them. 3. A setting of its own, searched
# for it alone.
#
# Poses that were added are moved off their limits like all others. What is still short then is
# lost; the largest P_all that was found on the way is what its reason states.


Centre = Callable[[list[SensorSetting]], list[SensorSetting]]


class ShortTargets:
    """Targets that lack the required P_all, and where they may have it.

    Parameters
    ----------
    run : SearchRun
        Its request says what is asked, its pool has other columns.
    settings : sequence of SensorSetting
        The others, which have it.
    reached : dict of str to float
        The largest P_all found of each target that lacks it.
    centre : callable
        Moves settings off their limits, and counts their P_all.

    Attributes
    ----------
    settings : list of SensorSetting
        Those given, and the ones that were added.
    reached : dict of str to float
        The largest P_all found of each target that still lacks it.
    """

    def __init__(
        self,
        run: SearchRun,
        settings: Sequence[SensorSetting],
        reached: dict[str, float],
        centre: Centre,
    ):
        self._run = run
        self._centre = centre
        self.settings = list(settings)
        self.reached = dict(reached)

    def retry(self) -> None:
        """Try all that there is, until no target is left."""
        self.join_settings()
        for propose in (self._other_columns, self._own_settings):
            proposed = propose() if self.reached else []
            if proposed:
                self._add(self._centre(proposed))

    def join_settings(self) -> None:
        """Let settings that are there measure the targets, where they can."""
        judge = self._run.judge
        for name in list(self.reached):
            self._run.callbacks.deadline.check()
            column = judge.names.index(name)
            bounds = {}
            for k, setting in enumerate(self.settings):
                if judge(setting.cam2world[None]).inspects[0, column]:
                    bounds_here = joint_bounds(judge, setting.cam2world, (name,), self._run.seed)
                    bounds[k] = bounds_here[name][0]
            if not bounds:
                continue
            best = max(bounds, key=lambda k: bounds[k])
            self._reach(name, bounds[best])
            if keeps(judge, bounds[best]):
                self._join(best, name)

    def _join(self, k: int, name: str) -> None:
        run = self._run
        setting = self.settings[k]
        names = (*setting.entities, name)
        joined = setting_at(
            run.problem, setting.cam2world, names, setting.message, setting.seed, setting.nfev
        )
        poses = max(setting.p_all_poses, JOINT_POSES)
        joined = with_p_all(run.judge, joined, run.seed, poses)
        # by other draws the one or the other may be short
        if all(keeps(run.judge, p) for p in joined.p_all.values()):
            self.settings[k] = joined
            del self.reached[name]

    def _other_columns(self) -> list[SensorSetting]:
        """Return poses of other columns that simulation supports for some of the targets."""
        run = self._run
        short = np.isin(run.names, list(self.reached))
        columns = run.pool.membership & short
        rows = np.flatnonzero(columns.any(axis=1))
        worth = columns[rows].sum(axis=1) + run.pool.quality[rows] / 2.0
        rows = rows[np.argsort(-worth, kind="stable")]
        unserved = short.copy()
        tried = np.zeros(len(run.names), dtype=int)
        proposed = []
        for c in rows.tolist():
            served = columns[c] & unserved & (tried < _RETRIED)
            if not served.any():
                continue
            tried += served
            run.callbacks.deadline.check()
            (candidate,) = candidate_settings(run, run.pool, [c])
            others = [n for n in candidate.entities if n not in run.names_of(served)]
            for setting in as_simulated(run, [without(run.problem, candidate, others)]):
                unserved &= ~np.isin(run.names, setting.entities)
                proposed.append(setting)
            for name in run.names_of(served):
                self._reach(name, run.promises.bound(candidate.cam2world, name))
        return proposed

    def _own_settings(self) -> list[SensorSetting]:
        """Return the best poses that a search for each of the targets alone finds."""
        run = self._run
        sets = [(name,) for name in self.reached]
        realised = [outcome.setting for outcome in run.realise(sets)]
        supported = run.supported([[outcome] for outcome in realised if outcome is not None])
        return [outcome.setting for outcome in supported]

    def _add(self, settings: Sequence[SensorSetting]) -> None:
        """Take the settings in, for the targets that have the required P_all there and were short."""
        for setting in settings:
            for name, p in setting.p_all.items():
                self._reach(name, p)
            useless = [
                name
                for name in setting.entities
                if name not in self.reached or not keeps(self._run.judge, setting.p_all[name])
            ]
            added = without(self._run.problem, setting, useless) if useless else setting
            if added.entities:
                self.settings.append(added)
            for name in added.entities:
                del self.reached[name]

    def _reach(self, name: str, p_all: float) -> None:
        if name in self.reached:
            self.reached[name] = max(self.reached[name], p_all)


Proven = Callable[[SearchRun, Sequence[SensorSetting]], Needed]


class Settled(NamedTuple):
    """The settings of the final cover.

    Attributes
    ----------
    settings : list of SensorSetting
        With what they promise.
    lost : dict of str to Reason
        Targets of the cover that have the required P_all in none of them.
    """

    settings: list[SensorSetting]
    lost: dict[str, Reason]


def settle(
    run: SearchRun,
    inspected: np.ndarray,
    counted: ColumnPool,
    *,
    moves: bool = True,
    ready: Sequence[SensorSetting] = (),
) -> Settled:
    """Choose the final cover and give every column in it the best pose that simulation supports.

    Parameters
    ----------
    run : SearchRun
        Its request says what is asked.
    inspected : array of bool (k,)
        Entities that are to be covered. Those that no counted column contains get settings of their own, where such
        are found.
    counted : ColumnPool
        Columns of which every target has the required P_all; see `CountedColumns`.
    moves : bool
        Whether the poses are moved off their limits.
    ready : sequence of SensorSetting
        Settings of another plan, off their limits already. Where one of them serves for a column, it stays where it
        is, and that column is searched no more.
    """
    there, settings = already_there(run, chosen_settings(run, counted, inspected), ready)
    centring = Centring.of(run.effort)
    if not moves:
        centring = centring._replace(give_up=0.0)

    def centre(some: Sequence[SensorSetting]) -> list[SensorSetting]:
        return centre_all(run, some, centring)

    missing = run.names_of(inspected & ~counted.inspected)
    settled = _without_short(run, [*there, *centre(settings)], centre, missing)
    return settled._replace(settings=without_spare(run, settled.settings, centre))


def without_spare(
    run: SearchRun, settings: Sequence[SensorSetting], centre: Centre
) -> list[SensorSetting]:
    """Return settings without those whose targets the others measure, too, from where their poses are now.

    The columns that the cover was chosen from are of other poses: a search for better ones, and the moves off their
    limits, may bring more targets into a setting. They join it only if they have the required P_all there.

    Parameters
    ----------
    run : SearchRun
        Its request says what is asked.
    settings : sequence of SensorSetting
        Those of fewest targets are tried first.
    centre : callable
        Moves settings off their limits; none is moved here.
    """
    if not settings:
        return []
    inspects = run.judge(np.array([setting.cam2world for setting in settings])).inspects
    by_index = dict(enumerate(settings))
    for k in sorted(by_index, key=lambda index: len(settings[index].entities)):
        others = [index for index in by_index if index != k]
        names_elsewhere = {name for index in others for name in by_index[index].entities}
        names = [name for name in by_index[k].entities if name not in names_elsewhere]
        if not others or not inspects[others][:, np.isin(run.names, names)].any(axis=0).all():
            continue
        tried = ShortTargets(run, [by_index[i] for i in others], dict.fromkeys(names, 0.0), centre)
        tried.join_settings()
        if not tried.reached:
            by_index = dict(zip(others, tried.settings, strict=True))
    return list(by_index.values())


def settle_early(run: SearchRun, plan: InspectionPlan, proven: Proven) -> InspectionPlan:
    """Return a plan that a time limit ended with its settings moved off their limits, and what they promise.

    Parameters
    ----------
    run : SearchRun
        Its request says what is asked.
    plan : InspectionPlan
        The best plan so far.
    proven : callable
        ``proven(run, settings)`` returns the bounds for what settings inspect.
    """
    moved = centre_all(
        run,
        plan.settings,
        Centring.of(run.effort).shorter(),
        until=run.callbacks.deadline.of_settling(),
    )
    settled = _without_short(run, moved)
    settings = settled.settings
    if run.problem.requirements.cell is not None:
        settings = in_order_of_arm(run.problem, settings, unfinished=True)
    ended = replace(
        plan,
        settings=tuple(settings),
        uninspectable={**plan.uninspectable, **settled.lost},
    )
    return proven(run, settings).stated_in(ended)


def _without_short(
    run: SearchRun,
    settings: Sequence[SensorSetting],
    centre: Centre | None = None,
    others: Sequence[str] = (),
) -> Settled:
    """Take from settings the targets that lack the required P_all there; return why some are in none any more.

    Where it is said how settings are moved off their limits, these are tried again before they are given up, and so are
    others that no setting contains.
    """
    threshold = min(run.problem.probability, MOST_REQUIRED)
    short = [{n for n, p in setting.p_all.items() if p < threshold} for setting in settings]
    fewer = [
        without(run.problem, setting, sorted(missing)) if missing else setting
        for setting, missing in zip(settings, short, strict=True)
    ]
    entities = {name for setting in fewer for name in setting.entities}
    reached = dict.fromkeys(others, 0.0)
    for setting, missing in zip(settings, short, strict=True):
        for name in missing - entities:
            reached[name] = max(setting.p_all[name], reached.get(name, 0.0))
    fewer = [setting for setting in fewer if setting.entities]
    if reached and centre is not None:
        tried = ShortTargets(run, fewer, reached, centre)
        tried.retry()
        fewer = tried.settings
        reached = tried.reached
    lost = {
        name: Reason.of(
            ReasonKind.PROBABILITY_TOO_LOW,
            f"the best pose found reaches P_all = {best:.4f}, below the required "
            f"{run.request.probability:g}.",
        )
        for name, best in reached.items()
    }
    return Settled(fewer, lost)


def centre_all(
    run: SearchRun,
    settings: Sequence[SensorSetting],
    centring: Centring,
    *,
    until: float | None = None,
) -> list[SensorSetting]:
    """Move settings off their limits, and count what they promise.

    Parameters
    ----------
    run : SearchRun
        Its request says what is asked.
    settings : sequence of SensorSetting
        Settings that simulation supports.
    centring : Centring
        How long to search.
    until : float, optional
        The time limit has passed, which is not asked again. Fewer poses are displaced, and from this time on, as
        `time.time` counts, poses are not moved.

    Returns
    -------
    list of SensorSetting
        In the same order, for the same targets.
    """
    poses = JOINT_POSES
    early = until is not None
    if until is not None and time.time() >= until and all(map(is_counted, settings)):
        # whoever would do it may still be at work
        return list(settings)
    if not early:
        poses = poses_stated(sum(len(setting_of.entities) for setting_of in settings))
    tasks = [
        (
            run.shared,
            setting,
            derive_seed(run.seed, setting.entities),
            poses,
            centring,
            # a pose that needs a neighbour is left as it is
            ALL_TRIALS if early else len(settings),
            math.inf if until is None else until,
        )
        for setting in settings
    ]
    check = (lambda: None) if early else run.callbacks.check
    moved = []
    for setting in in_order(run.executor, centre_setting, tasks, check):
        moved.append(setting)
        # where the time is up already, it is not asked again
        report(run.callbacks.progress, len(moved), len(settings), "widening margins")
    return moved


# Columns: the pools are filled from viewpoints of every entity, then improved where the cover
# would profit.


# rounds of column generation between two searches
_ROUNDS_PER_SEARCH = 5
# smallest number of rounds of column generation from poses that the proof found
_JOINING_ROUNDS = 5
# largest number of these rounds, for few columns
_MOST_JOINING_ROUNDS = 25
# these rounds times columns is about this, because a round over many columns takes longer
_ROUNDS_TIMES_COLUMNS = 20_000
# entities without a view are tried so many at a time: whole numbers of what several processes take at once
_AT_A_TIME = 16
# rounds of column generation before that: they come across views of many, and a round costs less than trying one
_FIRST_ROUNDS = 10


def sample_poses(run: SearchRun, incumbents: Incumbents) -> None:
    """Fill the pools from viewpoints of every entity, but for those that the state has."""
    done = run.state.entries.get("sampled", 0)
    names = [name for name in run.names if name not in run.state.uninspectable]
    arguments = [(run.shared, name, run.effort.viewpoints, run.seed) for name in names[done:]]
    check = run.callbacks.check
    results = in_order(run.executor, judged_poses, arguments, check)
    for k, (poses, judged) in enumerate(results, done + 1):
        run.pools.add(poses, judged, run.judge.steady)
        run.save({"sampled": k})
        incumbents.offer_on_the_way(run)
        run.callbacks.report(k, len(names), "candidate poses")


def realise_missing_alone(run: SearchRun, incumbents: Incumbents) -> dict[str, Reason]:
    """Give entities that no pose inspects a run of their own; return the reasons of those that fail.

    What some of them add to the plan is offered before the others are tried, as each takes seconds. Those that no lamp
    lights are not tried.
    """
    state = run.state.uninspectable
    reasons = {name: state[name] for name in state if state[name].kind is ReasonKind.NOT_SHOWN}
    missing = [
        name
        for i, name in enumerate(run.names)
        if name not in reasons and not run.pool.membership[:, i].any()
    ]
    n_unlit = len(reasons)
    for first in range(0, len(missing), _AT_A_TIME):
        batch = missing[first : first + _AT_A_TIME]
        for name, outcome in zip(batch, run.realise([(name,) for name in batch]), strict=True):
            if name not in run.accept(outcome):
                reasons[name] = _reason(run.problem, outcome, name)
        if len(reasons) - n_unlit < first + len(batch):
            incumbents.offer(run)
    return reasons


def _reason(problem: Problem, outcome: Outcome, name: str) -> Reason:
    """Return why a target is not inspected, given the outcome of its own run, and what would help."""
    target = problem.measured[name]
    if outcome.setting is None or name not in outcome.setting.entities:
        return outcome.reason_at(problem.probability, target.remedy)
    budget = problem.described_at(outcome.setting.cam2world, name).budget
    is_limited = isinstance(target, PlannedDimension) and target.is_limited_by_part(
        budget, problem.probability
    )
    remedy = partial(target.remedy, budget=budget)
    return outcome.reason_at(problem.probability, remedy, is_limited_by_part=is_limited)


def generate_first_columns(run: SearchRun, incumbents: Incumbents) -> None:
    """Improve the pools a little, before targets that no pose inspects are tried alone."""
    rounds = min(run.effort.pricing_rounds, _FIRST_ROUNDS)
    _generate(run, incumbents, rounds, derive_seed(run.seed, ["first columns"]))


def generate_columns(run: SearchRun, incumbents: Incumbents) -> None:
    """Improve the pools by column generation."""
    _generate(run, incumbents, run.effort.pricing_rounds, run.seed)


def _generate(run: SearchRun, incumbents: Incumbents, rounds: int, seed: int) -> None:
    """Improve the pools, from where the state has got."""

    def offer(entries: dict[str, Any]) -> None:
        if entries["pricing"]["done"] % _ROUNDS_PER_SEARCH == 0:
            incumbents.offer(run)

    warm_start = WarmStart(coverable=~np.isin(run.names, list(run.state.uninspectable)))
    price_poses(
        run.shared,
        run.pools,
        seed,
        rounds,
        run.executor,
        run.callbacks,
        warm_start,
        run.checkpoint(offer),
    )


# Second step: a lower bound is proven; poses that the proof comes across join the pools.


def prove_bound(run: SearchRun, incumbents: Incumbents) -> ProvenBound:
    """Prove a lower bound. Better plans and bounds are told on the way."""
    state = run.state
    inspected = _inspected(run)
    columns = ProofColumns(run)

    def improve(poses: np.ndarray) -> np.ndarray:
        state.joined += 1
        columns.join(poses, derive_seed(run.seed, ["joined", str(state.joined)]))
        incumbents.offer(run)
        return columns.membership[:, inspected]

    def raised(bound: int, weights: np.ndarray | None) -> None:
        incumbents.on_bound(run, ProvenBound(bound, SO_FAR, inspected, _of_all(weights)))

    def _of_all(weights: np.ndarray | None) -> np.ndarray | None:
        return None if weights is None else of_all(weights, inspected)

    checkpoint = run.checkpoint()
    proven = checkpoint.get("proven")
    enough = run.callbacks.deadline.wanted_bound(state.n_known)
    alone = len(state.incompatible)
    if not inspected[np.isin(run.names, state.incompatible)].all():
        alone = 0
    if proven is None and alone >= enough > 0:
        proven = alone, exclusion_proof(run.problem, alone), None
    if proven is None:
        proven = lower_bound(
            run.problem.restricted_to(run.names_of(inspected)),
            enough,
            columns.membership[:, inspected],
            effort=run.effort,
            improve=improve,
            checkpoint=checkpoint,
            executor=run.executor,
            callbacks=replace(run.callbacks, on_bound=raised),
        )
        run.save({"proven": list(proven)})
    if proven[0] < alone:
        proven = alone, exclusion_proof(run.problem, alone), None
    bound, proof, weights = proven
    proven_bound = ProvenBound(bound, proof, inspected, _of_all(weights))
    incumbents.on_bound(run, proven_bound)
    return proven_bound


def _inspected(run: SearchRun) -> np.ndarray:
    """Return which entities (k,) the proof is for; find at its beginning in how many settings they can be covered."""
    state = run.state
    if state.inspected is None:
        state.inspected = run.pool.inspected
        if state.inspected.any():
            membership = run.pool.membership[:, state.inspected]
            nodes = run.nodes(REFUTING_SHARE)
            chosen = few_columns(membership, nodes, run.rng("known"))
            state.n_known = len(chosen)
    return state.inspected


def find_incompatible(run: SearchRun) -> None:
    """Find targets of which no setting inspects two: a bound long before the proof. The same of ends, if they count."""
    seen = np.flatnonzero(run.pool.inspected)
    if seen.size < 2:
        return
    names = np.array(run.names)
    exclusive = exclusive_entities(run.problem, seen, run.pool.membership[:, seen], run.executor)
    run.state.incompatible = tuple(names[exclusive].tolist())
    if not may_split(run):
        return
    apart = ends_apart(run.problem, names[seen].tolist())
    columns = run.pool.membership[:, seen][:, apart.owner]
    every = np.arange(len(apart.owner))
    ends = exclusive_entities(apart.problem, every, columns, run.executor)
    run.state.incompatible_ends = tuple(names[seen[np.unique(apart.owner[ends])]].tolist())


def weigh_columns(run: SearchRun) -> None:
    """Find the columns that the proof's weights come from, where they are not those of the plan.

    The proof does not use all conditions. Weights from columns that meet them all are too large for its poses, and it
    would take most of its time to learn so, one pose after the other.
    """
    columns = ProofColumns(run)
    if columns.relaxed is None:
        return
    poses = None
    if run.state.weighing is None:
        run.state.weighing = empty_pools(len(run.names))
        poses = np.concatenate([pool.poses for pool in run.pools])
    price_poses(
        columns.shared,
        run.state.weighing,
        derive_seed(run.seed, ["weighing"]),
        run.effort.pricing_rounds,
        run.executor,
        run.callbacks.silent,
        WarmStart(poses),
        run.checkpoint(),
    )


def without_unproven(problem: Problem) -> Problem | None:
    """Return a request without the conditions that the proof does not use; None if it has none."""
    need = problem.requirements
    showing = replace(need.showing, separation_px=0.0, min_corner_deg=0.0)
    if showing == need.showing and need.cell is None:
        return None
    return replace(problem, requirements=replace(need, showing=showing, cell=None))


class ProofColumns:
    """The columns that the proof's weights come from: those of the plan, or of a request without some conditions."""

    def __init__(self, run: SearchRun):
        self._run = run

    @cached_property
    def relaxed(self) -> Problem | None:
        """The request without the conditions that the proof does not use; None if it has none."""
        return without_unproven(self._run.problem)

    @cached_property
    def shared(self) -> Shared:
        """The judge of that request."""
        assert self.relaxed is not None
        return Shared(Judge(self.relaxed, self._run.effort, to_be_counted=False))

    @property
    def _pools(self) -> Pools:
        state = self._run.state
        return state.pools if state.weighing is None else state.weighing

    @property
    def membership(self) -> np.ndarray:
        """Columns (c, k)."""
        return self._pools.realised.membership

    def join(self, poses: np.ndarray, seed: int) -> None:
        """Add what the proof came across to these columns, and to the plan's."""
        run = self._run
        affordable = _ROUNDS_TIMES_COLUMNS // max(1, len(run.pool))
        rounds = min(max(_JOINING_ROUNDS, affordable), _MOST_JOINING_ROUNDS)
        silent = run.callbacks.silent
        start = WarmStart(poses)
        weighing = run.state.weighing
        # what is found without some conditions seldom meets them
        plan_rounds = rounds if weighing is None else _JOINING_ROUNDS
        price_poses(run.shared, run.pools, seed, plan_rounds, run.executor, silent, start)
        if weighing is not None:
            price_poses(self.shared, weighing, seed, rounds, run.executor, silent, start)


# Third step: optimistic columns that would save a setting are realised or refuted.


def refute(run: SearchRun, inspected: np.ndarray, bound: int, incumbents: Incumbents) -> None:
    """Try to do with fewer settings, not below the bound, by optimistic columns; refute what cannot be realised.

    Parameters
    ----------
    run : SearchRun
        Its pools get what was realised.
    inspected : array of bool (k,)
        Entities that are to be covered.
    bound : int
        Settings that are needed at least.
    incumbents : Incumbents
        Columns that make a better plan are offered.
    """
    tries = run.effort.refutations
    enough = None
    rng = run.rng("refutation")
    nodes = run.nodes(REFUTING_SHARE)
    impossible = np.zeros((0, len(run.names)), dtype=bool)
    while tries > 0 and inspected.any():
        realised = run.pool.membership[:, inspected]
        if enough is None:
            enough = len(few_columns(realised, nodes, rng))
        if enough <= 1 or bound >= run.callbacks.deadline.wanted_bound(enough):
            return
        near = run.pools.near.membership[:, inspected]
        sets = sets_to_realise(realised, near, impossible[:, inspected], enough, nodes, rng)[:tries]
        if not sets:
            return
        tries -= len(sets)
        sets_of_names = [
            tuple(np.array(run.names)[inspected][members].tolist()) for members in sets
        ]
        for names, outcome in zip(sets_of_names, run.realise(sets_of_names), strict=True):
            reached = run.accept(outcome)
            enough = None if reached else enough
            if set(names) - set(reached):
                impossible = np.vstack([impossible, np.isin(run.names, names)])
        incumbents.offer(run)


@dataclass(frozen=True)
class Tools:
    """What the stages work with.

    Attributes
    ----------
    run : SearchRun
        The request, and what searches and remembers.
    incumbents : Incumbents
        The best plan so far; no stage depends on it.
    lighting : Lighting or None
        What is asked of lamps.
    """

    run: SearchRun
    incumbents: Incumbents
    lighting: Lighting | None = None


class Stage(NamedTuple):
    """One stage of a plan.

    Attributes
    ----------
    name : str
        What the state calls it.
    run : callable
        ``run(state, tools)`` does it, from the beginning or from where the entries of the state have got.
    """

    name: str
    run: Callable[[PlanState, Tools], None]


def _sample(state: PlanState, tools: Tools) -> None:
    sample_poses(tools.run, tools.incumbents)
    tools.incumbents.offer(tools.run)


def _find_incompatible(state: PlanState, tools: Tools) -> None:
    find_incompatible(tools.run)
    tools.incumbents.on_incompatible(tools.run)


def _generate_first_columns(state: PlanState, tools: Tools) -> None:
    generate_first_columns(tools.run, tools.incumbents)
    tools.incumbents.offer(tools.run)
    # before the columns are improved further, so that others can join what is hard to inspect
    state.uninspectable = realise_missing_alone(tools.run, tools.incumbents)
    tools.incumbents.offer(tools.run)


def _generate_columns(state: PlanState, tools: Tools) -> None:
    generate_columns(tools.run, tools.incumbents)
    tools.incumbents.offer(tools.run)


def _weigh(state: PlanState, tools: Tools) -> None:
    weigh_columns(tools.run)


def _prove_bound(state: PlanState, tools: Tools) -> None:
    proven = prove_bound(tools.run, tools.incumbents)
    state.bound = proven.n
    state.proof = proven.proof
    state.bound_of = proven.of
    state.bound_weights = proven.weights
    # poses that the proof came across may inspect more
    state.inspected = state.pools.realised.inspected


def _refute(state: PlanState, tools: Tools) -> None:
    assert state.inspected is not None
    refute(tools.run, state.inspected, state.bound, tools.incumbents)


def _count(state: PlanState, tools: Tools) -> None:
    assert state.inspected is not None
    columns = CountedColumns.resumed(tools.run, state.inspected, state.entries.get("counted"))

    def offer(entries: dict[str, Any]) -> None:
        tools.incumbents.offer(tools.run, columns.counted)

    columns.search(tools.run.effort.pricing_rounds, state.bound, tools.run.checkpoint(offer))
    state.counted = columns.counted


def _settle(state: PlanState, tools: Tools) -> None:
    assert state.inspected is not None
    assert state.counted is not None
    settled = settle(tools.run, state.inspected, state.counted)
    state.uninspectable.update(settled.lost)
    settled_targets = np.isin(
        tools.run.names, [n for setting in settled.settings for n in setting.entities]
    )
    assert state.bound_of is not None
    proven = ProvenBound(state.bound, state.proof, state.bound_of, state.bound_weights)
    state.bound = proven.for_some(settled_targets)
    state.plan = assembled(tools.run, settled.settings, state.bound, state.proof)


def _light(state: PlanState, tools: Tools) -> None:
    if tools.lighting is None or state.plan is None:
        return
    # what ends the search for lamps leaves this plan
    tools.incumbents.publish(replace(state.plan, unfinished=True))
    plan = with_lamps(tools.run, tools.lighting, state.plan)
    if plan.unlit:
        assert state.inspected is not None
        assert state.counted is not None
        # where a pose was moved to, no lamp may light what one lights from where it was
        unmoved = settle(tools.run, state.inspected, state.counted, moves=False)
        if not unmoved.lost.keys() <= state.uninspectable.keys():
            # it inspects less than the plan
            state.plan = plan
            return
        draft = assembled(tools.run, unmoved.settings, state.bound, state.proof)
        other = with_lamps(tools.run, tools.lighting, draft)
        if set(other.promises) == set(plan.promises) and len(other.unlit) < len(plan.unlit):
            plan = other
    state.plan = plan


STAGES = (
    Stage("candidate poses", _sample),
    Stage("incompatible targets", _find_incompatible),
    Stage("first columns", _generate_first_columns),
    Stage("column generation", _generate_columns),
    Stage("weighing", _weigh),
    Stage("lower bound", _prove_bound),
    Stage("refutation", _refute),
    Stage("counted columns", _count),
    Stage("settings", _settle),
    Stage("lamps", _light),
)


def run_stages(
    run: SearchRun, incumbents: Incumbents, lighting: Lighting | None = None
) -> InspectionPlan:
    """Do all stages that are left to do, and return the plan.

    Parameters
    ----------
    run : SearchRun
        A new one; its state may be that of an earlier, interrupted one.
    incumbents : Incumbents
        Better plans on the way are offered to it.
    lighting : Lighting, optional
        What is asked of lamps.

    Returns
    -------
    InspectionPlan
        The same whether the planning was interrupted or not.
    """
    state = run.state
    tools = Tools(run, incumbents, lighting)
    names = [stage.name for stage in STAGES]
    if state.stage:
        incumbents.offer(run)
        incumbents.on_incompatible(run)
    else:
        state.stage = names[0]
        unlit = never_lit(run.problem, lighting)
        state.uninspectable = {**without_corners(run.judge), **unlit}
        incumbents.glance(run)
    for stage in STAGES[names.index(state.stage) :]:
        if stage.name != state.stage:
            state.stage = stage.name
            run.save({})
        run.callbacks.stage(stage.name)
        stage.run(state, tools)
    assert state.plan is not None
    return state.plan
