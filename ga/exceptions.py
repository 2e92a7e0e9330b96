"""What can go wrong in a run, each also a builtin so that callers need not know these names."""


class GAError(Exception):
    """Base of every error this package raises on purpose."""


class ParameterError(GAError, ValueError):
    """A parameter breaks its rule; the message names parameter, rule and value."""


class FitnessError(GAError, ValueError):
    """The fitness or feasibility function returned something that cannot be used."""


class InfeasiblePopulationError(GAError, ValueError):
    """No complete initial population of feasible individuals could be had."""
