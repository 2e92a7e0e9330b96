"""One process writes to a folder at a time; one that was killed blocks nobody."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from aspectgraph import compute_regions, read_solid, resolve_entities
from planner import read_plan
from planner.exceptions import OutputError
from planner.report import plan_folder
from planner.report import plan_folder as module
from planner.report.plan_folder import (
    FEW_GRAPH_ENTITIES,
    LOCK_FILE,
    LockOwner,
    _joint_graph,
    folder_lock,
)
from planner.request.reach import TargetSpace

_HOLDER = """
import os, sys, time
from pathlib import Path
# on a busy machine the parent may be killed before its worker has closed the lock
os.register_at_fork(after_in_child=lambda: time.sleep(0.3))
from planner.report.plan_folder import folder_lock
with folder_lock(Path(sys.argv[1])):
    if sys.argv[2] == "fork":
        child = os.fork()
        if child == 0:
            time.sleep(60)
            os._exit(0)
        print(child, flush=True)
    print("held", flush=True)
    time.sleep(60)
"""


def holder(folder, kind="alone"):
    """Start a process that holds the folder; return it and the lines it printed."""
    process = subprocess.Popen(
        [sys.executable, "-c", _HOLDER, str(folder), kind], stdout=subprocess.PIPE, text=True
    )
    lines = [process.stdout.readline().strip()]
    while lines[-1] != "held":
        lines.append(process.stdout.readline().strip())
    return process, lines


def killed(process):
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    process.stdout.close()


def refusal(folder):
    with pytest.raises(OutputError) as caught, folder_lock(folder, "--out"):
        pytest.fail("two processes hold the folder")
    return str(caught.value)


def test_the_second_is_told_who_has_the_folder_and_since_when(tmp_path):
    process, _ = holder(tmp_path)
    message = refusal(tmp_path)
    killed(process)
    assert message.startswith(
        f"--out must be a folder that no other process writes to. Got {tmp_path}, in use by "
        f"process {process.pid} on {socket.gethostname()} for "
    )
    assert message.count("\n") == 0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forked workers here")
def test_a_killed_process_blocks_nobody_even_if_its_worker_still_runs(tmp_path):
    process, lines = holder(tmp_path, "fork")
    killed(process)
    try:
        assert (tmp_path / LOCK_FILE).exists()
        with folder_lock(tmp_path):
            owner = json.loads((tmp_path / LOCK_FILE).read_text())
            assert owner["pid"] == os.getpid()
        assert list(tmp_path.iterdir()) == []
    finally:
        os.kill(int(lines[0]), signal.SIGKILL)


def test_a_lock_is_free_after_the_block_whatever_happened_in_it(tmp_path):
    def interrupted():
        with folder_lock(tmp_path):
            assert "in use by process" in refusal(tmp_path)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with folder_lock(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def owned_by(folder, **change):
    record = {"pid": 1, "host": socket.gethostname(), "started": "", "since": time.time() - 7300}
    (folder / LOCK_FILE).write_text(json.dumps({**record, **change}))


@pytest.fixture
def no_locks(monkeypatch):
    """Make the file system one without locks."""

    def fail(*arguments):
        raise OSError(37, "No locks available")

    monkeypatch.setattr(module.fcntl, "flock", fail)


def test_a_file_system_without_locks_goes_by_the_record(tmp_path, no_locks):
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    owned_by(tmp_path, pid=process.pid)
    with folder_lock(tmp_path):
        assert "in use by process" in refusal(tmp_path)
    parent = os.getppid()
    started = module._start_of(parent)
    owned_by(tmp_path, pid=parent, started=started)
    assert f"process {parent} on {socket.gethostname()} for 2 h" in refusal(tmp_path)
    owned_by(tmp_path, host="another-host")
    assert refusal(tmp_path).endswith(f"If that process has ended, delete {tmp_path / LOCK_FILE}.")
    # a record that is half written is of nobody
    (tmp_path / LOCK_FILE).write_text('{"pid": 1')
    with folder_lock(tmp_path):
        pass


@pytest.mark.skipif(sys.platform != "linux", reason="start times of processes are Linux's")
def test_a_process_that_got_the_id_of_a_dead_one_is_not_taken_for_it(tmp_path, no_locks):
    assert module._start_of(os.getppid())
    owned_by(tmp_path, pid=os.getppid(), started="1")
    with folder_lock(tmp_path):
        pass


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path, monkeypatch):
    def fail(*arguments, **options):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(module.os, "open", fail)
    assert refusal(tmp_path) == (
        f"--out must be a folder that can be written. Got {tmp_path}: Read-only file system."
    )


def test_a_link_in_the_place_of_the_lock_is_not_written_through(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "out" / LOCK_FILE).symlink_to(tmp_path / "mine")
    assert "must be a folder that can be written" in refusal(tmp_path / "out")
    assert (tmp_path / "mine").read_text() == "mine"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(3, "3 s"), (119, "119 s"), (120, "2 min"), (7200, "2 h"), (200_000, "2 days"), (-5, "0 s")],
)
def test_ages_are_said_in_a_unit_that_suits(seconds, text):
    assert str(LockOwner(1, "h", "", time.time() - seconds - 0.01)).endswith(f" for {text}")


def test_only_the_name_of_the_lock_is_left_behind(tmp_path):
    """A process that waits for the file of the owner before, holds nothing that has a name."""
    with folder_lock(tmp_path):
        (tmp_path / LOCK_FILE).rename(tmp_path / "moved")
        with folder_lock(tmp_path):
            assert Path(tmp_path / LOCK_FILE).exists()
    assert [path.name for path in tmp_path.iterdir()] == ["moved"]


# The joint graph beside a plan: where it can be afforded, and what is said where it cannot.


@pytest.fixture(scope="module")
def regions():
    solid = read_solid("examples/two_pocket_block.off")
    entities = resolve_entities(solid, {f"e{k}": k for k in range(FEW_GRAPH_ENTITIES + 2)})
    return compute_regions(solid, entities)


def test_of_many_entities_it_is_there_where_it_can_be_afforded(regions):
    graph, notes = _joint_graph(regions, None)
    assert graph.entity_names == regions.entity_names
    assert notes == []


def test_else_the_regions_are_summed_up(regions, monkeypatch):
    monkeypatch.setattr(plan_folder, "AFFORDABLE_BYTES", 1)
    graph, notes = _joint_graph(regions, None)
    assert graph is None
    assert "--graph-limit 26 builds it anyway" in notes[0]
    low, high = regions.workspace
    # drawn with another seed: a share of 10,000 is known to 1.5 %, three standard deviations
    seen = regions.observable(np.random.default_rng(1).uniform(low, high, (10_000, 3)))
    numbers = [float(one) / 100 for one in re.findall(r"([\d.]+) %", notes[1])]
    shares = seen.mean(axis=0)
    assert numbers == pytest.approx([shares.min(), shares.max(), shares.mean()], abs=0.02)
    assert f"more than {seen.sum(axis=1).max()} of the 26 entities." in notes[1]


def test_a_limit_that_is_given_is_kept(regions):
    graph, notes = _joint_graph(regions, 25)
    assert graph is None
    assert "--graph-limit is 25, and the plan has" in notes[0]


def test_a_deadline_ends_it_between_two_entities(regions, monkeypatch):
    """The clock goes on by a second with every look, which is one for every entity."""
    seconds = iter(range(1000))
    monkeypatch.setattr(plan_folder.time, "time", lambda: float(next(seconds)))
    seen = []
    ended = plan_folder._ended_at(3.0, lambda done, total, label: seen.append(done))
    graph, notes = _joint_graph(regions, None, ended)
    assert graph is None
    assert notes == ["graph.graphml was not written: the time limit ended before it was complete."]
    assert 1 < len(seen) < len(regions.entity_names)


def test_a_report_of_targets_whose_regions_were_late(regions):
    """The report shows what is known; the other targets are in its list with their reason."""
    plan = read_plan("examples/two_pocket_block_plan.json")
    names = list(plan.entities)
    solid = read_solid("examples/two_pocket_block.off")
    known = compute_regions(solid, {names[0]: plan.entities[names[0]]}, workspace=plan.workspace)
    space = TargetSpace.of_plan(known, plan)
    assert list(space.entity_names) == names[:1]
