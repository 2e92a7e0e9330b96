"""How images are measured: the options of `measure` and `Measurer`."""

from __future__ import annotations

from dataclasses import dataclass, field

from errors.measurands import DecisionRule, Localisation
from ground.short_repr import short_repr
from planner.argument_kinds import ABOVE_0_TO_1, check_kinds, check_number
from planner.camera.calibration import check_white_level
from planner.camera.pose import PoseUncertainty
from planner.camera.response import check_response
from planner.detectability.image_check import COVERAGE_SHARE
from planner.measuring.registration import Registration
from planner.measuring.task import REPEATABILITY
from planner.request.edge_state import checked_break


@dataclass(frozen=True)
class MeasureOptions:
    """How images are measured.

    Attributes
    ----------
    registration : Registration
        How poses are known. Default: from the part's own edges.
    localisation : Localisation or None
        How well edges are found; only its floor counts, because single points are judged by their own residuals. A
        registration takes edges to be off by three times the floor. None is the plan's. If that is none or the
        default of 0.05 px, it is 0.01 px, because broken edges are an error of their own.
    coverage : float
        Share of an entity that must be found, in (0, 1].
    rule : DecisionRule
        How it is decided. Default: ISO 14253-1 with 95 %.
    white_level : int or None
        Grey value of full exposure. None is that of the plan's camera, see `Camera`.
    response : str, float or None
        How much light a grey value stands for: "linear", "srgb", a gamma, or a file, see `Camera`. None is that of the
        plan's camera.
    edge_break_mm : (float, float) or None
        By how much the part's edges are broken along their faces, least and most, mm. Targets that state their own
        keep it. None is the plan's; without that, it is what images clearly show. Otherwise edges are assumed to be
        sharp within 0.05 mm.
    repeatability : PoseUncertainty
        By how much the camera moves between the images that a setting takes under different lamps. Images that are
        farther apart are refused. Default: 0.02 mm and 0.1 mrad.

    Raises
    ------
    RequestError
        If registration, rule, localisation or repeatability is no such value, the coverage is not in (0, 1], or
        the breaks are not two numbers in rising order.
    CameraError
        If the white level is not a grey value, or the response none.

    Examples
    --------
    >>> from planner import MeasureOptions, Registration
    >>> MeasureOptions(Registration.none()).coverage
    0.8
    >>> MeasureOptions().registration.method
    'own edges'
    """

    registration: Registration = field(default_factory=Registration.own_edges)
    localisation: Localisation | None = None
    coverage: float = COVERAGE_SHARE
    rule: DecisionRule = field(default_factory=DecisionRule.iso14253)
    white_level: int | None = None
    response: str | float | None = None
    edge_break_mm: tuple[float, float] | None = None
    repeatability: PoseUncertainty = REPEATABILITY

    __repr__ = short_repr

    def __post_init__(self) -> None:
        check_kinds(
            registration=(self.registration, "Registration"),
            rule=(self.rule, "DecisionRule"),
            repeatability=(self.repeatability, "PoseUncertainty"),
        )
        if self.localisation is not None:
            check_kinds(localisation=(self.localisation, "Localisation"))
        if self.response is not None:
            object.__setattr__(self, "response", check_response(self.response))
        if self.edge_break_mm is not None:
            object.__setattr__(self, "edge_break_mm", checked_break(self.edge_break_mm))
        if self.white_level is not None:
            object.__setattr__(self, "white_level", check_white_level(self.white_level))
        check_number("coverage", self.coverage, ABOVE_0_TO_1)


def or_default(options: MeasureOptions | None) -> MeasureOptions:
    """Return options, the default ones for None; refuse what is none, such as a dictionary."""
    if options is None:
        return MeasureOptions()
    check_kinds(options=(options, "MeasureOptions"))
    return options
