"""What measured things of a plan consist of, found again in the part; in another part they are not."""

from types import SimpleNamespace

import pytest
from holed_plate import FRONT, HEIGHT, HOLES, holed_plate

from errors.measurands import Circle, Line
from planner import RequestError
from planner.light.demands import _parts
from planner.request.targets import edge_target

PLATE = holed_plate()


def of(*geometry):
    return SimpleNamespace(geometry=geometry)


@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 0, -1)])
def test_a_rim_and_an_edge_of_a_dimension_are_those_of_the_part(axis):
    (centre, radius) = HOLES["right"]
    rim, edge = _parts(of(Circle((*centre, HEIGHT), axis, radius), Line(*FRONT)), PLATE, "it")
    assert rim.kind == "rim"
    assert rim.circle.centre == pytest.approx([*centre, HEIGHT])
    assert rim.circle.radius_mm == pytest.approx(radius)
    assert sorted(map(tuple, edge.endpoints.tolist())) == sorted(map(tuple, FRONT))
    (edge,) = _parts(edge_target("edge", FRONT), PLATE, "edge")
    assert sorted(map(tuple, edge.endpoints.tolist())) == sorted(map(tuple, FRONT))


@pytest.mark.parametrize(
    "geometry",
    [
        Circle((*HOLES["right"][0], HEIGHT), (0, 0, 1), HOLES["right"][1] + 0.5),
        Circle((*HOLES["right"][0], HEIGHT + 0.5), (0, 0, 1), HOLES["right"][1]),
        Circle((*HOLES["right"][0], HEIGHT), (0, 1, 0), HOLES["right"][1]),
        Circle((*HOLES["right"][0], HEIGHT), (0, 0, 1), HOLES["right"][1] + 0.5, (1, 0, 0), 1.0),
        Line((0, 0, 11), (80, 0, 11)),
        # half of it lies beyond the edge
        Line((40, 0, 10), (120, 0, 10)),
    ],
)
def test_of_another_part_they_are_not_found(geometry):
    with pytest.raises(RequestError, match=r"solid must be the plan's part\."):
        _parts(of(geometry), PLATE, "it")


def test_a_stretch_and_a_run_are_lit_as_the_whole_edge_and_rim():
    (centre, radius) = HOLES["right"]
    run = Circle((*centre, HEIGHT), (0, 0, 1), radius, (1, 0, 0), 1.0)
    stretch = Line((20, 0, 10), (40, 0, 10))
    rim, edge = _parts(of(run, stretch), PLATE, "it")
    assert rim.kind == "rim"
    assert rim.circle.centre == pytest.approx([*centre, HEIGHT])
    assert sorted(map(tuple, edge.endpoints.tolist())) == sorted(map(tuple, FRONT))
