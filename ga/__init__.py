"""A genetic algorithm for bit-string problems."""
