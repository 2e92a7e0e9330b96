"""Which lines of a part surely do not show near segments in the images of cameras that are near to each other.

A count looks at the images of a thousand displaced cameras. Most lines are near a segment in none of them, or hidden
in all of them. What is told here is proven for each place of the cameras, so leaving a line out changes no count.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aspectgraph import Solid
from aspectgraph.solid.solid import RayScene
from ground.decorators import entry_kernel, kernel_without_refcounts
from planner.detectability.corners import SHOWS, Contours

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

# pieces of each line
_PARTS = 8
# radians that a bound may be too small by, for rounding
_ROUNDING = 1e-9
# mm, so that nothing is divided by 0
_TINY_MM = 1e-12
# of the distance of a point, how far a camera may move; beyond, nothing is said of that point
_NEARLY = 0.9
# arcs shorter than this have no direction, rad
_SHORTEST = 1e-6
# distances from curves may be said to be less than they are, by a tenth of how far these leave their chords
_BULGIER = 1.25
# lines near segments that there is memory for at first
_ROOM = 256
# cameras to come may be so many times as far from the middle as those of the first images
_WIDER = 1.25
# of the distance to the part: cameras farther apart than this are not near to each other
_APART = 0.1

# Columns of a table of segments, as the middle of a ball sees them: unit vectors to both ends, how
# far what belongs to a segment is off it (rad; 2 π where nothing is known), its middle (mm), how
# far it reaches from that, and how near it comes to anywhere in the ball. Then a cone that holds
# it, axis and half angle, and how far it reaches from the part's middle. At last the arc of a great
# circle between the ends: the normal of its plane, those of planes at its ends, and the sine of its
# angle.
_FIRST = 0
_LAST = 3
_OFF = 6
_MIDDLE = 7
_HALF_MM = 10
_NEAREST_MM = 11
_AXIS = 12
_HALF = 15
_FAR_MM = 16
_NORMAL = 17
_AFTER = 20
_BEFORE = 23
_LENGTH = 26
_COLUMNS = 27


class PartPieces:
    """The lines of a part in pieces, and the faces that may hide them.

    Parameters
    ----------
    solid : Solid
        The part.
    scene : RayScene
        Of the part.
    ends : array (m, 2, 3)
        Of the lines, mm.
    bulges : array (m, 3)
        How far the curves that they stand for leave them, mm.
    """

    def __init__(self, solid: Solid, scene: RayScene, ends: Array, bulges: Array) -> None:
        self.ends = ends
        self.bulge_mm = _BULGIER * np.linalg.norm(bulges, axis=1)
        self.split = _split(ends).reshape(-1, _PARTS, 2, 3)
        self.faces = HidingFaces(solid, scene)
        self.middle = np.asarray(solid.bounds, np.float64).mean(axis=0)
        self._last: Vicinity | None = None

    def around(self, cam2world: Array) -> Vicinity | None:
        """Return what is known of poses (n, 4, 4) near to each other: of the last ones, if they hold these.

        None where the poses are so far from each other that nothing can be known.
        """
        last = self._last
        if last is None or not last.holds(cam2world):
            last = Vicinity.of(self, cam2world)
            if last.radius_mm > _APART * float(np.linalg.norm(self.middle - last.centre)):
                return None
            self._last = last
        return last


class Vicinity:
    """Tells which lines of a part may show near segments, from anywhere in a ball.

    Turning a camera does not change the angles between what it sees, and the image of a pinhole camera is nowhere
    smaller than the focal length times such an angle. Two points at the distances d and d' of a camera, a apart from
    each other, change their angle by a / (d d') at most for each millimetre that the camera moves: that is the length
    of the angle's gradient. So what is farther apart than these angles allow is not near in the image, from any of the
    places.

    Parameters
    ----------
    part : PartPieces
        The lines.
    centre : array (3,)
        Of the ball, mm.
    radius_mm : float
        Of the ball.
    axis : array (3,)
        A unit vector, from which optical axes of cameras in the ball are not far off.
    spread : float
        How far, rad.

    Attributes
    ----------
    known : dict of tuple to array of int
        Lines that may show near segments, as far as somebody has asked and keeps it here.
    """

    def __init__(
        self, part: PartPieces, centre: Array, radius_mm: float, axis: Array, spread: float
    ) -> None:
        self.centre = centre
        self.radius_mm = radius_mm
        self.known: dict[tuple[bytes | float, ...], Indices] = {}
        self._axis = axis
        self._spread = spread
        self._part = part
        self._whole = self._seen(part.ends, part.bulge_mm)
        # those that somebody has asked for; pieces, and sides of faces
        self._pieces = _Looks.none(len(part.ends) * _PARTS)
        self._sides = _Looks.none(len(part.faces.borders))
        # of each piece 1 where it is hidden, 0 where it may be seen, -1 where nobody has looked yet
        self._hidden = np.full((len(part.ends), _PARTS), -1, np.int8)

    @classmethod
    def of(cls, part: PartPieces, cam2world: Array) -> Vicinity:
        """Return one that holds poses (n, 4, 4), and a little more."""
        eyes = cam2world[:, :3, 3]
        axes = cam2world[:, :3, 2]
        centre = eyes.mean(axis=0)
        axis = axes.mean(axis=0)
        axis /= max(float(np.linalg.norm(axis)), _TINY_MM)
        radius_mm = float(np.linalg.norm(eyes - centre, axis=1).max())
        spread = float(_angle(axes, axis).max())
        return cls(part, centre, _WIDER * radius_mm, axis, _WIDER * spread + _ROUNDING)

    def holds(self, cam2world: Array) -> bool:
        """Return whether poses (n, 4, 4) are in the ball, and their optical axes as near as those that it is for."""
        off_mm = np.linalg.norm(cam2world[:, :3, 3] - self.centre, axis=1)
        off = _angle(cam2world[:, :3, 2], self._axis)
        return bool((off_mm <= self.radius_mm).all() and (off <= self._spread).all())

    def lines_near(
        self, spans: Array, owner: Indices, angle: float, among: Mask
    ) -> tuple[Indices, Indices]:
        """Return which lines may be seen so near to which segment: numbers of segments, in rising order, and of lines.

        Parameters
        ----------
        spans : array (s, 2, 3)
            The segments, mm.
        owner : array of int (s,)
            What they belong to, which is near to all of them.
        angle : float
            How near, rad; less than π / 2.
        among : array of bool (r, m)
            Lines that are looked at for each owner.
        """
        part = self._part
        spans_seen = self._seen(spans, np.zeros(len(spans)))
        balls = self._balls(spans, owner, len(among))
        room = _ROOM
        while True:
            rows = np.empty((room, 2), np.int64), np.empty((room, _PARTS), np.bool_)
            lines = (self._whole, part.bulge_mm, among)
            pieces = (self._pieces.table, self._pieces.is_seen, part.split.reshape(-1, 2, 3))
            limits = (*self._ball, angle)
            n = _near_lines((spans_seen, owner, balls), lines, pieces, limits, rows)
            if n <= room:
                break
            room = n
        of, line = rows[0][:n].T
        near = rows[1][:n]
        row, piece = np.nonzero(near)
        near[row, piece] = ~self._are_hidden(line[row], piece)
        may_show = near.any(axis=1)
        return of[may_show], line[may_show]

    @property
    def _ball(self) -> tuple[Array, float, Array]:
        """The ball, and the middle of the part as its centre sees it."""
        return self.centre, self.radius_mm, self._part.middle - self.centre

    def _balls(self, spans: Array, owner: Indices, n: int) -> Array:
        """Return balls (n,) that hold the segments of each owner."""
        middles = spans.mean(axis=1)
        half_mm = np.linalg.norm(spans[:, 1] - spans[:, 0], axis=1) / 2.0
        count = np.maximum(np.bincount(owner, minlength=n), 1)
        sums = [np.bincount(owner, weights=middles[:, c], minlength=n) for c in range(3)]
        centres = np.stack(sums, axis=1) / count[:, None]
        radius_mm = np.zeros(n)
        far_mm = np.linalg.norm(middles - centres[owner], axis=1) + half_mm
        np.maximum.at(radius_mm, owner, far_mm)
        return self._seen(np.repeat(centres[:, None], 2, axis=1), radius_mm)

    def _are_hidden(self, line: Indices, piece: Indices) -> Mask:
        """Return which pieces of lines (q,) are hidden from the whole ball."""
        number, place = np.unique(line * _PARTS + piece, return_inverse=True)
        hidden = self._hidden.reshape(-1)
        new = number[hidden[number] < 0]
        if len(new):
            pieces = self._part.split.reshape(-1, 2, 3)[new]
            hidden[new] = self._part.faces.hide(self, pieces)
        return np.asarray(hidden[number][place] > 0)

    def may_show(self, contours: Contours) -> Mask:
        """Return which contours (m,) their own two faces leave to be seen from somewhere in the ball."""
        height = contours.planes[:, :3] @ self.centre - contours.planes[:, 3]
        unsure_mm = self.radius_mm + _ROUNDING * (1.0 + np.abs(contours.planes[:, 3]))
        fewest = (height > unsure_mm)[contours.faces].sum(axis=1)
        highest = (height > -unsure_mm)[contours.faces].sum(axis=1)
        shows = SHOWS[contours.kinds] > 0
        fronts = np.arange(3)
        possible = (fronts >= fewest[:, None]) & (fronts <= highest[:, None])
        return np.asarray((shows & possible).any(axis=1))

    def hides(self, pieces: Array, first: Indices, unsure_mm: float) -> Mask:
        """Return which segments (q, 2, 3) faces hide from the whole ball, from a first one (q,) on; mm."""
        hidden = np.zeros(len(pieces), np.bool_)
        faces = self._part.faces
        sides = (self._sides.table, self._sides.is_seen, faces.borders)
        _hide(pieces, first, faces.compiled, sides, (*self._ball, unsure_mm), hidden)
        return hidden

    def turned_away(self, corner: Array, ends: Array, tips: Array) -> Array:
        """Return the least angle at which lines leave segments that begin at the same corner, as seen; rad, (q,).

        It is that between the planes through the camera and the two of them, at most a right angle.

        Parameters
        ----------
        corner, ends, tips : array (q, 3)
            Where both begin, and where segment and line end, mm.
        """
        eye = corner - self.centre
        normals = []
        turn = np.zeros(len(corner))
        for other in (ends, tips):
            along = other - corner
            normal = _cross(eye, along)
            size = np.linalg.norm(normal, axis=1)
            off_mm = size / np.maximum(np.linalg.norm(along, axis=1), _TINY_MM)
            ratio = self.radius_mm / np.maximum(off_mm, _TINY_MM)
            # the plane turns about the line when the camera moves
            turn += np.where(ratio < _NEARLY, np.arcsin(np.minimum(ratio, _NEARLY)), np.pi)
            normals.append(normal / np.maximum(size, _TINY_MM)[:, None])
        sine = np.linalg.norm(_cross(*normals), axis=1)
        between = np.arctan2(sine, (normals[0] * normals[1]).sum(axis=1))
        return np.asarray(np.clip(between - turn - _ROUNDING, 0.0, np.pi / 2.0))

    def off_axis(self, points: Array) -> Array:
        """Return how far from the optical axes points (q, 3) are seen at most, rad; (q,)."""
        way = points - self.centre
        distance = np.maximum(np.linalg.norm(way, axis=1), _TINY_MM)
        turn = np.where(
            self.radius_mm < _NEARLY * distance,
            np.arcsin(np.minimum(self.radius_mm / distance, _NEARLY)),
            np.pi,
        )
        off = _angle(way / distance[:, None], self._axis)
        return np.asarray(off + (turn + self._spread + _ROUNDING))

    def seen_within(self, line: Indices) -> Array:
        """Return how long lines (q,) look at most, rad; π where nothing is known."""
        whole = self._whole[line]
        turn = np.arcsin(np.minimum(self.radius_mm / whole[:, _NEAREST_MM], 1.0))
        length = _angle(whole[:, _FIRST:_LAST], whole[:, _LAST:_OFF])
        return np.asarray(np.minimum(length + whole[:, _OFF] + 2.0 * turn, np.pi))

    def _seen(self, segments: Array, bulge_mm: Array) -> Array:
        """Return how segments (m, 2, 3), and what is so far off them, look from the middle of the ball: a table."""
        table = np.empty((len(segments), _COLUMNS))
        _look_all(np.ascontiguousarray(segments), bulge_mm, self._ball, table)
        return table


class _Looks(NamedTuple):
    """How segments look from the middle of a ball: a table (q, 27), and which of its rows are filled (q,)."""

    table: Array
    is_seen: Mask

    @classmethod
    def none(cls, n: int) -> _Looks:
        """Return a table of which no row is filled."""
        return cls(np.empty((n, _COLUMNS)), np.zeros(n, np.bool_))


def _cross(one: Array, other: Array) -> Array:
    """Return cross products (q, 3); numpy's own takes several times as long for so few."""
    x, y, z = one.T
    u, v, w = other.T
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)


