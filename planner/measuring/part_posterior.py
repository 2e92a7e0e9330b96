"""One posterior over all images of a part: from it every value is read, whatever images show its entities.

Each image is registered by itself first. From there steps of Gauss and Newton lead to the joint estimate: poses are
eliminated setting by setting, and surfaces are the same ones for all, see `errors.many_images`. In each step, the edges
of all images are looked for again where it puts them.

A target has a prior of its own: nothing is assumed of the surfaces that it measures, and of the others what is stated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2 as chi_squared

from aspectgraph.entities.entity_rules import PARAMETERS
from errors.many_images import Estimate, Evidence, ManyImages, Prior, Slope, View
from errors.measurands.geometry import FLOOR_PX
from errors.registration import LEARNT, Posterior, bias_variance_of
from planner.camera.camera import Camera
from planner.measuring.reading import Reading
from planner.measuring.register import bias_of
from planner.measuring.registered import ImageEvidence, Registered, displaced, surface_variances
from planner.measuring.samples import POSE, PartModel
from planner.measuring.task import CREDIBLE
from planner.request.edge_state import SHARP, EdgeState

Array = NDArray[np.float64]

# less of a variance is rounding; and so many surfaces are let deviate more than stated
_LEAST_LEARNT = 1e-7
_MOST_DEVIATING = 30
# steps at most, the first of them whole ones; and standard deviations of a step after which none follows
_ROUNDS = 6
_FULL_STEPS = 2
_STILL = 0.1
_NOTHING_FREE = Prior(np.empty(0, dtype=np.int64), np.empty(0))


@dataclass(frozen=True, eq=False)
class KnownImage:
    """What all images tell of one of them, for a target.

    Attributes
    ----------
    registered : Registered
        The image with the joint covariance. Pose and deviations are those that its edges were last looked for at.
    shift : array (n,)
        How far the joint estimate is from them.
    """

    registered: Registered
    shift: Array

    def corrected(self, reading: Reading) -> Reading:
        """Return a reading at this image's own estimate as it is at the joint one."""
        if not reading.measured or not self.shift.any():
            return reading
        return replace(reading, value=reading.value + float(reading.gradient @ self.shift))


