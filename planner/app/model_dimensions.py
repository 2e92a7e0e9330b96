"""The dimensions that a model states, as `plan` and `batch` measure them: which ones, and what is left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aspectgraph import GeometricTolerance, ReadError, ReadLimits, read_requirements
from planner.argument_kinds import ABOVE_0_TO_1, check_number
from planner.exceptions import RequestError
from planner.request.dimension import QUARTER
from planner.request.dimension_files import dimensions_to_plan
from planner.text_table import count

if TYPE_CHECKING:
    from aspectgraph import ModelDimension, ModelRequirements, Solid

_LEFT_OUT = {
    "reference": "see --reference-dimensions",
    "basic": "plan without --no-basic-dimensions",
}
"""What to do about dimensions that their role leaves out."""


@dataclass(frozen=True)
class ModelDimensions:
    """A choice among the dimensions that a STEP file (AP242) states.

    `dimensions_to_plan` describes the fields in full.

    Attributes
    ----------
    share : float
        Permitted error as a share of half the tolerance's width, in (0, 1].
    one_per_pattern : bool
        Measure each dimension on one of its features.
    reference : bool
        Plan reference dimensions, too.
    basic : bool
        Plan basic dimensions.
    positions : bool
        Plan positions, symmetry and coaxiality.

    Raises
    ------
    RequestError
        The share breaks its rule.

    Examples
    --------
    >>> from planner import ModelDimensions
    >>> ModelDimensions(share=0.2).share
    0.2
    """

    share: float = QUARTER
    one_per_pattern: bool = False
    reference: bool = False
    basic: bool = True
    positions: bool = True

    def __post_init__(self) -> None:
        check_number("share", self.share, ABOVE_0_TO_1)

    def chosen(
        self, stated: Iterable[ModelDimension | GeometricTolerance], part: str | Path
    ) -> tuple[dict[str, Any], dict[str, str]]:
        """Return the dimensions to plan, and why the others are left out.

        Parameters
        ----------
        stated : iterable of ModelDimension or GeometricTolerance
            What the model states.
        part : path
            Its file, for errors.

        Returns
        -------
        items : dict of str to Dimension
            What to plan, by name.
        left_out : dict of str to str
            The others, with the reason.

        Raises
        ------
        RequestError
            There is none to plan, or a tolerance breaks its rule.
        """
        items, left_out = dimensions_to_plan(
            stated,
            share=self.share,
            one_per_pattern=self.one_per_pattern,
            reference=self.reference,
            basic=self.basic,
            positions=self.positions,
        )
        if not items:
            raise _nothing_to_plan(stated, part)
        return dict(items), left_out


def stated_dimensions(
    part: str | Path, solid: Solid, limits: ReadLimits | None = None
) -> ModelRequirements:
    """Return the requirements that the file of a part states, of which one at least is a dimension.

    Parameters
    ----------
    part : path
        The file.
    solid : Solid
        The part.
    limits : ReadLimits, optional
        What reading may take.

    Raises
    ------
    ReadError
        It states no dimension.
    """
    stated = read_requirements(part, solid, limits=limits)
    if not stated.dimensions:
        raise ReadError(
            f"the part must be a STEP file with semantic dimensions (AP242). Got {part}, which states none; a file of "
            "dimensions can be given instead."
        )
    return stated


def _nothing_to_plan(
    stated: Iterable[ModelDimension | GeometricTolerance], part: str | Path
) -> RequestError:
    """Return the error of a model without a dimension to plan; it counts those left out by their role."""
    roles = Counter(
        requirement.role
        for requirement in stated
        if not isinstance(requirement, GeometricTolerance) and requirement.entities is not None
    )
    texts = [
        f"{count(roles[role], f'{role} dimension')} {'is' if roles[role] == 1 else 'are'} left out: {advice}"
        for role, advice in _LEFT_OUT.items()
        if roles[role]
    ]
    error = RequestError(
        f"--dimensions all needs a dimension that can be measured. Got none in {part}."
    )
    error.hint = ". ".join(texts)
    return error
