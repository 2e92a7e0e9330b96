"""The schema of the files, and what it cannot say: every contradiction is named by the path of its field."""

from __future__ import annotations

import json
import math
import os
import random

import jsonschema
import numpy as np
import pytest
from file_mutants import damaged_json, damaged_toml
from fuzzing import OWN, READERS, mutant, outcome
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from plan_examples import ENTITIES, LIGHT, plan, setting

from aspectgraph import ReadLimits, files, read_solid
from aspectgraph.exceptions import ReadError
from errors.measurands.measurand import kinds
from ground.convert import field_name, shown
from planner import Camera, Dimension, look_at
from planner.exceptions import CameraError, PlanFileError
from planner.files import encoded, read_json
from planner.plan import InspectionPlan, read_plan
from planner.plan_file import packed, unpacked
from planner.plan_record import plan_schema
from planner.request.dimension_files import read_wanted
from planner.resume import PlanningState, check_fields
from planner.sensor_setting import Outcome


def data():
    return encoded(plan(light=LIGHT).simulated(50).to_dict())


def changed(path, value):
    """Return the data of a good plan with one field changed, or removed where the value is ``...``."""
    whole = data()
    holder = whole
    for key in path[:-1]:
        holder = holder[key]
    if value is ...:
        del holder[path[-1]]
    else:
        holder[path[-1]] = value
    return whole


def test_schema_is_json_schema_that_any_validator_can_use(tmp_path):
    schema = plan_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    plan().write(tmp_path / "plan.json")
    jsonschema.validate(json.loads((tmp_path / "plan.json").read_text()), schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"format": "a shopping list"}, schema)


def test_every_rule_of_the_schema_has_words():
    left = list(plan_schema()["$defs"].values())
    while left:
        one = left.pop()
        # any value keeps no rule
        is_rule = one and not {"$ref", "anyOf"} & set(one)
        assert not is_rule or one["title"].startswith("must ")
        left += one.get("properties", {}).values()
        left += [
            one[key] for key in ("items", "additionalProperties") if isinstance(one.get(key), dict)
        ]


