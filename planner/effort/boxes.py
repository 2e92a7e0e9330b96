"""How closely the program checks boxes of poses. Compiled loops take these records, so they are named tuples."""

from __future__ import annotations

from typing import NamedTuple


class Subdivision(NamedTuple):
    """How far to subdivide space in the search for a viewpoint that serves a pair.

    Attributes
    ----------
    finest_mm : float
        Boxes with a smaller half size are not halved. The pair then counts as served.
    boxes : int
        Largest number of boxes for two cells. After that the pair counts as served.
    waiting : int
        Largest number of waiting boxes: one for each halving.
    """

    finest_mm: float = 0.5
    boxes: int = 200_000
    waiting: int = 256


class Halving(NamedTuple):
    """Along which coordinate to halve boxes of poses, and how far.

    No value can make an answer wrong.

    Attributes
    ----------
    look_share : float
        Boxes of look points first shrink to this share of half the view's width. Larger ones cut
        hardly any window.
    length_score : float
        Weight of the length of s in the choice of the coordinate, relative to the width of windows.
    doubt_score : float
        Weight of doubtful visibility in the choice of the coordinate.
    most_short : float
        Largest weight of one image of doubtful length, as a multiple of half the depth of field.
    finest : float
        Boxes are not halved if all coordinates contribute less than this share of the weight.
    wide_turn : float
        They are halved anyway if the turn, in its own coordinates, is wider than this.
    most_seen : float
        Halve the box of nodal points itself, if at most this share of them sees enough. The halving
        then decides much.
    near_sides : float
        The same without this condition for a box at most this many radii of visibility wide,
        because it is near the boundary of cells.
    eye_share : float
        But do not halve it below this share of the uncertainty from look points and turn, which
        must follow.
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
    """When the program makes the expensive checks of a box. No value can make an answer wrong.

    Attributes
    ----------
    much_seen : float
        If more than this share of the nodal points sees enough, pause the check, because it would
        gain little.
    pause : int
        Number of halvings of this pause.
    thin : float
        If the depth in focus is less than this share of the view's width, windows are linear in the
        turn. The turn then causes most of the loss.
    parts_per_box : int
        This many parts of a box of small turns cost as much as a box and count as one.
    """

    much_seen: float = 0.6
    pause: int = 3
    thin: float = 0.15
    parts_per_box: int = 25


class SmallTurns(NamedTuple):
    """When turns are small, and how to halve boxes of small turns.

    Attributes
    ----------
    turn : float
        Tangent of half the largest angle of a small turn. Windows that are linear in it omit its
        square, a hundredth.
    parts : int
        Largest number of parts of a box to check before the box itself is halved.
    turn_share : float
        Halve the turn if its second-order uncertainty of the nodal point exceeds this share of the
        nodal points' box. Otherwise halve the nodal points.
    least_turn : float
        Boxes of turns, in their own coordinates, at most this wide are not halved. No camera is
        aimed more finely.
    least_mm : float
        The same for boxes of nodal points, mm.
    """

    turn: float = 0.1
    parts: int = 64
    turn_share: float = 0.25
    least_turn: float = 2e-3
    least_mm: float = 0.05


class Growth(NamedTuple):
    """How large a tree grows, and how finely to query it.

    Attributes
    ----------
    depth : int
        Largest number of waiting boxes: one for each halving.
    enough : int
        Grow the tree again with boxes half as large until it has this many.
    most : int
        Largest number of boxes. It limits the memory.
    coarse : float
        Width of the smallest boxes at first, as a share of the whole.
    fine : float
        Smallest width of these boxes later, as a share of the whole.
    effort : int
        Largest number of boxes that one query may halve. Its gain must not take longer than the
        search.
    """

    depth: int = 64
    enough: int = 25_000
    most: int = 400_000
    coarse: float = 2.0**-4
    fine: float = 2.0**-10
    effort: int = 1024


class Shrinking(NamedTuple):
    """How the program checks parts of a box.

    Attributes
    ----------
    levels : int
        Largest number of waiting parts: one for each halving.
    much : float
        Check a part again if shrinking left less than this share of a coordinate. A smaller
        reduction is not worth it.
    """

    levels: int = 64
    much: float = 0.8


class Meeting(NamedTuple):
    """How finely the program checks whether windows meet.

    Attributes
    ----------
    deepest : int
        Largest number of halvings of the range. Ten along each axis leave a thousandth of its
        width.
    doubtful : int
        Number of undecided parts of that size that the search skips before the answer is yes.
    """

    deepest: int = 30
    doubtful: int = 8


class BoxEffort(NamedTuple):
    """How closely the program checks boxes of poses.

    Attributes
    ----------
    halving : Halving
        Along which coordinate to halve boxes.
    asking : Asking
        When to make expensive checks.
    small_turns : SmallTurns
        When turns are small.
    growth : Growth
        How large the tree of viewpoints grows.
    shrinking : Shrinking
        How to check parts of boxes of small turns.
    meeting : Meeting
        How finely the program checks whether windows meet.
    """

    halving: Halving = Halving()
    asking: Asking = Asking()
    small_turns: SmallTurns = SmallTurns()
    growth: Growth = Growth()
    shrinking: Shrinking = Shrinking()
    meeting: Meeting = Meeting()
