"""What is asked of the lamps of a plan, in one frozen value: where they may be, and how much they have to show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aspectgraph.light.contrast import check_contrast, check_lamps
from aspectgraph.light.light_regions import DEFAULT_CONTRAST, LightRegions, compute_light
from aspectgraph.solid.ray_scene import RayScene
from planner.argument_kinds import FROM_0_BELOW_1, NOT_NEGATIVE, check_number
from planner.exceptions import RequestError
from planner.light.background import DEFAULT_STEP
from planner.light.corner_light import corners_of
from planner.light.demands import Demands, PlanToLight, demands_of
from planner.light.lamps import LampSpace, LampsTogether, check_lamps_given
from planner.light.served import Served
from planner.progress import Progress, labelled

if TYPE_CHECKING:
    from aspectgraph import Solid

GROUNDS = ("dark", "bright")
# the workspace of the regions is so much larger than the lamps' space, as a share of it
_ROOM = 0.01


@dataclass(frozen=True, eq=False)
class Lighting:
    """The options of the lamps of a plan; `plan_light` describes them in full.

    Parameters
    ----------
    lamps : array_like, shape (n, 3), or LampBox, LampDome or "ring"
        Positions of the lamps, mm, or the region where lamps may be, or a ring light.
    contrast, step : float
        Least contrast, and least step of grey values.
    ground : str
        "dark" or "bright".
    tolerance_mm : float
        Largest distance of a lamp from its position, mm.
    together : bool
        Whether all lamps are on in every image, as in a cell without switches. They then have equal
        strength. Otherwise one lamp is on at a time.

    Raises
    ------
    RequestError
        If an argument breaks its rule.
    LightError
        If the contrast is out of range.

    Examples
    --------
    >>> from planner import Lighting
    >>> Lighting("ring").is_ring
    True
    """

    lamps: Any
    contrast: float = DEFAULT_CONTRAST
    step: float = DEFAULT_STEP
    ground: str = "dark"
    tolerance_mm: float = 0.0
    together: bool = False

    def __post_init__(self) -> None:
        check_contrast(self.contrast)
        if isinstance(self.lamps, LampsTogether):
            object.__setattr__(self, "together", True)
            object.__setattr__(self, "lamps", self.lamps.lamps)
        object.__setattr__(self, "lamps", check_lamps_given(self.lamps))
        if self.together and self.is_ring:
            rule = "must be False for a ring light, which is one lamp"
            raise RequestError.of_rule("together", rule, "True")
        if self.ground not in GROUNDS:
            raise RequestError.of_rule(
                "ground", f"must be one of {', '.join(GROUNDS)}", repr(self.ground)
            )
        check_number("tolerance_mm", self.tolerance_mm, NOT_NEGATIVE)
        check_step(self.step)

    def __repr__(self) -> str:
        """Return a one-line summary."""
        lamps: object = self.given
        if lamps is None:
            lamps = "a ring light"
        elif isinstance(lamps, np.ndarray):
            lamps = f"{len(lamps)} lamps"
        return f"<Lighting by {lamps}: contrast {self.contrast:g}, step {self.step:g}, {self.ground} ground>"

    @property
    def given(self) -> LampSpace | NDArray[np.float64] | None:
        """Positions (n, 3) of fixed lamps, mm, or their region, or None for a ring light."""
        return None if self.is_ring else self.lamps

    @property
    def is_ring(self) -> bool:
        """Whether the lamp is on the camera."""
        return isinstance(self.lamps, str)

    @property
    def is_fixed(self) -> bool:
        """Whether the lamps have fixed positions."""
        return isinstance(self.lamps, np.ndarray)

    def check_part(self, solid: Solid) -> None:
        """Refuse fixed lamps inside the part.

        Parameters
        ----------
        solid : Solid
            The part.

        Raises
        ------
        LightError
            If there is one.
        """
        if isinstance(self.given, np.ndarray):
            check_lamps(solid, self.given)

    def served(self, plan: PlanToLight, solid: Solid, progress: Progress | None = None) -> Served:
        """Return a record of lamp positions that light the targets; it is empty at first.

        Parameters
        ----------
        plan : PlanToLight
            Settings and their targets.
        solid : Solid
            The part.
        progress : callable, optional
            ``progress(done, total, label)``.

        Returns
        -------
        Served
            With the pairs of the plan.

        Raises
        ------
        RequestError
            If the part is not the plan's.
        LightError
            If a fixed lamp is inside the part.
        """
        self.check_part(solid)
        given = self.given
        scene = RayScene(solid.vertices, solid.triangles, n_threads=1)
        demands = demands_of(plan, solid, scene, self.ground)
        if given is None:
            room = eyes_of(plan)
        else:
            room = given if isinstance(given, np.ndarray) else given.bounds
        # a displaced camera takes its ring along
        moved = plan.requirements.get("visibility_radius_mm", 0.0) if given is None else 0.0
        off = max(self.tolerance_mm, moved)
        light = _regions(solid, demands, self.contrast, _workspace(solid, room, off), progress)
        clearance = 0.0 if given is None or isinstance(given, np.ndarray) else given.clearance_mm
        names = [(pair.setting, pair.name) for pair in demands.pairs]
        corners = corners_of(plan, solid, scene, names, demands.edge_ids)
        return Served(
            light, scene, demands.pairs, self.contrast, self.step, clearance, off, corners
        )


def eyes_of(plan: PlanToLight) -> NDArray[np.float64]:
    """Return where the cameras of a plan are (n, 3), mm."""
    return np.array([np.asarray(one.cam2world)[:3, 3] for one in plan.settings]).reshape(-1, 3)


def check_step(step: float) -> float:
    """Return the step of grey values; RequestError if it is not in [0, 1)."""
    return check_number("step", step, FROM_0_BELOW_1)


def _workspace(solid: Solid, places: ArrayLike, tolerance_mm: float) -> NDArray[np.float64]:
    """Return a box around the part and all lamps."""
    points = np.concatenate([solid.bounds, np.reshape(places, (-1, 3))])
    low = points.min(axis=0)
    high = points.max(axis=0)
    room = _ROOM * float(np.linalg.norm(high - low)) + 2 * tolerance_mm
    return np.array([low - room, high + room])


def _regions(
    solid: Solid,
    demands: Demands,
    contrast: float,
    workspace: NDArray[np.float64],
    progress: Progress | None,
) -> LightRegions | None:
    if not demands.entities:
        return None
    shown = labelled(progress, "light regions")
    return compute_light(
        solid, demands.entities, contrast, workspace, None, shown, demands.silhouettes
    )
