"""What is said of a plan, in sentences that are true of every plan: complete or not, empty, simulated or not.

The terminal and the report say the same. "Under this request" stands for all the proof takes as given: the part, the
workspace, the camera and its uncertainty, the accuracy, the probability and the constraints.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from errors.checks import percent_text
from errors.measurands.measurand import COVERAGE
from planner.camera.response import Response
from planner.detectability.image_check import MOST_PX
from planner.light.area_light import spoken
from planner.measuring.foreseen import surest
from planner.progress import duration
from planner.request.camera_limits import LEAST_SIGMAS, corner_margin_px
from planner.request.constraints import limit_sentences
from planner.request.dimension_files import SURFACES_MM
from planner.request.edge_state import (
    STATE_EDGES,
    TYPICAL_BREAK_MM,
    EdgeState,
    largest_shift,
    value_sigma,
)
from planner.request.registration import PLANNED
from planner.request.targets import words_of
from planner.request.words import amount_text
from planner.rows import unshown_warning
from planner.text_table import count, digits_text
from planner.verify.setting_record import measurements, search_windows_px
from planner.verify.simulate_setting import (
    CONFIRMED,
    CONSERVATIVE,
    CONTRADICTED,
    MODEL_TOLERANCE,
    TOLERATED,
    UNSTATED,
)

if TYPE_CHECKING:
    from aspectgraph import JointEstimate
    from planner.camera.camera import Camera
    from planner.light.light_plan import LightPlan, LitImage
    from planner.plan import InspectionPlan
    from planner.request.targets import PlannedDimension, Target
    from planner.sensor_setting import Foreseen
    from planner.verify.simulate_plan import ShownImages, SimulationResult


def features_sentence(plan: InspectionPlan) -> str:
    """Say how many characteristics are not planned, and why; empty if every one is."""
    if not plan.features_text:
        return ""
    return f"{plan.features_text}; the plan measures one feature of each dimension."


def features_cell(target: Target) -> str:
    """Say that a target is measured on one feature of several; empty if it applies to one."""
    return f"1 of {target.n_features} features" if target.n_features > 1 else ""


def names_by_reason(reasons: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the targets of each reason, so that a reason of many is written once.

    Parameters
    ----------
    reasons : mapping of str to str
        Of targets that are not inspected, by name.
    """
    names: dict[str, list[str]] = {}
    for name, reason in reasons.items():
        names.setdefault(str(reason), []).append(name)
    return names


def bound_sentence(
    plan: InspectionPlan, nouns: Sequence[str] = ("entity", "entities"), place: str = "setting"
) -> str:
    """Say how many settings are proven to be needed, and for what; nothing of a plan without settings.

    Of an incomplete plan the proof is about the targets that it inspects.
    """
    n = len(plan.settings)
    bound = plan.lower_bound
    inspected = len(plan.promises)
    if not n:
        return ""
    these = f"all {inspected} {nouns[1]}" if inspected > 1 else f"the {nouns[0]}"
    scope = ""
    if plan.unlit or plan.uninspectable:
        these = "them" if inspected > 1 else "it"
        inspected_nouns = (f"inspected {nouns[0]}", f"inspected {nouns[1]}")
        scope = f" for the {count(inspected, *inspected_nouns)}"
        if plan.unlit:
            scope = f" for the {count(inspected, *nouns)} that poses inspect{dark_note(plan)}"
    if plan.request.poses is not None:
        number = count(len(plan.request.poses), "given pose")
        others = " Other poses may do with fewer." if n > 1 else ""
        if plan.minimal:
            return f"Proven minimal{scope}: of the {number}, no fewer inspect {these}.{others}"
        return f"Proven lower bound{scope}: {bound} of the {number}.{others}"
    if plan.minimal:
        proof = f"no plan that inspects {these} under this request has fewer {place}s"
        return f"Proven minimal{scope}: {proof}."
    proof = (
        f"Every plan that inspects {these} under this request has at least {count(bound, place)}"
    )
    return f"Proven lower bound{scope}: {bound}. {proof}{_whole_bound_text(plan)}."


def _whole_bound_text(plan: InspectionPlan) -> str:
    """Say what is proven of plans that measure each target in one image; nothing where that is no more."""
    return f", and at least {plan.whole_bound} without split values" if plan.whole_bound else ""


def dark_note(plan: InspectionPlan) -> str:
    """Say that a bound counts also targets that no lamp shows, since it is about poses; nothing without such."""
    if not plan.unlit:
        return ""
    return ", lit or not"


