"""What a notebook shows of a result: one short line with numbers that are true."""

import copy
import inspect
import pickle
import re
from collections import defaultdict
from dataclasses import is_dataclass, replace
from itertools import product

import numpy as np
import pytest
from measured_plate import POSES, fine_plate, measured_plan, photograph, thick_plate
from plan_examples import BRIEF, LIGHT

import aspectgraph
import errors
import ga
import planner
from aspectgraph import (
    Solid,
    build_aspect_graph,
    domain_path,
    plot_graph,
    plot_section,
    read_solid,
    stability,
)
from errors import simulate_success
from ga import maximize
from ground.short_repr import LONGEST, short_repr
from planner import (
    Box,
    Camera,
    Dimension,
    Effort,
    Fixturing,
    InspectionOptions,
    MeasureOptions,
    Measurer,
    PoseUncertainty,
    Registration,
    Rehearsal,
    plan_inspection,
    plan_setting,
    predict,
    read_plan,
)
from planner.measuring.rehearsal import Rendered

FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
BOX = Solid(list(product((0, 40), (0, 30), (0, 20))), FACES, name="box")
CAMERA = Camera.named("basler-acA2440-20gm-8mm")
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)


@pytest.fixture(scope="module")
def eag():
    return build_aspect_graph(BOX, {"top": 1, "side": 2}, [[-400, -400, -400], [440, 430, 420]])


@pytest.fixture(scope="module")
def plan(eag, stated_in_full):
    return plan_inspection(
        BOX, {"top": 1, "side": 2}, CAMERA, UNCERTAINTY, accuracy=0.95, space=eag, effort=BRIEF
    )


def ones(bits):
    return bits.sum(axis=1)


def test_graph_and_regions(eag):
    assert repr(eag) == "<EntityAspectGraph of 'box': 2 entities, 4 domains, 5 adjacencies>"
    assert (len(eag.graph), eag.graph.number_of_edges()) == (4, 5)
    assert (
        repr(eag.regions)
        == "<VisibilityRegions of 'box': 2 entities, vertices snapped by at most 0 mm>"
    )
    assert eag.regions.grid.snapping_mm == 0


def test_cells_and_domains(eag):
    cells = eag.covering_cells(["top", "side"])
    assert repr(cells) == f"<CellSet: {len(cells)} cells, {cells.volume:.4g} mm³>"
    assert repr(cells[0]) == f"<Cell: 6 half-spaces, {cells[0].volume:.4g} mm³>"
    domain = eag._domains.domains[0]
    assert repr(domain).startswith(f"<Domain: {len(eag.cells(0))} cells, ")


def test_drawings(eag):
    pytest.importorskip("matplotlib").use("agg")
    assert repr(plot_graph(eag)) == "<GraphDrawing: 4 nodes, 5 edges>"
    assert repr(plot_section(eag)) == "<SectionDrawing: 3 domains in the window>"


def test_camera():
    text = "<Camera 'basler-acA2440-20gm-8mm': 8 mm, 2448 × 2048 px, f/8, focus at 300 mm>"
    assert repr(CAMERA) == text
    off = replace(CAMERA, name="", principal_point_px=(1200.0, 1000.0), f_number=5.6)
    assert repr(off) == "<Camera: 8 mm, 2448 × 2048 px, f/5.6, focus at 300 mm, calibrated>"


def test_rendered_images():
    made = read_plan("examples/two_pocket_block_plan.json")
    rehearsal = Rehearsal(made, read_solid("examples/two_pocket_block.off"), seed=3)
    truth = rehearsal.truth
    assert repr(truth) == "<Truth of 'two_pocket_block': 1 image, surfaces 0 mm, seed 3>"
    assert repr(replace(truth, part="")) == "<Truth: 1 image, surfaces 0 mm, seed 3>"
    image = Rendered(rehearsal._shots[0], np.zeros((3, 4), np.uint8), np.eye(4))
    assert repr(image) == "<Rendered 'setting_01': 4 × 3 px, uint8>"


