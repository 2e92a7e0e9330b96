"""All kinds of lights with an area: how files tell them apart, and words for those that follow from part and camera."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias, TypeGuard

import numpy as np

from planner.light.area_light import AreaLight
from planner.light.backlight import Backlight
from planner.light.mounted_light import (
    MOUNTED,
    CoaxialLight,
    DiffuseDome,
    MountedLight,
    RingLight,
    distance_before,
    of_material,
)
from planner.light.reflection import Material
from planner.light_catalogue import light_facts
from planner.robotcell.cell_light import CarriedLight, LightBox

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


def catalogued_light(
    kind: str, name: str, solid: Solid, camera: Camera
) -> Backlight | MountedLight:
    """Return a light of the catalogue in its place: under a part, or above the plane in focus of a camera.

    Parameters
    ----------
    kind, name : str
        Such as "coaxial" and "typical-50".
    solid : Solid
        The part; z is up.
    camera : Camera
        The camera.

    Raises
    ------
    RequestError
        If there is no such light, or it does not fit before the camera.
    """
    facts = light_facts(kind, name)
    key = name.lower()
    if kind == "backlight":
        low, high = solid.bounds
        place = (float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2, float(low[2]))
        return Backlight.horizontal(place, facts["width_mm"], facts["height_mm"], key)
    return _carried(kind, key, distance_before(camera, facts["working_mm"], f"{kind}:{key}"))


def _carried(kind: str, name: str, distance_mm: float) -> MountedLight:
    """Return a light of the catalogue so far before a camera."""
    facts = light_facts(kind, name)
    sizes = {key: value for key, value in facts.items() if key not in ("working_mm", "source")}
    light: MountedLight = AREA_LIGHTS[kind](**sizes, distance_mm=distance_mm, name=name.lower())
    return light


def light_of_cell(cell: object) -> AreaRecord | None:
    """Return the light of a robot cell as plans ask for it, on a matt part; None if the cell states none.

    Parameters
    ----------
    cell : Cell, or another region of poses
        The cell. Only a `Cell` has a light.
    """
    stated = getattr(cell, "light", None)
    if isinstance(stated, CarriedLight):
        kind, _, name = stated.name.partition(":")
        return _carried(kind, name, stated.distance_mm)
    if not isinstance(stated, LightBox):
        return None
    # the upper side of the box, in the frame of the part
    middle = np.append((np.asarray(stated.low) + stated.high)[:2] / 2, stated.high[2])
    half_width, half_height = (np.asarray(stated.high) - stated.low)[:2] / 2
    turn = stated.pose[:3, :3]
    return Backlight(
        tuple((turn @ middle + stated.pose[:3, 3]).tolist()),
        tuple((half_width * turn[:, 0]).tolist()),
        tuple((half_height * turn[:, 1]).tolist()),
        stated.name.partition(":")[2],
    )


def in_material(light: AreaLight, material: Material) -> AreaLight:
    """Return the same light on a part of a material."""
    if isinstance(light, Backlight):
        return replace(light, material=material)
    if isinstance(light, DiffuseDome | CoaxialLight | RingLight):
        return of_material(light, material)
    return light
