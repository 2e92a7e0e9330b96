"""How candidate poses are drawn, judged and simulated."""

from __future__ import annotations

from dataclasses import dataclass


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
