"""Compiling small loops that are called very often."""

from __future__ import annotations

from typing import Any

import numba as nb

# numba's stubs do not know the option
_options: dict[str, Any] = {"cache": True, "_nrt": False}
lean = nb.njit(**_options)
"""Compile a function that allocates nothing, without counting references.

Counting those of a complex's arrays at every call takes longer than the work. Assigning a row of an array allocates.
"""
