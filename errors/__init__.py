"""Measurement error of dimensions taken from an image: densities and probabilities.

Arrays of numbers in millimetres and radians go in, densities and probabilities come out. `success_probability` is the
one call a planner needs, `SuccessModel` the same for an optimiser that asks often; the laws of the paper's equations
are `AxisQuantization` (1-2), `SegmentQuantization` (3), `displacement_terms` (8-9), `point_displacement` (10-11),
`AxisDisplacement` (12-13), `SegmentDisplacement` (14) and `SegmentError` (15).

Names are imported from their modules when they are first used. ``__init__.pyi`` states them.
"""

from ground.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
