"""A setting in a plan file, with what follows from plan and pose: how sure dimensions are, and where to look."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from errors.formatting import below_one
from planner.detectability.conditions import asks_of_images
from planner.detectability.search_window import search_window_px
from planner.exceptions import PlanFileError
from planner.records.schema import field_name, shown
from planner.wanted.planned import targets_of

# a plan may be read on another machine, whose last digits differ
_SAME = 1e-6
# earlier programs had another definition; the schema says what it may be
_DEFINED_ANEW = ("binding",)
_FOLLOWS = ("measurements", "search_window_px")
# sources of variance that earlier programs did not know
_LATER = ("localisation_floor", "surfaces")


def search_windows_px(plan: Any, setting: Any) -> dict[str, float]:
    """Return within how many pixels of its prediction each item of a setting is found in the image.

    Parameters
    ----------
    plan : InspectionPlan
        Gives the points, the camera and the pose uncertainty.
    setting : SensorSetting
        One of its settings.

    Returns
    -------
    dict of str to float
        Three standard deviations of the image's shift by name, px, see `planner.detectability.search_window`.
    """
    targets = targets_of(plan.targets, setting)
    return {
        name: search_window_px(
            setting.cam2world, targets[name].points, plan.camera, plan.pose_uncertainty
        )
        for name in setting.entities
    }


def setting_dict(plan: Any, setting: Any) -> dict[str, Any]:
    """Return a setting as plain values for a plan file.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    setting : SensorSetting
        One of its settings.

    Returns
    -------
    dict
        Its fields; in plans of dimensions `measurements`, and where edges must be found in images `search_window_px`.
    """
    fields = setting.to_dict()
    fields["probability"] = {name: below_one(p) for name, p in fields["probability"].items()}
    return {**fields, **_what_follows(plan, setting)}


def own_fields(setting: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a setting in a file holds beside what follows from the plan.

    Parameters
    ----------
    setting : mapping
        As read.
    """
    return {name: value for name, value in setting.items() if name not in _FOLLOWS}


def check_settings(plan: Any, settings: Sequence[Mapping[str, Any]]) -> None:
    """Refuse values in a file that are not those that follow from the plan.

    Parameters
    ----------
    plan : InspectionPlan
        What was read.
    settings : sequence of mapping
        The file's settings; what is missing is left alone.

    Raises
    ------
    PlanFileError
        Names the first wrong field by its path.
    """
    for k, (setting, data) in enumerate(zip(plan.settings, settings, strict=True)):
        given = [name for name in _FOLLOWS if name in data]
        follows = _what_follows(plan, setting) if given else {}
        for name in given:
            where = field_name("settings", k, name)
            if name not in follows:
                rule = "must only be given where requirements ask that edges are found in images"
                raise PlanFileError(f"{where} {rule}. Got {shown(data[name])}.")
            _check_same(where, data[name], follows[name])


def _what_follows(plan: Any, setting: Any) -> dict[str, Any]:
    found: dict[str, Any] = {}
    if plan.dimensions:
        from planner.verify.measurements import measurements_dict

        found["measurements"] = measurements_dict(plan, setting)
    if asks_of_images(plan.requirements):
        found["search_window_px"] = search_windows_px(plan, setting)
    return found


def _check_same(where: str, given: Any, computed: Any) -> None:
    if isinstance(computed, dict) and isinstance(given, Mapping):
        for name in [*computed, *given]:
            if name in _DEFINED_ANEW and name in given:
                continue
            if name in _LATER and name not in given and computed[name] == 0.0:
                continue
            if name not in computed or name not in given:
                rule = (
                    "must be given. Got none."
                    if name in computed
                    else "must be of an item of the setting."
                )
                raise PlanFileError(f"{where}.{name} {rule}")
            _check_same(f"{where}.{name}", given[name], computed[name])
        return
    if isinstance(computed, float) and isinstance(given, int | float):
        same = bool(abs(given - computed) <= _SAME * max(abs(computed), _SAME))
    else:
        same = given == computed
    if not same:
        raise PlanFileError(
            f"{where} must be that of the pose, {shown(computed)}. Got {shown(given)}."
        )
