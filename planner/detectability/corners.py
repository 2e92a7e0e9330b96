"""The other lines that leave the ends of an edge, and their angles with it and with others in the image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from math import acos, atan2, degrees, hypot, radians, tan
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


# Which edges leave the ends of entities, on the part.


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
    """Arms (q) in images, as far as an edge's own two faces do not hide them, in the order of the ends.

    Attributes
    ----------
    of : array of int (q,)
        Number of the pair, doubled, and the end.
    arm : array of int (q,)
        Their numbers.
    angle : array (q,)
        From the edge, at its end, to the arm, 0 to 180 degrees.
    length_px : array (q,)
        Of the whole arm in the image.
    direction : array (q,)
        Of the arm in the image, degrees.
    place : array (q, 3)
        A point of the arm near the end, mm.
    last : array (q, 3)
        Where the arm is `FITTED_PX` from the corner, or ends, mm.
    """

    of: NDArray[np.int64]
    arm: NDArray[np.int64]
    angle: Array
    length_px: Array
    direction: Array
    place: Array
    last: Array

    @property
    def bend(self) -> Array:
        """The smaller angle (q,) between the lines of edge and arm, 0 to 90 degrees."""
        return np.minimum(self.angle, 180.0 - self.angle)

    def chosen(self, which: NDArray[Any]) -> SeenArms:
        """Return some of them."""
        return SeenArms(*(field[which] for field in self))


# What of them shows in images, and which of it is long enough for a fit; compiled.
#
# Points of a line are found across it, to so many pixels on either side: s. So where another line
# leaves at an angle α, the first s / tan α of an arm show that one, too, and so do the last ones
# where a line comes back from its tip. As much as the first again is needed between, and 2 s at
# least. Lines are blurred, so that s counts as a little more there.


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
        Where those of each entity begin (k + 1,), the end that each leaves, its contour (a,), and corners, tips and
        other ends of the entities (3, a, 3).
    found : tuple
        To be written: `SeenArms.of` and `arm` (2, q), `angle`, `length_px` and `direction` (3, q), `place` and `last`
        (2, q, 3).
    """
    first, end, contour, points = arms
    numbers, values, places = found
    corner = np.empty(3)
    tip = np.empty(3)
    inward = np.empty(3)
    count = 0
    for p in range(len(pairs)):
        pose = poses[pairs[p, 0]]
        k = pairs[p, 1]
        for a in range(first[k], first[k + 1]):
            if not _shows(pose, lines, contour[a]):
                continue
            before = _image(pose, scale, points[0, a], corner)
            before &= _image(pose, scale, points[1, a], tip)
            before &= _image(pose, scale, points[2, a], inward)
            if not before:
                continue
            numbers[0, count] = 2 * p + end[a]
            numbers[1, count] = a
            x = tip[0] - corner[0]
            y = tip[1] - corner[1]
            length = hypot(x, y)
            values[0, count] = _angle_deg(x, y, inward[0] - corner[0], inward[1] - corner[1])
            values[1, count] = length
            values[2, count] = degrees(atan2(y, x))
            near = _near_share(length)
            _put_between(points[0, a], points[1, a], corner[2], tip[2], near, places[0, count])
            last = min(1.0, FITTED_PX / max(length, _TINY))
            _put_between(points[0, a], points[1, a], corner[2], tip[2], last, places[1, count])
            count += 1
    return count


