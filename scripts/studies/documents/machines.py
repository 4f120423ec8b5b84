"""What the presets and similar machines do: impacts, reach, coming to rest."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rimless_gym import THESIS_PHYSICAL, WheelParams, simulate
from rimless_gym.equations import equations
from rimless_gym.presets import PRESETS

eq = equations(np.sin, np.cos, sqrt=np.sqrt)  # of arrays

#: The presets that are the thesis's, which know no losses but the motor's.
OF_THE_THESIS = {name: PRESETS[name] for name in ("THESIS_NOMINAL", "THESIS_PHYSICAL", "PROTOTYPE")}


def impact_ratios(
    params: WheelParams, law: str, theta: Any, dphi: Any, dtheta: Any
) -> tuple[Any, Any]:
    """(phi'+, kinetic energy after / before) of a forward touchdown."""
    p, q = params.constants, params.replace(impact_law=law).constants
    after = eq.impact(p.a, p.b, theta, dphi, dtheta, q)
    energy = eq.kinetic_energy(p.a, theta, *after, p)
    return after[0], energy / eq.kinetic_energy(p.b, theta, dphi, dtheta, p)


def kappa_range(params: WheelParams) -> list[float]:
    """Least and largest phi'+ / phi'- of a plastic touchdown over all pendulum angles."""
    rates = impact_ratios(params, "plastic", np.linspace(-math.pi, math.pi, 100_001), 1.0, 0.0)[0]
    return [float(rates.min()), float(rates.max())]


def kappa_of_few_legs() -> dict[str, dict[str, list[float]]]:
    """`kappa_range` of each preset with fewer legs."""
    return {
        name: {str(n): kappa_range(params.replace(n_legs=n)) for n in (3, 4)}
        for name, params in PRESETS.items()
    }


def reach_and_hub(params: WheelParams) -> list[float]:
    """How far the pendulum reaches below the hub, and the hub's height on two feet (m)."""
    p = params.constants
    hub = float(eq.hub_position(p.a, p)[1])
    return [hub - float(eq.pendulum_clearance(p.a, 0.0, p)), hub]


def coming_to_rest() -> dict[str, Any]:
    """A sequence of ever quicker touchdowns, which ends in double stance."""
    p = THESIS_PHYSICAL.constants
    motion = simulate(THESIS_PHYSICAL, [p.a + 0.05, 0.0, 0.0, 0.0], np.zeros(60), 0.6)
    falls = motion.touchdowns
    return {
        "touchdowns": len(falls),
        "time": [event.time for event in falls],
        "rate": [abs(float(event.before[2])) for event in falls],
        "loss": [event.loss for event in falls],
        "final_mode": motion.final_mode,
    }
