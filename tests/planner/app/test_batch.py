"""The table of all parts."""

import csv
import gc
import json
import math
import multiprocessing
import os
import signal
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from aspectgraph import read_dimensions, read_solid, select_entities
from errors.measurands import Localisation
from planner import (
    Camera,
    Detectability,
    DimensionFolder,
    Effort,
    ModelDimensions,
    OutputError,
    PartRequest,
    PoseUncertainty,
    Registration,
    RequestError,
    dimensions_to_plan,
    plan_folder,
)
from planner.app import batch, plan_commands
from planner.app import batch as scheduler
from planner.app.batch import (
    PLANNED,
    REFUSED,
    PartResult,
    _short_reasons,
    dask_executor,
    write_tables,
)
from planner.app.main import main
from planner.app.process import BAD_INPUT, INCOMPLETE
from planner.files import file_digest
from planner.plan import read_plan
from planner.report.plan_folder import folder_lock
from planner.sensor_setting import Reason, ReasonKind


def result(part, status=PLANNED, reason=""):
    return PartResult(part, status, reason, 1, 1, 1, 0.5, "ab", "cd", "ef")


def test_no_spreadsheet_runs_the_name_of_a_file(tmp_path):
    names = ["+1.off", "-1.off", "=SUM(1).off", "@a.off", "a\rb.off", "b.off"]
    write_tables([result(name) for name in names] + [result("c", REFUSED, "=1: no")], tmp_path)
    with open(tmp_path / "results.csv", newline="") as table:
        rows = list(csv.DictReader(table))
    shown = ["'+1.off", "'-1.off", "'=SUM(1).off", "'@a.off", "a\rb.off", "b.off", "c"]
    assert [row["part"] for row in rows] == shown
    assert rows[-1]["reason"] == "'=1: no"
    assert [row["seconds"] for row in rows] == ["0.5"] * 7
    # JSON has the names themselves
    parts = [row["part"] for row in json.loads((tmp_path / "results.json").read_text())]
    assert parts == [*names, "c"]


# A folder of parts: every part has a result, what is done is found again, and a worker that dies
# costs nothing.


forked = pytest.mark.skipif(
    multiprocessing.get_start_method() != "fork", reason="workers inherit what is patched"
)


def box(x, y, z):
    corners = [(i, j, k) for k in (0, z) for i, j in ((0, 0), (x, 0), (x, y), (0, y))]
    faces = ("3 2 1 0", "4 5 6 7", "0 1 5 4", "2 3 7 6", "1 2 6 5", "0 4 7 3")
    lines = [
        "OFF",
        "8 6 12",
        *(" ".join(map(str, corner)) for corner in corners),
        *(f"4 {face}" for face in faces),
    ]
    return "\n".join(lines) + "\n"


