"""The best plan so far, while a run goes on: an upper bound that can be used at once.

An incumbent is a whole plan: a cover by the columns found so far, each with the candidate pose it was found at,
supported by simulation. It is told of whenever it or its bound gets better. Nothing in a run depends on it, so a run
that is watched ends with the same plan as one that is not.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields, replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ground.shared import Shared
from planner.bound.lower_bound import ProvenBound, exclusion_proof
from planner.callbacks import LEAST_SEARCH_S, NOBODY, Callbacks, Checkpoint
from planner.cover import bound_columns, exchange_columns, greedy_cover
from planner.executors import in_order
from planner.identity import Request
from planner.plan import InspectionPlan
from planner.request.problem import Problem, witness_reasons
from planner.request.reach import PoseRegion
from planner.request.split import NEVER, split_names
from planner.request.targets import Target
from planner.resume import PlanningState
from planner.search.columns import (
    BATCH,
    ColumnPool,
    Judge,
    Judgement,
    Pools,
    derive_seed,
    first_poses,
)
from planner.search.plan_setting import setting_at, without
from planner.search.realise_column import (
    Promises,
    Supported,
    realise,
    simulate_promises,
    supported_pose,
)
from planner.sensor_setting import (
    Outcome,
    Reason,
    ReasonKind,
    SensorSetting,
    kinds_record,
    reasons_from,
)
from planner.travel import order_by, pose_distances
from planner.verify.setting_record import search_windows_px

# One planning run: the request, the pools of columns, and what every step needs of them.


# How far a planning has got: all that its stages hand on, in one value that packs itself for the
# state file.


@dataclass
class PlanState:
    """What the stages of a plan hand on.

    Attributes
    ----------
    pools : Pools
        Columns found so far.
    stage : str
        Name of the stage that is to be done, or is being done.
    entries : dict of str to value
        How far this stage has got; empty at its beginning. See `planner.callbacks.Checkpoint`.
    uninspectable : dict of str to Reason
        Targets that no pose inspects, and why.
    incompatible : tuple of str
        Targets of which no setting inspects two, as known so far.
    incompatible_ends : tuple of str
        Targets that have an entity each so that no setting inspects two of these; only if plans may split targets.
    weighing : Pools or None
        Columns that the weights of the proof come from, if they are not those of the plan.
    inspected : array of bool (k,) or None
        Targets that some column inspects: the bound and the settings are for these.
    n_known : int
        Settings of a cover that is known when the proof begins.
    joined : int
        How many times poses have joined the pools that the proof came across.
    bound : int
        Settings that are needed at least.
    proof : str
        What the bound rests on.
    bound_of : array of bool (k,) or None
        Targets that it was proven for.
    bound_weights : array (k,) or None
        Their weights, where such prove it; see `planner.bound.lower_bound.ProvenBound`.
    counted : ColumnPool or None
        Columns of which all targets have the required P_all; the settings are chosen from these.
    plan : InspectionPlan or None
        The plan, without lamps at first.
    """

    pools: Pools
    stage: str = ""
    entries: dict[str, Any] = field(default_factory=dict)
    uninspectable: dict[str, Reason] = field(default_factory=dict)
    incompatible: tuple[str, ...] = ()
    incompatible_ends: tuple[str, ...] = ()
    weighing: Pools | None = None
    inspected: NDArray[np.bool_] | None = None
    n_known: int = 0
    joined: int = 0
    bound: int = 0
    proof: str = ""
    bound_of: NDArray[np.bool_] | None = None
    bound_weights: NDArray[np.float64] | None = None
    counted: ColumnPool | None = None
    plan: InspectionPlan | None = None

    @classmethod
    def empty(cls, n_targets: int) -> PlanState:
        """Return the state in which nothing is known of k targets."""
        return cls(empty_pools(n_targets))

    def pack(self) -> dict[str, Any]:
        """Return the fields as values that `planner.plan_file.packed` takes; arrays are not copied."""
        values = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return {
            **values,
            "pools": self.pools.to_dict(),
            "weighing": None if self.weighing is None else self.weighing.to_dict(),
            "counted": None if self.counted is None else self.counted.to_dict(),
            "uninspectable": {name: str(reason) for name, reason in self.uninspectable.items()},
            "uninspectable_kinds": kinds_record(self.uninspectable),
            "plan": None if self.plan is None else self.plan.to_dict(),
        }

    @classmethod
    def unpack(cls, data: Mapping[str, Any]) -> PlanState:
        """Build from the result of `pack`, as it is or as it comes back from a file."""
        values = {entry.name: data[entry.name] for entry in fields(cls)}
        plan = data["plan"]
        weighing = data["weighing"]
        counted = data["counted"]
        return cls(
            **{
                **values,
                "pools": Pools.from_dict(data["pools"]),
                "weighing": None if weighing is None else Pools.from_dict(weighing),
                "counted": None if counted is None else ColumnPool.from_dict(counted),
                "uninspectable": reasons_from(data["uninspectable"], data["uninspectable_kinds"]),
                "incompatible": tuple(data["incompatible"]),
                "incompatible_ends": tuple(data["incompatible_ends"]),
                "plan": None if plan is None else InspectionPlan.from_dict(plan),
            }
        )


def may_split(run: SearchRun) -> bool:
    """Return whether plans of a run may measure some of its targets in two settings."""
    return run.request.split != NEVER and bool(split_names(run.problem))


def empty_pools(n_targets: int) -> Pools:
    """Return pools for k targets without columns."""
    return Pools(*(ColumnPool(n_targets) for _ in Pools._fields))


# seconds after which the checking of poses is shown
SILENT_S = 1.0
# share of the solver's nodes for each cover while columns are tried. There are many, and a cover
# that is not the best costs no more than a run of the genetic algorithm.
REFUTING_SHARE = 0.1


class SearchRun:
    """One planning run: the pools of columns that the steps fill.

    Parameters
    ----------
    problem : Problem
        The request on the part, with where its targets are observable.
    request : Request
        What the plan states as asked; it holds seed and effort.
    memo : PlanningState
        Outcomes and checkpoints.
    executor : concurrent.futures.Executor, optional
        Runs the per-entity and per-column work.
    callbacks : Callbacks
        What is called while it goes on, and when it ends.

    Attributes
    ----------
    state : PlanState
        How far it has got; that of the memo, if there is one.
    """

    def __init__(
        self,
        problem: Problem,
        request: Request,
        memo: PlanningState,
        *,
        executor: Executor | None = None,
        callbacks: Callbacks = NOBODY,
    ):
        self.problem = problem
        self.request = request
        self.seed = request.seed
        self.effort = request.effort
        self.judge = Judge(problem, request.effort)
        self.names = problem.names
        self.shared = Shared(self.judge)
        self.promises = Promises(self.shared, request.seed)
        self.memo = memo
        self.executor = executor
        self.callbacks = callbacks
        last = memo.last()
        self.state = PlanState.empty(len(self.names)) if last is None else PlanState.unpack(last)
        self._begun = 0

    @property
    def pools(self) -> Pools:
        """Columns found so far."""
        return self.state.pools

    @property
    def pool(self) -> ColumnPool:
        """Columns that poses inspect."""
        return self.state.pools.realised

    def bound_of(self, names: Sequence[str]) -> int:
        """Return how many settings some targets need at least, by the proof so far; 0 without one."""
        state = self.state
        if state.bound_of is None:
            return 0
        proven = ProvenBound(state.bound, state.proof, state.bound_of, state.bound_weights)
        return proven.for_some(np.isin(self.names, names))

    def save(self, entries: dict[str, Any]) -> None:
        """Keep the state, with how far its stage has got."""
        self.state.entries = entries
        self.memo.keep(self.state.pack())

    def checkpoint(self, then: Callable[[dict[str, Any]], object] | None = None) -> Checkpoint:
        """Return where work of this stage goes on and is kept; ``then(entries)`` is called after each change."""

        def keep(entries: dict[str, Any]) -> None:
            self.save(entries)
            if then is not None:
                then(entries)

        return Checkpoint(self.state.entries, keep)

    def nodes(self, share: float = 1.0) -> int:
        """Return the nodes that a cover may take: a share of what the effort allows."""
        return int(share * self.effort.cover_nodes)

    def rng(self, purpose: str) -> np.random.Generator:
        """Return the source of chance for a purpose, whatever was drawn before."""
        return np.random.default_rng(derive_seed(self.seed, [purpose]))

    def names_of(self, column: np.ndarray) -> tuple[str, ...]:
        """Return the names of the entities in a column (k,) of bool."""
        return tuple(np.array(self.names)[column].tolist())

    def simulate(self, settings: Sequence[SensorSetting]) -> Iterator[SensorSetting]:
        """Simulate what settings state and was not simulated before, several at a time; yield each when it is done."""
        # what two settings state of one pose is simulated twice, and is the same
        tasks = [self.promises.task(setting) for setting in settings]
        new = [k for k, task in enumerate(tasks) if task[2]]
        results = in_order(
            self.executor, simulate_promises, [tasks[k] for k in new], self.callbacks.deadline.check
        )
        for k, excess in zip(new, results, strict=True):
            self.promises.take(settings[k], excess)
            yield settings[k]

    def accept(self, outcome: Outcome) -> tuple[str, ...]:
        """Add what a run of the genetic algorithm achieved to the pool; return the entities it inspects."""
        if outcome.setting is None:
            return ()
        pose = outcome.setting.cam2world[None]
        judged = self.judge(pose)
        self.pool.add(judged.countable, pose, judged.probability)
        self.pools.add_missing(pose, judged)
        return self.names_of(judged.inspects[0])

    def realise(self, sets: Sequence[tuple[str, ...]]) -> list[Outcome]:
        """Run the genetic algorithm for sets of entities not tried before; return all outcomes in order."""
        todo = [names for names in dict.fromkeys(sets) if self.memo.get(names) is None]
        done = self._begun
        self._begun = self._begun + len(todo)
        arguments = [
            (self.shared, names, derive_seed(self.seed, names), self._start(names))
            for names in todo
        ]
        for names, outcome in zip(
            todo, in_order(self.executor, realise, arguments, self.callbacks.check), strict=True
        ):
            self.memo.put(names, outcome)
            done += 1
            self.callbacks.report(done, self._begun, "improving poses")
        outcomes = (self.memo.get(names) for names in sets)
        return [outcome for outcome in outcomes if outcome is not None]

    def supported(self, options: Sequence[Sequence[SensorSetting]]) -> list[Supported]:
        """Return for each of some settings the best of its options that simulation supports; see `best_supported`."""
        tasks = [
            (self.shared, choices, derive_seed(self.seed, choices[0].entities), len(options))
            for choices in options
        ]
        confirmed = []
        begun = time.monotonic()
        for result in in_order(self.executor, supported_pose, tasks, self.callbacks.check):
            confirmed.append(result)
            # what is soon done needs no line
            if time.monotonic() - begun > SILENT_S:
                self.callbacks.report(len(confirmed), len(tasks), "checked poses")
        return confirmed

    def _start(self, names: Sequence[str]) -> np.ndarray | None:
        """Return the candidate pose (1, 4, 4) that inspects, or nearly inspects, a set of entities."""
        for pool in self.pools:
            best = pool.best_containing(np.isin(self.names, names))
            if best is not None:
                return pool.poses[best : best + 1]
        return None


# number of viewing directions per entity, for each of the first plans
_GLANCES = (4, 32)
# pairs of a pose and an entity that are judged for one of them at most: of hundreds of entities, a part of the poses
_GLANCE_PAIRS = 200_000
# steps of the exchange search for a cover of one column less
_EXCHANGES = 1000
# largest number of covers that are simulated. Each omits the edges contradicted before.
_COVERS = 20
# drop an edge that simulation contradicts from this many candidate poses and confirms from none
_IN_VAIN = 4

# Which other lines a detector may take for an edge: visible ones where the edge has to be looked
# for.


def with_lines_in_windows(plan: InspectionPlan, problem: Problem) -> InspectionPlan:
    """Return a plan whose settings tell of other visible lines in the search windows of targets.

    Lines that leave an edge's own ends at the angle asked for are no such lines: their direction tells them apart.
    Beside lines and circles that are fitted, a fifth of the points may have such lines.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    problem : Problem
        What it answers; where it asks nothing of images, the plan is returned as it is.
    """
    showing = problem.requirements.showing
    if showing.asks_nothing or not plan.settings:
        return plan
    windows = [search_windows_px(plan, setting) for setting in plan.settings]
    # all are looked for as far as the widest window
    widest = max(max(widths.values()) for widths in windows)
    settings = []
    for setting, window in zip(plan.settings, windows, strict=True):
        # of witnesses, each setting has its own
        request_here = problem.at_pose(setting.cam2world, setting.entities)
        check = request_here.constraints.image_check(replace(showing, separation_px=widest))
        every = np.ones((1, len(request_here.names)), bool)
        apart = check.separations(setting.cam2world[None], every, 0.0)[0] + widest
        near = dict(zip(request_here.names, apart.tolist(), strict=True))
        lines = {name: near[name] for name in setting.entities if near[name] < window[name]}
        settings.append(replace(setting, lines_in_window_px=lines))
    return replace(plan, settings=tuple(settings))


# In plans for a robot cell: in which fixturing each setting is taken, by which joints, and in
# which order.


# all choices of so many fixturings are tried; there are seldom more than three
_MOST_TRIED = 12


def in_order_of_arm(
    problem: Problem, settings: Sequence[SensorSetting], *, unfinished: bool
) -> list[SensorSetting]:
    """Return settings with fixturing and joints: the fewest fixturings that do, one after the other.

    Parameters
    ----------
    problem : Problem
        Has a cell.
    settings : sequence of SensorSetting
        All of them are reached.
    unfinished : bool
        A better plan follows, so the order is not worth seconds.
    """
    cell = problem.requirements.cell
    assert cell is not None
    placed = [
        cell.placed(
            item.cam2world, problem.at_pose(item.cam2world, item.entities).constraints.segments
        )
        for item in settings
    ]
    chosen = fewest_fixturings([set(ways) for ways in placed], list(cell.to_dict()["fixturings"]))
    result: list[SensorSetting] = []
    for name in chosen:
        group = [
            _standing(setting, name, ways[name])
            for setting, ways in zip(settings, placed, strict=True)
            if next((item for item in chosen if item in ways), "") == name
        ]
        result += _ordered(cell, group, name, unfinished)
    # what a cell forbids after all is told by the plan's reachability
    result += [item for item, ways in zip(settings, placed, strict=True) if not ways]
    return result


def fewest_fixturings(ways: Sequence[set[str]], every: Sequence[str]) -> tuple[str, ...]:
    """Return the fewest of all names such that each set that is not empty holds one; the first of equal choices.

    Beyond a dozen names, they are chosen greedily.
    """
    unserved = [names for names in ways if names]
    if len(every) <= _MOST_TRIED:
        for count in range(len(every) + 1):
            for chosen in combinations(every, count):
                if all(names.intersection(chosen) for names in unserved):
                    return chosen
    picked: list[str] = []
    while unserved:
        best = max(every, key=lambda name: sum(name in names for names in unserved))
        picked.append(best)
        unserved = [names for names in unserved if best not in names]
    return tuple(picked)


def _standing(setting: SensorSetting, fixturing: str, arm: Any) -> SensorSetting:
    return replace(
        setting,
        fixturing=fixturing,
        joints=arm.joints,
        angle_deg=arm.angle_deg,
        arm={
            "clearance_robot_mm": arm.clearance_mm,
            "closest": arm.closest,
            "to_limit_rad": arm.to_limit_rad,
            "singular_value": arm.singular_value,
        },
    )


def _ordered(
    cell: PoseRegion, group: Sequence[SensorSetting], fixturing: str, unfinished: bool
) -> Iterable[SensorSetting]:
    """Return the settings of one fixturing in the order that takes the least time."""
    if not group:
        return ()
    seconds = cell.travel_seconds(np.array([setting.axes for setting in group]), fixturing)
    order = order_by(seconds, kicks=0) if unfinished else order_by(seconds)
    return [group[i] for i in order]


# Putting a plan together from settings, at the end of a run or on the way.


# of entities that have neither a pose nor a reason for that yet
_NOT_YET = Reason.of(ReasonKind.NOT_FOUND_YET, "planning stopped early. More time may find one.")

_LATE = Reason.of(
    ReasonKind.NOT_FOUND_YET,
    "the time limit ended before the program knew from where it is visible.",
)


def assembled(
    run: SearchRun,
    settings: Sequence[SensorSetting],
    bound: int,
    proof: str,
    *,
    unfinished: bool = False,
) -> InspectionPlan:
    """Put the plan together, its settings in the order of travel.

    Parameters
    ----------
    run : SearchRun
        Its request, and its reasons for what is not inspected.
    settings : sequence of SensorSetting
    bound : int
        Settings that are needed at least.
    proof : str
        What that rests on.
    unfinished : bool
        The run goes on.
    """
    problem = run.problem
    # a later run may have come across a view of one that had none of its own
    seen = {name for setting in settings for name in setting.entities}
    if not unfinished:
        settings = [with_passed_over(problem, setting) for setting in settings]
    cell = problem.requirements.cell
    late = _late_names(run)
    plan = InspectionPlan(
        request=run.request,
        settings=tuple(_in_order(problem, settings, unfinished)),
        lower_bound=bound,
        bound_proof=proof,
        uninspectable={**_reasons(run, unfinished, seen), **dict.fromkeys(late, _LATE)},
        unfinished=unfinished or bool(late),
        cell={} if cell is None else cell.to_dict(),
    )
    return with_lines_in_windows(plan, problem)


def with_passed_over(problem: Problem, setting: SensorSetting) -> SensorSetting:
    """Return a setting that says why it uses none of the other witnesses of its targets."""
    if not setting.witness:
        return setting
    measured = problem.restricted_to(list(setting.witness))
    why = witness_reasons(measured.witnesses, setting.cam2world)
    over = {
        target.name: {
            ", ".join(witness.entities): reason
            for k, (witness, reason) in enumerate(zip(target.witnesses, reasons, strict=True))
            if k != setting.witness[target.name]
        }
        for target, reasons in zip(measured.targets, why, strict=True)
    }
    return replace(setting, passed_over=over)


def _in_order(
    problem: Problem, settings: Sequence[SensorSetting], unfinished: bool
) -> Sequence[SensorSetting]:
    """Return settings in the order of travel, by the joints of a robot where there is one."""
    if problem.requirements.cell is not None:
        return in_order_of_arm(problem, settings, unfinished=unfinished)
    # a better plan follows soon, so its travel is not worth seconds
    distances = pose_distances(np.array([s.cam2world for s in settings]).reshape(-1, 4, 4))
    order = order_by(distances, kicks=0) if unfinished else order_by(distances)
    return [settings[i] for i in order]


def needed(target: Target) -> set[str]:
    """Return the names of all entities whose regions a target needs."""
    return {name for witness in target.witnesses for name in witness.entities}


def _reasons(run: SearchRun, unfinished: bool, seen: set[str]) -> dict[str, Reason]:
    """Return why entities are not inspected, in the order in which that was found out."""
    reasons = dict(run.state.uninspectable)
    if unfinished:
        reasons = {name: reasons.get(name, _NOT_YET) for name in run.names}
    return {name: reason for name, reason in reasons.items() if name not in seen}


def _late_names(run: SearchRun) -> list[str]:
    """Return the targets whose region was not complete in time."""
    return [target.name for target in run.request.targets if target.name not in run.names]


# Covers by candidate poses of which simulation supports what is counted on.
#
# A cover by columns as judged may promise more than a simulation of their poses supports: the
# probability is of second order, and does not count ends that leave the image. So what a cover
# takes is simulated, what is contradicted is taken out of these columns, and a cover is chosen
# again, until all of it has been simulated: a relaxation, tightened where a cover makes use of
# it.


class SupportedColumns:
    """What simulation supports of the candidate poses that were tried, each of them once."""

    def __init__(self) -> None:
        # None if nothing is stated of the pose
        self._tried: dict[tuple[bytes, tuple[str, ...]], SensorSetting | None] = {}
        # poses that promise an edge, and that simulation contradicts there
        self._in_vain: Counter[str] = Counter()

    def cover(
        self, run: SearchRun, pool: ColumnPool, beaten: tuple[int, int], covers: int = _COVERS
    ) -> list[SensorSetting] | None:
        """Choose few columns of a pool that simulation supports, for as many entities as possible.

        Parameters
        ----------
        run : SearchRun
            Its request says what is asked, its seed how poses are displaced.
        pool : ColumnPool
        beaten : (int, int)
            Entities of a plan known, and minus its settings: what is not better is not looked for further.
        covers : int
            Covers that are simulated at most.

        Returns
        -------
        list of SensorSetting or None
            None if none better was found.
        """
        membership, done = self._corrected(run, pool)
        chosen = _short_cover(membership, beaten, run.rng("incumbent"), _EXCHANGES)
        for k in range(covers):
            if chosen is None:
                return None
            new = [c for c in chosen.tolist() if not done[c]]
            if not new:
                break
            begun = time.monotonic()
            untried = [c for c in new if _key(run, pool, c) not in self._tried]
            # if the time is up on the way, those tried show most
            untried.sort(key=membership.sum(axis=1).tolist().__getitem__, reverse=True)
            candidates = candidate_settings(run, pool, untried)
            for i, setting in enumerate(run.simulate(candidates), 1):
                self._try(run, setting)
                run.callbacks.deadline.arm_soon()
                # what is soon done needs no line
                if time.monotonic() - begun > SILENT_S:
                    run.callbacks.report(i, len(untried), "checked poses")
            for c in new:
                membership[c] = self._supported(run, pool, c)
                done[c] = True
            self._give_up(run, membership, done)
            if k + 1 < covers:
                chosen = _short_cover(membership, beaten, run.rng("incumbent"), _EXCHANGES)
            confirmed = np.where(done[:, None], membership, False)
            shorter = _short_cover(confirmed, beaten, run.rng("incumbent"), _EXCHANGES)
            if k + 1 == covers or (
                shorter is not None and chosen is not None and _as_good(membership, shorter, chosen)
            ):
                chosen = shorter
        return None if chosen is None else self._as_settings(run, pool, chosen)

    def _corrected(
        self, run: SearchRun, pool: ColumnPool
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return the columns of a pool (c, k) as far as they are known to be supported, and which (c,) were tried."""
        membership = pool.membership.copy()
        done = np.zeros(len(pool), dtype=bool)
        for c in range(len(pool) if self._tried else 0):
            if _key(run, pool, c) in self._tried:
                membership[c] = self._supported(run, pool, c)
                done[c] = True
        self._give_up(run, membership, done)
        return membership, done

    def _give_up(
        self, run: SearchRun, membership: NDArray[np.bool_], done: NDArray[np.bool_]
    ) -> None:
        """Clear the edges that no pose tried supports, although many promise them."""
        often = np.array([self._in_vain[name] >= _IN_VAIN for name in run.names])
        membership[:, often & ~membership[done].any(axis=0)] = False

    def _supported(self, run: SearchRun, pool: ColumnPool, c: int) -> NDArray[np.bool_]:
        """Return which entities (k,) of a column simulation supports; it is tried if it was not."""
        key = _key(run, pool, c)
        if key not in self._tried:
            self._try(run, candidate_settings(run, pool, [c])[0])
        return np.isin(run.names, _entities(self._tried[key]))

    def _try(self, run: SearchRun, setting: SensorSetting) -> None:
        """Remember what simulation supports of a candidate pose."""
        key = setting.cam2world.tobytes(), setting.entities
        if key not in self._tried:
            supported = as_simulated(run, [setting])
            tried = supported[0] if supported else None
            self._tried[key] = tried
            self._in_vain.update(set(key[1]) - set(_entities(tried)))

    def cover_of_tried(self, run: SearchRun) -> list[SensorSetting]:
        """Return few of the poses tried so far, for as many entities as these show."""
        settings = [setting for setting in self._tried.values() if setting is not None]
        if not settings:
            return []
        membership = np.array([np.isin(run.names, setting.entities) for setting in settings])
        chosen = _short_cover(membership, (0, 0), run.rng("incumbent"), _EXCHANGES)
        return [] if chosen is None else [settings[k] for k in chosen.tolist()]

    def _as_settings(
        self, run: SearchRun, pool: ColumnPool, chosen: NDArray[np.int_]
    ) -> list[SensorSetting]:
        tried = [self._tried[_key(run, pool, c)] for c in chosen.tolist()]
        return [setting for setting in tried if setting is not None]


