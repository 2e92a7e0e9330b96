"""The catalogue of lights: facts, places, and names that are not there."""

import re

import pytest
from lit_parts import block
from plan_examples import CAMERA

from planner import Lighting, light_names
from planner.exceptions import RequestError
from planner.light.area_lights import AREA_LIGHTS
from planner.light.mounted_light import DiffuseDome
from planner.light_catalogue import light_facts, light_parts


def test_each_kind_has_three_lights_with_a_source_or_a_typical_size():
    assert set(light_parts()) == set(AREA_LIGHTS)
    for of_kind in light_parts().values():
        assert len(of_kind) >= 3
        for name, facts in of_kind.items():
            typical = name.startswith("typical-")
            assert bool(re.fullmatch(r"https://[\w.-]+/\S+", facts["source"])) is not typical
    assert light_facts("diffuse-dome", "Basler-Dome-200")["hole_mm"] == 30.0


@pytest.mark.parametrize("name", light_names())
def test_every_light_stands_where_it_belongs(name):
    light = Lighting(name).on_part(block(), CAMERA).area
    kind, _, own = name.partition(":")
    assert (light.kind, light.name) == (kind, own)
    if kind == "backlight":
        # under the middle of the block of 80 x 50
        assert light.centre == (40.0, 25.0, 0.0)
    else:
        focus = CAMERA.focus_distance_mm
        working = light_facts(kind, own)["working_mm"]
        assert light.distance_mm == max(focus - working, focus / 2)


def test_a_dome_that_does_not_fit_is_refused():
    with pytest.raises(RequestError, match="distance_mm must be above half of diameter_mm"):
        DiffuseDome(300.0, 33.0, 149.0)


def test_unknown_names_are_refused_with_near_ones():
    with pytest.raises(RequestError) as error:
        Lighting("coaxial:typical-51").on_part(block(), CAMERA)
    text = str(error.value)
    assert text.startswith(
        "light must name a light of kind coaxial in the catalogue. Got 'typical-51'"
    )
    assert "typical-50" in text
