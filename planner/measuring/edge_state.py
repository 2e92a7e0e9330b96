"""Broken edges in an image: where the step of a sample is seen, and what that does to a value.

Offsets are pixels across the edge for a break of 1 mm along each face, see `planner.request.edge_state` for the lines.
Which share of the way from one line to the other the step is at depends on the light of face, break and face. The lamp
that fits an image tells it: the detector finds the steepest place of two blurred steps. Without such a lamp, every share
is equally likely, and the same one for a whole entity.
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
from planner.measuring.registered import Faces, Lamp
from planner.measuring.images import Picture
from planner.measuring.samples import (
    ALONG_VARIANCE,
    BESIDE_PX,
    SMOOTHING_PX,
    PartEdge,
    Samples,
    pixels_of,
    profiles_of,
)
from planner.request.edge_state import EdgeState, band_normals, broken_lines, shifts_of

Array = NDArray[np.float64]

RESOLVED_PX = 3.0
"""Both lines of a broken edge are found apart if they are this far apart in the image.

Blur and smoothing have a standard deviation of about 1.3 px, and two equal steps merge below twice that.
"""
RESOLVED_HALF_PX = 2.0
"""Where they are, the wanted line is searched this far from where the mean break puts it, and by half of their distance."""
TWO_STEPS_PX = 1.0
"""Two steps of a sample are no fault if the lines of a stated break may be this far apart."""
SHARE_SIGMA = 0.2
"""Standard deviation of the share of the way between both lines, where a lamp tells it."""
LEAST_STEP = 0.02
"""Smallest step of both faces, as a share of white, of which a lamp tells where it is."""

# mm: of difference quotients
_STEP_MM = 0.01
# px, from both lines: where the steepest place is looked for
_BEYOND_PX = 3.0
_PLACES = 61
_MOST_BESIDE_PX = 8.0
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
    offsets : array (k, m)
        Where the step is for each break of `EdgeState.nodes`, px, as the lamp tells it; nan where it does not.
    """

    state: EdgeState
    ends: Array
    resolved: NDArray[np.bool_]
    normals: Array
    offsets: Array = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def expected(self) -> Array:
        """Where steps are expected (m,), px across; at the edge of the model where nothing is stated."""
        if not self.state.stated:
            return np.zeros(len(self.ends))
        mean = self.state.mean_mm
        return np.where(self.resolved, mean * self.ends[:, 1], mean * self.ends.mean(axis=1))

    def half_px(self, half_px: float) -> float:
        """Return how far steps are searched: no farther than half way to the other line where that is found apart."""
        if not self.resolved.any():
            return half_px
        apart = self.state.mean_mm * np.abs(self.ends[self.resolved, 0] - self.ends[self.resolved, 1])
        return min(half_px, max(RESOLVED_HALF_PX, float(np.median(apart)) / 2))

    def of(self, which: NDArray[np.bool_]) -> Breaks:
        """Return those of some of the samples (m,)."""
        offsets = self.offsets[:, which] if len(self.offsets) else self.offsets
        return replace(
            self,
            ends=self.ends[which],
            resolved=self.resolved[which],
            normals=self.normals[which],
            offsets=offsets,
        )


def two_steps(ends: Array, state: EdgeState) -> NDArray[np.bool_]:
    """Return of which samples two steps are no fault (m,), given the offsets of both lines (m, 2)."""
    apart = state.high_mm * np.abs(ends[:, 0] - ends[:, 1])
    return np.asarray(apart >= TWO_STEPS_PX) & state.stated


def line_offsets(edge: PartEdge, samples: Samples, places: Array, across: Array, pose: Array, camera: Camera) -> Array:
    """Return the offsets of both lines of an edge's samples, px across for each mm of the break.

    Parameters
    ----------
    edge : PartEdge
        The edge.
    samples : Samples
        Its samples (m).
    places : array (m, 3)
        Where these are, mm.
    across : array (m, 2)
        Unit vectors across the edge in the image.
    pose : array (4, 4)
        Pose of the camera.
    camera : Camera
        The camera.

    Returns
    -------
    array (m, 2)
        Of the line on the first and on the second face; 0 of a re-entrant edge.
    """
    if not len(places):
        return np.zeros((0, 2))
    normals = edge.at(samples.share)[2]
    convex = np.full(len(places), edge.convex)
    lines = broken_lines(normals, samples.tangents, convex, pose[:3, 3] - places)
    return _pixels_across(places, lines, across, pose, camera)


