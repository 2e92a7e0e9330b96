"""The lines that a part shows from a place, found from its faces and triangles, without `planner.detectability`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import open3d as o3d
from rendered_images import Renderer

from aspectgraph import Solid

NEAR_PX = 5.0
CORNER_DEG = 25.0
# turns below these are no lines of the part but seams and facets of curved surfaces: between flat faces, beside one
# curved face, and between two (degrees)
SHARP_DEG = 5.0
CHORD_DEG = 20.0
FACET_DEG = 40.0
# near a corner, so many px of a line say nothing of it: as far as 5 px to its side are reached at 25 degrees
LEAVES_PX = NEAR_PX / np.sin(np.radians(CORNER_DEG))


class Arm(NamedTuple):
    """A line that leaves a corner: where it ends (3,), its angle with the edge, and with the nearest line there.

    ``tip_deg`` is the least angle at which another line comes back from where it ends, ``edge_deg`` that of any line at
    the corner with the edge.
    """

    tip: np.ndarray
    seen_deg: float
    fork_deg: float
    tip_deg: float = 90.0
    edge_deg: float = 90.0


class Lines:
    """The lines that a part shows, as dense points, found from faces and triangles alone."""

    def __init__(self, solid: Solid) -> None:
        self.solid = solid
        self.scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        self.scene.add_triangles(
            np.asarray(solid.vertices, np.float32), np.asarray(solid.triangles, np.uint32)
        )
        self.ends = np.array([edge.vertices for edge in solid.edges])
        self.faces = np.array([edge.faces for edge in solid.edges])
        self.turn = np.array([abs(edge.turn_deg) for edge in solid.edges])
        self.curved = np.array([edge.curved for edge in solid.edges])
        self.convex = np.array([edge.dihedral_deg > 0 for edge in solid.edges])
        both = np.array(
            [all(solid.faces[face].curved for face in edge.faces) for edge in solid.edges]
        )
        self.line = self.turn >= np.where(
            both, FACET_DEG, np.where(self.curved, CHORD_DEG, SHARP_DEG)
        )

    def shown(self, eye: np.ndarray) -> np.ndarray:
        """Return which edges (e,) show from a place, but for what hides them."""
        start = self.solid.vertices[self.ends[:, 0]]
        front = (np.einsum("efk,ek->ef", self.solid.normals[self.faces], eye - start) > 1e-9).sum(
            axis=1
        )
        return np.where(self.line, front > 0, self.convex & (front == 1))

    def visible(self, eye: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return which points (n, 3) are hidden by nothing."""
        rays = np.concatenate([np.broadcast_to(eye, points.shape), points - eye], axis=1).astype(
            np.float32
        )
        return self.scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy() >= 1 - 2e-4

    def nearest_px(
        self, renderer: Renderer, pose: np.ndarray, ends: np.ndarray, own: set[int]
    ) -> float:
        """Return how near another visible line comes to an edge, without what meets it beside its ends."""
        a, b = renderer.projected(ends, pose)
        mine = {v for e in own for v in self.ends[e].tolist()}
        best = 100.0
        for e in np.flatnonzero(self.shown(pose[:3, 3])):
            if e in own:
                continue
            p, q = self.solid.vertices[self.ends[e]]
            points = p + np.linspace(0, 1, max(2, int(np.linalg.norm(q - p) / 0.25)))[:, None] * (
                q - p
            )
            image = renderer.projected(points, pose)
            apart = _from_segment(image, a, b)
            if set(self.ends[e].tolist()) & mine:
                beside = np.minimum(
                    np.linalg.norm(image - a, axis=1), np.linalg.norm(image - b, axis=1)
                )
                apart = np.where(beside < LEAVES_PX, 100.0, apart)
            close = apart < min(best, 12.0)
            if close.any():
                seen = self.visible(pose[:3, 3], points[close])
                best = min(best, apart[close][seen].min(initial=100.0))
        return float(best)

    def apart_px(
        self, renderer: Renderer, pose: np.ndarray, points: np.ndarray, own: set[int]
    ) -> np.ndarray:
        """Return how near other visible lines come to points (m, 3) of a line or circle with its own edges; (m,).

        Lines that meet it are not asked about near their common corner. Distances above 12 px are not told apart.
        """
        places = renderer.projected(points, pose)
        mine = {v for e in own for v in self.ends[e].tolist()}
        corners = renderer.projected(self.solid.vertices[sorted(mine)], pose)
        best = np.full(len(points), 12.0)
        low = places.min(axis=0) - 12.0
        high = places.max(axis=0) + 12.0
        for e in np.flatnonzero(self.shown(pose[:3, 3])):
            if e in own:
                continue
            p, q = self.solid.vertices[self.ends[e]]
            a, b = renderer.projected(np.array([p, q]), pose)
            if (np.maximum(a, b) < low).any() or (np.minimum(a, b) > high).any():
                continue
            share = np.linspace(0, 1, max(2, int(np.linalg.norm(b - a)) + 2))[:, None]
            dense = p + share * (q - p)
            image = renderer.projected(dense, pose)
            apart = np.linalg.norm(places[:, None] - image[None], axis=2)
            if set(self.ends[e].tolist()) & mine:
                beside = np.linalg.norm(image[:, None] - corners[None], axis=2).min(axis=1)
                apart[:, beside < LEAVES_PX] = 100.0
            close = np.flatnonzero((apart < best[:, None]).any(axis=0))
            if close.size:
                seen = close[self.visible(pose[:3, 3], dense[close])]
                best = np.minimum(best, apart[:, seen].min(axis=1, initial=100.0))
        return best

    def arms(
        self,
        pose: np.ndarray,
        renderer: Renderer,
        corner: np.ndarray,
        inward: np.ndarray,
        own: set[int],
    ) -> list[Arm]:
        """Return the lines that leave a corner visibly, at an angle with the edge on the part."""
        tips = self.leaving(pose, corner, own)
        image = renderer.projected(np.array([corner, inward, *tips.values()]), pose)
        ways = image[1:] - image[0]
        found = []
        sharpest = min((angle_deg(way, ways[0]) for way in ways[1:]), default=90.0)
        for i, (e, tip) in enumerate(tips.items(), 1):
            wide = angle_deg(tip - corner, inward - corner)
            fork = min(angle_deg(ways[i], way) for k, way in enumerate(ways) if k != i)
            others = renderer.projected(
                np.array([tip, *self.leaving(pose, tip, {e}).values()]), pose
            )
            back = min((angle_deg(one, -ways[i]) for one in others[1:] - others[0]), default=90.0)
            if min(wide, 180 - wide) >= CORNER_DEG:
                found.append(
                    Arm(
                        tip, angle_deg(ways[i], ways[0]), fork, min(back, 90.0), min(sharpest, 90.0)
                    )
                )
        return found

    def leaving(self, pose: np.ndarray, corner: np.ndarray, own: set[int]) -> dict[int, np.ndarray]:
        """Return the other ends (3,) of the lines that leave a corner visibly, by their numbers."""
        vertex = int(np.linalg.norm(self.solid.vertices - corner, axis=1).argmin())
        tips = {}
        for e in np.flatnonzero(
            (self.ends == vertex).any(axis=1) & self.line & self.shown(pose[:3, 3])
        ):
            tip = self.solid.vertices[self.ends[e].sum() - vertex]
            if e not in own and self.visible(pose[:3, 3], (0.97 * corner + 0.03 * tip)[None])[0]:
                tips[int(e)] = tip
        return tips


def angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    """Return the angle between two directions."""
    return float(
        np.degrees(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1)))
    )


def _from_segment(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return np.linalg.norm(points - a - share[:, None] * (b - a), axis=1)