class PartPosterior:
    """The poses of all images of a part and the deviations of its surfaces, estimated together.

    Parameters
    ----------
    model : PartModel
        The part.
    camera : Camera
        The camera, which says how far a surface may be off of which nothing is assumed, see `surface_variances`.
    settings : sequence of mapping of str to Registered
        The registered images of each pose, by name.
    free_of : mapping of str to set of int
        The surfaces that each target measures, by its name.
    places_mm : mapping of int to float
        Of holes and pins with a tolerance of position, how far their axes may be off, by the number of the surface; one
        standard deviation along each direction, mm.
    edges : EdgeState
        How edges are taken to be broken; notes name it.
    """

    def __init__(
        self,
        model: PartModel,
        camera: Camera,
        settings: Sequence[Mapping[str, Registered]],
        free_of: Mapping[str, set[int]],
        places_mm: Mapping[int, float] | None = None,
        edges: EdgeState = SHARP,
    ) -> None:
        self._model = model
        self._places_mm = places_mm or {}
        self._edges = edges
        self._camera = camera
        self._free_of = free_of
        self._settings = settings
        self._images = {name: image for images in settings for name, image in images.items()}
        self._place = {
            name: (number, POSE * k)
            for number, images in enumerate(settings)
            for k, name in enumerate(images)
        }
        self._sizes = [POSE * len(images) for images in settings]
        self._evidence = {
            name: image.evidence
            for name, image in self._images.items()
            if image.evidence is not None
        }
        self._views = self._all_views()
        self._estimated = bool(self._evidence)
        self._surfaces_mm = max((image.surfaces_mm for image in self._images.values()), default=0.0)
        self._priors: dict[str, Prior] = {}
        self._stated = self._as_stated()
        self._alone = len(self._images) == 1 and all(
            free == model.free for free in free_of.values()
        )
        if self._estimated and not self._alone:
            self._stated = self._settled()

    def _as_stated(self) -> Array:
        """Return the variances (3k,) of surfaces as they are stated, with the tolerances of position of holes."""
        variances = surface_variances(self._model, self._surfaces_mm)
        for k, place_mm in self._places_mm.items():
            # the radius is first, then the axis
            axis = slice(PARAMETERS * k + 1, PARAMETERS * (k + 1))
            variances[axis] = np.maximum(variances[axis], place_mm**2)
        return variances

    def _settled(self) -> Array:
        """Return the variances (3k,) of surfaces before; of those that deviate more, with what the images show.

        The rows of images are taken again where the joint estimate puts their edges, until it stays. Alone, an image
        hardly tells surfaces that targets measure from its pose, and both lie far along a curved valley. Biases of
        edges are enlarged to what all images show together.
        """
        stated = self._as_stated()
        by_light = light_variances(self._model, self._camera)
        for k in range(_ROUNDS):
            variances = variances_shown(stated, self._views, by_light)
            joint = ManyImages(variances, self._views)
            farthest = 0.0
            for name, evidence in self._evidence.items():
                estimate = self._estimate_of(name, joint)
                sigmas = np.sqrt(np.diag(estimate.covariance))
                farthest = max(
                    farthest, float(np.abs((estimate.mean - evidence.at) / sigmas).max())
                )
                shown = bias_variance_of(evidence.rows, estimate, evidence.bias_variance)
                # edges that come and go must not swing the estimate
                share = 1.0 if k < _FULL_STEPS else 0.5
                moved = evidence.moved_to(evidence.at + share * (estimate.mean - evidence.at))
                self._evidence[name] = moved.with_biases(max(shown, evidence.bias_variance))
            self._views = self._all_views()
            if farthest < _STILL:
                break
        return variances_shown(stated, self._views, by_light)

    def _estimate_of(self, image: str, joint: ManyImages) -> Posterior:
        """Return the joint estimate of an image's pose and the surfaces, if none is free."""
        number, _ = self._place[image]
        mean, covariance = joint.of_view(number, _NOTHING_FREE)
        chosen = self._unknowns_of(image)
        return Posterior(mean[chosen], covariance[np.ix_(chosen, chosen)])

    def _unknowns_of(self, image: str) -> NDArray[np.int64]:
        """Return where the pose of an image and the surfaces (n,) are among the unknowns of its view."""
        number, first = self._place[image]
        size = self._sizes[number]
        shared = self._model.n_unknowns - POSE
        return np.concatenate([first + np.arange(POSE), size + np.arange(shared)])

    @cached_property
    def _joint(self) -> ManyImages:
        return ManyImages(self._stated, self._views)

    @property
    def notes(self) -> tuple[str, ...]:
        """What of the part is not as stated."""
        if not self._estimated:
            return ()
        stated = self._as_stated()
        more = (self._stated > stated).reshape(-1, PARAMETERS).any(axis=1)
        count = int(more.sum())
        if not count:
            return ()
        largest = float(np.sqrt((self._stated[self._stated > stated]).max()))
        faces = f"{count} face{'s' * (count > 1)} seem{'s' * (count == 1)} to deviate by up to"
        return (self._edges.deviation_note(faces, largest, self._surfaces_mm),)

    def _all_views(self) -> list[View]:
        return [self._view(images) for images in self._settings]

    def _view(self, images: Mapping[str, Registered]) -> View:
        """Return the images of one pose: each moves by itself and with the others."""
        shared = self._model.n_unknowns - POSE
        size = POSE * len(images)
        prior = np.zeros((size, size))
        evidence = Evidence.nothing(size + shared)
        for k, (name, image) in enumerate(images.items()):
            place = np.concatenate([POSE * k + np.arange(POSE), size + np.arange(shared)])
            block = slice(POSE * k, POSE * (k + 1))
            if name not in self._evidence:
                prior[block, block] = image.pose_covariance
                continue
            evidence_of_image = self._evidence[name]
            evidence.information[np.ix_(place, place)] += evidence_of_image.evidence.information
            evidence.right[place] += evidence_of_image.evidence.right
            _tie(prior, evidence_of_image, k, len(images))
        return View(prior, evidence)

    def _prior(self, target: str) -> Prior:
        """Return what is known of surfaces before the images, for a target."""
        if target not in self._priors:
            # a pose that is only stated does not tell how far a surface is off
            free = sorted(self._free_of[target]) if self._estimated else []
            camera = self._camera if self._estimated else None
            freed = surface_variances(self._model, self._surfaces_mm, camera, free)
            variances = np.maximum(freed, self._stated)
            places = np.array(
                [PARAMETERS * k + i for k in free for i in range(PARAMETERS)], dtype=np.int64
            )
            self._priors[target] = Prior(places, variances[places])
        return self._priors[target]

    def known(self, target: str, image: str) -> KnownImage:
        """Return what all images tell of one of them, for a target.

        Parameters
        ----------
        target, image : str
            Their names.
        """
        registered = self._images[image]
        if registered.evidence is None or self._alone:
            return KnownImage(registered, np.zeros(self._model.n_unknowns))
        number, _ = self._place[image]
        prior = self._prior(target)
        mean, covariance = self._joint.of_view(number, prior)
        chosen = self._unknowns_of(image)
        before = self._stated.copy()
        before[prior.free] = prior.variances
        stated = np.diag(np.concatenate([np.zeros(POSE), before]))
        stated[:POSE, :POSE] = registered.evidence.pose_prior + registered.evidence.apart
        evidence = self._evidence[image]
        image_with_prior = replace(
            registered,
            cam2world=displaced(evidence.planned, evidence.at[:POSE])[0],
            deviations=evidence.at[POSE:],
            covariance=covariance[np.ix_(chosen, chosen)],
            prior=stated,
        )
        return KnownImage(image_with_prior, mean[chosen] - evidence.at)

    def common(self, readings: Sequence[Reading]) -> Array:
        """Return the covariance (n, n) of readings by poses and surfaces, each with the prior of its target."""
        values = [Estimate(self._slope(reading), self._prior(reading.name)) for reading in readings]
        return self._covariances(values)

    def common_of_values(self, values: Sequence[tuple[Sequence[Reading], Array]]) -> Array:
        """Return the covariance (n, n) of values by poses and surfaces.

        Parameters
        ----------
        values : sequence of (sequence of Reading, array)
            For each value the readings that it is the mean of, and their weights.
        """
        slopes = []
        for readings, weights in values:
            total = Slope({}, np.zeros(self._model.n_unknowns - POSE))
            for reading, weight in zip(readings, weights, strict=True):
                total = total + self._slope(reading).times(weight)
            slopes.append(Estimate(total, self._prior(readings[0].name)))
        return self._covariances(slopes)

    def _covariances(self, values: list[Estimate]) -> Array:
        covariance = np.zeros((len(values), len(values)))
        for i, first in enumerate(values):
            for j, second in enumerate(values[: i + 1]):
                covariance[i, j] = self._joint.covariance(first, second)
                covariance[j, i] = covariance[i, j]
        return covariance

    def _slope(self, reading: Reading) -> Slope:
        number, first = self._place[reading.image]
        by_view = np.zeros(self._sizes[number])
        by_view[first : first + POSE] = reading.gradient[:POSE]
        return Slope({number: by_view}, reading.gradient[POSE:])


