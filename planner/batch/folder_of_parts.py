"""Every part of a folder planned; what was done before is found again."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from pathlib import Path

from aspectgraph.read.part_file import MESH_SUFFIXES, STEP_SUFFIXES
from planner.argument_kinds import check_count
from planner.batch.part_request import PartRequest
from planner.batch.part_result import (
    FAILED,
    REFUSED,
    TABLES,
    PartResult,
    digest_of,
    found_again,
    is_table,
    parts_in,
    write_tables,
)
from planner.batch.plan_part import check_part_place, reason_of
from planner.batch.workers import Task, on_executor, on_own_processes
from planner.exceptions import OutputError, RequestError
from planner.files import absolute, check_set_place, name_text, output_folder
from planner.output.folder_lock import folder_lock
from planner.progress import Progress, report

# between two writings of the table while parts are planned
_TABLE_S = 10.0


def plan_folder(
    folder: str | os.PathLike[str],
    out: str | os.PathLike[str],
    request: PartRequest,
    *,
    jobs: int = 1,
    executor: Executor | None = None,
    progress: Progress | None = None,
    replace: bool = False,
) -> list[PartResult]:
    """Plan every part of a folder, and write each plan to a folder of its own.

    **Guarantee.** Every part has a result: a plan, or one reason. Finished results remain after an
    interruption. The same call reuses them while file, request and program are the same. The plans
    do not depend on the executor.

    Parameters
    ----------
    folder : path
        Folder of the part files. Subfolders are included.
    out : path
        Folder for ``results.json``, ``results.csv`` and a folder for every part, named after its
        file.
    request : PartRequest
        The options for every part.
    jobs : int
        Number of processes on this machine. A process that dies is replaced. A part that alone
        kills its process fails.
    executor : concurrent.futures.Executor, optional
        Plans the parts instead of local processes, such as
        ``dask.distributed.Client(...).get_executor()``. Its workers must reach both folders under
        the same names.
    progress : callable, optional
        The program calls ``progress(done, total, "parts")``. An exception it raises ends the work.
    replace : bool
        Replace plans and other files in ``out`` that no earlier call wrote. By default, such files
        stay: a table refuses the call, and the files of a part make this part fail.

    Returns
    -------
    list of PartResult
        In the order of the names of the parts.

    Raises
    ------
    RequestError
        If the folder holds no part file, or a number breaks its rule.
    OutputError
        If nothing can be written, another process writes there, or a table is there that no
        earlier call wrote.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from planner import Camera, Effort, PartRequest, PoseUncertainty, plan_folder
    >>> uncertainty = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
    >>> camera = Camera.named("basler-acA2440-20gm-8mm")
    >>> effort = Effort(viewpoints=10, pricing_rounds=2, refutations=1, bound_nodes=1000)
    >>> rule = "near 60,30,10 < 1"
    >>> request = PartRequest(camera, uncertainty, 0.95, select=rule, simulate=100, effort=effort)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     part = Path(folder) / "parts" / "block.off"
    ...     part.parent.mkdir()
    ...     _ = part.write_bytes(Path("examples/two_pocket_block.off").read_bytes())
    ...     (result,) = plan_folder(part.parent, Path(folder) / "plans", request)
    >>> result.part, result.status
    ('block.off', 'planned')
    """
    check_count("jobs", jobs, 1)
    source = absolute(folder)
    if not replace:
        check_set_place(Path(out), TABLES, is_table, "out")
    with output_folder(out, TABLES, "out") as target, folder_lock(target):
        results: dict[str, PartResult] = {}
        waiting: list[Task] = []
        ours = parts_in(target / TABLES[0]) or set()
        for path in part_files(source, target):
            name = name_text(path.relative_to(source))
            task = Task(request, name, path, target / path.relative_to(source))
            known = _known(task, replace or name in ours)
            if known is None:
                waiting.append(task)
            else:
                results[name] = known
        total = len(results) + len(waiting)
        reported = time.monotonic()
        report(progress, len(results), total, "parts")
        try:
            for result in _planned(waiting, jobs, executor):
                results[result.part] = result
                report(progress, len(results), total, "parts")
                if time.monotonic() - reported > _TABLE_S:
                    write_tables(results.values(), target)
                    reported = time.monotonic()
        finally:
            write_tables(results.values(), target)
    return sorted(results.values(), key=lambda one: one.part)


def _known(task: Task, may_replace: bool) -> PartResult | None:
    """Return the result of a part without planning it; None if it is to be planned."""
    if not task.path.is_file():
        kind = "a link that leads nowhere" if task.path.is_symlink() else "a pipe or a device"
        return task.failed(f"the part must be an existing file. Got {kind}.", REFUSED)
    known = found_again(task.part, task.folder, digest_of(task.path), task.request.fingerprint)
    if known is None and not may_replace:
        try:
            check_part_place(task.folder)
        except (OutputError, OSError) as error:
            return task.failed(reason_of(error), FAILED)
    return known


def part_files(folder: Path, out: Path) -> list[Path]:
    """Return the part files in a folder and those in it, but for those of the output, in order.

    Links that lead nowhere, pipes and devices with the name of a part file are among them.

    Raises
    ------
    RequestError
        If there are none.
    """
    found = [
        path
        for path in sorted(folder.rglob("*"))
        if _is_part(path) and not path.is_dir() and (out == folder or out not in path.parents)
    ]
    if not found:
        raise RequestError(
            f"the folder of parts must hold part files ({_kinds()}). Got {name_text(folder)}."
        )
    return found


def _is_part(path: Path) -> bool:
    suffixes = [suffix.lower() for suffix in path.suffixes]
    packed = suffixes[-1:] == [".gz"]
    return bool(suffixes) and suffixes[-1 - packed :][:1][0] in (*STEP_SUFFIXES, *MESH_SUFFIXES)


def _kinds() -> str:
    return " ".join((*STEP_SUFFIXES, *MESH_SUFFIXES))


def _planned(waiting: list[Task], jobs: int, executor: Executor | None) -> Iterator[PartResult]:
    if executor is not None:
        yield from on_executor(waiting, executor)
    else:
        yield from on_own_processes(waiting, jobs)
