"""On which side, where and on what posts a part should lie so that the robot reaches a plan."""

from types import SimpleNamespace

import numpy as np
import pytest
from robot_cells import ROBOTS, TABLE, made_cell, pose
from scipy.spatial import ConvexHull

from aspectgraph import read_solid
from planner import (
    Backlight,
    Box,
    Cell,
    Fixturing,
    LightBox,
    PlannerError,
    RequestError,
    RobotError,
    look_at,
    propose_layings,
)
from planner.light.area_lights import light_of_cell
from planner.robotcell.cell_file import laid_cell, toml_lines
from planner.robotcell.laying import Posts, centre_of_mass, flat_sides

EDGE = np.array([[0.0, 0.0, 40.0], [60.0, 0.0, 40.0]])


@pytest.fixture(scope="module")
def block():
    return read_solid("examples/two_pocket_block.off")


def closed(corners, faces):
    """Return corners and triangles of polygons, fanned."""
    fans = [(face[0], face[i], face[i + 1]) for face in faces for i in range(1, len(face) - 1)]
    return SimpleNamespace(
        vertices=np.array(corners, dtype=float), triangles=np.array(fans, dtype=np.int64)
    )


def box(x, y, z):
    corners = [[i * x, j * y, k * z] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return closed(corners, faces)


def prism(outline, height):
    """Return the prism over a polygon (n, 2), counter-clockwise, its lower end at 0."""
    n = len(outline)
    corners = [(*point, z) for z in (0.0, height) for point in outline]
    walls = [(i, (i + 1) % n, n + (i + 1) % n, n + i) for i in range(n)]
    return closed(corners, [tuple(range(n))[::-1], tuple(range(n, 2 * n)), *walls])


def frame(outer, inner, height):
    """Return a square plate with a square hole through its middle."""
    corners = [
        (sx * half, sy * half, z)
        for z in (0.0, height)
        for half in (outer / 2, inner / 2)
        for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    around = [(i, (i + 1) % 4) for i in range(4)]
    below = [(j, i, 4 + i, 4 + j) for i, j in around]
    above = [(8 + i, 8 + j, 12 + j, 12 + i) for i, j in around]
    outside = [(i, j, 8 + j, 8 + i) for i, j in around]
    inside = [(4 + j, 4 + i, 12 + i, 12 + j) for i, j in around]
    return closed(corners, [*below, *above, *outside, *inside])


def turned(solid, motion):
    corners = solid.vertices @ motion[:3, :3].T + motion[:3, 3]
    return SimpleNamespace(vertices=corners, triangles=solid.triangles)


def test_a_box_has_six_sides_by_their_area():
    sides = flat_sides(box(60.0, 100.0, 40.0))
    np.testing.assert_allclose(
        [side.area_mm2 for side in sides], [6000, 6000, 4000, 4000, 2400, 2400]
    )
    for side in sides:
        np.testing.assert_allclose(side.rotation @ side.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(side.rotation) == pytest.approx(1.0)
        # the foot is the middle of the side, below the middle of the box
        apart = side.foot - [30.0, 50.0, 20.0]
        np.testing.assert_allclose(side.rotation @ apart, [0, 0, -side.height_mm], atol=1e-9)


def test_sides_do_not_depend_on_the_frame():
    motion = pose((900.0, -40.0, 3.0), np.linalg.qr(np.arange(9).reshape(3, 3) + np.eye(3) * 3)[0])
    if np.linalg.det(motion[:3, :3]) < 0:
        motion[:3, 0] *= -1
    plain = flat_sides(frame(200.0, 80.0, 30.0))
    moved = flat_sides(turned(frame(200.0, 80.0, 30.0), motion))
    np.testing.assert_allclose([s.area_mm2 for s in plain], [s.area_mm2 for s in moved])
    np.testing.assert_allclose([s.height_mm for s in plain], [s.height_mm for s in moved])


def test_the_centre_of_mass_of_an_angle_is_that_of_its_two_legs():
    angle = prism([(0, 0), (60, 0), (60, 10), (10, 10), (10, 40), (0, 40)], 20.0)
    legs = np.array([[60 * 10, 30.0, 5.0], [10 * 30, 5.0, 25.0]])
    expected = (legs[:, :1] * legs[:, 1:]).sum(axis=0) / legs[:, 0].sum()
    found = centre_of_mass(angle.vertices, angle.triangles)
    np.testing.assert_allclose(found, [*expected, 10.0], atol=1e-9)


def test_a_side_that_the_centre_of_mass_is_not_above_carries_nothing():
    # a leaning prism falls over its short lower end
    square = ((0, 0), (20, 0), (20, 20), (0, 20))
    leaning = closed(
        [(x + shift, y, z) for z, shift in ((0, 0), (60, 90)) for x, y in square],
        [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)],
    )
    downs = [-side.rotation[2] for side in flat_sides(leaning, 5.0)]
    assert not any(abs(down[2]) > 0.999 for down in downs)
    assert any(abs(down[1]) > 0.999 for down in downs)


def test_a_box_tips_over_its_nearest_side():
    side = flat_sides(box(60.0, 100.0, 40.0))[0]
    assert side.tips_at_rad(side.outline) == pytest.approx(np.arctan2(30.0, 20.0))
    assert side.tips_at_rad(side.stands[0]) == 0.0
    assert 0 < side.tips_at_rad(side.stands[1]) < side.tips_at_rad(side.outline)


def test_a_part_that_reaches_beyond_its_table_tips_over_its_border(block):
    tower = made_cell(
        fixturings={
            "up": Fixturing(
                pose((690.0, -30.0, 20.0)), {"tower": Box((700, -6, 0), (760, 5, 20), np.eye(4))}
            )
        }
    )
    found = propose_layings(PLAN, block, tower, "tower", post_heights_mm=(0.0,), draws=40, rng=2)
    assert found
    sides = flat_sides(block)
    for way in found:
        (laying,) = way.layings.values()
        # over the nearer border of the strip, which is at most 11 mm wide
        x, y = laying.foot_mm
        apart = min(y + 6.0, 5.0 - y, x - 700.0, 760.0 - x)
        expected = np.degrees(np.arctan2(apart, sides[laying.side - 1].height_mm))
        assert laying.tips_at_deg == pytest.approx(expected, abs=1e-6)


def test_posts_stand_below_material_and_around_the_centre_of_mass():
    largest = flat_sides(frame(200.0, 80.0, 30.0), 20.0)[0]
    # nothing is above a post in the middle of the hole
    assert [len(stand) for stand in largest.stands] == [3] * len(largest.stands)
    assert largest.stands
    for stand in largest.stands:
        edge = np.abs(stand).max(axis=1)
        assert (edge <= 90.0 + 1e-9).all()
        assert (edge >= 50.0 - 1e-9).all()
        shares = np.linalg.solve(np.vstack([stand.T, np.ones(3)]), [0.0, 0.0, 1.0])
        assert (shares > 0).all()
    with_middle = flat_sides(box(60.0, 100.0, 40.0), 20.0)[0].stands
    np.testing.assert_array_equal(with_middle[0], [[0.0, 0.0]])


def setting(position):
    views = look_at(np.array([position], dtype=float), np.array([40.0, 20.0, 30.0]))
    return SimpleNamespace(cam2world=views[0], entities=("edge",))


def plan_of(*settings):
    return SimpleNamespace(
        settings=settings, entities={"edge": EDGE}, ends_of=lambda setting, name: EDGE
    )


PLAN = plan_of(setting((40, 20, 330)), setting((40, 20, -300)), setting((40, -200, 250)))


@pytest.fixture(scope="module")
def found(block):
    return propose_layings(PLAN, block, made_cell(), "table", draws=160, rng=1)


def test_on_its_side_the_part_shows_top_and_underside(found, block):
    # flat on the table, the robot reaches one of both
    flat = made_cell().reachability(PLAN, block)
    assert not flat.reached[:2].all()
    best = found[0]
    assert best.n_reached == 3
    assert len(best.layings) == 1
    order = [way.worth for way in found]
    assert order == sorted(order)


def test_what_is_proposed_lies_on_its_table_or_posts(found, block):
    top = TABLE.corners()[:, 2].max()
    for way in found:
        for name, laying in way.layings.items():
            lying = way.fixturings[name]
            placed = block.vertices @ lying.part2base[:3, :3].T + lying.part2base[:3, 3]
            assert placed[:, 2].min() == pytest.approx(top + laying.post_mm, abs=1e-6)
            posts = [body for key, body in lying.obstacles.items() if key.startswith("post")]
            assert len(posts) in ((1, 3) if laying.post_mm else (0,))
            for post in posts:
                heights = post.corners()[:, 2]
                assert (heights.min(), heights.max()) == pytest.approx((top, top + laying.post_mm))


def test_what_is_proposed_is_what_the_cell_reaches(found, block):
    for way in found[:3]:
        told = made_cell().with_fixturings(way.fixturings).reachability(PLAN, block)
        np.testing.assert_array_equal(told.reached, way.reachability.reached)
        assert way.to_dict()["reached"] == told.reached.any(axis=1).sum()


def test_two_ways_are_chosen_together_where_one_is_not_enough(block):
    # flat only, as a plate as thin as this would lie
    search = {"post_heights_mm": (0.0,), "draws": 120}
    views = [
        (40, 20, 330),
        (40, 20, -300),
        (40, -290, 30),
        (40, 330, 30),
        (-250, 20, 30),
        (330, 20, 30),
    ]
    around = plan_of(*map(setting, views))
    alone = propose_layings(around, block, made_cell(), "table", most_fixturings=1, **search)[0]
    pair = propose_layings(around, block, made_cell(), "table", **search)[0]
    assert alone.n_reached < pair.n_reached
    assert (len(alone.layings), len(pair.layings)) == (1, 2)


def test_proposals_repeat(found, block):
    again = propose_layings(PLAN, block, made_cell(), "table", draws=160, rng=1)
    assert [way.to_dict() for way in again] == [way.to_dict() for way in found]


@pytest.mark.parametrize(
    ("table", "options", "message"),
    [
        ("bench", {}, "table must be an obstacle of the cell or of its first fixturing.*'table'"),
        ("table", {"draws": 0}, "draws must be"),
        ("table", {"most_fixturings": 3}, "most_fixturings must be 1 or 2. Got 3"),
        ("table", {"post_heights_mm": ()}, "post_heights_mm must have at least one height"),
        ("table", {"post_heights_mm": (-1.0,)}, "post_heights_mm must be .*-1"),
        ("table", {"post_width_mm": 0.0}, "post_width_mm must be"),
    ],
)
def test_a_search_that_cannot_be_is_refused(block, table, options, message):
    with pytest.raises(PlannerError, match=message):
        propose_layings(PLAN, block, made_cell(), table, **options)


AXIS = ((700.0, 0.0, 0.0), (0.0, 0.0, 1.0))
PLATE = Box((550.0, -150.0, 40.0), (850.0, 150.0, 60.0))


def turning_cell(**changes):
    """A cell with a plate on its drive, and a clamp on the plate."""
    clamp = Box((560.0, 0.0, 60.0), (580.0, 20.0, 90.0))
    options = {"axis": AXIS, "angles": 8, "turning": {"plate": PLATE, "clamp": clamp}} | changes
    around = {"table": TABLE, "drive": Box((600.0, -100.0, 0.0), (800.0, 100.0, 40.0))}
    lying = Fixturing(pose((700.0, 0.0, 60.0)), around, **options)
    return made_cell(fixturings={"up": lying})


def test_a_part_is_laid_on_a_turntable_and_each_setting_has_its_angle(block):
    cell = turning_cell()
    best = propose_layings(PLAN, block, cell, "plate", draws=30, rng=1)[0]
    (lying,) = best.fixturings.values()
    # the clamp held the part as it lay
    assert set(lying.obstacles) == {"table", "drive"}
    assert "clamp" not in lying.turning
    assert lying.turning["plate"] == PLATE
    assert lying.table.angles == cell.fixturings["up"].table.angles
    placed = block.vertices @ lying.part2base[:3, :3].T + lying.part2base[:3, 3]
    (laying,) = best.layings.values()
    assert placed[:, 2].min() == pytest.approx(60.0 + laying.post_mm, abs=1e-6)
    # the same angle by angle, on tables that stand still
    reached = np.zeros(len(PLAN.settings), dtype=bool)
    for angle in lying.table.angles:
        still = made_cell(fixturings={"up": lying.at(angle)}).reachability(PLAN, block)
        reached |= still.reached[:, 0]
    assert best.n_reached == reached.sum() > 1


BACK = LightBox.of("backlight:basler-back-200x300", pose((700.0, 0.0, 40.0)))


def lit_cell(*others):
    around = {"table": TABLE, "light": BACK, **dict(others)}
    return made_cell(fixturings={"up": Fixturing(pose((680.0, -20.0, 40.0)), around)})


def test_a_part_is_laid_on_its_backlight_in_one_way(block):
    found = propose_layings(PLAN, block, lit_cell(), "light", draws=40, rng=1)
    assert {len(way.layings) for way in found} == {1}
    for way in found:
        (lying,) = way.fixturings.values()
        # the table below the light is the old way's own
        assert "table" not in lying.obstacles
        assert lying.obstacles["light"] == BACK
        assert made_cell(fixturings=way.fixturings).light.name == BACK.name


def lit_plan(*settings, unlit=()):
    plan = plan_of(*settings)
    area = Backlight.horizontal((0.0, 0.0, -5.0), 200.0, 300.0)
    plan.light = SimpleNamespace(kind="backlight", area=area, unlit=[unlit] * len(settings))
    return plan


def test_a_setting_counts_only_with_the_backlight_behind_its_targets(block):
    # the edge is 60 mm long and 40 mm above the light, below this camera
    above = lit_plan(setting((30, 20, 330)))
    assert lit_cell().reachability(above, block).complete
    # from the side, the line of sight leaves the rectangle; without a backlight it would do
    aside = lit_plan(setting((40, -220, 85)))
    (told,) = lit_cell().reachability(aside, block).poses["up"]
    assert told.why == "the backlight is not behind edge"
    assert lit_cell().reachability(plan_of(*aside.settings), block).complete
    assert lit_cell().reachability(lit_plan(*aside.settings, unlit=("edge",)), block).complete
    # a plan for the backlight of this cell has decided what shows
    aside.light.area = light_of_cell(lit_cell())
    assert lit_cell().reachability(aside, block).complete


def test_nothing_may_stand_between_a_target_and_its_backlight(block):
    # the line of sight past the edge goes outwards, over the border of the part's hull
    slanted = lit_plan(setting((30, 130, 330)))
    assert lit_cell().reachability(slanted, block).complete
    bar = Box((600.0, -60.0, 41.0), (800.0, -25.0, 55.0))
    (told,) = lit_cell(("bar", bar)).reachability(slanted, block).poses["up"]
    assert told.why == "bar hides the backlight behind edge"


FILE = """
cam2flange = {{ xyz = [0, 0, 90] }}
[robot]
urdf = "{robots}/made_parallel.urdf"
packages = {{ made_robots = "{robots}" }}
[fixturings.up]
part2base = {{ xyz = [700, 0, 60] }}
axis = {{ point = [700, 0, 0], direction = [0, 0, 1] }}
angles_deg = [0, 90, 180]
turn_speed = 1.0
[fixturings.up.obstacles.drive]
mesh = "drive.stl"
[fixturings.up.turning.clamp]
low = [600, 0, 60]
high = [620, 20, 90]
[fixturings.up.light]
name = "backlight:basler-back-200x300"
pose = {{ xyz = [700, 0, 60] }}
"""


def test_the_file_of_a_proposal_is_its_cell(block, tmp_path):
    """A backlight is the plate of a turntable, and its drive is a mesh."""
    write_stl(tmp_path / "drive.stl", Box((650, -50, 0), (750, 50, 40)))
    path = tmp_path / "cell.toml"
    path.write_text(FILE.format(robots=ROBOTS), encoding="utf-8")
    cell = Cell.from_toml(path)
    best = propose_layings(PLAN, block, cell, "light", draws=20, rng=4)[0]
    (tmp_path / "away").mkdir()
    out = tmp_path / "away" / "laid.toml"
    content = laid_cell(path, best.fixturings, out.parent)
    out.write_text("\n".join(toml_lines(content)), encoding="utf-8")
    read = Cell.from_toml(out)
    ((name, lying),) = best.fixturings.items()
    again = read.fixturings[name]
    np.testing.assert_array_equal(again.part2base, lying.part2base)
    assert again.table.numbers == lying.table.numbers
    assert set(again.turning) == set(lying.turning)
    np.testing.assert_allclose(read.light.pose, cell.with_fixturings(best.fixturings).light.pose)
    reached = read.reachability(PLAN, block).reached
    np.testing.assert_array_equal(reached, best.reachability.reached)


def write_stl(path, body):
    corners = body.corners()
    lines = ["solid box"]
    for a, b, c in ConvexHull(corners).simplices:
        if np.linalg.det(corners[[a, b, c]] - corners.mean(axis=0)) < 0:
            b, c = c, b
        lines.append("facet normal 0 0 0\nouter loop")
        lines += [f"vertex {x} {y} {z}" for x, y, z in corners[[a, b, c]]]
        lines.append("endloop\nendfacet")
    path.write_text("\n".join([*lines, "endsolid box"]), encoding="utf-8")


def test_a_table_that_does_not_carry_the_part_is_refused(block):
    message = r"table must turn with the part.*'table'.*'plate', 'clamp'"
    with pytest.raises(RobotError, match=message):
        propose_layings(PLAN, block, turning_cell(), "table")
    tilted = turning_cell(axis=((700, 0, 0), (0, 0.6, 0.8)), angles=[0.0])
    with pytest.raises(RobotError, match="cell must have an upright turntable"):
        propose_layings(PLAN, block, tilted, "plate")


def test_a_tilted_table_is_refused(block):
    tilt = np.eye(4)
    tilt[:3, :3] = [[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]]
    tilted = Fixturing(pose((700.0, 0.0, 0.0)), {"table": Box((0, 0, -90), (9, 9, -80), tilt)})
    with pytest.raises(RobotError, match="table must have a level top"):
        propose_layings(PLAN, block, made_cell(fixturings={"up": tilted}), "table")


def test_posts_are_checked_where_they_are_stated():
    assert Posts((0.0, 80.0), 10.0).width_mm == 10.0


def test_plan_and_part_exchanged(block):
    with pytest.raises(RequestError, match=r"^solid must be a Solid\. Got "):
        made_cell().reachability(block, PLAN)
