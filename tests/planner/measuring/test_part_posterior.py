"""Values from one posterior over all images of a part: what is asked, and in which order, does not matter."""

from dataclasses import replace

import numpy as np
import pytest
from measured_plate import CAMERA, POSES, fine_plate, measured_plan, photograph, thick_plate

from errors.many_images import Evidence, View
from planner import Measurer, Registration, measure
from planner.measuring.images import Picture
from planner.measuring.part_posterior import PartPosterior, light_variances, variances_shown
from planner.measuring.register import register_as_shown
from planner.measuring.registered import as_given
from planner.measuring.samples import POSE
from planner.request.edge_state import EdgeState
from planner.request.registration import OWN_EDGES

MADE = {"left": 0.05, "right": 0.0, "width": 0.08}
NAMES = ("left", "right", "apart", "width")
SURFACES_MM = 0.02


@pytest.fixture(scope="module")
def solid():
    return thick_plate()


@pytest.fixture(scope="module")
def images():
    return photograph(fine_plate(**MADE), POSES)


@pytest.fixture(scope="module")
def together(solid, images):
    return measure(measured_plan(solid), solid, images)


@pytest.fixture(scope="module")
def measurer(solid):
    return Measurer(measured_plan(solid), solid)


@pytest.fixture(scope="module")
def registered(measurer, images):
    """The images, each by itself."""
    covariance = measurer.plan.pose_uncertainty.covariance
    return {
        f"setting_{k:02d}": register_as_shown(
            measurer.model,
            [Picture.of(f"setting_{k:02d}", images[k], CAMERA)],
            POSES[k - 1],
            covariance,
            SURFACES_MM,
            0.03,
        )
        for k in (1, 2)
    }


def joined(measurer, registered, order=("setting_01", "setting_02")):
    return PartPosterior(
        measurer.model,
        CAMERA,
        [{name: registered[name]} for name in order],
        measurer.model.free_of,
    )


@pytest.mark.parametrize("name", ["left", "width"])
def test_a_target_is_as_sure_alone_as_among_others(solid, images, together, name):
    """But for what one registration finds where the other does not."""
    (alone,) = measure(measured_plan(solid, [name]), solid, images)
    u = alone.standard_uncertainty
    assert together[name].standard_uncertainty == pytest.approx(u, rel=0.1)
    assert together[name].value == pytest.approx(alone.value, abs=0.3 * u)


def test_two_images_are_never_less_sure_than_one(together):
    for result in together:
        each = [reading.standard_uncertainty for reading in result.readings]
        assert len(each) == 2
        assert result.standard_uncertainty <= min(each) * (1 + 1e-9)


def test_the_order_of_images_does_not_matter(measurer, registered):
    forth = joined(measurer, registered)
    back = joined(measurer, registered, ("setting_02", "setting_01"))
    for target in NAMES:
        for image in registered:
            one, other = (each.known(target, image) for each in (forth, back))
            scale = np.sqrt(np.diag(one.registered.covariance))
            np.testing.assert_allclose(other.shift / scale, one.shift / scale, atol=1e-9)
            units = np.outer(scale, scale)
            difference = other.registered.covariance - one.registered.covariance
            assert np.abs(difference / units).max() < 1e-9


def test_one_image_asked_for_one_target_is_as_it_was_registered(solid, images):
    plan = measured_plan(solid, ["left"], settings=1)
    model = Measurer(plan, solid).model
    picture = Picture.of("setting_01", images[1], CAMERA)
    covariance = plan.pose_uncertainty.covariance
    image = register_as_shown(model, [picture], POSES[0], covariance, SURFACES_MM, 0.03)
    known = PartPosterior(model, CAMERA, [{"setting_01": image}], model.free_of)
    found = known.known("left", "setting_01")
    assert found.registered is image
    assert not found.shift.any()
    # and of another target beside it, the joint posterior of the same rows has nearly the same numbers
    everything = {"left": set(model.free), "other": set()}
    both = PartPosterior(model, CAMERA, [{"setting_01": image}], everything)
    joint = both.known("left", "setting_01")
    scale = np.sqrt(np.diag(image.covariance))
    assert not both.notes
    np.testing.assert_allclose(
        np.sqrt(np.diag(joint.registered.covariance)) / scale, 1.0, atol=0.05
    )
    here = joint.registered.deviations + joint.shift[POSE:]
    assert np.abs((here - image.deviations) / scale[POSE:]).max() < 0.5


def test_an_image_that_shows_no_surface_changes_nothing(measurer, registered):
    """Its pose is only stated: so is what is known of the part."""
    stated = as_given(measurer.model, POSES[1], np.eye(POSE) * 1e-4, SURFACES_MM, "given")
    images = {"setting_01": registered["setting_01"], "setting_02": stated}
    both = joined(measurer, images)
    alone = joined(measurer, images, ("setting_01",))
    for target in NAMES:
        one, other = (each.known(target, "setting_01") for each in (alone, both))
        np.testing.assert_allclose(other.shift, one.shift, atol=1e-12)
        np.testing.assert_allclose(
            other.registered.covariance, one.registered.covariance, atol=1e-15
        )


