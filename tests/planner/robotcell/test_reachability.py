"""What a cell reaches of a plan, and where the part should lie instead."""

from types import SimpleNamespace

import numpy as np
import pytest
from robot_cells import TABLE, made_cell, pose
from scipy.spatial.transform import Rotation

from aspectgraph import read_solid
from planner import Box, Fixturing, RobotError, look_at
from planner.robotcell import Reachability, propose_placements
from planner.robotcell.reachability import PoseReach, most_often

DOWN = Rotation.from_euler("x", 180, degrees=True).as_matrix()
EDGE = np.array([[0.0, 0.0, 40.0], [60.0, 0.0, 40.0]])


@pytest.fixture(scope="module")
def block():
    return read_solid("examples/two_pocket_block.off")


def setting(position, target=(40.0, 20.0, 30.0), names=("edge",)):
    views = look_at(np.array([position], dtype=float), np.array(target, dtype=float))
    return SimpleNamespace(cam2world=views[0], entities=names)


def plan_of(*settings):
    return SimpleNamespace(
        settings=settings, entities={"edge": EDGE}, ends_of=lambda setting, name: EDGE
    )


PLAN = plan_of(setting((40, 20, 330)), setting((40, 20, -300)), setting((40, -200, 250)))


def two_ways():
    over = pose((700.0, 80.0, 40.0), DOWN)
    return {
        "up": Fixturing(pose((700.0, 0.0, 0.0)), {"table": TABLE}),
        "turned over": Fixturing(over, {"table": TABLE}),
    }


def test_each_setting_says_how_it_is_reached_or_why_not(block):
    cell = made_cell(fixturings=two_ways())
    told = cell.reachability(PLAN, block)
    assert told.settings == ("setting_01", "setting_02", "setting_03")
    np.testing.assert_array_equal(told.reached, [[True, False], [False, True], [True, False]])
    assert told.complete
    assert repr(told) == "<Reachability: 3 of 3 settings reached (up: 2, turned over: 1)>"
    rows = told.rows()
    joints = [float(word) for word in rows[0][1].split()]
    placed = cell.cam2world(np.radians([joints]), "up")[0]
    np.testing.assert_allclose(placed[:3, 3], PLAN.settings[0].cam2world[:3, 3], atol=4.0)
    assert rows[1][1] == told.poses["up"][1].why
    record = told.to_dict()
    assert record["setting_01"]["up"]["joints_rad"] == told.poses["up"][0].branches[0].tolist()
    assert record["setting_02"]["up"] == {"why": rows[1][1]}


def test_one_fixturing_is_not_complete(block):
    told = made_cell().reachability(PLAN, block)
    assert not told.complete
    assert repr(told) == "<Reachability: 2 of 3 settings reached (up: 2)>"
    assert told.most_in_the_way("up") == told.poses["up"][1].why


def test_an_obstacle_may_hide_a_target_from_where_the_arm_is(block):
    clamp = Box((690.0, -20.0, 41.0), (720.0, 10.0, 60.0))
    fixturings = {"up": Fixturing(pose((700.0, 0.0, 0.0)), {"table": TABLE, "clamp": clamp})}
    cell = made_cell(fixturings=fixturings)
    above = plan_of(setting((40, 20, 330)))
    assert cell.reach(above.settings[0].cam2world[None], "up")[0].reached
    assert cell.reachability(above, block).poses["up"][0].why == "clamp hides edge"
    other = plan_of(setting((40, 20, 330), names=()))
    assert cell.reachability(other, block).complete


def test_the_most_frequent_reason_is_the_first_of_equal_ones():
    assert most_often(["b", "a", "b", "a"]) == "a"
    assert most_often(["b", "a", "b"]) == "b"
    assert most_often([]) == ""


def test_an_empty_plan_is_reached(block):
    assert made_cell().reachability(plan_of(), block).complete
    assert Reachability((), {"up": ()}).reached.shape == (0, 1)
    assert PoseReach(np.empty((0, 6)), "far").reached is False


def test_placements_are_ranked_and_reached(block):
    # one setting that the cell does not reach where the part is, but elsewhere
    far = {"up": Fixturing(pose((1250.0, 0.0, 0.0)))}
    cell = made_cell(fixturings=far)
    assert not cell.reachability(PLAN, block).reached[0].any()
    found = propose_placements(PLAN, block, cell, x=(450, 1100), y=(-300, 300), draws=40)
    assert 0 < len(found) <= 10
    best = found[0]
    assert best.n_reached >= 2
    x, y, z = best.centre_mm
    where = f"at ({x:.1f}, {y:.1f}, {z:.1f}) mm, turned by {best.turn_deg:g}°"
    n = len(PLAN.settings)
    assert repr(best) == f"<Placement {where}: {best.n_reached} of {n} settings reached>"
    order = [(-one.n_reached, -round(one.singular_value, 6)) for one in found]
    assert order == sorted(order)
    moved = cell.with_fixturings(best.fixturings)
    np.testing.assert_array_equal(
        moved.reachability(PLAN, block).reached, best.reachability.reached
    )
    middle = best.fixturings["up"].part2base @ [*block.bounds.mean(axis=0), 1.0]
    np.testing.assert_allclose(middle[:3], best.centre_mm)
    assert 450 <= best.centre_mm[0] <= 1100
    assert best.to_dict()["part2base"]["up"] == best.fixturings["up"].part2base.tolist()


