"""How far a planning has got: all that its stages hand on, in one value that packs itself for the state file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.columns.candidates import Pools
from planner.columns.pool import ColumnPool
from planner.plan import InspectionPlan
from planner.setting.reason import Reason, kinds_record, reasons_from


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
        How far this stage has got; empty at its beginning. See `planner.checkpoint.Checkpoint`.
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
        Their weights, where such prove it; see `planner.bound.proven.ProvenBound`.
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
        """Return the fields as values that `planner.records.packing.packed` takes; arrays are not copied."""
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
