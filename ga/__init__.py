"""A genetic algorithm for bit-string problems.

`maximize` runs the algorithm; `Chromosome` reads and writes numbers as genes, in plain binary or Gray code. The
operators are functions of whole populations, in `ga.bits`.

Reference: C. C. Yang and F. W. Ciarallo, "Optimized sensor placement for active visual inspection", Journal of
Robotic Systems 18(1), 1-15, 2001, section 4.

Names are imported from their modules when they are first used. ``__init__.pyi`` states them.
"""

from ground.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
