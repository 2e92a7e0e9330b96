"""What a plan in the making has found out so far, kept in a file so that it can be resumed.

A plan is a deterministic function of its request. Its costly parts are the search for candidate poses, the proof of the
lower bound and runs of the genetic algorithm, one per set of entities, each with a seed derived from the plan's seed
and the set. So the state is

* a memo of the runs' outcomes: resuming finds them there instead of running again;
* a checkpoint: all that the planning depends on from one of certain points on. Between two of them nothing is known, so
  what was done since the last one is done again;
* the plan, once there is one.

With or without interruption the plan is the same. The file is written every few seconds, and when the planning ends for
whatever reason that lets it.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from ground.convert import Meta, from_plain, shown
from planner.exceptions import OutputError, PlanFileError
from planner.files import encoded, make_folder, program_digest, read_json, write_text
from planner.identity import first_difference
from planner.plan import InspectionPlan
from planner.plan_file import Reasons, check_checkpoint, check_state, packed, unpacked
from planner.plan_record import Kinds, PlanFile
from planner.sensor_setting import Outcome, Reason, ReasonKind, SensorSetting, kind_of

FORMAT = "aspectgraph planning state"
VERSION = 4

# the file is not written anew before so many seconds, nor before so many times as long as it took, but after so many
_SECONDS = 5.0
_TIMES = 60.0
_MOST_SECONDS = 15.0


# What the file holds. Arrays of a checkpoint are packed; what else it holds is read by this program alone.


@dataclass(frozen=True, eq=False)
class SettingOutcome:
    """A run that found a setting."""

    setting: SensorSetting


@dataclass(frozen=True)
class ReasonOutcome:
    """A run that found none."""

    reason: str
    kind: Annotated[ReasonKind, Meta(title="must be a kind of reason")] = ReasonKind.NOT_STATED


@dataclass(frozen=True, eq=False)
class CheckpointRecord:
    """How far a planning has got, see `planner.search.incumbents.PlanState`."""

    stage: Annotated[
        Literal[
            "candidate poses",
            "incompatible targets",
            "first columns",
            "column generation",
            "weighing",
            "lower bound",
            "refutation",
            "counted columns",
            "settings",
            "lamps",
        ],
        Meta(title="must be a stage of planning"),
    ]
    entries: Mapping[str, Any]
    pools: Mapping[str, Any]
    uninspectable: Reasons
    uninspectable_kinds: Kinds = field(default_factory=dict)
    incompatible: tuple[str, ...] = ()
    incompatible_ends: tuple[str, ...] = ()
    weighing: Any = None
    inspected: Any = None
    n_known: Any = None
    joined: Any = None
    bound: Any = None
    proof: Any = None
    bound_of: Any = None
    bound_weights: Any = None
    counted: Any = None
    plan: Any = None


_Digest = Annotated[str, Meta(pattern="^[0-9a-f]{64}$", title="must be 64 hexadecimal digits")]


@dataclass(frozen=True, eq=False)
class StateFile:
    """What a state file holds; the key of an outcome is the sorted JSON array of the names."""

    format: Literal["aspectgraph planning state"]
    version: Literal[4]
    request: Annotated[Mapping[str, Any], Meta(title="must be an object that holds the request")]
    program: _Digest
    outcomes: Mapping[
        str,
        Annotated[
            SettingOutcome | ReasonOutcome, Meta(title="must hold either a setting or a reason")
        ],
    ]
    checkpoint: CheckpointRecord | None
    plan: PlanFile | None
    digest: _Digest


def check_fields(data: Any) -> None:
    """Refuse a state with a field that is missing, wrong or unknown, or that contradicts itself.

    Raises
    ------
    PlanFileError
        Names the field by its path.
    """
    plan = from_plain(StateFile, data, PlanFileError).plan
    try:
        if plan is not None:
            # reads the request
            plan.asked  # noqa: B018
    except PlanFileError as error:
        raise PlanFileError(f"plan.{error}") from None
    check_state(data)


class PlanningState:
    """Checkpoint, outcomes of genetic algorithm runs by set of entities, and plan; saved now and then to a file.

    Parameters
    ----------
    identity : mapping
        Everything the plan depends on, as plain values: `Request.identity`. A file made for another request,
        or by other code, is refused.
    path : path, optional
        File to continue from, if it exists, and to save to.

    Raises
    ------
    PlanFileError
        If the file is not a state file, belongs to another request, or has a field that is wrong; it is left as it is.
    OutputError
        If nothing can be saved there.
    """

    def __init__(
        self, identity: Mapping[str, Any], path: str | os.PathLike[str] | None = None
    ) -> None:
        self.identity = dict(identity)
        self.path = None if path is None else Path(path)
        self._outcomes: dict[str, dict[str, Any]] = {}
        self._checkpoint: dict[str, Any] | None = None
        self.plan: InspectionPlan | None = None
        self._seconds = 0.0
        self._saved_at = 0.0
        self._failed = False
        if self.path is None:
            return
        if self.path.exists():
            data = self._read(self.path)
            self._outcomes = data["outcomes"]
            self._checkpoint = data["checkpoint"]
            self.plan = data["plan"]
        # found out now whether that is possible, and not when there is something to lose
        self._write(self.path)

    def __len__(self) -> int:
        return len(self._outcomes)

    def get(self, names: Iterable[str]) -> Outcome | None:
        """Return what came of a run for a set of entities, or None if not tried yet."""
        outcome = self._outcomes.get(_key(names))
        if outcome is None:
            return None
        if "setting" in outcome:
            return Outcome(SensorSetting.from_dict(outcome["setting"]))
        kind = outcome.get("kind", ReasonKind.NOT_STATED.value)
        return Outcome(reason=Reason(outcome["reason"], ReasonKind(kind)))

    def put(self, names: Iterable[str], outcome: Outcome) -> None:
        """Remember an outcome; save if it is time to."""
        if outcome.setting is None:
            kind = kind_of(outcome.reason).value
            record: dict[str, Any] = {"reason": str(outcome.reason), "kind": kind}
        else:
            record = {"setting": outcome.setting.to_dict()}
        self._outcomes[_key(names)] = record
        self._save_in_time()

    def last(self) -> dict[str, Any] | None:
        """Return the checkpoint, if any: what `keep` was given."""
        return self._checkpoint

    def keep(self, values: dict[str, Any]) -> None:
        """Take a checkpoint in place of the one before; save if it is time to.

        Parameters
        ----------
        values : dict
            See `planner.plan_file.packed`. They must not be changed any more; what can be called is called when
            the file is written.
        """
        self._checkpoint = values
        self._save_in_time()

    def finish(self, plan: InspectionPlan) -> None:
        """Remember the plan; what led to it is no longer needed."""
        self.plan = plan
        self._checkpoint = None
        self._outcomes = {}

    def save(self) -> None:
        """Write the file, if there is one, whole or not at all; remove it if there is nothing to keep.

        What goes wrong is no more than a warning, once: it must not end the planning.
        """
        if self.path is None:
            return
        try:
            if self.plan is None and self._checkpoint is None and not self._outcomes:
                self.path.unlink(missing_ok=True)
            else:
                self._write(self.path)
        except OSError as error:
            if not self._failed:
                warnings.warn(f"state is no longer saved: {error}", RuntimeWarning, stacklevel=2)
            self._failed = True

    def _save_in_time(self) -> None:
        # saving costs a small share of the time; of a very large state more, so that no more is lost
        if time.monotonic() - self._saved_at > min(
            max(_SECONDS, _TIMES * self._seconds), _MOST_SECONDS
        ):
            self.save()

    def _write(self, path: Path) -> None:
        begin = time.monotonic()
        data = encoded(
            {
                "format": FORMAT,
                "version": VERSION,
                "request": self.identity,
                "program": program_digest(),
                "outcomes": self._outcomes,
                "checkpoint": packed(self._checkpoint),
                "plan": None if self.plan is None else self.plan.to_dict(),
            }
        )
        try:
            make_folder(path.parent, [])
        except OSError as error:
            raise OutputError(
                f"{path} must be in a folder that can be made. Got: {error.strerror}."
            ) from None
        write_text(path, json.dumps({**data, "digest": _digest(data)}, allow_nan=False) + "\n")
        self._saved_at = time.monotonic()
        self._seconds = self._saved_at - begin

    def _read(self, path: Path) -> dict[str, Any]:
        """Read the file, and all of its fields."""
        data = read_state(path)
        change = state_difference(data, self.identity)
        if change is not None:
            raise PlanFileError(
                f"{path}: state file must belong to the same request and version of the program. "
                f"Got another one: {change}; plan again without it."
            )
        try:
            checkpoint = unpacked(data["checkpoint"])
            # compiled loops trust what they get
            check_checkpoint(checkpoint, len(self.identity.get("targets") or ()))
        except (PlanFileError, ValueError, TypeError, KeyError) as error:
            what = str(error).removesuffix(".")
            raise PlanFileError(f"{path}: {what}; plan again without it.") from None
        return {
            "outcomes": data["outcomes"],
            "checkpoint": checkpoint,
            "plan": None if data["plan"] is None else InspectionPlan.from_dict(data["plan"]),
        }


def read_state(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the fields of a state file as they are in the file.

    Raises
    ------
    PlanFileError
        If it is not one, of another version, or not as it was written; the message names the field where that is known.
    """
    path = Path(path)
    data = read_json(path, "state file")
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise PlanFileError(
            f"{path}: state file must be a planning state of version {VERSION}. Got another file."
        )
    if data.get("version") != VERSION:
        raise PlanFileError(
            f"{path}: state file must be a planning state of version {VERSION}. Got version "
            f"{shown(data.get('version'))}, which another version of this program wrote; plan again without it."
        )
    try:
        check_fields(data)
    except PlanFileError as error:
        raise PlanFileError(f"{path}: {error}") from None
    # what is inside a checkpoint fits together or not, which no single field tells
    if data["digest"] != _digest({name: value for name, value in data.items() if name != "digest"}):
        raise PlanFileError(
            f"{path}: digest must be that of the other fields. Got another; plan again without it."
        )
    return data


def holds_plan(path: str | os.PathLike[str]) -> bool:
    """Tell whether a file is the state of a planning that is done, so that resuming it gives the plan at once."""
    try:
        return read_state(path)["plan"] is not None
    except PlanFileError:
        return False


def state_difference(
    data: Mapping[str, Any],
    identity: Mapping[str, Any],
    words: Callable[[str], str] = str,
) -> str | None:
    """Return in what the request or the program of a state differs from those of now.

    Parameters
    ----------
    data : mapping
        As `read_state` returns it.
    identity : mapping
        The identity of the request now.
    words : callable
        Returns what the caller calls a keyword of `plan_inspection`. Default: its name.

    Returns
    -------
    str or None
        The first difference; None if the state can be resumed.
    """
    change = first_difference(identity, data["request"], words)
    if change is None and data["program"] != program_digest():
        return "the version of the program changed"
    return change


def _digest(data: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def _key(names: Iterable[str]) -> str:
    return json.dumps(sorted(names))
