"""What is asked for every part of a folder."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from planner.camera.camera import Camera
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.exceptions import RequestError
from planner.request.defaults import check_count, check_fraction
from planner.request.effort import Effort
from planner.resume import program_version
from planner.showing.showing import NOT_ASKED, Showing

_LIMITS = (
    "stand_off_mm",
    "min_length_px",
    "field_margin_px",
    "visibility_radius_mm",
    "focus_margin_mm",
    "showing",
    "time_limit_s",
    "gap",
)


@dataclass(frozen=True)
class PartRequest:
    """What is asked for every part of a folder; `plan_inspection` says more of most of it.

    Parameters
    ----------
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        How far its real pose may be from the planned one.
    accuracy, probability : float
        What is required, in (0, 1).
    seed : int
        Same seed, same plans.
    select : str, optional
        Rule for the entities, as `aspectgraph.select_entities` takes it. Default: all sharp straight edges. Of rims the
        diameter is measured, of arcs the radius.
    units : str, optional
        Of mesh files.
    simulate : int
        Displaced poses per setting that check each plan.
    graph_limit : int
        The joint graph is written for up to so many entities.
    effort : Effort
        How long to search.
    limits : mapping
        ``stand_off_mm``, ``min_length_px``, ``field_margin_px``, ``visibility_radius_mm``, ``focus_margin_mm``,
        ``showing``, ``time_limit_s`` and ``gap`` as `plan_inspection` takes them, where not the default;
        the time is per part.

    Raises
    ------
    RequestError
        If one breaks its rule.
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
        check_fraction("accuracy", self.accuracy)
        check_fraction("probability", self.probability)
        for name, least in (("seed", 0), ("simulate", 1), ("graph_limit", 0)):
            check_count(name, getattr(self, name), least)
        for name in self.limits:
            if name not in _LIMITS:
                raise RequestError(f"limits must be of {', '.join(_LIMITS)}. Got {name!r}.")

    @property
    def fingerprint(self) -> str:
        """Digest of the request and of the program's version: equal for equal plans of a file."""
        basis: dict[str, Any] = {
            "camera": self.camera.to_dict(),
            "pose_uncertainty": self.pose_uncertainty.to_dict(),
            "effort": asdict(self.effort),
            "limits": {
                name: asdict(value) if isinstance(value, Showing) else value
                for name, value in self.limits.items()
                if value not in (None, NOT_ASKED)
            },
            "program": program_version(),
        }
        for name in (
            "accuracy",
            "probability",
            "seed",
            "select",
            "units",
            "simulate",
            "graph_limit",
        ):
            basis[name] = getattr(self, name)
        return hashlib.sha256(json.dumps(basis, sort_keys=True).encode()).hexdigest()
