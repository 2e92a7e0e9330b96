"""Whether edges can be found in the images of poses: how far other visible lines are, and how wide corners are.

Notation: n poses, k entities, p pairs of a pose and an entity. Lines are those of the part
(`planner.detectability.corners`) that rays find visible. Distances are those in the images that the camera delivers.
Corners are looked at in images without distortion.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from aspectgraph.solid.solid import RayScene
from errors.measurands.geometry import Circle, Geometry
from planner.camera.camera import Camera
from planner.detectability.conditions import Detectability
from planner.detectability.corners import (
    CONNECTED,
    FITTED_PX,
    OWN,
    SHARP,
    Contours,
    SeenArms,
    arm_images,
    arms_of,
    contours_of,
    corner_widths,
    drop_mixed,
    drop_short,
    find_hopeful,
    meeting,
    rank_arms,
    relation_to,
    tip_lines,
)
from planner.detectability.near_contours import choose_tested, near_contours, rays_to
from planner.detectability.vicinity import PartPieces, Vicinity
from planner.executors import check_on_the_way

if TYPE_CHECKING:
    from aspectgraph import Solid


# What the lines of a part are, whatever is asked of them: found once per part, as many checks of
# images need it.


_kept: WeakKeyDictionary[Solid, dict[bool, PartLines]] = WeakKeyDictionary()


class PartLines:
    """The lines of a part, and rays that tell what hides them.

    Parameters
    ----------
    solid : Solid
        The part.
    only_outlines : bool
        Whether edges of two faces that both turn to the camera make no line, as in front of a backlight.

    Attributes
    ----------
    contours : Contours
        Of the part, which show as in daylight.
    showing : Contours
        The same, which show as asked.
    at : dict
        See `meeting`.
    scene : RayScene
        Of the part.
    compiled : tuple of array
        Of `showing` vertices (3, v), ends, planes (4, f), faces and kinds, as compiled loops take them: coordinates
        one after the other, so that several points are computed at once, and numbers that cannot be negative.
    bulges : array (m, 3)
        From the middle of each edge of `contours` to that of the arc it is a chord of, mm; 0 for straight ones.
    pieces : PartPieces
        The same lines in pieces, and what may hide them.
    """

    def __init__(self, solid: Solid, *, only_outlines: bool = False) -> None:
        self.contours = contours_of(solid)
        # what is not sharp shows where one of its faces turns away
        kinds = self.contours.kinds & ~np.uint8(SHARP) if only_outlines else self.contours.kinds
        self.showing = self.contours._replace(kinds=kinds)
        self.at = meeting(self.contours)
        self.scene = RayScene(solid.vertices, solid.triangles, n_threads=1)
        contours = self.contours
        vertices, planes = (
            np.array(rows.T, order="C") for rows in (contours.vertices, contours.planes)
        )
        ends, faces = (rows.astype(np.uint32) for rows in (contours.ends, contours.faces))
        self.compiled: Any = (vertices, ends, planes, faces, kinds)
        self.bulges = _bulges(solid, contours)
        self._relations: dict[tuple[tuple[int, ...], float], NDArray[np.uint8]] = {}
        self.pieces = PartPieces(solid, self.scene, contours.vertices[contours.ends], self.bulges)

    @classmethod
    def of(cls, solid: Solid, *, only_outlines: bool = False) -> PartLines:
        """Return the lines of a part; the same ones as long as the part is there."""
        of_part = _kept.setdefault(solid, {})
        if only_outlines not in of_part:
            of_part[only_outlines] = cls(solid, only_outlines=only_outlines)
        return of_part[only_outlines]

    def relation(self, edge_ids: Sequence[int], radius_mm: float) -> NDArray[np.uint8]:
        """Return `relation_to` an entity's edges."""
        key = tuple(edge_ids), radius_mm
        if key not in self._relations:
            self._relations[key] = relation_to(self.contours, self.at, edge_ids, radius_mm)
        return self._relations[key]

    def some(
        self, edges: NDArray[np.int64], looked: _Looked, line: NDArray[np.int64]
    ) -> tuple[Any, Any]:
        """Return some contours, and what is asked for them, as `near_contours` takes them.

        Parameters
        ----------
        edges : array of int (e,)
            The contours, in rising order.
        looked : _Looked
            What is asked.
        line : array of int
            Which of its lines are used.
        """
        vertices, ends, planes, faces, kinds = self.compiled
        lines = looked.lines
        used = np.zeros(vertices.shape[1], bool)
        used[ends[edges]] = True
        for r in line.tolist():
            used[lines.vertices[lines.first[r] : lines.first[r + 1]]] = True
        place = np.cumsum(used) - 1
        faces_used, faces = np.unique(faces[edges], return_inverse=True)
        compiled = (
            np.ascontiguousarray(vertices[:, used]),
            place[ends[edges]].astype(np.uint32),
            np.ascontiguousarray(planes[:, faces_used]),
            faces.reshape(-1, 2).astype(np.uint32),
            kinds[edges],
        )
        relations = np.ascontiguousarray(lines.relations[:, edges])
        # vertices of lines that are not used have no place, and nobody looks for them
        vertex = np.maximum(place[lines.vertices], 0)
        entities = looked.ends, looked.line, relations, vertex, lines.first
        return (compiled, self.bulges[edges]), entities


