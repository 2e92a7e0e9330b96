"""Measuring: from a plan, its part and its images to results."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from errors.measurands import Circle, DecisionRule, Localisation, Position
from errors.measurands.geometry import DETECTOR_FLOOR_PX, FLOOR_PX
from errors.measurands.split import End, can_be_split, end_groups
from ground.blas import with_one_thread
from ground.faces import program_name
from planner.argument_kinds import check_kinds, suggests_names
from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty, world_to_cam
from planner.exceptions import RequestError
from planner.files import timestamp
from planner.identity import PartRecord
from planner.measuring.advice import (
    advice_of_images,
    advised,
    digest_of_rendering,
    image_notes,
    lacks_registration,
    of_poses,
    plan_notes,
    rendered_note,
    with_advice,
)
from planner.measuring.images import ImageSet, Picture, Shot, read_images, shots_of
from planner.measuring.measure_options import MeasureOptions, or_default
from planner.measuring.merging import (
    ScannedEnd,
    joined_ends,
    merged,
    position_of_ends,
    read_with,
    weights_of,
)
from planner.measuring.part_posterior import KnownImage, PartPosterior
from planner.measuring.reading import (
    EntityScan,
    Reading,
    entity_samples,
    read_length,
    read_value,
    scan_entity,
)
from planner.measuring.register import (
    MOST_WINDOW_PX,
    bias_of,
    check_lens,
    looks_like,
    register_as_shown,
)
from planner.measuring.registered import FREE_PX, Registered, as_given, prior_covariance
from planner.measuring.registration import BOTH, NoFiducialsError, Registration, locate
from planner.measuring.response import JudgedResponse, judge_response
from planner.measuring.results import (
    NOT_INSPECTED,
    NOT_PLANNED,
    MeasurementResults,
    Result,
    Source,
    UnseenBreaks,
)
from planner.measuring.samples import POSE, PartEdge, PartModel
from planner.measuring.seen_breaks import (
    UNCLEAR_PX,
    SeenBreak,
    edges_text,
    pixel_mm,
    seen_break,
    seen_notes,
    unseen_breaks,
    unseen_mm,
)
from planner.measuring.task import (
    NotRegisteredError,
    TooFarError,
    check_distance,
    displacement_between,
    distance_of,
)
from planner.progress import Progress, labelled, report
from planner.request.dimension import POSITIONS, is_one_sided
from planner.request.edge_state import EdgeState
from planner.request.registration import GIVEN, LEAST_POSE, OWN_EDGES, PLANNED
from planner.request.targets import Target, targets_of
from planner.sensor_setting import SensorSetting, setting_name
from planner.verify.setting_record import search_windows_px

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.plan import InspectionPlan


NEAR_PX = 3.0
"""Entities are searched this far from a registered prediction, px."""

# what progress calls the stages of measuring
_AS_SHOWN = " (as images show)"
_PREPARING = "preparing images"
_REGISTERING = "registering images"
_AGAIN = "registering images again"
_JUDGING = "comparing edges in all images"
_JOINING = "joining images"
_READING = "measuring in images"
_DECIDING = "deciding"
# windows of unregistered images begin with the plan's, which are three standard deviations wide
_ROOM_PX = 2.0
# with a wider window, more samples have another line in it
_MOST_TOLERANCE_PX = 3.0


def _unregistered(shot: Shot, why: str, advice: str) -> list[Reading]:
    """Return the readings of an image that cannot be registered: none has a value."""
    reason = f"the image cannot be registered: {why}"
    return [
        Reading(name, shot.name, shot.setting, reason=reason, advice=advice)
        for name in shot.targets
    ]


class MeasuredEnd:
    """One entity of a target, which an image may show without the others.

    Parameters
    ----------
    target : str
        Name of the target.
    value : End
        What the entity has in the value.
    edge : PartEdge
        The entity.
    model : PartModel
        The part.

    Attributes
    ----------
    free : set of int
        Surfaces whose deviation the entity measures itself.
    """

    def __init__(self, target: str, value: End, edge: PartEdge, model: PartModel) -> None:
        self.target = target
        self.value = value
        self.edge = edge
        self.free = model.free_surfaces(value, (edge,))
        self._model = model

    def is_shown(self, image: Registered, camera: Camera, coverage: float) -> bool:
        """Return whether an image may show enough of the entity in focus and apart from other lines."""
        samples = entity_samples(self._model, [self.edge], image, camera, NEAR_PX)
        if not len(samples.points):
            return False
        depth = world_to_cam(samples.points, image.cam2world)[:, 2]
        nearest, farthest = camera.depth_of_field_mm
        in_focus = (depth >= nearest) & (depth <= farthest)
        return float(np.mean(samples.usable & in_focus)) >= coverage


def witness_key(setting: SensorSetting, name: str) -> str:
    """Return a name for a target as a setting measures it."""
    k = setting.witness.get(name, 0)
    return f"{name} (way {k + 1})" if k else name


def whole_targets(plan: InspectionPlan, setting: SensorSetting) -> Mapping[str, Target]:
    """Return the targets of a plan by the witnesses of a setting, also those of which it measures one entity."""
    return targets_of(plan.targets, replace(setting, ends={}))


class Measurer:
    """Measures parts by images of a plan's settings; rays and surfaces are found once.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    solid : Solid
        Its part.
    part_file_sha256 : str
        SHA-256 of the part's file, for the results.

    Raises
    ------
    RequestError
        If the part is not the plan's, or the plan has no settings.

    Examples
    --------
    >>> from aspectgraph import Solid
    >>> from planner import Measurer, read_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> measurer = Measurer(plan, Solid.read("examples/two_pocket_block.off"))
    >>> measurer.shots[0].name
    'setting_01'
    """

    def __init__(self, plan: InspectionPlan, solid: Solid, *, part_file_sha256: str = "") -> None:
        check_kinds(plan=(plan, "InspectionPlan"), solid=(solid, "Solid"))
        self._part_file_sha256 = part_file_sha256
        self._digest = PartRecord.of(solid).digest
        why = plan.request.other_part(solid)
        if why:
            rule = "must be the one that was planned"
            raise RequestError.of_rule("part", rule, f"{solid.name!r}, {why}")
        if not plan.settings:
            raise RequestError.of_rule("plan", "must have a setting", "one without settings")
        self.plan = plan
        self.shots = shots_of(plan)
        self.targets = {
            name: plan.targets[name] for name in plan.promises if name not in plan.split
        }
        # a setting measures a target by the witness that it was planned with
        self.by_witness = {
            witness_key(setting, name): whole_targets(plan, setting)[name]
            for setting in plan.settings
            for name in setting.entities
        }
        area = None if plan.light is None else plan.light.area
        self.model = PartModel(solid, self.by_witness, area)
        self.ends = self._ends_of_others()

    @with_one_thread
    @suggests_names
    def measure(
        self,
        images: str | os.PathLike[str] | Mapping[Any, Any],
        options: MeasureOptions | None = None,
        *,
        serial: str = "",
        operator: str = "",
        partial: bool = False,
        allow_lossy: bool = False,
        progress: Progress | None = None,
    ) -> MeasurementResults:
        """Measure one part.

        Parameters
        ----------
        images : path or mapping
            A folder with an image for each setting, or images by setting, see `read_images`.
        options : MeasureOptions, optional
            How. Default: ``MeasureOptions()``.
        serial : str
            Name of the part, for the files.
        operator : str
            Who measures, for the files.
        partial : bool
            Whether images may be missing.
        allow_lossy : bool
            Whether JPEG files are accepted.
        progress : callable, optional
            Takes how many images are done, of how many, and a label.

        Returns
        -------
        MeasurementResults
            A result for each target.

        Raises
        ------
        RequestError
            If images are missing or wrong.
        """
        options = or_default(options)
        camera = self._camera(options)
        report(progress, 0, len(self.shots), _PREPARING)
        wide = _wide_note(self.model.solid, self.plan, options.registration)
        drawn_for = digest_of_rendering(images)
        reading = {"partial": partial, "allow_lossy": allow_lossy}
        stranger = rendered_note(self.plan, drawn_for)
        image_set = read_images(images, self.shots, camera, stranger=stranger, **reading)
        pictures = _pictures(image_set, camera, progress)
        registered, failed = self._all_registered(pictures, options, progress)
        poses = registered | self._alone(failed, pictures, options)
        seen, response = self._judged(pictures, poses, options, progress)
        pictures = response.pictures
        again = labelled(progress, _AGAIN)
        broken = None
        if seen is not None and not self.edge_state(options).stated:
            broken = self._broken(seen, pictures, options, failed, again)
            seen = seen if broken is not None else None
        edge_notes = seen_notes(seen, self.edge_state(options), is_drawn_sharp=bool(drawn_for))
        if broken is not None:
            options, registered, failed = broken
        elif response.is_changed:
            registered, failed = self._all_registered(pictures, options, again)
        joint = self._joined(response.pictures, registered, options, progress)
        readings = self._readings(response, registered, joint, options, progress)
        report(progress, 0, 1, _DECIDING)
        self._add_unregistered(readings, failed)
        results = self._merged(readings, joint, options.rule) | self._not_planned(options.rule)
        results |= self._of_several_images(response, registered, failed, joint, options)
        notes = image_notes(self.plan, self.model.edges.scene, pictures, registered, readings)
        states = {name: self.edge_state(options, self.plan.targets[name]) for name in self.targets}
        unseen = self._unseen(results, states, registered, options)
        of_images = (*image_set.notes, *response.notes(readings), *edge_notes, *joint.notes, *notes)
        of_plan = plan_notes(self.plan, options.registration, drawn_for, states.values())
        report(progress, 1, 1, _DECIDING)
        return MeasurementResults(
            {name: self._with_foreseen(results[name]) for name in self.plan.entities},
            {name: replace(image, evidence=None) for name, image in registered.items()},
            {name: with_advice(*both) for name, both in failed.items()},
            options.rule,
            serial,
            self._correlation(results, joint),
            self._source(image_set, operator),
            (*of_images, *wide, *of_plan),
            pictures,
            response.records(),
            edges_text(results, states, unseen) + _AS_SHOWN * (broken is not None),
            unseen,
        )

    def _unseen(
        self,
        results: Mapping[str, Result],
        states: Mapping[str, EdgeState],
        registered: Mapping[str, Registered],
        options: MeasureOptions,
    ) -> UnseenBreaks | None:
        """Return what breaks would do that images do not show."""
        poses = [image.cam2world for image in registered.values()]
        limit_mm = unseen_mm(self.plan.camera, self.model.solid, poses)
        return unseen_breaks(results, states, limit_mm, options.rule)

    def _broken(
        self,
        seen: SeenBreak,
        pictures: Mapping[str, Picture],
        options: MeasureOptions,
        failed: Collection[str],
        progress: Progress | None,
    ) -> tuple[MeasureOptions, dict[str, Registered], dict[str, tuple[str, str]]] | None:
        """Return the options with breaks that images show, and what is registered with them.

        None if fewer images are registered then: faces that deviate look like breaks in one image, and others speak
        against these.
        """
        options = replace(options, edge_break_mm=seen.limits_mm)
        registered, still_failed = self._all_registered(pictures, options, progress)
        return None if len(still_failed) > len(failed) else (options, registered, still_failed)

    def _judged(
        self,
        pictures: Mapping[str, Picture],
        poses: Mapping[str, Registered],
        options: MeasureOptions,
        progress: Progress | None,
    ) -> tuple[SeenBreak | None, JudgedResponse]:
        """Return what edges in all images tell of their breaks, and of the response of the camera."""
        report(progress, 0, 1, _JUDGING)
        seen = seen_break(self.model, pictures, poses)
        is_broken = seen is not None or self._is_wide(self.edge_state(options), poses)
        half_px = self._edges_half_px(poses)
        response = judge_response(self.model, pictures, poses, half_px, is_broken)
        report(progress, 1, 1, _JUDGING)
        return seen, response

    def _with_foreseen(self, result: Result) -> Result:
        """Return a result with U as the plan foresaw it, in the surest of the settings whose images there are.

        A plan foresees nothing of what its lamps do not show.
        """
        if result.name in self.plan.unlit:
            return result
        settings = {reading.setting for reading in result.readings}
        foreseen = [
            row.expanded_uncertainty
            for row in self.plan.foreseen
            if row.name == result.name and row.setting in settings
        ]
        return replace(result, foreseen_uncertainty=min(foreseen, default=math.nan))

    def _merged(
        self, readings: Mapping[str, list[Reading]], joint: PartPosterior, rule: DecisionRule
    ) -> dict[str, Result]:
        """Return a result for each target that the plan inspects: of several readings, their common one."""
        results = {}
        for name, target_readings in readings.items():
            measured = [reading for reading in target_readings if reading.measured]
            common = joint.common(measured) if len(measured) > 1 else None
            results[name] = merged(
                name, self.plan.targets[name], target_readings, rule, common=common
            )
        return results

    def _add_unregistered(
        self, readings: dict[str, list[Reading]], failed: Mapping[str, tuple[str, str]]
    ) -> None:
        """Append the readings of images that cannot be registered."""
        for shot in self.shots:
            if shot.name in failed:
                for reading in _unregistered(shot, *failed[shot.name]):
                    readings[reading.name].append(reading)

    def _camera(self, options: MeasureOptions) -> Camera:
        """Return the plan's camera with what is stated of its grey values."""
        camera = self.plan.camera
        if options.white_level is not None:
            camera = replace(camera, white_level=options.white_level)
        if options.response is not None:
            camera = replace(camera, response=str(options.response))
        return camera

    def _all_registered(
        self,
        pictures: Mapping[str, Picture],
        options: MeasureOptions,
        progress: Progress | None = None,
    ) -> tuple[dict[str, Registered], dict[str, tuple[str, str]]]:
        """Return the registrations of images, and why others cannot be registered, with advice."""
        registered: dict[str, Registered] = {}
        failed: dict[str, tuple[str, str]] = {}
        for shots in self._by_pose(pictures, options.registration):
            report(progress, len(registered) + len(failed), len(pictures), _REGISTERING)
            try:
                registration = self._registered(shots, pictures, options)
            except NotRegisteredError as error:
                advice = advice_of_images([pictures[shot.name] for shot in shots], error.counts)
                failed |= {shot.name: (str(error), advice) for shot in shots}
                continue
            registered |= {shot.name: registration.of(shot.name) for shot in shots}
        report(progress, len(pictures), len(pictures), _REGISTERING)
        return registered, failed

    def _alone(
        self,
        failed: Collection[str],
        pictures: Mapping[str, Picture],
        options: MeasureOptions,
    ) -> dict[str, Registered]:
        """Return what images that cannot be registered together are by themselves: a wrong response moves edges."""
        registered: dict[str, Registered] = {}
        for shots in self._by_pose(pictures, options.registration):
            if len(shots) < 2:
                continue
            for shot in shots:
                if shot.name in failed:
                    with suppress(NotRegisteredError):
                        registered[shot.name] = self._registered([shot], pictures, options)
        return registered

    def _readings(
        self,
        response: JudgedResponse,
        registered: Mapping[str, Registered],
        known: PartPosterior,
        options: MeasureOptions,
        progress: Progress | None = None,
    ) -> dict[str, list[Reading]]:
        """Return what is read in registered images, by target."""
        readings: dict[str, list[Reading]] = {name: [] for name in self.targets}
        every = len(response.pictures)
        done = itertools.count()
        for shots in self._by_pose(response.pictures, options.registration):
            for shot in shots:
                report(progress, next(done), every, _READING)
                if shot.name not in registered:
                    continue
                pose = registered[shot.name]
                others = [
                    self._read(shot, pictures[shot.name], known, options)
                    for pictures in response.others
                ]
                picture = response.pictures[shot.name]
                light = self.plan.light
                dark = {} if light is None else light.unlit[shot.setting]
                image_readings = self._read(shot, picture, known, options)
                for i, reading in enumerate(image_readings):
                    alike = [bent_readings[i] for bent_readings in others]
                    reading = response.counted(reading, alike)
                    is_unlit = reading.name in dark
                    readings[reading.name].append(
                        advised(reading, picture, pose.blur_px, is_unlit=is_unlit)
                    )
        report(progress, every, every, _READING)
        if lacks_registration(self.plan, options.registration):
            return {name: list(map(of_poses, each)) for name, each in readings.items()}
        return readings

    def _joined(
        self,
        pictures: Mapping[str, Picture],
        registered: Mapping[str, Registered],
        options: MeasureOptions,
        progress: Progress | None,
    ) -> PartPosterior:
        """Return what all registered images tell together."""
        report(progress, 0, 1, _JOINING)
        groups = [
            {shot.name: registered[shot.name] for shot in shots if shot.name in registered}
            for shots in self._by_pose(pictures, options.registration)
        ]
        free_of: dict[str, set[int]] = {name: set() for name in self.targets}
        for setting in self.plan.settings:
            for name in setting.entities:
                if name in setting.ends:
                    continue
                free_of[name] |= self.model.free_of[witness_key(setting, name)]
        for name, ends in self.ends.items():
            free_of[name] = set().union(*(end.free for end in ends))
        joint = PartPosterior(
            self.model,
            self.plan.camera,
            [group for group in groups if group],
            free_of,
            self._places_mm(),
            self.edge_state(options),
        )
        report(progress, 1, 1, _JOINING)
        return joint

    def _places_mm(self) -> dict[int, float]:
        """Return how far the axes of holes and pins may be off by their tolerances of position, by their surfaces.

        The zone holds two standard deviations to each side. A hole that is off as its drawing allows must not move the
        pose from which others are measured.
        """
        places: dict[int, float] = {}
        for key, target in self.by_witness.items():
            shape = target.measurand.geometry[0]
            if target.kind in POSITIONS and isinstance(shape, Circle) and target.tolerance:
                axis = self.model.carried_by[self.model.measured[key][0].name][1]
                places[axis] = max(places.get(axis, 0.0), target.tolerance[1] / 4)
        return places

    def _edges_half_px(self, registered: Mapping[str, Registered]) -> float:
        """Return how far from their predictions the edges of all images are searched, px."""
        planned = [shot for shot in self.shots if shot.name in registered]
        widest = NEAR_PX
        for shot in planned:
            if registered[shot.name].method == PLANNED:
                windows = search_windows_px(self.plan, self.plan.settings[shot.setting])
                widest = max(widest, *windows.values())
        return widest

    def _by_pose(self, pictures: Mapping[str, Picture], how: Registration) -> list[list[Shot]]:
        """Return the shots that have an image, those of one pose together: of a setting, unless each has its own."""
        groups: dict[object, list[Shot]] = {}
        for shot in self.shots:
            if shot.name in pictures:
                key = shot.name if shot.name in how.poses else shot.setting
                groups.setdefault(key, []).append(shot)
        return list(groups.values())

    def _registered(
        self, shots: list[Shot], pictures: Mapping[str, Picture], options: MeasureOptions
    ) -> Registered:
        """Return the pose of a setting, given its shots."""
        registration = options.registration
        shot = shots[0]
        planned = np.asarray(self.plan.settings[shot.setting].cam2world)
        uncertainty = registration.pose_uncertainty or self.plan.pose_uncertainty
        pose = planned
        covariance = uncertainty.covariance
        setting_pictures = [pictures[shot.name] for shot in shots]
        if registration.board is not None:
            try:
                pose, covariance = locate(
                    registration.board,
                    setting_pictures,
                    planned,
                    covariance,
                    options.repeatability,
                )
            except NoFiducialsError as error:
                raise NotRegisteredError(str(error)) from None
        if registration.method in (OWN_EDGES, BOTH):
            return self._by_edges(shot.setting, setting_pictures, pose, covariance, options)
        if registration.method == GIVEN:
            stem = shot.name if shot.name in registration.poses else setting_name(shot.setting)
            if stem not in registration.poses:
                raise RequestError.of_rule(
                    "register", "must hold the pose of every image", f"none of {shot.name}"
                )
            pose = registration.poses[stem]
        registered = as_given(
            self.model, pose, covariance, self._surfaces_mm(registration), registration.method
        )
        if registration.method != PLANNED:
            spread = self.plan.pose_uncertainty.covariance + np.diag(LEAST_POSE**2)
            if registration.method == GIVEN:
                # both poses are off the real one
                spread = spread + covariance
            chi2 = distance_of(displacement_between(planned, pose), spread)
            check_distance(chi2)
            registered = replace(registered, chi2=chi2)
        if registration.board is None:
            self._check_edges(registered, setting_pictures, planned, options)
        return registered

    def _by_edges(
        self,
        setting: int,
        pictures: list[Picture],
        pose: NDArray[np.float64],
        covariance: NDArray[np.float64],
        options: MeasureOptions,
    ) -> Registered:
        """Return the pose of a setting by the part's own edges, given what is known before."""
        stated = covariance, self._surfaces_mm(options.registration)
        prior = prior_covariance(self.model, *stated, pictures[0].camera)
        try:
            registered = register_as_shown(
                self.model,
                pictures,
                pose,
                *stated,
                self._bias_px(options),
                self.edge_state(options),
                options.repeatability,
            )
        except NotRegisteredError as error:
            poses = [np.asarray(setting.cam2world) for setting in self.plan.settings]
            like = looks_like(self.model, pictures, poses, setting, prior)
            # what it looks like is the better reason
            why = f"{error.what}; it {like}" if like else str(error)
            state = self.edge_state(options)
            if state.stated and not state.is_sharp:
                why += f"; check also whether edges are {state}"
            raise NotRegisteredError(why, counts={} if like else error.counts) from None
        accuracy = self._bias_px(options), self.edge_state(options)
        check_lens(self.model, pictures, pose, prior, registered, *accuracy)
        return registered

    def _check_edges(
        self,
        stated: Registered,
        own: list[Picture],
        planned: NDArray[np.float64],
        options: MeasureOptions,
    ) -> None:
        """Refuse a stated pose that the part's edges contradict, if the images show enough of them to tell."""
        prior = self.plan.pose_uncertainty.covariance
        surfaces_mm = self._surfaces_mm(options.registration)
        bias_px = self._bias_px(options)
        try:
            state = self.edge_state(options)
            seen = register_as_shown(self.model, own, planned, prior, surfaces_mm, bias_px, state)
        except TooFarError:
            raise
        except NotRegisteredError:
            return
        if stated.method == GIVEN:
            spread = (stated.covariance + seen.covariance)[:POSE, :POSE]
            chi2 = distance_of(displacement_between(stated.cam2world, seen.cam2world), spread)
            check_distance(chi2, "its pose by the part's edges", "the stated one")

    def _surfaces_mm(self, how: Registration) -> float:
        if how.surfaces_mm is not None:
            return how.surfaces_mm
        planned = self.plan.request.registration
        if planned is not None and planned.surfaces_mm is not None:
            return planned.surfaces_mm
        targets = (self.plan.targets[name] for name in self.plan.promises)
        return max((target.surfaces_mm for target in targets), default=0.0)

    def _read(
        self, shot: Shot, picture: Picture, known: PartPosterior, options: MeasureOptions
    ) -> list[Reading]:
        """Return the readings of an image."""
        readings = []
        for name in shot.targets:
            image = known.known(name, shot.name)
            half_px = self._half_px(shot, image.registered)[name]
            readings.append(self._read_target(shot, name, picture, image, half_px, options))
        return readings

    def _read_target(
        self,
        shot: Shot,
        name: str,
        picture: Picture,
        image: KnownImage,
        half_px: float,
        options: MeasureOptions,
    ) -> Reading:
        """Return the reading of a target in an image, as it is at the joint estimate of all images."""
        registered = image.registered
        key = witness_key(self.plan.settings[shot.setting], name)
        target = self.by_witness[key]
        place = (name, shot.name, shot.setting)
        floor_px = self._floor_px(target.localisation, options)
        edge_state = self.edge_state(options, target)
        edges = list(self.model.measured[key])
        if target.measurand.in_image:
            search = (half_px, options.coverage, floor_px)
            reading = read_length(
                place,
                target.measurand,
                edges[0],
                picture,
                registered,
                self.model,
                search,
                edge_state,
            )
            return image.corrected(reading)
        samples = entity_samples(self.model, edges, registered, picture.camera, half_px)
        scans = [
            scan_entity(
                self.model,
                edge,
                frame,
                samples.of(k),
                picture,
                registered,
                half_px=half_px,
                coverage=options.coverage,
                edge_state=edge_state,
            )
            for k, (edge, frame) in enumerate(zip(edges, target.measurand.frames, strict=True))
        ]
        # components of a position are corrected before its length is taken
        return read_with(
            target.measurand,
            lambda value: image.corrected(
                read_value(place, value, scans, registered, self.model, floor_px, picture.camera)
            ),
            with_size=target.material is not None,
        )

    def _ends_of_others(self) -> dict[str, list[MeasuredEnd]]:
        """Return the entities of targets that no image of the plan shows whole, each with its share of the value."""
        ends = {}
        for name in (*self.plan.split, *self.plan.uninspectable):
            value = self._split_target(name).measurand
            if not can_be_split(value):
                continue
            ends[name] = [
                MeasuredEnd(name, End(value, k), self.model.entity(shape, name), self.model)
                for k, shape in enumerate(value.geometry)
            ]
        return ends

    def _split_target(self, name: str) -> Target:
        """Return a target that no image shows whole, by the witness of the settings that measure its ends."""
        settings = [setting for setting in self.plan.settings if name in setting.ends]
        if not settings:
            return self.plan.targets[name]
        return whole_targets(self.plan, settings[0])[name]

    def _why_unregistered(self, failed: Mapping[str, tuple[str, str]]) -> dict[str, list[str]]:
        """Return by target why images that the plan has for its ends cannot be registered."""
        why: dict[str, list[str]] = {name: [] for name in self.ends}
        for shot in self.shots:
            if shot.name not in failed:
                continue
            for name in self.plan.settings[shot.setting].ends:
                reason = f"the image cannot be registered: {with_advice(*failed[shot.name])}"
                why[name].append(f"{shot.name}: {reason}")
        return why

    def _of_several_images(
        self,
        response: JudgedResponse,
        registered: Mapping[str, Registered],
        failed: Mapping[str, tuple[str, str]],
        known: PartPosterior,
        options: MeasureOptions,
    ) -> dict[str, Result]:
        """Return results of targets whose entities are in different images, whether the plan inspects them or not."""
        why = self._why_unregistered(failed)
        best: dict[str, dict[int, ScannedEnd]] = {name: {} for name in self.ends}
        for shot in self.shots:
            image = registered.get(shot.name)
            if image is None:
                continue
            planned = self.plan.settings[shot.setting].ends
            for name, ends in self.ends.items():
                groups = end_groups(ends[0].value.whole)
                for k, end in enumerate(ends):
                    is_planned = name in planned and k in groups[planned[name]]
                    if not is_planned and (
                        image.method != OWN_EDGES
                        or not end.is_shown(image, self.plan.camera, options.coverage)
                    ):
                        continue
                    scanned = self._scanned_end(shot, end, response, known, options)
                    if is_planned and not scanned.first.measured:
                        why[name].append(f"{shot.name}: {scanned.first.reason}")
                    worse = best[name].get(k)
                    if scanned.first.measured and (worse is None or scanned.spread < worse.spread):
                        best[name][k] = scanned
        missing = {
            name: merged(
                name,
                self.plan.targets[name],
                (),
                options.rule,
                "; ".join(why[name]) or "an image of one of its entities is missing",
            )
            for name in self.plan.split
        }
        results = dict(missing)
        for name, scans in best.items():
            if len(scans) < len(self.ends[name]):
                continue
            entities = [scans[k] for k in sorted(scans)]
            target = self.plan.targets[name]
            if isinstance(target.measurand, Position):
                result = position_of_ends(target, entities, known.common, options.rule)
            else:
                readings = [entity.first for entity in entities]
                common = known.common(readings)
                result = joined_ends(name, target, readings, options.rule, common)
            reason = self.plan.uninspectable.get(name)
            if reason is not None:
                # it is read all the same, from what images show of it
                refused = f"{NOT_INSPECTED}{reason}"
                notes = (*result.notes, refused)
                result = replace(result, notes=notes, is_planned=False)
            results[name] = result
        return results

    def _scanned_end(
        self,
        shot: Shot,
        end: MeasuredEnd,
        response: JudgedResponse,
        posterior: PartPosterior,
        options: MeasureOptions,
    ) -> ScannedEnd:
        """Return one entity of a target as an image shows it, also with other responses of the camera."""
        target = self.plan.targets[end.target]
        image = posterior.known(end.target, shot.name)
        scans = [
            self._scan_end(shot, end, pictures[shot.name], image.registered, options)
            for pictures in (response.pictures, *response.others)
        ]
        floor_px = self._floor_px(target.localisation, options)

        def read(value: End) -> Reading:
            reading, *others = [
                image.corrected(
                    read_value(
                        (end.target, shot.name, shot.setting),
                        value,
                        [scan],
                        image.registered,
                        self.model,
                        floor_px,
                        self.plan.camera,
                    )
                )
                for scan in scans
            ]
            return replace(response.counted(reading, others), entity=end.edge.name)

        first = read(end.value)
        spread = first.standard_uncertainty
        if isinstance(target.measurand, Position) and first.measured:
            axes = np.eye(len(target.measurand.frame.errors))
            components = [End(target.measurand.along(axis), end.value.entities) for axis in axes]
            spread = math.hypot(*(read(value).standard_uncertainty for value in components))
        return ScannedEnd(read, first, spread)

    def _scan_end(
        self,
        shot: Shot,
        end: MeasuredEnd,
        picture: Picture,
        registered: Registered,
        options: MeasureOptions,
    ) -> EntityScan:
        """Return what an image shows of one entity of a target."""
        target = self.plan.targets[end.target]
        edge_state = self.edge_state(options, target)
        half_px = NEAR_PX
        if registered.method != OWN_EDGES:
            setting = self.plan.settings[shot.setting]
            whole = {end.target: self._split_target(end.target)}
            half_px = self._searched_px(setting, whole, registered)[end.target]
        samples = entity_samples(self.model, [end.edge], registered, picture.camera, half_px)
        return scan_entity(
            self.model,
            end.edge,
            end.value.frames[0],
            samples.of(0),
            picture,
            registered,
            half_px=half_px,
            coverage=options.coverage,
            edge_state=edge_state,
        )

    def _half_px(self, shot: Shot, registered: Registered) -> dict[str, float]:
        """Return how far from its prediction each target is searched, px."""
        if registered.method == OWN_EDGES:
            # deviations are estimated, and entities are searched for where these put them
            return dict.fromkeys(shot.targets, NEAR_PX)
        setting = self.plan.settings[shot.setting]
        targets = {name: self.by_witness[witness_key(setting, name)] for name in shot.targets}
        return self._searched_px(setting, targets, registered)

    def _searched_px(
        self, setting: SensorSetting, targets: Mapping[str, Target], registered: Registered
    ) -> dict[str, float]:
        """Return how far from their predictions targets are searched where their deviations are not estimated, px."""
        room = {name: self._tolerance_px(target, registered) for name, target in targets.items()}
        if registered.method != PLANNED:
            return {name: max(NEAR_PX, more + _ROOM_PX) for name, more in room.items()}
        windows = search_windows_px(self.plan, setting)
        return {name: windows[name] + more + _ROOM_PX for name, more in room.items()}

    def _tolerance_px(self, target: Target, registered: Registered) -> float:
        """Return the width of a target's tolerance in the image, px, so that a part outside it is found; at most 3.

        A tolerance with one limit does not say how far off a part may be: then it is 3.
        """
        share = target.permitted_error_px(registered.cam2world, self.plan.camera)
        if target.tolerance is None or share is None:
            return 0.0
        if is_one_sided(target.tolerance):
            return _MOST_TOLERANCE_PX
        lower, upper = target.tolerance
        return min((upper - lower) * share / target.permitted_error, _MOST_TOLERANCE_PX)

    def edge_state(self, options: MeasureOptions, target: Target | None = None) -> EdgeState:
        """Return by how much the edges of a target are broken, or of the whole part.

        Parameters
        ----------
        options : MeasureOptions
            What is stated here counts more than what the plan states of the part.
        target : Target, optional
            What it states of its own edges counts most. Default: none.

        Returns
        -------
        EdgeState
            What is stated, or sharp within 0.05 mm.
        """
        of_target = getattr(target, "edge_break_mm", None)
        return EdgeState.of(of_target, options.edge_break_mm, self.plan.request.edge_break_mm)

    def _is_wide(self, state: EdgeState, registered: Mapping[str, Registered]) -> bool:
        """Return whether edges are stated as broken so widely that light beside them is asymmetric."""
        if not state.stated or not registered:
            return False
        poses = [image.cam2world for image in registered.values()]
        return state.high_mm > UNCLEAR_PX * pixel_mm(self.plan.camera, self.model.solid, poses)

    def _floor_px(self, planned: Localisation, options: MeasureOptions) -> float:
        if options.localisation is not None:
            return options.localisation.floor_px
        # broken edges are an error of its own here, which the default of plans stands for
        is_default = planned.floor_px in (0.0, FLOOR_PX)
        return DETECTOR_FLOOR_PX if is_default else planned.floor_px

    def _bias_px(self, options: MeasureOptions) -> float:
        """Return the standard deviation of edges' biases, px."""
        targets = (self.plan.targets[name] for name in self.plan.promises)
        floors = (self._floor_px(target.localisation, options) for target in targets)
        return bias_of(max(floors, default=DETECTOR_FLOOR_PX))

    def _not_planned(self, rule: DecisionRule) -> dict[str, Result]:
        """Return results of what the plan does not inspect: the reason is the plan's."""
        results = {
            name: merged(name, self.plan.targets[name], (), rule, f"{NOT_PLANNED}{reason}")
            for name, reason in self.plan.uninspectable.items()
        }
        return {name: replace(result, is_planned=False) for name, result in results.items()}

    def _correlation(
        self, results: Mapping[str, Result], known: PartPosterior
    ) -> NDArray[np.float64]:
        """Return the correlation of measured values by what they have in common: poses and surfaces."""
        names = [name for name in self.plan.entities if results[name].measured]
        values = []
        for name in names:
            readings = [reading for reading in results[name].readings if reading.measured]
            common = known.common(readings) if len(readings) > 1 else None
            values.append((readings, weights_of(readings, common)))
        u = np.array([results[name].standard_uncertainty for name in names])
        correlation = known.common_of_values(values) / np.outer(u, u)
        np.fill_diagonal(correlation, 1.0)
        return correlation

    def _source(self, found: ImageSet, operator: str) -> Source:
        return Source(
            program=program_name(),
            part=self.plan.part,
            part_digest=self._digest,
            images=dict(found.digests),
            image_files=dict(found.files),
            date=timestamp(),
            operator=operator,
            plan_digest=self.plan.digest,
            camera=self.plan.camera,
            part_file_sha256=self._part_file_sha256,
        )


