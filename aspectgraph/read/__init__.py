"""Part files in, a `Solid` in millimetres out.

Every repair is noted in the solid, nothing is guessed: what cannot be read as a closed surface is refused.
"""

from aspectgraph.read.join_faces import Tessellation, assemble
from aspectgraph.read.limits import ReadLimits, SolidChoice
from aspectgraph.read.part_file import read_solid

__all__ = [
    "ReadLimits",
    "SolidChoice",
    "Tessellation",
    "assemble",
    "read_solid",
]
