"""Records and plain values: what is read is what was written, and each broken rule is named by path, rule and value."""

from __future__ import annotations

import copy
import json
import math
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, make_dataclass
from enum import Enum
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

import jsonschema
import numpy as np
import pytest
from numpy.typing import NDArray
from typing_extensions import TypeAliasType

from ground.convert import (
    FROM_ONE,
    LATER,
    NOT_STORED,
    ROW,
    SPELLED,
    STATED,
    Key,
    Meta,
    NullIs,
    Plain,
    Shape,
    check_fields,
    field_name,
    from_plain,
    json_schema,
    shown,
    to_plain,
)

Share = Annotated[float, Meta(ge=0, le=1)]
Fraction = Annotated[float, Meta(gt=0, lt=1, title="must be in (0, 1)")]
Names = Annotated[
    tuple[str, ...],
    Meta(
        min_length=1,
        extra_json_schema={"uniqueItems": True},
        title="must be an array of at least one name, all different",
    ),
]


class RuleError(ValueError):
    """An error as the packages have them."""

    parameter = ""

    @classmethod
    def of_rule(cls, parameter, rule, got):
        error = cls(f"{parameter} {rule}. Got {got}.")
        error.parameter = parameter
        return error


class Grade(Enum):
    GOOD = "good"
    POOR = "poor"


class Rates(NamedTuple):
    """Speeds of the joints, rad/s."""

    speeds: Annotated[NDArray[np.float64], Shape(None), Meta(gt=0)]
    scale: float = 1.0


@dataclass(frozen=True)
class Ring:
    kind: Literal["ring"]
    n: Annotated[int, Meta(ge=1)]


@dataclass(frozen=True)
class Lamp:
    kind: Literal["fixed", "placed"]
    at: tuple[float, float, float]


@dataclass(frozen=True)
class Line:
    p: tuple[float, float]
    q: tuple[float, float]

    def __post_init__(self):
        if self.p == self.q:
            raise RuleError(f"a line must have two ends. Got {self.p} twice.")


@dataclass(frozen=True)
class Board:
    squares: Annotated[tuple[int, int], Meta(title="must be two integers")]
    side: Annotated[float, Meta(gt=0, title="must be positive"), Meta(ge=0.01), Meta(le=1000)]
    pose: Annotated[NDArray[np.float64], Shape(2, 2)]
    line: Annotated[Line | None, ROW] = None
    kind: Literal["dots", "squares"] = "dots"

    def __post_init__(self):
        check_fields(self, RuleError)


@dataclass(frozen=True)
class Circle:
    centre: tuple[float, float]
    radius: float

    def __post_init__(self):
        if self.radius <= 0:
            raise RuleError.of_rule("radius", "must be positive", str(self.radius))


@dataclass(frozen=True)
class Move:
    joints: Annotated[NDArray[np.float64], Shape(None)]
    seconds: float = field(init=False)
    last: Annotated[NDArray[np.float64], Shape(1)] = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "seconds", float(self.joints.sum()))
        object.__setattr__(self, "last", self.joints[-1:])


@dataclass(frozen=True, eq=False)
class Setting:
    """One pose.

    More words.
    """

    cam2world: Annotated[NDArray[np.float64], Shape(4, 4)]
    probability: Annotated[Mapping[str, Share], Meta(title="must map names to probabilities")]
    names: Names
    margins: Mapping[str, Annotated[float, SPELLED]] = field(default_factory=dict)
    error: Annotated[float, NullIs(math.nan)] = math.nan
    limits: tuple[Annotated[float, NullIs(-math.inf)], Annotated[float, NullIs(math.inf)]] | None = None  # fmt: skip
    expanded: Annotated[float | None, Key("U"), Meta(gt=0)] = None


@dataclass(frozen=True)
class Plan:
    format: Literal["a plan"]
    settings: tuple[Setting, ...]
    light: Ring | Lamp | None = None
    shapes: tuple[Line | Circle, ...] = ()
    share: Annotated[Fraction | None, Meta(description="Of all parts.")] = None
    grade: Grade = Grade.GOOD
    rates: Rates | None = None
    reasons: Mapping[int, str] = field(default_factory=dict)
    table: Annotated[NDArray[np.int64], Shape(None, None)] | None = None
    extra: Any = None
    plotted: Annotated[bool, NOT_STORED] = False


