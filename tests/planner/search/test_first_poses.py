"""Refinement from many starts: the choice of starts on hand-made data, and what refinement promises."""

from dataclasses import replace

import numpy as np
import pytest
from known_box import BoxSpace, Cells
from scipy.stats import chisquare, ks_2samp

from planner import Camera, PoseUncertainty, Search, SphereRegion, look_at
from planner.request.camera_limits import focus_reach_mm
from planner.request.constraints import Constraints, Requirements
from planner.request.models import Means
from planner.request.problem import Objective
from planner.search.poses import (
    _POOL,
    Ascent,
    PoseEncoding,
    ViewpointSampler,
    _least_violating,
    approach,
    best_apart,
    best_around,
    draw_start,
    refine,
    spread,
    turned_views,
)

CAMERA = Camera(25.0, (0.01, 0.013), (640, 480), 8.0, 300.0, largest_blur_mm=0.03)
PAPER = PoseUncertainty(np.diag([0.03] * 3 + [0.003] * 3))
NAMES = ["x00", "z00"]
NO_WALLS = np.empty((0, 4))


def request(names=NAMES, camera=CAMERA, **requirements):
    space = BoxSpace()
    constraints = Constraints(space, names, camera, Requirements(**requirements))
    objective = Objective(constraints.targets, Means(camera, PAPER, 0.98))
    sampler = ViewpointSampler(space.covering_cells(names), constraints.ends, camera)
    encoding = PoseEncoding(sampler.bounds, constraints.sphere_centre, camera.half_diagonal_rad)
    return constraints, objective, sampler, encoding


def feasible_poses(n, constraints, sampler, encoding, rng):
    poses = np.empty((0, 4, 4))
    while len(poses) < n:
        positions = sampler.sample(200, rng)
        drawn = encoding.poses(np.hstack([positions, encoding.draw_turns(len(positions), rng)]))
        poses = np.concatenate([poses, drawn[constraints.feasible(drawn)]])
    return poses[:n]


def test_positions_are_chosen_farthest_first():
    """On the line 0 1 2 10 14 from the first: 14, then 10 (4 from 14, 10 from 0) and not 2, then 2."""
    positions = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [10, 0, 0], [14, 0, 0]])
    centres, group = spread(positions, 3)
    assert centres == [0, 4, 3]
    assert group.tolist() == [0, 0, 0, 2, 1]
    assert spread(positions, 4)[0] == [0, 4, 3, 2]
    assert spread(positions[[0, 0, 0]], 3)[0] == [0]


def test_the_best_of_each_group_is_taken():
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, 0, 3] = [0, 1, 2, 10, 14]
    chosen = best_around(poses, np.array([0.5, 0.6, 0.4, 0.1, 0.2]), 3)
    # from the best, at 1: 14 is farthest, then 10
    assert chosen[:, 0, 3].tolist() == [1, 14, 10]
    assert len(best_around(poses, np.zeros(5), 0)) == 0


def test_neighbours_of_a_better_chromosome_are_passed_over():
    encoding = PoseEncoding([[0, 0, 0], [100, 100, 100]], [0, 0, 0], 0.5)
    middle = [50.0, 50, 50, 0, 0, 0]
    parameters = np.array([middle] * 4)
    parameters[1, 0] = 58.0
    parameters[2, 0] = 65.0
    parameters[3, 3] = 0.2
    bits = encoding.encode(parameters)
    chosen = best_apart(bits, np.array([0.9, 0.8, 0.7, 0.6]), encoding, 3)
    assert encoding.parameters(chosen)[:, 0] == pytest.approx([50, 65, 50], abs=0.01)
    assert np.array_equal(best_apart(bits, np.array([0.1, 0.8, 0.7, 0.6]), encoding, 1), bits[[1]])


