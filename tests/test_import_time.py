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


def test_what_a_mesh_consists_of_is_told_without_compiler_and_search():
    code = (
        "import sys; from planner.app.main import main\n"
        "assert main(['info', 'examples/two_pocket_block.off', '--json']) == 0\n"
        "heavy = {'numba', 'open3d', 'plotly', 'OCP', 'networkx', 'scipy.optimize', 'scipy.stats', 'planner.search'}\n"
        "print('loaded', *sorted(set(sys.modules) & heavy))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "loaded"


def test_rays_need_no_web_server_and_whoever_wants_one_has_it():
    code = (
        "import sys; from aspectgraph.solid.solid import RayScene\n"
        "RayScene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])\n"
        "assert 'dash' not in sys.modules\n"
        "from open3d.visualization import draw_plotly\n"
        "shown = draw_plotly.__globals__['Dash']('window').layout, draw_plotly.__globals__['html'].H3('window')\n"
        "import dash\n"
        "assert isinstance(shown[1], dash.html.H3)\n"
        "print('version', dash.__version__)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1].startswith("version ")
