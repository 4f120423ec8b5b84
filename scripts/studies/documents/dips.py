"""Whether the kernel finds a foot that dips below the ground and comes up within an interval."""

from __future__ import annotations

import math

import numpy as np

from rimless_gym.energy import ROW
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import STATE_SIZE, advance
from rimless_gym.presets import PRESETS
from scripts.studies.documents.feet import dip


def missed_dips(count: int) -> dict[str, dict[str, float]]:
    """Control intervals that start near a touchdown, compared with the same in eight parts.

    If the leg turns back twice within an interval, the foot may dip below the ground and come up.

    Args:
        count: intervals of each preset.

    Returns:
        By preset: the number of `intervals` and of `touchdowns`, how many intervals were `unlike`
        the same in parts, and the `deepest` dip of those (m).
    """
    table = {}
    for name, params in PRESETS.items():
        p, rng = params.constants, np.random.default_rng(0)
        start = np.zeros((count, STATE_SIZE))
        start[:, 0] = p.a + 10 ** rng.uniform(-7, -2.5, count)
        start[:, 1] = rng.uniform(-math.pi, math.pi, count)
        start[:, 2] = -(10 ** rng.uniform(-4, -0.3, count)) * rng.choice([1, 1, -1], count)
        start[:, 3] = rng.uniform(-15, 15, count)
        volts, whole, parts = rng.uniform(-20, 20, count), start.copy(), start.copy()
        rows = advance(params, whole, volts, pull=math.inf)
        eighths = [advance(params, parts, volts, CONTROL_PERIOD / 8, math.inf) for _ in range(8)]
        counts = np.sum([eighth[:, ROW.touchdowns] for eighth in eighths], axis=0)
        unlike = np.flatnonzero(
            (np.abs(whole - parts).max(1) > 1e-6) | (rows[:, ROW.touchdowns] != counts)
        )
        depths = [dip(params, start[i, :4].tolist(), volts[i], CONTROL_PERIOD, -1) for i in unlike]
        table[name] = {
            "intervals": count,
            "touchdowns": int(rows[:, ROW.touchdowns].sum()),
            "unlike": len(unlike),
            "deepest": max(depths, default=0.0),
        }
    return table
