"""The command ``program``: files, tables, exit codes, and what it refuses in one line."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from robot_cells import ROBOTS

from planner import Backlight, Box, Cell, Fixturing, LightPlan, LitImage, read_plan
from planner.app.main import main
from planner.app.robot_commands import print_lamp_note
from planner.measuring.images import shots_of

ROOT = Path(__file__).parents[3]
PLAN = ROOT / "examples/two_pocket_block_plan.json"
PART = ROOT / "examples/two_pocket_block.off"
CELL = ROOT / "examples/cell.toml"
GIVEN = [str(PLAN), str(PART), "--cell", str(CELL), "--quiet"]


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("own_folder")
def test_a_program_is_written_and_its_rounds_are_printed(capsys):
    words = ["--format", "krl", "--speed", "25%", "--sigma-joints", "0.1mrad"]
    assert main(["program", *GIVEN, *words]) == 0
    out = capsys.readouterr().out
    assert "setting_01.png" in out
    assert re.match(r"the program visits (\d+) of \1 settings?\n", out)
    assert "25 % of the joints' speeds" in out
    assert "smallest P" in out
    assert out.splitlines()[-1] == "inspection.src"
    assert "$VEL_AXIS[i]=25" in Path("inspection.src").read_text("utf-8")


def test_lamps_are_said_to_be_no_obstacles_where_they_stand_somewhere(capsys):
    plan = read_plan(PLAN)
    cell = Cell.from_toml(CELL)
    print_lamp_note(plan, cell)
    assert capsys.readouterr().out == ""
    dark = ({},) * len(plan.settings)
    places = np.array([[100.0, 20.0, 300.0]])
    images = ((),) * len(plan.settings)
    placed = LightPlan("placed", 0.1, 0.1, "dark", places, images, dark, 1, "by hand")
    print_lamp_note(replace(plan, light=placed), cell)
    printed = " ".join(capsys.readouterr().out.split())
    assert (
        "no obstacles of the cell: lamp 1 at (100, 20, 300) mm in the frame of the part" in printed
    )
    # an obstacle about a lamp that moves with the part, in every fixturing
    middle = np.array([100.0, 20.0, 300.0])
    two = replace(placed, lamps=np.array([middle, [0.0, 0.0, 500.0]]))
    up = Fixturing(np.eye(4), {"lamp": Box(middle - 10, middle + 10)})
    shift = np.eye(4)
    shift[:3, 3] = (800.0, 300.0, 100.0)
    moved = up.moved(shift)
    print_lamp_note(replace(plan, light=placed), cell.with_fixturings({"up": up, "moved": moved}))
    assert capsys.readouterr().out == ""
    print_lamp_note(replace(plan, light=two), cell.with_fixturings({"up": up}))
    printed = " ".join(capsys.readouterr().out.split())
    assert (
        "of the plan's lamps, these are no obstacles of the cell: lamp 2 at (0, 0, 500)" in printed
    )
    assert "lamp 1" not in printed
    bare = Fixturing(np.eye(4))
    print_lamp_note(replace(plan, light=placed), cell.with_fixturings({"up": up, "bare": bare}))
    assert "lamp 1" in capsys.readouterr().out
    # what stands beside a turntable does not turn with the part
    axis = ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    beside = Fixturing(np.eye(4), up.obstacles, axis=axis)
    print_lamp_note(replace(plan, light=placed), cell.with_fixturings({"up": beside}))
    assert "lamp 1" in capsys.readouterr().out
    turned = Fixturing(np.eye(4), axis=axis, turning=up.obstacles)
    print_lamp_note(replace(plan, light=placed), cell.with_fixturings({"up": turned}))
    assert capsys.readouterr().out == ""
    # this one moves with the camera
    print_lamp_note(replace(plan, light=replace(placed, kind="ring")), cell)
    assert capsys.readouterr().out == ""
    back = Backlight.horizontal((40.0, 25.0, -5e-15), 200.0, 160.0)
    print_lamp_note(replace(plan, light=replace(placed, kind="backlight", area=back)), cell)
    printed = " ".join(capsys.readouterr().out.split())
    assert "no obstacle of the cell: a backlight of 200 x 160 mm at (40, 25, 0) mm" in printed
    assert "State it as [fixturings.NAME.light]" in printed


@pytest.mark.usefixtures("own_folder")
def test_the_printed_images_are_those_that_measure_asks_for_with_their_lamps(capsys):
    plan = read_plan(PLAN)
    names = plan.settings[0].entities
    lit = tuple(LitImage((lamp,), {name: 0.5}) for lamp, name in enumerate(names[:2]))
    places = np.array([[100.0, 20.0, 300.0], [0.0, 20.0, 300.0]])
    light = LightPlan("placed", 0.1, 0.1, "dark", places, (lit,), ({},), 1, "by hand")
    plan = replace(plan, light=light)
    plan.write("plan.json")
    words = ["--sigma-joints", "0.1mrad", "--simulate", "100"]
    assert main(["program", "plan.json", *GIVEN[1:], *words]) == 0
    rows = re.findall(r"\b1 +(setting_\S+) +(\d)\b", capsys.readouterr().out)
    asked = [f"{shot.name}.png" for shot in shots_of(plan)]
    assert asked == ["setting_01_1.png", "setting_01_2.png"]
    assert rows == list(zip(asked, ("1", "2"), strict=True))


@pytest.mark.usefixtures("own_folder")
def test_json_is_the_record(capsys):
    assert main(["program", *GIVEN, "--format", "json", "--out", "p.json", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads(Path("p.json").read_text("utf-8"))
    assert printed["speed"] == 0.5
    assert len(printed["tours"][0]["stops"]) == 1


@pytest.mark.usefixtures("own_folder")
def test_settle_and_signals_are_in_the_program():
    words = ["--settle", "250ms", "--trigger-output", "7", "--ready-input", "4"]
    assert main(["program", *GIVEN, *words]) == 2
    words[1] = "0.25"
    assert main(["program", *GIVEN, *words]) == 0
    script = Path("inspection.script").read_text("utf-8")
    assert "sleep(0.25)" in script
    assert "set_standard_digital_out(7, True)" in script
    assert "get_standard_digital_in(4)" in script


def cell_with(**changes):
    """A cell file beside the robots, with texts replaced."""
    text = CELL.read_text("utf-8").replace('"robots', f'"{ROOT}/examples/robots')
    for old, new in changes.values():
        assert old in text
        text = text.replace(old, new)
    path = Path("cell.toml")
    path.write_text(text, encoding="utf-8")
    return [str(PLAN), str(PART), "--cell", str(path), "--quiet"]


@pytest.mark.usefixtures("own_folder")
def test_a_plan_out_of_reach_is_not_done(capsys):
    given = cell_with(far=("xyz = [800.0, 300.0", "xyz = [5800.0, 300.0"))
    assert main(["program", *given]) == 1
    assert "Got none: setting 1: beyond the arm's reach." in capsys.readouterr().err
    assert not Path("inspection.script").exists()


@pytest.mark.usefixtures("own_folder")
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--speed", "0"], "--speed must be in (0, 1]. Got 0."),
        (
            ["--speed", "0.001", "--format", "krl"],
            "--speed must be at least 0.01 for krl. Got 0.001.",
        ),
        (["--speed", "1e-9"], "--speed must be at least 0.001 for urscript. Got 1e-09."),
        (["--speed", "1e-300", "--format", "json"], "--speed must be at least 0.001 for json."),
        (["--settle", "1e300"], "--settle must be 0, or from 0.001 to 3600 s. Got 1e+300."),
        (["--settle", "1e-9"], "--settle must be 0, or from 0.001 to 3600 s. Got 1e-09."),
        (["--speed", "150%"], "--speed must be in (0, 1]. Got 1.5."),
        (["--settle", "-1"], "--settle must be finite and not negative. Got -1."),
        (["--sigma-joints", "-1"], "--sigma-joints must be finite and not negative. Got -1."),
        (["--sigma-joints", "2rad"], "--sigma-joints must be in [0, 1] rad"),
        (["--sigma-part", "0.1"], "--sigma-part must be a length and an angle"),
        (["--sigma-hand-eye", "500,0.001"], "--sigma-hand-eye must have standard deviations"),
        (["--format", "ls"], "--format must be one of urscript, rapid"),
        (["--out", "none/a.script"], "--out must be in a folder that exists"),
        (["--out", "."], "--out must be a file"),
        (["--trigger-output", "-1"], "--trigger-output must be"),
        (["--ready-input", "99999"], "--ready-input must be at most 4096"),
    ],
    ids=lambda one: one[0] if isinstance(one, list) else "",
)
def test_bad_options(words, message, capsys):
    assert main(["program", *GIVEN, *words]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert len(err.strip().splitlines()) == 1


@pytest.mark.usefixtures("own_folder")
def test_a_cell_without_home(capsys):
    line = next(line for line in CELL.read_text("utf-8").splitlines() if "home_deg" in line)
    assert main(["program", *cell_with(home=(line, ""))]) == 2
    assert "home_deg of the cell file must be given for a program" in capsys.readouterr().err


@pytest.mark.usefixtures("own_folder")
def test_a_missing_cell(capsys):
    assert main(["program", str(PLAN), str(PART), "--cell", "none.toml"]) == 2
    assert "--cell must be an existing file" in capsys.readouterr().err


# The command ``reach``: tables, exit codes, and what it refuses.


EXAMPLES = ROBOTS.parent
PLAN_REACH_COMMAND = str(EXAMPLES / "two_pocket_block_plan.json")
PART_REACH_COMMAND = str(EXAMPLES / "two_pocket_block.off")
CELL_REACH_COMMAND = """
cam2flange = {{ xyz = [0, 0, 90] }}
[robot]
urdf = "{robots}/made_parallel.urdf"
packages = {{ made_robots = "{robots}" }}
[[camera_body]]
low = [-30, -30, -90]
high = [30, 30, 0]
[fixturings.up]
part2base = {{ xyz = [{x}, 0, {z}] }}
[fixturings.up.obstacles.table]
low = [300, -500, -100]
high = [1300, 500, 0]
"""


def cell_file(folder, x=600, z=0):
    path = folder / "cell.toml"
    path.write_text(CELL_REACH_COMMAND.format(robots=ROBOTS, x=x, z=z), encoding="utf-8")
    return str(path)


def test_a_plan_that_is_reached(tmp_path, capsys):
    out = tmp_path / "reached.json"
    words = [PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", cell_file(tmp_path)]
    assert main(["reach", *words, "--plan-out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert not out.exists()
    assert "was not written: all settings are reached as planned" in printed
    count = len(json.loads(Path(PLAN_REACH_COMMAND).read_text("utf-8"))["settings"])
    assert f"{count} of {count} settings reached: {count} in 'up'" in printed
    assert "setting_01 in 'up': tool0 at (" in printed
    assert "Joints in degrees, by 'made_parallel'" in printed
    assert (
        "not compared, because the arm is built so: link_3 and link_5, link_4 and link_6" in printed
    )


def test_a_plan_that_is_not(tmp_path, capsys):
    assert (
        main(
            ["reach", PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", cell_file(tmp_path, x=2500)]
        )
        == 1
    )
    printed = capsys.readouterr().out
    assert "'up' reaches nothing; most often: beyond the arm's reach" in printed
    assert "add --cell" in printed


def test_records_for_other_programs(tmp_path, capsys):
    assert (
        main(
            [
                "reach",
                PLAN_REACH_COMMAND,
                PART_REACH_COMMAND,
                "--cell",
                cell_file(tmp_path),
                "--json",
            ]
        )
        == 0
    )
    record = json.loads(capsys.readouterr().out)
    assert len(record["setting_01"]["up"]["joints_rad"]) == 6


def test_a_printed_place_can_be_pasted_into_the_cell(tmp_path, capsys):
    # without the table, which a place moves along
    free = Path(cell_file(tmp_path, x=2500)).read_text("utf-8").split("[fixturings.up.obstacles")[0]
    cell = tmp_path / "free.toml"
    cell.write_text(free, encoding="utf-8")
    words = [
        "reach",
        PLAN_REACH_COMMAND,
        PART_REACH_COMMAND,
        "--cell",
        str(cell),
        "--place",
        "--quiet",
    ]
    assert main([*words, "--within", "450", "-300", "0", "900", "300", "300"]) == 0
    printed = capsys.readouterr().out
    assert "may hang in the air" not in printed
    lines = printed.splitlines()
    (place,) = (line for line in lines if line.startswith("part2base = "))
    # the part is turned by no round angle, so the digits matter
    assert "0.0, 0.0, 1.0" in place
    assert place.count("1.0") < 4
    old = "part2base = { xyz = [2500, 0, 0] }"
    assert free.count(old) == 1
    cell.write_text(free.replace(old, place), encoding="utf-8")
    assert main(["reach", PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", str(cell)]) == 0
    assert "1 of 1 settings reached" in capsys.readouterr().out


def test_a_place_away_from_a_table_of_the_cell_is_noted(tmp_path, capsys):
    """A table of the cell stays where it is, and nobody looks whether the part lies on it."""
    text = (
        Path(cell_file(tmp_path)).read_text("utf-8").replace("fixturings.up.obstacles", "obstacles")
    )
    cell = tmp_path / "cell.toml"
    cell.write_text(text, encoding="utf-8")
    words = ["reach", PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", str(cell)]
    main([*words, "--place", "--quiet", "--draws", "40"])
    printed = " ".join(capsys.readouterr().out.split())
    assert (
        "it may hang in the air at these positions. --table NAME lays it on an obstacle" in printed
    )
    assert "(table)" in printed


def test_places_to_put_the_part(tmp_path, capsys):
    words = [
        "reach",
        PLAN_REACH_COMMAND,
        PART_REACH_COMMAND,
        "--cell",
        cell_file(tmp_path, x=2500),
        "--place",
        "--quiet",
    ]
    assert main([*words, "--draws", "15", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found[0]["reached"] >= found[-1]["reached"]
    box = ["--within", "600", "-10", "20", "620", "10", "20"]
    assert main([*words, "--draws", "3", *box]) == 0
    printed = capsys.readouterr().out
    assert "part2base = [[" in printed
    assert "evaluated: moved with the part: table" in printed
    assert "[fixturings.up.obstacles.table]" in printed
    outside = ["--within", "4000", "0", "20", "4010", "1", "20"]
    assert main([*words, "--draws", "2", *outside]) == 1


def test_the_part_laid_on_a_table_is_reached_by_a_program(tmp_path, capsys):
    """The cell that is written gives the program that was counted, from another folder."""
    (tmp_path / "found").mkdir()
    out = tmp_path / "found" / "laid.toml"
    words = ["reach", PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", "examples/cell.toml"]
    words += ["--place", "--table", "table", "--draws", "30", "--quiet", "--cell-out", str(out)]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert "1 of 1, " in printed.splitlines()[2]
    assert "tips over" not in printed
    assert main([*words, "--json"]) == 0
    best = json.loads(capsys.readouterr().out)[0]
    assert (best["reached"], best["program"]["images"]) == (1, 1)
    words = ["program", PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", str(out), "--json"]
    assert main([*words, "--out", str(tmp_path / "laid.script"), "--quiet"]) == 0
    made = json.loads(capsys.readouterr().out)
    assert [tour["fixturing"] for tour in made["tours"]] == list(best["layings"])
    # without home there is no program, but what is reached counts
    words = ["reach", PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", cell_file(tmp_path)]
    assert main([*words, "--place", "--table", "table", "--draws", "60", "--quiet"]) == 0
    assert "program: not tried, since the cell file states no home_deg" in capsys.readouterr().out


STANDING = """
[obstacles.pedestal]
low = [-150, -150, -800]
high = [150, 150, -50]
[fixturings.up.obstacles.clamp]
mesh = "clamp.stl"
"""
# a corner of a clamp on the table, beside the part
CLAMP = """solid clamp
{}endsolid clamp
"""


def clamp_text():
    """Return an STL of a tetrahedron of 20 mm, beside the part and on the table."""
    corners = [(560.0, 20.0, 0.0), (580.0, 20.0, 0.0), (560.0, 40.0, 0.0), (560.0, 20.0, 20.0)]
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    facets = ""
    for face in faces:
        vertices = "".join("vertex {} {} {}\n".format(*corners[k]) for k in face)
        facets += f"facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n"
    return CLAMP.format(facets)


def test_the_cell_of_the_best_place_is_the_one_that_was_evaluated(tmp_path, capsys):
    """The file is read from another folder, and gives the same joints. No table goes through the pedestal."""
    path = Path(cell_file(tmp_path))
    path.write_text(path.read_text("utf-8") + STANDING, encoding="utf-8")
    (tmp_path / "clamp.stl").write_text(clamp_text(), encoding="utf-8")
    (tmp_path / "found").mkdir()
    out = tmp_path / "found" / "best.toml"
    words = [
        "reach",
        PLAN_REACH_COMMAND,
        PART_REACH_COMMAND,
        "--cell",
        str(path),
        "--place",
        "--quiet",
        "--draws",
        "40",
    ]
    code = main([*words, "--json", "--cell-out", str(out)])
    found = json.loads(capsys.readouterr().out)
    assert found[0]["moved_with_part"] == {"up": ["table", "clamp"]}
    # the table begins 300 mm before the part's place in the file, so most draws put it into the pedestal
    for one in found:
        corners = np.array([[x, y, z, 1.0] for x in (300, 1300) for y in (-500, 500) for z in (0,)])
        motion = np.array(one["motion"])
        turned = corners @ motion.T
        into_table = np.array([[x, y, 0.0, 1.0] for x in (-150, 150) for y in (-150, 150)])
        local = into_table @ np.linalg.inv(motion).T
        inside = (local[:, 0] > 301) & (local[:, 0] < 1299) & (abs(local[:, 1]) < 499)
        assert not inside.any()
        assert not ((abs(turned[:, 0]) < 149) & (abs(turned[:, 1]) < 149)).any()
    assert code == 0
    assert (
        main(["reach", PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", str(out), "--json"]) == 0
    )
    told = json.loads(capsys.readouterr().out)
    assert len(told) == found[0]["reached"]
    assert found[0]["part2base"]["up"] == Cell.from_toml(out).fixturings["up"].part2base.tolist()
    # the clamp's corner moved as the part did
    corners = Cell.from_toml(out).fixturings["up"].obstacles["clamp"][0]
    expected = np.array(found[0]["motion"]) @ [580.0, 20.0, 0.0, 1.0]
    assert np.linalg.norm(corners - expected[:3], axis=1).min() < 1e-4


def test_a_table_of_the_example_is_written_whole(tmp_path, capsys):
    """Every field of the example comes back: what is not moved is the same, by the cell's own digests."""
    example = EXAMPLES / "cell.toml"
    out = tmp_path / "best.toml"
    words = [
        "reach",
        PLAN_REACH_COMMAND,
        PART_REACH_COMMAND,
        "--cell",
        str(example),
        "--place",
        "--quiet",
        "--draws",
        "20",
    ]
    assert main([*words, "--cell-out", str(out)]) == 0
    assert str(out) in capsys.readouterr().out
    first, second = (Cell.from_toml(path).parts for path in (example, out))
    changed = {name for name in first if first[name] != second[name]}
    assert changed == {"fixturing up", "fixturing turned over"}


