"""Exact entity-based aspect graphs of polyhedral parts."""
