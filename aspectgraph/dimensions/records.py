"""A dimension of the CAD model, as the caller gets it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, TypeAlias

EntityId: TypeAlias = int | str
"""Id of a straight edge (``17``), rim (``"r3"``) or arc (``"a0"``) of the solid."""

Way: TypeAlias = tuple[EntityId, ...]
"""Entities that measure a dimension together, in one image."""


@dataclass(frozen=True)
class SurfaceZone:
    """The zone in which a face lies, as a flatness or profile tolerance of the model says.

    Attributes
    ----------
    tolerance : str
        ``"flatness"`` or ``"profile"``.
    width_mm : float
        Width of the zone, mm.
    places : bool
        Whether the zone also says where the face is, not only how true to form it is.
    """

    tolerance: str
    width_mm: float
    places: bool


@dataclass(frozen=True)
class ModelDimension:
    """A dimension that a CAD model states, and how it can be measured.

    Attributes
    ----------
    name : str
        Unique name: the name in the model, or kind and number. If the assembly contains its part
        several times, the numbers of its solids follow, as in ``"diameter 1 (solid 2)"``.
    kind : str
        ``"diameter"``, ``"radius"``, ``"distance"``, ``"centre_distance"``, ``"centre_to_edge"`` or
        ``"angle"``; or a kind that is never measurable, such as ``"spherical_radius"``.
    nominal : float or None
        Nominal value in mm, of angles in degrees. None if neither the model nor its geometry has a
        value.
    tolerance : tuple of float or None
        Lower and upper deviation permitted from the nominal value, in the same unit. None if the model states none.
    entities : tuple or None
        Ids of the solid's entities that measure it in one image. None if that is impossible.
    reason : str or None
        Why it cannot be measured. None if it can be.
    alternatives : tuple of tuple
        Other entities that measure it, best first.
    features : tuple of tuple of tuple
        For each feature (each hole of a pattern), all entities that can measure it, best first.
        Empty for a feature that cannot be measured. ``entities`` are the best ones of the first
        measurable feature.
    geometry : float or None
        The value in the model's geometry, in the same unit.
    direction : tuple of float or None
        Unit vector along which a distance is measured.
    attached : tuple of str
        The elements of the model that it refers to.
    note : str
        Sentence on inferred or repaired values; empty if there are none.
    n_features : int
        Number of features, measurable or not. Each hole of a pattern is one.
    solids : tuple of int
        The solids of the file that it refers to, counted from 0 in the order of the file. Empty if
        unknown.
    feature_reasons : tuple of str or None
        For each feature why it cannot be measured. None where it can be. Empty like ``features``
        if no feature can be measured.
    tolerance_class : str or None
        The class of ISO 286 that the model states, such as ``"H7"``. ``tolerance`` has its limits.
    role : str or None
        ``"reference"`` for a dimension that is given for information only (in parentheses on a
        drawing); ``"basic"`` for one that is theoretically exact (in a box). None for others.
    surfaces : tuple of SurfaceZone or None
        For each feature the zone of the faces that carry its best entities. None where the model
        states no flatness or profile tolerance of them.
    """

    name: str
    kind: str
    nominal: float | None
    tolerance: tuple[float, float] | None
    entities: Way | None
    reason: str | None
    alternatives: tuple[Way, ...] = ()
    features: tuple[tuple[Way, ...], ...] = ()
    geometry: float | None = None
    direction: tuple[float, float, float] | None = None
    attached: tuple[str, ...] = ()
    note: str = ""
    n_features: int = 1
    solids: tuple[int, ...] = ()
    feature_reasons: tuple[str | None, ...] = ()
    tolerance_class: str | None = None
    role: str | None = None
    surfaces: tuple[SurfaceZone | None, ...] = ()

    @property
    def unit(self) -> str:
        """Unit of its values: ``"mm"`` or ``"deg"``."""
        return "deg" if self.kind == "angle" else "mm"

    def to_dict(self) -> dict[str, Any]:
        """Return the dimension as JSON values: every attribute by name, and ``unit``.

        Returns
        -------
        dict
            Its keys in the order of the attributes; ``unit`` comes last.
        """
        return {**_plain(asdict(self)), "unit": self.unit}

    def __repr__(self) -> str:
        """Return a one-line summary."""
        value = "no value" if self.nominal is None else f"{self.nominal:.6g} {self.unit}"
        note = (
            f"not measurable: {self.reason}"
            if self.entities is None
            else f"by {list(self.entities)}"
        )
        return f"<ModelDimension {self.name!r}: {self.kind} {value}, {note}>"


def _plain(value: Any) -> Any:
    """Return a value with lists for tuples, at any depth."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def unique_names(names: Sequence[str]) -> list[str]:
    """Return names with ``" #2"``, ``" #3"``, … behind each that occurred before.

    Parameters
    ----------
    names : sequence of str
        In their order, which is kept.
    """
    unique: list[str] = []
    for name in names:
        candidates = (name if k == 1 else f"{name} #{k}" for k in range(1, len(names) + 1))
        unique.append(next(candidate for candidate in candidates if candidate not in unique))
    return unique
