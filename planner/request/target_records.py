"""Targets as files hold them: what they have from the request is stated there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

from errors.exceptions import InvalidParameterError, MeasurandError
from errors.measurands.geometry import Circle, Line
from errors.measurands.measurand import kinds, measurand
from ground.convert import Meta, NullIs, field_name, from_plain, to_plain
from planner.exceptions import PlanFileError, RequestError
from planner.plan_file import Amount, Coordinates
from planner.request.dimension import MaterialCondition, checked_tolerance
from planner.request.edge_state import Break, checked_break
from planner.request.targets import (
    EdgeTarget,
    EntityRecord,
    PlannedDimension,
    Target,
    Witness,
)

if TYPE_CHECKING:
    _Kind = str
else:
    _Kind = Literal[kinds()]

# relative difference of a nominal value and that of its geometry: both are computed
_SAME_NOMINAL = 1e-6

_Positive = Annotated[float, Meta(gt=0, title="must be finite and positive")]
_Coordinate = Annotated[float, Coordinates]


@dataclass(frozen=True)
class WitnessRecord:
    """Entities that in one image give the value of a target, and their lines and circles."""

    entities: Annotated[
        tuple[EntityRecord, ...],
        Meta(min_length=1, title="must be an array of at least one entity"),
    ]
    geometry: Annotated[
        tuple[Line | Circle, ...],
        Meta(min_length=1, title="must be an array of lines and circles"),
    ]

    @classmethod
    def of(cls, witness: Witness) -> WitnessRecord:
        """Return the record of a witness."""
        return cls(witness.records, witness.geometry)

    def witness(
        self,
        kind: str,
        direction: tuple[float, float, float] | None = None,
        groups: tuple[int, ...] = (),
    ) -> Witness:
        """Return the witness of a target of a kind."""
        return Witness(self.entities, measurand(kind, self.geometry, direction, groups))


_Witnesses = Annotated[
    tuple[WitnessRecord, ...],
    Meta(min_length=1, title="must be an array of at least one set of entities"),
]


@dataclass(frozen=True)
class EdgeRecord:
    """The length of an edge, measured as in the paper."""

    kind: Literal["edge"]
    witnesses: _Witnesses

    def target(self, name: str) -> EdgeTarget:
        """Return the target under its name."""
        return EdgeTarget(name, tuple(item.witness("length") for item in self.witnesses))


@dataclass(frozen=True)
class DimensionRecord:
    """A dimension: mm, or degrees. A deviation is null where there is no limit.

    Without a share there is no width of the tolerance; without ``surfaces_mm`` it is that of the request, and
    ``surfaces_from`` is the tolerance of the model that it follows from. Without ``edge_break_mm`` the breaks of its
    edges are those of the request.
    """

    kind: _Kind
    witnesses: _Witnesses
    nominal: Annotated[float, Meta(ge=0, title="must be finite and 0 or more")]
    unit: Annotated[str, Meta(pattern="^(mm|deg)$", title="must be mm or deg")]
    tolerance: (
        Annotated[
            tuple[
                Annotated[_Coordinate, NullIs(-math.inf)], Annotated[_Coordinate, NullIs(math.inf)]
            ],
            Meta(title="must be two numbers, lower and upper deviation"),
        ]
        | None
    )
    permitted_error: _Positive
    share: float | None
    direction: (
        Annotated[tuple[_Coordinate, _Coordinate, _Coordinate], Meta(title="must be three numbers")]
        | None
    )
    n_features: Annotated[int, Meta(ge=1, le=10**9, title="must be a whole number, 1 or more")]
    surfaces_mm: Amount | None
    surfaces_from: str
    edge_break_mm: Break | None = None
    material: MaterialCondition | None = None
    groups: tuple[Annotated[int, Meta(ge=0, title="must not be negative")], ...] = ()
    frame: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.edge_break_mm is not None:
            checked_break(self.edge_break_mm)

    @classmethod
    def of(cls, target: PlannedDimension) -> DimensionRecord:
        """Return the record of a dimension."""
        return cls(
            target.kind,
            tuple(map(WitnessRecord.of, target.witnesses)),
            target.nominal,
            target.unit,
            target.tolerance,
            target.permitted_error,
            target.share,
            target.direction,
            target.n_features,
            target.stated_surfaces_mm,
            target.surfaces_from,
            target.edge_break_mm,
            target.material,
            target.groups,
            target.frame,
        )

    def target(self, name: str) -> PlannedDimension:
        """Return the target under its name."""
        target = PlannedDimension(
            name,
            tuple(item.witness(self.kind, self.direction, self.groups) for item in self.witnesses),
            self.kind,
            self.permitted_error,
            None if self.tolerance is None else checked_tolerance(self.tolerance),
            self.share,
            self.direction,
            self.n_features,
            self.surfaces_mm,
            self.surfaces_from,
            self.edge_break_mm,
            self.material,
            self.groups,
            self.frame,
        )
        nominal = target.nominal
        if abs(nominal - self.nominal) > _SAME_NOMINAL * max(1.0, abs(nominal)):
            raise PlanFileError(
                f"{field_name('targets', name, 'nominal')} must be that of the geometry, {nominal:.9g}. "
                f"Got {self.nominal!r}."
            )
        return target


TargetRecord = EdgeRecord | DimensionRecord
TargetsByName = Annotated[
    Mapping[str, Annotated[TargetRecord, Meta(title="must be a target")]],
    Meta(min_length=1, title="must map at least one name to a target"),
]
"""What is measured: one entry for each characteristic."""


@dataclass(frozen=True)
class _Targets:
    """Targets by name."""

    targets: TargetsByName


def target_of(name: str, record: TargetRecord) -> Target:
    """Return the target of a record.

    Raises
    ------
    PlanFileError
        If it is none that can be measured, or contradicts itself.
    """
    try:
        return record.target(name)
    except (MeasurandError, InvalidParameterError, RequestError) as error:
        where = field_name("targets", name)
        raise PlanFileError(f"{where} must be one that can be measured. Got: {error}") from None


def target_from(values: Mapping[str, Any] | Target) -> Target:
    """Return the target of plain values, with its name among them; a target as it is."""
    if isinstance(values, Target):
        return values
    fields = dict(values)
    name = fields.pop("name")
    records = from_plain(_Targets, {"targets": {name: fields}}, PlanFileError).targets
    return target_of(name, records[name])


def plain_target(target: Target) -> dict[str, Any]:
    """Return a target as plain values, with its name among them."""
    return {"name": target.name, **to_plain(record_of(target))}


def record_of(target: Target) -> TargetRecord:
    """Return the record of a target."""
    if isinstance(target, PlannedDimension):
        return DimensionRecord.of(target)
    return EdgeRecord("edge", tuple(map(WitnessRecord.of, target.witnesses)))
