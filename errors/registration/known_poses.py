"""What registering an image to the part's own edges leaves unknown of the camera's pose, before there is an image.

Notation
--------
x   unknowns: displacement of the camera (6), then three numbers of each surface, normal with mean 0 and known variances
A   how the image of a sample moves across its edge with x, px
w   1 / variance of what is found of a sample's stretch of its edge
b   biases of an edge; M how far they move its samples

Stretches of edges that a pose shows give the information of `errors.registration.posterior`, edge after edge:

    P⁻¹ + q Σ_edges [Σ w A Aᵀ − (Σ w A Mᵀ) (1/Var b + Σ w M Mᵀ)⁻¹ (Σ w M Aᵀ)],   q the share of the edges that are found

Its Cholesky factor has the pose last. So the pose's own covariance, with the surfaces not known, is the inverse of its
last block; and the variance of a value with the gradient g is |y|², L y = g. All are plain loops in one order: what a
plan decides by them is the same on all machines.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.registration.known_pose_loops import POSE, find_known_poses

Array = NDArray[np.float64]


class Stretches(NamedTuple):
    """Stretches (m) of edges (e) that surfaces (k) carry.

    Attributes
    ----------
    points, tangents : array (m, 3)
        Their middles, mm, and unit vectors along them.
    lengths : array (m,)
        Along the edge, mm.
    moves : array (m, 3, 6)
        How they move with the numbers of both surfaces of their edge.
    edge : array of int (m,)
        Which edge each is of, ascending.
    along : array (m,)
        Where on it their middles are, from 0 to 1.
    spans : array (e,)
        Angle of each edge that is round, rad; 0 of lines.
    surfaces : array of int (e, 2)
        The surfaces of each edge.
    free : array of bool (m, n, n)
        Whether they can be seen from far away in directions of an octahedral grid.
    turn : array (3, 3)
        From the part's frame to the grid's.
    sigmas : array (k, 3)
        Standard deviations of the numbers of the surfaces before the image, mm; positive.
    """

    points: Array
    tangents: Array
    lengths: Array
    moves: Array
    edge: NDArray[np.int64]
    along: Array
    spans: Array
    surfaces: NDArray[np.int64]
    free: NDArray[np.bool_]
    turn: Array
    sigmas: Array


class Imaging(NamedTuple):
    """How a camera shows them, and how well they are found.

    Attributes
    ----------
    focal_px : tuple of float
        Image distance over pixel pitch, along x and y.
    centre_px : tuple of float
        Where the axis meets the image.
    limits_px : tuple of float
        Width and height of the image.
    focus : tuple of float
        1 / the depth in focus; by how much 1 / depth differs where the blur is still small, 1/mm; and how many times
        that blur an edge may have. Beyond it once, the variance of found points grows with the blur's third power.
    noise_px, correlation_px : float
        Standard deviation of a found point, and how far apart points are independent.
    bias_px : float
        Standard deviation of an edge's bias.
    margin_px, apart_px, end_px : float
        Strip along the border without samples; how far other edges must be in the image; what is not sampled at each
        end of an edge.
    share : float
        Share of what is shown that is found.
    """

    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    limits_px: tuple[float, float]
    focus: tuple[float, float, float]
    noise_px: float
    correlation_px: float
    bias_px: float
    margin_px: float
    apart_px: float
    end_px: float
    share: float


class Values(NamedTuple):
    """Values (t) whose variance is asked for, each at one pose.

    A surface that is off moves an entity as a rigid body, as far as a value feels it: by a vector and a small turn
    about the origin of the part.

    Attributes
    ----------
    pose : array of int (t,)
        At which pose, ascending.
    gradient : array (t, e, 6)
        By the displacement of the camera, of each entity alone.
    surfaces : array of int (t, e, 2)
        The surfaces that carry each entity; -1 for none.
    motions : array (t, e, 2, 3, 6)
        How it moves with the numbers of each: vector, mm, and turn, rad.
    """

    pose: NDArray[np.int64]
    gradient: Array
    surfaces: NDArray[np.int64]
    motions: Array


class KnownPoses(NamedTuple):
    """What is known of poses (n) after registration.

    Attributes
    ----------
    covariance : array (n, 6, 6)
        Of the displacement of the camera.
    root : array (n, 6, 6)
        S with S S' that covariance.
    variance : array (t,)
        Of the values, by pose and surfaces together.
    by_pose : array (t,)
        Of the values, by the pose alone.
    """

    covariance: Array
    root: Array
    variance: Array
    by_pose: Array


def known_poses(
    world_to_camera: Array,
    pose_covariance: Array,
    stretches: Stretches,
    imaging: Imaging,
    values: Values,
) -> KnownPoses:
    """Return what registration leaves unknown of poses.

    Parameters
    ----------
    world_to_camera : array (n, 4, 4)
        Planned poses.
    pose_covariance : array (6, 6)
        Of the displacement of the camera before the image; positive definite.
    stretches : Stretches
        The part's edges.
    imaging : Imaging
        The camera.
    values : Values
        What is measured.

    Returns
    -------
    KnownPoses
        Covariances of poses, and variances of values.
    """
    n = len(world_to_camera)
    covariance = np.zeros((n, POSE, POSE))
    root = np.zeros((n, POSE, POSE))
    variance = np.zeros((len(values.pose), 2))
    find_known_poses(
        np.ascontiguousarray(world_to_camera, dtype=np.float64),
        np.ascontiguousarray(pose_covariance, dtype=np.float64),
        stretches,
        imaging,
        values,
        covariance,
        root,
        variance,
    )
    return KnownPoses(covariance, root, variance[:, 0].copy(), variance[:, 1].copy())
