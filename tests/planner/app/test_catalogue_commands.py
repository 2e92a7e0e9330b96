"""`aspectgraph optics`: the table, its records, and what it says when nothing can do it."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

import pytest
from step_kernels import one_kernel

from planner import Camera, OpticsProposal, optics_table
from planner.app.main import main
from planner.app.process import BAD_INPUT, DONE, INCOMPLETE

BLOCK = str(Path(__file__).parents[3] / "examples" / "two_pocket_block.off")
EDGE = "(60,20,10)-(60,40,10)"
OPTICS = [
    "optics",
    BLOCK,
    "--entities",
    EDGE,
    "--body",
    "basler-acA2440-20gm",
    "--distances",
    "250,400",
]
CASES = Path(__file__).parents[2] / "cases"
SURE = ["--sigma-mm", "0.05", "--sigma-rad", "0.001"]


def test_table_of_optics(capsys):
    assert main([*OPTICS, *SURE, "--rows", "2"]) == DONE
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:2] == ["body", "lens"]
    assert lines[0].endswith("targets  U / permitted")
    shares = [line.split()[-3:-1] for line in lines[2:4]]
    assert [able for able, _ in shares] == ["1/1", "1/1"]
    assert float(shares[0][1]) <= float(shares[1][1])
    assert lines[4].startswith("note: OFF files state no unit")


def test_the_table_of_optics_fits_the_terminal(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main([*OPTICS, *SURE, "--rows", "2"]) == DONE
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    assert "basler-acA2440-20gm" in out


def test_records_of_optics(capsys):
    assert main([*OPTICS, *SURE, "--rows", "3", "--json"]) == DONE
    records = json.loads(capsys.readouterr().out)
    assert len(records) == 3
    for one in records:
        assert one["body"] == "basler-acA2440-20gm"
        assert one["camera"]["focus_distance_mm"] in (250.0, 400.0)
        assert [*one["probability"]] == one["able"]


def test_optics_for_a_pattern_rank_by_every_hole_or_say_what_is_not_planned(tmp_path, capsys):
    """The diameter applies to both holes of each of two instances of a plate."""
    pytest.importorskip("OCP")
    text = (CASES / "dim_two_instances.step").read_text()
    usage = "#900 = GEOMETRIC_ITEM_SPECIFIC_USAGE('','',#551,#36,#508);\n"
    part = tmp_path / "pattern.step"
    part.write_text(text.replace("ENDSEC;\nEND-ISO", usage + "ENDSEC;\nEND-ISO"))
    wanted = ["--dimensions", "all", "--body", "basler-acA2440-20gm", "--distances", "250"]
    request = ["optics", str(part), *wanted, *SURE, "--rows", "1"]
    with one_kernel():
        main([*request, "--one-per-pattern"])
        printed = capsys.readouterr().out
        main([*request, "--one-per-pattern", "--json"])
        (record,) = json.loads(capsys.readouterr().out)
        main([*request, "--json"])
        (of_all,) = json.loads(capsys.readouterr().out)
    sentence = (
        "2 dimensions, 4 characteristics: 2 not planned; optics are ranked by one feature of each"
    )
    assert sentence in printed
    assert record["features"] == {"n": 4, "not_planned": 2}
    assert of_all["features"] == {"n": 4, "not_planned": 0}
    # every hole is as large as every other one
    assert len(of_all["able"]) == 2 * len(record["able"]) == 4


def test_nothing_can_do_it(capsys):
    # no image of 20 mm has 5000 px on a sensor of 2448
    assert main([*OPTICS, *SURE, "--min-length-px", "5000"]) == INCOMPLETE
    assert "0/1" in capsys.readouterr().out


def test_the_best_camera_is_written_for_plan(tmp_path, monkeypatch, capsys):
    """Once: a file that is there stays, and so it does where no camera measures anything."""
    monkeypatch.chdir(tmp_path)
    assert main([*OPTICS, *SURE, "--rows", "1", "--json"]) == DONE
    (record,) = json.loads(capsys.readouterr().out)
    assert main([*OPTICS, *SURE, "--rows", "1", "--write", "camera.toml"]) == DONE
    assert "give it to plan as --camera camera.toml" in capsys.readouterr().out
    assert Camera.from_toml("camera.toml") == Camera.from_dict(record["camera"])
    assert main([*OPTICS, *SURE, "--write", "camera.toml"]) == BAD_INPUT
    assert capsys.readouterr().err == (
        "aspectgraph: --write must be a new file. Got 'camera.toml', which exists.\n"
    )
    none = [*OPTICS, *SURE, "--min-length-px", "5000", "--write", "none.toml"]
    assert main(none) == INCOMPLETE
    assert "none.toml was not written" in capsys.readouterr().out
    assert not (tmp_path / "none.toml").exists()
    for name, message in (
        ("x.json", "must end in .toml"),
        ("no/x.toml", "in a folder that exists"),
    ):
        assert main([*OPTICS, *SURE, "--write", name]) == BAD_INPUT
        assert f"--write {message}" in capsys.readouterr().err.replace("must be in", "in")


def test_what_is_sharp_has_digits_enough(capsys):
    """A long lens close up: the depth of field is a fraction of a millimetre, and "250 to 250" says nothing."""
    lens = {"pixel_pitch_mm": (0.002, 0.002), "resolution": (4000, 3000)}
    near = Camera(focal_length_mm=75.0, f_number=2.0, focus_distance_mm=250.0, **lens)
    first, second = map(float, near.depth_of_field_text.split(" to "))
    assert near.depth_of_field_mm == pytest.approx((first, second), abs=0.005)
    assert first < 250.0 < second
    far = Camera(focal_length_mm=8.0, f_number=8.0, focus_distance_mm=5e4, **lens)
    assert far.depth_of_field_text.endswith(" to infinity")
    shown = optics_table([OpticsProposal("b", "l", near, 0.9, {"rim": 1.0}, {"rim": 0.5}, {})])
    assert near.depth_of_field_text in shown


def test_unknown_bodies_and_distances_are_refused(capsys):
    assert main([*OPTICS, "--body", "box"]) == BAD_INPUT
    assert "--body must be of the catalogue" in capsys.readouterr().err
    assert main([*OPTICS, "--distances", "near"]) == BAD_INPUT
    assert "must be numbers like 250,400. Got 'near'" in capsys.readouterr().err
    assert main([*OPTICS, "--rows", "0"]) == BAD_INPUT
    assert "--rows must be at least 1" in capsys.readouterr().err


# `aspectgraph dimensions`: a table, JSON, and one line for what has none.


EXAMPLES = Path(__file__).parents[3] / "examples"
PART = str(EXAMPLES / "nist_ctc_01_ap242.stp")


@pytest.mark.skipif(find_spec("OCP") is None, reason="needs OCP")
def test_the_table_names_value_tolerance_and_entities(capsys):
    assert main(["dimensions", PART]) == DONE
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "18 requirements (12 dimensions, 6 geometric); 14 measurable from edges"
    assert lines[1] == "12 dimensions, 8 with a tolerance, 12 measurable: 12 characteristics"
    row = next(line for line in lines if "Linear Size.1 " in line)
    assert row.split()[2:9] == ["diameter", "35", "mm", "0/-0.2", "mm", "1", "r8"]
    assert "note: distance 1: the file states no nominal value; this is the geometry's" in lines


@pytest.mark.skipif(find_spec("OCP") is None, reason="needs OCP")
def test_json_is_a_list_of_records(capsys):
    assert main(["dimensions", PART, "--json"]) == DONE
    records = json.loads(capsys.readouterr().out)
    assert [record["kind"] for record in records].count("surface profile") == 2
    assert len(records) == 18
    assert records[3]["name"] == "Linear Size.1"
    assert (records[3]["nominal"], records[3]["unit"], records[3]["tolerance"]) == (
        35.0,
        "mm",
        [-0.2, 0.0],
    )
    assert all(set(record) == set(records[0]) for record in records[:12])


@pytest.mark.skipif(find_spec("OCP") is None, reason="needs OCP")
@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "mfcad_6-11-11-19.step",
            "the part must be a STEP file with semantic dimensions (AP242). Got ",
        ),
        (
            "slotted_block.off",
            "dimensions are read from .step and .stp files. Got 'slotted_block.off'.",
        ),
        ("none.stp", "the part must be an existing file. Got "),
    ],
)
def test_what_has_no_dimensions_is_one_line(capsys, name, message):
    assert main(["dimensions", str(EXAMPLES / name)]) == BAD_INPUT
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"aspectgraph: {message}")
    assert len(err.splitlines()) == 1
    # what to do instead stands where a STEP file states none
    assert ("--picture edges.html" in err) == ("AP242" in message)