def given_text(plan: InspectionPlan) -> str:
    """Say which given pose each setting is; empty of a plan whose poses were searched."""
    if plan.request.poses is None:
        return ""
    names = {pose.cam2world.tobytes(): pose.name for pose in plan.request.poses}
    pairs = [
        f"setting {k} is {names.get(setting.cam2world.tobytes(), 'another pose')}"
        for k, setting in enumerate(plan.settings, 1)
    ]
    return f"given poses: {', '.join(pairs)}" if pairs else ""


def incumbent_line(plan: InspectionPlan, seconds: float) -> str:
    """Say in a line of a log how good a plan is, and when that was."""
    settings = count(len(plan.settings), "setting")
    inspected = len(plan.inspected)
    items = words_of(plan.targets).items
    is_whole = inspected == len(plan.entities)
    targets = "" if is_whole else f", {inspected} of {count(len(plan.entities), *items)}"
    return f"{seconds:8.1f} s   {settings:>12}   at least {plan.lower_bound:<3}   gap {100 * plan.gap:.0f} %{targets}"


def cost_sentence(about: JointEstimate, n: int) -> str:
    """Say about what the joint graph of n entities costs."""
    memory = (
        f"{about.memory_bytes / 2**30:.1g} GiB"
        if about.memory_bytes >= 2**29
        else "less than 0.5 GiB"
    )
    graph = f"joint graph of {count(n, 'entity', 'entities')}"
    return (
        f"{graph}: about {duration(about.seconds)} and {memory}, estimated from the cells of the visible regions. "
        "Either may be up to three times as much. A busy machine takes longer."
    )


MORE_TIME = "The same command with --resume continues; a larger --time-limit gives more time."
"""What to do about a planning that was ended early."""


def unfinished_sentence(plan: InspectionPlan) -> str:
    """Say what a planning that was ended before its end may have missed; empty of one that was not."""
    if not plan.unfinished:
        return ""
    return f"Planning stopped early. A longer run may {_more_by_longer(plan)}."


def _more_by_longer(plan: InspectionPlan) -> str:
    if plan.light is not None and plan.unlit and not plan.light.together:
        return "find other poses, from which lamps show more targets"
    if plan.uninspectable:
        return "inspect more targets, need fewer settings or prove a larger bound"
    if plan.minimal:
        return "find poses with a larger P"
    return "need fewer settings or prove a larger bound"


def registration_text(plan: InspectionPlan) -> str:
    """Say how poses are known when values are read; empty where they are as planned."""
    registration = plan.request.registration
    if registration is None or registration.method == PLANNED:
        return ""
    if registration.pose_uncertainty is None:
        return "values are read from images registered to the part's own edges"
    sigmas = registration.pose_uncertainty.sigmas
    return f"poses are known to {sigmas[:3].max():g} mm and {sigmas[3:].max():g} rad when values are read"


def edges_text(plan: InspectionPlan) -> str:
    """Say by how much edges are taken to be broken, and what a break would do where none is stated.

    Empty where it does not matter: without dimensions, and where points lie on whole pixels and nothing is stated.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    """
    stated = {
        name: EdgeState(*target.edge_break_mm, True)
        for name, target in plan.dimensions.items()
        if target.edge_break_mm is not None
    }
    part = plan.request.edge_break_mm
    if part is not None and plan.dimensions:
        stated = {"": EdgeState(*part, True)} | stated
    texts = [f"{name}: {state}" if name else str(state) for name, state in stated.items()]
    if text := unstated_edges_text(plan):
        texts.append(text)
    return "; ".join(texts)


def brief_edges_text(plan: InspectionPlan) -> str:
    """Say by how much edges are broken, and in one sentence what a break would do where it is not stated.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    """
    text = edges_text(plan)
    brief = assumed_edges_text(plan)
    if not brief:
        return text
    if whole := unstated_edges_text(plan):
        return text.replace(whole, f"{brief}. State --edges sharp, or --edges 0.1..0.3")
    return f"{brief}. State --edges to 'measure'"