def _bulges(solid: Solid, contours: Contours) -> NDArray[np.float64]:
    """Return how far circles leave their chords, vectors (m, 3); chords of other curves count as straight."""
    bulges = np.zeros((len(contours.ids), 3))
    place = {int(edge): k for k, edge in enumerate(contours.ids)}
    for arc in (*solid.rims(), *solid.arcs()):
        for edge in arc.edge_ids:
            if edge in place:
                off = solid.edge_points(edge).mean(axis=0) - arc.centre
                # a fitted circle may be off the plane of its chords
                off = off - (off @ arc.axis) * arc.axis
                size = float(np.linalg.norm(off))
                if 0.0 < size < arc.radius_mm:
                    bulges[place[edge]] = (arc.radius_mm / size - 1.0) * off
    return bulges


# Which entities are scanned for lines and circles, and how near other lines may come to them.
#
# A fit needs no corners: it takes points all along an entity. A point with another line nearby is
# left out. So a share of the points may lie beside other lines, but not all of those of a
# twelfth: the far rim of a through hole crosses the image of the near one in all oblique views.


Array = NDArray[np.float64]
Pairs = NDArray[np.int64]

COVERAGE_SHARE = 0.8
"""Share of the points of an entity that must be found, at least."""
SECTORS = 12
"""Parts of an entity in each of which a point must be found."""
# points of an entity in a check: two in each twelfth
_POINTS = 2 * SECTORS
# of these so many may lie beside another line
_LOST = round((1.0 - COVERAGE_SHARE) * _POINTS - 0.5)


@dataclass(frozen=True)
class Scanned:
    """A line or circle of the part that is scanned for.

    Attributes
    ----------
    edge_ids : tuple of int
        Its edges in ``solid.edges``.
    points : array (24, 3)
        Points all along it, mm.
    """

    edge_ids: tuple[int, ...]
    points: Array = field(repr=False, compare=False)

    @classmethod
    def of(cls, edge_ids: Sequence[int], geometry: Geometry) -> Scanned:
        """Return what is scanned of an entity."""
        shares = (np.arange(_POINTS) + 0.5) / _POINTS
        if isinstance(geometry, Circle):
            return cls(tuple(edge_ids), geometry.points(shares * geometry.span_rad))
        way = np.asarray(geometry.q) - np.asarray(geometry.p)
        return cls(tuple(edge_ids), np.asarray(geometry.p) + shares[:, None] * way)


class ImagePieces(NamedTuple):
    """Pieces (c) of entities, each of which is asked how near other lines come.

    Attributes
    ----------
    ends : array (c, 2, 3)
        Of each: an edge, or twice the same point.
    line : array of int (c,)
        Number of the edges, of those that `of` returns, that it belongs to.
    first : array of int (k + 1,)
        Where those of each entity begin.
    """

    ends: Array
    line: NDArray[np.int64]
    first: NDArray[np.int64]

    @classmethod
    def of(
        cls,
        edge_ids: Sequence[Sequence[int] | None],
        ends: Array,
        scanned: Sequence[Sequence[Scanned]],
    ) -> tuple[ImagePieces, list[tuple[int, ...]]]:
        """Return the pieces of entities, and the edges that they belong to.

        Parameters
        ----------
        edge_ids : sequence of (sequence of int or None)
            Of each entity (k) that is an edge with ends.
        ends : array (k, 2, 3)
            Their ends, mm.
        scanned : sequence of sequence of Scanned
            What is scanned of the others.
        """
        places: list[Array] = []
        line: list[int] = []
        first = [0]
        lines: dict[tuple[int, ...], int] = {}
        for ids, edge_ends, parts in zip(edge_ids, ends, scanned, strict=True):
            if ids is not None:
                places.append(edge_ends[None])
                line.append(lines.setdefault(tuple(ids), len(lines)))
            for part in parts if ids is None else ():
                places.append(np.repeat(part.points[:, None], 2, axis=1))
                line.extend([lines.setdefault(part.edge_ids, len(lines))] * _POINTS)
            first.append(len(line))
        rows = np.concatenate([np.zeros((0, 2, 3)), *places])
        return cls(rows, np.array(line, np.int64), np.array(first, np.int64)), list(lines)

    def of_pairs(self, pairs: Pairs) -> PiecesOfPairs:
        """Return the pieces of pairs (p, 2) of a pose and an entity."""
        count = np.diff(self.first)[pairs[:, 1]]
        pair = np.repeat(np.arange(len(pairs)), count)
        begin = np.cumsum(count) - count
        piece = np.arange(len(pair)) - begin[pair] + self.first[pairs[pair, 1]]
        return PiecesOfPairs(
            np.column_stack([pairs[pair, 0], piece]), pair, (count > 1)[pair], len(pairs)
        )

    def batches(self, pairs: Pairs, most: int) -> Iterable[Pairs]:
        """Yield pairs, so many that they have about so many pieces."""
        number = np.cumsum(np.diff(self.first)[pairs[:, 1]]) // most
        cuts = np.flatnonzero(np.diff(number)) + 1
        return (batch for batch in np.split(pairs, cuts) if len(batch))


