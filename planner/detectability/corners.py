"""The other lines that leave the ends of an edge, and their angles with it and with others in the image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aspectgraph.solid.rims import CORNER_DEG, edges_that_show
from ground.decorators import entry_kernel, kernel_without_refcounts

if TYPE_CHECKING:
    from aspectgraph import Solid


# Lines that a part may show in an image: its sharp edges, and contours where curved faces turn
# away.
#
# A *contour* is an edge that shows from a viewpoint: a sharp one, unless a face beside it hides
# it there, or one between two facets of a curved surface, the one facing the camera and the other
# not.


# what an edge of the part is to an entity
OTHER = 0
OWN = 1
CONNECTED = 2
# bits of `Contours.kinds`
SHARP = 1
CONVEX = 2
CURVED = 4
# whether an edge shows, by its kind and how many of its faces turn to the camera: smooth ones where one turns away,
# sharp ones where none does, and convex ones in both cases
SHOWS = np.array(
    [[0, not kind & SHARP or kind & CONVEX > 0, kind & SHARP > 0] for kind in range(8)], np.int64
)


class Contours(NamedTuple):
    """Edges (m) of a part that may be contours.

    Attributes
    ----------
    vertices : array (v, 3)
        Corners of the part, mm.
    ends : array of int (m, 2)
        Vertex numbers.
    planes : array (f, 4)
        Unit normals and offsets of the part's faces: n·x > o in front.
    faces : array of int (m, 2)
        Their faces.
    kinds : array of uint8 (m,)
        Bits `SHARP`, `CONVEX` and `CURVED`, which are chords.
    ids : array of int (m,)
        Numbers in ``solid.edges``.
    """

    vertices: NDArray[np.float64]
    ends: NDArray[np.int64]
    planes: NDArray[np.float64]
    faces: NDArray[np.int64]
    kinds: NDArray[np.uint8]
    ids: NDArray[np.int64]


def contours_of(solid: Solid) -> Contours:
    """Return the edges of a part that may be contours from some viewpoint.

    Parameters
    ----------
    solid : Solid
        The part.

    Returns
    -------
    Contours
        Without the smooth edges of hollows, which are hidden wherever one of their faces turns away.
    """
    shows = edges_that_show(solid)
    turns = np.array([edge.dihedral_deg for edge in solid.edges])
    ids = np.flatnonzero(shows | (turns > 0))
    edges = [solid.edges[i] for i in ids]
    ends = np.array([edge.vertices for edge in edges], np.int64).reshape(-1, 2)
    faces = np.array([edge.faces for edge in edges], np.int64).reshape(-1, 2)
    vertices = np.ascontiguousarray(solid.vertices, np.float64)
    normals = np.asarray(solid.normals, np.float64)
    offsets = np.zeros(len(normals))
    offsets[faces] = np.einsum("efk,ek->ef", normals[faces], vertices[ends[:, 0]])
    curved = np.array([edge.curved for edge in edges], bool)
    kinds = (
        np.where(shows[ids], SHARP, 0)
        | np.where(turns[ids] > 0, CONVEX, 0)
        | np.where(curved, CURVED, 0)
    )
    planes = np.ascontiguousarray(np.column_stack([normals, offsets]))
    return Contours(vertices, ends, planes, faces, kinds.astype(np.uint8), ids.astype(np.int64))


Meeting = dict[int, list[int]]
"""Vertex to the contours that end there."""


def meeting(contours: Contours) -> Meeting:
    """Return which contours end at which vertex."""
    at: Meeting = {}
    for e, (a, b) in enumerate(contours.ends.tolist()):
        at.setdefault(a, []).append(e)
        at.setdefault(b, []).append(e)
    return at


def relation_to(
    contours: Contours, at: Meeting, edge_ids: Sequence[int], radius_mm: float
) -> NDArray[np.uint8]:
    """Return what each edge (m,) is to an entity: another one, its own, or connected to it at a vertex.

    Connected are the edges that meet it, and of curves that meet it the next chords. Where the wall of a rim or arc
    turns away, the wall's contour touches the curve: another line, which is near for as long as it takes to leave.

    Parameters
    ----------
    contours : Contours
        Of the part.
    at : dict
        See `meeting`.
    edge_ids : sequence of int
        Edges of the entity.
    radius_mm : float
        How far from the vertex chords still count as connected.
    """
    relation = np.full(len(contours.ids), OTHER, np.uint8)
    ids = np.array(edge_ids, np.int64)
    places = np.searchsorted(contours.ids[:-1], ids)
    # not every edge is a contour
    same_edge = places[contours.ids[places] == ids] if relation.size else places[:0]
    is_curve = _has_round_wall(contours, at, same_edge)
    for vertex in np.unique(contours.ends[same_edge]).tolist():
        middle = contours.vertices[vertex].tolist()
        reached = {vertex}
        waiting = [vertex]
        while waiting:
            here = waiting.pop()
            for e in at[here]:
                if here != vertex and not contours.kinds[e] & CURVED:
                    continue
                if is_curve and not contours.kinds[e] & SHARP:
                    continue
                relation[e] = CONNECTED
                for other in contours.ends[e].tolist() if contours.kinds[e] & CURVED else ():
                    if other in reached:
                        continue
                    if math.dist(contours.vertices[other].tolist(), middle) <= radius_mm:
                        reached.add(other)
                        waiting.append(other)
    relation[same_edge] = OWN
    return relation


def _has_round_wall(contours: Contours, at: Meeting, own: NDArray[np.int64]) -> bool:
    """Return whether smooth contours may begin between two of an entity's own edges: that is so of chords only."""
    vertices, count = np.unique(contours.ends[own], return_counts=True)
    between = (e for vertex in vertices[count > 1].tolist() for e in at[vertex])
    return any(not contours.kinds[e] & SHARP for e in between)


