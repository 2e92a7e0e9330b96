"""Lines and circles in the part's frame, as a measurement knows them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from errors.exceptions import InvalidParameterError

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

    p: NDArray[np.float64]
    q: NDArray[np.float64]

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

    centre: NDArray[np.float64]
    axis: NDArray[np.float64]
    radius_mm: float
    start: NDArray[np.float64] | None = None
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


def to_dict(one: Geometry) -> dict[str, object]:
    """Return a line or circle as plain values, mm, ready for JSON."""
    if isinstance(one, Line):
        return {"p": one.p.tolist(), "q": one.q.tolist()}
    data: dict[str, object] = {
        "centre": one.centre.tolist(),
        "axis": one.axis.tolist(),
        "radius_mm": one.radius_mm,
    }
    if one.start is not None:
        data |= {"start": one.start.tolist(), "span_rad": one.span_rad}
    return data


def from_dict(data: dict[str, Any]) -> Geometry:
    """Return the line or circle that `to_dict` wrote."""
    return Line(**data) if "p" in data else Circle(**data)


def _vector(name: str, value: object) -> NDArray[np.float64]:
    vector = np.array(value, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InvalidParameterError.of_rule(name, "must be three finite numbers", repr(value))
    vector.setflags(write=False)
    return vector
