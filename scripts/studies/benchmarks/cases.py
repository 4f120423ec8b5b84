"""The rows of the benchmark, each with the worker program that measures it."""

from __future__ import annotations

import dataclasses
from typing import Any

from scripts.studies.benchmarks.environments import OURS

SINGLE, VECTOR, TRAINING, PROCESS, ACCURACY = "single", "vector", "training", "process", "accuracy"
OPTIMISATION, LANES = "optimisation", "lanes"

_OUR_PHYSICS = "hybrid walking, impacts located, energy booked; float64, 8th order, 10 ms"
_CARTPOLE = "cart and pole, one Euler step of 20 ms"
_ACROBOT = "double pendulum, one RK4 step of 200 ms"
_SIMPSON, _IPOPT = "Hermite-Simpson", "IPOPT, exact Hessian"
_MUJOCO = "MuJoCo: cart and two poles, RK4, 5 steps of 10 ms"


@dataclasses.dataclass(frozen=True)
class Case:
    """One row of the benchmark.

    Attributes:
        key: its name on the command line and in the results.
        group: the table that it belongs to.
        title: its name in the table.
        environment: whose Python runs it, the name of a file in requirements/ or `OURS`.
        worker: module in `scripts.studies.benchmarks.workers`.
        settings: for the worker.
        physics: what a step computes, or how the problem is solved.
        one_core: whether it is kept to one core, or may use all.
        most: largest number of rounds. It is small where a measurement is long and steady.
    """

    key: str
    group: str
    title: str
    environment: str
    worker: str
    settings: dict[str, Any] = dataclasses.field(default_factory=dict)
    physics: str = ""
    one_core: bool = True
    most: int = 1000


def _gymnasium(name: str, physics: str) -> Case:
    worker, title = "gymnasium_single", f"Gymnasium {name}"
    return Case(name, SINGLE, title, "gymnasium", worker, {"env": name}, physics)


def _sizes(key: str, title: str, environment: str, worker: str, **more: Any) -> list[Case]:
    env = {"env": more.pop("env")} if "env" in more else {}
    return [
        Case(f"{key}-{n}", VECTOR, title, environment, worker, env | {"n": n}, **more)
        for n in (1024, 16384)
    ]


def _one_lane(key: str, title: str, worker: str, **more: Any) -> Case:
    return Case(key, LANES, title, OURS, "ours_lanes", {"lanes": 1, "worker": worker, **more})


def _swing_up(key: str, title: str, environment: str, physics: str, **more: Any) -> Case:
    worker = f"{environment}_cartpole"
    return Case(f"swing-up-{key}", OPTIMISATION, title, environment, worker, more, physics)


def _fresh(program: str, title: str, **more: Any) -> Case:
    cold = {"cold": True} if more.pop("cold", False) else {}
    key = f"{program}-cold" if cold else program
    settings = {"program": program, "warm_up": "most" not in more} | cold
    return Case(key, PROCESS, title, OURS, "ours_process", settings, one_core=False, **more)


