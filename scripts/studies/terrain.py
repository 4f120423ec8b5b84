"""The study `terrain`: how many steps wheels take on rough ground until they stop or fall."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from scipy.stats import norm

from agents.cli.options import MaybePath
from agents.conditions import Conditions
from agents.experts import EXPERT_SPEED
from agents.policy_files import PRETRAINED, load_policy
from agents.rollout import Policy, Rollout, controller_policy
from rimless_gym import BUILDABLE, THESIS_PHYSICAL, WheelParams
from rimless_gym.envs.vector_env import RimlessWheelVectorEnv
from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.streams import MOST_TURN
from scripts.studies.documents import markdown
from trajopt import periodic_gait
from trajopt.feedback import laws
from trajopt.ocp.arrays import Array

MARKS = markdown.marks("terrain", ("passive", "walkers"))

#: Eight legs, all mass in the hub, down a slope of 8 degrees: the wheel of Byl and Tedrake,
#: "Metastable walking machines" (IJRR 2009). Its pendulum has no mass and turns freely.
PASSIVE = THESIS_PHYSICAL.replace(
    wheel_mass=1.0,
    wheel_inertia=0.0,
    leg_length=1.0,
    n_legs=8,
    pendulum_mass=0.0,
    pendulum_inertia=1.0,
    pendulum_length=0.0,
    motor_constant=0.0,
    gravity=9.8,
    slope=math.radians(8),
)

#: Standard deviations of the slope (degrees) under this wheel, and under BUILDABLE.
ROUGHNESS, LESS = (1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0), (0.1, 0.2, 0.3, 0.5, 0.7, 1.0)

#: Stops and steps of the passive wheel at each roughness, at most; where it would hardly stop 30
#: times in these steps, it is not simulated.
STOPS, MOST_STEPS = 400, 2_000_000

#: Walks of each policy at each roughness, which begin on the gait, and their length (s); a walk
#: ends that takes no step for so long (s).
WALKS, SECONDS, PATIENCE = 64, 120, 3.0


def terrain(*, out: Path = Path("runs/terrain"), docs: MaybePath = None) -> int:
    """Measure mean first-passage times: steps until a stop or a fall, over the ground's roughness.

    The passive wheel's are compared with its return map. It takes some minutes of one core.

    Args:
        out: folder of the LQR's start-up controller.
        docs: docs/environment.md, to write the tables into.
    """
    lines = []
    for degrees in ROUGHNESS:
        expected, measured = first_passage(PASSIVE, math.radians(degrees)), "-"
        if 30 * expected < MOST_STEPS:
            total, count = passive_walks(math.radians(degrees), STOPS, MOST_STEPS)
            measured = f"{total / count:.4g} ± {total / count**1.5:.2g}"
        lines.append([f"{degrees:g}°", f"{expected:.4g}", measured])
    head = ["standard deviation of the slope", "return map", "simulated, with standard error"]
    passive = markdown.table(head, lines)
    gait, lines = periodic_gait(BUILDABLE, EXPERT_SPEED, hold=CONTROL_PERIOD), []
    policies = {name: load_policy(PRETRAINED[name]).policy for name in ("imitation", "robust")}
    policies = {"lqr": controller_policy(BUILDABLE, laws.design("lqr", gait, out))} | policies
    starts = np.tile(np.append(gait.phases[0].start, [SINGLE, 0.0]), (WALKS, 1))
    for degrees in LESS:
        each = (walked(p, starts, math.radians(degrees)) for p in policies.values())
        lines.append([f"{degrees:g}°", *each])
    walkers = markdown.table([head[0], *(f"`{name}`" for name in policies)], lines)
    if docs:
        markdown.refresh(docs, MARKS, {"passive": passive + "\n", "walkers": walkers + "\n"})
    print(passive, walkers, sep="\n\n")
    return 0


def added(params: WheelParams, slope: Array) -> Array:
    """What a step over ground of this slope (rad) adds to x, the squared rate with the leg upright.

    For a wheel with its mass in the hub: between upright legs, x becomes cos(alpha)^2 x + `added`.
    The wheel stops where that is negative.
    """
    half = params.leg_angle / 2
    falls, climbs = 1 - np.cos(half + slope), 1 - np.cos(half - slope)
    drop = math.cos(params.leg_angle) ** 2 * falls - climbs
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


def passive_walks(slope_std: float, stops: int, most_steps: int) -> tuple[int, int]:
    """Steps taken in all, and how often the passive wheel stopped; it then begins another walk."""
    rows = 256
    envs = RimlessWheelVectorEnv(
        *(rows, PASSIVE),
        disturbances={"terrain": {"slope_std": slope_std}},
        max_episode_steps=None,
        autoreset_mode="Disabled",
        control_period=0.1,
    )
    upright = [math.pi / 2 - PASSIVE.slope, PASSIVE.slope, math.sqrt(cycle(PASSIVE)), 0.0]
    envs.reset(seed=0, options={"state": upright})
    total, stopped = -rows, 0  # the first step of a walk, on even ground, does not count
    while stopped < stops and total < most_steps:
        _, _, ended, _, info = envs.step(np.zeros((rows, 1), np.float32))
        backward = (info["touchdowns"] - info["steps"]) / 2
        stopping = ended | (info["mode"] == DOUBLE) | (backward > 0)
        total += int((info["steps"] + backward - stopping).sum())
        stopped += int(stopping.sum())
        if stopping.any():
            envs.reset(options={"state": upright, "reset_mask": stopping})
    return total, stopped


def walked(policy: Policy, starts: Array, slope_std: float) -> str:
    """Mean number of steps until a fall or a stop: all steps over the number of walks that end."""
    conditions = Conditions.of(BUILDABLE, None, {"terrain": {"slope_std": slope_std}})
    steps, waited = np.zeros((2, len(starts)))
    on = np.ones(len(starts), dtype=bool)
    for interval in Rollout(conditions, policy, starts, round(SECONDS / CONTROL_PERIOD)):
        rows, stepped = interval.running, interval.info["steps"]
        steps[rows] += on[rows] * stepped
        waited[rows] = np.where(stepped > 0, 0.0, waited[rows] + CONTROL_PERIOD)
        on[rows] &= (waited[rows] < PATIENCE) & (interval.info["failure"] == 0)
    ends = int(np.sum(~on))
    return f"{steps.sum() / ends:.3g} ({ends} of {len(on)})" if ends else f"> {steps.sum():.0f}"