FIRST = ("settings", 0)
BOTTOM = ("targets", "bottom")
LIT = ("light", "settings", 1)
LIT_FIRST = ("light", "settings", 0, "images", 0)
RATE = ("simulation", "rates", 0, "top front")
WRONG = {
    "probability nan": (
        (*FIRST, "probability", "top right"),
        math.nan,
        "must be a number in [0, 1]. Got NaN.",
    ),
    "probability text": (
        (*FIRST, "probability", "top right"),
        "0.9",
        'must be a number in [0, 1]. Got "0.9".',
    ),
    "probability above 1": (
        (*FIRST, "probability", "top right"),
        1.5,
        "must be a number in [0, 1]. Got 1.5.",
    ),
    "probability missing": ((*FIRST, "probability", "top right"), ..., "must be given. Got none."),
    "below the required": (
        (*FIRST, "probability", "top right"),
        0.89,
        "must be at least the required probability, 0.9. Got 0.89.",
    ),
    "of no entity": (
        (*FIRST, "probability", "x"),
        0.95,
        'must be of an entity of the setting. Got "x".',
    ),
    "required 2": (("request", "probability"), 2, "must be in (0, 1). Got 2."),
    "accuracy true": (("request", "accuracy"), True, "must be in (0, 1). Got true."),
    "bound 99": (("bound",), 99, "must be 1 to 2, the number of settings. Got 99."),
    "bound 0": (("bound",), 0, "must be 1 to 2, the number of settings. Got 0."),
    "bound text": (("bound",), "x", 'must be a non-negative integer. Got "x".'),
    "bound 1.0": (("bound",), 1.0, "must be a non-negative integer. Got 1.0."),
    "unknown field": (("colour",), 1, "must be left out, or renamed to one of format, version,"),
    "huge": (("settings", 1, "fitness"), 10**400, "must be a number. Got an integer of 1329 bits."),
    "sheared": (
        ("settings", 1, "cam2world", 0, 0),
        0.5,
        "must hold a rotation: orthonormal, determinant +1. Got",
    ),
    "last row": (
        ("settings", 1, "cam2world", 3, 3),
        2.0,
        "must have the last row [0, 0, 0, 1]. Got [0.0, ",
    ),
    "far away": (
        ("settings", 1, "cam2world", 2, 3),
        1e6,
        "must be in the workspace. Got [250.0, 40.0, 1000000.0].",
    ),
    "margin": (
        (*FIRST, "margins", "focus_mm"),
        -1.0,
        "must not be negative: the constraint is met. Got -1.0.",
    ),
    "margin nan": (
        (*FIRST, "margins", "focus_mm"),
        math.nan,
        'must be a number, or {"not finite": "inf"} where',
    ),
    "margin odd": ((*FIRST, "margins", "reach", "not finite"), "nan", 'must be "inf". Got "nan".'),
    "unknown entity": ((*FIRST, "entities", 0), "x", None),
    "no entity": (
        (*FIRST, "entities"),
        [],
        "must be an array of at least one name, all different. Got [].",
    ),
    "no length": ((*BOTTOM, "witnesses", 0, "geometry", 0, "q"), [0, 0, 0], None),
    "no entity of a target": (
        (*BOTTOM, "witnesses", 0, "entities"),
        [],
        "must be an array of at least one entity. Got [].",
    ),
    "an edge with an angle": ((*BOTTOM, "kind"), "angle", "must be given. Got none."),
    "a target that is not named": (("request", "targets"), ["top front", "top right"], None),
    "a name without a target": (("request", "targets", 2), "x", None),
    "in neither": (("uninspectable",), {}, None),
    "in both": (("uninspectable", "top front"), "hidden", None),
    "reason for nobody": (
        ("uninspectable", "x"),
        "hidden",
        'must be one of the plan\'s targets. Got "x".',
    ),
    "kind for nobody": (
        ("uninspectable_kinds",),
        {"x": "too short"},
        None,
    ),
    "workspace": (("request", "workspace", 0, 0), 901.0, None),
    "covariance": (("request", "pose_uncertainty", "covariance", 0, 1), 0.1, None),
    "focus": (
        ("request", "camera", "focus_distance_mm"),
        20.0,
        "must exceed focal_length_mm (25), otherwise no real image forms.",
    ),
    "f-number": (
        ("request", "camera", "f_number"),
        math.inf,
        "must be finite and positive. Got Infinity.",
    ),
    "successes": ((*RATE, "successes"), 51, "must be at most n, 50. Got 51."),
    "interval": ((*RATE, "high"), 0.5, None),
    "predicted": ((*RATE, "predicted"), 0.99, "must be the setting's probability, 0.95. Got 0.99."),
    "another n": ((*RATE, "n"), 60, "must be simulation.n, 50. Got 60."),
    "rates of nobody": (("simulation", "rates", 0, "x"), 1, "must be an object. Got 1."),
    "fewer rates": (("simulation", "rates"), [], None),
    "too many draws": (
        ("simulation", "n"),
        2**54,
        "must be an integer from 1 to 2^53. Got 18014398509481984.",
    ),
    "far too many draws": (
        ("simulation", "n"),
        10**400,
        "must be an integer from 1 to 2^53. Got an integer of 1329",
    ),
    "kind of lamps": (
        ("light", "kind"),
        "torch",
        'must be fixed, ring, placed, backlight, diffuse-dome, coaxial or ring-light. Got "torch".',
    ),
    "contrast 1": (("light", "contrast"), 1, "must be in (0, 1). Got 1."),
    "lamp in the plane": (("light", "lamps", 0), [1, 2], "must have the shape (3,). Got (2,)."),
    "lamp 2": (
        (*LIT, "images", 0, "lamps"),
        [2],
        "must be numbers of lamps below 2 in rising order, more than one",
    ),
    "two lamps": (
        (*LIT, "images", 0, "lamps"),
        [0, 1],
        "must be numbers of lamps below 2 in rising order, more than one",
    ),
    "more lamps needed": (
        ("light", "lower_bound"),
        3,
        "must be at most 2, the number of lamps. Got 3.",
    ),
    "too even": (
        (*LIT, "images", 0, "contrast", "top right"),
        0.05,
        "must be at least light.contrast, 0.1. Got 0.05.",
    ),
    "lit settings": (("light", "settings"), [], "must hold one object per setting, 2. Got 0."),
    "lit twice": ((*LIT, "unlit", "top right"), "why", None),
    "exposed for nobody": (
        (*LIT_FIRST, "expose_for", "dimmest"),
        "bottom",
        None,
    ),
    "off the image": (
        (*LIT_FIRST, "expose_for", "pixel", 1),
        -1,
        "must be an integer from 0. Got -1.",
    ),
    "more light than most": (
        (*LIT_FIRST, "expose_for", "times"),
        0.5,
        "must be a number from 1, or null. Got 0.5.",
    ),
    "nobody's outline": (
        (*LIT, "images", 0, "silhouettes"),
        ["x"],
        'must be names that the image shows. Got "x".',
    ),
}
# where the field that is named is not the one that was changed, or the value is told otherwise
SENTENCES = {
    "exposed for nobody": "light.settings[0].images[0].expose_for must be names that the image shows. "
    'Got "bottom".',
    "kind for nobody": 'uninspectable_kinds.x must be a name that has a reason. Got "x".',
    "lit twice": 'light.settings[1] must tell of each of the setting\'s entities once. Got ["top right", "top right"].',
    "unknown entity": "settings[0].probability.x must be given. Got none.",
    "no length": "targets.bottom.witnesses[0].geometry[0]: a line must have two different ends. Got",
    "an edge with an angle": "targets.bottom.nominal must be given. Got none.",
    "in neither": "targets.bottom must be in a setting or uninspectable. Got neither.",
    "in both": 'targets["top front"] must be in a setting or uninspectable. Got both.',
    "a target that is not named": 'request.targets must name every target once. Got "bottom".',
    "a name without a target": 'request.targets must name every target once. Got "bottom".',
    "workspace": "request.workspace must hold the lower corner, then the upper one. Got [[901.0, ",
    "covariance": "request.pose_uncertainty.covariance must be symmetric. Got a difference of 0.1.",
    "interval": 'simulation.rates[0]["top front"] must be an interval, low to high, that contains successes / n, ',
    "fewer rates": "simulation.rates must hold one object per setting, 2. Got 0.",
    "sheared": "settings[1].cam2world must hold a rotation",
    "last row": "settings[1].cam2world must have the last row",
    "far away": "settings[1].cam2world must be in the workspace",
}


