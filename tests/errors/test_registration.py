"""The joint posterior against a direct computation with a covariance of all rows."""

import math

import numpy as np
import pytest
import scipy.linalg
from scipy.spatial.transform import Rotation

from errors.checks import chi_squared_quantile
from errors.registration import (
    Imaging,
    Rows,
    Stretches,
    Values,
    bias_variance_of,
    known_poses,
    posterior,
    rests_on_prior,
    surprise,
    undetermined,
    variance_by_input,
)


def example(rng, n=5, groups=3, m=7):
    prior = np.diag(rng.uniform(0.5, 2.0, n)) + 0.1
    truth = rng.normal(size=n)
    rows = []
    for _ in range(groups):
        unknowns = np.sort(rng.choice(n, 3, replace=False))
        design = rng.normal(size=(m, 3))
        residual = design @ truth[unknowns] + rng.normal(size=m)
        rows.append(Rows(unknowns, design, residual, rng.uniform(0.5, 3.0, m)))
    return prior, rows


@pytest.mark.parametrize("bias", [0.0, 0.3])
def test_against_the_covariance_of_all_rows(bias):
    """Kalman's form, mean P Aᵀ S⁻¹ r and covariance P − P Aᵀ S⁻¹ A P, with the biases inside S."""
    prior, rows = example(np.random.default_rng(3))
    design = np.zeros((21, 5))
    noise = np.zeros((21, 21))
    for k, group in enumerate(rows):
        own = slice(7 * k, 7 * k + 7)
        design[own, group.unknowns] = group.design
        noise[own, own] = np.diag(1 / group.weight) + bias
    gain = prior @ design.T @ np.linalg.inv(design @ prior @ design.T + noise)
    found = posterior(prior, rows, bias)
    right = np.concatenate([group.residual for group in rows])
    np.testing.assert_allclose(found.mean, gain @ right, atol=1e-10)
    np.testing.assert_allclose(found.covariance, prior - gain @ design @ prior, atol=1e-10)


def test_variance_of_a_value_by_input_against_drawn_errors():
    """Pose, surfaces and rows are drawn one at a time, and estimated; the estimate is off by their part."""
    rng = np.random.default_rng(7)
    prior = scipy.linalg.block_diag([[1.0, 0.6], [0.6, 2.0]], 0.5, 1.5)
    design = rng.normal(size=(9, 4))
    weight = rng.uniform(0.5, 3.0, 9)
    gradient = np.array([1.0, -0.5, 1.0, -1.0])
    row = Rows(np.arange(4), design, np.zeros(9), weight)
    covariance = posterior(prior, [row], 0.0).covariance
    parts = variance_by_input(covariance, prior, gradient, 2)
    x = rng.multivariate_normal(np.zeros(4), prior, size=40000)
    noise = rng.normal(size=(40000, 9)) / np.sqrt(weight)
    pose = x * [1, 1, 0, 0]
    surfaces = x * [0, 0, 1, 1]
    gain = covariance @ (design.T * weight)
    for part, truth, off in ((0, pose, 0), (1, surfaces, 0), (2, 0 * x, noise)):
        errors = ((truth @ design.T + off) @ gain.T - truth) @ gradient
        assert np.mean(errors**2) == pytest.approx(parts[part], rel=0.03)
    assert sum(parts) == pytest.approx(gradient @ covariance @ gradient)
    # without rows, all is as before
    before = variance_by_input(prior, prior, gradient, 2)
    assert before == pytest.approx((1.0 - 0.6 + 0.5, 2.0, 0.0))


def test_nothing_found_leaves_the_prior():
    prior, _ = example(np.random.default_rng(0))
    found = posterior(prior, [], 0.1)
    np.testing.assert_allclose(found.covariance, prior, atol=1e-12)
    assert not found.mean.any()


def test_a_bias_that_can_be_anything_takes_what_all_rows_have_in_common():
    """One unknown that moves all rows of a group alike says nothing if the group's bias is unknown."""
    row = Rows(np.array([0]), np.ones((50, 1)), np.ones(50), np.full(50, 1e4))
    found = posterior(np.eye(1), [row], 1e6)
    assert found.mean[0] == pytest.approx(0.0, abs=1e-5)
    assert found.covariance[0, 0] == pytest.approx(1.0, abs=1e-5)


