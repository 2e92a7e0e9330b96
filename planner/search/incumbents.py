"""The best plan so far, while a run goes on: an upper bound that can be used at once.

An incumbent is a whole plan: a cover by the columns found so far, each with the candidate pose it was found at,
supported by simulation. It is told of whenever it or its bound gets better. Nothing in a run depends on it, so a run
that is watched ends with the same plan as one that is not.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.bound.dual_bound import ProvenBound
from planner.bound.lower_bound import exclusion_proof
from planner.callbacks import LEAST_SEARCH_S, Callbacks
from planner.cover.few_columns import exchange_columns
from planner.cover.set_cover import bound_columns, greedy_cover
from planner.plan import InspectionPlan
from planner.request.reach import PoseRegion
from planner.request.request import Request, witness_reasons
from planner.request.targets import Target
from planner.search.candidates import derive_seed, first_poses
from planner.search.judge import ColumnPool, Judgement
from planner.search.plan_setting import setting_at, without
from planner.search.run import SILENT_S, Run
from planner.sensor_setting import Reason, ReasonKind, SensorSetting
from planner.travel import order_by, pose_distances
from planner.verify.setting_record import search_windows_px

# Which other lines a detector may take for an edge: visible ones where the edge has to be looked
# for.


def with_lines_in_windows(plan: InspectionPlan, request: Request) -> InspectionPlan:
    """Return a plan whose settings tell of other visible lines in the search windows of targets.

    Lines that leave an edge's own ends at the angle asked for are no such lines: their direction tells them apart.
    Beside lines and circles that are fitted, a fifth of the points may have such lines.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    request : Request
        What it answers; where it asks nothing of images, the plan is returned as it is.
    """
    showing = request.requirements.showing
    if showing.asks_nothing or not plan.settings:
        return plan
    windows = [search_windows_px(plan, setting) for setting in plan.settings]
    # all are looked for as far as the widest window
    widest = max(max(one.values()) for one in windows)
    settings = []
    for setting, window in zip(plan.settings, windows, strict=True):
        # of witnesses, each setting has its own
        own = request.at_pose(setting.cam2world, setting.entities)
        check = own.constraints.image_check(replace(showing, separation_px=widest))
        wanted = np.ones((1, len(own.names)), bool)
        apart = check.separations(setting.cam2world[None], wanted, 0.0)[0] + widest
        near = dict(zip(own.names, apart.tolist(), strict=True))
        lines = {name: near[name] for name in setting.entities if near[name] < window[name]}
        settings.append(replace(setting, lines_in_window_px=lines))
    return replace(plan, settings=tuple(settings))


# In plans for a robot cell: in which fixturing each setting is taken, by which joints, and in
# which order.


# all choices of so many fixturings are tried; there are seldom more than three
_MOST_TRIED = 12


def in_order_of_arm(
    request: Request, settings: Sequence[SensorSetting], *, unfinished: bool
) -> list[SensorSetting]:
    """Return settings with fixturing and joints: the fewest fixturings that do, one after the other.

    Parameters
    ----------
    request : Request
        Has a cell.
    settings : sequence of SensorSetting
        All of them are reached.
    unfinished : bool
        A better plan follows, so the order is not worth seconds.
    """
    cell = request.requirements.cell
    assert cell is not None
    placed = [
        cell.placed(
            one.cam2world, request.at_pose(one.cam2world, one.entities).constraints.segments
        )
        for one in settings
    ]
    chosen = fewest_fixturings([set(ways) for ways in placed], list(cell.to_dict()["fixturings"]))
    result: list[SensorSetting] = []
    for name in chosen:
        group = [
            _standing(setting, name, ways[name])
            for setting, ways in zip(settings, placed, strict=True)
            if next((one for one in chosen if one in ways), "") == name
        ]
        result += _ordered(cell, group, name, unfinished)
    # what a cell forbids after all is told by the plan's reachability
    result += [one for one, ways in zip(settings, placed, strict=True) if not ways]
    return result


def fewest_fixturings(ways: Sequence[set[str]], every: Sequence[str]) -> tuple[str, ...]:
    """Return the fewest of all names such that each set that is not empty holds one; the first of equal choices.

    Beyond a dozen names, they are chosen greedily.
    """
    left = [names for names in ways if names]
    if len(every) <= _MOST_TRIED:
        for count in range(len(every) + 1):
            for chosen in combinations(every, count):
                if all(names.intersection(chosen) for names in left):
                    return chosen
    picked: list[str] = []
    while left:
        best = max(every, key=lambda name: sum(name in names for names in left))
        picked.append(best)
        left = [names for names in left if best not in names]
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
    seconds = cell.travel_seconds(np.array([one.axes for one in group]), fixturing)
    order = order_by(seconds, kicks=0) if unfinished else order_by(seconds)
    return [group[i] for i in order]


# Putting a plan together from settings, at the end of a run or on the way.


# of entities that have neither a pose nor a reason for that yet
_NOT_YET = Reason.of(ReasonKind.NOT_FOUND_YET, "planning stopped early.")

_LATE = Reason.of(
    ReasonKind.NOT_FOUND_YET,
    "the time limit ended before the program knew from where it is visible.",
)


def assembled(
    run: Run,
    settings: Sequence[SensorSetting],
    bound: int,
    proof: str,
    *,
    unfinished: bool = False,
) -> InspectionPlan:
    """Put the plan together, its settings in the order of travel.

    Parameters
    ----------
    run : Run
        Its request, and its reasons for what is not inspected.
    settings : sequence of SensorSetting
    bound : int
        Settings that are needed at least.
    proof : str
        What that rests on.
    unfinished : bool
        The run goes on.
    """
    request = run.request
    # a later run may have come across a view of one that had none of its own
    seen = {name for setting in settings for name in setting.entities}
    if not unfinished:
        settings = [with_passed_over(request, setting) for setting in settings]
    cell = request.requirements.cell
    late = _late_names(run)
    plan = InspectionPlan(
        request=run.asked,
        settings=tuple(_in_order(request, settings, unfinished)),
        lower_bound=bound,
        bound_proof=proof,
        uninspectable={**_reasons(run, unfinished, seen), **dict.fromkeys(late, _LATE)},
        unfinished=unfinished or bool(late),
        cell={} if cell is None else cell.to_dict(),
    )
    return with_lines_in_windows(plan, request)


def with_passed_over(request: Request, setting: SensorSetting) -> SensorSetting:
    """Return a setting that says why it uses none of the other witnesses of its targets."""
    if not setting.witness:
        return setting
    some = request.restricted_to(list(setting.witness))
    why = witness_reasons(some.witnesses, setting.cam2world)
    over = {
        target.name: {
            ", ".join(witness.entities): reason
            for k, (witness, reason) in enumerate(zip(target.witnesses, reasons, strict=True))
            if k != setting.witness[target.name]
        }
        for target, reasons in zip(some.targets, why, strict=True)
    }
    return replace(setting, passed_over=over)


def _in_order(
    request: Request, settings: Sequence[SensorSetting], unfinished: bool
) -> Sequence[SensorSetting]:
    """Return settings in the order of travel, by the joints of a robot where there is one."""
    if request.requirements.cell is not None:
        return in_order_of_arm(request, settings, unfinished=unfinished)
    # a better plan follows soon, so its travel is not worth seconds
    distances = pose_distances(np.array([s.cam2world for s in settings]).reshape(-1, 4, 4))
    order = order_by(distances, kicks=0) if unfinished else order_by(distances)
    return [settings[i] for i in order]


def needed(target: Target) -> set[str]:
    """Return the names of all entities whose regions a target needs."""
    return {name for witness in target.witnesses for name in witness.entities}


def _reasons(run: Run, unfinished: bool, seen: set[str]) -> dict[str, Reason]:
    """Return why entities are not inspected, in the order in which that was found out."""
    reasons = dict(run.state.uninspectable)
    if unfinished:
        reasons = {name: reasons.get(name, _NOT_YET) for name in run.names}
    return {name: reason for name, reason in reasons.items() if name not in seen}


def _late_names(run: Run) -> list[str]:
    """Return the targets whose region was not complete in time."""
    return [target.name for target in run.asked.targets if target.name not in run.names]


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
        self, run: Run, pool: ColumnPool, beaten: tuple[int, int], covers: int | None = None
    ) -> list[SensorSetting] | None:
        """Choose few columns of a pool that simulation supports, for as many entities as possible.

        Parameters
        ----------
        run : Run
            Its request says what is asked, its seed how poses are displaced.
        pool : ColumnPool
        beaten : (int, int)
            Entities of a plan known, and minus its settings: what is not better is not looked for further.
        covers : int
            Covers that are simulated at most. Default: as many as the effort says.

        Returns
        -------
        list of SensorSetting or None
            None if none better was found.
        """
        trying = run.effort.stages.trying
        covers = trying.covers if covers is None else covers
        membership, done = self._corrected(run, pool)
        chosen = _short_cover(membership, beaten, run.rng("incumbent"), trying.exchanges)
        for k in range(covers):
            if chosen is None:
                return None
            new = [c for c in chosen.tolist() if not done[c]]
            if not new:
                break
            begun = time.monotonic()
            untried = [c for c in new if _key(run, pool, c) not in self._tried]
            for i, _ in enumerate(run.simulate(candidate_settings(run, pool, untried)), 1):
                # what is soon done needs no line
                if time.monotonic() - begun > SILENT_S:
                    run.callbacks.report(i, len(untried), "checked poses")
            for c in new:
                membership[c] = self._supported(run, pool, c)
                done[c] = True
            self._give_up(run, membership, done)
            if k + 1 < covers:
                chosen = _short_cover(membership, beaten, run.rng("incumbent"), trying.exchanges)
            known = np.where(done[:, None], membership, False)
            own = _short_cover(known, beaten, run.rng("incumbent"), trying.exchanges)
            if k + 1 == covers or (
                own is not None and chosen is not None and _as_good(membership, own, chosen)
            ):
                chosen = own
        return None if chosen is None else self._as_settings(run, pool, chosen)

    def _corrected(self, run: Run, pool: ColumnPool) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return the columns of a pool (c, k) as far as they are known to be supported, and which (c,) were tried."""
        membership = pool.membership.copy()
        done = np.zeros(len(pool), dtype=bool)
        for c in range(len(pool) if self._tried else 0):
            if _key(run, pool, c) in self._tried:
                membership[c] = self._supported(run, pool, c)
                done[c] = True
        self._give_up(run, membership, done)
        return membership, done

    def _give_up(self, run: Run, membership: NDArray[np.bool_], done: NDArray[np.bool_]) -> None:
        """Clear the edges that no pose tried supports, although many promise them."""
        in_vain = run.effort.stages.trying.in_vain
        often = np.array([self._in_vain[name] >= in_vain for name in run.names])
        membership[:, often & ~membership[done].any(axis=0)] = False

    def _supported(self, run: Run, pool: ColumnPool, c: int) -> NDArray[np.bool_]:
        """Return which entities (k,) of a column simulation supports; it is tried if it was not."""
        key = _key(run, pool, c)
        if key not in self._tried:
            supported = as_simulated(run, candidate_settings(run, pool, [c]))
            tried = supported[0] if supported else None
            self._tried[key] = tried
            self._in_vain.update(set(key[1]) - set(_entities(tried)))
        return np.isin(run.names, _entities(self._tried[key]))

    def _as_settings(
        self, run: Run, pool: ColumnPool, chosen: NDArray[np.int_]
    ) -> list[SensorSetting]:
        tried = [self._tried[_key(run, pool, c)] for c in chosen.tolist()]
        return [setting for setting in tried if setting is not None]


