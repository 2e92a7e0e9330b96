"""Edges and covariances the tests of `errors` share."""

import numpy as np

F = 25.0
PITCH = (0.01, 0.013)
PAPER_COVARIANCE = np.diag([0.03] * 3 + [0.003] * 3)
# 50 mm edge, about 300 mm away, turned and tilted.
EDGE = np.array([[-25.0, -4.0, -280.0], [22.0, 10.0, -270.0]])
CAMERA = {"focal_length_mm": F, "pixel_pitch_mm": PITCH}


def random_edges(n, rng):
    """Draw n edges of 20 to 80 mm, 200 to 600 mm away, none closer than 17 degrees to the line of sight."""
    edges = []
    while len(edges) < n:
        depth = rng.uniform(200.0, 600.0)
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        if np.hypot(*direction[:2]) < 0.3:
            continue
        centre = np.array([*(rng.uniform(-0.2, 0.2, 2) * depth), F - depth])
        edges.append(centre + np.array([[-0.5], [0.5]]) * rng.uniform(20.0, 80.0) * direction)
    return np.array(edges)


def random_covariance(rng, rotation_std, translation_variance=0.03):
    """Draw a correlated covariance with the given variances."""
    factor = rng.normal(size=(6, 12))
    covariance = factor @ factor.T
    std = np.array([np.sqrt(translation_variance)] * 3 + [rotation_std] * 3) / np.sqrt(
        np.diag(covariance)
    )
    return covariance * std[:, None] * std
