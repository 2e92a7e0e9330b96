"""Whether a lamp explains an image: that edges are found where it makes a step, and only there.

Where two faces are equally bright, or both are in a shadow, their edge does not show, and that speaks for a pose. A
matt face is as bright as the cosine of the angle at which light comes (Lambert), less with the distance of a lamp near
it. A face in a shadow is as bright as the surroundings. The lamp is what fits the grey values beside the edges that
were found, and it predicts the step of every edge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from aspectgraph.solid.ray_scene import RayScene
from errors.measurands import Circle
from planner.camera.imaging import tangents_of
from planner.measuring.image.picture import Picture
from planner.measuring.image.samples import across_of, pixels_of
from planner.measuring.image.scans import profiles_of
from planner.measuring.poses.task import Task

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

BESIDE_PX = 3.0
"""Faces and grey values are looked at this far from an edge."""
NEAR_PX = 1.5
"""Faces are looked at this far from an edge to tell whether a shadow ends beside it."""
NEAR_GREY_PX = 2.0
"""Grey values are then taken this far from it: nearer, the edge is blurred."""
LEAST_STEP = 0.03
"""A lamp shows an edge if it makes a step of this share of white at least: half more than scans need."""
STEP_ERROR = 0.35
"""A step is as predicted if it is off by this share of it, or by `LEAST_STEP`."""
LEAST_ALIKE = 0.8
"""Share of the found samples whose step must be as the lamp makes it: it was 0.9 and more at right poses."""
LEAST_SHOWN = 0.7
"""Share of the samples that the lamp shows which must be found, with the step that it makes.

