"""What to change in the shop where an image or a reading fails: one sentence, for the likeliest cause."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from planner.camera.response import LINEAR
from planner.exceptions import PlanFileError
from planner.files import read_json
from planner.light.light_plan import beside, irradiance
from planner.measuring.images import (
    DARK_SHARE,
    MOST_BLUR_PX,
    STATED,
    WELL_EXPOSED,
    Picture,
    longer,
)
from planner.measuring.reading import Reading, largest_state
from planner.measuring.registered import Registered
from planner.measuring.registration import Registration
from planner.measuring.samples import CLIPPED_SHARE, STATE_TEXTS, State
from planner.request.edge_state import EdgeState
from planner.request.registration import PLANNED
from planner.request.targets import targets_of
from planner.sensor_setting import setting_name
from planner.verify.setting_record import search_windows_px

if TYPE_CHECKING:
    from aspectgraph.solid.solid import RayScene
    from planner.light.area_light import AreaLight
    from planner.light.light_plan import LitImage
    from planner.plan import InspectionPlan

TRUTH = "truth.json"
"""File of the true values, beside rendered images."""

SHORTER = "expose for a shorter time: edges lie beside overexposed places"
FOCUS = "focus: blurred edges run into each other"
LIGHT = "light it from another side: the faces beside it are about equally bright"
TWO_STEPS = (
    "look at the edge: a broken or printed edge shows two steps; state its break, "
    "or light it so that only one shows, for example from behind"
)
SHADOW = "move the lamp: the shadow that it casts ends beside the edge"
NEAR_LINE = "measure it from another view: another line of the part lies beside it here"
AT_END = (
    "check that the part is of this revision and lies as planned: edges lie at the end of where they "
    "are searched; state how far surfaces deviate if it does"
)
MOVED = "check that the part is of this revision; state how far surfaces deviate if they are farther off"
ROUGH = (
    "clean the edge, or light it more evenly: what is found lies on no line or circle; "
    "if the edge has a wide chamfer, model it as a face"
)
OUTSIDE = "check the pose: the edge leaves the image"
ANOTHER = "nothing of the part is where it should be: is it an image of this part and setting?"
UNLIT = "move a lamp or add one: the plan has none that shows it here"
REGISTER = "register the image: nothing else tells how far it is off its planned pose"
HIDDEN = "measure it from another view: the part hides it here"

# of samples that are lost in the likeliest way; blur makes others
_BY_STATE = {
    State.CLIPPED: SHORTER,
    State.TWO_STEPS: TWO_STEPS,
    State.SHADOW: SHADOW,
    State.NEAR_LINE: NEAR_LINE,
    State.AT_END: AT_END,
    State.OUTLIER: ROUGH,
    State.OUTSIDE: OUTSIDE,
    State.HIDDEN: HIDDEN,
}
# how edges are lost that are not where they are looked for
_OF_POSE = tuple(
    STATE_TEXTS[state]
    for state in (State.TWO_STEPS, State.SHADOW, State.NEAR_LINE, State.AT_END, State.OUTLIER)
)
_BY_TEXT = {STATE_TEXTS[state]: advice for state, advice in _BY_STATE.items()}
_OF_BLUR = tuple(
    STATE_TEXTS[state] for state in (State.WEAK, State.TWO_STEPS, State.AT_END, State.OUTLIER)
)
# px around samples, to see whether there is light
_AROUND_PX = 4
_BRIGHT = 0.95
# of a digest in a sentence
_DIGITS = 12
# share of the samples of all edges below which an image shows nothing of the part in its place
_NOTHING_SHARE = 0.02


def advice_of(
    counts: Mapping[str, int], picture: Picture, places: NDArray[np.float64], blur_px: float
) -> str:
    """Return what to change, for edges that were not found.

    Parameters
    ----------
    counts : mapping of str to int
        Samples by what became of them, in words, see `planner.measuring.samples.STATE_TEXTS`.
    picture : Picture
        The image.
    places : array (m, 2)
        Where the samples are, px.
    blur_px : float
        Blur across edges of the image; nan if it is not known.

    Returns
    -------
    str
        A clause in the imperative; empty if nothing was lost.
    """
    worst = largest_state(counts)
    if not worst:
        return ""
    if blur_px > MOST_BLUR_PX and worst in _OF_BLUR:
        return FOCUS
    if (
        worst == STATE_TEXTS[State.AT_END]
        and counts.get(STATE_TEXTS[State.FOUND], 0) >= counts[worst]
    ):
        # an edge that is mostly where it should be has not moved: something else is beside it
        return SHADOW
    if worst != STATE_TEXTS[State.WEAK]:
        return _BY_TEXT[worst]
    bright = brightness(picture, places)
    if bright < DARK_SHARE:
        return f"{longer(bright)}, or light it from another side: it is dark there"
    return LIGHT


def lacks_registration(plan: InspectionPlan, how: Registration) -> bool:
    """Return whether images are taken at planned poses, although the plan counts on their registration."""
    planned = plan.request.registration
    return planned is not None and planned.method != PLANNED and how.method == PLANNED


def of_poses(reading: Reading) -> Reading:
    """Return a reading of an image that lacks registration, with the likeliest cause of what is lost."""
    is_lost = not reading.measured and bool(reading.points)
    if is_lost and (reading.moved or largest_state(reading.counts) in _OF_POSE):
        return replace(reading, advice=REGISTER)
    return reading


def unregistered_note(plan: InspectionPlan) -> str:
    """Return the note on images that lack registration."""
    windows = (search_windows_px(plan, setting).values() for setting in plan.settings)
    widest = max(max(of_setting, default=0.0) for of_setting in windows)
    return (
        "the images are not registered, and the plan counts on it. They may be up to about "
        f"{widest:.0f} px off the planned poses. Register them to the part's edges or to a board"
    )


def digest_of_rendering(images: object) -> str:
    """Return the digest of the plan that images were rendered for, as the file beside them states; "" of others."""
    if not isinstance(images, str | os.PathLike):
        return ""
    try:
        truth = read_json(Path(images) / TRUTH, "file")
    except PlanFileError:
        return ""
    digest = truth.get("plan_digest") if isinstance(truth, dict) else ""
    return digest if isinstance(digest, str) else ""


def rendered_note(plan: InspectionPlan, digest: str) -> str:
    """Return the note on images that were rendered for another plan, given the digest of theirs; nothing of others."""
    if digest in ("", plan.digest):
        return ""
    return (
        f"the images were rendered for another plan: {TRUTH} beside them states the SHA-256 {digest[:_DIGITS]}… of "
        f"its file, and that of this plan is {plan.digest[:_DIGITS]}…. Render them again if settings differ"
    )


def sharp_note(digest: str, states: Iterable[EdgeState]) -> str:
    """Return the note on rendered images, which have a digest, if edges are stated as broken: theirs are sharp."""
    broken = [state for state in states if state.stated and not state.is_sharp]
    if not broken or not digest:
        return ""
    return (
        f"the images are rendered, with sharp edges, and edges are stated as {broken[0]}: values are off by "
        "about as much. --edges sharp (edge_break_mm=(0, 0) in Python) measures what is drawn, but for targets with "
        "edges of their own"
    )


def plan_notes(
    plan: InspectionPlan, how: Registration, digest: str, states: Iterable[EdgeState]
) -> list[str]:
    """Return notes on what a plan counts on in vain, and on what it leaves out of the CAD model.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    how : Registration
        How the poses of the images are known.
    digest : str
        Of the plan that the images were rendered for; empty of others, see `digest_of_rendering`.
    states : iterable of EdgeState
        How edges are taken to be broken.
    """
    texts = [rendered_note(plan, digest), sharp_note(digest, states)]
    notes = [text for text in texts if text]
    if plan.light_missing:
        notes.append(
            "light was requested and is not planned yet, so nothing is promised of contrast"
        )
    if lacks_registration(plan, how):
        notes.append(unregistered_note(plan))
    names: dict[str, list[str]] = {}
    for name, reason in plan.not_planned.items():
        names.setdefault(reason, []).append(name)
    return notes + [
        f"not planned, and so not measured: {', '.join(of)}: {why}" for why, of in names.items()
    ]


def brightness(picture: Picture, places: NDArray[np.float64]) -> float:
    """Return how bright the bright pixels around places (m, 2) are, as a share of white; 0 off the image."""
    finite = places[np.isfinite(places).all(axis=1)]
    steps = np.arange(-_AROUND_PX, _AROUND_PX + 1)
    shifts = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    pixels = (np.rint(finite).astype(np.int64)[:, None] + shifts).reshape(-1, 2)
    height, width = picture.grey.shape
    inside = ((pixels >= 0) & (pixels < [width, height])).all(axis=1)
    if not inside.any():
        return 0.0
    u, v = pixels[inside].T
    return float(np.quantile(picture.grey[v, u], _BRIGHT)) / picture.white


def advised(
    reading: Reading,
    picture: Picture,
    blur_px: float,
    *,
    is_unlit: bool = False,
) -> Reading:
    """Return a reading that says what to change if it has no value.

    Parameters
    ----------
    reading : Reading
        The reading.
    picture : Picture
        Its image.
    blur_px : float
        Blur across edges of the image; nan if it is not known.
    is_unlit : bool
        Whether the plan says that no lamp shows its target there.
    """
    if reading.measured or not reading.points:
        return reading
    places = np.concatenate([np.c_[points["u"], points["v"]] for points in reading.points])
    advice = UNLIT if is_unlit else advice_of(reading.counts, picture, places, blur_px)
    return replace(reading, advice=MOVED if reading.moved else advice)


def advice_of_images(pictures: Sequence[Picture], lost: Mapping[str, int]) -> str:
    """Return what to change, for images of a setting that cannot be registered.

    Parameters
    ----------
    pictures : sequence of Picture
        The images.
    lost : mapping of str to int
        Samples of all edges by what became of them, in words; empty if they were not looked for.

    Returns
    -------
    str
        A clause in the imperative; empty if nothing is known.
    """
    if all(picture.overexposed for picture in pictures):
        return "expose for half of the time or less: much of the image is overexposed"
    bright = max(picture.bright_share for picture in pictures)
    if bright < DARK_SHARE:
        return f"{longer(bright)}: the image is dark"
    advice = _advice_of_lost(lost)
    if not any(
        picture.response_from == STATED and picture.response != LINEAR for picture in pictures
    ):
        return advice
    # a wrong one moves edges, and by how much depends on how far they are from sharp
    return f"{advice}; and check the stated response" if advice else "check the stated response"


def _advice_of_lost(lost: Mapping[str, int]) -> str:
    """Return what to change by what became of samples, in words; empty if nothing is known."""
    found = lost.get(STATE_TEXTS[State.FOUND], 0)
    if lost and found < _NOTHING_SHARE * sum(lost.values()):
        return ANOTHER
    worst = largest_state(lost)
    if worst == STATE_TEXTS[State.WEAK]:
        return "light more of the part: many of its edges lack contrast"
    if worst in (STATE_TEXTS[State.AT_END], STATE_TEXTS[State.OUTLIER]):
        return "check the part's revision, its clamping and the camera's pose"
    return _BY_TEXT.get(worst, "")


def with_advice(reason: str, advice: str) -> str:
    """Return why an image fails, and what to change if that is known."""
    return f"{reason}; {advice}" if advice else reason


def as_sentence(advice: str) -> str:
    """Return advice as a sentence; empty if there is none."""
    return f"{advice[:1].upper()}{advice[1:]}." if advice else ""


# What is wrong with exposure and focus of images, and for what share of the time to expose
# instead.


LOST_SHARE = 0.05
"""An overexposed share of a target's samples from which on its image has a note, if it is not measured."""

