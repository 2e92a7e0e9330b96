"""In how many images of displaced cameras the edges of a plan meet the conditions for showing that it was made with.

A plan meets the conditions for showing at its planned poses. This counts how often they are met from displaced poses,
too: a line that is 5 px away in the planned image may be 4 px away in a real one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.detectability.conditions import Detectability
from planner.detectability.image_check import ImageCheck
from planner.exceptions import RequestError
from planner.progress import Progress, report
from planner.verify.simulate_setting import displaced_poses
from planner.verify.simulated import Planned

if TYPE_CHECKING:
    from aspectgraph import Solid

MOST_POSES = 200
"""Displaced poses per setting at most: each one takes rays for every line near an edge."""


@dataclass(frozen=True)
class ShownImages:
    """How often edges meet the conditions for showing.

    Attributes
    ----------
    counts : tuple of dict of str to int
        Per setting, in how many images each edge does; what is no edge is not counted.
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
    measured = [
        [name for name in one.entities if plan.targets[name].in_image] for one in plan.settings
    ]
    if not any(asked.values()) or not any(measured):
        return None
    names = sorted({name for own in measured for name in own})
    ends = np.array([plan.targets[name].points for name in names], dtype=np.float64)
    showing = Detectability(asked["separation_px"], 0.0, asked["min_corner_deg"])
    image = ImageCheck(solid, _edges_of(solid, names, ends), ends, plan.camera, showing)
    counts = []
    n = min(n, MOST_POSES)
    for k, (setting, own) in enumerate(zip(plan.settings, measured, strict=True)):
        rng = np.random.default_rng(None if seed is None else [seed, k, 1])
        poses = displaced_poses(np.asarray(setting.cam2world), plan.pose_uncertainty, n, rng)
        wanted = np.broadcast_to(np.isin(names, own), (n, len(names)))
        found = image.shown(poses, wanted).sum(axis=0)
        counts.append({name: int(found[names.index(name)]) for name in own})
        report(progress, k + 1, len(plan.settings), "displaced images")
    return ShownImages(tuple(counts), n)


def _edges_of(solid: Solid, names: list[str], ends: np.ndarray) -> list[tuple[int, ...]]:
    from aspectgraph import resolve_entities
    from aspectgraph.exceptions import EntityError

    try:
        found = resolve_entities(solid, dict(zip(names, ends, strict=True)))
    except EntityError as error:
        raise RequestError(f"solid must be the plan's part. {error}") from error
    return [tuple(found[name].edge_ids) for name in names]