@pytest.fixture(autouse=True)
def one_date(monkeypatch):
    """Digests of plans do not depend on when they were made."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")


@pytest.fixture
def parts(tmp_path):
    folder = tmp_path / "parts"
    (folder / "more").mkdir(parents=True)
    (folder / "a.off").write_text(box(80, 50, 40))
    (folder / "more" / "a.off").write_text(box(70, 50, 40))
    (folder / "torn.stl").write_text("solid")
    (folder / "readme.txt").write_text("no part")
    return folder


@pytest.fixture
def request_():
    return PartRequest(
        Camera.named("basler-acA2440-20gm-8mm"),
        PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001),
        accuracy=0.95,
        select="length > 60 and face = top",
        simulate=100,
        effort=Effort(
            viewpoints=5, pricing_rounds=1, refutations=0, bound_nodes=10, margin_generations=3
        ),
    )


def test_parts_without_displaced_poses_are_planned_and_not_simulated(parts, request_, tmp_path):
    out = tmp_path / "out"
    results = plan_folder(parts, out, replace(request_, simulate=0))
    assert [one.status for one in results] == ["planned", "planned", "refused"]
    assert read_plan(out / "a.off" / "plan.json").simulation is None


def test_every_part_has_a_result_and_is_found_again(parts, request_, tmp_path, monkeypatch):
    out = tmp_path / "out"
    told = []
    results = plan_folder(parts, out, request_, progress=lambda *values: told.append(values))
    assert [(one.part, one.status) for one in results] == [
        ("a.off", "planned"),
        ("more/a.off", "planned"),
        ("torn.stl", "refused"),
    ]
    assert "STL file must end with endsolid" in results[2].reason
    assert told[-1] == (3, 3, "parts")
    for one in results[:2]:
        found = read_plan(out / one.part / "plan.json")
        assert (one.entities, one.settings, one.lower_bound) == (
            2,
            len(found.settings),
            found.lower_bound,
        )
        assert one.file_sha256 == file_digest(parts / one.part)
        assert (one.inspected, one.targets) == (len(found.inspected), len(found.targets)) == (2, 2)
    assert repr(results).endswith("2 planned, 1 refused; 4 of 4 targets inspected>")
    rows = json.loads((out / "results.json").read_text())
    assert [row["part"] for row in rows] == [one.part for one in results]
    with open(out / "results.csv", newline="") as table:
        assert [row["status"] for row in csv.DictReader(table)] == ["planned", "planned", "refused"]
    assert not list(out.rglob("planning-state.json"))

    monkeypatch.setattr(batch, "plan_part", lambda *_: pytest.fail("planned again"))
    assert plan_folder(parts, out, request_, executor=ThreadPoolExecutor(1)) == results


def test_plans_do_not_go_where_the_parts_are(parts, request_):
    """The folder of a part's plan would have the name of the part's file."""
    before = sorted(parts.rglob("*"))
    for out in (parts, parts / "more" / ".."):
        with pytest.raises(RequestError, match="out must be another folder than that of the parts"):
            plan_folder(parts, out, request_)
    assert sorted(parts.rglob("*")) == before


def test_solids_are_chosen_in_every_part(request_, tmp_path):
    """Two plates next to each other: each has two long edges on top."""
    parts = tmp_path / "parts"
    parts.mkdir()
    (parts / "two.step").write_bytes((CASES / "dim_two_instances.step").read_bytes())
    chosen = replace(request_, solids=1)
    assert chosen.solids == [1]
    assert len(select_entities(read_solid(parts / "two.step"), chosen.select)) == 4
    (result,) = plan_folder(parts, tmp_path / "out", chosen, executor=ThreadPoolExecutor(1))
    assert result.targets == 2
    assert read_plan(tmp_path / "out" / "two.step" / "plan.json").source["solids"] == [1]


def test_the_command_takes_solids_as_plan_does(parts, tmp_path, monkeypatch):
    requests = []

    def planned(folder, out, request, **keywords):
        requests.append(request)
        return batch.PartResults([])

    monkeypatch.setattr(plan_commands, "plan_folder", planned)
    start = ["batch", str(parts), "--camera", "basler-acA2440-20gm-8mm", "--sigma-mm", "0.05"]
    main([*start, "--sigma-rad", "0.001", "--out", str(tmp_path / "out"), "--solids", "0,bolt:2"])
    assert [request.solids for request in requests] == [[0, "bolt:2"]]


@pytest.mark.parametrize("solids", [[], 1.5, True, [None], {"a": 1}])
def test_solids_that_are_none_are_refused(request_, solids):
    rule = r"solids must (be numbers or names of solids|hold at least one item)\. Got "
    with pytest.raises(RequestError, match=rule):
        replace(request_, solids=solids)


def test_a_limit_that_is_none_is_told_the_nearest(request_):
    with pytest.raises(RequestError, match=r"Got 'stand_of_mm'; the nearest is stand_off_mm\.$"):
        replace(request_, limits={"stand_of_mm": 60.0})
    with pytest.raises(RequestError, match=r"Got 'x'\.$"):
        replace(request_, limits={"x": 60.0})


def test_what_changed_is_planned_again(parts, request_, tmp_path, monkeypatch):
    out = tmp_path / "out"
    again = []
    with ThreadPoolExecutor(1) as executor:
        plan_folder(parts, out, request_, executor=executor)
        before = (out / "a.off" / "plan.json").read_bytes()
        true_plan = batch.plan_part
        monkeypatch.setattr(
            batch, "plan_part", lambda *task: again.append(task[1]) or true_plan(*task)
        )

        def planned(request=request_):
            again.clear()
            plan_folder(parts, out, request, executor=executor)
            return again

        assert planned() == []
        (out / "a.off" / "plan.json").write_text("{}")
        assert planned() == ["a.off"]
        assert (out / "a.off" / "plan.json").read_bytes() == before
        (parts / "more" / "a.off").write_text(box(75, 50, 40))
        assert planned() == ["more/a.off"]
        (out / "torn.stl" / "result.json").write_text("{")
        assert planned() == ["torn.stl"]
        assert planned(replace(request_, seed=1)) == ["a.off", "more/a.off", "torn.stl"]


TRUE_PLAN_PART = batch.plan_part


def _planned_by_a_mortal(request, part, path, folder):
    """Kill the process: on one part always, on another the first time."""
    fell = folder.parent / f"{folder.name}.fell"
    if part == "torn.stl" or (part == "a.off" and not fell.exists()):
        fell.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return TRUE_PLAN_PART(request, part, path, folder)


@forked
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_worker_that_dies_costs_only_the_part_that_kills_it(
    parts, request_, tmp_path, monkeypatch, jobs
):
    monkeypatch.setattr(batch, "plan_part", _planned_by_a_mortal)
    out = tmp_path / "out"
    results = plan_folder(parts, out, request_, jobs=jobs)
    assert [one.status for one in results] == ["planned", "planned", "failed"]
    assert "the process that planned it died" in results[2].reason
    monkeypatch.undo()
    # a failure is tried again, the rest is found
    again = plan_folder(parts, out, request_, jobs=jobs)
    assert again[:2] == results[:2]
    assert again[2].status == "refused"


def test_errors_that_are_not_ours_are_failures_with_their_kind(
    parts, request_, tmp_path, monkeypatch
):
    def wrong(*_, **__):
        raise ZeroDivisionError("by nought")

    monkeypatch.setattr(batch, "read_solid", wrong)
    with ThreadPoolExecutor(1) as executor:
        results = plan_folder(parts, tmp_path / "out", request_, executor=executor)
    assert {(one.status, one.reason) for one in results} == {
        ("failed", "ZeroDivisionError: by nought")
    }


def test_an_interruption_keeps_what_is_done(parts, request_, tmp_path):
    def interrupt(done, *_):
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        plan_folder(parts, tmp_path / "out", request_, progress=interrupt)
    assert [row["part"] for row in json.loads((tmp_path / "out" / "results.json").read_text())] == [
        "a.off"
    ]


def test_lamps_are_planned_for_every_part(parts, request_, tmp_path):
    (parts / "torn.stl").unlink()
    lit = replace(request_, limits={"lamps": "ring"})
    results = plan_folder(parts, tmp_path / "out", lit)
    for one in results:
        light = read_plan(tmp_path / "out" / one.part / "plan.json").light
        assert light is not None
        assert light.kind == "ring"
        assert (one.status == "planned") == light.complete


def test_a_part_without_straight_edges_needs_a_rule(parts, request_, tmp_path):
    n = 60
    turns = 2 * np.pi * np.arange(n) / n
    corners = [(30 * np.cos(a), 30 * np.sin(a), z) for z in (0, 20) for a in turns]
    walls = [(k, (k + 1) % n, n + (k + 1) % n, n + k) for k in range(n)]
    faces = [tuple(range(n))[::-1], tuple(range(n, 2 * n)), *walls]
    lines = ["OFF", f"{len(corners)} {len(faces)} 0"]
    lines += [" ".join(map(str, corner)) for corner in corners]
    lines += [" ".join(map(str, (len(face), *face))) for face in faces]
    (parts / "a.off").write_text("\n".join(lines) + "\n")
    rule = "select must be given for a part without a sharp straight edge, such as 'kind = rim'"
    found = {}
    for select in (None, "kind = rim and face = top"):
        results = plan_folder(parts, tmp_path / f"{select}", replace(request_, select=select))
        found[select] = next(one for one in results if one.part == "a.off")
    assert found[None].status == "refused"
    assert found[None].reason.startswith(rule)
    assert found["kind = rim and face = top"].status == "planned"


def test_bad_input(parts, request_, tmp_path):
    with pytest.raises(RequestError, match=r"folder must be an existing folder\. Got .*none'?\."):
        plan_folder(tmp_path / "none", tmp_path / "out", request_)
    with pytest.raises(RequestError, match=r"folder must be an existing folder\. Got .*, a file\."):
        plan_folder(parts / "a.off", tmp_path / "out", request_)
    (tmp_path / "empty").mkdir()
    with pytest.raises(RequestError, match=r"must hold part files \(\.step"):
        plan_folder(tmp_path / "empty", tmp_path / "out", request_)
    with pytest.raises(RequestError, match="jobs must be an integer of at least 1"):
        plan_folder(parts, tmp_path / "out", request_, jobs=0)
    with pytest.raises(OutputError, match="out must be a folder"):
        plan_folder(parts, parts / "a.off", request_)
    with pytest.raises(RequestError, match="limits must be of stand_off_mm"):
        replace(request_, limits={"colour": 1.0})
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("fields_", "rule"),
    [
        ({"limits": {"time_limit_s": -1}}, "time_limit_s must be a positive number"),
        ({"limits": {"gap": 2}}, r"gap must be in \[0, 1\)"),
        ({"limits": {"showing": 3}}, "showing must be a Detectability"),
        ({"limits": {"stand_off_mm": -5}}, "stand_off_mm must be finite and not negative"),
        ({"limits": 3}, "limits must be a mapping"),
        ({"effort": "quick"}, r"effort must be an Effort. Got 'quick'\. Effort\.named"),
        ({"camera": "basler"}, "camera must be a Camera"),
        ({"accuracy": 95}, r"accuracy must be in \(0, 1\)\. Got 95\."),
        ({"probability": True}, r"probability must be in \(0, 1\)\. Got True\."),
        ({"seed": -1}, "seed must be an integer of at least 0"),
        ({"seed": 10**400}, r"seed must be at most 1e\+300\. Got an integer of 1329 bits\."),
        ({"simulate": -1}, "simulate must be an integer of at least 0"),
        ({"simulate": 10**12}, r"simulate must be at most 1e\+09"),
        ({"graph_limit": 1.5}, "graph_limit must be an integer of at least 0"),
        ({"select": 5}, r"select must be a str\. Got 5\."),
        ({"units": ["mm"]}, r"units must be a str\. Got a list\."),
        ({"limits": {"stand_off_mm": True}}, "stand_off_mm must be finite and not negative"),
        ({"limits": {"min_length_px": 10**400}}, r"min_length_px must be finite .* 1329 bits"),
        ({"limits": {"field_margin_px": "8"}}, "field_margin_px must be finite and not negative"),
        ({"limits": {"visibility_radius_mm": math.nan}}, "visibility_radius_mm must be finite"),
        ({"limits": {"focus_margin_mm": 1e6}}, "focus_margin_mm must be less than half the depth"),
        ({"limits": {"showing": Detectability(surround_px=2000)}}, "surround_px must be less than"),
        ({"limits": {"lamps": "rign"}}, "lamps must be"),
    ],
)
def test_a_bad_option_is_refused_before_any_part(request_, fields_, rule):
    with pytest.raises(RequestError, match=f"^{rule}"):
        replace(request_, **fields_)


def test_swapped_arguments_are_told_their_order(request_):
    rule = (
        r"^camera must be a Camera\. Got a PoseUncertainty; "
        "the order of the arguments is camera, pose_uncertainty"
    )
    with pytest.raises(RequestError, match=rule):
        PartRequest(request_.pose_uncertainty, request_.camera)


def test_the_time_limit_ends_the_visible_regions_of_a_part(parts, request_, tmp_path, monkeypatch):
    monkeypatch.setattr("planner.callbacks.LEAST_SEARCH_S", 0.0)
    (parts / "torn.stl").unlink()
    limited = replace(request_, limits={"time_limit_s": 1e-9})
    results = plan_folder(parts, tmp_path / "out", limited, executor=ThreadPoolExecutor(1))
    assert [one.status for one in results] == ["refused", "refused"]
    assert "time_limit_s must be long enough" in results[0].reason


def test_what_a_time_limit_ended_is_kept_for_a_longer_one(parts, request_, tmp_path, monkeypatch):
    (parts / "torn.stl").unlink()
    (parts / "more" / "a.off").unlink()
    true_plan = batch.plan_request

    def ended_early(*arguments, **keywords):
        return replace(true_plan(*arguments, **keywords), unfinished=True)

    regions = tmp_path / "out" / "a.off" / batch.REGIONS_FOLDER
    with ThreadPoolExecutor(1) as executor:
        monkeypatch.setattr(batch, "plan_request", ended_early)
        (early,) = plan_folder(parts, tmp_path / "out", request_, executor=executor)
        assert early.status == "planned"
        # the fewest settings are proven, so more time cannot save one
        assert early.settings == early.lower_bound
        more = "so a longer time limit may find poses with a larger P"
        assert early.reason == f"stopped early, {more}"
        assert len(list(regions.glob("*.npz"))) == 2
        monkeypatch.undo()
        longer = replace(request_, limits={"time_limit_s": 600.0})
        (result,) = plan_folder(parts, tmp_path / "out", longer, executor=executor)
    assert result.status == "planned"
    assert not regions.exists()


def test_the_command(parts, tmp_path, capsys):
    command = [
        "batch",
        str(parts),
        "--camera",
        "basler-acA2440-20gm-8mm",
        "--out",
        str(tmp_path / "out"),
    ]
    command += ["--select", "length > 1000", "--jobs", "1"]
    assert main([*command, "--quiet"]) == INCOMPLETE
    out, err = capsys.readouterr()
    assert err == ""
    assert "3 parts: 3 refused" in out
    assert "a.off is refused: select must hold for at least one edge" in out
    assert main([*command, "--quiet", "--json"]) == INCOMPLETE
    assert [row["status"] for row in json.loads(capsys.readouterr().out)] == ["refused"] * 3
    assert main([*command[:1], str(tmp_path / "none"), *command[2:]]) == BAD_INPUT
    assert capsys.readouterr().err.count("\n") == 1


def test_dask_plans_the_same(parts, request_, tmp_path):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        there = plan_folder(
            parts, tmp_path / "there", request_, executor=client.get_executor(pure=False)
        )
    here = plan_folder(parts, tmp_path / "here", request_)
    assert [replace(one, seconds=0) for one in there] == [replace(one, seconds=0) for one in here]


def test_requests_that_differ_have_different_fingerprints(request_):
    """Whatever field it is; and a default that is given is the default."""
    usual = Detectability()
    none = Detectability(0.0, 0.0, 0.0)
    given = {
        "stand_off_mm": 60.0,
        "min_length_px": 21.0,
        "field_margin_px": 3.0,
        "visibility_radius_mm": 1.0,
        "focus_margin_mm": 1.0,
        "showing": none,
        "time_limit_s": 60.0,
        "gap": 0.1,
        "localisation": Localisation.gaussian(0.2),
        "surfaces_mm": 0.1,
        "edge_break_mm": (0.1, 0.3),
        "registration": Registration.own_edges(),
        "split": "never",
        "lamps": "ring",
    }
    fields_ = {
        "camera": Camera.named("basler-acA2440-20gm-12mm"),
        "pose_uncertainty": PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.001),
        "accuracy": 0.9,
        "probability": 0.8,
        "seed": 1,
        "select": None,
        "units": "inch",
        "simulate": 200,
        "graph_limit": 3,
        "effort": Effort(viewpoints=6),
        "solids": [1],
    }
    others = [replace(request_, limits={name: value}) for name, value in given.items()]
    others += [replace(request_, **{name: value}) for name, value in fields_.items()]
    others.append(replace(request_, select=None, dimensions=ModelDimensions()))
    # a field or limit that is added must be changed here, too
    assert set(given) == set(batch._LIMITS)
    assert {*fields_, "limits", "dimensions"} == {one.name for one in fields(PartRequest)}
    prints = {one.fingerprint for one in others}
    assert len(prints) == len(others)
    assert request_.fingerprint not in prints
    same = [
        {"showing": usual},
        {"showing": None},
        {"stand_off_mm": 50},
        {"time_limit_s": None, "gap": 0},
    ]
    assert {replace(request_, limits=one).fingerprint for one in same} == {request_.fingerprint}


def test_a_folder_that_another_process_plans_into_is_refused(parts, request_, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    with folder_lock(out):
        with pytest.raises(OutputError, match="must be a folder that no other process writes to"):
            plan_folder(parts, out, request_)
        arguments = ["batch", str(parts), "--camera", "basler-acA2440-20gm-8mm", "--out", str(out)]
        assert main(arguments) == BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    assert f"--out must be a folder that no other process writes to. Got {out}, in use by" in line
    assert list(out.iterdir()) == []


def test_a_part_that_another_process_plans_is_tried_again(parts, request_, tmp_path):
    (parts / "more" / "a.off").unlink()
    (parts / "torn.stl").unlink()
    out = tmp_path / "out"
    (out / "a.off").mkdir(parents=True)
    with folder_lock(out / "a.off"):
        (failed,) = plan_folder(parts, out, request_)
    assert failed.status == "failed"
    assert "no other process writes to" in failed.reason
    (planned,) = plan_folder(parts, out, request_)
    assert planned.status == "planned"
    stored = read_plan(out / "a.off" / "plan.json").source
    assert stored == {"file": "../../parts/a.off", "relative_to": "the folder of this file"}


def test_files_of_somebody_else_stay(parts, request_, tmp_path):
    """Neither a table nor a plan that no batch wrote is replaced, unless that is asked for."""
    out = tmp_path / "out"
    (out / "a.off").mkdir(parents=True)
    report = out / "a.off" / "report.html"
    report.write_text("mine")
    results = plan_folder(parts, out, request_)
    assert [one.status for one in results] == ["failed", "planned", "refused"]
    assert "report.html without result.json; --force" in results[0].reason
    assert report.read_text() == "mine"
    assert not (out / "a.off" / "result.json").exists()
    assert plan_folder(parts, out, request_, replace=True)[0].status == "planned"
    assert report.read_text() != "mine"
    (out / "results.json").write_text("[]x")
    with pytest.raises(OutputError, match="out must be a folder without files of others"):
        plan_folder(parts, out, request_)
    (out / "results.json").unlink()
    with pytest.raises(OutputError, match=r"results\.csv without results\.json"):
        plan_folder(parts, out, request_)


def test_what_is_no_file_is_refused_in_its_row(parts, request_, tmp_path):
    (parts / "gone.off").symlink_to(tmp_path / "nowhere")
    os.mkfifo(parts / "pipe.stl")
    found = {one.part: one for one in plan_folder(parts, tmp_path / "out", request_)}
    assert found["gone.off"].status == found["pipe.stl"].status == "refused"
    assert found["gone.off"].reason.endswith("Got a link that leads nowhere.")
    assert found["pipe.stl"].reason.endswith("Got a pipe or a device.")
    assert found["a.off"].status == "planned"


def test_a_record_that_breaks_the_schema_is_not_believed(parts, request_, tmp_path):
    out = tmp_path / "out"
    first = plan_folder(parts, out, request_)
    path = out / "a.off" / "result.json"
    for change in (
        {"entities": "2"},
        {"status": "fine"},
        {"seconds": -1},
        {"more": 1},
        {"reason": None},
    ):
        path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
        again = plan_folder(parts, out, request_)
        assert [replace(one, seconds=0.0) for one in again] == [
            replace(one, seconds=0.0) for one in first
        ]
        assert set(json.loads(path.read_text())) == {field.name for field in fields(first[0])}


# A Dask scheduler as an executor: one that answers, one that does not, and none at all.


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere:nothing"])
def test_a_scheduler_that_does_not_answer_is_told_with_its_address(monkeypatch, address):
    pytest.importorskip("distributed")
    monkeypatch.setattr(scheduler, "_ANSWERS_S", 0.2)
    with (
        pytest.raises(RequestError, match=f"scheduler that answers.*Got '{address}'"),
        dask_executor(address),
    ):
        pass
    # Dask closes a client that failed when it is collected as garbage, which in another client's loop would wait for it
    gc.collect()


def test_without_dask_it_is_said_how_to_get_it(monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(scheduler, "import_module", missing)
    with (
        pytest.raises(ImportError, match=r"pip install '\.\[dask\]'"),
        dask_executor("tcp://host:8786"),
    ):
        pass


def test_work_is_done_by_its_workers():
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
        ) as cluster,
        dask_executor(cluster.scheduler_address) as executor,
    ):
        assert executor.submit(pow, 3, 4).result(timeout=30) == 81
        assert list(executor.map(abs, [-1, 2, -3])) == [1, 2, 3]


CASES = Path(__file__).parents[2] / "cases"


def dimension_request(**changes):
    return PartRequest(
        Camera.named("basler-acA2440-20gm-8mm"),
        PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001),
        simulate=50,
        effort=Effort(
            viewpoints=5, pricing_rounds=1, refutations=0, bound_nodes=10, margin_generations=3
        ),
        **{"dimensions": ModelDimensions(share=1.0), **changes},
    )


def test_stated_dimensions_are_planned_as_those_of_one_part(tmp_path, monkeypatch):
    pytest.importorskip("OCP")
    works = []

    def done(work):
        works.append(work)
        (work.folder / "plan.json").write_text("{}")
        names = dict.fromkeys(target.name for target in work.resolved.request.targets)
        return SimpleNamespace(
            uninspectable={},
            simulation=None,
            entities=names,
            targets=names,
            settings=(),
            lower_bound=0,
            unlit=(),
            light_missing=False,
            unfinished=False,
        ), None

    # the search takes long, and others test it
    monkeypatch.setattr(batch.FolderWork, "done", done)
    folder = tmp_path / "parts"
    folder.mkdir()
    part = folder / "plate.step"
    part.write_bytes((CASES / "dim_on_thread_curve.step").read_bytes())
    (folder / "block.off").write_text(box(80, 50, 40))
    request = dimension_request()
    block, plate = plan_folder(folder, tmp_path / "out", request, executor=ThreadPoolExecutor(1))
    assert (block.status, block.left_out) == ("refused", 0)
    assert "dimensions are read from .step and .stp files" in block.reason
    # a diameter of a hole, and one of a curve without a face, which nothing measures
    wanted, left_out = dimensions_to_plan(read_dimensions(part, read_solid(part)), share=1.0)
    assert (len(wanted), plate.left_out) == (1, len(left_out))
    assert plate.left_out_reasons == "; ".join(": ".join(pair) for pair in left_out.items())
    (target,) = works[0].resolved.request.targets
    assert target.name in wanted
    assert (plate.status, plate.entities) == ("planned", 1)
    assert works[0].resolved.request.localisation == Localisation.gaussian(0.1)


@pytest.fixture
def files(parts, tmp_path):
    """A file of dimensions for each part that can be read, in the same subfolders."""
    (parts / "torn.stl").unlink()
    folder = tmp_path / "wanted"
    (folder / "more").mkdir(parents=True)
    solid = read_solid(parts / "a.off")
    pair = opposite_edges(solid)
    stated = f"width = {{ distance = {pair}, tolerance = [-0.5, 0.5] }}"
    (folder / "a.toml").write_text(stated)
    (folder / "more" / "a.json").write_text(
        json.dumps({"side": {"edge": pair[0], "accuracy": 0.9}})
    )
    return folder


def opposite_edges(solid):
    """Two parallel edges of the face on top."""
    top = [
        edge.id
        for edge in solid.edges
        if (solid.edge_points(edge.id)[:, 2] == solid.bounds[1][2]).all()
    ]
    along = [i for i in top if np.ptp(solid.edge_points(i)[:, 0]) > 0]
    return along[:2]


def test_each_part_has_the_dimensions_of_its_file(parts, files, request_, tmp_path):
    request = replace(request_, select=None, dimensions=DimensionFolder(str(files), 0.5))
    out = tmp_path / "out"
    results = plan_folder(parts, out, request)
    assert [(one.part, one.entities) for one in results] == [("a.off", 1), ("more/a.off", 1)]
    assert set(read_plan(out / "a.off" / "plan.json").dimensions) == {"width"}
    assert set(read_plan(out / "more" / "a.off" / "plan.json").dimensions) == {"side"}
    # what has not changed is found again, wherever the files are
    moved = files.rename(tmp_path / "moved")
    request = replace(request, dimensions=DimensionFolder(str(moved), 0.5))
    assert plan_folder(parts, out, request) == results
    (moved / "a.toml").write_text((moved / "a.toml").read_text().replace("width", "depth"))
    first, second = plan_folder(parts, out, request)
    assert set(read_plan(out / "a.off" / "plan.json").dimensions) == {"depth"}
    assert first.request != results[0].request
    assert second == results[1]


def test_a_part_without_a_file_of_dimensions_is_refused_before_all_work(
    parts, files, request_, tmp_path, capsys
):
    (files / "more" / "a.json").unlink()
    text = "dimensions must hold NAME.toml or NAME.json for every part. Got none for more/a.off."
    request = replace(request_, select=None, dimensions=DimensionFolder(str(files)))
    with pytest.raises(RequestError) as info:
        plan_folder(parts, tmp_path / "out", request)
    assert str(info.value) == text
    words = ["batch", str(parts), "--camera", "basler-acA2440-20gm-8mm", "--sigma-mm", "0.05"]
    words += ["--sigma-rad", "0.001", "--out", str(tmp_path / "plans"), "--dimensions", str(files)]
    assert main(words) == BAD_INPUT
    assert f"--{text}" in capsys.readouterr().err
    assert not list((tmp_path / "plans").rglob("plan.json"))


def test_a_choice_of_dimensions_is_part_of_the_fingerprint():
    requests = [
        dimension_request(),
        dimension_request(dimensions=None),
        dimension_request(dimensions=ModelDimensions(share=0.5)),
        dimension_request(dimensions=ModelDimensions(share=1.0, one_per_pattern=True)),
        dimension_request(dimensions=DimensionFolder("wanted")),
        dimension_request(dimensions=DimensionFolder("wanted", 0.5)),
        dimension_request(limits={"surfaces_mm": 0.1}),
        dimension_request(limits={"localisation": Localisation.gaussian(0.3)}),
    ]
    assert len({request.fingerprint for request in requests}) == len(requests)
    with pytest.raises(RequestError, match="select must not be given with dimensions"):
        dimension_request(select="length > 20")
    with pytest.raises(RequestError, match="share"):
        ModelDimensions(share=0.0)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--dimensions", "none.toml"], "--dimensions must be 'all' or name an existing file"),
        (
            ["--dimensions", __file__],
            "--dimensions must be all or a folder with a file of dimensions for each part. Got",
        ),
        (["--share", "0.5"], "--share must be given with --dimensions"),
        (["--one-per-pattern"], "--one-per-pattern must be given with --dimensions all"),
        (["--surfaces-mm", "0.1"], "--surfaces-mm must be given with --dimensions"),
    ],
)
def test_options_of_dimensions_need_dimensions(parts, tmp_path, capsys, words, message):
    start = ["batch", str(parts), "--camera", "basler-acA2440-20gm-8mm"]
    assert main([*start, "--out", str(tmp_path / "out"), *words]) == BAD_INPUT
    assert message in capsys.readouterr().err


def test_reasons_of_several_targets_are_told_once():
    corner = Reason.of(ReasonKind.NO_CORNER, "at (1, 2, 3) mm the edge ends in an arc.")
    reasons = {
        "e0": corner,
        "e2": corner,
        "hole": Reason.of(ReasonKind.OUT_OF_REACH, "far."),
        "x": "none",
    }
    assert _short_reasons(reasons) == [
        "no corner to measure to: e0, e2",
        "hole: out of reach: far",
        "x: none",
    ]
