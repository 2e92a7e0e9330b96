"""How a lower bound is proven: how many boxes of poses, which weights, which number of settings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from planner.effort.poses import check_record, with_floats

# How closely the program checks boxes of poses. Compiled loops take these records, so they are
# named tuples.


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


@dataclass(frozen=True)
class Sweeping:
    """How many boxes of poses the parts of the space get. Undecided parts get more.

    Attributes
    ----------
    first : int
        Boxes checked in a part at first.
    more : int
        Factor of more boxes for an undecided part.
    hard : int
        After this multiple of the first boxes, the program prefers other weights, if there are any.
    again : float
        Multiple of the boxes of an earlier proof, for other weights.
    least_sweeps : int
        Smallest number of sweeps of all parts that must be possible.
    found : int
        Largest number of poses beyond the limit taken from one part at a time.
    targets : int
        Largest number of targets for which the proof may use all boxes. With more targets, each box
        takes longer, and the number of boxes falls in proportion.
    """

    first: int = 8000
    more: int = 4
    hard: int = 16
    again: float = 1.5
    least_sweeps: int = 8
    found: int = 8
    targets: int = 500


@dataclass(frozen=True)
class Aiming:
    """Which number of settings the proof attempts, and when it changes to a smaller one.

    Attributes
    ----------
    share_at_first : float
        Share of the remaining boxes for a number, if smaller numbers are not yet proven.
    share_of_next : float
        Once a number is proven, share of all boxes after which the proof stops the next one.
    least_limit : float
        The first number needs no pose limit smaller than this. The limit is the largest permitted
        weight of a pose. The heaviest known column weighs 1.
    least_limit_of_next : float
        The proof stops later numbers when their limit is no larger than this.
    near_one : float
        The proof stops the first number when its limit exceeds 1 by no more than this, and
        `near_setting` holds as well.
    near_setting : float
        The limit times the next smaller number of settings exceeds that number by no more than
        this.
    """

    share_at_first: float = 0.65
    share_of_next: float = 0.6
    least_limit: float = 1.15
    least_limit_of_next: float = 1.06
    near_one: float = 0.02
    near_setting: float = 0.3


@dataclass(frozen=True)
class Weighing:
    """How the program makes the weights, and how close to them the limit lies.

    Attributes
    ----------
    duals : int
        Number of optimal duals of the cover. The weights are their mean, because a single one
        depends on few entities.
    bias : float
        Largest factor of the weights in the search for duals. The smallest is 1.
    least : float
        Smaller weights become 0, because they would only lengthen the search.
    spare : float
        Safety margin below the largest permitted weight of a pose, as a share. With it, a few
        heavier poses need no new weights.
    spare_of_room : float
        Upper limit of this margin, as a share of the limit's excess over 1.
    less : float
        Factor by which weights stay below the limit where poses exceeded it.
    """

    duals: int = 16
    bias: float = 1.5
    least: float = 1e-3
    spare: float = 0.01
    spare_of_room: float = 0.25
    less: float = 0.999


@dataclass(frozen=True)
class TreeGrowth:
    """How large the tree of poses grows, and how long to search for integer covers by its leaves.

    Attributes
    ----------
    nodes : int
        Largest number of nodes with boxes of positions. Proofs from pairs that exclude each other
        need few.
    finest_rad : float
        The tree does not split nodes smaller than this angle, seen from the camera.
    batch : int
        Largest number of nodes split between two checks of whether they suffice.
    columns : int
        Largest number of sets of an integer cover. With more, it proves nothing.
    cover_nodes : int
        Largest number of branch-and-bound nodes of one integer cover.
    cover_rounds : int
        For each number of settings, each of this many first rounds has an integer cover.
    rounds_per_cover : int
        After that, one round in this many has one.
    """

    nodes: int = 32_000
    finest_rad: float = 2e-3
    batch: int = 6000
    columns: int = 4000
    cover_nodes: int = 2000
    cover_rounds: int = 20
    rounds_per_cover: int = 10


@dataclass(frozen=True)
class DualRounds:
    """How constraint generation finds the dual of the fractional cover over all leaves.

    Attributes
    ----------
    rounds : int
        Largest number of linear programs. Then all weights are divided by that of the heaviest
        leaf.
    tolerance : float
        A leaf may weigh this much more than 1.
    violated : int
        Leaves checked in a round, those that weigh most.
    added : int
        Constraints added in a round.
    kept : float
        Keep only constraints of leaves that weigh more than this for the next time.
    """

    rounds: int = 60
    tolerance: float = 1e-7
    violated: int = 2000
    added: int = 150
    kept: float = 0.5


@dataclass(frozen=True)
class Division:
    """How the program divides the space of poses among searches.

    Attributes
    ----------
    parts : int
        Number of parts, each searched on its own, several at a time. With enough parts, proofs of
        one part outlast changes of the weights for others.
    tick_s : float
        Seconds between two checks for cancellation during a search.
    less : float
        Entities of a pose found then count this share of the limit in its part, so that the next
        pose inspects others.
    """

    parts: int = 256
    tick_s: float = 0.5
    less: float = 0.999


@dataclass(frozen=True)
class BoundEffort:
    """How the program proves a lower bound. No value can make a bound wrong.

    Attributes
    ----------
    sweeping : Sweeping
        Number of boxes of poses for each part of the space.
    aiming : Aiming
        Which number of settings the proof attempts.
    weighing : Weighing
        How the program makes the weights of entities.
    covering : TreeGrowth
        How large the tree of poses grows.
    generation : DualRounds
        How the program finds the weights of its leaves.
    division : Division
        How the program divides the space of poses.
    subdivision : Subdivision
        How long the program searches for pairs that exclude each other.
    boxes : BoxEffort
        How closely the program checks boxes of poses.
    """

    sweeping: Sweeping = field(default_factory=Sweeping)
    aiming: Aiming = field(default_factory=Aiming)
    weighing: Weighing = field(default_factory=Weighing)
    covering: TreeGrowth = field(default_factory=TreeGrowth)
    generation: DualRounds = field(default_factory=DualRounds)
    division: Division = field(default_factory=Division)
    subdivision: Subdivision = field(default_factory=Subdivision)
    boxes: BoxEffort = field(default_factory=BoxEffort)

    def __post_init__(self) -> None:
        for name in ("subdivision", "boxes"):
            check_record(f"bound.{name}", getattr(self, name))
            object.__setattr__(self, name, with_floats(getattr(self, name)))