@pytest.mark.parametrize("case", WRONG)
def test_contradiction_is_named_by_its_path(tmp_path, case):
    path, value, rule = WRONG[case]
    sentence = SENTENCES.get(case) or f"{field_name(*path)} {rule}"
    (tmp_path / "plan.json").write_text(json.dumps(changed(path, value)))
    with pytest.raises(PlanFileError) as caught:
        read_plan(tmp_path / "plan.json")
    told = str(caught.value).removeprefix(f"{tmp_path / 'plan.json'}: ")
    assert told.startswith(sentence)
    assert told.endswith(".")


def test_null_is_what_is_not_given_where_a_field_may_be_null():
    data = encoded(plan().to_dict())
    nothing = {"cell": None, "light": None, "simulation": None}
    assert InspectionPlan.from_dict({**data, **nothing}) == plan()
    data["settings"][0]["arm"] = None
    with pytest.raises(PlanFileError, match=r"^settings\[0\]\.arm must be an object\. Got null"):
        InspectionPlan.from_dict(data)
    for name in ("part", "workspace"):
        with pytest.raises(PlanFileError, match=rf"^request\.{name} must be given\. Got null\."):
            InspectionPlan.from_dict(changed(("request", name), None))


def test_values_are_checked_as_the_file_is():
    assert InspectionPlan.from_dict(plan().to_dict()) == plan()
    with pytest.raises(PlanFileError, match=r"^bound must be 1 to 2"):
        InspectionPlan.from_dict({**plan().to_dict(), "bound": 3})


def test_an_empty_plan_has_the_bound_0(tmp_path):
    empty = plan(settings=(), lower_bound=0, uninspectable=dict.fromkeys(plan().entities, "hidden"))
    empty.write(tmp_path / "plan.json")
    assert read_plan(tmp_path / "plan.json") == empty
    (tmp_path / "plan.json").write_text(json.dumps({**empty.to_dict(), "bound": 1}))
    with pytest.raises(PlanFileError, match=r"bound must be 0, as there are no settings\. Got 1\."):
        read_plan(tmp_path / "plan.json")


