"""What is measured of a law about a held gait, each by a function that returns JSON values."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.evaluate import (
    PROTOCOL,
    SHORT_PROTOCOL,
    Protocol,
    bootstrap_interval,
    evaluate,
    interquartile_mean,
)
from agents.rollout import Policy, controller_policy
from rimless_gym.envs.starts import normal_force
from rimless_gym.equations import SINGLE
from rimless_gym.hybrid import CONTROL_PERIOD, push
from rimless_gym.kernel.stepping import STATE_SIZE, hybrid_states
from rimless_gym.params import WheelParams
from rimless_gym.presets import preset
from trajopt import Solution, periodic_gait
from trajopt.feedback import laws
from trajopt.feedback.controller import ContactGuard, SwitchingController
from trajopt.feedback.law import Floats, Law
from trajopt.feedback.transverse import multipliers as multipliers_of

#: The gaits of the study: preset and speed (m/s). Their voltage is held for a control period.
GAITS = {
    f"{name} at {speed:g} m/s": (name, speed)
    for name, speed in (("BUILDABLE", 0.56), ("BUILDABLE", 0.62), ("THESIS_PHYSICAL", 0.57))
}

#: A law whose decision takes longer than this per wheel, in a batch, is measured from fewer starts.
SLOW = 100e-6

#: Between the seeds of two sets of starts.
APART = 1000

#: A wheel must walk again so long after a push, and for so long (s).
RECOVERY, WALK = 5.0, 3.0

#: The largest impulse that is tried, in units of the machine's momentum on the gait.
LARGEST = 4.0

#: Random states have rates from minus to plus so much times the gait's largest. They walk for so
#: long (s), and the last seconds count.
RANDOM_RATES, RANDOM_SECONDS, RANDOM_WINDOW, RANDOM_SEED = 1.5, 20.0, 4.0, 20150503

#: Standard deviations of the sensors' errors: angles (rad) and rates (rad/s).
NOISE = {"leg_angle": 5e-4, "pendulum_angle": 5e-4, "leg_rate": 5e-3, "pendulum_rate": 1e-2}

#: Relative changes of a parameter, and the parameters that are changed, where a machine has them.
CHANGES = (-0.2, 0.2)
PARAMETERS = (
    *("wheel_mass", "wheel_inertia", "leg_length"),
    *("pendulum_mass", "pendulum_inertia", "pendulum_length"),
    *("motor_constant", "gear_ratio", "armature_resistance", "rotor_inertia"),
    *("hub_damping", "hub_friction", "gear_loss", "drag"),
)

#: Wheels of a batch whose decisions are timed, for how long calls are repeated (s), and how often.
BATCH, TIMED_SECONDS, REPEATS = 128, 0.1, 5


@dataclasses.dataclass(frozen=True)
class Sizes:
    """How much is measured."""

    seeds: int = 4  # sets of starts of the full protocol
    starts: int = 128  # in each of them
    few_starts: int = 48  # of the short protocol, for everything that is changed or disturbed
    phases: int = 8  # of the step at which a push comes
    impulses: int = 20  # tried side by side, before the bisection
    bisections: int = 5  # between the largest that was survived and the next
    states: int = 400  # random ones
    shorter: float = 1.0  # divides all times of the full and the short protocol

    def protocol(self, full: bool, **changes: Any) -> Protocol:
        """The full or the short protocol, in this size."""
        p, starts = (PROTOCOL, self.starts) if full else (SHORT_PROTOCOL, self.few_starts)
        times = {name: getattr(p, name) / self.shorter for name in ("duration", "window", "alive")}
        return dataclasses.replace(p, starts=starts, **times, **changes)


FOR_FAST_LAWS = Sizes()
FOR_SLOW_LAWS = Sizes(3, 8, 4, 4, 8, 3, 48)
FOR_A_TRIAL = Sizes(2, 4, 4, 2, 4, 2, 16, shorter=4.0)


class Measurement(NamedTuple):
    """A measure of a law about a gait."""

    gait: str  # its key in `GAITS`
    law: str  # its name
    measure: str  # its key in `MEASURES`
    quick: bool  # whether this is a trial
    folder: Path  # where start-up controllers are stored


@dataclasses.dataclass(frozen=True)
class Subject:
    """A law about a gait, as it is measured."""

    gait: Solution  # the gait
    name: str  # of the law
    folder: Path  # where the start-up controller is stored
    quick: bool  # whether this is a trial

    @property
    def params(self) -> WheelParams:
        """The machine."""
        return self.gait.params

    @cached_property
    def law(self) -> Law:
        """By itself."""
        return laws.holding(self.name, self.gait, self.folder)

    @cached_property
    def policy(self) -> Policy:
        """The law with start-up controller and guard, as the environment takes it."""
        return controller_policy(self.params, laws.design(self.law, self.gait, self.folder))

    @cached_property
    def sizes(self) -> Sizes:
        """How much is measured."""
        if self.quick:
            return FOR_A_TRIAL
        return FOR_SLOW_LAWS if decision(self)["batch"] > SLOW else FOR_FAST_LAWS


@lru_cache(maxsize=32)
def subject_of(gait: str, law: str, folder: Path, quick: bool) -> Subject:
    """A law about a gait; designed and compiled only once in a process."""
    name, speed = GAITS[gait]
    return Subject(periodic_gait(preset(name), speed, hold=CONTROL_PERIOD), law, folder, quick)


def measured(task: Measurement) -> dict[str, Any]:
    """The result of a measurement, or {"error": its text}."""
    try:
        subject = subject_of(task.gait, task.law, task.folder, task.quick)
        return MEASURES[task.measure](subject)
    except (TypeError, ValueError, RuntimeError, ArithmeticError) as error:
        return {"error": f"{type(error).__name__}: {error}"}


def cost(subject: Subject) -> dict[str, Any]:
    """Cost over the optimum, and the share of starts that walk, from several sets of starts.

    Averages are interquartile means over the sets; the first set is the protocol's own.
    """
    walks = [
        evaluate(
            subject.policy,
            subject.params,
            subject.sizes.protocol(full=True, seed=PROTOCOL.seed + APART * k),
        )
        for k in range(subject.sizes.seeds)
    ]
    gaps = [walk.cot / subject.gait.cot - 1 for walk in walks if walk.walking.any()]
    shares = [walk.walking_share for walk in walks]
    demands = [walk.friction_demand for walk in walks if np.isfinite(walk.friction_demand)]
    return {
        "share": interquartile_mean(shares),
        "share_interval": bootstrap_interval(shares),
        "gap": interquartile_mean(gaps) if gaps else None,
        "gap_interval": bootstrap_interval(gaps) if gaps else None,
        "friction_demand": max(demands, default=None),
    }


def multipliers(subject: Subject) -> dict[str, Any]:
    """Those of the law by itself, kept in step with the clock; None for a law without slopes."""
    law = subject.law
    return {"sizes": multipliers_of(law, subject.gait).tolist() if law.smooth else None}


def decision(subject: Subject) -> dict[str, Any]:
    """Seconds per decision on the gait, without start-up controller, by itself and in a batch."""
    switching = SwitchingController(subject.law, lambda x, mode: np.zeros(len(x)))
    controller = ContactGuard(subject.params, switching)
    t = subject.gait.duration * (np.arange(BATCH) + 0.5) / BATCH
    states, modes = subject.gait.state(t), np.full(BATCH, SINGLE)

    def seconds(x: Floats, mode: Any) -> float:
        controller(x, mode)  # may compile
        calls, begin = 0, time.perf_counter()
        while (spent := time.perf_counter() - begin) < TIMED_SECONDS:
            controller(x, mode)
            calls += 1
        return spent / calls

    return {
        "single": min(seconds(states[0], SINGLE) for _ in range(REPEATS)),
        "batch": min(seconds(states, modes) for _ in range(REPEATS)) / BATCH,
    }


def random_states(subject: Subject) -> dict[str, Any]:
    """The share of random states from which the wheel walks at the end."""
    starts, shorter = drawn_states(subject, subject.sizes.states), subject.sizes.shorter
    window = RANDOM_WINDOW / shorter
    protocol = Protocol(duration=RANDOM_SECONDS / shorter, window=window, alive=window)
    walk = evaluate(subject.policy, subject.params, protocol, starts=starts)
    return {"states": len(starts), "share": walk.walking_share}


def drawn_states(subject: Subject, count: int) -> Floats:
    """States (count, STATE_SIZE) in which some voltage presses the foot on the ground.

    Uniform in both angles and both rates, except for those that are left out. They depend on the
    gait only.
    """
    c, rng = subject.params.constants, np.random.default_rng(RANDOM_SEED)
    fastest = RANDOM_RATES * np.abs(subject.law.data.orbit.states[:, 2:4]).max(axis=0)
    high, states = np.array([c.b, np.pi, *fastest]), np.zeros((count, STATE_SIZE))
    low, n = np.array([c.a, -np.pi, *-fastest]), 0
    while n < count:
        states[n, :4] = rng.uniform(low, high)
        n += normal_force(subject.params, states[n], subject.params.voltage_limit) > 0.0
    return states


def disturbed(subject: Subject) -> dict[str, Any]:
    """The shares that walk undisturbed, with noisy sensors, and with a delay of one period."""
    disturbances: dict[str, Mapping[str, Any] | None] = {
        "undisturbed": None,
        "noise": {"sensor_noise": NOISE},
        "delay": {"actuator_delay": 1},
    }
    return {name: _share(subject, subject.params, each) for name, each in disturbances.items()}


def machines(subject: Subject) -> dict[str, Any]:
    """The share that walks for each parameter of the machine, changed by itself; the law stays."""
    return {
        f"{name} {change:+.0%}": _share(subject, params)
        for name, change, params in changed_machines(subject.params)
    }


def changed_machines(params: WheelParams) -> Iterator[tuple[str, float, WheelParams]]:
    """(parameter, relative change, machine). A longer pendulum reaches farther, too."""
    for name in PARAMETERS:
        if getattr(params, name) == 0.0:
            continue
        for change in CHANGES:
            fields = {name: (1 + change) * getattr(params, name)}
            if name == "pendulum_length" and params.pendulum_reach is not None:
                fields["pendulum_reach"] = (1 + change) * params.pendulum_reach
            yield name, change, dataclasses.replace(params, **fields)


def _share(
    subject: Subject, params: WheelParams, disturbances: Mapping[str, Any] | None = None
) -> float:
    protocol = subject.sizes.protocol(full=False)
    return evaluate(subject.policy, params, protocol, disturbances=disturbances).walking_share


def on_the_gait(gait: Solution, count: int) -> Floats:
    """Hybrid states (count, STATE_SIZE), evenly spread over a stride in time."""
    times = gait.duration * (np.arange(count) + 0.5) / count
    return hybrid_states(gait.state(times), SINGLE)


def pushes(subject: Subject) -> dict[str, Any]:
    """The largest impulses (N s) that are survived, at phases of the stride, in both directions.

    Pushes are those of the environment (`rimless_gym.hybrid.push`). At each phase a row of impulses
    is tried; then the first one that is not survived and the one before it are bisected. So all
    smaller ones that were tried are survived, too.
    """
    sizes, gait = subject.sizes, subject.gait
    states, largest = on_the_gait(gait, sizes.phases), LARGEST * gait.params.total_mass * gait.speed
    row = largest * (np.arange(sizes.impulses + 1) / sizes.impulses) ** 2  # finer for small ones
    phases = ((np.arange(sizes.phases) + 0.5) / sizes.phases).tolist()
    results: dict[str, Any] = {"phases": phases, "largest_tried": largest}
    for name, sign in (("backward", -1.0), ("forward", 1.0)):
        tried = sign * np.tile(row, len(states))
        good = survived(subject, np.repeat(states, len(row), axis=0), tried)
        low, high = _bracket(row, good.reshape(len(states), -1))
        for _ in range(sizes.bisections):
            middle = 0.5 * (low + high)
            fine = survived(subject, states, sign * middle)
            low, high = np.where(fine, middle, low), np.where(fine, high, middle)
        results[name] = low.tolist()
    return results


def _bracket(row: Floats, good: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Of rising impulses (m,): the last before the first not survived, and that one.

    `good` (states, m): which are survived, from each state.
    """
    failing = np.where(good.all(axis=1), len(row), good.argmin(axis=1))
    low, high = row[np.maximum(failing - 1, 0)], row[np.minimum(failing, len(row) - 1)]
    return low, high  # both are 0 where not even no push is survived


def survived(subject: Subject, states: Floats, impulses: Floats) -> NDArray[np.bool_]:
    """Which states (n, STATE_SIZE) in single stance walk again after impulses (N s)."""
    params = subject.params
    pushed = pushed_states(params, states, impulses)
    limit = params.voltage_limit
    good = np.array([normal_force(params, state, limit) > 0.0 for state in pushed])
    if good.any():
        protocol = Protocol(duration=RECOVERY + WALK, window=WALK, alive=WALK)
        walk = evaluate(subject.policy, params, protocol, starts=pushed[good])
        good[good] = walk.walking
    return good


def pushed_states(params: WheelParams, states: Floats, impulses: Floats) -> Floats:
    """Hybrid states after impulses (N s) on the hub along the ground."""
    pushed = states.copy()
    for x, impulse in zip(pushed, impulses, strict=True):
        x[2], x[3] = push(*x[:4], impulse, 0.0, params.constants)
    return pushed


TIMING = "decision"

MEASURES: dict[str, Callable[[Subject], dict[str, Any]]] = {
    TIMING: decision,
    "cost": cost,
    "multipliers": multipliers,
    "pushes": pushes,
    "random_states": random_states,
    "disturbed": disturbed,
    "machines": machines,
}
