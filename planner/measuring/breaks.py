"""Broken edges in an image: where the step of a sample is seen, and what that does to a value.

Offsets are pixels across the edge for a break of 1 mm along each face, see `planner.request.edge_state` for the lines.
Which share of the way from one line to the other the step is at depends on the light of face, break and face. The
lamp that fits an image tells it: the detector finds the steepest place of blurred steps. Without such a lamp, every
share is equally likely, and the same one for a whole entity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Circle
from errors.measurands.geometry import Frame
from planner.camera.camera import Camera, tangents_of
from planner.measuring.fit import carried_back, fit_entities
from planner.measuring.images import Picture
from planner.measuring.registered import Faces, Lamp
from planner.measuring.samples import (
    ALONG_VARIANCE,
    BESIDE_PX,
    MOST_IF_SHARP_PX,
    SMOOTHING_PX,
    EdgeTable,
    PartEdge,
    Samples,
    pixels_of,
    profiles_of,
)
from planner.request.edge_state import EdgeState, broken_lines, chamfer_lines, round_band, shifts_of

Array = NDArray[np.float64]

RESOLVED_PX = 3.0
"""Both lines of a broken edge are found apart if they are this far apart in the image, whatever the break is.

Blur and smoothing have a standard deviation of about 1.3 px, and two equal steps merge below twice that.
"""
RESOLVED_HALF_PX = 2.0
"""Where they are, the wanted line is searched this far from its place at the mean break, or half of their distance."""
TWO_STEPS_PX = 1.0
"""Two steps of a sample are no fault if the lines of a stated break may be this far apart."""
SHARE_SIGMA = 0.1
"""Standard deviation of the share of the way between both lines, where a lamp tells it."""
LEAST_STEP = 0.02
"""Smallest step of both faces, as a share of white, of which a lamp tells where it is."""

# mm: of difference quotients
_STEP_MM = 0.01
# px, from both lines: where the steepest place is looked for
_BEYOND_PX = 3.0
_PLACES = 61
# of a round band
_STRIPS = 6
_MOST_BAND_PX = 5.0
_MOST_WIDER_PX = 2.0
_LIFT_MM = 0.02


@dataclass(frozen=True)
class Breaks:
    """Where the steps of the samples (m) of an entity are seen if it is broken.

    Attributes
    ----------
    state : EdgeState
        By how much it is broken.
    ends : array (m, 2)
        Offsets of the line on the other face, and of that on the wanted one, px across for each mm.
    resolved : array of bool (m,)
        Whether the wanted line is searched alone.
    normals : array (m, 2, 3)
        Of the other and of the wanted face.
    scale : array (m, 3)
        Pixels across for a millimetre along each axis of the part.
    offsets : array (h, m)
        Where the step is by `hypotheses`, px, as a lamp tells it; nan where it does not.
    weights : array (q,)
        Probabilities of each shape, a chamfer or a round band, under each lamp that may be the right one.
    """

    state: EdgeState
    ends: Array
    resolved: NDArray[np.bool_]
    normals: Array
    scale: Array
    offsets: Array = field(default_factory=lambda: np.empty((0, 0)))
    weights: Array = field(default_factory=lambda: np.ones(1))

    @property
    def is_told(self) -> NDArray[np.bool_]:
        """Of which samples a lamp tells where the step is (m,)."""
        if not len(self.offsets):
            return np.zeros(len(self.ends), dtype=np.bool_)
        return np.asarray(np.isfinite(self.offsets).all(axis=0))

    @property
    def hypotheses(self) -> tuple[Array, Array]:
        """Breaks (h,), mm, with their probabilities: all of them for each shape and each lamp."""
        mm, weights = self.state.nodes()
        return np.tile(mm, len(self.weights)), np.outer(self.weights, weights).ravel()

    @property
    def by_break(self) -> Array:
        """Where the step is by `hypotheses` (h, m), px; half way where no lamp tells it."""
        mm, _ = self.hypotheses
        middle = mm[:, None] * np.where(self.resolved, self.ends[:, 1], self.ends.mean(axis=1))
        return np.where(self.is_told, self.offsets, middle) if len(self.offsets) else middle

    @property
    def expected(self) -> Array:
        """Where steps are expected (m,), px across; at the edge of the model where nothing is stated."""
        if not self.state.stated:
            return np.zeros(len(self.ends))
        return np.asarray(self.hypotheses[1] @ self.by_break)

    @property
    def band_px(self) -> float:
        """How wide the band between both faces may be, px; 0 where nothing is stated."""
        return self.state.stated * band_px(self.ends, self.state)

    @property
    def assumed_px(self) -> float:
        """How far breaks that are only assumed may move a part of an entity, px; slopes of light do so, too."""
        if self.state.stated:
            return 0.0
        return min(band_px(self.ends, self.state), MOST_IF_SHARP_PX)

    def half_px(self, half_px: float) -> float:
        """Return how far steps are searched: farther by what a break may be off, but not to a line found apart."""
        if not self.state.stated or not len(self.ends):
            return half_px
        apart = np.abs(self.ends[:, 0] - self.ends[:, 1])
        alone = self.resolved & ~self.is_told
        if alone.mean() > 0.5:
            room = self.state.low_mm * float(np.median(apart[alone])) / 2
            return min(half_px, max(RESOLVED_HALF_PX, room))
        return half_px + min(self.state.mean_mm * float(np.median(apart)) / 2, _MOST_WIDER_PX)

    def of(self, which: NDArray[np.bool_]) -> Breaks:
        """Return those of some of the samples (m,)."""
        offsets = self.offsets[:, which] if len(self.offsets) else self.offsets
        return replace(
            self,
            ends=self.ends[which],
            resolved=self.resolved[which],
            normals=self.normals[which],
            scale=self.scale[which],
            offsets=offsets,
        )


def band_px(ends: Array, state: EdgeState) -> float:
    """Return how wide bands may be, px, given the offsets of both lines (m, 2): the median, up to a limit."""
    if not len(ends):
        return 0.0
    return min(state.high_mm * float(np.median(np.ptp(ends, axis=1))), _MOST_BAND_PX)


def two_steps(ends: Array, state: EdgeState) -> NDArray[np.bool_]:
    """Return of which samples two steps are no fault (m,), given the offsets of both lines (m, 2)."""
    apart = state.high_mm * np.abs(ends[:, 0] - ends[:, 1])
    return np.asarray(apart >= TWO_STEPS_PX) & state.stated


def px_across(places: Array, across: Array, pose: Array, camera: Camera) -> Array:
    """Return how far a millimetre along each axis of the part moves places (m, 3) across edges in the image (m, 3), px.

    Parameters
    ----------
    places : array (m, 3)
        mm.
    across : array (m, 2)
        Unit vectors across the edges.
    pose : array (4, 4)
        Pose of the camera.
    camera : Camera
        The camera.
    """
    moves = [
        pixels_of(places + step, pose, camera) - pixels_of(places - step, pose, camera)
        for step in _STEP_MM * np.eye(3)
    ]
    return np.stack([(move * across).sum(axis=1) for move in moves], axis=1) / (2 * _STEP_MM)


def wanted_face(edge: PartEdge, frame: Frame, samples: Samples) -> NDArray[np.int64]:
    """Return which face of each sample (m,) bounds what is measured: the one whose normal lies across the entity."""
    normals = edge.at(samples.share)[2]
    way = np.broadcast_to(frame.y, samples.points.shape)
    if isinstance(edge.geometry, Circle):
        way = samples.points - edge.geometry.centre
        way = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    return np.asarray(np.argmax(np.abs((normals * way[:, None]).sum(axis=2)), axis=1))


def entity_breaks(
    edge: PartEdge,
    frame: Frame,
    samples: Samples,
    state: EdgeState,
    places: Array,
    across: Array,
    pose: Array,
    camera: Camera,
) -> Breaks:
    """Return where the steps of an entity are seen if it is broken.

    Parameters
    ----------
    edge : PartEdge
        The entity.
    frame : Frame
        The plane that it is fitted in.
    samples : Samples
        Its samples (m).
    state : EdgeState
        By how much it is broken.
    places, across, pose, camera
        See `px_across`.
    """
    scale = px_across(places, across, pose, camera)
    face = wanted_face(edge, frame, samples)
    order = np.stack([1 - face, face], axis=1)
    normals = np.take_along_axis(edge.at(samples.share)[2], order[..., None], axis=1)
    convex = np.full(len(places), edge.convex)
    lines = broken_lines(normals, samples.tangents, convex, pose[:3, 3] - places)
    ends = np.einsum("mki,mi->mk", lines, scale)
    apart = state.low_mm * np.abs(ends[:, 0] - ends[:, 1])
    resolved = np.asarray(apart >= RESOLVED_PX) & state.stated
    return Breaks(state, ends, resolved, normals, scale)


def levels_beside(picture: Picture, places: Array, across: Array, breaks: Breaks) -> Array:
    """Return grey values (2, m) beside broken edges, the first against the direction across; shares of white.

    Parameters
    ----------
    picture : Picture
        The image.
    places, across : array (m, 2)
        Where the edges are found, px, and unit vectors across.
    breaks : Breaks
        How wide the band between both faces may be.
    """
    beside = BESIDE_PX + band_px(breaks.ends, breaks.state)
    at, grey = profiles_of(picture.grey, places, across, beside)
    columns = [int(np.argmin(np.abs(at - side * beside))) for side in (-1, 1)]
    return np.asarray(grey[:, columns].T / picture.white)


def lit_breaks(
    breaks: Breaks, samples: Samples, lamp: Lamp, faces: Faces, levels: Array, blur_px: float
) -> Breaks:
    """Return breaks with the offsets that a lamp makes.

    The grey values of both faces, or of what lies behind, are those of the image. The lamp tells that of the band.

    Parameters
    ----------
    breaks : Breaks
        Of the samples (m).
    samples : Samples
        Of the entity.
    lamp : Lamp
        The lamp that fits the image.
    faces : Faces
        Holds the camera's place and the part.
    levels : array (2, m)
        See `levels_beside`.
    blur_px : float
        Standard deviation of the image's blur, px.
    """
    ways = faces.eye - samples.points
    convex = np.ptp(breaks.ends, axis=1) > 0
    chamfer = chamfer_lines(breaks.normals, samples.tangents, convex, ways)
    flat = breaks.normals.sum(axis=1, keepdims=True)
    flat = flat / np.maximum(np.linalg.norm(flat, axis=2, keepdims=True), 1e-9)
    round_lines, round_normals = round_band(breaks.normals, samples.tangents, ways, _STRIPS)
    beside = _in_order(breaks, ways, levels)
    sigma = float(np.sqrt(ALONG_VARIANCE / 2 + blur_px**2 + SMOOTHING_PX**2))
    mm, _ = breaks.state.nodes()
    lamps, weights = lamp.plausible
    offsets = []
    for lines, normals in ((chamfer, flat), (round_lines, round_normals)):
        points = np.broadcast_to(samples.points[:, None] + _LIFT_MM * flat, normals.shape)
        band = replace(faces, points=points, normals=normals)
        ends = np.einsum("mki,mi->mk", lines, breaks.scale)
        for each in lamps:
            steps = np.diff(
                np.concatenate([beside[:, :1], band.shaded(each), beside[:, 1:]], axis=1), axis=1
            )
            offsets.append(steepest(mm[:, None, None] * ends, steps, sigma))
    return replace(breaks, offsets=np.concatenate(offsets), weights=np.tile(weights / 2, 2))


def _in_order(breaks: Breaks, ways: Array, levels: Array) -> Array:
    """Return the grey values beside edges (m, 2), on the side of the other face and on that of the wanted one."""
    is_seen = (breaks.normals * ways[:, None]).sum(axis=2) > 0
    rows = np.arange(len(ways))
    # of the faces that are seen the one that is farther from edge-on; its line lies on its side
    face = np.argmax(np.abs(breaks.ends) * is_seen, axis=1)
    side = (breaks.ends[rows, face] > 0).astype(np.int64)
    side = np.where(face == 0, side, 1 - side)
    return np.stack([levels[side, rows], levels[1 - side, rows]], axis=1)


def steepest(ends: Array, steps: Array, sigma: float) -> Array:
    """Return where blurred steps are steepest, in the direction of their sum (h, m), px; nan where that is small.

    Parameters
    ----------
    ends : array (h, m, k)
        Where the steps are, px.
    steps : array (m, k)
        How high they are, as shares of white.
    sigma : float
        Standard deviation of the blur, px.
    """
    total = steps.sum(axis=1)
    low = ends.min(axis=2) - _BEYOND_PX
    high = ends.max(axis=2) + _BEYOND_PX
    places = low[..., None] + (high - low)[..., None] * np.linspace(0.0, 1.0, _PLACES)
    slope = np.zeros(places.shape)
    for i in range(ends.shape[2]):
        away = (places - ends[..., i, None]) / sigma
        slope += (np.sign(total) * steps[:, i])[:, None] * np.exp(-(away**2) / 2)
    best = np.clip(slope.argmax(axis=2), 1, _PLACES - 2)
    before, peak, after = (
        np.take_along_axis(slope, (best + k)[..., None], axis=2)[..., 0] for k in (-1, 0, 1)
    )
    bend = before - 2 * peak + after
    shift = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, -1.0), 0.0)
    place = low + (best + np.clip(shift, -1.0, 1.0)) * (high - low) / (_PLACES - 1)
    # steps that nearly cancel each other leave no step to be found far away
    width = np.ptp(ends, axis=2)
    place = np.clip(place, ends.min(axis=2) - width, ends.max(axis=2) + width)
    return np.asarray(np.where(np.abs(total) >= LEAST_STEP, place, np.nan))


@dataclass(frozen=True)
class FoundPoints:
    """Found points (m) of an entity: pixels and unit vectors across, and what they are carried back and fitted by."""

    pixels: Array
    across: Array
    origins: Array
    weight: Array


class BreakShift(NamedTuple):
    """How far the break of an entity shifts a value: on average, mean square, and by 1 mm at both lines (2,).

    What is expected of a stated break is not part of it.
    """

    mean: float
    mean_square: float
    ends: Array


def break_shifts(
    breaks: Breaks,
    edge: PartEdge,
    frame: Frame,
    points: FoundPoints,
    pose: Array,
    camera: Camera,
    slope: Array,
) -> BreakShift:
    """Return how far the break of an entity shifts a value.

    Parameters
    ----------
    breaks : Breaks
        Of the found points (m).
    edge, frame
        The entity and the plane that it is fitted in.
    points : FoundPoints
        Its points.
    pose, camera
        What they were found with.
    slope : array (p,)
        Derivatives of the value by what is fitted.
    """
    state = breaks.state
    _, weights = breaks.hypotheses
    # what is expected is corrected before the fit
    moves = [*(_STEP_MM * breaks.ends.T), *(breaks.by_break - breaks.expected)]
    shifts = _value_shifts(np.array(moves), edge, frame, points, pose, camera) @ slope
    ends = shifts[:2] / _STEP_MM
    by_lamp = float(np.mean(breaks.is_told))
    open_share = float(np.mean(~breaks.is_told & ~breaks.resolved))
    sigma = np.hypot(SHARE_SIGMA * by_lamp, open_share / np.sqrt(12))
    mean = float(weights @ shifts[2:])
    square = float(weights @ shifts[2:] ** 2)
    square += float((sigma * (ends[1] - ends[0])) ** 2) * state.mean_square
    return BreakShift(mean, square, ends)


def _value_shifts(
    moves: Array, edge: PartEdge, frame: Frame, points: FoundPoints, pose: Array, camera: Camera
) -> Array:
    """Return how far what is fitted moves (k, p) if points are found off by moves (k, m), px across."""
    every = np.concatenate([np.zeros((1, moves.shape[1])), moves])
    pixels = points.pixels + every[..., None] * points.across
    directions = tangents_of(camera, pixels.reshape(-1, 2)).reshape(pixels.shape)
    normal = np.cross(frame.x, frame.y)
    flat = carried_back(directions, pose, points.origins, normal, frame)
    fits = fit_entities(edge.geometry, flat, points.weight**2)[0]
    return np.asarray(fits[1:] - fits[0])


class RegistrationShift(NamedTuple):
    """What breaks do to the samples (m) of a registration.

    Attributes
    ----------
    shift_px : array (m,)
        Where steps are expected, px across.
    sigma_px : float
        Standard deviation of what remains; root mean square of all samples.
    two_steps : array of bool (m,)
        Of which samples two steps are no fault.
    band_px : float
        How wide bands are, px; 0 where nothing is stated.
    """

    shift_px: Array
    sigma_px: float
    two_steps: NDArray[np.bool_]
    band_px: float


def registration_shift(
    edges: Sequence[PartEdge],
    samples: Samples,
    across: Array,
    pose: Array,
    camera: Camera,
    state: EdgeState,
) -> RegistrationShift:
    """Return what breaks do to the samples (m) of a registration.

    Parameters
    ----------
    edges : sequence of PartEdge
        The edges, which samples number in order.
    samples : Samples
        Visible samples.
    across, pose, camera
        See `px_across`.
    state : EdgeState
        The breaks of the part.
    """
    table = EdgeTable(edges)
    normals = table.at(samples.edge, samples.share)[2]
    convex = np.array([edge.convex for edge in edges])[samples.edge]
    lines = broken_lines(normals, samples.tangents, convex, pose[:3, 3] - samples.points)
    scale = px_across(samples.points, across, pose, camera)
    ends = np.einsum("mki,mi->mk", lines, scale)
    mean, square = shifts_of(ends, state)
    shift = mean if state.stated else np.zeros(len(mean))
    sigma = float(np.sqrt(np.maximum(square - shift**2, 0.0).mean()))
    band = state.stated * band_px(ends, state)
    return RegistrationShift(shift, sigma, two_steps(ends, state), band)