UNREADABLE = {
    "empty": (b" \n", r"2:1: plan file must be JSON\. Got an empty file\."),
    "deep": (
        b"[" * 100_000 + b"]" * 100_000,
        r"plan file must be nested at most 40 deep\. Got more\.",
    ),
    "less deep": (b"[" * 50 + b"]" * 50, r"plan file must be nested at most 40 deep\. Got more\."),
    "twice": (b'{"a": 1, "a": 2}', r"must hold every key of an object once\. Got 'a' twice\."),
    "half": (
        b'["\\ud800"]',
        r"must hold text of whole characters\. Got half of one in '\\ud800'\.",
    ),
    "long": (b"9" * 5000, r"must hold numbers of a sensible length\. Got a longer one\."),
    "utf-16": ("{}".encode("utf-16"), r"plan file must be UTF-8 text\. Got other bytes\."),
}


@pytest.mark.parametrize("case", UNREADABLE)
def test_bytes_that_are_no_sensible_json_are_named(tmp_path, case):
    content, message = UNREADABLE[case]
    (tmp_path / "plan.json").write_bytes(content)
    with pytest.raises(PlanFileError, match=message):
        read_json(tmp_path / "plan.json", "plan file")


def test_folder_instead_of_a_file_is_named(tmp_path):
    with pytest.raises(
        PlanFileError, match=r"plan file must be readable\. Got: No such file or directory\."
    ):
        read_plan(tmp_path)


STATE = {
    "format": "aspectgraph planning state",
    "version": 4,
    "request": {},
    "program": "0" * 64,
    "outcomes": {'["a"]': {"reason": "hidden"}},
    "checkpoint": None,
    "plan": None,
    "digest": "0" * 64,
}
SETTING = setting((40.0, -180.0, 620.0), ["top front", "top right"]).to_dict()
WRONG_STATE = {
    "outcome": (
        {"outcomes": {'["a"]': {}}},
        'outcomes["[\\"a\\"]"] must hold either a setting or a reason.',
    ),
    "both": (
        {"outcomes": {'["a"]': {"reason": "hidden", "setting": SETTING}}},
        'outcomes["[\\"a\\"]"].reason must be left out, or renamed to one of setting. Got an unknown field.',
    ),
    "kind of nothing": (
        {"outcomes": {'["a"]': {"kind": "too short"}}},
        'outcomes["[\\"a\\"]"] must hold either a setting or a reason.',
    ),
    "unknown kind": (
        {"outcomes": {'["a"]': {"reason": "hidden", "kind": "dull"}}},
        'outcomes["[\\"a\\"]"].kind must be a kind of reason. Got "dull".',
    ),
    "key": (
        {"outcomes": {'["b","a"]': {"reason": ""}}},
        "outcomes must have sorted JSON arrays of names as keys.",
    ),
    "step": (
        {"checkpoint": {"stage": "lunch", "entries": {}, "pools": {}, "uninspectable": {}}},
        'checkpoint.stage must be a stage of planning. Got "lunch".',
    ),
    "pools": (
        {"checkpoint": {"stage": "lower bound", "entries": {}, "uninspectable": {}}},
        "checkpoint.pools must be given. Got none.",
    ),
    "digest": ({"digest": 7}, "digest must be 64 hexadecimal digits. Got 7."),
    "program": ({"program": 7}, "program must be 64 hexadecimal digits. Got 7."),
    "request": ({"request": "0" * 64}, "request must be an object that holds the request."),
    "no plan": ({"plan": 7}, "plan must be an object or null. Got 7."),
    "plan's field": (
        {"plan": changed(("request", "accuracy"), 2)},
        "plan.request.accuracy must be in (0, 1). Got 2.",
    ),
    "plan's bound": ({"plan": changed(("bound",), 99)}, "plan.bound must be 1 to 2"),
}


@pytest.mark.parametrize("case", WRONG_STATE)
def test_state_is_checked_by_its_own_schema(case):
    change, message = WRONG_STATE[case]

    check_fields(STATE)
    with pytest.raises(PlanFileError) as raised:
        check_fields({**STATE, **change})
    assert str(raised.value).startswith(message)


def test_a_state_that_was_changed_inside_is_refused(tmp_path):
    """What fits every rule may still not be what was written."""
    path = tmp_path / "state.json"
    state = PlanningState({}, path)
    state.put(["a"], Outcome(reason="hidden by e7"))
    state.save()
    path.write_text(path.read_text().replace("hidden by e7", "hidden by e8"))
    with pytest.raises(PlanFileError, match="digest must be that of the other fields"):
        PlanningState({}, path)


