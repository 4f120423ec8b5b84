"""The rows of the benchmark."""

from __future__ import annotations

import dataclasses
from typing import Any

#: The Python that runs this study; other names are those of files in requirements/.
OURS = "ours"

SINGLE, VECTOR, OPTIMISATION, PROCESS = "single", "vector", "optimisation", "process"

OUR_PHYSICS = "hybrid walking, impacts located, every joule accounted; float64, 8th order, 10 ms"
CARTPOLE = "cart and pole, one Euler step of 20 ms"
ACROBOT = "double pendulum, one RK4 step of 200 ms"
MUJOCO = "MuJoCo: cart and two poles, RK4, 5 steps of 10 ms"
IPOPT = "IPOPT, exact Hessian"


@dataclasses.dataclass(frozen=True)
class BenchmarkRow:
    """One row of the benchmark."""

    key: str  # its name on the command line and in the results
    group: str  # the table that it belongs to
    title: str  # its name in the table
    python: str  # whose Python runs it, the name of a file in requirements/ or `OURS`
    measure: str  # function of ours.py, peers.py or swing_up.py
    settings: dict[str, Any] = dataclasses.field(default_factory=dict)  # arguments of that function
    by: str = ""  # what a step computes, or how the problem is solved
    one_core: bool = True  # whether it is kept to one core, or may use all
    most: int = 1000  # largest number of rounds; small where a measurement is long and steady


def _gymnasium(name: str, physics: str) -> BenchmarkRow:
    settings = {"env": name}
    title = f"Gymnasium {name}"
    return BenchmarkRow(name, SINGLE, title, "gymnasium", "gymnasium_single", settings, physics)


def _swing_up(key: str, title: str, python: str, by: str) -> BenchmarkRow:
    return BenchmarkRow(f"swing-up-{key}", OPTIMISATION, title, python, python, by=by)


def _fresh(key: str, title: str, program: str, most: int = 1000, **settings: Any) -> BenchmarkRow:
    settings["program"] = program
    return BenchmarkRow(key, PROCESS, title, OURS, "fresh", settings, one_core=False, most=most)


SIZES = (1024, 16384)
CARTPOLE_NATIVE = {"env": "CartPole-v1"}
SIMPSON = "Hermite-Simpson"
TRAPEZOIDS = f"{SIMPSON}, force linear, cost by trapezoids; no Hessian"

ROWS = (
    BenchmarkRow("ours", SINGLE, "**rimless-gym**", OURS, "single", by=OUR_PHYSICS),
    _gymnasium("CartPole-v1", CARTPOLE),
    _gymnasium("Pendulum-v1", "pendulum, one Euler step of 50 ms"),
    _gymnasium("Acrobot-v1", ACROBOT),
    _gymnasium("InvertedDoublePendulum-v5", MUJOCO),
    *(
        BenchmarkRow(
            f"ours-vector-{n}", VECTOR, "**rimless-gym**", OURS, "vector", {"n": n}, OUR_PHYSICS
        )
        for n in SIZES
    ),
    BenchmarkRow(
        f"ours-random-{SIZES[0]}",
        VECTOR,
        "**rimless-gym**, random actions",
        OURS,
        "played",
        {"n": SIZES[0]},
        "the same; most wheels stand, and the motor reverses often: 3.5 integration steps each",
    ),
    BenchmarkRow(
        f"ours-ppo-{SIZES[0]}",
        VECTOR,
        "**rimless-gym**, PPO of stable-baselines3 included",
        OURS,
        "learned",
        {"n": SIZES[0]},
        "two networks of 64 x 64, 3 epochs of batches of 4096, roll-outs of 64",
    ),
    *(
        BenchmarkRow(
            f"cartpole-vector-{n}",
            VECTOR,
            "Gymnasium CartPole-v1, native",
            "gymnasium",
            "gymnasium_vector",
            CARTPOLE_NATIVE | {"n": n},
            CARTPOLE,
        )
        for n in SIZES
    ),
    BenchmarkRow(
        "envpool-acrobot",
        VECTOR,
        "EnvPool Acrobot-v1",
        "envpool",
        "envpool_vector",
        {"env": "Acrobot-v1", "n": 2048, "batch": 1024},
        ACROBOT,
        one_core=False,
    ),
    BenchmarkRow(
        "gymnax-acrobot-one",
        VECTOR,
        "gymnax Acrobot-v1",
        "gymnax",
        "gymnax_vector",
        {"env": "Acrobot-v1", "n": 16384},
        f"{ACROBOT}, float32",
    ),
    BenchmarkRow(
        "swing-up-ours", OPTIMISATION, "**trajopt**", OURS, "optimisation", by=f"{SIMPSON}; {IPOPT}"
    ),
    _swing_up("bare", "a script: CasADi, by hand", "casadi", f"{SIMPSON}; {IPOPT}"),
    _swing_up(
        "rockit-collocation",
        "rockit, DirectCollocation",
        "rockit",
        f"2 Gauss points, force linear; {IPOPT}",
    ),
    _swing_up("drake-ipopt", "Drake, IPOPT", "drake", TRAPEZOIDS),
    _fresh("gait", "`periodic_gait` of two steps, verified; imports not counted", "gait", 3),
    _fresh("import", "`import rimless_gym`", "import"),
    _fresh("single", "import, `gym.make`, first `reset` and `step`", "single"),
    _fresh("single-cold", "the same the very first time", "single", 2, cold=True),
    _fresh("vector", "import, `gym.make_vec` of 64, first `reset` and `step`", "vector"),
)