def test_links_without_bodies_are_told_with_every_table_and_program(tmp_path, capsys):
    text = (ROBOTS / "made_parallel.urdf").read_text("utf-8")
    text = re.sub(r"<collision>.*?</collision>|<visual>.*?</visual>", "", text, flags=re.DOTALL)
    (tmp_path / "made.urdf").write_text(text, encoding="utf-8")
    path = Path(cell_file(tmp_path))
    cell = path.read_text("utf-8").replace(f"{ROBOTS}/made_parallel.urdf", "made.urdf")
    path.write_text(cell, encoding="utf-8")
    assert main(["reach", PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", str(path)]) == 2
    assert 'bodiless_links = "all" in [robot] of the cell file' in capsys.readouterr().err
    stated = cell.replace("[[camera_body]]", 'bodiless_links = "all"\n[[camera_body]]')
    path.write_text(stated + "\n", encoding="utf-8")
    links = "link_1, link_2, link_3, link_4, link_5, link_6"
    words = f"collisions of links without geometry in the URDF were NOT checked: {links}"
    assert main(["reach", PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", str(path)]) == 0
    assert f"warning: {words}" in " ".join(capsys.readouterr().out.split())
    assert (
        main(["reach", PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", str(path), "--json"]) == 0
    )
    assert words in capsys.readouterr().err
    home = stated.replace("cam2flange", "home_deg = [0, -110, 100, 0, 90, 0]\ncam2flange")
    path.write_text(home, encoding="utf-8")
    for kind in ("urscript", "rapid", "krl", "fanuc", "ros", "csv", "json"):
        out = tmp_path / f"program.{kind}"
        given = [
            "program",
            PLAN_REACH_COMMAND,
            PART_REACH_COMMAND,
            "--cell",
            str(path),
            "--format",
            kind,
            "--quiet",
        ]
        assert main([*given, "--out", str(out)]) == 0
        text = out.read_text("utf-8")
        if kind == "fanuc":
            # its remarks are short
            text = " ".join(re.findall(r": +! (.*) ;", text))
        assert words in text
        assert f"warning: {words}" in " ".join(capsys.readouterr().out.split())


def test_the_folder_of_a_plan_for_the_part_is_named(tmp_path, capsys):
    (tmp_path / "plan.json").write_text("{}")
    words = [PART_REACH_COMMAND, str(tmp_path), "--cell", cell_file(tmp_path)]
    assert main(["reach", *words]) == 2
    hint = f"a part; the plan seems to be {str(tmp_path)!r}, so exchange the two.\n"
    assert capsys.readouterr().err.endswith(hint)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([PLAN_REACH_COMMAND, PART_REACH_COMMAND], "--cell must be given"),
        (
            [PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", "none.toml"],
            "--cell must be an existing file. Got 'none.toml'",
        ),
        (
            [PART_REACH_COMMAND, PLAN_REACH_COMMAND, "--cell", "CELL"],
            f"the plan must be an existing plan file, or its folder. Got {PART_REACH_COMMAND!r}, a part; the plan "
            f"seems to be {PLAN_REACH_COMMAND!r}, so exchange the two",
        ),
        ([PLAN_REACH_COMMAND, "none.off", "--cell", "CELL"], "the part must be an existing file"),
        (["none", PART_REACH_COMMAND, "--cell", "CELL"], "the plan must be an existing plan file"),
        (
            [PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", "CELL", "--within", *"123456"],
            "--within must be given with --place",
        ),
        (
            [PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", "CELL", "--post-heights", "50"],
            "--post-heights must be given with --table",
        ),
        (
            [
                PLAN_REACH_COMMAND,
                PART_REACH_COMMAND,
                "--cell",
                "CELL",
                "--place",
                "--table=table",
                "--post-heights=-5",
            ],
            "--post-heights must be finite and not negative. Got -5",
        ),
        (
            [PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", "CELL", "--place", "--ways", "3"],
            "--ways must be at most 2. Got 3",
        ),
        (
            [PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", "CELL", "--place", "--table", "x"],
            "--table must be an obstacle of the cell or of its first fixturing",
        ),
        (
            [PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", "CELL", "--cell-out", "best.toml"],
            "--cell-out must be given with --place",
        ),
        (
            [
                PLAN_REACH_COMMAND,
                PART_REACH_COMMAND,
                "--cell",
                "CELL",
                "--place",
                "--cell-out",
                "CELL",
            ],
            "--cell-out must be another file than that of --cell",
        ),
        (
            [PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", "THROUGH", "--place"],
            "30 mm deep in table",
        ),
        ([PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", "THROUGH"], "30 mm deep in table"),
        (
            [PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", PART_REACH_COMMAND],
            "cell file must be TOML",
        ),
        (
            [
                PLAN_REACH_COMMAND,
                PART_REACH_COMMAND,
                "--cell",
                "CELL",
                "--place",
                "--within",
                *"623451",
            ],
            "--within must be finite, lower corner first",
        ),
    ],
)
def test_bad_input_is_one_line(words, message, tmp_path, capsys):
    places = {"CELL": cell_file(tmp_path)}
    if "THROUGH" in words:
        places["THROUGH"] = cell_file(tmp_path, z=-30)
    words = [places.get(word, word) for word in words]
    try:
        code = main(["reach", *words])
    except SystemExit as error:
        code = error.code
    assert code == 2
    told = capsys.readouterr().err
    assert message in told
    assert len(told.strip().splitlines()) == 1


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """Return a folder with a plan for a cell, and the cell's file."""
    folder = tmp_path_factory.mktemp("planned")
    path = cell_file(folder)
    words = ["--entities", "17", "--camera", "basler-acA2440-20gm-8mm", "--accuracy", "0.98"]
    words += ["--effort", "quick", "--simulate", "1000", "--jobs", "1", "--quiet"]
    out = str(folder / "plan")
    assert main(["plan", PART_REACH_COMMAND, *words, "--cell", path, "--out", out]) == 0
    return out, path


def test_a_plan_for_a_cell_is_reached(planned, capsys):
    out, path = planned
    plan = json.loads(Path(out, "plan.json").read_text("utf-8"))
    assert plan["cell"]["robot"] == "made_parallel"
    assert plan["settings"][0]["fixturing"] == "up"
    assert main(["reach", out, PART_REACH_COMMAND, "--cell", path, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["setting_01"]["up"]["joints_rad"] == plan["settings"][0]["joints"]


def test_another_cell_is_noted(planned, tmp_path, capsys):
    out, path = planned
    assert main(["reach", out, PART_REACH_COMMAND, "--cell", path]) == 0
    assert "cell of the plan differs" not in capsys.readouterr().out
    main(["reach", out, PART_REACH_COMMAND, "--cell", cell_file(tmp_path, x=610)])
    assert "note: the cell of the plan differs from the cell given, in" in capsys.readouterr().out


def test_a_plan_for_a_cell_is_planned_again_with_its_cell(planned, tmp_path, capsys):
    out, path = planned
    again = ["plan", "--again", out, "--out", str(tmp_path / "again"), "--quiet", "--jobs", "1"]
    assert main(again) == 2
    assert "--cell must be given for a plan of a robot cell" in capsys.readouterr().err
    assert main([*again, "--cell", cell_file(tmp_path, x=610)]) == 2
    assert "--cell must be the cell of the plan" in capsys.readouterr().err
    assert main([*again, "--cell", path]) == 0
    printed = capsys.readouterr().out
    assert "part lies" in printed
    assert "made_parallel reaches all settings, with the part lying 'up'." in printed
    first, second = (
        json.loads(Path(folder, "plan.json").read_text("utf-8"))["settings"]
        for folder in (out, tmp_path / "again")
    )
    assert first == second
    without = ["plan", "--again", PLAN_REACH_COMMAND, "--out", str(tmp_path / "none"), "--quiet"]
    assert main([*without, "--cell", path]) == 2


@pytest.mark.parametrize("command", ["reach", "program"])
def test_another_part_is_refused(command, tmp_path, capsys):
    other = str(EXAMPLES / "nist_ctc_01_ap242.stp")
    assert main([command, PLAN_REACH_COMMAND, other, "--cell", cell_file(tmp_path), "--quiet"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "the part must be the one that was planned. Got" in line
    assert "which has another shape" in line


def test_the_pose_to_compare_is_in_the_frame_of_the_pendant(tmp_path, capsys):
    """The link `base` of the URDF is turned by 180 degrees: x and y have the other sign."""
    shown = []
    for turned in (False, True):
        path = Path(cell_file(tmp_path))
        if turned:
            text = Path("examples/robots/made_parallel.urdf").read_text("utf-8")
            base = (
                '<link name="base"/><joint name="to_base" type="fixed"><parent link="base_link"/>'
                '<child link="base"/><origin rpy="0 0 3.141592653589793"/></joint></robot>'
            )
            (tmp_path / "turned.urdf").write_text(text.replace("</robot>", base), encoding="utf-8")
            content = re.sub(r'urdf = ".*"', 'urdf = "turned.urdf"', path.read_text("utf-8"))
            path.write_text(content, encoding="utf-8")
        assert main(["reach", PLAN_REACH_COMMAND, PART_REACH_COMMAND, "--cell", str(path)]) == 0
        (words,) = re.findall(r"tool0 at \((.*?)\) mm in (.*?),", capsys.readouterr().out)
        shown.append(words)
    (plain, base_link), (other, frame) = shown
    assert (base_link, frame) == ("the base", "the link 'base'")
    x, y, z = map(float, plain.split())
    np.testing.assert_allclose([float(word) for word in other.split()], [-x, -y, z], atol=0.11)
