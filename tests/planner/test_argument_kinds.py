"""Numbers out of their range, or no numbers at all, are refused by name."""

import math
from fractions import Fraction

import numpy as np
import pytest

from aspectgraph import ModelDimension, ModelRequirements, Solid, read_solid, richest_domains
from aspectgraph.exceptions import AspectGraphError
from planner import (
    Camera,
    Detectability,
    Dimension,
    InspectionOptions,
    LampBox,
    LampDome,
    Lighting,
    MeasureOptions,
    PoseUncertainty,
    Registration,
    RequestError,
    SphereRegion,
    dimensions_to_plan,
    measure,
    plan_figure,
    plan_inspection,
    predict,
    propose_optics,
    read_plan,
    write_poses,
)
from planner.argument_kinds import (
    ABOVE_0_TO_1,
    FROM_0_BELOW_1,
    NOT_NEGATIVE,
    check_number,
    kind_shown,
    shown,
)
from planner.callbacks import Deadline
from planner.exceptions import PlannerError
from planner.measuring.results import MeasurementResults
from planner.request.models import Means
from planner.request.problem import Objective

CAMERA = Camera.named("basler-acA2440-20gm-8mm")
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.001)
NO_NUMBERS = (True, np.True_, "0.5", None, math.nan, math.inf, -math.inf, 1j, [0.5], 10**400)


@pytest.mark.parametrize("value", NO_NUMBERS)
def test_what_is_no_finite_number_is_refused(value):
    with pytest.raises(
        RequestError, match=r"^width must be finite and not negative\. Got "
    ) as info:
        check_number("width", value, NOT_NEGATIVE)
    assert info.value.parameter == "width"


@pytest.mark.parametrize("value", [1, 0.5, np.float32(0.5), np.int64(1), Fraction(1, 2)])
def test_numbers_of_all_kinds_are_numbers(value):
    number = check_number("width", value, NOT_NEGATIVE)
    assert type(number) is float
    assert number == value


def test_the_ends_of_a_range_belong_to_it_or_not():
    assert [FROM_0_BELOW_1.accepts(end) for end in (0, 1)] == [True, False]
    assert [ABOVE_0_TO_1.accepts(end) for end in (0, 1)] == [False, True]


@pytest.mark.parametrize(
    ("make", "parameter"),
    [
        (lambda value: Deadline(value), "time_limit_s"),
        (lambda value: Deadline(gap=value), "gap"),
        (lambda value: Detectability(surround_px=value), "surround_px"),
        (lambda value: Dimension.diameter("r0", max_error_mm=value), "max_error_mm"),
        (lambda value: Dimension.diameter("r0", accuracy=value), "accuracy"),
        (lambda value: Dimension.diameter("r0", share=value), "share"),
        (lambda value: LampBox((0, 0, 0), (1, 1, 1), clearance_mm=value), "clearance_mm"),
        (lambda value: LampDome((0, 0, 0), 9.0, clearance_mm=value), "clearance_mm"),
        (lambda value: Lighting("ring", tolerance_mm=value), "tolerance_mm"),
        (lambda value: Lighting("ring", step=value), "step"),
        (lambda value: SphereRegion((0, 0, 0), value), "radius_mm"),
        (lambda value: Objective([], Means(CAMERA, UNCERTAINTY, value)), "accuracy"),
    ],
)
@pytest.mark.parametrize("value", ["0.5", -1.0, math.nan, True])
def test_every_record_refuses_what_is_no_number_by_its_name(make, parameter, value):
    with pytest.raises(RequestError) as info:
        make(value)
    assert info.value.parameter == parameter
    assert info.value.got == repr(value)


def test_an_effort_by_its_name_is_refused_with_what_makes_one():
    with pytest.raises(RequestError) as info:
        InspectionOptions(effort="quick")
    told = "effort must be an Effort. Got 'quick'. Effort.named makes one."
    assert str(info.value) == told


@pytest.mark.parametrize(
    ("order", "told"),
    [
        ((1, 0), "plan must be an InspectionPlan. Got a Solid; the order of the arguments"),
        ((2, 1), "plan must be an InspectionPlan. Got 'plan.json'; read_plan reads one"),
        ((0, 2), "solid must be a Solid. Got 'plan.json'; read_solid reads one"),
    ],
)
def test_measuring_names_the_argument_of_the_wrong_kind(order, told):
    given = (
        read_plan("examples/two_pocket_block_plan.json"),
        Solid.read("examples/two_pocket_block.off"),
        "plan.json",
    )
    plan, solid = (given[k] for k in order)
    with pytest.raises(RequestError) as info:
        measure(plan, solid, "images")
    assert str(info.value).startswith(told)


def block():
    return read_solid("examples/two_pocket_block.off")


def example():
    return read_plan("examples/two_pocket_block_plan.json")


def planned(*options, **keywords):
    return plan_inspection(block(), [1], CAMERA, UNCERTAINTY, *options, **keywords)


