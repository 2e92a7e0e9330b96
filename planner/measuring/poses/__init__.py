"""Poses of images: planned, given, or estimated from the part's own edges, with what else is estimated."""
