"""Random machines under random voltages, every step checked; `make fuzz` runs many more of them.

In each step energies balance, all numbers are finite, feet stay above the ground and observations
lie in their space. One row is compared with the single environment to the last bit, and some
intervals are integrated again by the reference simulator.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import operator
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from rimless_gym import (
    Disturbances,
    Pushes,
    RimlessWheelSpeedVectorEnv,
    RimlessWheelVectorEnv,
    SensorNoise,
    simulate,
)
from rimless_gym.energy import ROW, balance
from rimless_gym.envs.arguments import MOST_TICKS
from rimless_gym.envs.layout import MEMORY, MOST_SPEED, NUMBER_NAMES
from rimless_gym.envs.starts import Starts, draw_start, normal_force
from rimless_gym.envs.task import TERM_NAMES, Task
from rimless_gym.equations import DOUBLE, IMPACT_LAWS, LOSSES, MODE_NAMES, equations
from rimless_gym.hybrid import CONTROL_PERIOD, MAX_RATE
from rimless_gym.kernel.attempt import LEAST_PEAK, peak
from rimless_gym.kernel.stepping import MODE, advance, require_steppable
from rimless_gym.params import MOTOR_MOUNTS, WheelParams
from rimless_gym.presets import PRESETS
from rimless_gym.streams import MOST_TURN

EXAMPLES = settings.default.max_examples // 6  # of the profile, see tests/conftest.py
LENGTH = 60  # intervals of a trial
REINTEGRATED = range(7, LENGTH, 13)

RESIDUAL = 1e-7  # of a ledger, relative to the energies in it, on the most violent machines
DIFFERENCE = 1e-8  # from the reference: of angles (rad), of rates relative to size
DIVIDED = 1e-6  # the same, of a long interval from its 10 ms
MOST_TOUCHDOWNS = 10  # in such an interval

#: Ranges, drawn evenly in the logarithm; all but `NEVER_ZERO` are sometimes 0 instead.
WIDE = {
    "wheel_mass": (1e-2, 1e2),
    "wheel_inertia": (1e-5, 1e2),
    "leg_length": (0.02, 20.0),
    "pendulum_mass": (1e-2, 1e2),
    "pendulum_inertia": (1e-5, 1e2),
    "pendulum_length": (1e-3, 10.0),
    "motor_constant": (1e-4, 1.0),
    "gear_ratio": (1.0, 3e3),
    "armature_resistance": (1e-2, 1e2),
    "rotor_inertia": (1e-9, 1e-4),
    "hub_damping": (1e-6, 10.0),
    "hub_friction": (1e-3, 10.0),
    "gear_loss": (1e-3, 0.9),
    "friction_width": (1e-2, 1.0),
    "drag": (1e-4, 10.0),
    "pendulum_drag": (1e-6, 1.0),
    "idle_power": (1e-3, 10.0),
    "gravity": (0.1, 30.0),
    "friction": (1e-2, 10.0),
    "voltage_limit": (0.1, 1e3),
}
NEVER_ZERO = (
    *("leg_length", "gear_ratio", "armature_resistance", "friction_width", "gravity"),
    "voltage_limit",
)
NUMBERS = [name for name in NUMBER_NAMES if name != "failure"]
_eq = equations(np.sin, np.cos, sqrt=np.sqrt)


@dataclasses.dataclass(frozen=True)
class Batch:
    """A vector environment: machines of the rows, and arguments that the single one takes too.

    `options` are those of its first reset, and whether it is the one with commanded speeds.
    """

    machines: tuple[WheelParams, ...]
    mode: AutoresetMode
    settings: dict[str, Any]
    options: dict[str, Any]
    commanded: bool
    seed: int


@st.composite
def machines(draw: st.DrawFn) -> WheelParams:
    """Machines that the environment accepts; half of them are like a preset."""
    fields = draw(st.sampled_from(list(PRESETS.values()))).to_dict()
    like = draw(st.booleans())
    for name, (low, high) in WIDE.items():
        if like and fields[name] != 0.0:
            fields[name] *= math.exp(draw(st.floats(-0.6, 0.6)))
        elif not like or draw(st.integers(0, 9)) < 3:
            fields[name] = math.exp(draw(st.floats(math.log(low), math.log(high))))
        if not like and name not in NEVER_ZERO and draw(st.integers(0, 6)) == 0:
            fields[name] = 0.0
    beyond = draw(st.none() | st.floats(1.0, 3.0))
    fields["pendulum_reach"] = None if beyond is None else beyond * fields["pendulum_length"]
    fields["n_legs"] = draw(st.sampled_from([3, 4, 5, 6, 8, 12, 30, 300]))
    fields["slope"] = draw(st.just(0.0) | st.floats(-0.1, 0.1) | st.floats(-0.7, 0.7))
    fields["motor_mount"] = draw(st.sampled_from(MOTOR_MOUNTS))
    fields["impact_law"] = draw(st.sampled_from(IMPACT_LAWS))
    rng = np.random.default_rng(0)
    try:
        params = WheelParams(**fields)
        require_steppable(params)
        for _ in range(3):
            draw_start(params, rng)
    except (ValueError, RuntimeError):
        assume(False)
    return params


@st.composite
def batches(draw: st.DrawFn) -> Batch:
    """Rows of one machine or several, with or without disturbances and ranges."""
    one, commanded = draw(st.booleans()), draw(st.integers(0, 3)) == 0
    each = [draw(machines()) for _ in range(1 if one else draw(st.integers(2, 3)))]
    rows = [each[i % len(each)] for i in range(draw(st.sampled_from([1, 2, 7, 100])))]
    chosen: dict[str, Any] = {"max_episode_steps": draw(st.integers(5, 2 * LENGTH))}
    chosen["control_period"] = CONTROL_PERIOD * draw(st.just(1) | st.integers(1, MOST_TICKS))
    if draw(st.integers(0, 3)) == 0:
        chosen["actions"] = "current"
    if commanded:
        chosen["speeds"] = (draw(st.floats(0.01, 0.6)), draw(st.floats(0.6, MOST_SPEED)))
    varied: dict[str, Any] = {}  # by an argument, or as an option of the first reset
    if draw(st.booleans()):
        momentum = each[0].total_mass * math.sqrt(each[0].gravity * each[0].leg_length)
        noise = SensorNoise(leg_angle=0.1, pendulum_rate=5.0) if draw(st.booleans()) else None
        varied["disturbances"] = Disturbances(
            pushes=Pushes(rate=10.0, impulse=(0.0, momentum * draw(st.floats(0.01, 0.3)))),
            sensor_noise=noise,
            actuator_delay=(0, draw(st.integers(0, 5))),
            terrain={"slope_std": draw(st.sampled_from([0.0, 0.01, 0.2]))},
        )
    if one and draw(st.booleans()):
        near = {name: getattr(each[0], name) for name in ("wheel_mass", "gravity", "friction")}
        varied["ranges"] = {name: (0.97 * x, 1.03 * x) for name, x in near.items() if x > 0}
        try:
            require_steppable(each[0].replace(wheel_mass=0.97 * each[0].wheel_mass))
        except ValueError:  # ranges of such machines are refused
            assume(False)
    if draw(st.booleans()):
        varied["starts"] = draw(
            st.sampled_from([Starts(1, 0, 0), Starts(0, 1, 0), Starts(1, 1, 1)])
        )
    options = {name: varied.pop(name) for name in list(varied) if draw(st.booleans())}
    mode = draw(st.sampled_from(list(AutoresetMode)))
    return Batch(
        tuple(rows), mode, chosen | varied, options, commanded, draw(st.integers(0, 2**31))
    )


def run(batch: Batch) -> None:
    """Step to the end, or until an episode finds no start; a wrong step is an AssertionError."""
    rng, n = np.random.default_rng(batch.seed), len(batch.machines)
    one = len(set(batch.machines)) == 1
    params = batch.machines[0] if one else list(batch.machines)
    kind = RimlessWheelSpeedVectorEnv if batch.commanded else RimlessWheelVectorEnv
    name = "RimlessWheelSpeed-v0" if batch.commanded else "RimlessWheel-v0"
    envs = kind(n, params, autoreset_mode=batch.mode, **batch.settings)
    single = gym.make(name, **batch.settings | {"params": batch.machines[0]})
    try:
        first, _ = envs.reset(seed=batch.seed, options=batch.options)
        assert np.array_equal(first[0], single.reset(seed=batch.seed, options=batch.options)[0])
        reset_first(batch, envs, single, rng, np.arange(n) == 0)
        step_through(batch, envs, single, rng)
    except RuntimeError as error:
        if "no start found" not in str(error):
            raise
    finally:
        envs.close()


def reset_first(batch: Batch, envs: Any, single: Any, rng: np.random.Generator, mask: Any) -> None:
    """Reset the rows of a mask, the first among them, with options that all of them share."""
    options: dict[str, Any] = {}
    if "ranges" not in batch.settings | batch.options:
        if rng.random() < 0.3:
            options["params"] = batch.machines[rng.integers(len(batch.machines))]
        machines = [options.get("params", machine) for machine in envs.params]
        start = drawn_start(rng, machines[0])
        if start is not None and len({machines[i] for i in np.flatnonzero(mask)}) == 1:
            options |= start
        elif rng.random() < 0.3:
            options["mode"] = "double_stance"
    if rng.random() < 0.3:
        options["task"] = drawn_task(rng, batch.commanded)
    if batch.commanded and rng.random() < 0.3:
        options["speed"] = rng.uniform(0.01, MOST_SPEED)
    observations, _ = envs.reset(options=options | {"reset_mask": mask})
    assert np.array_equal(single.reset(options=options)[0], observations[0])


def drawn_task(rng: np.random.Generator, commanded: bool) -> dict[str, float]:
    """Some fields of a task; a commanded speed leaves no target to choose."""
    names = [field.name for field in dataclasses.fields(Task)]
    chosen = {name: rng.uniform(0.01, 3.0) for name in names if rng.random() < 0.5}
    if commanded:
        chosen.pop("target_speed", None)
    return chosen


def drawn_start(rng: np.random.Generator, params: WheelParams) -> dict[str, Any] | None:
    """Options for a state in which the feet press, at any rates; None if none was found."""
    p, mode = params.constants, int(rng.random() < 0.25)
    fastest = min(3 * math.sqrt(params.gravity / params.leg_length), MAX_RATE)
    for _ in range(64):
        rates = rng.choice([-1, 1], 2) * [fastest, MAX_RATE] * 10 ** rng.uniform(-3, 0, 2)
        theta = rng.uniform(-math.pi, math.pi) + 2 * math.pi * rng.choice([0, 0, -15000, 9000])
        state = [rng.uniform(p.a, p.b), theta, *rates]
        if mode == DOUBLE:
            state[0], state[2] = p.a, 0.0
        if normal_force(params, np.array([*state, mode, 0.0])) > 1e-6 * params.weight:
            return {"state": [float(x) for x in state], "mode": MODE_NAMES[mode]}
    return None


def commands(rng: np.random.Generator, ways: np.ndarray, states: np.ndarray, emf: np.ndarray):
    """Held, white, full, no voltage, noise beyond the limits, and one near the back-EMF."""
    white = rng.uniform(-1, 1, len(ways))
    held = np.sin(np.arange(len(ways)) + 0.01)
    whirling = emf[0] * (states[:, 3] + emf[1] * states[:, 2]) + 0.1 * held
    options = (held, white, np.sign(held + 0.5 * white), 0 * white, 3 * white, whirling)
    return np.choose(ways, options)[:, None].astype(np.float32)


def step_through(batch: Batch, envs: Any, single: Any, rng: np.random.Generator) -> None:
    n, machines = envs.num_envs, envs.params
    emf = np.array([(m.constants.K / m.voltage_limit, m.constants.d1) for m in machines]).T
    ways = rng.integers(0, 6, n)
    begun, ended_alone = np.zeros(n, dtype=bool), False  # rows reset in the place of a step
    for number in range(LENGTH):
        if rng.random() < 0.03:
            command(batch, envs, single, rng)
        ways = np.where(rng.random(n) < 0.04, rng.integers(0, 6, n), ways)
        before = envs.states
        actions = commands(rng, ways, before, emf)
        snapshot = envs.get_state() if number in REINTEGRATED else None
        seen = envs.step(actions)
        if snapshot is not None:
            step_again(envs, snapshot, actions, seen)
        ended = seen[2] | seen[3]
        with np.errstate(invalid="ignore"):
            for trouble, bad in broken(envs, machines, before, ~begun & ~ended, seen):
                rows = np.flatnonzero(bad & ~begun)
                assert rows.size == 0, f"{trouble}: {machines[rows[0]]}, {before[rows[0]]}"
        ended_alone = compare(batch.mode, single, actions[0], seen, ended_alone)
        if not {"ranges", "disturbances", "actions"} & set(batch.settings | batch.options):
            if envs.control.ticks > 1:
                divide(envs, machines, before, actions, ~begun & ~ended, seen)
            if number in REINTEGRATED:
                reintegrate(envs, machines, before, actions, ~begun & ~ended, seen)
        if batch.mode is AutoresetMode.DISABLED and ended.any():
            if ended[0]:
                reset_first(batch, envs, single, rng, ended)
                ended_alone = False
            else:
                envs.reset(options={"reset_mask": ended})
        if ended.any() or begun.any():
            machines = envs.params  # ranges draw others
        begun = ended if batch.mode is AutoresetMode.NEXT_STEP else np.zeros_like(begun)


def command(batch: Batch, envs: Any, single: Any, rng: np.random.Generator) -> None:
    """Change reward and commanded speed of the first row, and of others, within their episodes."""
    mask = rng.random(envs.num_envs) < 0.5
    mask[0] = True
    task = drawn_task(rng, batch.commanded)
    envs.set_task(task, mask)
    single.unwrapped.set_task(task)
    if batch.commanded:
        speed = rng.uniform(0.01, MOST_SPEED)
        envs.set_command(speed, mask)
        single.unwrapped.set_command(speed)


def step_again(envs: Any, snapshot: dict[str, Any], actions: np.ndarray, seen: Any) -> None:
    """From a snapshot the same step gives the same to the bit, and ends in the same state."""
    after = envs.states
    envs.set_state(snapshot)
    again = envs.step(actions)
    for one, other in zip(seen[:4], again[:4], strict=True):
        assert np.array_equal(one, other), "differs after set_state"
    assert np.array_equal(after, envs.states), "differs after set_state"


@functools.lru_cache
def followed(params: WheelParams) -> bool:
    """Whether the kernel's steps are short enough for the highest peaks of the accelerations."""
    with np.errstate(divide="ignore"):
        return bool(peak(params.constants) >= LEAST_PEAK)