WRONG_CALLS = {
    "localisation": lambda: planned(localisation="gaussian:0.1"),
    "options": lambda: planned({"accuracy": 0.9}),
    "executor": lambda: planned(executor=2),
    "space": lambda: planned(space="x"),
    "on_incumbent": lambda: planned(on_incumbent=5),
    "progress": lambda: planned(progress="yes"),
    "registration": lambda: planned(registration="edges"),
    "material": lambda: Lighting("ring", material="metal"),
    "surfaces_mm": lambda: Registration.own_edges("x"),
    "rng": lambda: example().simulate(10, rng="x"),
    "plan": lambda: plan_figure(block(), example()),
    "eag": lambda: richest_domains(5),
    "folder": lambda: write_poses(example(), 5),
    "path": lambda: example().to_csv(5),
    "kind": lambda: Dimension("dist", (1, 2)),
    "tolerance_mm": lambda: Dimension.distance(25, 27, tolerance_mm="±0.1"),
    "changes": lambda: Camera.named("basler-acA2440-20gm-8mm", focus=400),
    "pixel_pitch_mm": lambda: Camera(25.0, 3.45e-6, (2448, 2048), 8.0, 600.0),
}


@pytest.mark.parametrize("parameter", WRONG_CALLS)
def test_a_wrong_call_names_its_parameter_in_one_line(parameter):
    with pytest.raises((PlannerError, AspectGraphError)) as info:
        WRONG_CALLS[parameter]()
    assert info.value.parameter == parameter
    assert "\n" not in str(info.value)


@pytest.mark.parametrize(
    "call",
    [
        lambda solid: solid.straight_edges("5"),
        lambda solid: solid.straight_edges(min_length_mm=math.nan),
        lambda solid: solid.straight_edges(min_length_mm=-1),
        lambda solid: solid.rims("x"),
        lambda solid: solid.arcs("x"),
    ],
)
def test_a_limit_of_edges_is_a_number(call):
    with pytest.raises(AspectGraphError, match=r"must be a finite number from 0\. Got "):
        call(block())


@pytest.mark.parametrize(
    "call",
    [
        lambda: Camera.read(3),
        lambda: CAMERA.write(3),
        lambda: MeasurementResults.write_csv(object(), None),
    ],
)
def test_what_is_no_path_is_refused(call):
    with pytest.raises(PlannerError, match=r"^path must be a path\. Got "):
        call()


@pytest.mark.parametrize(
    "call",
    [
        lambda options: predict(
            block(), {"rim": 1}, np.eye(4), CAMERA, UNCERTAINTY, options=options
        ),
        lambda options: propose_optics(block(), {"rim": 1}, UNCERTAINTY, options=options),
    ],
)
def test_options_are_one_value_everywhere(call):
    with pytest.raises(RequestError, match=r"^options must be an InspectionOptions\. Got a dict\."):
        call({"accuracy": 0.9})


def test_hints_fit_the_call():
    with pytest.raises(RequestError, match="the order of the arguments is plan, solid"):
        plan_figure(block(), example())
    with pytest.raises(PlannerError, match=r"3\.45e-06 m are 0\.00345\. Got 3\.45e-06\.$"):
        Camera(25.0, 3.45e-6, (2448, 2048), 8.0, 600.0)
    with pytest.raises(PlannerError, match="did you mean focus_distance_mm"):
        Camera.named("basler-acA2440-20gm-8mm", focus=400)
    with pytest.raises(RequestError, match=r"Got 'edges'\.$"):
        planned(registration="edges")
    with pytest.raises(RequestError, match="Got 2 for an angle"):
        Dimension("angle", (25, 26), places=2)
    # where no image is there, none can be measured
    with pytest.raises(RequestError, match=r"Got no setting_01\.$"):
        measure(example(), block(), {})


OF_MODEL = "write wanted, left_out = dimensions_to_plan(stated) and pass wanted."
RECORD = ModelDimension("bore", "diameter", 8.0, (-0.1, 0.1), ("r0",), None, features=((("r0",),),))


@pytest.mark.parametrize(
    ("entities", "text"),
    [
        (dimensions_to_plan([RECORD]), f"Got a tuple with a dict; {OF_MODEL}"),
        (list(dimensions_to_plan([RECORD])), f"Got a list with a dict; {OF_MODEL}"),
        ([RECORD], f"Got a list with a ModelDimension; {OF_MODEL}"),
        (ModelRequirements((RECORD,)), f"Got a ModelRequirements; {OF_MODEL}"),
    ],
)
def test_dimensions_of_a_model_are_refused_with_how_they_become_a_request(entities, text):
    with pytest.raises(RequestError) as info:
        plan_inspection(block(), entities, CAMERA, UNCERTAINTY)
    assert info.value.parameter == "entities"
    assert str(info.value).startswith("entities must be ")
    assert str(info.value).endswith(text)
    for call in (
        lambda: predict(block(), entities, np.eye(4), CAMERA, UNCERTAINTY),
        lambda: propose_optics(block(), entities, UNCERTAINTY),
    ):
        with pytest.raises(RequestError) as info:
            call()
        assert str(info.value).startswith("wanted must be a mapping. Got a ")
        assert str(info.value).endswith(OF_MODEL)


