"""The command line end to end on a small block; every error is one line, and nothing half-written stays behind."""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import warnings
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import networkx as nx
import pytest
from plan_examples import plan

from planner import Camera
from planner.app import plan_commands as commands
from planner.app.main import main
from planner.app.plan_commands import REGIONS_FOLDER
from planner.app.process import BAD_INPUT, DONE, INCOMPLETE, INTERNAL
from planner.exceptions import OutputError
from planner.plan import InspectionPlan, read_plan
from planner.resume import PlanningState
from planner.sensor_setting import Outcome
from planner.verify.simulate_plan import SimulationResult

BLOCK = """OFF
8 6 12
0 0 0
80 0 0
80 50 0
0 50 0
0 0 40
80 0 40
80 50 40
0 50 40
4 0 3 2 1
4 4 5 6 7
4 0 1 5 4
4 2 3 7 6
4 1 2 6 5
4 0 4 7 3
"""
ENTITIES = """
rim = [[0, 0, 40], [80, 0, 40]]
"far rim" = [[0, 50, 40], [80, 50, 40]]
bottom = [[0, 0, 0], [0, 50, 0]]
"bottom right" = [[80, 0, 0], [80, 50, 0]]
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # plans of the same request are then the same, byte for byte
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    (tmp_path / "block.off").write_text(BLOCK)
    (tmp_path / "edges.toml").write_text(ENTITIES)
    return tmp_path


@pytest.fixture
def quick(monkeypatch):
    """Search little where no effort is asked for."""
    from planner.effort import Effort

    effort = Effort(
        viewpoints=20, pricing_rounds=5, refutations=1, bound_nodes=3000, margin_generations=3
    )
    monkeypatch.setattr("planner.resolve_request.Effort", lambda: effort)


PLAN = [
    "plan",
    "block.off",
    "--entities",
    "edges.toml",
    "--camera",
    "basler-acA2440-20gm-8mm",
    "--out",
    "out",
]


def failure(capsys, arguments, code=BAD_INPUT):
    assert main(arguments) == code
    out, err = capsys.readouterr()
    lines = err.splitlines()
    assert "Traceback" not in err
    assert out == ""
    assert lines[-1].startswith("aspectgraph")
    return lines


def test_info_lists_the_edges(folder, capsys):
    assert main(["info", "block.off"]) == DONE
    out = capsys.readouterr().out
    assert "6 faces, 12 edges, 12 sharp straight edges, 80.00 x 50.00 x 40.00 mm" in out
    assert "80.000" in out


def test_info_counts_the_faces_of_a_cad_model(capsys):
    """Counted in the file: 117 faces, of which curved ones become facets; a mesh has no such model."""
    part = "examples/nist_ctc_01_ap242.stp"
    assert main(["info", part]) == DONE
    assert ": 1 shell, 117 CAD faces, 462 facets, 1110 edges " in capsys.readouterr().out
    assert main(["info", part, "--json"]) == DONE
    assert json.loads(capsys.readouterr().out)["cad_faces"] == 117
    assert main(["info", "examples/two_pocket_block.off", "--json"]) == DONE
    assert json.loads(capsys.readouterr().out)["cad_faces"] is None


def test_info_of_a_planar_model_counts_its_faces_once(capsys):
    assert main(["info", "examples/mfcad_6-11-11-19.step"]) == DONE
    assert " CAD face" not in capsys.readouterr().out.splitlines()[0]


def test_info_draws(folder, capsys):
    assert main(["info", "block.off", "--picture", "edges.html"]) == DONE
    assert capsys.readouterr().out.splitlines()[-1] == "edges.html"
    assert "Save TOML" in (folder / "edges.html").read_text(encoding="utf-8")


def test_graph_is_written(folder, capsys):
    assert (
        main(["graph", "block.off", "--entities", "edges.toml", "--graphml", "g.graphml"]) == DONE
    )
    captured = capsys.readouterr()
    assert "viewing domains" in captured.out
    assert "visible regions: 4/4" in captured.err
    # before it is built
    assert "joint graph of 4 entities: about 10 s and less than 0.5 GiB" in captured.err
    assert captured.err.index("about 10 s") < captured.err.index("joint graph: 4/4")
    graph = nx.read_graphml(folder / "g.graphml")
    assert len(graph) > 3


def test_a_graph_beyond_the_memory_limit_is_one_line(folder, capsys):
    arguments = [
        "graph",
        "block.off",
        "--entities",
        "edges.toml",
        "--graphml",
        "g.graphml",
        "--quiet",
    ]
    assert main([*arguments, "--memory-limit", "1e-9"]) == BAD_INPUT
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "the joint graph of 4 entities must fit --memory-limit" in err
    assert err.endswith(". Choose fewer entities: a plan needs no joint graph.\n")
    assert not (folder / "g.graphml").exists()


@pytest.mark.all_cores
def test_plan_leaves_all_its_files_and_repeats(folder, quick, capsys):
    """With two processes and with one."""
    assert main([*PLAN, "--simulate", "500", "--operator", "A. Meyer", "--jobs", "2"]) == DONE
    captured = capsys.readouterr()
    assert "4 of 4 entities inspected from 2 settings, proven to be the fewest." in captured.out
    assert "genetic algorithm" not in captured.out
    assert "lower bound" in captured.err
    written = {
        str(p.relative_to(folder / "out")) for p in (folder / "out").rglob("*") if p.is_file()
    }
    assert written == {
        "plan.json", "graph.graphml", "report.html", "measurements.csv", "poses_opencv.json", "poses_open3d.json",
        "poses_ros.yaml", "camera_ros.yaml", "transforms.json",
        "colmap/cameras.txt", "colmap/images.txt", "colmap/points3D.txt",
    }  # fmt: skip
    assert captured.out.splitlines()[-1] == "12 files in out/; open out/report.html"
    first = (folder / "out" / "plan.json").read_bytes()
    made = json.loads(first)["made"]
    assert (made["date"], made["operator"]) == ("1970-01-02T00:00:00Z", "A. Meyer")
    digest = hashlib.sha256((folder / PLAN[1]).read_bytes()).hexdigest()
    assert made["part_file_sha256"] == digest
    assert "A. Meyer" in (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert (folder / "out" / "measurements.csv").read_bytes().decode() == read_plan(
        folder / "out/plan.json"
    ).to_csv()
    assert main([*PLAN, "--simulate", "500", "--operator", "A. Meyer", "--jobs", "1"]) == DONE
    assert (folder / "out" / "plan.json").read_bytes() == first

    capsys.readouterr()
    assert main(["simulate", "out/plan.json", "--poses", "2000"]) == DONE
    out = capsys.readouterr().out
    assert "far rim" in out
    assert "confirms the plan" in out


def test_simulating_with_the_part_counts_the_images_that_show_the_edges(folder, quick, capsys):
    assert main([*PLAN, "--simulate", "100", "--explain"]) == DONE
    told = " ".join(capsys.readouterr().out.split())
    assert "the image conditions from each of the 100 displaced poses per setting" in told
    assert (
        main(["simulate", "out/plan.json", "--poses", "100", "--part", PLAN[1], "--json"]) == DONE
    )
    shown = json.loads(capsys.readouterr().out)["shown"]
    assert shown == json.loads((folder / "out" / "plan.json").read_text())["simulation"]["shown"]
    assert shown["n"] == 100
    assert main(["simulate", "out/plan.json", "--poses", "100", "--json"]) == DONE
    assert json.loads(capsys.readouterr().out)["shown"] is None


def test_no_displaced_pose_means_no_simulation(folder, quick, capsys):
    """A complete plan is then done, though no simulation confirms it."""
    assert main([*PLAN, "--simulate", "0"]) == DONE
    assert "Not simulated." in capsys.readouterr().out
    assert read_plan(folder / "out" / "plan.json").simulation is None
    assert main([*PLAN[:-1], "far", "--simulate", "0", "--stand-off", "450"]) == INCOMPLETE


def test_interrupted_plan_can_be_resumed(folder, quick, capsys, monkeypatch):
    assert main([*PLAN, "--simulate", "100"]) == DONE
    expected = (folder / "out" / "plan.json").read_bytes()
    capsys.readouterr()

    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    arguments = [*PLAN[:-1], "other", "--simulate", "100"]
    with monkeypatch.context() as patch:
        patch.setattr("planner.search.stages.assembled", interrupt)
        assert main(arguments) == INCOMPLETE
    out, err = capsys.readouterr()
    assert "Planning stopped early. A longer run may" in " ".join(out.split())
    assert "The same command with --resume continues from here." in out
    # it was no limit that ended it
    assert "ended the planning" not in out
    lines = err.splitlines()
    assert lines[-1] == "aspectgraph: interrupted; 'plan' with --resume continues from here"
    best = read_plan(folder / "other" / "plan.json")
    assert best.unfinished
    assert best.complete
    assert commands.STATE_FILE in os.listdir(folder / "other")
    with monkeypatch.context() as patch:
        patch.setattr("planner.search.incumbents.realise", interrupt)
        patch.setattr("planner.search.stages.lower_bound", interrupt)
        assert main([*arguments, "--resume"]) == DONE
    assert (folder / "other" / "plan.json").read_bytes() == expected
    assert commands.STATE_FILE not in os.listdir(folder / "other")


def test_a_request_to_terminate_keeps_the_state_too(folder, quick, capsys, monkeypatch):
    monkeypatch.setattr(
        "planner.search.stages.assembled", lambda *a, **k: os.kill(os.getpid(), signal.SIGTERM)
    )
    before = signal.getsignal(signal.SIGTERM)
    assert main(PLAN) == INCOMPLETE
    assert (
        capsys.readouterr()
        .err.splitlines()[-1]
        .endswith("interrupted; 'plan' with --resume continues from here")
    )
    assert read_plan(folder / "out" / "plan.json").unfinished
    assert commands.STATE_FILE in os.listdir(folder / "out")
    assert signal.getsignal(signal.SIGTERM) == before


def interrupt(*arguments, **options):
    raise KeyboardInterrupt


def test_resuming_is_not_offered_where_nothing_is_kept(folder, quick, capsys, monkeypatch):
    monkeypatch.setattr("planner.app.batch.visible_regions", interrupt)
    assert failure(capsys, [*PLAN, "--jobs", "1"], INCOMPLETE)[-1] == "aspectgraph: interrupted"
    assert not (folder / "out").exists()


def test_visible_regions_are_kept_before_there_is_a_state(folder, quick, capsys, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("planner.search.incumbents.first_poses", interrupt)
        last = failure(capsys, [*PLAN, "--jobs", "1"], INCOMPLETE)[-1]
    assert last.endswith("interrupted; 'plan' with --resume continues from here")
    assert os.listdir(folder / "out") == [REGIONS_FOLDER]
    with monkeypatch.context() as patch:
        patch.setattr("aspectgraph.visibility.visibility_regions.observable_region", interrupt)
        assert main([*PLAN, "--jobs", "1", "--resume"]) == DONE
    assert REGIONS_FOLDER not in os.listdir(folder / "out")
    # with --force they are forgotten
    with monkeypatch.context() as patch:
        patch.setattr("planner.search.incumbents.first_poses", interrupt)
        assert main([*PLAN, "--jobs", "1", "--force"]) == INCOMPLETE
        patch.setattr("aspectgraph.visibility.visibility_regions.observable_region", interrupt)
        assert main([*PLAN, "--jobs", "1", "--force"]) == INCOMPLETE
    assert REGIONS_FOLDER not in os.listdir(folder / "out")


def test_resuming_nothing_is_said(folder, quick, capsys):
    assert main([*PLAN, "--simulate", "100", "--resume"]) == DONE
    assert "nothing to resume in" in capsys.readouterr().err


def test_a_plan_that_cannot_be_written_is_kept_and_resumed_without_planning(
    folder, quick, capsys, monkeypatch
):
    plan = [*PLAN, "--simulate", "100"]
    assert main(plan) == DONE
    first = {path: path.read_bytes() for path in (folder / "out").rglob("*") if path.is_file()}
    capsys.readouterr()

    def full(*arguments, **options):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("planner.report.plan_folder.write_poses", full)
        lines = failure(capsys, [*plan, "--seed", "1", "--force"])
    state = folder / "out" / commands.STATE_FILE
    assert lines[-1].endswith(
        f"--out must be a folder that can be written. Got out: No space left on device. "
        f"The plan is saved in {state}. The same command with --resume writes it without planning again."
    )
    assert {path: path.read_bytes() for path in first} == first
    with monkeypatch.context() as patch:
        patch.setattr("planner.search.stages.judged_poses", full)
        patch.setattr("planner.search.incumbents.realise", full)
        assert main([*plan, "--seed", "1", "--resume", "--force"]) == DONE
    assert read_plan(folder / "out" / "plan.json").seed == 1
    assert not state.exists()


def test_a_plan_that_can_be_kept_nowhere_in_its_folder_is_elsewhere(
    folder, quick, capsys, monkeypatch
):
    saves = []

    def full(path, text):
        saves.append(path)
        if len(saves) > 1:
            raise OutputError("disk full")

    def unwritable(*arguments, **options):
        raise OutputError("disk full")

    (folder / "tmp").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder / "tmp"))
    monkeypatch.setattr("planner.resume.write_text", full)
    monkeypatch.setattr("planner.app.batch.write_outputs", unwritable)
    last = failure(capsys, [*PLAN, "--simulate", "100"])[-1]
    place = next((folder / "tmp").glob("aspectgraph-*/plan.json"))
    assert last == f"aspectgraph: disk full The plan is in {place} instead."
    assert read_plan(place).simulation.confirmed


def test_the_state_stays_until_everything_is_written(folder, quick, monkeypatch):
    def broken(*arguments, **options):
        raise RuntimeError("bug")

    for name in (
        "planner.report.plan_folder.make_report",
        "planner.report.plan_folder.write_graphml",
        "planner.verify.simulate_plan.simulate_setting",
    ):
        with monkeypatch.context() as patch:
            module, _, function = name.rpartition(".")
            patch.setattr(import_module(module), function, broken)
            assert main([*PLAN, "--simulate", "100", "--resume"]) == INTERNAL
        names = os.listdir(folder / "out")
        assert {REGIONS_FOLDER, commands.STATE_FILE} <= set(names)
        # the plan and its report are there before the graph
        written = {"plan.json", "report.html"}.intersection(names)
        assert len(written) == (2 if function == "write_graphml" else 0)
        for path in (folder / "out").iterdir():
            if path.is_dir() and path.name != REGIONS_FOLDER:
                shutil.rmtree(path)
            elif path.is_file() and path.name != commands.STATE_FILE:
                path.unlink()


def test_an_older_graph_does_not_stay_beside_a_new_plan(folder, quick):
    assert main([*PLAN, "--simulate", "100"]) == DONE
    (folder / "out" / "photo.png").write_text("mine")
    assert (
        main([*PLAN, "--graph-limit", "3", "--simulate", "100", "--seed", "1", "--force"]) == DONE
    )
    names = os.listdir(folder / "out")
    assert "graph.graphml" not in names
    assert {"plan.json", "report.html", "photo.png"} < set(names)


def test_incomplete_plan_is_written_and_told(folder, quick, capsys):
    # farther from the part than the lens can focus
    assert main([*PLAN, "--simulate", "100", "--stand-off", "450"]) == INCOMPLETE
    out = capsys.readouterr().out
    assert (
        "not inspected: rim: no feasible view: no tried pose meets all constraints for rim" in out
    )
    # another lens may focus at that distance
    assert "'aspectgraph optics' with the part and its targets ranks" in out
    assert set(read_plan(folder / "out" / "plan.json").uninspectable) == {
        "rim",
        "far rim",
        "bottom",
        "bottom right",
    }
    assert main(["simulate", "out/plan.json"]) == INCOMPLETE


BAD = {
    "no command": ([], "COMMAND must be given"),
    "unknown command": (["fly"], "unknown command 'fly'; see aspectgraph --help"),
    "unknown option": (
        ["info", "block.off", "--colour"],
        "unknown option --colour; see aspectgraph info",
    ),
    "missing option": (["plan", "block.off", "--all", "--out", "out"], "--camera must be given"),
    "two kinds of entities": (
        ["plan", "block.off", "--all", "--entities", "1", "--out", "o"],
        "must not be given with",
    ),
    "not a number": ([*PLAN, "--accuracy", "high"], "--accuracy must be a number like 0.98, or a"),
    "accuracy": ([*PLAN, "--accuracy", "1.2"], "accuracy must be in (0, 1). Got 1.2."),
    "probability": ([*PLAN, "--probability", "0"], "probability must be in (0, 1). Got 0.0."),
    "seed": ([*PLAN, "--seed", "-1"], "--seed must be at least 0. Got -1."),
    "sigma": ([*PLAN, "--sigma-rad", "3rad"], "at most 0.1 rad"),
    "sigma in which unit": (
        [*PLAN, "--sigma-rad", "1"],
        "57.3° in rad; did you mean 1mrad or 1deg?",
    ),
    "no part": (["info", "nothing.step"], "nothing.step"),
    "wrong format": (["info", "edges.toml"], "edges.toml"),
    "no camera": (
        [*PLAN[:4], "--camera", "basler-acA2440-20gm-9mm", "--out", "o"],
        "nearest: basler-acA2440-20gm-",
    ),
    "no camera file": (
        [*PLAN[:4], "--camera", "nothing.toml", "--out", "o"],
        "nothing.toml: camera file cannot be read",
    ),
    "unknown edge": (["graph", "block.off", "--entities", "99", "--graphml", "g.graphml"], "99"),
    "no folder": (
        ["graph", "block.off", "--entities", "1", "--graphml", "no/g.graphml"],
        "--graphml must be in a folder that exists and can be written. Got 'no/g.graphml'",
    ),
    "folder for a file": (
        ["graph", "block.off", "--entities", "1", "--graphml", "."],
        "must be a file",
    ),
    "picture is a folder": (
        ["info", "block.off", "--picture", "."],
        "--picture must be a file that can be written. Got '.', a folder",
    ),
    "folder is a file": ([*PLAN[:-1], "block.off"], "--out must be a folder"),
    "no plan": (["simulate", "plan.json"], "the plan must be an existing plan file, or its folder"),
    "workspace": ([*PLAN, "--workspace", "1", "1", "1", "0", "0", "0"], "workspace"),
    "picture": (
        ["info", "block.off", "--picture", "edges.bmp"],
        "picture must end in .png or .html",
    ),
    "no folder for the picture": (
        ["info", "block.off", "--picture", "no/edges.html"],
        "Got 'no/edges.html': No such",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_leaves_nothing(folder, capsys, case):
    arguments, message = BAD[case]
    if "--entities" in arguments and "--camera" not in arguments and "plan" in arguments:
        arguments = [*arguments, "--camera", "x"]
    before = sorted(os.listdir(folder))
    lines = failure(capsys, arguments)
    assert len(lines) == 1
    assert message in lines[0]
    assert sorted(os.listdir(folder)) == before


def test_malformed_files_are_named(folder, capsys):
    (folder / "edges.toml").write_text("rim = [[0, 0\n")
    assert "edges.toml" in failure(capsys, PLAN)[-1]
    (folder / "block.off").write_text(BLOCK.replace("4 0 4 7 3\n", ""))
    assert "block.off: " in failure(capsys, ["info", "block.off"])[-1]
    (folder / "plan.json").write_text("{}")
    assert "format must be" in failure(capsys, ["simulate", "plan.json"])[-1]
    (folder / "camera.toml").write_text("focal_length_mm = 8\n")
    (folder / "edges.toml").write_text(ENTITIES)
    lines = failure(capsys, [*PLAN[:4], "--camera", "camera.toml", "--out", "out"])
    assert "pixel_pitch_mm must be given" in lines[-1]
    assert not (folder / "out").exists()


def test_state_of_another_request_is_refused(folder, quick, capsys):
    (folder / "out").mkdir()
    other = PlanningState({"part": {"name": "another"}}, folder / "out" / commands.STATE_FILE)
    other.put(["rim"], Outcome(reason="hidden"))
    other.save()
    lines = failure(capsys, [*PLAN, "--resume"])
    assert len(lines) == 1
    assert "--resume must be of the same request. Got" in lines[0]
    assert "of another one: the part was 'another' and is now 'block'" in lines[0]


def test_boxes_too_near_each_other_are_refused_before_planning(folder, capsys):
    """Two copies of the block a nanometre apart would be one to the grid."""
    counts, *rows = [line for line in BLOCK.splitlines() if line and line != "OFF"]
    n_vertices, n_faces = map(int, counts.split()[:2])
    vertices = rows[:n_vertices]
    faces = rows[n_vertices : n_vertices + n_faces]
    corners = [list(map(float, row.split())) for row in vertices]
    shift = max(x for x, _, _ in corners) - min(x for x, _, _ in corners) + 1e-6
    moved = [f"{x + shift!r} {y!r} {z!r}" for x, y, z in corners]
    others = [[int(word) for word in row.split()] for row in faces]
    shifted = [
        " ".join(map(str, [row[0], *(v + n_vertices for v in row[1 : row[0] + 1])]))
        for row in others
    ]
    lines = ["OFF", f"{2 * n_vertices} {2 * n_faces} 0", *vertices, *moved, *faces, *shifted]
    (folder / "pair.off").write_text("\n".join(lines) + "\n")
    told = failure(capsys, ["graph", "pair.off", "--entities", "0", "--graphml", "g.graphml"])
    assert len([line for line in told if line.startswith("aspectgraph: ")]) == 1
    assert "Got 1e-06 mm between" in told[-1]
    assert "merge the solids" in told[-1]
    assert not (folder / "g.graphml").exists()


def test_interrupted_simulation_does_not_speak_of_resuming(folder, capsys, monkeypatch):
    def interrupt(path):
        raise KeyboardInterrupt

    monkeypatch.setattr(commands, "read_plan", interrupt)
    (folder / "plan.json").touch()
    assert failure(capsys, ["simulate", "plan.json"], INCOMPLETE) == ["aspectgraph: interrupted"]


def test_skipped_graph_is_told_on_the_terminal_and_in_the_report(folder, quick, capsys):
    assert main([*PLAN, "--simulate", "100", "--graph-limit", "3"]) == DONE
    sentence = "graph.graphml was not written: --graph-limit is 3, and the plan has 4 entities."
    assert sentence in capsys.readouterr().out
    assert sentence in (folder / "out" / "report.html").read_text()
    assert not (folder / "out" / "graph.graphml").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"probability": 2},
            "plan.json: probability must be left out, or renamed to one of format, version,",
        ),
        ({"bound": 99}, "plan.json: bound must be 1 to 2, the number of settings. Got 99."),
        ({"bound": "x"}, 'plan.json: bound must be a non-negative integer. Got "x".'),
        ({"targets": {}}, "plan.json: targets must map at least one name to a target."),
    ],
)
def test_plan_whose_promises_make_no_sense_is_not_confirmed(folder, capsys, change, message):
    plan().write(folder / "plan.json")
    data = json.loads((folder / "plan.json").read_text())
    (folder / "plan.json").write_text(json.dumps({**data, **change}))
    assert message in failure(capsys, ["simulate", "plan.json"])[-1]


def test_a_state_that_cannot_be_resumed_is_refused_before_any_work(folder, capsys):
    (folder / "out").mkdir()
    (folder / "out" / commands.STATE_FILE).write_text(
        json.dumps({"format": "aspectgraph planning state", "version": 1})
    )
    lines = failure(capsys, [*PLAN, "--resume"])
    assert len(lines) == 1
    assert "must be a planning state of version 4. Got version 1" in lines[0]


def test_help_explains_and_is_quick():
    script = "import sys\nfrom planner.app.main import main\ncode = main(['--help'])\n"
    script += (
        "print(sorted({'open3d', 'plotly', 'numba', 'OCP'} & set(sys.modules)))\nsys.exit(code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    assert "exit codes: 0 done, 1 plan incomplete, 2 bad input" in done.stdout
    assert done.stdout.splitlines()[-1] == "[]"


def test_solids_of_a_step_file_can_be_chosen(folder, capsys, monkeypatch):
    pytest.importorskip("OCP")
    from step_in_process import read_in_process

    read_in_process(monkeypatch)
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.gp import gp_Pnt
    from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer

    writer = STEPControl_Writer()
    for size, x in ((2.0, 0.0), (2.0, 1.0), (3.0, 9.0)):
        box = BRepPrimAPI_MakeBox(gp_Pnt(x, x, x), size, size, size).Shape()
        writer.Transfer(box, STEPControl_StepModelType.STEPControl_AsIs)
    writer.Write("part.step")
    capsys.readouterr()
    (line,) = failure(capsys, ["info", "part.step"])
    assert "Got solids 0 and 1 of part.step, which do. The file holds 3 solids: 0 " in line
    assert line.endswith(", for instance, --solids 0.")
    assert "solids=" not in line
    assert main(["info", "part.step", "--solids", "2", "--occluders", "0", "--json"]) == DONE
    record = json.loads(capsys.readouterr().out)
    assert {edge["length"] for edge in record["edges"]} == {3.0}
    assert len(record["edges"]) == 12
    assert record["faces"] == 12
    (note,) = [text for text in record["notes"] if text.startswith("ids of edges")]
    assert note.endswith("'info' lists them with the same --solids and --occluders")
    (line,) = failure(capsys, ["info", "part.step", "--solids", "2", "--occluders", "all"])
    assert "must not overlap" in line
    (line,) = failure(capsys, ["info", "part.step", "--occluders", "all"])
    assert (
        "--occluders must be numbers or names where --solids does not say which are measured"
        in line
    )
    assert main(["info", "part.step", "--solids", "0,2"]) == DONE
    out = capsys.readouterr().out
    assert "part: 2 shells, 12 faces" in out
    assert f"note: {note}" in out
    graph = ["graph", "part.step", "--graphml", "g.graphml"]
    (line,) = failure(capsys, [*graph, "--solids", "2", "--entities", "30"])
    assert line.endswith("an edge id must be in 0..11. Got 30. Ids are those of the chosen solids.")
    assert main(["graph", "part.step", "--solids", "2", "--all", "--graphml", "g.graphml"]) == DONE
    assert len(nx.read_graphml("g.graphml")) > 1
    capsys.readouterr()
    for arguments, rule in (
        (["part.step", "--solids", "7"], "must name some of 0..2 of part.step. Got [7]"),
        (["part.step", "--solids", "1,x"], "--solids must name solids of the file"),
        (["part.step", "--solids", "0", "--gap-mm", "-1"], "--gap-mm must be positive"),
        (["block.off", "--solids", "0"], "solids applies to STEP files"),
    ):
        assert rule in failure(capsys, ["info", *arguments])[0]


def test_time_limit_and_gap_end_a_plan(folder, quick, capsys):
    assert main([*PLAN, "--simulate", "100", "--time-limit", "0.001"]) == DONE
    out, err = capsys.readouterr()
    best = read_plan(folder / "out" / "plan.json")
    assert best.unfinished
    lines = [line for line in err.splitlines() if "at least" in line]
    assert len(lines) == 1
    assert f"{len(best.settings)} setting" in lines[0]
    assert "The same command with --resume continues from here." in out
    more = "The time limit of 0.001 s ended the planning; a larger --time-limit may give more."
    assert more in " ".join(out.split())
    page = (folder / "out" / "report.html").read_text()
    assert "stopped early" in page
    assert "continues; a larger --time-limit gives more time." in page
    assert main([*PLAN, "--simulate", "100", "--resume", "--json"]) == DONE
    record = json.loads(capsys.readouterr().out)["plan"]
    assert "unfinished" not in record
    assert not read_plan(folder / "out" / "plan.json").unfinished
    assert commands.STATE_FILE not in os.listdir(folder / "out")
    # what may end the search sooner is of the request, too
    (line,) = failure(capsys, [*PLAN, "--gap", "0.9"])
    assert line.endswith("plan.json of another request: --gap was 0 and is now 0.9.")
    assert main([*PLAN, "--gap", "0.9", "--effort", "quick", "--force"]) == DONE


def test_a_longer_run_does_not_leave_a_worse_plan(folder, quick, capsys, monkeypatch):
    """Lamps may show less from poses that a longer search moved: what the time ends first is not the better plan."""
    limited = [*PLAN, "--simulate", "100", "--time-limit", "0.001"]
    assert main(limited) == DONE
    path = folder / "out" / "plan.json"
    earlier = path.read_bytes()
    search = commands._CommandWork.search

    def poorer(work, options):
        plan = search(work, options)
        *settings, last = plan.settings
        names = set(last.entities).difference(*(setting.entities for setting in settings))
        assert names
        left_out = dict.fromkeys(sorted(names), "no pose")
        return replace(plan, settings=tuple(settings), uninspectable=left_out)

    monkeypatch.setattr(commands._CommandWork, "search", poorer)
    capsys.readouterr()
    assert main([*limited, "--resume"]) == DONE
    assert path.read_bytes() == earlier
    assert "inspects more than this run in its time, and stays" in " ".join(
        capsys.readouterr().out.split()
    )
    # a run that is not to go on from there begins anew
    assert main([*limited, "--force"]) == INCOMPLETE
    assert path.read_bytes() != earlier


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--time-limit", "0"], "--time-limit must be a positive number of seconds. Got 0."),
        (["--time-limit", "nan"], "--time-limit must be a positive number of seconds. Got nan."),
        (["--gap", "1"], "--gap must be in [0, 1). Got 1."),
        (["--gap", "-0.5"], "--gap must be in [0, 1). Got -0.5."),
    ],
)
def test_ends_that_are_none(folder, capsys, options, message):
    assert failure(capsys, [*PLAN, *options]) == [f"aspectgraph: {message}"]


@pytest.mark.parametrize("command", ["info", "dimensions", "cameras"])
def test_a_fault_is_no_result(folder, capsys, monkeypatch, command):
    """70 is EX_SOFTWARE: no script takes it for a part that does not conform."""

    def broken(name):
        raise ZeroDivisionError("by \x1b nought")

    monkeypatch.setattr("planner.app.main._command_of", broken)
    words = [command, *([] if command == "cameras" else ["block.off"])]
    (line,) = failure(capsys, words, INTERNAL)
    assert line.startswith("aspectgraph: the program has a fault. Got ZeroDivisionError: by \\x1b")
    assert line.endswith("--verbose shows its origin.")
    assert main([*words, "--verbose"]) == INTERNAL
    assert "Traceback" in capsys.readouterr().err


def test_warnings_of_libraries_are_shown_if_asked_for(folder, capsys, monkeypatch):
    def warning(name):
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)
        return lambda options: DONE

    monkeypatch.setattr("planner.app.main._command_of", warning)
    with warnings.catch_warnings():
        # the tests make errors of them
        warnings.simplefilter("always")
        assert main(["info", "block.off"]) == DONE
        assert capsys.readouterr().err == ""
        assert main(["info", "block.off", "--verbose"]) == DONE
    assert capsys.readouterr().err == "aspectgraph: RuntimeWarning: overflow\n"


# `--json` and `--quiet` of every command: what a program reads is JSON and nothing else.


BLOCK_JSON = str(Path(__file__).parents[3] / "examples" / "two_pocket_block.off")


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
    code, found = record("info", BLOCK_JSON, "--select", "face = bottom")
    assert code == DONE
    # the block stands on a square of 60 mm
    assert [edge["length"] for edge in found["edges"]] == [60.0] * 4
    assert found["bounds"] == [[0.0, 0.0, 0.0], [60.0, 60.0, 40.0]]
    assert found["curves"] == []
    assert found["notes"] == [
        "OFF files state no unit, so the program assumes mm. Use --units for another unit"
    ]
    assert record("info", BLOCK_JSON, "--units", "mm")[1]["notes"] == []


def test_a_graph(record, tmp_path):
    path = tmp_path / "g.graphml"
    code, found = record("graph", BLOCK_JSON, "--entities", "0,1", "--graphml", str(path))
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
        BLOCK_JSON,
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
    generations = [setting["generations"] for setting in found["plan"]["settings"]]
    assert found["from_genetic_algorithm"] == sum(map(bool, generations))


def test_a_simulation(record, tmp_path):
    plan().write(tmp_path / "plan.json")
    _, found = record("simulate", str(tmp_path / "plan.json"), "--poses", "50")
    assert SimulationResult.from_dict(found).n == 50


def test_graph_and_plan_have_one_workspace_if_the_camera_is_told(record, tmp_path, capsys):
    name = "basler-acA2440-20gm-8mm"
    path = str(tmp_path / "g.graphml")
    _, found = record("graph", BLOCK_JSON, "--entities", "0", "--graphml", path, "--camera", name)
    # as far as the lens focuses in the image's corners: the depth of field's far limit, along the corner's ray
    camera = Camera.named(name)
    half_diagonal = math.hypot(*camera.sensor_size_mm) / 2
    room = camera.depth_of_field_mm[1] * math.hypot(1, half_diagonal / camera.image_distance_mm)
    expected = [[-room, -room, -room], [60 + room, 60 + room, 40 + room]]
    assert found["workspace"] == [pytest.approx(corner) for corner in expected]
    own = ["--workspace", "-100", "-100", "-100", "200", "200", "200"]
    _, found = record(
        "graph", BLOCK_JSON, "--entities", "0", "--graphml", path, "--camera", name, *own
    )
    assert found["workspace"] == [[-100.0] * 3, [200.0] * 3]
    assert main(["graph", BLOCK_JSON, "--entities", "0", "--graphml", path, *own]) == DONE
    assert (
        "workspace: -100.00 -100.00 -100.00 to 200.00 200.00 200.00 mm" in capsys.readouterr().out
    )
