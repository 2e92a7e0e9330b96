"""Targets that two images may measure: each becomes two ends, which are targets of a search.

An end is one of two entities, or a group of the entities of a position (`errors.measurands.end_groups`).

A cover of "all of it, or all ends" is a plain cover of ends, if a pose that measures all of a target counts as one that
measures each of its ends. So the whole is a further witness of each end.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from errors.measurands import End, end_groups
from planner.camera.pose import PoseUncertainty
from planner.request.models import Key, Lifts, OwnEdges, key_of
from planner.request.problem import Problem
from planner.request.reach import TargetSpace, entity_space
from planner.request.targets import END_SHARE, PlannedDimension, Target, can_be_split, end_of

if TYPE_CHECKING:
    from typing import Self

AUTO = "auto"
"""Targets are split where that saves a setting or inspects more."""
NEVER = "never"
"""All entities of a target are in one image."""

_END = " \x1fend"
WHOLE = -1
"""Number of the end of a target that is not split."""


@dataclass(frozen=True)
class SearchedEnd(PlannedDimension):
    """One end of a target in a search: a pose measures it alone, or with the other one as all of the target.

    The permitted error is that of the whole. A witness that is an end has `END_SHARE` of it.
    """

    def choosing(self, k: int, name: str | None = None) -> Self:
        """Return the same end with one of its witnesses.

        Parameters
        ----------
        k : int
            Number of the witness, from 0.
        name : str, optional
            Another name for it.
        """
        chosen = super().choosing(k, name)
        is_end = isinstance(chosen.witness.measurand, End)
        if len(self.witnesses) == 1 or not is_end:
            return chosen
        return replace(chosen, permitted_error=END_SHARE * self.permitted_error)


class Split(NamedTuple):
    """A request in which some targets are ends.

    Attributes
    ----------
    problem : Problem
        The request (e targets).
    owner : array of int (e,)
        Which target of the original request each of them belongs to.
    entity : array of int (e,)
        Number of its end; `WHOLE` of a target that is not split.
    """

    problem: Problem
    owner: NDArray[np.int_]
    entity: NDArray[np.int_]


def end_name(name: str, entity: int) -> str:
    """Return the name of an end of a target in a search."""
    return f"{name}{_END}{entity}"


def target_and_end(name: str) -> tuple[str, int]:
    """Return the name of a target and the number of its end, `WHOLE` of a name that is no end's."""
    target, _, entity = name.partition(_END)
    return target, int(entity) if entity else WHOLE


def split_names(problem: Problem) -> list[str]:
    """Return the names of targets that can be split."""
    return [target.name for target in problem.targets if can_be_split(target)]


def ends_apart(problem: Problem, names: Sequence[str]) -> Split:
    """Return the request of a bound for plans that may split some targets: their ends count one by one.

    Whatever images measure a target, each of its ends is in one of them, and meets the conditions of the proof there.
    """
    problem = problem.restricted_to(names)
    return split_problem(problem, split_names(problem), any_way=True)


def split_problem(
    problem: Problem,
    names: Collection[str],
    also_whole: Collection[str] = (),
    *,
    any_way: bool = False,
) -> Split:
    """Return a request with ends in place of some targets.

    Parameters
    ----------
    problem : Problem
        The request.
    names : collection of str
        Targets that are split.
    also_whole : collection of str
        Those of them that a pose may also measure as a whole.
    any_way : bool
        Whether an end may be of any witness of its target. Default: of the first one.

    Returns
    -------
    Split
        The request, and what its targets are ends of.
    """
    if not names:
        return Split(problem, np.arange(len(problem.names)), np.full(len(problem.names), WHOLE))
    targets: list[Target] = []
    owner = []
    entity = []
    for column, target in enumerate(problem.targets):
        if target.name not in names:
            targets.append(target)
            owner.append(column)
            entity.append(WHOLE)
            continue
        for k in range(2):
            whole = target.name in also_whole
            targets.append(_searched_end(target, k, also_whole=whole, any_way=any_way))
            owner.append(column)
            entity.append(k)
    return Split(
        replace(
            problem,
            space=TargetSpace.of(entity_space(problem.space), targets),
            names=tuple(target.name for target in targets),
            targets=tuple(targets),
            registered=_registered(problem, names),
        ),
        np.array(owner, dtype=np.int_),
        np.array(entity, dtype=np.int_),
    )


def _searched_end(target: Target, entity: int, *, also_whole: bool, any_way: bool) -> Target:
    # both ends must be of one witness
    of_target = target if any_way else target.choosing(0)
    end = replace(end_of(of_target, entity), name=end_name(target.name, entity))
    if not also_whole:
        return end
    assert isinstance(target, PlannedDimension)
    values = {item.name: getattr(target, item.name) for item in fields(PlannedDimension)}
    return SearchedEnd(
        **{
            **values,
            "name": end.name,
            "witnesses": (*target.witnesses, *end.witnesses),
        }
    )


def _registered(problem: Problem, names: Collection[str]) -> OwnEdges | PoseUncertainty | None:
    """Return the registration of a problem with how ends move; an end frees what the whole value frees."""
    own_edges = problem.registered
    if not isinstance(own_edges, OwnEdges):
        return own_edges
    lifts: dict[Key, Lifts] = dict(own_edges.lifts)
    for target in problem.targets:
        if target.name not in names:
            continue
        for witness in target.witnesses:
            whole = own_edges.lifts[key_of(target.name, witness.entities)]
            for group in map(list, end_groups(witness.measurand)):
                names_of_end = [witness.entities[k] for k in group]
                lifts[key_of(target.name, names_of_end)] = Lifts(
                    whole.surfaces[group], whole.motions[group], whole.free
                )
    return replace(own_edges, lifts=lifts)