def test_turned_views_lie_in_the_covering_domains_and_see_past_the_entities():
    constraints, _, sampler, encoding = request()
    poses = turned_views(12, sampler, encoding, np.random.default_rng(0))
    assert poses.shape == (12, 4, 4)
    assert (constraints.slacks(poses, ["visibility"])["visibility"] > 0).all()
    turns = np.abs(encoding.parameters_of(poses)[:, 3:5])
    assert turns.max() <= CAMERA.half_diagonal_rad / 2 + 1e-9
    assert turns.min(axis=0).max() > 0
    assert turned_views(0, sampler, encoding, np.random.default_rng(0)).shape == (0, 4, 4)


def test_refinement_is_never_worse_and_ends_feasible():
    constraints, objective, sampler, encoding = request()
    gains = []
    for pose in feasible_poses(12, constraints, sampler, encoding, np.random.default_rng(1)):
        better, fitness, nfev = refine(pose, sampler.cell_of(pose[:3, 3]), objective, constraints)
        assert constraints.feasible(better[None])[0]
        assert fitness == pytest.approx(objective.fitness(better[None])[0], abs=1e-12)
        gains.append(fitness - objective.fitness(pose[None])[0])
        assert nfev > 0
    assert min(gains) >= 0
    assert np.median(gains) > 0.001


def test_an_infeasible_pose_is_led_to_a_feasible_one():
    """Too near to be in focus, by 40 mm: the way leads back."""
    constraints, objective, *_ = request()
    target = constraints.sphere_centre
    away = np.array([-1.0, -1.0, -1.0]) / np.sqrt(3)
    near = look_at([target + 230.0 * away], target)[0]
    assert constraints.margins(near[None])["focus_mm"].min() < -20
    pose, fitness, _ = refine(near, NO_WALLS, objective, constraints)
    assert constraints.feasible(pose[None])[0]
    assert fitness == pytest.approx(objective.fitness(pose[None])[0])
    _, merit, _ = approach(near, NO_WALLS, objective, constraints, 20)
    assert merit == pytest.approx(fitness, abs=0.02)


def test_where_nothing_is_feasible_refinement_says_so():
    constraints, objective, *_ = request(min_length_px=2000)
    pose = look_at([[-200.0, -200.0, -200.0]], constraints.sphere_centre)[0]
    same, fitness, _ = refine(pose, NO_WALLS, objective, constraints)
    assert fitness == -np.inf
    assert np.array_equal(same, pose)
    end, merit, _ = approach(pose, NO_WALLS, objective, constraints, 8)
    assert merit < objective.fitness(end[None])[0] - 0.1


class Nearness:
    """A stand-in objective: the nearer to the part's middle, the better."""

    highest = 1.0
    ends = None

    def fitness(self, poses):
        return 1.0 - np.linalg.norm(poses[:, :3, 3] - [30.0, 20.0, 15.0], axis=1) / 1000


def test_a_clearance_left_out_at_first_is_kept_all_the_same():
    """With a deep lens, and from far away, the stand-off only matters at the end of the way."""
    deep = Camera(6.0, (0.01, 0.013), (2000, 1600), 16.0, 100.0, largest_blur_mm=0.03)
    (free, *_) = request(camera=deep, stand_off_mm=0.0)
    (held, *_) = request(camera=deep, stand_off_mm=73.0)
    away = np.array([[-1.0, -1.0, -1.0], [-1.0, -0.5, -1.0]])
    poses = look_at(
        free.sphere_centre + 190.0 * away / np.linalg.norm(away, axis=1)[:, None],
        free.sphere_centre,
    )
    assert held.margins(poses)["clearance_mm"].min() > 73
    ends = np.array([[refine(p, NO_WALLS, Nearness(), c)[0] for c in (free, held)] for p in poses])
    assert held.margins(ends[:, 0])["clearance_mm"].max() < 0
    assert held.feasible(ends[:, 1]).all()
    assert held.margins(ends[:, 1])["clearance_mm"].max() < 1