def _angle(one: Array, other: Array) -> Array:
    """Return angles (q,) between unit vectors (q, 3), rad."""
    return np.asarray(2.0 * np.arcsin(np.minimum(np.linalg.norm(one - other, axis=1) / 2.0, 1.0)))


def _split(ends: Array) -> Array:
    """Return the ends (8 m, 2, 3) of the pieces of segments (m, 2, 3)."""
    shares = np.linspace(0.0, 1.0, _PARTS + 1)[:, None]
    points = ends[:, :1] + shares * (ends[:, 1:] - ends[:, :1])
    return np.stack([points[:, :-1], points[:, 1:]], axis=2).reshape(-1, 2, 3)


# Which pieces of lines the part hides from a whole ball.
#
# The ray to the middle of a piece meets a face first. As the camera moves in the ball, and the
# point along the piece, the place where the ray meets the part moves on, over borders to other
# faces. It is lost only at a border to a face that turns away, or behind the piece. So faces are
# followed from the first one over all borders that may be seen in line with the piece. If all of
# them turn to the whole ball, and the piece is below all of their planes, it is hidden.


# rays end this share before what they look for; what hides must be clearly nearer
_SHORT = 1e-3
# flatter rays are not looked at
_LEAST_SINE = 0.05
# of lengths, what single precision of rays may be off, with a reserve
_SINGLE = 1e-5
# faces that are followed, at most
_MOST_FACES = 12


