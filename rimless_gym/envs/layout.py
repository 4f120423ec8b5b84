"""The arrays of many wheels: where everything is, by name; and the observations and `info` in them.

Every array is field-major, (fields, rows): a quantity's values over the rows lie side by side, so
that loops over rows vectorise. ``memory[MEMORY.voltage, i]`` is one number; the `*_of` functions
read several of them as a named tuple.
"""

from __future__ import annotations

import dataclasses
import math
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rimless_gym.energy import Row
from rimless_gym.envs.task import TERM_NAMES, Task
from rimless_gym.equations import places, record
from rimless_gym.hybrid import MAX_RATE, OK
from rimless_gym.jit import cached, inner, written
from rimless_gym.kernel.stepping import DPHI, DTHETA, MODE, PHI, STATE_SIZE, THETA, HybridState
from rimless_gym.params import Constants, WheelParams
from rimless_gym.streams import Ground
from rimless_gym.trigonometry import cos, sin


class TaskParams(NamedTuple):
    """What the task needs to know of the machine."""

    voltage_limit: Any  # V
    idle_power: Any  # W
    friction: Any  # friction coefficient of the ground
    weight: Any  # N
    slope: Any  # rad
    leg_scale: Any  # scale of the observed leg angle, 2 / alpha (1/rad)
    allowance_limit: Any  # most travel that may be rewarded at once, a step length (m); see `Task`


Weights = record("Weights", [field.name for field in dataclasses.fields(Task)], __name__)

#: What is remembered of each row from step to step: the hybrid state and its ground; the voltage
#: held over the interval (V) and the last action; time (s) and intervals since the episode began;
#: the delay from action to voltage (intervals); machine and task; the travel that may still be
#: rewarded (m); and, for a push before the interval, its work (J) and the number of legs by which
#: it moved the stance foot.
Memory = record(
    "Memory",
    [
        *HybridState._fields,
        *Ground._fields,  # next to the state, where the kernel reads it
        *("voltage", "action", "time", "count", "delay"),
        *TaskParams._fields,
        *Weights._fields,
        *("allowance", "push_work", "push_shift"),
    ],
    __name__,
)
MEMORY = places(Memory)

#: The rows of the weights in a memory.
WEIGHTS = slice(MEMORY.distance_weight, MEMORY.distance_weight + len(Weights._fields))

#: The results of an interval: the kernel's rows, the energies that the environment adds, the travel
#: that is rewarded, the rewards, and a last row whose bytes are laid out by `FLAG`.
Results = record(
    "Results",
    [*Row._fields, "idle", "push", "rewarded_travel", *TERM_NAMES, "reward", "flags"],
    __name__,
)
RESULT = places(Results)


class Flags(NamedTuple):
    """Truth values and codes of one byte each, in the 8 bytes of a number; see `flags_of`."""

    terminated: Any
    truncated: Any
    slips: Any
    mode: Any
    failure: Any


FLAG = Flags(*range(len(Flags._fields)))
FLAGS_SIZE = 8  # bytes

#: An interval as the terms of the reward see it: `failed` is 1 where the episode ended early.
Interval = record("Interval", [*Row._fields, "idle", "push", "rewarded_travel", "failed"], __name__)