def test_run_of_the_genetic_algorithm():
    shown = []
    result = maximize(
        ones,
        8,
        population=10,
        max_generations=3,
        epsilon=0,
        callback=lambda g: shown.append(repr(g)),
    )
    best = result.fun
    nfev = result.nfev
    assert (
        repr(result)
        == f"<GAResult: best fitness {best:g} after 3 generations, {nfev} evaluations, max_generations>"
    )
    assert repr(result.history) == f"<History: 3 generations, best fitness {best:g}>"
    assert shown[0].startswith("<Generation 0: best fitness ")
    assert shown[0].endswith(", 10 evaluations>")
    assert len(shown) == 4


def test_estimate():
    request = {
        "focal_length_mm": 25.0,
        "pixel_pitch_mm": (0.01, 0.01),
        "pose_covariance": np.eye(6) * 1e-12,
    }
    edge = [[-25, 0, -575], [25, 0, -575]]
    one = simulate_success(edge, accuracy=0.9, samples=100, **request)
    assert (
        repr(one)
        == "<MonteCarloEstimate: 100 of 100, in 0.9637 or more, confidence 0.95, 100 samples>"
    )
    many = simulate_success([edge, edge], accuracy=0.9, samples=100, **request)
    assert repr(many) == "<MonteCarloEstimate: shape (2,), confidence 0.95, 100 samples>"


def test_setting(eag):
    setting = plan_setting(eag, ["top", "side"], CAMERA, UNCERTAINTY, accuracy=0.95)
    x, y, z = setting.position
    place = f"({x:.1f}, {y:.1f}, {z:.1f}) mm"
    worst = min(setting.probability.values())
    assert worst > 0.9999
    assert (
        repr(setting) == f"<SensorSetting: 2 targets from {place}, smallest probability > 0.9999>"
    )


def test_plan_and_simulation(plan):
    worst = min(plan.inspected.values())
    found = "1 setting (at least 1 needed), 2 of 2 entities inspected"
    # a bound with 99.9 % confidence, after 20,000 of 20,000 displaced poses
    assert worst == pytest.approx(0.001 ** (1 / 20_000), rel=1e-9)
    assert repr(plan) == f"<InspectionPlan of 'box': {found}, smallest probability 0.9996>"
    simulation = plan.simulate(1000)
    assert repr(simulation) == "<SimulationResult: 1 setting, 1000 poses each: 2 confirmed>"


def test_plan_without_settings(plan):
    reasons = {"top": "no view", "side": "no view"}
    nothing = replace(plan, settings=(), lower_bound=0, uninspectable=reasons)
    assert (
        repr(nothing)
        == "<InspectionPlan of 'box': 0 settings (at least 0 needed), 0 of 2 entities inspected>"
    )
    assert (
        repr(nothing.simulate(10))
        == "<SimulationResult: 0 settings, 10 poses each: nothing to check>"
    )


def test_equality_and_pickling_are_as_before(plan):
    for result in (plan, plan.settings[0], plan.simulate(100)):
        assert pickle.loads(pickle.dumps(result)) == copy.copy(result) == result
        assert "\n" not in repr(result)


PACKAGES = (aspectgraph, errors, ga, planner)
# what may be long: a record with one of these among its fields gives its text itself
MAY_BE_LONG = re.compile(r"Array|ndarray|Mapping|dict|list|Sequence|Iterable|\.\.\.|Any|Callable")


def public_classes():
    things = [getattr(package, name) for package in PACKAGES for name in package.__all__]
    return {c for c in things if inspect.isclass(c) and not issubclass(c, Exception)}


def is_generated(cls):
    """Whether a dataclass or a named tuple shows all its fields in full."""
    if is_dataclass(cls):
        return hasattr(cls.__repr__, "__wrapped__")
    return hasattr(cls, "_fields") and cls.__repr__.__module__ != cls.__module__


def test_a_record_that_may_be_long_has_a_text_of_its_own():
    full = [cls for cls in public_classes() if cls.__repr__ is not short_repr and is_generated(cls)]
    assert planner.Detectability in full
    long = {
        cls.__name__: kind
        for cls in full
        for base in cls.__mro__
        for kind in map(str, vars(base).get("__annotations__", {}).values())
        if MAY_BE_LONG.search(kind) and "ClassVar" not in kind
    }
    # its words are checked: a camera has at most one name
    assert long == {}


