"""The best plan so far: told of as it gets better, returned when the time is up, and without influence on the end."""

import itertools
import json
import math
from collections import Counter
from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from grid_box import EDGES, BoxSpace
from lit_parts import block
from plan_examples import BRIEF, CAMERA, ENTITIES, plan, setting

from aspectgraph import LightError, compute_regions
from ground.convert import to_plain
from planner import (
    Camera,
    Detectability,
    Effort,
    LampBox,
    Lighting,
    PoseUncertainty,
    Requirements,
    plan_inspection,
    plan_light,
)
from planner.callbacks import NOBODY
from planner.detectability.conditions import NOT_ASKED
from planner.exceptions import RequestError
from planner.light.light_plan import LightPlan
from planner.plan import InspectionPlan, read_plan
from planner.progress import TimeIsUpError
from planner.report.tables import nearest_limits
from planner.request.camera_limits import default_workspace
from planner.request.problem import Problem
from planner.rows import measured_rows
from planner.search import incumbents as supported_columns
from planner.search import lit_poses, realise_column
from planner.search import plan_setting as pose_setting
from planner.search.columns import ColumnPool
from planner.search.incumbents import SupportedColumns, with_lines_in_windows
from planner.search.realise_column import PosedOnly, promised_too_much
from planner.sensor_setting import ReasonKind
from planner.verify.simulate_setting import MODEL_TOLERANCE

# a narrow field of view, so that there is something to improve and to prove
CAMERA_INCUMBENTS = Camera(25.0, (0.00345, 0.00345), (2448, 2048), 8.0, 400.0)
UNCERTAINTY = PoseUncertainty.isotropic(translation_mm=0.05, rotation_rad=0.001)
NAMES = list(EDGES)[:8]
EFFORT = Effort(
    viewpoints=6, pricing_rounds=15, refutations=2, bound_nodes=20_000, margin_generations=3
)


@pytest.fixture(scope="module")
def space():
    return BoxSpace((120.0, 80.0, 60.0), [[-900.0] * 3, [1100.0] * 3], NAMES)


def plan_box(space, **options):
    options = {"effort": EFFORT, "rng": 3, **options}
    return plan_inspection(
        space.solid, space.entities, CAMERA_INCUMBENTS, UNCERTAINTY, space=space, **options
    )


@pytest.fixture(scope="module")
def whole(space):
    """The plan, and all that was told of on the way."""
    told = []
    return plan_box(space, on_incumbent=told.append), told


def exact(incumbent):
    return json.dumps(incumbent.to_dict())


def test_a_plan_that_is_watched_is_the_plan(space, whole):
    assert exact(plan_box(space)) == exact(whole[0])


def test_incumbents_get_better(whole):
    incumbent, told = whole
    assert len(told) > 3
    assert told[-1] is incumbent
    for earlier, later in itertools.pairwise(told[:-1]):
        worth = [
            (len(one.inspected), -len(one.settings), one.lower_bound) for one in (earlier, later)
        ]
        assert worth[0] < worth[1]
    assert len(told[0].inspected) < len(incumbent.inspected) or len(told[0].settings) > len(
        incumbent.settings
    )
    assert {one.lower_bound for one in told} > {1}


def test_entities_that_exclude_each_other_prove_a_bound_before_the_search_for_one(whole):
    incumbent, told = whole
    early = next(one for one in told if one.lower_bound > 1)
    assert early.unfinished
    assert early.bound_proof.startswith(
        f"Of {early.lower_bound} edges no two can be inspected together"
    )
    assert len(early.settings) > len(incumbent.settings)


def test_incumbents_keep_what_they_promise(whole):
    for k, incumbent in enumerate(whole[1]):
        # a glance may miss some
        assert incumbent.complete or k <= 1
        assert len(incumbent.inspected) + len(incumbent.uninspectable) == len(NAMES)
        assert incumbent.unfinished == (incumbent is not whole[0])
        assert min(incumbent.inspected.values()) >= incumbent.probability
        assert incumbent.lower_bound <= len(whole[0].settings)
        simulation = incumbent.simulate(4000, rng=17)
        assert not simulation.verdicts["contradicted"]


def is_moved(incumbent, best):
    """Whether a plan is the best one so far, but for the margins of its poses."""
    same = [one.entities for one in incumbent.settings] == [one.entities for one in best.settings]
    return (
        same
        and incumbent.lower_bound == best.lower_bound
        and min(least_shares(incumbent)) >= min(least_shares(best))
    )


