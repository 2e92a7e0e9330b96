import numpy as np
import pytest
from known_box import BoxSpace, Cells
from scipy.stats import chisquare

from planner import Camera, SphereRegion
from planner.camera.pose import look_at
from planner.request.constraints import Constraints, Requirements
from planner.search.poses import _POOL, PoseEncoding, ViewpointSampler, _least_violating, draw_start

BOUNDS = np.array([[-100.0, -50.0, 200.0], [300.0, 60.0, 210.0]])
CAMERA = Camera(25.0, (0.01, 0.013), (640, 480), 8.0, 600.0, largest_blur_mm=0.02)


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


def shell_limits(camera=CAMERA):
    nearest, farthest = camera.depth_of_field_mm
    return nearest, farthest / np.cos(camera.half_diagonal_rad)


@pytest.mark.parametrize("names", [["x00"], ["x00", "z00", "y00"], ["x00", "x11"]])
@pytest.mark.parametrize("half_width", [620.0, 5000.0])
def test_every_viewpoint_sees_all_entities_from_a_focusable_distance(names, half_width):
    space, ends = space_and_ends(names, reach=half_width)
    sampler = ViewpointSampler(space.covering_cells(names), ends, CAMERA)
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
    constraints = Constraints(space, ["x00", "z00"], CAMERA, Requirements(min_length_px=0))
    sampler = ViewpointSampler(space.covering_cells(["x00", "z00"]), ends, CAMERA)
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
    sampler = ViewpointSampler(three_cells(), simplex, CAMERA)
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


def test_the_three_ways_to_propose_draw_from_the_same_distribution():
    """Counts in the octants must agree with counts of plain rejection from a large box."""
    _, ends = space_and_ends()
    cells = three_cells()
    sampler = ViewpointSampler(cells, ends, CAMERA)
    rng = np.random.default_rng(11)
    plain = rng.uniform(-700, 700, (400_000, 3))
    plain = plain[cells.contains(plain) & sampler.in_shell(plain)]

    def octants(points):
        return np.bincount(((points > 10) @ [1, 2, 4]), minlength=8)

    expected = octants(plain)
    for proposal in ("cells", "shell", "boxes"):
        sampler.proposal = proposal
        drawn = octants(sampler.sample(6000, rng))
        assert drawn.sum() == 6000
        scaled = expected / expected.sum() * 6000
        kept = scaled > 20
        assert drawn[~kept].sum() < 100
        frequency = scaled[kept] / scaled[kept].sum() * drawn[kept].sum()
        assert chisquare(drawn[kept], frequency).pvalue > 1e-3, proposal


def test_cell_of_returns_the_half_spaces_around_a_viewpoint():
    _, ends = space_and_ends()
    sampler = ViewpointSampler(three_cells(), ends, CAMERA)
    planes = sampler.cell_of(np.array([-600.0, 0.0, 0.0]))
    assert (planes[:, :3] @ [-600.0, 0.0, 0.0] + planes[:, 3] <= 0).all()
    assert (planes[:, :3] @ [1.0, 0.0, 0.0] + planes[:, 3] > 0).any()
    assert sampler.cell_of(np.array([600.0, 0.0, -600.0])) is None


def test_cells_that_are_all_too_near_or_too_far_are_empty():
    _, ends = space_and_ends()
    near = Cells([[[-300] * 3, [0] * 3]])
    far = Cells([[[2000] * 3, [3000] * 3]])
    for cells in (near, far, Cells([])):
        sampler = ViewpointSampler(cells, ends, CAMERA)
        assert sampler.empty
        assert sampler.sample(10, np.random.default_rng(0)).shape == (0, 3)


@pytest.mark.parametrize(
    "names", [["x00"], ["x00", "z00", "y00"], ["x11", "y11", "z11", "x01", "y10"]]
)
def test_the_first_population_is_feasible_and_inside_the_covering_domains(names):
    space, ends = space_and_ends(names)
    constraints = Constraints(space, names, CAMERA, Requirements())
    cells = space.covering_cells(names)
    sampler = ViewpointSampler(cells, ends, CAMERA)
    encoding = PoseEncoding(sampler.bounds, constraints.sphere_centre, CAMERA.half_diagonal_rad)
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
    constraints = Constraints(space, ["x00"], CAMERA, requirements)
    sampler = ViewpointSampler(space.covering_cells(["x00"]), ends, CAMERA)
    encoding = PoseEncoding(sampler.bounds, constraints.sphere_centre, CAMERA.half_diagonal_rad)
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
    constraints = Constraints(space, ["x00", "y00"], CAMERA, Requirements())
    encoding = PoseEncoding(
        [[-600.0] * 3, [700.0] * 3], constraints.sphere_centre, CAMERA.half_diagonal_rad
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
