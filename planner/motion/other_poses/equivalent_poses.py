"""Poses that inspect the same as a setting of a plan, by the rules of the request that the plan holds.

A setting is rolled about its line of sight, and moved a little in all directions. Of these poses those are kept that
the judge of the request accepts. Where the camera may be is computed anew, only around the setting.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.columns.judge import Judge
from planner.columns.perturb import perturbed
from planner.columns.realise_column import joint_bounds, missing, promised_too_much
from planner.exceptions import PlanFileError
from planner.identity.inspection_request import InspectionRequest
from planner.identity.resolve_request import Promise, resolve_request
from planner.identity.restore import restored_options, restored_request
from planner.request.request import Request
from planner.request.target_space import TargetSpace
from planner.setting.pose_setting import setting_at
from planner.verify.setting_record import search_windows_px
from planner.wanted.registered.record import OWN_EDGES

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.plan import InspectionPlan
    from planner.setting.sensor_setting import SensorSetting

_ROLLS = 72
_NEAR = 2000
# half the box around a setting in which the camera may be, mm
_AROUND_MM = 400.0
# beyond the part, which that box must contain, mm
_ROOM_MM = 50.0
# a turn of a radian is as far as so many millimetres
_MM_PER_RAD = 200.0
_MESSAGE = "another pose that inspects the same"


def why_no_other_poses(plan: InspectionPlan) -> str:
    """Return why no other poses can be found for a plan, in words; empty if they can."""
    if not plan.request:
        return "the plan does not hold its request: plan again"
    if plan.light is not None or plan.request.get("ring") is not None:
        return "its lamps were chosen for its poses"
    try:
        asked = _asked(plan)
    except PlanFileError:
        return "the plan's request cannot be made again"
    if asked.registration is not None and asked.registration.method == OWN_EDGES:
        return "its values are read from images registered to the part's own edges"
    return ""


def _asked(plan: InspectionPlan) -> InspectionRequest:
    """Return the request of a plan, without the robot: that is asked apart."""
    stated: Mapping[str, Any] = plan.request
    return restored_request({**stated, "requirements": {**stated["requirements"], "cell": None}})


@dataclass(frozen=True)
class _Local:
    """What is asked of a setting, with where its targets are observable around it."""

    judge: Judge

    @property
    def request(self) -> Request:
        return self.judge.request


class EquivalentPoses:
    """Other poses for the settings of one plan.

    Parameters
    ----------
    plan : InspectionPlan
        One for which `why_no_other_poses` is empty.
    solid : Solid
        Its part.
    seed : int
        Of the poses.
    """

    def __init__(self, plan: InspectionPlan, solid: Solid, seed: int = 0) -> None:
        self._plan = plan
        self._solid = solid
        self._seed = seed
        self._asked = _asked(plan)
        self._known: dict[int, _Local] = {}
        self._poses: dict[int, np.ndarray] = {}

    def request(self, k: int) -> Request:
        """Return what is asked of setting k, from 0."""
        return self._local(k).request

    def poses(self, k: int) -> np.ndarray:
        """Return poses (n, 4, 4) that inspect what setting k does, the nearest first; the setting's own is left out."""
        if k not in self._poses:
            self._poses[k] = self._found(k)
        return self._poses[k]

    def setting(self, k: int, cam2world: np.ndarray) -> SensorSetting | None:
        """Return another pose as a setting in the place of setting k; None if it promises less than is asked.

        Its probabilities and margins are stated again, and P_all where the plan states it.
        """
        before = self._plan.settings[k]
        names = before.entities
        judge = self._local(k).judge
        seed = before.seed or 0
        found = setting_at(judge.request, cam2world, names, _MESSAGE, before.seed)
        if min(found.probability.values()) < self._plan.probability:
            return None
        if promised_too_much(judge, found, seed):
            return None
        if before.p_all:
            bounds = joint_bounds(judge, cam2world, names, seed)
            if missing(judge, bounds):
                return None
            found = _with_bounds(found, bounds)
        return self._with_lines(k, found)

    def distance(self, k: int, cam2world: np.ndarray) -> tuple[float, float]:
        """Return how far a pose (4, 4) is from setting k, mm, and by how much it is turned, rad."""
        shift, turn = _apart(self._plan.settings[k].cam2world, cam2world[None])
        return float(shift[0]), float(turn[0])

    def _found(self, k: int) -> np.ndarray:
        own = self._plan.settings[k].cam2world
        rng = np.random.default_rng([self._seed, k])
        far = self._plan.camera.focus_distance_mm
        first = np.concatenate([_rolled(own), perturbed(np.repeat(own[None], _NEAR, 0), far, rng)])
        kept = self._inspecting(k, first)
        if len(kept):
            again = kept[rng.integers(len(kept), size=_NEAR)]
            kept = np.concatenate([kept, self._inspecting(k, perturbed(again, far, rng))])
        shift, turn = _apart(own, kept)
        # noise in the last digits must not decide the order
        return kept[np.argsort(np.round(shift + _MM_PER_RAD * turn, 6), kind="stable")]

    def _inspecting(self, k: int, poses: np.ndarray) -> np.ndarray:
        """Return those of poses (n, 4, 4) that inspect all that setting k does."""
        judge = self._local(k).judge
        low, high = np.asarray(self._plan.workspace, dtype=float)
        places = poses[:, :3, 3]
        poses = poses[((places >= low) & (places <= high)).all(axis=1)]
        inspects = judge(poses).inspects
        poses = poses[inspects.all(axis=1)]
        steady = judge.steady(poses, np.ones((len(poses), len(judge.names)), dtype=bool))
        return np.asarray(poses[steady.all(axis=1)])

    def _local(self, k: int) -> _Local:
        if k not in self._known:
            self._known[k] = _Local(Judge(self._request(k), self._asked.effort))
        return self._known[k]

    def _request(self, k: int) -> Request:
        from aspectgraph import compute_regions

        asked = self._asked
        setting = self._plan.settings[k]
        records = {record.name: record for record in asked.targets or ()}
        items = {name: records[name].item_of(self._solid) for name in setting.entities}
        promise = Promise(asked.accuracy, asked.probability, asked.seed)
        options = restored_options(asked)
        resolved = resolve_request(
            self._solid, items, asked.camera, asked.pose_uncertainty, promise, options
        )
        regions = compute_regions(self._solid, resolved.entities, workspace=self._box(setting))
        space = TargetSpace.of(regions, resolved.targets)
        return Request(
            space,
            space.entity_names,
            asked.camera,
            asked.pose_uncertainty,
            asked.accuracy,
            asked.probability,
            resolved.request.requirements,
            resolved.targets,
            asked.localisation,
            asked.surfaces_mm,
            None if asked.registration is None else asked.registration.pose_uncertainty,
        )

    def _box(self, setting: SensorSetting) -> np.ndarray:
        """Return the workspace (2, 3) around a setting."""
        low, high = np.asarray(self._plan.workspace, dtype=float)
        centre = setting.position
        # the part must be inside
        first, last = np.asarray(self._solid.bounds, dtype=float)
        near = np.minimum(centre - _AROUND_MM, first - _ROOM_MM)
        far = np.maximum(centre + _AROUND_MM, last + _ROOM_MM)
        return np.array([np.maximum(low, near), np.minimum(high, far)])

    def _with_lines(self, k: int, setting: SensorSetting) -> SensorSetting:
        """Return a setting that tells of other visible lines in the search windows of edges."""
        request = self.request(k)
        showing = request.requirements.showing
        if showing.asks_nothing:
            return setting
        windows = search_windows_px(self._plan, setting)
        widest = max(windows.values())
        check = request.first.constraints.image_check(replace(showing, separation_px=widest))
        wanted = np.ones((1, len(request.names)), dtype=bool)
        apart = check.separations(setting.cam2world[None], wanted, 0.0)[0] + widest
        near = dict(zip(request.names, apart.tolist(), strict=True))
        lines = {name: near[name] for name in setting.entities if near[name] < windows[name]}
        return replace(setting, lines_in_window_px=lines)