class HidingFaces:
    """The faces of a part, and what they hide.

    Parameters
    ----------
    solid : Solid
        The part.
    scene : RayScene
        Of the part.
    """

    def __init__(self, solid: Solid, scene: RayScene) -> None:
        self._scene = scene
        self._normals = np.array(solid.normals, np.float64, order="C")
        self._triangle_face = np.asarray(solid.triangle_face, np.int64)
        vertices = np.asarray(solid.vertices, np.float64)
        triangles = np.asarray(solid.triangles, np.int64)
        self._places = np.zeros_like(self._normals)
        self._places[self._triangle_face] = vertices[triangles[:, 0]]
        self._planarity_mm = float(solid.planarity_mm)
        self._size_mm = float(np.linalg.norm(np.ptp(vertices, axis=0)))
        self._middle = np.asarray(solid.bounds, np.float64).mean(axis=0)
        # the border of a face: the sides of its triangles that no other one of them has
        sides = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        of_face = np.column_stack([np.repeat(self._triangle_face, 3), sides])
        border, count = np.unique(of_face, axis=0, return_counts=True)
        border = border[count == 1]
        self.borders = np.ascontiguousarray(vertices[border[:, 1:]])
        first = np.searchsorted(border[:, 0], np.arange(len(self._normals) + 1)).astype(np.int64)
        # what is beyond a border: the one other face that has this side, -1 where there is not one
        _, side, count = np.unique(border[:, 1:], axis=0, return_inverse=True, return_counts=True)
        side = side.reshape(-1)
        both = np.bincount(side, weights=border[:, 0]).astype(np.int64)
        beyond = np.where(count[side] == 2, both[side] - border[:, 0], -1).astype(np.int64)
        self.compiled = (self._normals, self._places, first, beyond)

    def hide(self, ball: Vicinity, pieces: Array) -> Mask:
        """Return which segments (q, 2, 3) are surely hidden from all of a ball; mm."""
        hits = self._scene.cast(ball.centre, pieces.mean(axis=1) - ball.centre)
        hidden = np.zeros(len(pieces), bool)
        rows = np.flatnonzero(hits["t_hit"] < 1.0 - _SHORT)
        first = self._triangle_face[hits["primitive_ids"][rows].astype(np.int64)]
        far_mm = float(np.linalg.norm(self._middle - ball.centre))
        unsure_mm = self._planarity_mm + _SINGLE * (far_mm + 2.0 * self._size_mm)
        hidden[rows] = ball.hides(pieces[rows], first, unsure_mm)
        return hidden