def test_values_are_shown_as_json_writes_them_and_shortened():
    long = "x" * 60
    assert [shown(value) for value in (None, math.nan, {"not finite": "inf"}, [1], {}, [long], {"a": long})] == [
        "null", "NaN", "Infinity", "[1]", "{}", "an array of 1 item", "an object of 1 field",
    ]  # fmt: skip
    assert shown("x" * 500) == '"' + "x" * 55 + '..."'
    assert (
        field_name("settings", 2, "probability", "long edge")
        == 'settings[2].probability["long edge"]'
    )


# Whatever is done to a plan, state or camera file: one clear line refuses it, or what it promises
# makes sense.


MUTANTS = 300
REQUEST = {"entities": ENTITIES}
CAMERA = """focal_length_mm = 25.0
pixel_pitch_mm = [0.00345, 0.00345]
resolution = [2448, 2048]
f_number = 8.0
focus_distance_mm = 600.0
largest_blur_mm = 0.005
name = "cell 7"
"""


def assert_one_line(error, path):
    assert str(error).startswith(str(path))
    assert str(error).endswith(".")
    assert str(error).isprintable()
    assert len(str(error)) < len(str(path)) + 400, str(error)


def test_damaged_plan_is_refused_or_makes_sense(tmp_path):
    good = encoded(plan(light=LIGHT).simulated(100).to_dict())
    rng = random.Random(1)
    path = tmp_path / "plan.json"
    refused = 0
    for _ in range(MUTANTS):
        path.write_bytes(damaged_json(good, rng))
        try:
            found = read_plan(path)
        except PlanFileError as error:
            assert_one_line(error, path)
            refused += 1
            continue
        assert_sensible(found)
    assert refused > 0.6 * MUTANTS


def assert_sensible(found):
    assert 0 < found.probability < 1
    assert min(1, len(found.settings)) <= found.lower_bound <= len(found.settings)
    assert set(found.inspected) | set(found.uninspectable) == set(found.entities)
    for one in found.settings:
        assert tuple(one.probability) == one.entities or set(one.probability) == set(one.entities)
        assert all(found.probability - 1e-6 <= p <= 1 for p in one.probability.values())
        turn = one.cam2world[:3, :3]
        assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-5)
        assert np.isfinite(one.cam2world).all()
    if found.light is not None:
        assert 0 <= found.light.lower_bound <= len(found.light.lamps)
        for one, images, unlit in zip(
            found.settings, found.light.images, found.light.unlit, strict=True
        ):
            assert sorted(
                [*unlit, *(name for image in images for name in image.contrast)]
            ) == sorted(one.entities)
    result = found.simulate(20)
    assert all(0 <= rate.low <= rate.high <= 1 for rates in result.rates for rate in rates.values())


def test_damaged_state_is_refused_and_left_alone_or_makes_sense(tmp_path):
    path = tmp_path / "state.json"
    good = json.loads(written_state(path).read_text())
    rng = random.Random(2)
    refused = 0
    for _ in range(MUTANTS):
        content = damaged_json(good, rng)
        path.write_bytes(content)
        try:
            state = PlanningState(REQUEST, path)
        except PlanFileError as error:
            assert_one_line(error, path)
            assert path.read_bytes() == content
            refused += 1
            continue
        # other spaces or another order of the fields, but nothing else
        assert json.loads(content) == good
        assert state.get(["bottom"]) == Outcome(reason="unobservable: no viewpoint sees it.")
    assert refused > 0.6 * MUTANTS


def written_state(path):
    state = PlanningState(REQUEST, path)
    state.put(["bottom"], Outcome(reason="unobservable: no viewpoint sees it."))
    state.put(
        ["top front", "top right"],
        Outcome(setting((40.0, -180.0, 620.0), ["top front", "top right"])),
    )
    poses = look_at([[0.0, 1.0, 200.0], [3.0, 4.0, 500.0]], (0.0, 0.0, 0.0), roll=0.3)
    pools = {"realised": {"poses": poses}, "near": {"poses": poses[:1]}}
    state.keep(
        {
            "stage": "lower bound",
            "pools": pools,
            "uninspectable": {"bottom": "hidden"},
            "entries": {"proven": [2, "boxes"]},
        },
    )
    state.save()
    return path


def test_damaged_camera_is_refused_or_exists(tmp_path):
    rng = random.Random(3)
    path = tmp_path / "camera.toml"
    refused = 0
    for _ in range(MUTANTS):
        path.write_bytes(damaged_toml(CAMERA, rng))
        try:
            camera = Camera.from_toml(path)
        except CameraError as error:
            assert_one_line(error, path)
            refused += 1
            continue
        near, far = camera.depth_of_field_mm
        assert 0 < near < far
        assert np.isfinite(
            [camera.image_distance_mm, *camera.sensor_size_mm, *camera.matrix.flat]
        ).all()
    assert refused > 0.6 * MUTANTS


