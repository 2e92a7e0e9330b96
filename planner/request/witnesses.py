"""Which witness of a target a pose shows best, and why the others are not used."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.formatting import probability_text
from planner.camera.camera import Camera
from planner.request.constraints import Constraints
from planner.request.necessary import widest_view_mm
from planner.request.objective import Objective
from planner.wanted.witness_choice import PREFERRED, WitnessChoice

# what a constraint that is not met says of a witness
_WHY = {
    "visibility": "hidden",
    "resolution_mm": "too short in the image",
    "focus_mm": "out of focus",
    "field_of_view_px": "outside the image",
    "field_of_view_mm": "outside the image",
    "separation_px": "another line is too near",
    "corner_deg": "no corner at an end",
}
_OTHER = "a constraint is not met"


class Witnesses(NamedTuple):
    """The witnesses (w) of targets (k), each as a target of its own.

    Attributes
    ----------
    constraints : Constraints
        Of all witnesses.
    objective : Objective
        How surely each is measured.
    owner : array of int (w,)
        The target that each belongs to, ascending.
    """

    constraints: Constraints
    objective: Objective
    owner: NDArray[np.int_]


class WitnessStates(NamedTuple):
    """What a pose says of the witnesses (w) of a request.

    Attributes
    ----------
    missed : array (w,)
        How far the worst constraint is missed, as a share of its scale; 0 if all are met.
    worst : list of str
        That constraint.
    probability : array (w,)
        P where all are met, else 0.
    """

    missed: NDArray[np.float64]
    worst: list[str]
    probability: NDArray[np.float64]


def choice_for(camera: Camera, most: int) -> WitnessChoice:
    """Return which witnesses to offer to a camera.

    Stretches are a quarter of the shorter side of its field, in focus.

    Parameters
    ----------
    camera : Camera
        The camera.
    most : int
        Witnesses of a dimension at most. With 1 it is the preferred one, of whole entities.
    """
    if most == 1:
        return PREFERRED
    across = min(camera.sensor_size_mm) * camera.focus_distance_mm / camera.image_distance_mm
    return WitnessChoice(most, widest_view_mm(camera), across / 4)


def best_witnesses(witnesses: Witnesses, cam2world: NDArray[np.float64]) -> list[int]:
    """Return which witness of each target a pose (4, 4) shows best.

    Of those that meet all constraints it is the one with the largest P; of several, the first. If none meets them it
    is the one that misses them by least.

    Parameters
    ----------
    witnesses : Witnesses
        Of all targets.
    cam2world : array (4, 4)
        The pose.

    Returns
    -------
    list of int
        Of each target, counted from 0 among its own.
    """
    states = _states(witnesses, cam2world)
    found = []
    for target in range(witnesses.owner[-1] + 1):
        own = np.flatnonzero(witnesses.owner == target)
        order = np.lexsort((np.arange(len(own)), -states.probability[own], states.missed[own]))
        found.append(int(order[0]))
    return found


def witness_reasons(witnesses: Witnesses, cam2world: NDArray[np.float64]) -> list[list[str]]:
    """Return what keeps a pose from measuring targets by each of their witnesses; if nothing does, its P.

    Parameters
    ----------
    witnesses : Witnesses
        Of all targets.
    cam2world : array (4, 4)
        The pose.
    """
    states = _states(witnesses, cam2world)
    texts = [
        f"P = {probability_text(float(p))}" if missed == 0.0 else _WHY.get(name, _OTHER)
        for missed, name, p in zip(states.missed, states.worst, states.probability, strict=True)
    ]
    return [
        [texts[w] for w in np.flatnonzero(witnesses.owner == target)]
        for target in range(witnesses.owner[-1] + 1)
    ]


def _states(witnesses: Witnesses, cam2world: NDArray[np.float64]) -> WitnessStates:
    pose = np.asarray(cam2world, dtype=np.float64)[None]
    constraints, objective, owner = witnesses
    n = len(owner)
    missed = np.zeros(n)
    worst = [""] * n
    for name, margin in constraints.margins(pose).items():
        short = np.maximum(-margin[0], 0.0) / constraints.scale(name)
        for w in np.flatnonzero(np.broadcast_to(short, (n,)) > missed).tolist():
            worst[w] = name
        missed = np.maximum(missed, short)
    probability = np.zeros(n)
    met = missed == 0.0
    if met.any():
        probability[met] = objective.probability_where(pose, met[None])
    return WitnessStates(missed, worst, probability)
