"""The commands and snippets of the tutorial and the guides run as printed; see also test_readme.py."""

import csv
import importlib.util
import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import pytest

from planner import effort, read_plan
from planner.app.main import main
from planner.app.parsing import parse
from planner.measuring.results import results_schema

ROOT = Path(__file__).parents[1]
NAMED = ("tutorial", "dimensions", "cameras", "light", "showing")
PAGES = [
    *(ROOT / f"docs/{name}.md" for name in NAMED),
    *sorted((ROOT / "docs/guides").glob("*.md")),
]
# its parts and machines are the reader's: read by the command line, but not run
CLUSTERS = ROOT / "docs/clusters.md"
SNIPPET = re.compile(r"^```python\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
TOML = re.compile(r"^```toml\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"^    (aspectgraph .*)$", flags=re.MULTILINE)

BRIEF = replace(
    effort.QUICK,
    viewpoints=20,
    pricing_rounds=3,
    refutations=1,
    bound_nodes=20_000,
    margin_generations=3,
)


def shown(page):
    """The text of a page, its commands on a line each."""
    return re.sub(r" *\\\n *", " ", page.read_text("utf-8"))


def commands(page):
    return [shlex.split(line, comments=True)[1:] for line in COMMAND.findall(shown(page))]


def snippets(page):
    return SNIPPET.findall(page.read_text("utf-8"))


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A folder with the examples, to write to."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    # what a page says of the plan is true of a shorter search, too
    monkeypatch.setitem(effort._PRESETS, "quick", BRIEF)
    return tmp_path


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_all_that_is_shown_is_known_here(page):
    """Of fenced blocks only Python and TOML are shown, and of commands only ours."""
    text = shown(page)
    kinds = re.findall(r"^```(\w*)$", text, flags=re.MULTILINE)[::2]
    assert set(kinds) <= {"python", "toml"}
    assert kinds.count("python") == len(snippets(page))
    outside = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    indented = [line for line in outside.splitlines() if line.startswith("    ")]
    assert len(indented) == len(commands(page))
    for words in commands(page):
        options = parse(words)
        for name in ("part", "camera", "entities"):
            value = getattr(options, name, None)
            assert not str(value).startswith("examples/") or (ROOT / value).is_file()


@pytest.mark.parametrize(
    "page", [page for page in PAGES if commands(page)], ids=lambda page: page.stem
)
def test_commands_run_as_printed(page, clone, capsys):
    if page.stem == "dimensions":
        (clone / "wanted.toml").write_text(
            TOML.search(page.read_text("utf-8"))[1], encoding="utf-8"
        )
    for words in commands(page):
        # the tutorial says that a target may have no value
        codes = (0, 1) if words[:2] == ["measure", "boss"] else (0,)
        assert main(words) in codes, words
    if page.stem == "tutorial":
        out = capsys.readouterr().out
        check_rehearsal()
        assert "12 of 12 entities inspected from 1 setting" in out
        assert "proven to be the fewest" in out
        assert read_plan("boss/plan.json").complete
        assert "<html" in Path("edges.html").read_text(encoding="utf-8")
    if page.stem == "measuring":
        # the table on that page is filled with these, see docs/tables.py
        spec = importlib.util.spec_from_file_location("tables", ROOT / "docs/tables.py")
        tables = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(tables)
        assert tables.example_rows(Path("measured")) == tables.stored("example")["rows"]
    if page.stem == "dimensions":
        # as the snippet of that page asks, in Python
        assert set(read_plan("plan-wanted/plan.json").dimensions) == {"bore", "width", "front"}
        # what the file states, see the table on that page
        assert len(read_plan("plan-all/plan.json").inspected) == 12


def check_rehearsal():
    """Nearly all edges are measured, and 19 of 20 values are to be within U of the true one."""
    by_image = json.loads(Path("boss-images/truth.json").read_text())["values"]
    truth = {name: value for values in by_image.values() for name, value in values.items()}
    results = json.loads(Path("boss-measured/results.json").read_text())["results"]
    measured = [result for result in results if not result["reason"]]
    assert len(measured) >= 11
    within = [abs(one["value"] - truth[one["name"]]) <= one["U"] for one in measured]
    assert within.count(False) <= 2


def test_no_command_meets_the_plan_of_another_page():
    """A reader runs them all in one folder, where a plan of another request is refused."""
    folders = {}
    for page in [ROOT / "README.md", *PAGES]:
        for words in commands(page):
            if words[0] == "plan":
                folders.setdefault(parse(words).out, []).append(page.name)
    assert len(folders) > 8
    assert [pages for pages in folders.values() if len(pages) > 1] == []


def test_commands_for_clusters_are_known():
    found = commands(CLUSTERS)
    assert len(found) == 2
    assert {parse(words).name() for words in found} == {"batch"}


@pytest.mark.parametrize(
    "page", [page for page in PAGES if snippets(page)], ids=lambda page: page.stem
)
def test_snippets_give_what_the_page_says(page, clone, capsys):
    """Each page has a check of its own, below: of its values, its files and what it prints."""
    assert page.stem in CHECKS
    names = {"__name__": page.stem}
    for snippet in snippets(page):
        exec(compile(snippet, page.name, "exec"), names)
    names["printed"] = capsys.readouterr().out
    assert names["printed"] or page.stem in SILENT
    CHECKS[page.stem](names)


def tutorial(names):
    assert names["plan"].complete
    # one camera pose measures all twelve edges, and no plan has fewer
    assert len(names["plan"].settings) == names["plan"].lower_bound == 1
    assert "1 setting (at least 1 needed), 12 of 12 entities inspected" in names["printed"]
    assert len(names["plan"].entities) == 12
    assert Path("plan.csv").read_text().count("\n") >= 13
    assert "<svg" in Path("image.svg").read_text()
    assert Path("poses_ros.yaml").is_file()


def dimensions(names):
    assert set(names["plan"].dimensions) == {"bore", "width", "front"}
    # a quarter of half the tolerance's width
    assert names["plan"].dimensions["bore"].permitted_error == 0.125
    # 20 H7 and 20 g6; the files state 12 and 10 dimensions, the latter on 14 features, one for reference
    lines = names["printed"].splitlines()
    assert lines[:2] == ["(0.0, 0.021)", "(-0.02, -0.007)"]
    # 12 dimensions of CTC-01, the counts of CTC-03, and 6 geometric tolerances of CTC-01
    assert lines[14:16] == ["10 13 1", "dict_keys(['Linear Size.11'])"]
    assert len(lines) == 2 + 12 + 2 + 6


def from_a_drawing(names):
    # a quarter of the zone of 0.2 mm: the value of a position is twice its deviation
    first, *reasons, last = names["printed"].splitlines()
    assert float(first) == pytest.approx(0.05)
    # as the commands of the page count: 12 dimensions, of 6 geometric tolerances 2 positions
    assert len(names["wanted"]) == 12
    assert len(reasons) == len(names["left_out"]) == 6
    assert all(" is not planned: " in line for line in reasons)
    assert "12 of 12 dimensions inspected" in last


def cameras(names):
    # 2381.9 px of 0.00345 mm
    assert names["camera"].image_distance_mm == pytest.approx(2381.9 * 0.00345)
    assert names["camera"].principal_point_px == (1231.6, 1019.2)
    assert names["found"][0].able == ("rim",)
    assert "basler-acA2440-20gm" in names["printed"]


def light(names):
    assert read_plan("plan.json").light.kind == "ring"
    # of the last choice, in front of metal
    assert names["light"].kind == "coaxial"
    assert names["plan"].complete
    assert "showing" in next(iter(names["graph"].graph.nodes.values()))


def showing(names):
    assert names["plan"].complete
    # by default, and without conditions
    first, second = names["printed"].splitlines()
    assert "'separation_px': 5" in first
    assert "'separation_px': 5" not in second
    # of the last request, which asks nothing
    assert not any(
        names["plan"].requirements.get(key)
        for key in ("separation_px", "surround_px", "min_corner_deg")
    )


def camera_and_tolerance(names):
    # the thin lens: 1/8 = 1/300 + 1/d gives d = 8.219 mm; 50 mm at 300 mm in pixels of 3.45 um
    assert names["pixels"] == pytest.approx(50 / 300 * (8 * 300 / 292) / 0.00345)
    # 397.07 px, and a hundredth of it
    assert names["printed"].startswith("397 px long, 4.0 px permitted\n")


def margins_and_budgets(names):
    rows = names["plan"].rows()
    assert {row["name"] for row in rows} == {"rim", "width"}
    # each row, the requirements, and each measurement with its budget
    lines = names["printed"].splitlines()
    assert len(lines) == len(rows) + 1 + len(rows)
    assert all("'margin_focus_mm'" in line for line in lines[: len(rows)])
    # the budget divides the variance
    one = names["one"]
    assert sum(one.budget.values()) == pytest.approx(one.standard_uncertainty**2)
    assert all(
        value >= 0 for row in rows for key, value in row.items() if key.startswith("margin_")
    )


def pose_uncertainty(names):
    import numpy as np

    # of a normal displacement the distance is Maxwell's: mean 2 s sqrt(2/pi), variance s^2 (3 - 8/pi)
    assert 2 * (2 / np.pi) ** 0.5 + 3 * (3 - 8 / np.pi) ** 0.5 == pytest.approx(3.62, abs=0.005)
    # 20 poses: a standard deviation is off by 16 % itself, and four of these are rarely exceeded
    assert names["measured"].sigmas == pytest.approx([0.1] * 3 + [0.0005] * 3, rel=0.64)
    # rotations of 0.2 mrad about the flange move the camera by that times its lever arm, per axis by at most all of it
    lever = float(np.hypot(60, 120)) * 0.0002
    assert np.all(
        names["uncertainty"].sigmas[:3] <= (0.1**2 + (0.05 / 3.62) ** 2 + lever**2) ** 0.5 + 1e-12
    )


def poses_that_exist(names):
    # nine poses are in the file, and one of them inspects both
    assert len(names["poses"]) == 9
    both = set.intersection(*(set(names["predicted"].inspecting(name)) for name in ("e1", "e4")))
    assert both == {"pose_02"}
    assert names["predicted"].missed == {}
    assert names["printed"].endswith("1 True\n")


def robot_programs(names):
    import numpy as np

    pose = names["pose"]
    *written, ur, kuka, fanuc, abb = names["printed"].splitlines()
    assert [ur, kuka, fanuc, abb] == [names[maker] for maker in ("ur", "kuka", "fanuc", "abb")]
    assert written[0].startswith("<RobotProgram of 'two_pocket_block'")
    assert any(line.strip().startswith("movej(") for line in written)
    assert np.allclose(
        names["part2base"] @ names["plan"].settings[0].cam2world, pose @ names["cam2flange"]
    )

    def cos(t):
        return np.cos(np.radians(t))

    def sin(t):
        return np.sin(np.radians(t))

    def about(axis, t):
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        turn = np.eye(3)
        turn[[i, i, j, j], [i, j, i, j]] = cos(t), -sin(t), sin(t), cos(t)
        return turn

    # about z, then the new y, then the new x; and W, P, R about the fixed x, then y, then z
    assert np.allclose(
        about(2, names["a"]) @ about(1, names["b"]) @ about(0, names["c"]), pose[:3, :3]
    )
    assert np.allclose(
        about(2, names["r"]) @ about(1, names["p"]) @ about(0, names["w"]), pose[:3, :3]
    )
    # the rotation vector is the axis, which the rotation leaves alone
    axis = np.array([names["rx"], names["ry"], names["rz"]])
    assert np.allclose(pose[:3, :3] @ axis, axis)
    assert np.trace(pose[:3, :3]) == pytest.approx(1 + 2 * np.cos(np.linalg.norm(axis)))
    # the matrix of a quaternion w x y z: its first column
    w = names["qw"]
    x = names["qx"]
    y = names["qy"]
    z = names["qz"]
    assert np.allclose(
        pose[:3, 0], [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
    )


def robot_cells(names):
    import numpy as np

    assert names["printed"].startswith("True [[")
    # the camera looks down from 300 mm above the table, and the flange is 90 mm above it
    flange = names["robot"].forward(names["answer"].branches[0])
    assert np.allclose(flange[:3, 3], [630.0, 30.0, 390.0])


def many_cores(names):
    assert names["together"] == names["alone"]


# they print nothing
SILENT = ("light", "many-cores")


def read_results_of(path):
    """Value and U of a table of results, by name."""
    with Path(path).open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    return {row["name"]: (float(row["value"]), float(row["U"])) for row in rows}


def measuring(names):
    results = names["results"]
    # known because the images are rendered: benchmarks/images/measured_example.py
    true = {"bore_25": 24.8098, "bore_35": 34.9835, "slot_width": 49.9978, "bore_35_back": 34.8587}
    for name, value in true.items():
        assert abs(results[name].value - value) < results[name].expanded_uncertainty
    assert names["printed"].count(" conforms") == 4
    block = read_results_of("block.csv")
    assert list(block) == ["width", "height"]
    # the part deviates by 0.02 mm, and its values are to be within U of the true ones
    truth = json.loads(Path("block-images/truth.json").read_text())["values"]["setting_01"]
    for name, (value, spread) in block.items():
        assert abs(value - truth[name]) < spread
    assert "<svg" in Path("block.html").read_text(encoding="utf-8")
    assert "<svg" in names["page"]


def plan_file(names):
    import numpy as np

    # both edges are in front of the camera, and the program's own reader says the same of them
    assert names["plan"].lower_bound == 1
    assert "['e1', 'e4']" in names["printed"]
    pose = names["plan"].settings[0].cam2world
    line = np.array(names["plan"].targets["e4"].ends)
    assert np.allclose(
        (line - pose[:3, 3]) @ pose[:3, :3], (names["ends"] - pose[:3, 3]) @ pose[:3, :3]
    )
    data = read_plan("examples/two_pocket_block_plan.json").to_dict()
    assert listed_keys("The keys of plan.json") >= data.keys()
    assert listed_keys("The request") == data["request"].keys()
    assert listed_keys("A setting") >= data["settings"][0].keys()
    stored = results_schema()["$defs"]["ResultsFile"]["properties"]
    assert listed_keys("The keys of results.json") == stored.keys()


def listed_keys(heading):
    """Keys in the table under a heading of the page on the files."""
    page = (ROOT / "docs/guides/plan-file.md").read_text("utf-8")
    section = re.split(r"^#+ ", page.partition(f"# {heading}\n")[2], flags=re.MULTILINE)[0]
    cells = re.findall(r"^\| (`.*?) \|", section, flags=re.MULTILINE)
    return {key for cell in cells for key in re.findall(r"`(\w+)`", cell)}


CHECKS = {
    function.__name__.replace("_", "-"): function
    for function in (
        tutorial,
        dimensions,
        from_a_drawing,
        cameras,
        light,
        showing,
        camera_and_tolerance,
        margins_and_budgets,
        pose_uncertainty,
        robot_programs,
        poses_that_exist,
        robot_cells,
        many_cores,
        measuring,
        plan_file,
    )
}
