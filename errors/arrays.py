"""Names of the array types that the laws of errors use."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]

# A field that takes what is array-like and holds an array of float64 once it is built: no annotation says both.
ArrayField: TypeAlias = Any
