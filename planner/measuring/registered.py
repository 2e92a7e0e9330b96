"""A registered image: the camera's pose, the deviations of the part's surfaces, and how sure both are."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from aspectgraph.entities.entity_rules import PARAMETERS
from aspectgraph.solid.solid import RayScene
from errors.many_images import Evidence, evidence_of
from errors.registration import Rows
from ground.convert import NOT_STORED, Meta, NullIs, Shape
from ground.short_repr import short_repr
from planner.camera.camera import Camera
from planner.measuring.samples import POSE, PartEdge, PartModel
from planner.request.registration import LEAST_POSE

# The lamp that fits an image: the one that makes the grey values beside the edges that were
# found.
#
# A matt face is as bright as the cosine of the angle at which light comes (Lambert), less with
# the distance of a lamp near it. A face in a shadow is as bright as the surroundings.


Array = NDArray[np.float64]

NumberOrNull = Annotated[float, NullIs(math.nan)]
"""A number; nan where there is none, for which files have null."""

LEAST_KNOWN = 300
"""A lamp is fitted to this many samples at least."""

_CLIPPED = 0.97
_LEAST_WEIGHT = 1e-6
_LEAST_SPREAD = 1e-12
# a direction that is no axis of anything
_ANY_WAY = np.array([0.3, 0.5, 0.8])
# scale of the robust fit, in shares of white
_SCALE = 0.03
_FIT_ROUNDS = 5
# directions and distances, in that of the camera, from which the search starts; it goes on from the best of them
_WAYS = 80
_FAR = (0.6, 1.2, 3.0)
_STARTS = 2
_LOWEST = -0.1
_MANY = 800
# of other lamps: how many are kept, and costs by which their weight falls, as a share of the least and at least
_OTHERS = 4
_COST_SHARE = 0.1
_COST = 10.0
_MOST_COSTS = 2.5
_EVALUATIONS = 60
# of the first simplex: logarithm of the distance, and turns
_SIMPLEX = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]])
_FALLOFFS = (0.0, 2.0)
_LIFT_MM = 0.01


@dataclass(frozen=True)
class Lamp:
    """A lamp that fits an image.

    Attributes
    ----------
    place : array (3,)
        Where it is, mm.
    falloff : float
        Power of the distance that its light is divided by.
    unit_mm : float
        Unit of that distance: how far the camera is.
    gain, ambient : float
        Grey value that it makes at right angles at this distance, and that of shadows.
    cost : float
        How badly it fits.
    background : float
        Grey value behind the part.
    others : tuple of Lamp
        Lamps that fit nearly as well: what an image shows of few directions leaves the lamp's open.
    """

    place: Array
    falloff: float
    unit_mm: float
    gain: float
    ambient: float
    cost: float
    background: float = 0.0
    others: tuple[Lamp, ...] = field(default=(), kw_only=True)

    @property
    def plausible(self) -> tuple[tuple[Lamp, ...], Array]:
        """All lamps that fit, the best one first, and their weights, which sum up to 1."""
        lamps = (self, *self.others)
        costs = np.array([lamp.cost for lamp in lamps])
        weight = np.exp((costs.min() - costs) / (_COST_SHARE * costs.min() + _COST))
        return lamps, weight / weight.sum()


@dataclass(frozen=True)
class Faces:
    """Places on faces that an image shows.

    Attributes
    ----------
    points, normals : array (..., 3)
        In the part's frame, mm; unit vectors towards the camera.
    eye, middle : array (3,)
        Where the camera is, and the middle of the faces, mm.
    scene : RayScene
        The part.
    """

    points: Array
    normals: Array
    eye: Array
    middle: Array
    scene: RayScene

    def chosen(self, which: Any) -> Faces:
        """Return some of the places, by an index into the first axes."""
        return replace(self, points=self.points[which], normals=self.normals[which])

    def light(self, places: Array) -> tuple[Array, Array]:
        """Return the light of lamps as if they were far away, 1 at right angles and 0 in shadows; and distances, mm.

        Lamps broadcast against the places on faces.
        """
        way = places - self.points
        length = np.linalg.norm(way, axis=-1)
        cosine = np.maximum((way * self.normals).sum(axis=-1), 0.0) / length
        lifted = self.points + _LIFT_MM * self.normals
        lit = ~self.scene.blocked(lifted, places - lifted)
        return cosine * lit, length

    def lamps(
        self, places: Array, grey: Array, falloffs: tuple[float, ...] = _FALLOFFS
    ) -> list[Lamp]:
        """Return the lamps at some places (k, 3) that fit grey values (m,) best, for each falloff."""
        light, length = self.light(places[:, None])
        unit = float(np.linalg.norm(self.eye - self.middle))
        return [
            Lamp(place, falloff, unit, *map(float, fit))
            for falloff in falloffs
            for place, *fit in zip(
                places, *_gains(light * (unit / length) ** falloff, grey), strict=True
            )
        ]

    def shaded(self, lamp: Lamp) -> Array:
        """Return the grey values (...,) that a lamp makes."""
        light, length = self.light(lamp.place)
        bright = light * (lamp.unit_mm / length) ** lamp.falloff
        return np.minimum(lamp.gain * bright + lamp.ambient, 1.0)


def _gains(light: Array, grey: Array) -> tuple[Array, Array, Array]:
    """Return gains and ambient light, not negative, for which light (k, m) fits grey values (m,) robustly; (k,).

    And the costs (Cauchy).
    """
    weight = np.ones_like(light)
    for _ in range(_FIT_ROUNDS):
        total = weight.sum(axis=-1)
        x = (weight * light).sum(axis=-1) / total
        y = (weight * grey).sum(axis=-1) / total
        spread = (weight * (light - x[:, None]) ** 2).sum(axis=-1)
        common = (weight * (light - x[:, None]) * (grey - y[:, None])).sum(axis=-1)
        gain = np.maximum(common / np.maximum(spread, _LEAST_SPREAD), 0.0)
        ambient = y - gain * x
        # without ambient light where it would be negative
        square = np.maximum((weight * light**2).sum(axis=-1), _LEAST_SPREAD)
        gain = np.where(ambient < 0, (weight * light * grey).sum(axis=-1) / square, gain)
        ambient = np.maximum(ambient, 0.0)
        shaded = gain[:, None] * light + ambient[:, None]
        square = ((grey - np.minimum(shaded, 1.0)) / _SCALE) ** 2
        # what is overexposed says only that it is bright
        clipped = (shaded >= 1.0) & (grey >= _CLIPPED)
        weight = np.where(clipped, _LEAST_WEIGHT, 1.0 / (1.0 + square))
    return gain, ambient, np.log1p(square).sum(axis=-1)


def fitted(faces: Faces, grey: Array) -> Lamp:
    """Return the lamp that fits the grey values (m,) of faces best: the best ones of a grid, made better."""
    order = np.random.default_rng(0).permutation(len(grey))
    few = order[:LEAST_KNOWN]
    many = order[:_MANY]
    coarse = faces.chosen(few)
    places = _places(faces)
    starts = sorted(coarse.lamps(places, grey[few]), key=lambda one: one.cost)
    fine = faces.chosen(many)

    def moved(move: Array, start: Lamp) -> Lamp:
        place = _moved(faces, start.place, move)
        return fine.lamps(place[None], grey[many], (start.falloff,))[0]

    lamps = []
    for start in starts[:_STARTS]:
        best = minimize(
            lambda move, start: moved(move, start).cost,
            np.zeros(3),
            (start,),
            "Nelder-Mead",
            options={"maxfev": _EVALUATIONS, "initial_simplex": _SIMPLEX},
        )
        lamps.append(moved(best.x, start))
    best_lamp = min(lamps, key=lambda one: one.cost)
    # costs of as many samples as those of the first search
    (again,) = coarse.lamps(best_lamp.place[None], grey[few], (best_lamp.falloff,))
    limit = (1 + _MOST_COSTS * _COST_SHARE) * again.cost + _MOST_COSTS * _COST
    alike = [lamp for lamp in starts if lamp.cost <= limit]
    others = tuple(alike[:: -(-len(alike) // _OTHERS)]) if alike else ()
    return replace(best_lamp, cost=again.cost, others=others)


def _places(faces: Faces) -> Array:
    """Return places of lamps (n, 3): at the camera, and around the faces, on its side and a little behind it."""
    towards = faces.eye - faces.middle
    distance = np.linalg.norm(towards)
    axis = towards / distance
    first = np.cross(axis, _ANY_WAY)
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    count = np.arange(_WAYS) + 0.5
    height = 1.0 - (1.0 - _LOWEST) * count / _WAYS
    turn = np.pi * (3.0 - np.sqrt(5.0)) * count
    flat = np.sqrt(1.0 - height**2)
    ways = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)
    ways = ways @ np.stack([first, second, axis])
    around = [faces.middle + far * distance * ways for far in _FAR]
    # of a lamp on the camera, walls that are seen at a small angle tell more than the steps of the grid
    return np.concatenate([faces.eye[None], *around])


def _moved(faces: Faces, place: Array, move: Array) -> Array:
    """Return a place that is moved away from the faces by a factor exp(move[0]), and turned about them by the rest."""
    way = place - faces.middle
    first = np.cross(way, _ANY_WAY)
    first *= np.linalg.norm(way) / np.linalg.norm(first)
    second = np.cross(way, first) / np.linalg.norm(way)
    turned = way + move[1] * first + move[2] * second
    return np.asarray(faces.middle + np.exp(move[0]) * turned)


@dataclass(frozen=True, eq=False)
class ImageEvidence:
    """What one image tells, without what was known before.

    Attributes
    ----------
    evidence : Evidence
        Of pose and surfaces (n).
    rows : tuple of Rows
        What it is from: the found points of each edge, by pose and surfaces.
    bias_variance : float
        Variance of the biases of edges that it counts with, px².
    at : array (n,)
        The unknowns that it is registered with: what is found near them.
    rows_at : callable
        Returns the rows of what is found at other unknowns (n,).
    planned : array (4, 4)
        The pose that the unknowns displace.
    pose_prior : array (6, 6)
        Covariance of the displacement that all images of the setting have in common, before.
    apart : array (6, 6)
        Covariance of that which each has besides.
    """

    evidence: Evidence
    rows: tuple[Rows, ...]
    bias_variance: float
    at: Array
    rows_at: Callable[[Array], list[Rows]]
    planned: Array
    pose_prior: Array
    apart: Array

    @classmethod
    def of(
        cls,
        rows: Iterable[Rows],
        bias_variance: float,
        at: Array,
        rows_at: Callable[[Array], list[Rows]],
        *,
        planned: Array,
        pose_prior: Array,
        apart: Array,
    ) -> ImageEvidence:
        """Return what rows tell."""
        of_edges = tuple(rows)
        evidence = evidence_of(of_edges, len(at), bias_variance)
        return cls(evidence, of_edges, bias_variance, at, rows_at, planned, pose_prior, apart)

    def with_biases(self, bias_variance: float) -> ImageEvidence:
        """Return what the same rows tell if edges have biases of another variance, px²."""
        evidence = evidence_of(self.rows, len(self.at), bias_variance)
        return replace(self, evidence=evidence, bias_variance=bias_variance)

    def moved_to(self, x: Array) -> ImageEvidence:
        """Return what the image tells at other unknowns (n,)."""
        rows = tuple(self.rows_at(x))
        evidence = evidence_of(rows, len(x), self.bias_variance)
        return replace(self, evidence=evidence, rows=rows, at=x)


SAMPLE = np.dtype(
    [
        *(("u", float), ("v", float), ("state", np.int64)),
        *(("edge", np.int64), ("planned_u", float), ("planned_v", float)),
    ]
)
"""A sample of a registration."""
FREE_PX = 10.0
"""Standard deviation of a surface that a target measures, in pixels at the focus distance.