GOOD: dict[str, Any] = {
    "format": "a plan",
    "settings": [
        {
            "cam2world": np.eye(4).tolist(),
            "probability": {"e1": 0.1 + 0.2, "long edge": 1.0},
            "names": ["e1"],
            "margins": {"focus": 0.5, "reach": {"not finite": "inf"}},
            "limits": [None, 0.5],
            "U": 0.25,
        }
    ],
    "light": {"kind": "placed", "at": [1.0, 2.0, 3.0]},
    "shapes": [
        {"p": [0.0, 0.0], "q": [1.0, 0.0]},
        {"centre": [0.0, 0.0], "radius": 2.0},
    ],
    "share": 0.5,
    "grade": "poor",
    "rates": {"speeds": [1.0, 2.0]},
    "reasons": {"3": "hidden"},
    "table": [[1, 2], [3, 4]],
    "extra": {"anything": [1]},
}


def changed(path, value):
    """Return the good data with one value changed, or removed where the value is ``...``."""
    data = copy.deepcopy(GOOD)
    holder = data
    for key in path[:-1]:
        holder = holder[key]
    if value is ...:
        del holder[path[-1]]
    else:
        holder[path[-1]] = value
    return data


def test_what_is_written_is_what_was_read():
    plan = from_plain(Plan, GOOD, RuleError)
    assert to_plain(plan) == GOOD
    assert json.dumps(to_plain(plan)) == json.dumps(GOOD)


def test_values_have_the_types_of_the_fields():
    plan = from_plain(Plan, GOOD, RuleError)
    (setting,) = plan.settings
    assert setting.cam2world.dtype == np.float64
    assert setting.cam2world.shape == (4, 4)
    assert setting.probability["e1"] == 0.1 + 0.2
    assert setting.margins["reach"] == math.inf
    assert math.isnan(setting.error)
    assert setting.limits == (-math.inf, 0.5)
    assert plan.light == Lamp("placed", (1.0, 2.0, 3.0))
    assert plan.shapes == (Line((0.0, 0.0), (1.0, 0.0)), Circle((0.0, 0.0), 2.0))
    assert plan.grade is Grade.POOR
    assert plan.rates is not None
    assert plan.rates.speeds.tolist() == [1.0, 2.0]
    assert plan.reasons == {3: "hidden"}
    assert plan.table is not None
    assert plan.table.dtype == np.int64


def test_integers_are_numbers_and_become_floats():
    plan = from_plain(Plan, changed(("light", "at"), [1, 2, 3]), RuleError)
    assert isinstance(plan.light, Lamp)
    assert all(type(x) is float for x in plan.light.at)


def test_defaults_are_left_out_unless_wanted():
    plan = Plan("a plan", (), rates=Rates(np.ones(2)), light=Ring("ring", 1))
    assert to_plain(plan) == {
        "format": "a plan",
        "settings": [],
        "light": {"kind": "ring", "n": 1},
        "rates": {"speeds": [1.0, 1.0]},
    }
    full = to_plain(plan, defaults=True)
    assert list(full) == [
        *("format", "settings", "light", "shapes", "share", "grade", "rates"),
        *("reasons", "table", "extra"),
    ]
    assert full["rates"]["scale"] == 1.0
    assert full["grade"] == "good"
    assert from_plain(Plan, full, RuleError).light == plan.light


def test_what_follows_from_other_fields_is_written_and_compared():
    data = {"joints": [1.0, 2.0], "seconds": 3.0, "last": [2.0]}
    assert to_plain(from_plain(Move, data, RuleError)) == data
    assert from_plain(Move, {**data, "seconds": 3.0000001}, RuleError).seconds == 3.0
    with pytest.raises(RuleError, match=r"^seconds must be 3\.0, as the other fields say\. Got 4"):
        from_plain(Move, {**data, "seconds": 4.0}, RuleError)
    with pytest.raises(RuleError, match=r"^last must be \[2\.0\], as .* Got \[1\.0\]\.$"):
        from_plain(Move, {**data, "last": [1.0]}, RuleError)
    with pytest.raises(RuleError, match=r"^seconds must be given"):
        from_plain(Move, {"joints": [1.0], "last": [1.0]}, RuleError)


