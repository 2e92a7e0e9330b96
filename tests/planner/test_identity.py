"""One value says what is asked: each of its fields tells requests apart, and comes back from a plan file."""

from __future__ import annotations

import json
from dataclasses import field, fields, make_dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from grid_box import EDGES, BoxSpace
from holed_plate import HOLES
from measured_plate import measured_plan, thick_plate
from robot_cells import made_cell, pose

from aspectgraph import read_solid
from errors.measurands import Localisation
from ground.convert import to_plain
from planner import (
    BoxRegion,
    Camera,
    Detectability,
    Dimension,
    Effort,
    Fixturing,
    LampBox,
    Lighting,
    MeshRegion,
    PartRequest,
    PoseUncertainty,
    Registration,
    RequestError,
    SphereRegion,
    inspection,
    read_plan,
)
from planner.app import batch as part_request
from planner.app import main as command_line
from planner.app import options as command_options
from planner.app.plan_commands import REGIONS_FOLDER
from planner.app.process import BAD_INPUT, DONE, INCOMPLETE
from planner.effort import Search
from planner.exceptions import PlanFileError
from planner.identity import Request, restored_request
from planner.options import InspectionOptions
from planner.request.models import Means
from planner.request.reach import reach_identity
from planner.resolve_request import resolve_request

CAMERA = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 300.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
BOX = [[-300.0] * 3, [300.0] * 3]
# options that say how to work, and not what is asked; a space is known by what it was computed for
TOOLS = {"time_limit_s", "on_incumbent", "state", "executor", "progress", "space"}


@pytest.fixture(scope="module")
def block(pytestconfig):
    return read_solid(pytestconfig.rootpath / "examples/two_pocket_block.off")


def ids(solid):
    return [edge.id for edge in solid.straight_edges()]


def request_of(solid, wanted=None, camera=CAMERA, **options):
    wanted = {"top": ids(solid)[0], "side": ids(solid)[3]} if wanted is None else wanted
    uncertainty = options.pop("uncertainty", UNCERTAINTY)
    given = InspectionOptions(**{"workspace": BOX, **options})
    return resolve_request(solid, wanted, camera, uncertainty, given).request


def far_cell():
    """Return a cell with the block far from the robot."""
    return made_cell(fixturings={"far": Fixturing(pose((3000.0, 0.0, 0.0)))})


# every option of a plan, changed: and what is said of it
CHANGES = {
    "rng": ({"rng": 1}, "rng was 0 and is now 1"),
    "accuracy": ({"accuracy": 0.97}, "accuracy was 0.98 and is now 0.97"),
    "probability": ({"probability": 0.8}, "probability was 0.9 and is now 0.8"),
    "workspace": ({"workspace": [[-301.0] * 3, [300.0] * 3]}, "workspace changed"),
    "stand_off_mm": ({"stand_off_mm": 60}, "stand_off_mm was 50 and is now 60"),
    "min_length_px": ({"min_length_px": 21.0}, "min_length_px was 20 and is now 21"),
    "field_margin_px": ({"field_margin_px": 7.0}, "and is now 7"),
    "visibility_radius_mm": ({"visibility_radius_mm": 1.0}, "visibility_radius_mm was 0.15"),
    "focus_margin_mm": ({"focus_margin_mm": 1.0}, "focus_margin_mm was 0.15 and is now 1"),
    "showing": ({"showing": Detectability(4.0)}, "separation_px was 5 and is now 4"),
    "reach": ({"reach": SphereRegion((0, 0, 0), 900.0)}, "reach changed"),
    "cell": ({"cell": far_cell()}, "cell changed"),
    "lamps": ({"lamps": Lighting([[0.0, 0.0, 500.0]], together=True)}, "lamps changed"),
    "effort": (
        {"effort": Effort(viewpoints=49)},
        "effort changed: viewpoints was 50 and is now 49",
    ),
    "localisation": ({"localisation": Localisation.rounding(9)}, "localisation changed: points"),
    "gap": ({"gap": 0.1}, "gap was 0 and is now 0.1"),
    "surfaces_mm": ({"surfaces_mm": 0.05}, "surfaces_mm was 0 and is now 0.05"),
    "edge_break_mm": (
        {"edge_break_mm": (0.1, 0.3)},
        "edge_break_mm was not given and is now [0.1, 0.3]",
    ),
    "poses": ({"poses": [np.eye(4)]}, "poses changed"),
    "split": ({"split": "never"}, "split was 'auto' and is now 'never'"),
    "registration": ({"registration": Registration.own_edges()}, "registration changed"),
}


def test_every_option_of_a_plan_is_of_the_request_or_a_tool():
    """Whoever adds an option must say which it is: here, and by a field of the request."""
    assert {one.name for one in fields(InspectionOptions)} == {*CHANGES, *TOOLS}


