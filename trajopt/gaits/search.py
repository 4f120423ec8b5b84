"""Random starts for gaits: families of motions, by what the leg and the pendulum do."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from rimless_gym.params import WheelParams
from trajopt.gaits.gait_problem import gait_problem, posed
from trajopt.gaits.stance import CONTROL_DEGREE
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.search.multi_start import Search, multi_start
from trajopt.ocp.search.optima import Outcome, Start
from trajopt.ocp.solving.guesses import Guess, polyline
from trajopt.ocp.transcribe.mesh import Mesh

#: Enough to tell good optima from bad ones; winners are refined.
SEARCH_ELEMENTS, SEARCH_DEGREE = 14, 4


@dataclasses.dataclass(frozen=True)
class GaitFamily:
    """Starts of gaits, each solved with regeneration first, whose landscape is smoother.

    Attributes:
        params: the machine.
        speed: m/s.
        steps: per stride.
        regeneration: whether that is the objective in the end.
        problem: that the starts' problems share their functions with, in other processes too.
    """

    params: WheelParams
    speed: float
    steps: int
    regeneration: bool
    problem: Problem

    @classmethod
    def of(cls, params: WheelParams, speed: float, steps: int, regeneration: bool) -> GaitFamily:
        """The family of a machine at a speed."""
        problem = gait_problem(params, speed=speed, steps=steps, regeneration=regeneration)
        return cls(params, speed, steps, regeneration, problem)

    def __call__(self, rng: np.random.Generator, index: int) -> Start:
        """Start number `index`."""
        stride_time = self.steps * self.params.step_length / self.speed
        guess, turns = random_guess(self.params, self.steps, stride_time, rng)
        objectives = [True] if self.regeneration else [True, False]
        problems = tuple(
            posed(self.problem, self.params, self.speed, turns, regeneration)
            for regeneration in objectives
        )
        return Start(guess, problems=problems, kind=str(turns))


def search_gaits(
    family: GaitFamily,
    starts: int,
    *,
    seed: int = 0,
    workers: int = 1,
    progress: bool = False,
) -> Search:
    """Local optima from random starts; their `kind` is the turns of theta per stride.

    Raises:
        Interrupted: see `trajopt.ocp.search.multi_start.multi_start`.
    """
    problem = family.problem
    mesh = Mesh.uniform(problem, SEARCH_ELEMENTS, SEARCH_DEGREE, control_degree=CONTROL_DEGREE)
    return multi_start(
        *(problem, family, starts),
        seed=seed,
        workers=workers,
        mesh=mesh,
        same=same_gait,
        progress=progress,
    )


def same_gait(one: Outcome, other: Outcome) -> bool:
    """Whether two are one gait, up to a shift by whole steps and to the mesh's accuracy."""
    mine, theirs = (sorted(p.duration for p in o.phases) for o in (one, other))
    return (
        one.kind == other.kind
        and math.isclose(one.cost, other.cost, rel_tol=1e-4, abs_tol=1e-4)
        and bool(np.allclose(mine, theirs, rtol=1e-2))
    )


def random_guess(
    params: WheelParams, steps: int, duration: float, rng: np.random.Generator
) -> tuple[Guess, int]:
    """A motion from one of several families, and its turns of theta per stride.

    The leg rocks back inside a step, or not; the pendulum hangs or stands, swings with the
    stride's harmonics, or turns over and over.
    """
    c = params.constants
    turns = int(rng.integers(0, 2) * rng.integers(-2 * steps, 2 * steps, endpoint=True))
    centre = rng.choice([0.0, 0.0, math.pi, rng.uniform(-math.pi, math.pi)])
    amplitudes = rng.uniform(0.0, 2.5 if turns == 0 else 1.0) * np.array(
        [1.0, rng.uniform(), 0.5 * rng.uniform()]
    )
    harmonics = rng.permutation([1, 2, 3]) * rng.choice([1, steps])
    lags = rng.uniform(0.0, 2 * math.pi, 3)
    rocking = rng.uniform(0.0, 0.6, steps) * rng.choice([0, 1])
    durations = rng.dirichlet(np.full(steps, rng.choice([3.0, 30.0]))) * duration
    s = np.linspace(0.0, 1.0, 41)
    phases, begin = [], 0.0
    for T, rock in zip(np.maximum(durations, 0.1), rocking, strict=True):
        t = s * T
        angle = 2 * math.pi * (begin + t)[:, None] / duration * harmonics + lags
        phi = np.clip(c.a + c.alpha * s + rock * np.sin(2 * math.pi * s), c.a, c.b)
        theta = centre + np.sin(angle) @ amplitudes + 2 * math.pi * turns * (begin + t) / duration
        x = np.stack([phi, theta, np.gradient(phi, t), np.gradient(theta, t)], axis=1)
        phases.append(polyline(t, x))
        begin += T
    return tuple(phases), turns
