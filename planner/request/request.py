"""The request: what is asked, in one frozen value that travels from the public call to the bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from planner.argument_kinds import check_fraction
from planner.camera.camera import Camera
from planner.camera.pose_uncertainty import PoseUncertainty
from planner.request.constraints import Constraints, Requirements
from planner.request.objective import Objective
from planner.request.space import Space
from planner.wanted.models import Means
from planner.wanted.targets import Target, edge_targets

if TYPE_CHECKING:
    from errors.measurands import Localisation
    from planner.wanted.planned import PlannedTarget


@dataclass(frozen=True, eq=False)
class Request:
    """What is asked: which entities are to be measured, by which camera, how accurately and how surely.

    Parameters
    ----------
    space : VisibilityRegions or EntityAspectGraph
        Tells from where which entities are observable.
    names : sequence of str
        What is wanted (k entities); the columns of every result are in this order.
    camera : Camera
        The camera.
    pose_uncertainty : PoseUncertainty
        How far its real pose may be from the planned one.
    accuracy : float
        Required accuracy A in (0, 1).
    probability : float
        Required probability of it, in (0, 1); the search for a single setting does not use it.
    requirements : Requirements
        What is asked of a setting beside that.
    targets : tuple of Target, optional
        What is measured, in the order of the names. Default: the lengths of edges.
    localisation : Localisation, optional
        How well points are found in the image. Default: the paper's, both ends of an edge on whole pixels.
    surfaces_mm : float
        Standard deviation of a face's position along its normal, mm; for dimensions.

    Raises
    ------
    RequestError
        If the accuracy or the probability breaks its rule.
    """

    space: Space
    names: tuple[str, ...]
    camera: Camera
    pose_uncertainty: PoseUncertainty
    accuracy: float = 0.98
    probability: float = 0.9
    requirements: Requirements = field(default_factory=Requirements)
    targets: tuple[Target, ...] = ()
    localisation: Localisation | None = None
    surfaces_mm: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        for name in ("accuracy", "probability"):
            object.__setattr__(self, name, check_fraction(name, getattr(self, name)))
        targets = self.targets or edge_targets(self.space.entities, self.names)
        object.__setattr__(self, "targets", targets)

    def __getstate__(self) -> dict[str, object]:
        """Leave what is computed behind: the constraints' scene cannot cross a process boundary."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    @property
    def ends(self) -> NDArray[np.float64]:
        """Ends of the entities in the part's frame, shape (k, 2, 3), mm."""
        return self.constraints.ends

    @cached_property
    def constraints(self) -> Constraints:
        """The constraints of a setting that inspects all that is wanted."""
        return Constraints(self.space, self.names, self.camera, self.requirements, self.targets)

    @cached_property
    def objective(self) -> Objective:
        """The success probabilities of all that is wanted, and their sum."""
        return self.objective_of("sum", "joint")

    def objective_of(self, kind: str, model: str) -> Objective:
        """Return the objective of another kind or error model, see `Objective`."""
        return Objective(self.targets, replace(self.means, model=model), kind)

    @property
    def means(self) -> Means:
        """What the targets are measured with, and how accurately."""
        return Means(
            self.camera,
            self.pose_uncertainty,
            self.accuracy,
            self.localisation,
            surfaces_mm=self.surfaces_mm,
        )

    def restricted_to(self, names: Sequence[str]) -> Request:
        """Return the same request for some of the entities."""
        by_name = dict(zip(self.names, self.targets, strict=True))
        return replace(self, names=tuple(names), targets=tuple(by_name[name] for name in names))

    def find_target(self, name: str) -> Target:
        """Return the target of this name."""
        return self.targets[self.names.index(name)]

    @cached_property
    def measured(self) -> dict[str, PlannedTarget]:
        """What is measured, by name, as plans keep it and simulation draws it."""
        from planner.wanted.planned import planned

        return {target.name: planned(target, self.means) for target in self.targets}
