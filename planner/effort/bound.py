"""How a lower bound is proven: how many boxes of poses, which weights, which number of settings."""

from __future__ import annotations

from dataclasses import dataclass, field

from planner.effort.boxes import BoxEffort, Subdivision
from planner.effort.checks import check_record, with_floats


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
