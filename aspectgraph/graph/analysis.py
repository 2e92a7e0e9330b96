"""What an aspect graph says of its part: the domains that see most, how stable lists are, ways between domains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import networkx as nx
import numpy as np

from aspectgraph.exceptions import EntityError
from aspectgraph.graph.aspect_graph import EntityAspectGraph


@dataclass(frozen=True)
class ListOfEntities:
    """All domains with the same list of observable entities.

    Attributes
    ----------
    observable : tuple of str
        The list.
    volume : float
        Total volume of these domains inside the workspace, mm³.
    share : float
        Share of the volume of all domains. It is the probability that a random viewpoint has this
        list.
    domains : tuple of int
        Their numbers, largest first.
    clearance : float
        Radius of the largest ball found in one of their cells, mm. A camera at its centre may move
        by this distance.
    """

    observable: tuple[str, ...]
    volume: float
    share: float
    domains: tuple[int, ...]
    clearance: float


@dataclass(frozen=True)
class Crossing:
    """A step from one viewing domain to the next.

    Attributes
    ----------
    domain : int
        The domain that the step enters.
    appear, vanish : tuple of str
        Entities that become observable, and those that cease to be.
    """

    domain: int
    appear: tuple[str, ...]
    vanish: tuple[str, ...]


def stability(eag: EntityAspectGraph | nx.Graph) -> list[ListOfEntities]:
    """Group the domains of an aspect graph by their lists, the list of the largest volume first.

    Parameters
    ----------
    eag : EntityAspectGraph or networkx.Graph
        From `build_aspect_graph` or `read_graphml`.

    Returns
    -------
    list of ListOfEntities
        The volumes depend on the workspace where domains reach its boundary.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import build_aspect_graph, stability
    >>> eag = build_aspect_graph(box, {"top": 1, "side": 2})
    >>> sorted(group.observable for group in stability(eag))
    [(), ('side',), ('top',), ('top', 'side')]
    """
    nodes = _graph(eag).nodes
    total = sum(volume for _, volume in nodes(data="volume"))
    groups: dict[tuple[str, ...], list[int]] = {}
    for node, names in nodes(data="observable"):
        groups.setdefault(tuple(names), []).append(node)
    lists = []
    for names, members in groups.items():
        volume = sum(nodes[node]["volume"] for node in members)
        ordered = tuple(sorted(members, key=lambda node: (-nodes[node]["volume"], node)))
        clearance = max(nodes[node]["clearance"] for node in members)
        lists.append(ListOfEntities(names, volume, volume / total, ordered, clearance))
    return sorted(lists, key=lambda group: (-group.volume, group.domains))


def richest_domains(eag: EntityAspectGraph | nx.Graph, n: int | None = None) -> list[int]:
    """Return the domains from which most entities are observable, in this order.

    Parameters
    ----------
    eag : EntityAspectGraph or networkx.Graph
        From `build_aspect_graph` or `read_graphml`.
    n : int, optional
        Largest number of domains. Default: all.

    Returns
    -------
    list of int
        Numbers of nodes. Among equals, those with larger ``clearance``, then ``volume``, come
        first.

    Raises
    ------
    EntityError
        If `n` is not a positive whole number.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import build_aspect_graph, richest_domains
    >>> eag = build_aspect_graph(box, {"top": 1, "side": 2})
    >>> eag.graph.nodes[richest_domains(eag, 1)[0]]["observable"]
    ('top', 'side')
    """
    if n is not None and (isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 1):
        raise EntityError.of_rule("n", "must be a positive whole number", repr(n))
    nodes = _graph(eag).nodes

    def key(node: int) -> tuple[Any, ...]:
        record = nodes[node]
        return -len(record["observable"]), -record["clearance"], -record["volume"], node

    return sorted(nodes, key=key)[:n]


def domain_path(eag: EntityAspectGraph | nx.Graph, start: int, goal: int) -> list[Crossing]:
    """Return a path between two domains that crosses the fewest partition surfaces.

    Of several such paths, it is one with the smallest total distance between viewpoints.

    Parameters
    ----------
    eag : EntityAspectGraph or networkx.Graph
        From `build_aspect_graph` or `read_graphml`.
    start, goal : int
        Numbers of nodes.

    Returns
    -------
    list of Crossing
        One for each domain after `start`; the last is `goal`. Domains are connected, but a straight line between their
        viewpoints may leave them, or pass through the part.

    Raises
    ------
    EntityError
        If there is no such domain, or no path between the two.

    Examples
    --------
    >>> from itertools import product
    >>> from aspectgraph import Solid
    >>> faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    >>> box = Solid(list(product((0, 40), (0, 30), (0, 20))), faces, name="box")
    >>> from aspectgraph import build_aspect_graph, domain_path, richest_domains
    >>> eag = build_aspect_graph(box, {"top": 1, "side": 2})
    >>> best, *_, worst = richest_domains(eag)
    >>> way = domain_path(eag, best, worst)
    >>> sorted(name for crossing in way for name in crossing.vanish)
    ['side', 'top']
    """
    graph = _graph(eag)
    for name, node in (("start", start), ("goal", goal)):
        if node not in graph:
            raise EntityError.of_rule(
                name, f"must be a domain of the graph, 0 to {len(graph) - 1}", repr(node)
            )
    place = {node: np.array(point) for node, point in graph.nodes(data="viewpoint")}
    # a crossing weighs more than every way together is long, so that crossings decide first
    crossing = 1.0 + len(place) * float(np.linalg.norm(np.ptp(list(place.values()), axis=0)))

    def weight(i: int, j: int, _: Any) -> float:
        return crossing + float(np.linalg.norm(place[i] - place[j]))

    try:
        way: Sequence[int] = nx.dijkstra_path(graph, start, goal, weight)
    except nx.NetworkXNoPath:
        raise EntityError(
            f"start and goal must be connected by domains. Got {start} and {goal}."
        ) from None
    lists = [graph.nodes[node]["observable"] for node in way]
    return [
        Crossing(node, tuple(n for n in new if n not in old), tuple(n for n in old if n not in new))
        for node, old, new in zip(way[1:], lists, lists[1:], strict=False)
    ]


def _graph(eag: EntityAspectGraph | nx.Graph) -> nx.Graph:
    return eag.graph if isinstance(eag, EntityAspectGraph) else eag