def _wide_note(solid: Solid, plan: InspectionPlan, how: Registration) -> list[str]:
    """Return a note on faces that are stated to deviate by more than images tell; none otherwise.

    It is found before images are read, which takes long.

    Raises
    ------
    RequestError
        If they deviate by more than edges are searched from where they should be.
    """
    pixel = pixel_mm(plan.camera, solid, [setting.cam2world for setting in plan.settings])
    stated = how.surfaces_mm
    if stated is None or stated <= FREE_PX * pixel:
        return []
    if stated > MOST_WINDOW_PX * pixel:
        raise RequestError.of_rule(
            "surfaces_mm",
            f"must be at most {MOST_WINDOW_PX * pixel:.2g} mm, which are {MOST_WINDOW_PX:g} px of these images: edges "
            "are searched no farther from where they should be",
            f"{stated:g}",
        )
    return [
        f"faces are stated to deviate by {stated:g} mm, {stated / pixel:.0f} px of these images. Of more than "
        f"{FREE_PX:g} px, nothing is known of where they are, so U is larger than with a deviation that parts have"
    ]


def _pictures(images: ImageSet, camera: Camera, progress: Progress | None) -> dict[str, Picture]:
    """Return images as they are measured in, by name."""
    pictures = {}
    for k, (name, image) in enumerate(images.images.items()):
        report(progress, k, len(images.images), _PREPARING)
        pictures[name] = Picture.of(name, image, camera, images.responses.get(name))
    report(progress, len(images.images), len(images.images), _PREPARING)
    return pictures


