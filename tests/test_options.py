"""Public calls with many options take them by keyword, each shown with its default, and no other."""

import inspect
import sys
from dataclasses import MISSING, fields, replace
from types import SimpleNamespace
from typing import Literal, get_args, get_origin

import pytest
from IPython.core.completer import provisionalcompleter
from IPython.core.interactiveshell import InteractiveShell

import aspectgraph
import errors
import ga
import planner
from planner.options import InspectionKeywords
from planner.request.dimension import RequirementInDeg, RequirementInMm

CALLS = [
    (ga.maximize, 21),
    (errors.simulate_success, 9),
    (errors.simulate_measurement, 10),
    (planner.plan_setting, 19),
    (planner.simulate_setting, 9),
]
CONSTRUCTORS = (
    *("length", "distance", "angle", "diameter", "radius", "centre_distance", "centre_to_edge"),
    *("position", "symmetry", "coaxiality"),
)
# what a position needs to be made at all
ENTITIES = {
    "position": {"rim": "r3", "datums": [17], "zone_mm": 0.2},
    "symmetry": {"edges": [17, 18], "datum": [3, 4], "zone_mm": 0.2},
    "coaxiality": {"rim": "r3", "datum": "r1", "zone_mm": 0.2},
}


@pytest.mark.parametrize(("call", "n"), CALLS)
def test_every_keyword_is_shown_and_none_is_taken_unseen(call, n):
    shown = inspect.signature(call).parameters
    assert len(shown) == n
    assert not [p for p in shown.values() if p.kind is p.VAR_KEYWORD]


@pytest.mark.parametrize(("call", "_"), CALLS)
def test_an_unknown_keyword_is_refused_by_name(call, _):
    needed = [n for n, p in inspect.signature(call).parameters.items() if p.default is p.empty]
    # those of the planner look for the one that may be meant, and here there is none
    words = (
        "has no argument"
        if call.__module__.startswith("planner")
        else "got an unexpected keyword argument"
    )
    message = rf"{call.__name__}\(\) {words} 'colour'"
    with pytest.raises(TypeError, match=message):
        call(**dict.fromkeys(needed), colour="red")


@pytest.mark.parametrize(
    ("call", "wrong", "right"),
    [
        (planner.measure, "coverge", "coverage"),
        (planner.Measurer.measure, "operater", "operator"),
        (planner.plan_light, "contrasts", "contrast"),
        (planner.compare_lights, "materiel", "material"),
        (planner.plan_folder, "executer", "executor"),
    ],
)
def test_a_misspelt_keyword_is_answered_with_the_right_one(call, wrong, right):
    assert right in inspect.signature(call).parameters
    message = rf"{call.__name__}\(\) has no argument '{wrong}'; did you mean '{right}'\?"
    with pytest.raises(TypeError, match=message):
        call(**{wrong: 1})


def options_of(call):
    parameters = inspect.signature(call).parameters.values()
    return [item.name for item in parameters if item.default is not item.empty]


# that of `plan_inspection` looks at the arguments first, and has a test of its own
WITH_OPTIONS = {
    name: call
    for name, call in inspect.getmembers(planner, inspect.isfunction)
    if not name.startswith("_") and name != "plan_inspection" and options_of(call)
}


@pytest.mark.parametrize("name", sorted(WITH_OPTIONS))
def test_every_function_with_options_names_the_one_that_is_meant(name):
    """The last one is misspelt: a letter is missing."""
    call = WITH_OPTIONS[name]
    parameters = inspect.signature(call).parameters.values()
    options = options_of(call)
    wrong = options[-1][:-1]
    # all that is needed is there, so that Python does not miss that first
    needed = {item.name: None for item in parameters if item.default is item.empty}
    with pytest.raises(TypeError) as refused:
        call(**needed, **{wrong: 1})
    assert f"did you mean '{options[-1]}'" in str(refused.value)


def test_the_options_of_a_plan_are_one_value_with_defaults():
    (options,) = list(inspect.signature(planner.plan_inspection).parameters.values())[4:5]
    assert (options.name, options.default) == ("options", None)
    assert all(field.default is not MISSING for field in fields(planner.InspectionOptions))


def test_type_checkers_know_the_keywords_of_a_plan():
    """They read the annotation; names and types are those of the record."""
    keywords = planner.plan_inspection.__annotations__["keywords"]
    assert keywords == f"Unpack[{InspectionKeywords.__name__}]"
    # a dataclass keeps its annotations as texts, a TypedDict wraps them
    texts = {field.name: field.type for field in fields(planner.InspectionOptions)}
    stated = InspectionKeywords.__annotations__
    assert {name: kind.__forward_arg__ for name, kind in stated.items()} == texts
    assert not InspectionKeywords.__required_keys__


