"""Which light suffices for a plan: what each kind of light shows of its targets, in its settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

import numpy as np

from ground.convert import Meta
from planner.argument_kinds import check_kinds
from planner.exceptions import RequestError
from planner.light.area_lights import AREA_LIGHTS, area_of_word
from planner.light.lighting import LampDome, Lighting
from planner.light.plan_light import chosen_lamps
from planner.light.reflection import Material
from planner.plan_file import Reasons
from planner.progress import Progress, labelled

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.light.light_plan import LightPlan
    from planner.plan import InspectionPlan

LAMPS = "lamps"
"""Small lamps anywhere on a dome around the part, as few as possible."""
# radius of that dome, in diagonals of the part
_DOME = 3.0


@dataclass(frozen=True)
class LightShows:
    """What a light shows of the targets of a plan.

    Attributes
    ----------
    kind : str
        "backlight", "diffuse-dome", "coaxial", "ring-light" or "lamps".
    light : str
        Its sizes and place; of lamps, how many.
    shown : tuple of str
        Targets that it shows in at least one of the settings that measure them, in the order of the plan.
    dark : dict of str to str
        The others, and why.
    """

    kind: str
    light: str
    shown: Annotated[tuple[str, ...], Meta(title="must be an array of names")]
    dark: Reasons = field(default_factory=dict)


def compare_lights(
    plan: InspectionPlan,
    solid: Solid,
    material: Material | None = None,
    *,
    progress: Progress | None = None,
) -> tuple[LightShows, ...]:
    """Return what each kind of light shows of the targets of a plan; the first one shows most.

    The settings stay as they are. A plan that was made for one light has settings that suit it. So
    compare lights on a plan without any. Each light has the size that part and camera need.

    Parameters
    ----------
    plan : InspectionPlan
        The plan. Its own light does not matter.
    solid : Solid
        Its part.
    material : Material, optional
        Of the part. Default: matt.
    progress : callable, optional
        ``progress(done, total, label)``.

    Returns
    -------
    tuple of LightShows
        A backlight, a diffuse dome, coaxial light, a ring, and the best small lamps. Of two that
        show as many targets, the simpler one is first, in this order. The same for the same
        arguments.

    Raises
    ------
    RequestError
        If the part is not the plan's, or its camera is focused at infinity.

    Examples
    --------
    >>> from aspectgraph import read_solid
    >>> from planner import compare_lights, read_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> sorted(item.kind for item in compare_lights(plan, block))
    ['backlight', 'coaxial', 'diffuse-dome', 'lamps', 'ring-light']
    """
    from planner.plan import InspectionPlan

    check_kinds(plan=(plan, "InspectionPlan"), solid=(solid, "Solid"))
    assert isinstance(plan, InspectionPlan)
    if why := plan.request.other_part(solid):
        raise RequestError.of_rule("solid", "must be the part of the plan", why)
    material = material or Material()
    shown = labelled(progress, "lights")
    kinds = (*AREA_LIGHTS, LAMPS)
    compared = []
    for k, kind in enumerate(kinds):
        compared.append(_shows(kind, plan, solid, material))
        if shown is not None:
            shown(k + 1, len(kinds), "")
    # sorted keeps the order of equals
    return tuple(sorted(compared, key=lambda item: -len(item.shown)))


def _shows(kind: str, plan: InspectionPlan, solid: Solid, material: Material) -> LightShows:
    if kind == LAMPS:
        low, high = (np.asarray(corner, dtype=np.float64) for corner in solid.bounds)
        x, y, z = ((low + high) / 2).tolist()
        radius = _DOME * float(np.linalg.norm(high - low))
        lamps: object = LampDome((x, y, z), radius)
    else:
        lamps = area_of_word(kind, solid, plan.camera, material)
    light = chosen_lamps(Lighting(lamps, material=material), plan, solid)
    dark = _dark(plan, light)
    names = [name for name in plan.entities if name in plan.inspected]
    called = str(light.area)
    if kind == LAMPS:
        n = len(light.lamps)
        called = f"{n} lamp{'s' * (n != 1)} on a dome of {radius:.0f} mm around the part"
    return LightShows(kind, called, tuple(name for name in names if name not in dark), dark)


def _dark(plan: InspectionPlan, light: LightPlan) -> dict[str, str]:
    """Return the targets that a light shows in no setting, and the reason of the first."""
    lit = {name for images in light.images for image in images for name in image.contrast}
    reasons: dict[str, str] = {}
    for unlit in light.unlit:
        for name, reason in unlit.items():
            if name not in lit:
                reasons.setdefault(name, reason)
    return reasons


def sufficient(compared: Sequence[LightShows]) -> str:
    """Return the sentence that says which light suffices.

    Parameters
    ----------
    compared : sequence of LightShows
        From `compare_lights`.
    """
    best = compared[0]
    total = len(best.shown) + len(best.dark)
    if not best.dark:
        return f"{best.kind} shows every target."
    if not best.shown:
        return "No light shows any target in these settings."
    text = f"No light shows all targets. {best.kind} shows most: {len(best.shown)} of {total}."
    missing = [name for name in best.dark if any(name in item.shown for item in compared)]
    if missing:
        other = next(item for item in compared if missing[0] in item.shown)
        text += f" {other.kind} shows {', '.join(name for name in best.dark if name in other.shown)}, too."
    return text
