"""Why a request is not met: which constraint, for which entity, by how much.

"Cannot be met" is proven. "No tried pose meets" is the result of a search.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from planner.exceptions import InfeasibleError
from planner.request.camera_limits import focus_reach_mm, longest_image_mm, widest_view_mm
from planner.request.constraints import Constraints
from planner.request.reach import Space, cells_of
from planner.search.first_poses import PoseEncoding, neighbours

if TYPE_CHECKING:
    from aspectgraph import CellSet


_UNITS = {"mm": "mm", "px": "px", "deg": "degrees"}
_ROUNDS = np.geomspace(0.2, 1e-4, 20)


def check_observable(space: Space, names: Sequence[str]) -> CellSet:
    """Return the covering cells of the entities, or raise `InfeasibleError` naming who cannot be seen."""
    cells = cells_of(space, list(names))
    if len(cells):
        return cells
    hidden = [name for name in names if not len(cells_of(space, [name]))]
    if hidden:
        raise InfeasibleError(
            f"visibility cannot be met: no viewpoint in the workspace sees all of entity {hidden[0]!r}.",
            constraint="visibility",
            entity=hidden[0],
            margin=-1.0,
            proven=True,
        )
    pair = _pair_never_seen_together(space, names)
    who = f"entities {pair[0]!r} and {pair[1]!r}" if pair else f"entities {', '.join(names)}"
    raise InfeasibleError(
        f"visibility cannot be met: no viewpoint in the workspace sees all of {who}.",
        constraint="visibility",
        entity=pair[1] if pair else "",
        margin=-1.0,
        proven=True,
    )


def _pair_never_seen_together(space: Space, names: Sequence[str]) -> tuple[str, str] | None:
    """Return two entities without a common viewpoint, or None if every two seem to have one.

    Viewpoints drawn for one entity clear most pairs at little cost; a few of the others are looked into exactly.
    """
    if len(names) == 2:
        return names[0], names[1]
    seen = np.array(
        [
            space.observable(cells_of(space, [name]).sample(1000, 0), names).any(axis=0)
            for name in names
        ]
    )
    doubtful = [(names[i], names[j]) for i, j in np.argwhere(~(seen | seen.T)) if i < j]
    return next((pair for pair in doubtful[:5] if not len(cells_of(space, list(pair)))), None)


def check_resolvable(constraints: Constraints) -> None:
    """Raise `InfeasibleError` for an entity too short to be resolved wherever the lens can focus.

    See `planner.request.camera_limits.longest_image_mm`.
    """
    camera = constraints.camera
    nearest = camera.depth_of_field_mm[0]
    segments = constraints.segments
    lengths = np.where(
        constraints.resolved, np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1), np.inf
    )
    worst = int(np.argmin(lengths))
    name = constraints.names[constraints.owner[worst]]
    longest = float(longest_image_mm(camera, lengths)[worst])
    margin = longest - constraints.min_length_mm
    if margin < 0:
        pixel = max(camera.pixel_pitch_mm)
        raise InfeasibleError(
            f"resolution_mm cannot be met for entity {name!r}: it is {lengths[worst]:.6g} mm long. Where "
            f"the lens focuses (from {nearest:.4g} mm), its image is at most {longest / pixel:.4g} px long, "
            f"but must be at least {constraints.requirements.min_length_px:.4g} px.",
            constraint="resolution_mm",
            entity=name,
            margin=margin,
            proven=True,
        )


def check_extent(constraints: Constraints) -> None:
    """Raise `InfeasibleError` for entities too far apart for one image.

    See `planner.request.camera_limits.widest_view_mm`.
    """
    camera = constraints.camera
    limit = widest_view_mm(constraints.camera)
    ends = constraints.segments.reshape(-1, 3)
    apart = np.linalg.norm(ends[:, None] - ends, axis=-1)
    first, second = np.unravel_index(np.argmax(apart), apart.shape)
    if apart[first, second] > limit:
        names = list(
            dict.fromkeys(constraints.names[constraints.owner[i // 2]] for i in (first, second))
        )
        who = (
            f"entities {names[0]!r} and {names[1]!r}: their"
            if len(names) > 1
            else f"entity {names[0]!r}: its"
        )
        margin = (
            (limit - apart[first, second])
            * camera.image_distance_mm
            / camera.depth_of_field_mm[1]
            / min(camera.pixel_pitch_mm)
        )
        raise InfeasibleError(
            f"field_of_view_px cannot be met for {who} ends are {apart[first, second]:.5g} mm apart, but where "
            f"the lens focuses, the image covers at most {limit:.5g} mm.",
            constraint="field_of_view_px",
            entity=names[-1],
            margin=float(margin),
            proven=True,
        )


def missing_corners(constraints: Constraints) -> dict[str, InfeasibleError]:
    """Return the edges that run on smoothly in an arc although corners are asked for, and what to say of each."""
    found = {}
    for k, name in enumerate(constraints.names if "corner_deg" in constraints.shows else ()):
        end = constraints.image.without_corner(k)
        if end is not None:
            place = ", ".join(f"{x:.6g}" for x in end)
            least = constraints.requirements.showing.min_corner_deg
            found[name] = InfeasibleError(
                f"corner_deg cannot be met for entity {name!r}: at ({place}) mm the edge ends in a tangent "
                "arc, so its length is undefined. Distances and angles are not affected. To measure its "
                f"length, require no corner (0 instead of {least:g} degrees).",
                constraint="corner_deg",
                entity=name,
                margin=-least,
                proven=True,
            )
    return found


def explain_positions(
    constraints: Constraints, cells: CellSet, rng: np.random.Generator
) -> InfeasibleError:
    """Explain a request whose covering domains hold no viewpoint at a distance where the lens can focus."""
    positions = np.concatenate([cells.sample(4096, rng), *(cell.vertices for cell in cells)])
    distance = np.linalg.norm(positions[:, None, None] - constraints.ends, axis=-1)
    nearest, farthest = focus_reach_mm(constraints.camera)
    slack = np.minimum(distance - nearest, farthest - distance).min(axis=-1)
    best = int(np.argmax(slack.min(axis=1)))
    worst = int(np.argmin(slack[best]))
    return InfeasibleError(
        f"no tried viewpoint meets focus_mm for entity {constraints.names[worst]!r}: its ends must be "
        f"{nearest:.5g} to {farthest:.5g} mm from the camera. From the best of {len(positions)} viewpoints that see "
        f"the targets, they are {distance[best, worst].min():.5g} to {distance[best, worst].max():.5g} mm away.",
        constraint="focus_mm",
        entity=constraints.names[worst],
        margin=float(slack[best, worst]),
    )


def explain_infeasible(
    constraints: Constraints,
    encoding: PoseEncoding,
    tried: np.ndarray,
    rng: np.random.Generator | None,
) -> InfeasibleError:
    """Explain why none of the tried parameters (m, 6), the least violating first, could be made feasible.

    A constraint that fails by itself in every pose, even after a search for its own best margin, is named first;
    else the constraints conflict, and those the least violating pose breaks are named. Without a source of chance there
    is no such search.
    """
    unreached = constraints.explain_reach()
    if unreached:
        who = ", ".join(constraints.names)
        return InfeasibleError(
            f"the robot reaches no tried pose that meets all else for {who}: {unreached}.",
            constraint="robot",
            margin=-1.0,
        )
    margins = constraints.margins(encoding.poses(tried))
    if rng is None:
        return _nearest_misses(margins, constraints)
    for name in sorted(
        margins, key=lambda name: margins[name].min(axis=1).max() / constraints.scale(name)
    ):
        if margins[name].min(axis=1).max() >= 0:
            break
        margin, entity = _best_margin(name, constraints, encoding, tried, rng)
        if margin < 0:
            # of visibility the margin is only a sign
            best = (
                ""
                if name == "visibility"
                else f": the best margin found is {_quantity(name, margin)}"
            )
            return InfeasibleError(
                f"no tried pose meets {name}{_for(entity)}{best}.",
                constraint=name,
                entity=entity,
                margin=margin,
            )
    return _nearest_misses(margins, constraints)


def _best_margin(
    name: str,
    constraints: Constraints,
    encoding: PoseEncoding,
    tried: np.ndarray,
    rng: np.random.Generator,
) -> tuple[float, str]:
    """Search poses for the largest margin of one constraint; return it and the entity that sets it."""
    pool = tried[:32]
    for step in _ROUNDS:
        pool = np.concatenate([pool, neighbours(pool, 96, step, encoding, rng)])
        margin = constraints.slacks(encoding.poses(pool), [name])[name].min(axis=-1)
        best = np.argsort(-margin.min(axis=1), kind="stable")[:32]
        pool = pool[best]
        margin = margin[best]
    return _worst(margin[0], constraints)


def _worst(margin: np.ndarray, constraints: Constraints) -> tuple[float, str]:
    """Return the smallest of the margins (k,) or (1,), and the entity's name if they belong to entities."""
    index = int(np.argmin(margin))
    shared = len(margin) == 1 and len(constraints.names) > 1
    return float(margin[index]), "" if shared else constraints.names[index]


def _nearest_misses(margins: dict[str, np.ndarray], constraints: Constraints) -> InfeasibleError:
    """Explain by the first pose, which comes nearest: what it still misses."""
    worst = {name: _worst(margin[0], constraints) for name, margin in margins.items()}
    missed = sorted((m / constraints.scale(name), name) for name, (m, _) in worst.items() if m < 0)
    parts = [
        f"{name} by {_quantity(name, -worst[name][0])}{_for(worst[name][1])}" for _, name in missed
    ]
    name = missed[0][1] if missed else ""
    what = f": the nearest pose misses {', '.join(parts)}" if parts else ""
    return InfeasibleError(
        f"no tried pose meets all constraints for {', '.join(constraints.names)}{what}.",
        constraint=name,
        entity=worst[name][1] if name else "",
        margin=worst[name][0] if name else float("nan"),
        together=True,
    )


def _for(entity: str) -> str:
    return f" for entity {entity!r}" if entity else ""


def _quantity(name: str, value: float) -> str:
    return f"{value:.4g} {_UNITS.get(name.rsplit('_', 1)[-1], '')}".rstrip()
