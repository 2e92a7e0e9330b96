"""Tables of the documents say what the program says: generated ones are current, others name all there is."""

import hashlib
import importlib
import importlib.util
import inspect
import json
import re
import shlex
from dataclasses import MISSING, fields
from pathlib import Path

import pytest

from planner import Camera, CameraError
from planner.app import process
from planner.app.options import COMMANDS, Showing
from planner.measuring.reading import SOURCES
from planner.measuring.results import STATUSES, results_schema
from planner.plan_record import plan_schema
from planner.report.plan_folder import POSE_FILES
from planner.robotcell.arm import Robot
from planner.robotcell.bodies import DEFAULT_ANGLES
from planner.robotcell.cell import Cell, Fixturing
from planner.robotprogram.program_texts import FORMATS

ROOT = Path(__file__).parents[1]
spec = importlib.util.spec_from_file_location("tables", ROOT / "docs/tables.py")
TABLES = importlib.util.module_from_spec(spec)
spec.loader.exec_module(TABLES)


def rows_of(page, head):
    """The rows of the table of a page that begins with a head, as lists of cells."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    start = text.index(f"| {head} |")
    lines = text[start:].split("\n\n")[0].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def code(cells):
    """All that the cells show as code, in their order."""
    return re.findall(r"`([^`]+)`", " ".join(cells))


def firsts(rows):
    return [row[0] for row in rows]


def test_generated_tables_are_current():
    """If this fails, run docs/tables.py; what takes long is stored with its options."""
    pages = TABLES.pages()
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    assert set(re.findall(r"<!-- table ([\w-]+) -->", text)) == set(TABLES.TABLES)
    assert text.count("<!-- table ") == text.count("<!-- end of table -->")
    for page in pages:
        assert TABLES.filled(page.read_text(encoding="utf-8")) == page.read_text(encoding="utf-8")


def test_stored_counts_are_of_the_models_of_their_digests():
    data = TABLES.stored("models")
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", data["date"])
    assert list(data["models"]) == list(TABLES.MODELS)
    digests = [model["sha256"] for model in data["models"].values()]
    example = ROOT / "examples" / TABLES.MODELS["CTC-01"]
    assert digests[0] == hashlib.sha256(example.read_bytes()).hexdigest()
    models = data["models"].values()
    total = sum(model["characteristics"] for model in models)
    measurable = sum(model["measurable"] for model in models)
    zones = sum(len(model["zones"]) for model in models)
    page = " ".join((ROOT / "docs/dimensions.md").read_text(encoding="utf-8").split())
    assert f"Together {measurable} measurable dimensions have {total} characteristics" in page
    assert f"state {total} characteristics that can be measured, and zones for {zones}" in page


def test_stored_values_are_of_the_images_of_the_example():
    data = TABLES.stored("example")
    folder = ROOT / "examples/measured"
    assert data["plan_digest"] == hashlib.sha256((folder / "plan.json").read_bytes()).hexdigest()
    assert list(data["images"]) == [path.stem for path in sorted((folder / "images").iterdir())]
    page = (ROOT / "docs/guides/measuring.md").read_text(encoding="utf-8")
    assert shlex.split(data["command"]) == shlex.split(
        re.search(r"^    (aspectgraph measure examples/measured.*\\\n.*)$", page, re.MULTILINE)[
            1
        ].replace("\\\n", "")
    )


def test_measured_gaps_do_not_refute_the_bound():
    """No cover of any poses is smaller than the bound, and a plan's own settings are columns of the pool."""
    rows = TABLES.stored("gaps")["rows"]
    assert {row["part"] for row in rows} <= set(TABLES.GAPS)
    for row in rows:
        assert row["bound"] <= row["optimum"] <= row["counted"] <= row["plan"], row["part"]
        assert row["relaxation"] - 0.01 <= row["at_least"] <= row["optimum"], row["part"]
        assert row["targets"] <= row["asked"]