def candidate_settings(
    run: SearchRun, pool: ColumnPool, columns: Iterable[int]
) -> list[SensorSetting]:
    """Return the poses of columns as settings."""
    columns_of = [(pool.poses[c], run.names_of(pool.membership[c])) for c in columns]
    return [
        setting_at(run.problem, pose, names, "candidate pose", seed=derive_seed(run.seed, names))
        for pose, names in columns_of
    ]


def as_simulated(run: SearchRun, settings: Iterable[SensorSetting]) -> list[SensorSetting]:
    """Return settings that state what simulation does not contradict; those that state nothing are left out."""
    supported = []
    for setting in settings:
        wrong = run.promises.contradicted_in(setting)
        reduced = without(run.problem, setting, list(wrong)) if wrong else setting
        supported.append(run.promises.with_bounds(reduced))
    return [setting for setting in supported if setting.entities]


def _key(run: SearchRun, pool: ColumnPool, c: int) -> tuple[bytes, tuple[str, ...]]:
    return pool.poses[c].tobytes(), run.names_of(pool.membership[c])


def _entities(tried: SensorSetting | None) -> tuple[str, ...]:
    return () if tried is None else tried.entities


def _short_cover(
    membership: NDArray[np.bool_], beaten: tuple[int, int], rng: np.random.Generator, steps: int
) -> NDArray[np.int_] | None:
    """Return few columns that cover all that columns (c, k) contain, or None if that is not better than a plan known.

    It is better if it has more entities, or as many in fewer columns. The greedy cover, and what
    exchanges make of it in so many steps.
    """
    covered = membership.any(axis=0)
    membership = membership[:, covered]
    n_beaten = beaten[0]
    fewer_than = -beaten[1]
    if not covered.any() or covered.sum() < n_beaten:
        return None
    chosen: NDArray[np.int_] | None = None
    if covered.sum() > n_beaten:
        chosen = np.array(greedy_cover(membership))
        fewer_than = len(chosen)
    fewest = bound_columns(membership)
    while fewer_than > fewest:
        exchange = exchange_columns(membership, fewer_than - 1, steps=steps, rng=rng)
        if exchange.missing:
            break
        chosen = exchange.chosen
        fewer_than = len(exchange.chosen)
    return None if chosen is None else np.sort(chosen)


