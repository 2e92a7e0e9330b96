"""How pages and tables speak of targets: of edges, of dimensions, and of both in one plan."""

from __future__ import annotations

from dataclasses import dataclass, replace


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
    found: str
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
    found="the edge is found",
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
    found="the target is found",
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
    found=DIMENSIONS.found,
    localisation=("of edges, both ends on whole pixels",),
    simulated=f"{DIMENSIONS.simulated} For edges that are not dimensions, it {EDGES.simulated}",
    bold=f"{DIMENSIONS.bold}, edges with their ends",
)
