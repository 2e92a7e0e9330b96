"""A plan from poses that exist: the fewest of them that inspect all that any of them inspects.

No pose is searched or moved. Every pose is judged and simulated, as the poses of any plan are, which
gives a column: what it inspects as surely as required. An integer program chooses the fewest columns
and proves that no fewer do. Where counts over more displaced poses take a target from a column that
was chosen, it is chosen again without. With lamps, a column first holds only what a lamp shows there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.camera.pose import GivenPose
from planner.cover import Cover, min_cover
from planner.light.lighting import Lighting
from planner.light.plan_light import chosen_lamps
from planner.plan import InspectionPlan
from planner.request.problem import Problem, why_missed, witness_states
from planner.search.columns import derive_seed
from planner.search.evolution import Centring
from planner.search.incumbents import SearchRun, as_simulated, assembled
from planner.search.lit_poses import lamp_places, shown_by_lamps
from planner.search.plan_setting import setting_at, without
from planner.search.realise_column import MEANING, keeps, without_corners
from planner.search.stages import centre_all
from planner.sensor_setting import Reason, ReasonKind, SensorSetting

# so long the integer program may take; a plan depends on the clock only beyond
_LONGEST_S = 600.0


class GivenColumns:
    """What each given pose inspects, as far as simulation supports it.

    Parameters
    ----------
    run : SearchRun
        Its request holds the poses.

    Attributes
    ----------
    settings : list of SensorSetting
        Of the poses that inspect something.
    membership : array of bool (n, k)
        What each inspects.
    reached : dict of str to float
        The largest P_all of targets that lacked it somewhere.
    """

    def __init__(self, run: SearchRun) -> None:
        self._run = run
        self.reached: dict[str, float] = {}
        self.settings = as_simulated(run, self._candidates())
        self.membership = np.array(
            [np.isin(run.names, setting.entities) for setting in self.settings], dtype=bool
        ).reshape(-1, len(run.names))

    def _candidates(self) -> list[SensorSetting]:
        run = self._run
        poses = poses_of(run)
        judged = run.judge(np.array([pose.cam2world for pose in poses]))
        candidates = [
            setting_at(
                run.problem,
                pose.cam2world,
                names,
                f"given pose {pose.name}",
                seed=derive_seed(run.seed, names),
            )
            for pose, inspects in zip(poses, judged.inspects, strict=True)
            if (names := run.names_of(inspects))
        ]
        for k, _ in enumerate(run.simulate(candidates), 1):
            run.callbacks.report(k, len(candidates), "given poses")
        return candidates

    def cover(self, shown: NDArray[np.bool_]) -> tuple[list[SensorSetting], Cover]:
        """Return the fewest settings that contain all that some column contains, and the proof.

        Parameters
        ----------
        shown : array of bool (n, k)
            What of the columns counts.
        """
        run = self._run
        while True:
            columns = self.membership & shown
            covered = columns.any(axis=0)
            if not covered.any():
                return [], Cover((), 0)
            quality = np.array([item.fitness / len(item.entities) for item in self.settings])
            cover = min_cover(columns[:, covered], quality, time_limit_s=_LONGEST_S)
            settled = self._counted(cover.chosen)
            if all(
                set(setting.entities) == set(self.settings[c].entities)
                for c, setting in zip(cover.chosen, settled, strict=True)
            ):
                return settled, cover
            for c, setting in zip(cover.chosen, settled, strict=True):
                self.settings[c] = setting
                self.membership[c] = np.isin(run.names, setting.entities)

    def _counted(self, chosen: Sequence[int]) -> list[SensorSetting]:
        """Return chosen settings with the P_all of a plan, without what lacks it."""
        still = Centring.of(self._run.effort)._replace(give_up=0.0)
        settings = [self.settings[c] for c in chosen]
        return [self._sure(setting) for setting in centre_all(self._run, settings, still)]

    def _sure(self, setting: SensorSetting) -> SensorSetting:
        short = [name for name, p in setting.p_all.items() if not keeps(self._run.judge, p)]
        for name in short:
            self.reached[name] = max(setting.p_all[name], self.reached.get(name, 0.0))
        return without(self._run.problem, setting, short) if short else setting


def poses_of(run: SearchRun) -> tuple[GivenPose, ...]:
    """Return the poses that the request of a run gives."""
    assert run.request.poses is not None
    return run.request.poses


def plan_of_given(run: SearchRun, lighting: Lighting | None = None) -> InspectionPlan:
    """Return the plan of the fewest given poses.

    **Guarantee.** Its settings are given poses, unmoved. They inspect each target that a given pose
    inspects as surely as required. If the integer program ends within its time, no fewer given poses
    do.

    Parameters
    ----------
    run : SearchRun
        Its request holds the poses.
    lighting : Lighting, optional
        What is asked of lamps. Targets that a lamp shows in a given pose are covered by poses in
        which one shows them.
    """
    columns = GivenColumns(run)
    everything = np.ones_like(columns.membership)
    settings, cover = columns.cover(everything)
    plan = _assembled(run, columns, settings, cover)
    if lighting is None or not settings:
        return plan
    lighting = lighting.on_part(run.problem.space.solid, plan.camera)
    lit = _lit(run, lighting, plan)
    if not lit.unlit or lighting.together:
        return lit
    places = lamp_places(lighting, lit)
    shown = shown_by_lamps(run, lighting, lit, columns.settings, places)
    seen = np.array([np.isin(run.names, sorted(names)) for names in shown])
    # a cover has all targets; those that no lamp shows anywhere are left out of the plan afterwards
    seen[:, ~(seen & columns.membership).any(axis=0)] = True
    others, proven = columns.cover(seen)
    other = _lit(run, lighting, _assembled(run, columns, others, proven))
    return other if len(other.unlit) < len(lit.unlit) else lit


def _lit(run: SearchRun, lighting: Lighting, plan: InspectionPlan) -> InspectionPlan:
    solid = run.problem.space.solid
    silent = run.callbacks.silent.report
    lamps = chosen_lamps(
        lighting, plan, solid, silent, reads=run.problem.reads, executor=run.executor
    )
    return replace(plan, light=lamps)


def _assembled(
    run: SearchRun, columns: GivenColumns, settings: Sequence[SensorSetting], cover: Cover
) -> InspectionPlan:
    inspected = {name for setting in settings for name in setting.entities}
    missing = [name for name in run.names if name not in inspected]
    poses = poses_of(run)
    tangent = without_corners(run.judge)
    run.state.uninspectable = {
        name: tangent.get(name) or reason_of(run.problem, poses, name, columns.reached.get(name))
        for name in missing
    }
    n = len(poses)
    proof = (
        f"An integer program over the {n} given poses, with what each inspects: no fewer of them inspect "
        "the same targets. Other poses were not searched."
    )
    if not cover.optimal:
        proof = f"An integer program over the {n} given poses, which ended before its proof was complete."
    return assembled(run, settings, cover.lower_bound, proof if settings else "")


def reason_of(
    problem: Problem,
    poses: Sequence[GivenPose],
    name: str,
    reached: float | None = None,
) -> Reason:
    """Return why no given pose inspects a target: the nearest miss.

    Parameters
    ----------
    problem : Problem
        What is asked.
    poses : sequence of GivenPose
        All of them.
    name : str
        The target.
    reached : float, optional
        The largest P_all that was counted, if it was.
    """
    nearest = nearest_miss(problem, poses, name)
    required = problem.probability
    if nearest.share > 0.0:
        kind = MEANING.get(nearest.constraint, ReasonKind.NO_FEASIBLE_VIEW)
        if kind is ReasonKind.UNOBSERVABLE:
            # other poses may see it
            kind = ReasonKind.IN_VIEW_FROM_NO_POSE_TRIED
        why = why_missed(nearest.constraint, nearest.amount)
        text = f"no given pose meets all constraints; {nearest.pose} is nearest: {why}."
        return Reason.of(kind, text)
    value = f"P = {nearest.probability:.4f}"
    if reached is not None:
        value = f"P_all = {reached:.4f}"
    text = f"the best given pose, {nearest.pose}, reaches {value}, below the required {required:g}."
    return Reason.of(ReasonKind.PROBABILITY_TOO_LOW, text)


class NearestMiss(NamedTuple):
    """The pose that comes nearest to inspecting a target, and what it misses.

    Attributes
    ----------
    pose : str
        Its name.
    share : float
        How far the worst constraint is missed, as a share of its scale; 0 if all are met.
    probability : float
        P where all are met, else 0.
    constraint : str
        The worst constraint.
    amount : float
        By how much it is missed, in its unit.
    """

    pose: str
    share: float
    probability: float
    constraint: str
    amount: float


def nearest_miss(problem: Problem, poses: Sequence[GivenPose], name: str) -> NearestMiss:
    """Return the pose that misses a target by least; of those that meet all constraints the surest.

    Parameters
    ----------
    problem, poses, name
        As `reason_of` takes them.
    """
    witnesses = problem.restricted_to([name]).witnesses
    misses = []
    for pose in poses:
        states = witness_states(witnesses, pose.cam2world)
        best = int(np.lexsort((-states.probability, states.missed))[0])
        misses.append(
            NearestMiss(
                pose.name,
                float(states.missed[best]),
                float(states.probability[best]),
                states.worst[best],
                float(states.amount[best]),
            )
        )
    return min(misses, key=lambda miss: (miss.share, -miss.probability))