@entry_kernel(error_model="numpy")
def _look_all(segments: Any, bulge_mm: Any, ball: Any, table: Any) -> None:
    """Write how segments (m, 2, 3), and what is so far off them (m,), look from the middle of a ball."""
    for i in range(len(segments)):
        _look(segments, i, bulge_mm[i], ball, table, i)


@entry_kernel(error_model="numpy")
def _near_lines(segments: Any, lines: Any, pieces: Any, limits: Any, found: Any) -> int:
    """Write which lines may be seen near which segments, and which pieces of these; return how many there are.

    Parameters
    ----------
    segments : tuple
        Table (s, 27), whose they are (s,), and a table (r, 27) of balls that hold those of each owner.
    lines : tuple
        Table (m, 27), how far they are off it in mm (m,), and those looked at for each owner (r, m).
    pieces : tuple
        Table (8 m, 27), which rows are filled, and the pieces (8 m, 2, 3) in mm.
    limits : tuple
        Centre, radius, the part's middle from there, and how near, rad.
    found : tuple
        To be written: segment and line (q, 2), and which of its pieces (q, 8). What does not fit is counted.
    """
    spans, owner, balls = segments
    whole, bulge_mm, among = lines
    centre, radius_mm, middle, angle = limits
    ball = (centre, radius_mm, middle)
    near = np.empty(_PARTS, np.bool_)
    is_near_owner = np.empty(among.shape, np.bool_)
    for r in range(among.shape[0]):
        for m in range(among.shape[1]):
            is_near_owner[r, m] = among[r, m] and _may_meet(balls, r, whole, m, radius_mm, angle)
    count = 0
    for s in range(len(spans)):
        for m in range(len(whole)):
            if not is_near_owner[owner[s], m]:
                continue
            if not _may_meet(spans, s, whole, m, radius_mm, angle):
                continue
            if not _meet(spans, s, whole, m, radius_mm, angle):
                continue
            n_near = _near_pieces(spans, s, m, bulge_mm[m], pieces, ball, angle, near)
            if n_near == 0:
                continue
            if count < len(found[0]):
                found[0][count, 0] = s
                found[0][count, 1] = m
                for c in range(_PARTS):
                    # where on a chord its curve is near is not known so exactly
                    found[1][count, c] = near[c] or bulge_mm[m] > 0.0
            count += 1
    return count


