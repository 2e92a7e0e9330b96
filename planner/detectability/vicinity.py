"""Which lines of a part surely do not show near segments in the images of cameras that are near to each other.

A count looks at the images of a thousand displaced cameras. Most lines are near a segment in none of them, or hidden
in all of them. What is told here is proven for each place of the cameras, so leaving a line out changes no count.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aspectgraph import Solid
from aspectgraph.solid.solid import RayScene
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
# cameras to come may be so many times as far from the middle as those of the first images
_WIDER = 1.25
# of the distance to the part: cameras farther apart than this are not near to each other
_APART = 0.1


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
        # the sides of faces, as far as somebody has asked
        self._sides: dict[int, tuple[_Seen, tuple[Array, Array, Array]]] = {}
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
        # lines near an owner first, then near a segment, then pieces of what is left
        whole = self._seen(spans, np.zeros(len(spans)))
        by_owner = among & self._may_meet(self._balls(spans, owner, len(among)), angle)
        of, line = np.nonzero(by_owner[owner])
        near = _meet(whole.chosen(of), self._whole.chosen(line), self.radius_mm, angle)
        of = of[near]
        line = line[near]
        off_mm = np.repeat(part.bulge_mm[line], _PARTS)
        pieces = self._seen(part.split[line].reshape(-1, 2, 3), off_mm)
        other = whole.chosen(np.repeat(of, _PARTS))
        near = _meet(other, pieces, self.radius_mm, angle).reshape(-1, _PARTS)
        # where on a chord its curve is near is not known so exactly
        curved = part.bulge_mm[line] > 0.0
        near[curved] = near[curved].any(axis=1)[:, None]
        row, piece = np.nonzero(near)
        near[row, piece] = ~self._are_hidden(line[row], piece)
        may_show = near.any(axis=1)
        return of[may_show], line[may_show]

    def _balls(self, spans: Array, owner: Indices, n: int) -> _Seen:
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

    def _may_meet(self, spans: _Seen, angle: float) -> Mask:
        """Return where `_meet` is worth asking, of segments or balls (s,) and all lines (m,); (s, m)."""
        lines = self._whole
        axes, half, far_mm = spans.around(self._part.middle - self.centre)
        line_axes, line_half, line_far_mm = lines.around(self._part.middle - self.centre)
        chord = np.sqrt(np.maximum(2.0 - 2.0 * (axes @ line_axes.T), 0.0))
        change = self.radius_mm * np.add.outer(far_mm, line_far_mm)
        change /= np.multiply.outer(spans.nearest_mm, lines.nearest_mm)
        limit = np.add.outer(half + spans.off, line_half + lines.off) + change
        return np.asarray(chord <= limit + (angle + _ROUNDING))

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

    def in_line(self, face: int, sides: Array, segment: Array, off_mm: float) -> Mask:
        """Return which sides (q, 2, 3) of a face may be seen to meet a segment (2, 3), up to an uncertainty in mm."""
        middle = self._part.middle - self.centre
        if face not in self._sides:
            seen = self._seen(sides, np.full(len(sides), off_mm))
            self._sides[face] = seen, seen.around(middle)
        seen, (axes, half, far_mm) = self._sides[face]
        itself = self._seen(segment[None], np.full(1, off_mm))
        (axis,), (own_half,), (own_far_mm,) = itself.around(middle)
        # as `_may_meet`
        chord = np.sqrt(np.maximum(2.0 - 2.0 * (axes @ axis), 0.0))
        change = self.radius_mm * (far_mm + own_far_mm) / (seen.nearest_mm * itself.nearest_mm)
        limit = half + own_half + seen.off + itself.off + change + _ROUNDING
        rows = np.flatnonzero(chord <= limit)
        result = np.zeros(len(sides), bool)
        repeated = itself.chosen(np.zeros(len(rows), np.int64))
        result[rows] = _meet(repeated, seen.chosen(rows), self.radius_mm, 0.0)
        return result

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
        whole = self._whole.chosen(line)
        turn = np.arcsin(np.minimum(self.radius_mm / whole.nearest_mm, 1.0))
        length = _angle(whole.directions[:, 0], whole.directions[:, 1])
        return np.minimum(length + whole.off + 2.0 * turn, np.pi)

    def _seen(self, segments: Array, bulge_mm: Array) -> _Seen:
        """Return how segments (m, 2, 3), and what is so far off them, look from the middle of the ball."""
        local = segments - self.centre
        length = np.linalg.norm(local, axis=2)
        directions = local / np.maximum(length, _TINY_MM)[..., None]
        along = local[:, 1] - local[:, 0]
        square = (along**2).sum(axis=1)
        share = np.clip(-(local[:, 0] * along).sum(axis=1) / np.maximum(square, _TINY_MM), 0.0, 1.0)
        reached_mm = np.linalg.norm(local[:, 0] + share[:, None] * along, axis=1)
        nearest_mm = reached_mm - bulge_mm - self.radius_mm
        unknown = nearest_mm < (1.0 - _NEARLY) * reached_mm
        off = np.arcsin(np.minimum(bulge_mm / np.maximum(reached_mm, _TINY_MM), _NEARLY))
        half_mm = np.sqrt(square) / 2.0 + bulge_mm
        return _Seen(
            directions,
            np.where(unknown, 2.0 * np.pi, off),
            local.mean(axis=1),
            half_mm,
            np.maximum(nearest_mm, _TINY_MM),
        )


class _Seen(NamedTuple):
    """Segments (q) as the middle of a ball sees them.

    Attributes
    ----------
    directions : array (q, 2, 3)
        Of their ends.
    off : array (q,)
        How far what belongs to them is off them, rad; 2 π where nothing is known.
    middles : array (q, 3)
        Of the segments, mm.
    half_mm : array (q,)
        How far from these they reach.
    nearest_mm : array (q,)
        From anywhere in the ball, they are no nearer.
    """

    directions: Array
    off: Array
    middles: Array
    half_mm: Array
    nearest_mm: Array

    def around(self, middle: Array) -> tuple[Array, Array, Array]:
        """Return axes (q, 3) and half angles (q,) of cones that hold them, and how far from a point they reach, mm."""
        axes = self.directions.sum(axis=1)
        size = np.linalg.norm(axes, axis=1)
        # half of the angle between two unit vectors
        half = np.arctan2(
            np.linalg.norm(self.directions[:, 1] - self.directions[:, 0], axis=1), size
        )
        far_mm = np.linalg.norm(self.middles - middle, axis=1) + self.half_mm
        return axes / np.maximum(size, _TINY_MM)[:, None], half, far_mm

    def chosen(self, which: Indices) -> _Seen:
        """Return some of them."""
        return _Seen(*(field[which] for field in self))


def _meet(one: _Seen, other: _Seen, radius_mm: float, angle: float) -> Mask:
    """Return which segments (q,) may be seen so near to others (q,) from anywhere in the ball."""
    apart_mm = np.linalg.norm(one.middles - other.middles, axis=1) + one.half_mm + other.half_mm
    change = radius_mm * apart_mm / (one.nearest_mm * other.nearest_mm)
    limit = one.off + other.off + change + (angle + _ROUNDING)
    return np.asarray(_apart(one.directions, other.directions) <= limit)


def _apart(one: Array, other: Array) -> Array:
    """Return how far arcs of great circles are apart, by their ends (q, 2, 3); chords, which are less than angles."""
    nearest = np.full(len(one), np.inf)
    sides = []
    for arc, points in ((one, other), (other, one)):
        first = arc[:, 0]
        last = arc[:, 1]
        normal = _cross(first, last)
        length = np.linalg.norm(normal, axis=1)
        is_arc = length > _SHORTEST
        normal /= np.maximum(length, _TINY_MM)[:, None]
        after = _cross(normal, first)
        before = _cross(last, normal)
        side = []
        for end in range(2):
            point = points[:, end]
            height = (point * normal).sum(axis=1)
            within = is_arc & ((point * after).sum(axis=1) > 0) & ((point * before).sum(axis=1) > 0)
            chord = np.minimum(*(np.linalg.norm(point - arc[:, k], axis=1) for k in range(2)))
            # of what is too short to have a direction
            chord -= np.where(is_arc, 0.0, length)
            nearest = np.minimum(nearest, np.where(within, np.abs(height), chord))
            side.append(height)
        sides.append((side[0] * side[1] <= 0.0) & is_arc)
    in_front = (one.sum(axis=1) * other.sum(axis=1)).sum(axis=1) > 0.0
    return np.where(sides[0] & sides[1] & in_front, 0.0, nearest)


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
        self._normals = np.asarray(solid.normals, np.float64)
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
        self._borders = vertices[border[:, 1:]]
        self._first = np.searchsorted(border[:, 0], np.arange(len(self._normals) + 1))
        # what is beyond a border: the one other face that has this side, -1 where there is not one
        _, side, count = np.unique(border[:, 1:], axis=0, return_inverse=True, return_counts=True)
        side = side.reshape(-1)
        both = np.bincount(side, weights=border[:, 0]).astype(np.int64)
        self._beyond = np.where(count[side] == 2, both[side] - border[:, 0], -1)

    def hide(self, ball: Vicinity, pieces: Array) -> Mask:
        """Return which segments (q, 2, 3) are surely hidden from all of a ball; mm."""
        hits = self._scene.cast(ball.centre, pieces.mean(axis=1) - ball.centre)
        hidden = np.zeros(len(pieces), bool)
        for row in np.flatnonzero(hits["t_hit"] < 1.0 - _SHORT).tolist():
            first = int(self._triangle_face[int(hits["primitive_ids"][row])])
            hidden[row] = self._is_hidden(ball, pieces[row], first)
        return hidden

    def _is_hidden(self, ball: Vicinity, piece: Array, first: int) -> bool:
        """Return whether all faces that rays to a segment (2, 3) may meet, from a first one on, hide it."""
        far_mm = float(np.linalg.norm(self._middle - ball.centre))
        unsure_mm = self._planarity_mm + _SINGLE * (far_mm + 2.0 * self._size_mm)
        waiting = [first]
        met = {first}
        while waiting:
            face = waiting.pop()
            if not self._is_before(ball, piece, face, unsure_mm):
                return False
            sides = slice(self._first[face], self._first[face + 1])
            # a plane that is off moves flat rays more
            off_mm = unsure_mm / _LEAST_SINE
            in_line = ball.in_line(face, self._borders[sides], piece, off_mm)
            beyond = set(self._beyond[sides][in_line].tolist()) - met
            met |= beyond
            if -1 in met or len(met) > _MOST_FACES:
                return False
            waiting += sorted(beyond)
        return True

    def _is_before(self, ball: Vicinity, piece: Array, face: int, unsure_mm: float) -> bool:
        """Return whether a face turns to the whole ball, and a segment is below its plane."""
        normal = self._normals[face]
        height = float((ball.centre - self._places[face]) @ normal)
        depth = (self._places[face] - piece) @ normal
        whole = depth + height
        is_steep = whole >= _LEAST_SINE * np.linalg.norm(piece - ball.centre, axis=1)
        enough = np.maximum(_SHORT * (whole + ball.radius_mm), 2.0 * unsure_mm)
        is_front = height > 2.0 * (ball.radius_mm + unsure_mm)
        return bool(is_front and (is_steep & (depth >= enough)).all())