# levels of light that places beside edges are sorted by
_LEVELS = 20
# of places at a level, and of levels that are not overexposed, to know how bright the part is
_FEWEST = 5
_FEWEST_LEVELS = 2


def image_notes(
    plan: InspectionPlan,
    scene: RayScene,
    pictures: Mapping[str, Picture],
    registered: Mapping[str, Registered],
    readings: Mapping[str, list[Reading]],
) -> list[str]:
    """Return notes on images.

    Parameters
    ----------
    plan : InspectionPlan
        The plan. Its lamps tell how bright the overexposed places are.
    scene : RayScene
        Of the part.
    pictures : mapping of str to Picture
        The images, by name.
    registered : mapping of str to Registered
        Their poses.
    readings : mapping of str to list of Reading
        What was read in them, by target.
    """
    lit = _lit_images(plan)
    # what was stated of the part, and is not so
    notes = [
        f"{name}: {warning}"
        for name, registration in registered.items()
        for warning in registration.warnings
    ]
    for name, picture in pictures.items():
        lost = [
            reading.name
            for target_readings in readings.values()
            for reading in target_readings
            if reading.image == name
            and not reading.measured
            and reading.overexposed_share > LOST_SHARE
        ]
        share = None
        if name in lit and (lost or picture.overexposed):
            k, image = lit[name]
            setting = plan.settings[k]
            targets = targets_of(plan.targets, setting)
            pose = registered[name].cam2world if name in registered else setting.cam2world
            assert plan.light is not None
            share = exposure_share(
                picture,
                scene,
                np.asarray(pose),
                {name: targets[name].points for name in image.contrast},
                plan.light.area or plan.light.lamps[list(image.lamps)],
            )
        blur = registered[name].blur_px if name in registered else 0.0
        notes += [
            f"{name}: {note}" for note in picture.notes(blur, lost, share, planned=name in lit)
        ]
    return notes