@kernel_without_refcounts(error_model="numpy")
def _near_pieces(
    spans: Any, s: int, m: int, bulge_mm: float, pieces: Any, ball: Any, angle: float, near: Any
) -> int:
    """Write which pieces of a line may be seen near a segment; return how many."""
    table, is_seen, ends = pieces
    n_near = 0
    for c in range(_PARTS):
        row = m * _PARTS + c
        if not is_seen[row]:
            _look(ends, row, bulge_mm, ball, table, row)
            is_seen[row] = True
        near[c] = _may_meet(spans, s, table, row, ball[1], angle) and _meet(
            spans, s, table, row, ball[1], angle
        )
        n_near += near[c]
    return n_near


@entry_kernel(error_model="numpy")
def _hide(pieces: Any, first: Any, faces: Any, sides: Any, limits: Any, hidden: Any) -> None:
    """Write which segments all faces that rays to them may meet hide, from a first one on.

    Parameters
    ----------
    pieces : array (q, 2, 3)
        The segments, mm.
    first : array of int (q,)
        The faces that the rays to their middles meet.
    faces : tuple
        `HidingFaces.compiled`.
    sides : tuple
        Table (b, 27) of the sides of faces, which rows are filled, and the sides (b, 2, 3) in mm.
    limits : tuple
        Centre, radius, the part's middle from there, and what is unsure, mm.
    hidden : array of bool (q,)
        To be written.
    """
    normals, places, begin, beyond = faces
    centre, radius_mm, middle, unsure_mm = limits
    ball = (centre, radius_mm, middle)
    # a plane that is off moves flat rays more
    off_mm = unsure_mm / _LEAST_SINE
    met = np.empty(_MOST_FACES, np.int64)
    segment = np.empty((1, _COLUMNS))
    for q in range(len(pieces)):
        _look(pieces, q, off_mm, ball, segment, 0)
        met[0] = first[q]
        n_met = 1
        done = 0
        while 0 <= done < n_met:
            face = met[done]
            done += 1
            if not _is_before(pieces, q, face, normals, places, (centre, radius_mm, unsure_mm)):
                done = -1
                break
            for side in range(begin[face], begin[face + 1]):
                if not sides[1][side]:
                    _look(sides[2], side, off_mm, ball, sides[0], side)
                    sides[1][side] = True
                if not _may_meet(segment, 0, sides[0], side, radius_mm, 0.0):
                    continue
                if not _meet(segment, 0, sides[0], side, radius_mm, 0.0):
                    continue
                n_met = _with_face(met, n_met, beyond[side])
                if n_met < 0:
                    break
        hidden[q] = done == n_met


