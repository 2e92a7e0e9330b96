"""Which lamps show the other line at each end of an edge, and let no shadow end beside the edge or that line.

Where a plan asks for corners, another visible line leaves each end of an edge at an angle. At least one such line per
end must differ in brightness on its two sides where it leaves. Where it asks for separation, no border of a shadow may
run beside the edge or that line (`planner.light.shadow_borders`). This is computed for lamps at given places, at points
of each line with the shadows that rays find, and takes no part in proofs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from planner.detectability.conditions import Detectability
from planner.detectability.corners import FITTED_PX
from planner.detectability.image_check import ImageCheck
from planner.light.background import SHARES, seen_beside
from planner.light.shadow_borders import Beside, SeenLine, beside_lines
from planner.light.together import LampSets, Sites

if TYPE_CHECKING:
    from aspectgraph import Solid
    from aspectgraph.solid.ray_scene import RayScene
    from planner.light.demands import PlanToLight

Array = NDArray[np.float64]

# a line is looked at from so near to the corner, px, to no farther than this share of it
_FROM_PX = 4.0
_SHARE = 0.9
# every 3 px: shadows of a few pixels end beside a corner
_POINTS = 9


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
    beside : Beside, optional
        Places beside these lines.
    beside_edges : Beside, optional
        Places beside the edges of each pair.
    """

    sites: Sites
    end: NDArray[np.int_]
    pair: NDArray[np.int_]
    beside: Beside | None = None
    beside_edges: Beside | None = None

    def shown(
        self,
        scene: RayScene,
        places: Array,
        sets: NDArray[np.int_],
        limits: tuple[float, float],
        wanted: NDArray[np.bool_],
    ) -> NDArray[np.bool_]:
        """Return which of the wanted pairs (sets, n) have lines that show at both ends, and no shadow beside them.

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
        wanted : array of bool (s, n)
            Pairs that are asked for.
        """
        shown = wanted.copy()
        if self.beside_edges is not None:
            shown &= _clear(self.beside_edges, scene, places, sets, shown)
        if not len(self.pair):
            return shown
        contrast, step = LampSets(scene, self.sites, places, np.zeros((1, 3))).shown(sets)
        shows = (contrast >= limits[0]) & (step >= limits[1]) & shown[:, self.pair[self.end]]
        if self.beside is not None:
            shows &= _clear(self.beside, scene, places, sets, shows)
        ends = np.zeros((len(sets), len(self.pair)), dtype=bool)
        for line, end in enumerate(self.end.tolist()):
            ends[:, end] |= shows[:, line]
        for end, pair in enumerate(self.pair.tolist()):
            shown[:, pair] &= ends[:, end]
        return shown