# Which lines at the ends of entities show in images, as far as their own two faces do not hide
# them; compiled.


# for dividing by a depth
_TINY = 1e-9


@entry_kernel(error_model="numpy")
def arm_images(poses: Any, pairs: Any, scale: Any, lines: Any, arms: Any, found: Any) -> int:
    """Write which arms show in images, in the order of pairs and arms; return how many there are.

    Parameters
    ----------
    poses : array (n, 4, 4)
        Cam2world.
    pairs : array of int (p, 2)
        Pose and entity.
    scale : array (4,)
        Pixels per unit of slope in x and y, and the principal point, px.
    lines : tuple
        `PartLines.compiled`.
    arms : tuple
        Where those of each entity begin (k + 1,), their contours (a,), corners, tips and other ends of the entities
        (3, a, 3).
    found : tuple
        To be written: number of the pair and of the arm (q, 2), images in px and depths in mm of the three (3, q, 3).
    """
    first, contour, points = arms
    numbers, images = found
    planes = lines[2]
    faces = lines[3]
    kinds = lines[4]
    count = 0
    for p in range(len(pairs)):
        pose = poses[pairs[p, 0]]
        k = pairs[p, 1]
        for a in range(first[k], first[k + 1]):
            e = contour[a]
            front = 0
            for f in faces[e]:
                side = (
                    planes[0, f] * pose[0, 3]
                    + planes[1, f] * pose[1, 3]
                    + planes[2, f] * pose[2, 3]
                )
                front += side > planes[3, f]
            if not SHOWS[kinds[e], front]:
                continue
            before = True
            for i in range(3):
                before &= _image(pose, scale, points[i, a], images[i, count])
            if before:
                numbers[count, 0] = p
                numbers[count, 1] = a
                count += 1
    return count


@kernel_without_refcounts(error_model="numpy")
def _image(pose: Any, scale: Any, point: Any, image: Any) -> bool:
    """Write the image of a point in px, and its depth in mm; return whether it is in front of the camera."""
    x = point[0] - pose[0, 3]
    y = point[1] - pose[1, 3]
    z = point[2] - pose[2, 3]
    depth = pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z
    safe = max(depth, _TINY)
    image[0] = (pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z) / safe * scale[0] + scale[2]
    image[1] = (pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z) / safe * scale[1] + scale[3]
    image[2] = depth
    return depth > 0.0


