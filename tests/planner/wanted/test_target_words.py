"""How a plan's targets are called follows from their kinds alone."""

import pytest
from plan_examples import planned_dimension

from errors.measurands import Line, Localisation
from planner.request.targets import edge_target, words_of
from planner.request.words import DIMENSIONS, EDGES, MIXED

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
