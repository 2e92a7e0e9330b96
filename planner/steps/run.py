"""One planning run: the request, the pools of columns, and what every step needs of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any

import numpy as np

from planner.callbacks import NOBODY, Callbacks
from planner.checkpoint import Checkpoint
from planner.columns.candidates import Pools, derive_seed
from planner.columns.judge import Judge
from planner.columns.outcome import Outcome
from planner.columns.pool import ColumnPool
from planner.columns.realise_column import (
    PosedOnly,
    joint_bounds,
    missing,
    promised_too_much,
    realise,
    supported_pose,
)
from planner.effort.effort import Effort
from planner.executors import Shared, in_order
from planner.request.request import Request
from planner.resume import PlanningState
from planner.setting.sensor_setting import SensorSetting
from planner.steps.plan_state import PlanState

# seconds after which the checking of poses is shown
SILENT_S = 1.0


class Run:
    """One planning run: the pools of columns that the steps fill.

    Parameters
    ----------
    request : Request
        What is asked.
    seed : int
        The plan's seed.
    effort : Effort
        How long to search.
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
        request: Request,
        seed: int,
        effort: Effort,
        memo: PlanningState,
        *,
        executor: Executor | None = None,
        callbacks: Callbacks = NOBODY,
    ):
        self.request = request
        self.judge = Judge(request, effort)
        self.names = request.names
        self.shared = Shared(self.judge)
        self.seed = seed
        self.effort = effort
        self.memo = memo
        self.executor = executor
        self.callbacks = callbacks
        last = memo.last()
        self.state = PlanState.empty(len(self.names)) if last is None else PlanState.unpack(last)
        self._begun = 0
        # by how much simulation contradicts what is stated of an entity from a pose
        self._excess: dict[tuple[bytes, str, float], float] = {}
        # lower bound of P_all of an entity from a pose, and over how many displaced poses
        self._bounds: dict[tuple[bytes, str], tuple[float, int]] = {}

    @property
    def pools(self) -> Pools:
        """Columns found so far."""
        return self.state.pools

    @property
    def pool(self) -> ColumnPool:
        """Columns that poses inspect."""
        return self.state.pools.realised

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

    def contradicted_in(self, setting: SensorSetting) -> dict[str, float]:
        """Return the entities of a setting that simulation contradicts or that lack P_all, and by how much.

        Each promise is simulated once, and what comes out depends on nothing else that is stated of its pose, nor on
        what was simulated before.
        """
        pose = setting.cam2world.tobytes()
        stated = {name: setting.probability[name] for name in setting.entities}
        new = [name for name in stated if (pose, name, stated[name]) not in self._excess]
        # edges see the same displaced poses, whichever they are; a dimension is displaced by draws of its own
        own = [name for name in new if not self.request.find_target(name).in_image]
        for names in (tuple(name for name in new if name not in own), *((name,) for name in own)):
            if names:
                some = PosedOnly(setting.cam2world, names, {name: stated[name] for name in names})
                wrong = promised_too_much(self.judge, some, self.seed)
                self._excess.update(
                    {(pose, name, stated[name]): wrong.get(name, 0.0) for name in names}
                )
        kept = tuple(name for name in new if self._excess[pose, name, stated[name]] <= 0.0)
        if kept:
            bounds = joint_bounds(self.judge, setting.cam2world, kept, self.seed)
            self._bounds.update({(pose, name): bound for name, bound in bounds.items()})
            short = missing(self.judge, bounds)
            self._excess.update({(pose, name, stated[name]): short[name] for name in short})
        found = {
            name: self._excess[pose, name, probability] for name, probability in stated.items()
        }
        return {name: too_much for name, too_much in found.items() if too_much > 0.0}

    def with_bounds(self, setting: SensorSetting) -> SensorSetting:
        """Return a setting that states the P_all which `contradicted_in` counted for its entities."""
        pose = setting.cam2world.tobytes()
        if not all((pose, name) in self._bounds for name in setting.entities):
            return setting
        found = {name: self._bounds[pose, name] for name in setting.entities}
        stated = {name: min(lower, setting.probability[name]) for name, (lower, _) in found.items()}
        # what is missed by one at least is missed by no more than all of them miss
        together = max(1.0 - sum(1.0 - p for p in stated.values()), 0.0)
        poses = min((n for _, n in found.values()), default=0)
        return replace(setting, p_all=stated, p_all_together=together, p_all_poses=poses)

    def accept(self, outcome: Outcome) -> tuple[str, ...]:
        """Add what a run of the genetic algorithm achieved to the pool; return the entities it inspects."""
        if outcome.setting is None:
            return ()
        pose = outcome.setting.cam2world[None]
        judged = self.judge(pose)
        self.pool.add(judged.inspects, pose, judged.probability)
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
            self.callbacks.report(done, self._begun, "genetic algorithm")
        outcomes = (self.memo.get(names) for names in sets)
        return [outcome for outcome in outcomes if outcome is not None]

    def supported(self, options: Sequence[Sequence[SensorSetting]]) -> list[SensorSetting]:
        """Return for each of some settings the best of its options that simulation supports; see `best_supported`."""
        tasks = [
            (self.shared, some, derive_seed(self.seed, some[0].entities), len(options))
            for some in options
        ]
        found = []
        begun = time.monotonic()
        for one in in_order(self.executor, supported_pose, tasks, self.callbacks.check):
            found.append(one)
            # what is soon done needs no line
            if time.monotonic() - begun > SILENT_S:
                self.callbacks.report(len(found), len(tasks), "checked poses")
        return found

    def _start(self, names: Sequence[str]) -> np.ndarray | None:
        """Return the candidate pose (1, 4, 4) that inspects, or nearly inspects, a set of entities."""
        for pool in self.pools:
            best = pool.best_containing(np.isin(self.names, names))
            if best is not None:
                return pool.poses[best : best + 1]
        return None