def assumed_edges_text(plan: InspectionPlan) -> str:
    """Say in one sentence what breaks would do that nobody states; empty where all are stated, or do not matter.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    """
    assumed = f"planned as sharp, and P holds for that; 'measure' assumes breaks of up to {EdgeState().high_mm:g} mm"
    whole = unstated_edges_text(plan)
    if whole:
        rows = _broken_rows(plan)
        if not rows:
            return whole.partition(". ")[0]
        worst = rows[0]
        foreseen = digits_text(worst.expanded_uncertainty, 2)
        amount = amount_text(foreseen, plan.dimensions[worst.name].unit)
        return f"{assumed}: its U of {worst.name} will be about {amount}{_unknown_response(plan)}"
    if edges_text(plan) or plan.request.edge_break_mm is not None or not _measures_lengths(plan):
        return ""
    return f"{assumed}, so its U of lengths will be larger"


def _unknown_response(plan: InspectionPlan) -> str:
    """Say what a foreseen U leaves out, where nothing states how grey values follow from light."""
    return (
        ""
        if plan.camera.response is not None
        else ", more if images must show the camera's response"
    )


def _measures_lengths(plan: InspectionPlan) -> bool:
    """Return whether a setting measures the length of an edge, which the plan takes for sharp."""
    lengths = plan.targets.keys() - plan.dimensions.keys()
    return any(lengths.intersection(setting.entities) for setting in plan.settings)


def unstated_edges_text(plan: InspectionPlan) -> str:
    """Say what a break would do to the worst of the dimensions that are planned as sharp; empty without any.

    Parameters
    ----------
    plan : InspectionPlan
        The plan.
    """
    if plan.request.edge_break_mm is not None or plan.request.localisation.model == "rounding":
        return ""
    worst = None
    for setting in plan.settings:
        for name, measurement in measurements(plan, setting).items():
            target = plan.dimensions[name]
            shift = TYPICAL_BREAK_MM * largest_shift(target.measurand)
            share = shift / max(measurement.expanded_uncertainty, 1e-12)
            if target.edge_break_mm is None and shift > 0 and (worst is None or share > worst[0]):
                worst = share, target, shift, measurement.expanded_uncertainty
    if worst is None:
        return ""
    _, target, shift, expanded = worst
    moved = (
        f"planned as sharp; a break of {TYPICAL_BREAK_MM:g} mm would move {target.name} by up to "
        f"{amount_text(digits_text(shift, 2), target.unit)}, its U is "
        f"{amount_text(digits_text(expanded, 2), target.unit)}"
    )
    if text := _foreseen_text(plan):
        return f"{moved}. {text}. {STATE_EDGES}"
    assumed = EdgeState()
    measured = math.hypot(expanded, COVERAGE * value_sigma(target.measurand, assumed))
    return (
        f"{moved}. 'measure' assumes breaks of up to {assumed.high_mm:g} mm where none is stated. Its U is then at "
        f"most about {amount_text(digits_text(measured, 2), target.unit)}, and less where the image tells how the "
        f"light falls. {STATE_EDGES}"
    )


def _broken_rows(plan: InspectionPlan) -> list[Foreseen]:
    """Return what `measure` will state where breaks may not be seen, the target that suffers most first."""
    rows = [row for row in surest(plan.foreseen).values() if row.limit_mm > 0]
    rows.sort(key=lambda row: -row.unseen_uncertainty / row.expanded_uncertainty)
    return rows


def _foreseen_text(plan: InspectionPlan) -> str:
    """Say which U `measure` will state where edges are not stated, of the target that suffers most."""
    rows = _broken_rows(plan)
    if not rows:
        return ""
    worst = rows[0]
    unit = plan.dimensions[worst.name].unit
    foreseen = amount_text(digits_text(worst.expanded_uncertainty, 2), unit)
    unseen = amount_text(digits_text(worst.unseen_uncertainty, 2), unit)
    text = (
        f"'measure' assumes breaks of up to {EdgeState().high_mm:g} mm where none is stated: its U of {worst.name} "
        f"will be about {foreseen}{_unknown_response(plan)}. Images may not show breaks of up to "
        f"{digits_text(worst.limit_mm, 2)} mm: with them, this U is about {unseen}"
    )
    undecided = sum(row.is_open for row in rows)
    if undecided:
        count_of = f"{undecided} of {len(rows)} dimensions"
        text += f", and it is open for {count_of} whether a nominal part conforms"
    return text


