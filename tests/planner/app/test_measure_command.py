"""The command ``measure``: files, exit codes, and errors in one line."""

import csv
import hashlib
import json
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from measured_plate import POSES, fine_plate, measured_plan, photograph, thick_plate
from PIL import Image
from plan_examples import changed

from aspectgraph import read_solid
from planner import Lighting, read_plan
from planner.app.main import main
from planner.files import path_text
from planner.identity import PartRecord


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A plan, its part, images of a good plate and of one that is too wide, and the exact poses."""
    root = tmp_path_factory.mktemp("measure")
    solid = thick_plate()
    lines = [f"OFF\n{len(solid.vertices)} {len(solid.triangles)} 0"]
    lines += [" ".join(map(repr, vertex)) for vertex in solid.vertices.tolist()]
    lines += [f"3 {a} {b} {c}" for a, b, c in solid.triangles.tolist()]
    (root / "plate.off").write_text("\n".join(lines))
    plan = measured_plan(solid, ["width"], part=PartRecord.of(read_solid(root / "plate.off")))
    plan.write(root / "plan.json")
    for name, width in (("good", 0.0), ("wide", 0.5)):
        (root / name).mkdir()
        for k, image in photograph(fine_plate(width=width), POSES).items():
            Image.fromarray(image).save(root / name / f"setting_{k:02d}.png")
    poses = {f"setting_{k + 1:02d}": pose.tolist() for k, pose in enumerate(POSES)}
    given = {"poses": poses, "covariance": np.diag([1e-8] * 3 + [1e-12] * 3).tolist()}
    (root / "poses.json").write_text(json.dumps(given))
    (root / "bad.json").write_text(json.dumps({"setting_01": [[1, 2], [3, 4]]}))
    (root / "few.json").write_text(json.dumps({"setting_01": poses["setting_01"]}))
    return root


def run(folder, images, *more, out="out"):
    return main(
        [
            *("measure", str(folder / "plan.json"), str(folder / images)),
            *("--part", str(folder / "plate.off"), "--units", "mm"),
            *("--out", str(folder / out), *more),
        ]
    )


def table_of(path):
    with open(path, newline="", encoding="utf-8") as table:
        return list(csv.DictReader(table))


def given(folder, name="poses.json"):
    return "--register", str(folder / name)


def test_a_good_part_conforms(folder, capsys):
    assert run(folder, "good", *given(folder), "--serial", "N0012") == 0
    out = capsys.readouterr().out
    assert "1 of 1 planned target measured in 2 images" in out
    data = json.loads((folder / "out" / "results.json").read_text())
    assert data["serial"] == "N0012"
    # what sha256sum prints
    for key, name in (("part_file_sha256", "plate.off"), ("plan_digest", "plan.json")):
        assert data["source"][key] == hashlib.sha256((folder / name).read_bytes()).hexdigest()
    assert data["results"][0]["decision"] == "conforms"
    assert (folder / "out" / "results.csv").read_text().count("\n") == 2
    (row,) = table_of(folder / "out" / "results.csv")
    assert (row["serial"], row["date"], row["operator"]) == ("N0012", data["source"]["date"], "")


def test_a_wide_part_does_not(folder, capsys):
    assert run(folder, "wide", *given(folder), out="wide-out") == 1
    assert "1 does not conform" in " ".join(capsys.readouterr().out.split())
    assert run(folder, "wide", *given(folder), "--exit", "measured", out="wide-out") == 0


def test_json(folder, capsys):
    assert run(folder, "good", *given(folder), "--json", out="json") == 0
    data = json.loads(capsys.readouterr().out)
    assert data["results"][0]["name"] == "width"
    assert set(data["images"]) == {"setting_01", "setting_02"}


@pytest.mark.parametrize(
    ("images", "more", "message"),
    [
        ("nowhere", [], "aspectgraph: the images must be an existing folder. Got"),
        (
            "good",
            ["--register", "none.json"],
            "--register must be edges, none or name an existing file.",
        ),
        ("good", ["--coverage", "0"], "--coverage must be in (0, 1]. Got 0."),
        ("good", ["--surfaces-mm", "-1"], "--surfaces-mm must be finite and not negative. Got -1."),
        (
            "good",
            ["--surfaces-mm", "50"],
            "--surfaces-mm must be at most 9.7 mm, which are 60 px of",
        ),
    ],
    ids=["no folder", "no poses", "coverage", "surfaces", "far surfaces"],
)
def test_bad_input(folder, capsys, images, more, message):
    assert run(folder, images, *more, out="bad") == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (folder / "bad").exists()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("bad.json", "the pose of setting_01 must be a matrix (4, 4) of numbers"),
        ("few.json", "--register must hold the pose of every image. Got none of setting_02."),
        ("plate.off", "--register must be JSON"),
    ],
)
def test_bad_poses(folder, capsys, name, message):
    assert run(folder, "good", *given(folder, name), out="bad") == 2
    assert message in capsys.readouterr().err


ROW = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"poses": {}, "covariance": [[1], [1, 2]]}', "covariance must be a (6, 6) array"),
        (
            '{"poses": {}, "covariance": [[1' + "0" * 400 + "]]}",
            "covariance must be a (6, 6) array",
        ),
        ('{"poses": [1]}', "--register must hold poses by setting name"),
        (f'{{"setting_01": {ROW}, "setting_01.png": {ROW}}}', "poses must have one pose of"),
        ("[" * 100_000, "--register must be JSON"),
        (f'{{"setting_01": {ROW}}}'.replace("[1,", "[NaN,"), "must be a matrix (4, 4)"),
    ],
    ids=["ragged", "overflow", "list", "twice", "deep", "nan"],
)
def test_pose_files_are_refused_in_one_line(folder, capsys, tmp_path, text, message):
    path = tmp_path / "poses.json"
    path.write_text(text)
    assert run(folder, "good", "--register", str(path)) == 2
    error = capsys.readouterr().err
    assert message in error
    assert len(error.strip().splitlines()) == 1


def test_missing_images(folder, capsys, tmp_path):
    (tmp_path / "setting_02.png").write_bytes((folder / "good" / "setting_02.png").read_bytes())
    assert run(folder, tmp_path, *given(folder), out="partial") == 2
    assert "Got no setting_01; --partial measures what is there." in capsys.readouterr().err
    assert run(folder, tmp_path, *given(folder), "--partial", out="partial") == 0
    assert "setting_01: no image" in capsys.readouterr().out


def test_a_folder_of_parts(folder, tmp_path, capsys):
    for serial, images in (("N1", "good"), ("N2", "wide")):
        (tmp_path / serial).symlink_to(folder / images)
    assert run(folder, tmp_path, *given(folder), "--parts", out="parts") == 1
    decisions = [
        json.loads((folder / "parts" / serial / "results.json").read_text())["results"][0][
            "decision"
        ]
        for serial in ("N1", "N2")
    ]
    assert decisions == ["conforms", "does not conform"]
    assert (folder / "parts" / "N2" / "report.html").exists()
    rows = table_of(folder / "parts" / "results.csv")
    assert [(row["serial"], row["decision"]) for row in rows] == [
        ("N1", "conforms"),
        ("N2", "does not conform"),
    ]
    out = capsys.readouterr().out.replace("\n", "")
    for serial in ("N1", "N2"):
        assert f"report: {path_text(folder / 'parts' / serial / 'report.html')}" in out
    assert f"7 files in {path_text(folder / 'parts')}/; open" in out
    assert out.endswith(path_text(folder / "parts" / "results.csv"))
    # an earlier table is replaced
    assert run(folder, tmp_path, *given(folder), "--parts", "--operator", "B", out="parts") == 1
    assert {row["operator"] for row in table_of(folder / "parts" / "results.csv")} == {"B"}
    assert run(folder, tmp_path, *given(folder), "--parts", "--serial", "N3") == 2
    assert run(folder, tmp_path / "N1", *given(folder), "--parts") == 2
    assert "the images must hold a folder for each part" in capsys.readouterr().err


@pytest.mark.parametrize(("name", "text"), [("results.csv", "name,mine"), ("results.json", "{}")])
def test_files_where_the_table_of_parts_belongs_stay(folder, tmp_path, capsys, name, text):
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "N1").symlink_to(folder / "good")
    (tmp_path / name).write_text(text)
    assert run(folder, tmp_path / "images", *given(folder), "--parts", out=tmp_path) == 2
    error = capsys.readouterr().err
    assert error.startswith("aspectgraph: --out must be a folder without files of others. Got ")
    assert (tmp_path / name).read_text() == text


def test_a_part_may_not_have_the_name_of_the_table(folder, tmp_path, capsys):
    (tmp_path / "results.csv").symlink_to(folder / "good")
    assert run(folder, tmp_path, *given(folder), "--parts", out="clash") == 2
    assert "other names than that of the table of all parts" in capsys.readouterr().err


def test_qif_is_written_if_asked_for_and_does_not_stay(folder, capsys):
    assert run(folder, "good", *given(folder), "--qif", out="qif") == 0
    assert "4 files" in capsys.readouterr().out
    assert "<CharacteristicStatusEnum>PASS<" in (folder / "qif" / "results.qif").read_text()
    assert run(folder, "good", *given(folder), out="qif") == 0
    assert not (folder / "qif" / "results.qif").exists()


def test_the_floor_of_the_localisation_is_that_of_the_option(folder, capsys):
    """It adds its square to what is uneven in the image, and the rest stays with given poses."""
    budgets = []
    for floor in ("0.05", "0.03", "0.01px"):
        assert run(folder, "good", *given(folder), "--floor-px", floor, out="floor") == 0
        data = json.loads((folder / "floor" / "results.json").read_text())
        budgets.append(data["results"][0]["readings"][0]["variance"])
    wide, usual, narrow = (budget["localisation floor"] for budget in budgets)
    # 25, 9 and 1 times the same, and something in addition
    assert wide - usual == pytest.approx(2 * (usual - narrow), rel=1e-9)
    assert 0 < narrow < usual < wide
    assert len({budget["localisation"] for budget in budgets}) == 1
    assert run(folder, "good", "--floor-px", "-1", out="floor") == 2
    assert "--floor-px" in capsys.readouterr().err


def test_one_bad_part_has_a_reason_and_the_others_are_measured(folder, tmp_path, capsys):
    """Neither a torn image nor a link that leads nowhere ends the work, nor a name that is not UTF-8."""
    torn = tmp_path / "N1"
    torn.mkdir()
    for k in (1, 2):
        (torn / f"setting_{k:02d}.png").write_bytes(b"no image")
    (tmp_path / "N2").symlink_to(tmp_path / "nowhere")
    os.mkfifo(tmp_path / "N3")
    last = Path(os.fsdecode(os.fsencode(tmp_path) + b"/N\xe9"))
    last.symlink_to(folder / "good")
    (tmp_path / "notes.txt").write_text("no part")
    assert run(folder, tmp_path, *given(folder), "--parts", "--qif", out="many") == 2
    out, error = capsys.readouterr()
    assert error == "aspectgraph: 3 of 4 parts not measured: N1, N2, N3\n"
    assert "N1: not measured: the images must be as the plan's camera takes them" in " ".join(
        out.split()
    )
    assert "N2: not measured: the images must be an existing folder. Got a link" in out.replace(
        "\n", " "
    )
    rows = table_of(folder / "many" / "results.csv")
    assert [row["serial"] for row in rows] == ["N1", "N2", "N3", r"N\xe9"]
    assert [row["decision"] for row in rows] == [*["not measured"] * 3, "conforms"]
    assert rows[1]["reason"].startswith("the images must be an existing folder. Got a link")
    results = Path(os.fsdecode(os.fsencode(folder / "many") + b"/N\xe9"), "results.json")
    assert json.loads(results.read_text(encoding="utf-8"))["serial"] == r"N\xe9"
    assert run(folder, tmp_path, *given(folder), "--parts", "--json", out="many") == 2
    records = json.loads(capsys.readouterr().out)
    assert [set(record) == {"serial", "not_measured"} for record in records] == [True] * 3 + [False]


@pytest.mark.parametrize(
    "name", ["results.json", "results.csv", "results.qif", "report.html", "plan.json"]
)
def test_files_of_somebody_else_stay(folder, tmp_path, capsys, name):
    (tmp_path / name).write_text("mine")
    assert run(folder, "good", *given(folder), out=tmp_path) == 2
    error = capsys.readouterr().err
    assert error.startswith("aspectgraph: --out must be a folder without files of others. Got ")
    assert f"{name}" in error
    assert (tmp_path / name).read_text() == "mine"
    assert run(folder, "good", *given(folder), "--force", out=tmp_path) == 0


def test_results_of_another_serial_stay(folder, tmp_path, capsys):
    assert run(folder, "good", *given(folder), "--serial", "N1", out=tmp_path) == 0
    assert run(folder, "good", *given(folder), "--serial", "N1", out=tmp_path) == 0
    assert run(folder, "good", *given(folder), "--serial", "N2", out=tmp_path) == 2
    told = "results.json, which is of serial 'N1' and not of 'N2'; --force replaces it."
    assert told in capsys.readouterr().err
    assert run(folder, "good", *given(folder), out=tmp_path) == 2
    told = "results.json, which is of serial 'N1', and none is given; --force replaces it."
    assert told in capsys.readouterr().err
    assert json.loads((tmp_path / "results.json").read_text())["serial"] == "N1"


def test_a_plan_without_the_light_asked_for_says_so(folder, capsys, tmp_path):
    """As where the time limit ended before lamps were found."""
    part = PartRecord.of(read_solid(folder / "plate.off"))
    plan = measured_plan(thick_plate(), ["width"], part=part, lighting=Lighting("ring"))
    plan.write(tmp_path / "plan.json")
    part_options = "--part", str(folder / "plate.off"), "--units", "mm"
    plan_file = str(tmp_path / "plan.json")
    images = str(tmp_path / "images")
    assert main(["render", plan_file, *part_options, "--out", images]) == 0
    note = "aspectgraph: the light that was requested is not planned yet; a lamp on the camera"
    assert note in capsys.readouterr().err
    results = str(tmp_path / "results")
    main(["measure", plan_file, images, *part_options, "--out", results])
    told = "light was requested and is not planned yet, so nothing is promised of contrast"
    assert told in " ".join(capsys.readouterr().out.split())
    assert told in json.loads((tmp_path / "results" / "results.json").read_text())["notes"]


def test_a_rendering_stays_out_of_folders_of_others(folder, capsys, tmp_path):
    plan = measured_plan(
        thick_plate(), ["width"], settings=1, part=PartRecord.of(read_solid(folder / "plate.off"))
    )
    plan.write(tmp_path / "plan.json")

    def rendered(*more, plan=tmp_path / "plan.json"):
        part = "--part", str(folder / "plate.off"), "--units", "mm"
        code = main(["render", str(plan), *part, "--out", str(tmp_path / "out"), *more])
        return code, capsys.readouterr().err

    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "bracket.step").write_text("mine")
    code, told = rendered()
    assert code == 2
    assert told.startswith("aspectgraph: --out must be a folder without files of others. Got ")
    assert told.endswith("bracket.step; give a new folder, or write there with --force.\n")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["bracket.step"]
    assert rendered("--force")[0] == 0
    # as its own folder, whatever else is there, and whenever the plan was made
    assert rendered("--seed", "1")[0] == 0
    code, told = rendered(plan=folder / "plan.json")
    assert code == 2
    assert "truth.json, which is of another plan; --force replaces it." in told
    (tmp_path / "out" / "truth.json").write_text("{}")
    assert "truth.json, which 'render' did not write; --force replaces it." in rendered()[1]


def test_rendered_images_are_measured(folder, capsys, monkeypatch):
    """The whole chain without a camera: render, then measure."""
    monkeypatch.chdir(folder)
    plan = str(folder / "plan.json")
    part = str(folder / "plate.off")
    images = "rendered"
    assert main(["render", plan, "--part", part, "--units", "mm", "--out", images]) == 0
    printed = capsys.readouterr()
    assert "3 files in rendered/; open rendered/truth.json" in printed.out
    assert "the plan has no light; a lamp on the camera" in printed.err
    assert "rendered as designed" not in printed.err
    assert run(folder, "rendered", out="rehearsed") == 0
    truth = json.loads((folder / "rendered" / "truth.json").read_text())
    (result,) = json.loads((folder / "rehearsed" / "results.json").read_text())["results"]
    assert abs(result["value"] - truth["values"]["setting_01"]["width"]) <= 1.5 * result["U"]


@pytest.mark.parametrize(("more", "n"), [((), 1), (("--surfaces-mm", "0"), 0), (("--quiet",), 0)])
def test_a_rehearsal_without_deviations_says_so(folder, capsys, tmp_path, more, n):
    """As of plans for lengths of edges, which state none; a user who asks for it knows."""
    part = PartRecord.of(read_solid(folder / "plate.off"))
    plan = measured_plan(thick_plate(), ["width"], part=part)
    as_designed = replace(plan.targets["width"], stated_surfaces_mm=0.0)
    changed(plan, targets=(as_designed,)).write(tmp_path / "plan.json")
    part_options = "--part", str(folder / "plate.off"), "--units", "mm"
    out = str(tmp_path / "images")
    assert main(["render", str(tmp_path / "plan.json"), *part_options, "--out", out, *more]) == 0
    note = (
        "the plan states no deviation of faces, so the part is rendered as designed; --surfaces-mm"
    )
    assert capsys.readouterr().err.count(note) == n


def test_a_rehearsal_says_that_its_edges_are_sharp(folder, capsys):
    """What is stated of the whole part has an option that overrules it; what a target states has none."""
    plan = read_plan(folder / "plan.json")
    name = next(iter(plan.targets))
    own = replace(plan.targets[name], edge_break_mm=(0.02, 0.1))
    changes = {
        "plain": (plan, 0, 0, 1),
        "sharp": (changed(plan, edge_break_mm=(0.0, 0.0)), 0, 0, 0),
        "stated": (changed(plan, edge_break_mm=(0.05, 0.1)), 1, 0, 0),
        "own": (changed(plan, targets=(own, *list(plan.targets.values())[1:])), 0, 1, 0),
    }
    for key, (one, n_stated, n_own, n_assumed) in changes.items():
        path = folder / f"sharp_{key}.json"
        one.write(path)
        words = ["render", str(path), "--part", str(folder / "plate.off"), "--units", "mm"]
        assert main([*words, "--out", str(folder / f"sharp_{key}")]) == 0
        text = capsys.readouterr().err
        assert text.count("the plan states that they are broken by 0.05 to 0.1 mm") == n_stated
        assert text.count(f"1 target of the plan, such as {name}, count on broken ones") == n_own
        assert text.count("'measure' counts on small breaks, as of a real part") == n_assumed


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ((), "0.02 mm at most, as the plan states of each; --surfaces-mm states another"),
        (("--surfaces-mm", "0.2"), "0.2 mm, as --surfaces-mm states"),
    ],
)
def test_a_rehearsal_says_how_far_the_part_deviates(folder, capsys, more, text):
    words = [
        "render",
        str(folder / "plan.json"),
        "--part",
        str(folder / "plate.off"),
        "--units",
        "mm",
    ]
    assert main([*words, "--out", str(folder / f"drawn{len(more)}"), *more]) == 0
    told = capsys.readouterr().err
    largest, rest = re.search(r"faces of the part deviate by up to (\S+) mm, (.*)", told).groups()
    round_ones = "that of radii and axes is 1.5 times as large"
    assert rest == f"drawn with a standard deviation of {text}; {round_ones}"
    sigma = float(text.split()[0])
    # of so many faces, one is off by more than a standard deviation, and none by six
    assert sigma < float(largest) < 6 * sigma


def test_measuring_says_which_image_it_is_at(folder, capsys):
    """Without --verbose, only what takes long is a line."""
    assert run(folder, "good", "--verbose", out="shown") == 0
    lines = capsys.readouterr().err
    for label in ("preparing images", "registering images", "measuring in images"):
        assert f"{label}: 2/2 (" in lines


def test_a_part_without_a_value_is_named_at_the_end(folder, tmp_path, capsys):
    """Its images are those of other settings, which show the targets elsewhere."""
    (tmp_path / "whole").symlink_to(folder / "good")
    flat = tmp_path / "flat"
    flat.mkdir()
    names = sorted(path.name for path in (folder / "good").iterdir())
    for name, other in zip(names, reversed(names), strict=True):
        shutil.copy(folder / "good" / other, flat / name)
    run(folder, tmp_path, *given(folder), "--parts", out="named")
    assert capsys.readouterr().err == "aspectgraph: 1 of 2 parts without a value: flat\n"
