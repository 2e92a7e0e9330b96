"""Which lamps show the other line at each end of an edge: without it, there is no corner that is found in the image.

Where a plan asks for corners, another visible line leaves each end of an edge at an angle. At least one such line per
end must differ in brightness on its two sides where it leaves. This is computed for lamps at given places, at three
points of each line with the shadows that rays find, and takes no part in proofs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from aspectgraph.solid.ray_scene import RayScene
from planner.light.together import LampSets, Sites
from planner.showing.contours import contours_of, relation_to
from planner.showing.corners import arms_of, corner_arms

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.camera.camera import Camera
    from planner.light.demands import Planned

Array = NDArray[np.float64]

# a line is looked at from so near to the corner to so far, px, but no farther than this share of it
_FROM_PX, _TO_PX, _SHARE = 4.0, 28.0, 0.9
_POINTS = 3


@dataclass(frozen=True)
class Corners:
    """Lines that leave the ends of what is measured.

    Attributes
    ----------
    sites : Sites
        Both sides of each line, whose number takes the place of the pair's.
    end : array of int (a,)
        For each line, the number of the end that it leaves.
    pair : array of int (e,)
        For each end, the pair it belongs to.
    """

    sites: Sites
    end: NDArray[np.int_]
    pair: NDArray[np.int_]

    def shown(
        self, scene: RayScene, places: Array, sets: NDArray[np.int_], limits: tuple[float, float], n: int
    ) -> NDArray[np.bool_]:
        """Return which pairs (sets, n) have a line that shows at both ends, under sets of lamps at places (p, 3).

        Parameters
        ----------
        scene : RayScene
            Of the part.
        places : array (p, 3)
            Of lamps, mm.
        sets : array of int (s, size)
            Numbers of the lamps that are on.
        limits : tuple of float
            Least contrast and step.
        n : int
            Number of pairs.
        """
        found = np.ones((len(sets), n), dtype=bool)
        if not len(self.pair):
            return found
        contrast, step = LampSets(scene, self.sites, places, np.zeros((1, 3))).shown(sets)
        shows = (contrast >= limits[0]) & (step >= limits[1])
        ends = np.zeros((len(sets), len(self.pair)), dtype=bool)
        for line, end in enumerate(self.end.tolist()):
            ends[:, end] |= shows[:, line]
        for end, pair in enumerate(self.pair.tolist()):
            found[:, pair] &= ends[:, end]
        return found


def corners_of(
    plan: Planned, solid: Solid, names: Sequence[tuple[int, str]], edge_ids: Sequence[Sequence[int]]
) -> Corners:
    """Return the lines that leave the ends of edges in the images of a plan.

    Parameters
    ----------
    plan : Planned
        The plan; if it does not ask for corners, there are none.
    solid : Solid
        Its part.
    names : sequence of (int, str)
        Setting and name of each pair.
    edge_ids : sequence of (sequence of int)
        The edges of each pair; none where it has no ends.

    Returns
    -------
    Corners
        Without the lines that are hidden or leave at too small an angle; an end that has none is left out.
    """
    least = plan.requirements.get("min_corner_deg", 0.0)
    asked = np.array([bool(one) and least > 0 for one in edge_ids], dtype=bool)
    contours, camera = contours_of(solid), plan.camera
    relations = np.array([relation_to(contours, one, 0.0) for one in edge_ids], np.uint8).reshape(
        len(names), len(contours.ids)
    )
    ends = np.array([plan.entities[name] for _, name in names], np.float64).reshape(-1, 2, 3)
    poses = np.array([np.asarray(one.cam2world) for one in plan.settings], np.float64).reshape(-1, 4, 4)
    arms = arms_of(contours, relations, ends, asked)
    pairs = np.array([(names[k][0], k) for k in np.flatnonzero(asked).tolist()], np.int64).reshape(-1, 2)
    angles, seen_at, of, wide, arm = corner_arms(poses, pairs, _scale(camera), contours, arms)
    scene = RayScene(solid.vertices, solid.triangles, n_threads=1)
    eyes = poses[pairs[of // 2, 0], :3, 3]
    good = wide & (np.minimum(angles, 180.0 - angles) >= least)
    good &= scene.cast(eyes, seen_at - eyes)["t_hit"] >= 1.0 - 1e-4 if len(eyes) else good
    used, end = np.unique(of[good], return_inverse=True)
    sites = [
        _sites_of_arm(solid, contours.ids[arms.contour[a]], arms.corner[a], arms.tip[a], eye, camera)
        for a, eye in zip(arm[good], eyes[good], strict=True)
    ]
    return Corners(_joined(sites), end, pairs[used // 2, 1])


def _scale(camera: Camera) -> Array:
    matrix = camera.matrix
    return np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]])


_Compared = tuple[tuple[Array, Array], tuple[Array, Array] | None]


def _sites_of_arm(solid: Solid, edge_id: int, corner: Array, tip: Array, eye: Array, camera: Camera) -> list[_Compared]:
    """Return what is compared at points of a line near a corner: both faces, or the seen one with a dark ground."""
    edge = solid.edges[int(edge_id)]
    length, away = float(np.linalg.norm(tip - corner)), float(np.linalg.norm(corner - eye))
    pixel = away * max(camera.pixel_pitch_mm) / camera.image_distance_mm
    last = min(_TO_PX * pixel, _SHARE * length)
    points = corner + np.linspace(min(_FROM_PX * pixel, last / 2), last, _POINTS)[:, None] * (tip - corner) / length
    normals = solid.normals[list(edge.faces)]
    front = normals @ (eye - corner) > 0
    if front.all():
        return [((point, normals[0]), (point, normals[1])) for point in points]
    return [((point, normals[int(front.argmax())]), None) for point in points]


def _joined(arms: Sequence[Sequence[_Compared]]) -> Sites:
    places: list[Array] = []
    compared, owner = [], []
    for k, arm in enumerate(arms):
        for one, other in arm:
            first = len(places)
            places.append(np.concatenate(one))
            if other is not None:
                places.append(np.concatenate(other))
            compared.append((first, -1 if other is None else first + 1))
            owner.append(k)
    found = np.array(places).reshape(-1, 6)
    return Sites(found[:, :3], found[:, 3:], np.array(compared, int).reshape(-1, 2), np.array(owner, int), len(arms))
