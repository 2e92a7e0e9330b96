"""What a plan needs to know of registration to the part's own edges: stretches of edges, and from where each is seen.

Whether a stretch is hidden is looked up: rays go from it in the directions of an octahedral grid until they leave the
part. It counts as seen where all four directions around that of the camera are free. The grid is turned off the axes of
the part, so that no ray of it lies in a face.

Registration may find less than what is seen. So `FOUND_SHARE` of each edge counts, with larger errors of single points
than were found in images.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from errors.measurands import Geometry, Line
from errors.measurands.geometry import FLOOR_PX
from errors.registration import Imaging, Stretches
from planner.camera.camera import Camera
from planner.light.area_light import EdgePoints, Sight
from planner.measuring.fit import CORRELATION_PX
from planner.measuring.lit_edges import reads_of
from planner.measuring.register import bias_of
from planner.measuring.registered import surface_variances
from planner.measuring.samples import APART_PX, END_PX, PartEdges, PartModel
from planner.measuring.verdict import LEAST_SHARE
from planner.request.edge_state import EdgeState, shifts_of
from planner.request.models import Lifts, OwnEdges, key_of
from planner.request.problem import Problem
from planner.request.reach import entity_space
from planner.request.registration import LEAST_POSE, OWN_EDGES, RegistrationRecord
from planner.request.targets import PlannedDimension, Target, sample_points

Array = NDArray[np.float64]

FOUND_SHARE = LEAST_SHARE
"""Share of what an image shows of the part that is found: with less, a lamp must explain what is dark."""
NOISE_PX = 0.2
"""Standard deviation of a found point: residuals in images were 0.1 to 0.2 px."""
STRETCH_PX = 60.0
"""Length of a stretch at the focus distance."""
GRID = 32
"""Directions along each side of the octahedral grid."""
MOST_BLUR = 3.0
"""Blur of an edge that still counts, in that at the limits of the depth of field."""
MARGIN_PX = 10.0
"""Strip along the image's border in which nothing counts."""

_LEAST = 3
_LEAST_CIRCLE = 8
_MOST = 24
_LIFT_MM = 0.03
# digits that all machines compute alike
_DIGITS = 9
# angles that are no multiples of anything
_TURN = (0.3217, 0.7411, 0.5263)
_RAYS = 100


def planned_edges(problem: Problem, surfaces_mm: float | None = None) -> OwnEdges:
    """Return how surely registration to the part's own edges will tell poses and values.

    Parameters
    ----------
    problem : Problem
        What is asked; its pose uncertainty is what is known before registration.
    surfaces_mm : float, optional
        Standard deviation of the position of faces along their normals, mm. Default: the largest of the targets.

    Returns
    -------
    OwnEdges
        For any pose.
    """
    single = problem.single
    targets = dict(single.measured)
    area = getattr(entity_space(single.space), "area", None)
    model = PartModel(single.space.solid, targets, area)
    if surfaces_mm is None:
        surfaces_mm = max((target.surfaces_mm for target in targets.values()), default=0.0)
    stated = surface_variances(model, surfaces_mm)
    free = surface_variances(
        model, surfaces_mm, problem.camera, range(len(model.carriers.surfaces))
    )
    sigmas, free_sigmas = (np.sqrt(each).reshape(-1, 3) for each in (stated, free))
    floor = (
        max((target.localisation.floor_px for target in targets.values()), default=0.0) or FLOOR_PX
    )
    return OwnEdges(
        problem.pose_uncertainty.covariance + np.diag(LEAST_POSE**2),
        _stretches(model, problem.camera, sigmas)._replace(free_sigmas=free_sigmas),
        _imaging(problem.camera, edges_bias_px(problem.camera, floor, problem.edges)),
        {
            key_of(target.name, target.witness.entities): _lifts(
                model, target.name, targets[target.name]
            )
            for target in single.targets
        },
    )


