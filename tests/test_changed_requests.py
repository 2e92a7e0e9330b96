"""What must follow when a request is changed: no known answers, but relations that hold for every part."""

import numpy as np
import pytest

from aspectgraph import compute_regions, read_solid
from errors import success_probability
from planner import Camera, PoseUncertainty, plan_setting

RIM = {"e1": [[60, 20, 10], [60, 40, 10]], "e4": [[20, 60, 10], [40, 60, 10]]}
BOX = np.array([[-300.0] * 3, [300.0] * 3])
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


@pytest.fixture(scope="module")
def block(request):
    return read_solid(request.config.rootpath / "examples/two_pocket_block.off")


def with_boxes(solid, boxes, path):
    """The part and boxes (low, high) beside it, as one solid."""
    vertices = solid.vertices.tolist()
    faces = solid.triangles.tolist()
    for low, high in boxes:
        first = len(vertices)
        vertices += [
            [(low, high)[i][0], (low, high)[j][1], (low, high)[k][2]]
            for i, j, k in np.ndindex(2, 2, 2)
        ]
        faces += [[first + v for v in quad] for quad in QUADS]
    lines = [f"OFF\n{len(vertices)} {len(faces)} 0", *(" ".join(map(str, one)) for one in vertices)]
    path.write_text(
        "\n".join([*lines, *(f"{len(face)} {' '.join(map(str, face))}" for face in faces)])
    )
    return read_solid(path)


def test_more_that_stands_in_the_way_never_enlarges_a_region(block, tmp_path):
    """Also: what is observable before and not after is hidden by a box, for one that is not hidden stays."""
    rng = np.random.default_rng(0)
    points = rng.uniform(*BOX, (4000, 3))
    boxes = [
        ((100, 10, 0), (110, 50, 60)),
        ((10, 120, -20), (60, 130, 80)),
        ((80, 80, 40), (120, 120, 50)),
    ]
    before = compute_regions(block, RIM, BOX).observable(points)
    for n in range(1, len(boxes) + 1):
        after = compute_regions(
            with_boxes(block, boxes[:n], tmp_path / f"{n}.off"), RIM, BOX
        ).observable(points)
        assert not (after & ~before).any()
        assert (before & ~after).any()
        before = after


@pytest.mark.parametrize("seed", range(4))
def test_a_less_certain_pose_never_makes_a_length_more_certain(seed):
    """Of a density that is symmetric and falls to both sides, widening takes from every interval about 0 (Anderson)."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(250, 600)
    length = rng.uniform(20, 80)
    tilt = rng.uniform(-0.5, 0.5)
    way = length / 2 * np.array([np.cos(tilt), np.sin(tilt), 0.0])
    edge = np.array([0.0, 0.0, 25.0 - depth]) + np.array([-way, way])
    covariance = PoseUncertainty.isotropic(translation_mm=0.1, rotation_rad=0.001).covariance
    found = [
        float(
            success_probability(
                edge,
                focal_length_mm=25.0,
                pixel_pitch_mm=(0.00345, 0.00345),
                pose_covariance=scale * covariance,
                accuracy=0.99,
            )
        )
        for scale in (0.1, 1.0, 10.0, 100.0, 1000.0, 4000.0)
    ]
    assert (np.diff(found) <= 1e-6).all()
    assert found[0] - found[-1] > 0.01


@pytest.mark.parametrize("seed", range(2))
def test_more_to_measure_at_once_never_makes_one_more_certain(block, seed):
    """The best pose for two edges is a pose for one; the search is one of chance, so a little is allowed for."""
    camera = Camera(8.0, (0.00345, 0.00345), (2448, 2048), 8.0, 300.0)
    uncertainty = PoseUncertainty.isotropic(translation_mm=0.3, rotation_rad=0.003)
    space = compute_regions(block, RIM, BOX)
    both = plan_setting(space, list(RIM), camera, uncertainty, accuracy=0.98, rng=seed).probability
    for name in RIM:
        alone = plan_setting(
            space, [name], camera, uncertainty, accuracy=0.98, rng=seed
        ).probability[name]
        assert both[name] <= alone + 0.01
