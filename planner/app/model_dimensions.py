"""The dimensions that a model or a folder of files states, as `plan` and `batch` measure them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aspectgraph import GeometricTolerance, ReadError, ReadLimits, read_requirements
from errors.measurands.measurand import kinds
from planner.argument_kinds import ABOVE_0_TO_1, check_number, check_path
from planner.exceptions import RequestError
from planner.request.dimension import QUARTER
from planner.request.dimension_files import dimensions_to_plan, read_wanted
from planner.request.resolve import with_places
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


@dataclass(frozen=True)
class DimensionFolder:
    """A folder with a file of dimensions for each part of a batch.

    The file has the path of the part in its folder, and ends in ``.toml`` or ``.json``:
    ``more/plate.toml`` for ``more/plate.step``. A file that is changed has its part planned anew.

    Attributes
    ----------
    folder : str
        The folder.
    share : float
        Permitted error as a share of half the tolerance's width, in (0, 1].

    Raises
    ------
    RequestError
        The share breaks its rule.

    Examples
    --------
    >>> from planner import DimensionFolder
    >>> DimensionFolder("examples").file_of("two_pocket_block_dimensions.off").name
    'two_pocket_block_dimensions.toml'
    """

    folder: str
    share: float = QUARTER

    def __post_init__(self) -> None:
        check_path("folder", self.folder)
        check_number("share", self.share, ABOVE_0_TO_1)

    def file_of(self, part: str | Path) -> Path | None:
        """Return the file of a part.

        Parameters
        ----------
        part : path
            The part's file, relative to the folder of parts.

        Returns
        -------
        pathlib.Path or None
            None if there is none.
        """
        stem = Path(part).with_suffix("")
        stem = stem.with_suffix("") if Path(part).suffix.lower() == ".gz" else stem
        paths = [Path(self.folder) / f"{stem}{suffix}" for suffix in (".toml", ".json")]
        return next((path for path in paths if path.is_file()), None)

    def check_parts(self, parts: Iterable[str]) -> None:
        """Check that every part has a file.

        Parameters
        ----------
        parts : iterable of str
            The parts' files, relative to the folder of parts.

        Raises
        ------
        RequestError
            A part has none.
        """
        missing = [part for part in parts if self.file_of(part) is None]
        if missing:
            more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
            rule = "must hold NAME.toml or NAME.json for every part"
            raise RequestError.of_rule("dimensions", rule, f"none for {missing[0]}{more}")

    def chosen(self, part: str, solid: Solid) -> dict[str, Any]:
        """Return what the file of a part states, as `plan_inspection` takes it.

        Parameters
        ----------
        part : str
            The part's file, relative to the folder of parts.
        solid : Solid
            The part.

        Returns
        -------
        dict of str to Dimension or entity
            By name, in the order of the file.

        Raises
        ------
        RequestError
            There is no such file, or what it says breaks a rule.
        """
        self.check_parts([part])
        path = self.file_of(part)
        assert path is not None
        return dict(with_places(solid, read_wanted(path, kinds(), self.share)))


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
