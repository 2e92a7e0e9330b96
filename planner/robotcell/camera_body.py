"""The outside of a camera: housing, lens and the loop of its cable, as solids that nothing may touch."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from ground.short_repr import short_repr
from planner.argument_kinds import NOT_NEGATIVE, POSITIVE, check_number, shown
from planner.exceptions import RobotError
from planner.robotcell.bodies import Body, Box, hull_of, round_points

NO_CAMERA_BODY = (
    "the camera has no body, so its collisions are not checked: state [camera] or [[camera_body]]"
)
"""What a user must know of a cell without the outside of its camera."""

LEAST_MM = 1.0
"""Least size of a housing or a lens: what is smaller is stated in metres."""


@cache
def camera_body_parts() -> dict[str, dict[str, dict[str, Any]]]:
    """Return the housings and lenses of the catalogue, with their sizes and where these were read.

    Returns
    -------
    dict
        By kind, "housing" or "lens", and name: ``size_mm``, and ``source``, an address or empty where the size is a
        typical one of no maker. A housing has width, height and length, with lens mount and connectors. A lens has
        diameter and length before the mount.
    """
    text = resources.files("planner.robotcell").joinpath("camera_bodies.toml").read_text("utf-8")
    return {
        kind: {name: {"source": "", **facts} for name, facts in of.items()}
        for kind, of in tomllib.loads(text).items()
    }


@dataclass(frozen=True)
class CableCapsule:
    """What a cable may take up, which leaves a camera at the middle of its rear: a capsule.

    Parameters
    ----------
    to_mm : sequence of float
        The other end of its axis (3,) in the camera's frame, mm.
    radius_mm : float
        How far the cable may be from this axis.

    Raises
    ------
    RobotError
        If a number breaks its rule.

    Examples
    --------
    >>> from planner import CableCapsule
    >>> CableCapsule((0.0, -60.0, -140.0), 20.0).radius_mm
    20.0
    """

    to_mm: tuple[float, float, float]
    radius_mm: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "to_mm", _lengths("to_mm", self.to_mm, 3))
        radius = check_number("radius_mm", self.radius_mm, POSITIVE)
        object.__setattr__(self, "radius_mm", radius)


@dataclass(frozen=True)
class CameraBody:
    """The outside of a camera with its lens, in the camera's frame.

    The lens is a cylinder about the line of sight, and the housing a box behind it. `Cell` takes the solids as
    `camera_body`.

    Parameters
    ----------
    housing : str or sequence of float
        Name in the catalogue, or width (x), height (y) and length (3,), mm, with lens mount and connectors.
    lens : str or sequence of float
        Name in the catalogue, or diameter and length (2,) before the mount, mm.
    nodal_mm : float
        How far the camera's front nodal point, the origin of its frame, is behind the front of the lens.
    cable : CableCapsule, optional
        What the cable may take up. Default: nothing.

    Raises
    ------
    RobotError
        If the catalogue has no such name, or a number breaks its rule.

    Examples
    --------
    >>> from planner import CableCapsule, CameraBody
    >>> body = CameraBody("basler-ace-usb", (33.0, 45.0), 25.0, CableCapsule((0, 0, -130), 15))
    >>> len(body.bodies())
    3
    """

    housing: Any
    lens: Any
    nodal_mm: float
    cable: CableCapsule | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for name, count in (("housing", 3), ("lens", 2)):
            size = getattr(self, name)
            if isinstance(size, str):
                size = _facts(name, size)["size_mm"]
            object.__setattr__(self, name, _lengths(name, size, count, LEAST_MM))
        object.__setattr__(self, "nodal_mm", check_number("nodal_mm", self.nodal_mm, NOT_NEGATIVE))

    def bodies(self) -> tuple[Body, ...]:
        """Return the solids that it consists of.

        Returns
        -------
        tuple of Box or (corners, triangles)
            Convex each, in the camera's frame, mm: the housing, the lens, and the capsule of the cable. What is round
            is no smaller than stated.
        """
        width, height, length = self.housing
        diameter, barrel = self.lens
        mount = self.nodal_mm - barrel
        rear = mount - length
        housing = Box((-width / 2, -height / 2, rear), (width / 2, height / 2, mount))
        middle = np.array([0.0, 0.0, self.nodal_mm - barrel / 2])
        solids: list[Body] = [housing, _solid(round_points(diameter / 2, barrel) + middle, "lens")]
        if self.cable is not None:
            ball = round_points(self.cable.radius_mm, 0.0)
            ends = [ball + np.array([0.0, 0.0, rear]), ball + np.array(self.cable.to_mm)]
            solids.append(_solid(np.concatenate(ends), "cable"))
        return tuple(solids)


def _solid(points: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    hull = hull_of(points, name)
    return hull.corners, hull.triangles


def _lengths(name: str, value: Any, count: int, least: float = -np.inf) -> tuple[float, ...]:
    """Return so many finite numbers, none below the least, or raise."""
    rule = f"must be {count} finite numbers, mm"
    if least > 0:
        rule = f"must be {count} numbers of at least {least:g} mm"
    is_sequence = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
    if not is_sequence or len(value) != count:
        raise RobotError.of_rule(name, rule, shown(value))
    if not all(isinstance(number, int | float | np.number) for number in value):
        raise RobotError.of_rule(name, rule, shown(value))
    numbers = tuple(float(number) for number in value)
    if any(isinstance(number, bool) for number in value) or not np.isfinite(numbers).all():
        raise RobotError.of_rule(name, rule, shown(value))
    if min(numbers) < least:
        hint = "are they in m?" if min(numbers) > 0 else ""
        raise RobotError.of_rule(name, rule, shown(value), hint=hint)
    return numbers


def _facts(kind: str, name: str) -> Mapping[str, Any]:
    """Return the facts on a part of the catalogue, or raise."""
    of_kind = camera_body_parts()[kind]
    if name.lower() not in of_kind:
        near = difflib.get_close_matches(name.lower(), of_kind, n=3, cutoff=0.3) or list(of_kind)
        rule = f"must be a {kind} of the catalogue, or its size in mm"
        raise RobotError.of_rule(kind, rule, repr(name), hint=f"nearest: {', '.join(near)}")
    return of_kind[name.lower()]


def unchecked_of(bodiless_links: str, *, has_camera_body: bool) -> tuple[str, ...]:
    """Return what a user must know of objects without geometry, in sentences without a full stop.

    Parameters
    ----------
    bodiless_links : str
        What `planner.robotcell.arm.unchecked_text` says of links; empty if all have geometry.
    has_camera_body : bool
        Whether the cell states the outside of its camera.
    """
    camera = () if has_camera_body else (NO_CAMERA_BODY,)
    return (*((bodiless_links,) if bodiless_links else ()), *camera)