def edges_bias_px(camera: Camera, floor_px: float, edges: EdgeState) -> float:
    """Return the standard deviation of what all points of an edge have in common, px.

    Parameters
    ----------
    camera : Camera
        The camera.
    floor_px : float
        Floor of the localisation, px.
    edges : EdgeState
        By how much edges are broken.
    """
    return math.hypot(bias_of(floor_px), _spread_mm(edges) * _px_per_mm(camera))


def _spread_mm(edges: EdgeState) -> float:
    """Return the standard deviation of where steps of broken edges are seen, mm; the step may be at both lines."""
    mean, square = shifts_of(np.array([0.0, 1.0]), edges)
    return math.sqrt(max(float(square - mean**2), 0.0))


def _px_per_mm(camera: Camera) -> float:
    """Return how many pixels a millimetre is in the plane of focus."""
    return camera.image_distance_mm / (camera.focus_distance_mm * max(camera.pixel_pitch_mm))


def registered_problem(problem: Problem, how: RegistrationRecord | None) -> Problem:
    """Return a problem whose values are read from registered images.

    Parameters
    ----------
    problem : Problem
        What is asked.
    how : RegistrationRecord or None
        How poses are known; None for no better than planned, as far as the request states it.
    """
    problem = replace(problem, reads=reads_of(problem.space.solid, how))
    if how is None:
        return problem
    if how.method == OWN_EDGES:
        return replace(problem, registered=planned_edges(problem, how.surfaces_mm))
    return replace(problem, registered=how.pose_uncertainty)


def _imaging(camera: Camera, bias_px: float) -> Imaging:
    matrix = camera.matrix
    width, height = camera.resolution
    sharp = 1.0 / camera.focus_distance_mm
    return Imaging(
        (float(matrix[0, 0]), float(matrix[1, 1])),
        (float(matrix[0, 2]), float(matrix[1, 2])),
        (float(width), float(height)),
        (sharp, 1.0 / camera.depth_of_field_mm[0] - sharp, MOST_BLUR),
        NOISE_PX,
        CORRELATION_PX,
        float(bias_px),
        MARGIN_PX,
        APART_PX,
        END_PX,
        FOUND_SHARE,
    )


def _stretches(model: PartModel, camera: Camera, sigmas: Array) -> Stretches:
    edges = model.edges.edges
    step = STRETCH_PX * camera.focus_distance_mm / float(camera.matrix.diagonal()[:2].max())
    number = []
    parts = []
    for k, edge in enumerate(edges):
        length = _length(edge.geometry)
        shortest = _LEAST if isinstance(edge.geometry, Line) else _LEAST_CIRCLE
        n = int(np.clip(np.ceil(length / step), shortest, _MOST))
        along = (np.arange(n) + 0.5) / n
        points, tangents, normals = edge.at(along)
        moves = model.displacement(edge, points)
        number.append(np.full(n, k, dtype=np.int64))
        parts.append((points, tangents, np.full(n, length / n), along, moves, normals))
    edge_of = np.concatenate(number)
    points, tangents, lengths, along, moves, normals = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    turn = Rotation.from_euler("xyz", _TURN).as_matrix()
    return Stretches(
        _rounded(points),
        _rounded(tangents),
        _rounded(lengths),
        _rounded(moves),
        edge_of,
        _rounded(along),
        np.array([_span(edge.geometry) for edge in edges]),
        np.array([model.carried_by[edge.name] for edge in edges], dtype=np.int64),
        _free(model.edges, edge_of, EdgePoints(points, tangents, normals), turn, camera),
        _rounded(turn),
        sigmas,
        sigmas,
    )


def _rounded(values: Array) -> Array:
    return np.ascontiguousarray(np.round(values, _DIGITS) + 0.0)


def _length(geometry: Geometry) -> float:
    if isinstance(geometry, Line):
        return float(geometry.length)
    return float(geometry.radius_mm * geometry.span_rad)


def _span(geometry: Geometry) -> float:
    """Return the angle of a circle, rad, and 0 for a line."""
    return 0.0 if isinstance(geometry, Line) else float(geometry.span_rad)