def light_variances(model: PartModel, camera: Camera) -> Array:
    """Return the variances (3k,) with which light may move the rims of round surfaces, mm²; 0 for planes.

    A plane has several edges, whose biases the images show. A bore often shows one rim, and light on its wall moves
    all of it: by more than most edges, so that the radius would seem to deviate. A plan expects as much of each edge.
    """
    pixel_mm = camera.focus_distance_mm / float(camera.matrix.diagonal()[:2].min())
    is_round = [not surface.is_plane for surface in model.carriers.surfaces]
    return np.repeat(is_round, PARAMETERS) * (bias_of(FLOOR_PX) * pixel_mm) ** 2


def variances_shown(stated: Array, views: Sequence[View], by_light: Array | None = None) -> Array:
    """Return the variances (3k,) of surfaces before: as stated, unless the images contradict that.

    The number of a surface that deviates most gets what the images show of it, and so on until none deviates more than
    by chance. No target counts in this, so what is asked changes nothing.

    Parameters
    ----------
    stated : array (3k,)
        Variances as stated, mm².
    views : sequence of View
        What the images tell.
    by_light : array (3k,), optional
        Variances with which light may move what is seen of them besides, mm². Default: 0.
    """
    variances = stated.copy()
    light = np.zeros(len(stated)) if by_light is None else by_light
    # offsets of planes and radii of cylinders
    is_size = np.arange(len(stated)) % PARAMETERS == 0
    for _ in range(_MOST_DEVIATING):
        mean, after = ManyImages(variances, views).shared()
        # an estimate has this share of its prior's variance if the prior is right
        learnt = 1 - after / variances
        # light moves edges, too, so that faces seem to be tilted a little
        is_learnt = learnt > np.where(is_size, _LEAST_LEARNT, LEARNT)
        if not is_learnt.any():
            break
        learnt = np.where(is_learnt, learnt, 1.0)
        # where the images have it, over the variance of that and of the prior
        chance = learnt * variances + learnt**2 * light
        square = np.where(is_learnt, mean**2 / chance, 0.0)
        worst = int(np.argmax(square))
        if square[worst] <= chi_squared.ppf(1 - (1 - CREDIBLE) / is_learnt.sum(), 1):
            break
        # where the images have it if nothing is assumed
        variances[worst] = max(variances[worst], float(mean[worst] / learnt[worst]) ** 2)
    return variances


def _tie(prior: Array, image: ImageEvidence, number: int, count: int) -> None:
    """Write what is known before of how an image of a setting is displaced, alone and with the others."""
    block = slice(POSE * number, POSE * (number + 1))
    for k in range(count):
        prior[block, POSE * k : POSE * (k + 1)] = image.pose_prior
    prior[block, block] += image.apart