CASES = (
    Case("ours", SINGLE, "**rimless-gym**", OURS, "ours_single", physics=_OUR_PHYSICS),
    Case("ours-info", SINGLE, "the same, reading `info`", OURS, "ours_single", {"read_info": True}),
    Case("kernel", SINGLE, "its kernel alone, called from Python", OURS, "ours_kernel", {"n": 1}),
    _gymnasium("CartPole-v1", _CARTPOLE),
    _gymnasium("Pendulum-v1", "pendulum, one Euler step of 50 ms"),
    _gymnasium("Acrobot-v1", _ACROBOT),
    _gymnasium("InvertedDoublePendulum-v5", _MUJOCO),
    *_sizes("ours-vector", "**rimless-gym**", OURS, "ours_vector", physics=_OUR_PHYSICS),
    *_sizes("kernel-batch", "its kernel alone", OURS, "ours_kernel"),
    *_sizes(
        "cartpole-vector",
        "Gymnasium CartPole-v1, native",
        "gymnasium",
        "gymnasium_vector",
        env="CartPole-v1",
        physics=_CARTPOLE,
    ),
    Case(
        "envpool-acrobot",
        VECTOR,
        "EnvPool Acrobot-v1",
        "envpool",
        "envpool_vector",
        {"env": "Acrobot-v1"},
        _ACROBOT,
        one_core=False,
    ),
    Case(
        "envpool-double-pendulum",
        VECTOR,
        "EnvPool InvertedDoublePendulum-v5",
        "envpool",
        "envpool_vector",
        {"env": "InvertedDoublePendulum-v5"},
        _MUJOCO,
        one_core=False,
    ),
    *[
        Case(
            f"gymnax-acrobot-{cores}",
            VECTOR,
            "gymnax Acrobot-v1",
            "gymnax",
            "gymnax_vector",
            {"env": "Acrobot-v1", "n": 16384},
            _ACROBOT + ", float32",
            one_core=cores == "one",
        )
        for cores in ("one", "all")
    ],
    _one_lane("one-lane", "one environment, as `gym.make` gives it", "ours_single"),
    _one_lane("one-lane-1024", "1024 environments", "ours_vector", n=1024),
    _one_lane("one-lane-16384", "16384 environments", "ours_vector", n=16384),
    Case(
        "ppo-8",
        TRAINING,
        "8 environments, SB3's defaults",
        OURS,
        "ours_training",
        {"n": 8, "ppo": {}},
        most=3,
    ),
    Case(
        "ppo-256",
        TRAINING,
        "256 environments, batches of 4096, 256 steps a rollout, else SB3's defaults",
        OURS,
        "ours_training",
        {"n": 256, "ppo": {"n_steps": 256, "batch_size": 4096}},
    ),
    _swing_up("ours", "**trajopt**", OURS, f"{_SIMPSON}; {_IPOPT}"),
    _swing_up("bare", "a bare script: CasADi, by hand", "casadi", f"{_SIMPSON}; {_IPOPT}"),
    _swing_up(
        "rockit-collocation",
        "rockit, DirectCollocation",
        "rockit",
        f"2 Gauss points, force linear; {_IPOPT}",
        method="collocation",
    ),
    _swing_up(
        "rockit-shooting",
        "rockit, MultipleShooting",
        "rockit",
        f"a step of RK4, force linear; {_IPOPT}",
        method="shooting",
    ),
    _swing_up(
        "drake-ipopt",
        "Drake, DirectCollocation with IPOPT",
        "drake",
        f"{_SIMPSON}, force linear, cost by trapezoids; no Hessian",
        solver="ipopt",
    ),
    _swing_up(
        "drake-snopt",
        "Drake, DirectCollocation with SNOPT",
        "drake",
        f"{_SIMPSON}, force linear, cost by trapezoids; no Hessian",
        solver="snopt",
    ),
    dataclasses.replace(
        _swing_up("dymos", "dymos", "dymos", f"{_SIMPSON}; SciPy's SLSQP", warm_up=False),
        most=1,
    ),
    _fresh("gait", "`trajopt.periodic_gait` of two steps, verified; imports not counted", most=3),
    _fresh("gaits", "the same with 32 random starts", most=1),
    _fresh("import", "`import rimless_gym`"),
    _fresh("single", "import, `gym.make`, first `reset` and `step`"),
    _fresh("single", "the same the very first time, nothing compiled", cold=True, most=2),
    _fresh("vector", "import, `gym.make_vec` of 64, first `reset` and `step`"),
    _fresh("vector", "the same the very first time", cold=True, most=2),
    _fresh("memory-vector", "memory of a row of the vector environment", most=1),
    _fresh("memory-single", "memory of a `gym.make`", most=1),
    Case(
        "accuracy",
        ACCURACY,
        "accuracy over 2 s of the gait",
        OURS,
        "ours_accuracy",
        {"warm_up": False},
        most=3,
    ),
)
