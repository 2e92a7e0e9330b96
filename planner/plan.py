"""The inspection plan: what was decided, how sure it is, and its file."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.camera.camera import Camera
from planner.camera.pose import PoseUncertainty
from planner.exceptions import PlanFileError
from planner.files import encoded, file_digest, plan_file, read_json, write_text
from planner.plan_file import FORMAT, VERSION
from planner.plan_tables import PlanTables
from planner.request.words import LeftOut, features_text, frame_of
from planner.sensor_setting import (
    Foreseen,
    Reason,
    SensorSetting,
    SplitValue,
    kind_of,
    kinds_record,
    reasons_from,
)

if TYPE_CHECKING:
    from aspectgraph import Solid
    from planner.identity import Made, Request
    from planner.light.light_plan import LightPlan
    from planner.progress import Progress
    from planner.request.models import Means
    from planner.request.targets import PlannedDimension, Target
    from planner.verify.simulate_plan import SimulationResult


_UNITS = {
    "length": "mm",
    "angle": "rad",
    "pose": "camera to world, OpenCV axes (x right, y down, z forward)",
}


@dataclass(frozen=True, eq=False, repr=False)
class InspectionPlan(PlanTables):
    """A plan: sensor settings that together inspect the entities of a part.

    **Guarantee.** A setting inspects each entity with a P_all of at least ``probability``, or
    ``uninspectable`` lists the entity with the reason: no view of it was found. No plan for the
    same request that inspects these entities, or more, has fewer than ``lower_bound`` settings.
    A request can ask for one feature of a pattern only, such as one of its holes. Then
    `n_features_not_planned` counts the others.

    Attributes
    ----------
    request : Request
        The request: the part, the targets as they were found on it, camera, constraints, and
        everything that the plan depends on.
    settings : tuple of SensorSetting
        In the order of the robot's travel.
    lower_bound : int
        Proven lower bound: at least this many settings are needed to inspect the same entities. It
        is 0 if the plan inspects none.
    bound_proof : str
        How the bound was proven, in one sentence.
    whole_bound : int
        Proven lower bound of plans that measure every target in one image, where it is larger than ``lower_bound``;
        otherwise 0. See ``split`` of `InspectionOptions`.
    uninspectable : mapping of str to Reason
        Name of each entity that is not inspected, and the reason. A `Reason` is text that also has
        a ``kind``.
    cell : mapping of str to value
        In plans for a robot cell: its robot, its digest, and ``part2base`` of each fixturing.
    unfinished : bool
        Whether the planning ended early; a longer one may save settings or raise the bound.
    simulation : SimulationResult or None
        Result of the simulation with displaced poses, in a plan that `simulated` returned.
    light : LightPlan or None
        Lamps for the settings. ``dataclasses.replace(plan, light=...)`` attaches another.
    source : mapping of str to value
        How the command line read the part: its ``file``, relative to the plan's, and its options.
    not_planned : mapping of str to str
        What the CAD model requires besides the targets, by name: the reason why the command line did not plan it.
    split : mapping of str to SplitValue
        Dimensions whose two ends different settings measure, see ``SensorSetting.ends``, and how sure each is.
    foreseen : tuple of Foreseen
        The U that `measure` will state of each dimension in each setting, with the lamps and breaks of edges of this
        plan. Without those of lengths, short arcs and dimensions that two settings measure. Empty in older files, and
        where the time limit ended before.
    made : Made or None
        When, by whom and by which program the command line made the plan. Plans that differ only in it are equal.

    Examples
    --------
    >>> from planner import read_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> plan.complete, len(plan.settings), plan.lower_bound
    (True, 1, 1)
    >>> plan.settings[0].entities
    ('e1', 'e4')
    """

    request: Request
    settings: tuple[SensorSetting, ...]
    lower_bound: int
    uninspectable: Mapping[str, str]
    bound_proof: str = ""
    simulation: SimulationResult | None = None
    unfinished: bool = False
    light: LightPlan | None = None
    cell: Mapping[str, Any] = field(default_factory=dict)
    source: Mapping[str, Any] = field(default_factory=dict)
    not_planned: Mapping[str, str] = field(default_factory=dict)
    made: Made | None = None
    split: Mapping[str, SplitValue] = field(default_factory=dict)
    whole_bound: int = 0
    foreseen: tuple[Foreseen, ...] = ()
    # no field: a changed copy is not what the file holds
    _file_digest = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "settings", tuple(self.settings))
        object.__setattr__(self, "uninspectable", _reasons(self.uninspectable))
        for name in ("cell", "source", "not_planned", "split"):
            object.__setattr__(self, name, dict(getattr(self, name)))
        self._check_names()

    @property
    def camera(self) -> Camera:
        """The camera."""
        return self.request.camera

    @property
    def pose_uncertainty(self) -> PoseUncertainty:
        """Uncertainty of the camera's real pose about the planned one."""
        return self.request.pose_uncertainty

    @property
    def accuracy(self) -> float:
        """Required accuracy A: the error of a measured image length may be at most (1 - A) of it."""
        return self.request.accuracy

    @property
    def probability(self) -> float:
        """Required probability that a measurement is accurate."""
        return self.request.probability

    @property
    def seed(self) -> int:
        """Seed that reproduces the plan."""
        return self.request.seed

    @property
    def part(self) -> str:
        """Name of the part."""
        return "" if self.request.part is None else self.request.part.name

    @property
    def workspace(self) -> np.ndarray:
        """Opposite corners of the box the camera may be in, (2, 3) mm."""
        return np.asarray(self.request.workspace, dtype=np.float64)

    @property
    def requirements(self) -> dict[str, float]:
        """Further constraints, by names that end with the unit; see `Requirements`."""
        return self.request.requirements.to_dict()

    @cached_property
    def targets(self) -> dict[str, Target]:
        """The targets by name: lengths of edges, and dimensions."""
        means = self.request.means
        return {target.name: target.measured_with(means) for target in self.request.targets}

    @cached_property
    def entities(self) -> dict[str, np.ndarray]:
        """Two points of every target, far apart: the ends of an edge; (2, 3) mm, in the part's frame."""
        return {name: target.ends for name, target in self.targets.items()}

    @cached_property
    def dimensions(self) -> dict[str, PlannedDimension]:
        """The dimensions among the targets, by name. The others are lengths of edges."""
        from planner.request.targets import PlannedDimension

        return {
            name: target
            for name, target in self.targets.items()
            if isinstance(target, PlannedDimension)
        }

    def _check_names(self) -> None:
        inspected = {name for setting in self.settings for name in setting.entities}
        for name in [*inspected, *self.uninspectable]:
            if name not in self.targets:
                raise PlanFileError(
                    f"targets must hold every name that the plan uses. Got no {name!r}."
                )
        for name in self.targets:
            if (name in inspected) == (name in self.uninspectable):
                where = "both" if name in inspected else "neither"
                raise PlanFileError(
                    f"entity {name!r} must be in a setting or uninspectable. Got {where}."
                )
        ends = self.ends
        for name in {*ends, *self.split}:
            if set(ends.get(name, {})) != {0, 1} or name not in self.split:
                raise PlanFileError(
                    f"both ends of {name!r} must be in settings, and its value in split. Got "
                    f"{len(ends.get(name, {}))} ends."
                )

    @cached_property
    def ends(self) -> dict[str, dict[int, int]]:
        """Of each dimension that is measured in two settings, the index of the setting of each end."""
        ends: dict[str, dict[int, int]] = {}
        for k, setting in enumerate(self.settings):
            for name, entity in setting.ends.items():
                ends.setdefault(name, {})[entity] = k
        return ends

    def __repr__(self) -> str:
        """Return a one-line summary."""
        from errors.checks import probability_text
        from planner.request.targets import words_of

        n = len(self.settings)
        settings = f"{n} setting{'' if n == 1 else 's'} (at least {self.lower_bound} needed)"
        inspected = self.inspected
        worst = (
            f", smallest probability {probability_text(min(inspected.values()))}"
            if inspected
            else ""
        )
        items = words_of(self.targets).items[1]
        shares = f"{len(inspected)} of {len(self.targets)} {items} inspected"
        features = f", {self.features_text}" if self.features_text else ""
        ended = ", planning stopped early" if self.unfinished else ""
        return f"<InspectionPlan of {self.part!r}: {settings}, {shares}{features}{worst}{ended}>"

    @property
    def complete(self) -> bool:
        """Whether the plan inspects every entity and dimension of the request, in the light of the request.

        It is False if a target is ``uninspectable`` or ``unlit``, and if `light_missing`. A request for
        one feature per pattern omits others: see `n_features_not_planned`.
        """
        return not (self.uninspectable or self.unlit or self.light_missing)

    @property
    def n_features(self) -> int:
        """Number of characteristics: one dimension on one feature, such as a hole of a pattern."""
        return sum(dimension.n_features for dimension in self.dimensions.values())

    @property
    def n_features_not_planned(self) -> int:
        """Number of characteristics that a request for one feature per pattern leaves out."""
        return self.n_features - len(self.dimensions)

    @property
    def features_text(self) -> str:
        """Words on the characteristics that are left out; empty if there are none."""
        return features_text([dimension.n_features for dimension in self.dimensions.values()])

    @property
    def light_missing(self) -> bool:
        """Whether light was requested and is not planned, as where the time limit ended before."""
        return bool(self.settings) and self.request.lighting is not None and self.light is None

    @property
    def means(self) -> Means:
        """The camera, its pose uncertainty, the localisation and the required accuracy, as one value."""
        return self.request.means

    @property
    def minimal(self) -> bool:
        """Whether no plan for the same entities is shorter. An empty plan is not minimal."""
        return bool(self.settings) and len(self.settings) == self.lower_bound

    @property
    def gap(self) -> float:
        """Share of the settings, in [0, 1), that the bound does not prove to be needed."""
        return 1.0 - self.lower_bound / len(self.settings) if self.settings else 0.0

    @property
    def n_evolved(self) -> int:
        """Number of settings whose pose comes from the genetic algorithm."""
        return sum(setting.generations > 0 for setting in self.settings)

    @property
    def inspected(self) -> dict[str, float]:
        """Name to the best promise of each target that poses inspect and lamps show, in the order of ``targets``.

        The promise is P_all, or P if that was not counted. Targets in ``unlit`` are not inspected. Without
        planned light, poses alone decide.
        """
        unlit = self.unlit
        return {name: p for name, p in self.promises.items() if name not in unlit}

    @property
    def promises(self) -> dict[str, float]:
        """Name to the best promise of each target that poses inspect, lit or not, as in ``inspected``."""
        best = {
            name: max(
                (s.promise[name] for s in self.settings if name in s.entities), default=math.nan
            )
            for name in self.targets
        }
        best |= {name: value.p_all for name, value in self.split.items()}
        return {name: p for name, p in best.items() if name not in self.uninspectable}

    @property
    def unlit(self) -> tuple[str, ...]:
        """Targets that poses inspect, but that no lamp shows in any setting; none without planned light.

        `plan_inspection` lists them in ``uninspectable``, so only a plan that was given other lamps has some.
        """
        if self.light is None:
            return ()
        lit = {
            name
            for setting, dark in zip(self.settings, self.light.unlit, strict=False)
            for name in setting.entities
            if name not in dark
        }
        # of what two settings measure, both entities must show
        dark: set[str] = set()
        for setting, unlit in zip(self.settings, self.light.unlit, strict=False):
            dark.update(set(setting.ends).intersection(unlit))
        return tuple(name for name in self.promises if name not in lit or name in dark)

    def simulate(
        self,
        n: int = 10_000,
        rng: int = 0,
        progress: Progress | None = None,
        solid: Solid | None = None,
    ) -> SimulationResult:
        """Measure from displaced poses, and count how often the measurement is accurate.

        Parameters
        ----------
        n : int
            Displaced poses per setting.
        rng : int or numpy.random.Generator
            Seed.
        progress : callable, optional
            ``progress(done, total, label)``.
        solid : Solid, optional
            The part. With it, also count the images in which software can find the edges.

        Returns
        -------
        SimulationResult
            Frequency of success and its confidence interval, per setting and entity.
        """
        from planner.verify.simulate_plan import simulate_plan

        return simulate_plan(self, n, rng=rng, progress=progress, solid=solid)

    def simulated(
        self,
        n: int = 10_000,
        rng: int = 0,
        progress: Progress | None = None,
        solid: Solid | None = None,
    ) -> InspectionPlan:
        """Return the same plan with the result of `simulate` attached.

        Parameters
        ----------
        n : int
            Displaced poses per setting.
        rng : int or numpy.random.Generator
            Seed.
        progress : callable, optional
            As `simulate` takes it.
        solid : Solid, optional
            As `simulate` takes it.

        Returns
        -------
        InspectionPlan
            A new plan; this one is not changed.
        """
        return replace(self, simulation=self.simulate(n, rng, progress, solid))

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain Python values, which JSON stores without loss.

        Returns
        -------
        dict
            The content that `write` writes, with format, version and units. Numbers that are not
            finite remain floats.
        """
        from errors.checks import below_one
        from planner.identity import stored_request
        from planner.verify.setting_record import setting_dict

        kinds = kinds_record(self.uninspectable)
        split = {}
        for name, value in self.split.items():
            split[name] = {**asdict(value), "probability": below_one(value.probability)}
        frames = {}
        of_model = {name: list(frame_of(reason)) for name, reason in self.not_planned.items()}
        if any(of_model.values()):
            frames["not_planned_frames"] = {
                name: boxes for name, boxes in of_model.items() if boxes
            }
        foreseen = {}
        if self.foreseen:
            foreseen["foreseen"] = list(map(asdict, self.foreseen))
        return {
            "format": FORMAT,
            "version": VERSION,
            "units": dict(_UNITS),
            **({} if self.made is None else {"made": asdict(self.made)}),
            **stored_request(self.request),
            **({"source": dict(self.source)} if self.source else {}),
            "bound": self.lower_bound,
            "bound_proof": self.bound_proof,
            **({"whole_bound": self.whole_bound} if self.whole_bound else {}),
            **({"cell": dict(self.cell)} if self.cell else {}),
            **({"unfinished": True} if self.unfinished else {}),
            "uninspectable": {name: str(reason) for name, reason in self.uninspectable.items()},
            **({"uninspectable_kinds": kinds} if kinds else {}),
            **(
                {"not_planned": {name: str(reason) for name, reason in self.not_planned.items()}}
                if self.not_planned
                else {}
            ),
            **frames,
            "settings": [setting_dict(self, setting) for setting in self.settings],
            **({"split": split} if split else {}),
            **foreseen,
            **({} if self.light is None else {"light": self.light.to_dict()}),
            # it was requested
            **({"light": None} if self.light_missing else {}),
            "simulation": None if self.simulation is None else self.simulation.to_dict(),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> InspectionPlan:
        """Build a plan from the result of `to_dict`.

        Parameters
        ----------
        data : mapping of str to value
            The fields.

        Returns
        -------
        InspectionPlan
            Equal to the one written.

        Raises
        ------
        PlanFileError
            If the format, the version or a field is missing, wrong or unknown, or fields contradict each other; the
            message names the first such field by its path.
        """
        return _from_json(cls, encoded(data))

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> InspectionPlan:
        """Read a plan; another name of `read_plan`.

        Parameters
        ----------
        path : str or os.PathLike
            The JSON file, or the folder with its ``plan.json``.

        Returns
        -------
        InspectionPlan
            Equal to the plan written.

        Examples
        --------
        >>> from planner import InspectionPlan
        >>> InspectionPlan.read("examples/two_pocket_block_plan.json").complete
        True
        """
        return read_plan(path)

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the plan as JSON. The file appears whole or not at all.

        Parameters
        ----------
        path : str or os.PathLike
            The file, or a folder for its ``plan.json``. An existing file is replaced.

        Returns
        -------
        pathlib.Path
            The file.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        path = plan_file(path)
        write_text(path, self.file_text())
        return path

    def file_text(self) -> str:
        """Return what the plan's file holds.

        Returns
        -------
        str
            JSON.
        """
        return json.dumps(encoded(self.to_dict()), indent=1, allow_nan=False) + "\n"

    @property
    def digest(self) -> str:
        """SHA-256 of the plan's file, 64 hexadecimal digits: of that it was read from, or that `write` would write."""
        return self._file_digest or hashlib.sha256(self.file_text().encode()).hexdigest()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, InspectionPlan):
            return NotImplemented
        # the same request gives the same plan, whenever and by whomever it is made
        return replace(self, made=None).to_dict() == replace(other, made=None).to_dict()

    __hash__ = None  # type: ignore[assignment]


