"""Types of arrays, whose users give shapes and units in their docstrings, and the rounding unit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Ints = NDArray[np.int64]
Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]

EPS = float(np.finfo(np.float64).eps)  # distance of 1.0 to the next larger number