def test_placements_repeat(block):
    cell = made_cell(fixturings=two_ways())
    first, again, other = (
        propose_placements(PLAN, block, cell, x=(500, 900), y=(0, 0), z=(20, 20), draws=6, rng=seed)
        for seed in (3, 3, 4)
    )
    assert [one.to_dict() for one in first] == [one.to_dict() for one in again]
    assert first[0].centre_mm != other[0].centre_mm


def test_a_place_through_something_is_none(block):
    fixed = made_cell(
        obstacles={"wall": Box((0, -900, 5), (1200, 900, 500))}, fixturings=two_ways()
    )
    assert (
        propose_placements(PLAN, block, fixed, x=(600, 700), y=(0, 10), z=(50, 60), draws=5) == ()
    )


PLATE = Box((-100.0, -100.0, -20.0), (300.0, 220.0, 0.0))


def on_plate(x, y, **changes):
    """A cell whose part lies on a plate of 400 x 320 x 20 mm, both moved along x and y."""
    plate = Box(PLATE.low, PLATE.high, pose((x, y, 0.0)))
    return made_cell(fixturings={"up": Fixturing(pose((x, y, 0.0)), {"plate": plate})}, **changes)


def test_a_table_through_the_pedestal_is_no_place(block):
    """Without its table the part would stand there; it and the arm keep clear of the pedestal."""
    pedestal = {"pedestal": Box((640.0, -900.0, -300.0), (660.0, 900.0, -10.0))}
    cell = on_plate(900.0, 0.0, obstacles=pedestal)
    ranges = {"x": (650.0, 660.0), "y": (0.0, 10.0), "draws": 5}
    assert propose_placements(PLAN, block, cell, **ranges) == ()
    lower = {"pedestal": Box((640.0, -900.0, -300.0), (660.0, 900.0, -20.0))}
    assert propose_placements(PLAN, block, on_plate(900.0, 0.0, obstacles=lower), **ranges)


def test_a_table_through_the_base_of_the_robot_is_no_place(block):
    """The part lies 350 mm before the base, and its plate reaches 400 mm back from the middle of the part."""
    long = Box((-300.0, -100.0, -20.0), (300.0, 220.0, 0.0), pose((900.0, 0.0, 60.0)))
    fixturing = Fixturing(pose((900.0, 0.0, 60.0)), {"plate": long})
    ranges = {"x": (350.0, 351.0), "y": (0.0, 1.0), "draws": 100}
    cell = made_cell(fixturings={"up": fixturing})
    found = propose_placements(PLAN, block, cell, **ranges)
    bare = made_cell(fixturings={"up": Fixturing(pose((900.0, 0.0, 60.0)))})
    assert propose_placements(PLAN, block, bare, **ranges)
    for one in found:
        plate = one.fixturings["up"].obstacles["plate"]
        axis = np.linalg.inv(plate.pose) @ [0.0, 0.0, 0.0, 1.0]
        # the base stands about the origin, with 75 mm or more to each side
        assert not (-300 < axis[0] < 300 and -100 < axis[1] < 220)


def test_a_table_may_stay_as_deep_in_the_floor_as_it_is(block):
    """A plate that is modelled 5 mm deep in the floor is there at every place."""
    floor = {"floor": Box((-2000.0, -2000.0, -300.0), (2000.0, 2000.0, -15.0))}
    cell = on_plate(900.0, 0.0, obstacles=floor)
    ranges = {"x": (600.0, 800.0), "y": (-100.0, 100.0), "draws": 10}
    depths = dict(cell.fixture_depths())
    # its own half thickness is 10 mm, and 5 mm of it are below the floor
    assert depths[("up", "plate", "floor")] == pytest.approx(5.0, abs=0.02)
    assert propose_placements(PLAN, block, cell, **ranges)


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ({"x": (900, 500), "y": (0, 1)}, "x must be two finite numbers, the lower first"),
        ({"x": (500, 900), "y": 3}, "y must be two finite numbers"),
        ({"x": (500, 900), "y": (0, 1), "z": (0, np.inf)}, "z must be two finite numbers"),
    ],
)
def test_ranges_that_are_none(block, ranges, message):
    with pytest.raises(RobotError, match=message):
        propose_placements(PLAN, block, made_cell(), **ranges)


def test_many_fixturings_are_counted_in_the_summary():
    missed = PoseReach(np.zeros((0, 6)), "too far")
    told = Reachability(("setting_01",), {f"fixturing number {k}": (missed,) for k in range(9)})
    assert repr(told) == "<Reachability: 0 of 1 settings reached (9 fixturings)>"
