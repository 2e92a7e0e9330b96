"""One planning run: the request, the pools of columns, and what every step needs of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.callbacks import NOBODY, Callbacks, Checkpoint
from planner.executors import Shared, in_order
from planner.identity import InspectionRequest
from planner.plan import InspectionPlan
from planner.request.request import Request
from planner.resume import PlanningState
from planner.search.candidates import Pools, derive_seed
from planner.search.judge import ColumnPool, Judge
from planner.search.realise_column import (
    Promises,
    Supported,
    realise,
    simulate_promises,
    supported_pose,
)
from planner.sensor_setting import Outcome, Reason, SensorSetting, kinds_record, reasons_from

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
    weighing : Pools or None
        Columns that the weights of the proof come from, if they are not those of the plan.
    inspected : array of bool (k,) or None
        Targets that some column inspects: the bound and the settings are for these.
    known : int
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
        Their weights, where such prove it; see `planner.bound.dual_bound.ProvenBound`.
    plan : InspectionPlan or None
        The plan, without lamps at first.
    """

    pools: Pools
    stage: str = ""
    entries: dict[str, Any] = field(default_factory=dict)
    uninspectable: dict[str, Reason] = field(default_factory=dict)
    incompatible: tuple[str, ...] = ()
    weighing: Pools | None = None
    inspected: NDArray[np.bool_] | None = None
    known: int = 0
    joined: int = 0
    bound: int = 0
    proof: str = ""
    bound_of: NDArray[np.bool_] | None = None
    bound_weights: NDArray[np.float64] | None = None
    plan: InspectionPlan | None = None

    @classmethod
    def empty(cls, n_targets: int) -> PlanState:
        """Return the state in which nothing is known of k targets."""
        return cls(empty_pools(n_targets))

    def pack(self) -> dict[str, Any]:
        """Return the fields as values that `planner.plan_file.packed` takes; arrays are not copied."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        return {
            **values,
            "pools": self.pools.to_dict(),
            "weighing": None if self.weighing is None else self.weighing.to_dict(),
            "uninspectable": {name: str(reason) for name, reason in self.uninspectable.items()},
            "uninspectable_kinds": kinds_record(self.uninspectable),
            "plan": None if self.plan is None else self.plan.to_dict(),
        }

    @classmethod
    def unpack(cls, data: Mapping[str, Any]) -> PlanState:
        """Build from the result of `pack`, as it is or as it comes back from a file."""
        values = {one.name: data[one.name] for one in fields(cls)}
        plan = data["plan"]
        weighing = data["weighing"]
        return cls(
            **{
                **values,
                "pools": Pools.from_dict(data["pools"]),
                "weighing": None if weighing is None else Pools.from_dict(weighing),
                "uninspectable": reasons_from(data["uninspectable"], data["uninspectable_kinds"]),
                "incompatible": tuple(data["incompatible"]),
                "plan": None if plan is None else InspectionPlan.from_dict(plan),
            }
        )


def empty_pools(n_targets: int) -> Pools:
    """Return pools for k targets without columns."""
    return Pools(*(ColumnPool(n_targets) for _ in Pools._fields))


# seconds after which the checking of poses is shown
SILENT_S = 1.0


class Run:
    """One planning run: the pools of columns that the steps fill.

    Parameters
    ----------
    request : Request
        What is asked, with where its targets are observable.
    asked : InspectionRequest
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
        request: Request,
        asked: InspectionRequest,
        memo: PlanningState,
        *,
        executor: Executor | None = None,
        callbacks: Callbacks = NOBODY,
    ):
        self.request = request
        self.asked = asked
        self.seed = asked.seed
        self.effort = asked.effort
        self.judge = Judge(request, asked.effort)
        self.names = request.names
        self.shared = Shared(self.judge)
        self.promises = Promises(self.shared, asked.seed)
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
        for k, found in zip(new, results, strict=True):
            self.promises.take(settings[k], found)
            yield settings[k]

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

    def supported(self, options: Sequence[Sequence[SensorSetting]]) -> list[Supported]:
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