def test_known_poses_are_considered_and_the_best_is_kept():
    constraints, objective, sampler, encoding = request()
    poses = feasible_poses(5, constraints, sampler, encoding, np.random.default_rng(3))
    fitness = objective.fitness(poses)
    ascent = Ascent(sampler, encoding, objective, constraints, 2.0, poses[0], fitness[0])
    ascent.consider(poses[1:])
    assert ascent.fitness == fitness.max()
    assert np.array_equal(ascent.cam2world, poses[fitness.argmax()])
    ascent.climb(poses[:2])
    ascent.mirror()
    assert ascent.fitness > fitness.max()
    assert ascent.fitness == pytest.approx(objective.fitness(ascent.cam2world[None])[0])
    assert constraints.feasible(ascent.cam2world[None])[0]
    # nothing is done where nothing better is asked for
    enough = Ascent(sampler, encoding, objective, constraints, 0.0, poses[0], fitness[0])
    enough.climb(poses)
    enough.mirror()
    assert (enough.nfev, enough.fitness) == (0, fitness[0])


class Valley:
    """A stand-in objective with an optimum on either side of the straight view, the one with positive tilt better."""

    highest = 1.0
    ends = None

    def __init__(self, encoding):
        self.encoding = encoding

    def fitness(self, poses):
        tilt = self.encoding.parameters_of(poses)[:, 4]
        return 0.5 + 20 * tilt**2 - 600 * tilt**4 + 0.2 * tilt


def test_the_other_side_of_the_straight_view_is_tried():
    """The optima of 20 t² − 600 t⁴ + 0.2 t are near t = ±√(1/60) = ±0.129; from −0.1, refinement ends at −0.127."""
    constraints, _, sampler, encoding = request(names=["x00"])
    valley = Valley(encoding)
    parameters = np.hstack(
        [sampler.sample(200, np.random.default_rng(4)), np.tile([0.0, -0.1, 0.0], (200, 1))]
    )
    poses = encoding.poses(parameters)
    pose = poses[constraints.feasible(poses)][0]
    ascent = Ascent(
        sampler, encoding, valley, constraints, 1.0, pose, valley.fitness(pose[None])[0]
    )
    ascent.climb(pose[None])
    assert encoding.parameters_of(ascent.cam2world[None])[0, 4] == pytest.approx(-0.127, abs=0.02)
    ascent.mirror()
    assert encoding.parameters_of(ascent.cam2world[None])[0, 4] > 0


def test_the_plain_searches_refine_nothing():
    assert not Search.genetic().refines
    assert not Search.paper().refines
    assert Search(refine_starts=0, spread_starts=0).refines


BOUNDS = np.array([[-100.0, -50.0, 200.0], [300.0, 60.0, 210.0]])
CAMERA_POSE_BITS = Camera(25.0, (0.01, 0.013), (640, 480), 8.0, 600.0, largest_blur_mm=0.02)


@pytest.mark.parametrize("gray", [True, False])
def test_decoding_the_encoding_is_within_half_a_step(gray):
    encoding = PoseEncoding(BOUNDS, [0, 0, 0], 0.3, gene_bits=12, gray=gray)
    rng = np.random.default_rng(0)
    parameters = rng.uniform(encoding.low, encoding.high, (500, 6))
    bits = encoding.encode(parameters)
    assert bits.shape == (500, 72)
    step = (encoding.high - encoding.low) / (2**12 - 1)
    assert np.all(np.abs(encoding.parameters(bits) - parameters) <= step / 2 * (1 + 1e-9))
    assert np.array_equal(encoding.encode(encoding.parameters(bits)), bits)


def test_genes_by_hand():
    """Two bits per gene in plain binary: 0, 1/3, 2/3 and 1 of each range."""
    encoding = PoseEncoding([[0, 0, 0], [3, 6, 9]], [0, 0, 0], 0.3, gene_bits=2, gray=False)
    bits = np.array([[0, 0, 0, 1, 1, 0, 1, 1, 0, 1, 1, 0]], dtype=bool)
    assert encoding.parameters(bits)[0] == pytest.approx([0, 2, 6, 0.3, -0.1, np.pi / 3])