@pytest.mark.parametrize("name", CHANGES)
def test_every_option_tells_requests_apart_and_is_named(block, name):
    options, words = CHANGES[name]
    first = request_of(block)
    second = request_of(block, **options)
    assert words in second.difference(first)
    assert first.difference(second) is not None
    assert first.fingerprint() != second.fingerprint()
    assert second.difference(request_of(block, **options)) is None
    assert second.fingerprint() == request_of(block, **options).fingerprint()


def test_what_else_is_asked_tells_requests_apart(block):
    first = request_of(block)
    some = ids(block)
    top = some[0]
    side = some[3]
    cases = {
        "camera changed: f number was 8 and is now 4": request_of(
            block, camera=replace(CAMERA, f_number=4.0)
        ),
        "pose_uncertainty changed": request_of(
            block, uncertainty=PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.001)
        ),
        f"target 'top' was edge {top} and is now edge {some[5]}": request_of(
            block, {"top": some[5], "side": side}
        ),
        "target 'side' is no longer wanted": request_of(block, {"top": top}),
        "target 'more' is new": request_of(block, {"top": top, "side": side, "more": some[5]}),
        "the order of the targets changed": request_of(block, {"side": side, "top": top}),
    }
    for words, other in cases.items():
        assert other.difference(first) == words
        assert other.fingerprint() != first.fingerprint()


def test_tolerances_tell_requests_apart(block):
    def asked(**error):
        return request_of(block, {"d": Dimension.length(ids(block)[0], **error)})

    first = asked(max_error_mm=0.5)
    assert asked(max_error_mm=0.9).difference(first) == (
        "target 'd' changed: permitted error was 0.5 and is now 0.9"
    )
    assert "target 'd' changed: " in asked(tolerance_mm=(-2, 2)).difference(first)
    other = asked(tolerance_mm=(-1, 3))
    assert other.difference(asked(tolerance_mm=(-2, 2))) == (
        "target 'd' changed: tolerance was [-2, 2] and is now [-1, 3]"
    )


def test_a_part_that_changed_is_noticed_and_the_last_digits_are_not(block):
    first = request_of(block).identity()
    moved = json.loads(json.dumps(first))
    moved["part"]["digest"] = "0" * 64
    assert request_of(block).difference(moved) == "the shape of the part changed"
    moved["part"] = {**first["part"], "name": "another"}
    assert request_of(block).difference(moved) == (
        f"the part was 'another' and is now {block.name!r}"
    )


def test_numbers_computed_on_another_machine_are_the_same_if_that_is_allowed(block):
    asked = request_of(block)
    other = json.loads(json.dumps(asked.identity()))
    other["workspace"][0][0] *= 1 + 1e-12
    assert asked.difference(other) == "workspace changed"
    assert asked.difference(other, tolerance=1e-9) is None


def test_whole_numbers_are_floats_where_floats_are_meant(block):
    assert (
        request_of(block, stand_off_mm=50).fingerprint()
        == request_of(block, stand_off_mm=50.0).fingerprint()
    )


def test_a_field_that_is_added_cannot_be_forgotten(block):
    wider = make_dataclass(
        "Wider", [("made_up", float, 1.0)], bases=(Request,), frozen=True, eq=False
    )
    known = {one.name: getattr(request_of(block), one.name) for one in fields(Request)}
    first = wider(**known)
    second = wider(**known, made_up=2.0)
    assert second.difference(first) == "made_up was 1 and is now 2"
    assert first.fingerprint() != second.fingerprint()
    # and one that cannot be told apart by plain values is refused
    with pytest.raises(TypeError, match="not JSON serializable"):
        wider(**known, made_up=object()).fingerprint()


LIGHTS = [
    Lighting("ring", 0.2, 0.1),
    Lighting([[0.0, 0.0, 500.0]], ground="bright"),
    Lighting(
        LampBox((-9.0, -9.0, 400.0), (9.0, 9.0, 500.0), reach=BoxRegion((0, 0, 0), (1, 1, 9)))
    ),
    Lighting([[0.0, 0.0, 500.0], [0.0, 9.0, 500.0]], together=True),
]


