"""How well points on an edge are found in the image."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from errors.exceptions import InvalidParameterError

POINTS = 16
"""Points that are found on an entity, where a model does not tell their number."""

FLOOR_PX = 0.05
"""Error that all points of an edge or rim have in common, px, where it is not given.

In path-traced images, edges over a whole rim were found 0.02 to 0.10 px off their position, and lines up to 0.04 px.
"""

_MODELS = ("rounding", "gaussian", "fit")


@dataclass(frozen=True)
class Localisation:
    """A model of the errors of image points on an edge.

    Make it with one of its class methods.

    Attributes
    ----------
    model : {"rounding", "gaussian", "fit"}
        Its name.
    sigma_px : float
        Standard deviation of a point's position along each axis of the image, px. For rounding it
        is 1 / sqrt(12).
    points : int
        Number of independent points on a fitted line or circle. For ``fit`` it follows from the
        image's length.
    correlation_px : float
        Length in the image within which errors are correlated, px.
    floor_px : float
        Error that does not average out, px. ``gaussian``: standard deviation of an error across
        the edge that all points of an edge, rim or arc have in common. ``fit``: smallest standard
        deviation of a fit, however long the image is.

    Raises
    ------
    InvalidParameterError
        If the model is unknown, or a number breaks its rule.

    Examples
    --------
    >>> from planner import Localisation
    >>> found = Localisation.gaussian(0.1)
    >>> found.sigma_px, found.floor_px
    (0.1, 0.05)
    """

    model: str
    sigma_px: float
    points: int = POINTS
    correlation_px: float = 0.0
    floor_px: float = 0.0

    def __post_init__(self) -> None:
        if self.model not in _MODELS:
            raise InvalidParameterError.of_rule(
                "localisation", f"must be one of {', '.join(_MODELS)}", repr(self.model)
            )
        for name in ("sigma_px", "correlation_px", "floor_px"):
            value = getattr(self, name)
            if isinstance(value, bool) or not (
                isinstance(value, int | float) and math.isfinite(value) and value >= 0
            ):
                raise InvalidParameterError.of_rule(
                    name, "must be finite and not negative", repr(value)
                )
        if self.model == "rounding" and self.floor_px != 0:
            raise InvalidParameterError.of_rule(
                "floor_px", "must be 0 with rounding", repr(self.floor_px)
            )
        if self.model == "fit" and self.correlation_px == 0:
            raise InvalidParameterError("correlation_px must be positive. Got 0.")
        if isinstance(self.points, bool) or not isinstance(self.points, int) or self.points < 3:
            raise InvalidParameterError.of_rule(
                "points", "must be an integer of at least 3", repr(self.points)
            )

    @classmethod
    def rounding(cls, points: int = POINTS) -> Localisation:
        """Return the paper's model: points rounded to whole pixels. It suits binary images.

        Parameters
        ----------
        points : int
            Number of points found on a line or circle.

        Returns
        -------
        Localisation
            The model.
        """
        return cls("rounding", 1 / math.sqrt(12), points)

    @classmethod
    def gaussian(
        cls, sigma_px: float = 0.1, points: int = POINTS, *, floor_px: float = FLOOR_PX
    ) -> Localisation:
        """Return independent normal errors of every end or point, and a common one of an entity.

        Sub-pixel line fits and corner detectors reached 0.04 to 0.11 px in rendered images. Over a
        whole rim the edge was off by 0.02 to 0.10 px, over a line by up to 0.04 px; see
        ``docs/showing.md``.

        Parameters
        ----------
        sigma_px : float
            Standard deviation of a point along each axis of the image, px.
        points : int
            Independent points on a fitted line or circle.
        floor_px : float
            Standard deviation of the error across the edge that all points of an entity have in
            common, px. A rim is found larger or smaller by it, a line is shifted, and each end of a
            length is shifted along the edge. It is independent between entities.

        Returns
        -------
        Localisation
            The model.
        """
        return cls("gaussian", sigma_px, points, floor_px=floor_px)

    @classmethod
    def fit(
        cls, sigma_px: float = 0.3, correlation_px: float = 2.0, floor_px: float = 0.02
    ) -> Localisation:
        """Return errors that average out over the length of the image, but not below a floor.

        Parameters
        ----------
        sigma_px : float
            Standard deviation of a point along each axis of the image, px.
        correlation_px : float
            Length in the image per independent point, px.
        floor_px : float
            Smallest standard deviation of a fit, px.

        Returns
        -------
        Localisation
            The model.
        """
        return cls("fit", sigma_px, POINTS, correlation_px, floor_px)

    @property
    def common_px(self) -> float:
        """Standard deviation of the error that all points of an entity have in common, px."""
        return self.floor_px if self.model == "gaussian" else 0.0

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, ready for JSON.

        Returns
        -------
        dict
            Text and numbers.
        """
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Localisation:
        """Return the model that `to_dict` wrote.

        Parameters
        ----------
        data : dict
            The fields.

        Returns
        -------
        Localisation
            The model.
        """
        return cls(**data)

    def __str__(self) -> str:
        """Return what a report says of it."""
        if self.model == "rounding":
            return "rounding to whole pixels"
        if self.model == "gaussian":
            common = f", {self.floor_px:g} px per entity" if self.floor_px else ""
            return f"gaussian, {self.sigma_px:g} px per point{common}"
        return f"fit, {self.sigma_px:g} px per {self.correlation_px:g} px of image, {self.floor_px:g} px at best"
