"""What is asked of a dimension: permitted errors, and every rule."""

import json
import math

import pytest
from plan_examples import planned_dimension

from errors.measurands import Circle, Line, Localisation
from planner import Dimension, RequestError
from planner.request.target_records import plain_target, target_from
from planner.request.targets import edge_target, words_of
from planner.request.words import DIMENSIONS, EDGES, MIXED


def test_the_permitted_error_is_a_share_of_the_tolerance_an_error_or_a_share_of_the_value():
    bore = Dimension.diameter("r3", tolerance_mm=(-0.02, 0.06))
    assert bore.permitted_error(12.0) == pytest.approx(0.04 / 4)
    tenth = Dimension.diameter("r3", tolerance_mm=(-0.02, 0.06), share=0.1)
    assert tenth.permitted_error(12.0) == pytest.approx(0.004)
    assert Dimension.distance(17, 18, max_error_mm=0.02).permitted_error(12.0) == 0.02
    assert Dimension.angle(17, 18, max_error_deg=0.1).permitted_error(60.0) == 0.1
    assert Dimension.radius("a0", accuracy=0.99).permitted_error(
        12.0, accuracy=0.5
    ) == pytest.approx(0.12)
    assert Dimension.length(17).permitted_error(50.0, accuracy=0.98) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Dimension.diameter("r3", tolerance_mm=(0.05, -0.05)),
            r"lower deviation below .*0.05, -0.05",
        ),
        (lambda: Dimension.diameter("r3", tolerance_mm=(0.05,)), "must be two numbers"),
        (
            lambda: Dimension.diameter("r3", tolerance_mm=-0.2),
            r"Got -0\.2; write \[-0\.2, 0\.2\] for ±0\.2\.",
        ),
        (
            lambda: Dimension.diameter("r3", max_error_mm=0),
            "max_error_mm must be a positive number. Got 0",
        ),
        (lambda: Dimension.diameter("r3", accuracy=1.0), r"accuracy must be in \(0, 1\). Got 1.0"),
        (lambda: Dimension.diameter("r3", share=0), r"share must be in \(0, 1\]. Got 0"),
        (
            lambda: Dimension.diameter("r3", tolerance_deg=(-1, 1)),
            "must be one of tolerance_mm.* Got 'tolerance_deg'",
        ),
        (lambda: Dimension.angle(1, 2, max_error_mm=1), "Got 'max_error_mm'"),
        (
            lambda: Dimension.diameter("r3", max_error_mm=1, accuracy=0.9),
            "one of tolerance, max_error and accuracy",
        ),
        (
            lambda: Dimension.diameter("r3", tolerance="H7", tolerance_mm=(-1, 1)),
            "one of tolerance, max_error and accuracy. Got tolerance, tolerance_class",
        ),
        (
            lambda: Dimension.diameter("r3", tolerance=(-1, 1)),
            r"^tolerance must be a class such as 'H7'. Got \(-1, 1\); deviations are tolerance_mm.$",
        ),
        (
            lambda: Dimension.distance(25, 27, tolerance_mm=0.1),
            r"^tolerance_mm must be two numbers.* Got 0.1; write \[-0.1, 0.1\] for ±0.1.$",
        ),
        (
            lambda: Dimension.angle(25, 27, tolerance_deg=(1, -1)),
            r"^tolerance_deg must have its lower deviation below its upper one. Got \[1, -1\].$",
        ),
        (
            lambda: Dimension.distance(25, 27, max_error_mm=-1),
            "^max_error_mm must be a positive number. Got -1.$",
        ),
        (
            lambda: Dimension.diameter("r3", tolerance="Q7"),
            r"tolerance must be a letter and a grade .* A, B, C, .* Got 'Q7'",
        ),
        (
            lambda: Dimension.diameter("r3", tolerance="H7/g6"),
            "Got 'H7/g6'; give the class of this part only",
        ),
        (
            lambda: Dimension.radius("r3", tolerance_class="H7"),
            "only a diameter, distance or length has a tolerance class. Got 'H7' for a radius",
        ),
        (
            lambda: Dimension.diameter("r3", tolerance="t6").permitted_error(20.0),
            "tolerance must have limits in ISO 286-1 .* 20 mm. Got 't6'; t is defined over 24",
        ),
        (
            lambda: Dimension.distance(1, 2, direction=(0, 0, 0)),
            "direction must be three numbers, not all of them 0",
        ),
        (
            lambda: Dimension.diameter("r3", max_error_mm=12.0).permitted_error(12.0),
            "smaller than its nominal value 12",
        ),
        (
            lambda: Dimension.diameter("r3").permitted_error(12.0),
            "needs a tolerance, max_error or accuracy",
        ),
    ],
)
def test_refusals(make, message):
    with pytest.raises(RequestError, match=message):
        make()


