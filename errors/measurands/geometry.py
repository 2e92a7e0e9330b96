"""Lines and circles in the part's frame, as a measurement knows them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from errors.exceptions import InvalidParameterError
from ground.convert import Meta, Shape, check_fields

Vector = Annotated[NDArray[np.float64], Shape(3)]

_UNIT = 1e-9


@dataclass(frozen=True, eq=False)
class Line:
    """A straight edge.

    Parameters
    ----------
    p, q : array (3,)
        Its ends, mm.

    Raises
    ------
    InvalidParameterError
        If the ends are the same point, or not finite.
    """

    p: Vector
    q: Vector

    def __post_init__(self) -> None:
        object.__setattr__(self, "p", _vector("p", self.p))
        object.__setattr__(self, "q", _vector("q", self.q))
        if not self.length > 0:
            raise InvalidParameterError(
                f"a line must have two different ends. Got {self.p.tolist()} twice."
            )

    @property
    def length(self) -> float:
        """Distance of the ends, mm."""
        return float(np.linalg.norm(self.q - self.p))

    @property
    def direction(self) -> NDArray[np.float64]:
        """Unit vector from p to q; (3,)."""
        return (self.q - self.p) / self.length

    @property
    def middle(self) -> NDArray[np.float64]:
        """Point half way, mm; (3,)."""
        return (self.p + self.q) / 2


@dataclass(frozen=True, eq=False)
class Circle:
    """A rim, or an arc of it.

    Parameters
    ----------
    centre : array (3,)
        Centre, mm.
    axis : array (3,)
        Unit normal of its plane.
    radius_mm : float
        Radius, mm.
    start : array (3,), optional
        Unit vector from the centre to where an arc begins; it runs to the left about the axis. None is a whole circle.
    span_rad : float
        Angle of the arc, 2 pi for a whole circle.

    Raises
    ------
    InvalidParameterError
        If the radius or the angle is not positive, a vector is not finite, or the start runs along the axis.
    """

    centre: Vector
    axis: Vector
    radius_mm: float
    start: Vector | None = None
    span_rad: float = 2 * math.pi

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", _vector("centre", self.centre))
        axis = _vector("axis", self.axis)
        size = float(np.linalg.norm(axis))
        if not size > _UNIT:
            raise InvalidParameterError(f"axis must have a length. Got {axis.tolist()}.")
        object.__setattr__(self, "axis", axis / size)
        if not (math.isfinite(self.radius_mm) and self.radius_mm > 0):
            raise InvalidParameterError.of_rule(
                "radius_mm", "must be positive", repr(self.radius_mm)
            )
        if not 0 < self.span_rad <= 2 * math.pi + _UNIT:
            raise InvalidParameterError(f"span_rad must be in (0, 2 pi]. Got {self.span_rad!r}.")
        if self.start is not None:
            across = _vector("start", self.start)
            across = across - (across @ self.axis) * self.axis
            size = float(np.linalg.norm(across))
            if not size > _UNIT:
                raise InvalidParameterError(
                    f"start must not run along the axis. Got {np.asarray(self.start).tolist()}."
                )
            object.__setattr__(self, "start", across / size)

    @property
    def is_closed(self) -> bool:
        """Whether it is a whole circle."""
        return self.start is None

    @cached_property
    def basis(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Two unit vectors that span its plane, the first one towards the start; (3,) each."""
        x = self.start
        if x is None:
            x = np.eye(3)[int(np.argmin(np.abs(self.axis)))]
            x = x - (x @ self.axis) * self.axis
            x = x / np.linalg.norm(x)
        return x, np.cross(self.axis, x)

    def points(self, angles: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Return points (n, 3) at angles (n,) from the start, rad."""
        x, y = self.basis
        return self.centre + self.radius_mm * (
            np.cos(angles)[:, None] * x + np.sin(angles)[:, None] * y
        )


Geometry = Line | Circle


def _vector(name: str, value: object) -> NDArray[np.float64]:
    vector = np.array(value, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InvalidParameterError.of_rule(name, "must be three finite numbers", repr(value))
    vector.setflags(write=False)
    return vector


# How well points on an edge are found in the image.


POINTS = 16
"""Points that are found on an entity, where a model does not tell their number."""

FLOOR_PX = 0.05
"""Error that all points of an edge or rim have in common, px, where it is not given.

In path-traced images, edges over a whole rim were found 0.02 to 0.10 px off their position, and lines up to 0.04 px.
"""

NotNegative = Annotated[float, Meta(ge=0, title="must be finite and not negative")]


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

    model: Annotated[
        str,
        Meta(pattern="^(rounding|gaussian|fit)$", title="must be one of rounding, gaussian, fit"),
    ]
    sigma_px: NotNegative
    points: Annotated[int, Meta(ge=3, title="must be an integer of at least 3")] = POINTS
    correlation_px: NotNegative = 0.0
    floor_px: NotNegative = 0.0

    def __post_init__(self) -> None:
        check_fields(self, InvalidParameterError)
        if self.model == "rounding" and self.floor_px != 0:
            raise InvalidParameterError.of_rule(
                "floor_px", "must be 0 with rounding", repr(self.floor_px)
            )
        if self.model == "fit" and self.correlation_px == 0:
            raise InvalidParameterError("correlation_px must be positive. Got 0.")

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

    def __str__(self) -> str:
        """Return what a report says of it."""
        if self.model == "rounding":
            return "rounding to whole pixels"
        if self.model == "gaussian":
            common = f", {self.floor_px:g} px per entity" if self.floor_px else ""
            return f"gaussian, {self.sigma_px:g} px per point{common}"
        return f"fit, {self.sigma_px:g} px per {self.correlation_px:g} px of image, {self.floor_px:g} px at best"
