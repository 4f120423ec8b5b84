"""The study `robustness`: laws and policies on machines that differ from the one they are for."""

from __future__ import annotations

import dataclasses
import math
import shutil
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.cli.options import Count, MaybeCount, MaybePath, Positive, Several, chosen
from agents.conditions import Conditions
from agents.evaluate import SHORT_PROTOCOL, evaluate
from agents.experts import OwnLaws
from agents.imitation import Cloning
from agents.learner import IMITATION
from agents.policy_files import PRETRAINED, load_policy
from agents.rollout import AdaptivePolicy, Policy, Running, begun, controller_policy
from agents.sb3.feedforward import RATES, back_emf_gains
from agents.training import train
from agents.training_config import TrainingConfig
from rimless_gym import BUILDABLE
from rimless_gym.envs.layout import observe
from rimless_gym.envs.starts import draw_start
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import THETA
from rimless_gym.params import WheelParams
from scripts.studies.documents import markdown
from scripts.studies.history import TeachingWithHistory, remembering
from trajopt import Solution, periodic_gait
from trajopt.feedback import laws
from trajopt.feedback.adaptive import AdaptiveController
from trajopt.feedback.gait_table import law_about, own_gait
from trajopt.feedback.law import Floats, Law
from trajopt.gaits.fronts import CotFront, shipped_front
from trajopt.identification.fit import PHYSICAL, machines_within
from trajopt.pool import run
from trajopt.store import Store, file_digest, key

MARKS = markdown.marks("robustness", ("machines",))

#: Control periods per step of the gaits from which optima are continued: 0.566 and 0.620 m/s.
TICKS = (46, 42)

#: What is measured, and the gait that it holds, None for a policy. The gentle law is the LQR with
#: the gains from which the adaptive controller starts, and without a clock; the tuned one begins
#: with these gains. The clones imitate the laws of drawn machines about their own gaits, one from
#: the state alone, one with its history.
CANDIDATES: dict[str, int | None] = {
    **{f"{law} 42": 42 for law in ("adaptive", "lqr")},
    **{
        f"{law} 46": 46
        for law in (
            *("adaptive", "lqr", "gentle", "tuned", "clone", "history"),
            *("input_output", "pid", "sliding_mode", "receding_horizon"),
        )
    },
    "tuned 44": 44,
    **dict.fromkeys(
        (
            *("tolerant", "imitation", "fine_tuned", "evolution", "robust"),
            *("ppo", "sac", "evolved"),
        )
    ),
}

#: Within which shares all parameters are drawn.
LEVELS = (0.0, 0.005, 0.01, 0.02, 0.05)

#: The clones learn from machines within this share; and how they learn.
TAUGHT = 0.04
CLONING = Cloning(
    expert_starts=96,
    starts=512,
    labels=40_000,
    lost_labels=40_000,
    gait_starts=160,
    gait_labels=60_000,
    gradient_steps=8000,
    batch_size=1024,
)

#: Noise of the angles (rad) with which the clone with history learns: else what it concludes from
#: its past is wrong where an encoder is.
TAUGHT_NOISE = {"sensor_noise": {"leg_angle": 1e-3, "pendulum_angle": 3e-3}}

#: Of the drawn machines, which are the same for all levels but for the level.
SEED = 20261126

#: What no law's model has: air drag on the turning pendulum (N m s^2), to which 3 % of the nominal
#: gait's power goes, and play (rad) between the pendulum and the motor, at which its angle is
#: measured. The adaptive controller is set to expect errors of `ERROR` (rad), and so adds as much
#: noise to what it reads.
UNMODELLED, WINDAGE, PLAY, ERROR = "windage and 0.5° of play", 7e-6, math.radians(0.5), 3e-3

#: Disturbances, of the nominal machine and of drawn ones.
LATE, NOISE = "one period late", "encoders' noise of 0.001 rad"
DISTURBANCES: dict[str, Mapping[str, Any]] = {
    LATE: {"actuator_delay": 1},
    NOISE: {"sensor_noise": {"leg_angle": 1e-3, "pendulum_angle": 1e-3}},
    UNMODELLED: {},  # see `WithPlay`
}

#: A gait that costs more than this times the nominal machine's at the speed may be a local optimum.
LOCAL = 1.15

#: Most walks side by side, from one stored result to the next.
TOGETHER = 16


class Variation(NamedTuple):
    """The machines of some walks, which differ in one way, and what disturbs them."""

    machines: tuple[WheelParams, ...]
    disturbances: str | None = None  # in `DISTURBANCES`


