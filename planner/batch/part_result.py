"""What came of a part: a record beside its plan, and the table of all parts."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from aspectgraph.entities.spreadsheet_text import csv_text
from planner.exceptions import PlanFileError
from planner.files import write_text
from planner.records.json_file import read_json
from planner.records.schema import check_schema

RECORD = "result.json"
PLAN = "plan.json"
TABLES = ("results.json", "results.csv")
PLANNED = "planned"
INCOMPLETE = "incomplete"
REFUSED = "refused"
FAILED = "failed"


@dataclass(frozen=True)
class PartResult:
    """The result of planning one part of a folder.

    Attributes
    ----------
    part : str
        Its file, relative to the folder of parts.
    status : {"planned", "incomplete", "refused", "failed"}
        "incomplete": some entity cannot be inspected, or the simulation contradicts the plan.
        "refused": the part or the request breaks a rule, and would break it again. "failed":
        another error occurred, and the next call tries again.
    reason : str
        Why there is no plan, or what it lacks. Otherwise empty.
    entities, settings, lower_bound : int
        Numbers of the plan, 0 without one.
    seconds : float
        Time of the planning, in seconds.
    file_sha256, request, plan_sha256 : str
        Digests of the part file, the request and ``plan.json``. They decide whether the result is
        still valid.
    """

    part: str
    status: str
    reason: str = ""
    entities: int = 0
    settings: int = 0
    lower_bound: int = 0
    seconds: float = 0.0
    file_sha256: str = ""
    request: str = ""
    plan_sha256: str = ""

    def write(self, folder: Path) -> None:
        """Write the record next to the plan.

        Parameters
        ----------
        folder : Path
            Folder of the part's plan.
        """
        write_text(folder / RECORD, json.dumps(asdict(self), indent=1) + "\n")


def found_again(part: str, folder: Path, file_sha256: str, request: str) -> PartResult | None:
    """Return the result of an earlier call, if it holds for this file and this request; else None.

    A failure is no result. A plan that is gone, or is not the one that was written, is made again.
    """
    result = read_record(folder / RECORD)
    if result is None:
        return None
    asked = (part, file_sha256, request)
    if (result.part, result.file_sha256, result.request) != asked or result.status == FAILED:
        return None
    return (
        result
        if result.status == REFUSED or digest_of(folder / PLAN) == result.plan_sha256
        else None
    )


def read_record(path: Path) -> PartResult | None:
    """Return a record that `PartResult.write` wrote; None of what is no such record, or is not there."""
    try:
        data = read_json(path, "result")
        check_schema(data, "part_result")
    except PlanFileError:
        return None
    return PartResult(**data)


def is_table(path: Path) -> bool:
    """Tell whether a file is ``results.json`` of `write_tables`."""
    return parts_in(path) is not None


def parts_in(path: Path) -> set[str] | None:
    """Return the parts in ``results.json`` of `write_tables`; None of what is no such table, or is not there."""
    try:
        rows = read_json(path, "results")
        check_schema(rows, "part_results")
    except PlanFileError:
        return None
    return {row["part"] for row in rows}


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file, or nothing if it cannot be read."""
    digest = hashlib.sha256()
    try:
        with open(path, "rb") as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    except OSError:
        return ""
    return digest.hexdigest()


def write_tables(results: Iterable[PartResult], out: Path) -> None:
    """Write ``results.json`` and ``results.csv``, a row per part, in the order of their names."""
    rows: list[dict[str, Any]] = [
        asdict(result) for result in sorted(results, key=lambda result: result.part)
    ]
    write_text(out / TABLES[0], json.dumps(rows, indent=1) + "\n")
    write_text(out / TABLES[1], csv_text([field.name for field in fields(PartResult)], rows))