def test_poses_look_at_the_target_and_turn():
    encoding = PoseEncoding(BOUNDS, [5, 5, 5], 0.3)
    parameters = np.array([[10.0, 20.0, 205.0, 0.0, 0.0, 0.0], [10.0, 20.0, 205.0, 0.2, -0.1, 1.0]])
    straight, turned = encoding.poses(parameters)
    towards = np.array([5, 5, 5]) - [10, 20, 205]
    assert straight[:3, 2] == pytest.approx(towards / np.linalg.norm(towards))
    assert turned == pytest.approx(
        look_at([[10.0, 20.0, 205.0]], [5, 5, 5], [0.2], [-0.1], [1.0])[0]
    )
    assert np.arccos(turned[:3, 2] @ straight[:3, 2]) == pytest.approx(
        np.arccos(np.cos(0.2) * np.cos(0.1))
    )


def test_values_outside_the_range_are_clipped():
    encoding = PoseEncoding(BOUNDS, [0, 0, 0], 0.3)
    outside = np.array([[1e6, -1e6, 205.0, 9.0, -9.0, 0.0]])
    assert encoding.parameters(encoding.encode(outside))[0, [0, 1, 3, 4]] == pytest.approx(
        [300, -50, 0.3, -0.3]
    )


def space_and_ends(names=("x00",), **options):
    space = BoxSpace(**options)
    return space, np.array([space.entities[name].endpoints for name in names])


def shell_limits(camera=CAMERA_POSE_BITS):
    nearest, farthest = camera.depth_of_field_mm
    return nearest, farthest / np.cos(camera.half_diagonal_rad)


@pytest.mark.parametrize("names", [["x00"], ["x00", "z00", "y00"], ["x00", "x11"]])
@pytest.mark.parametrize("half_width", [620.0, 5000.0])
def test_every_viewpoint_sees_all_entities_from_a_focusable_distance(names, half_width):
    space, ends = space_and_ends(names, reach=half_width)
    sampler = ViewpointSampler(space.covering_cells(names), ends, CAMERA_POSE_BITS)
    positions = sampler.sample(500, np.random.default_rng(0))
    assert len(positions) == 500
    assert space.observable(positions, names).all()
    distance = np.linalg.norm(positions[:, None] - ends.reshape(-1, 3), axis=-1)
    near, far = shell_limits()
    assert distance.min() >= near * (1 - 1e-12)
    assert distance.max() <= far * (1 + 1e-12)
    assert np.all((positions >= sampler.bounds[0]) & (positions <= sampler.bounds[1]))


def test_the_shell_excludes_no_feasible_pose():
    """Any pose with every end in focus and in the image has all ends at distances the shell allows."""
    space, ends = space_and_ends(["x00", "z00"])
    constraints = Constraints(
        space, ["x00", "z00"], CAMERA_POSE_BITS, Requirements(min_length_px=0)
    )
    sampler = ViewpointSampler(space.covering_cells(["x00", "z00"]), ends, CAMERA_POSE_BITS)
    rng = np.random.default_rng(3)
    positions = rng.uniform(-700, 700, (40_000, 3))
    poses = look_at(positions, [20, 0, 10], *rng.uniform(-0.3, 0.3, (2, 40_000)))
    margins = constraints.margins(poses)
    ok = (margins["focus_mm"].min(axis=1) >= 0) & (margins["field_of_view_px"].min(axis=1) >= 0)
    assert ok.sum() > 30
    assert sampler.in_shell(positions[ok]).all()


def test_the_shell_lies_around_ends_that_surround_no_box_centre():
    """The middle of the box around a corner of a cube is outside the simplex: farther from some places than any end."""
    simplex = 300.0 * np.array([[[0, 0, 0], [1, 0, 0]], [[0, 1, 0], [0, 0, 1]]])
    sampler = ViewpointSampler(three_cells(), simplex, CAMERA_POSE_BITS)
    near, far = shell_limits()
    positions = np.random.default_rng(4).uniform(-700, 700, (100_000, 3))
    distance = np.linalg.norm(positions[:, None] - simplex.reshape(-1, 3), axis=-1)
    expected = (distance.min(axis=1) >= near) & (distance.max(axis=1) <= far)
    assert expected.any()
    assert np.array_equal(sampler.in_shell(positions), expected)


