"""The sensor setting: a pose, what is inspected from it, and how sure that is."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Annotated, Any

import numpy as np

from errors.checks import relation_text
from ground.convert import SPELLED, STATED, Meta, from_plain, to_plain
from ground.short_repr import count
from planner.exceptions import PlanFileError
from planner.plan_file import Amount, Count, Names, Pixels, Pose, Probabilities, Share, Texts
from planner.request.registration import PoseKnowledge

# Names of the images that the settings of a plan take.


def setting_name(setting_idx: int, image_idx: int | None = None) -> str:
    """Return the name of a setting, such as "setting_01", or of one of its images, such as "setting_01_2".

    Parameters
    ----------
    setting_idx : int
        Number of the setting, from 0.
    image_idx : int, optional
        Number of the image, from 0, of a setting that takes several, each with other lamps.
    """
    stem = f"setting_{setting_idx + 1:02d}"
    return stem if image_idx is None else f"{stem}_{image_idx + 1}"


def image_name(setting_idx: int, image_idx: int | None = None) -> str:
    """Return the file name of the image that a setting takes, see `setting_name`."""
    return f"{setting_name(setting_idx, image_idx)}.png"


# Why something is not inspected: a kind for programs, and a text for people.


class ReasonKind(Enum):
    """Kinds of reasons why a plan does not inspect an item. The values are those of the files."""

    UNOBSERVABLE = "unobservable"
    IN_VIEW_FROM_NO_POSE_TRIED = "in view from no pose tried"
    NOT_SHOWN = "not shown"
    TOO_SHORT = "too short"
    OUT_OF_FOCUS = "out of focus"
    TOO_LARGE = "too large"
    OUT_OF_REACH = "out of reach"
    TOO_NEAR = "too near"
    NO_CORNER = "no corner"
    LINE_NEARBY = "line nearby"
    NO_FEASIBLE_VIEW = "no feasible view"
    PROBABILITY_TOO_LOW = "probability too low"
    LIMITED_BY_PART = "limited by part"
    NOT_FOUND_YET = "not found yet"
    NOT_STATED = "not stated"

    @property
    def words(self) -> str:
        """The kind in words."""
        return _WORDS.get(self, self.value)


_WORDS = {
    ReasonKind.IN_VIEW_FROM_NO_POSE_TRIED: "not in view from any tried pose",
    ReasonKind.NOT_SHOWN: "not readable in the light",
    ReasonKind.TOO_SHORT: "too short for the resolution",
    ReasonKind.TOO_LARGE: "larger than the field of view",
    ReasonKind.TOO_NEAR: "in view only from too close to the part",
    ReasonKind.NO_CORNER: "no corner to measure to",
    ReasonKind.LINE_NEARBY: "too close to another line in the image",
    ReasonKind.LIMITED_BY_PART: "probability too low for these edges and faces",
    ReasonKind.NOT_FOUND_YET: "no view found yet",
    ReasonKind.NOT_STATED: "other reasons",
}


class Reason(str):
    """The text of a reason, with its kind.

    Parameters
    ----------
    text : str
        The whole sentence.
    kind : ReasonKind
        Kind of the reason. Default: that of a text from elsewhere, such as an older plan file.

    Examples
    --------
    >>> from planner import Reason, ReasonKind
    >>> reason = Reason.of(ReasonKind.OUT_OF_REACH, "the wall is in the way.")
    >>> print(reason)
    out of reach: the wall is in the way.
    >>> reason.kind
    <ReasonKind.OUT_OF_REACH: 'out of reach'>
    """

    kind: ReasonKind

    def __new__(cls, text: str, kind: ReasonKind = ReasonKind.NOT_STATED) -> Reason:
        """Make a text with a kind."""
        reason = super().__new__(cls, text)
        reason.kind = kind
        return reason

    @classmethod
    def of(cls, kind: ReasonKind, details: object) -> Reason:
        """Return the sentence "KIND: DETAILS".

        Parameters
        ----------
        kind : ReasonKind
            Its words begin the sentence.
        details : object
            The rest of it; the same words at its beginning are left out.

        Returns
        -------
        Reason
            The sentence with its kind.
        """
        return cls(f"{kind.words}: {str(details).removeprefix(f'{kind.words} ')}", kind)


def kind_of(reason: str) -> ReasonKind:
    """Return the kind of a reason; a plain text states none."""
    return reason.kind if isinstance(reason, Reason) else ReasonKind.NOT_STATED


def kinds_record(reasons: Mapping[str, str]) -> dict[str, str]:
    """Return the values of the kinds that are stated, by name, as files hold them."""
    kinds = {name: kind_of(reason) for name, reason in reasons.items()}
    return {name: kind.value for name, kind in kinds.items() if kind is not ReasonKind.NOT_STATED}


def reasons_from(
    texts: Mapping[str, str], kinds: Mapping[str, str | ReasonKind]
) -> dict[str, Reason]:
    """Return reasons from the texts and kinds of a file; of what has no kind, none is stated."""
    stated = ReasonKind.NOT_STATED.value
    return {name: Reason(text, ReasonKind(kinds.get(name, stated))) for name, text in texts.items()}


# fields that hold something of each target
_BY_TARGET = ("probability", "p_all", "witness", "ends", "passed_over", "lines_in_window_px")


@dataclass(frozen=True, eq=False, repr=False)
class SensorSetting:
    """A camera pose and the entities it inspects.

    Attributes
    ----------
    cam2world : array (4, 4)
        Pose in OpenCV axes (x right, y down, z forward), mm, in the part's frame.
    entities : tuple of str
        Names of the inspected entities.
    probability : dict of str to float
        Per entity, the probability P that the error of its measured value is at most the permitted
        error. P assumes a registered image in which the entity is found.
    p_all : dict of str to float
        Per entity, the probability P_all that the displaced camera measures it. The entity is then
        in the picture, in focus, unhidden and apart from other lines, and the error is at most the
        permitted one. It is a lower bound with 99.9 % confidence, counted over `p_all_poses`
        displaced poses, see `planner.verify.simulate_setting`. Empty if it was not counted.
    p_all_together : float
        The same for all entities at once; nan if it was not counted.
    p_all_poses : int
        Number of displaced poses.
    witness : dict of str to int
        Of each entity that several sets of entities can measure, which of them this setting uses,
        from 0. See ``PlannedDimension.witnesses``.
    ends : dict of str to int
        Of each dimension of which this setting measures one end alone, the number of this end, 0
        or 1. Another setting measures the other one. P and P_all are then those of the end's own
        error, with a permitted error of r/√2. See `errors.measurands.end_groups` for the ends.
    passed_over : dict of str to dict
        Of each such entity, why the setting uses none of the other sets: ids and the reason.
    margins : dict of str to float
        Per constraint, the smallest margin over the entities. A constraint is met at 0 or more. The
        key ends with the unit.
    fitness : float
        Objective of the search: the sum (or the smallest) of the probabilities.
    nfev : int
        Number of poses the search evaluated.
    generations : int
        Number of generations of the genetic algorithm.
    message : str
        Why the search stopped.
    seed : int or None
        Seed that reproduces the run. None if the caller passed a generator.
    history : tuple of float
        Best fitness after each generation.
    lines_in_window_px : dict of str to float
        Edges with another visible line in their search window, and the distance of that line, px.
        Only plans with conditions on the image have it.
    registered : PoseKnowledge or None
        How surely its pose and values are known when they are read, in plans with registration.
    fixturing : str
        Which way the part lies for it, in plans for a robot cell; otherwise empty.
    joints : tuple of float
        Joints (6,) of the robot, rad, in plans for a robot cell; otherwise empty.
    angle_deg : float or None
        Angle of the turntable, degrees, where the part lies on one; otherwise None.
    arm : dict of str to float or str
        In plans for a robot cell. ``clearance_robot_mm`` is the distance of the ``closest`` two
        objects, ``to_limit_rad`` that of the joints from their limits. ``singular_value`` is the
        smallest of the Jacobian with lengths divided by 500 mm.

    Examples
    --------
    >>> from planner import read_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> plan.settings[0]
    <SensorSetting: 2 targets from (164.1, 133.0, 290.8) mm, smallest probability > 0.9999>
    >>> plan.settings[0].cam2world.shape
    (4, 4)
    """

    cam2world: Pose
    entities: Names
    probability: Probabilities
    margins: Annotated[
        Mapping[str, Annotated[float, SPELLED]], Meta(title="must map constraints to margins")
    ]
    fitness: float
    nfev: Count
    generations: Count
    message: str
    seed: Annotated[Count | None, STATED] = None
    history: Annotated[tuple[float, ...], STATED, Meta(title="must be an array of numbers")] = ()
    lines_in_window_px: Pixels = field(default_factory=dict)
    p_all: Probabilities = field(default_factory=dict)
    p_all_together: Share = math.nan
    p_all_poses: Count = 0
    witness: Mapping[str, Annotated[int, Meta(ge=0, le=10**6)]] = field(default_factory=dict)
    ends: Mapping[str, Annotated[int, Meta(ge=0, le=1)]] = field(default_factory=dict)
    passed_over: Mapping[str, Texts] = field(default_factory=dict)
    registered: PoseKnowledge | None = None
    fixturing: str = ""
    joints: Annotated[
        tuple[float, ...], Meta(min_length=6, max_length=6, title="must hold six angles")
    ] = ()
    angle_deg: float | None = None
    arm: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        pose = np.array(self.cam2world, dtype=np.float64)
        pose.setflags(write=False)
        object.__setattr__(self, "cam2world", pose)

    def __repr__(self) -> str:
        """Return a one-line summary."""
        from errors.checks import probability_text

        place = ", ".join(f"{c:.1f}" for c in self.position)
        worst = (
            f", smallest probability {probability_text(min(self.promise.values()))}"
            if self.probability
            else ""
        )
        return f"<SensorSetting: {count(len(self.entities), 'target')} from ({place}) mm{worst}>"

    @property
    def position(self) -> np.ndarray:
        """Front nodal point (3,), mm."""
        return self.cam2world[:3, 3]

    @property
    def axes(self) -> tuple[float, ...]:
        """The joints, and behind them the angle of the turntable if there is one, rad."""
        turned = () if self.angle_deg is None else (math.radians(self.angle_deg),)
        return (*self.joints, *turned)

    @property
    def promise(self) -> dict[str, float]:
        """The promise for each entity: `p_all`, or `probability` where that was not counted."""
        return dict(self.p_all or self.probability)

    def without(self, names: Collection[str]) -> SensorSetting:
        """Return the setting without some of its targets; what it states of the others stays.

        Parameters
        ----------
        names : collection of str
            Names of targets.

        Returns
        -------
        SensorSetting
            Its ``margins`` and ``p_all_together`` are still those with these targets: lower bounds.
        """
        remaining: dict[str, Any] = {
            field: {
                name: value for name, value in getattr(self, field).items() if name not in names
            }
            for field in _BY_TARGET
        }
        remaining["entities"] = tuple(name for name in self.entities if name not in names)
        return replace(self, **remaining, fitness=math.fsum(remaining["probability"].values()))

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain Python values, ready for JSON.

        Returns
        -------
        dict
            Field names and values. The pose is a list of lists.
        """
        return to_plain(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> SensorSetting:
        """Build a setting from the result of `to_dict`, or from its JSON.

        Parameters
        ----------
        data : mapping of str to value
            The fields.

        Returns
        -------
        SensorSetting
            Equal to the one written.
        """
        return from_plain(cls, data, PlanFileError)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SensorSetting):
            return NotImplemented
        return self.to_dict() == other.to_dict()

    __hash__ = None  # type: ignore[assignment]


