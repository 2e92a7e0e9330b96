"""`aspectgraph plan --light`: lamps in the plan, on the terminal and in the report, and one line for every bad one."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from plan_examples import CAMERA, ENTITIES, UNCERTAINTY, plan

from aspectgraph import read_graphml
from planner import Localisation, read_plan
from planner.app.checks import option
from planner.app.main import main
from planner.app.options import Plan
from planner.app.parsing import arguments_of
from planner.app.plan_commands import REGIONS_FOLDER, STATE_FILE, Leftovers, check_owner
from planner.app.process import BAD_INPUT, DONE, INCOMPLETE
from planner.camera.camera import Camera
from planner.effort import Effort
from planner.exceptions import OutputError, PlanFileError
from planner.identity import PartRecord, Request, keyword
from planner.light.lighting import Lighting
from planner.measuring import foreseen
from planner.request.constraints import Requirements
from planner.request.targets import EntityRecord, edge_target
from planner.resume import PlanningState
from planner.sensor_setting import Outcome
from planner.text_table import digits_text

PLAN = [
    "plan",
    "block.off",
    "--entities",
    "(60,20,10)-(60,40,10),(20,60,10)-(40,60,10)",
    "--effort",
    "quick",
]
PLAN += ["--camera", "basler-acA2440-20gm-8mm", "--out", "out", "--simulate", "200", "--jobs", "1"]


@pytest.fixture
def folder(tmp_path, monkeypatch, request):
    (tmp_path / "block.off").write_bytes(
        (request.config.rootpath / "examples/two_pocket_block.off").read_bytes()
    )
    (tmp_path / "lamps.toml").write_text("lamps = [[280, 320, 450], [-200, -200, 500]]")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("folder")
def test_lamps_to_be_placed_are_written_and_told(folder, capsys):
    light = ["--light", "box:-600,-400,200,600,400,700"]
    assert main([*PLAN, *light, "--explain"]) == DONE
    told = " ".join(capsys.readouterr().out.split())
    assert "setting lamp on lamp at (mm) targets least contrast expose so that" in told
    assert " 1 lamp 1 " in told
    exposure = read_plan(folder / "out" / "plan.json").light.images[0][0].expose_for
    column, row = exposure.pixel
    assert f"pixel ({column}, {row}) has {100 * exposure.share:.2g} % of white" in told
    assert "1 lamp position gives every measurement a contrast of at least 0.1" in told
    found = read_plan(folder / "out" / "plan.json")
    assert found.light.minimal
    assert found.light.complete
    assert [sorted(image.contrast) for images in found.light.images for image in images] == [
        ["p1", "p2"]
    ]
    page = (folder / "out" / "report.html").read_text()
    assert "Predicted image, hidden lines removed, under lamp 1" in page
    assert "Polished metal is out of scope" in page
    # what is planned anew must be asked for as before
    assert main([*PLAN, *light, "--contrast", "0.2"]) == BAD_INPUT
    assert "--contrast was 0.1 and is now 0.2." in capsys.readouterr().err
    assert main(PLAN) == BAD_INPUT
    assert "plan.json of another request: --light changed." in capsys.readouterr().err


@pytest.mark.usefixtures("folder")
def test_lamps_that_are_on_together(folder, capsys):
    assert main([*PLAN, "--light", "lamps.toml", "--together", "--explain"]) == DONE
    told = " ".join(capsys.readouterr().out.split())
    assert "all on together" in told
    found = read_plan(folder / "out" / "plan.json")
    assert found.light.together
    assert {image.lamps for images in found.light.images for image in images} == {
        tuple(range(len(found.light.lamps)))
    }
    assert (
        "of one strength that are all on together" in (folder / "out" / "report.html").read_text()
    )


@pytest.mark.usefixtures("folder")
def test_a_plan_without_the_light_asked_for_is_incomplete(folder, capsys, monkeypatch):
    """As where the time limit ended before lamps were found."""
    monkeypatch.setattr("planner.app.batch.with_light", lambda plan, *_: replace(plan, light=None))
    assert main([*PLAN, "--light", "lamps.toml", "--json"]) == INCOMPLETE
    told = json.loads(capsys.readouterr().out)
    assert told["light_missing"]
    assert told["plan"]["light"] is None
    found = read_plan(folder / "out" / "plan.json")
    assert found.light_missing
    assert not found.complete
    assert not found.uninspectable
    page = (folder / "out" / "report.html").read_text()
    assert "Light is not planned yet, so nothing is promised of contrast" in page


@pytest.mark.usefixtures("folder")
def test_a_ring_light_takes_part_in_the_planning(folder, capsys):
    """The rims lie between the face x = 60 or y = 60 and the lower wall of a pocket, z = 10."""
    assert main([*PLAN, "--light", "ring", "--contrast", "0.2", "--json"]) == DONE
    light = json.loads(capsys.readouterr().out)["plan"]["light"]
    settings = read_plan(folder / "out" / "plan.json").settings
    assert light["lamps"] == [setting.position.tolist() for setting in settings]
    shown = set()
    for setting, lit in zip(settings, light["settings"], strict=True):
        (image,) = lit["images"]
        assert image["silhouettes"] == []
        x, y, z = setting.position
        over = {"p1": x - 60, "p2": y - 60}
        assert list(image["contrast"]) == list(setting.entities)
        for name, contrast in image["contrast"].items():
            expected = abs(over[name] - (z - 10)) / (over[name] + z - 10)
            # told is the least from around the camera, so a little less
            assert 0.2 <= contrast <= expected
            assert contrast == pytest.approx(expected, abs=0.01)
            shown.add(name)
    # settings are made for what the ring did not show in those chosen without it
    assert shown == {"p1", "p2"}


@pytest.mark.usefixtures("folder")
def test_what_no_fixed_lamp_shows_makes_the_plan_incomplete(folder, capsys):
    assert main([*PLAN, "--light", "at:30,30,-100;40,40,-200"]) == INCOMPLETE
    told = " ".join(capsys.readouterr().out.split())
    assert (
        "not inspected: p1, p2: not readable in the light: none of 2 lamps lights all of it, "
        "wherever the camera is: somewhere both of its faces turn away. " in told
    )
    assert "plan without --light, and 'aspectgraph lights' with that plan prints" in told
    # lamps at other places are another request
    assert main([*PLAN, "--light", "lamps.toml"]) == BAD_INPUT
    assert "plan.json of another request: --light changed." in capsys.readouterr().err
    assert main([*PLAN, "--light", "lamps.toml", "--force"]) == DONE
    assert len(read_plan(folder / "out" / "plan.json").light.lamps) == 1


BAD = {
    "no such kind": (
        ["--light", "torch"],
        "--light must be backlight, diffuse-dome, coaxial or ring-light",
    ),
    "five numbers": (["--light", "box:0,0,0,1,1"], "Got 'box:0,0,0,1,1'."),
    "no numbers": (["--light", "dome:a,b,c,d"], "Got 'dome:a,b,c,d'."),
    "dome without a radius": (
        ["--light", "dome:35,22,0"],
        "--light must be dome:X,Y,Z,RADIUS[,LOWEST]: four or five numbers, in mm. Got 'dome:35,22,0'.",
    ),
    "box upside down": (["--light", "box:0,0,0,1,1,-1"], "low must be below high"),
    "dome without size": (["--light", "dome:0,0,0,0"], "radius_mm must be positive. Got 0.0."),
    "two coordinates": (
        ["--light", "at:1,2"],
        "--light must be at:X,Y,Z[;X,Y,Z...]: three numbers for each lamp, in mm. Got 'at:1,2'.",
    ),
    "dome inside": (
        ["--light", "dome:5,5,5,2,-2"],
        "--light must be a dome that reaches beyond the part. Got a radius of 2 mm at a part of 60 x 60 x 40 mm.",
    ),
    "dome in a pocket": (
        ["--light", "dome:30,30,20,0.3"],
        "--light must be a dome that reaches beyond the part. Got a radius of 0.3 mm at a part of",
    ),
    "box inside": (
        ["--light", "box:3,3,3,7,7,7"],
        "--light must have positions outside the part. Got the box of lamps from (3, 3, 3) to (7, 7, 7) "
        "mm, all inside it.",
    ),
    "lamp inside": (
        ["--light", "at:5,5,5"],
        "--light must lie outside the part. Got [5.0, 5.0, 5.0] mm inside it.",
    ),
    "no file": (
        ["--light", "none.toml"],
        "none.toml: file of lamps must be readable. Got: No such file",
    ),
    "no lamps": (["--light", "empty.toml"], "empty.toml: a file of lamps must hold lamps"),
    "no TOML": (["--light", "bad.toml"], "bad.toml: file of lamps must be TOML."),
    "contrast": (
        ["--light", "ring", "--contrast", "1"],
        "contrast must lie strictly between 0 and 1. Got 1.0.",
    ),
    "together alone": (
        ["--together"],
        "--together needs lamps by --light at, box or dome. Got no --light.",
    ),
    "ring together": (["--light", "ring", "--together"], "box or dome. Got --light ring."),
    "separation": (
        ["--separation-px", "-1"],
        "--separation-px must be finite and not negative. Got -1.",
    ),
    "wide": (
        ["--separation-px", "4000"],
        "--separation-px must be less than half the image's smaller side, 2048 px.",
    ),
    "corner": (["--min-corner-deg", "95"], "--min-corner-deg must be below 90. Got 95.0."),
    "ground": (
        ["--light", "ring", "--ground", "grey"],
        "--ground must be one of dark, bright. Got 'grey'",
    ),
}


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("case", BAD)
def test_bad_lamps_are_one_line(folder, capsys, case):
    (folder / "empty.toml").write_text("")
    (folder / "bad.toml").write_text("lamps = [")
    arguments, message = BAD[case]
    assert main([*PLAN, "--quiet", *arguments]) == BAD_INPUT
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert message in err
    assert not (folder / "out" / "plan.json").exists()


@pytest.mark.usefixtures("folder")
def test_the_graph_of_lamp_positions(folder, capsys):
    asked = [
        "graph",
        "block.off",
        "--entities",
        "(60,20,10)-(60,40,10)",
        "--lamps",
        "--graphml",
        "lamps.graphml",
    ]
    assert main([*asked, "--contrast", "0.3", "--json"]) == DONE
    domains = json.loads(capsys.readouterr().out)["domains"]
    found = read_graphml("lamps.graphml")
    assert found.graph["contrast"] == 0.3
    assert [found.nodes[one["id"]]["showing"] for one in domains] == [
        tuple(one["showing"]) for one in domains
    ]
    assert {len(one["showing"]) for one in domains} == {0, 1}
    assert main([*asked, "--quiet"]) == DONE
    assert "light domains" in capsys.readouterr().out
    assert main([*asked, "--quiet", "--contrast", "0"]) == BAD_INPUT
    assert "contrast must lie strictly between 0 and 1. Got 0.0." in capsys.readouterr().err


# `aspectgraph plan --dimensions`: a file of dimensions planned, and one line for every bad one.


EXAMPLES = Path(__file__).parents[3] / "examples"
CASES = Path(__file__).parents[2] / "cases"
BLOCK = str(EXAMPLES / "two_pocket_block.off")
CAMERA_PLAN_DIMENSIONS = [
    "--camera",
    "basler-acA2440-20gm-8mm",
    "--sigma-mm",
    "0.05",
    "--sigma-rad",
    "0.001",
    "--jobs",
    "1",
]
LEFT = "[[50, 20, 10], [50, 40, 10]]"
RIGHT = "[[60, 20, 10], [60, 40, 10]]"
ACROSS = "[[50, 20, 10], [60, 20, 10]]"


def planned(tmp_path, text, *options, part=BLOCK):
    path = tmp_path / "wanted.toml"
    path.write_text(text)
    return main(
        [
            "plan",
            part,
            "--dimensions",
            str(path),
            *CAMERA_PLAN_DIMENSIONS,
            "--out",
            str(tmp_path / "out"),
            *options,
        ]
    )


def test_a_file_of_dimensions(tmp_path, capsys, monkeypatch):
    computed = []
    foresee = foreseen.foreseen_uncertainties
    monkeypatch.setattr(
        foreseen,
        "foreseen_uncertainties",
        lambda *given: computed.append(given) or foresee(*given),
    )
    text = f"step = {{ distance = [{LEFT}, {RIGHT}], max_error = 0.1 }}\nfloor = {{ edge = {LEFT}, max_error = 0.2 }}"
    assert planned(tmp_path, text, "--simulate", "2000") == DONE
    text = " ".join(capsys.readouterr().out.split())
    assert "2 of 2 dimensions inspected" in text
    plan = read_plan(tmp_path / "out" / "plan.json")
    # once for terminal, report and file; the length of an edge has none
    assert len(computed) == 1
    (row,) = plan.foreseen
    assert row.name == "step"
    shown = digits_text(row.expanded_uncertainty, 2)
    # the camera file states no response, which images must show then
    assert (
        f"its U of step will be about {shown} mm, more if images must show the camera's response"
        in text
    )
    assert plan.dimensions["step"].nominal == pytest.approx(10.0)
    step = plan.dimensions["step"]
    assert step.localisation == Localisation("gaussian", 0.1, floor_px=0.05)
    assert step.surfaces_mm == plan.request.surfaces_mm == 0.02
    assert plan.dimensions["floor"].permitted_error == 0.2
    assert plan.simulation.confirmed
    assert (tmp_path / "out" / "graph.graphml").is_file()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            f"step = {{ distance = [{LEFT}, {ACROSS}] }}",
            "dimension 'step': the edges of a distance must be parallel",
        ),
        (f"step = {{ width = {LEFT} }}", "dimension 'step' must be made of a kind"),
        ("bore = { diameter = 'r7' }", "dimension 'bore': "),
        (
            f"step = {{ edge = {LEFT}, max_error = 1, unit = 'ell' }}",
            "dimension 'step': unit must be one of",
        ),
        (
            f"step = {{ edge = {LEFT}, tolerance = [1, -1] }}",
            "dimension 'step': tolerance must have its lower",
        ),
        (
            f"step = {{ edge = {LEFT}, max_error = 0 }}",
            "dimension 'step': max_error must be a positive number. Got 0",
        ),
        (
            f"step = {{ edge = {LEFT}, max_error = 99 }}",
            "dimension 'step': the permitted error of a length must be",
        ),
    ],
)
def test_what_is_wrong_is_one_line_and_nothing_is_written(tmp_path, capsys, text, message):
    assert planned(tmp_path, text) == BAD_INPUT
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("aspectgraph: --dimensions ")
    assert f"wanted.toml: {message}" in err
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--localisation", "canny"], "--localisation must be rounding, gaussian"),
        (["--localisation", "gaussian:much"], "--localisation must hold numbers of px"),
        (
            ["--localisation", "gaussian:-1"],
            "--localisation: sigma_px must be finite and not negative",
        ),
    ],
)
def test_localisation_is_checked(tmp_path, capsys, options, message):
    assert planned(tmp_path, f"floor = {LEFT}", *options) == BAD_INPUT
    assert capsys.readouterr().err.startswith(f"aspectgraph: {message}")
    assert not (tmp_path / "out").exists()


def test_all_dimensions_of_a_pattern(tmp_path, capsys):
    """Two instances of a plate with two holes. A third item of the aspect is none of its faces."""
    pytest.importorskip("OCP")
    text = (CASES / "dim_two_instances.step").read_text()
    usage = "#{}=GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#551,#36,#{});\n"
    more = usage.format(900, 508) + usage.format(901, 335)
    part = tmp_path / "pattern.step"
    part.write_text(text.replace("ENDSEC;\nEND-ISO", f"{more}ENDSEC;\nEND-ISO"))
    wanted = ["--dimensions", "all", "--share", "1", "--effort", "quick", "--simulate", "500"]
    out = str(tmp_path / "out")
    assert (
        main(["plan", str(part), *wanted, *CAMERA_PLAN_DIMENSIONS, "--out", out, "--json"]) == DONE
    )
    found = json.loads(capsys.readouterr().out)
    names = [f"diameter 1 (solid {i}) [{k} of 3]" for i in (0, 1) for k in (1, 2, 3)]
    planned = [name for name in names if "[3 of" not in name]
    assert list(found["plan"]["targets"]) == planned
    unread = "the file attaches it to an item of this feature that could not be read"
    assert found["not_planned"] == {name: unread for name in names if name not in planned}
    with open(tmp_path / "out" / "measurements.csv", newline="") as file:
        assert {row["name"] for row in csv.DictReader(file)} == set(planned)


@pytest.mark.parametrize(
    "option",
    ["--one-per-pattern", "--reference-dimensions", "--no-basic-dimensions", "--no-positions"],
)
@pytest.mark.parametrize(
    ("wanted", "got"), [(["--all"], "none"), (["--dimensions", BLOCK], repr(BLOCK))]
)
def test_options_for_the_dimensions_of_the_model_need_these(tmp_path, capsys, wanted, got, option):
    request = [
        "plan",
        BLOCK,
        *wanted,
        option,
        *CAMERA_PLAN_DIMENSIONS,
        "--out",
        str(tmp_path / "out"),
    ]
    assert main(request) == BAD_INPUT
    assert capsys.readouterr().err == (
        f"aspectgraph: {option} must be given with --dimensions all. Got {got}.\n"
    )
    assert not (tmp_path / "out").exists()


def test_a_model_of_reference_dimensions_says_how_to_plan_them(tmp_path, capsys):
    """The diameter of the case, with the note that it is for information only."""
    pytest.importorskip("OCP")
    text = (CASES / "dim_two_instances.step").read_text()
    note = "#900 = DESCRIPTIVE_REPRESENTATION_ITEM('dimensional note','auxiliary');\n"
    text = text.replace("ENDSEC;\nEND-ISO", note + "ENDSEC;\nEND-ISO")
    part = tmp_path / "reference.step"
    part.write_text(
        text.replace("REPRESENTATION('',(#553),#535)", "REPRESENTATION('',(#553,#900),#535)")
    )
    request = [
        "plan",
        str(part),
        "--dimensions",
        "all",
        *CAMERA_PLAN_DIMENSIONS,
        "--out",
        str(tmp_path / "out"),
    ]
    assert main(request) == BAD_INPUT
    assert capsys.readouterr().err == (
        f"aspectgraph: --dimensions all needs a dimension that can be measured. Got none in {part}; "
        "2 reference dimensions are left out: see --reference-dimensions.\n"
    )
    assert main(["dimensions", str(part)]) == DONE
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "2 requirements (2 dimensions, 0 geometric); 2 measurable from edges"
    assert lines[1].startswith("2 dimensions, 2 with a tolerance, 2 reference, 2 measurable")
    assert "±0.05 mm reference" in lines[4]


def test_a_part_without_dimensions_says_so(tmp_path, capsys):
    pytest.importorskip("OCP")
    part = str(EXAMPLES / "mfcad_6-11-11-19.step")
    assert (
        main(
            [
                "plan",
                part,
                "--dimensions",
                "all",
                *CAMERA_PLAN_DIMENSIONS,
                "--out",
                str(tmp_path / "out"),
            ]
        )
        == BAD_INPUT
    )
    assert "must be a STEP file with semantic dimensions (AP242)" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# An output folder belongs to one request; what is unfinished in it is never deleted in silence.


LIMITS = dict.fromkeys(
    ("min_length_px", "field_margin_px", "focus_margin_mm", "stand_off_mm", "visibility_radius_mm"),
    1.0,
)


def targets(**changes):
    """Records of the edges of the hand-made plan; a change is another edge, with other ends."""
    edges = {name: (k, np.array(ends)) for k, (name, ends) in enumerate(ENTITIES.items())}
    edges |= changes
    return tuple(
        edge_target(name, ends, EntityRecord(name, "edge", (edge,)))
        for name, (edge, ends) in edges.items()
    )


def request_(**changes):
    """The request of the hand-made plan."""
    return Request(
        **{
            "part": PartRecord("block", "0" * 64),
            "targets": targets(),
            "camera": CAMERA,
            "pose_uncertainty": UNCERTAINTY,
            "localisation": Localisation.rounding(),
            "accuracy": 0.98,
            "probability": 0.9,
            "requirements": Requirements(**LIMITS),
            "workspace": np.array([[-900.0] * 3, [900.0] * 3]),
            "lighting": None,
            "ring": None,
            "seed": 5,
            "effort": Effort(),
            **changes,
        }
    )


OTHERS = {
    "part": ({"part": PartRecord("bracket", "0" * 64)}, "part was 'block' and is now 'bracket'"),
    "seed": ({"seed": 6}, "--seed was 5 and is now 6"),
    "accuracy": ({"accuracy": 0.97}, "--accuracy was 0.98 and is now 0.97"),
    "workspace": ({"workspace": np.array([[-1.0] * 3, [900.0] * 3])}, "--workspace changed"),
    "limits": (
        {"requirements": Requirements(**{**LIMITS, "stand_off_mm": 60.0})},
        "--stand-off was 1 and is now 60",
    ),
    "camera": ({"camera": Camera.named("basler-acA2440-20gm-8mm")}, "--camera changed"),
    "new entity": (
        {"targets": targets(more=(9, [[0.0, 0, 0], [0, 50, 0]]))},
        "target 'more' is new",
    ),
    "edges": (
        {"edge_break_mm": (0.0, 0.0)},
        "--edges was not given and is now sharp",
    ),
    "broken edges": (
        {"edge_break_mm": (0.1, 0.3)},
        "--edges was not given and is now 0.1..0.3",
    ),
    "edges of other targets": (
        {"targets": targets(more=(9, [[0.0, 0, 0], [0, 50, 0]])), "edge_break_mm": (0.0, 0.0)},
        "target 'more' is new",
    ),
    "another edge": (
        {"targets": targets(bottom=(17, [[0.0, 0, 0], [0, 50, 0]]))},
        "target 'bottom'",
    ),
    "lighting": ({"lighting": Lighting("ring")}, "--light"),
    "effort": ({"effort": Effort.named("quick")}, "--effort changed: pricing rounds was 100"),
    "gap": ({"gap": 0.2}, "--gap was 0 and is now 0.2"),
    "localisation": (
        {"localisation": Localisation.gaussian(0.1, floor_px=0.0)},
        "--localisation changed: model",
    ),
    "surfaces": ({"surfaces_mm": 0.01}, "--surfaces-mm was 0 and is now 0.01"),
    "shape": ({"part": PartRecord("block", "1" * 64)}, "the shape of the part changed"),
}


def write_plan(folder, request, **changes):
    plan(request, **changes).write(folder / "plan.json")


def test_the_same_request_and_an_empty_folder_are_welcome(tmp_path):
    write_plan(tmp_path, request_())
    before = (tmp_path / "plan.json").read_bytes()
    check_owner(tmp_path, request_(), force=False)
    check_owner(tmp_path / "new", request_(), force=False)
    # asking replaces and makes nothing
    assert (tmp_path / "plan.json").read_bytes() == before
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("case", OTHERS)
def test_another_request_needs_force_and_the_option_is_named(tmp_path, case):
    changes, message = OTHERS[case]
    write_plan(tmp_path, request_())
    with pytest.raises(
        OutputError, match="--out must be a folder without another plan; --force replaces it"
    ) as caught:
        check_owner(tmp_path, request_(**changes), force=False)
    assert message in str(caught.value)
    check_owner(tmp_path, request_(**changes), force=True)


def test_a_file_that_is_no_plan_is_not_replaced_either(tmp_path):
    (tmp_path / "plan.json").write_text(json.dumps({"mine": 1}))
    with pytest.raises(OutputError, match=r"Got .*plan\.json: format must be"):
        check_owner(tmp_path, request_(), force=False)


def test_every_field_of_a_request_is_named_as_an_option_that_there_is():
    """So is one that is added, if its option has its name."""
    options = {argument.name for argument in arguments_of(Plan)}
    names = [one.name for kind in (Request, Lighting) for one in fields(kind)]
    names += [one.name for one in fields(Requirements)]
    # what the command line cannot ask for, and what is no word of an error
    names = set(names) - {
        *("part", "targets", "requirements", "reach", "field_of_view", "showing"),
        *("tolerance_mm", "pose_uncertainty"),
        # a ring light is of the lighting, too, which is compared first
        "ring",
    }
    for name in map(keyword, names):
        assert option(name) in options, name


# --- what an interrupted planning left ------------------------------------------------------------------------------


def unfinished(folder, request, kind):
    """Leave what a killed planning leaves: its state, or regions only."""
    if kind == "state":
        state = PlanningState(request.identity(), folder / STATE_FILE)
        state.put(["top front"], Outcome(reason="hidden"))
        state.save()
    else:
        (folder / REGIONS_FOLDER).mkdir()
        (folder / REGIONS_FOLDER / "request.json").write_text(json.dumps(request.identity()))
        (folder / REGIONS_FOLDER / "abc.npz").write_text("hours of work")
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def prepare(folder, request, *, resume=False, force=False):
    leftovers = Leftovers(folder)
    leftovers.prepare(request, resume=resume, force=force, quiet=True)
    return leftovers


@pytest.mark.parametrize("kind", ["state", "regions"])
def test_unfinished_work_of_another_request_is_refused_and_stays(tmp_path, kind):
    left = unfinished(tmp_path, request_(), kind)
    place = tmp_path / (STATE_FILE if kind == "state" else REGIONS_FOLDER)
    with pytest.raises(OutputError) as caught:
        prepare(tmp_path, request_(seed=6))
    assert str(caught.value) == (
        f"--out must be a folder without an unfinished plan. Got {place} of another request: "
        "--seed was 5 and is now 6; that request with --resume continues it, --force discards it."
    )
    with pytest.raises(PlanFileError, match="--seed was 5 and is now 6; --force without --resume"):
        prepare(tmp_path, request_(seed=6), resume=True)
    # with both, only a plan may be replaced
    with pytest.raises(PlanFileError, match="--resume must be of the same request"):
        prepare(tmp_path, request_(seed=6), resume=True, force=True)
    assert {path: path.read_bytes() for path in left} == left
    prepare(tmp_path, request_(seed=6), force=True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["state", "regions"])
def test_unfinished_work_of_the_same_request_is_continued_or_discarded_as_the_user_says(
    tmp_path, kind
):
    left = unfinished(tmp_path, request_(), kind)
    with pytest.raises(
        OutputError, match="of this request: --resume continues it, --force starts again"
    ):
        prepare(tmp_path, request_())
    prepare(tmp_path, request_(), resume=True)
    assert {path: path.read_bytes() for path in left} == left
    prepare(tmp_path, request_(), force=True)
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_state_is_refused_and_stays(tmp_path):
    (tmp_path / STATE_FILE).write_text("{")
    with pytest.raises(OutputError, match=r"must be JSON\. Got.*; --force discards it\.$"):
        prepare(tmp_path, request_())
    assert (tmp_path / STATE_FILE).read_text() == "{"
    with pytest.raises(PlanFileError, match="must be JSON"):
        prepare(tmp_path, request_(), resume=True)
    prepare(tmp_path, request_(), force=True)
    assert not (tmp_path / STATE_FILE).exists()


def test_regions_of_an_earlier_program_are_of_nobody_known(tmp_path):
    (tmp_path / REGIONS_FOLDER).mkdir()
    (tmp_path / REGIONS_FOLDER / "abc.npz").write_text("hours of work")
    with pytest.raises(OutputError, match="--resume continues it, --force starts again"):
        prepare(tmp_path, request_())
    assert prepare(tmp_path, request_(), resume=True)


@pytest.mark.parametrize("given", [{}, {"resume": True}, {"force": True}])
def test_regions_are_not_kept_through_a_link(tmp_path, given):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "mine").write_text("mine")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / REGIONS_FOLDER).symlink_to(elsewhere)
    with pytest.raises(OutputError, match="in which planning-regions is no link"):
        prepare(tmp_path / "out", request_(), **given)
    assert [path.name for path in elsewhere.iterdir()] == ["mine"]


# A plan is made again from its file.


CAMERA_AGAIN = "basler-acA2440-20gm-8mm"
WORK = ["--jobs", "1", "--simulate", "50", "--quiet"]


@pytest.fixture(scope="module")
def planned_again(tmp_path_factory, pytestconfig):
    """A folder with a part and its plan: an edge, a dimension, lamps, a localisation and limits of its own."""
    folder = tmp_path_factory.mktemp("again")
    shutil.copy(pytestconfig.rootpath / "examples" / "two_pocket_block.off", folder / "block.off")
    (folder / "edges.toml").write_text("rim = 8\n")
    request = [
        "--entities",
        str(folder / "edges.toml"),
        "--camera",
        CAMERA_AGAIN,
        "--effort",
        "quick",
    ]
    request += ["--accuracy", "0.95", "--stand-off", "60", "--seed", "3", "--light", "at:0,0,900"]
    request += ["--units", "mm", "--separation-px", "4", "--localisation", "gaussian:0.2"]
    out = ["--out", str(folder / "plan")]
    with pytest.MonkeyPatch.context() as patch:
        # a plan holds its date
        patch.setenv("SOURCE_DATE_EPOCH", "86400")
        assert main(["plan", str(folder / "block.off"), *request, *out, *WORK]) in (DONE, 1)
        yield folder


def refusal(capsys, *arguments):
    capsys.readouterr()
    assert main(["plan", *arguments]) == BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_a_plan_made_again_is_the_same_byte_for_byte(planned_again, tmp_path):
    """Also where part and plan were moved together."""
    moved = tmp_path / "moved"
    shutil.copytree(planned_again, moved)
    again = ["--again", str(moved / "plan" / "plan.json"), "--out", str(moved / "again")]
    assert main(["plan", *again, *WORK]) in (DONE, 1)
    for name in ("plan.json", "measurements.csv", "poses_opencv.json"):
        assert (moved / "again" / name).read_bytes() == (planned_again / "plan" / name).read_bytes()
    found = read_plan(moved / "again" / "plan.json")
    folder = "the folder of this file"
    assert found.source == {"file": "../block.off", "relative_to": folder, "units": "mm"}
    assert found.light is not None
    assert found.seed == 3


def test_the_folder_of_a_plan_stands_for_its_file(planned_again, tmp_path, monkeypatch):
    """Then the plan is written to ./plan, as any other."""
    monkeypatch.chdir(tmp_path)
    assert main(["plan", "--again", str(planned_again / "plan"), *WORK]) in (DONE, 1)
    assert read_plan("plan").settings == read_plan(planned_again / "plan").settings


def test_a_simulation_refuses_another_part_than_that_of_the_plan(planned_again, tmp_path, capsys):
    other = tmp_path / "other.off"
    other.write_text((planned_again / "block.off").read_text().replace("60 ", "61 "))
    command = ["simulate", str(planned_again / "plan"), "--poses", "10", "--quiet", "--part"]
    assert main([*command, str(other)]) == BAD_INPUT
    assert capsys.readouterr().err == (
        "aspectgraph: --part must be the one that was planned. "
        f"Got '{other}', which has another shape.\n"
    )
    assert main([*command, str(planned_again / "block.off")]) != BAD_INPUT


def test_a_part_that_changed_or_is_gone_is_told(planned_again, tmp_path, capsys):
    moved = tmp_path / "moved"
    shutil.copytree(planned_again, moved)
    again = ["--again", str(moved / "plan" / "plan.json"), "--out", str(moved / "again"), *WORK]
    text = (moved / "block.off").read_text()
    (moved / "block.off").write_text(text.replace("60 ", "61 "))
    assert "the part must be the one that was planned. Got" in refusal(capsys, *again)
    (moved / "block.off").unlink()
    assert "block.off'; give PART, too, if it was moved" in refusal(capsys, *again)
    (moved / "there.off").write_text(text.replace("60 ", "61 "))
    line = refusal(capsys, str(moved / "there.off"), *again)
    assert f"Got '{moved / 'there.off'}', which has another shape; plan it from" in line
    # of a plan from Python, nothing says where its part is
    data = json.loads((moved / "plan" / "plan.json").read_text())
    source = data.pop("source")
    (moved / "plan" / "plan.json").write_text(json.dumps(data))
    assert "source must name the part's file" in refusal(capsys, *again)
    data |= {"source": source, "request": {**data["request"], "colour": "red"}}
    (moved / "plan" / "plan.json").write_text(json.dumps(data))
    assert "request.colour must be left out, or renamed to one of part, targets," in refusal(
        capsys, *again
    )
    assert not (moved / "again").exists()


def test_what_the_request_says_is_not_given_again(planned_again, tmp_path, capsys):
    again = ["--again", str(planned_again / "plan" / "plan.json"), "--out", str(tmp_path / "again")]
    for more in (["--accuracy", "0.9"], ["--seed=4"], ["--all"], ["--light", "ring"]):
        name = more[0].partition("=")[0]
        line = refusal(capsys, *again, *more)
        assert f"{name} must not be given with --again, which takes the request from" in line
    line = refusal(capsys, *again, "--units", "inch")
    assert "the part must be given with options that say how to read it" in line
    for arguments, message in (
        (["--out", "x"], "PART, --camera must be given"),
        (
            ["p.off", "--camera", "c", "--out", "x"],
            "one of --entities, --select, --all, --dimensions must be given",
        ),
        (["--again", "p.json"], "--again must be an existing plan file, or its folder"),
    ):
        assert message in refusal(capsys, *arguments)
