"""The schema of the files, and what it cannot say: every contradiction is named by the path of its field."""

import json
import math

import jsonschema
import pytest
from plan_examples import LIGHT, plan, setting

from planner.exceptions import PlanFileError
from planner.files import encoded, read_json
from planner.plan import InspectionPlan, read_plan
from planner.plan_file import check_schema, check_state, field_name, read_schema, shown
from planner.resume import PlanningState
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
    schema = read_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    plan().write(tmp_path / "plan.json")
    jsonschema.validate(json.loads((tmp_path / "plan.json").read_text()), schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"format": "a shopping list"}, schema)


def test_every_rule_of_the_schema_has_words():
    left = list(read_schema()["$defs"].values())
    while left:
        one = left.pop()
        assert "$ref" in one or one["title"].startswith("must ")
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
    "unknown field": (("colour",), 1, "must be one of format, version,"),
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
    "kind of lamps": (("light", "kind"), "torch", 'must be fixed, ring or placed. Got "torch".'),
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
    "no length": "targets.bottom must be one that can be measured. Got: a line must have two",
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
        'outcomes["[\\"a\\"]"] must hold either a setting or a reason.',
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
    "request": ({"request": "0" * 64}, "request must be an object that holds what was asked for."),
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

    def check(state):
        check_schema(state, "state")
        check_state(state)

    check(STATE)
    with pytest.raises(PlanFileError) as raised:
        check({**STATE, **change})
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
    assert shown("x" * 500) == '"' + "x" * 56 + "..."
    assert (
        field_name("settings", 2, "probability", "long edge")
        == 'settings[2].probability["long edge"]'
    )
