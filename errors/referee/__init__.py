"""Referees of the laws: Monte Carlo with exact rotations, and measurement in simulated pixels.

Nothing here uses the densities it judges.
"""
