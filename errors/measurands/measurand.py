"""Measurands: what is measured, decisions about its tolerance, and how sure a measurement is."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from statistics import NormalDist
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from errors.checks import (
    check_covariance,
    check_not_negative,
    check_pixel_pitch,
    check_positive,
    check_probability,
    covariance_root,
)
from errors.exceptions import InvalidParameterError, InvalidShapeError, MeasurandError
from errors.measurands.geometry import (
    Circle,
    FittedEntities,
    Frame,
    Geometry,
    Line,
    Localisation,
    is_short,
)
from errors.model import quadratic_probability
from errors.registration import KnownPoses

# What a measurement error means for a tolerance: uncertainty ratio, acceptance limits.
#
# The probability of the model is that of a small *error*. It is not the probability that a part
# conforms, which depends on how parts vary, too (JCGM 106:2012). `decide` states that of a
# measured part, about which nothing else is known.


COVERAGE = 2.0
"""Coverage factor k of the expanded uncertainty U = k u (JCGM 100:2008, 6.2)."""


def uncertainty_ratio(expanded: float, tolerance: tuple[float, float]) -> float:
    """Return U / T with T the tolerance's whole width; 0 of a tolerance with one limit.

    Parameters
    ----------
    expanded : float
        Expanded uncertainty U, in the tolerance's unit.
    tolerance : (float, float)
        Lower and upper deviation; an infinite one is no limit.

    Returns
    -------
    float
        U divided by upper minus lower deviation.
    """
    lower, upper = tolerance
    if math.isinf(upper - lower) and upper > lower:
        return 0.0
    return expanded / check_positive(upper - lower, "tolerance")


class Decision(StrEnum):
    """What a measured value says of a part. The values are those of files."""

    CONFORMS = "conforms"
    DOES_NOT_CONFORM = "does not conform"
    UNDECIDED = "undecided"
    NOT_MEASURED = "not measured"
    NO_TOLERANCE = "no tolerance"


@dataclass(frozen=True)
class DecisionRule:
    """How a value and its uncertainty decide.

    Make it with one of its class methods.

    Attributes
    ----------
    name : {"iso14253-1", "simple", "guard U"}
        Its name.
    level : float
        Probability that a decision is right, for ``iso14253-1``.

    Raises
    ------
    InvalidParameterError
        If the name is unknown, or the level is not in (0.5, 1).

    Examples
    --------
    >>> from planner import DecisionRule
    >>> str(DecisionRule.iso14253())
    'ISO 14253-1, 95 %'
    """

    name: str
    level: float = 0.95

    def __post_init__(self) -> None:
        if self.name not in ("iso14253-1", "simple", "guard U"):
            raise InvalidParameterError.of_rule(
                "rule", "must be one of iso14253-1, simple, guard U", repr(self.name)
            )
        level = check_probability(self.level, "level")
        if level <= 0.5:
            raise InvalidParameterError.of_rule("level", "must be above 0.5", repr(self.level))

    @classmethod
    def iso14253(cls, level: float = 0.95) -> DecisionRule:
        """Return the rule of ISO 14253-1:2017: a decision is right with this probability.

        A guard band of 1.65 u at 0.95 lies at each limit where the tolerance is wider than about 4 u. Both limits count
        where it is narrower (JCGM 106:2012, 7 and 8).

        Parameters
        ----------
        level : float
            The probability, in (0.5, 1).

        Returns
        -------
        DecisionRule
            The rule.
        """
        return cls("iso14253-1", level)

    @classmethod
    def simple(cls) -> DecisionRule:
        """Return simple acceptance: a value within the tolerance conforms, any other does not.

        Returns
        -------
        DecisionRule
            The rule.
        """
        return cls("simple")

    @classmethod
    def guard(cls) -> DecisionRule:
        """Return the rule of ISO 14253-1:1998: guard bands of the whole U.

        Returns
        -------
        DecisionRule
            The rule.
        """
        return cls("guard U")

    def __str__(self) -> str:
        """Return what a report says of it."""
        if self.name == "simple":
            return "simple acceptance"
        if self.name == "guard U":
            return "guard bands of U"
        return f"ISO 14253-1, {100 * self.level:g} %"


def conformance_probability(
    deviation: float, standard_uncertainty: float, tolerance: tuple[float, float]
) -> float:
    """Return the probability that a measured part is within its tolerance (JCGM 106:2012, 7.1).

    The true value is normal about the measured one.

    Parameters
    ----------
    deviation : float
        Measured value minus nominal value.
    standard_uncertainty : float
        Its standard uncertainty u, not negative.
    tolerance : (float, float)
        Lower and upper deviation that the drawing allows; an infinite one is no limit.

    Returns
    -------
    float
        In [0, 1].
    """
    u = check_not_negative(standard_uncertainty, "standard_uncertainty")
    lower, upper = tolerance
    if u == 0:
        return float(lower <= deviation <= upper)
    to_lower = (lower - deviation) / u
    to_upper = (upper - deviation) / u
    if to_lower > 0:
        # as the mirror image: a difference of tails keeps the digits that one of numbers near 1 loses
        return _below(-to_lower) - _below(-to_upper)
    if to_upper == math.inf:
        return _below(-to_lower)
    return _below(to_upper) - _below(to_lower)


def decide(
    deviation: float,
    standard_uncertainty: float,
    tolerance: tuple[float, float] | None,
    rule: DecisionRule,
) -> Decision:
    """Return what a measured deviation says of a part.

    Parameters
    ----------
    deviation : float
        Measured value minus nominal value.
    standard_uncertainty : float
        Its standard uncertainty u.
    tolerance : (float, float) or None
        Lower and upper deviation that the drawing allows; an infinite one is no limit.
    rule : DecisionRule
        How it is decided.

    Returns
    -------
    Decision
        The decision.
    """
    if tolerance is None:
        return Decision.NO_TOLERANCE
    lower, upper = tolerance
    if rule.name == "iso14253-1":
        p = conformance_probability(deviation, standard_uncertainty, tolerance)
        if p >= rule.level:
            return Decision.CONFORMS
        return Decision.DOES_NOT_CONFORM if 1 - p >= rule.level else Decision.UNDECIDED
    guard = COVERAGE * standard_uncertainty if rule.name == "guard U" else 0.0
    if lower + guard <= deviation <= upper - guard:
        return Decision.CONFORMS
    if deviation < lower - guard or deviation > upper + guard:
        return Decision.DOES_NOT_CONFORM
    return Decision.UNDECIDED


def acceptance_limits(
    tolerance: tuple[float, float], standard_uncertainty: float, rule: DecisionRule
) -> tuple[float, float] | None:
    """Return the deviations between which `decide` says that a part conforms.

    Parameters
    ----------
    tolerance : (float, float)
        Lower and upper deviation that the drawing allows; an infinite one is no limit.
    standard_uncertainty : float
        Standard uncertainty u of the value, not negative.
    rule : DecisionRule
        How it is decided. By ISO 14253-1:2017 both limits count where the tolerance is narrow, so that less than
        the guard band of one limit is left.

    Returns
    -------
    (float, float) or None
        The tolerance less a guard band at either side; None if nothing is left, so that conformity cannot be proven.

    Raises
    ------
    InvalidParameterError
        If the uncertainty is negative.
    """
    u = check_not_negative(standard_uncertainty, "standard_uncertainty")
    lower, upper = tolerance
    band = _inner_band(tolerance, u, rule)
    if band is None or lower + band > upper - band:
        return None
    return lower + band, upper - band


def guard_band(standard_uncertainty: float, rule: DecisionRule) -> float:
    """Return how far from a limit a value must lie to decide, if no other limit is near.

    Parameters
    ----------
    standard_uncertainty : float
        Standard uncertainty u of the value, not negative.
    rule : DecisionRule
        How it is decided.

    Returns
    -------
    float
        0 for simple acceptance, U, or 1.65 u for ISO 14253-1 at 95 %.
    """
    if rule.name == "simple":
        return 0.0
    if rule.name == "guard U":
        return COVERAGE * standard_uncertainty
    return NormalDist().inv_cdf(rule.level) * standard_uncertainty


def _inner_band(tolerance: tuple[float, float], u: float, rule: DecisionRule) -> float | None:
    """Return how far inside each limit a value must lie to conform; None if no value does."""
    lower, upper = tolerance
    band = guard_band(u, rule)
    half = (upper - lower) / 2
    if u == 0 or rule.name != "iso14253-1" or math.isinf(half):
        return band

    def lacking(band: float) -> float:
        return conformance_probability(lower + band, u, tolerance) - rule.level

    if lacking(half) < 0:
        return None
    if lacking(band) >= 0:
        return band
    from scipy.optimize import brentq

    # the other limit only lowers the probability
    return float(brentq(lacking, band, half, xtol=1e-12 * half))


def _below(x: float) -> float:
    """Return the probability that a standard normal variable is below x."""
    return 0.5 * math.erfc(-x / math.sqrt(2))


# A value over lines and circles: what a kind of dimension has to say, and what follows from it.


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
        Of the two triangular parts, see `errors.model`.
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
    and_more: ClassVar[bool] = False
    """Whether further entities follow those of ``takes``, such as datums."""
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

    @property
    def fitted(self) -> FittedEntities:
        """What is fitted, with the value's derivatives by it."""
        return self._fitted

    def by_entity(self, poses: NDArray[np.float64], image: Image) -> NDArray[np.float64]:
        """Return the gradient (n, e, 6) of `expansion` by the displacement of the camera, of each entity alone."""
        if self.in_image:
            return self.expansion(poses, image, Localisation.rounding()).gradient[:, None]
        return self._fitted.by_entity(poses)

    def model(self, **means: Any) -> MeasurandModel:
        """Return how surely the value is measured, see `MeasurandModel`."""
        return MeasurandModel(self, **means)

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