def broken(envs, machines, before, running, seen) -> Iterator[tuple[str, Any]]:
    """What breaks each rule, and which rows (N,) do."""
    observations, rewards, _, _, info = seen
    period, after = envs.control.period, envs.states
    p = WheelParams().constants._make(np.stack([m.constants_array for m in machines], axis=1))
    weight, limit = np.array([(m.weight, m.voltage_limit) for m in machines]).T
    stall = limit * p.K * p.G  # torque
    yield "an observation is not finite", ~np.isfinite(observations).all(axis=1)
    outside = np.abs(observations) > envs.single_observation_space.high
    yield "an observation is outside its space", outside.any(axis=1)
    yield "the reward is not finite", ~np.isfinite(rewards)
    terms = functools.reduce(operator.add, (info[name] for name in TERM_NAMES))
    yield "the reward is not the sum of its terms", rewards != terms
    infinite = ("min_normal_force", "friction_demand", "impulse_friction_demand")  # with no force
    for name, values in info.items():
        if not name.startswith(("_", "final")):
            bad = np.isnan(values) if name in infinite else ~np.isfinite(values)
            yield f"{name} is not a finite number", bad
    energies = np.array(balance(info))  # angles are rounded: stall torque counts over a radian
    scale = _eq.kinetic_energy(*before[:, :4].T, p) + (p.S1 + p.S2) * np.hypot(p.gx, p.gy)
    residuals = np.abs(energies.sum(axis=0)) / (scale + stall + np.abs(energies).sum(axis=0))
    unresolved = np.array([not followed(machine) for machine in machines])
    yield "the ledger does not balance", ~(residuals <= RESIDUAL) & ~unresolved
    small = RESIDUAL * (weight * p.L1 + limit**2 * p.G * period + stall)
    for name in (*LOSSES, "shaft", "electrical_positive", "idle"):
        yield f"{name} is negative", info[name] < -small
    dissipates = np.array([machine.impact_law == "plastic" for machine in machines])
    yield "a plastic touchdown creates energy", dissipates & (info["collision"] < -small)
    short = info["electrical_positive"] - np.maximum(info["electrical"], 0.0)
    yield "electrical_positive is less than electrical", short < -small
    late = info["elapsed"] / period - 1
    yield "the interval is too long or too short", (late > 1e-12) | running & (late < -1e-12)
    phi, theta, dphi, dtheta, mode = after[:, :5].T
    rough = envs.get_state()["batch"]["memory"][MEMORY.slope_std, : len(phi)] > 0
    lean = np.where(rough, MOST_TURN * p.alpha, 0.0) + 1e-12
    yield "a foot is below the ground", running & ~(np.maximum(p.a - phi, phi - p.b) <= lean)
    fast = np.maximum(np.abs(dphi), np.abs(dtheta))
    yield "a rate is beyond the model's", running & ~(fast <= MAX_RATE)
    yield "the angle of the pendulum is lost", running & ~np.isfinite(theta)
    moved = (phi != p.a) & ~rough | (dphi != 0.0)
    yield "the wheel moves on two feet", running & (mode == DOUBLE) & moved
    yield "the ground pulls", running & (info["force_y"] < -1e-6 * weight)


