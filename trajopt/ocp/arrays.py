"""The types of arrays that the engine passes around."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

#: Numbers.
Array: TypeAlias = NDArray[np.float64]

#: Indices into other arrays.
Indices: TypeAlias = NDArray[np.intp]