def _free(
    edges: PartEdges,
    edge_of: NDArray[np.int64],
    of_edges: EdgePoints,
    turn: Array,
    camera: Camera,
) -> NDArray[np.bool_]:
    """Return in which directions of the grid points (m) of edges are seen, and their light shows them; (m, n, n)."""
    points = of_edges.points
    normals = of_edges.normals
    across = np.linspace(-1.0, 1.0, GRID)
    a, b = np.meshgrid(across, across, indexing="ij")
    c = 1.0 - np.abs(a) - np.abs(b)
    x = np.where(c < 0, (1.0 - np.abs(b)) * np.where(a >= 0, 1.0, -1.0), a)
    y = np.where(c < 0, (1.0 - np.abs(a)) * np.where(b >= 0, 1.0, -1.0), b)
    ways = np.stack([x, y, c], axis=2)
    ways /= np.linalg.norm(ways, axis=2, keepdims=True)
    ways = ways @ turn
    chord = np.array([edge.chord_mm for edge in edges.edges])[edge_of]
    above = normals.sum(axis=1)
    above /= np.maximum(np.linalg.norm(above, axis=1, keepdims=True), 1e-9)
    lifted = points + (_LIFT_MM + 2 * chord)[:, None] * above
    extent = float(np.linalg.norm(np.ptp(edges.solid.vertices, axis=0)))
    free = np.empty((len(points), GRID, GRID), dtype=np.bool_)
    for first in range(0, len(points), _RAYS):
        ray_points = lifted[first : first + _RAYS, None, None]
        rays = np.broadcast_to(2 * extent * ways, (len(ray_points), *ways.shape))
        free[first : first + _RAYS] = ~edges.scene.blocked(ray_points, rays)
    if edges.area is not None:
        sight = Sight.of(edges.solid, camera, edges.scene)
        for k in range(len(points)):
            point = EdgePoints(*(values[k : k + 1] for values in of_edges))
            eyes = points[k] + camera.focus_distance_mm * ways[free[k]]
            free[k, free[k]] = edges.area.contrasts(sight, point, eyes)[0][:, 0] > 0
    return free


def _lifts(model: PartModel, name: str, target: Target) -> Lifts:
    """Return how surfaces move the entities of a target, as far as its value feels it."""
    free = np.array(sorted(model.free_of[name]), dtype=np.int64)
    if not isinstance(target, PlannedDimension):
        return Lifts(np.empty((0, 2), dtype=np.int64), np.empty((0, 2, 3, 6)), free)
    measured = model.measured[name]
    motions = np.zeros((len(measured), 2, 3, 6))
    frames = target.measurand.frames
    for k, (edge, frame) in enumerate(zip(measured, frames, strict=True)):
        points = sample_points(edge.geometry, 8)
        moved = model.displacement(edge, points)
        if target.measurand.in_image:
            # along itself it makes no error
            projection = np.eye(3) - np.outer(frame.x, frame.x)
        else:
            # in its plane, it is what is measured
            normal = np.cross(frame.x, frame.y)
            projection = np.outer(normal, normal)
        motions[k] = _rigid(points, projection @ moved).reshape(2, 3, 6)
    surfaces = np.array([model.carried_by[edge.name] for edge in measured], dtype=np.int64)
    return Lifts(surfaces, _rounded(motions), free)


def _rigid(points: Array, moved: Array) -> Array:
    """Return the vectors and turns (k, 6) about the origin that move points (m, 3) as stated (m, 3, k)."""
    middle = points.mean(axis=0)
    off = points - middle
    size = np.abs(off).max()
    rows = np.zeros((len(points), 3, 6))
    rows[:, :, :3] = np.eye(3)
    for i in range(3):
        rows[:, :, 3 + i] = np.cross(np.eye(3)[i], off) / size
    motion = np.linalg.lstsq(rows.reshape(-1, 6), moved.reshape(3 * len(points), -1), rcond=1e-9)[0]
    turn = motion[3:].T / size
    return np.concatenate([motion[:3].T - np.cross(turn, middle), turn], axis=1)