def three_cells():
    return Cells(
        [
            [[-700, -700, -700], [0, 700, 700]],
            [[0, -700, 0], [700, 700, 700]],
            [[-9000] * 3, [-8000] * 3],
        ]
    )


def test_the_ways_to_propose_draw_from_the_same_distribution():
    """Counts in the octants must agree with counts of plain rejection from a large box."""
    _, ends = space_and_ends()
    cells = three_cells()
    sampler = ViewpointSampler(cells, ends, CAMERA_POSE_BITS)
    rng = np.random.default_rng(11)
    plain = rng.uniform(-700, 700, (400_000, 3))
    plain = plain[cells.contains(plain) & sampler.in_shell(plain)]

    def octants(points):
        return np.bincount(((points > 10) @ [1, 2, 4]), minlength=8)

    expected = octants(plain)
    for proposal in ("cells", "shell", "shells", "boxes", "halved boxes"):
        if proposal == "halved boxes":
            sampler._halve_boxes()
        sampler.proposal = proposal.split()[-1]
        drawn = octants(sampler.sample(6000, rng))
        assert drawn.sum() == 6000
        scaled = expected / expected.sum() * 6000
        kept = scaled > 20
        assert drawn[~kept].sum() < 100
        frequency = scaled[kept] / scaled[kept].sum() * drawn[kept].sum()
        assert chisquare(drawn[kept], frequency).pvalue > 1e-3, proposal


def test_viewpoints_in_two_thin_shells_are_even_in_both_distances():
    """Against plain rejection from a box: distances from both ends, and two coordinates."""
    camera = replace(CAMERA_POSE_BITS, f_number=1.4)
    ends = np.array([[[-30.0, 5.0, 2.0], [35.0, -4.0, 8.0]]])
    cells = three_cells()
    sampler = ViewpointSampler(cells, ends, camera)
    assert sampler.proposal == "shells"
    rng = np.random.default_rng(12)
    far = sampler.far
    plain = rng.uniform(-far - 35.0, far + 35.0, (3_000_000, 3))
    plain = plain[sampler.in_shell(plain)]
    plain = plain[cells.contains(plain)]
    drawn = sampler.sample(6000, rng)
    assert len(plain) > 1000
    assert sampler.in_shell(drawn).all()

    def measures(points):
        distances = np.linalg.norm(points[:, None] - ends[0], axis=-1).T
        return [*distances, points[:, 0], points[:, 2]]

    for ours, theirs in zip(measures(drawn), measures(plain), strict=True):
        assert ks_2samp(ours, theirs).pvalue > 1e-3


def test_cells_from_which_one_end_is_too_near_are_found_empty_without_many_proposals():
    """Seen along a line, both of its ends cannot be in focus where it is longer than the depth of field."""
    camera = replace(CAMERA_POSE_BITS, f_number=1.4)
    near, far = focus_reach_mm(camera)
    length = 1.1 * (far - near)
    ends = np.array([[[0.0, 0.0, 0.0], [length, 0.0, 0.0]]])
    distance = (near + far) / 2.0
    along = Cells([[[distance - 80.0, -120.0, -120.0], [distance + 80.0, 120.0, 120.0]]])
    sampler = ViewpointSampler(along, ends, camera)
    assert not sampler.empty
    assert sampler.sample(1, np.random.default_rng(0)).shape == (0, 3)
    assert sampler.empty
    across = Cells([[[-30.0, -30.0, distance - 80.0], [30.0, 30.0, distance + 80.0]]])
    sampler = ViewpointSampler(across, ends, camera)
    sampler._halve_boxes()
    assert not sampler.empty
    assert sampler.in_shell(sampler.sample(100, np.random.default_rng(0))).all()


def test_cell_of_returns_the_half_spaces_around_a_viewpoint():
    _, ends = space_and_ends()
    sampler = ViewpointSampler(three_cells(), ends, CAMERA_POSE_BITS)
    planes = sampler.cell_of(np.array([-600.0, 0.0, 0.0]))
    assert (planes[:, :3] @ [-600.0, 0.0, 0.0] + planes[:, 3] <= 0).all()
    assert (planes[:, :3] @ [1.0, 0.0, 0.0] + planes[:, 3] > 0).any()
    assert sampler.cell_of(np.array([600.0, 0.0, -600.0])) is None


