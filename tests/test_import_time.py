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


@pytest.mark.parametrize(
    "arguments",
    [
        ["--help"],
        ["plan", "--help"],
        ["cameras"],
        ["cameras", "--sources"],
        ["completion", "bash"],
        ["plan", "part.step", "--nonsense"],
        ["plan", "--entities", "1", "--camera", "nobody", "--out", "plan"],
        ["info", "nowhere.step"],
        ["simulate", "plan.json", "--poses", "0"],
    ],
)
def test_what_needs_no_part_loads_nothing_heavy(arguments):
    code = (
        "import sys; from planner.app.main import main\n"
        f"try:\n    main({arguments!r})\nexcept SystemExit:\n    pass\n"
        f"print('loaded', *sorted(set(sys.modules) & {{*{HEAVY!r}, 'aspectgraph.solid'}}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "loaded"
