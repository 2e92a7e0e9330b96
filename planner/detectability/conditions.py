"""What is asked of an image so that an edge can be found in it and its length be measured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import astuple, dataclass, fields

import numpy as np

from planner.exceptions import RequestError


@dataclass(frozen=True)
class Detectability:
    """Conditions for edges to be found in the image; each may be 0, which leaves it out.

    Without them a plan asks of an edge what Yang & Ciarallo (2001) ask: that it is not hidden. Images of plans made so
    were rendered and measured with a line fit that finds points to a tenth of a pixel: of edges with another edge
    within 3 px a quarter was measured as well as promised, of edges that run on smoothly in an arc a half.

    Parameters
    ----------
    separation_px : float
        No other visible edge and no occluding contour of a curved face comes so near to an edge in the image, its own
        neighbours near a common end excepted. A line fit looks at about as many pixels on either side.
    surround_px : float
        So much of the image lies around each end, beside the reserve for displaced poses: a fit needs to see the faces
        there and the other edges of the corner.
    min_corner_deg : float
        At each end another visible edge leaves the edge at this angle in the image at least, and none at a smaller one.
        Lines at less than 17 degrees shift the corner by two pixels; where an edge runs on smoothly in an arc, there is
        no point that its length could be measured to.

    Raises
    ------
    RequestError
        If a value is negative or not finite, or the angle is 90 degrees or more.

    Notes
    -----
    Only the surroundings are necessary for the proven lower bound, as they narrow the picture; the others make plans
    harder and leave the bound valid.

    Examples
    --------
    >>> from planner import Detectability
    >>> Detectability(separation_px=8.0)
    Detectability(separation_px=8.0, surround_px=40.0, min_corner_deg=25.0)
    >>> Detectability(0, 0, 0).asks_nothing
    True
    """

    separation_px: float = 5.0
    surround_px: float = 40.0
    min_corner_deg: float = 25.0

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            right = isinstance(value, int | float | np.number) and not isinstance(value, bool)
            if not (right and math.isfinite(value) and value >= 0):
                raise RequestError.of_rule(one.name, "must be finite and not negative", repr(value))
        if self.min_corner_deg >= 90:
            raise RequestError.of_rule(
                "min_corner_deg", "must be below 90", repr(self.min_corner_deg)
            )

    @property
    def asks_nothing(self) -> bool:
        """Whether all conditions are left out."""
        return not any(astuple(self))


Showing = Detectability
"""The name of `Detectability` up to version 0.1. It goes in the version after the next."""

USUAL = Detectability()
"""What is asked where nothing is said."""

NOT_ASKED = Detectability(0.0, 0.0, 0.0)
"""The paper's constraints: an edge must not be hidden."""


def asks_of_images(requirements: Mapping[str, float]) -> bool:
    """Return whether the requirements of a plan ask that edges are found in images.

    Parameters
    ----------
    requirements : mapping of str to float
        As `InspectionPlan.requirements`.
    """
    return any(requirements.get(one.name, 0.0) > 0 for one in fields(Detectability))
