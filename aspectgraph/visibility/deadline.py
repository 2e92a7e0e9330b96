"""A time by which a computation ends, whether or not it is complete."""

from __future__ import annotations

import time


class DeadlineError(Exception):
    """The deadline has passed. It never leaves the package."""


def check_deadline(deadline: float) -> None:
    """Raise `DeadlineError` if a time (`time.time`, which other machines share) has passed."""
    if time.time() > deadline:
        raise DeadlineError