def promise_sentence(plan: InspectionPlan) -> str:
    """Say what P is, and what it takes as given."""
    words = words_of(plan.targets)
    error = words.error.format(share=percent_text(1 - plan.accuracy))
    alone = (
        f"P is the probability that the error is at most {error}, given a registered image in which "
        f"{words.finding}."
    )
    if registered := registration_text(plan):
        alone += f" Here, {registered}, so the camera's own uncertainty limits where it looks, not what it reads."
    if assumed_edges_text(plan):
        alone += (
            f" P takes edges as sharp, but 'measure' assumes breaks of up to {EdgeState().high_mm:g} mm where none is "
            "stated, so its U is another one, and mostly larger."
        )
    poses = min((view.p_all_poses for view in plan.settings if view.p_all), default=0)
    if not poses:
        return alone
    item = words.finding.removesuffix(" is found")
    return (
        f"{alone} P_all asks for everything at once: the displaced camera has {item} in the picture, in "
        "focus, unhidden and apart from other lines, and the error is at most the permitted one. It is counted over "
        f"{poses} displaced poses or more, and stated as a lower bound with 99.9 % confidence."
    )


def share_text(share: float) -> str:
    """Return a share of room in percent, rounded down, so that 10 % are 10 % at least."""
    percents = 100 * share
    return f"{math.floor(percents)} %" if percents >= 1 else f"{math.floor(10 * percents) / 10:g} %"


def window_sentence() -> str:
    """Say what P follows from, and what a search window is."""
    return (
        "P follows from the uncertainty of the camera's pose and of points found in the image. The search window is "
        "three standard deviations of the shift that the uncertain pose gives the image. Search this far on either "
        "side of the predicted target."
    )


def window_text(plan: InspectionPlan, k: int) -> str:
    """Say within how many pixels what a setting measures is to be looked for, such as "±16.9 px"."""
    windows = search_windows_px(plan, plan.settings[k])
    narrow = min(windows.values())
    wide = max(windows.values())
    width = f"{wide:.3g}" if wide - narrow < 0.1 else f"{narrow:.3g} to {wide:.3g}"
    return f"±{width} px"


def near_lines_text(plan: InspectionPlan) -> str:
    """Say where other lines lie in search windows, and what `measure` makes of them; empty if nowhere."""
    near = [
        (px, name, k)
        for k, setting in enumerate(plan.settings, start=1)
        for name, px in setting.lines_in_window_px.items()
    ]
    if not near:
        return ""
    # here, because it loads compiled loops
    from planner.measuring.samples import APART_PX

    px, name, k = min(near)
    several = "1 measurement has" if len(near) == 1 else f"{len(near)} measurements have"
    return (
        f"{several} another visible line in the search window, the nearest {px:.3g} px away ({name} in setting {k}): "
        "a detector that searches the whole window may confuse the two. 'measure' registers the image first, and "
        f"leaves out only what lies within {APART_PX:g} px of another line"
    )


def unshown_texts(images: ShownImages | None, k: int) -> list[str]:
    """Return of which targets of a setting the conditions for showing are missed in an image of a displaced camera."""
    if images is None:
        return []
    return [
        f"{name}: {unshown_warning(n, images.n)}"
        for name, n in images.counts[k].items()
        if n < images.n
    ]


def simulation_sentence(result: SimulationResult) -> str:
    """Say what a simulation made of the stated probabilities, every kind counted."""
    kinds = result.verdicts
    n = sum(kinds.values())
    if not n:
        return "Nothing was simulated: the plan has no settings."
    if kinds[CONTRADICTED]:
        judgement = "contradicts the plan"
    elif kinds[UNSTATED]:
        judgement = "cannot judge the plan"
    elif kinds[TOLERATED]:
        judgement = "does not contradict the plan"
    else:
        judgement = "confirms the plan" if kinds[CONFIRMED] == n else "supports the plan"
    return f"A simulation of {count(result.n, 'displaced pose')} per setting {judgement}: {_counted(result, n)}."


def shown_sentence(images: ShownImages | None) -> str:
    """Say how many targets meet the conditions for showing from displaced cameras; nothing if not asked."""
    if images is None:
        return ""
    counts = [count for setting in images.counts for count in setting.values()]
    always = counts.count(images.n)
    n = len(counts)
    poses = f"the {count(images.n, 'displaced pose')} per setting"
    if always == n:
        targets = "The target meets" if n == 1 else f"All {n} targets meet"
        return f"{targets} the image conditions from each of {poses}."
    if n == 1:
        return f"The target meets the image conditions from {counts[0]} of {poses}."
    if not always:
        return f"Each of {n} targets meets the image conditions from at least {min(counts)} of {poses}."
    others = "Each of the others meets them from at least"
    if n - always == 1:
        others = "The other one meets them from"
    return (
        f"{always} of {count(n, 'target')} {'meets' if always == 1 else 'meet'} the image conditions "
        f"from each of {poses}. {others} {min(counts)} of {images.n}."
    )


