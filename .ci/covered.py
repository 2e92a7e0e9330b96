"""Shares of the lines and of the branches that tests run, each with the least that it should be.

Usage: coverage json --quiet -o - | python .ci/covered.py

The one number that `coverage report` tells, and can fail for, mixes both.
"""

from __future__ import annotations

import json
import sys
from typing import Any

LEAST = {"lines": 95.0, "branches": 90.0}
"""In percent."""


def shares(totals: dict[str, Any]) -> dict[str, float]:
    """Return the percentages of lines and of branches, from the totals of coverage's report."""
    counted = {
        "lines": (totals["covered_lines"], totals["num_statements"]),
        "branches": (totals["covered_branches"], totals["num_branches"]),
    }
    return {what: 100.0 * covered / all_of_them for what, (covered, all_of_them) in counted.items()}


def main(text: str) -> int:
    """Tell both shares; 1 if one is too small."""
    found = shares(json.loads(text)["totals"])
    # cut, not rounded: 94.96 is not 95.0
    print(
        "covered:",
        ", ".join(f"{int(share * 10) / 10:.1f} % of {what}" for what, share in found.items()),
    )
    short = [what for what, share in found.items() if share < LEAST[what]]
    for what in short:
        print(f"covered: at least {LEAST[what]:g} % of {what} must be run.", file=sys.stderr)
    return 1 if short else 0


if __name__ == "__main__":
    sys.exit(main(sys.stdin.read()))
