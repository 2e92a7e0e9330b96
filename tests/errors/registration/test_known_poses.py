"""What registration will leave unknown of a pose, against a direct computation with projected points."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from errors.registration import Imaging, Stretches, Values, known_poses

PRIOR = np.diag([0.2, 0.3, 0.4, 0.001, 0.002, 0.003]) ** 2
PRIOR[0, 4] = PRIOR[4, 0] = 0.5 * 0.2 * 0.002
IMAGING = Imaging(
    (2000.0, 2100.0),
    (600.0, 500.0),
    (1200.0, 1000.0),
    (1 / 300, 1e-3, 3.0),
    0.2,
    4.0,
    0.15,
    0.0,
    0.5,
    6.0,
    0.6,
)
POSE = np.eye(4)
POSE[:3, :3] = Rotation.from_euler("xyz", [0.2, -0.1, 0.3]).as_matrix()
POSE[:3, 3] = [3.0, -4.0, 300.0]
SURFACES = 4
NOTHING = Values(
    np.zeros(0, dtype=np.int64),
    np.zeros((0, 1, 6)),
    np.zeros((0, 1, 2), dtype=np.int64),
    np.zeros((0, 1, 2, 3, 6)),
)


def stretches(**more):
    """Five edges of three stretches each, on four surfaces; two edges are round."""
    rng = np.random.default_rng(4)
    m = 15
    tangents = rng.normal(size=(m, 3))
    made = Stretches(
        rng.uniform(-30, 30, (m, 3)),
        tangents / np.linalg.norm(tangents, axis=1, keepdims=True),
        rng.uniform(5.0, 9.0, m),
        rng.normal(size=(m, 3, 6)),
        np.repeat(np.arange(5), 3),
        np.tile([1 / 6, 1 / 2, 5 / 6], 5),
        np.array([0.0, 2.0, 0.0, 2 * np.pi, 0.0]),
        np.array([[0, 1], [1, 2], [2, 0], [0, 2], [1, 0]]),
        np.ones((m, 4, 4), dtype=bool),
        np.eye(3),
        rng.uniform(0.01, 0.05, (SURFACES, 3)),
    )
    return made._replace(**more)


def moved(x):
    """World to camera after a displacement of the camera in its own frame."""
    step = np.eye(4)
    step[:3, :3] = Rotation.from_rotvec(x[3:]).as_matrix()
    step[:3, 3] = x[:3]
    return np.linalg.inv(np.linalg.inv(POSE) @ step)


def images(points, pose):
    local = points @ pose[:3, :3].T + pose[:3, 3]
    return local[:, :2] / local[:, 2:] * IMAGING.focal_px + IMAGING.centre_px


def difference(function, at, step):
    """Columns of derivatives by difference quotients."""
    steps = np.diag(step)
    return np.stack([(function(at + s) - function(at - s)) / (2 * s.sum()) for s in steps], axis=-1)


def biased(span):
    """Covariance of three points of an edge by biases of one: of all, and of its ends or its sides."""
    if span:
        angle = span * np.array([1 / 6, 1 / 2, 5 / 6])
        return 1.0 + 0.25 * np.cos(angle[:, None] - angle)
    ends = np.array([-1.0, 0.0, 1.0])
    return 1.0 + 0.25 * np.outer(ends, ends)


def information(known):
    """Return what the edges tell, from projected points, and the unknowns' covariance before."""
    size = 6 + 3 * SURFACES
    before = np.zeros((size, size))
    before[:6, :6] = PRIOR
    before[6:, 6:] = np.diag(known.sigmas.ravel() ** 2)
    total = np.zeros((size, size))
    here = images(known.points, POSE)
    along = images(known.points + 1e-4 * known.tangents, POSE) - here
    px = np.linalg.norm(along, axis=1) / 1e-4
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(
        along, axis=1, keepdims=True
    )
    depth = (known.points @ POSE[:3, :3].T + POSE[:3, 3])[:, 2]
    blur = np.maximum(np.abs(1 / depth - IMAGING.focus[0]) / IMAGING.focus[1], 1.0)
    by_pose = difference(
        lambda x: images(known.points, moved(x)), np.zeros(6), [1e-3] * 3 + [1e-6] * 3
    )
    for edge, pair in enumerate(known.surfaces):
        own = known.edge == edge
        slots = np.concatenate([np.arange(6), *(6 + 3 * k + np.arange(3) for k in pair)])

        def shifted(s, own=own):
            return images(known.points[own] + known.moves[own] @ s, POSE)

        rows = np.concatenate([by_pose[own], difference(shifted, np.zeros(6), [1e-3] * 6)], axis=2)
        rows = np.einsum("mi,mik->mk", across[own], rows)
        length = px[own] * known.lengths[own]
        left = (length.sum() - 2 * IMAGING.end_px) / length.sum()
        variance = IMAGING.correlation_px * IMAGING.noise_px**2 * blur[own] ** 3 / (left * length)
        noise = np.diag(variance) + IMAGING.bias_px**2 * biased(known.spans[edge])
        total[np.ix_(slots, slots)] += IMAGING.share * rows.T @ np.linalg.inv(noise) @ rows
    return total, before