def simulated_sentences(plan: InspectionPlan) -> list[str]:
    """Say how a simulation agrees with a plan, and how many targets meet the image conditions."""
    if plan.simulation is None:
        return ["Not simulated."]
    return [simulation_sentence(plan.simulation), shown_sentence(plan.simulation.shown)]


def percent(share: float) -> str:
    """Return a share in percent, with the digits it needs."""
    return f"{100 * share:.6g} %"


_STRETCH = re.compile(r"(e?\d+)\[(\d+(?:/\d+)?):(\d+(?:/\d+)?)\]")


def entity_words(name: str) -> str:
    """Return an entity's id as people read it: of a stretch, the edge and the percentages of its length.

    Parameters
    ----------
    name : str
        An id; ids of whole entities, and of runs of rims, stay as they are.

    Examples
    --------
    >>> entity_words("e6[0:85/256]")
    'e6 from 0 to 33 %'
    """
    stretch = _STRETCH.fullmatch(name)
    # joints of a rim are no shares
    if stretch is None or Fraction(stretch[3]) > 1:
        return name
    first, last = (100 * Fraction(stretch[k]) for k in (2, 3))
    digits = 0 if last - first >= 2 else 1
    return f"{stretch[1]} from {float(first):.{digits}f} to {float(last):.{digits}f} %"


def entities_words(names: str) -> str:
    """Return ids that commas separate as `entity_words`."""
    return ", ".join(map(entity_words, names.split(", ")))


def _counted(result: SimulationResult, n: int) -> str:
    """Count the rates of each kind, and say how far off they are at most."""
    kinds = result.verdicts
    if n == 1 and kinds[CONFIRMED]:
        return "the one stated probability confirmed"
    parts = [
        f"{kinds[CONFIRMED]} of {count(n, 'stated probability', 'stated probabilities')} confirmed"
    ]
    if kinds[CONSERVATIVE]:
        parts.append(
            f"{kinds[CONSERVATIVE]} conservative (measured up to {_largest(result, CONSERVATIVE)} better)"
        )
    if kinds[TOLERATED]:
        parts.append(
            f"{kinds[TOLERATED]} above the interval by no more than the model's tolerance of {MODEL_TOLERANCE:g}"
        )
    if kinds[CONTRADICTED]:
        parts.append(
            f"{kinds[CONTRADICTED]} contradicted (measured up to {_largest(result, CONTRADICTED)} worse)"
        )
    if kinds[UNSTATED]:
        parts.append(f"{kinds[UNSTATED]} missing")
    return ", ".join(parts)


def _largest(result: SimulationResult, kind: str) -> str:
    """Return the largest difference between prediction and frequency among rates of a kind."""
    rates = [rate for rate in result.all_rates if rate.verdict == kind]
    return f"{max(abs(rate.predicted - rate.frequency) for rate in rates):.2g}"


def graph_sentence(n_entities: int, graph_limit: int | None) -> str:
    """Say that the joint graph was left out, and what to do about it."""
    if graph_limit is not None:
        return (
            f"graph.graphml was not written: --graph-limit is {graph_limit}, and the plan has "
            f"{count(n_entities, 'entity', 'entities')}."
        )
    return (
        f"graph.graphml was not written: the joint graph of {n_entities} entities may take long to build and to draw "
        f"(--graph-limit {n_entities} builds it anyway). For a few entities, run: aspectgraph graph PART "
        "--entities IDS --graphml FILE."
    )


STOPPED_EARLY = "stopped early"
"""How the note begins that a plan of a folder was not finished."""


def stopped_note(plan: InspectionPlan) -> str:
    """Say in a table of parts that a plan was stopped early, and what a longer limit may change; else empty."""
    if not plan.unfinished:
        return ""
    more = f"a longer time limit may {_more_by_longer(plan)}"
    return f"{STOPPED_EARLY}, so {more}"


def regions_sentence(shares: Mapping[str, float], n_together: int) -> str:
    """Say from how much of the workspace entities are observable, and how many at most from one place."""
    smallest = min(shares, key=shares.__getitem__)
    largest = max(shares, key=shares.__getitem__)
    mean = sum(shares.values()) / len(shares)
    return (
        f"Regions: each entity is visible as a whole from {percent_text(shares[smallest], 2)} ({smallest}) to "
        f"{percent_text(shares[largest], 2)} ({largest}) of the workspace, and from "
        f"{percent_text(mean, 2)} on average. None of 10,000 "
        f"random viewpoints sees more than {n_together} of the {len(shares)} entities."
    )