@kernel_without_refcounts(error_model="numpy")
def _with_face(met: Any, n_met: int, face: int) -> int:
    """Take note of a face that is met; return how many there are, -1 where that is not known or too many."""
    if face < 0:
        return -1
    for i in range(n_met):
        if met[i] == face:
            return n_met
    if n_met == len(met):
        return -1
    met[n_met] = face
    return n_met + 1


@kernel_without_refcounts(error_model="numpy")
def _is_before(pieces: Any, q: int, face: int, normals: Any, places: Any, limits: Any) -> bool:
    """Whether a face turns to the whole ball, and a segment is below its plane."""
    centre, radius_mm, unsure_mm = limits
    height = 0.0
    for c in range(3):
        height += (centre[c] - places[face, c]) * normals[face, c]
    if height <= 2.0 * (radius_mm + unsure_mm):
        return False
    for end in range(2):
        depth = 0.0
        square = 0.0
        for c in range(3):
            depth += (places[face, c] - pieces[q, end, c]) * normals[face, c]
            square += (pieces[q, end, c] - centre[c]) ** 2
        whole = depth + height
        is_steep = whole >= _LEAST_SINE * math.sqrt(square)
        if not is_steep or depth < max(_SHORT * (whole + radius_mm), 2.0 * unsure_mm):
            return False
    return True


@kernel_without_refcounts(error_model="numpy")
def _look(segments: Any, i: int, bulge_mm: float, ball: Any, table: Any, row: int) -> None:
    """Write how a segment, and what is so far off it, looks from the middle of a ball."""
    centre, radius_mm, middle = ball
    along_square = 0.0
    forward = 0.0
    for c in range(3):
        first = segments[i, 0, c] - centre[c]
        last = segments[i, 1, c] - centre[c]
        table[row, _FIRST + c] = first
        table[row, _LAST + c] = last
        table[row, _MIDDLE + c] = (first + last) / 2.0
        along_square += (last - first) ** 2
        forward -= first * (last - first)
    share = min(max(forward / max(along_square, _TINY_MM), 0.0), 1.0)
    reached_square = 0.0
    far_square = 0.0
    for c in range(3):
        first = table[row, _FIRST + c]
        last = table[row, _LAST + c]
        reached_square += (first + share * (last - first)) ** 2
        far_square += (table[row, _MIDDLE + c] - middle[c]) ** 2
    reached_mm = math.sqrt(reached_square)
    nearest_mm = reached_mm - bulge_mm - radius_mm
    table[row, _NEAREST_MM] = max(nearest_mm, _TINY_MM)
    table[row, _OFF] = 2.0 * math.pi
    if nearest_mm >= (1.0 - _NEARLY) * reached_mm:
        table[row, _OFF] = math.asin(min(bulge_mm / max(reached_mm, _TINY_MM), _NEARLY))
    table[row, _HALF_MM] = math.sqrt(along_square) / 2.0 + bulge_mm
    table[row, _FAR_MM] = math.sqrt(far_square) + table[row, _HALF_MM]
    _write_arc(table, row)


@kernel_without_refcounts(error_model="numpy")
def _write_arc(table: Any, row: int) -> None:
    """Make unit vectors of the ends of a segment; write the cone that holds it, and the arc between them."""
    first_mm = max(_length(table, row, _FIRST), _TINY_MM)
    last_mm = max(_length(table, row, _LAST), _TINY_MM)
    sum_square = 0.0
    between_square = 0.0
    for c in range(3):
        table[row, _FIRST + c] /= first_mm
        table[row, _LAST + c] /= last_mm
        table[row, _AXIS + c] = table[row, _FIRST + c] + table[row, _LAST + c]
        sum_square += table[row, _AXIS + c] ** 2
        between_square += (table[row, _LAST + c] - table[row, _FIRST + c]) ** 2
    size = math.sqrt(sum_square)
    # half of the angle between two unit vectors
    table[row, _HALF] = math.atan2(math.sqrt(between_square), size)
    for c in range(3):
        table[row, _AXIS + c] /= max(size, _TINY_MM)
    _write_cross(table, row, _FIRST, _LAST, _NORMAL)
    table[row, _LENGTH] = _length(table, row, _NORMAL)
    for c in range(3):
        table[row, _NORMAL + c] /= max(table[row, _LENGTH], _TINY_MM)
    _write_cross(table, row, _NORMAL, _FIRST, _AFTER)
    _write_cross(table, row, _LAST, _NORMAL, _BEFORE)


