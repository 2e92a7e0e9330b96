"""`aspectgraph plan --light`: lamps in the plan, on the terminal and in the report, and one line for every bad one."""

import json

import pytest

from aspectgraph import read_graphml
from planner.app.main import main
from planner.app.process import BAD_INPUT, DONE, INCOMPLETE
from planner.plan import read_plan

PLAN = [
    "plan",
    "block.off",
    "--entities",
    "(60,20,10)-(60,40,10),(20,60,10)-(40,60,10)",
    "--effort",
    "quick",
]
PLAN += ["--camera", "basler-acA2440-20gm-8mm", "--out", "out", "--simulate", "200", "--jobs", "1"]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch, request):
    (tmp_path / "block.off").write_bytes(
        (request.config.rootpath / "examples/two_pocket_block.off").read_bytes()
    )
    (tmp_path / "lamps.toml").write_text("lamps = [[280, 320, 450], [-200, -200, 500]]")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_lamps_to_be_placed_are_written_and_told(folder, capsys):
    light = ["--light", "box:-600,-400,200,600,400,700"]
    assert main([*PLAN, *light]) == DONE
    told = " ".join(capsys.readouterr().out.split())
    assert "setting 1: lamp 1 at (" in told
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


def test_lamps_that_are_on_together(folder, capsys):
    assert main([*PLAN, "--light", "lamps.toml", "--together"]) == DONE
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


def test_what_no_fixed_lamp_shows_makes_the_plan_incomplete(folder, capsys):
    assert main([*PLAN, "--light", "at:30,30,-100;40,40,-200"]) == INCOMPLETE
    told = " ".join(capsys.readouterr().out.split())
    assert (
        "not shown: p1: none of 2 lamps shows it: 2 with a contrast under 0.1, 0 with a step under 0.1"
        in told
    )
    # lamps at other places are another request
    assert main([*PLAN, "--light", "lamps.toml"]) == BAD_INPUT
    assert "plan.json of another request: --light changed." in capsys.readouterr().err
    assert main([*PLAN, "--light", "lamps.toml", "--force"]) == DONE
    assert len(read_plan(folder / "out" / "plan.json").light.lamps) == 1


BAD = {
    "no such kind": (["--light", "torch"], "--light must be ring, box:X0,Y0,Z0,X1,Y1,Z1, dome:"),
    "five numbers": (["--light", "box:0,0,0,1,1"], "Got 'box:0,0,0,1,1'."),
    "no numbers": (["--light", "dome:a,b,c,d"], "Got 'dome:a,b,c,d'."),
    "box upside down": (["--light", "box:0,0,0,1,1,-1"], "low must be below high"),
    "dome without size": (["--light", "dome:0,0,0,0"], "radius_mm must be positive. Got 0.0."),
    "two coordinates": (
        ["--light", "at:1,2"],
        "--light must be finite numbers in mm, shape (n, 3).",
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
