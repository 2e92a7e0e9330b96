"""What is wrong with exposure and focus of images, and for what share of the time to expose instead."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from planner.light.exposure import beside, irradiance
from planner.measuring.image.picture import WELL_EXPOSED, Picture
from planner.measuring.image.scans import CLIPPED_SHARE
from planner.measuring.poses.registered import Registered
from planner.measuring.reading import Reading
from planner.setting.image_names import setting_name
from planner.wanted.planned import targets_of

if TYPE_CHECKING:
    from aspectgraph.solid.ray_scene import RayScene
    from planner.light.light_plan import LitImage
    from planner.plan import InspectionPlan

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
    notes = [f"{name}: {one}" for name, own in registered.items() for one in own.warnings]
    for name, picture in pictures.items():
        lost = [
            one.name
            for own in readings.values()
            for one in own
            if one.image == name and not one.measured and one.overexposed_share > LOST_SHARE
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
                {one: targets[one].points for one in image.contrast},
                plan.light.lamps[list(image.lamps)],
            )
        blur = registered[name].blur_px if name in registered else 0.0
        notes += [f"{name}: {note}" for note in picture.notes(blur, lost, share)]
    return notes


def _lit_images(plan: InspectionPlan) -> dict[str, tuple[int, LitImage]]:
    """Return setting and lamps of each image, by name; none of a plan without lamps."""
    images = () if plan.light is None else plan.light.images
    return {
        setting_name(k, i if len(own) > 1 else None): (k, image)
        for k, own in enumerate(images)
        for i, image in enumerate(own)
    }


def exposure_share(
    picture: Picture,
    scene: RayScene,
    cam2world: NDArray[np.float64],
    points: Mapping[str, NDArray[np.float64]],
    lamps: NDArray[np.float64],
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
    lamps : array (k, 3)
        The lamps that were on, mm.

    Returns
    -------
    float or None
        Below 1. None if too little is not overexposed, or if the light does not explain that anything is.
    """
    rings = [beside(picture.camera, cam2world, own).reshape(-1, 2) for own in points.values()]
    pixels = np.concatenate(rings)
    light = irradiance(scene, cam2world, picture.camera, pixels, lamps)
    u, v = np.rint(pixels[light > 0]).astype(int).T
    levels, shares = _by_light(light[light > 0], picture.grey[v, u] / picture.white)
    # where half of the places are overexposed, and where there is more light, nothing is seen
    fair = np.logical_and.accumulate(shares < CLIPPED_SHARE)
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
