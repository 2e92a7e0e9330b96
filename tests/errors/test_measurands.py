"""Dimensions: known answers in closed form, derivatives by differences, and Monte Carlo with exact rotations."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from errors import success_probability
from errors.measurands import (
    Circle,
    Decision,
    DecisionRule,
    Line,
    Localisation,
    Measurand,
    MeasurandError,
    MeasurandModel,
    acceptance_limits,
    decide,
    kind,
    uncertainty_ratio,
)
from errors.measurands.measurand import _KINDS, kinds, measurand

pytestmark = pytest.mark.uncompiled

DISTANCE = 26.0
PITCH = (0.00345, 0.00345)
GEOMETRY = {
    "length": [Line([-20, -10, 0], [25, -10, 0])],
    "distance": [Line([-20, -10, 0], [25, -10, 0]), Line([20, 15, 0], [-10, 15, 0])],
    "angle": [Line([-20, -10, 0], [25, -10, 0]), Line([20, 15, 6], [-10, 35, 6])],
    "diameter": [Circle([10, 5, 0], [0, 0, 1], 6.0)],
    "radius": [Circle([10, 5, 0], [0, 0, 1], 6.0, [1, 0, 0], 2.5)],
    "centre_distance": [
        Circle([10, 5, 0], [0, 0, 1], 6.0),
        Circle([-20, -8, 4], [0, 0, -1], 4.0),
    ],
    "centre_to_edge": [
        Circle([10, 5, 0], [0, 0, 1], 6.0),
        Line([-20, -10, 3], [25, -12, 3]),
    ],
}
NOMINAL = {
    "length": 45.0,
    "distance": 25.0,
    # between (1, 0) and (-3, 2)
    "angle": math.degrees(math.atan2(2, 3)),
    "diameter": 12.0,
    "radius": 6.0,
    "centre_distance": math.hypot(30, 13),
    # of (10, 5) from the line through (-20, -10) and (25, -12)
    "centre_to_edge": abs(-2 * 30 - 45 * 15) / math.hypot(45, 2),
}


def straight_on(height=300.0):
    """From above, looking down: x right, y down in the image."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = height
    return pose


def oblique(rng):
    """World to camera, from somewhere above the origin."""
    eye = np.array([rng.uniform(-150, 150), rng.uniform(-150, 150), rng.uniform(200, 400)])
    z = np.array([rng.uniform(-10, 10), rng.uniform(-10, 10), 0.0]) - eye
    z /= np.linalg.norm(z)
    x = np.cross(z, Rotation.random(random_state=rng).apply([1.0, 0, 0]))
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = [x, np.cross(z, x), z]
    pose[:3, 3] = -pose[:3, :3] @ eye
    return pose


def model(name, *, translation=0.0, rotation=0.0, localisation=None, error=None, pitch=PITCH):
    value = measurand(name, GEOMETRY[name])
    covariance = np.diag([*np.broadcast_to(translation, 3), *np.broadcast_to(rotation, 3)]) ** 2
    return MeasurandModel(
        value,
        image_distance_mm=DISTANCE,
        pixel_pitch_mm=pitch,
        pose_covariance=covariance,
        localisation=localisation or Localisation.gaussian(0.0, floor_px=0.0),
        permitted_error=error or 0.01 * value.nominal,
    )


def displaced(value, pose, moves, localisation, rng):
    """Errors of a value measured from exactly displaced poses: own projection, carrying back and fits."""
    turn = Rotation.from_rotvec(moves[:, 3:]).as_matrix()
    shift = moves[:, :3]
    fits = []
    for one, frame in zip(value.geometry, value.frames, strict=True):
        share = (np.arange(localisation.points) + 0.5) / localisation.points
        if value.in_image:
            share = np.array([0.0, 1.0])
        points = (
            one.points(share * one.span_rad)
            if isinstance(one, Circle)
            else one.p + share[:, None] * (one.q - one.p)
        )
        local = points @ pose[:3, :3].T + pose[:3, 3]
        seen = np.einsum("nji,npj->npi", turn, local[None] - shift[:, None])
        image = DISTANCE * seen[..., :2] / seen[..., 2:]
        image += rng.normal(size=image.shape) * localisation.sigma_px * PITCH
        if value.in_image:
            planned = np.linalg.norm(np.diff(DISTANCE * local[:, :2] / local[:, 2:], axis=0))
            return value.nominal * (np.linalg.norm(image[:, 1] - image[:, 0], axis=1) / planned - 1)
        origin = pose[:3, :3] @ frame.origin + pose[:3, 3]
        x = pose[:3, :3] @ frame.x
        y = pose[:3, :3] @ frame.y
        rays = np.concatenate([image / DISTANCE, np.ones((*image.shape[:2], 1))], axis=2)
        normal = np.cross(x, y)
        back = rays * (normal @ origin) / (rays @ normal)[..., None] - origin
        fits.append(fitted(one, back @ x, back @ y))
    return value.value(fits)


