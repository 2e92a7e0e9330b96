"""The section of the report about settings: a table of all, then each with its predicted images."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

from scipy.spatial.transform import Rotation

from aspectgraph.solid.ray_scene import RayScene
from planner.light.exposure import WHITE_SHARE, exposure_of
from planner.progress import report
from planner.progress.time_left import TimeLeft
from planner.report.figure import color_of
from planner.report.outlines import drawn
from planner.report.predicted_image import PictureMaker
from planner.report.setting_table import (
    binding_sentence,
    focus_note,
    passed_over_sentence,
    setting_table,
    stance,
)
from planner.report.tables import Promised, cells, heads, unbroken
from planner.report.wording import lamp_texts, lamps_named, margin_texts
from planner.wanted.planned import words_of

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.plan import InspectionPlan
    from planner.progress import Progress
    from planner.rows.measured_rows import Row

NO_PICTURES = '<p class="note">The pictures are left out: the time limit ended. A longer --time-limit draws them.</p>'
"""What a setting has in the place of its pictures, if there was no time for them."""

# what fills more of the image is shown once
_WORTH_ENLARGING = 1.25
# from this ratio of light on, the dimmest target is named
_UNEVEN = 2.0


def settings_table(plan: InspectionPlan, named: tuple[str, str]) -> str:
    """Return a table with a row per setting.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    named : tuple of str
        What an item is called, and several.
    """
    if not plan.settings:
        return '<p class="note">The plan has no settings.</p>'
    rows = []
    several = named[1].capitalize()
    least = [min(setting.promise.values()) for setting in plan.settings]
    promised = Promised(plan, least, [])
    head = f"n:Smallest {promised.name}"
    columns = [head] if promised.heads else []
    same = (
        ""
        if columns
        else f"The smallest {promised.name} of every setting is {promised.text(min(least))}."
    )
    for k, setting in enumerate(plan.settings):
        stands = stance(plan, setting)
        position = " ".join(f"{x:.1f}" for x in setting.position)
        rows.append(
            cells(
                {
                    "": f'<a href="#setting-{k + 1}">{_swatch(k)}{k + 1}</a>',
                    "n:Position (mm)": position,
                    "n:Distance (mm)": f"{stands.distance_mm:.0f}",
                    "n:Tilt (°)": f"{stands.tilt_deg:.1f}",
                    "n:µm/px": f"{stands.um_per_px:.3g}",
                    **dict.fromkeys(columns, promised.text(least[k])),
                    several: ", ".join(map(unbroken, setting.entities)),
                }
            )
        )
    names = ["Setting", "n:Position (mm)", "n:Distance (mm)", "n:Tilt (°)", "n:µm/px"]
    titles = heads([*names, *columns, several])
    return (
        f'<div class="scroll"><table class="stack">{titles}<tbody>{"".join(rows)}</tbody></table></div>'
        '<p class="note">Distance: from the front nodal point to the targets, along the optical axis. Tilt: angle '
        "between the optical axis and the part's z axis. µm/px: size of a pixel at that distance. "
        f"{escape(same)}</p>"
    )


def settings_section(
    plan: InspectionPlan,
    solid: Solid,
    rows: Sequence[Sequence[Row]],
    progress: Progress | None = None,
    *,
    until: float = math.inf,
) -> str:
    """Return each setting: pose, predicted images, probabilities, the binding constraint, margins and lamps.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    solid : Solid
        Its part.
    rows : sequence of sequence of Row
        As of `measured_rows`.
    progress : callable, optional
        ``progress(done, total, label)``.
    until : float
        Time, as `time.time` gives it, after which settings get a sentence instead of pictures.
    """
    maker = PictureMaker(solid, plan.camera)
    scene = RayScene(solid.vertices, solid.triangles) if plan.light is not None else None
    time_left = TimeLeft(until)
    sections = []
    for k in range(len(plan.settings)):
        shots = (
            f'<div class="shots">{_shots(plan, k, maker)}</div>'
            if time_left.fits_another()
            else NO_PICTURES
        )
        lit = [*lamp_texts(plan, k), *exposure_texts(plan, scene, k)]
        sections.append(_setting(plan, k, setting_table(plan, rows[k]), shots, lit))
        report(progress, k + 1, len(plan.settings), "predicted images")
    return "".join(sections)


def exposure_texts(plan: InspectionPlan, scene: RayScene | None, k: int) -> list[str]:
    """Say what to expose each image of a setting for; nothing of a plan without lamps.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    scene : RayScene or None
        Of its part.
    k : int
        Number of the setting, from 0.
    """
    if plan.light is None or scene is None:
        return []
    texts = []
    for image in plan.light.images[k]:
        # plans of earlier programs do not have it
        found = image.expose_for or exposure_of(image, plan.light, plan, k, scene)
        if found is None:
            continue
        text = (
            f"under {lamps_named(image)}, expose so that pixel {found.pixel} beside {found.target} "
            f"has {100 * WHITE_SHARE:.0f} % of white: it is the brightest place beside the targets of a "
            "matt part"
        )
        if found.times >= _UNEVEN:
            text += f"; {found.dimmest} gets {found.times:.1f} times less light"
        texts.append(text)
    return texts


def _setting(plan: InspectionPlan, k: int, table: str, shots: str, lit: Sequence[str]) -> str:
    setting = plan.settings[k]
    x, y, z, w = Rotation.from_matrix(setting.cam2world[:3, :3]).as_quat(canonical=True)
    position = ", ".join(f"{value:.3f}" for value in setting.position)
    lamps = "".join(f'<p class="note">{escape(text[0].upper() + text[1:])}</p>' for text in lit)
    return (
        f'<section class="setting" id="setting-{k + 1}"><div class="head"><h3>{_swatch(k)}Setting {k + 1}</h3>'
        f'<span class="note">{escape(stance(plan, setting).text)}; camera at ({position}) mm, '
        f"quaternion x y z w = ({x:.6f}, {y:.6f}, {z:.6f}, {w:.6f})</span>"
        f'<button data-view="setting-{k + 1}">Show in 3-D</button></div>'
        f'{shots}<div class="scroll">{table}</div>'
        f"<p>{escape(binding_sentence(plan, setting))} {escape(focus_note(plan, setting))} "
        f"{escape(passed_over_sentence(setting))}</p>"
        f'<p class="note">Margins: {escape("; ".join(margin_texts(setting.margins)))}.</p>{lamps}</section>'
    )


def _shots(plan: InspectionPlan, k: int, maker: PictureMaker) -> str:
    """Return predicted image and edge map; next to each the targets enlarged, if they are small in the image."""
    pose = plan.settings[k].cam2world
    entities = drawn(plan, plan.settings[k].entities, plan.settings[k])
    color = color_of(k)
    images = plan.light.images[k] if plan.light is not None else ()
    lamp = plan.light.lamps[list(images[0].lamps)] if plan.light is not None and images else None
    shaded = "Predicted image, hidden lines removed" + (
        f", under {lamps_named(images[0])}" if images else ""
    )
    window = maker.window(pose, entities)
    times = maker.camera.resolution[0] / window[2]
    if times < _WORTH_ENLARGING:
        image = maker.image_svg(pose, entities, color, lamp)
        return _figure(image, shaded) + _figure(
            maker.edge_map_svg(pose, entities), _map_caption(plan)
        )
    enlarged = f"the frame enlarged {times:.3g} times ({window[2]} x {window[3]} px)"
    return (
        _figure(maker.image_svg(pose, entities, color, lamp, outlined=window), shaded)
        + _figure(
            maker.image_svg(pose, entities, color, lamp, window=window),
            f"Predicted image: {enlarged}",
        )
        + _figure(maker.edge_map_svg(pose, entities), _map_caption(plan))
        + _figure(maker.edge_map_svg(pose, entities, window=window), f"Edge map: {enlarged}")
    )


def _figure(picture: str, caption: str) -> str:
    return f"<figure>{picture}<figcaption>{caption}</figcaption></figure>"


def _map_caption(plan: InspectionPlan) -> str:
    return f"Edge map: {words_of(plan.targets).bold}"


def _swatch(k: int) -> str:
    return f'<span class="swatch" style="background:{color_of(k)}"></span>'
