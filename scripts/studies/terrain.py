"""The study `terrain`: how many steps wheels take on rough ground until they stop or fall."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.stats import norm

from agents.cli.options import Count, MaybePath
from agents.conditions import Conditions
from agents.experts import EXPERT_SPEED
from agents.policy_files import PRETRAINED, load_policy
from agents.rollout import Policy, Rollout, controller_policy
from rimless_gym import BUILDABLE, Terrain, WheelParams
from rimless_gym.envs.vector_env import RimlessWheelVectorEnv
from rimless_gym.equations import DOUBLE
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import STATE_SIZE
from rimless_gym.streams import MOST_TURN
from scripts.studies.documents import markdown
from trajopt import Solution, periodic_gait
from trajopt.feedback import laws
from trajopt.ocp.arrays import Array

MARKS = markdown.marks("terrain", ("passive", "walkers"))

#: Eight legs, all mass in the hub, down a slope of 8 degrees: the wheel of Byl and Tedrake,
#: "Metastable walking machines" (IJRR 2009). Its pendulum has no mass and turns freely.
PASSIVE = WheelParams(
    wheel_mass=1.0,
    wheel_inertia=0.0,
    leg_length=1.0,
    n_legs=8,
    pendulum_mass=0.0,
    pendulum_inertia=1.0,
    pendulum_length=0.0,
    pendulum_reach=0.0,
    motor_constant=0.0,
    rotor_inertia=0.0,
    hub_friction=0.0,
    gear_loss=0.0,
    gravity=9.8,
    slope=math.radians(8),
)
ROUGHNESS = (1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0)  # degrees

#: Of the ground under BUILDABLE; what walks on it; and how long without a step is a pause (s).
LESS = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
WALKERS = ("lqr", "imitation", "robust")
PATIENCE = 3.0


def terrain(
    *,
    stops: Count = 400,
    most_steps: Count = 2_000_000,
    walks: Count = 64,
    seconds: Count = 120,
    out: Path = Path("runs/terrain"),
    docs: MaybePath = None,
) -> int:
    """Measure mean first-passage times: steps until a stop or a fall, over the ground's roughness.

    The passive wheel's are compared with its return map. It takes some minutes of one core.

    Args:
        stops: of the passive wheel at each roughness, at most.
        most_steps: of the passive wheel at each roughness; where it would hardly stop 30 times in
            these, it is not simulated.
        walks: of each walker at each roughness, which begin on its gait.
        seconds: length of these walks.
        out: folder of the LQR's start-up controller.
        docs: a page, docs/environment.md, to put the tables into.
    """
    lines = []
    for degrees in ROUGHNESS:
        expected = first_passage(PASSIVE, math.radians(degrees))
        measured = "-"
        if 30 * expected < most_steps:
            total, count = passive_walks(math.radians(degrees), stops, most_steps)
            measured = f"{total / count:.4g} ± {total / count**1.5:.2g}"
        lines.append([f"{degrees:g}°", f"{expected:.4g}", measured])
    head = ["standard deviation of the slope", "return map", "simulated, with standard error"]
    passive = markdown.table(head, lines)
    gait = periodic_gait(BUILDABLE, EXPERT_SPEED, hold=CONTROL_PERIOD)
    start, lines = np.append(gait.phases[0].start, [0.0, 0.0]), []
    policies = {name: _policy(name, gait, out) for name in WALKERS}
    for degrees in LESS:
        for name, policy in policies.items():
            each = walked(policy, start, math.radians(degrees), walks, seconds)
            lines.append([f"{degrees:g}°", f"`{name}`", *each])
    head = [head[0], "walker", "steps until a pause (walks)", "steps until a fall (walks)"]
    walkers = markdown.table(head, lines)
    if docs:
        markdown.refresh(docs, MARKS, {"passive": passive + "\n", "walkers": walkers + "\n"})
    print(passive, walkers, sep="\n\n")
    return 0


def _policy(name: str, gait: Solution, folder: Path) -> Policy:
    if name in PRETRAINED:
        return load_policy(PRETRAINED[name]).policy
    return controller_policy(BUILDABLE, laws.design(name, gait, folder))


def added(params: WheelParams, slope: Array) -> Array:
    """What a step over ground of this slope (rad) adds to x, the squared rate with the leg upright.

    For a wheel with its mass in the hub: between upright legs, x becomes cos(alpha)^2 x + `added`.
    The wheel stops where that is negative.
    """
    half, alpha = params.leg_angle / 2, params.leg_angle
    falls, climbs = 1 - np.cos(half + slope), 1 - np.cos(half - slope)
    drop = math.cos(alpha) ** 2 * falls - climbs
    return np.asarray(2 * params.gravity / params.leg_length * drop)


def cycle(params: WheelParams) -> float:
    """The square of the upright leg's rate (1/s^2) that even ground repeats."""
    return float(added(params, np.asarray(params.slope))) / math.sin(params.leg_angle) ** 2


