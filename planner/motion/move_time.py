"""How long a straight joint move takes: all joints start, accelerate and stop together.

A straight line from p to q is one number s from 0 to 1, with joints p + s (q - p). With speeds v and
accelerations a of the joints, s may change at V = min v / abs(q - p) per second and A = min a /
abs(q - p) per second squared. From rest to rest it takes 1 / V + V / A if the speed V is reached,
2 sqrt(1 / A) otherwise: a trapezoid or a triangle of speed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class JointRates(NamedTuple):
    """How fast the joints may turn.

    Attributes
    ----------
    speeds : array (k,)
        Largest speed of each joint, rad/s.
    accelerations : array (k,)
        Largest acceleration of each joint, rad/s².
    """

    speeds: np.ndarray
    accelerations: np.ndarray

    def scaled(self, share: float) -> JointRates:
        """Return the rates with a share of the speeds; accelerations stay."""
        return JointRates(self.speeds * share, self.accelerations)


def move_times(starts: np.ndarray, ends: np.ndarray, rates: JointRates) -> np.ndarray:
    """Return how long straight joint moves take, from rest to rest.

    Parameters
    ----------
    starts, ends : array (..., k)
        Joints, rad; the shapes are broadcast.
    rates : JointRates
        Of the robot.

    Returns
    -------
    array (...)
        Seconds.
    """
    distances = np.abs(np.asarray(ends) - np.asarray(starts))
    # seconds at full speed, and seconds squared at full acceleration, of the joint that limits
    cruise = (distances / rates.speeds).max(axis=-1)
    square = (distances / rates.accelerations).max(axis=-1)
    # the speed is reached where 1 / V >= V / A
    reached = cruise * cruise >= square
    at_speed = cruise + np.divide(square, cruise, out=np.zeros_like(square), where=cruise > 0)
    return np.where(reached, at_speed, 2.0 * np.sqrt(square))


class LeadingAxis(NamedTuple):
    """Speed and acceleration of the joint that turns farthest in a move.

    Attributes
    ----------
    speed : float
        rad/s.
    acceleration : float
        rad/s².
    """

    speed: float
    acceleration: float


def leading_axis(start: np.ndarray, end: np.ndarray, rates: JointRates) -> LeadingAxis:
    """Return the rates that a controller must give the joint that turns farthest; the others follow.

    Parameters
    ----------
    start, end : array (k,)
        Joints, rad.
    rates : JointRates
        Of the robot.

    Returns
    -------
    LeadingAxis
        A move at these rates takes as long as `move_times` says.
    """
    distances = np.abs(np.asarray(end) - np.asarray(start))
    largest = float(distances.max())
    if largest == 0.0:
        return LeadingAxis(float(rates.speeds.min()), float(rates.accelerations.min()))
    cruise = float((distances / rates.speeds).max())
    square = float((distances / rates.accelerations).max())
    return LeadingAxis(largest / cruise, largest / square)
