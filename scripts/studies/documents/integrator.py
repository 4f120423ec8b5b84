"""The order of the kernel's integrator, measured on smooth motion without events."""

from __future__ import annotations

from typing import Any

import numpy as np

from rimless_gym.kernel.integration import smooth_states
from scripts.studies.documents.machines import OF_THE_THESIS


def convergence(count: int = 20) -> dict[str, dict[str, Any]]:
    """Errors of the integrator with ever shorter steps, and its order, on the thesis's machines.

    Dry friction changes within milliseconds where psi' changes its sign. Steps of the lengths here
    would pass over that, and show no order.

    Args:
        count: starts, over which an error is a root mean square.
    """
    table = {}
    for name, params in OF_THE_THESIS.items():
        rng, squares = np.random.default_rng(3), np.zeros(7)
        duration = 0.01 if name == "PROTOTYPE" else 0.2  # its motor pole is that much faster
        sizes = duration / 2.0 ** np.arange(7)
        for start in rng.uniform([1.2, -2, -2, -6], [1.8, 2, 2, 6], (count, 4)):
            *_, exact = smooth_states(params, tuple(start), 10.0, duration, 512)
            for i in range(7):
                *_, end = smooth_states(params, tuple(start), 10.0, duration, 2**i)
                squares[i] += np.abs(np.subtract(end, exact)).max() ** 2 / count
        errors = np.sqrt(squares)
        fit = (errors > 2e-13) & (errors < 1e-5)
        order = float(np.polyfit(np.log(sizes[fit]), np.log(errors[fit]), 1)[0])
        table[name] = {"h": sizes.tolist(), "error": errors.tolist(), "order": order}
    return table