@pytest.mark.parametrize(
    ("numbers", "other", "verdict"),
    [
        ((5, 4, 4), None, "near the bound"),
        ((6, 4, 6), None, "smallest known"),
        ((6, 4, 5), None, "1 above the smallest known"),
        # another plan of as many targets is known, or of fewer
        ((6, 3, 6), (4, 10), "2 above the smallest known"),
        ((6, 3, 6), (4, 9), "smallest known"),
    ],
)
def test_a_plan_is_short_by_its_bound_or_by_the_smallest_cover(numbers, other, verdict):
    """The factor of the bound is 1.25."""
    row = dict(zip(("plan", "bound", "counted"), numbers, strict=True), targets=10)
    if other is not None:
        other = dict(zip(("settings", "inspected"), map(str, other), strict=True))
    assert TABLES.gap_verdict(row, other) == verdict


def keys_of(schema, name):
    return set(schema["$defs"][name]["properties"])


def test_keys_of_files_are_those_of_their_schemas():
    page = (ROOT / "docs/guides/plan-file.md").read_text(encoding="utf-8")
    _, *tables = page.split("| key | content |\n|---|---|\n")
    listed = []
    for table in tables:
        rows = [line.strip("|").split("|") for line in table.split("\n\n")[0].splitlines()]
        listed.append(set(code(firsts(rows))))
    whole, request, _, setting, results = listed
    plan = plan_schema()
    assert whole == keys_of(plan, "PlanFile")
    # among the limits of a setting
    assert request | {"focus_reserve"} == keys_of(plan, "Request") | {"focus_reserve"}
    assert setting == keys_of(plan, "SettingRecord")
    assert results == keys_of(results_schema(), "ResultsFile")


def test_conditions_on_the_image_have_their_defaults():
    """Those of the options: a call in Python that states none has none."""
    stated = {code([row[1]])[0]: row[2] for row in rows_of("showing.md", "condition | option")[:3]}
    for name, text in stated.items():
        assert float(re.match(r"[\d.]+", text)[0]) == getattr(Showing, name), name


def test_defaults_of_cells_are_those_of_their_files():
    turning = {field.name: field.default for field in fields(Fixturing)}
    of_robot = inspect.signature(Robot.from_urdf).parameters
    defaults = {
        "clearance_mm": inspect.signature(Cell).parameters["clearance_mm"].default,
        "robot.tip": of_robot["tip"].default,
        "robot.accelerations": of_robot["accelerations"].default,
        "angles": DEFAULT_ANGLES,
        "turn_speed": turning["turn_speed"],
        "turn_acceleration": turning["turn_acceleration"],
    }
    stated = {}
    for first, _, meaning in rows_of("guides/robot-cells.md", "field | unit | meaning"):
        default = re.search(r"Default: (?:`(\w+)`|([\d.]*\d))", meaning)
        for name in code([first]) if default else ():
            stated[name] = default[1] or float(default[2])
    assert {name: stated[name] for name in defaults} == defaults


def test_tables_name_all_there_is():
    commands = code(firsts(rows_of("guides/command-line.md", "command | what it does")))
    assert sorted(commands) == sorted(COMMANDS)
    codes = [process.DONE, process.INCOMPLETE, process.BAD_INPUT, process.NOT_REGISTERED]
    codes += [process.INTERNAL, process.NOBODY_READS]
    assert firsts(rows_of("guides/command-line.md", "code | meaning")) == list(map(str, codes))
    assert firsts(rows_of("guides/measuring.md", "part | from")) == list(SOURCES)
    decisions = [decision.value for decision in STATUSES]
    assert firsts(rows_of("guides/measuring.md", "decision | meaning")) == decisions
    files = rows_of("guides/robot-programs.md", "`--format` | file | joints")
    assert [tuple(code(row[:2])[:2]) for row in files] == list(FORMATS.items())
    poses = code(firsts(rows_of("guides/robot-programs.md", "file | pose | camera's axes")))
    assert set(poses) <= set(POSE_FILES)