def compare(mode: AutoresetMode, single: Any, action: Any, seen: Any, had_ended: bool) -> bool:
    """The single environment does what row 0 does, to the bit; returns whether it has ended."""
    observations, rewards, terminated, truncated, info = seen
    if had_ended and mode is AutoresetMode.NEXT_STEP:  # the row was reset in this step
        assert np.array_equal(single.reset()[0], observations[0])
        return False
    observation, reward, *ends, _ = single.step(action)
    alone = single.unwrapped.measurements
    assert [rewards[0], terminated[0], truncated[0]] == [reward, *ends], "differs from the single's"
    if mode is AutoresetMode.SAME_STEP and any(ends):
        assert np.array_equal(info["final_obs"][0], observation)
        assert np.array_equal(single.reset()[0], observations[0])
        info, ends = info["final_info"], [False]
    else:
        assert np.array_equal(observations[0], observation)
    for name in NUMBERS:
        assert np.array_equal(info[name][0], alone[name], equal_nan=True), f"{name} differs"
    return any(ends)


def divide(envs, machines, before, actions, running, seen) -> None:
    """A row moves in intervals of 10 ms as in one long interval, unless rounding decides events.

    A wheel that rocks from foot to foot multiplies errors of rounding at every touchdown.
    """
    rows = running & [followed(machine) for machine in machines]
    for i in np.flatnonzero(rows)[:1]:
        state, touchdowns = before[i : i + 1].copy(), 0.0
        for _ in range(envs.control.ticks):
            out = advance(machines[i], state, volts(machines[i], actions[i]))[0]
            touchdowns += out[ROW.touchdowns]
            if out[ROW.failure]:
                return
        after = envs.states[i]
        alike = touchdowns == seen[4]["touchdowns"][i] and state[0, MODE] == after[MODE]
        if alike and touchdowns <= MOST_TOUCHDOWNS:
            apart = difference(state[0], before[i], after)
            message = f"{apart} in intervals of 10 ms: {machines[i]}, {before[i]}, {actions[i]}"
            assert apart.max() <= DIVIDED, message