@pytest.mark.parametrize("lamps", [None, *LIGHTS])
def test_a_request_comes_back_from_a_plan_file(block, lamps):
    some = ids(block)
    asked = request_of(
        block,
        {"top": some[0], "d": Dimension.length(some[3], tolerance_mm=(-2, 2), share=0.5)},
        lamps=lamps,
        reach=BoxRegion((-300, -300, 0), (300, 300, 300)),
        localisation=Localisation.gaussian(0.05, floor_px=0.03),
        surfaces_mm=0.01,
    )
    assert asked.surfaces_mm == 0.01
    stored = json.loads(json.dumps(asked.identity()))
    again = restored_request(stored)
    assert again.difference(asked) is None
    assert again.fingerprint() == asked.fingerprint()
    # and from its targets and options the same request follows
    items = {record.name: record.item_of(block) for record in again.targets}
    options = InspectionOptions.of_request(again)
    made = resolve_request(block, items, again.camera, again.pose_uncertainty, options).request
    assert made.difference(asked) is None


def test_faces_are_off_by_what_is_given_or_by_what_suits_the_localisation(block):
    """Whole pixels are the paper's model, which knows no faces that are off."""
    gaussian = Localisation.gaussian(0.1)
    assert request_of(block).surfaces_mm == 0.0
    assert request_of(block, localisation=gaussian).surfaces_mm == 0.02
    assert request_of(block, localisation=gaussian, surfaces_mm=0).surfaces_mm == 0.0
    assert request_of(block, surfaces_mm=0.1).surfaces_mm == 0.1
    for wrong in (-0.01, float("nan"), "wide"):
        with pytest.raises(RequestError, match="surfaces_mm must"):
            request_of(block, surfaces_mm=wrong)


def test_faces_of_the_model_come_back_from_a_plan_file_unless_the_call_gives_its_own(block):
    some = ids(block)
    edge = Dimension(
        "length", (some[0],), max_error=0.5, surfaces_mm=0.03, surfaces_from="profile 0.1 mm"
    )
    fine = Localisation.gaussian()
    asked = request_of(block, {"edge": edge}, localisation=fine)
    assert (asked.targets[0].stated_surfaces_mm, asked.surfaces_mm) == (0.03, 0.02)
    again = restored_request(json.loads(json.dumps(asked.identity())))
    items = {record.name: record.item_of(block) for record in again.targets}
    options = InspectionOptions.of_request(again)
    made = resolve_request(block, items, again.camera, again.pose_uncertainty, options).request
    assert made.difference(asked) is None
    means = Means(CAMERA, UNCERTAINTY, localisation=fine, surfaces_mm=0.02)
    (target,) = made.targets
    assert target.description(means).surfaces_mm == target.measured_with(means).surfaces_mm == 0.03
    assert target.surfaces_from == "profile 0.1 mm"
    given = request_of(block, {"edge": edge}, localisation=fine, surfaces_mm=0.02)
    assert (given.targets[0].stated_surfaces_mm, given.targets[0].surfaces_from) == (None, "")
    assert "edge" in asked.difference(given)


def test_a_number_that_steers_the_search_tells_requests_apart(block):
    first = request_of(block)
    changed = request_of(block, effort=Effort(search=Search(population=32)))
    assert changed.difference(first) == (
        "effort changed: population of search was 100 and is now 32"
    )
    assert changed.fingerprint() != first.fingerprint()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"colour": "red"},
            r"request\.colour must be left out, or renamed to one of part, targets",
        ),
        ({"camera": {}}, r"request\.camera"),
        ({"effort": {"viewpoints": -1}}, r"request\.effort\.viewpoints must be"),
        ({"seed": None, "targets": [{"name": "a"}]}, r"targets\.a\.kind must be given"),
        ({"part": 5}, r"request\.part must be an object or null\. Got 5\."),
    ],
)
def test_a_request_that_was_changed_is_refused_by_name(block, change, message):
    stored = {**request_of(block).identity(), **change}
    with pytest.raises(PlanFileError, match=message):
        restored_request(stored)