def test_a_class_permits_a_share_of_its_tolerance():
    """IT7 over 18 to 30 mm is 21 µm: a quarter of half of it; over 30 to 50 mm it is 25 µm."""
    bore = Dimension.diameter("r3", tolerance="H7")
    assert bore == Dimension("diameter", ("r3",), tolerance_class="H7")
    assert bore.permitted_error(20.0) == pytest.approx(0.021 / 8)
    assert bore.permitted_error(40.0) == pytest.approx(0.025 / 8)
    assert bore.with_accuracy(0.98) is bore
    assert bore.with_limits(20.0) == Dimension.diameter("r3", tolerance_mm=(0.0, 0.021))
    plain = Dimension.diameter("r3")
    assert plain.with_limits(20.0) is plain


def test_a_tolerance_with_one_limit_has_no_width():
    """The permitted error is what is stated beside it, or the call's accuracy."""
    most = Dimension.diameter("r3", tolerance_mm=(None, 0.1), max_error_mm=0.02)
    assert most.tolerance == (-math.inf, 0.1)
    assert most.permitted_error(12.0) == 0.02
    least = Dimension.diameter("r3", tolerance_mm=(-0.1, math.inf))
    assert least.tolerance == (-0.1, math.inf)
    assert least.permitted_error(10.0, accuracy=0.99) == pytest.approx(0.1)
    with pytest.raises(RequestError, match="Got a tolerance with one limit"):
        least.permitted_error(10.0)


@pytest.mark.parametrize(
    "tolerance",
    [(None, None), (-math.inf, math.inf), (math.inf, None), (None, -math.inf), (None, math.nan)],
)
def test_a_tolerance_has_a_limit(tolerance):
    with pytest.raises(RequestError, match=r"^tolerance_mm must have a finite limit"):
        Dimension.diameter("r3", tolerance_mm=tolerance)


@pytest.mark.parametrize(
    ("tolerance", "stored", "text"),
    [
        ((-math.inf, 0.1), [None, 0.1], "at most +0.1"),
        ((-0.1, math.inf), [-0.1, None], "at least -0.1"),
    ],
)
def test_plans_store_no_limit_as_null(tolerance, stored, text):
    circle = Circle((0, 0, 0), (0, 0, 1), 10.0, (1, 0, 0))
    planned = planned_dimension(
        "diameter", ("r1",), (circle,), 0.02, Localisation.gaussian(), tolerance
    )
    data = json.loads(json.dumps(plain_target(planned), allow_nan=False))
    assert data["tolerance"] == stored
    assert target_from(data).tolerance == tolerance
    assert planned.requirement_texts[0].endswith(text)
    assert planned.share_text == ""


# How a plan's targets are called follows from their kinds alone.


EDGE = edge_target("top", [[0.0, 0, 0], [10, 0, 0]])
WIDTH = planned_dimension(
    "length", ("e1",), (Line([0, 0, 0], [0, 20, 0]),), 0.1, Localisation.rounding()
)


@pytest.mark.parametrize(
    ("targets", "words"),
    [
        ([], EDGES),
        ([EDGE, EDGE], EDGES),
        ([WIDTH], DIMENSIONS),
        ([EDGE, WIDTH], MIXED),
        ([WIDTH, EDGE], MIXED),
    ],
)
def test_words_follow_from_the_kinds_of_targets(targets, words):
    assert words_of({str(k): target for k, target in enumerate(targets)}) is words


def test_a_cell_has_the_unit_unless_its_head_has_it():
    assert f"{EDGES.value_head}: {EDGES.value.format(EDGE)}" == "Length (mm): 10.000"
    assert f"{MIXED.value_head}: {MIXED.value.format(EDGE)}" == "Nominal: length 10.000 mm"
    assert DIMENSIONS.value.format(WIDTH) == "length 20.000 mm"


def test_a_mixed_plan_says_what_holds_of_each_kind():
    """The sentences of either kind are in those of both."""
    share = {"share": "2 %"}
    for kind in (EDGES, DIMENSIONS):
        assert kind.accuracy.format(**share) in MIXED.accuracy.format(**share)
        assert kind.simulated in MIXED.simulated
    assert MIXED.error.format(**share) == "the permitted one (for an edge, 2 % of its image length)"