def light_sentence(plan: InspectionPlan) -> str:
    """Say which lamps a plan has, and what they show; empty of a plan without lamps."""
    light = plan.light
    if light is None or not plan.settings:
        return ""
    pairs = sum(len(setting.entities) for setting in plan.settings)
    dark = sum(map(len, light.unlit))
    measured = "every measurement" if pairs > 1 else "the measurement"
    shown = f"{pairs - dark} of the {pairs} measurements" if dark else measured
    contrast = f"a contrast of at least {light.contrast:g}"
    if light.kind == "ring":
        return f"A ring light on the camera gives {shown} {contrast}."
    if light.area is not None:
        text = f"{light.area} gives {shown} {contrast}."
        return text[0].upper() + text[1:]
    n = len(light.lamps)
    lamps = f"{n} of the given lamps {'gives' if n == 1 else 'give'}"
    if light.kind == "placed":
        lamps = f"{count(n, 'lamp position')} {'gives' if n == 1 else 'give'}"
    proof = (
        "proven to be the fewest" if light.minimal else f"proven lower bound: {light.lower_bound}"
    )
    several = [len(images) for images in light.images if len(images) > 1]
    taken = count(len(several), "setting needs", "settings need")
    total = sum(map(len, light.images))
    images = f" {taken} more than one image, and the plan takes {total}." if several else ""
    switched = "all on together" if light.together else "one lamp at a time"
    return f"{lamps} {shown} {contrast}, {switched}{f' ({proof})' if n else ''}.{images}"


def white_text(share: float, camera: Camera) -> str:
    """Return how bright a place of an image must be: a share of white, and its grey value of a known response.

    Parameters
    ----------
    share : float
        Share of the light of full exposure.
    camera : Camera
        Its response and its white level, if they are stated.
    """
    if camera.response is None or Response.of(camera.response).is_linear:
        return f"{100 * share:.2g} % of white"
    white = camera.white_level or 255
    level = float(Response.of(camera.response).level(np.array(share)))
    return f"grey value {white * level:.0f} of {white}"


def lamps_named(image: LitImage, light: LightPlan) -> str:
    """Return which lamps are on in an image, such as "lamp 1", "lamps 1, 2" or "the backlight"."""
    if light.area is not None:
        return f"the {spoken(light.kind)}"
    numbers = ", ".join(str(lamp + 1) for lamp in image.lamps)
    return f"lamp{'s' * (len(image.lamps) > 1)} {numbers}"


def unlit_sentence(plan: InspectionPlan) -> str:
    """Say what a plan without lamps does not promise; empty of one with lamps, or without settings."""
    if plan.light is not None or not plan.settings:
        return ""
    promise = (
        "nothing is promised of contrast: an edge that your lamps do not show is not measured."
    )
    if plan.light_missing:
        return f"Light is not planned yet, so {promise}"
    return f"Light is not planned, so {promise} --light plans lamps."


def lamp_texts(plan: InspectionPlan, k: int) -> list[str]:
    """Say for each image of a setting where its lamp is and what it shows, and what no lamp shows."""
    if plan.light is None:
        return []
    texts = []
    for image in plan.light.images[k]:
        places = [
            ", ".join(f"{x:.1f}" for x in place) for place in plan.light.lamps[list(image.lamps)]
        ]
        at = f" at {' and '.join(f'({place})' for place in places)} mm" if places else ""
        parts = [
            f"{name} {value:.2f}{' (silhouette)' if name in image.silhouettes else ''}"
            for name, value in image.contrast.items()
        ]
        texts.append(f"{lamps_named(image, plan.light)}{at}: contrast of {', '.join(parts)}")
    return texts + not_shown_texts(plan, k)


def not_shown_texts(plan: InspectionPlan, k: int) -> list[str]:
    """Say what light does not show in a setting: targets of one reason together."""
    unlit = {} if plan.light is None else plan.light.unlit[k]
    alike = names_by_reason(unlit)
    return [f"not shown: {', '.join(names)}: {reason}" for reason, names in alike.items()]


