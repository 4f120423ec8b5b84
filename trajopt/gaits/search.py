"""Multi-start: many local optima lie about, and nothing but trying finds the good ones."""

from __future__ import annotations

import dataclasses
import math
import signal
from collections.abc import Sequence
from multiprocessing import get_context
from typing import Any

import numpy as np
from tqdm import tqdm

from rimless_gym.params import WheelParams
from trajopt.gaits.stance import CONTROL_DEGREE, gait_problem
from trajopt.guesses import polyline
from trajopt.mesh import Mesh
from trajopt.nlp import Result, Transcription
from trajopt.trajectory import PhaseTrajectory

#: Enough to tell good optima from bad ones; winners are refined.
SEARCH_ELEMENTS, SEARCH_DEGREE = 14, 4


@dataclasses.dataclass(frozen=True)
class Candidate:
    """A local optimum on the mesh it was found on.

    Attributes:
        phases: the trajectory.
        theta_turns: whole turns of theta per stride.
        cost: of the stride (J), as the transcription sees it.
        found: how many starts led here.
    """

    phases: tuple[PhaseTrajectory, ...]
    theta_turns: int
    cost: float
    found: int = 1

    def same_as(self, other: Candidate) -> bool:
        """Whether both are one gait, up to a shift by whole steps and to the mesh's accuracy."""
        mine, theirs = (sorted(p.duration for p in c.phases) for c in (self, other))
        return (
            self.theta_turns == other.theta_turns
            and math.isclose(self.cost, other.cost, rel_tol=1e-4, abs_tol=1e-4)
            and bool(np.allclose(mine, theirs, rtol=1e-2))
        )


def random_guess(
    params: WheelParams, steps: int, duration: float, rng: np.random.Generator
) -> tuple[tuple[PhaseTrajectory, ...], int]:
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


class Search:
    """Local optimisation of gaits of `steps` steps from given or random guesses."""

    def __init__(
        self, params: WheelParams, speed: float, steps: int, regeneration: bool, seed: int
    ) -> None:
        self.params, self.speed, self.steps = params, speed, steps
        self.regeneration, self.seed = regeneration, seed
        problem = gait_problem(params, speed=speed, steps=steps)
        mesh = Mesh.uniform(steps, SEARCH_ELEMENTS, SEARCH_DEGREE, control_degree=CONTROL_DEGREE)
        self.transcription = Transcription(problem, mesh)

    def from_random(self, index: int) -> tuple[Candidate | None, Result]:
        """Start `index` of the seed: with regeneration first, whose landscape is smoother."""
        rng = np.random.default_rng([self.seed, index])
        duration = self.steps * self.params.step_length / self.speed
        guess, turns = random_guess(self.params, self.steps, duration, rng)
        return self.from_guess(guess, turns, via_regeneration=True)

    def from_guess(
        self,
        guess: Sequence[PhaseTrajectory],
        turns: int,
        *,
        via_regeneration: bool = False,
        **options: Any,
    ) -> tuple[Candidate | None, Result]:
        """The local optimum near `guess`, or None, and IPOPT's last word."""
        both = [True, False] if via_regeneration and not self.regeneration else [self.regeneration]
        for regeneration in both:
            problem = gait_problem(
                self.params,
                speed=self.speed,
                steps=self.steps,
                theta_turns=turns,
                regeneration=regeneration,
            )
            result = self.transcription.solve(guess, problem, **{"max_iter": 300} | options)
            guess = result.phases
        if not result.success:
            return None, result
        return Candidate(result.phases, turns, result.cost), result


def distinct(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Different optima, best first, with how often each was found."""
    kept: list[Candidate] = []
    for candidate in sorted(candidates, key=lambda c: c.cost):
        for i, other in enumerate(kept):
            if candidate.same_as(other):
                kept[i] = dataclasses.replace(other, found=other.found + candidate.found)
                break
        else:
            kept.append(candidate)
    return kept


def multi_start(
    params: WheelParams,
    *,
    speed: float,
    steps: int,
    regeneration: bool = False,
    starts: int = 20,
    seed: int = 0,
    workers: int = 1,
    progress: bool = False,
) -> tuple[list[Candidate], list[Result]]:
    """Distinct local optima from `starts` random guesses, best first, and what failed.

    The same seed gives the same starts whatever the number of workers.
    """
    arguments = (params, speed, steps, regeneration, seed)
    bar = tqdm(total=starts, desc="starts", unit="start", disable=not progress)
    outcomes: list[tuple[Candidate | None, Result]] = []
    if workers == 1:
        search = Search(*arguments)
        for index in range(starts):
            outcomes.append(search.from_random(index))
            bar.update()
    else:
        # Leaving the block terminates the workers: Ctrl-C need not wait for them.
        with get_context("spawn").Pool(workers, _start_worker, arguments) as pool:
            for outcome in pool.imap(_work, range(starts)):
                outcomes.append(outcome)
                bar.update()
    bar.close()
    found = [candidate for candidate, _ in outcomes if candidate is not None]
    return distinct(found), [result for candidate, result in outcomes if candidate is None]


_worker: Search


def _start_worker(*arguments: Any) -> None:
    global _worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent
    _worker = Search(*arguments)


def _work(index: int) -> tuple[Candidate | None, Result]:
    return _worker.from_random(index)
