"""Poses near given ones, far and fine changes mixed."""

from __future__ import annotations

import numpy as np

from planner.camera.pose import look_at


def perturbed(cam2world: np.ndarray, distance_mm: float, rng: np.random.Generator) -> np.ndarray:
    """Perturb poses (n, 4, 4): swing about the point in focus, shift across the view and along it, turn, roll.

    Every pose draws its own scale, so that both far and fine changes are tried.
    """
    n = len(cam2world)
    scale = 10.0 ** rng.uniform(-2.3, 0.0, (n, 1))
    shift = rng.normal(size=(n, 3)) * scale * distance_mm * [0.3, 0.3, 0.2]
    pivot = cam2world[:, :3, 3] + distance_mm * cam2world[:, :3, 2]
    swing = rng.normal(size=(n, 2)) * scale * 0.6 * (rng.random((n, 1)) < 0.6)
    roll = np.where(
        rng.random(n) < 0.3, rng.uniform(-np.pi, np.pi, n), rng.normal(size=n) * scale[:, 0]
    )
    # looking along z from the origin is the identity, so this is the turn in the camera's own axes
    local = look_at(
        np.zeros((n, 3)), np.array([0.0, 0.0, 1.0]), pan=swing[:, 0], tilt=swing[:, 1], roll=roll
    )
    moved = cam2world.copy()
    moved[:, :3, :3] = cam2world[:, :3, :3] @ local[:, :3, :3]
    moved[:, :3, 3] = pivot - distance_mm * moved[:, :3, 2]
    moved[:, :3, 3] += np.einsum("nij,nj->ni", moved[:, :3, :3], shift)
    return moved