def measurand(
    name: str, geometry: Sequence[Geometry], direction: Any = None, groups: Sequence[int] = ()
) -> Measurand:
    """Return a value over lines and circles.

    Parameters
    ----------
    name : str
        Kind, one of `kinds`.
    geometry : sequence of Line or Circle
        Its entities in the part's frame.
    direction : array (3,), optional
        Direction of a distance. Default: across the lines.
    groups : sequence of int
        Of a position with slots among its datums or with a pattern: the number of entities of each datum.

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
    taken = [type(shape) for shape in geometry]
    fits = len(taken) == len(cls.takes) or (len(taken) > len(cls.takes) and cls.and_more)
    if not fits or not all(map(isinstance, geometry, cls.takes)):
        raise MeasurandError(_wrong_entities(name, taken))
    if groups and not hasattr(cls, "n_first"):
        raise MeasurandError.of_rule(
            "groups",
            "must be those of a position",
            f"{list(groups)} for {_with_article(name)}",
        )
    further: dict[str, Any] = {"groups": tuple(groups)} if groups else {}
    try:
        return cls(tuple(geometry), direction, **further)
    except InvalidParameterError as error:
        raise MeasurandError(str(error)) from error


def _with_article(name: str) -> str:
    """Return what a sentence calls a kind."""
    words = name.replace("_", " ")
    return f"an {words}" if words[0] in "aeiou" else f"a {words}"


_NUMBERS = {1: "one", 2: "two", 3: "three", 4: "four"}


def _wrong_entities(name: str, taken: Sequence[type]) -> str:
    """Say what a kind of value takes instead of these entities, and which kinds take them in which order."""
    rule = f"{_with_article(name)} must have {_several(_KINDS[name].takes)}. Got {_several(taken) or 'nothing'}"
    fitting = [
        other
        for other, kind in _KINDS.items()
        if not kind.and_more and Counter(kind.takes) == Counter(taken)
    ]
    if not fitting or name in fitting:
        return f"{rule}."
    return f"{rule}. Use {' or '.join(fitting)} for {'this' if len(taken) == 1 else 'these'}."


def _several(takes: Sequence[type]) -> str:
    """Return entities in words, such as "one rim or arc and two straight edges"."""
    words = {"Line": "straight edge", "Circle": "rim or arc"}
    plurals = {"Line": "straight edges", "Circle": "rims or arcs"}
    parts = []
    for kind, run in itertools.groupby(takes):
        number = len(list(run))
        name = (words if number == 1 else plurals)[kind.__name__]
        parts.append(f"{_NUMBERS.get(number, number)} {name}")
    return " and ".join(parts)


# How sure a value is measured from a pose: probability of a small error, uncertainty, budget.


# what a normal variable is within one and two standard deviations of its mean with
_ONE = math.erf(1 / math.sqrt(2))
_TWO = math.erf(2 / math.sqrt(2))
_BISECTIONS = 60

BREAKS_WIDER = 1.08
"""How much farther out the quantiles of broken edges are than those of a normal distribution of the same spread.

