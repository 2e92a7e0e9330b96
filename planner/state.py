"""What a plan in the making has found out so far, kept in a file so that it can be resumed.

A plan is a deterministic function of its request; the costly parts of it are the proof of the lower bound and runs of
the genetic algorithm, one per set of entities, each with a seed derived from the plan's seed and the set. So the state
is a memo of their outcomes: resuming means planning again and finding the outcomes there. With or without interruption
the plan is the same.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np

from planner.exceptions import PlanFileError
from planner.files import write_text
from planner.jsonfile import encoded, read_json
from planner.plancheck import check_state
from planner.schema import check_schema
from planner.setting import SensorSetting

FORMAT = "aspectgraph planning state"
VERSION = 1


class PlanningState:
    """The proof, and outcomes of genetic algorithm runs by set of entities, saved after each one if there is a file.

    Parameters
    ----------
    request : dict
        Everything the outcomes depend on, as plain values; a file made for another request is refused.
    path : path, optional
        File to continue from, if it exists, and to save to.

    Raises
    ------
    PlanFileError
        If the file is not a state file, belongs to another request, or has a field that is wrong; it is left as it is.
    """

    def __init__(self, request: dict, path=None):
        self.fingerprint = hashlib.sha256(json.dumps(request, sort_keys=True).encode()).hexdigest()
        self.path = None if path is None else Path(path)
        self._names = request.get("entities")
        self._outcomes: dict[str, dict] = {}
        self._proof: dict | None = None
        if self.path is not None and self.path.exists():
            data = self._read()
            self._outcomes, self._proof = data["outcomes"], data.get("proof")

    def __len__(self) -> int:
        return len(self._outcomes)

    def get(self, names) -> SensorSetting | str | None:
        """Return the setting found for a set of entities, the reason why there is none, or None if not tried yet."""
        outcome = self._outcomes.get(_key(names))
        if outcome is None:
            return None
        return SensorSetting.from_dict(outcome["setting"]) if "setting" in outcome else outcome["reason"]

    def put(self, names, outcome: SensorSetting | str) -> None:
        """Remember an outcome and save all of them."""
        entry = {"reason": outcome} if isinstance(outcome, str) else {"setting": encoded(outcome.to_dict())}
        self._outcomes[_key(names)] = entry
        self.save()

    def get_proof(self, basis: str) -> tuple[int, str, list[np.ndarray]] | None:
        """Return what `put_proof` stored on the same basis, or None."""
        if self._proof is None or self._proof["basis"] != basis:
            return None
        return self._proof["bound"], self._proof["text"], [np.array(poses) for poses in self._proof["joined"]]

    def put_proof(self, basis: str, bound: int, text: str, joined: list[np.ndarray]) -> None:
        """Remember the lower bound, what it rests on and the poses its search came across, and save all.

        ``basis`` is what the proof depends on beside the request.
        """
        poses = [batch.tolist() for batch in joined]
        self._proof = {"basis": basis, "bound": bound, "text": text, "joined": poses}
        self.save()

    def save(self) -> None:
        """Write the file, if there is one, whole or not at all."""
        if self.path is None:
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        data = {"format": FORMAT, "version": VERSION, "request": self.fingerprint, "outcomes": self._outcomes}
        if self._proof is not None:
            data["proof"] = self._proof
        write_text(self.path, json.dumps(data) + "\n")

    def discard(self) -> None:
        """Delete the file: the plan is done."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)

    def _read(self) -> dict:
        data = read_json(self.path, "state file")
        if not isinstance(data, dict) or data.get("format") != FORMAT or data.get("version") != VERSION:
            raise PlanFileError(
                f"{self.path}: state file must be a planning state of version {VERSION}. Got another file."
            )
        if data.get("request") != self.fingerprint:
            raise PlanFileError(
                f"{self.path}: state file must belong to the same part, entities, camera, limits and seed. "
                "Got another request's."
            )
        try:
            check_schema(data, "state")
            check_state(data, self._names)
        except PlanFileError as error:
            raise PlanFileError(f"{self.path}: {error}") from None
        return data


def _key(names) -> str:
    return json.dumps(sorted(names))