@pytest.mark.parametrize(
    ("name", "kind"),
    [(name, RequirementInDeg if name == "angle" else RequirementInMm) for name in CONSTRUCTORS],
)
def test_type_checkers_know_the_keywords_of_a_dimension(name, kind):
    """Every keyword that they know is a field of a dimension, and no other is taken."""
    call = getattr(planner.Dimension, name)
    assert call.__func__.__annotations__["requirement"] == f"Unpack[{kind.__name__}]"
    known = {field.name for field in fields(planner.Dimension)}
    units = {f"{word}_{unit}" for word in ("tolerance", "max_error") for unit in ("mm", "deg")}
    assert set(kind.__annotations__) <= known | units
    needed = [n for n, p in inspect.signature(call).parameters.items() if p.default is p.empty]
    values = dict.fromkeys(needed, 1)
    with pytest.raises(planner.RequestError, match="must be one of") as refused:
        call(**{**values, **ENTITIES.get(name, {})}, colour="red")
    words = str(refused.value).partition("one of ")[2].partition(". Got")[0]
    assert set(words.split(", ")) == set(kind.__annotations__)


@pytest.mark.parametrize(
    ("call", "name", "words"),
    [
        (planner.plan_light, "ground", {"dark", "bright"}),
        (planner.Lighting, "ground", {"dark", "bright"}),
        (planner.InspectionOptions, "split", {"auto", "never"}),
        (planner.Requirements, "field_of_view", {"exact", "cone"}),
        (planner.plan_setting, "field_of_view", {"exact", "cone"}),
        (planner.plan_setting, "objective", {"sum", "min"}),
        (planner.plan_setting, "model", {"joint", "independent", "montecarlo"}),
        (planner.Search, "selection", {"roulette", "sus"}),
        (planner.Search, "scaling", {"proportional", "window", "rank"}),
        (planner.Search, "sampling", {"covering", "workspace"}),
        (planner.Effort.named, "name", {"quick", "standard", "thorough"}),
        (planner.program_text, "format", {"urscript", "rapid", "krl", "fanuc", "ros", "csv", "json"}),
        (planner.write_program, "format", {"urscript", "rapid", "krl", "fanuc", "ros", "csv", "json"}),
        (aspectgraph.plot_section, "axis", {"x", "y", "z"}),
        (errors.success_probability, "model", {"joint", "independent", "montecarlo"}),
        (errors.SuccessModel, "model", {"joint", "independent", "montecarlo"}),
        (errors.simulate_success, "quantization", {"uniform", "grid", "none"}),
        (errors.measure_lengths, "detector", {"axes", "area"}),
        (errors.simulate_measurement, "detector", {"axes", "area"}),
        (ga.maximize, "selection", {"roulette", "sus"}),
        (ga.maximize, "scaling", {"proportional", "window", "rank"}),
    ],
)  # fmt: skip
def test_type_checkers_know_the_words_of_an_argument(call, name, words):
    # help shows those of records in words of its own
    stated = getattr(call, "__func__", call)
    text = stated.__annotations__.get(name) or stated.__init__.__annotations__[name]
    kind = eval(text, vars(sys.modules[call.__module__]))
    # one of them may be left out
    choices = next((arg for arg in (kind, *get_args(kind)) if get_origin(arg) is Literal), None)
    assert set(get_args(choices)) == words


@pytest.mark.parametrize(
    ("begun", "keywords"),
    [
        ("plan_inspection(solid, {}, acc", {"accuracy="}),
        ("planner.plan_inspection(time", {"time_limit_s="}),
        ("Dimension.diameter('r1', tol", {"tolerance=", "tolerance_mm=", "tolerance_class="}),
        ("Dimension.angle(1, 2, tol", {"tolerance_deg=", "tolerance_class="}),
        ("measure(plan, solid, 'images', cov", {"coverage="}),
    ],
)
def test_a_notebook_completes_keywords(begun, keywords):
    """As the kernel of Jupyter does: by the completer of IPython, which works in one of its shells."""
    shell = InteractiveShell.instance()
    shell.run_cell("import planner\nfrom planner import Dimension, measure, plan_inspection")
    with provisionalcompleter():
        offered = list(shell.Completer.completions(begun, len(begun)))
    # besides commands of the shell itself
    assert {item.text for item in offered if item.text.endswith("=")} == keywords