Array = NDArray[np.float64]

# an arm is looked at so far from the corner, px, and at most at this share of its length
_ALONG_PX = 6.0
_ALONG = 0.5
# a line is fitted to an arm so far from the corner at most, px
FITTED_PX = 28.0
# blur shows a line much stronger than another one so far beside itself, px
_BLURRED_PX = 1.5
# for dividing by a tangent
_LEAST_DEG = 1e-3


class Arms(NamedTuple):
    """Sharp edges (a) that leave the ends of entities, in the order of these.

    Attributes
    ----------
    entity, end : array of int (a,)
        Whose they are, and of which end.
    contour : array of int (a,)
        Numbers in `Contours`.
    corner, tip : array (a, 3)
        Where they begin and end, mm.
    inward : array (a, 3)
        The entity's other end.
    wide : array of bool (a,)
        Whether the angle is that of a corner on the part; the chords of an arc that the edge runs on in are not.
    beyond : array of int (a, d)
        Contours that meet the edge where it ends, -1 where there are fewer.
    first : array of int (k + 1,)
        Where the arms of each entity begin.
    """

    entity: NDArray[np.int64]
    end: NDArray[np.int64]
    contour: NDArray[np.int64]
    corner: Array
    tip: Array
    inward: Array
    wide: NDArray[np.bool_]
    beyond: NDArray[np.int64]
    first: NDArray[np.int64]


def arms_of(
    contours: Contours,
    at: Meeting,
    relations: NDArray[np.uint8],
    ends: Array,
    has_ends: NDArray[np.bool_],
) -> Arms:
    """Return the edges that leave the ends of entities.

    Parameters
    ----------
    contours : Contours
        Of the part.
    at : dict
        See `meeting`.
    relations : array (k, m)
        See `relation_to`.
    ends : array (k, 2, 3)
        Ends of the entities, mm.
    has_ends : array of bool (k,)
        Entities that have corners.
    """
    rows = []
    sharp = (contours.kinds & SHARP) > 0
    for k in np.flatnonzero(has_ends):
        of_entity = np.unique(contours.ends[relations[k] == OWN])
        for end in range(2):
            distance = np.linalg.norm(contours.vertices[of_entity] - ends[k, end], axis=1)
            vertex = int(of_entity[distance.argmin()])
            for e in at[vertex]:
                if sharp[e] and relations[k, e] != OWN:
                    rows.append((k, end, e, vertex, int(contours.ends[e].sum()) - vertex))
    entity, which, contour, start, stop = np.array(rows, np.int64).reshape(-1, 5).T
    corner = contours.vertices[start]
    tips = contours.vertices[stop]
    inward = ends[entity, 1 - which]
    along = tips - corner
    edge = inward - corner
    length = np.linalg.norm(along, axis=1) * np.linalg.norm(edge, axis=1)
    wide = np.abs((along * edge).sum(axis=1)) <= np.cos(np.radians(CORNER_DEG)) * length
    others = [
        [edge for edge in at[tip] if edge != line]
        for line, tip in zip(contour.tolist(), stop.tolist(), strict=True)
    ]
    beyond = np.full((len(rows), max(map(len, others), default=0)), -1)
    for a, edges in enumerate(others):
        beyond[a, : len(edges)] = edges
    first = np.searchsorted(entity, np.arange(len(has_ends) + 1))
    return Arms(entity, which, contour, corner, tips, inward, wide, beyond, first)


