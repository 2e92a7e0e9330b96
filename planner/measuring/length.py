"""The length of an edge in an image: its line and a line that leaves each of its ends, intersected at the corners.

The value is the plan's: the nominal length times the length of the image over that at the registered pose. Lines are
fitted in planes through them that face the camera, so that every edge is seen across; corners are intersected in the
image of a lens without distortion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Line, Measurand
from errors.measurands.fitted import Frame
from planner.camera.camera import Camera
from planner.camera.pose import world_to_cam
from planner.measuring.entity_scan import EntityScan, entity_samples, scan_entity
from planner.measuring.fit import CORRELATION_PX, uneven_px
from planner.measuring.image.part_edge import PartEdge
from planner.measuring.image.picture import Picture
from planner.measuring.part_model import POSE, PartModel
from planner.measuring.poses.registered import Registered, displaced
from planner.measuring.reading import Reading, budget_of, counts_of

Array = NDArray[np.float64]

LEAST_ANGLE_DEG = 20.0
"""A corner is where another line leaves an edge at this angle at least, in the image."""
ARM_SHARE = 0.5
"""Share of the samples of such a line that must be found."""
ARM_PX = 200.0
"""Such a line is used up to this distance from the corner."""

_STEP = 1e-4
# mm and rad
_UNKNOWN_STEPS = np.array([1e-3] * 3 + [1e-5] * 3 + [1e-3] * 6)


def read_length(
    where: tuple[str, str, int],
    measurand: Measurand,
    edge: PartEdge,
    picture: Picture,
    registered: Registered,
    model: PartModel,
    how: tuple[float, float, float],
) -> Reading:
    """Return the reading of an edge's length.

    Parameters
    ----------
    where : (str, str, int)
        Names of target and image, and number of the setting.
    measurand : Measurand
        The length.
    edge : PartEdge
        The edge.
    picture : Picture
        The image.
    registered : Registered
        Its pose.
    model : PartModel
        The part.
    how : (float, float, float)
        How far from their predictions lines are searched, px; share of the edge that must be found; error that all
        points of a line have in common, px.
    """
    half_px, coverage, floor_px = how
    own = _scan(model, edge, picture, registered, (half_px, coverage, None))
    scans = [own]
    reasons = [own.reason]
    for end in _ends(edge):
        arm = _arm(model, edge, end, picture, registered, half_px)
        reasons.append("" if arm else "no line that leaves a corner was found")
        scans += [arm] if arm else []
    counts = counts_of(scans)
    points = tuple(scan.points for scan in scans)
    reason = next(filter(None, reasons), "")
    if reason:
        return Reading(
            *where, reason=reason, found_share=own.found_share, counts=counts, points=points
        )
    fitted = np.concatenate([scan.fit.fitted for scan in scans if scan.fit is not None])
    planned = _planned_ends(model, edge, registered, picture.camera, np.zeros(POSE + 6))

    def value(parameters: Array) -> float:
        corners = _corners(scans, parameters, registered, picture.camera)
        pitch = np.array(picture.camera.pixel_pitch_mm)
        return float(measurand.image_value(corners[None] * pitch, planned * pitch)[0])

    random, floor = _localisation(value, fitted, scans, floor_px)
    length = measurand.nominal + value(fitted)
    unknowns, slopes = _by_unknowns(model, edge, registered, picture.camera, length)
    gradient = np.zeros(model.n_unknowns)
    np.add.at(gradient, unknowns, slopes)
    budget = budget_of(gradient, registered.covariance, random, floor)
    return Reading(
        *where,
        value=length,
        standard_uncertainty=math.sqrt(max(math.fsum(budget.values()), 0.0)),
        budget=budget,
        found_share=own.found_share,
        rms_px=_rms(own),
        counts=counts,
        points=points,
        gradient=gradient,
    )


def _ends(edge: PartEdge) -> tuple[Array, Array]:
    line = edge.geometry
    assert isinstance(line, Line)
    return line.p, line.q


def _facing(edge: PartEdge, registered: Registered) -> Frame:
    """Return the plane through an edge that faces the camera."""
    line = edge.geometry
    assert isinstance(line, Line)
    view = line.middle - registered.cam2world[:3, 3]
    across = np.cross(view, line.direction)
    return Frame(line.middle, line.direction, across / np.linalg.norm(across))


def _scan(
    model: PartModel,
    edge: PartEdge,
    picture: Picture,
    registered: Registered,
    how: tuple[float, float, Array | None],
) -> EntityScan:
    """Scan a line; near a point only, if one is given."""
    half_px, coverage, near = how
    samples = entity_samples(model, [edge], registered, picture.camera, half_px)
    if near is not None and len(samples.edge):
        pose = registered.cam2world
        places = _images(samples.points, pose, picture.camera)
        close = np.linalg.norm(places - _images(near[None], pose, picture.camera), axis=1) <= ARM_PX
        samples = samples.chosen(close)
    return scan_entity(
        model,
        edge,
        _facing(edge, registered),
        samples,
        picture,
        registered,
        half_px=half_px,
        coverage=coverage,
    )


def _arm(
    model: PartModel,
    edge: PartEdge,
    end: Array,
    picture: Picture,
    registered: Registered,
    half_px: float,
) -> EntityScan | None:
    """Return the line that leaves an end of an edge and is found best; None if there is none."""
    best = None
    share = 0.0
    along = _image_way(edge, end, registered, picture.camera)
    for other in model.leaving(edge, end):
        way = _image_way(other, end, registered, picture.camera)
        sine = abs(float(along[0] * way[1] - along[1] * way[0]))
        if sine < math.sin(math.radians(LEAST_ANGLE_DEG)):
            continue
        scan = _scan(model, other, picture, registered, (half_px, ARM_SHARE, end))
        worth = sine * scan.n_found
        if scan.fit is not None and worth > share:
            best = scan
            share = worth
    return best


def _image_way(edge: PartEdge, end: Array, registered: Registered, camera: Camera) -> Array:
    """Return the unit vector along an edge in the image, away from one of its ends."""
    p, q = _ends(edge)
    other = q if np.linalg.norm(p - end) < np.linalg.norm(q - end) else p
    images = _images(np.array([end, end + 1e-3 * (other - end)]), registered.cam2world, camera)
    way = images[1] - images[0]
    return np.asarray(way / max(float(np.linalg.norm(way)), 1e-12))


def _images(points: Array, pose: Array, camera: Camera) -> Array:
    """Return images (n, 2) in px of a lens without distortion."""
    local = world_to_cam(points, pose)
    return np.asarray((local / local[:, 2:] @ camera.matrix.T)[:, :2])


def _corners(
    scans: Sequence[EntityScan], parameters: Array, registered: Registered, camera: Camera
) -> Array:
    """Return both corners (2, 2), px: the edge's line with that of each arm."""
    lines = []
    for k, scan in enumerate(scans):
        frame = _facing(scan.edge, registered)
        offset, slope = parameters[2 * k : 2 * k + 2]
        line = scan.edge.geometry
        assert isinstance(line, Line)
        at = np.array([-0.5, 0.5]) * line.length
        points = frame.origin + at[:, None] * frame.x + (offset + slope * at)[:, None] * frame.y
        # a line that deviates lies in the plane of its estimate
        lift = _lift(scan, frame)
        images = _images(points + lift, registered.cam2world, camera)
        lines.append(np.cross(np.append(images[0], 1.0), np.append(images[1], 1.0)))
    corners = [np.cross(lines[0], arm) for arm in lines[1:]]
    return np.array([corner[:2] / corner[2] for corner in corners])


