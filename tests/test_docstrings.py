"""Docstrings of what the packages export: complete by numpydoc's rules, their examples right."""

import ast
import builtins
import doctest
import inspect
import re
import textwrap
from dataclasses import is_dataclass
from enum import Enum
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import FunctionType

import pytest
from numpydoc.docscrape import get_doc_object
from numpydoc.validate import Validator, validate

import aspectgraph
import errors
import ga
import planner

ROOT = Path(__file__).parents[1]
PACKAGES = (aspectgraph, errors, ga, planner)

# Summary missing (GL08, SS01); parameters missing, unknown, in another order, without type or description (PR01-PR04,
# PR07); Returns or Yields missing or without description (RT01, RT03, YD01).
CHECKS = {"GL08", "SS01", "PR01", "PR02", "PR03", "PR04", "PR07", "RT01", "RT03", "YD01"}

# what calls return and nobody makes by hand, and what the example of another name shows
RESULTS = {
    "Arc", "Cell", "CellSet", "Circle", "Crossing", "Edge", "EdgeEnd", "Entity",
    "EntityAspectGraph", "Exposure", "Face", "GraphDrawing", "JointEstimate", "LightGraph", "LightRegions",
    "ListOfEntities", "ModelDimension", "PartitionSurface", "Rim", "SectionDrawing",
    "VisibilityRegions", "AxisDisplacement", "DisplacementTerms", "MonteCarloEstimate",
    "SegmentDisplacement", "SegmentError", "GAResult", "Generation", "History", "Cover",
    "LitImage", "OpticsProposal", "PartResult", "PlannedDimension",
    "Decision", "PosePrediction", "ReachedPlan", "Reading", "ReasonKind",
    "SimulationResult", "SuccessRate",
}  # fmt: skip


def dotted(thing):
    return f"{thing.__module__}.{thing.__qualname__}"


def public_members(cls):
    """Public methods and properties, by name, that a class of ours defines or inherits from one of ours."""
    own = [
        base
        for base in cls.__mro__
        if base.__module__.split(".")[0] in {p.__name__ for p in PACKAGES}
    ]
    members = {
        name: value
        for base in reversed(own)
        for name, value in vars(base).items()
        if not name.startswith("_")
    }
    kinds = (FunctionType, property, cached_property, classmethod, staticmethod)
    return {name: value for name, value in members.items() if isinstance(value, kinds)}


def documented():
    for package in PACKAGES:
        for name in package.__all__:
            thing = getattr(package, name)
            yield dotted(thing), thing
            if inspect.isclass(thing):
                yield from (
                    (f"{dotted(thing)}.{name}", member)
                    for name, member in public_members(thing).items()
                )


THINGS = dict(documented())


def exported():
    """Calls and classes that the packages export, exceptions left out, by name."""
    named = {name: getattr(package, name) for package in PACKAGES for name in package.__all__}
    return {
        name: thing
        for name, thing in named.items()
        if callable(thing) and not (inspect.isclass(thing) and issubclass(thing, Exception))
    }


def has_example(thing):
    return ">>>" in (inspect.getdoc(thing) or "")


EXAMPLES = [
    *(thing for thing in exported().values() if has_example(thing)),
    *(
        member
        for thing in exported().values()
        if inspect.isclass(thing)
        for member in public_members(thing).values()
        if has_example(member)
    ),
]


def undocumented(cls):
    """Parameters of a class that stand neither under Parameters nor, with type and description, under Attributes."""
    doc = Validator(get_doc_object(cls))
    fields = {
        one.strip()
        for names, kind, text in doc.doc["Attributes"]
        if kind and text
        for one in names.split(",")
    }
    return set(doc.signature_parameters) - set(doc.doc_all_parameters) - fields


def raised(thing):
    """Names of the exceptions that a function raises in its own body, or a class in making an instance."""
    if inspect.isclass(thing):
        # the __init__ of a dataclass has no source
        names = ("__post_init__",) if is_dataclass(thing) else ("__init__",)
        makers = [vars(thing).get(name) for name in names]
        return set().union(*(raised(maker) for maker in makers if maker is not None))
    tree = ast.parse(textwrap.dedent(inspect.getsource(thing)))
    calls = [
        node.exc
        for node in ast.walk(tree)
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)
    ]
    # `ReadError(...)`, or `ReadError.of_rule(...)`; a function that makes the error has another name
    makers = [
        call.func.value
        if isinstance(call.func, ast.Attribute) and call.func.attr == "of_rule"
        else call.func
        for call in calls
    ]
    names = {maker.id for maker in makers if isinstance(maker, ast.Name)}
    return {name for name in names if name[0].isupper()}


def kinds_of(error, function):
    """Names of an exception's classes, up to the builtin ones."""
    found = vars(builtins).get(error) or vars(import_module(function.__module__))[error]
    return {base.__name__ for base in found.__mro__}


def test_every_kind_of_name_is_checked():
    assert len(THINGS) > 200
    assert {"aspectgraph.solid.solid.Solid.triangles", "errors.segment.SegmentError.pdf"} <= set(
        THINGS
    )
    assert {"planner.camera.camera.Camera.named", "ga.run.History.best_so_far"} <= set(THINGS)


@pytest.mark.parametrize("name", THINGS)
def test_complete(name, monkeypatch):
    function = getattr(THINGS[name], "__func__", THINGS[name])
    if inspect.isfunction(function) and function.__code__.co_flags & inspect.CO_VARKEYWORDS:
        # documented as it is written: completion lists one by one what the stars stand for
        monkeypatch.delattr(function, "__signature__", raising=False)
    found = [(code, text) for code, text in validate(name)["errors"] if code in CHECKS]
    thing = THINGS[name]
    if inspect.isclass(thing) and (issubclass(thing, Enum) or not undocumented(thing)):
        # fields of a record are documented under Attributes, and members are the values of an enum
        found = [(code, text) for code, text in found if code != "PR01"]
    assert not found


@pytest.mark.parametrize("name", THINGS)
def test_errors_are_named(name):
    """What a call raises in its own body stands under Raises, itself or a class it belongs to."""
    thing = THINGS[name]
    thing = (
        getattr(thing, "fget", None)
        or getattr(thing, "func", None)
        or getattr(thing, "__func__", thing)
    )
    section = get_doc_object(thing)["Raises"]
    named = {one.strip() for entry in section for one in (entry.type or entry.name).split(",")}
    assert not [error for error in raised(thing) if not named & kinds_of(error, thing)]


def test_headings_stand_on_lines_of_their_own():
    """A heading that was filled into its paragraph is none, and what stands under it is lost."""
    heading = re.compile(r"\b(Attributes|Examples|Notes|Parameters|Raises|Returns|Yields) -{3,}")
    files = [path for package in PACKAGES for path in Path(package.__path__[0]).rglob("*.py")]
    assert len(files) > 180
    assert [str(path) for path in files if heading.search(path.read_text())] == []


def test_what_a_user_calls_has_an_example():
    without = {name for name, thing in exported().items() if not has_example(thing)}
    assert without - RESULTS == set()


@pytest.mark.parametrize("thing", EXAMPLES, ids=dotted)
def test_examples(thing, monkeypatch):
    """They run from the root of the repository, each on its own."""
    monkeypatch.chdir(ROOT)
    (found,) = doctest.DocTestFinder(recurse=False).find(thing, dotted(thing), globs={})
    assert found.examples
    assert doctest.DocTestRunner().run(found).failed == 0