class SeenArms(NamedTuple):
    """Arms (q) in images, as far as an edge's own two faces do not hide them.

    Attributes
    ----------
    angle : array (q,)
        From the edge, at its end, to the arm, 0 to 180 degrees.
    place : array (q, 3)
        A point of the arm near the end, mm.
    of : array of int (q,)
        Number of the pair, doubled, and the end.
    wide : array of bool (q,)
        As of the arms.
    arm : array of int (q,)
        Their numbers.
    length_px : array (q,)
        Of the whole arm in the image.
    last : array (q, 3)
        Where the arm is `FITTED_PX` from the corner, or ends, mm.
    tip_deg : array (q,)
        The least angle at which another line comes back from its tip, 90 degrees if none does or it is far.
    direction : array (q,)
        Of the arm in the image, degrees.
    """

    angle: Array
    place: Array
    of: NDArray[np.int64]
    wide: NDArray[np.bool_]
    arm: NDArray[np.int64]
    length_px: Array
    last: Array
    direction: Array
    tip_deg: Array

    @property
    def bend(self) -> Array:
        """The smaller angle (q,) between the lines of edge and arm, 0 to 90 degrees."""
        return np.minimum(self.angle, 180.0 - self.angle)

    def chosen(self, which: NDArray[Any]) -> SeenArms:
        """Return some of them."""
        return SeenArms(*(field[which] for field in self))

    def fork_deg(self) -> Array:
        """Return the least angle (q,) of each arm with the edge's line or another arm at its end, 0 to 90 degrees.

        Arms have to be in the order of their ends.
        """
        smallest = self.bend
        for apart in range(1, int(np.bincount(self.of).max(initial=0))):
            near = np.flatnonzero(self.of[apart:] == self.of[:-apart])
            between = np.abs(
                (self.direction[near + apart] - self.direction[near] + 180.0) % 360.0 - 180.0
            )
            np.minimum.at(smallest, near, between)
            np.minimum.at(smallest, near + apart, between)
        return smallest

    def long_enough(self, fork_deg: Array, separation_px: float) -> NDArray[np.bool_]:
        """Return which arms (q,) leave enough of themselves for a line fit.

        Points of a line are found across it, to so many pixels on either side. So where another line leaves at an angle
        α, the first s / tan α of an arm show that one, too, and so do the last ones where a line comes back from its
        tip. As much as the first again is needed between, and two separations at least.

        Parameters
        ----------
        fork_deg : array (q,)
            See `fork_deg`.
        separation_px : float
            s.
        """
        mixed = mixed_px(fork_deg, separation_px)
        clear_px = self.length_px - mixed - mixed_px(self.tip_deg, separation_px)
        return np.asarray(clear_px >= np.maximum(2.0 * separation_px, mixed))


def mixed_px(fork_deg: Array, separation_px: float) -> Array:
    """Return how long another line, which leaves at an angle, shows within the separation s across a line: s / tan α.

    Lines are blurred, so s is a little more than is asked of other lines; nothing where nothing is asked.
    """
    across = separation_px + _BLURRED_PX if separation_px > 0 else 0.0
    return np.asarray(across / np.tan(np.radians(np.maximum(fork_deg, _LEAST_DEG))))


def corner_arms(
    cam2world: Array, pairs: NDArray[np.int64], scale: Array, lines: Any, arms: Arms
) -> SeenArms:
    """Return what leaves the ends of entities in the image.

    Parameters
    ----------
    cam2world : array (n, 4, 4)
        Poses.
    pairs : array of int (p, 2)
        Pose and entity.
    scale : array (4,)
        Pixels per unit of slope in x and y, and the principal point, px.
    lines : tuple of array
        `PartLines.compiled` of the part.
    arms : Arms
        Of the entities.
    """
    poses = np.array(cam2world, np.float64, order="C")
    pairs = np.ascontiguousarray(pairs)
    n_longest = int((arms.first[pairs[:, 1] + 1] - arms.first[pairs[:, 1]]).sum())
    numbers = np.empty((n_longest, 2), np.int64)
    points_found = np.empty((3, n_longest, 3))
    points = np.stack([arms.corner, arms.tip, arms.inward])
    n = arm_images(
        poses, pairs, scale, lines, (arms.first, arms.contour, points), (numbers, points_found)
    )
    pair = numbers[:n, 0]
    arm = numbers[:n, 1]
    (corner, tip, inward) = points_found[:, :n]
    along = tip[:, :2] - corner[:, :2]
    edge = inward[:, :2] - corner[:, :2]
    length = np.linalg.norm(along, axis=1)
    ends = (arms.corner[arm], arms.tip[arm])
    depths = (corner[:, 2], tip[:, 2])
    near = _place(ends, depths, _near_share(length))
    last = _place(ends, depths, np.minimum(1.0, FITTED_PX / np.maximum(length, _TINY)))
    direction = np.degrees(np.arctan2(along[:, 1], along[:, 0]))
    no_line = np.full(len(arm), 90.0)
    angle = _angle_deg(along, edge)
    return SeenArms(
        angle, near, 2 * pair + arms.end[arm], arms.wide[arm], arm, length, last, direction, no_line
    )


