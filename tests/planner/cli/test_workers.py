"""Worker processes of the command line: no more than cores, and none that outlives its parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from planner.app import plan_commands as commands
from planner.executors import usable_cores

_PARENT = """
import os, sys, time
from planner.app import plan_commands as commands
with commands._executor(2) as executor:
    futures = [executor.submit(os.getpid) for _ in range(8)]
    print(*{future.result() for future in futures}, flush=True)
    time.sleep(60)
"""


def _is_running(pid):
    try:
        with open(f"/proc/{pid}/stat") as stat:
            # a zombie waits for init only
            return stat.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(
    sys.platform != "linux" or usable_cores() < 2, reason="workers of Linux, and two of them"
)
def test_no_worker_outlives_a_parent_that_is_killed():
    parent = subprocess.Popen([sys.executable, "-c", _PARENT], stdout=subprocess.PIPE, text=True)
    workers = [int(pid) for pid in parent.stdout.readline().split()]
    assert workers
    assert all(_is_running(pid) for pid in workers)
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    for _ in range(100):
        if not any(_is_running(pid) for pid in workers):
            return
        time.sleep(0.05)
    pytest.fail("workers are still running five seconds later")


def test_there_are_no_more_workers_than_cores(monkeypatch):
    asked = []

    class Pool:
        def __init__(self, jobs, **_):
            asked.append(jobs)

        def shutdown(self, **_):
            pass

    monkeypatch.setattr("planner.app.batch.ProcessPoolExecutor", Pool)
    monkeypatch.setattr(commands, "usable_cores", lambda: 3)
    with commands._executor(200):
        pass
    assert asked == [3]