def reintegrate(envs, machines, before, actions, running, seen) -> None:
    """The reference simulator agrees with an interval in single stance without touchdowns."""
    rows = running & (seen[4]["touchdowns"] == 0.0)
    rows &= (before[:, MODE] != DOUBLE) & [followed(machine) for machine in machines]
    for i in np.flatnonzero(rows)[:1]:
        held = np.repeat(volts(machines[i], actions[i]), envs.control.ticks)
        start, end = before[i][:4].copy(), envs.states[i]
        start[1] = math.remainder(start[1], math.tau)  # the reference's errors grow with its angles
        end[1] += start[1] - before[i][1]
        try:
            motion = simulate(machines[i], start, held, envs.control.period, pull=0.0)
        except RuntimeError:  # the reference's motion diverges or chatters
            return
        if motion.events or motion.failure is not None:  # rounding decides what just touches
            return
        apart = difference(motion.x[-1], before[i], end)
        assert apart.max() <= DIFFERENCE, f"{apart} from the reference: {machines[i]}, {before[i]}"


def volts(machine: WheelParams, action: np.ndarray) -> np.ndarray:
    """The voltage (1,) that an action (1,) holds."""
    return machine.voltage_limit * np.clip(action.astype(np.float64), -1.0, 1.0)


def difference(state: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Of two final states: of the angles (rad), of the rates relative to their size."""
    scale = np.maximum(1.0, np.abs([1.0, before[1], *after[2:4]]))
    return np.abs(state[:4] - after[:4]) / scale


@settings(max_examples=EXAMPLES, suppress_health_check=list(HealthCheck))
@given(batches())
def test_every_step_of_random_machines_keeps_the_rules(batch: Batch) -> None:
    run(batch)