def parts_of(value):
    """What a value holds: items of containers, else fields and properties."""
    if isinstance(value, dict):
        return list(value.values())[:3]
    if isinstance(value, list | tuple) and not hasattr(value, "_fields"):
        return list(value)[:3]
    names = {name for name, kind in inspect.getmembers(type(value)) if isinstance(kind, property)}
    names |= {*getattr(value, "__dict__", {}), *getattr(value, "_fields", ())}
    return [getattr(value, name) for name in sorted(names) if not name.startswith("_")]


def instances(*values):
    """All values of public classes in some values, each class up to three times."""
    shown = defaultdict(list)
    # by identity; kept, so that no other value gets the same
    seen = {}
    waiting = list(values)
    while waiting:
        value = waiting.pop()
        cls = type(value)
        is_ours = cls.__module__.split(".")[0] in {package.__name__ for package in PACKAGES}
        if id(value) in seen or not (is_ours or isinstance(value, dict | list | tuple)):
            continue
        seen[id(value)] = value
        if is_ours:
            shown[cls].append(value)
            if len(shown[cls]) > 3:
                continue
        waiting += parts_of(value)
    return {cls: shown[cls] for cls in shown.keys() & public_classes()}


def test_every_value_is_one_short_line(eag, plan):
    solid = thick_plate()
    exact = Registration.given({1: POSES[0]})
    images = photograph(fine_plate(left=0.05), POSES[:1])
    measurer = Measurer(measured_plan(solid, ["left", "right"]), solid)
    results = measurer.measure(images, MeasureOptions(exact), partial=True)
    table = Box([0, 0, 0], [9, 9, 1])
    values = [
        [eag, *eag.graph.nodes.values(), *eag.graph.edges.values()],
        [stability(eag), domain_path(eag, 0, 3)],
        [list(solid.rims()), list(solid.faces), list(solid.edges)],
        [replace(plan, light=LIGHT).simulated(100)],
        [measurer, results, MeasureOptions(exact)],
        [Effort.named("thorough"), InspectionOptions(effort=BRIEF)],
        predict(BOX, {"top": 1}, plan.settings[0].cam2world, CAMERA, UNCERTAINTY),
        [Dimension("diameter", ("r0",), tolerance=(-0.1, 0.1))],
        [table, Fixturing(np.eye(4), {"table": table})],
    ]
    shown = instances(*values)
    names = {cls.__name__ for cls in shown}
    assert len(names) > 35
    assert {"MeasurementResults", "Result", "Reading", "InspectionPlan", "Effort", "Rim"} <= names
    texts = {repr(value) for values in shown.values() for value in values}
    assert {text for text in texts if "\n" in text or len(text) > 300} == set()
    ours = [v for values in shown.values() for v in values if type(v).__repr__ is short_repr]
    assert {repr(value) for value in ours if len(repr(value)) > LONGEST} == set()
    left = results["left"]
    value = f"{left.value:.3f} ± {left.expanded_uncertainty:.3f} mm"
    assert repr(left) == f"<Result 'left': {value}, {left.decision.value}>"
    assert repr(left.readings[0]).startswith("<Reading of 'left' in 'setting_01': 16.")
    assert repr(UNCERTAINTY) == "<PoseUncertainty: 0.05, 0.05, 0.05 mm, 0.001, 0.001, 0.001 rad>"


def test_a_printed_part_says_what_can_be_measured_of_it():
    """Its edges are those of the model, as `info` lists them, and not those of its facets."""
    assert str(BOX) == "box: 40 x 30 x 20 mm, 12 straight edges"
    part = read_solid("examples/nist_ctc_01_ap242.stp")
    counts = {kind: int(n) for n, kind in re.findall(r"(\d+) (straight edge|rim|arc)s?", str(part))}
    assert counts == {
        "straight edge": len(part.straight_edges()),
        "rim": len(part.rims()),
        "arc": len(part.arcs()),
    }
    assert len(part.edges) > sum(counts.values())