So much from 85 to 99 %, for one edge whose break and whose share of it are uniform; less for several edges.
"""

SOURCES = (
    *("translation", "rotation", "localisation", "localisation_floor", "surfaces"),
    "edge_state",
)
"""What the variance of a measured value comes from."""


@dataclass(frozen=True)
class Prediction:
    """How sure a value is measured from one pose.

    Attributes
    ----------
    nominal : float
        Nominal value, mm (angles: degrees), as everything here.
    permitted_error : float
        Largest error that counts as accurate.
    probability : float
        P(error at most that); 0 without an image.
    standard_uncertainty : float
        Standard deviation of the error; of a short arc half the width of the interval that holds 68.27 %.
    expanded_uncertainty : float
        U: twice that; of a short arc half the width of the interval that holds 95.45 %.
    bias : float
        Mean error, of second order in the displacement.
    budget : dict of str to float
        Variance by `SOURCES`: translation and rotation of the camera, errors of single points in the image, the error
        that all points of an entity have in common, surfaces that are not where the model has them, broken edges. None
        is negative. What translation and rotation do as a product is shared equally, what they do by their correlation
        as in `uncorrelated_root`. Of a value that is not from a short arc, they sum to the square of the standard
        uncertainty.
    """

    nominal: float
    permitted_error: float
    probability: float
    standard_uncertainty: float
    expanded_uncertainty: float
    bias: float
    budget: dict[str, float]


class MeasurandModel:
    """The joint second-order model of a value: error = g.delta + 1/2 delta'H delta + localisation + surfaces.

    Probabilities are those of x = ln(1 + k error) / k, with k between 0 (the error itself) and 1 / nominal, such that x
    is linear in the displacement along the gradient: perspective multiplies what lies in a plane, and adds to what lies
    in two. At .055 rad the largest difference from exact measurements falls from .03 to .007 by it.

    Parameters
    ----------
    measurand : Measurand
        The value.
    image_distance_mm : float
        From the lens to the image plane, mm.
    pixel_pitch_mm : array_like (2,)
        Pixel pitch (r_x, r_y), mm.
    pose_covariance : array_like (6, 6)
        Of (dx, dy, dz, phi_x, phi_y, phi_z), mm and rad: translation and rotation vector of the real camera in the
        frame of the planned one (x right, y down, z along the optical axis), about the lens.
    localisation : Localisation
        How well points are found.
    permitted_error : float
        Largest error that counts as accurate, in the unit of the value.
    surfaces_mm : float
        Standard deviation of a face's position along its normal, mm. Entities in one plane share it.
    by_surfaces : float, optional
        Standard deviation of the value by the position of faces, in its unit, where it is known; then ``surfaces_mm``
        does not count.
    by_edges : float
        Root mean square error of the value by broken edges, in its unit.

    Raises
    ------
    InvalidParameterError
        If a number breaks its rule.
    """

    def __init__(
        self,
        measurand: Measurand,
        *,
        image_distance_mm: float,
        pixel_pitch_mm: ArrayLike,
        pose_covariance: ArrayLike,
        localisation: Localisation,
        permitted_error: float,
        surfaces_mm: float = 0.0,
        by_surfaces: float | None = None,
        by_edges: float = 0.0,
    ):
        self.by_surfaces = by_surfaces
        self.by_edges = check_not_negative(by_edges, "by_edges")
        self.measurand = measurand
        self.localisation = localisation
        self.surfaces_mm = check_not_negative(surfaces_mm, "surfaces_mm")
        pitch = check_pixel_pitch(pixel_pitch_mm)
        self.image = Image(
            check_positive(image_distance_mm, "image_distance_mm"),
            (float(pitch[0]), float(pitch[1])),
        )
        self.covariance = check_covariance(pose_covariance)
        if self.covariance.shape != (6, 6):
            raise InvalidShapeError.of_rule(
                "pose_covariance", "must have shape (6, 6)", f"shape {self.covariance.shape}"
            )
        self.permitted_error = check_positive(permitted_error, "permitted_error")
        if 0.0 < measurand.nominal <= self.permitted_error:
            raise InvalidParameterError(
                f"permitted_error must be smaller than the nominal value {measurand.nominal:.6g}. "
                f"Got {permitted_error!r}."
            )
        self._root = covariance_root(self.covariance)

    def probability(self, world_to_camera: ArrayLike) -> NDArray[np.float64]:
        """Return the probability that the error is at most the permitted one.

        Parameters
        ----------
        world_to_camera : array_like (n, 4, 4)
            Planned poses.

        Returns
        -------
        array (n,)
            Probabilities in [0, 1]; 0 where an entity is not wholly in front of the camera or its plane is seen
            edge-on.
        """
        expansion = self._expansion(world_to_camera)
        return self._within(expansion, np.full(len(expansion.seen), self.permitted_error))

    def probability_at(
        self, world_to_camera: ArrayLike, poses: KnownPoses, excess: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the same with a covariance of each pose.

        Parameters
        ----------
        world_to_camera : array_like (n, 4, 4)
            Planned poses.
        poses : KnownPoses
            Their covariances (n, 6, 6), with roots.
        excess : array (n,)
            Variance of x beside that by the pose, see `errors.measurands.measurand.Expansion`: by surfaces.

        Returns
        -------
        array (n,)
            Probabilities in [0, 1].
        """
        expansion = self._expansion(world_to_camera)
        expansion.variance[:, 2] = excess
        error = np.full(len(expansion.seen), self.permitted_error)
        return self._within(expansion, error, (poses.covariance, poses.root))

    def between(self, world_to_camera: ArrayLike, errors: ArrayLike) -> NDArray[np.float64]:
        """Return the probabilities that the error is in intervals.

        Parameters
        ----------
        world_to_camera : array_like (4, 4)
            Planned pose.
        errors : array_like (m, 2)
            Lower and upper end of each, in the unit of the value.

        Returns
        -------
        array (m,)
            Probabilities in [0, 1]; 0 without an image.
        """
        intervals = np.asarray(errors, dtype=np.float64)
        pose = np.asarray(world_to_camera, dtype=np.float64)[None]
        expansion = self._expansion(np.repeat(pose, len(intervals), axis=0))
        return self._in_intervals(expansion, intervals)

    def scale(self, world_to_camera: ArrayLike) -> float:
        """Return the unit of x per unit of the value at one pose (1, 4, 4); 0 without an image."""
        expansion = self._expansion(world_to_camera)
        return float(expansion.scale[0]) if expansion.seen[0] else 0.0

    def describe(self, world_to_camera: ArrayLike) -> Prediction:
        """Return how sure the value is measured from one pose.

        Parameters
        ----------
        world_to_camera : array_like (4, 4)
            Planned pose.

        Returns
        -------
        Prediction
            Probability, uncertainty and budget; infinite uncertainty without an image.
        """
        expansion = self._expansion(np.asarray(world_to_camera)[None])
        if not expansion.seen[0]:
            nothing = dict.fromkeys(SOURCES, math.inf)
            return Prediction(
                self.measurand.nominal,
                self.permitted_error,
                0.0,
                math.inf,
                math.inf,
                math.nan,
                nothing,
            )
        probability = float(self._within(expansion, np.array([self.permitted_error]))[0])
        budget, bias = self._budget(expansion)
        u = math.sqrt(math.fsum(budget.values()))
        expanded = COVERAGE * u
        if any(map(is_short, self.measurand.geometry)):
            u = self._quantile(expansion, _ONE)
            expanded = self._quantile(expansion, _TWO)
        return Prediction(
            self.measurand.nominal, self.permitted_error, probability, u, expanded, bias, budget
        )

    def _expansion(self, world_to_camera: ArrayLike) -> Expansion:
        poses = np.asarray(world_to_camera, dtype=np.float64)
        if poses.ndim != 3 or poses.shape[1:] != (4, 4):
            raise InvalidShapeError.of_rule(
                "world_to_camera", "must have shape (n, 4, 4)", str(poses.shape)
            )
        expansion = self.measurand.expansion(poses, self.image, self.localisation, self.surfaces_mm)
        if self.by_surfaces is not None:
            expansion.variance[:, 2] = (self.by_surfaces * expansion.scale) ** 2
        return expansion

    def _within(
        self,
        expansion: Expansion,
        error: NDArray[np.float64],
        spread: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
    ) -> NDArray[np.float64]:
        """Return P(|error| <= given) (n,), with a covariance and a root of each pose if they are given."""
        return self._in_intervals(expansion, np.stack([-error, error], axis=1), spread)

    def _in_intervals(
        self,
        expansion: Expansion,
        intervals: NDArray[np.float64],
        spread: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
    ) -> NDArray[np.float64]:
        """Return P(low <= error <= high) (n,) for intervals (n, 2)."""
        seen = expansion.seen
        covariance, root = (self.covariance, self._root) if spread is None else spread
        result = np.zeros(len(seen))
        if not seen.any():
            return result
        gradient = expansion.gradient[seen]
        hessian = expansion.hessian[seen]
        if spread is not None:
            covariance = covariance[seen]
            root = root[seen]
        if expansion.logarithmic:
            bend = np.full(len(gradient), 1 / self.measurand.nominal)
        else:
            bend = _bend(gradient, hessian, covariance, 1 / self.measurand.nominal)
            hessian = hessian - bend[:, None, None] * (gradient[:, :, None] * gradient[:, None, :])
        limits = _bent(intervals[seen], bend[:, None]) * expansion.scale[seen, None]
        breaks = (BREAKS_WIDER * self.by_edges * expansion.scale[:, None]) ** 2
        variance = expansion.variance.sum(axis=1, keepdims=True) + breaks
        noise = np.concatenate([expansion.widths, variance], axis=1)[seen]
        result[seen] = quadratic_probability(gradient, hessian, root, noise, limits)
        return result

    def _budget(self, expansion: Expansion) -> tuple[dict[str, float], float]:
        """Return variance by source, and the mean error, of the first pose."""
        scale = expansion.scale[0]
        g = expansion.gradient[0] / scale
        h = expansion.hessian[0] / scale
        if expansion.logarithmic:
            # error = nominal (exp(y / nominal) - 1) = y + y^2 / (2 nominal) + ...
            h = h + np.outer(g, g) / self.measurand.nominal
        covariance = self.covariance
        if covariance[:3, 3:].any():
            root = uncorrelated_root(covariance)
            g = root.T @ g
            h = root.T @ h @ root
            covariance = np.eye(6)
        whole, translation, rotation = (
            _variance(g[part], h[part, part], covariance[part, part])
            for part in (slice(6), slice(3), slice(3, 6))
        )
        common = whole - translation - rotation
        points, floor, surfaces = expansion.variance[0] / scale**2
        points += (expansion.widths[0] ** 2).sum() / 6 / scale**2
        camera = translation + common / 2, rotation + common / 2
        parts = (*camera, points, floor, surfaces, self.by_edges**2)
        budget = dict(zip(SOURCES, map(float, parts), strict=True))
        return budget, float(0.5 * np.trace(h @ covariance))

    def _quantile(self, expansion: Expansion, probability: float) -> float:
        """Return the error that is not exceeded with a probability."""
        low = 0.0
        high = self.measurand.nominal
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            enough = self._within(expansion, np.array([middle]))[0] >= probability
            low, high = (low, middle) if enough else (middle, high)
        return high


