"""Exact entity-based aspect graphs of polyhedral parts.

Names are imported from their modules when they are first used. ``__init__.pyi`` states them.
"""

from ground.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