def least_shares(incumbent):
    return [nearest_limits(incumbent, one)[0].share for one in incumbent.settings]


def test_when_the_time_is_up_the_best_plan_so_far_is_returned_and_the_state_goes_on(
    space, whole, tmp_path
):
    told = []
    state = tmp_path / "state.json"
    incumbent = plan_box(space, time_limit_s=1e-9, on_incumbent=told.append, state=state)
    assert incumbent.unfinished
    assert incumbent.complete
    # a glance is no plan to end with
    *before, last = told
    assert 1 <= len(before) < len(whole[1])
    assert [exact(one) for one in before] == [exact(one) for one in whole[1][: len(before)]]
    assert exact(incumbent) == exact(last)
    assert is_moved(incumbent, before[-1])
    incumbent.write(tmp_path / "plan.json")
    assert read_plan(tmp_path / "plan.json") == incumbent
    assert exact(plan_box(space, state=state)) == exact(whole[0])


def test_the_time_is_up_while_others_work(space, whole):
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(2) as executor:
        incumbent = plan_box(space, time_limit_s=1e-9, executor=executor)
    assert incumbent.unfinished
    assert incumbent.complete
    assert any(is_moved(incumbent, one) for one in whole[1])


def test_time_enough_changes_nothing(space, whole):
    assert exact(plan_box(space, time_limit_s=3600)) == exact(whole[0])


@pytest.mark.parametrize("gap", [0.3, 0.6, 0.9])
def test_a_gap_is_reached_and_not_more_is_proven(space, whole, gap):
    incumbent = plan_box(space, gap=gap)
    n = len(incumbent.settings)
    assert not incumbent.unfinished
    assert incumbent.complete
    # as good as asked for, or as good as it gets
    assert incumbent.gap <= gap or incumbent.lower_bound == whole[0].lower_bound
    # what entities that exclude each other prove is known before
    assert incumbent.lower_bound <= max(math.ceil(n * (1 - gap)), whole[1][1].lower_bound)
    assert incumbent.gap == pytest.approx((n - incumbent.lower_bound) / n)


def test_an_error_of_the_listener_ends_the_work(space):
    class Enough(Exception):
        pass

    def listener(incumbent):
        assert isinstance(incumbent, InspectionPlan)
        raise Enough

    with pytest.raises(Enough):
        plan_box(space, on_incumbent=listener)


def test_what_has_no_view_yet_is_said_to_have_none_yet(space, monkeypatch):
    """One entity gets no candidate poses, so its own run finds the first."""
    from planner.search import incumbents
    from planner.search import stages as find_columns

    monkeypatch.setattr(incumbents, "first_poses", lambda *_: np.zeros((0, 4, 4)))
    drawn = find_columns.judged_poses

    def without_one(shared, name, n_viewpoints, seed):
        return drawn(shared, NAMES[1], n_viewpoints, seed)

    monkeypatch.setattr(find_columns, "judged_poses", without_one)
    told = []
    incumbent = plan_box(space, on_incumbent=told.append)
    assert incumbent.complete
    first = told[0]
    assert first.uninspectable
    assert set(first.uninspectable.values()) == {
        "no view found yet: planning stopped early. More time may find one."
    }
    assert first.lower_bound == 1


@pytest.mark.parametrize("limit", [0, -1.0, math.nan, math.inf, True, "10"])
def test_a_limit_is_a_positive_number_of_seconds(space, limit):
    with pytest.raises(RequestError, match="time_limit_s must be a positive number of seconds"):
        plan_box(space, time_limit_s=limit)


@pytest.mark.parametrize("gap", [1, -0.1, math.nan, True, "0.2", None])
def test_a_gap_is_a_share(space, gap):
    with pytest.raises(RequestError, match=r"gap must be in \[0, 1\)"):
        plan_box(space, gap=gap)


def test_efforts_have_names():
    assert Effort.named("standard") == Effort()
    quick = Effort.named("quick")
    thorough = Effort.named("thorough")
    assert quick.bound_nodes < Effort().bound_nodes < thorough.bound_nodes
    with pytest.raises(
        RequestError, match=r"effort must be one of quick, standard, thorough\. Got 'slow'"
    ):
        Effort.named("slow")


# Covers of which simulation supports what they count on: as small as any, and no pose is tried
# twice.


N_ENTITIES = 7


