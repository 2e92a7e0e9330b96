"""A proposal of optics, and a table of several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.camera.camera import Camera
from planner.progress.text_table import Column, table_lines


@dataclass(frozen=True, repr=False)
class OpticsProposal:
    """A camera with a lens and its settings, and how well it measures each target.

    The values are those of the best pose tried for each target.

    Attributes
    ----------
    body, lens : str
        Names of camera and lens in the catalogue.
    camera : Camera
        Both together, with the aperture set and the focus at the working distance.
    required : float
        The required probability.
    probability : dict of str to float
        Per target, P(error at most the permitted one). It is 0 if no pose tried meets every
        constraint.
    share : dict of str to float
        Ratio of the expanded uncertainty U (k = 2) to the permitted error, per target with a pose.
    poses : dict of str to array (4, 4)
        Those poses, cam2world, mm.
    """

    body: str
    lens: str
    camera: Camera
    required: float
    probability: dict[str, float]
    share: dict[str, float]
    poses: dict[str, NDArray[np.float64]] = field(compare=False)

    def __repr__(self) -> str:
        """Show the optics and how many items they measure as required."""
        how = f"f/{self.camera.f_number:g} at {self.working_distance_mm:g} mm"
        return f"<OpticsProposal: {self.camera.name}, {how}: {len(self.able)} of {len(self.probability)} items>"

    @property
    def working_distance_mm(self) -> float:
        """Distance from the front nodal point to the plane in focus."""
        return self.camera.focus_distance_mm

    @property
    def able(self) -> tuple[str, ...]:
        """Targets measured with the required probability."""
        return tuple(name for name, p in self.probability.items() if p >= self.required)

    @property
    def worst_share(self) -> float:
        """Largest ratio of U to the permitted error among `able`; inf without any."""
        return max((self.share[name] for name in self.able), default=float("inf"))

    @property
    def field_mm(self) -> tuple[float, float]:
        """Width and height of the field of view at the working distance."""
        left, top, right, bottom = self.camera.field().inner
        return (right - left) * self.working_distance_mm, (bottom - top) * self.working_distance_mm

    def to_dict(self) -> dict[str, Any]:
        """Return the proposal as plain values, without the poses.

        Returns
        -------
        dict
            Ready for JSON.
        """
        return {
            "body": self.body,
            "lens": self.lens,
            "camera": self.camera.to_dict(),
            "able": list(self.able),
            "probability": dict(self.probability),
            "share": dict(self.share),
        }


def optics_table(proposals: Sequence[OpticsProposal], most: int = 10) -> str:
    """Return proposals as a table of plain text.

    Parameters
    ----------
    proposals : sequence of OpticsProposal
        In the order of `propose_optics`: the best first.
    most : int
        Largest number of rows.

    Returns
    -------
    str
        A heading, and a line per proposal: camera, lens, f-number, working distance, depth of field
        and field of view. Then follow how many targets it measures as required, and the largest
        ratio of U to the permitted error among them.

    Examples
    --------
    >>> from planner import Camera, OpticsProposal, optics_table
    >>> camera = Camera.named("basler-acA2440-20gm-8mm")
    >>> able = OpticsProposal("a body", "a lens", camera, 0.9, {"rim": 0.97}, {"rim": 0.8}, {})
    >>> heading, _, row = optics_table([able]).splitlines()
    >>> print(heading)
    body    lens    f/  distance  sharp (mm)  field (mm)  targets  U / permitted
    >>> print(row)
    a body  a lens   8    300 mm  266 to 343   308 x 258      1/1           80 %
    """
    return "\n".join(table_lines(OPTICS_COLUMNS, optics_rows(proposals, most), None))


OPTICS_COLUMNS = (
    Column("body"),
    Column("lens"),
    Column("f/", right=True),
    Column("distance", right=True),
    Column("sharp (mm)", right=True),
    Column("field (mm)", right=True),
    Column("targets", right=True),
    Column("U / permitted", right=True),
)
"""Columns of the table of proposals."""


def optics_rows(proposals: Sequence[OpticsProposal], most: int) -> list[tuple[str, ...]]:
    """Return a row per proposal, in the columns of `OPTICS_COLUMNS`.

    Parameters
    ----------
    proposals : sequence of OpticsProposal
        In the order of `propose_optics`.
    most : int
        Largest number of rows.
    """
    rows: list[tuple[str, ...]] = []
    for one in proposals[:most]:
        width, height = one.field_mm
        row = (
            one.body,
            one.lens,
            f"{one.camera.f_number:g}",
            f"{one.working_distance_mm:g} mm",
            one.camera.depth_of_field_text,
            f"{width:.0f} x {height:.0f}",
            f"{len(one.able)}/{len(one.probability)}",
            f"{100 * one.worst_share:.0f} %" if one.able else "-",
        )
        rows.append(row)
    return rows
