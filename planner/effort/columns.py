"""How candidate poses are drawn, judged and simulated."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Pricing:
    """How candidate poses are drawn and improved; numbers of poses unless said otherwise.

    Attributes
    ----------
    axes_per_viewpoint : int
        Directions of view for every viewpoint drawn; the first looks at the entity itself.
    parents : int
        Poses a round breeds from, about: a quarter are drawn from the pool, a quarter are its best by price, half
        nearly inspect more than they do.
    children : int
        Perturbations of every parent.
    batch : int
        Poses judged at a time, whoever judges them, as the last digits depend on it.
    rounds_per_check : int
        The relaxation is looked at every so many rounds.
    checks : int
        The search ends if so many looks gain too little.
    least_gain : float
        That is too little, as a share of the relaxation's value.
    exchanges : int
        Steps of the search for a cover that would end it.
    whole : int
        At the first glance, the whole part is looked at from so many times as many directions as an entity.
    promising : float
        A pose is bred for an entity only if it promises so much of it (1 is inspected).
    uncovered : float
        Price of an entity that no column has yet: more than a column may weigh, because a column of its own is worth a
        setting.
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
    """How far a margin may miss for an entity still to count as nearly inspected: its tolerance.

    Attributes
    ----------
    field : float
        Of the field of view, as a share of the sensor's larger side.
    length : float
        Of the image's length, as a share of the smallest allowed.
    focus : float
        Of the depth, as a share of the depth of field (of at most nine times its near limit, as it may be infinite).
    separation : float
        Of the separation, as a share of what is asked for.
    corner_deg : float
        Of the angle of corners.
    probability : float
        Of the probability.
    hopeless : float
        Missing a constraint by so many tolerances, an entity is not looked at further: visibility, which costs most,
        is not asked for.
    first : int
        Of so many entities of a pose, those worth most, it is asked first whether they have corners, which most lack.
    batch : int
        Poses judged at a time; bounds the memory.
    """

    field: float = 0.06
    length: float = 0.1
    focus: float = 0.1
    separation: float = 0.5
    corner_deg: float = 5.0
    probability: float = 0.05
    hopeless: float = 6.0
    first: int = 2
    batch: int = 2048


@dataclass(frozen=True)
class Support:
    """When simulation supports a pose, and how hard another is looked for if it does not.

    Attributes
    ----------
    trial_poses : int
        Displaced poses simulated to tell whether a pose is contradicted.
    neighbours : int
        Poses drawn near one that is.
    batch : int
        Of these, so many are judged at a time: often one of the first is supported.
    most_trials : int
        Of those that inspect the same, so many are simulated at most.
    too_high : float
        A promise that is too high by more than this is contradicted, as in the simulation of the whole plan.
    sure_poses : int
        Displaced poses simulated where the first ones contradict a promise: frequencies are known to a standard
        error of 0.0025 or less then.
    """

    trial_poses: int = 4000
    neighbours: int = 2000
    batch: int = 250
    most_trials: int = 100
    too_high: float = 0.005
    sure_poses: int = 40_000