class World:
    """Columns as judged, and what of them simulation supports; a stand-in for a run that counts what is tried."""

    def __init__(self, promised, supported, monkeypatch):
        self.callbacks = NOBODY
        self.effort = Effort()
        self.promised = np.array(promised, dtype=bool)
        self.truth = np.array(supported, dtype=bool)
        self.names = [f"e{i}" for i in range(self.promised.shape[1])]
        self.tries = Counter()
        self.pool = ColumnPool(len(self.names))
        self.pool.membership = self.promised
        self.pool.poses = np.tile(np.eye(4), (len(self.promised), 1, 1))
        # tells the columns apart
        self.pool.poses[:, 0, 3] = np.arange(len(self.promised))
        monkeypatch.setattr(supported_columns, "candidate_settings", self.candidates)
        monkeypatch.setattr(supported_columns, "as_simulated", self.simulated)
        # after so many columns the time is up
        self.n_in_time = math.inf

    def rng(self, purpose):
        return np.random.default_rng(0)

    def names_of(self, column):
        return tuple(np.array(self.names)[column].tolist())

    def candidates(self, run, pool, columns):
        return [
            SimpleNamespace(cam2world=pool.poses[c], entities=self.names_of(self.promised[c]))
            for c in columns
        ]

    def simulate(self, settings):
        # what is found beforehand is taken from here by `simulated`
        for k, tried in enumerate(settings):
            if k >= self.n_in_time:
                raise TimeIsUpError
            yield tried

    def simulated(self, run, settings):
        c = int(settings[0].cam2world[0, 3])
        self.tries[c] += 1
        names = self.names_of(self.truth[c])
        return [SimpleNamespace(entities=names)] if names else []