@kernel_without_refcounts(error_model="numpy")
def _length(table: Any, row: int, column: int) -> float:
    return math.sqrt(
        table[row, column] ** 2 + table[row, column + 1] ** 2 + table[row, column + 2] ** 2
    )


@kernel_without_refcounts(error_model="numpy")
def _may_meet(one: Any, i: int, other: Any, k: int, radius_mm: float, angle: float) -> bool:
    """Whether `_meet` is worth asking: whether the cones that hold two segments come so near."""
    cosine = 0.0
    for c in range(3):
        cosine += one[i, _AXIS + c] * other[k, _AXIS + c]
    chord = math.sqrt(max(2.0 - 2.0 * cosine, 0.0))
    change = radius_mm * (one[i, _FAR_MM] + other[k, _FAR_MM])
    change /= one[i, _NEAREST_MM] * other[k, _NEAREST_MM]
    limit = one[i, _HALF] + other[k, _HALF] + one[i, _OFF] + other[k, _OFF] + change
    return bool(chord <= limit + (angle + _ROUNDING))


@kernel_without_refcounts(error_model="numpy")
def _meet(one: Any, i: int, other: Any, k: int, radius_mm: float, angle: float) -> bool:
    """Whether a segment may be seen so near to another one from anywhere in the ball."""
    square = 0.0
    for c in range(3):
        square += (one[i, _MIDDLE + c] - other[k, _MIDDLE + c]) ** 2
    apart_mm = math.sqrt(square) + one[i, _HALF_MM] + other[k, _HALF_MM]
    change = radius_mm * apart_mm / (one[i, _NEAREST_MM] * other[k, _NEAREST_MM])
    limit = one[i, _OFF] + other[k, _OFF] + change + (angle + _ROUNDING)
    # no chord of a unit sphere is longer
    return bool(limit >= 2.0 or _apart(one, i, other, k) <= limit)


@kernel_without_refcounts(error_model="numpy")
def _apart(one: Any, i: int, other: Any, k: int) -> float:
    """How far arcs of great circles are apart; chords, which are less than angles."""
    nearest, is_crossed = _from_arc(one, i, other, k)
    back, is_crossed_back = _from_arc(other, k, one, i)
    is_facing = _dot(one, i, _AXIS, other, k, _AXIS) > 0.0
    if is_crossed and is_crossed_back and is_facing:
        return 0.0
    return float(min(nearest, back))


@kernel_without_refcounts(error_model="numpy")
def _from_arc(arc: Any, i: int, other: Any, k: int) -> tuple[float, bool]:
    """How far the ends of another arc are from an arc, and whether they are on both sides of its plane."""
    length = arc[i, _LENGTH]
    is_arc = length > _SHORTEST
    nearest = math.inf
    heights = 1.0
    for column in (_FIRST, _LAST):
        height = _dot(arc, i, _NORMAL, other, k, column)
        after = _dot(arc, i, _AFTER, other, k, column)
        before = _dot(arc, i, _BEFORE, other, k, column)
        heights *= height
        if is_arc and after > 0.0 and before > 0.0:
            nearest = min(nearest, abs(height))
            continue
        for end in (_FIRST, _LAST):
            square = 0.0
            for c in range(3):
                square += (other[k, column + c] - arc[i, end + c]) ** 2
            chord = math.sqrt(square)
            # of what is too short to have a direction
            nearest = min(nearest, chord if is_arc else chord - length)
    return nearest, is_arc and heights <= 0.0


@kernel_without_refcounts(error_model="numpy")
def _dot(one: Any, i: int, column: int, other: Any, k: int, other_column: int) -> float:
    return float(
        one[i, column] * other[k, other_column]
        + one[i, column + 1] * other[k, other_column + 1]
        + one[i, column + 2] * other[k, other_column + 2]
    )


@kernel_without_refcounts(error_model="numpy")
def _write_cross(table: Any, row: int, one: int, other: int, product: int) -> None:
    """Write the cross product of two vectors of a row to columns of it."""
    for c in range(3):
        u = (c + 1) % 3
        v = (c + 2) % 3
        table[row, product + c] = (
            table[row, one + u] * table[row, other + v]
            - table[row, one + v] * table[row, other + u]
        )