@dataclass(frozen=True)
class SplitValue:
    """How sure a dimension is whose two ends are measured in different settings.

    Attributes
    ----------
    probability : float
        The probability P that the error of the value is at most the permitted one.
    p_all : float
        The probability P_all that both displaced cameras measure their end, and the error of the value is at most
        the permitted one: a lower bound with 99.9 % confidence.
    p_all_poses : int
        Number of displaced poses of each camera.
    standard_uncertainty : float
        u of the value, in its unit.
    """

    probability: Share
    p_all: Share
    p_all_poses: Count
    standard_uncertainty: Amount


@dataclass(frozen=True)
class Foreseen:
    """What `measure` will state of a dimension that a setting measures.

    Attributes
    ----------
    name : str
        The dimension.
    setting : int
        Number of the setting, from 0.
    expanded_uncertainty : float
        U with the state of edges that `measure` assumes or that is stated, mm (angles: degrees). The response of the
        camera is taken for known.
    unseen_uncertainty : float
        U with breaks that images may not show; equal where the state is stated.
    limit_mm : float
        The largest of these breaks, mm; 0 where the state is stated.
    is_open : bool
        Whether it is then open that a part conforms, even if its value is in the middle of its limits.
    """

    name: str
    setting: Count
    expanded_uncertainty: Amount
    unseen_uncertainty: Amount
    limit_mm: Amount
    is_open: bool


