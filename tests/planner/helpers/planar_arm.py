"""A planar arm of two links among points, with distances in closed form; nothing of planner.robotcell is used."""

import numpy as np


class PlanarArm:
    """Two thin links in a plane; obstacles are segments (n, 2, 2), mm."""

    def __init__(self, obstacles, lengths=(400.0, 300.0), keep=0.0):
        self.obstacles = np.asarray(obstacles, dtype=float)
        self.lengths = lengths
        self.lower = np.full(2, -np.pi)
        self.upper = np.full(2, np.pi)
        self.levers_mm = np.array([sum(lengths), lengths[1]])
        self.keep = keep
        self.asked = 0

    def points(self, joints):
        """Shoulder, elbow and tip (n, 3, 2)."""
        joints = np.atleast_2d(joints)
        first, second = self.lengths
        a = joints[:, 0]
        b = a + joints[:, 1]
        elbow = first * np.stack([np.cos(a), np.sin(a)], axis=1)
        tip = elbow + second * np.stack([np.cos(b), np.sin(b)], axis=1)
        return np.stack([np.zeros_like(elbow), elbow, tip], axis=1)

    def free_shares(self, joints, turn, reach):
        motion = (self.levers_mm * np.abs(turn)).sum()
        gaps = self.distances(joints) - self.keep
        shares = gaps / motion if motion > 0 else np.where(gaps > 0, np.inf, -1.0)
        return np.minimum(shares, reach)

    def distances(self, joints):
        points = self.points(joints)
        self.asked += len(points)
        gaps = [
            segment_distances(points[:, k : k + 2], segment)
            for segment in self.obstacles
            for k in range(2)
        ]
        return np.min(gaps, axis=0)


def segment_distances(links, segment):
    """Distances (n,) of segments (n, 2, 2) from a segment (2, 2) in a plane."""
    segments = np.broadcast_to(segment, links.shape)
    gaps = [_point_distances(links[:, k], segments) for k in range(2)]
    gaps += [_point_distances(segments[:, k], links) for k in range(2)]
    apart = np.min(gaps, axis=0)
    crosses = (_side(segments, links[:, 0]) * _side(segments, links[:, 1]) < 0) & (
        _side(links, segments[:, 0]) * _side(links, segments[:, 1]) < 0
    )
    return np.where(crosses, 0.0, apart)


def _point_distances(points, segments):
    along = segments[:, 1] - segments[:, 0]
    square = np.maximum((along**2).sum(axis=1), 1e-300)
    share = np.clip(((points - segments[:, 0]) * along).sum(axis=1) / square, 0, 1)
    return np.linalg.norm(points - segments[:, 0] - share[:, None] * along, axis=1)


def _side(segments, points):
    along = segments[:, 1] - segments[:, 0]
    to = points - segments[:, 0]
    return along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0]