class CaseWalks(NamedTuple):
    """A candidate's walks with some machines of a case, each from a start of its own."""

    candidate: str
    first: int  # of the case's machines
    machines: tuple[WheelParams, ...]
    disturbances: str | None
    seconds: float
    folder: Path


class OwnGait(NamedTuple):
    """The gait of a machine whose step lasts so many control periods."""

    machine: WheelParams
    ticks: int
    folder: Path


def robustness(
    *,
    out: Path = Path("runs/robustness"),
    machines: Count = 64,
    starts: Count = 2,
    seconds: Positive = 28.0,
    candidates: Several = (),
    groups: Several = (),
    workers: MaybeCount = None,
    docs: MaybePath = None,
) -> int:
    """Measure laws, the adaptive controller and policies on changed machines.

    All parameters within a few percent, single ones, slopes, payload, battery, delay and noise.
    The cost is compared with each machine's own optimum at the speed at which it walks. It takes
    hours of one core; after Ctrl-C or a kill, the same command continues.

    Args:
        out: folder of the study; after a change of the code, take another one.
        machines: how many are drawn for each level; each walks from one start.
        starts: of each other machine.
        seconds: of a walk, of which the last 10 are measured.
        candidates: some of those that are measured; all by default.
        groups: of changes, some of drawn, single, slopes, others; all by default.
        workers: processes; by default one for every core.
        docs: a page, docs/feedback.md, to put the table into.
    """
    changes, names = cases(machines, starts), chosen(candidates, list(CANDIDATES))
    every = {t: c for group in chosen(groups, list(changes)) for t, c in changes[group].items()}
    todo = {
        (title, name): walks_of(case, name, seconds, out)
        for title, case in every.items()
        for name in names
    }
    with Store(out) as store:
        for name in names:  # the workers find in the folder what takes long
            policy_of(name, out)
        _compute(store, [task for tasks in todo.values() for task in tasks], walked, workers)
        walks = {
            which: [walk for task in tasks for walk in _results(task, store.load(_key(task)))]
            for which, tasks in todo.items()
        }
        every_walk = [walk for several in walks.values() for walk in several if walk.walks]
        own = (OwnGait(each.machine, n, out) for each in every_walk for n in each.between)
        optima = list(dict.fromkeys(own))
        _compute(store, optima, optimal, workers)
        costs = {(each.machine, each.ticks): store.load(_key(each))["cot"] for each in optima}
    text = table(every, names, walks, costs)
    if docs:
        markdown.refresh(docs, MARKS, {"machines": text + "\n"})
    print(text)
    return 0


def cases(count: int, starts: int) -> dict[str, dict[str, Variation]]:
    """All cases by group and title: `count` drawn machines, and `starts` walks of each other."""
    drawn = np.random.default_rng(SEED).uniform(-1.0, 1.0, (count, len(PHYSICAL)))
    several = {
        f"all within {100 * level:g} %": Variation(
            machines_within(BUILDABLE, level, drawn) if level else (BUILDABLE,) * starts
        )
        for level in LEVELS
    }
    single = {
        f"{name.replace('_', ' ')} ± 2 %": Variation(
            tuple(_scaled({name: factor}) for factor in (0.98, 1.02)) * starts
        )
        for name in ("pendulum_length", "pendulum_mass", "leg_length")
    }
    slopes = {
        f"slope of {degrees:+g}°": Variation(
            (BUILDABLE.replace(slope=math.radians(degrees)),) * starts
        )
        for degrees in (-2, -1, -0.5, 0.5, 1, 2)
    }
    heavier = BUILDABLE.wheel_mass + 0.05 * BUILDABLE.total_mass
    others = {
        "5 % payload at the hub": Variation((BUILDABLE.replace(wheel_mass=heavier),) * starts),
        "battery at 80 %": Variation((_scaled({"voltage_limit": 0.8}),) * starts),
        **{title: Variation((BUILDABLE,) * starts, title) for title in (LATE, NOISE)},
        f"all within 2 %, {NOISE}": several["all within 2 %"]._replace(disturbances=NOISE),
        **{
            f"{title}, {UNMODELLED}": Variation(
                tuple(
                    machine.replace(pendulum_drag=WINDAGE) for machine in several[title].machines
                ),
                UNMODELLED,
            )
            for title in ("all within 0 %", "all within 2 %")
        },
    }
    return {"drawn": several, "single": single, "slopes": slopes, "others": others}