def test_state_is_strict_json_and_keeps_margins_that_are_not_finite(tmp_path):
    path = written_state(tmp_path / "state.json")
    json.loads(path.read_text(), parse_constant=pytest.fail)
    found = PlanningState(REQUEST, path).get(["top right", "top front"]).setting
    assert found == setting((40.0, -180.0, 620.0), ["top front", "top right"])
    assert found.margins["reach"] == float("inf")


# Every reader gives a result or one of the package's own errors of one line, whatever the file;
# see `make fuzz`.


MUTANTS_FUZZ = 40

# mutants that once ended otherwise
KEPT = {
    "binary.ply": (1604, 4350),
    "entities.toml": (1292, 1308, 1504),
    "entities.json": (129, 1136, 1385, 1996),
    "entities.csv": (1325,),
    "wanted.toml": (1069, 1231, 1539),
    "wanted.json": (143, 147, 670, 752, 1120),
}


@pytest.mark.parametrize("name", [name for name in READERS if name != "part.step"])
def test_damaged_files_are_read_or_refused(tmp_path, name):
    path = tmp_path / name
    good = READERS[name].good()
    path.write_bytes(good)
    assert outcome(name, path) == "read"
    found = []
    for seed in (*range(MUTANTS_FUZZ), *KEPT.get(name, ())):
        path.write_bytes(mutant(name, seed, good))
        found.append(outcome(name, path))
    assert found.count("refused") > MUTANTS_FUZZ / 3


@pytest.mark.parametrize("name", [name for name in READERS if READERS[name].read is not read_solid])
def test_every_reader_has_a_limit_of_size(tmp_path, monkeypatch, name):
    path = tmp_path / name
    good = READERS[name].good()
    path.write_bytes(good)
    if name == "part.step":
        with pytest.raises(ReadError, match=r"must have at most file_mb=0\.001 MB"):
            read_solid(path, limits=ReadLimits(file_mb=0.001))
        return
    monkeypatch.setattr(files, "SMALL_FILE_BYTES", len(good) - 1)
    monkeypatch.setattr(files, "LARGE_FILE_BYTES", len(good) - 1)
    with pytest.raises(OWN, match=r"it has more than .* MB"):
        READERS[name].read(path)


@pytest.mark.parametrize("name", [name for name in READERS if READERS[name].read is read_solid])
def test_every_mesh_has_a_limit_of_size(tmp_path, name):
    path = tmp_path / name
    good = READERS[name].good()
    path.write_bytes(good)
    with pytest.raises(ReadError, match=r"must have at most file_mb=0\.0001 MB"):
        read_solid(path, limits=ReadLimits(file_mb=0.0001))


def test_a_part_whose_name_is_no_unicode_has_a_name_that_can_be_written(tmp_path):
    path = tmp_path / os.fsdecode(b"part\xff\xed\xa0\x80.off")
    path.write_bytes(READERS["part.off"].good())
    name = read_solid(path).name
    assert name == r"part\xff\xed\xa0\x80"
    plan(part=name).write(tmp_path / "plan.json")
    assert read_plan(tmp_path / "plan.json").part == name


@pytest.mark.parametrize("name", READERS)
def test_half_a_character_is_no_name_of_a_file(tmp_path, name):
    before, after = name.split(".")
    with pytest.raises((*OWN, FileNotFoundError)):
        READERS[name].read(tmp_path / f"{before}\ud800.{after}")


def test_mutants_are_the_same_everywhere():
    good = READERS["part.off"].good()
    assert mutant("part.off", 7, good) == mutant("part.off", 7, good) != good
    assert len({mutant("part.off", seed, good) for seed in range(100)}) > 90


def test_a_damaged_step_file_is_read_or_refused(tmp_path):
    pytest.importorskip("OCP")
    path = tmp_path / "part.step"
    good = READERS["part.step"].good()
    for seed in range(2):
        path.write_bytes(mutant("part.step", seed, good))
        assert outcome("part.step", path) in ("read", "refused")


# Whatever a plan, a state or a file of dimensions holds comes back as it was, bit for bit.