@entry_kernel(error_model="numpy")
def tip_lines(
    poses: Any, pairs: Any, scale: Any, lines: Any, arms: Any, seen: Any, found: Any
) -> int:
    """Write what comes back from the tips of arms in images, under 90 degrees; return how much that is.

    Parameters
    ----------
    poses, pairs, scale, lines
        As `arm_images` takes them.
    arms : tuple
        `Arms.beyond`, and corners, tips and other ends of the entities (3, a, 3).
    seen : tuple
        `SeenArms.of` and `arm`, and which of them (q,) are looked at.
    found : tuple
        To be written: which arm and pose (2, b), the angle in degrees (b,), and a point of the line near the tip
        (b, 3). Lines that their own two faces hide are left out.
    """
    beyond, points = arms
    of, arm, among = seen
    numbers, angles, places = found
    vertices = lines[0]
    ends = lines[1]
    corner = np.empty(3)
    tip = np.empty(3)
    other = np.empty(3)
    far = np.empty(3)
    count = 0
    for q in range(len(of)):
        if not among[q]:
            continue
        pose = poses[pairs[of[q] // 2, 0]]
        a = arm[q]
        _image(pose, scale, points[0, a], corner)
        _image(pose, scale, points[1, a], tip)
        for column in range(beyond.shape[1]):
            e = beyond[a, column]
            if e < 0 or not _shows(pose, lines, e):
                continue
            _put_other_end(vertices, ends[e, 0], ends[e, 1], points[1, a], far)
            before = _image(pose, scale, far, other)
            x = other[0] - tip[0]
            y = other[1] - tip[1]
            angle = _angle_deg(corner[0] - tip[0], corner[1] - tip[1], x, y)
            if not before or angle >= 90.0:
                continue
            numbers[0, count] = q
            numbers[1, count] = pairs[of[q] // 2, 0]
            angles[count] = angle
            share = _near_share(hypot(x, y))
            _put_between(points[1, a], far, tip[2], other[2], share, places[count])
            count += 1
    return count


@entry_kernel(error_model="numpy")
def drop_mixed(
    seen: Any, wide: Any, separation_px: float, visible: Any, fork_deg: Any, sharpest: Any
) -> None:
    """Drop arms that are too short beside those that leave the same end.

    Parameters
    ----------
    seen : tuple
        `SeenArms.of`, `arm`, `angle`, `length_px` and `direction` (q,).
    wide : array of bool (a,)
        See `Arms`; others are dropped, too.
    separation_px : float
        s.
    visible : array of bool (q,)
        Which arms there are. Those that are too short are taken out.
    fork_deg : array (q,)
        To be written: the least angle of each with the edge's line or another arm at its end, 0 to 90 degrees.
    sharpest : array (2 p,)
        To be lowered: the least angle at each end.
    """
    of, arm, angle, length_px, direction = seen
    start = 0
    while start < len(of):
        stop = start
        while stop < len(of) and of[stop] == of[start]:
            if visible[stop]:
                sharpest[of[stop]] = min(sharpest[of[stop]], angle[stop])
                fork_deg[stop] = min(angle[stop], 180.0 - angle[stop])
            stop += 1
        for i in range(start, stop):
            for j in range(i + 1, stop):
                if visible[i] and visible[j]:
                    between = abs((direction[j] - direction[i] + 180.0) % 360.0 - 180.0)
                    fork_deg[i] = min(fork_deg[i], between)
                    fork_deg[j] = min(fork_deg[j], between)
        for i in range(start, stop):
            visible[i] &= wide[arm[i]] and _is_long_enough(
                length_px[i], fork_deg[i], 90.0, separation_px
            )
        start = stop


@entry_kernel(error_model="numpy")
def drop_short(
    length_px: Any, fork_deg: Any, tip_deg: Any, separation_px: float, visible: Any
) -> None:
    """Drop arms that are too short between other lines at their end and at their tip; see `drop_mixed`."""
    for q in range(len(length_px)):
        visible[q] &= _is_long_enough(length_px[q], fork_deg[q], tip_deg[q], separation_px)


@entry_kernel(error_model="numpy")
def find_hopeful(
    of: Any, angle: Any, visible: Any, required_deg: float, sharpest: Any, hopeful: Any
) -> None:
    """Write which visible arms may make a corner, of edges that may have one at both ends.

    Parameters
    ----------
    of, angle
        See `SeenArms`.
    visible : array of bool (q,)
        Which arms there are.
    required_deg : float
        How wide a corner is asked for.
    sharpest : array (2 p,)
        The least angle at each end.
    hopeful : array of bool (q,)
        To be written.
    """
    has = np.zeros(len(sharpest), np.bool_)
    for q in range(len(of)):
        bend = min(angle[q], 180.0 - angle[q])
        if visible[q] and bend >= required_deg and sharpest[of[q]] >= required_deg:
            has[of[q]] = True
    for q in range(len(of)):
        bend = min(angle[q], 180.0 - angle[q])
        # ends have the numbers 2 p and 2 p + 1
        both = has[of[q]] and has[of[q] ^ 1]
        hopeful[q] = both and visible[q] and bend >= required_deg


@entry_kernel(error_model="numpy")
def rank_arms(of: Any, angle: Any, visible: Any, hopeful: Any, found: Any) -> None:
    """Write the hopeful arms of each end in falling order of their bends.

    Parameters
    ----------
    of, angle
        See `SeenArms`.
    visible, hopeful : array of bool (q,)
        Which arms there are, and which of them may make a corner.
    found : tuple
        To be written: the arms (h,), where those of each end begin (2 p + 1,), and the largest bend of the other
        visible arms of each end (2 p,).
    """
    ranked, first, widest = found
    count = 0
    q = 0
    for end in range(len(widest)):
        first[end] = count
        while q < len(of) and of[q] == end:
            bend = min(angle[q], 180.0 - angle[q])
            if hopeful[q]:
                place = count
                while place > first[end]:
                    before = ranked[place - 1]
                    if min(angle[before], 180.0 - angle[before]) >= bend:
                        break
                    ranked[place] = before
                    place -= 1
                ranked[place] = q
                count += 1
            elif visible[q]:
                widest[end] = max(widest[end], bend)
            q += 1
    first[len(widest)] = count


@entry_kernel(error_model="numpy")
def corner_widths(
    poses: Any, pairs: Any, scale: Any, ends: Any, separation_px: float, angles: Any, widths: Any
) -> None:
    """Write how wide the narrower corner of each edge is, degrees.

    It is 0 where what other lines at both ends are beside of leaves less than two separations of the edge.

    Parameters
    ----------
    poses, pairs, scale
        As `arm_images` takes them.
    ends : array (k, 2, 3)
        Of the edges, mm.
    separation_px : float
        s.
    angles : array (2, 2 p)
        The widest bend and the sharpest angle at each end, degrees.
    widths : array (p,)
        To be written.
    """
    start = np.empty(3)
    stop = np.empty(3)
    for p in range(len(pairs)):
        pose = poses[pairs[p, 0]]
        _image(pose, scale, ends[pairs[p, 1], 0], start)
        _image(pose, scale, ends[pairs[p, 1], 1], stop)
        clear_px = hypot(stop[0] - start[0], stop[1] - start[1])
        narrowest = 90.0
        for end in range(2 * p, 2 * p + 2):
            clear_px -= mixed_px(angles[1, end], separation_px)
            narrowest = min(narrowest, min(angles[0, end], angles[1, end]))
        widths[p] = narrowest if clear_px >= 2.0 * separation_px else 0.0


@kernel_without_refcounts(error_model="numpy")
def _shows(pose: Any, lines: Any, e: int) -> bool:
    """Return whether a contour's own two faces leave it to be seen from a camera."""
    planes = lines[2]
    faces = lines[3]
    front = 0
    for i in range(2):
        f = faces[e, i]
        side = planes[0, f] * pose[0, 3] + planes[1, f] * pose[1, 3] + planes[2, f] * pose[2, 3]
        front += side > planes[3, f]
    return bool(SHOWS[lines[4][e], front])


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


@kernel_without_refcounts(error_model="numpy")
def _angle_deg(x: float, y: float, other_x: float, other_y: float) -> float:
    """Return the angle between two directions in the image, degrees."""
    length = hypot(x, y) * hypot(other_x, other_y)
    cosine = (x * other_x + y * other_y) / max(length, _TINY)
    return degrees(acos(min(max(cosine, -1.0), 1.0)))


@kernel_without_refcounts(error_model="numpy")
def _near_share(length_px: float) -> float:
    """Return at which share of an arm's image it is looked at."""
    return min(_ALONG, _ALONG_PX / max(length_px, _TINY))


@kernel_without_refcounts(error_model="numpy")
def _put_between(
    start: Any, stop: Any, depth: float, depth_there: float, share: float, place: Any
) -> None:
    """Write the point (3,) whose image is at a share of the way between those of two points at some depths."""
    share = share * depth / ((1.0 - share) * depth_there + share * depth)
    for i in range(3):
        place[i] = start[i] + share * (stop[i] - start[i])


@kernel_without_refcounts(error_model="numpy")
def _put_other_end(vertices: Any, v: int, w: int, tip: Any, far: Any) -> None:
    """Write the end (3,) of a contour between two vertices that is not the tip of an arm."""
    to_v = 0.0
    to_w = 0.0
    for i in range(3):
        to_v += (vertices[i, v] - tip[i]) ** 2
        to_w += (vertices[i, w] - tip[i]) ** 2
    for i in range(3):
        far[i] = vertices[i, w] if to_v < to_w else vertices[i, v]


@kernel_without_refcounts(error_model="numpy")
def _is_long_enough(
    length_px: float, fork_deg: float, tip_deg: float, separation_px: float
) -> bool:
    """Return whether an arm leaves enough of itself for a line fit; see above."""
    mixed = mixed_px(fork_deg, separation_px)
    clear_px = length_px - mixed - mixed_px(tip_deg, separation_px)
    return clear_px >= max(2.0 * separation_px, mixed)


@kernel_without_refcounts(error_model="numpy")
def mixed_px(fork_deg: float, separation_px: float) -> float:
    """Return how long another line, which leaves at an angle, shows within s across a line; 0 if nothing is asked."""
    across = separation_px + _BLURRED_PX if separation_px > 0.0 else 0.0
    return across / tan(radians(max(fork_deg, _LEAST_DEG)))