def _lit_images(plan: InspectionPlan) -> dict[str, tuple[int, LitImage]]:
    """Return setting and lamps of each image, by name; none of a plan without lamps."""
    images = () if plan.light is None else plan.light.images
    return {
        setting_name(k, i if len(setting_images) > 1 else None): (k, image)
        for k, setting_images in enumerate(images)
        for i, image in enumerate(setting_images)
    }


def exposure_share(
    picture: Picture,
    scene: RayScene,
    cam2world: NDArray[np.float64],
    points: Mapping[str, NDArray[np.float64]],
    lamps: NDArray[np.float64] | AreaLight,
) -> float | None:
    """Return for what share of the time to expose, so that the brightest place beside edges has 80 % of white.

    How bright the part is, is seen where the image is not overexposed. How much brighter the brightest place is, is
    computed for a matt part.

    Parameters
    ----------
    picture : Picture
        The image.
    scene : RayScene
        Of the part.
    cam2world : array (4, 4)
        Pose of the camera.
    points : mapping of str to array (n, 3)
        Points on the edges of each target, mm.
    lamps : array (k, 3) or AreaLight
        The lamps that were on, mm, or the light with an area.

    Returns
    -------
    float or None
        Below 1. None if too little is not overexposed, or if the light does not explain that anything is.
    """
    rings = [
        beside(picture.camera, cam2world, target_points).reshape(-1, 2)
        for target_points in points.values()
    ]
    pixels = np.concatenate(rings)
    light = irradiance(scene, cam2world, picture.camera, pixels, lamps)
    u, v = np.rint(pixels[light > 0]).astype(int).T
    levels, shares = _by_light(light[light > 0], picture.grey[v, u] / picture.white)
    # where half of the places are overexposed, and where there is more light, nothing is seen
    fair = np.logical_and.accumulate(shares < picture.clipped_from / picture.white)
    if fair.sum() < _FEWEST_LEVELS:
        return None
    # a line, as some light comes from everywhere
    slope, base = np.polyfit(levels[fair], shares[fair], 1)
    full = base + slope * light.max()
    return WELL_EXPOSED / float(full) if full > CLIPPED_SHARE else None


def _by_light(
    light: NDArray[np.float64], shares: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return levels of light in rising order, and the median share of white at each; rare levels are left out."""
    number = np.minimum((_LEVELS * light / light.max(initial=0.0)).astype(int), _LEVELS - 1)
    usual = [k for k in range(_LEVELS) if (number == k).sum() >= _FEWEST]
    levels = np.array([np.median(light[number == k]) for k in usual])
    return levels, np.array([np.median(shares[number == k]) for k in usual])