def test_a_free_unknown_takes_its_rows_from_the_others():
    """A group that an unknown of its own moves like another one tells nothing of that other one."""
    rng = np.random.default_rng(1)
    design = np.repeat(rng.normal(size=(30, 1)), 2, axis=1)
    found = posterior(
        np.diag([1.0, 1e8]), [Rows(np.array([0, 1]), design, design[:, 0], np.full(30, 1e3))], 0.0
    )
    assert found.covariance[0, 0] == pytest.approx(1.0, abs=1e-4)
    assert found.mean[0] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(
    ("prior", "message"),
    [
        (np.ones((2, 3)), r"prior_covariance must have shape \(n, n\)"),
        (np.diag([1.0, 0.0]), "prior_covariance must have positive variances"),
        (np.ones((2, 2)), "prior_covariance must be positive definite"),
    ],
)
def test_refusals(prior, message):
    with pytest.raises(ValueError, match=message):
        posterior(prior, [], 0.0)


def test_biases_with_modes_against_the_covariance_of_all_rows():
    """As above, with two biases of each group: all rows alike, and their ends against each other."""
    prior, rows = example(np.random.default_rng(4))
    modes = np.stack([np.ones(7), np.linspace(-0.5, 0.5, 7)], axis=1)
    rows = [group._replace(modes=modes) for group in rows]
    design = np.zeros((21, 5))
    noise = np.zeros((21, 21))
    for k, group in enumerate(rows):
        own = slice(7 * k, 7 * k + 7)
        design[own, group.unknowns] = group.design
        noise[own, own] = np.diag(1 / group.weight) + 0.3 * modes @ modes.T
    gain = prior @ design.T @ np.linalg.inv(design @ prior @ design.T + noise)
    found = posterior(prior, rows, 0.3)
    right = np.concatenate([group.residual for group in rows])
    np.testing.assert_allclose(found.mean, gain @ right, atol=1e-10)
    np.testing.assert_allclose(found.covariance, prior - gain @ design @ prior, atol=1e-10)


def test_unknowns_that_no_row_moves_keep_their_prior():
    """They are left out of what is solved, unless the prior ties them to others."""
    row = Rows(np.array([1]), np.ones((4, 1)), np.full(4, 2.0), np.full(4, 1.0))
    found = posterior(np.diag([3.0, 1.0, 5.0]), [row], 0.0)
    np.testing.assert_allclose(found.mean, [0.0, 1.6, 0.0])
    np.testing.assert_allclose(found.covariance, np.diag([3.0, 0.2, 5.0]), atol=1e-12)
    tied = np.array([[1.0, 0.5], [0.5, 1.0]])
    # the other one moves by its correlation: 0.5 of 1.6
    both = posterior(tied, [row], 0.0)
    np.testing.assert_allclose(both.mean, [0.8, 1.6])
    assert both.covariance[0, 0] == pytest.approx(1 - 0.25 * 0.8)


def test_rows_show_how_large_their_biases_are():
    """From 400 groups with biases of 0.5, stated as 0.1: known to 4 %, two standard deviations 7 %."""
    rng = np.random.default_rng(2)
    prior = np.eye(2)
    rows = []
    for _ in range(400):
        design = rng.normal(size=(6, 2))
        bias = rng.normal(0.0, 0.5)
        noise = rng.normal(0.0, 0.1, 6)
        rows.append(
            Rows(np.arange(2), design, design @ [0.3, -1.0] + bias + noise, np.full(6, 100.0))
        )
    variance = 0.01
    for _ in range(30):
        variance = bias_variance_of(rows, posterior(prior, rows, variance), variance)
    assert np.sqrt(variance) == pytest.approx(0.5, rel=0.08)


# Whether estimates agree with what was stated: drawn unknowns, of which some directions are not
# measured.


def total(times, seed):
    """Sum and number of what 40 unknowns, of which 25 are measured, surprise by if they are some times too large."""
    rng = np.random.default_rng(seed)
    n = 40
    root = rng.normal(size=(n, n)) / 4 + np.eye(n)
    prior = root @ root.T
    truth = times * root @ rng.normal(size=n)
    design = rng.normal(size=(25, n))
    rows = [Rows(np.arange(n), design, design @ truth + rng.normal(0, 0.1, 25), np.full(25, 100.0))]
    found = posterior(prior, rows, 0.0)
    return surprise(found.mean, found.covariance, prior)