class PiecesOfPairs(NamedTuple):
    """Pieces of pairs of a pose and an entity, and how the pairs follow from them.

    Attributes
    ----------
    rows : array of int (q, 2)
        Pose and piece.
    pair : array of int (q,)
        Which pair each is of.
    scanned : array of bool (q,)
        Whether it is one of the points that are scanned.
    n : int
        Number of pairs.
    """

    rows: Pairs
    pair: NDArray[np.int64]
    scanned: NDArray[np.bool_]
    n: int

    def least_distance(self, near: Array) -> Array:
        """Return how near other lines may be said to come to pairs, by how near they come to pieces (q,), px; (n,).

        To a whole edge that is the least distance. Of an entity that is scanned, it is the largest distance that
        enough points keep, and one in each twelfth.
        """
        distances = np.full(self.n, np.inf)
        edges = ~self.scanned
        distances[self.pair[edges]] = near[edges]
        if self.scanned.any():
            points = near[self.scanned].reshape(-1, _POINTS)
            enough = np.sort(points, axis=1)[:, _LOST]
            in_each = points.reshape(len(points), SECTORS, -1).max(axis=2).min(axis=1)
            whose = self.pair[self.scanned][::_POINTS]
            np.minimum.at(distances, whose, np.minimum(enough, in_each))
        return distances


# a ray that ends this share before a point has been stopped by something else
_SHORT = 1e-4
# margins of separation are told up to so many px
MOST_PX = 20.0
# points at first, at least and for each pair, and pairs at a time
_ROOM = 100_000
_EACH = 24
_BATCH = 20_000
# of so many poses, so many entities are asked first whether they show
_MANY = 32
_FIRST = 2
# of so many poses, lines that are surely not near are left out beforehand, if that leaves at most this share of them;
# but not for more segments than so many
_MANY_NEAR = 200
_FEWER = 0.7
_MOST_SPANS = 4000
# and not where that is too many pairs of a line that is asked for and one of the part
_MOST_CELLS = 2_000_000
# distances from curves may be said to be less than they are by so many px
_SAG_PX = 0.05
# length of a line as it is seen, rad, up to which it leads away from another one at its end: less than π / 2
_NARROW = 1.4
# parts of a line that is looked at from its end on, and how much of one is rounding
_SHARES = 16
_OVER = 1e-6
_LEAST_MM = 1e-12
# of a depth of field without end so many times its near limit counts
_FAR = 10.0
# of the sensor, where distortion is looked at along each side; and how much more it may be between and beside these
_GRID = 33
_WIDER = 1.1


