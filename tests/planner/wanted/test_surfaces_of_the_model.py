"""Where the position of a dimension's faces comes from: the model, the default or the caller."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from aspectgraph import ModelDimension
from aspectgraph.dimensions.features import SurfaceZone
from errors.measurands import Localisation
from planner import Dimension, RequestError, dimensions_to_plan
from planner.request.dimension_files import SURFACES_MM, surfaces_of_zone, with_surfaces_of_call

FINE = Localisation.gaussian()
BORE = ModelDimension(
    "bore",
    "diameter",
    12.0,
    (-0.05, 0.05),
    ("r1",),
    None,
    features=((("r1",),), (("r2",),)),
    n_features=2,
    feature_reasons=(None, None),
    surfaces=(SurfaceZone("profile", 0.12, True), None),
)


def test_a_zone_has_the_deviation_of_equally_likely_places():
    """Uniform over a width t: the mean of x^2 from -t/2 to t/2 is t^2/12."""
    n = 1001
    places = [0.12 * ((k + 0.5) / n - 0.5) for k in range(n)]
    by_sum = math.sqrt(math.fsum(x * x for x in places) / n)
    sigma, source = surfaces_of_zone(SurfaceZone("profile", 0.12, True))
    assert sigma == pytest.approx(by_sum, rel=1e-5)
    assert source == "profile 0.12 mm"
    assert surfaces_of_zone(None) == (None, "")


def test_a_form_alone_makes_nothing_better_than_the_default():
    """A face that is flat to 1 µm may still be anywhere; one that is not flat to 1 mm is worse."""
    assert surfaces_of_zone(SurfaceZone("flatness", 0.001, False))[0] == SURFACES_MM
    worse, _ = surfaces_of_zone(SurfaceZone("flatness", 1.0, False))
    assert worse == pytest.approx(1.0 / math.sqrt(12.0))


def test_each_feature_has_the_zone_of_its_own_face():
    wanted, _ = dimensions_to_plan([BORE])
    first, second = wanted.values()
    assert first.surfaces_mm == pytest.approx(0.12 / math.sqrt(12.0))
    assert first.surfaces_from == "profile 0.12 mm"
    assert (second.surfaces_mm, second.surfaces_from) == (None, "")
    one, _ = dimensions_to_plan([BORE], one_per_pattern=True)
    assert one["bore"].surfaces_from == "profile 0.12 mm"
    by_hand, _ = dimensions_to_plan([replace(BORE, surfaces=())])
    assert [item.surfaces_mm for item in by_hand.values()] == [None, None]


def test_what_the_caller_gives_takes_the_place_of_the_model():
    wanted, _ = dimensions_to_plan([BORE])
    own = Dimension.diameter("r3", tolerance_mm=(-0.05, 0.05), surfaces_mm=0.01)
    items = {**wanted, "own": own, "edge": 17}
    assert with_surfaces_of_call(items, None, FINE) == items
    for surfaces_mm, how in ((0.05, FINE), (0.0, FINE), (None, Localisation.rounding())):
        found = with_surfaces_of_call(items, surfaces_mm, how)
        assert [found[name].surfaces_mm for name in wanted] == [None, None]
        assert [found[name].surfaces_from for name in wanted] == ["", ""]
        # what is stated for one dimension stays
        assert found["own"] == own
        assert found["edge"] == 17


@pytest.mark.parametrize("wrong", [-0.1, math.inf, "0.1", True])
def test_a_position_that_is_none_is_refused(wrong):
    with pytest.raises(RequestError, match="surfaces_mm must be finite and not negative"):
        Dimension("diameter", ("r1",), max_error=0.1, surfaces_mm=wrong)