def columns(n: int) -> int:
    """Number of columns of an array for n rows of an environment; those beyond n are unused.

    Without them, rows of an array could be a large power of two apart and evict each other from
    the cache.
    """
    return n if n <= 64 else 8 * (n // 8 + 2)


def flags_of(results: NDArray[np.float64]) -> NDArray[np.int8]:
    """The flags in results, (FLAGS_SIZE, N); a view."""
    return results[RESULT.flags].view(np.int8).reshape(FLAGS_SIZE, -1)


def reader(kind: type[Any], first: int) -> Any:
    """Compiled: (array, i) -> the numbers of column i from row `first` on, as a named tuple."""
    numbers = ", ".join(f"array[{first + k}, i]" for k in range(len(kind._fields)))
    return inner(
        written(f"def {kind.__name__}_of(array, i):\n    return kind({numbers})", kind=kind)
    )


def writer(kind: type[Any], first: int) -> Any:
    """Compiled: (array, i, values) sets the numbers that the matching `reader` reads."""
    numbers = "".join(f"array[{first + k}, i], " for k in range(len(kind._fields)))
    return inner(written(f"def set_{kind.__name__}(array, i, values):\n    {numbers} = values"))


constants_of = reader(Constants, 0)  # of (N_CONSTANTS, N)
task_params_of = reader(TaskParams, getattr(MEMORY, TaskParams._fields[0]))
weights_of = reader(Weights, WEIGHTS.start)
set_task_params = writer(TaskParams, getattr(MEMORY, TaskParams._fields[0]))


@inner
def params_at(constants, i):
    """The constants of row i, whether it has its own machine or all rows share one."""
    return constants_of(constants, i if constants.shape[1] > 1 else i - i)  # 0 of i's own type


_numbers = ", ".join(f"results[{k}, i]" for k in range(len(Interval._fields) - 1))
#: Compiled: (results, i) -> the `Interval` of row i.
interval_of = inner(
    written(
        f"def interval_of(results, i):\n"
        f"    failed = 1.0 if results[{RESULT.failure}, i] != {OK} else 0.0\n"
        f"    return Interval({_numbers}, failed)",
        Interval=Interval,
    )
)


# Observations

#: Observations are (phi - pi/2) / (alpha/2), sin theta, cos theta, phi' / LEG_RATE_SCALE,
#: theta' / PENDULUM_RATE_SCALE (rad/s), and 1 while resting on two feet.
LEG_RATE_SCALE, PENDULUM_RATE_SCALE = 5.0, 10.0
OBSERVATION_SIZE = 6
OBSERVATION_BOUND = np.array(
    [1, 1, 1, MAX_RATE / LEG_RATE_SCALE, MAX_RATE / PENDULUM_RATE_SCALE, 1], dtype=np.float32
)

#: With a commanded speed, two numbers follow: (speed - MIDDLE_SPEED) / SPEED_SCALE (m/s), and the
#: allowance in units of its limit; see `rimless_gym.envs.task.Task`.
MIDDLE_SPEED, SPEED_SCALE = 0.45, 0.2
COMMANDED_SIZE = OBSERVATION_SIZE + 2
MOST_SPEED = 2.0  # m/s, that may be commanded
COMMANDED_BOUND = np.append(
    OBSERVATION_BOUND, np.array([(MOST_SPEED - MIDDLE_SPEED) / SPEED_SCALE, 1], dtype=np.float32)
)


def commanded_speeds(observations: NDArray[np.float32]) -> NDArray[np.float64]:
    """The commanded speeds (m/s) in observations (..., 8)."""
    observed = observations[..., OBSERVATION_SIZE].astype(np.float64)
    return np.asarray(MIDDLE_SPEED + SPEED_SCALE * observed)


#: Sensor errors of phi, theta, phi', theta' without noise.
NO_ERRORS = (0.0, 0.0, 0.0, 0.0)

_PLAIN = np.uint64(OBSERVATION_SIZE)


@inner
def observation(phi, theta, dphi, dtheta, mode, leg_scale):
    """The observation's six numbers; `leg_scale` is 2 / alpha."""
    return (
        _within((phi - math.pi / 2) * leg_scale, 1.0),
        sin(theta),
        cos(theta),
        _within(dphi / LEG_RATE_SCALE, MAX_RATE / LEG_RATE_SCALE),
        _within(dtheta / PENDULUM_RATE_SCALE, MAX_RATE / PENDULUM_RATE_SCALE),
        mode,
    )


@inner
def observed_command(speed, allowance, limit):
    """The two numbers that follow where a speed (m/s) is commanded."""
    return (speed - MIDDLE_SPEED) / SPEED_SCALE, allowance / limit


@inner
def _within(value, bound):
    return min(max(value, -bound), bound)


@inner
def observe_row(memory, errors, observations, width, i):
    """Write the observation of row i; `observations` is flat, `width` (uint64) numbers per row.

    With a width of COMMANDED_SIZE, the command is observed too, and always exactly.
    """
    values = observation(
        memory[MEMORY.phi, i] + errors[0],
        memory[MEMORY.theta, i] + errors[1],
        memory[MEMORY.dphi, i] + errors[2],
        memory[MEMORY.dtheta, i] + errors[3],
        memory[MEMORY.mode, i],
        memory[MEMORY.leg_scale, i],
    )
    for k in range(OBSERVATION_SIZE):
        observations[i * width + np.uint64(k)] = values[k]
    if width > _PLAIN:
        command, allowance = observed_command(
            memory[MEMORY.target_speed, i],
            memory[MEMORY.allowance, i],
            memory[MEMORY.allowance_limit, i],
        )
        observations[i * width + _PLAIN] = command
        observations[i * width + _PLAIN + np.uint64(1)] = allowance


def observe(params: WheelParams, states: NDArray[np.float64]) -> NDArray[np.float32]:
    """Observations of hybrid states (..., STATE_SIZE): a new float32 array (..., 6)."""
    observations = np.empty((*states.shape[:-1], OBSERVATION_SIZE), dtype=np.float32)
    _observe(
        states.reshape(-1, STATE_SIZE),
        2 / params.leg_angle,
        observations.reshape(-1, OBSERVATION_SIZE),
    )
    return observations


@cached()
def _observe(states, leg_scale, observations):
    for x, seen in zip(states, observations):  # noqa: B905  numba knows no strict
        values = observation(x[PHI], x[THETA], x[DPHI], x[DTHETA], x[MODE], leg_scale)
        for i in range(OBSERVATION_SIZE):
            seen[i] = values[i]


# Measurements and info. Each entry has the same type in every step and reset, so that programs that
# collect episodes can make arrays of them.

#: Names of the numbers that are measured in a step, in the order of `Results`.
NUMBER_NAMES = Results._fields[: RESULT.reward]

#: The entries of the single environment's `info`: few, since each takes time in every step.
INFO_NAMES = ("distance", "electrical_positive", "idle", *TERM_NAMES, "mode", "failure")

_CODES = "2x?2b"  # the flags `slips`, `mode` and `failure`
_ALL = struct.Struct(f"{RESULT.flags}d{_CODES}")
_FEW = struct.Struct(
    "".join("d" if name in (*INFO_NAMES[:-1], "reward") else "8x" for name in Results._fields[:-1])
    + _CODES.replace("?", "x")
)

#: What `step` returns, from the bytes of one row's results, its observation, and whether its
#: episode was terminated or truncated. Written out, it takes a third of the time of a loop.
step_result = written(
    f"def step_result(results, observation, terminated, truncated):\n"
    f"    {', '.join((*INFO_NAMES[:-2], 'reward', *INFO_NAMES[-2:]))} = unpack(results)\n"
    f"    info = {{{', '.join(f'{name!r}: {name}' for name in INFO_NAMES)}}}\n"
    f"    return observation, reward, terminated, truncated, info",
    unpack=_FEW.unpack_from,
)

#: The `info` before the first step.
NO_INFO = step_result(bytes(8 * len(RESULT)), None, False, False)[-1]


def measurements_of(results: bytes) -> dict[str, Any]:
    """All that was measured in a step of one row, from the bytes of its results."""
    *numbers, slips, mode, failure = _ALL.unpack_from(results)
    codes = {"slips": slips, "mode": mode, "failure": failure}
    return dict(zip(NUMBER_NAMES, numbers, strict=False)) | codes


def dense_measurements(
    results: NDArray[np.float64], flags: NDArray[np.int8]
) -> dict[str, NDArray[Any]]:
    """All that was measured in a step of N rows, as views (N,) of the results and their flags."""
    measured: dict[str, Any] = dict(zip(NUMBER_NAMES, results, strict=False))
    measured["slips"] = flags[FLAG.slips].view(np.bool_)
    measured["mode"], measured["failure"] = flags[FLAG.mode], flags[FLAG.failure]
    return measured


def info_of_row(dense: Mapping[str, NDArray[Any]], row: int) -> dict[str, Any]:
    """The single environment's `info` of one row of dense measurements."""
    return {name: dense[name].item(row) for name in INFO_NAMES}