def fitted(one, a, b):
    if isinstance(one, Line):
        off = a - a.mean(axis=1, keepdims=True)
        slope = (off * b).sum(axis=1) / (off**2).sum(axis=1)
        return np.stack([b.mean(axis=1) - slope * a.mean(axis=1), slope], axis=1)
    found = np.stack([a.mean(axis=1), b.mean(axis=1), np.full(len(a), one.radius_mm)], axis=1)
    for _ in range(6):
        dx = a - found[:, :1]
        dy = b - found[:, 1:2]
        r = np.hypot(dx, dy)
        slopes = np.stack([dx / r, dy / r, np.ones_like(r)], axis=2)
        normal = np.einsum("nmi,nmj->nij", slopes, slopes)
        right = np.einsum("nmi,nm->ni", slopes, r - found[:, 2:])
        found += np.linalg.solve(normal, right[..., None])[..., 0]
    return found


@pytest.mark.parametrize("name", GEOMETRY)
def test_nominal_values(name):
    assert measurand(name, GEOMETRY[name]).nominal == pytest.approx(NOMINAL[name], abs=1e-12)


def test_an_error_along_the_axis_scales_what_is_seen_straight_on():
    """D sigma_z / Z, the design's known answer; of a length too, as its image scales likewise."""
    for name, nominal in NOMINAL.items():
        if name in ("angle", "centre_distance", "centre_to_edge"):
            continue
        told = model(name, translation=[0, 0, 0.05]).describe(straight_on())
        assert told.standard_uncertainty == pytest.approx(nominal * 0.05 / 300, rel=1e-3)
    assert (
        model("angle", translation=[0, 0, 0.05]).describe(straight_on()).standard_uncertainty < 1e-9
    )


@pytest.mark.parametrize("name", GEOMETRY)
def test_a_turn_about_the_optical_axis_changes_nothing(name):
    told = model(name, rotation=[0, 0, 0.01]).describe(straight_on())
    assert told.standard_uncertainty < 1e-9
    assert abs(told.bias) < 1e-9


@pytest.mark.parametrize("points", [16, 40])
def test_localisation_of_circles_and_lines_in_closed_form(points):
    """Radius sigma / sqrt(N), diameter twice that, two lines sigma sqrt(2 / N), in the part straight on."""
    here = Localisation.gaussian(0.2, points, floor_px=0.0)
    sigma = 0.2 * PITCH[0] * 300 / DISTANCE
    whole = Circle([10, 5, 0], [0, 0, 1], 6.0)
    cases = {
        "radius": ([whole], sigma / math.sqrt(points)),
        "diameter": ([whole], 2 * sigma / math.sqrt(points)),
        "centre_distance": (
            [whole, Circle([-20, -8, 0], [0, 0, 1], 6.0)],
            math.sqrt(2) * sigma * math.sqrt(2 / points),
        ),
        "distance": (
            [Line([-20, 0, 0], [20, 0, 0]), Line([-20, 9, 0], [20, 9, 0])],
            sigma * math.sqrt(2 / points),
        ),
    }
    for name, (geometry, expected) in cases.items():
        value = measurand(name, geometry)
        told = MeasurandModel(
            value,
            image_distance_mm=DISTANCE,
            pixel_pitch_mm=PITCH,
            pose_covariance=np.zeros((6, 6)),
            localisation=here,
            permitted_error=1.96 * expected,
        ).describe(straight_on())
        assert told.standard_uncertainty == pytest.approx(expected, rel=1e-9)
        assert told.budget["localisation"] == pytest.approx(expected**2, rel=1e-9)
        assert told.probability == pytest.approx(math.erf(1.96 / math.sqrt(2)), abs=2e-5)


@pytest.mark.parametrize("name", GEOMETRY)
def test_derivatives_are_those_of_the_exact_measurement(name):
    rng = np.random.default_rng(5)
    pose = oblique(rng)
    exact = Localisation.gaussian(0.0, floor_px=0.0)
    value = measurand(name, GEOMETRY[name])
    told = value.expansion(pose[None], model(name).image, exact)
    gradient = told.gradient[0] / told.scale[0]
    hessian = told.hessian[0] / told.scale[0]
    if told.logarithmic:
        # x is nominal ln(1 + error / nominal)
        hessian = hessian + np.outer(gradient, gradient) / value.nominal
    steps = np.array([1e-2] * 3 + [3e-5] * 3)
    for i in range(6):
        for j in range(i + 1):
            first = np.eye(6)[i] * steps[i]
            second = np.eye(6)[j] * steps[j]
            moves = np.array(
                [first + second, first - second, second - first, -first - second, first, -first]
            )
            e = displaced(value, pose, moves, exact, rng)
            bent = (e[0] - e[1] - e[2] + e[3]) / (4 * steps[i] * steps[j])
            size = np.abs(hessian[: i + 1]).max() + 1e-6
            assert hessian[i, j] == pytest.approx(
                bent, rel=2e-3, abs=2e-3 * size + 1e-6 * abs(gradient[i]) / steps[j]
            )
        assert gradient[i] == pytest.approx((e[4] - e[5]) / (2 * steps[i]), rel=1e-4, abs=1e-7)


