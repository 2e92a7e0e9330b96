"""Viewing domains: connected unions of cells from which the same entities are observable, outside the solid.

A cell thinner than the least width neither joins nor parts domains; its volume goes to a neighbour.
"""
