"""A value over lines and circles: what a kind of dimension has to say, and what follows from it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.exceptions import InvalidParameterError, MeasurandError
from errors.measurands.fitted import FittedEntities, Frame
from errors.measurands.geometry import Circle, Geometry, Line, Localisation


class Image(NamedTuple):
    """What of the camera a measurement depends on.

    Attributes
    ----------
    distance_mm : float
        From the lens to the image plane.
    pitch_mm : tuple of float
        Pixel pitch (r_x, r_y).
    """

    distance_mm: float
    pitch_mm: tuple[float, float]


class Expansion(NamedTuple):
    """A measured value's error at n poses: x = g.delta + 1/2 delta'H delta + noise, monotonic in the error.

    Attributes
    ----------
    seen : array of bool (n,)
        Where there is an image.
    gradient, hessian : array (n, 6), (n, 6, 6)
        By the displacement (dx, dy, dz, phi_x, phi_y, phi_z) of the camera in its own frame, mm and rad.
    variance : array (n, 3)
        Of the normal parts of the noise: localisation of single points, its floor, and surfaces.
    widths : array (n, 2)
        Of the two triangular parts, see `errors.joint`.
    scale : array (n,)
        Unit of x per unit of the value.
    logarithmic : bool
        x is scale times nominal times ln(1 + error / nominal) instead of scale times error.
    """

    seen: NDArray[np.bool_]
    gradient: NDArray[np.float64]
    hessian: NDArray[np.float64]
    variance: NDArray[np.float64]
    widths: NDArray[np.float64]
    scale: NDArray[np.float64]
    logarithmic: bool = False


class Measurand:
    """A value that is computed from lines and circles which are fitted in planes of the part.

    A kind is a class with ``takes``, and with `describe`, which says in which plane each entity is fitted, what the
    value is, and its derivatives by what is fitted. Nothing else depends on the kind.

    Parameters
    ----------
    geometry : tuple of Line or Circle
        The entities in the part's frame.
    direction : array (3,), optional
        Direction of a distance.

    Attributes
    ----------
    nominal : float
        Nominal value, mm or degrees; positive.
    frames : tuple of Frame
        Plane of each entity.
    """

    kind: ClassVar[str] = ""
    unit: ClassVar[str] = "mm"
    takes: ClassVar[tuple[type, ...]] = ()
    in_image: ClassVar[bool] = False
    """Whether the value is taken from images of the ends as they are, by `image_value`, and nothing is carried back."""

    def __init__(self, geometry: tuple[Geometry, ...], direction: Any = None):
        self.geometry = geometry
        self.direction = None if direction is None else np.asarray(direction, dtype=np.float64)
        self.nominal, self.frames, gradient, hessian = self.describe()
        self._fitted = FittedEntities(self.geometry, self.frames, gradient, hessian)

    def describe(self) -> tuple[float, tuple[Frame, ...], NDArray[np.float64], NDArray[np.float64]]:
        """Return nominal value, frame of each entity, and the value's gradient and Hessian by what is fitted.

        What is fitted is offset and slope of a line (across its frame's y, over x), and centre and radius of a circle
        (in its frame's x and y), entity after entity.
        """
        raise NotImplementedError

    def value(self, fitted: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return the values (n,) of fitted lines (n, 2) and circles (n, 3), as deviations from the nominal ones.

        This is what a measuring program computes, and what the derivatives are of.
        """
        raise NotImplementedError

    def image_value(
        self, images: NDArray[np.float64], planned: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return deviations (n,) by images of the ends (n, 2, 2) and the planned ones (2, 2), mm on the sensor."""
        raise NotImplementedError

    def expansion(
        self,
        poses: NDArray[np.float64],
        image: Image,
        localisation: Localisation,
        surfaces_mm: float = 0.0,
    ) -> Expansion:
        """Return the error of the value at poses world to camera (n, 4, 4)."""
        seen, gradient, hessian, variance = self._fitted.expand(
            poses, image.distance_mm, image.pitch_mm, localisation, surfaces_mm
        )
        return Expansion(
            seen, gradient, hessian, variance, np.zeros((len(poses), 2)), np.ones(len(poses))
        )

    def by_entity(self, poses: NDArray[np.float64], image: Image) -> NDArray[np.float64]:
        """Return the gradient (n, e, 6) of `expansion` by the displacement of the camera, of each entity alone."""
        if self.in_image:
            return self.expansion(poses, image, Localisation.rounding()).gradient[:, None]
        return self._fitted.by_entity(poses)

    @property
    def surfaces(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Which entities lie on one surface, as the index of its first one (k,), and the normals (k, 3)."""
        return self._fitted.surfaces, self._fitted.normals

    def __getstate__(self) -> dict[str, Any]:
        return {"geometry": self.geometry, "direction": self.direction}

    def __setstate__(self, state: dict[str, Any]) -> None:
        type(self).__init__(self, state["geometry"], state["direction"])


def lines_of(geometry: tuple[Geometry, ...]) -> list[Line]:
    """Return the lines among entities."""
    return [shape for shape in geometry if isinstance(shape, Line)]


def circles_of(geometry: tuple[Geometry, ...]) -> list[Circle]:
    """Return the circles among entities."""
    return [shape for shape in geometry if isinstance(shape, Circle)]


# Kinds of dimensions by name: a kind is one class in one file, and nothing else has a branch for
# it.


_KINDS: dict[str, type[Measurand]] = {}


def kind(name: str) -> Callable[[type[Any]], type[Any]]:
    """Return a decorator that makes a class the kind of that name."""

    def register(cls: type[Any]) -> type[Any]:
        cls.kind = name
        _KINDS[name] = cls
        return cls

    return register


def kinds() -> tuple[str, ...]:
    """Return the names of all kinds."""
    return tuple(_KINDS)


def measurand(name: str, geometry: Sequence[Geometry], direction: Any = None) -> Measurand:
    """Return a value over lines and circles.

    Parameters
    ----------
    name : str
        Kind, one of `kinds`.
    geometry : sequence of Line or Circle
        Its entities in the part's frame.
    direction : array (3,), optional
        Direction of a distance. Default: across the lines.

    Returns
    -------
    Measurand
        The value, its planes and its derivatives.

    Raises
    ------
    MeasurandError
        If the kind is unknown, or its value is not defined for these entities.
    """
    if name not in _KINDS:
        raise MeasurandError.of_rule("kind", f"must be one of {', '.join(_KINDS)}", repr(name))
    cls = _KINDS[name]
    if len(geometry) != len(cls.takes):
        raise MeasurandError(
            f"a {name} must have {_several(cls.takes)}. Got {len(geometry)} of them."
        )
    for shape, required_type in zip(geometry, cls.takes, strict=True):
        if not isinstance(shape, required_type):
            raise MeasurandError(
                f"a {name} must have {_several(cls.takes)}. Got a {type(shape).__name__.lower()}."
            )
    try:
        return cls(tuple(geometry), direction)
    except InvalidParameterError as error:
        raise MeasurandError(str(error)) from error


def _several(takes: Sequence[type]) -> str:
    words = {"Line": "straight edge", "Circle": "rim or arc"}
    return " and ".join("one " + words[kind.__name__] for kind in takes)
