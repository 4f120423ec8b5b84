"""The thesis's printed equations compared with the right ones."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rimless_gym import THESIS_PHYSICAL, WheelParams
from rimless_gym.equations import equations
from rimless_gym.kernel.integration import smooth_states
from rimless_gym.presets import PRESETS


def single_inertia(params: WheelParams) -> WheelParams:
    """A machine under the printed map with I1 counted once, as in its closed form (3.85-3.87).

    The wheel's mass enters (3.75-3.82) only through Je1, so it is enough to subtract I1 from Je1.
    """
    spare = params.wheel_inertia / params.leg_length**2
    return params.replace(impact_law="thesis", wheel_mass=max(params.wheel_mass - spare, 0.0))


def printed_impact(count: int = 200_000) -> dict[str, Any]:
    """What the printed map (3.82) does, beside the plastic one."""
    rng = np.random.default_rng(0)
    ranges = ((-math.pi, math.pi), (0, 4), (-8, 8))  # of theta (rad), phi' and theta' (rad/s)
    states = [rng.uniform(low, high, count) for low, high in ranges]
    shares = {}
    machines = OF_THE_THESIS | {
        f"THESIS_PHYSICAL, n = {n}": THESIS_PHYSICAL.replace(n_legs=n) for n in (4, 6, 8, 12)
    }
    for name, params in machines.items():
        rate, gain = impact_ratios(params, "thesis", *states)
        _, plastic = impact_ratios(params, "plastic", *states)
        p, once = params.constants, single_inertia(params).constants
        closed = -eq.impact(p.a, p.b, *states, once)[0]
        shares[name] = {
            "creates": float(np.mean(gain > 1)),
            "largest": float(gain.max()),
            "reverses": float(np.mean(rate < 0)),
            "closed_form_reverses": float(np.mean(closed < 0)),
            "plastic_largest": float(plastic.max()),
        }
    typical = []
    for theta in (-0.5, 0.0, 0.5, 1.0, 1.5, math.pi):
        typical.append({"theta": theta})
        for law in ("plastic", "thesis"):
            rate, gain = impact_ratios(THESIS_PHYSICAL, law, theta, 1.0, 0.0)
            typical[-1] |= {f"{law}_rate": float(rate), f"{law}_energy": float(gain)}
        p, q = THESIS_PHYSICAL.constants, single_inertia(THESIS_PHYSICAL).constants
        typical[-1]["closed_form_rate"] = -float(eq.impact(p.a, p.b, theta, 1.0, 0.0, q)[0])
    return {"random": shares, "typical": typical}


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


def reach_and_hub(params: WheelParams) -> list[float]:
    """How far the pendulum reaches below the hub, and the hub's height on two feet (m)."""
    p = params.constants
    hub = float(eq.hub_position(p.a, p)[1])
    return [hub - float(eq.pendulum_clearance(p.a, 0.0, p)), hub]


def orders(count: int = 20) -> dict[str, float]:
    """The integrator's order, from errors with ever shorter steps, on the thesis's machines.

    Dry friction changes within milliseconds where psi' changes its sign. Steps of the lengths here
    would pass over that, and show no order.
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
        table[name] = float(np.polyfit(np.log(sizes[fit]), np.log(errors[fit]), 1)[0])
    return table
