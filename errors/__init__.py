"""Measurement error of dimensions taken from an image: densities and probabilities."""
