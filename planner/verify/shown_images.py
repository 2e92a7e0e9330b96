"""In how many images of displaced cameras targets of a plan meet the conditions for showing that it was made with.

A plan meets the conditions for showing at its planned poses. This counts how often they are met from displaced poses,
too: a line that is 5 px away in the planned image may be 4 px away in a real one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from errors.measurands.geometry import Geometry, Line
from planner.camera.camera import Camera
from planner.detectability.conditions import Detectability
from planner.detectability.image_check import ImageCheck
from planner.detectability.scanned import Scanned
from planner.exceptions import RequestError
from planner.progress import Progress, report
from planner.verify.simulate_setting import displaced_poses
from planner.verify.simulated import Planned
from planner.wanted.planned import PlannedLength, PlannedTarget, targets_of

if TYPE_CHECKING:
    from aspectgraph import Solid

MOST_POSES = 200
"""Displaced poses per setting at most: each one takes rays for every line near an edge."""


@dataclass(frozen=True)
class ShownImages:
    """How often targets meet the conditions for showing.

    Attributes
    ----------
    counts : tuple of dict of str to int
        Per setting, in how many images each target does.
    n : int
        Images, that is displaced poses, per setting.
    """

    counts: tuple[dict[str, int], ...]
    n: int

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain Python values, ready for JSON.

        Returns
        -------
        dict
            Field names and values.
        """
        return {"counts": [dict(one) for one in self.counts], "n": self.n}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ShownImages:
        """Build from the result of `to_dict`.

        Parameters
        ----------
        data : mapping of str to value
            The fields.

        Returns
        -------
        ShownImages
            Equal to the one written.
        """
        return cls(tuple(dict(one) for one in data["counts"]), data["n"])


def count_shown(
    plan: Planned, solid: Solid, n: int, seed: int | None, progress: Progress | None = None
) -> ShownImages | None:
    """Count in how many images of displaced cameras the edges of a plan meet the conditions for showing.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    solid : Solid
        Its part.
    n : int
        Displaced poses per setting; at most `MOST_POSES` are drawn.
    seed : int or None
        With an integer, setting i uses the seed (seed, i, 1).
    progress : callable, optional
        ``progress(done, total, label)``.

    Returns
    -------
    ShownImages or None
        None if the plan asks for no such condition, or has no settings that measure edges.

    Raises
    ------
    RequestError
        If the part lacks an edge of the plan.
    """
    asked = {name: plan.requirements.get(name, 0.0) for name in ("separation_px", "min_corner_deg")}
    edges_only = asked["separation_px"] == 0.0
    measured = [
        [name for name in one.entities if plan.targets[name].in_image or not edges_only]
        for one in plan.settings
    ]
    if not any(asked.values()) or not any(measured):
        return None
    showing = Detectability(asked["separation_px"], 0.0, asked["min_corner_deg"])
    counts = []
    n = min(n, MOST_POSES)
    for k, (setting, own) in enumerate(zip(plan.settings, measured, strict=True)):
        rng = np.random.default_rng(None if seed is None else [seed, k, 1])
        poses = displaced_poses(np.asarray(setting.cam2world), plan.pose_uncertainty, n, rng)
        image = _image_check(solid, targets_of(plan.targets, setting), own, plan.camera, showing)
        found = image.shown(poses, np.ones((n, len(own)), bool)).sum(axis=0)
        counts.append(dict(zip(own, found.tolist(), strict=True)))
        report(progress, k + 1, len(plan.settings), "displaced images")
    return ShownImages(tuple(counts), n)


def _image_check(
    solid: Solid,
    targets: Mapping[str, PlannedTarget],
    names: list[str],
    camera: Camera,
    showing: Detectability,
) -> ImageCheck:
    """Return a check of what targets of a plan need in an image."""
    edge_ids: list[tuple[int, ...] | None] = []
    ends = np.zeros((len(names), 2, 3))
    scanned: list[list[Scanned]] = []
    for k, name in enumerate(names):
        target = targets[name]
        if isinstance(target, PlannedLength):
            ends[k] = target.ends
            edge_ids.append(_edges_of(solid, [target.ends]))
            scanned.append([])
        else:
            edge_ids.append(None)
            scanned.append(
                [
                    Scanned.of(_edges_of(solid, _names_of(entity, geometry)), geometry)
                    for entity, geometry in zip(target.entities, target.geometry, strict=True)
                ]
            )
    return ImageCheck(solid, edge_ids, ends, camera, showing, scanned)


def _names_of(entity: str, geometry: Geometry) -> list[Any]:
    """Return what may name an entity: its id, or the ends of an edge that was given by them."""
    return [entity, (geometry.p, geometry.q)] if isinstance(geometry, Line) else [entity]


def _edges_of(solid: Solid, names: Sequence[Any]) -> tuple[int, ...]:
    """Return the edges of an entity, by the first of its names that the part knows."""
    from aspectgraph import resolve_entities
    from aspectgraph.exceptions import EntityError

    for name in names:
        try:
            return tuple(resolve_entities(solid, {"entity": name})["entity"].edge_ids)
        except EntityError as error:
            unknown = error
    raise RequestError(f"solid must be the plan's part. {unknown}") from unknown