def test_the_margins_that_are_explained_are_those_of_a_plan():
    data = json.loads((ROOT / "examples/two_pocket_block_plan.json").read_text(encoding="utf-8"))
    margins = set(data["settings"][0]["margins"])
    explained = set(code(firsts(rows_of("guides/margins-and-budgets.md", "margin | meaning"))))
    assert margins <= explained


def test_constants_of_the_proof_are_those_of_the_code():
    """A row that names a constant states its value: powers of ten, or percents."""
    n = 0
    for allowance, where, *_ in rows_of("mathematics/lower-bound.md", "allowance | where"):
        powers = re.findall(r"\$(?:(\d+)\\cdot)?10\^\{(-\d+)\}\$", allowance)
        stated = [int(factor or 1) * 10.0 ** int(power) for factor, power in powers]
        stated += [int(percent) / 100 for percent in re.findall(r"^(\d+) %", allowance)]
        for module, name in re.findall(r"`(planner\.bound\.\w+)\.([A-Z_]+)`", where):
            value = getattr(importlib.import_module(module), name)
            # of a factor, how far it is from 1
            either = (value, abs(value - 1))
            close = [pytest.approx(number, rel=1e-6) in either for number in stated]
            assert any(close) or not stated, name
            n += any(close)
    assert n >= 6


def test_the_fields_of_a_camera_file_are_those_that_are_read(tmp_path):
    rows = rows_of("cameras.md", "field | unit | meaning | default")
    assert all(len(row) == 4 and all(row) for row in rows)
    known = {item.name: item.default is MISSING for item in fields(Camera)}
    assert code(firsts(rows)) == [*known, "calibration"]
    required = {name.strip("`"): default == "required" for name, _, _, default in rows}
    assert required == {**known, "calibration": False}
    for name, unit, *_ in rows:
        if name.strip("`").endswith(("_mm", "_px")):
            assert name.strip("`").endswith(f"_{unit}")
    file = tmp_path / "left.toml"
    file.write_text("field = 1\n")
    with pytest.raises(CameraError, match="must be left out, or renamed to one of ") as refusal:
        Camera.from_toml(file)
    listed = re.search("renamed to one of (.*?)\\.", str(refusal.value))[1].split(", ")
    assert listed == list(known)


def test_the_defaults_of_a_camera_file_are_as_the_page_says(tmp_path):
    example = ROOT / "examples/camera.toml"
    file = tmp_path / "left.toml"
    file.write_text(re.sub(r"(?m)^name = .*$", "", example.read_text()))
    camera = Camera.from_toml(file)
    assert camera.name == "left"
    assert camera.largest_blur_mm == min(camera.pixel_pitch_mm)
    for name in ("principal_point_px", "distortion", "white_level", "response"):
        assert getattr(camera, name) is None
    # what a calibration gives is not required
    calibration = tmp_path / "cameras.txt"
    calibration.write_text("1 PINHOLE 2448 2048 2381.9 2382.4 1231.6 1019.2\n")
    file.write_text(
        'calibration = "cameras.txt"\npixel_pitch_mm = 0.00345\nf_number = 8\nfocus_distance_mm = 300\n'
    )
    camera = Camera.from_toml(file)
    assert camera.resolution == (2448, 2048)
    # its first pixel's centre is (0.5, 0.5)
    assert camera.principal_point_px == pytest.approx((1231.1, 1018.7))


def test_a_notebook_has_the_true_values_of_the_guide():
    """Both know them from the same rendering, and show them with three decimals."""
    script = (ROOT / "notebooks/measuring.py").read_text("utf-8")
    stated = json.loads(re.search(r"^true = (\{.*\})$", script, re.M)[1])
    assert {name: f"{value:.3f}" for name, value in stated.items()} == TABLES.TRUE
    stored = (ROOT / "notebooks/measuring.ipynb").read_text("utf-8")
    shown = re.findall(r"(\w+) +[\d.]+ ± [\d.]+ mm   true +([\d.]+) ", stored)
    assert dict(shown) == TABLES.TRUE
