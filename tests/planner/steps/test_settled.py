"""What becomes of targets that lack the required P_all when the settings are fixed."""

from dataclasses import replace
from types import SimpleNamespace

from grid_box import EDGES, BoxSpace

from planner import Camera, PoseUncertainty, look_at
from planner.request.problem import Problem
from planner.search.plan_setting import setting_at
from planner.search.stages import _without_short
from planner.sensor_setting import ReasonKind

CAMERA = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
NAMES = tuple(EDGES[:3])
REQUEST = Problem(
    BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], NAMES),
    NAMES,
    CAMERA,
    UNCERTAINTY,
    0.98,
    0.9,
)
POSE = look_at([[60.0, -280.0, 380.0]], [60.0, 40.0, 60.0])[0]


def setting(p_all):
    made = setting_at(REQUEST, POSE, tuple(p_all), "given")
    return replace(made, p_all=p_all, p_all_together=0.5, p_all_poses=1000)


def test_a_target_is_dropped_where_it_is_short_and_lost_where_it_is_so_everywhere():
    """The first is short in one of two settings, the second in its only one, the third in none."""
    first, second, third = NAMES
    settled = _without_short(
        SimpleNamespace(problem=REQUEST, request=REQUEST),
        [setting({first: 0.85, second: 0.89}), setting({first: 0.95, third: 0.9})],
    )
    # nothing is left of the first setting
    assert [one.entities for one in settled.settings] == [(first, third)]
    assert list(settled.lost) == [second]
    assert settled.lost[second].kind is ReasonKind.PROBABILITY_TOO_LOW
    assert "P_all = 0.8900, below the required 0.9." in settled.lost[second]


def test_a_setting_keeps_what_is_stated_of_its_other_targets():
    first, second, _ = NAMES
    (kept,) = _without_short(
        SimpleNamespace(problem=REQUEST, request=REQUEST), [setting({first: 0.85, second: 0.93})]
    ).settings
    assert kept.p_all == {second: 0.93}
    assert set(kept.probability) == {second}
