"""The other lines that leave the ends of an edge, and their angles with it in the image."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aspectgraph.solid.edge_ends import CORNER_DEG
from planner.showing.contours import CONVEX, OWN, SHARP, Contours

Array = NDArray[np.float64]

# an arm is looked at so far from the corner, px, and at most at this share of its length
_ALONG_PX, _ALONG = 6.0, 0.5
# a line is fitted to an arm so far from the corner at most, px
FITTED_PX = 28.0
_TINY = 1e-9
# for dividing by a tangent
_LEAST_DEG = 1e-3


class Arms(NamedTuple):
    """Sharp edges (a) that leave the ends of entities.

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
    """

    entity: NDArray[np.int64]
    end: NDArray[np.int64]
    contour: NDArray[np.int64]
    corner: Array
    tip: Array
    inward: Array
    wide: NDArray[np.bool_]


def arms_of(contours: Contours, relations: NDArray[np.uint8], ends: Array, asked: NDArray[np.bool_]) -> Arms:
    """Return the edges that leave the ends of entities.

    Parameters
    ----------
    contours : Contours
        Of the part.
    relations : array (k, m)
        See `relation_to`.
    ends : array (k, 2, 3)
        Ends of the entities, mm.
    asked : array of bool (k,)
        Entities that have corners.
    """
    rows = []
    sharp = (contours.kinds & SHARP) > 0
    for k in np.flatnonzero(asked):
        own = np.unique(contours.ends[relations[k] == OWN])
        for end in range(2):
            distance = np.linalg.norm(contours.vertices[own] - ends[k, end], axis=1)
            vertex = int(own[distance.argmin()])
            for e in np.flatnonzero(sharp & (contours.ends == vertex).any(axis=1) & (relations[k] != OWN)):
                tip = int(contours.ends[e].sum()) - vertex
                rows.append((k, end, e, vertex, tip))
    entity, which, contour, start, stop = np.array(rows, np.int64).reshape(-1, 5).T
    corner, tips, inward = contours.vertices[start], contours.vertices[stop], ends[entity, 1 - which]
    along, edge = tips - corner, inward - corner
    length = np.linalg.norm(along, axis=1) * np.linalg.norm(edge, axis=1)
    wide = np.abs((along * edge).sum(axis=1)) <= np.cos(np.radians(CORNER_DEG)) * length
    return Arms(entity, which, contour, corner, tips, inward, wide)


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

    @property
    def bend(self) -> Array:
        """The smaller angle (q,) between the lines of edge and arm, 0 to 90 degrees."""
        return np.minimum(self.angle, 180.0 - self.angle)

    def chosen(self, which: NDArray[Any]) -> SeenArms:
        """Return some of them."""
        return SeenArms(*(one[which] for one in self))

    def fork_deg(self) -> Array:
        """Return the least angle (q,) of each arm with the edge's line or another arm at its end, 0 to 90 degrees.

        Arms have to be in the order of their ends.
        """
        least = self.bend
        for apart in range(1, int(np.bincount(self.of).max(initial=0))):
            one = np.flatnonzero(self.of[apart:] == self.of[:-apart])
            between = np.abs((self.direction[one + apart] - self.direction[one] + 180.0) % 360.0 - 180.0)
            np.minimum.at(least, one, between)
            np.minimum.at(least, one + apart, between)
        return least

    def long_enough(self, fork_deg: Array, separation_px: float) -> NDArray[np.bool_]:
        """Return which arms (q,) leave enough of themselves for a line fit.

        Points of a line are found across it, to so many pixels on either side. So where another line leaves at an angle
        α, the first s / tan α of an arm show that one, too. As much again is needed beyond, and two separations at
        least.

        Parameters
        ----------
        fork_deg : array (q,)
            See `fork_deg`.
        separation_px : float
            s.
        """
        mixed = separation_px / np.tan(np.radians(np.maximum(fork_deg, _LEAST_DEG)))
        return np.asarray(self.length_px - mixed >= np.maximum(2.0 * separation_px, mixed))


def corner_arms(cam2world: Array, pairs: NDArray[np.int64], scale: Array, contours: Contours, arms: Arms) -> SeenArms:
    """Return what leaves the ends of entities in the image.

    Parameters
    ----------
    cam2world : array (n, 4, 4)
        Poses.
    pairs : array of int (p, 2)
        Pose and entity.
    scale : array (4,)
        Pixels per unit of slope in x and y, and the principal point, px.
    contours, arms : Contours, Arms
        Of the part and the entities.
    """
    order = np.argsort(arms.entity, kind="stable")
    begin = np.searchsorted(arms.entity[order], pairs[:, 1])
    number = np.searchsorted(arms.entity[order], pairs[:, 1], side="right") - begin
    pair = np.repeat(np.arange(len(pairs)), number)
    arm = order[np.arange(len(pair)) - np.repeat(np.cumsum(number) - number, number) + np.repeat(begin, number)]
    poses = cam2world[pairs[pair, 0]]
    shown = _shown(contours, arms.contour[arm], poses[:, :3, 3])
    pair, arm, poses = pair[shown], arm[shown], poses[shown]
    corner, tip, inward = (_image(poses, scale, points[arm]) for points in (arms.corner, arms.tip, arms.inward))
    good = (corner[:, 2] > 0) & (tip[:, 2] > 0) & (inward[:, 2] > 0)
    pair, arm, corner, tip, inward = pair[good], arm[good], corner[good], tip[good], inward[good]
    along, edge = tip[:, :2] - corner[:, :2], inward[:, :2] - corner[:, :2]
    length = np.linalg.norm(along, axis=1)
    cosine = (along * edge).sum(axis=1) / np.maximum(length * np.linalg.norm(edge, axis=1), _TINY)
    angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))

    def place(share: Array) -> Array:
        """Return the points whose images are so far along the arms' images."""
        share = share * corner[:, 2] / ((1 - share) * tip[:, 2] + share * corner[:, 2])
        return np.asarray(arms.corner[arm] + share[:, None] * (arms.tip[arm] - arms.corner[arm]))

    near = place(np.minimum(_ALONG, _ALONG_PX / np.maximum(length, _TINY)))
    last = place(np.minimum(1.0, FITTED_PX / np.maximum(length, _TINY)))
    direction = np.degrees(np.arctan2(along[:, 1], along[:, 0]))
    return SeenArms(angle, near, 2 * pair + arms.end[arm], arms.wide[arm], arm, length, last, direction)


def _shown(contours: Contours, contour: NDArray[np.int64], eyes: Array) -> NDArray[np.bool_]:
    """Return which contours their own two faces leave to be seen from eyes (a, 3)."""
    planes = contours.planes[contours.faces[contour]]
    front = (np.einsum("afk,ak->af", planes[..., :3], eyes) > planes[..., 3]).sum(axis=1)
    return np.asarray(np.where(contours.kinds[contour] & CONVEX, front > 0, front == 2))


def _image(poses: Array, scale: Array, points: Array) -> Array:
    """Return images and depths (a, 3) of points (a, 3)."""
    local = np.einsum("aik,ai->ak", poses[:, :3, :3], points - poses[:, :3, 3])
    depth = np.maximum(local[:, 2:], _TINY)
    return np.concatenate([local[:, :2] / depth * scale[:2] + scale[2:], local[:, 2:]], axis=1)
