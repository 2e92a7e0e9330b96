"""What poses that exist measure: tables for the terminal, and records for other programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from errors.checks import probability_text
from planner.optics import PosePrediction, PosesPrediction
from planner.request.problem import why_missed
from planner.text_table import Column, count, listed, print_table, print_text, words

_OPTICAL_AXES = "x right, y down, z forward"
_COLUMNS = (
    Column("pose"),
    Column("target"),
    Column("nominal", right=True),
    Column("permitted", right=True),
    Column("U", right=True),
    Column("P", right=True),
    Column("P_all", right=True),
)
_MISSED = (Column("target"), Column("nearest miss"))
_NOT_INSPECTED = (Column("pose"), Column("why not"), Column("targets"))


def prediction_record(
    predicted: PosesPrediction, source: str, frame: str, left_out: Mapping[str, str]
) -> dict[str, Any]:
    """Return what poses measure as plain values, in mm and degrees.

    Parameters
    ----------
    predicted : PosesPrediction
        The prediction.
    source, frame : str
        Of the file of poses, see `planner.PoseFile`.
    left_out : mapping of str to str
        Targets of the model that cannot be planned, and why.
    """
    required = predicted.required
    poses = []
    for pose, targets in zip(predicted.poses, predicted.predictions, strict=True):
        told = {
            name: {
                **_without_nan(vars(target)),
                "inspected": target.is_sure(required),
                "reason": target.reason(required) or None,
            }
            for name, target in targets.items()
        }
        poses.append({"name": pose.name, "cam2world": pose.cam2world.tolist(), "targets": told})
    return {
        "source": source,
        "frame": frame,
        "required": required,
        "poses": poses,
        "not_inspected": predicted.missed,
        "not_planned": dict(left_out),
    }


def _without_nan(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a prediction with None for what is no number."""
    return {
        name: None if isinstance(value, float) and np.isnan(value) else value
        for name, value in values.items()
    }


def print_prediction(predicted: PosesPrediction, source: str, frame: str) -> None:
    """Print what each pose inspects, why it does not inspect the other targets, and what no pose inspects.

    Parameters
    ----------
    predicted, source, frame
        As `prediction_record` takes them.
    """
    named = f"; frame {frame!r} is taken as that of the part" if frame not in ("", "part") else ""
    print_text(f"{count(len(predicted.poses), 'pose')}: {source}{named}")
    required = predicted.required
    rows = []
    others = []
    for pose, targets in zip(predicted.poses, predicted.predictions, strict=True):
        rows += [
            _row(pose.name, name, target)
            for name, target in targets.items()
            if target.is_sure(required)
        ]
        short = {name: item for name, item in targets.items() if not item.is_sure(required)}
        others += [(pose.name, why, listed(names)) for why, names in _grouped(short, required)]
    print_table(_COLUMNS, rows)
    if rows and others:
        print()
    print_table(_NOT_INSPECTED, others)
    print()
    names = list(predicted.predictions[0])
    missed = predicted.missed
    if missed:
        print_text(f"No pose inspects {len(missed)} of {count(len(names), 'target')}:")
        print_table(_MISSED, [(name, words(why)) for name, why in missed.items()])
    else:
        print_text(f"The poses inspect {count(len(names), 'target')}, all that are wanted.")
    if note := _doubts(predicted):
        print_text(note)


def _row(pose: str, name: str, target: PosePrediction) -> tuple[str, ...]:
    unit = target.unit
    return (
        pose,
        name,
        f"{target.nominal:.6g} {unit}",
        f"{target.permitted_error:.3g} {unit}",
        f"{target.expanded_uncertainty:.3g} {unit}",
        probability_text(target.probability),
        probability_text(target.p_all),
    )


def _grouped(
    short: Mapping[str, PosePrediction], required: float
) -> list[tuple[str, Sequence[str]]]:
    """Return targets by their worst reason, each with the range of its amounts."""
    groups: dict[str, list[str]] = {}
    for name, target in short.items():
        behind = np.isnan(target.conditional_probability)
        key = target.reason(required)
        if target.missed and not behind:
            key = next(iter(target.missed))
        groups.setdefault(key, []).append(name)
    told = []
    for key, names in groups.items():
        amounts = [short[name].missed.get(key) for name in names]
        known = [amount for amount in amounts if amount is not None]
        text = key
        if len(known) == len(names):
            text = why_missed(key, min(known))
            if f"{max(known):.3g}" != f"{min(known):.3g}" and " by " in text:
                head, _, unit = text.rpartition(" ")
                text = f"{head} to {max(known):.3g} {unit}"
        told.append((text, names))
    return told


def _doubts(predicted: PosesPrediction) -> str:
    """Return what may be wrong with all poses: their axes, or their unit and frame; empty if nothing is."""
    targets = [target for targets in predicted.predictions for target in targets.values()]
    if all(np.isnan(target.conditional_probability) for target in targets):
        return (
            "note: the part is behind the camera in every pose. Poses must be those of the optical frame "
            f"({_OPTICAL_AXES}), camera to part; those of a camera's body or flange are others."
        )
    if all("workspace_mm" in target.missed for target in targets):
        return (
            "note: every pose is outside the workspace. Unit or frame of the file may be others: "
            "poses must be given in the frame of the part."
        )
    return ""
