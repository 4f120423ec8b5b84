"""Random starts for gaits: motions of several kinds of the leg and the pendulum."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from rimless_gym.params import WheelParams
from trajopt.gaits.problem import CONTROL_DEGREE, gait_problem, posed
from trajopt.ocp.guesses import Guess, polyline
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.multi_start import Outcome, Search, Start, multi_start
from trajopt.ocp.problem import Problem

#: A mesh fine enough to tell good optima from bad ones; the best are refined.
SEARCH_ELEMENTS, SEARCH_DEGREE = 14, 4


@dataclasses.dataclass(frozen=True)
class GaitFamily:
    """Starts of gaits. Each is solved with regeneration first, where the landscape is smoother.

    Attributes:
        params: the machine.
        speed: m/s.
        steps: per stride.
        regeneration: whether the final objective is E, not E+.
        problem: one problem of the family; those of all starts share its functions, in other
            processes too.
    """

    params: WheelParams
    speed: float
    steps: int
    regeneration: bool
    problem: Problem

    @classmethod
    def create(
        cls, params: WheelParams, speed: float, steps: int, regeneration: bool
    ) -> GaitFamily:
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
    """Local optima from random starts; their `kind` is the number of turns of theta per stride.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed.
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
    """Whether two outcomes are one gait, to the mesh's accuracy, whichever step comes first."""
    mine, theirs = (sorted(p.duration for p in o.phases) for o in (one, other))
    return (
        one.kind == other.kind
        and math.isclose(one.cost, other.cost, rel_tol=1e-4, abs_tol=1e-4)
        and bool(np.allclose(mine, theirs, rtol=1e-2))
    )


def random_guess(
    params: WheelParams, steps: int, duration: float, rng: np.random.Generator
) -> tuple[Guess, int]:
    """A random motion, and its number of turns of theta per stride; see `random_motion`."""
    turns = int(rng.integers(0, 2) * rng.integers(-2 * steps, 2 * steps, endpoint=True))
    return random_motion(params, steps, duration, turns, rng), turns


def random_motion(
    params: WheelParams, steps: int, duration: float, turns: int, rng: np.random.Generator
) -> Guess:
    """A random motion of a stride with so many turns of theta.

    The leg may rock back inside a step; the pendulum hangs or stands, swings with the stride's
    harmonics, or turns over and over.

    Args:
        params: the machine.
        steps: per stride.
        duration: of the stride (s).
        turns: whole turns of theta in the stride.
        rng: what is random is drawn from it.
    """
    c = params.constants
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
    return tuple(phases)