def _scaled(factors: Mapping[str, float]) -> WheelParams:
    fields = {name: factor * getattr(BUILDABLE, name) for name, factor in factors.items()}
    return dataclasses.replace(BUILDABLE, **fields)


def walks_of(case: Variation, candidate: str, seconds: float, folder: Path) -> list[CaseWalks]:
    """The walks of a case, in parts that are stored each by itself."""
    firsts = range(0, len(case.machines), TOGETHER)
    several = ((i, case.machines[i : i + TOGETHER], case.disturbances) for i in firsts)
    return [CaseWalks(candidate, *each, seconds, folder) for each in several]


def _key(task: CaseWalks | OwnGait) -> str:
    """The name of a result: what it depends on, but for the code."""
    values = {name: value for name, value in task._asdict().items() if name != "folder"}
    candidate = getattr(task, "candidate", "optimum")
    if candidate in PRETRAINED:
        values["file"] = file_digest(PRETRAINED[candidate])
    return key(candidate, **values)


def _compute(store: Store, tasks: Sequence[Any], function: Any, workers: int | None) -> None:
    todo = [task for task in tasks if _key(task) not in store]
    for task, result in run(function, todo, workers, progress=f"robustness: {function.__name__}"):
        store.save(_key(task), result)


@lru_cache
def nominal_gait(ticks: int, folder: Path) -> Solution:
    """The nominal machine's gait, of so many control periods per step."""
    file = folder / f"gait{ticks}.npz"
    if not file.exists():
        time = ticks * CONTROL_PERIOD
        periodic_gait(BUILDABLE, step_time=time, hold=CONTROL_PERIOD).save(file)
    return Solution.load(file)


@lru_cache
def policy_of(candidate: str, folder: Path) -> Policy:
    """A candidate, designed for the nominal machine."""
    ticks = CANDIDATES[candidate]
    if ticks is None:
        return load_policy(PRETRAINED[candidate]).policy
    gait, law = nominal_gait(ticks, folder), candidate.split()[0]
    if law == "adaptive":
        return AdaptivePolicy(AdaptiveController.about(gait, folder))
    if law == "clone":
        file = folder / "clone.zip"  # two processes cannot train in one folder
        if not file.exists():
            shutil.copy(cloned(AdaptiveController.about(gait, folder), folder), file)
        return load_policy(file).policy
    if law == "history":
        expert = OwnLaws(AdaptiveController.about(gait, folder))
        conditions = Conditions.of(BUILDABLE, taught_ranges(), TAUGHT_NOISE)
        teaching = TeachingWithHistory(expert, conditions, CLONING, seed=0)
        return remembering(teaching, folder / "history.pt")
    held: Law | str = law
    if law == "gentle":
        held = law_about(gait, ahead=None)
    return controller_policy(BUILDABLE, laws.design(held, gait, folder))


def cloned(controller: AdaptiveController, folder: Path) -> Path:
    """A network that imitates, from the state alone, what each drawn machine's own law does."""
    config = TrainingConfig(
        "ppo",
        IMITATION,
        timesteps=0,
        ranges=taught_ranges(),
        expert=OwnLaws(controller),
        cloning=CLONING,
    )
    return train(config, folder / "clone", progress=False).last


def taught_ranges() -> dict[str, tuple[float, float]]:
    """Within which the machines are drawn that the clones learn from."""
    known = {name: getattr(BUILDABLE, name) for name in PHYSICAL}
    return {name: ((1 - TAUGHT) * at, (1 + TAUGHT) * at) for name, at in known.items()}


def walked(task: CaseWalks) -> dict[str, Any]:
    """The speed and cost of each walk, NaN of those that do not count."""
    rng = np.random.default_rng((SEED, task.first))
    policy = policy_of(task.candidate, task.folder)
    if task.disturbances == UNMODELLED:
        policy = WithPlay(policy)
    result = evaluate(
        policy,
        BUILDABLE,
        dataclasses.replace(
            SHORT_PROTOCOL, duration=task.seconds, seed=SHORT_PROTOCOL.seed + task.first
        ),
        starts=np.stack([draw_start(machine, rng) for machine in task.machines]),
        machines=task.machines,
        disturbances=None
        if task.disturbances in (None, UNMODELLED)
        else DISTURBANCES[task.disturbances],
        progress=False,
    )
    return {"speed": result.speeds, "cot": result.cots}