def test_help_lists_keywords_with_their_defaults():
    shown = inspect.signature(planner.plan_inspection).parameters
    for item in fields(planner.InspectionOptions):
        assert shown[item.name].default == item.default
        assert shown[item.name].kind is inspect.Parameter.KEYWORD_ONLY
    assert inspect.signature(planner.Dimension.angle).parameters["tolerance_deg"].default is None


def test_every_option_of_a_plan_reaches_it(monkeypatch):
    """Each keyword becomes the field of its name."""
    seen = []
    monkeypatch.setattr("planner.inspection.resolve_request", lambda *given: seen.append(given))
    monkeypatch.setattr(
        "planner.inspection.plan_request", lambda *given, **named: seen.append(given)
    )
    monkeypatch.setattr("planner.inspection.foreseen_in_time", lambda plan, *_: (plan, []))
    # what is passed on is no part, no camera and no limit
    monkeypatch.setattr("planner.inspection.check_kinds", lambda **given: None)
    never = SimpleNamespace(at=lambda share: None)
    monkeypatch.setattr("planner.inspection.Deadline", lambda *given: never)
    monkeypatch.setattr("planner.options.check_kinds", lambda **given: None)
    monkeypatch.setattr("planner.options.RunOptions.__post_init__", lambda options: None)
    monkeypatch.setattr(planner.InspectionOptions, "lighting", None)
    values = {field.name: object() for field in fields(planner.InspectionOptions)}
    planner.plan_inspection(1, 2, 3, 4, **values)
    planner.plan_inspection(1, 2, 3, 4, planner.InspectionOptions(**values))
    for *others, options in (seen[0], seen[2]):
        assert others == [1, 2, 3, 4]
        assert {name: getattr(options, name) for name in values} == values
    assert seen[1] == (1, None, seen[0][-1])


def test_measure_takes_each_option_of_a_measurer_with_its_default():
    """By keyword; None stands for a default that is made anew."""
    shown = dict(inspect.signature(planner.measure).parameters)
    by_method = dict(inspect.signature(planner.Measurer.measure).parameters)
    defaults = planner.MeasureOptions()
    for field in fields(planner.MeasureOptions):
        default = getattr(defaults, field.name)
        assert shown[field.name].default is (None if field.default is MISSING else default)
    named = [name for name, p in by_method.items() if p.kind is p.KEYWORD_ONLY]
    assert {"serial", "operator", "partial", "allow_lossy"} < set(named)
    assert [shown[name] for name in named] == [by_method[name] for name in named]
    assert by_method["options"].default is None


def test_every_option_of_measure_reaches_the_measurer(monkeypatch):
    seen = []

    class Recorder:
        def __init__(self, *given):
            seen.append(given)

        def measure(self, *given, **named):
            seen.append((given, named))

    monkeypatch.setattr("planner.measuring.measurer.Measurer", Recorder)
    options = {
        "registration": planner.Registration.none(0.1),
        "localisation": planner.Localisation.gaussian(),
        "coverage": 0.7,
        "rule": planner.DecisionRule.simple(),
        "white_level": 4095,
        "response": "srgb",
        "edge_break_mm": (0.1, 0.3),
        "repeatability": planner.PoseUncertainty.isotropic(translation_mm=1, rotation_rad=0.1),
    }
    run = {"serial": "A1", "operator": "A. Meyer", "partial": True, "allow_lossy": True}
    planner.measure(1, 2, "images", **options, **run)
    planner.measure(1, 2, "images")
    assert seen[0] == (1, 2)
    (images, made), named = seen[1]
    assert images == "images"
    assert {field.name for field in fields(made)} == set(options)
    assert {name: getattr(made, name) for name in options} == options
    assert named == {**run, "progress": None}
    (_, usual), _ = seen[3]
    assert usual.registration.method == "own edges"
    default = planner.MeasureOptions()
    assert replace(usual, registration=default.registration) == default


def test_the_options_of_a_measurer_are_of_their_kind():
    with pytest.raises(planner.RequestError, match=r"repeatability must be a PoseUncertainty"):
        planner.MeasureOptions(repeatability=0.02)


@pytest.mark.parametrize("call", [planner.predict, planner.propose_optics])
def test_options_that_a_call_takes_as_one_value_are_public(call):
    """A user must be able to make them: by their public name, which is documented like the others."""
    assert "InspectionOptions" in inspect.signature(call).parameters["options"].annotation
    assert "InspectionOptions" in planner.__all__