def test_covariances_are_those_of_projected_points():
    known = stretches()
    total, before = information(known)
    covariance = np.linalg.inv(np.linalg.inv(before) + total)
    found = known_poses(POSE[None], PRIOR, known, IMAGING, NOTHING)
    np.testing.assert_allclose(found.covariance[0], covariance[:6, :6], rtol=2e-5, atol=1e-12)
    np.testing.assert_allclose(
        found.root[0] @ found.root[0].T, found.covariance[0], rtol=1e-12, atol=1e-18
    )


def test_variance_of_a_value_whose_entities_move_with_surfaces():
    known = stretches()
    rng = np.random.default_rng(8)
    gradient = rng.normal(size=(2, 6)) * ([1.0] * 3 + [300.0] * 3)
    # a surface that no edge lies on, and one that both entities move with
    surfaces = np.array([[0, 3], [2, 0]])
    motions = rng.normal(size=(2, 2, 3, 6)) * ([1.0] * 3 + [0.01] * 3)
    total, before = information(known)
    covariance = np.linalg.inv(np.linalg.inv(before) + total)
    g = np.zeros(len(covariance))
    g[:6] = gradient.sum(axis=0)
    for e in range(2):
        for side in range(2):
            for j in range(3):
                motion = motions[e, side, j] * 1e-5
                body = np.eye(4)
                body[:3, :3] = Rotation.from_rotvec(motion[3:]).as_matrix()
                body[:3, 3] = motion[:3]
                # the entity moves: as if the camera moved the other way
                step = POSE @ np.linalg.inv(body) @ np.linalg.inv(POSE)
                shift = np.concatenate(
                    [step[:3, 3], Rotation.from_matrix(step[:3, :3]).as_rotvec()]
                )
                g[6 + 3 * surfaces[e, side] + j] += gradient[e] @ shift / 1e-5
    values = Values(np.zeros(1, dtype=np.int64), gradient[None], surfaces[None], motions[None])
    found = known_poses(POSE[None], PRIOR, known, IMAGING, values)
    assert found.variance[0] == pytest.approx(g @ covariance @ g, rel=1e-4)
    assert found.by_pose[0] == pytest.approx(g[:6] @ covariance[:6, :6] @ g[:6], rel=1e-4)


@pytest.mark.parametrize(
    "less",
    [
        {"free": np.zeros((15, 4, 4), dtype=bool)},
        {
            "points": np.tile([0.0, 0.0, 0.0], (15, 1)),
            "tangents": np.tile([1.0, 0.0, 0.0], (15, 1)),
        },
        {"points": np.tile([0.0, 0.0, -180.0], (15, 1))},
        {"points": np.tile([500.0, 0.0, 0.0], (15, 1))},
        {"lengths": np.full(15, 0.1)},
    ],
    ids=["hidden", "another line near", "out of focus", "out of the image", "short"],
)
def test_what_an_image_does_not_show_tells_nothing(less):
    found = known_poses(POSE[None], PRIOR, stretches(**less), IMAGING, NOTHING)
    np.testing.assert_allclose(found.covariance[0], PRIOR, rtol=1e-9, atol=1e-18)


def test_surfaces_of_which_nothing_is_known_tell_nothing_of_the_pose():
    known = stretches()
    wide = known._replace(sigmas=np.full((SURFACES, 3), 1e5))
    well = known_poses(POSE[None], PRIOR, known, IMAGING, NOTHING).covariance[0]
    badly = known_poses(POSE[None], PRIOR, wide, IMAGING, NOTHING).covariance[0]
    assert np.linalg.eigvalsh(badly - well).min() > -1e-12
    assert badly.trace() > 1.5 * well.trace()