class WithPlay:
    """A policy that reads the pendulum's angle at the motor.

    It is off by half of the play, in the direction of the current; the torque that accelerates the
    rotor is left out.
    """

    def __init__(self, policy: Policy) -> None:
        if isinstance(policy, AdaptivePolicy):
            policy = AdaptivePolicy(dataclasses.replace(policy.controller, encoders=ERROR))
        self.policy = policy

    def begin(self, machines: Sequence[WheelParams], running: Running) -> Policy:
        """See `agents.rollout.begun`."""
        policy, last = begun(self.policy, machines, running), np.zeros(len(machines))
        gains = np.stack([back_emf_gains(machine) for machine in machines])

        def reading(states: Floats, observations: NDArray[np.float32]) -> Floats:
            rows, read = running(), states.copy()
            back_emf = (observations[:, RATES] * gains[rows]).sum(axis=1)
            read[:, THETA] += 0.5 * PLAY * np.sign(last[rows] - back_emf)
            last[rows] = policy(read, observe(BUILDABLE, read))
            return last[rows]

        return reading

    def __call__(self, states: Floats, observations: NDArray[np.float32]) -> Floats:
        """The actions (N,) in [-1, 1] of walks that begin now."""
        n = len(states)
        return self.begin((BUILDABLE,) * n, lambda: np.arange(n))(states, observations)


class Walk(NamedTuple):
    """How a machine walked."""

    machine: WheelParams
    speed: float  # m/s; NaN where it does not count, and so is the cost
    cot: float

    @property
    def walks(self) -> bool:
        """Whether it counts."""
        return math.isfinite(self.cot)

    @property
    def ticks(self) -> float:
        """Control periods per step."""
        return self.machine.step_length / (self.speed * CONTROL_PERIOD)

    @property
    def between(self) -> tuple[int, int]:
        """The whole control periods of the gaits with which it is compared."""
        return math.floor(self.ticks), math.floor(self.ticks) + 1


def _results(task: CaseWalks, result: Mapping[str, Any]) -> list[Walk]:
    figures = result["speed"].tolist(), result["cot"].tolist()
    return [Walk(*each) for each in zip(task.machines, *figures, strict=True)]


def optimal(task: OwnGait) -> dict[str, Any]:
    """The least cost of a machine's own gaits; None without any.

    The search starts from the nearer gait of the nominal machine, and from the other one if what it
    finds may be a local optimum.
    """
    costs: list[float] = []
    for ticks in sorted(TICKS, key=lambda ticks: abs(ticks - task.ticks)):
        nominal = nominal_gait(ticks, task.folder)
        gait = own_gait(nominal, task.machine, task.ticks - ticks)
        if gait is not None and gait.verification.passed:
            costs.append(gait.cot)
            if gait.cot < LOCAL * float(one_step_front()(_speed(task.ticks))):
                break
    return {"cot": min(costs, default=None)}


def _speed(ticks: int) -> float:
    return BUILDABLE.step_length / (ticks * CONTROL_PERIOD)


def table(
    every: Mapping[str, Variation],
    candidates: Sequence[str],
    walks: Mapping[tuple[str, str], Sequence[Walk]],
    costs: Mapping[tuple[WheelParams, int], float | None],
) -> str:
    """A line for every case: of each candidate, the mean gap and the share of starts that walk."""
    lines = []
    for title, case in every.items():
        cells = []
        for candidate in candidates:
            several = walks[title, candidate]
            gaps = [gap for each in several if (gap := _gap(each, costs)) is not None]
            share = markdown.percent(fmean(each.walks for each in several))
            mean = f"{100 * fmean(gaps):+.1f} %" if gaps else "-"
            cells.append(f"{mean} ({share})")
        lines.append([f"{title} ({len(case.machines)})", *cells])
    return markdown.table(["machines", *map(_title, candidates)], lines)


def _gap(walk: Walk, costs: Mapping[tuple[WheelParams, int], float | None]) -> float | None:
    """A walk's cost over the optimum at its speed, less one; None without either."""
    if not walk.walks:
        return None
    known = {n: cost for n in walk.between if (cost := costs[walk.machine, n]) is not None}
    if not known:
        return None
    return float(walk.cot / np.interp(walk.ticks, list(known), list(known.values())) - 1)


@lru_cache
def one_step_front() -> CotFront:
    """The nominal machine's gaits of one step, which all optima here are."""
    gaits = shipped_front(BUILDABLE).solutions
    return CotFront(tuple(gait for gait in gaits if gait.steps == 1))


def _title(candidate: str) -> str:
    """A column's."""
    ticks = CANDIDATES[candidate]
    if ticks is None:
        return f"`{candidate}`"
    return f"`{candidate.split()[0]}`, {_speed(ticks):.3f} m/s"
