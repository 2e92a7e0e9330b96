"""A made-up option of the request is noticed by resume, ``--out``, batch, kept regions and plan files.

It is added where an option is added: to the request, to the options of the call, and to the command line.
"""

from __future__ import annotations

import json
from dataclasses import field, make_dataclass
from importlib import import_module

import pytest
from grid_box import EDGES, BoxSpace

from planner import Camera, Effort, PartRequest, PoseUncertainty, inspection, read_plan
from planner.app import batch as part_request
from planner.app import main as command_line
from planner.app import options as command_options
from planner.app.plan_commands import REGIONS_FOLDER
from planner.app.process import BAD_INPUT, DONE, INCOMPLETE
from planner.exceptions import PlanFileError
from planner.identity import InspectionRequest
from planner.options import InspectionOptions

CAMERA = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
# modules that hold the names of the two classes
_REQUEST = ("planner.identity", "planner.resolve_request", "planner.app.batch")
_OPTIONS = (
    *("planner.inspection", "planner.app.job", "planner.app.batch"),
    *("planner.options",),
)


@pytest.fixture(autouse=True)
def made_up(monkeypatch):
    """Add the option ``made_up``."""

    def wider(kind, **how):
        added = [("made_up", str, field(default="none"))]
        return make_dataclass(kind.__name__, added, bases=(kind,), frozen=True, **how)

    request = wider(InspectionRequest, eq=False)
    options = wider(InspectionOptions)
    for name in _REQUEST:
        monkeypatch.setattr(f"{name}.InspectionRequest", request)
    for name in _OPTIONS:
        monkeypatch.setattr(import_module(name), "InspectionOptions", options)
    monkeypatch.setattr(part_request, "_LIMITS", (*part_request._LIMITS, "made_up"))
    plan = command_options.Plan
    added = [("made_up", str, field(default="none", kw_only=True))]
    wider_plan = make_dataclass(plan.__name__, added, bases=(plan,))
    monkeypatch.setitem(command_options.COMMANDS, "plan", wider_plan)


class Stop(Exception):
    pass


def stop(done, total, label):
    raise Stop


def test_resuming_notices_it(tmp_path):
    space = BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], list(EDGES)[:2])

    def plan(value, progress=None):
        options = inspection.InspectionOptions(
            space=space,
            effort=Effort(1, 0, 0, 0, 1),
            state=tmp_path / "state.json",
            made_up=value,
            progress=progress,
        )
        part = (space.solid, space.entities)
        return inspection.plan_inspection(*part, CAMERA, UNCERTAINTY, options)

    found = plan("a")
    assert found.request.made_up == "a"
    with pytest.raises(PlanFileError, match="made_up was 'a' and is now 'b'"):
        plan("b")
    assert plan("a", stop) == found


def test_a_batch_notices_it():
    def fingerprint(**limits):
        return PartRequest(CAMERA, UNCERTAINTY, limits=limits).fingerprint

    assert fingerprint(made_up="a") != fingerprint(made_up="b")
    assert fingerprint(made_up="none") == fingerprint()


def test_the_output_folder_kept_regions_and_plan_files_notice_it(
    tmp_path, pytestconfig, capsys, monkeypatch
):
    block = str(pytestconfig.rootpath / "examples" / "two_pocket_block.off")
    out = tmp_path / "out"
    plan = ["plan", block, "--entities", "8", "--camera", "basler-acA2440-20gm-8mm"]
    plan += ["--effort", "quick", "--simulate", "50", "--jobs", "1", "--quiet"]
    plan += ["--out", str(out), "--made-up"]

    def refusal(*more):
        capsys.readouterr()
        assert command_line.main([*plan, "b", *more]) == BAD_INPUT
        (line,) = capsys.readouterr().err.splitlines()
        return line

    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("planner.search.incumbents.first_poses", interrupt)
        assert command_line.main([*plan, "a"]) == INCOMPLETE
    # regions alone know whose they are
    assert [path.name for path in out.iterdir()] == [REGIONS_FOLDER]
    assert "--made-up was 'a' and is now 'b'" in refusal()
    assert "--made-up was 'a' and is now 'b'" in refusal("--resume")
    assert command_line.main([*plan, "a", "--resume"]) == DONE
    assert "plan.json of another request: --made-up was 'a' and is now 'b'." in refusal()
    stored = read_plan(out / "plan.json").request
    assert stored.made_up == "a"
    assert import_module("planner.options").InspectionOptions.of_request(stored).made_up == "a"
    # a plan file that does not state it is none
    data = json.loads((out / "plan.json").read_text())
    del data["request"]["made_up"]
    (out / "plan.json").write_text(json.dumps(data))
    assert "request.made_up must be given. Got none" in refusal()