@pytest.mark.parametrize(
    ("call", "got"),
    [
        (lambda: PoseUncertainty.isotropic(0.001, 50), "0.001 and 50 without a name"),
        (lambda: PoseUncertainty.isotropic(0.05, rotation_rad=0.001), "0.05 without a name"),
        (lambda: PoseUncertainty.isotropic(translation_mm=0.05), "translation_mm"),
        (lambda: PoseUncertainty.isotropic(mm=0.05, rotation_rad=0.001), "mm, rotation_rad"),
        (lambda: PoseUncertainty.isotropic(), "no argument"),
    ],
)
def test_an_uncertainty_without_its_names_is_refused_with_names_and_units(call, got):
    with pytest.raises(TypeError) as info:
        call()
    assert str(info.value) == (
        "PoseUncertainty.isotropic() takes translation_mm in mm and rotation_rad in rad, each by "
        f"its name. Got {got}; write PoseUncertainty.isotropic(translation_mm=0.05, "
        "rotation_rad=0.001)."
    )


def test_pairs_of_a_name_and_a_dimension_are_refused_with_how_to_name_them():
    pairs = list(dimensions_to_plan([RECORD])[0].items())
    with pytest.raises(
        RequestError, match=r"name each dimension\. Got a list with .*Dimension"
    ) as info:
        plan_inspection(block(), pairs, CAMERA, UNCERTAINTY)
    assert str(info.value).endswith('; write {"name": Dimension(...)}.')


def test_a_shortened_text_keeps_its_closing_quote():
    for text in (kind_shown("x" * 90), shown("x" * 90)):
        assert text.startswith("'x")
        assert text.endswith("...'")
    assert len(kind_shown("x" * 90)) == 40
    assert not shown(list(range(90))).endswith("'")


@pytest.mark.parametrize("coverage", ["80 %", "a", None, [0.8], True, 0, 1.2])
def test_a_coverage_is_a_share(coverage):
    for call in (
        lambda: measure(example(), block(), {}, coverage=coverage),
        lambda: MeasureOptions(Registration.none(), coverage=coverage),
    ):
        with pytest.raises(RequestError) as info:
            call()
        assert str(info.value) == f"coverage must be in (0, 1]. Got {coverage!r}."


def test_an_array_is_shown_in_one_line():
    assert shown(np.eye(2)) == "array([[1., 0.], [0., 1.]])"


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (
            lambda: Dimension.distance(25, 27, tol=0.1),
            "Got 'tol'; did you mean tolerance_mm?",
        ),
        (
            lambda: Dimension.distance(25, 27, tolerances_mm=0.1),
            "Got 'tolerances_mm'; use tolerance_mm.",
        ),
        (lambda: Dimension.angle(1, 2, tolerances=0.1), "Got 'tolerances'; use tolerance_deg."),
        (lambda: Dimension.distance(25, 27, accurcy=0.1), "Got 'accurcy'; did you mean accuracy?"),
        (lambda: Dimension.distance(25, 27, zzz=0.1), "Got 'zzz'."),
        (lambda: Dimension.angle(1, 2, tolerance_mm=0.1), "Got 'tolerance_mm'; use tolerance_deg."),
        (lambda: Dimension.angle(1, 2, max_error=0.1), "Got 'max_error'; use max_error_deg."),
        (lambda: Dimension.length(1, max_error_deg=0.1), "Got 'max_error_deg'; use max_error_mm."),
    ],
)
def test_a_requirement_by_another_name_is_refused_with_the_right_one(call, told):
    with pytest.raises(RequestError) as info:
        call()
    rule = "a requirement of a dimension must be one of tolerance_"
    assert str(info.value).startswith(rule)
    assert str(info.value).endswith(told)


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("tol", "tolerance"),
        ("tolerance_mm", "tolerance"),
        ("tolerances_mm", "tolerance"),
        ("max_error_mm", "max_error"),
    ],
)
def test_a_dimension_by_its_kind_names_the_argument_that_may_be_meant(name, meant):
    with pytest.raises(TypeError) as info:
        Dimension("distance", (25, 27), **{name: 0.1})
    assert str(info.value) == f"Dimension() has no argument {name!r}; did you mean {meant!r}?"


def test_the_names_of_requirements_hold_that_of_a_class():
    with pytest.raises(RequestError, match="one of tolerance_mm, tolerance, max_error_mm, "):
        Dimension.distance(25, 27, tol=0.1)
    with pytest.raises(RequestError, match="one of tolerance_deg, max_error_deg, "):
        Dimension.angle(1, 2, tol=0.1)
    with pytest.raises(RequestError) as info:
        Dimension.distance(25, 27, tolerance=(-0.1, 0.1))
    assert str(info.value) == (
        "tolerance must be a class such as 'H7'. Got (-0.1, 0.1); deviations are tolerance_mm."
    )