def verdict(plan: InspectionPlan) -> str:
    """Say in a few sentences how good a plan is."""
    n = len(plan.settings)
    items = words_of(plan.targets).items
    sentences = [f"{_inspected_text(plan)}.", dark_sentence(plan), features_sentence(plan)]
    sentences.append(split_sentence(plan))
    if n:
        sentences.append(bound_sentence(plan, items))
        sentences += simulated_sentences(plan)
    if plan.unfinished:
        sentences.append(unfinished_sentence(plan))
    if plan.light is not None and n:
        sentences.append(light_sentence(plan))
    sentences.append(unlit_sentence(plan))
    return " ".join(filter(None, sentences))


def split_sentence(plan: InspectionPlan) -> str:
    """Say which dimensions two settings measure together; nothing of a plan without such."""
    if not plan.split:
        return ""
    parts = []
    for name, ends in plan.ends.items():
        first, second = sorted(ends.values())
        parts.append(f"{name} by settings {first + 1} and {second + 1}")
    verb = "is" if len(parts) == 1 else "are"
    which = count(len(parts), "dimension")
    return f"{which} {verb} measured by two settings, one end in each: {', '.join(parts)}."


def brief_verdict(plan: InspectionPlan) -> str:
    """Say in two sentences how good a plan is, and in more what is not as it should be."""
    n = len(plan.settings)
    head = _inspected_text(plan)
    if n and plan.request.poses is None:
        bound = f"; at least {plan.lower_bound} {'is' if plan.lower_bound == 1 else 'are'} needed"
        head += ", proven to be the fewest" if plan.minimal else bound + _whole_bound_text(plan)
        if plan.unlit:
            seen = count(len(plan.promises), *words_of(plan.targets).items)
            head += f" for the {seen} that poses inspect{dark_note(plan)}"
        elif plan.uninspectable:
            head += " for these" if len(plan.inspected) > 1 else " for this one"
    sentences = [f"{head}.", dark_sentence(plan), features_sentence(plan)]
    sentences.append(split_sentence(plan))
    if n and plan.request.poses is not None:
        sentences.append(bound_sentence(plan, words_of(plan.targets).items))
    if n and plan.simulation is not None and _all_confirmed(plan.simulation):
        poses = count(plan.simulation.n, "displaced pose")
        sentences.append(f"A simulation of {poses} per setting confirms the plan.")
    elif n:
        sentences += simulated_sentences(plan)
    if plan.unfinished:
        sentences.append(unfinished_sentence(plan))
    sentences.append(unlit_sentence(plan))
    return " ".join(filter(None, sentences))


def _inspected_text(plan: InspectionPlan) -> str:
    """Return how many targets cameras inspect and lamps show, without a full stop."""
    shown = len(plan.inspected)
    items = words_of(plan.targets).items
    settings = count(len(plan.settings), "setting")
    return f"{shown} of {count(len(plan.entities), *items)} inspected from {settings}"


def dark_sentence(plan: InspectionPlan) -> str:
    """Say which targets the light of a plan does not show; nothing if it shows all."""
    if not plan.unlit:
        return ""
    names = ", ".join(plan.unlit)
    if plan.light is not None and plan.light.area is not None:
        return f"The {spoken(plan.light.kind)} does not show {names}."
    # of a plan that was ended early, lamps were tried for its poses only
    poses = " from these poses" if plan.unfinished else ""
    return f"No lamp shows {names}{poses}."


def _all_confirmed(result: SimulationResult) -> bool:
    """Return whether every probability is confirmed, and every displaced image shows what it must."""
    kinds = result.verdicts
    every = kinds[CONFIRMED] == sum(kinds.values()) > 0
    images = result.shown
    return every and (
        images is None or all(n == images.n for counts in images.counts for n in counts.values())
    )


def evolved_sentence(plan: InspectionPlan) -> str:
    """Say how many poses of a plan come from the genetic algorithm; nothing where none was searched."""
    if not plan.settings or plan.request.poses is not None:
        return ""
    if not plan.n_evolved:
        return "No pose of this plan comes from the genetic algorithm."
    settings = count(plan.n_evolved, "setting")
    return f"The poses of {settings} come from the genetic algorithm and its refinement."


def calibration_rows(camera: Camera) -> dict[str, str]:
    """Say what a calibration found of a camera; nothing of one that was not calibrated."""
    rows = {}
    if camera.principal_point_px is not None:
        rows["Principal point"] = "({:.2f}, {:.2f}) px".format(*camera.principal_point_px)
    if camera.distortion is not None:
        numbers = ", ".join(f"{c:g}" for c in camera.distortion.coefficients)
        rows["Lens distortion"] = (
            f"k1, k2, p1, p2, k3 = {numbers}; lengths are those of the undistorted image"
        )
    return rows


