"""Tolerances as a drawing has them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from aspectgraph import ModelRequirements
    from planner.request.edge_state import EdgeState

# Characteristics: one dimension on one feature. Their names, and how many a plan leaves out.
#
# A dimension of a pattern applies to each of its holes. A plan measures each of them, or one per
# pattern if the request says so. A distance may also be asked for at several places along its
# edges.


_NUMBERED = re.compile(r" \[\d+ of \d+( places)?\]( #\d+)?$")


def characteristic_name(dimension: str, k: int, n: int) -> str:
    """Return the name of a dimension on one feature of a pattern.

    Parameters
    ----------
    dimension : str
        Name of the dimension.
    k, n : int
        Number of the feature, from 1, and number of all features.

    Examples
    --------
    >>> from planner.request.words import characteristic_name
    >>> characteristic_name("Linear Size.11", 3, 30)
    'Linear Size.11 [3 of 30]'
    """
    return f"{dimension} [{k} of {n}]"


class LeftOut(str):
    """The reason why a requirement of a model is not planned, with its frame.

    Parameters
    ----------
    reason : str
        The reason.
    frame : iterable of str
        Its kind, value or zone, and datums, as a drawing has them in boxes; empty if it is not known.

    Examples
    --------
    >>> from planner.request.words import LeftOut
    >>> LeftOut("edges do not show it", ["flatness", "0.2"]).frame
    ('flatness', '0.2')
    """

    frame: tuple[str, ...]

    def __new__(cls, reason: str, frame: Iterable[str] = ()) -> LeftOut:
        """Make a reason with a frame."""
        left_out = super().__new__(cls, reason)
        left_out.frame = tuple(frame)
        return left_out


def frame_of(reason: str) -> tuple[str, ...]:
    """Return the frame of what is not planned; empty of a plain reason.

    Parameters
    ----------
    reason : str
        The reason, maybe a `LeftOut`.
    """
    return reason.frame if isinstance(reason, LeftOut) else ()


def place_name(dimension: str, k: int, n: int) -> str:
    """Return the name of a dimension at one of several places along its edges.

    Parameters
    ----------
    dimension : str
        Name of the dimension.
    k, n : int
        Number of the place, from 1, and number of all places.

    Examples
    --------
    >>> from planner.request.words import place_name
    >>> place_name("width", 2, 3)
    'width [2 of 3 places]'
    """
    return f"{dimension} [{k} of {n} places]"


def is_characteristic(name: str) -> bool:
    """Return whether a name is that of a dimension on one feature of a pattern, or at one place.

    Parameters
    ----------
    name : str
        Name of a target.
    """
    return _NUMBERED.search(name) is not None


def n_not_planned(counts: Sequence[int]) -> int:
    """Return how many characteristics a plan leaves out that measures one feature of each dimension.

    Parameters
    ----------
    counts : sequence of int
        Features of each dimension, 1 or more.
    """
    return sum(counts) - len(counts)


def features_text(counts: Sequence[int]) -> str:
    """Say how many characteristics are not planned; nothing if every dimension applies to one.

    Parameters
    ----------
    counts : sequence of int
        Features of each dimension, 1 or more.

    Examples
    --------
    >>> from planner.request.words import features_text
    >>> features_text([1, 6, 30, 4, 30, 1])
    '6 dimensions, 72 characteristics: 66 not planned'
    """
    missing = n_not_planned(counts)
    if not missing:
        return ""
    dimensions = "1 dimension" if len(counts) == 1 else f"{len(counts)} dimensions"
    return f"{dimensions}, {sum(counts)} characteristics: {missing} not planned"


def requirements_text(stated: ModelRequirements) -> str:
    """Say how many requirements a model states, and how many of them edges show.

    Parameters
    ----------
    stated : ModelRequirements
        See `aspectgraph.read_requirements`.

    Examples
    --------
    >>> from aspectgraph import ModelRequirements
    >>> from planner.request.words import requirements_text
    >>> requirements_text(ModelRequirements())
    '0 requirements (0 dimensions, 0 geometric); 0 measurable from edges'
    """
    total = f"{len(stated)} requirement{'' if len(stated) == 1 else 's'}"
    n = len(stated.dimensions)
    sizes = f"{n} dimension{'' if n == 1 else 's'}, {len(stated.tolerances)} geometric"
    return f"{total} ({sizes}); {stated.n_measurable} measurable from edges"


# How pages and tables speak of targets: of edges, of dimensions, and of both in one plan.


@dataclass(frozen=True)
class TargetWords:
    """The words for the targets of one kind, or of a plan.

    ``{share}`` stands for the share of a length that may be wrong, such as ``2 %``.

    Attributes
    ----------
    items : (str, str)
        What tables of the terminal call one target, and several.
    nouns : (str, str)
        The same on a page.
    seen : str
        Entities whose visibility is computed.
    value_head, value : str
        Head of a column of nominal values, and the format of a cell.
    accuracy : str
        What the accuracy of a request means.
    error, found : str
        The largest error that counts as accurate, and what must be found in the image.
    localisation : tuple of str
        What to say besides the models of dimensions.
    simulated : str
        What a simulation does at each displaced pose.
    bold : str
        What edge maps draw in bold.
    requirement_column : bool
        Whether a table needs a column with what is measured: it differs from row to row.
    """

    items: tuple[str, str]
    nouns: tuple[str, str]
    seen: str
    value_head: str
    value: str
    accuracy: str
    error: str
    finding: str
    simulated: str
    bold: str
    localisation: tuple[str, ...] = ()
    requirement_column: bool = True


EDGES = TargetWords(
    items=("entity", "entities"),
    nouns=("edge", "edges"),
    seen="edges",
    value_head="Length (mm)",
    value="{0.nominal:.3f}",
    accuracy="error at most {share} of an edge's image",
    error="{share} of the edge's image length",
    finding="the edge is found",
    simulated="projected the edges, rounded their ends to pixels and measured them. "
    "An end outside the image counts as a failure.",
    bold="measured edges and their ends in bold",
    requirement_column=False,
)
DIMENSIONS = TargetWords(
    items=("dimension", "dimensions"),
    nouns=("dimension", "dimensions"),
    seen="edges, rims and arcs",
    value_head="Nominal",
    value="{0.value_text}",
    accuracy="dimensions without a tolerance: error at most {share} of the nominal value",
    error="the permitted one",
    finding="the target is found",
    simulated="moved the faces by the error of their position, projected points of the entities, "
    "added the error of the localisation model, carried them back to the part with the planned pose, and fitted them. "
    "A point outside the image counts as a failure.",
    bold="measured lines and circles in bold",
)
_ONE_OR_MORE = ("characteristic", "characteristics")
CHARACTERISTICS = replace(DIMENSIONS, items=_ONE_OR_MORE, nouns=_ONE_OR_MORE)
"""Of a plan in which a dimension on several features is a target on each of them."""
MIXED = TargetWords(
    items=("edge or dimension", "edges and dimensions"),
    nouns=("edge or dimension", "edges and dimensions"),
    seen=DIMENSIONS.seen,
    value_head=DIMENSIONS.value_head,
    value=DIMENSIONS.value,
    accuracy=f"{DIMENSIONS.accuracy}; {EDGES.accuracy}",
    error=f"{DIMENSIONS.error} (for an edge, {{share}} of its image length)",
    finding=DIMENSIONS.finding,
    localisation=("of edges, both ends on whole pixels",),
    simulated=f"{DIMENSIONS.simulated} For edges that are not dimensions, it {EDGES.simulated}",
    bold=f"{DIMENSIONS.bold}, edges with their ends",
)


def amount_text(amount: str, unit: str) -> str:
    """Return an amount with its unit, such as "12 mm" or "45°".

    Parameters
    ----------
    amount : str
        The digits.
    unit : str
        Such as "mm" or "deg".
    """
    return f"{amount}°" if unit == "deg" else f"{amount} {unit}"


def deviation_text(deviation: float) -> str:
    """Return a deviation that a tolerance allows, with its sign; 0 has none.

    Parameters
    ----------
    deviation : float
        mm (angles: degrees).
    """
    return f"{deviation:+.4g}" if deviation else "0"


def tolerance_text(tolerance: tuple[float, float]) -> str:
    """Return a tolerance as a drawing has it, such as "±0.05", "0/-0.2" or "at most +0.1".

    Parameters
    ----------
    tolerance : (float, float)
        Lower and upper deviation, mm (angles: degrees).
    """
    lower, upper = tolerance
    if math.isinf(lower):
        return f"at most {deviation_text(upper)}"
    if math.isinf(upper):
        return f"at least {deviation_text(lower)}"
    if lower == -upper:
        return f"±{upper:.4g}"
    return "/".join(deviation_text(limit) for limit in (upper, lower))


_LIMITS = {
    "the uncertain pose of the camera": (
        ("translation", "rotation"),
        "A surer pose is needed, or registered images: --register edges (in Python: "
        "registration=Registration.own_edges()).",
    ),
    "points found in the image": (
        ("localisation", "localisation_floor"),
        "A larger image is needed.",
    ),
    "faces that deviate": (
        ("surfaces",),
        "State a smaller deviation of faces if the part is made better.",
    ),
    "the edges, {edges}": (
        ("edge_state",),
        "State smaller breaks if the part has them.",
    ),
}


def limit_text(budget: Mapping[str, float], edges: EdgeState) -> str:
    """Say what most of the variance of a value comes from, and what to do about it; empty without a variance.

    Parameters
    ----------
    budget : mapping of str to float
        Variance by source, as a `Prediction` has it.
    edges : EdgeState
        How edges are taken to be broken.
    """
    total = sum(budget.values())
    if not 0 < total < math.inf:
        return ""
    shares = {
        cause: sum(budget.get(source, 0.0) for source in sources) / total
        for cause, (sources, _) in _LIMITS.items()
    }
    largest = max(shares, key=shares.__getitem__)
    share = f"{100 * shares[largest]:.0f} %"
    return f"The largest part of the variance ({share}) is by {largest.format(edges=edges)}. {_LIMITS[largest][1]}"
