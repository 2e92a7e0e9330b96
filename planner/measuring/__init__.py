"""Measuring: images of a plan's settings in, values with uncertainties and decisions out.

**Guarantee.** Every target has a value with its uncertainty, or the reason why there is none. A value is computed by
the plan's own measurand from points that were found, and every point that was left out has a state that says why. The
same images give the same results.
"""