def _separation_text(plan: InspectionPlan, least_px: float) -> str:
    """Say what other visible lines keep away from: whole edges, or enough of what is fitted."""
    kinds = {target.in_image for target in plan.targets.values()}
    edges = ["an edge"] if True in kinds else []
    fitted = ["four fifths of a fitted line or circle"] if False in kinds else []
    return f"no other visible line within {least_px:g} px of {' or of '.join(edges + fitted)}"


def requirement_rows(plan: InspectionPlan) -> dict[str, str]:
    """Say what every setting satisfies, also in standard deviations of the pose; nothing if not known."""
    need = plan.requirements
    uncertainty = plan.pose_uncertainty
    if not need:
        return {}
    limits = {}
    if need.get("separation_px"):
        limits["Separation"] = _separation_text(plan, need["separation_px"])
    if need.get("surround_px"):
        limits["Surroundings"] = (
            f"{need['surround_px']:g} px of the image around each end, inside the margin"
        )
    if need.get("min_corner_deg"):
        limits["Corners"] = f"another line leaves each end at {need['min_corner_deg']:g}° or more"
    corner = corner_margin_px(plan.camera, uncertainty, 1.0)
    anyway = float(uncertainty.sigmas[:3].max())
    return {
        **limits,
        **limit_sentences(need),
        "Margin of the field of view": f"no target within {need['field_margin_px']:.4g} px of the sensor's sides"
        f"{_in_sigmas(need['field_margin_px'], corner, 'an image point in the corners')}",
        "Margin of focus": _focus_reserve(need, float(uncertainty.sigmas[2])),
        "Margin of visibility": f"targets stay visible from every point within {need['visibility_radius_mm']:.4g} mm "
        f"of the camera{_in_sigmas(need['visibility_radius_mm'], anyway, 'its position')}",
    }


def _focus_reserve(need: Mapping[str, float], along: float) -> str:
    """Say how far from the limits of the depth of field all that is measured stays."""
    margin = need["focus_margin_mm"]
    sigmas = need.get("focus_sigmas", 0.0)
    if not sigmas or not along:
        return (
            f"{margin:.4g} mm at both ends of the depth of field"
            f"{_in_sigmas(margin, along, 'the camera along its axis')}"
        )
    return (
        f"{sigmas:g} standard deviations of each point's depth at both ends of the depth of field ({margin:.4g} mm on "
        "the optical axis, more off it). Where the depth of field is narrow: an eighth of it, but at least "
        f"{LEAST_SIGMAS:g} standard deviations"
    )


def _in_sigmas(value: float, sigma: float, of: str) -> str:
    """Return a margin in standard deviations of what the uncertain pose moves; nothing where there are none."""
    return f" ({value / sigma:.2g} standard deviations of {of})" if sigma > 0 else ""


def margin_texts(margins: Mapping[str, float]) -> list[str]:
    """Return one text per constraint: name, margin and unit; yes-or-no constraints without a number."""
    texts = []
    for key, value in margins.items():
        name, _, unit = key.rpartition("_")
        if unit not in ("mm", "px", "deg"):
            texts.append(f"{key.replace('_', ' ')} {'met' if value >= 0 else 'missed'}")
        else:
            more = " or more" if key == "separation_px" and value >= MOST_PX else ""
            # a length of the image, not of the part
            on = " on the sensor" if key == "resolution_mm" else ""
            sign = "°" if unit == "deg" else f" {unit}"
            texts.append(f"{name.replace('_', ' ')} {value:+.4g}{sign}{on}{more}")
    return texts


def surfaces_sources(dimensions: Iterable[PlannedDimension]) -> list[str]:
    """Say how far the faces of dimensions are off their place, and what that follows from.

    Parameters
    ----------
    dimensions : iterable of PlannedDimension
        Those of a plan.

    Returns
    -------
    list of str
        Such as "0.02 mm (default)" or "0.03 mm (profile 0.1 mm in the model)", the smallest first.
    """
    sources = sorted({(target.surfaces_mm, target.surfaces_from) for target in dimensions})
    return [f"{sigma:.3g} mm ({_surfaces_source(sigma, zone)})" for sigma, zone in sources]


def _surfaces_source(sigma_mm: float, zone: str) -> str:
    if zone:
        return f"{zone} in the model"
    return "default" if sigma_mm == SURFACES_MM else "as given"
