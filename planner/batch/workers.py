"""Parts on worker processes: one that dies costs at most the part that killed it."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from planner.batch.part_request import PartRequest
from planner.batch.part_result import FAILED, PartResult
from planner.batch.plan_part import plan_part, reason_of
from planner.executors import leave_signals_to_the_parent

# parts that an executor of the caller has at a time; enough for hundreds of workers
_AT_A_TIME = 1000


class Task(NamedTuple):
    """What `plan_part` takes."""

    request: PartRequest
    part: str
    path: Path
    folder: Path

    def failed(self, reason: str, status: str = FAILED) -> PartResult:
        """Return the result where there is none of the worker."""
        return PartResult(self.part, status, reason, request=self.request.fingerprint)


def on_executor(tasks: Sequence[Task], executor: Executor) -> Iterator[PartResult]:
    """Yield results as they come from an executor, which replaces its own workers."""
    waiting: deque[Task] = deque(tasks)
    running: dict[Future[PartResult], Task] = {}
    try:
        while waiting or running:
            while waiting and len(running) < _AT_A_TIME:
                task = waiting.popleft()
                running[executor.submit(plan_part, *task)] = task
            for future in _first(running):
                task = running.pop(future)
                yield _result(task, future)
    finally:
        for future in running:
            future.cancel()


def on_own_processes(tasks: Sequence[Task], jobs: int) -> Iterator[PartResult]:
    """Yield results as they come from processes of this machine.

    When one dies, all parts that were being planned are suspects. Each is planned alone then: so it is known on which
    part a process dies.
    """
    waiting: deque[Task] = deque(tasks)
    suspects: deque[Task] = deque()
    while waiting or suspects:
        if suspects:
            task = suspects.popleft()
            with _pool(1) as pool:
                yield _result(task, pool.submit(plan_part, *task))
        else:
            with _pool(jobs) as pool:
                suspects.extend((yield from _while_whole(pool, waiting, jobs)))


def _while_whole(
    pool: Executor, waiting: deque[Task], jobs: int
) -> Generator[PartResult, None, list[Task]]:
    """Yield results until all are there or a process dies; return the parts without a result."""
    running: dict[Future[PartResult], Task] = {}
    lost: list[Task] = []
    while (waiting and not lost) or running:
        while waiting and not lost and len(running) < jobs:
            task = waiting.popleft()
            try:
                running[pool.submit(plan_part, *task)] = task
            except BrokenProcessPool:
                lost.append(task)
        for future in _first(running):
            task = running.pop(future)
            if isinstance(future.exception(), BrokenProcessPool):
                lost.append(task)
            else:
                yield _result(task, future)
    return lost


def _first(running: dict[Future[PartResult], Task]) -> list[Future[PartResult]]:
    """Wait; return what is done, in the order in which it was begun."""
    done, _ = wait(running, return_when=FIRST_COMPLETED)
    return [future for future in running if future in done]


def _result(task: Task, future: Future[PartResult]) -> PartResult:
    try:
        return future.result()
    except BrokenProcessPool:
        return task.failed(
            "the process that planned it died: it crashed, or was ended for its memory"
        )
    except Exception as error:
        # one part, or a result that cannot be unpickled, must not end the batch
        return task.failed(reason_of(error))


@contextmanager
def _pool(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Provide processes; where the work is interrupted they are ended at once, for what they know is on the disk."""
    pool = ProcessPoolExecutor(
        jobs, initializer=leave_signals_to_the_parent, initargs=(os.getpid(),)
    )
    try:
        yield pool
    except BaseException:
        # after an interruption, too, no process may stay. Python before 3.14 has no public way
        for process in list((getattr(pool, "_processes", None) or {}).values()):
            process.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
