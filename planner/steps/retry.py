"""Another try for targets that lack the required P_all in the final settings, before they are given up.

In this order, and only as long as some are left:

1. The poses of the other settings: one of them may measure the target as well.
2. The poses of other columns that contain it, as simulation supports them.
3. A setting of its own, searched for it alone.

Poses that were added are moved off their limits like all others. What is still short then is lost; the largest P_all
that was found on the way is what its reason states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from planner.columns.centre_column import with_p_all
from planner.columns.realise_column import joint_bounds, keeps
from planner.setting.pose_setting import setting_at, without
from planner.setting.sensor_setting import SensorSetting
from planner.steps.run import Run
from planner.steps.supported_columns import as_simulated, candidate_settings

Centre = Callable[[list[SensorSetting]], list[SensorSetting]]


class ShortTargets:
    """Targets that lack the required P_all, and where they may have it.

    Parameters
    ----------
    run : Run
        Its request says what is asked, its pool has other columns, its effort says how many are tried.
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
        run: Run,
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
            own = judge.names.index(name)
            bounds = {}
            for k, setting in enumerate(self.settings):
                if judge(setting.cam2world[None]).inspects[0, own]:
                    found = joint_bounds(judge, setting.cam2world, (name,), self._run.seed)
                    bounds[k] = found[name][0]
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
            run.request, setting.cam2world, names, setting.message, setting.seed, setting.nfev
        )
        poses = max(setting.p_all_poses, run.effort.support.joint_poses)
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
        left = short.copy()
        tried = np.zeros(len(run.names), dtype=int)
        proposed = []
        for c in rows.tolist():
            wanted = columns[c] & left & (tried < run.effort.support.retried)
            if not wanted.any():
                continue
            tried += wanted
            run.callbacks.deadline.check()
            (candidate,) = candidate_settings(run, run.pool, [c])
            others = [n for n in candidate.entities if n not in run.names_of(wanted)]
            for one in as_simulated(run, [without(run.request, candidate, others)]):
                left &= ~np.isin(run.names, one.entities)
                proposed.append(one)
        return proposed

    def _own_settings(self) -> list[SensorSetting]:
        """Return the best poses that a search for each of the targets alone finds."""
        run = self._run
        sets = [(name,) for name in self.reached]
        found = [one.setting for one in run.realise(sets)]
        supported = run.supported([[one] for one in found if one is not None])
        return [one.setting for one in supported]

    def _add(self, settings: Sequence[SensorSetting]) -> None:
        """Take the settings in, for the targets that have the required P_all there and were short."""
        for one in settings:
            for name, p in one.p_all.items():
                self._reach(name, p)
            useless = [
                name
                for name in one.entities
                if name not in self.reached or not keeps(self._run.judge, one.p_all[name])
            ]
            kept = without(self._run.request, one, useless) if useless else one
            if kept.entities:
                self.settings.append(kept)
            for name in kept.entities:
                del self.reached[name]

    def _reach(self, name: str, p_all: float) -> None:
        if name in self.reached:
            self.reached[name] = max(self.reached[name], p_all)