def test_an_array_without_rows_keeps_its_number_of_axes():
    plan = from_plain(Plan, changed(("table",), []), RuleError)
    assert plan.table is not None
    assert plan.table.shape == (0, 0)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_number_that_is_not_finite_is_not_written(value):
    with pytest.raises(ValueError, match=r"^a file must hold finite numbers\. Got"):
        to_plain(Circle((value, 0.0), 1.0))
    with pytest.raises(ValueError, match=r"^a file must hold finite numbers\. Got an array"):
        to_plain(Rates(np.array([value])))


SETTING = ("settings", 0)
WRONG = {
    "above": ((*SETTING, "probability", "e1"), 1.2, "must be at most 1. Got 1.2."),
    "below": ((*SETTING, "probability", "e1"), -1, "must be at least 0. Got -1."),
    "text": ((*SETTING, "probability", "e1"), "1", 'must be a number. Got "1".'),
    "nan": ((*SETTING, "probability", "e1"), math.nan, "must be a number. Got NaN."),
    "true": ((*SETTING, "probability", "e1"), True, "must be a number. Got true."),
    "null": ((*SETTING, "probability", "e1"), None, "must be a number. Got null."),
    "long": (
        (*SETTING, "probability", "long edge"),
        10**400,
        "must be at most 1. Got an integer of 1329 bits.",
    ),
    "no object": ((*SETTING, "probability"), 7, "must map names to probabilities. Got 7."),
    "no record": (SETTING, [], "must be an object. Got []."),
    "whole": ((), 7, "file must be an object. Got 7."),
    "rows": ((*SETTING, "cam2world"), [[1]], "must have the shape (4, 4). Got (1, 1)."),
    "row": ((*SETTING, "cam2world", 3), [1], "must have the shape (4,). Got (1,)."),
    "no rows": ((*SETTING, "cam2world"), "x", 'must have the shape (4, 4). Got "x".'),
    "entry": ((*SETTING, "cam2world", 2, 1), "x", 'must be a number. Got "x".'),
    "inf entry": ((*SETTING, "cam2world", 2, 1), math.inf, "must be a number. Got Infinity."),
    "uneven": (("table", 1), [3], "table must have the shape (n, n). Got (2, 2)."),
    "float": (("table", 1, 0), 3.0, "must be an integer. Got 3.0."),
    "speed": (("rates", "speeds", 1), 0, "must be above 0. Got 0."),
    "no name": (
        (*SETTING, "names"),
        [],
        "must be an array of at least one name, all different. Got [].",
    ),
    "name twice": (
        (*SETTING, "names"),
        ["a", "a"],
        'must be an array of at least one name, all different. Got ["a", "a"].',
    ),
    "name": ((*SETTING, "names", 0), 3, None),
    "margin": (
        (*SETTING, "margins", "focus"),
        math.inf,
        'must be a number, or {"not finite": "inf"} where there is no finite one. Got Infinity.',
    ),
    "spelling": ((*SETTING, "margins", "reach", "not finite"), "nan", 'must be "inf". Got "nan".'),
    "nan for null": (
        (*SETTING, "error"),
        math.nan,
        "must be a number or null. Got NaN.",
    ),
    "one limit": ((*SETTING, "limits"), [1], "must be an array of 2 items or null. Got [1]."),
    "limit": ((*SETTING, "limits", 1), "1", 'must be a number or null. Got "1".'),
    "renamed": ((*SETTING, "U"), 0, "must be above 0. Got 0."),
    "missing": ((*SETTING, "names"), ..., "must be given. Got none."),
    "unknown": (
        (*SETTING, "nams"),
        1,
        "must be left out, or renamed to one of cam2world, probability, names, margins, error, "
        "limits, U. "
        "Got an unknown field; the nearest is names.",
    ),
    "own name": ((*SETTING, "expanded"), 1, None),
    "not stored": (("plotted",), True, None),
    "kind": (("light", "kind"), "torch", 'must be ring, fixed or placed. Got "torch".'),
    "no kind": (("light", "kind"), ..., "must be given. Got none."),
    "kind of": (
        ("light", "kind"),
        "ring",
        "light.at must be left out, or renamed to one of kind, n. Got an unknown",
    ),
    "no shape": (("shapes", 0), {"r": 1}, 'must be an object. Got {"r": 1}.'),
    "fraction": (("share",), 3, "must be in (0, 1) or null. Got 3."),
    "enum": (("grade",), "so so", 'must be good or poor. Got "so so".'),
    "const": (("format",), "plan", 'must be "a plan". Got "plan".'),
    "no number": (
        ("reasons",),
        {"a": "hidden"},
        'must have whole numbers as keys. Got "a".',
    ),
    "record": (
        ("shapes", 0, "q"),
        [0, 0],
        "shapes[0]: a line must have two ends. Got (0.0, 0.0) twice.",
    ),
    "its field": (("shapes", 1, "radius"), -2, "must be positive. Got -2.0."),
}
# where the name is not that of the field, or the words begin elsewhere
WHOLE = {
    "whole": "file must be an object. Got 7.",
    "uneven": "table must have the shape (n, n). Got (2, 2).",
    "record": "shapes[0]: a line must have two ends. Got (0.0, 0.0) twice.",
    "name": "settings[0].names[0] must be text. Got 3.",
    "kind of": "light.at must be left out, or renamed to one of kind, n. Got an unknown field.",
    "own name": "settings[0].expanded must be left out, or renamed to one of cam2world, ",
    "not stored": "plotted must be left out, or renamed to one of format, ",
}


