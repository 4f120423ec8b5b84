"""Other machines, slopes, noisy sensors, delays and a low battery; the law knows of none."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from agents.evaluate import SHORT_PROTOCOL, Protocol, evaluate
from agents.policies import Policy
from rimless_gym.equations import SINGLE
from rimless_gym.kernel.stepping import hybrid_states
from rimless_gym.params import WheelParams
from scripts.studies.feedback_laws.sizes import Sizes
from scripts.studies.feedback_laws.subject import Walker
from trajopt.feedback.law import Floats
from trajopt.gaits.solution import Solution

#: Relative changes of a parameter.
CHANGES = (-0.2, 0.2)

#: The parameters that are changed, where a machine has them.
PARAMETERS = (
    *("wheel_mass", "wheel_inertia", "leg_length"),
    *("pendulum_mass", "pendulum_inertia", "pendulum_length"),
    *("motor_constant", "gear_ratio", "armature_resistance", "rotor_inertia"),
    *("hub_damping", "hub_friction", "gear_loss", "drag"),
)

#: Standard deviations of the sensors' errors: angles (rad) and rates (rad/s); and the multiples.
NOISE = {"leg_angle": 5e-4, "pendulum_angle": 5e-4, "leg_rate": 5e-3, "pendulum_rate": 1e-2}
TIMES = (1, 2, 4)

#: Delays (control periods of 10 ms).
DELAYS = (1, 2)

#: What is left of the voltage.
SAG = 0.7

#: The steepest slope (deg), and for how long it must be walked and is judged at the end (s).
STEEPEST, SLOPE_SECONDS, JUDGED = 5.0, 15.0, 5.0


def short_protocol(sizes: Sizes) -> Protocol:
    """The protocol of everything that takes many evaluations."""
    p = SHORT_PROTOCOL
    return dataclasses.replace(
        p,
        starts=sizes.few_starts,
        duration=p.duration / sizes.shorter,
        window=p.window / sizes.shorter,
        alive=p.alive / sizes.shorter,
    )


def machines(walker: Walker, sizes: Sizes) -> dict[str, Any]:
    """Each parameter of the machine, changed by itself."""
    protocol = short_protocol(sizes)
    found: dict[str, Any] = {}
    for name, change, params in changed_machines(walker.params):
        found.setdefault(name, {})[f"{change:+.0%}"] = _walk(walker.policy, params, protocol)
    return {"starts": protocol.starts, "parameters": found}


def changed_machines(params: WheelParams) -> Iterator[tuple[str, float, WheelParams]]:
    """(parameter, relative change, machine). A longer pendulum reaches farther, too."""
    for name in PARAMETERS:
        if getattr(params, name) == 0.0:
            continue
        for change in CHANGES:
            fields = {name: (1 + change) * getattr(params, name)}
            if name == "pendulum_length" and params.pendulum_reach is not None:
                fields["pendulum_reach"] = (1 + change) * params.pendulum_reach
            yield name, change, params.replace(**fields)


def nuisances(walker: Walker, sizes: Sizes) -> dict[str, Any]:
    """Noise, delay, and a battery whose voltage sags."""
    protocol, params, policy = short_protocol(sizes), walker.params, walker.policy
    found = {"undisturbed": _walk(policy, params, protocol)}
    for times in TIMES:
        noise = {name: times * deviation for name, deviation in NOISE.items()}
        found[f"noise x {times}"] = _walk(policy, params, protocol, {"sensor_noise": noise})
    for delay in DELAYS:
        found[f"delay {delay}"] = _walk(policy, params, protocol, {"actuator_delay": delay})
    low = params.replace(voltage_limit=SAG * params.voltage_limit)
    found["sag"] = _walk(policy, low, protocol)
    found["limit"] = _walk(_compensated(policy), low, protocol)
    return {"starts": protocol.starts, "figures": found}


def _compensated(policy: Policy) -> Policy:
    """The volts that the law asks for, up to a limit of `SAG`: the driver measures its supply."""

    def compensated(states: Floats, observations: Any) -> Floats:
        return np.clip(policy(states, observations) / SAG, -1.0, 1.0)

    return compensated


def slopes(walker: Walker, sizes: Sizes) -> dict[str, Any]:
    """The slopes around level ground on which every start on the gait walks on."""
    step, seconds = sizes.slope_step, SLOPE_SECONDS / sizes.shorter
    window = JUDGED / sizes.shorter
    protocol = Protocol(duration=seconds, window=window, alive=window)
    starts = on_the_gait(walker.gait, sizes.slope_starts)
    level = _walk(walker.policy, walker.params, protocol, starts=starts)
    found: dict[str, Any] = {}
    tried = {"0": level}
    for side, sign in (("up", -1.0), ("down", 1.0)):
        found[side] = 0.0 if level["share"] == 1.0 else None
        for k in range(1, round(STEEPEST / step) + 1):
            if found[side] is None or found[side] < (k - 1) * step:
                break
            params = walker.params.replace(slope=math.radians(sign * k * step))
            walk = _walk(walker.policy, params, protocol, starts=starts)
            tried[f"{sign * k * step:g}"] = walk
            if walk["share"] == 1.0:
                found[side] = k * step
    return {"starts": len(starts), "step": step, "tried": tried, **found}


def on_the_gait(gait: Solution, count: int) -> Floats:
    """Hybrid states (count, STATE_SIZE), evenly spread over a stride in time."""
    times = gait.duration * (np.arange(count) + 0.5) / count
    return hybrid_states(gait.state(times), SINGLE)


def _walk(
    policy: Policy,
    params: WheelParams,
    protocol: Protocol,
    disturbances: Mapping[str, Any] | None = None,
    starts: Floats | None = None,
) -> dict[str, Any]:
    walk = evaluate(policy, params, protocol, disturbances=disturbances, starts=starts)
    some = bool(walk.walking.any())
    return {
        "share": walk.walking_share,
        "cot": walk.cot if some else None,
        "speed": walk.speed if some else None,
        "faults": walk.failures,
    }