# What came of trying to realise a column: a setting, or the reason why there is none.


_NONE = Reason("")


@dataclass(frozen=True)
class Outcome:
    """What a run for a set of entities found.

    Attributes
    ----------
    setting : SensorSetting or None
        The setting; it may miss the required probability for some of the entities.
    reason : Reason
        Why there is none, with its kind; empty if there is one.
    """

    setting: SensorSetting | None = None
    reason: Reason = _NONE

    def reason_at(
        self,
        threshold: float,
        remedy: Callable[[float, float], str] | None = None,
        *,
        is_limited_by_part: bool = False,
    ) -> Reason:
        """Say why an entity is not inspected, given that this is the outcome of its own run.

        Parameters
        ----------
        threshold : float
            Required probability.
        remedy : callable, optional
            Says of the best probability and the required one what would help, such as `PlannedDimension.remedy`.
        is_limited_by_part : bool
            Whether no camera helps against a probability that is too low.
        """
        if self.setting is None:
            return self.reason
        best = max(self.setting.probability.values())
        if best >= threshold:
            return Reason.of(
                ReasonKind.NO_FEASIBLE_VIEW,
                f"the best pose found reaches P {relation_text(best)}, "
                "but violates a constraint when checked again.",
            )
        # so many digits that it is seen to be below
        digits = next((n for n in range(4, 16) if round(best, n) < threshold), 16)
        text = (
            f"the best pose found reaches P = {best:.{digits}f}, below the required {threshold:g}."
        )
        advice = remedy(best, threshold) if remedy else ""
        low = ReasonKind.LIMITED_BY_PART if is_limited_by_part else ReasonKind.PROBABILITY_TOO_LOW
        return Reason.of(low, f"{text} {advice}".strip())