def test_poses_that_are_given_are_not_changed(solid, images):
    how = Registration.given(
        {k + 1: pose for k, pose in enumerate(POSES)}, np.diag([1e-8] * 3 + [1e-12] * 3)
    )
    plan = measured_plan(solid)
    results = measure(plan, solid, images, registration=how)
    for result in results:
        assert result.measured
        assert all(image.method != OWN_EDGES for image in results.images.values())
    correlation = results.correlation
    assert np.linalg.eigvalsh(correlation).min() > -1e-9


def test_values_of_one_part_are_correlated_as_their_images_are(together):
    correlation = together.correlation
    np.testing.assert_array_equal(np.diag(correlation), 1.0)
    np.testing.assert_allclose(correlation, correlation.T)
    assert np.linalg.eigvalsh(correlation).min() > -1e-9
    # two bores' diameters share the distance of the camera
    assert 0 < correlation[0, 1] < 1


def test_a_face_that_deviates_more_than_stated_is_let_deviate():
    """Rows say of four numbers where they are, and of the second one that it is 20 times off."""
    stated = np.full(6, 0.02**2)
    where = np.array([0.01, 0.4, -0.02, 0.0, 0.01, 0.0])
    information = np.diag(np.append(0.0, np.full(6, 1 / 0.005**2)))
    view = View(np.eye(1), Evidence(information, information @ np.append(0.0, where)))
    shown = variances_shown(stated, [view])
    assert shown[1] == pytest.approx(0.4**2)
    np.testing.assert_array_equal(np.delete(shown, 1), np.delete(stated, 1))
    usual = replace_right(view, np.append(0.0, np.sign(where) * 0.02))
    np.testing.assert_array_equal(variances_shown(stated, [usual]), stated)


def test_a_face_that_deviates_may_be_an_edge_that_is_not_as_stated(measurer, registered):
    """Both move the lines in the image alike, so the note names both."""
    image, *_ = registered.values()
    joint = PartPosterior(
        measurer.model,
        CAMERA,
        [{"setting_01": image}],
        measurer.model.free_of,
        edges=EdgeState(0.5, 0.5, True),
    )
    stated = joint._as_stated()
    joint._stated = np.append(0.43**2, stated[1:])
    (note,) = joint.notes
    assert note.startswith("1 face seems to deviate by up to 0.43 mm, not by ")
    assert "or edges are not broken as taken here (broken by 0.5 mm)" in note


def test_what_light_does_to_a_rim_is_no_deviation(measurer):
    """Images have a radius that is stated as exact 4 standard deviations off, 0.3 px: light does that, to no plane."""
    by_light = light_variances(measurer.model, CAMERA)
    pixel_mm = CAMERA.focus_distance_mm / CAMERA.matrix.diagonal()[:2].min()
    surfaces = measurer.model.carriers.surfaces
    expected = [0.0 if surface.is_plane else 0.15 * pixel_mm for surface in surfaces]
    np.testing.assert_allclose(by_light, np.repeat(np.square(expected), 3))
    assert any(expected)
    stated = np.full(6, 1e-4**2)
    sigma = 0.3 * pixel_mm / 4.2
    information = np.diag(np.append(0.0, np.full(6, 1 / sigma**2)))

    def is_let_deviate(off_px, light):
        right = np.zeros(7)
        right[1] = off_px * pixel_mm / sigma**2
        view = View(np.eye(1), Evidence(information, right))
        shown = variances_shown(stated, [view], np.full(6, light))
        return bool((shown > stated).any())

    assert is_let_deviate(0.3, 0.0)
    assert not is_let_deviate(0.3, by_light.max())
    assert is_let_deviate(0.8, by_light.max())


def replace_right(view, where):
    evidence = view.evidence
    return view._replace(evidence=evidence._replace(right=evidence.information @ where))


def test_a_setting_of_several_images_has_poses_that_move_together(measurer, registered):
    """Twice the same image as one setting: its poses have the covariance that the setting states."""
    image = registered["setting_01"]
    apart = np.diag([1e-6] * 3 + [1e-12] * 3)
    twin = replace(image, evidence=replace(image.evidence, apart=apart))
    both = PartPosterior(measurer.model, CAMERA, [{"a": twin, "b": twin}], measurer.model.free_of)
    for target in NAMES:
        first, second = (both.known(target, name) for name in "ab")
        scale = np.sqrt(np.diag(first.registered.covariance))
        np.testing.assert_allclose(first.shift / scale, second.shift / scale, atol=1e-6)
        single = joined(measurer, registered, ("setting_01",)).known(target, "setting_01")
        ratio = np.diag(first.registered.covariance) / np.diag(single.registered.covariance)
        assert ratio.max() <= 1 + 1e-6