@pytest.mark.parametrize("times", [1.0, 3.0])
def test_the_sum_is_as_large_as_the_square_of_what_was_not_stated(times):
    sums = [total(times, seed) for seed in range(60)]
    assert {n for _, n in sums} == {25}
    # a mean of 60 sums of 25 squares: known to 1.83 %, three standard deviations 5.5 %
    assert np.mean([one for one, _ in sums]) == pytest.approx(25 * times**2, rel=0.055)


def test_nothing_that_was_learnt_surprises():
    prior = np.diag([1.0, 4.0])
    assert surprise(np.array([0.1, 0.1]), 0.9 * prior, prior) == (0.0, 0)
    assert surprise(np.empty(0), np.empty((0, 0)), np.empty((0, 0))) == (0.0, 0)


# Directions that an image says nothing about: a camera farther away, and everything larger.


PRIOR = np.diag([1.0, 4.0])


def seen(known):
    """Rows that see only the difference of x0 and x1 / 2."""
    return posterior(
        PRIOR, [Rows(np.arange(2), known, np.zeros(len(known)), np.full(len(known), 1e6))], 0.0
    )


def test_the_sum_is_undetermined_if_only_the_difference_is_seen():
    covariance = seen(np.array([[1.0, -0.5]])).covariance
    (direction,) = undetermined(covariance, PRIOR)
    # both together, each by its standard deviation over the root of two
    np.testing.assert_allclose(np.abs(direction), [np.sqrt(0.5), 2 * np.sqrt(0.5)], rtol=1e-3)
    assert direction[0] * direction[1] > 0


def test_nothing_is_undetermined_if_both_are_seen():
    assert len(undetermined(seen(np.eye(2)).covariance, PRIOR)) == 0


@pytest.mark.parametrize(
    ("gradient", "rests"), [([1.0, -0.5], False), ([1.0, 0.5], True), ([0.0, 0.0], False)]
)
def test_a_value_rests_on_the_prior_along_such_a_direction(gradient, rests):
    covariance = seen(np.array([[1.0, -0.5]])).covariance
    g = np.array(gradient)
    u = float(np.sqrt(g @ covariance @ g)) + 1e-3
    assert rests_on_prior(covariance, PRIOR, g, u) is rests


def test_what_the_fit_adds_hides_the_prior():
    covariance = seen(np.array([[1.0, -0.5]])).covariance
    assert not rests_on_prior(covariance, PRIOR, np.array([1.0, 0.5]), 10.0)


# What registration will leave unknown of a pose, against a direct computation with projected
# points.


POSE_PRIOR = np.diag([0.2, 0.3, 0.4, 0.001, 0.002, 0.003]) ** 2
POSE_PRIOR[0, 4] = POSE_PRIOR[4, 0] = 0.5 * 0.2 * 0.002
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
    np.zeros((0, SURFACES), dtype=bool),
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
        np.full((SURFACES, 3), 2.0),
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
    before[:6, :6] = POSE_PRIOR
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
    found = known_poses(POSE[None], POSE_PRIOR, known, IMAGING, NOTHING)
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
    nothing = np.zeros((1, SURFACES), dtype=bool)
    at = np.zeros(1, dtype=np.int64)
    values = Values(at, gradient[None], surfaces[None], motions[None], nothing)
    found = known_poses(POSE[None], POSE_PRIOR, known, IMAGING, values)
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
    found = known_poses(POSE[None], POSE_PRIOR, stretches(**less), IMAGING, NOTHING)
    np.testing.assert_allclose(found.covariance[0], POSE_PRIOR, rtol=1e-9, atol=1e-18)


def test_surfaces_of_which_nothing_is_known_tell_nothing_of_the_pose():
    known = stretches()
    wide = known._replace(sigmas=np.full((SURFACES, 3), 1e5))
    well = known_poses(POSE[None], POSE_PRIOR, known, IMAGING, NOTHING).covariance[0]
    badly = known_poses(POSE[None], POSE_PRIOR, wide, IMAGING, NOTHING).covariance[0]
    assert np.linalg.eigvalsh(badly - well).min() > -1e-12
    assert badly.trace() > 1.5 * well.trace()


@pytest.mark.parametrize("share", [0.001, 0.5, 0.95, 0.99999])
def test_quantiles_of_chi_squared(share):
    from scipy.stats import chi2

    # of two freedoms it is exponential
    assert chi_squared_quantile(share, 2) == pytest.approx(-2.0 * math.log1p(-share), rel=1e-12)
    assert [chi_squared_quantile(share, n) for n in (1, 6, 40)] == [
        chi2.ppf(share, n) for n in (1, 6, 40)
    ]