def candidate_settings(run: Run, pool: ColumnPool, columns: Iterable[int]) -> list[SensorSetting]:
    """Return the poses of columns as settings."""
    wanted = [(pool.poses[c], run.names_of(pool.membership[c])) for c in columns]
    return [
        setting_at(run.request, pose, names, "candidate pose", seed=derive_seed(run.seed, names))
        for pose, names in wanted
    ]


def as_simulated(run: Run, settings: Iterable[SensorSetting]) -> list[SensorSetting]:
    """Return settings that state what simulation does not contradict; those that state nothing are left out."""
    supported = []
    for setting in settings:
        wrong = run.promises.contradicted_in(setting)
        kept = without(run.request, setting, list(wrong)) if wrong else setting
        supported.append(run.promises.with_bounds(kept))
    return [setting for setting in supported if setting.entities]


def _key(run: Run, pool: ColumnPool, c: int) -> tuple[bytes, tuple[str, ...]]:
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
    known = beaten[0]
    fewer_than = -beaten[1]
    if not covered.any() or covered.sum() < known:
        return None
    chosen: NDArray[np.int_] | None = None
    if covered.sum() > known:
        chosen = np.array(greedy_cover(membership))
        fewer_than = len(chosen)
    fewest = bound_columns(membership)
    while fewer_than > fewest:
        found = exchange_columns(membership, fewer_than - 1, steps=steps, rng=rng)
        if found.missing:
            break
        chosen = found.chosen
        fewer_than = len(found.chosen)
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
_TRIVIAL = "Fewer settings than one inspect nothing; the proof of a larger bound had not begun."
SO_FAR = (
    "Covering by optimistic columns, boxes of camera poses checked against necessary conditions (visibility, focus, "
    "sensor size, length of the image), as far as the proof had got."
)


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
        self._columns = SupportedColumns()
        self._begun = time.monotonic()
        self._spent_s = 0.0
        self._offer_again = self._begun + LEAST_SEARCH_S

    def glance(self, run: Run) -> None:
        """Make a plan of very few poses, so that there is one at once; the run does not take these poses in."""
        deadline = self._callbacks.deadline
        # how long a direction takes
        each = 0.0
        for directions in (
            run.effort.stages.improving.directions if self._callbacks.wants_plans else ()
        ):
            begun = time.monotonic()
            # candidate poses make more of the time than a second glance that would take most of it
            left = deadline.seconds_left()
            if left is None and self.best is not None:
                break
            if left is not None and each * directions > max(LEAST_SEARCH_S, left / 2):
                break
            pool = ColumnPool(len(run.names))
            poses = first_poses(run.judge, directions, run.seed)
            judged = self._judged_in_parts(run, poses)
            pool.add(judged.inspects, poses, judged.probability)
            self._offer(run, pool, covers=1)
            if self.best is not None:
                deadline.arm_soon()
            each = (time.monotonic() - begun) / directions
        self._offer_again = time.monotonic() + LEAST_SEARCH_S

    def _judged_in_parts(self, run: Run, poses: NDArray[np.float64]) -> Judgement:
        """Judge poses as many at a time as the judge does itself, and report between."""
        size = run.effort.nearness.batch
        parts = [run.judge(poses[:0])]
        for first in range(0, len(poses), size):
            parts.append(run.judge(poses[first : first + size]))
            self._callbacks.report(first + len(parts[-1].inspects), len(poses), "first poses")
        return Judgement.joined(parts)

    def offer_on_the_way(self, run: Run) -> None:
        """Where the time is limited, see now and then what the columns of an unfinished stage are good for."""
        if not self._callbacks.deadline.limited:
            return
        now = time.monotonic()
        if now >= self._offer_again:
            self.offer(run)
            took = time.monotonic() - now
            self._offer_again = now + took + max(LEAST_SEARCH_S, _OFFERS_APART * took)

    def offer(self, run: Run) -> None:
        """See whether the columns of a run make a better plan."""
        if self._callbacks.wants_plans and run.pool.membership.any() and self._is_affordable():
            self._offer(run, run.pool)
            if self.best is not None:
                self._callbacks.deadline.arm()

    def _is_affordable(self) -> bool:
        """Return whether another plan on the way keeps to its share of the time, where the time is not limited."""
        if self._callbacks.deadline.limited or self.best is None:
            return True
        return self._spent_s <= max(_FREE_S, _SHARE * (time.monotonic() - self._begun))

    def _offer(self, run: Run, pool: ColumnPool, covers: int | None = None) -> None:
        """See whether the columns of a pool make a better plan."""
        begun = time.monotonic()
        cover = self._columns.cover(
            run, pool, (0, 0) if self.best is None else _worth(self.best), covers
        )
        if cover:
            bound, proof = self.proven(run, cover)
            plan = assembled(run, cover, bound, proof, unfinished=True)
            if self.best is None or _worth(plan) > _worth(self.best):
                self.publish(plan)
        self._spent_s += time.monotonic() - begun

    def on_bound(self, run: Run, proven: ProvenBound) -> None:
        """Take in a bound that was proven for some entities."""
        self._callbacks.bound(proven.n, proven.weights)
        self._proofs[proven.proof] = proven
        if self.best is not None:
            known, proof = self.proven(run, self.best.settings)
            if known > self.best.lower_bound:
                self.publish(replace(self.best, lower_bound=known, bound_proof=proof))

    def on_incompatible(self, run: Run) -> None:
        """Take in the bound of entities that exclude each other, if some are known."""
        incompatible = run.state.incompatible
        n = len(incompatible)
        if n > 1:
            seen = np.isin(run.names, incompatible)
            self.on_bound(run, ProvenBound(n, exclusion_proof(run.request, n), seen))

    @property
    def latest(self) -> InspectionPlan:
        """The best plan, once there is one."""
        assert self.best is not None
        return self.best

    def publish(self, plan: InspectionPlan) -> None:
        """Take in the plan of the whole run, and tell of it."""
        self.best = plan
        self._callbacks.best(plan)

    def proven(self, run: Run, settings: Sequence[SensorSetting]) -> tuple[int, str]:
        """Return the bound that holds for what settings inspect, and what it rests on."""
        if not settings:
            return 0, "No entity is inspected."
        seen = np.isin(run.names, [name for setting in settings for name in setting.entities])
        for_these = [(one.for_some(seen), one.proof) for one in self._proofs.values()]
        return max([(1, _TRIVIAL), *for_these], key=lambda one: one[0])


def _worth(plan: InspectionPlan) -> tuple[int, int]:
    """Return what the better one has more of."""
    return len(plan.inspected), -len(plan.settings)