def first_passage(params: WheelParams, slope_std: float, cells: int = 400) -> float:
    """Mean number of steps until the wheel stops, from the even ground's cycle.

    From the transition matrix between cells of x; `added` rises with the slope.
    """
    most = MOST_TURN * params.leg_angle
    turns = np.linspace(-most, most, 20_001)
    gains = added(params, params.slope + turns)
    edges = np.linspace(0.0, gains[-1] / math.sin(params.leg_angle) ** 2, cells + 1)
    x = (edges[1:] + edges[:-1]) / 2
    needed = edges[np.newaxis] - (math.cos(params.leg_angle) ** 2 * x)[:, np.newaxis]
    below = norm.cdf(np.interp(needed, gains, turns) / slope_std)
    below = np.where(needed < gains[0], 0.0, np.where(needed >= gains[-1], 1.0, below))
    times = np.linalg.solve(np.eye(cells) - np.diff(below), np.ones(cells))
    return float(np.interp(cycle(params), x, times))


def passive_walks(slope_std: float, stops: int, most_steps: int, rows: int = 256) -> Sequence[int]:
    """Steps taken in all, and how often the passive wheel stopped; it then begins another walk."""
    disturbances = {"terrain": Terrain(slope_std=slope_std)}
    envs = RimlessWheelVectorEnv(
        *(rows, PASSIVE),
        disturbances=disturbances,
        max_episode_steps=None,
        autoreset_mode="Disabled",
        control_period=0.1,
    )
    upright = [math.pi / 2 - PASSIVE.slope, PASSIVE.slope, math.sqrt(cycle(PASSIVE)), 0.0]
    envs.reset(seed=0, options={"state": upright})
    still, total, stopped = np.zeros((rows, 1), np.float32), -rows, 0  # the first step is even
    while stopped < stops and total < most_steps:
        _, _, ended, _, info = envs.step(still)
        back = (info["touchdowns"] - info["steps"]) / 2
        total += int((info["steps"] + back).sum())
        stops_now = ended | (info["mode"] == DOUBLE) | (back > 0)
        if stops_now.any():
            stopped += int(stops_now.sum())
            total -= int(stops_now.sum())
            envs.reset(options={"state": upright, "reset_mask": stops_now})
    return total, stopped


def walked(
    policy: Policy, start: Array, slope_std: float, walks: int, seconds: int
) -> tuple[str, str]:
    """Mean number of steps until a pause and until a fall: all steps over the number of ends."""
    conditions = Conditions.of(BUILDABLE, None, {"terrain": {"slope_std": slope_std}})
    starts = np.tile(start, (walks, 1)).reshape(walks, STATE_SIZE)
    steps, waited = np.zeros((2, walks)), np.zeros(walks)
    ended = np.zeros((2, walks), dtype=bool)
    for interval in Rollout(conditions, policy, starts, round(seconds / CONTROL_PERIOD)):
        rows, stepped = interval.running, interval.info["steps"]
        waited[rows] = np.where(stepped > 0, 0.0, waited[rows] + CONTROL_PERIOD)
        fell = interval.info["failure"] != 0
        steps[:, rows] += ~ended[:, rows] * stepped
        ended[:, rows] |= fell | np.array([waited[rows] >= PATIENCE, fell])
    pauses, falls = (_mean(*one) for one in zip(steps, ended, strict=True))
    return pauses, falls


def _mean(steps: Array, ended: Array) -> str:
    total, ends = steps.sum(), int(ended.sum())
    return f"{total / ends:.3g} ({ends} of {len(ended)})" if ends else f"> {total:.0f}"