def uncorrelated_root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the root R of a covariance R Rᵀ of translation and rotation whose columns stay nearest to both.

    With a root B of the covariance of each of the two alone, the covariance is B K Bᵀ, and R = B √K. The first three
    unit variates R⁻¹δ are those that correlate most with the translation, the others with the rotation (Zuber and
    Strimmer, *Stat. Appl. Genet. Mol. Biol.* 10(1), 34, 2011: correlation-adjusted scores). So the variance of a value
    has a part for each, and none is negative.

    Parameters
    ----------
    covariance : array (6, 6)
        Of translation and rotation, mm and rad.

    Returns
    -------
    array (6, 6)
        The root. Without a correlation between both, it is a root of each.
    """
    blocks = np.zeros((6, 6))
    inverse = np.zeros((6, 6))
    for part in (slice(3), slice(3, 6)):
        values, vectors = np.linalg.eigh(covariance[part, part])
        sigmas = np.sqrt(np.maximum(values, 0.0))
        # along a direction that is exact, nothing correlates
        inexact = sigmas > _EXACT * sigmas.max()
        blocks[part, part] = vectors * sigmas
        inverse[part, part] = (vectors * np.divide(1.0, sigmas, where=inexact, out=0 * sigmas)).T
    values, vectors = np.linalg.eigh(inverse @ covariance @ inverse.T)
    return np.asarray(blocks @ (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


_EXACT = 1e-7
"""A standard deviation is rounding if it is smaller than this share of the largest one."""


def _variance(
    g: NDArray[np.float64], h: NDArray[np.float64], covariance: NDArray[np.float64]
) -> float:
    """Return the variance of g.delta + 1/2 delta'H delta for normal delta: g'Sg + 1/2 tr (HS)^2."""
    turned = h @ covariance
    return float(g @ covariance @ g + 0.5 * np.trace(turned @ turned))


def _bend(
    g: NDArray[np.float64], h: NDArray[np.float64], covariance: NDArray[np.float64], limit: float
) -> NDArray[np.float64]:
    """Return k (n,) that makes ln(1 + k error) / k linear along the gradient: g'S H S g / (g'S g)^2, in [0, most]."""
    # one covariance for all poses, or one for each
    way = g @ covariance if covariance.ndim == 2 else np.einsum("ni,nij->nj", g, covariance)
    variance = (way * g).sum(axis=1)
    along = (way[:, None, :] @ h @ way[:, :, None])[:, 0, 0]
    safe = np.where(variance > 0, variance, np.inf)
    return np.asarray(np.clip(along / safe / safe, 0.0, limit))


def _bent(error: NDArray[np.float64], bend: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ln(1 + k error) / k; the error itself for k = 0."""
    scaled = np.maximum(bend * error, -1 + 1e-12)
    return np.where(bend > 0, np.log1p(scaled) / np.where(bend > 0, bend, 1.0), error)