It was 0.75 and more at right poses, and at most 0.62 at wrong ones of which the found steps were alike.
"""
LEAST_LIT = 0.3
"""Share of all samples that the lamp must show."""
LEAST_FITTING = 0.9
"""Share of the found samples without quite another step whose step must be as a lamp makes it, if it fits."""
MOST_OTHERS = 0.4
"""Share of the found samples that may have quite another step where a lamp fits: one long shadow has many."""
CONTRARY_STEP = 0.15
"""A step is quite another one if it is off by this share of white, and by `CONTRARY_SHARE` of what the lamp makes."""
CONTRARY_SHARE = 0.6
"""See `CONTRARY_STEP`."""
MOST_CONTRARY = 0.5
"""Share of the found samples of a stretch that may have quite another step."""

_SIDES = (-1.0, 1.0)
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
_FEW = 300
_MANY = 800
_EVALUATIONS = 60
# of the first simplex: logarithm of the distance, and turns
_SIMPLEX = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]])
_FALLOFFS = (0.0, 2.0)
_LIFT_MM = 0.01
# sagittae of chords that a ray keeps from a rounded edge of the mesh
_CHORDS = 1.1


@dataclass(frozen=True)
class Lamp:
    """A lamp that fits an image.

    Attributes
    ----------
    place : array (3,)
        Where it is, mm.
    falloff : float
        Power of the distance that its light is divided by.
    gain, ambient : float
        Grey value that it makes at right angles at the camera's distance, and that of shadows.
    cost : float
        How badly it fits.
    """

    place: Array
    falloff: float
    gain: float
    ambient: float
    cost: float = np.inf


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

    def chosen(self, which: NDArray[Any]) -> Faces:
        """Return some of the places."""
        return replace(self, points=self.points[which], normals=self.normals[which])

    def light(self, places: Array) -> tuple[Array, Array]:
        """Return the light of lamps as if they were far away, 1 at right angles and 0 in shadows; and distances (...,).

        Distances are in that of the camera. Lamps broadcast against the places on faces.
        """
        way = places - self.points
        length = np.linalg.norm(way, axis=-1)
        cosine = np.maximum((way * self.normals).sum(axis=-1), 0.0) / length
        lifted = self.points + _LIFT_MM * self.normals
        lit = ~self.scene.blocked(lifted, places - lifted)
        return cosine * lit, length / np.linalg.norm(self.eye - self.middle)

    def lamps(
        self, places: Array, grey: Array, falloffs: tuple[float, ...] = _FALLOFFS
    ) -> list[Lamp]:
        """Return the lamps at some places (k, 3) that fit grey values (m,) best, for each falloff."""
        light, far = self.light(places[:, None])
        return [
            Lamp(place, falloff, *map(float, fit))
            for falloff in falloffs
            for place, *fit in zip(places, *_gains(light / far**falloff, grey), strict=True)
        ]

    def shaded(self, lamp: Lamp) -> Array:
        """Return the grey values (...,) that a lamp makes."""
        light, far = self.light(lamp.place)
        return np.minimum(lamp.gain * light / far**lamp.falloff + lamp.ambient, 1.0)


@dataclass(frozen=True)
class Shown:
    """How the steps of found edges compare with those that the best lamp makes, for samples (m).

    Attributes
    ----------
    agree : array of bool (m,)
        Which samples were found.
    lit : array of bool (m,)
        Whether the lamp shows them.
    alike, contrary : array of bool (m,)
        Whether they were found with the step that the lamp makes, or with quite another one.
    """

    agree: Bools
    lit: Bools
    alike: Bools
    contrary: Bools

    @property
    def fits(self) -> bool:
        """Whether the lamp makes the steps of nearly all found edges but those that are quite other ones."""
        others = self.agree & ~self.contrary
        few = self.contrary[self.agree].mean() <= MOST_OTHERS
        return bool(few and self.alike[others].mean() >= LEAST_FITTING)

    @property
    def explains(self) -> bool:
        """Whether it makes those of nearly all that were found, and nearly all that it shows were found."""
        enough = self.lit.mean() >= LEAST_LIT and self.alike[self.agree].mean() >= LEAST_ALIKE
        return bool(enough and self.alike[self.lit].mean() >= LEAST_SHOWN)

    def contradicted(self, stretch: NDArray[np.int64]) -> Bools:
        """Return which samples are of stretches (m,) that were mostly found with quite another step; none without fit.

        What was found there is a shadow, or another edge.
        """
        if not self.fits:
            return np.zeros(len(stretch), dtype=np.bool_)
        found = np.bincount(stretch, self.agree)
        other = np.bincount(stretch, self.contrary)
        return np.asarray((other > MOST_CONTRARY * found)[stretch])


def shown(
    task: Task, pose: Array, picture: Picture, where: tuple[Array, Array], agree: Bools
) -> Shown | None:
    """Return how an image compares with the light of the lamp that fits it best.

    Parameters
    ----------
    task : Task
        What is registered.
    pose : array (4, 4)
        The registered pose.
    picture : Picture
        The image.
    where : pair of array (m, 2)
        Where the edges are in the image, px, and unit vectors across.
    agree : array of bool (m,)
        Which samples were found.

    Returns
    -------
    Shown or None
        None if too little is known to tell.
    """
    faces, on_part = _beside(task, pose, where[1], BESIDE_PX)
    grey = _grey(picture, *where, BESIDE_PX)
    finite = np.isfinite(grey)
    known = np.asarray(on_part & finite & agree)
    if known.sum() < _FEW:
        return None
    lamp = _fitted(faces.chosen(known), grey[known])
    around = grey[finite & ~on_part & agree]
    background = float(np.median(around)) if len(around) else 0.0
    shaded = np.where(on_part, faces.shaded(lamp), background)
    off, size = _compared(shaded, grey, on_part)
    # a shadow that ends beside an edge is taken for it
    near, on_part = _beside(task, pose, where[1], NEAR_PX)
    beside = np.where(on_part, near.shaded(lamp), background)
    near_off, near_size = _compared(beside, _grey(picture, *where, NEAR_GREY_PX), on_part)
    alike = off <= np.maximum(LEAST_STEP, STEP_ERROR * size)
    alike |= near_off <= np.maximum(LEAST_STEP, STEP_ERROR * near_size)
    return Shown(
        agree,
        np.abs(shaded[1] - shaded[0]) >= LEAST_STEP,
        agree & alike,
        agree & (near_off > np.maximum(CONTRARY_STEP, CONTRARY_SHARE * near_size)),
    )


def _compared(shaded: Array, grey: Array, on_part: Bools) -> tuple[Array, Array]:
    """Return by how much steps of grey values (2, m) are not those of a lamp, and the size of these; (m,).

    Behind a silhouette may be anything, so only the face counts.
    """
    wanted = shaded[1] - shaded[0]
    both = on_part.all(axis=0)
    alone = np.where(on_part, np.abs(grey - shaded), 0.0).sum(axis=0)
    off = np.where(both, np.abs(grey[1] - grey[0] - wanted), alone)
    size = np.where(both, np.abs(wanted), np.where(on_part, shaded, 0.0).sum(axis=0))
    return off, size


def _beside(task: Task, pose: Array, across: Array, beside_px: float) -> tuple[Faces, Bools]:
    """Return the faces on both sides of edges (2, m), the first against their unit vector across, and which are any."""
    # rays meet the nominal part, so they start from nominal edges, not from where deviations put them
    centres = pixels_of(task.samples.points, pose, task.camera)
    inward = _sagitta_px(task, pose)
    scene = task.model.edges.scene
    eye = pose[:3, 3].copy()
    points = np.zeros((2, len(centres), 3))
    normals = np.zeros((2, len(centres), 3))
    on_part = np.zeros((2, len(centres)), dtype=np.bool_)
    for k, side in enumerate(_SIDES):
        away = beside_px + np.where(np.sign(inward) == side, np.abs(inward), 0.0)
        seen = tangents_of(task.camera, centres + side * away[:, None] * across)
        known = np.asarray(np.isfinite(seen).all(axis=1))
        seen = np.where(known[:, None], seen, 0.0)
        ways = np.column_stack([seen, np.ones(len(seen))]) @ pose[:3, :3].T
        hit = scene.cast(eye, ways)
        on_part[k] = known & np.isfinite(hit["t_hit"])
        points[k] = eye + np.where(on_part[k], hit["t_hit"], 1.0)[:, None] * ways
        normal = hit["primitive_normals"].astype(np.float64)
        normals[k] = np.where(((normal * ways).sum(axis=1) > 0)[:, None], -normal, normal)
    middle = np.median(points[on_part], axis=0) if on_part.any() else eye + pose[:3, 2]
    return Faces(points, normals, eye, middle, scene), on_part


def _grey(picture: Picture, edges: Array, across: Array, beside_px: float) -> Array:
    """Return the grey values on both sides of edges (2, m), as a share of white; nan off the image."""
    places, grey = profiles_of(picture.grey, edges, across, beside_px)
    at = [int(np.argmin(np.abs(places - side * beside_px))) for side in _SIDES]
    return np.asarray(grey[:, at].T / picture.white)


def _sagitta_px(task: Task, pose: Array) -> Array:
    """Return how far chords of the mesh lie inside of round edges (m,), px: positive if inside is along across."""
    sagitta = np.zeros(len(task.samples.edge))
    points = task.samples.points
    across = across_of(points, task.samples.tangents, pose, task.camera)
    scale = float(task.camera.matrix[0, 0])
    for edge, own in zip(task.edges, task.own, strict=True):
        if not isinstance(edge.geometry, Circle):
            continue
        inward = pixels_of(edge.geometry.centre, pose, task.camera)
        side = np.sign(((inward - pixels_of(points[own], pose, task.camera)) * across[own]).sum(1))
        depth = (points[own] - pose[:3, 3]) @ pose[:3, 2]
        sagitta[own] = _CHORDS * edge.chord_mm * scale / np.maximum(depth, 1.0) * side
    return np.nan_to_num(sagitta)


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


def _fitted(faces: Faces, grey: Array) -> Lamp:
    """Return the lamp that fits the grey values (m,) of faces best: the best ones of a grid, made better."""
    order = np.random.default_rng(0).permutation(len(grey))
    few = order[:_FEW]
    many = order[:_MANY]
    coarse = faces.chosen(few)
    places = _places(faces)
    starts = sorted(coarse.lamps(places, grey[few]), key=lambda one: one.cost)
    fine = faces.chosen(many)

    def moved(move: Array, start: Lamp) -> Lamp:
        place = _moved(faces, start.place, move)
        return fine.lamps(place[None], grey[many], (start.falloff,))[0]

    found = []
    for start in starts[:_STARTS]:
        best = minimize(
            lambda move, start: moved(move, start).cost,
            np.zeros(3),
            (start,),
            "Nelder-Mead",
            options={"maxfev": _EVALUATIONS, "initial_simplex": _SIMPLEX},
        )
        found.append(moved(best.x, start))
    return min(found, key=lambda one: one.cost)


def _places(faces: Faces) -> Array:
    """Return places of lamps (n, 3) around the faces, on the camera's side and a little behind it."""
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
    return np.concatenate([faces.middle + far * distance * ways for far in _FAR])


def _moved(faces: Faces, place: Array, move: Array) -> Array:
    """Return a place that is moved away from the faces by a factor exp(move[0]), and turned about them by the rest."""
    way = place - faces.middle
    first = np.cross(way, _ANY_WAY)
    first *= np.linalg.norm(way) / np.linalg.norm(first)
    second = np.cross(way, first) / np.linalg.norm(way)
    turned = way + move[1] * first + move[2] * second
    return np.asarray(faces.middle + np.exp(move[0]) * turned)