QUICK = settings(max_examples=20, deadline=None, derandomize=True)
NAMES = st.text(st.characters(codec="utf-8"), min_size=1, max_size=12).filter(str.strip)
LENGTHS = st.floats(1e-9, 1e9)
NUMBERS = st.floats(-1e6, 1e6)


@QUICK
@given(
    names=st.lists(NAMES, min_size=3, max_size=3, unique=True),
    ends=st.lists(NUMBERS, min_size=6, max_size=6),
    reason=NAMES,
    probability=st.floats(0.5, 1.0),
    accuracy=st.floats(0.01, 0.999999),
    seed=st.integers(0, 2**63 - 1),
)
def test_plans(tmp_path_factory, names, ends, reason, probability, accuracy, seed):
    first, second, third = names
    segment = np.reshape(ends, (2, 3))
    segment[1] += 1.0 + np.abs(segment).max()
    made = plan(
        settings=(setting((40.0, -180.0, 620.0), [first, second], probability=probability),),
        entities=dict.fromkeys(names, segment.tolist()),
        uninspectable={third: reason},
        accuracy=accuracy,
        probability=0.5 * probability,
        seed=seed,
        part=reason,
    )
    path = tmp_path_factory.mktemp("plan") / "plan.json"
    made.write(path)
    again = read_plan(path)
    assert again.to_dict() == made.to_dict()
    assert np.array_equal(again.entities[first], segment)
    assert (again.seed, again.accuracy, again.uninspectable) == (seed, accuracy, {third: reason})
    again.write(path.with_name("again.json"))
    assert path.read_bytes() == path.with_name("again.json").read_bytes()


@QUICK
@given(
    st.lists(NAMES, min_size=1, max_size=4, unique=True).filter(lambda n: n != ["one more"]), NAMES
)
def test_states(tmp_path_factory, names, reason):
    path = tmp_path_factory.mktemp("state") / "state.json"
    state = PlanningState({"part": "block"}, path)
    state.put(names, Outcome(reason=reason))
    several = sorted({*names, "one more"})
    found = setting((40.0, -180.0, 620.0), several)
    state.put(several, Outcome(found))
    state.save()
    again = PlanningState({"part": "block"}, path)
    assert len(again) == 2
    assert again.get(reversed(names)).reason == reason
    assert again.get(several).setting.to_dict() == found.to_dict()


SHAPES = arrays.array_shapes(min_dims=1, max_dims=3, max_side=4)


@QUICK
@given(
    arrays.arrays(st.sampled_from([np.float64, np.int64, np.bool_]), SHAPES),
    st.recursive(
        st.none() | st.booleans() | st.integers() | NAMES, lambda inner: st.lists(inner, max_size=3)
    ),
)
def test_values_of_checkpoints(table, plain):
    last = unpacked(json.loads(json.dumps(packed({"table": table, "plain": plain}))))
    assert last["plain"] == plain
    assert (last["table"].dtype, last["table"].shape) == (table.dtype, table.shape)
    assert last["table"].tobytes() == table.tobytes()


ENTITIES_ROUND_TRIPS = st.one_of(st.integers(0, 999), st.integers(0, 99).map("r{}".format))
ASKED = st.one_of(
    st.fixed_dictionaries({"max_error": LENGTHS}),
    st.fixed_dictionaries({"accuracy": st.floats(0.5, 0.99)}),
    st.tuples(LENGTHS, LENGTHS, st.floats(0.01, 1.0)).map(
        lambda t: {"tolerance": [-t[0], t[1]], "share": t[2]}
    ),
    st.just({}),
)


@QUICK
@given(
    st.dictionaries(
        NAMES,
        st.tuples(
            st.sampled_from(["length", "diameter", "distance"]),
            ENTITIES_ROUND_TRIPS,
            ENTITIES_ROUND_TRIPS,
            ASKED,
        ),
        min_size=1,
    )
)
def test_files_of_dimensions(tmp_path_factory, wanted):
    path = tmp_path_factory.mktemp("wanted") / "dimensions.json"
    content = {
        name: {kind: [one, other] if kind == "distance" else one, **asked}
        for name, (kind, one, other, asked) in wanted.items()
    }
    path.write_text(json.dumps({"dimensions": content}))
    expected = {
        name: Dimension(kind, (one, other) if kind == "distance" else (one,), **asked)
        for name, (kind, one, other, asked) in wanted.items()
    }
    assert read_wanted(path, kinds()) == expected
