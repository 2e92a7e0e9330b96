"""Lights for the settings of a plan: the fewest lamps that show its targets, and which kind of light shows most."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from aspectgraph.light import DEFAULT_CONTRAST
from ground.convert import Meta
from ground.notebook import NotebookTable, NotebookView, ShownInNotebook, Toned
from planner.argument_kinds import check_kinds, suggests_names
from planner.exceptions import RequestError
from planner.light.area_lights import AREA_LIGHTS, area_of_word
from planner.light.corner_light import DEFAULT_STEP
from planner.light.lighting import Ground, LampDome, Lighting
from planner.light.plan_light import chosen_lamps
from planner.light.reflection import Material
from planner.measuring.lit_edges import reads_of
from planner.plan_file import Reasons
from planner.progress import Progress, labelled
from planner.text_table import count

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.light.light_plan import LightPlan
    from planner.plan import InspectionPlan

# of what a `Lighting` holds
_LAMP_DEFAULTS = (DEFAULT_CONTRAST, DEFAULT_STEP, "dark", 0.0)


@suggests_names
def plan_light(
    plan: InspectionPlan,
    solid: Solid,
    lamps: Any,
    *,
    contrast: float = DEFAULT_CONTRAST,
    step: float = DEFAULT_STEP,
    ground: Ground = "dark",
    tolerance_mm: float = 0.0,
    progress: Progress | None = None,
) -> LightPlan:
    """Choose lamps that light all targets of a plan, in every setting.

    One lamp is on at a time, or all are on together.

    The model assumes a matt part of one albedo, point lamps, and no light between faces. It does
    not hold for polished metal. If the camera sees both faces of an edge, the lamp must light the
    whole edge with the contrast between the faces. If it sees one face, the edge is a silhouette.
    The lamp must light that face, and the contrast to the background next to the edge must suffice.
    Rays at nine points of the edge check this. If the plan requires corners, another line must be
    visible at each end. If it requires separation, no shadow may end within that distance of the
    edge or that line.

    `measure` must also find enough of each target, and of the part's edges to register the image.
    The program predicts this for the part as designed. It does not for lamps that are on together,
    and under a light with an area it predicts the targets alone. The settings stay as they are;
    `plan_inspection` with ``lamps`` moves the camera where it has to.

    The light of lamps that are on together (`Lighting.together`) adds up. The program then checks
    nine points of every edge, for lamps of equal strength; see `planner.light.corner_light`.

    **Guarantee.** Every setting has an image for each target, or ``unlit`` lists the target with
    the reason: too little contrast or light, or what `measure` would lack. No choice of fewer than
    ``lower_bound`` lamps lights as many targets, with one lamp for a whole setting where one is
    enough.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    solid : Solid
        Its part.
    lamps : array_like, shape (n, 3), LampBox, LampDome, light with an area, str or Lighting
        Positions of the lamps of a cell, mm, or the region where lamps may be, or a `Backlight`,
        `DiffuseDome`, `CoaxialLight` or `RingLight`. "ring" is a lamp on the camera. "backlight",
        "diffuse-dome", "coaxial" and "ring-light" are as large as the request needs them.
        "coaxial:NAME" and so on are lights of the catalogue, see `light_names`. A `Lighting` also
        holds the other options; then omit them here.
    contrast : float
        Least contrast, strictly between 0 and 1; see `aspectgraph.contrast`.
    step : float
        Least step of the grey values across an edge, in [0, 1), as a share of the grey value of a
        face that the lamp lights frontally. Two faces with hardly any light have a contrast, but no
        step.
    ground : str
        Background of the part: "dark", or "bright" with a back light. Silhouettes in front of a
        back light are visible with every lamp.
    tolerance_mm : float
        Largest distance of a lamp from its position, mm. Targets must also be lit from there; the
        program checks 26 points around the lamp.
    progress : callable, optional
        ``progress(done, total, label)``.

    Returns
    -------
    LightPlan
        The same for the same arguments.

    Raises
    ------
    RequestError
        If an argument breaks its rule, or the part is not the plan's.
    LightError
        If the contrast is out of range, or a fixed lamp is inside the part.

    Examples
    --------
    >>> from planner import plan_light, read_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> from aspectgraph import read_solid
    >>> block = read_solid("examples/two_pocket_block.off")
    >>> light = plan_light(plan, block, "ring")
    >>> light.complete, sorted(light.unlit[0])
    (False, ['e1', 'e4'])
    """
    check_kinds(plan=(plan, "InspectionPlan"), solid=(solid, "Solid"))
    options = (contrast, step, ground, tolerance_mm)
    if not isinstance(lamps, Lighting):
        lighting = Lighting(lamps, *options)
    elif options == _LAMP_DEFAULTS:
        lighting = lamps
    else:
        rule = "must hold contrast, step, ground and tolerance_mm where it is a Lighting"
        raise RequestError.of_rule("lamps", rule, f"{lamps!r} and {options}")
    return readable_light(lighting, plan, solid, progress)


def readable_light(
    lighting: Lighting,
    plan: InspectionPlan,
    solid: Solid,
    progress: Progress | None = None,
    executor: Executor | None = None,
    deadline: float = math.inf,
) -> LightPlan:
    """Choose lamps under which `measure` finds enough of the targets of a plan.

    Parameters
    ----------
    lighting : Lighting
        The lamps to choose among.
    plan : InspectionPlan
        The plan.
    solid : Solid
        Its part.
    progress, executor, deadline
        As `planner.light.plan_light.chosen_lamps` takes them.

    Raises
    ------
    TimeIsUpError
        If the light of the targets is not known by the deadline.
    """
    reads = reads_of(solid, plan.request.registration)
    return chosen_lamps(
        lighting, plan, solid, progress, reads=reads, executor=executor, deadline=deadline
    )


# Which light suffices for a plan: what each kind of light shows of its targets, in its settings.


LAMPS = "lamps"
"""Small lamps anywhere on a dome around the part, as few as possible."""
# radius of that dome, in diagonals of the part
_DOME = 3.0


@dataclass(frozen=True)
class LightShows(ShownInNotebook):
    """What a light shows of the targets of a plan.

    Attributes
    ----------
    kind : str
        "backlight", "diffuse-dome", "coaxial", "ring-light" or "lamps".
    light : str
        Its sizes, and how far from the camera it is; of lamps, how many.
    shown : tuple of str
        Targets that it shows in at least one of the settings that measure them, in the order of the plan.
    dark : dict of str to str
        The others, and why.

    Examples
    --------
    >>> from planner import LightShows
    >>> LightShows("coaxial", "a window of 50 mm", ("d1",)).shown
    ('d1',)
    """

    kind: str
    light: str
    shown: Annotated[tuple[str, ...], Meta(title="must be an array of names")]
    dark: Reasons = field(default_factory=dict)

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"<LightShows {self.kind!r}: {self._counted()}>"

    def _notebook_view(self) -> NotebookView:
        verdict = Toned(f"It shows {self._counted()}.", "bad" if self.dark else "good")
        return NotebookView(f"Light: {self.kind}", (verdict, self.light), items=self.dark)

    def _counted(self) -> str:
        return f"{len(self.shown)} of {count(len(self.shown) + len(self.dark), 'target')}"


class LightComparison(tuple[LightShows, ...], ShownInNotebook):
    """What each kind of light shows: a tuple that notebooks show as a table.

    Parameters
    ----------
    iterable : iterable of LightShows, optional
        The lights, the best first. Default: none.

    Examples
    --------
    >>> from planner import LightComparison, LightShows
    >>> LightComparison([LightShows("coaxial", "a window of 50 mm", ("d1",))])
    <LightComparison of 1 light: coaxial 1 of 1 target>
    """

    def __repr__(self) -> str:
        """Return a one-line summary."""
        shown = ", ".join(f"{item.kind} {item._counted()}" for item in self)
        return f"<LightComparison of {count(len(self), 'light')}: {shown or 'nothing'}>"

    def _notebook_view(self) -> NotebookView:
        """Return a table of the lights, each with the first reasons why it does not show the others."""
        rows = []
        for item in self:
            reasons = [f"{name}: {reason.rstrip('.')}" for name, reason in item.dark.items()]
            more = len(reasons) - _SHOWN_REASONS
            text = "; ".join(reasons[:_SHOWN_REASONS]) + f"; and {more} more" * (more > 0)
            tone = "bad" if item.dark else "good"
            rows.append((item.kind, Toned(item._counted(), tone), item.light, text))
        headings = ("light", "shows", "size", "why not the others")
        return NotebookView(count(len(self), "light"), (), NotebookTable(headings, rows))


# in the row of a light
_SHOWN_REASONS = 3


@suggests_names
def compare_lights(
    plan: InspectionPlan,
    solid: Solid,
    material: Material | None = None,
    *,
    progress: Progress | None = None,
) -> LightComparison:
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
    LightComparison
        A tuple of `LightShows`: a backlight, a diffuse dome, coaxial light, a ring, and the best
        small lamps. Of two that show as many targets, the simpler one is first, in this order. The same for the same
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
    check_kinds(plan=(plan, "InspectionPlan"), solid=(solid, "Solid"))
    if why := plan.request.other_part(solid):
        rule = "must be the part of the plan"
        raise RequestError.of_rule("solid", rule, f"{solid.name!r}, {why}")
    if material is not None:
        check_kinds(material=(material, "Material"))
    material = material or Material()
    shown = labelled(progress, "lights")
    kinds = (*AREA_LIGHTS, LAMPS)
    compared = []
    for k, kind in enumerate(kinds):
        compared.append(_shows(kind, plan, solid, material))
        if shown is not None:
            shown(k + 1, len(kinds), "")
    # sorted keeps the order of equals
    return LightComparison(sorted(compared, key=lambda item: -len(item.shown)))


def _shows(kind: str, plan: InspectionPlan, solid: Solid, material: Material) -> LightShows:
    if kind == LAMPS:
        low, high = (np.asarray(corner, dtype=np.float64) for corner in solid.bounds)
        x, y, z = ((low + high) / 2).tolist()
        radius = _DOME * float(np.linalg.norm(high - low))
        lamps: object = LampDome((x, y, z), radius)
    else:
        lamps = area_of_word(kind, solid, plan.camera, material)
    light = readable_light(Lighting(lamps, material=material), plan, solid)
    dark = _dark(plan, light)
    names = [name for name in plan.entities if name in plan.promises]
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