def _clear(
    beside: Beside,
    scene: RayScene,
    places: Array,
    sets: NDArray[np.int_],
    wanted: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Return whether no lamp of a set (sets, lines) ends a shadow beside lines, for those that are wanted."""
    asked_of_lamps = np.zeros((len(places), beside.n_lines), dtype=bool)
    for lamps in sets.T:
        np.logical_or.at(asked_of_lamps, lamps, wanted)
    return np.asarray(beside.clear(scene, places, asked_of_lamps)[sets].all(axis=1))


def corners_of(
    plan: PlanToLight,
    solid: Solid,
    scene: RayScene,
    names: Sequence[tuple[int, str]],
    edge_ids: Sequence[Sequence[int]],
) -> Corners:
    """Return the lines that leave the ends of edges in the images of a plan, and what is beside lines and edges.

    Parameters
    ----------
    plan : PlanToLight
        The plan; if it asks for neither corners nor separation, there is nothing.
    solid : Solid
        Its part.
    scene : RayScene
        Of the part.
    names : sequence of (int, str)
        Setting and name of each pair.
    edge_ids : sequence of (sequence of int)
        The edges of each pair; none where it has no ends.

    Returns
    -------
    Corners
        With the lines that a corner may be fitted with; an end that has none is left out.
    """
    required = plan.requirements
    camera = plan.camera
    separation = required.get("separation_px", 0.0)
    least = required.get("min_corner_deg", 0.0)
    poses = np.array(
        [np.asarray(setting.cam2world) for setting in plan.settings], np.float64
    ).reshape(-1, 4, 4)
    pixel = max(camera.pixel_pitch_mm) / camera.image_distance_mm
    edges = _seen_edges(solid, poses, names, edge_ids, separation > 0)
    beside_edges = beside_lines(scene, edges, separation, pixel)
    numbers = np.flatnonzero([bool(ids) and least > 0 for ids in edge_ids])
    ends = np.array(
        [plan.targets[names[k][1]].points for k in numbers.tolist()], np.float64
    ).reshape(-1, 2, 3)
    image = ImageCheck(
        solid,
        [edge_ids[k] for k in numbers.tolist()],
        ends,
        camera,
        Detectability(separation, 0.0, least),
    )
    pairs = np.array([(names[k][0], i) for i, k in enumerate(numbers.tolist())], np.int64).reshape(
        -1, 2
    )
    seen = image.corner_lines(poses, pairs)
    arms = image.arms
    used, end = np.unique(seen.of, return_inverse=True)
    eyes = poses[pairs[seen.of // 2, 0], :3, 3]
    sites = []
    lines = []
    for a, eye in zip(seen.arm.tolist(), eyes, strict=True):
        points = _points_of_arm(arms.corner[a], arms.tip[a], eye, pixel)
        sites.append(
            _compared(solid, scene, int(image.contours.ids[arms.contour[a]]), points, eye, pixel)
        )
        lines.append(SeenLine(eye, points, arms.tip[a] - arms.corner[a]))
    beside = beside_lines(scene, lines, separation, pixel)
    return Corners(_joined(sites), end, numbers[pairs[used // 2, 1]], beside, beside_edges)


def _seen_edges(
    solid: Solid,
    poses: Array,
    names: Sequence[tuple[int, str]],
    edge_ids: Sequence[Sequence[int]],
    asked: bool,
) -> list[SeenLine]:
    """Return a line for each pair, all of whose edges are in one line; without points where there is none."""
    lines = []
    for (setting, _), edges in zip(names, edge_ids, strict=True):
        points = np.empty((0, 3))
        along = np.array([1.0, 0.0, 0.0])
        for edge in edges if asked else ():
            start, end = solid.vertices[list(solid.edges[edge].vertices)]
            points = np.concatenate([points, start + SHARES[:, None] * (end - start)])
            along = end - start
        lines.append(SeenLine(poses[setting, :3, 3], points, along))
    return lines


_Pair = tuple[tuple[Array, Array], tuple[Array, Array] | None]


def _points_of_arm(corner: Array, tip: Array, eye: Array, pixel_rad: float) -> Array:
    """Return points (n, 3) of a line near a corner."""
    length = float(np.linalg.norm(tip - corner))
    pixel = float(np.linalg.norm(corner - eye)) * pixel_rad
    last = min(FITTED_PX * pixel, _SHARE * length)
    steps = np.linspace(min(_FROM_PX * pixel, last / 2), last, _POINTS)
    return np.asarray(corner + steps[:, None] * (tip - corner) / length)


def _compared(
    solid: Solid, scene: RayScene, edge_id: int, points: Array, eye: Array, pixel_rad: float
) -> list[_Pair]:
    """Return what is compared at points of a line: both faces, or the seen one with what is behind."""
    edge = solid.edges[edge_id]
    normals = solid.normals[list(edge.faces)]
    front = normals @ (eye - points[0]) > 0
    if front.all():
        return [((point, normals[0]), (point, normals[1])) for point in points]
    along = np.subtract(*solid.vertices[list(edge.vertices)])
    seen = int(front.argmax())
    places, behind = seen_beside(scene, eye, points, (along, normals[1 - seen]), pixel_rad)
    met = np.isfinite(places[:, 0])
    return [
        ((points[i], normals[seen]), (places[i], behind[i]) if met[i] else None)
        for i in range(len(points))
    ]


def _joined(arms: Sequence[Sequence[_Pair]]) -> Sites:
    places: list[Array] = []
    compared = []
    owner = []
    for k, arm in enumerate(arms):
        for first_side, second_side in arm:
            first = len(places)
            places.append(np.concatenate(first_side))
            if second_side is not None:
                places.append(np.concatenate(second_side))
            compared.append((first, -1 if second_side is None else first + 1))
            owner.append(k)
    sides = np.array(places).reshape(-1, 6)
    return Sites(
        sides[:, :3],
        sides[:, 3:],
        np.array(compared, int).reshape(-1, 2),
        np.array(owner, int),
        len(arms),
    )
