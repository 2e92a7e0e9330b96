"""All kinds of lights with an area: how files tell them apart, and words for those that follow from part and camera."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias, TypeGuard

import numpy as np

from planner.light.area_light import AreaLight
from planner.light.backlight import Backlight
from planner.light.light_catalogue import catalogued_light
from planner.light.mounted_light import (
    MOUNTED,
    CoaxialLight,
    DiffuseDome,
    RingLight,
    of_material,
)
from planner.light.reflection import Material

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.camera.camera import Camera

BACKLIGHT = "backlight"
"""A backlight that the part lies on, as large as `Backlight.under` makes it."""

AREA_LIGHTS: dict[str, type] = {
    BACKLIGHT: Backlight,
    "diffuse-dome": DiffuseDome,
    "coaxial": CoaxialLight,
    "ring-light": RingLight,
}
"""The classes of area lights by kind."""

AreaRecord: TypeAlias = Backlight | DiffuseDome | CoaxialLight | RingLight
"""An area light as files hold it."""


def is_area_light(value: object) -> TypeGuard[AreaLight]:
    """Tell whether a value is a light with an area."""
    return isinstance(value, tuple(AREA_LIGHTS.values()))


def is_area_word(value: object) -> bool:
    """Tell whether a value is the word for a light with an area: a kind, or ``KIND:NAME`` of the catalogue."""
    return isinstance(value, str) and value.partition(":")[0] in AREA_LIGHTS


def area_of_word(word: str, solid: Solid, camera: Camera, material: Material) -> AreaLight:
    """Return the light that a word stands for.

    Parameters
    ----------
    word : str
        Such as "backlight" or "coaxial:NAME".
    solid : Solid
        The part, which a backlight lies under.
    camera : Camera
        The camera, which carries the others.
    material : Material
        Of the part.

    Raises
    ------
    RequestError
        If the catalogue has no such name, or the camera is focused at infinity.
    """
    kind, _, name = word.partition(":")
    if name:
        light: AreaLight = catalogued_light(kind, name, solid, camera)
        return in_material(light, material)
    if kind == BACKLIGHT:
        return in_material(Backlight.under(solid), material)
    low, high = solid.bounds
    return MOUNTED[kind](camera, material, float(np.linalg.norm(np.subtract(high, low))))


def in_material(light: AreaLight, material: Material) -> AreaLight:
    """Return the same light on a part of a material."""
    if isinstance(light, Backlight):
        return replace(light, metal=material.kind == "metal")
    if isinstance(light, DiffuseDome | CoaxialLight | RingLight):
        return of_material(light, material)
    return light
