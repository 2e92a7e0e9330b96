"""Viewing domains: connected unions of cells from which the same entities are observable, outside the solid.

A cell thinner than the least width neither joins nor parts domains; its volume goes to a neighbour.
"""

from aspectgraph.domains.carve import carve, is_inside, surface_facets
from aspectgraph.domains.find_domains import Domain, Domains, Ruler, find_domains, largest_extent

__all__ = [
    "Domain",
    "Domains",
    "Ruler",
    "carve",
    "find_domains",
    "is_inside",
    "largest_extent",
    "surface_facets",
]
