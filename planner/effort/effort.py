"""How long to search for a plan."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from numbers import Real

from planner.argument_kinds import check_count
from planner.effort.bound import BoundEffort, Sweeping
from planner.effort.poses import Centring, Search, check_record
from planner.exceptions import RequestError

# How few columns are chosen.


@dataclass(frozen=True)
class Relaxation:
    """How the program solves the linear relaxation, and which columns it omits.

    Attributes
    ----------
    fixing_bias, fixing_duals : float, int
        Bias and number of the duals that exclude columns. Their mean is nearer to the middle of all
        optimal duals than a single one.
    core_slack : float
        A column stays if its reduced cost is at most this.
    core_of_entity : int
        Of an entity in none of these columns, this many of the heaviest columns stay.
    first_columns, more_columns : int
        Columns in the first linear program, and violated columns added at a time. Few are ever
        needed.
    broken : float
        A smaller violation of a dual constraint is rounding.
    shares : int
        Groups of duals solved in parallel. Each dual starts with the columns of the one before
        in its group, so the result depends on this number and not on the machine.
    """

    fixing_bias: float = 1.05
    fixing_duals: int = 4
    core_slack: float = 0.1
    core_of_entity: int = 5
    first_columns: int = 300
    more_columns: int = 100
    broken: float = 1e-9
    shares: int = 2


@dataclass(frozen=True)
class Covering:
    """How long the program searches for a cover with few columns.

    Attributes
    ----------
    quality_slack : float
        The solver stops when better poses can gain at most this share in the cover.
    exchanges : int
        Steps of the exchange search for a cover of one column less.
    at_once : int
        Sets tried before the next exchange, because each realised set changes the value of the
        others.
    relaxation : Relaxation
        How the linear relaxation is solved.
    """

    quality_slack: float = 0.3
    exchanges: int = 1000
    at_once: int = 4
    relaxation: Relaxation = field(default_factory=Relaxation)


# How candidate poses are drawn, judged and simulated.


@dataclass(frozen=True)
class Pricing:
    """How the program draws and improves candidate poses.

    Numbers count poses unless stated otherwise.

    Attributes
    ----------
    axes_per_viewpoint : int
        Viewing directions for each drawn viewpoint. The first looks at the entity itself.
    parents : int
        A round starts from up to one and a half times this number of poses. A quarter of the number
        is drawn from the pool, and a quarter is the best of the pool by price. Up to half nearly
        inspect a set that would improve the cover. Up to half are the best of the round before.
    children : int
        Number of perturbations of every parent.
    batch : int
        Poses evaluated at a time, in every process, because the last digits depend on it.
    rounds_per_check : int
        Rounds between two checks of the relaxation.
    checks : int
        The search ends after this many checks with too little gain.
    least_gain : float
        Least sufficient gain, as a share of the relaxation's value.
    exchanges : int
        Steps of the exchange search for a cover that would end the search.
    whole : int
        At first, this many times as many directions look at the whole part as at an entity.
    promising : float
        The search improves a pose for an entity only if it nearly inspects it to this degree (1:
        inspected).
    uncovered : float
        Price of an entity without a column. It exceeds the weight of a column, because a column of
        its own is worth a setting.
    """

    axes_per_viewpoint: int = 6
    parents: int = 64
    children: int = 24
    batch: int = 768
    rounds_per_check: int = 10
    checks: int = 5
    least_gain: float = 2e-3
    exchanges: int = 300
    whole: int = 16
    promising: float = 0.3
    uncovered: float = 2.0


@dataclass(frozen=True)
class Nearness:
    """Tolerances of the margins within which a pose nearly inspects an entity.

    Attributes
    ----------
    field : float
        Tolerance of the field of view, as a share of the sensor's larger side.
    length : float
        Tolerance of the image's length, as a share of the smallest permitted length.
    focus : float
        Tolerance of the depth, as a share of the depth of field. That counts up to nine times its
        near limit, because it may be infinite.
    separation : float
        Tolerance of the separation, as a share of the required one.
    corner_deg : float
        Tolerance of the angle of corners, degrees.
    probability : float
        Tolerance of the probability.
    hopeless : float
        Skip an entity that misses a constraint by this many tolerances. The program then does not
        compute its visibility, which costs most.
    displaced : int
        Before a column is kept, its pose is displaced this many times. A target stays in it if
        enough of these images show it. 0: the column is kept as judged.
    first : int
        Check corners first for this many entities of a pose, those of the highest price. Most of
        them have none.
    batch : int
        Poses evaluated at a time. It limits the memory.
    """

    field: float = 0.06
    length: float = 0.1
    focus: float = 0.1
    separation: float = 0.5
    corner_deg: float = 5.0
    probability: float = 0.05
    hopeless: float = 6.0
    displaced: int = 24
    first: int = 2
    batch: int = 2048


@dataclass(frozen=True)
class Support:
    """When simulation confirms a pose, and how long to search for another one otherwise.

    Attributes
    ----------
    trial_poses : int
        Displaced poses simulated to check a pose.
    neighbours : int
        Poses drawn near a contradicted one.
    batch : int
        Neighbours evaluated at a time. Often simulation confirms one of the first.
    most_trials : int
        Largest number of simulated neighbours that inspect the same entities.
    all_trials : int
        The same for all settings of a plan together. They share it equally.
    too_high : float
        Simulation contradicts a probability that is too high by more than this, as for the whole
        plan.
    sure_poses : int
        Displaced poses simulated if the first ones contradict a probability. The standard error of
        the frequency is then at most 0.0025.
    joint_poses : int
        Displaced poses at first in which everything must hold, see `planner.verify.p_all`.
    joint_sure_poses : int
        The same where the first ones do not decide, and at most for what a plan states.
    joint_all_poses : int
        For what a plan states: displaced poses times targets, in all of its settings together.
    retried : int
        For a target that lacks the required P_all in the final settings: poses of other columns
        that are simulated for it.
    """

    trial_poses: int = 4000
    neighbours: int = 2000
    batch: int = 250
    most_trials: int = 100
    all_trials: int = 1000
    too_high: float = 0.005
    sure_poses: int = 40_000
    joint_poses: int = 1000
    joint_sure_poses: int = 20_000
    joint_all_poses: int = 400_000
    retried: int = 8

    def trials_of(self, settings: int) -> int:
        """Return how many neighbours each of so many settings may simulate, one at least.

        Parameters
        ----------
        settings : int
            Settings that share the trials.

        Returns
        -------
        int
            All that there may be, for few settings.
        """
        return min(self.most_trials, max(self.all_trials // max(settings, 1), 1))


# How long the stages of a plan search.


@dataclass(frozen=True)
class Preference:
    """When the program uses a candidate pose, and when that of the genetic algorithm.

    Attributes
    ----------
    fitness_gain : float
        Least gain in the sum of the probabilities. A smaller gain is rounding.
    enough : float
        The genetic algorithm does not search for a better pose where the candidate pose has more
        than this probability for each of its targets, and simulation confirms it. At 1, it always
        searches.
    """

    fitness_gain: float = 1e-6
    enough: float = 1.0


@dataclass(frozen=True)
class Joining:
    """How long the program improves columns from poses that the proof found.

    Attributes
    ----------
    rounds : int
        Smallest number of rounds of column generation.
    most_rounds : int
        Largest number of rounds, for few columns.
    columns : int
        Rounds times columns is about this, because a round over many columns takes longer.
    """

    rounds: int = 5
    most_rounds: int = 25
    columns: int = 20_000

    def rounds_for(self, n_columns: int) -> int:
        """Return the number of rounds for a pool of this many columns."""
        return min(max(self.rounds, self.columns // max(1, n_columns)), self.most_rounds)


@dataclass(frozen=True)
class Improving:
    """How often the program searches for a better plan, and how it finds the first ones.

    Attributes
    ----------
    rounds : int
        Rounds of column generation between two searches.
    directions : tuple of int
        Number of viewing directions per entity, for each of the first plans.
    """

    rounds: int = 5
    directions: tuple[int, ...] = (4, 32)


@dataclass(frozen=True)
class Trying:
    """How long the program searches for a cover that simulation confirms.

    Attributes
    ----------
    exchanges : int
        Steps of the exchange search for a cover of one column less.
    covers : int
        Largest number of covers that are simulated. Each omits the edges contradicted before.
    in_vain : int
        Drop an edge that simulation contradicts from this many candidate poses and confirms from
        none.
    """

    exchanges: int = 1000
    covers: int = 20
    in_vain: int = 4


@dataclass(frozen=True)
class CoverShares:
    """Shares of `Effort.cover_nodes` for covers on the way to the last one.

    Attributes
    ----------
    refuting : float
        Share for each cover while the program tries optimistic columns. There are many, and a cover
        that is not the best costs no more than a run of the genetic algorithm.
    """

    refuting: float = 0.1


@dataclass(frozen=True)
class Looking:
    """How long the program searches for a pose from which a lamp lights an entity.

    Attributes
    ----------
    viewpoints : int
        Viewpoints drawn for each unlit entity, in addition to the poses of the pool.
    around : int
        Poses tried around each planned pose of the entity, which may keep the other targets of the
        setting.
    tried : int
        Poses of each entity whose light is computed.
    kept : int
        Of the poses where the entity is lit, keep this many as candidates: those that inspect most
        entities with the highest probability.
    places : int
        Lamp positions tried in addition to the chosen ones, for lamps without fixed positions.
    """

    viewpoints: int = 60
    around: int = 400
    tried: int = 48
    kept: int = 8
    places: int = 1000


@dataclass(frozen=True)
class StageEffort:
    """How long the stages of a plan search.

    Attributes
    ----------
    improving : Improving
        How often the program searches for a better plan.
    trying : Trying
        How long the program searches for a cover that simulation confirms.
    joining : Joining
        How long the program improves columns from poses of the proof.
    shares : CoverShares
        Shares of the nodes for covers on the way.
    preference : Preference
        When the program prefers a candidate pose.
    looking : Looking
        How long the program searches for poses with light.
    """

    improving: Improving = field(default_factory=Improving)
    trying: Trying = field(default_factory=Trying)
    joining: Joining = field(default_factory=Joining)
    shares: CoverShares = field(default_factory=CoverShares)
    preference: Preference = field(default_factory=Preference)
    looking: Looking = field(default_factory=Looking)


@dataclass(frozen=True)
class Effort:
    """How long to search for a plan and its proof. The defaults suit a hundred entities.

    `named` returns shorter and longer presets.

    Parameters
    ----------
    viewpoints : int
        Number of viewpoints drawn for each entity.
    pricing_rounds : int
        Largest number of rounds of column generation.
    refutations : int
        Largest number of optimistic columns that the genetic algorithm tries to realise.
    bound_nodes : int
        Largest number of boxes of poses for the proof of the lower bound. See `boxes_for`.
    cover_nodes : int
        Largest number of nodes of the integer programming solver for one cover. It is a tenth while
        the program tries optimistic columns.
    witnesses : int
        Largest number of sets of entities that the program considers for one dimension. A model may
        offer more. With 1, it takes the first, of whole entities.

    pricing : Pricing
        How the program draws and improves candidate poses. The default of this and the following
        seldom needs a change.
    nearness : Nearness
        When a pose nearly inspects an entity.
    support : Support
        When simulation supports a pose.
    search : Search
        How the program searches for the pose of one column.
    centring : Centring
        How the program moves a planned pose off its limits.
    cover : Covering
        How the program chooses few columns.
    bound : BoundEffort
        How the program proves the lower bound.
    stages : StageEffort
        How long the stages of a plan search.

    Raises
    ------
    RequestError
        If a number has the wrong type or is negative, or the viewpoints or nodes of the solver are
        zero.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from planner import Effort
    >>> effort = Effort(viewpoints=10)
    >>> effort.viewpoints, effort.pricing.parents
    (10, 64)
    >>> replace(effort, pricing=replace(effort.pricing, parents=32)).pricing.parents
    32
    """

    viewpoints: int = 50
    pricing_rounds: int = 50
    refutations: int = 30
    bound_nodes: int = 8_000_000
    cover_nodes: int = 1000
    witnesses: int = 6
    pricing: Pricing = field(default_factory=Pricing)
    nearness: Nearness = field(default_factory=Nearness)
    support: Support = field(default_factory=Support)
    search: Search = field(default_factory=Search)
    centring: Centring = field(default_factory=Centring)
    cover: Covering = field(default_factory=Covering)
    bound: BoundEffort = field(default_factory=BoundEffort)
    stages: StageEffort = field(default_factory=StageEffort)

    @classmethod
    def named(cls, name: str) -> Effort:
        """Return a preset.

        Parameters
        ----------
        name : {"quick", "standard", "thorough"}
            "standard" is the default. "quick" ends after a short search and a short proof, and
            improves a pose only where simulation contradicts it. "thorough" searches four times as
            long and gives the proof five times as many boxes.

        Raises
        ------
        RequestError
            If there is no preset with this name.
        """
        if name not in _PRESETS:
            rule = f"must be one of {', '.join(_PRESETS)}"
            raise RequestError.of_rule("effort", rule, repr(name))
        return _PRESETS[name]

    @classmethod
    def for_dimensions(cls) -> Effort:
        """Return the default for dimensions: fewer boxes for the proof of the bound.

        The necessary conditions of a dimension exclude fewer poses than those of an edge. On the
        demo part, five times as many boxes raise the bound by one.
        """
        return cls(bound_nodes=1_500_000)

    def giving_up(self, give_up: float) -> Effort:
        """Return the same effort with another cost of the margin step.

        Parameters
        ----------
        give_up : float
            The step lowers no probability by more than this, in [0, 1). 0: there is no step.

        Returns
        -------
        Effort
            A new one.

        Raises
        ------
        RequestError
            If it breaks its rule.

        Examples
        --------
        >>> from planner import Effort
        >>> Effort().giving_up(0.01).centring.give_up
        0.01
        """
        if isinstance(give_up, bool) or not isinstance(give_up, Real) or not 0 <= give_up < 1:
            raise RequestError.of_rule("give_up", "must be in [0, 1)", repr(give_up))
        return replace(self, centring=replace(self.centring, give_up=float(give_up)))

    def boxes_for(self, n_targets: int) -> int:
        """Return the largest number of boxes of poses for the proof of so many targets.

        Parameters
        ----------
        n_targets : int
            Number of targets.

        Returns
        -------
        int
            `bound_nodes`, or fewer for more targets than `Sweeping.targets`.

        Examples
        --------
        >>> from planner import Effort
        >>> quick = Effort.named("quick")
        >>> quick.boxes_for(16), quick.boxes_for(64)
        (400000, 100000)
        """
        most = self.bound.sweeping.targets
        return self.bound_nodes * most // max(n_targets, most)

    def __post_init__(self) -> None:
        for name in ("pricing_rounds", "refutations", "bound_nodes"):
            check_count(name, getattr(self, name), 0)
        for name in ("viewpoints", "cover_nodes", "witnesses"):
            check_count(name, getattr(self, name), 1)
        for name in ("pricing", "nearness", "support", "centring", "cover", "bound", "stages"):
            check_record(name, getattr(self, name))


# what is searched with where nothing is said
NORMAL = Effort()
QUICK = Effort(
    pricing_rounds=20,
    refutations=4,
    bound_nodes=400_000,
    bound=BoundEffort(sweeping=Sweeping(targets=16)),
    stages=StageEffort(preference=Preference(enough=0.0)),
    cover_nodes=200,
    witnesses=3,
    search=Search(max_draws=2048),
    centring=Centring().shorter(),
)
THOROUGH = Effort(
    viewpoints=200,
    pricing_rounds=200,
    refutations=120,
    bound_nodes=40_000_000,
    cover_nodes=4000,
    witnesses=12,
)
_PRESETS = {"quick": QUICK, "standard": NORMAL, "thorough": THOROUGH}