@pytest.mark.parametrize("case", WRONG)
def test_a_broken_rule_is_named_by_path_and_value(case):
    path, value, rule = WRONG[case]
    data = changed(path, value) if path else value
    with pytest.raises(RuleError) as caught:
        from_plain(Plan, data, RuleError, "plan.json")
    sentence = WHOLE.get(case) or f"{field_name(*path)} {rule}"
    assert str(caught.value).startswith(f"plan.json: {sentence}")
    assert str(caught.value).endswith(".")


def test_the_error_says_which_parameter_it_is():
    with pytest.raises(RuleError) as caught:
        from_plain(Ring, {"kind": "ring", "n": 0}, RuleError)
    assert caught.value.parameter == "n"
    with pytest.raises(RuleError) as caught:
        from_plain(Circle, {"centre": [0, 0], "radius": 0}, RuleError)
    assert caught.value.parameter == "radius"


def test_a_record_made_by_hand_keeps_the_same_rules():
    board = Board([np.int64(3), 4], 2, np.eye(2), Line((0.0, 0.0), (1.0, 0.0)))
    assert board.squares == (3, 4)
    assert type(board.side) is float
    assert to_plain(board)["line"] == [[0.0, 0.0], [1.0, 0.0]]
    again = from_plain(Board, to_plain(board), RuleError)
    assert again.line == board.line
    assert Board([3, 4], np.float64(2), [[1, 0], [0, 1]]).pose.tolist() == np.eye(2).tolist()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"squares": 3}, r"squares must be two integers\. Got 3\."),
        ({"side": 0}, r"side must be positive\. Got 0\."),
        ({"side": "2"}, r"side must be positive\. Got '2'\."),
        ({"side": math.nan}, r"side must be positive\. Got nan\."),
        ({"side": 0.001}, r"side must be at least 0\.01\. Got 0\.001\."),
        ({"side": 10**400}, r"side must be at most 1000\. Got 1000.*\.\.\.\."),
        ({"pose": np.eye(3)}, r"pose must have the shape \(2, 2\)\. Got \(3, 3\)\."),
        ({"kind": None}, r"kind must be dots or squares\. Got None\."),
        ({"line": [[0, 0], [0, 0]]}, r"a line must have two ends"),
    ],
)
def test_rules_of_a_record_made_by_hand_show_values_of_python(change, message):
    good = {"squares": (3, 4), "side": 2.0, "pose": np.eye(2)}
    with pytest.raises(RuleError, match=f"^{message}$" if "Got" in message else message):
        Board(**{**good, **change})


def test_the_schema_of_several_rules_holds_all_limits():
    side = json_schema(Board)["$defs"]["Board"]["properties"]["side"]
    limits = {"exclusiveMinimum": 0, "minimum": 0.01, "maximum": 1000}
    assert side == {"title": "must be positive", "type": "number", **limits}


def test_the_schema_says_what_the_reader_does():
    schema = json_schema(Plan, title="Plans")
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["title"] == "Plans"
    validator = jsonschema.Draft202012Validator(schema)
    validator.validate(GOOD)
    # what JSON cannot hold, and what records say of themselves, no schema knows
    beyond = ("nan", "long", "inf entry", "margin", "nan for null", "uneven", "float")
    for case, (path, value, _) in WRONG.items():
        if path and case not in (*beyond, "no number", "record", "its field"):
            assert not validator.is_valid(changed(path, value)), case


