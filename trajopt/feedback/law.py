"""What a feedback law is: a voltage for every state."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rimless_gym.checks import real_array
from rimless_gym.hybrid import DOUBLE, SINGLE

Floats: TypeAlias = NDArray[np.float64]

#: (x (N, 4), mode (N,)) -> V (N,): a voltage (V) for each state (phi, theta, phi', theta') and
#: stance mode (`rimless_gym.hybrid.SINGLE` or `DOUBLE`).
Controller: TypeAlias = Callable[[Floats, NDArray[np.int64]], Floats]


def states_and_modes(x: ArrayLike, mode: ArrayLike) -> tuple[Floats, NDArray[np.int64]]:
    """Check what a law is given; returns contiguous states (N, 4) and modes (N,).

    Args:
        x: states, shape (N, 4) or (4,).
        mode: stance modes, shape (N,), or one for all states.

    Raises:
        TypeError: the states or modes are not real numbers.
        ValueError: they have another shape, or a mode is neither SINGLE nor DOUBLE.
    """
    states = np.atleast_2d(real_array("x", x))
    if states.ndim != 2 or states.shape[1] != 4:
        raise ValueError(f"x: has shape {np.shape(x)}; must have shape (4,) or (N, 4)")
    modes = real_array("mode", mode)
    if modes.shape not in ((), (1,), (len(states),)):
        raise ValueError(f"mode: has shape {modes.shape}; must have shape () or ({len(states)},)")
    if not np.isin(modes, (SINGLE, DOUBLE)).all():
        raise ValueError(
            f"mode = {mode!r}: must be {SINGLE} (single stance) or {DOUBLE} (double stance)"
        )
    contiguous = np.ascontiguousarray(states, dtype=np.float64)
    return contiguous, np.broadcast_to(modes.astype(np.int64), len(states))