@pytest.mark.parametrize(("sigma", "tolerance"), [(0.01, 0.002), (0.03, 0.006), (0.055, 0.012)])
@pytest.mark.parametrize("name", GEOMETRY)
def test_probability_agrees_with_exact_displaced_measurements(name, sigma, tolerance):
    rng = np.random.default_rng([17, len(name)])
    n = 20_000
    localisation = Localisation.gaussian(0.3, floor_px=0.0)
    for _ in range(2):
        pose = oblique(rng)
        moves = rng.normal(size=(n, 6)) * ([0.1] * 3 + [sigma] * 3)
        error = np.abs(displaced(measurand(name, GEOMETRY[name]), pose, moves, localisation, rng))
        asked = float(np.quantile(error, 0.7))
        told = model(name, translation=0.1, rotation=sigma, localisation=localisation, error=asked)
        noise = 4 * math.sqrt(0.21 / n)
        assert told.probability(pose[None])[0] == pytest.approx(0.7, abs=tolerance + noise)


def test_rounding_of_a_length_is_the_papers():
    """The same law in the paper's frame: the origin on the image plane, z from the part to the camera."""
    rng = np.random.default_rng(2)
    told = model(
        "length", translation=0.05, rotation=1e-9, localisation=Localisation.rounding(), error=0.45
    )
    for _ in range(5):
        pose = oblique(rng)
        ends = (
            np.array([GEOMETRY["length"][0].p, GEOMETRY["length"][0].q]) @ pose[:3, :3].T
            + pose[:3, 3]
        )
        paper = np.stack([-ends[:, 0], ends[:, 1], DISTANCE - ends[:, 2]], axis=-1)
        paper = paper * [1, 1, 1]
        expected = success_probability(
            paper,
            focal_length_mm=DISTANCE,
            pixel_pitch_mm=PITCH,
            pose_covariance=np.diag([0.05**2] * 3 + [1e-18] * 3),
            accuracy=0.99,
        )
        assert told.probability(pose[None])[0] == pytest.approx(expected, abs=2e-5)


def test_budget_sums_to_the_variance_and_uncertainty_to_its_root():
    told = model(
        "centre_to_edge", translation=0.1, rotation=0.002, localisation=Localisation.gaussian(0.2)
    )
    found = told.describe(oblique(np.random.default_rng(8)))
    assert sum(found.budget.values()) == pytest.approx(found.standard_uncertainty**2)
    assert found.expanded_uncertainty == 2 * found.standard_uncertainty
    without = dict(found.budget)
    assert without.pop("surfaces") == without.pop("edge_state") == 0.0
    assert min(without.values()) > 0


def test_a_short_arc_has_quantiles():
    """Their normal value is the standard deviation's, here where the fit is near to linear."""
    value = measurand("radius", [Circle([10, 5, 0], [0, 0, 1], 6.0, [1, 0, 0], 2.5)])
    found = MeasurandModel(
        value,
        image_distance_mm=DISTANCE,
        pixel_pitch_mm=PITCH,
        pose_covariance=np.zeros((6, 6)),
        localisation=Localisation.gaussian(0.1, floor_px=0.0),
        permitted_error=0.1,
    ).describe(straight_on())
    assert found.standard_uncertainty == pytest.approx(
        math.sqrt(found.budget["localisation"]), rel=1e-3
    )
    hopeless = measurand("radius", [Circle([10, 5, 0], [0, 0, 1], 6.0, [1, 0, 0], 0.1)])
    seen = hopeless.expansion(
        straight_on()[None], model("radius").image, Localisation.gaussian(0.5, floor_px=0.0)
    ).seen
    assert not seen[0]


def test_nothing_is_measured_behind_the_camera():
    told = model("diameter", error=0.1)
    behind = straight_on(-300.0)
    assert told.probability(np.array([behind]))[0] == 0.0
    assert math.isinf(told.describe(behind).standard_uncertainty)


def test_a_fit_gets_no_better_than_its_floor():
    exact = model("diameter", localisation=Localisation.fit(0.3, 2.0, 0.0)).describe(straight_on())
    floored = model("diameter", localisation=Localisation.fit(0.3, 2.0, 0.2)).describe(
        straight_on()
    )
    sigma = 0.2 * PITCH[0] * 300 / DISTANCE
    assert floored.standard_uncertainty == pytest.approx(2 * sigma, rel=1e-9)
    assert exact.standard_uncertainty < floored.standard_uncertainty


