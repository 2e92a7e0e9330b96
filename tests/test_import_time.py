"""What it costs to import the public names: a camera does not wait for the compiler or a ray caster."""

import subprocess
import sys

import pytest

HEAVY = ("numba", "open3d", "plotly", "scipy", "OCP")


@pytest.mark.parametrize(
    "name",
    [
        "Camera",
        "PoseUncertainty",
        "look_at",
        "camera_names",
        "RequestError",
        "InspectionPlan",
        "Effort",
    ],
)
def test_light_names_load_nothing_heavy(name):
    """In a process of its own, as this one has loaded everything."""
    code = (
        f"import sys; from planner import {name}; print(*sorted(set(sys.modules) & {set(HEAVY)!r}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
