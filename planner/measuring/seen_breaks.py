"""By how much edges are broken, as the images themselves show.

A sharp edge is one step of light, and a chamfer two. Their distance in the image is known for each size of the break,
and light is free on both faces and between them. So the size that makes one step of all profiles, or two, is estimated
from their shape. Where the steps are does not count: a pose or a size that deviates moves them, but adds none.

Single edges look broken for other reasons, such as a shadow or a mirror image next to them. So several edges must agree
on one size, and each must show it clearly.

Notation
--------
x        place across an edge, px              s      blur of the image, px
x1, d    place of one line, and how far the other is away, px
S(z)     a step, blurred by s, by a pixel, and by interpolation; R(z) its integral, a ramp

Each mean profile of a section is fitted by a + b S(x - x1) + c S(x - x1 - d) + e R(x1 - x) + f R(x - x1 - d), least
squares in a, b, c, e, f and x1, for each d. Without a break, c is left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from errors.measurands import Bonus, Decision, DecisionRule, decide, decide_deviation
from errors.measurands.measurand import COVERAGE
from planner.measuring.breaks import px_across
from planner.measuring.images import Picture
from planner.measuring.merging import surest
from planner.measuring.registered import Faces, Lamp, Registered
from planner.measuring.results import Result, UnseenBreaks
from planner.measuring.samples import EdgeTable, PartModel, across_of, pixels_of, profiles_of
from planner.measuring.verdict import Sampled
from planner.request.edge_state import (
    MOST_UNSEEN_MM,
    STATE_EDGES,
    UNSEEN_PX,
    UNSTATED_MM,
    EdgeState,
    chamfer_lines,
)
from planner.text_table import digits_text

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.camera.camera import Camera

Array = NDArray[np.float64]

FEWEST_EDGES = 3
"""Edges that must agree on one size."""
GAIN = 4.0
"""Logarithm of the likelihood that an edge gains by a break, for each pixel of its width, to count; 1 px at least."""
UNCLEAR_PX = 1.25
"""A narrower band cannot be told from a blur of an unusual shape."""
WIDEST = 2.2
"""An edge that counts shows its size up to this factor."""
ALIKE = 1.5
"""Edges agree if their sizes are within this factor of the median."""
FEWEST_UNLIKE = 5
"""Edges that must look broken if their sizes disagree, as those of one radius do in light from one side."""
UNLIKE = 2.5
"""The sizes of such edges differ by no more than this factor."""
ROUND_TIMES = 3.0
"""A round band looks like a chamfer that is smaller by up to this factor: its light changes mostly at one of its lines.