def test_a_new_kind_is_one_class():
    try:

        @kind("place")
        class Place(Measurand):
            """Position of a centre along x, from x = 0."""

            takes = (Circle,)

            def describe(self):
                from errors.measurands.geometry import Frame

                (circle,) = self.geometry
                frame = Frame(circle.centre, np.array([1.0, 0, 0]), np.array([0, 1.0, 0]))
                return float(circle.centre[0]), (frame,), np.array([1.0, 0, 0]), np.zeros((3, 3))

        assert "place" in kinds()
        value = measurand("place", GEOMETRY["diameter"])
        told = MeasurandModel(
            value,
            image_distance_mm=DISTANCE,
            pixel_pitch_mm=PITCH,
            pose_covariance=np.diag([0.02**2, 0, 0, 0, 0, 0]),
            localisation=Localisation.gaussian(0.0, floor_px=0.0),
            permitted_error=0.04,
        ).describe(straight_on())
        # the camera's x is the part's: what stands aside by 0.02 mm is measured aside by as much
        assert told.standard_uncertainty == pytest.approx(0.02)
        assert told.probability == pytest.approx(math.erf(2 / math.sqrt(2)), abs=2e-5)
    finally:
        _KINDS.pop("place", None)


@pytest.mark.parametrize(
    ("name", "geometry", "message"),
    [
        ("width", [], "kind must be one of"),
        (
            "distance",
            [GEOMETRY["length"][0]],
            "a distance must have two straight edges. Got one straight edge.",
        ),
        (
            "diameter",
            GEOMETRY["length"],
            "a diameter must have one rim or arc. Got one straight edge. Use length for this.",
        ),
        (
            "distance",
            GEOMETRY["centre_to_edge"],
            "Got one rim or arc and one straight edge. Use centre_to_edge for these.",
        ),
        ("angle", GEOMETRY["centre_distance"], "an angle must .* Use centre_distance for these"),
        ("distance", GEOMETRY["angle"], "must be parallel. Got 33.69 degrees"),
        ("angle", GEOMETRY["distance"], "must not be parallel"),
        (
            "centre_distance",
            [GEOMETRY["diameter"][0], Circle([0, 0, 9], [0, 1, 0], 2.0)],
            "must lie in parallel planes. Got 90 degrees",
        ),
        (
            "centre_distance",
            [GEOMETRY["diameter"][0], Circle([10, 5, 9], [0, 0, 1], 2.0)],
            "must lie apart",
        ),
        (
            "centre_to_edge",
            [GEOMETRY["diameter"][0], Line([0, 0, 0], [0, 9, 9])],
            "parallel to the rim's plane",
        ),
    ],
)
def test_what_entities_do_not_define_is_refused(name, geometry, message):
    with pytest.raises(MeasurandError, match=message):
        measurand(name, geometry)


def test_conformity():
    assert uncertainty_ratio(0.01, (-0.05, 0.05)) == pytest.approx(0.1)
    # guard bands of U, of nothing, and of the 95 % quantile of a normal distribution
    limits = acceptance_limits((-0.05, 0.05), 0.005, DecisionRule.guard())
    assert limits == pytest.approx((-0.04, 0.04))
    assert acceptance_limits((-0.05, 0.05), 0.03, DecisionRule.guard()) is None
    assert acceptance_limits((-0.05, 0.05), 0.03, DecisionRule.simple()) == (-0.05, 0.05)
    limits = acceptance_limits((-0.05, 0.05), 0.005, DecisionRule.iso14253())
    assert limits == pytest.approx((-0.05 + 1.644854 * 0.005, 0.05 - 1.644854 * 0.005))
    limits = acceptance_limits((-math.inf, 0.05), 0.005, DecisionRule.iso14253())
    assert limits == pytest.approx((-math.inf, 0.05 - 1.644854 * 0.005))


@pytest.mark.parametrize("rule", [DecisionRule.iso14253(0.99), DecisionRule.guard()])
@pytest.mark.parametrize("u", [0.001, 0.02, 0.024, 0.0255, 0.05])
def test_acceptance_limits_are_where_the_decision_changes(rule, u):
    tolerance = (-0.02, 0.1)
    limits = acceptance_limits(tolerance, u, rule)
    if limits is None:
        assert decide(0.04, u, tolerance, rule) is not Decision.CONFORMS
        return
    for limit, inwards in zip(limits, (1e-9, -1e-9), strict=True):
        assert decide(limit + inwards, u, tolerance, rule) is Decision.CONFORMS
        assert decide(limit - inwards, u, tolerance, rule) is not Decision.CONFORMS