def read_plan(path: str | os.PathLike[str]) -> InspectionPlan:
    """Read a plan written by `InspectionPlan.write`.

    Parameters
    ----------
    path : str or os.PathLike
        The JSON file, or the folder with its ``plan.json``.

    Returns
    -------
    InspectionPlan
        Equal to the plan written.

    Raises
    ------
    PlanFileError
        If the file cannot be read or is not JSON, the version of the plan is not known, or a field
        is wrong. The message names the file, and the line and column or the field.

    Examples
    --------
    >>> from planner import read_plan
    >>> plan = read_plan("examples/two_pocket_block_plan.json")
    >>> plan.part, len(plan.settings), plan.lower_bound, sorted(plan.inspected)
    ('two_pocket_block', 1, 1, ['e1', 'e4'])
    """
    path = plan_file(path)
    data = read_json(path, "plan file")
    try:
        plan = _from_json(InspectionPlan, data)
    except PlanFileError as error:
        raise PlanFileError(f"{path}: {error}") from None
    # an older release, or a person, may have written it otherwise; a pipe can be read only once
    if path.is_file():
        object.__setattr__(plan, "_file_digest", file_digest(path))
    return plan


def _from_json(cls: type[InspectionPlan], data: Any) -> InspectionPlan:
    """Check the values of a plan file and build the plan."""
    from planner.plan_record import PlanFile
    from planner.verify.setting_record import check_settings, own_fields

    record = PlanFile.read(data)
    plan = cls(
        request=record.asked,
        settings=tuple(SensorSetting.from_dict(own_fields(s)) for s in data["settings"]),
        lower_bound=record.bound,
        bound_proof=record.bound_proof,
        uninspectable=reasons_from(record.uninspectable, record.uninspectable_kinds),
        simulation=record.simulation,
        unfinished=record.unfinished,
        light=None if record.light is None else record.light.light,
        cell=data.get("cell") or {},
        source=record.source,
        not_planned={
            name: LeftOut(reason, record.not_planned_frames.get(name, ()))
            for name, reason in record.not_planned.items()
        },
        made=record.made,
        split=record.split,
        whole_bound=record.whole_bound,
        foreseen=record.foreseen,
    )
    check_settings(plan, data["settings"])
    return plan


def _reasons(texts: Mapping[str, str]) -> dict[str, Reason]:
    """Return texts as reasons; plain ones state no kind."""
    return {name: Reason(text, kind_of(text)) for name, text in texts.items()}