def _as_good(
    membership: NDArray[np.bool_], some: NDArray[np.int_], other: NDArray[np.int_]
) -> bool:
    """Tell whether some columns cover as many entities as others, and are no more."""
    return len(some) <= len(other) and bool(
        membership[some].any(axis=0).sum() >= membership[other].any(axis=0).sum()
    )


# between two offers on the way, in times of how long one takes
_OFFERS_APART = 4.0
# seconds, and then a share of the time, for plans on the way of a run that has all the time it needs
_FREE_S = 1.0
_SHARE = 0.1
TRIVIAL = "Fewer settings than one inspect nothing. Nothing larger was proved."
SO_FAR = (
    "Covering by optimistic columns, boxes of camera poses checked against necessary conditions (visibility, focus, "
    "sensor size, length of the image), as far as the proof had got."
)


class Needed(NamedTuple):
    """How many settings are needed at least.

    Attributes
    ----------
    n : int
        So many, in any plan.
    proof : str
        What that rests on.
    of_whole : int
        So many where no target is split; 0 if plans may not split targets.
    """

    n: int
    proof: str
    of_whole: int = 0

    def stated_in(self, plan: InspectionPlan) -> InspectionPlan:
        """Return a plan that states it."""
        more = self.of_whole if self.of_whole > self.n else 0
        return replace(plan, lower_bound=self.n, bound_proof=self.proof, whole_bound=more)


