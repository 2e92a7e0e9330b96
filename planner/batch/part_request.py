"""What is asked for every part of a folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

from aspectgraph.entities.entity_rules import check_selection
from aspectgraph.read.mesh import check_units
from planner.argument_kinds import (
    MAPPING,
    NOT_NEGATIVE,
    check_count,
    check_fraction,
    check_kinds,
    check_number,
)
from planner.callbacks import Deadline
from planner.camera.camera import Camera
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.effort.effort import Effort
from planner.exceptions import RequestError
from planner.identity.inspection_request import InspectionRequest, digest_of
from planner.identity.plain import plain_fields
from planner.identity.resolve_request import Promise, promised
from planner.inspection_options import InspectionOptions
from planner.request.defaults import MOST_SEED

_LENGTHS = (
    "stand_off_mm",
    "min_length_px",
    "field_margin_px",
    "visibility_radius_mm",
    "focus_margin_mm",
)
_LIMITS = (*_LENGTHS, "showing", "time_limit_s", "gap")
# least and most of what is counted
_COUNTS = {"seed": (0, MOST_SEED), "simulate": (1, 10**9), "graph_limit": (0, 10**9)}


@dataclass(frozen=True)
class PartRequest:
    """The options for planning every part of a folder.

    `plan_inspection` describes most of them in full.

    Parameters
    ----------
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        Uncertainty of its real pose about the planned one.
    accuracy, probability : float
        Required accuracy, and required probability of reaching it, in (0, 1).
    seed : int
        The same seed gives the same plans.
    select : str, optional
        Rule for the entities, as `aspectgraph.select_entities` takes it. Default: all sharp
        straight edges. The plans measure the diameter of rims and the radius of arcs.
    units : str, optional
        Unit of the coordinates of mesh files.
    simulate : int
        Number of displaced poses per setting that check each plan.
    graph_limit : int
        Write the joint graph for at most this many entities.
    effort : Effort
        How long to search.
    limits : mapping
        ``stand_off_mm``, ``min_length_px``, ``field_margin_px``, ``visibility_radius_mm``,
        ``focus_margin_mm``, ``showing``, ``time_limit_s`` and ``gap`` as `plan_inspection` takes
        them. The time limit applies to each part.

    Raises
    ------
    RequestError
        If an option breaks its rule.
    EntityError, ReadError
        If the rule for the entities is not valid, or the unit is not known.

    Examples
    --------
    >>> from planner import Camera, PartRequest, PoseUncertainty
    >>> uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
    >>> camera = Camera.named("basler-acA2440-20gm-8mm")
    >>> request = PartRequest(camera, uncertainty, select="length > 20", limits={"stand_off_mm": 80.0})
    >>> request.options.stand_off_mm
    80.0
    """

    camera: Camera
    pose_uncertainty: PoseUncertainty
    accuracy: float = 0.98
    probability: float = 0.9
    seed: int = 0
    select: str | None = None
    units: str | None = None
    simulate: int = 10_000
    graph_limit: int = 0
    effort: Effort = field(default_factory=Effort)
    limits: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_kinds(
            camera=(self.camera, "Camera"),
            pose_uncertainty=(self.pose_uncertainty, "PoseUncertainty"),
            effort=(self.effort, "Effort"),
            limits=(self.limits, MAPPING),
        )
        check_fraction("accuracy", self.accuracy)
        check_fraction("probability", self.probability)
        for name, (least, most) in _COUNTS.items():
            check_count(name, getattr(self, name), least, most)
        if self.select is not None:
            check_kinds(select=(self.select, "str"))
            check_selection(self.select)
        if self.units is not None:
            check_kinds(units=(self.units, "str"))
            check_units(self.units)
        for name, value in self.limits.items():
            if name not in _LIMITS:
                raise RequestError.of_rule("limits", f"must be of {', '.join(_LIMITS)}", repr(name))
            if name in _LENGTHS and value is not None:
                check_number(name, value, NOT_NEGATIVE)
        # what would be refused with every part is refused before the first one
        Deadline(self.options.time_limit_s, self.options.gap)
        self.options.requirements(self.camera, self.pose_uncertainty)

    @property
    def options(self) -> InspectionOptions:
        """The limits and the effort, as `plan_inspection` takes them."""
        given = {name: value for name, value in self.limits.items() if value is not None}
        return InspectionOptions(**{**given, "effort": self.effort})

    @cached_property
    def request(self) -> InspectionRequest:
        """The request that applies to every part, without part, targets and workspace."""
        promise = Promise(self.accuracy, self.probability, self.seed)
        known = promised(self.camera, self.pose_uncertainty, promise, self.options)
        return InspectionRequest(part=None, targets=None, workspace=None, ring=None, **known)

    @property
    def fingerprint(self) -> str:
        """Digest of the request and the program. Equal digests mean equal plans of a file.

        All fields count, also those that an `InspectionRequest` lacks.
        """
        asked = {one.name for one in fields(InspectionRequest)}
        own = {name: value for name, value in plain_fields(self).items() if name not in asked}
        # in the request as they are resolved: a default that is given is a default
        own["limits"] = {"time_limit_s": self.options.time_limit_s}
        return digest_of(self.request.fingerprint(), own)


def limits_of(options: InspectionOptions) -> dict[str, Any]:
    """Return the options that `PartRequest` takes as limits."""
    return {name: getattr(options, name) for name in _LIMITS}