def _pixels_across(places: Array, lines: Array, across: Array, pose: Array, camera: Camera) -> Array:
    before = pixels_of(places, pose, camera)
    moved = [
        pixels_of(places + _STEP_MM * lines[:, k], pose, camera) - before for k in range(2)
    ]
    return np.stack([(move * across).sum(axis=1) for move in moved], axis=1) / _STEP_MM


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
    edge, samples, places, across, pose, camera
        See `line_offsets`.
    frame : Frame
        The plane that the entity is fitted in.
    state : EdgeState
        By how much it is broken.
    """
    ends = line_offsets(edge, samples, places, across, pose, camera)
    rows = np.arange(len(ends))
    wanted = wanted_face(edge, frame, samples)
    order = np.stack([1 - wanted, wanted], axis=1)
    ends = np.take_along_axis(ends, order, axis=1)
    normals = edge.at(samples.share)[2][rows[:, None], order]
    apart = state.mean_mm * np.abs(ends[:, 0] - ends[:, 1])
    resolved = np.asarray(apart >= RESOLVED_PX) & state.stated
    return Breaks(state, ends, resolved, normals)


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
    band = breaks.state.high_mm * float(np.median(np.ptp(breaks.ends, axis=1)))
    beside = min(BESIDE_PX + band, _MOST_BESIDE_PX)
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
    band = band_normals(breaks.normals, samples.tangents, ways)
    lifted = samples.points + _LIFT_MM * band
    grey = replace(faces, points=lifted, normals=band).shaded(lamp)
    is_seen = (breaks.normals * ways[:, None]).sum(axis=2) > 0
    rows = np.arange(len(grey))
    # of the faces that are seen the one that is farther from edge-on; its line lies on its side
    face = np.argmax(np.abs(breaks.ends) * is_seen, axis=1)
    side = (breaks.ends[rows, face] > 0).astype(np.int64)
    side = np.where(face == 0, side, 1 - side)
    steps = np.stack([grey - levels[side, rows], levels[1 - side, rows] - grey], axis=1)
    sigma = float(np.sqrt(ALONG_VARIANCE / 2 + blur_px**2 + SMOOTHING_PX**2))
    mm, _ = breaks.state.nodes()
    offsets = steepest(mm[:, None, None] * breaks.ends, steps, sigma)
    offsets[:, breaks.resolved] = mm[:, None] * breaks.ends[breaks.resolved, 1]
    return replace(breaks, offsets=offsets)


def steepest(ends: Array, steps: Array, sigma: float) -> Array:
    """Return where two blurred steps are steepest, in the direction of their sum (k, m), px; nan where that is small.

    Parameters
    ----------
    ends : array (k, m, 2)
        Where the steps are, px.
    steps : array (m, 2)
        How high they are, as shares of white.
    sigma : float
        Standard deviation of the blur, px.
    """
    total = steps.sum(axis=1)
    low = ends.min(axis=2) - _BEYOND_PX
    high = ends.max(axis=2) + _BEYOND_PX
    places = low[..., None] + (high - low)[..., None] * np.linspace(0.0, 1.0, _PLACES)
    slope = np.zeros(places.shape)
    for i in (0, 1):
        away = (places - ends[..., i, None]) / sigma
        slope += (np.sign(total) * steps[:, i])[:, None] * np.exp(-(away**2) / 2)
    best = np.clip(slope.argmax(axis=2), 1, _PLACES - 2)
    before, peak, after = (
        np.take_along_axis(slope, (best + k)[..., None], axis=2)[..., 0] for k in (-1, 0, 1)
    )
    bend = before - 2 * peak + after
    shift = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, -1.0), 0.0)
    found = low + (best + np.clip(shift, -1.0, 1.0)) * (high - low) / (_PLACES - 1)
    return np.asarray(np.where(np.abs(total) >= LEAST_STEP, found, np.nan))


@dataclass(frozen=True)
class FoundPoints:
    """Found points (m) of an entity: their pixels and unit vectors across, and what they are carried back and fitted by."""

    pixels: Array
    across: Array
    origins: Array
    weight: Array


class BreakShift(NamedTuple):
    """How far the break of an entity shifts a value: on average, mean square, and by 1 mm at both lines (2,)."""

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
    mm, weights = state.nodes()
    is_told = np.zeros(len(breaks.ends), dtype=np.bool_)
    moves = [*(_STEP_MM * breaks.ends.T)]
    if len(breaks.offsets):
        is_told = np.isfinite(breaks.offsets).all(axis=0)
        moves += [*np.where(is_told, breaks.offsets, mm[:, None] * breaks.ends.mean(axis=1))]
    shifts = _value_shifts(np.array(moves), edge, frame, points, pose, camera) @ slope
    ends = shifts[:2] / _STEP_MM
    if len(breaks.offsets) == 0:
        known = _resolved_ends(breaks, ends)
        mean, square = shifts_of(known, state)
        return BreakShift(float(mean), float(square), ends)
    by_lamp = shifts[2:]
    mean = float(weights @ by_lamp)
    unknown = 1.0 - float(is_told.mean())
    sigma = np.hypot(SHARE_SIGMA * (1 - unknown), unknown / np.sqrt(12))
    square = float(weights @ by_lamp**2) + (sigma * (ends[1] - ends[0])) ** 2 * state.mean_square
    return BreakShift(mean, square, ends)


def _resolved_ends(breaks: Breaks, ends: Array) -> Array:
    """Return the ends of the shift, the other one nearer to the wanted line by the share that is found apart."""
    share = float(breaks.resolved.mean()) if len(breaks.resolved) else 0.0
    room = 1 - share + share * SHARE_SIGMA
    return np.array([ends[1] + room * (ends[0] - ends[1]), ends[1]])


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


def registration_shift(
    edges: Sequence[PartEdge], samples: Samples, across: Array, pose: Array, camera: Camera, state: EdgeState
) -> tuple[Array, float, NDArray[np.bool_]]:
    """Return what breaks do to the samples (m) of a registration.

    Parameters
    ----------
    edges : sequence of PartEdge
        The edges, which samples number in order.
    samples, across, pose, camera
        See `line_offsets`.
    state : EdgeState
        The breaks of the part.

    Returns
    -------
    shift : array (m,)
        Where steps are expected, px across.
    sigma_px : float
        Standard deviation of what remains; root mean square of all samples.
    two_steps : array of bool (m,)
        Of which samples two steps are no fault.
    """
    ends = np.zeros((len(samples.edge), 2))
    for k, edge in enumerate(edges):
        own = samples.edge == k
        alone = samples.chosen(own)
        ends[own] = line_offsets(edge, alone, alone.points, across[own], pose, camera)
    mean, square = shifts_of(ends, state)
    shift = mean if state.stated else np.zeros(len(mean))
    variance = np.maximum(square - shift**2, 0.0)
    sigma = float(np.sqrt(variance.mean())) if len(variance) else 0.0
    return shift, sigma, two_steps(ends, state)