def test_the_schema_has_words():
    schema = json_schema(Plan)
    assert schema["$ref"] == "#/$defs/Plan"
    assert schema["$defs"]["Setting"]["description"] == "One pose."
    assert "description" not in schema["$defs"]["Ring"]
    share = schema["$defs"]["Plan"]["properties"]["share"]
    assert share["description"] == "Of all parts."
    assert share["title"] == "must be in (0, 1) or null"


def test_the_schema_of_files_that_state_defaults_needs_them():
    needed = json_schema(Plan, defaults=True)["$defs"]["Plan"]["required"]
    assert needed == list(to_plain(Plan("a plan", ()), defaults=True))


def test_values_are_shown_as_json_writes_them_and_shortened():
    assert shown([None, math.nan, 1.0]) == "[null, NaN, 1.0]"
    assert shown("x" * 500) == '"' + "x" * 55 + '..."'
    assert shown(dict.fromkeys("abcdefghijklmnop", 1.5)) == "an object of 16 fields"


def test_faces_do_not_wait_for_the_converter():
    code = "import sys, aspectgraph, errors, ga, planner; print('msgspec' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


class Visits(NamedTuple):
    index: Annotated[int, Key("number"), FROM_ONE, Meta(ge=1)]
    missed: Annotated[Mapping[int, str], FROM_ONE]


def test_files_count_from_one():
    visits = Visits(0, {2: "far"})
    assert to_plain(visits) == {"number": 1, "missed": {"3": "far"}}
    assert from_plain(Visits, to_plain(visits), RuleError) == visits
    for data, message in (
        ({"number": 0, "missed": {}}, "number must be at least 1. Got 0"),
        ({"number": 1, "missed": {"0": ""}}, "missed must have whole numbers from 1 as keys"),
    ):
        with pytest.raises(RuleError, match=message):
            from_plain(Visits, data, RuleError)


@dataclass(frozen=True)
class Gauge:
    share: Annotated[Share, STATED] = 0.5
    gain: float = math.nan


@dataclass(frozen=True)
class Panel:
    gauge: Annotated[Gauge, LATER]
    colour: Annotated[complex, Plain(str, complex)] = 1j


def test_a_default_is_stated_where_files_always_hold_it_and_nan_is_a_default():
    assert to_plain(Gauge(gain=-math.nan)) == {"share": 0.5}
    assert from_plain(Gauge, {"share": 1}, RuleError).share == 1.0
    with pytest.raises(RuleError, match=r"^share must be given\. Got none\."):
        from_plain(Gauge, {}, RuleError)
    # a whole number is a float where floats are meant
    assert json.dumps(to_plain(Gauge(1))) == '{"share": 1.0}'


def test_functions_make_plain_what_is_no_record_and_a_record_may_be_read_later():
    data = {"gauge": {"bright": True}, "colour": "(1+2j)"}
    panel = from_plain(Panel, data, RuleError)
    assert panel == Panel({"bright": True}, 1 + 2j)
    assert to_plain(Panel(Gauge(), 2j))["colour"] == "2j"
    assert "Gauge" in json_schema(Panel)["$defs"]
    for change, text in (
        ({"gauge": 7}, "gauge must be an object. Got 7."),
        ({"colour": "red"}, "colour: complex() arg is a malformed string"),
        ({"colour": [1]}, "colour must be as this program writes it. Got [1]."),
    ):
        with pytest.raises(RuleError) as caught:
            from_plain(Panel, {**data, **change}, RuleError)
        assert str(caught.value) == text


def test_an_array_may_be_named_by_an_alias():
    """As numpy 2.5 names its own, for newer versions of Python."""
    number = TypeVar("number")
    alias = TypeAliasType(
        "NDArray", np.ndarray[tuple[Any, ...], np.dtype[number]], type_params=(number,)
    )
    kind = Annotated[alias[np.float64], Shape(3)]
    record = from_plain(
        make_dataclass("Named", [("place", kind)]), {"place": [1, 2, 3]}, ValueError
    )
    assert record.place.dtype == np.float64
    assert to_plain(record) == {"place": [1.0, 2.0, 3.0]}