Nothing is assumed of it: edges are searched half as far. With more, camera and surfaces could move together along a
curved valley, and at 0.02 mm a pixel the registration did not come to rest.
"""
CYLINDER_SHARE = 3.0
"""Standard deviation of radius and place of other cylinders, in that of planes: holes are less accurate than faces."""
TILT_SHARE = 0.5
"""How far a plane is lifted at its extent by each tilt, in the standard deviation of its offset."""
LEAST_MM = 1e-4
"""Standard deviation of surfaces that are said to be exact: none is."""


@dataclass(frozen=True)
class Registered:
    """What is known of one image's pose and of the part's surfaces.

    Attributes
    ----------
    cam2world : array (4, 4)
        Estimated pose.
    deviations : array (3k,)
        Estimated deviations of the surfaces, mm, see `aspectgraph.entities.entity_rules`.
    covariance : array (6 + 3k, 6 + 3k)
        Joint covariance of the displacement of the camera in its own frame (mm, rad) and the deviations.
    method : str
        "given", "planned" or "own edges".
    shift_px : float
        How far the image was off its prediction, px; the median over samples.
    used : int
        Samples that the estimate is from.
    offered : int
        Samples that were searched for.
    misfit_px : float
        Median distance of found points from the registered part, px.
    blur_px : float
        Standard deviation of the image's blur across edges, px.
    chi2 : float
        Square of the pose's displacement in standard deviations of the plan's uncertainty; 6 on average.
    notes : tuple of str
        What the user should know.
    warnings : tuple of str
        What of the request is not as stated.
    prior : array (6 + 3k, 6 + 3k) or None
        What was known before the image; None if nothing is estimated.
    samples : structured array (m,)
        u, v: the samples at the registered pose, px; state: see `planner.measuring.samples.State`; edge: number of
        the sample's edge; planned_u, planned_v: the sample at the planned pose.
    lamps : dict of str to Lamp
        The lamps of images that one fits.
    of_images : dict of str to Registered
        The registration of each of several images, whose camera may have moved a little between them.
    evidence : ImageEvidence or None
        What the image tells; None if nothing is estimated.
    surfaces_mm : float
        Standard deviation of the position of faces before, mm.
    pose_covariance : array (6, 6)
        Covariance of the displacement of the camera.
    """

    cam2world: Annotated[Array, Shape(4, 4)]
    deviations: Annotated[Array, Shape(None)] = field(repr=False)
    covariance: Annotated[Array, NOT_STORED] = field(repr=False)
    method: Annotated[str, Meta(pattern="^(planned|given|own edges|fiducials)$")]
    shift_px: float = 0.0
    used: int = 0
    offered: int = 0
    misfit_px: NumberOrNull = math.nan
    blur_px: NumberOrNull = math.nan
    chi2: NumberOrNull = math.nan
    notes: tuple[str, ...] = ()
    warnings: Annotated[tuple[str, ...], NOT_STORED] = ()
    prior: Annotated[Array | None, NOT_STORED] = field(default=None, repr=False)
    samples: Annotated[NDArray[np.void], NOT_STORED] = field(
        default_factory=lambda: np.zeros(0, SAMPLE), repr=False
    )
    lamps: Annotated[Mapping[str, Lamp], NOT_STORED] = field(default_factory=dict, repr=False)
    of_images: Annotated[Mapping[str, Registered], NOT_STORED] = field(
        default_factory=dict, repr=False
    )
    evidence: Annotated[ImageEvidence | None, NOT_STORED] = field(default=None, repr=False)
    surfaces_mm: Annotated[float, NOT_STORED] = 0.0
    pose_covariance: Annotated[Array, Shape(6, 6)] = field(init=False, repr=False)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose_covariance", self.covariance[:POSE, :POSE])

    def of(self, image: str) -> Registered:
        """Return the registration of an image of the setting, by its name."""
        return replace(
            self.of_images.get(image, self),
            warnings=self.warnings,
            surfaces_mm=self.surfaces_mm,
            of_images={},
        )

    def moved(self, model: PartModel, edge: PartEdge, points: Array) -> Array:
        """Return where points (n, 3) of an edge are, with the estimated deviations."""
        deviations = self.deviations[model.unknowns_of(edge) - POSE]
        if not deviations.any():
            return points
        return points + model.displacement(edge, points) @ deviations


def prior_covariance(
    model: PartModel, pose_covariance: Array, surfaces_mm: float, camera: Camera | None = None
) -> Array:
    """Return what is known of pose and surfaces before an image is looked at: a covariance (6 + 3k, 6 + 3k).

    Parameters
    ----------
    model : PartModel
        The part.
    pose_covariance : array (6, 6)
        Of the planned pose, mm and rad.
    surfaces_mm : float
        Standard deviation of the position of faces, mm.
    camera : Camera, optional
        Of surfaces that a target measures, nothing is assumed that its images show, see `FREE_PX`. Default: they are
        as the others.

    Returns
    -------
    array (6 + 3k, 6 + 3k)
        The covariance.
    """
    surfaces = surface_variances(model, surfaces_mm, camera, model.free)
    variances = np.concatenate([np.zeros(POSE), surfaces])
    covariance = np.diag(variances)
    # a robot that is said to be exact, or exact in some direction, is not
    covariance[:POSE, :POSE] = pose_covariance + np.diag(LEAST_POSE**2)
    return covariance


def surface_variances(
    model: PartModel,
    surfaces_mm: float,
    camera: Camera | None = None,
    free: Collection[int] = (),
) -> Array:
    """Return the variances (3k,) of the numbers of surfaces before an image is looked at, mm².

    Parameters
    ----------
    model, surfaces_mm, camera
        See `prior_covariance`.
    free : collection of int
        Surfaces of which nothing is assumed; without a camera, none.
    """
    sigma = max(surfaces_mm, LEAST_MM)
    free_mm = 0.0
    if camera is not None:
        free_mm = FREE_PX * camera.focus_distance_mm / float(camera.matrix.diagonal()[:2].min())
    variances = np.zeros(model.n_unknowns - POSE)
    for k, surface in enumerate(model.carriers.surfaces):
        start = PARAMETERS * k
        if surface.is_plane:
            sigmas = sigma * np.array([1.0, TILT_SHARE, TILT_SHARE])
        else:
            sigmas = np.full(PARAMETERS, CYLINDER_SHARE * sigma)
        if k in free:
            sigmas = np.maximum(sigmas, free_mm)
        variances[start : start + PARAMETERS] = sigmas**2
    return variances


def as_given(
    model: PartModel, cam2world: Array, pose_covariance: Array, surfaces_mm: float, method: str
) -> Registered:
    """Return an image whose pose is given, with its covariance; nothing is estimated."""
    covariance = prior_covariance(model, pose_covariance, surfaces_mm)
    nothing = np.zeros(model.n_unknowns - POSE)
    pose = np.asarray(cam2world, dtype=np.float64)
    return Registered(pose, nothing, covariance, method, surfaces_mm=surfaces_mm)


def displaced(cam2world: Array, moves: Array) -> Array:
    """Return poses (n, 4, 4) that are displaced by (n, 6), mm and rad, in the camera's own frame."""
    moves = np.atleast_2d(moves)
    step = np.zeros((len(moves), 4, 4))
    step[:, :3, :3] = Rotation.from_rotvec(moves[:, 3:]).as_matrix()
    step[:, :3, 3] = moves[:, :3]
    step[:, 3, 3] = 1.0
    return np.asarray(cam2world @ step)
