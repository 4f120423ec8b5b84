"""The type of a feedback law."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]

#: (x (N, 4), mode (N,)) -> V (N,): a voltage (V) for each state (phi, theta, phi', theta') and
#: stance mode (`rimless_gym.hybrid.SINGLE` or `DOUBLE`).
Controller: TypeAlias = Callable[[Floats, NDArray[np.int64]], Floats]