@suggests_names
def measure(
    plan: InspectionPlan,
    solid: Solid,
    images: str | os.PathLike[str] | Mapping[Any, Any],
    *,
    registration: Registration | None = None,
    localisation: Localisation | None = None,
    coverage: float = MeasureOptions.coverage,
    rule: DecisionRule | None = None,
    white_level: int | None = MeasureOptions.white_level,
    response: str | float | None = MeasureOptions.response,
    edge_break_mm: tuple[float, float] | None = MeasureOptions.edge_break_mm,
    repeatability: PoseUncertainty = MeasureOptions.repeatability,
    serial: str = "",
    operator: str = "",
    partial: bool = False,
    allow_lossy: bool = False,
    progress: Progress | None = None,
) -> MeasurementResults:
    """Measure one part in images of a plan's settings.

    A `Measurer` measures many parts of one plan faster. It takes the keywords up to
    ``repeatability`` as `MeasureOptions`.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    solid : Solid
        Its part.
    images : path or mapping
        A folder with ``setting_01.png`` and so on; or the number of a setting, from 1, to a file or to an array (h, w)
        of grey values.
    registration : Registration, optional
        How the poses are known. Default: from the part's own edges.
    localisation : Localisation, optional
        How well edges are found; only its floor counts, because single points are judged by their own residuals.
        Default: that of the plan. If that is none or the default of 0.05 px, it is 0.01 px, see `MeasureOptions`.
    coverage : float
        Share of an entity that must be found, in (0, 1].
    rule : DecisionRule, optional
        How it is decided. Default: ISO 14253-1 with 95 %.
    white_level : int, optional
        Grey value of full exposure. Default: that of the plan's camera, see `Camera`.
    response : str or float, optional
        How much light a grey value stands for: "linear", "srgb", a gamma, or a file. Default: that of the plan's
        camera, see `Camera`.
    edge_break_mm : (float, float), optional
        By how much the part's edges are broken, least and most, mm. Default: that of the plan; without it, edges are
        sharp within 0.05 mm.
    repeatability : PoseUncertainty
        By how much the camera moves between the images that a setting takes under different lamps. Default: 0.02 mm
        and 0.1 mrad.
    serial : str
        Name of the part, for the files.
    operator : str
        Who measures, for the files.
    partial : bool
        Whether images may be missing.
    allow_lossy : bool
        Whether JPEG files are accepted.
    progress : callable, optional
        Takes how many images are done, of how many, and a label.

    Returns
    -------
    MeasurementResults
        A result for each target.

    Raises
    ------
    RequestError
        If the part is not the plan's, or images are missing or wrong.

    Examples
    --------
    >>> import numpy as np
    >>> from aspectgraph import Solid
    >>> from planner import measure, read_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> solid = Solid.read("examples/two_pocket_block.off")
    >>> width, height = plan.camera.resolution
    >>> dark = {k + 1: np.full((height, width), k, np.uint8) for k in range(len(plan.settings))}
    >>> measure(plan, solid, dark).measured
    False
    """
    options = MeasureOptions(
        registration=registration or MeasureOptions().registration,
        rule=rule or MeasureOptions().rule,
        localisation=localisation,
        coverage=coverage,
        white_level=white_level,
        response=response,
        edge_break_mm=edge_break_mm,
        repeatability=repeatability,
    )
    return Measurer(plan, solid).measure(
        images,
        options,
        serial=serial,
        operator=operator,
        partial=partial,
        allow_lossy=allow_lossy,
        progress=progress,
    )