def _with_bounds(setting: SensorSetting, bounds: Mapping[str, tuple[float, int]]) -> SensorSetting:
    stated = {name: min(lower, setting.probability[name]) for name, (lower, _) in bounds.items()}
    # what is missed by one at least is missed by no more than all of them miss
    together = max(1.0 - sum(1.0 - p for p in stated.values()), 0.0)
    drawn = min(n for _, n in bounds.values())
    return replace(setting, p_all=stated, p_all_together=together, p_all_poses=drawn)


def _rolled(cam2world: np.ndarray) -> np.ndarray:
    """Return a pose (4, 4) turned about its line of sight, without the pose itself; (n, 4, 4)."""
    angles = 2 * np.pi / _ROLLS * np.arange(1, _ROLLS)
    turns = np.tile(np.eye(4), (len(angles), 1, 1))
    cosines = np.cos(angles)
    sines = np.sin(angles)
    turns[:, 0, 0] = cosines
    turns[:, 1, 1] = cosines
    turns[:, 0, 1] = -sines
    turns[:, 1, 0] = sines
    return np.einsum("ij,njk->nik", cam2world, turns)


def _apart(own: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return distances (n,), mm, and angles (n,), rad, of poses (n, 4, 4) from one (4, 4)."""
    shift = np.sqrt(((poses[:, :3, 3] - own[:3, 3]) ** 2).sum(axis=1))
    trace = np.einsum("ij,nij->n", own[:3, :3], poses[:, :3, :3])
    return shift, np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0))