def test_cells_that_are_all_too_near_or_too_far_are_empty():
    _, ends = space_and_ends()
    near = Cells([[[-300] * 3, [0] * 3]])
    far = Cells([[[2000] * 3, [3000] * 3]])
    for cells in (near, far, Cells([])):
        sampler = ViewpointSampler(cells, ends, CAMERA_POSE_BITS)
        assert sampler.empty
        assert sampler.sample(10, np.random.default_rng(0)).shape == (0, 3)


@pytest.mark.parametrize(
    "names", [["x00"], ["x00", "z00", "y00"], ["x11", "y11", "z11", "x01", "y10"]]
)
def test_the_first_population_is_feasible_and_inside_the_covering_domains(names):
    space, ends = space_and_ends(names)
    constraints = Constraints(space, names, CAMERA_POSE_BITS, Requirements())
    cells = space.covering_cells(names)
    sampler = ViewpointSampler(cells, ends, CAMERA_POSE_BITS)
    encoding = PoseEncoding(
        sampler.bounds, constraints.sphere_centre, CAMERA_POSE_BITS.half_diagonal_rad
    )
    start = draw_start(100, sampler, encoding, constraints, np.random.default_rng(0))
    assert start.bits.shape == (100, 96)
    poses = encoding.decode(start.bits)
    assert cells.contains(poses[:, :3, 3]).all()
    assert constraints.feasible(poses).all()


def test_repair_finds_poses_that_draws_do_not():
    """A reachable ball of 8 mm radius: draws hardly ever hit it."""
    space, ends = space_and_ends(["x00"])
    spot = np.array([20.0, -450.0, -400.0])
    requirements = Requirements(reach=SphereRegion(spot, 8.0))
    constraints = Constraints(space, ["x00"], CAMERA_POSE_BITS, requirements)
    sampler = ViewpointSampler(space.covering_cells(["x00"]), ends, CAMERA_POSE_BITS)
    encoding = PoseEncoding(
        sampler.bounds, constraints.sphere_centre, CAMERA_POSE_BITS.half_diagonal_rad
    )
    start = draw_start(20, sampler, encoding, constraints, np.random.default_rng(0), max_draws=2048)
    assert start.feasible_drawn < 5
    assert len(start.bits) == 20
    poses = encoding.decode(start.bits)
    assert constraints.feasible(poses).all()
    assert np.all(np.linalg.norm(poses[:, :3, 3] - spot, axis=1) <= 8)


def test_parameters_of_poses_are_the_parameters_they_were_made_of():
    encoding = PoseEncoding(BOUNDS, [0, 0, 0], 0.3)
    parameters = np.random.default_rng(2).uniform(encoding.low, encoding.high, (200, 6))
    assert encoding.parameters_of(encoding.poses(parameters)) == pytest.approx(parameters, abs=1e-9)
    assert encoding.parameters_of(np.empty((0, 4, 4))).shape == (0, 6)


def test_the_least_violating_are_those_of_a_whole_sort():
    space, _ = space_and_ends(["x00", "y00"])
    constraints = Constraints(space, ["x00", "y00"], CAMERA_POSE_BITS, Requirements())
    encoding = PoseEncoding(
        [[-600.0] * 3, [700.0] * 3], constraints.sphere_centre, CAMERA_POSE_BITS.half_diagonal_rad
    )
    parameters = np.random.default_rng(4).uniform(encoding.low, encoding.high, (3000, 6))
    violation = constraints.violation(encoding.poses(parameters))
    assert (constraints.violation(encoding.poses(parameters), images_only=True) <= violation).all()
    whole = parameters[np.argsort(violation, kind="stable")[:_POOL]]
    assert np.array_equal(_least_violating(parameters, encoding, constraints), whole)
    few = parameters[:5]
    assert np.array_equal(
        _least_violating(few, encoding, constraints),
        few[np.argsort(violation[:5], kind="stable")],
    )
