"""What tests need where loops run uncompiled (NUMBA_DISABLE_JIT=1), or where lines are counted by coverage."""

import os
import subprocess
from contextlib import suppress

import numba
import numpy as np
import pytest

from planner import progress
from planner.executors import usable_cores

# a slow machine must not add lines to what commands print: their tests compare it
progress._FIRST_WORD_S = 1e6

# a parallel run sets it, and what commands print would be broken at this width
os.environ.pop("COLUMNS", None)

# one core for each worker: plans then start no processes of their own, which would only wait for each other
# what needs more is marked `all_cores`
ALL_CORES = usable_cores()
_worker = os.environ.get("PYTEST_XDIST_WORKER")
_cores = sorted(os.sched_getaffinity(0)) if _worker and hasattr(os, "sched_setaffinity") else []
_own_core = _cores[int(_worker.removeprefix("gw")) % len(_cores)] if _cores else None
if _cores:
    os.sched_setaffinity(0, {_own_core})

# in this order they come first: a file of long tests that begins last would leave the other workers without work
LONG_FILES = (
    "notebooks/robot_cell.ipynb",
    "notebooks/cluster.ipynb",
    "notebooks/showing.ipynb",
    "notebooks/measuring.ipynb",
    "notebooks/comparisons.ipynb",
    "notebooks/dimensions.ipynb",
    "tests/test_docs_run.py",
    "tests/aspectgraph/graph/test_invariance.py",
    "tests/planner/app/test_main.py",
    "tests/planner/test_resume.py",
    "tests/planner/bound/test_lower_bound.py",
    "tests/planner/test_inspection.py",
    "tests/planner/app/test_plan_commands.py",
    "tests/test_edge_contrast.py",
    "tests/errors/test_joint.py",
    "tests/planner/bound/boxes/test_windows.py",
    "tests/aspectgraph/visibility/test_visibility_regions.py",
    "tests/test_docstrings.py",
    "tests/test_readme.py",
    "tests/planner/bound/test_dual_bound.py",
    "tests/planner/search/test_plan_setting.py",
    "tests/ground/test_linked.py",
    "tests/ground/test_decorators.py",
)


def pytest_collection_modifyitems(items):
    """Begin with the files of long tests; the order within a file, and of the others, stays."""
    rank = {name: k for k, name in enumerate(LONG_FILES)}
    items.sort(key=lambda item: rank.get(item.nodeid.partition("::")[0], len(rank)))


if numba.config.DISABLE_JIT:
    from wide_integers import stand_in

    stand_in()
    # compiled loops divide by zero and overflow in silence
    np.seterr(all="ignore")

if "COVERAGE_PROCESS_CONFIG" in os.environ:
    from aspectgraph.read.step.step_file import StepKernel

    _killed = StepKernel.__exit__

    def _ended(self, *error):
        """Let a process that reads STEP end by itself: one that is killed cannot tell which lines it ran."""
        with suppress(OSError, subprocess.TimeoutExpired):
            self._requests.close()
            self.process.wait(60)
        _killed(self, *error)

    StepKernel.__exit__ = _ended

# after what coverage needs
from step_kernels import remember  # noqa: E402

from planner.search import realise_column  # noqa: E402
from planner.verify.joint_counts import JOINT_POSES  # noqa: E402

# what small plans state of probabilities is counted over this many displaced poses: bounds are a little lower, and
# 20 times as many take a third of the time of a plan; `stated_in_full` counts as users have it
STATED_POSES = realise_column._STATED_POSES
realise_column._STATED_POSES = JOINT_POSES


@pytest.fixture(scope="module")
def stated_in_full():
    """Count what plans of a module state over as many displaced poses as for users."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(realise_column, "_STATED_POSES", STATED_POSES)
        yield


OF_THE_KERNEL = "tests/aspectgraph/read/"


def pytest_runtest_setup(item):
    """Let tests of the STEP kernel's process start one, and others use what it told an earlier test."""
    remember(not item.nodeid.startswith(OF_THE_KERNEL))
    if item.get_closest_marker("all_cores"):
        if ALL_CORES < 2:
            pytest.skip("needs two cores")
        if _cores:
            os.sched_setaffinity(0, _cores)


def pytest_runtest_teardown(item):
    """Give a worker its one core again."""
    if _cores and item.get_closest_marker("all_cores"):
        os.sched_setaffinity(0, {_own_core})
