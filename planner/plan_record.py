"""What plan files hold: the type of a field says what it may be, and the schema follows from the types."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ground.convert import LATER, Meta, Shape, from_plain, json_schema, shown
from planner.exceptions import PlanFileError
from planner.identity import Made, Request, restored_request
from planner.light.light_plan import LightRecord
from planner.plan_file import (
    Amount,
    Coordinates,
    Count,
    Names,
    Pixels,
    Pose,
    Reasons,
    check_format,
    check_plan,
)
from planner.request.target_records import TargetsByName, target_of
from planner.sensor_setting import Foreseen, ReasonKind, SensorSetting, SplitValue
from planner.verify.setting_record import Measurement
from planner.verify.simulate_plan import SimulationResult


class _Named(NamedTuple):
    """Names of the targets, in the order that was asked."""

    request: Mapping[str, Names]


_Three = Annotated[NDArray[np.float64], Shape(3), Coordinates]


@dataclass(frozen=True, eq=False)
class TableAxis:
    """TableAxis of a turntable in the base of the robot: a point, mm, and a unit vector."""

    point: _Three
    direction: _Three


@dataclass(frozen=True)
class CellRecord:
    """A robot cell, its digest, and ``part2base`` of each fixturing; on a turntable at the angle 0.

    With ``cam2base``, of a camera that stands still, the poses are ``part2flange``. The digests of parts tell what
    another cell changes. Links without bodies were not checked for collisions.
    """

    robot: str
    digest: str
    fixturings: Annotated[Mapping[str, Pose], Meta(title="must map names to poses")]
    parts: Annotated[Mapping[str, str], Meta(title="must map names to digests")] = field(
        default_factory=dict
    )
    cam2base: Pose | None = None
    turntables: Annotated[Mapping[str, TableAxis], Meta(title="must map names to axes")] = field(
        default_factory=dict
    )
    bodiless_links: tuple[str, ...] = ()


@dataclass(frozen=True)
class ArmRecord:
    """Distance of arm or camera from the nearest object, of the joints from their limits, and the singular value."""

    clearance_robot_mm: Amount
    to_limit_rad: Amount
    singular_value: Amount
    closest: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class SettingRecord(SensorSetting):
    """A camera pose, the entities it inspects, and what follows from the plan."""

    arm: ArmRecord = None  # type: ignore[assignment]
    measurements: Annotated[
        Mapping[str, Measurement], Meta(title="must map dimensions to how sure they are measured")
    ] = field(default_factory=dict)
    search_window_px: Pixels = field(default_factory=dict)


Kinds = Annotated[
    Mapping[str, Annotated[ReasonKind, Meta(title="must be a kind of reason")]],
    Meta(title="must map names to kinds of reasons"),
]
"""Kinds of the reasons why something is not inspected; a name without one has a reason of no stated kind."""


@dataclass(frozen=True)
class PlanUnits:
    """PlanUnits of the file."""

    length: Literal["mm"] = "mm"
    angle: Literal["rad"] = "rad"
    pose: Literal["camera to world, OpenCV axes (x right, y down, z forward)"] = (
        "camera to world, OpenCV axes (x right, y down, z forward)"
    )


@dataclass(frozen=True, eq=False)
class PlanFile:
    """An inspection plan; settings are in the order of the robot's travel."""

    format: Literal["aspectgraph inspection plan"]
    version: Literal[1]
    request: Annotated[Request, LATER]
    targets: TargetsByName
    bound: Count
    bound_proof: str
    uninspectable: Reasons
    settings: Annotated[tuple[SettingRecord, ...], Meta(title="must be an array of settings")]
    simulation: SimulationResult | None
    units: PlanUnits = PlanUnits()
    source: Annotated[Mapping[str, Any], Meta(title="must say how the part's file was read")] = (
        field(default_factory=dict)
    )
    cell: CellRecord | None = None
    unfinished: bool = False
    uninspectable_kinds: Kinds = field(default_factory=dict)
    not_planned: Reasons = field(default_factory=dict)
    not_planned_frames: Annotated[
        Mapping[str, tuple[str, ...]], Meta(title="must map names to the texts in their frames")
    ] = field(default_factory=dict)
    light: LightRecord | None = None
    made: Made | None = None
    split: Annotated[
        Mapping[str, SplitValue], Meta(title="must map dimensions to how sure they are measured")
    ] = field(default_factory=dict)
    whole_bound: Count = 0
    foreseen: Annotated[tuple[Foreseen, ...], Meta(title="must be an array of uncertainties")] = ()

    @classmethod
    def read(cls, data: Any) -> PlanFile:
        """Return the record of plain values.

        Raises
        ------
        PlanFileError
            If a field is missing, wrong or unknown, or fields contradict each other.
        """
        check_format(data)
        record = from_plain(cls, data, PlanFileError)
        # what a request says of itself comes before what a plan says of it
        record.asked  # noqa: B018
        check_plan(data)
        return record

    @cached_property
    def asked(self) -> Request:
        """The request, with its targets."""
        request: Any = self.request
        named = {"request": {"targets": request.get("targets")}}
        names = from_plain(_Named, named, PlanFileError).request["targets"]
        for name in (*self.targets, *names):
            if (name in names) != (name in self.targets):
                rule = "must name every target once"
                raise PlanFileError(f"request.targets {rule}. Got {shown(name)}.")
        targets = [target_of(name, self.targets[name]) for name in names]
        return restored_request({**request, "targets": targets})


def plan_schema() -> dict[str, Any]:
    """Return the JSON Schema of plan files."""
    title = (
        "Inspection plan; lengths in mm, angles in rad, in the part's frame. "
        "A title completes the sentence that begins with the name of the field."
    )
    schema = json_schema(PlanFile, title=title)
    # their records stand under their names
    names = json_schema(_Named)["$defs"]["_Named"]["properties"]["request"]["additionalProperties"]
    schema["$defs"]["Request"]["properties"]["targets"] = names
    return schema