def test_a_reach_of_a_program_cannot_come_from_a_file(block):
    corners = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9.0]])
    mesh = MeshRegion(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    asked = request_of(block, reach=mesh)
    stored = restored_request(json.loads(json.dumps(asked.identity())))
    # it is known as the same, and cannot be made again
    assert stored.difference(asked) is None
    with pytest.raises(PlanFileError, match="reach must be a box or a ball to be in a file"):
        InspectionOptions.of_request(stored)
    with pytest.raises(RequestError, match="reach must be a box or a ball to be in a file"):
        stored.requirements.reach.margin(np.zeros((1, 3)))


# --- reaches that nobody can recognise ------------------------------------------------------------------------------


def above(positions):
    return positions[:, 2] > 0


def higher(positions, height=3.0):
    return positions[:, 2] > height


class Arm:
    def __init__(self, length):
        self.length = length

    def margin(self, positions):
        return self.length - np.abs(positions).max(axis=-1)


def closure(height):
    def over(positions):
        return positions[:, 2] > height

    return over


def named(reach, name):
    reach.state_name = name
    return reach


UNNAMED = {
    "lambda": lambda positions: positions[:, 2] > 0,
    "closure": closure(3.0),
    "partial of a lambda": partial(lambda p, h: p[:, 2] > h, h=3.0),
}


@pytest.mark.parametrize("kind", UNNAMED)
def test_a_reach_without_a_lasting_name_is_no_request_to_resume(block, kind):
    asked = request_of(block, reach=UNNAMED[kind])
    with pytest.raises(
        RequestError, match=r"^reach must have a name that lasts .* state_name, a text that says"
    ):
        asked.check_lasting()
    # it is not even known to be the same as itself
    assert asked.difference(asked) == "reach changed"


def test_a_reach_with_a_lasting_name_is_told_from_others(block):
    reaches = [
        above,
        higher,
        partial(higher, height=4.0),
        partial(higher, height=5.0),
        Arm(3.0),
        Arm(4.0),
        Arm(3.0).margin,
        named(closure(3.0), "over the table"),
        BoxRegion((0, 0, 0), (1, 1, 1)),
    ]
    for reach in reaches:
        asked = request_of(block, reach=reach)
        asked.check_lasting()
        assert asked.difference(request_of(block, reach=reach)) is None
    assert len({json.dumps(reach_identity(reach)) for reach in reaches}) == len(reaches)


def test_a_function_whose_code_changed_is_another_one():
    space: dict = {}
    exec("def reach(p):\n    return p[:, 2] > 0", space)
    first = reach_identity(space["reach"])
    exec("def reach(p):\n    return p[:, 2] > 1", space)
    second = reach_identity(space["reach"])
    assert "content" in first
    assert first["kind"] == second["kind"]
    assert first != second


def test_the_reach_of_a_lamp_needs_a_lasting_name_too(block):
    lamps = LampBox((-9.0, -9.0, 400.0), (9.0, 9.0, 500.0), reach=UNNAMED["lambda"])
    with pytest.raises(RequestError, match="reach must have a name that lasts"):
        request_of(block, lamps=lamps).check_lasting()


def test_values_of_several_kinds_say_which_they_are():
    assert to_plain(Lighting("ring"))["lamps"] == "ring"
    assert to_plain(LIGHTS[2])["lamps"]["kind"] == "LampBox"


# A made-up option of the request is noticed by resume, ``--out``, batch, kept regions and plan
# files. It is added where an option is added: to the request, to the options of the call, and to
# the command line.


CAMERA_MADE_UP_OPTION = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
# modules that hold the names of the two classes
_REQUEST = ("planner.identity", "planner.resolve_request", "planner.app.batch")
_OPTIONS = (
    *("planner.inspection", "planner.app.job", "planner.app.batch"),
    *("planner.options",),
)


@pytest.fixture
def made_up(monkeypatch):
    """Add the option ``made_up``."""

    def wider(kind, **how):
        added = [("made_up", str, field(default="none"))]
        return make_dataclass(kind.__name__, added, bases=(kind,), frozen=True, **how)

    request = wider(Request, eq=False)
    options = wider(InspectionOptions)
    for name in _REQUEST:
        monkeypatch.setattr(f"{name}.Request", request)
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


@pytest.mark.usefixtures("made_up")
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
        return inspection.plan_inspection(*part, CAMERA_MADE_UP_OPTION, UNCERTAINTY, options)

    found = plan("a")
    assert found.request.made_up == "a"
    with pytest.raises(PlanFileError, match="made_up was 'a' and is now 'b'"):
        plan("b")
    assert plan("a", stop) == found


@pytest.mark.usefixtures("made_up")
def test_a_batch_notices_it():
    def fingerprint(**limits):
        return PartRequest(CAMERA_MADE_UP_OPTION, UNCERTAINTY, limits=limits).fingerprint

    assert fingerprint(made_up="a") != fingerprint(made_up="b")
    assert fingerprint(made_up="none") == fingerprint()


@pytest.mark.usefixtures("made_up")
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


# A plan knows its part by a digest, and no other part is taken for it.


EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize(("shift", "more"), [(1.0, 0.0), (0.0, 1.0)])
def test_a_hole_that_moved_or_grew_by_1_mm(shift, more):
    request = measured_plan(thick_plate()).request
    assert request.other_part(thick_plate()) == ""
    holes = {
        name: ((centre[0] + shift, centre[1]), radius + more)
        for name, (centre, radius) in HOLES.items()
    }
    assert request.other_part(thick_plate(holes)) == "which has another shape"


def test_a_part_from_a_file():
    request = read_plan(EXAMPLES / "measured/plan.json").request
    assert request.other_part(read_solid(EXAMPLES / "nist_ctc_01_ap242.stp")) == ""
    assert request.other_part(read_solid(EXAMPLES / "two_pocket_block.off")) != ""
