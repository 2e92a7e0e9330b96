"""How a lower bound is proven: how many boxes of poses, which weights, which number of settings."""

from __future__ import annotations

from dataclasses import dataclass, field

from planner.effort.boxes import BoxEffort, Subdivision
from planner.effort.checks import check_record, with_floats


@dataclass(frozen=True)
class Sweeping:
    """How many boxes of poses the parts of the space get; what is not decided gets more.

    Attributes
    ----------
    first : int
        Boxes looked at in a part, at first.
    more : int
        So many times more where that does not decide.
    hard : int
        After so many times as many as at first, the weights had better keep away, if there are others.
    again : float
        Times the boxes that a proof needed before, for other weights.
    least_sweeps : int
        So many sweeps of all parts must be possible.
    found : int
        Too heavy poses taken from one part at a time, at most.
    """

    first: int = 8000
    more: int = 4
    hard: int = 16
    again: float = 1.5
    least_sweeps: int = 8
    found: int = 8


@dataclass(frozen=True)
class Aiming:
    """Which number of settings is aimed at, and when it is given up for a smaller one.

    Attributes
    ----------
    share_at_first : float
        Of the boxes left, those for a number below which others are still to be proven.
    share_of_next : float
        Once one is proven, of all boxes those that may have been looked at when the next one is given up.
    least_limit : float
        No number is aimed at first that needs weights to be closer to the limit.
    least_limit_of_next : float
        Nor after one is proven.
    near_one : float
        A number is given up once poses found bring the limit this near to 1.
    near_setting : float
        Or one setting this near to a whole one.
    """

    share_at_first: float = 0.65
    share_of_next: float = 0.6
    least_limit: float = 1.15
    least_limit_of_next: float = 1.06
    near_one: float = 0.02
    near_setting: float = 0.3


@dataclass(frozen=True)
class Weighing:
    """How the weights are made, and how near to them the limit lies.

    Attributes
    ----------
    duals : int
        Optimal duals of the cover of which the weights are the mean: a single one rests on few entities.
    bias : float
        They are found by maximising the weights times factors from 1 to this.
    least : float
        Smaller weights are made 0: they would only lengthen the search.
    spare : float
        No pose may weigh more than this share less than would do, so that a few that do need no new weights.
    spare_of_room : float
        But that is at most this share of what the limit is above 1.
    less : float
        Weights keep away from the limit by this factor where poses were found to exceed it.
    """

    duals: int = 16
    bias: float = 1.5
    least: float = 1e-3
    spare: float = 0.01
    spare_of_room: float = 0.25
    less: float = 0.999


@dataclass(frozen=True)
class TreeGrowth:
    """How far the tree of poses is grown, and how hard integer covers by its leaves are tried.

    Attributes
    ----------
    nodes : int
        Nodes that have boxes of positions, at most: what pairs that exclude each other decide is soon proven.
    finest_rad : float
        Nodes smaller than this angle, seen from the camera, are not split further.
    batch : int
        Nodes split at a time, at most, before it is asked again whether they suffice.
    columns : int
        Sets that an integer cover is asked for, at most; if there are more, it proves nothing.
    cover_nodes : int
        Nodes of the branch and bound of one integer cover.
    cover_rounds : int
        For each number of settings, one integer cover in each of so many rounds.
    rounds_per_cover : int
        Then one in every so many.
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
    """How the dual of the fractional cover over all leaves is found, by constraint generation.

    Attributes
    ----------
    rounds : int
        Linear programs, at most; what is wrong then is divided away.
    tolerance : float
        A leaf may weigh this much more than 1.
    violated : int
        Leaves looked at in a round, those that weigh most.
    added : int
        Constraints added in a round.
    kept : float
        Only constraints of leaves that weigh more than this are kept for the next time.
    """

    rounds: int = 60
    tolerance: float = 1e-7
    violated: int = 2000
    added: int = 150
    kept: float = 0.5


@dataclass(frozen=True)
class Division:
    """How the space of poses is divided among searches.

    Attributes
    ----------
    parts : int
        Parts searched one by one, some at a time: enough that what is proven of one outlives the weights of others.
    tick_s : float
        How often a search of parts looks up to be cancelled.
    less : float
        What a pose found inspects counts this share of the limit in its part from then on, so that the next one
        inspects something else.
    """

    parts: int = 256
    tick_s: float = 0.5
    less: float = 0.999


@dataclass(frozen=True)
class BoundEffort:
    """How a lower bound is proven. None of it can make a bound wrong.

    Attributes
    ----------
    sweeping : Sweeping
        Boxes of poses that each part of the space gets.
    aiming : Aiming
        Which number of settings is aimed at.
    weighing : Weighing
        How the weights of entities are made.
    covering : TreeGrowth
        How far the tree of poses is grown.
    generation : DualRounds
        How the weights of its leaves are found.
    division : Division
        How the space of poses is divided.
    subdivision : Subdivision
        How far pairs that exclude each other are looked for.
    boxes : BoxEffort
        How closely boxes of poses are looked at.
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