For a matt face, factors are 1.5 to 3, see `tests/planner/measuring/test_seen_breaks.py`.
"""
LEAST_TIMES = 0.8
"""A break may be smaller than the estimate by this factor."""

# px: half of a profile, with the distance of other lines that it needs
_HALVES = ((12.0, 14.0), (8.0, 10.0), (6.0, 8.0), (4.5, 6.0))
# px beside an edge where its faces are certain, and the least cosine of normals of one face
_NEAR_PX = 2.0
_SAME_FACE = 0.98
_EVERY = 2
_PLACE_PX = 0.3
_MARGIN_PX = 1.5
_APART_PX = np.array(
    [
        0,
        0.4,
        0.6,
        0.8,
        1,
        1.25,
        1.5,
        1.8,
        2.2,
        2.6,
        3.1,
        3.7,
        4.4,
        5.2,
        6.2,
        7.4,
        8.8,
        10.5,
        12.5,
        15,
    ]
)
# blurs of a grid, by this factor, and which of them belong to an image, by its measured one
_BLUR_TIMES = 1.07
_BLURS = (0.5, 1.25)
# if no registration tells it
_ANY_BLUR_PX = (0.5, 1.5)
# standard deviation of the logarithm of the blur from edge to edge
_BLUR_SPREAD = 0.05
# variance of a pixel, and places and weights of a triangle as wide as interpolation is
_PIXEL = 0.5 / np.sqrt(3.0)
_KERNEL = [
    (box + shift, 0.5 * weight)
    for box in (-_PIXEL, _PIXEL)
    for shift, weight in ((-np.sqrt(0.5), 1 / 6), (0.0, 2 / 3), (np.sqrt(0.5), 1 / 6))
]
_SECTIONS = 12
_OF_SECTION = 3
_MOST_SECTIONS = 240
# independent grey values for each px of half a profile, and independent sections of an edge
_INDEPENDENT = 1.0
_MOST_OF_EDGE = 6
# of a step: what profiles are off by at least; weaker steps than this share of white say nothing
_FLOOR = 0.004
_LEAST_STEP = 0.04
_NOISE_SHARE = 0.3
# fall of the logarithm of the likelihood at the ends of what an edge shows
_FALL = 3.0
_QUANTILES = (0.1, 0.9)


@dataclass(frozen=True)
class SeenBreak:
    """A break that images show.

    Attributes
    ----------
    size_mm : float
        Leg of the chamfers that edges look like, mm.
    limits_mm : (float, float)
        Least and largest break that looks so, as a chamfer or a round band, mm.
    edges : tuple of str
        Names of the edges that show it.
    """

    size_mm: float
    limits_mm: tuple[float, float]
    edges: tuple[str, ...]


def seen_notes(
    seen: SeenBreak | None, stated: EdgeState, *, is_drawn_sharp: bool = False
) -> list[str]:
    """Return what the user should know of a break that images show, given what is stated; nothing if this agrees.

    Parameters
    ----------
    seen : SeenBreak or None
        The break.
    stated : EdgeState
        What is stated.
    is_drawn_sharp : bool
        Whether the images are rendered, with sharp edges. These look broken only because a break is stated.
    """
    if seen is None or (is_drawn_sharp and stated.stated and not stated.is_sharp):
        return []
    low, high = seen.limits_mm
    names = ", ".join(seen.edges[:3]) + (", ..." if len(seen.edges) > 3 else "")
    text = f"edges look broken by about {seen.size_mm:.2g} mm ({names})"
    if not stated.stated:
        return [f"{text}: measured as broken by {low:g} to {high:g} mm; state edges"]
    if low > stated.high_mm:
        said = str(stated) if stated.is_sharp else f"stated as {stated}"
        return [f"{text}, and they are {said}: measured as stated"]
    return []


def distance_of_steps(light: Array, half_px: float = 12.0) -> float:
    """Return how far both steps of a profile are apart, px; 0 for one step.

    Parameters
    ----------
    light : array (k,)
        Every half pixel, from `half_px` on one side of the edge to as far on the other.
    half_px : float
        One of the lengths that profiles have.
    """
    numbers = _blur_numbers(np.nan)
    squares = np.min([_misfit(light[None], half_px, number)[0] for number in numbers], axis=0)
    floor = (_FLOOR * np.ptp(light)) ** 2
    return float(_widths(half_px)[np.argmin(np.log1p(squares / floor))])


@dataclass(frozen=True)
class _Sections:
    """Mean profiles (n, k) of sections of edges, as shares of white, with half of their lengths, px."""

    light: Array
    half: Array
    edge: NDArray[np.int64]
    image: NDArray[np.int64]
    px_per_mm: Array
    variance: Array


def seen_break(
    model: PartModel, pictures: Mapping[str, Picture], registered: Mapping[str, Registered]
) -> SeenBreak | None:
    """Return the break that registered images show; None if they show none above `UNSTATED_MM`.

    Parameters
    ----------
    model : PartModel
        The part.
    pictures : mapping of str to Picture
        The images, in light.
    registered : mapping of str to Registered
        Their poses; others do not count.
    """
    names = [name for name in pictures if name in registered]
    parts = [
        sections
        for k, name in enumerate(names)
        if (sections := _sections(model, pictures[name], registered[name], k)) is not None
    ]
    if not parts:
        return None
    joined = _joined(parts)
    scale = float(np.median(joined.px_per_mm))
    sizes = _APART_PX / scale
    blurs = [registered[name].blur_px for name in names]
    gains = _likelihoods(joined, blurs, sizes)
    return _agreed(gains, joined, sizes, [edge.name for edge in model.edges.edges])


def _sections(
    model: PartModel, picture: Picture, registered: Registered, number: int
) -> _Sections | None:
    """Return the mean profiles of an image, of convex edges; None if there are none."""
    camera = picture.camera
    pose = registered.cam2world
    shown = model.shown(pose, camera)
    edges = model.edges.edges
    samples = shown.samples
    points = samples.points.copy()
    for k in np.unique(samples.edge):
        of_edge = samples.edge == k
        points[of_edge] = registered.moved(model, edges[k], points[of_edge])
    across = across_of(points, samples.tangents, pose, camera)
    centres = pixels_of(points, pose, camera)
    places, grey = profiles_of(picture.grey, centres, across, _HALVES[0][0])
    grey = grey / picture.white
    half = np.zeros(len(points))
    sampled = Sampled(model.edges.scene, camera, pose, edges, samples)
    lamp = registered.lamps.get(picture.name)
    for length, room in reversed(_HALVES):
        alone = shown.apart(edges, samples.edge, shown.pixels, room)
        half[alone & _between_flat(sampled, across, length, lamp)] = length
    normals = EdgeTable(edges).at(samples.edge, samples.share)[2]
    convex = np.array([edge.convex for edge in edges], dtype=np.bool_)[samples.edge]
    lines = chamfer_lines(normals, samples.tangents, convex, pose[:3, 3] - points)
    ends = np.einsum("mki,mi->mk", lines, px_across(points, across, pose, camera))
    apart = np.abs(np.diff(ends, axis=1))[:, 0]
    limit = picture.clipped_from / picture.white
    usable = (half > 0) & (apart > 0) & np.isfinite(grey).all(axis=1) & (grey < limit).all(axis=1)
    section = np.minimum((samples.share * _SECTIONS).astype(np.int64), _SECTIONS - 1)
    groups = _groups(samples.edge * _SECTIONS + section, usable)
    if not groups:
        return None
    inner = np.abs(places) <= _HALVES[0][0]
    light = np.array([grey[group].mean(axis=0) for group in groups])[:, inner][:, ::_EVERY]
    count = np.array([len(group) for group in groups])
    noise = (picture.noise / picture.white) ** 2 / count
    variance = (_FLOOR * np.ptp(light, axis=1)) ** 2 + _NOISE_SHARE * noise
    strong = np.ptp(light, axis=1) > _LEAST_STEP
    sections = _Sections(
        light,
        np.array([np.median(half[group]) for group in groups]),
        samples.edge[[group[0] for group in groups]],
        np.full(len(groups), number),
        np.array([apart[group].mean() for group in groups]),
        variance,
    )
    return _chosen(sections, np.flatnonzero(strong)) if strong.any() else None


def _between_flat(
    sampled: Sampled, across: Array, length: float, lamp: Lamp | None
) -> NDArray[np.bool_]:
    """Return which samples (m,) have the same face, or none, on each side as far as a profile reaches.

    A round face that begins there without an edge has light of its own, as a break has. So does a shadow that ends
    there, if a lamp is known that makes it.
    """
    near, near_on_part = sampled.beside(across, _NEAR_PX)
    near_lit = _lit(near, lamp)
    even = np.ones(near_on_part.shape[1], dtype=np.bool_)
    for away in (length / 2, length):
        far, far_on_part = sampled.beside(across, away)
        cosine = (near.normals * far.normals).sum(axis=2)
        same = near_on_part & far_on_part & (cosine >= _SAME_FACE) & (near_lit == _lit(far, lamp))
        even &= (same | ~(near_on_part | far_on_part)).all(axis=0)
    return even


def _lit(faces: Faces, lamp: Lamp | None) -> NDArray[np.bool_]:
    """Return whether a lamp lights faces (2, m); all of them without one."""
    if lamp is None:
        return np.ones(faces.normals.shape[:2], dtype=np.bool_)
    return np.asarray(faces.light(lamp.place)[0] > 0)


def _groups(key: NDArray[np.int64], usable: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Return the numbers of the usable samples of each section that has enough; evenly fewer of too many sections."""
    good = np.flatnonzero(usable)
    order = good[np.argsort(key[good], kind="stable")]
    groups = np.split(order, np.flatnonzero(np.diff(key[order])) + 1)
    groups = [group for group in groups if len(group) >= _OF_SECTION]
    return groups[:: -(-len(groups) // _MOST_SECTIONS)] if groups else []


def _chosen(sections: _Sections, which: NDArray[np.int64]) -> _Sections:
    return _Sections(*(getattr(sections, name)[which] for name in _Sections.__dataclass_fields__))


def _joined(parts: Sequence[_Sections]) -> _Sections:
    return _Sections(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in _Sections.__dataclass_fields__
        )
    )


def _likelihoods(sections: _Sections, blurs: Sequence[float], sizes: Array) -> Array:
    """Return the logarithm of the likelihood of each section (n,) for breaks of some sizes (c,), mm.

    The blur of each image is the one that fits best, if each edge has a size of its own.
    """
    result = np.empty((len(sections.half), len(sizes)))
    for k in np.unique(sections.image):
        of_image = np.flatnonzero(sections.image == k)
        image = _chosen(sections, of_image)
        numbers = _blur_numbers(blurs[k])
        by_blur = np.stack([_of_blur(image, number, sizes) for number in numbers])
        steps = np.log(_BLUR_TIMES) * np.subtract.outer(numbers, numbers) / _BLUR_SPREAD
        best = -np.inf
        for penalty in -0.5 * steps**2:
            with_blur = (by_blur + penalty[:, None, None]).max(axis=0)
            total = sum(
                with_blur[image.edge == edge].sum(axis=0).max() for edge in np.unique(image.edge)
            )
            if total > best:
                best = total
                result[of_image] = with_blur
    return result


def _blur_numbers(blur_px: float) -> NDArray[np.int64]:
    """Return the numbers of blurs of the grid that an image may have; its edges may have widened the measured one."""
    limits = _ANY_BLUR_PX
    if np.isfinite(blur_px):
        limits = (_BLURS[0] * max(blur_px, 0.5), _BLURS[1] * max(blur_px, 0.5))
    return np.arange(_blur_number(limits[0]), _blur_number(limits[1]) + 1)


def _blur_number(blur_px: float) -> int:
    return round(float(np.log(blur_px) / np.log(_BLUR_TIMES)))


def _of_blur(sections: _Sections, number: int, sizes: Array) -> Array:
    """Return the logarithm of the likelihood (n, c) with a blur of the grid."""
    result = np.zeros((len(sections.half), len(sizes)))
    for half, _ in _HALVES:
        of_half = np.flatnonzero(sections.half == half)
        if not len(of_half):
            continue
        square = _misfit(sections.light[of_half], half, number)
        fit = np.log1p(square / sections.variance[of_half, None])
        for i, row in zip(of_half, fit, strict=True):
            result[i] = np.interp(sizes * sections.px_per_mm[i], _widths(half), row)
    return -0.5 * _INDEPENDENT * sections.half[:, None] * result


def _widths(half: float) -> Array:
    """Return the distances of two lines that a profile may show."""
    return _APART_PX[2 * (half - _MARGIN_PX) - 2 * _PLACE_PX >= _APART_PX]


def _misfit(light: Array, half: float, number: int) -> Array:
    """Return the mean square misfit of profiles (n, k), for each distance of both lines (d,)."""
    places = _profile_places()
    light = light[:, np.abs(places) <= half]
    total = (light**2).sum(axis=1)
    columns = []
    for basis in _bases(half, number):
        shares = np.einsum("nk,ikb->nib", light, basis, optimize=True)
        columns.append(_least(total[:, None] - (shares**2).sum(axis=2)))
    return np.maximum(np.stack(columns, axis=1), 0.0) / light.shape[1]


def _least(squares: Array) -> Array:
    """Return the least of squares (n, i) at equally distant places, which lie on a parabola near it."""
    rows = np.arange(len(squares))
    best = np.clip(squares.argmin(axis=1), 1, squares.shape[1] - 2)
    before, middle, after = (squares[rows, best + k] for k in (-1, 0, 1))
    bend = before - 2 * middle + after
    shift = np.clip(0.5 * (before - after) / np.where(bend > 0, bend, 1.0), -1.0, 1.0)
    lower = np.where(bend > 0, middle - 0.25 * (before - after) * shift, middle)
    return np.asarray(np.minimum(lower, squares.min(axis=1)))


def _profile_places() -> Array:
    count = round(_HALVES[0][0] / 0.25)
    return np.asarray(np.arange(-count, count + 1)[::_EVERY] * 0.25, dtype=np.float64)


@lru_cache(maxsize=128)
def _bases(half: float, number: int) -> list[Array]:
    """Return orthonormal bases (i, k, b) of profiles, by place of the first line, for each distance of both."""
    places = _profile_places()
    places = places[np.abs(places) <= half]
    blur = _BLUR_TIMES**number
    bases = []
    for apart in _widths(half):
        first = np.arange(_MARGIN_PX - half, half - _MARGIN_PX - apart + 1e-9, _PLACE_PX)
        near = (places - first[:, None]) / blur
        far = near - apart / blur
        columns = [np.ones_like(near), _blurred(near, blur)[0]]
        columns += [_blurred(-near, blur)[1], _blurred(far, blur)[1]]
        if apart > 0:
            columns.append(_blurred(far, blur)[0])
        bases.append(np.linalg.qr(np.stack(columns, axis=2))[0])
    return bases


def _blurred(z: Array, blur: float) -> tuple[Array, Array]:
    """Return a blurred step and a blurred ramp at places z, in blurs."""
    step = np.zeros_like(z)
    ramp = np.zeros_like(z)
    for shift, weight in _KERNEL:
        at = z - shift / blur
        below = ndtr(at)
        step += weight * below
        ramp += weight * (at * below + np.exp(-0.5 * at**2) / np.sqrt(2 * np.pi))
    return step, ramp


def _agreed(
    likelihoods: Array, sections: _Sections, sizes: Array, names: Sequence[str]
) -> SeenBreak | None:
    """Return the break that several edges agree on; None if there is none."""
    rows = []
    largest = []
    for edge in np.unique(sections.edge):
        of_edge = sections.edge == edge
        count = min(int(of_edge.sum()), _MOST_OF_EDGE)
        value = count * likelihoods[of_edge].mean(axis=0)
        width = sizes * float(sections.px_per_mm[of_edge].mean())
        gain = float(value.max() - value[(sizes <= UNSTATED_MM) | (width <= UNCLEAR_PX)].max())
        size = float(sizes[value.argmax()])
        inside = sizes[value > value.max() - _FALL]
        if (
            gain >= GAIN * max(float(width[value.argmax()]), 1.0)
            and inside[-1] <= WIDEST * inside[0]
        ):
            rows.append((size, names[edge]))
        largest.append(inside[-1])
    if not rows:
        return None

    def against(size: float) -> int:
        """Return how many edges show that they are less broken."""
        return int(np.sum(np.array(largest) < size / ALIKE))

    shown = np.array([size for size, _ in rows])
    size = float(np.median(shown))
    alike = np.abs(np.log(shown / size)) <= np.log(ALIKE)
    if alike.sum() < max(FEWEST_EDGES, against(size) + 1, len(shown) / 2):
        # one radius looks like chamfers of several sizes
        smallest = float(shown.min())
        is_radius = float(shown.max()) <= UNLIKE * smallest and against(smallest) < len(shown)
        if len(shown) < FEWEST_UNLIKE or not is_radius:
            return None
        alike = np.ones(len(shown), dtype=np.bool_)
    low, high = np.quantile(shown[alike], _QUANTILES)
    limits = (float(f"{LEAST_TIMES * low:.2g}"), float(f"{ROUND_TIMES * high:.2g}"))
    edges = tuple(name for (_, name), same in zip(rows, alike, strict=True) if same)
    return SeenBreak(size, limits, edges)


# What is neither stated nor shown.


def pixel_mm(camera: Camera, solid: Solid, poses: Sequence[Array]) -> float:
    """Return how much a pixel is in the middle of a part, mm; the median of poses (4, 4), and 0 without any.

    Where the middle is nearer than what is sharp, or behind the camera, as of a large part, it is that of sharp places.
    """
    middle = (solid.vertices.min(axis=0) + solid.vertices.max(axis=0)) / 2
    nearest = camera.depth_of_field_mm[0]
    depths = [max(float((middle - pose[:3, 3]) @ pose[:3, 2]), nearest) for pose in poses]
    if not depths:
        return 0.0
    return float(max(camera.pixel_pitch_mm)) / camera.image_distance_mm * float(np.median(depths))


def unseen_mm(camera: Camera, solid: Solid, poses: Sequence[Array]) -> float:
    """Return the largest break that images from poses (4, 4) do not show, mm."""
    return min(UNSEEN_PX * pixel_mm(camera, solid, poses), MOST_UNSEEN_MM)


def unseen_breaks(
    results: Mapping[str, Result],
    states: Mapping[str, EdgeState],
    limit_mm: float,
    rule: DecisionRule,
) -> UnseenBreaks | None:
    """Return what breaks that nobody states and images do not show would do; None if all are stated.

    Parameters
    ----------
    results : mapping of str to Result
        What was measured.
    states : mapping of str to EdgeState
        By target.
    limit_mm : float
        Largest break that images do not show, mm.
    rule : DecisionRule
        How it was decided.
    """
    uncertainties = {}
    undecided = []
    for result in results.values():
        state = states.get(result.name)
        if not result.measured or state is None or state.stated or limit_mm <= state.high_mm:
            continue
        # steps move in proportion to narrow breaks
        more = result.budget["edge state"] * ((limit_mm / state.high_mm) ** 2 - 1.0)
        if more <= 0:
            continue
        u = math.sqrt(result.standard_uncertainty**2 + more)
        uncertainties[result.name] = COVERAGE * u
        if _decided(result, u, rule) != result.decision:
            undecided.append(result.name)
    if not uncertainties:
        return None
    return UnseenBreaks(limit_mm, uncertainties, tuple(undecided))


def _decided(result: Result, u: float, rule: DecisionRule) -> Decision:
    """Return the decision with another standard uncertainty."""
    good = [reading for reading in result.readings if reading.measured]
    if result.tolerance is None or not good[0].deviation_mm:
        return decide(result.deviation, u, result.tolerance, rule)
    best = surest(good)
    joint = np.array(best.covariance_mm2)
    joint += (u**2 - result.standard_uncertainty**2) * np.eye(len(joint))
    n = len(best.deviation_mm)
    bonus = None
    if result.bonus_mm > 0:
        # breaks move the size, too; what it has in common with the position is left out
        bonus = Bonus(result.bonus_mm, math.sqrt(joint[-1, -1]), (0.0,) * n)
    return decide_deviation(best.deviation_mm, joint[:n, :n], result.tolerance[1], rule, bonus)[0]


U_HOLDS = "U holds for that"
"""Begins what larger breaks would do."""


def edges_text(
    results: Mapping[str, Result], states: Mapping[str, EdgeState], unseen: UnseenBreaks | None
) -> str:
    """Say by how much edges are taken to be broken, and what larger breaks would do where none is stated.

    Parameters
    ----------
    results : mapping of str to Result
        What was measured.
    states : mapping of str to EdgeState
        By target.
    unseen : UnseenBreaks or None
        What breaks would do that nobody states.

    Returns
    -------
    str
        Without a full stop.
    """
    common = list(dict.fromkeys(states.values()))
    if len(common) == 1:
        texts = [str(common[0])]
    else:
        texts = [f"{name}: {state}" for name, state in states.items() if state.stated]
    if not all(state.stated for state in states.values()) and len(common) > 1:
        texts.append(f"others: {EdgeState()}")
    if unseen is None:
        return "; ".join(texts)
    wider = unseen.uncertainties
    worst = results[max(wider, key=lambda name: wider[name] / results[name].expanded_uncertainty)]
    text = (
        f"{U_HOLDS}. Images may not show breaks of up to {unseen.limit_mm:.2g} mm: with them, U of "
        f"{worst.name} is {digits_text(wider[worst.name], 2)} {worst.unit}, "
        f"not {digits_text(worst.expanded_uncertainty, 2)} {worst.unit}"
    )
    if unseen.open_decisions:
        names = ", ".join(unseen.open_decisions[:4]) + ", ..." * (len(unseen.open_decisions) > 4)
        text += f", and it is open whether {names} conform{'s' * (len(unseen.open_decisions) == 1)}"
    texts.append(text)
    return "; ".join(texts) + f". {STATE_EDGES}"
