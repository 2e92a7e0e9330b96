"""One planning run: the request, the pools of columns, and what every step needs of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.columns.candidates import Pools, derive_seed
from planner.columns.judge import Judge
from planner.columns.outcome import Outcome
from planner.columns.pool import ColumnPool
from planner.columns.realise_column import PosedOnly, promised_too_much, realise
from planner.executors import Shared, in_order
from planner.progress import Progress, report
from planner.request.effort import Effort
from planner.request.request import Request
from planner.resume import PlanningState
from planner.setting.reason import Reason, kinds_record, reasons_from
from planner.setting.sensor_setting import SensorSetting
from planner.watch import Watch


@dataclass(frozen=True)
class CoverShares:
    """Shares of `Effort.cover_nodes` for covers on the way to the last one.

    Attributes
    ----------
    refuting : float
        For each cover while optimistic columns are tried: there are many of them, and a cover that is not the best
        costs no more than a run of the genetic algorithm.
    """

    refuting: float = 0.1


SHARES = CoverShares()


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
    progress : callable, optional
        ``progress(done, total, label)``.
    watch : Watch, optional
        Tells when to end.
    """

    def __init__(
        self,
        request: Request,
        seed: int,
        effort: Effort,
        memo: PlanningState,
        *,
        executor: Executor | None = None,
        progress: Callable[..., Any] | None = None,
        watch: Watch | None = None,
    ):
        self.request = request
        self.judge = Judge(request)
        self.names = request.names
        self.shared = Shared(self.judge)
        self.seed = seed
        self.effort = effort
        self.memo = memo
        self.watch = watch or Watch()
        self.executor = executor
        self.progress = self.watch.watched(progress)
        self.pools = Pools(ColumnPool(len(self.names)), ColumnPool(len(self.names)))
        self.uninspectable: dict[str, Reason] = {}
        # entities of which no setting inspects two, as known so far
        self.incompatible: tuple[str, ...] = ()
        self._begun = 0
        # by how much simulation contradicts what is stated of an entity from a pose
        self._excess: dict[tuple[bytes, str, float], float] = {}

    @property
    def check(self) -> Callable[[], None] | None:
        """What may end long work, if anything may."""
        return self.watch.check if self.watch.limited else None

    @property
    def silent(self) -> Progress | None:
        """Progress of work that is not told of, but may be ended."""
        return self.watch.watched(None)

    @property
    def pool(self) -> ColumnPool:
        """Columns that poses inspect."""
        return self.pools.realised

    def keep(self, step: str, values: dict[str, Any]) -> None:
        """Take a checkpoint: all that the steps from here on depend on."""
        self.memo.keep(step, {**self._state(), **values})

    def _state(self) -> dict[str, Any]:
        """Return what every checkpoint holds."""
        return {
            "pools": self.pools.to_dict(),
            "uninspectable": dict(self.uninspectable),
            "uninspectable_kinds": kinds_record(self.uninspectable),
            "incompatible": self.incompatible,
        }

    def restore(self, last: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.pools = Pools.from_dict(last["pools"])
        kinds = last.get("uninspectable_kinds", {})
        self.uninspectable = reasons_from(last["uninspectable"], kinds)
        self.incompatible = tuple(last.get("incompatible", ()))

    def kept(self, step: str) -> dict[str, Any] | None:
        """Return the checkpoint if it was taken within this step, and not at its beginning."""
        last = self.memo.last()
        if last is None or last["step"] != step:
            return None
        return last if set(last) - {"step", *self._state()} else None

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
        """Return the entities that simulation contradicts in a setting, and by how much.

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
        found = {
            name: self._excess[pose, name, probability] for name, probability in stated.items()
        }
        return {name: too_much for name, too_much in found.items() if too_much > 0.0}

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
            todo, in_order(self.executor, realise, arguments, self.check), strict=True
        ):
            self.memo.put(names, outcome)
            done += 1
            report(self.progress, done, self._begun, "genetic algorithm")
        outcomes = (self.memo.get(names) for names in sets)
        return [outcome for outcome in outcomes if outcome is not None]

    def _start(self, names: Sequence[str]) -> np.ndarray | None:
        """Return the candidate pose (1, 4, 4) that inspects, or nearly inspects, a set of entities."""
        for pool in self.pools:
            best = pool.best_containing(np.isin(self.names, names))
            if best is not None:
                return pool.poses[best : best + 1]
        return None