def tip_lines(
    poses: Array, scale: Array, contours: Contours, arms: Arms, arm: NDArray[np.int64]
) -> tuple[NDArray[np.int64], Array, Array]:
    """Return what comes back from the tips of arms in images.

    Parameters
    ----------
    poses : array (q, 4, 4)
        From where each arm is seen.
    scale : array (4,)
        Pixels per unit of slope in x and y, and the principal point, px.
    contours, arms : Contours, Arms
        Of the part and the entities.
    arm : array of int (q,)
        Numbers of the arms.

    Returns
    -------
    of : array of int (b,)
        Which of the q arms a line comes back from, as far as its own two faces do not hide it.
    angle : array (b,)
        Between arm and line, under 90 degrees.
    place : array (b, 3)
        A point of the line near the tip, mm.
    """
    of, column = np.nonzero(arms.beyond[arm] >= 0)
    contour = arms.beyond[arm[of], column]
    shown = _shown(contours, contour, poses[of, :3, 3])
    of = of[shown]
    contour = contour[shown]
    tips = arms.tip[arm[of]]
    ends = contours.vertices[contours.ends[contour]]
    second = np.linalg.norm(ends[:, 0] - tips, axis=1) < np.linalg.norm(ends[:, 1] - tips, axis=1)
    far = np.where(second[:, None], ends[:, 1], ends[:, 0])
    corner, tip, other = (
        images(poses[of], scale, points) for points in (arms.corner[arm[of]], tips, far)
    )
    back = corner[:, :2] - tip[:, :2]
    line = other[:, :2] - tip[:, :2]
    angle = _angle_deg(back, line)
    place = _place((tips, far), (tip[:, 2], other[:, 2]), _near_share(np.linalg.norm(line, axis=1)))
    beside = (angle < 90.0) & (other[:, 2] > 0)
    return of[beside], angle[beside], place[beside]


def _near_share(length_px: Array) -> Array:
    return np.asarray(np.minimum(_ALONG, _ALONG_PX / np.maximum(length_px, _TINY)))


def _place(ends: tuple[Array, Array], depths: tuple[Array, Array], share: Array) -> Array:
    """Return the points (q, 3) whose images are at shares of the way between those of two ends."""
    share = share * depths[0] / ((1 - share) * depths[1] + share * depths[0])
    return np.asarray(ends[0] + share[:, None] * (ends[1] - ends[0]))


def _angle_deg(one: Array, other: Array) -> Array:
    length = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
    cosine = (one * other).sum(axis=1) / np.maximum(length, _TINY)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _shown(contours: Contours, contour: NDArray[np.int64], eyes: Array) -> NDArray[np.bool_]:
    """Return which contours their own two faces leave to be seen from eyes (a, 3)."""
    planes = contours.planes[contours.faces[contour]]
    front = (np.einsum("afk,ak->af", planes[..., :3], eyes) > planes[..., 3]).sum(axis=1)
    return np.asarray(SHOWS[contours.kinds[contour], front] > 0)


def images(poses: Array, scale: Array, points: Array) -> Array:
    """Return images in px and depths in mm (a, 3) of points (a, 3) from poses (a, 4, 4); see `corner_arms`."""
    local = np.einsum("aik,ai->ak", poses[:, :3, :3], points - poses[:, :3, 3])
    depth = np.maximum(local[:, 2:], _TINY)
    return np.concatenate([local[:, :2] / depth * scale[:2] + scale[2:], local[:, 2:]], axis=1)
