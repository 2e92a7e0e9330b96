"""A dimension as a plan keeps it: all that simulating and reporting it needs, without the part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Circle, Geometry, Localisation, Measurand, MeasurandError, measurand
from errors.measurands.geometry import from_dict, to_dict
from planner.exceptions import PlanFileError
from planner.wanted.targets import Target


@dataclass(frozen=True)
class PlannedDimension:
    """A dimension on the part.

    Attributes
    ----------
    kind : str
        What is measured, see `Dimension`.
    entities : tuple of str
        Ids of what must be seen.
    geometry : tuple of Line or Circle
        Their lines and circles, mm, in the part's frame.
    permitted_error : float
        Largest permitted error, mm (angles: degrees).
    localisation : Localisation
        How well points are found.
    tolerance : (float, float) or None
        Lower and upper deviation that the drawing allows, mm (angles: degrees).
    direction : (float, float, float) or None
        Direction of a distance.
    n_features : int
        How many features of the part it applies to; the entities measure one of them.
    """

    kind: str
    entities: tuple[str, ...]
    geometry: tuple[Geometry, ...] = field(repr=False, compare=False)
    permitted_error: float
    localisation: Localisation
    tolerance: tuple[float, float] | None = None
    direction: tuple[float, float, float] | None = None
    n_features: int = 1

    @classmethod
    def of(cls, target: Target, localisation: Localisation | None) -> PlannedDimension:
        """Return what a plan keeps of a dimension that was resolved on the part.

        Parameters
        ----------
        target : Target
            The dimension.
        localisation : Localisation or None
            How well points are found; None is on whole pixels.

        Returns
        -------
        PlannedDimension
            Without the part.
        """
        assert target.measurand is not None
        assert target.dimension is not None
        return cls(
            target.measurand.kind,
            target.entities,
            target.measurand.geometry,
            target.permitted_error,
            localisation or Localisation.rounding(),
            target.dimension.tolerance,
            target.dimension.direction,
            target.dimension.n_features,
        )

    @cached_property
    def measurand(self) -> Measurand:
        """The value and its planes."""
        return measurand(self.kind, self.geometry, self.direction)

    @property
    def nominal(self) -> float:
        """Nominal value, mm (angles: degrees)."""
        return self.measurand.nominal

    @property
    def unit(self) -> str:
        """Unit of its values, "mm" or "deg"."""
        return self.measurand.unit

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, ready for JSON, with the nominal value and its unit.

        Returns
        -------
        dict
            Lists, texts and numbers.
        """
        return {
            "kind": self.kind,
            "unit": self.unit,
            "nominal": self.nominal,
            "tolerance": None if self.tolerance is None else list(self.tolerance),
            "permitted_error": self.permitted_error,
            "entities": list(self.entities),
            "geometry": [to_dict(one) for one in self.geometry],
            "direction": None if self.direction is None else list(self.direction),
            "localisation": self.localisation.to_dict(),
            "n_features": self.n_features,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> PlannedDimension:
        """Build from the result of `to_dict`.

        Parameters
        ----------
        data : mapping of str to value
            The fields.

        Returns
        -------
        PlannedDimension
            Equal to the one written.

        Raises
        ------
        PlanFileError
            If fields contradict each other.
        """
        try:
            found = cls(
                data["kind"],
                tuple(data["entities"]),
                tuple(from_dict(one) for one in data["geometry"]),
                data["permitted_error"],
                Localisation.from_dict(data["localisation"]),
                None if data["tolerance"] is None else (data["tolerance"][0], data["tolerance"][1]),
                None if data["direction"] is None else tuple(data["direction"]),
                # files of earlier programs do not state it
                data.get("n_features", 1),
            )
            nominal = found.nominal
        except (MeasurandError, ValueError, TypeError, KeyError) as error:
            raise PlanFileError(f"must be a dimension that can be measured. Got: {error}") from None
        if abs(nominal - data["nominal"]) > 1e-6 * max(1.0, abs(nominal)):
            raise PlanFileError(
                f"nominal must be that of the geometry, {nominal:.9g}. Got {data['nominal']!r}."
            )
        return found

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, PlannedDimension):
            return NotImplemented
        return self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]


def sample_points(one: Geometry, n: int) -> NDArray[np.float64]:
    """Return n points at the middles of equal parts of a line or circle; (n, 3) mm."""
    shares = (np.arange(n) + 0.5) / n
    if isinstance(one, Circle):
        return one.points(shares * one.span_rad)
    return np.asarray(one.p + shares[:, None] * (one.q - one.p))