class Incumbents:
    """The best plan so far of one run.

    Parameters
    ----------
    callbacks : Callbacks
        ``on_best`` gets the plan whenever it or its bound is better, ``on_bound`` every bound. Plans are made only if
        they are of use to somebody.

    Attributes
    ----------
    best : InspectionPlan or None
        The plan.
    """

    def __init__(self, callbacks: Callbacks):
        self.best: InspectionPlan | None = None
        self._callbacks = callbacks
        # the best one of each kind
        self._proofs: dict[str, ProvenBound] = {}
        # of plans that may split targets
        self._proof_of_ends: ProvenBound | None = None
        self._columns = SupportedColumns()
        self._begun = time.monotonic()
        self._spent_s = 0.0
        self._offer_again = self._begun + LEAST_SEARCH_S

    def glance(self, run: SearchRun) -> None:
        """Make a plan of very few poses, so that there is one at once; the run does not take these poses in."""
        deadline = self._callbacks.deadline
        # how long a direction takes
        each = 0.0
        for directions in _GLANCES if self._callbacks.wants_plans else ():
            begun = time.monotonic()
            # candidate poses make more of the time than a second glance that would take most of it
            if not deadline.limited and self.best is not None:
                break
            if each * directions > deadline.glance_s():
                break
            pool = ColumnPool(len(run.names))
            poses = _evenly(first_poses(run.judge, directions, run.seed), len(run.names))
            judged = self._judged_in_parts(run, poses)
            pool.add(judged.countable, poses, judged.probability)
            self._offer(run, pool, covers=1)
            if self.best is not None:
                deadline.arm_soon()
            each = (time.monotonic() - begun) / directions
        self._offer_again = time.monotonic() + LEAST_SEARCH_S

    def _judged_in_parts(self, run: SearchRun, poses: NDArray[np.float64]) -> Judgement:
        """Judge poses as many at a time as the judge does itself, and report between."""
        parts = [run.judge(poses[:0])]
        for first in range(0, len(poses), BATCH):
            parts.append(run.judge(poses[first : first + BATCH]))
            self._callbacks.report(first + len(parts[-1].inspects), len(poses), "first poses")
        return Judgement.joined(parts)

    def offer_on_the_way(self, run: SearchRun) -> None:
        """Where the time is limited, see now and then what the columns of an unfinished stage are good for."""
        if not self._callbacks.deadline.limited:
            return
        now = time.monotonic()
        if now >= self._offer_again:
            self.offer(run)
            took = time.monotonic() - now
            self._offer_again = now + took + max(LEAST_SEARCH_S, _OFFERS_APART * took)

    def offer(self, run: SearchRun, pool: ColumnPool | None = None) -> None:
        """See whether the columns of a run, or those of a pool, make a better plan."""
        pool = run.pool if pool is None else pool
        if self._callbacks.wants_plans and pool.membership.any() and self._is_affordable():
            self._offer(run, pool)
            if self.best is not None:
                self._callbacks.deadline.arm()

    def _is_affordable(self) -> bool:
        """Return whether another plan on the way keeps to its share of the time, where the time is not limited."""
        if self._callbacks.deadline.limited or self.best is None:
            return True
        return self._spent_s <= max(_FREE_S, _SHARE * (time.monotonic() - self._begun))

    def _offer(self, run: SearchRun, pool: ColumnPool, covers: int = _COVERS) -> None:
        """See whether the columns of a pool make a better plan."""
        begun = time.monotonic()
        cover = self._columns.cover(
            run, pool, (0, 0) if self.best is None else _worth(self.best), covers
        )
        if cover:
            proven = self.proven(run, cover)
            plan = proven.stated_in(assembled(run, cover, proven.n, proven.proof, unfinished=True))
            if self.best is None or _worth(plan) > _worth(self.best):
                self.publish(plan)
        self._spent_s += time.monotonic() - begun

    def on_bound(self, run: SearchRun, proven: ProvenBound) -> None:
        """Take in a bound that was proven for some entities."""
        self._callbacks.bound(proven.n, proven.weights)
        self._proofs[proven.proof] = proven
        if self.best is not None:
            best = self.proven(run, self.best.settings).stated_in(self.best)
            is_better = best.lower_bound > self.best.lower_bound
            if is_better or best.whole_bound > self.best.whole_bound:
                self.publish(best)

    def on_incompatible(self, run: SearchRun) -> None:
        """Take in the bound of entities that exclude each other, if some are known."""
        ends = run.state.incompatible_ends
        if len(ends) > 1:
            self._proof_of_ends = _of_exclusion(run, ends)
        if len(run.state.incompatible) > 1:
            self.on_bound(run, _of_exclusion(run, run.state.incompatible))

    def latest(self, run: SearchRun) -> InspectionPlan:
        """Return the best plan, or one of the poses tried so far where that is better; it may have no settings."""
        settings = self._columns.cover_of_tried(run)
        names = {name for setting in settings for name in setting.entities}
        if self.best is not None and _worth(self.best) >= (len(names), -len(settings)):
            return self.best
        needed = self.proven(run, settings)
        plan = assembled(run, settings, needed.n, needed.proof, unfinished=True)
        return needed.stated_in(plan)

    def publish(self, plan: InspectionPlan) -> None:
        """Take in the plan of the whole run, and tell of it."""
        self.best = plan
        self._callbacks.best(plan)

    def proven(self, run: SearchRun, settings: Sequence[SensorSetting]) -> Needed:
        """Return the bound that holds for what settings inspect, and what it rests on."""
        if not settings:
            return Needed(0, "No entity is inspected.")
        seen = np.isin(run.names, [name for setting in settings for name in setting.entities])
        of_whole = _largest(self._proofs.values(), seen)
        if not may_split(run):
            return of_whole
        proofs = [] if self._proof_of_ends is None else [self._proof_of_ends]
        return _largest(proofs, seen)._replace(of_whole=of_whole.n)


def _evenly(poses: NDArray[np.float64], n_entities: int) -> NDArray[np.float64]:
    """Return as many poses, evenly, as are judged for so many entities at a glance."""
    n_poses = max(_GLANCE_PAIRS // n_entities, 1)
    if len(poses) <= n_poses:
        return poses
    return poses[np.linspace(0, len(poses) - 1, n_poses).astype(int)]


def _of_exclusion(run: SearchRun, names: Sequence[str]) -> ProvenBound:
    """Return the bound of targets that exclude each other."""
    n = len(names)
    return ProvenBound(n, exclusion_proof(run.problem, n), np.isin(run.names, names))


def _largest(proofs: Iterable[ProvenBound], seen: NDArray[np.bool_]) -> Needed:
    """Return the largest bound that proofs give for some targets (k,)."""
    for_these = [Needed(bound.for_some(seen), bound.proof) for bound in proofs]
    return max([Needed(1, TRIVIAL), *for_these], key=lambda needed: needed.n)


def _worth(plan: InspectionPlan) -> tuple[int, int]:
    """Return what the better one has more of."""
    return len(plan.promises), -len(plan.settings)