def random_world(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    promised = rng.random((12, N_ENTITIES)) < 0.35
    promised = promised[promised.any(axis=1)]
    supported = promised & (rng.random(promised.shape) < 0.7)
    return World(promised, supported, monkeypatch)


def fewest(columns):
    """The size of the smallest cover of all that columns contain, by trying all."""
    covered = columns.any(axis=0)
    for n in range(1, len(columns) + 1):
        if any(
            columns[list(some)].any(axis=0)[covered].all()
            for some in combinations(range(len(columns)), n)
        ):
            return n
    return 0


def reached(found):
    return {name for setting in found for name in setting.entities}


@pytest.mark.parametrize("seed", range(30))
def test_the_cover_is_as_small_as_any_of_what_is_supported(seed, monkeypatch):
    # so that nothing is given up, and no cover is the last one
    monkeypatch.setattr(supported_columns, "_EXCHANGES", 300)
    monkeypatch.setattr(supported_columns, "_IN_VAIN", 99)
    world = random_world(seed, monkeypatch)
    found = SupportedColumns().cover(world, world.pool, (0, 0), covers=99)
    assert reached(found) == set(world.names_of(world.truth.any(axis=0)))
    assert len(found) == fewest(world.truth)
    assert set(world.tries.values()) == {1}


@pytest.mark.parametrize("seed", range(10))
def test_what_was_tried_once_is_known(seed, monkeypatch):
    world = random_world(seed, monkeypatch)
    columns = SupportedColumns()
    first = columns.cover(world, world.pool, (0, 0))
    tries = dict(world.tries)
    worth = (len(reached(first)), -len(first))
    # no better one is there, and that is known
    assert columns.cover(world, world.pool, worth) is None
    assert world.tries == tries
    again = columns.cover(world, world.pool, (worth[0], worth[1] - 1))
    assert (len(reached(again)), len(again)) == (worth[0], -worth[1])
    assert set(world.tries.values()) == {1}


def test_when_the_time_is_up_the_poses_tried_are_still_of_use(monkeypatch):
    """Those that promise most come first, so that a part of them shows much."""
    promised = [[1, 0, 0, 0, 0, 0], [0, 1, 1, 1, 0, 0], [0, 0, 0, 0, 1, 1]]
    supported = [[1, 0, 0, 0, 0, 0], [0, 1, 1, 0, 0, 0], [0, 0, 0, 0, 1, 1]]
    world = World(promised, supported, monkeypatch)
    world.n_in_time = 2
    columns = SupportedColumns()
    assert columns.cover_of_tried(world) == []
    with pytest.raises(TimeIsUpError):
        columns.cover(world, world.pool, (0, 0))
    assert list(world.tries) == [1, 2]
    assert reached(columns.cover_of_tried(world)) == {"e1", "e2", "e4", "e5"}


def test_where_all_is_supported_not_a_column_more_is_tried(monkeypatch):
    world = World(np.eye(5), np.eye(5), monkeypatch)
    assert len(SupportedColumns().cover(world, world.pool, (0, 0))) == 5
    assert world.tries == dict.fromkeys(range(5), 1)


def test_one_cover_is_cut_to_what_is_supported(monkeypatch):
    """The large column promises all; it keeps one, and no other column was tried."""
    promised = np.vstack([np.ones((1, 4)), np.eye(4)])
    world = World(promised, np.vstack([np.eye(4)[:1], np.eye(4)]), monkeypatch)
    found = SupportedColumns().cover(world, world.pool, (0, 0), covers=1)
    assert reached(found) == {"e0"}
    assert world.tries == {0: 1}
    assert reached(SupportedColumns().cover(world, world.pool, (0, 0))) == {"e0", "e1", "e2", "e3"}


def test_what_is_promised_in_vain_is_given_up(monkeypatch):
    promised = [[1, 0]] * 10 + [[0, 1]]
    world = World(promised, [[0, 0]] * 10 + [[0, 1]], monkeypatch)
    assert reached(SupportedColumns().cover(world, world.pool, (0, 0), covers=99)) == {"e1"}
    assert sum(world.tries[c] for c in range(10)) == supported_columns._IN_VAIN


def test_what_some_pose_keeps_is_not_given_up_however_many_promise_it_in_vain(monkeypatch):
    """A column of e0 and another edge each, of which only that of e1 keeps e0; the others cannot be done without."""
    promised = np.hstack([np.ones((8, 1)), np.eye(8)])
    truth = promised.copy()
    truth[1:, 0] = 0
    world = World(promised, truth, monkeypatch)
    assert reached(SupportedColumns().cover(world, world.pool, (0, 0))) == set(world.names)


def test_nothing_supported_is_no_plan(monkeypatch):
    world = World(np.ones((3, 2)), np.zeros((3, 2)), monkeypatch)
    assert SupportedColumns().cover(world, world.pool, (0, 0)) is None


# What simulation contradicts: suspected with few displaced poses, decided with many.


@pytest.mark.parametrize(
    ("first", "sure", "contradicted"),
    [
        # as much as the plan's own simulation would call contradicted
        (0.02, 0.021, True),
        # luck of the first draws
        (0.02, 0.9 * MODEL_TOLERANCE, False),
        # nothing suspected: not looked at again
        (0.9 * MODEL_TOLERANCE, 0.5, False),
    ],
)
def test_a_promise_is_contradicted_by_more_than_the_models_tolerance(
    monkeypatch, first, sure, contradicted
):
    frequencies = {
        realise_column._TRIAL_POSES: 0.95 - first,
        realise_column._SURE_POSES: 0.95 - sure,
    }

    def simulated(setting, *_, n, **__):
        # what is not suspected is not simulated again
        assert set(setting.entities) == (
            {"edge", "sound"} if n == realise_column._TRIAL_POSES else {"edge"}
        )
        found = {
            "edge": SimpleNamespace(predicted=0.95, frequency=frequencies[n]),
            "sound": SimpleNamespace(predicted=0.95, frequency=0.95),
        }
        return {name: found[name] for name in setting.entities}

    monkeypatch.setattr(realise_column, "simulate_setting", simulated)
    judge = SimpleNamespace(
        problem=SimpleNamespace(
            pose_uncertainty=None,
            at_pose=lambda *_: SimpleNamespace(measured=None),
            known_at=lambda *_: None,
        ),
        camera=None,
        accuracy=0.98,
    )
    posed = PosedOnly(np.eye(4), ("edge", "sound"), {"edge": 0.95, "sound": 0.95})
    assert list(promised_too_much(judge, posed, 0)) == ["edge"] * contradicted


# Settings in which a lamp shows what they measure.


# between the top, z = 60, and the face x = 0
LEFT = {"left": [[0.0, 0, 60], [0, 50, 60]]}
# as high above the top as in front of the face: both are equally bright, so from where both are seen, nothing shows
EVEN = (-400.0, 25.0, 460.0)
CAMERA_LIT_SETTINGS = Camera.named("basler-acA2440-20gm-8mm")
HOW = {
    "accuracy": 0.98,
    "effort": BRIEF,
    "showing": Detectability(0, 0, 0),
}


def planned(**more):
    return plan_inspection(block(), LEFT, CAMERA_LIT_SETTINGS, UNCERTAINTY, **HOW, **more)


def sees_both(found):
    (one,) = found.settings
    return one.position[0] < 0 and one.position[2] > 60


def test_a_pose_is_found_from_which_the_lamp_shows_an_edge():
    """Beside the ground, which is dark, one face alone shows; both faces do not differ."""
    seed = next(seed for seed in range(20) if sees_both(planned(rng=seed)))
    dark = plan_light(planned(rng=seed), block(), [EVEN])
    assert not dark.complete
    found = planned(rng=seed, lamps=[EVEN])
    assert found.complete
    assert found.light.complete
    assert not sees_both(found)
    assert (found.lower_bound, len(found.settings)) == (1, 1)
    assert found.settings[0].message == "pose in which a lamp shows it"
    # nothing changes where all shows anyway
    above = planned(rng=seed, lamps=[(-150.0, 25.0, 500.0)])
    assert above.settings == planned(rng=seed).settings
    assert above.light == plan_light(above, block(), [(-150.0, 25.0, 500.0)])


def test_what_is_shown_from_nowhere_is_not_inspected():
    """Below the part, a lamp shows neither the top nor, from behind the face, that one."""
    found = planned(lamps=[(200.0, 25.0, -300.0)])
    assert found.uninspectable["left"].kind is ReasonKind.NOT_SHOWN
    assert found.uninspectable["left"] == (
        "not readable in the light: the lamp does not light all of it, wherever the camera is: "
        "somewhere both of its faces turn away."
    )
    assert (found.complete, found.settings, found.lower_bound) == (False, (), 0)
    assert found.light.images == ()


def test_a_ring_light_needs_no_space_of_its_own():
    found = planned(lamps="ring")
    assert found.light.kind == "ring"
    assert found.light.complete


def _contrast_of_a_ring(plan):
    """Between the top and the face x = 0, by the heights of the camera over them; 1 if it sees one face only."""
    x, _, z = plan.settings[0].position
    top = max(z - 60, 0)
    left = max(-x, 0)
    return abs(top - left) / (top + left)


def test_what_the_ring_does_not_show_is_looked_for_from_other_poses():
    """Where all viewpoints are taken, the first pose may see both faces at angles that hardly differ."""
    space = compute_regions(
        block(), LEFT, workspace=default_workspace(block(), CAMERA_LIT_SETTINGS)
    )
    lighting = Lighting("ring", contrast=0.8)
    drafts = {seed: planned(space=space, rng=seed) for seed in range(8)}
    seed = next(seed for seed, one in drafts.items() if _contrast_of_a_ring(one) < 0.8)
    assert not plan_light(drafts[seed], block(), "ring", contrast=0.8).complete
    found = planned(space=space, rng=seed, lamps=lighting)
    assert found.light.complete
    (one,) = found.settings
    assert one.message == "pose in which a lamp shows it"
    assert _contrast_of_a_ring(found) >= 0.8
    assert found.light.lamps.tolist() == [one.position.tolist()]


def test_lamps_are_part_of_what_a_state_belongs_to(tmp_path):
    state = tmp_path / "state.json"
    first = planned(lamps=[EVEN], state=state)
    assert planned(lamps=Lighting([EVEN]), state=state) == first
    with pytest.raises(Exception, match=r"contrast was 0\.1 and is now 0\.2"):
        planned(lamps=Lighting([EVEN], contrast=0.2), state=state)
    with pytest.raises(Exception, match="lamps changed"):
        planned(state=state)


def test_a_lamp_inside_the_part_is_refused_before_any_work():
    with pytest.raises(LightError, match="inside"):
        planned(lamps=[(40.0, 25.0, 30.0)], progress=lambda *_: pytest.fail("work was done"))


def test_a_setting_does_not_measure_what_only_another_one_shows(monkeypatch):
    settings = setting((0.0, 0.0, 300.0), ["left", "right"]), setting((50.0, 0.0, 300.0), ["left"])
    light = LightPlan(
        "fixed", 0.1, 0.1, "dark", [EVEN], ((), ()), ({"left": "dark", "right": "dark"}, {}), 1
    )
    two = replace(
        plan(settings=settings, uninspectable={}, entities={**LEFT, "right": LEFT["left"]}),
        light=light,
    )
    monkeypatch.setattr(
        pose_setting, "setting_at", lambda _, pose, names, *args, **how: setting(pose[:3, 3], names)
    )
    run = SimpleNamespace(problem=None, names=["left", "right"])
    # what nothing shows stays where it was, until the plan leaves it out
    assert [one.entities for one in lit_poses._chosen_among(run, two, [])] == [
        ("right",),
        ("left",),
    ]


def test_lighting_tells_what_is_asked():
    assert repr(Lighting(LampBox((0, 0, 0), (1, 1, 1)), 0.2)).startswith(
        "<Lighting by the box of lamps: contrast 0.2"
    )
    assert to_plain(Lighting([EVEN])) == to_plain(Lighting(np.array([EVEN])))
    assert to_plain(Lighting([EVEN])) != to_plain(Lighting([EVEN], step=0.3))


# Other lines in search windows: of the front of a block by similar triangles.


NAME = "top front"
SPACE = compute_regions(block(), {NAME: ENTITIES[NAME]}, workspace=[[-900.0] * 3, [900.0] * 3])
DEPTH_MM = 600.0
HEIGHT_MM = 60.0
# the front face's other long edge is its height away; its short ones leave the edge's ends
APART_PX = CAMERA.matrix[1, 1] * HEIGHT_MM / DEPTH_MM


def planned_lines_in_window(sigma_rad, showing):
    """Plan the front's upper edge, seen squarely by a camera that only turns."""
    uncertainty = PoseUncertainty(np.diag([0.0, 0, 0, sigma_rad**2, 0, 0]))
    need = Requirements(showing=showing)
    made = plan(
        settings=(setting((40.0, -DEPTH_MM, 60.0), [NAME], target=(40.0, 0.0, 60.0), roll=0.0),),
        entities={NAME: ENTITIES[NAME]},
        uninspectable={},
        pose_uncertainty=uncertainty,
        requirements=need.to_dict(),
    )
    request = Problem(SPACE, (NAME,), CAMERA, uncertainty, requirements=need)
    return with_lines_in_windows(made, request)


def turn_for(window_px):
    """Return the turn about the image's x axis whose three standard deviations move the axis so far."""
    return window_px / 3.0 / CAMERA.matrix[1, 1]


def test_a_line_inside_the_window_is_kept_and_warned_of():
    found = planned_lines_in_window(turn_for(1.1 * APART_PX), Detectability())
    assert found.settings[0].lines_in_window_px[NAME] == pytest.approx(APART_PX, rel=1e-6)
    (row,) = measured_rows(found)[0]
    # the ends lie beside the axis, where a turn about x moves them no less
    assert 1.1 * APART_PX <= row.search_window_px < 1.2 * APART_PX
    assert "another visible line comes within" in row.warnings[-1].text
    assert InspectionPlan.from_dict(found.to_dict()) == found


def test_a_line_outside_the_window_is_not():
    found = planned_lines_in_window(turn_for(0.8 * APART_PX), Detectability())
    assert found.settings[0].lines_in_window_px == {}
    assert not any(
        "another visible line" in one.text for one in measured_rows(found)[0][0].warnings
    )
    assert "lines_in_window_px" not in found.to_dict()["settings"][0]
    assert set(found.to_dict()["settings"][0]["search_window_px"]) == {NAME}


def test_plans_that_ask_nothing_of_images_keep_their_file():
    found = planned_lines_in_window(turn_for(1.1 * APART_PX), NOT_ASKED)
    assert not {"search_window_px", "lines_in_window_px"} & set(found.to_dict()["settings"][0])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"search_window_px": {NAME: 5000.0}}, r"search_window_px.*must be that of the pose"),
        ({"search_window_px": {}}, r"search_window_px.*must be given"),
        (
            {"lines_in_window_px": {"bottom": 1.0}},
            r"lines_in_window_px.*must be of an entity with a search window",
        ),
        (
            {"lines_in_window_px": {NAME: 1e6}},
            r"lines_in_window_px.*must be at most the search window",
        ),
    ],
)
def test_a_file_that_says_otherwise_is_refused(change, told):
    from planner.exceptions import PlanFileError

    data = planned_lines_in_window(turn_for(1.1 * APART_PX), Detectability()).to_dict()
    data["settings"][0].update(change)
    with pytest.raises(PlanFileError, match=told):
        InspectionPlan.from_dict(data)
