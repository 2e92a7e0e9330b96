"""What one registration needs: the samples of a part's edges at a planned pose, and how they move with the unknowns."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Circle
from planner.camera.camera import Camera
from planner.measuring.fit import scale_of
from planner.measuring.image.part_edge import PartEdge
from planner.measuring.image.samples import Samples, across_of, pixels_of
from planner.measuring.part_model import POSE, PartModel
from planner.measuring.poses.registered import displaced

Array = NDArray[np.float64]

STRETCH_RAD = np.pi / 6
"""Angle of a round edge whose step has one sign.

Around a bore, its wall is brighter than the face here, and darker there.
"""
LEAST_SAMPLES = 50
"""An image with fewer samples is not registered."""
LEAST_NOISE_PX = 0.05
"""Standard deviation that a single point has at least."""

_MOST_BIASES = 3.0
# difference quotients by the pose, mm and rad
_STEPS = np.array([1e-3] * 3 + [1e-5] * 3)


class NotRegisteredError(Exception):
    """An image does not show the part as the plan has it; says why.

    Parameters
    ----------
    what : str
        What is wrong.
    perhaps : str
        What may be the reason, if no better one is found.

    Attributes
    ----------
    what : str
        What is wrong, without the reason.
    """

    def __init__(self, what: str, perhaps: str = "") -> None:
        super().__init__(f"{what}; {perhaps}" if perhaps else what)
        self.what = what


@dataclass
class Task:
    """What one registration needs.

    Attributes
    ----------
    model, camera
        The part and the camera.
    planned : array (4, 4)
        The planned pose.
    prior : array (n, n)
        What is known of pose and surfaces.
    samples : Samples
        Visible samples (m) that are apart from each other; their edges are numbered as in ``edges``.
    edges : list of PartEdge
        The edges that have samples, in the order of the samples.
    unknowns : array of int (e, 6)
        Unknowns of the surfaces of each edge.
    moves : array (m, 3, 6)
        How samples move with these.
    bias_px : float
        Standard deviation of where an edge is found as a whole.
    """

    model: PartModel
    camera: Camera
    planned: Array
    prior: Array
    samples: Samples
    edges: list[PartEdge]
    unknowns: NDArray[np.int64]
    moves: Array
    bias_px: float

    @cached_property
    def own(self) -> list[slice]:
        """Where the samples of each edge are: they are in the order of the edges."""
        ends = np.searchsorted(self.samples.edge, np.arange(len(self.edges) + 1)).tolist()
        return [slice(first, last) for first, last in itertools.pairwise(ends)]

    @cached_property
    def information(self) -> Array:
        """Inverse of the prior (n, n)."""
        return np.asarray(np.linalg.inv(self.prior))

    @cached_property
    def spans(self) -> list[float]:
        """Angle of each edge that is round, rad; 0 of lines."""
        shapes = (edge.geometry for edge in self.edges)
        return [one.span_rad if isinstance(one, Circle) else 0.0 for one in shapes]

    @cached_property
    def stretch(self) -> NDArray[np.int64]:
        """Number of the stretch (m,) that each sample is in: an edge, or `STRETCH_RAD` of a round one."""
        parts = np.maximum(np.round(np.array(self.spans) / STRETCH_RAD), 1).astype(np.int64)
        first = np.concatenate([[0], np.cumsum(parts)])
        edge = self.samples.edge
        within = (self.samples.share * parts[edge]).astype(np.int64)
        return np.asarray(first[edge] + np.minimum(within, parts[edge] - 1))

    def of_surfaces(self, x: Array) -> Array:
        """Return the unknowns of the surfaces that carry each sample (m, 6)."""
        return np.asarray(x[self.unknowns][self.samples.edge])

    def places(self, x: Array) -> tuple[Array, Array]:
        """Return pose (4, 4) and points (m, 3) at unknowns."""
        points = self.samples.points + np.einsum("mij,mj->mi", self.moves, self.of_surfaces(x))
        return displaced(self.planned, x[:POSE])[0], points

    def predicted(self, x: Array) -> tuple[Array, Array]:
        """Return predicted places and unit vectors across (m, 2)."""
        pose, points = self.places(x)
        return (
            pixels_of(points, pose, self.camera),
            across_of(points, self.samples.tangents, pose, self.camera),
        )

    def design(self, x: Array, across: Array) -> Array:
        """Return how far samples move across by the pose and by the six numbers of their surfaces; (m, 12)."""
        _, points = self.places(x)
        moved = displaced(self.planned, x[:POSE] + np.vstack([np.diag(_STEPS), -np.diag(_STEPS)]))
        images = np.array([pixels_of(points, pose, self.camera) for pose in moved])
        slopes = (images[:POSE] - images[POSE:]) / (2 * _STEPS[:, None, None])
        by_pose = np.einsum("kmi,mi->mk", slopes, across)
        turn = displaced(self.planned, x[:POSE])[0][:3, :3]
        # a point moves against the camera
        by_point = -by_pose[:, :3] @ turn.T
        by_surface = np.einsum("mi,mij->mj", by_point, self.moves)
        return np.concatenate([by_pose, by_surface], axis=1)

    def edge_means(self, residual: Array, good: NDArray[np.bool_]) -> Array:
        """Return for each sample the median of its edge's residuals, px, as far as an edge's bias explains it."""
        means = np.zeros(len(self.edges))
        most = _MOST_BIASES * self.bias_px
        for k, own in enumerate(self.own):
            known = residual[own][good[own]]
            if len(known) >= 4:
                means[k] = min(max(float(np.median(known)), -most), most)
        return np.asarray(means[self.samples.edge])


@dataclass
class Found:
    """What was found in one image: offsets (m,) across, and which samples count."""

    offset: Array
    good: NDArray[np.bool_]
    state: NDArray[np.int64]
    blur_px: Array


class Scan(NamedTuple):
    """What was found at some unknowns.

    Attributes
    ----------
    x : array (n,)
        Unknowns.
    centres, across : array (m, 2)
        Where the samples are predicted, px, and unit vectors across.
    found : list of Found
        What was found in each image.
    """

    x: Array
    centres: Array
    across: Array
    found: list[Found]


def registration_task(
    model: PartModel, camera: Camera, planned: Array, prior: Array, bias_px: float
) -> Task:
    """Return what a registration needs.

    Parameters
    ----------
    model, planned, prior, bias_px
        See `Task`.
    camera : Camera
        The camera.

    Raises
    ------
    NotRegisteredError
        If too few samples are visible.
    """
    edges = model.edges.edges
    shown = model.shown(planned, camera)
    chosen = shown.samples.chosen(shown.apart(edges, shown.samples.edge, shown.pixels))
    if len(chosen.edge) < LEAST_SAMPLES:
        raise NotRegisteredError(
            f"only {len(chosen.edge)} samples of edges are visible and apart from each other"
        )
    used = np.unique(chosen.edge)
    number = np.searchsorted(used, chosen.edge)
    kept = [edges[k] for k in used]
    moves = np.zeros((len(number), 3, 6))
    firsts = np.searchsorted(number, np.arange(len(kept) + 1))
    for edge, (first, last) in zip(kept, itertools.pairwise(firsts), strict=True):
        moves[first:last] = model.displacement(edge, chosen.points[first:last])
    samples = Samples(
        number, chosen.share, chosen.points, chosen.tangents, chosen.visible, chosen.apart
    )
    unknowns = np.array([model.unknowns_of(edge) for edge in kept])
    return Task(model, camera, planned, prior, samples, kept, unknowns, moves, bias_px)


def residual_scale(residual: Array) -> float:
    """Return a robust standard deviation of residuals about their median, px."""
    return scale_of(residual - np.median(residual)) if len(residual) else 1.0
