"""`--json` and `--quiet` of every command: what a program reads is JSON and nothing else."""

from __future__ import annotations

import json
import math
from pathlib import Path

import networkx as nx
import pytest
from plan_examples import plan

from planner import Camera
from planner.app.main import main
from planner.app.process import DONE, INCOMPLETE
from planner.plan import InspectionPlan, read_plan
from planner.verify.simulate_plan import SimulationResult

BLOCK = str(Path(__file__).parents[3] / "examples" / "two_pocket_block.off")


@pytest.fixture
def record(capsys):
    """Run a command quietly and return its exit code and what it says."""

    def run(*arguments):
        code = main([*arguments, "--json", "--quiet"])
        out, err = capsys.readouterr()
        assert err == ""
        return code, json.loads(out)

    return run


def test_a_part(record):
    code, found = record("info", BLOCK, "--select", "face = bottom")
    assert code == DONE
    # the block stands on a square of 60 mm
    assert [edge["length"] for edge in found["edges"]] == [60.0] * 4
    assert found["bounds"] == [[0.0, 0.0, 0.0], [60.0, 60.0, 40.0]]
    assert found["curves"] == []
    assert found["notes"] == [
        "OFF files state no unit, so the program assumes mm. Use --units for another unit"
    ]
    assert record("info", BLOCK, "--units", "mm")[1]["notes"] == []


def test_a_graph(record, tmp_path):
    path = tmp_path / "g.graphml"
    code, found = record("graph", BLOCK, "--entities", "0,1", "--graphml", str(path))
    assert code == DONE
    graph = nx.read_graphml(path)
    assert len(found["domains"]) == len(graph)
    assert len(found["adjacent"]) == graph.number_of_edges()
    assert {name for domain in found["domains"] for name in domain["observable"]} == {"e0", "e1"}
    assert found["file"] == str(path)


def test_a_plan_and_its_simulation(record, tmp_path):
    camera = ["--camera", "basler-acA2440-20gm-8mm", "--sigma-mm", "0.05", "--sigma-rad", "0.001"]
    limits = ["--min-length-px", "30", "--focus-margin-mm", "0.2", "--visibility-radius-mm", "0.1"]
    out = str(tmp_path / "out")
    wanted = ["--select", "face = top and length > 59"]
    code, found = record(
        "plan",
        BLOCK,
        *wanted,
        *camera,
        *limits,
        "--effort",
        "quick",
        "--jobs",
        "1",
        "--simulate",
        "200",
        "--out",
        out,
    )
    assert code in (DONE, INCOMPLETE)
    stored = read_plan(tmp_path / "out" / "plan.json")
    assert InspectionPlan.from_dict(found["plan"]) == stored
    assert {name: stored.requirements[name] for name in ("min_length_px", "focus_margin_mm")} == {
        "min_length_px": 30.0,
        "focus_margin_mm": 0.2,
    }
    # what is asked for holds: margins of focus are what is left beyond the reserve
    assert all(setting.margins["focus_mm"] >= 0 for setting in stored.settings)
    assert found["files"][0].endswith("plan.json")
    assert found["not_planned"] == {}


def test_a_simulation(record, tmp_path):
    plan().write(tmp_path / "plan.json")
    _, found = record("simulate", str(tmp_path / "plan.json"), "--poses", "50")
    assert SimulationResult.from_dict(found).n == 50


def test_graph_and_plan_have_one_workspace_if_the_camera_is_told(record, tmp_path, capsys):
    name = "basler-acA2440-20gm-8mm"
    path = str(tmp_path / "g.graphml")
    _, found = record("graph", BLOCK, "--entities", "0", "--graphml", path, "--camera", name)
    # as far as the lens focuses in the image's corners: the depth of field's far limit, along the corner's ray
    camera = Camera.named(name)
    half_diagonal = math.hypot(*camera.sensor_size_mm) / 2
    room = camera.depth_of_field_mm[1] * math.hypot(1, half_diagonal / camera.image_distance_mm)
    expected = [[-room, -room, -room], [60 + room, 60 + room, 40 + room]]
    assert found["workspace"] == [pytest.approx(corner) for corner in expected]
    own = ["--workspace", "-100", "-100", "-100", "200", "200", "200"]
    _, found = record("graph", BLOCK, "--entities", "0", "--graphml", path, "--camera", name, *own)
    assert found["workspace"] == [[-100.0] * 3, [200.0] * 3]
    assert main(["graph", BLOCK, "--entities", "0", "--graphml", path, *own]) == DONE
    assert (
        "workspace: -100.00 -100.00 -100.00 to 200.00 200.00 200.00 mm" in capsys.readouterr().out
    )
