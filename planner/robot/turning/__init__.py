"""Turntables: the part turns about an axis, by angles that are further branches of a pose."""
