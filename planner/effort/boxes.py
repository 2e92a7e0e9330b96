"""How closely boxes of poses are looked at. Compiled loops take these records, so they are named tuples."""

from __future__ import annotations

from typing import NamedTuple


class Subdivision(NamedTuple):
    """How far space is subdivided in search of a viewpoint that serves a pair.

    Attributes
    ----------
    finest_mm : float
        Smaller half sizes are not halved: the pair then counts as served.
    boxes : int
        Boxes looked at, at most, for two cells; after that the pair counts as served.
    waiting : int
        Boxes that wait, at most: one for each halving.
    """

    finest_mm: float = 0.5
    boxes: int = 200_000
    waiting: int = 256


class Halving(NamedTuple):
    """Along which coordinate boxes of poses are halved, and how far. None of it can make an answer wrong.

    Attributes
    ----------
    look_share : float
        Boxes of points looked at are first made as small as this share of half the view's width: before, hardly any
        window is cut.
    length_score : float
        How much the length of s counts in the choice of the coordinate, beside the width of windows.
    doubt_score : float
        How much doubtful visibility counts.
    most_short : float
        The most that one image of doubtful length counts, as a multiple of half the depth of field.
    finest : float
        Boxes whose coordinates all do less than this, as a share of the weight, are not halved.
    wide_turn : float
        Unless the turn, in its own coordinates, is wider than this.
    most_seen : float
        Up to this share of nodal points from where enough is visible, their box is halved itself: it then tells much.
    near_sides : float
        Nor need they be so few in a box that is no wider than so many radii of visibility: it is near sides of cells.
    eye_share : float
        But not below this share of what points looked at and turn leave open: they must follow.
    """

    look_share: float = 0.5
    length_score: float = 0.3
    doubt_score: float = 1.0
    most_short: float = 4.0
    finest: float = 1e-4
    wide_turn: float = 1e-2
    most_seen: float = 0.3
    near_sides: float = 8.0
    eye_share: float = 0.2


class Asking(NamedTuple):
    """When the costlier questions are asked of a box. None of it can make an answer wrong.

    Attributes
    ----------
    much_seen : float
        Where enough is visible from more than this share of the nodal points, it is not asked again for a while: little
        would be learnt.
    pause : int
        For so many halvings.
    thin : float
        Where the depth in focus is less than this share of the view's width, the turn is what loses: there windows are
        made linear in it.
    parts_per_box : int
        So many parts of a box of small turns cost as much as a box, and count as one.
    """

    much_seen: float = 0.6
    pause: int = 3
    thin: float = 0.15
    parts_per_box: int = 25


class SmallTurns(NamedTuple):
    """When turns are small, and how boxes of small turns are halved.

    Attributes
    ----------
    turn : float
        Tangent of half the angle up to which a turn is small: its square, which windows linear in it leave out, is then
        a hundredth.
    parts : int
        Parts of a box looked at, at most, before the box itself is halved.
    turn_share : float
        The turn is halved where what it leaves open of the nodal point at second order is more than this share of the
        nodal points' box: the nodal points decide the rest.
    least_turn : float
        Boxes of turns, in their own coordinates, no wider than this are not halved: no camera is aimed so
        finely.
    least_mm : float
        Nor are such boxes of nodal points, mm.
    """

    turn: float = 0.1
    parts: int = 64
    turn_share: float = 0.25
    least_turn: float = 2e-3
    least_mm: float = 0.05


class Growth(NamedTuple):
    """How far a tree is grown, and how closely it is asked.

    Attributes
    ----------
    depth : int
        Boxes that wait, at most: one for each halving.
    enough : int
        A tree is grown anew with boxes half as large until it has so many.
    most : int
        Boxes, at most; bounds the memory.
    coarse : float
        Boxes that are not halved are this wide at first, as a share of the whole.
    fine : float
        And no narrower than this.
    effort : int
        Boxes of the tree that one question may halve: what it gains must not take longer than the search.
    """

    depth: int = 64
    enough: int = 25_000
    most: int = 400_000
    coarse: float = 2.0**-4
    fine: float = 2.0**-10
    effort: int = 1024


class Shrinking(NamedTuple):
    """How parts of a box are looked at.

    Attributes
    ----------
    levels : int
        Parts that wait, at most: one for each halving.
    much : float
        A part is looked at again where shrinking left less than this share of a coordinate: less would not pay.
    """

    levels: int = 64
    much: float = 0.8


class Meeting(NamedTuple):
    """How closely it is asked whether windows meet.

    Attributes
    ----------
    deepest : int
        Halvings of the room, at most: ten along each axis leave a thousandth of its width.
    doubtful : int
        So many parts of that size are passed over in search of one where windows do meet, before the answer is yes.
    """

    deepest: int = 30
    doubtful: int = 8


class BoxEffort(NamedTuple):
    """How closely boxes of poses are looked at.

    Attributes
    ----------
    halving : Halving
        Along which coordinate boxes are halved.
    asking : Asking
        When costlier questions are asked.
    small_turns : SmallTurns
        When turns are small.
    growth : Growth
        How far the tree of viewpoints is grown.
    shrinking : Shrinking
        How parts of boxes of small turns are looked at.
    meeting : Meeting
        How closely it is asked whether windows meet.
    """

    halving: Halving = Halving()
    asking: Asking = Asking()
    small_turns: SmallTurns = SmallTurns()
    growth: Growth = Growth()
    shrinking: Shrinking = Shrinking()
    meeting: Meeting = Meeting()
