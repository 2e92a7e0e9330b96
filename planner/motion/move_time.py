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


class Profile(NamedTuple):
    """A straight joint move in time: between its instants the acceleration is constant.

    Attributes
    ----------
    seconds : array (m,)
        Instants from 0; three for a triangle of speed, four for a trapezoid.
    shares : array (m,)
        Share of the way that is driven.
    rates : array (m,)
        How fast this share grows, 1/s; 0 at both ends.
    """

    seconds: np.ndarray
    shares: np.ndarray
    rates: np.ndarray


def profile(start: np.ndarray, end: np.ndarray, rates: JointRates) -> Profile:
    """Return how a straight joint move runs from rest to rest.

    Parameters
    ----------
    start, end : array (k,)
        Joints, rad; they differ.
    rates : JointRates
        Of the robot.

    Returns
    -------
    Profile
        It ends after the time that `move_times` says.
    """
    distances = np.abs(np.asarray(end) - np.asarray(start))
    cruise = float((distances / rates.speeds).max())
    square = float((distances / rates.accelerations).max())
    total = float(move_times(start, end, rates))
    if cruise * cruise < square:
        peak = 2.0 / total
        return Profile(
            np.array([0.0, total / 2, total]), np.array([0.0, 0.5, 1.0]), np.array([0.0, peak, 0.0])
        )
    rising = square / cruise
    driven = rising / cruise / 2
    return Profile(
        np.array([0.0, rising, total - rising, total]),
        np.array([0.0, driven, 1.0 - driven, 1.0]),
        np.array([0.0, 1.0 / cruise, 1.0 / cruise, 0.0]),
    )
