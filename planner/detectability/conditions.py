"""What is asked of an image so that an edge can be found in it and its length be measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple, dataclass, fields

from planner.argument_kinds import NOT_NEGATIVE, check_number, names_meant
from planner.exceptions import RequestError


@names_meant
@dataclass(frozen=True)
class Detectability:
    """Conditions under which software can find edges in the image.

    The value 0 switches a condition off.

    Without them a plan requires only that edges are not hidden, as Yang & Ciarallo (2001) do. We
    rendered images of such plans and measured them with a line fit accurate to a tenth of a pixel.
    A quarter of the edges with another edge within 3 px reached the predicted accuracy. A half of
    the edges that end in a tangent arc reached it.

    Parameters
    ----------
    separation_px : float
        Keep this distance in the image between an edge and every other visible edge or occluding
        contour of a curved face, px. Neighbours near a common end are exempt. A line fit uses about
        as many pixels on either side. Of the lines and circles of a dimension, four fifths of the
        points must keep it, and one in each twelfth.
    surround_px : float
        Keep each end at least this far inside the image, px, in addition to the safety margin for
        displaced poses. A fit needs the faces there and the other edges of the corner.
    min_corner_deg : float
        At each end another visible edge leaves at this angle or more in the image, degrees, and
        none at a smaller angle. Lines at less than 17 degrees shift the corner by two pixels. An
        edge that ends in a tangent arc has no corner there, so its length is undefined.

    Raises
    ------
    RequestError
        If a value is negative or not finite, or the angle is 90 degrees or more.

    Notes
    -----
    The proof of the lower bound uses only `surround_px`, because it narrows the picture. The other
    conditions restrict plans further and leave the bound valid.

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
        for field in fields(self):
            check_number(field.name, getattr(self, field.name), NOT_NEGATIVE)
        if self.min_corner_deg >= 90:
            raise RequestError.of_rule(
                "min_corner_deg", "must be below 90", repr(self.min_corner_deg)
            )

    @property
    def asks_nothing(self) -> bool:
        """Whether all conditions are switched off."""
        return not any(astuple(self))


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
    return any(requirements.get(field.name, 0.0) > 0 for field in fields(Detectability))