def _lift(scan: EntityScan, frame: Frame) -> Array:
    """Return how far the planes of a line's points lie off its frame, mm; the mean, along the normal."""
    normal = np.cross(frame.x, frame.y)
    return np.asarray(float(((scan.origins - frame.origin) @ normal).mean()) * normal)


def _planned_ends(
    model: PartModel, edge: PartEdge, registered: Registered, camera: Camera, move: Array
) -> Array:
    """Return the images of an edge's ends (2, 2) at the registered pose and surfaces, displaced by a move (12,)."""
    ends = np.array(_ends(edge))
    places = registered.moved(model, edge, ends) + model.displacement(edge, ends) @ move[POSE:]
    return _images(places, displaced(registered.cam2world, move[:POSE])[0], camera)


def _by_unknowns(
    model: PartModel, edge: PartEdge, registered: Registered, camera: Camera, length: float
) -> tuple[NDArray[np.int64], Array]:
    """Return the unknowns that move the length that is compared with, and the value's derivatives by them."""
    pitch = np.array(camera.pixel_pitch_mm)

    def compared(move: Array) -> float:
        ends = _planned_ends(model, edge, registered, camera, move) * pitch
        return float(np.linalg.norm(ends[1] - ends[0]))

    before = compared(np.zeros(len(_UNKNOWN_STEPS)))
    steps = np.diag(_UNKNOWN_STEPS)
    slopes = np.array([compared(step) - compared(-step) for step in steps]) / (2 * _UNKNOWN_STEPS)
    unknowns = np.concatenate([np.arange(POSE), model.unknowns_of(edge)])
    return unknowns, -length / before * slopes


def _localisation(
    value: Callable[[Array], float], fitted: Array, scans: Sequence[EntityScan], floor_px: float
) -> tuple[float, float]:
    """Return the variances of the value by single points and by the floor of each line."""
    slopes = np.empty(len(fitted))
    for i in range(len(fitted)):
        step = np.zeros(len(fitted))
        step[i] = _STEP
        slopes[i] = (value(fitted + step) - value(fitted - step)) / (2 * _STEP)
    random = 0.0
    floor = 0.0
    for k, scan in enumerate(scans):
        own = slopes[2 * k : 2 * k + 2]
        assert scan.fit is not None
        alike = max(1.0, CORRELATION_PX / scan.spacing_px)
        random += _rms(scan) ** 2 * alike * float(own @ scan.fit.covariance @ own)
        residual = scan.points["residual_px"][scan.points["state"] == 0]
        common_px = math.hypot(floor_px, uneven_px(residual, scan.spacing_px))
        floor += common_px**2 * float(((own @ scan.fit.common) ** 2).sum())
    return random, floor


def _rms(scan: EntityScan) -> float:
    residual = scan.points["residual_px"][scan.points["state"] == 0]
    return math.sqrt(float((residual**2).sum()) / max(len(residual) - 2, 1))