class ImageCheck:
    """Separation and corners of entities in the images of a camera.

    Parameters
    ----------
    solid : Solid
        The part.
    edge_ids : sequence of (sequence of int or None)
        The edges of each entity (k); None for what is not asked for corners, such as dimensions.
    ends : array (k, 2, 3)
        Their ends, mm.
    camera : Camera
        The camera.
    showing : Detectability
        What is asked.
    scanned : sequence of sequence of Scanned, optional
        What is scanned of each entity without edges of its own. Default: nothing.
    only_outlines : bool
        See `PartLines`.

    Attributes
    ----------
    contours : Contours
        Of the part.
    arms : Arms
        Lines that leave the entities' ends.
    scene : RayScene
        Of the part.
    """

    def __init__(
        self,
        solid: Solid,
        edge_ids: Sequence[Sequence[int] | None],
        ends: Array,
        camera: Camera,
        showing: Detectability,
        scanned: Sequence[Sequence[Scanned]] = (),
        *,
        only_outlines: bool = False,
    ) -> None:
        self.showing = showing
        self._ends = np.ascontiguousarray(ends, np.float64)
        matrix = camera.matrix
        (near, far) = camera.depth_of_field_mm
        self._scale = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]])
        self._lens = _lens_of(camera)
        self._stretches = _stretches_of(camera)
        self._has_corners = np.array([ids is not None for ids in edge_ids], bool)
        self._pieces, scanned_lines = ImagePieces.of(
            edge_ids, self._ends, scanned or [()] * len(edge_ids)
        )
        self._has_pieces = np.diff(self._pieces.first) > 0
        self._part = PartLines.of(solid, only_outlines=only_outlines)
        self.contours = self._part.contours
        self.scene = self._part.scene
        self._near_own_px = near_own_px(showing)
        radius = 2.0 * self._near_own_px * min(far, _FAR * near) / float(self._scale[:2].min())
        edges = [[] if ids is None else list(ids) for ids in edge_ids]
        self._entities = _ImageLines.of(
            self.contours, [self._part.relation(ids, radius) for ids in edges]
        )
        self._scanned = _ImageLines.of(
            self.contours, [self._part.relation(ids, radius) for ids in scanned_lines]
        )
        self.arms = arms_of(
            self.contours, self._part.at, self._entities.relations, self._ends, self._has_corners
        )
        self._arm_points = np.stack([self.arms.corner, self.arms.tip, self.arms.inward])
        # the same line may leave several entities
        lines, self._line_of_arm = np.unique(self.arms.contour, return_inverse=True)
        # and from the same end, when it is the same arm
        from_where = np.column_stack([self.arms.contour, self.arms.corner, self.arms.tip])
        self._same_arm = np.unique(from_where, axis=0, return_inverse=True)[1].reshape(-1)
        ids_of_lines = [[int(self.contours.ids[line])] for line in lines]
        self._lines = _ImageLines.of(
            self.contours, [self._part.relation(ids, radius) for ids in ids_of_lines]
        )

    def separations(
        self, cam2world: Array, wanted: NDArray[np.bool_], most_px: float = MOST_PX
    ) -> Array:
        """Return how far other visible lines are from entities in the image, less what is asked for, px; (n, k).

        Parameters
        ----------
        cam2world : array (n, 4, 4)
            Poses.
        wanted : array of bool (n, k)
            For which entities; the others get `most_px`.
        most_px : float
            Lines beyond what is asked for and so much more are not looked at.
        """
        margin = np.full(wanted.shape, most_px)
        if self.showing.separation_px > 0:
            for pairs in self._with_pieces(wanted):
                check_on_the_way()
                apart = self._separations(cam2world, pairs, self.showing.separation_px + most_px)
                margin[tuple(pairs.T)] = apart - self.showing.separation_px
        return margin

    def corners(self, cam2world: Array, wanted: NDArray[np.bool_]) -> Array:
        """Return how wide the narrower corner of entities is in the image, less what is asked for, degrees; (n, k).

        Parameters
        ----------
        cam2world : array (n, 4, 4)
            Poses.
        wanted : array of bool (n, k)
            For which entities; the others get 90 less what is asked for.
        """
        required_deg = self.showing.min_corner_deg
        margin = np.full(wanted.shape, 90.0 - required_deg)
        if required_deg > 0:
            for pairs in self._with_corners(wanted):
                margin[tuple(pairs.T)] = self._corners(cam2world, pairs) - required_deg
        return margin

    def shown(self, cam2world: Array, wanted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which of the wanted entities (n, k) meet both conditions in the images of poses (n, 4, 4)."""
        meets = wanted & (self.corners(cam2world, wanted) >= 0)
        if self.showing.separation_px > 0:
            required_px = self.showing.separation_px
            for pairs in self._with_pieces(meets):
                check_on_the_way()
                pieces = self._pieces.of_pairs(pairs)
                near = self._has_near(cam2world, pieces.rows, self._piece_lines, required_px)
                apart = pieces.least_distance(np.where(near, 0.0, required_px))
                meets[tuple(pairs.T)] = apart >= required_px
        return meets

    def show_all(self, cam2world: Array) -> NDArray[np.bool_]:
        """Return in the images of which poses (n, 4, 4) all entities meet both conditions; (n,).

        Where there are many poses, the first entities are asked first: most poses fail for one of them.
        """
        rows = np.arange(len(cam2world))
        entities = np.arange(len(self._ends))
        first = entities < _FIRST if len(cam2world) >= _MANY else np.zeros(len(entities), bool)
        for part in (first, ~first):
            if rows.size and part.any():
                mask = np.repeat(part[None], rows.size, axis=0)
                rows = rows[(self.shown(cam2world[rows], mask) | ~mask).all(axis=1)]
        return np.isin(np.arange(len(cam2world)), rows)

    def without_corner(self, k: int) -> Array | None:
        """Return an end (3,) of an entity where no edge of the part makes a corner with it, mm; None without one."""
        if self.showing.min_corner_deg > 0 and self._has_corners[k]:
            arms = (self.arms.entity == k) & self.arms.wide
            for end in range(2):
                if not (arms & (self.arms.end == end)).any():
                    return self._ends[k, end]
        return None

    def _with_corners(self, wanted: NDArray[np.bool_]) -> list[Pairs]:
        pairs = np.argwhere(wanted & self._has_corners)
        return [pairs[i : i + _BATCH] for i in range(0, len(pairs), _BATCH)]

    def _with_pieces(self, wanted: NDArray[np.bool_]) -> Iterable[Pairs]:
        return self._pieces.batches(np.argwhere(wanted & self._has_pieces), _BATCH)

    @property
    def _piece_lines(self) -> _Looked:
        pieces = self._pieces
        return _Looked(pieces.ends, pieces.line, self._scanned, np.arange(len(pieces.ends)))

    def _separations(self, cam2world: Array, pairs: Pairs, reach: float) -> Array:
        """Return how near other visible lines come in the image, px (p,), at most `reach`."""
        pieces = self._pieces.of_pairs(pairs)
        piece, distance, place = self._near(cam2world, pieces.rows, self._piece_lines, reach)
        apart = np.full(len(pieces.rows), reach)
        visible = self._visible(cam2world, pieces.rows[piece, 0], place)
        np.minimum.at(apart, piece[visible], distance[visible])
        return pieces.least_distance(apart)

    def _has_near(
        self, cam2world: Array, pairs: Pairs, looked: _Looked, reach: float
    ) -> NDArray[np.bool_]:
        """Return to what (p,) other visible lines come nearer than `reach` px: fewer rays than for how near."""
        pair, distance, place = self._near(cam2world, pairs, looked, reach)
        has = np.zeros(len(pairs), bool)
        poses = np.ascontiguousarray(pairs[:, 0])
        rows = np.empty(len(pair), np.int64)
        for is_first in (True, False):
            n = choose_tested(pair, distance, reach, is_first, has, rows)
            tested = rows[:n]
            of = pair[tested]
            visible = self._visible(cam2world, poses[of], place[tested])
            has[of[visible]] = True
        return has

    def _near(
        self, cam2world: Array, pairs: Pairs, looked: _Looked, reach: float
    ) -> tuple[Pairs, Array, Array]:
        """Return points of other lines, visible or not, that are near in the image; see `near_contours`."""
        hopeful, (contours, entities) = self._contours_for(cam2world, pairs, looked, reach)
        if not len(hopeful):
            return hopeful, np.zeros(0), np.zeros((0, 3))
        # one kind of arrays, so that the loop is compiled once: in order of rows, and not read-only
        room = max(_ROOM, _EACH * len(hopeful))
        poses = np.array(cam2world, np.float64, order="C")
        pairs = np.ascontiguousarray(pairs[hopeful])
        while True:
            rows = np.empty(room, np.int64), np.empty(room), np.empty((room, 3))
            limits = reach, self._near_own_px, *self._stretches
            view = self._scale, self._lens
            n = near_contours(poses, pairs, *view, *contours, entities, limits, rows)
            if n <= room:
                return hopeful[rows[0][:n]], rows[1][:n], rows[2][:n]
            room = n

    def _contours_for(
        self, cam2world: Array, pairs: Pairs, looked: _Looked, reach: float
    ) -> tuple[NDArray[np.int64], tuple[Any, Any]]:
        """Return which pairs may have lines nearby, and contours and entities as `near_contours` takes them.

        Left out is what surely does not show nearby, see `Vicinity`. That is worth the time where many poses are near
        to each other, as displaced ones are.
        """
        part = self._part
        every = np.arange(len(pairs))
        everything = (part.compiled, part.bulges), (looked.ends, looked.line, *looked.lines)
        if min(len(cam2world), len(pairs)) < _MANY_NEAR:
            return every, everything
        groups = looked.groups(pairs[:, 1])
        lines, owner = np.unique(groups.line, return_inverse=True)
        n_contours = len(part.contours.ids)
        if len(lines) * n_contours > _MOST_CELLS or len(groups.line) > _MOST_SPANS:
            return every, everything
        vicinity = part.pieces.around(cam2world)
        if vicinity is None:
            return every, everything
        segments = _Segments(groups.spans, owner, looked.lines.relations[lines])
        near = self._may_show(vicinity, segments, reach)
        is_hopeful = np.array([len(beside) > 0 for beside in near], bool)
        hopeful = np.flatnonzero(is_hopeful[groups.of])
        is_beside = np.zeros(n_contours, bool)
        is_beside[np.concatenate(near)] = True
        if is_beside.sum() > _FEWER * n_contours:
            return hopeful, everything
        return hopeful, part.some(np.flatnonzero(is_beside), looked, groups.line)

    def _may_show(
        self, vicinity: Vicinity, segments: _Segments, reach: float
    ) -> list[NDArray[np.int64]]:
        """Return which contours may show near each of some segments; what is known already is not looked for again."""
        limits = (reach, self._near_own_px, *self._stretches, *self._scale[:2].tolist())
        of_owner = [row.tobytes() for row in segments.relations]
        keys = [
            (span.tobytes(), of_owner[row], *limits)
            for span, row in zip(segments.spans, segments.owner.tolist(), strict=True)
        ]
        new = [g for g, key in enumerate(keys) if key not in vicinity.known]
        if new:
            rows = self._near_lines(vicinity, segments.chosen(new), reach)
            vicinity.known.update(zip([keys[g] for g in new], rows, strict=True))
        return [vicinity.known[key] for key in keys]

    def _near_lines(
        self, vicinity: Vicinity, segments: _Segments, reach: float
    ) -> list[NDArray[np.int64]]:
        """Return which contours may show near each of some segments, beyond what is excepted at common ends."""
        spans, owner, relations = segments
        scale = np.abs(self._scale[:2])
        angle = (reach + _SAG_PX * self._stretches[1]) * self._stretches[0] / float(scale.min())
        may_show = vicinity.may_show(self._part.showing)
        of, line = vicinity.lines_near(spans, owner, angle, may_show & (relations != OWN))
        clear = self._lead_away(vicinity, spans[of], line, angle)
        clear &= relations[owner[of], line] == CONNECTED
        return np.split(line[~clear], np.searchsorted(of[~clear], np.arange(1, len(spans))))

    def _lead_away(
        self, vicinity: Vicinity, spans: Array, line: NDArray[np.int64], angle: float
    ) -> NDArray[np.bool_]:
        """Return which contours (q,) leave an end of their segment (q, 2, 3) and are clear of it where that counts."""
        scale = np.abs(self._scale[:2])
        leads = np.zeros(len(line), bool)
        contours = self._part.contours
        tips = contours.vertices[contours.ends[line]]
        same = (tips[:, :, None] == spans[:, None]).all(axis=3)
        straight = self._part.pieces.bulge_mm[line] == 0.0
        shared = np.flatnonzero(same.any(axis=(1, 2)) & straight)
        at, begin = (same[shared].any(axis=axis).argmax(axis=1) for axis in (2, 1))
        rows = np.arange(len(shared))
        tips = tips[shared]
        spans = spans[shared]
        corner = tips[rows, at]
        turn = vicinity.turned_away(corner, spans[rows, 1 - begin], tips[rows, 1 - at])
        # what is not excepted is so far from the corner in the image, and farther off the axis that is a smaller angle
        off_axis = vicinity.off_axis(corner)
        at_axis = self._near_own_px / (self._stretches[1] * float(scale.max()))
        away = at_axis * np.cos(np.minimum(off_axis + at_axis, np.pi / 2.0)) ** 2
        clear = np.sin(np.minimum(away, 1.0)) * np.sin(turn) > math.sin(min(angle, 1.0))
        clear &= (vicinity.seen_within(line[shared]) < _NARROW) & (angle < 1.0)
        leads[shared] = clear
        return leads

    def corner_lines(self, cam2world: Array, pairs: Pairs) -> SeenArms:
        """Return the lines at the ends of entities that corners can be fitted with.

        Parameters
        ----------
        cam2world : array (n, 4, 4)
            Poses.
        pairs : array of int (p, 2)
            Pose and entity, in rising order of the poses.
        """
        poses = np.array(cam2world, np.float64, order="C")
        pairs = np.ascontiguousarray(pairs)
        seen, visible = self._leaving(poses, pairs)
        _, hopeful = self._drop_short(poses, pairs, seen, visible)
        candidates = np.flatnonzero(hopeful)
        visible[candidates] = self._far(poses, pairs, seen, candidates)
        return seen.chosen(visible & (seen.bend >= self.showing.min_corner_deg))

    def _leaving(self, poses: Array, pairs: Pairs) -> tuple[SeenArms, NDArray[np.bool_]]:
        """Return the arms that their own two faces do not hide, and which of them nothing hides."""
        arms = self.arms
        first = arms.first
        n_most = int((first[pairs[:, 1] + 1] - first[pairs[:, 1]]).sum())
        numbers = np.empty((2, n_most), np.int64)
        values = np.empty((3, n_most))
        places = np.empty((2, n_most, 3))
        of_arms = (first, arms.end, arms.contour, self._arm_points)
        rows = (numbers, values, places)
        n = arm_images(poses, pairs, self._scale, self._part.compiled, of_arms, rows)
        seen = SeenArms(*numbers[:, :n], *values[:, :n], *places[:, :n])
        return seen, self._visible(poses, pairs[seen.of // 2, 0], seen.place)

    def _drop_short(
        self, poses: Array, pairs: Pairs, seen: SeenArms, visible: NDArray[np.bool_]
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Take arms that are too short for a fit out of the visible ones.

        Returns
        -------
        sharpest : array (2 p,)
            The least angle of a visible arm at each end, degrees.
        hopeful : array of bool (q,)
            Which arms may make a corner and have to be far from other lines.
        """
        separation = self.showing.separation_px
        sharpest = np.full(2 * len(pairs), 90.0)
        fork = np.empty(len(visible))
        fields = (seen.of, seen.arm, seen.angle, seen.length_px, seen.direction)
        drop_mixed(fields, self.arms.wide, separation, visible, fork, sharpest)
        hopeful = np.zeros(len(visible), bool)
        if separation > 0:
            corner = (visible, self.showing.min_corner_deg, sharpest, hopeful)
            find_hopeful(seen.of, seen.angle, *corner)
            tip_deg = self._tips(poses, pairs, seen, hopeful)
            drop_short(seen.length_px, fork, tip_deg, separation, visible)
            find_hopeful(seen.of, seen.angle, *corner)
        return sharpest, hopeful

    def _tips(
        self, poses: Array, pairs: Pairs, seen: SeenArms, hopeful: NDArray[np.bool_]
    ) -> Array:
        """Return the least angle (q,) at which a visible line comes back from the tip of each arm.

        It is 90 degrees if none does, or if it does not matter.
        """
        beyond = self.arms.beyond
        # what comes back from a tip farther away is not beside what is fitted, or too near anyway
        short = hopeful & (seen.length_px < FITTED_PX + self._near_own_px)
        n_most = int(short.sum()) * beyond.shape[1]
        numbers = np.empty((2, n_most), np.int64)
        angles = np.empty(n_most)
        places = np.empty((n_most, 3))
        of_arms = (beyond, self._arm_points)
        among = (seen.of, seen.arm, short)
        rows = (numbers, angles, places)
        n = tip_lines(poses, pairs, self._scale, self._part.compiled, of_arms, among, rows)
        visible = self._visible(poses, numbers[1, :n], places[:n])
        tip_deg = np.full(len(short), 90.0)
        np.minimum.at(tip_deg, numbers[0, :n][visible], angles[:n][visible])
        return tip_deg

    def _corners(self, cam2world: Array, pairs: Pairs) -> Array:
        """Return how wide the narrower corner of pairs (p,) is, degrees."""
        poses = np.array(cam2world, np.float64, order="C")
        seen, visible = self._leaving(poses, pairs)
        sharpest, hopeful = self._drop_short(poses, pairs, seen, visible)
        # per end: a visible line far enough from the edge's own, and none too near to the edge
        widest = self._widest(poses, pairs, seen, visible, hopeful)
        widths = np.empty(len(pairs))
        angles = np.stack([widest, sharpest])
        separation = self.showing.separation_px
        corner_widths(poses, pairs, self._scale, self._ends, separation, angles, widths)
        return widths

    def _widest(
        self,
        poses: Array,
        pairs: Pairs,
        seen: SeenArms,
        visible: NDArray[np.bool_],
        hopeful: NDArray[np.bool_],
    ) -> Array:
        """Return the widest corner of each end (2 p,), degrees, of arms that are as far from other lines as is asked.

        Of an end, the arm at the largest angle is asked first: where it is far, no other counts.
        """
        widest = np.zeros(2 * len(pairs))
        ranked = np.empty(int(hopeful.sum()), np.int64)
        first = np.empty(len(widest) + 1, np.int64)
        rank_arms(seen.of, seen.angle, visible, hopeful, (ranked, first, widest))
        place = first[:-1].copy()
        last = first[1:]
        ends = np.flatnonzero(place < last)
        while ends.size:
            arms = ranked[place[ends]]
            far = self._far(poses, pairs, seen, arms)
            bend = np.minimum(seen.angle[arms], 180.0 - seen.angle[arms])
            widest[ends[far]] = np.maximum(widest[ends[far]], bend[far])
            ends = ends[~far]
            place[ends] += 1
            ends = ends[place[ends] < last[ends]]
        return widest

    def _far(
        self, cam2world: Array, pairs: Pairs, seen: SeenArms, arms: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        """Return which arms are as far from other lines as is asked of edges, as long as they are fitted to.

        The same arm of several entities is asked once.
        """
        of_pose = (
            pairs[seen.of[arms] // 2, 0] * len(self._same_arm) + self._same_arm[seen.arm[arms]]
        )
        _, chosen, inverse = np.unique(of_pose, return_index=True, return_inverse=True)
        arms = arms[chosen]
        ends = np.stack([self.arms.corner[seen.arm[arms]], seen.last[arms]], axis=1)
        looked = _Looked(
            np.ascontiguousarray(ends),
            self._line_of_arm[seen.arm[arms]],
            self._lines,
            self._same_arm[seen.arm[arms]],
            self.arms.tip[seen.arm[arms]],
        )
        each = np.column_stack([pairs[seen.of[arms] // 2, 0], np.arange(len(arms))])
        return ~self._has_near(cam2world, each, looked, self.showing.separation_px)[inverse]

    def _visible(
        self, cam2world: Array, rows: NDArray[np.int64], places: Array
    ) -> NDArray[np.bool_]:
        """Return which places (q, 3) nothing hides from the poses (q,) of these rows."""
        if not len(places):
            return np.zeros(0, bool)
        rays = np.empty((len(places), 6), np.float32)
        poses = np.ascontiguousarray(cam2world, np.float64)
        rays_to(poses, np.ascontiguousarray(rows), places, self.scene.centre, rays)
        return ~self.scene.are_blocked(rays, 1.0 - _SHORT)


def near_own_px(showing: Detectability) -> float:
    """Return how far from its own corner a neighbour leaves the strip beside an edge, at the angle asked for, px."""
    return showing.separation_px / math.sin(math.radians(max(showing.min_corner_deg, 5.0)))


def _lens_of(camera: Camera) -> Array:
    """Return the coefficients of a camera's distortion (5,), or none (0,) where it has no distortion."""
    if camera.distortion is None:
        return np.zeros(0)
    return np.array(camera.distortion.coefficients, np.float64)


def _stretches_of(camera: Camera) -> tuple[float, float]:
    """Return how many times as long a short way on the sensor may be in the image without distortion, and vice versa.

    Both are 1 at least, and just that without distortion.
    """
    lens = camera.distortion
    if lens is None:
        return 1.0, 1.0
    matrix = camera.matrix
    shares = np.linspace(0.0, 1.0, _GRID)
    pixels = np.stack(np.meshgrid(*(shares * (side - 1) for side in camera.resolution)), axis=-1)
    focal = np.array([matrix[0, 0], matrix[1, 1]])
    distorted = (pixels.reshape(-1, 2) - matrix[:2, 2]) / focal
    stretch = lens.stretch(lens.undistort(distorted))
    in_pixels = stretch * (focal[:, None] / focal)
    sizes = np.linalg.svd(in_pixels, compute_uv=False)
    return max(1.0, _WIDER / float(sizes.min())), max(1.0, _WIDER * float(sizes.max()))


class _ImageLines(NamedTuple):
    """Relations (r, m) of contours to entities or arms, vertices (w,) of these, where those of each begin (r + 1,)."""

    relations: NDArray[np.uint8]
    vertices: NDArray[np.int64]
    first: NDArray[np.int64]

    @classmethod
    def of(cls, contours: Contours, relations: Sequence[NDArray[np.uint8]]) -> _ImageLines:
        own_ends = [np.unique(contours.ends[relation == OWN]) for relation in relations]
        vertices = np.concatenate([np.zeros(0, np.int64), *own_ends]).astype(np.int64)
        first = np.cumsum([0, *map(len, own_ends)]).astype(np.int64)
        return cls(np.array(relations, np.uint8).reshape(-1, len(contours.ids)), vertices, first)


class _Groups(NamedTuple):
    """Segments (g, 2, 3) that hold those of pairs, which lines (g,) they belong to, and which each pair (p,) is of."""

    spans: Array
    line: NDArray[np.int64]
    of: NDArray[np.int64]


class _Segments(NamedTuple):
    """Segments (g, 2, 3), whose they are (g,), and the relations (r, m) of contours to each owner."""

    spans: Array
    owner: NDArray[np.int64]
    relations: NDArray[np.uint8]

    def chosen(self, which: Sequence[int]) -> _Segments:
        """Return some of the segments, with the relations of all owners."""
        return _Segments(self.spans[which], self.owner[which], self.relations)


class _Looked(NamedTuple):
    """What is asked how near other lines come: ends (k, 2, 3), the number (k,) of what they belong to, and these.

    Those of one number (k,) in `same` are the same segment; or, where `whole` (k, 3) has ends, begin at the same point
    and end on the way to the same one of these.
    """

    ends: Array
    line: NDArray[np.int64]
    lines: _ImageLines
    same: NDArray[np.int64]
    whole: Array | None = None

    def groups(self, which: NDArray[np.int64]) -> _Groups:
        """Return what some of them (p,) are together."""
        _, first, of = np.unique(self.same[which], return_index=True, return_inverse=True)
        first = which[first]
        begin = self.ends[first, 0]
        square = ((self.ends[which, 1] - self.ends[which, 0]) ** 2).sum(axis=1)
        longest = np.zeros(len(first))
        np.maximum.at(longest, of, square)
        if self.whole is None:
            return _Groups(self.ends[first], self.line[first], of)
        whole = self.whole[first]
        length = np.maximum(np.linalg.norm(whole - begin, axis=1), _LEAST_MM)
        # rounded up, so that other images ask for the same
        share = np.minimum(np.ceil(np.sqrt(longest) / length * _SHARES + _OVER) / _SHARES, 1.0)
        last = np.where(share[:, None] < 1.0, begin + share[:, None] * (whole - begin), whole)
        spans = np.stack([begin, last], axis=1)
        return _Groups(spans, self.line[first], of)


def edges_of(space: Any, name: str) -> tuple[int, ...] | None:
    """Return the edges of an entity of a space, or None for what is no straight edge."""
    entity = space.entities[name]
    if hasattr(entity, "witnesses"):
        (witness,) = entity.witnesses
        return edges_of(space.space, witness[0]) if len(witness) == 1 else None
    return tuple(entity.edge_ids) if getattr(entity, "kind", None) == "edge" else None


def scanned_in(space: Any, name: str, geometry: Sequence[Geometry]) -> list[Scanned]:
    """Return what is scanned of a dimension of a space that has one set of entities, in the order of its geometry."""
    seen = space.entities[name]
    if not hasattr(seen, "witnesses"):
        return [Scanned.of(seen.edge_ids, item) for item in geometry]
    (witness,) = seen.witnesses
    return [
        Scanned.of(space.space.entities[entity].edge_ids, item)
        for entity, item in zip(witness, geometry, strict=True)
    ]
