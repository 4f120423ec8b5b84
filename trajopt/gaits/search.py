"""The search for gaits of any machine: known gaits of other machines, and random motions."""

from __future__ import annotations

import dataclasses
import itertools
import math
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from rimless_gym.params import WheelParams
from trajopt.gaits.bounds import cot_bound, motor_deficit
from trajopt.gaits.library import gaits_around, repeated_phases
from trajopt.gaits.problem import CONTROL_DEGREE, gait_problem, posed
from trajopt.ocp.guesses import Guess, polyline
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.multi_start import Outcome, Search, Start, multi_start
from trajopt.ocp.problem import Problem

#: A mesh fine enough to tell good optima from bad ones; the best are refined. A slow step has as
#: many elements as make them no longer than `ELEMENT_TIME` (s), but at most `MOST_ELEMENTS`.
SEARCH_ELEMENTS, SEARCH_DEGREE = 14, 4
ELEMENT_TIME, MOST_ELEMENTS = 0.05, 40

#: IPOPT's iterations for a problem (starts that take more rarely become gaits), and its first
#: barrier where a start is a gait of another machine or speed.
ITERATIONS, KNOWN_BARRIER = 100, 1e-3

#: Most whole turns of theta per step, either way, in one round of random motions after another. A
#: round makes one motion of each number. Few turns have more optima, and more that are good.
MOST_TURNS = (8, 1, 2, 1, 4, 1, 2, 1)

#: Shipped gaits of each machine and number of turns from which a search starts; and optima of one
#: step, which a stride may repeat.
SHIPPED, SHORTER = 3, 3

#: A start: the turns of theta in a stride, and a known gait with as many; None for a random motion.
GaitStart: TypeAlias = tuple[int, Guess | None]


@dataclasses.dataclass(frozen=True)
class GaitFamily:
    """Starts of gaits: known gaits of any machine with as many steps, and random motions.

    A random motion is solved with regeneration first, where the landscape is smoother: ten times as
    many become gaits.
    """

    params: WheelParams  # the machine
    speed: float  # m/s
    regeneration: bool  # whether the final objective is E, not E+
    # one problem of the family; those of all starts share its functions, in other processes too
    problem: Problem
    starts: tuple[GaitStart, ...] = ()  # in order

    def __call__(self, rng: np.random.Generator, index: int) -> Start:
        """Start number `index`."""
        turns, guess = self.starts[index]
        final = self._posed(turns, self.regeneration)
        if guess is not None:
            return Start(guess, None, (final,), str(turns), {"mu_init": KNOWN_BARRIER})
        steps = len(self.problem.phases)
        guess = random_motion(
            self.params, steps, steps * self.params.step_length / self.speed, turns, rng
        )
        problems = (final,) if self.regeneration else (self._posed(turns, True), final)
        return Start(guess, None, problems, str(turns))

    def _posed(self, turns: int, regeneration: bool) -> Problem:
        return posed(self.problem, self.params, self.speed, turns, regeneration)


def search_gaits(
    params: WheelParams,
    speed: float,
    steps: int,
    regeneration: bool = False,
    *,
    starts: int,
    shipped: int = SHIPPED,
    seed: int = 0,
    workers: int = 1,
    progress: bool = True,
) -> Search:
    """Local optima from known gaits and random motions; their `kind` is the turns of a stride.

    No start has turns for which the motor is too weak, and no random one turns whose lower bound
    exceeds the cost of the best gait from a known start, whose turns half of the random ones have.

    Args:
        params: the machine.
        speed: m/s.
        steps: per stride.
        regeneration: whether the objective is E, not E+.
        starts: random ones, in addition to the shipped gaits nearby, and for a stride of several
            steps to the best strides of one step, which are searched for first.
        shipped: how many of those gaits of each machine and number of turns, the nearest in speed.
        seed: of the random starts.
        workers: processes.
        progress: whether to show a bar on a terminal.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed.
    """
    settings: dict[str, Any] = {"seed": seed, "workers": workers, "progress": progress}
    possible = possible_turns(params, speed, steps)
    likely: list[GaitStart] = [
        (gait.theta_turns, gait.phases)
        for gait in gaits_around(speed, steps, shipped)
        if gait.theta_turns in possible
    ]
    if steps > 1:
        one_step: dict[str, Any] = {"starts": starts, "shipped": shipped, **settings}
        single = search_gaits(params, speed, 1, regeneration, **one_step)
        for optimum in single.optima[:SHORTER]:
            gained = int(optimum.best.kind)
            phases = repeated_phases(optimum.phases, gained, steps)
            likely.append((steps * gained, phases))
    problem = gait_problem(params, speed=speed, steps=steps, regeneration=regeneration)
    needed = math.ceil(params.step_length / speed / ELEMENT_TIME)
    elements = min(max(SEARCH_ELEMENTS, needed), MOST_ELEMENTS)
    settings |= {
        "mesh": Mesh.uniform(problem, elements, SEARCH_DEGREE, control_degree=CONTROL_DEGREE),
        "same": same_gait,
        "unit": ("CoT", params.weight * steps * params.step_length),
        "max_iter": ITERATIONS,
    }
    family = GaitFamily(params, speed, regeneration, problem, tuple(likely))
    known = multi_start(problem, family, len(likely), **settings)
    least = min((optimum.cost / known.unit[1] for optimum in known.optima), default=math.inf)
    bound = partial(cot_bound, params, speed=speed, steps=steps, regeneration=regeneration)
    better = [turns for turns in possible if bound(theta_turns=turns) < least]
    rounds = [(k, None) for most in MOST_TURNS for k in better if abs(k) <= most * steps]
    if known.optima:  # half of the random starts are in the family of the best known gait
        best = int(known.optima[0].best.kind)
        rounds = [each for other in rounds for each in ((best, None), other)]
    random = itertools.islice(itertools.cycle(rounds), starts)
    family = dataclasses.replace(family, starts=(*likely, *random))
    return multi_start(problem, family, len(family.starts), earlier=known.outcomes, **settings)


def possible_turns(params: WheelParams, speed: float, steps: int) -> tuple[int, ...]:
    """Whole turns of theta per stride for which the motor is strong enough, fewest first."""
    most = max(MOST_TURNS) * steps
    outwards = sorted(range(-most, most + 1), key=lambda turns: (abs(turns), turns))
    return tuple(k for k in outwards if motor_deficit(params, speed, k / steps) <= 0)


def same_gait(one: Outcome, other: Outcome) -> bool:
    """Whether two outcomes are one gait, to the mesh's accuracy, whichever step comes first."""
    mine, theirs = (sorted(p.duration for p in o.phases) for o in (one, other))
    return (
        one.kind == other.kind
        and math.isclose(one.cost, other.cost, rel_tol=1e-4, abs_tol=1e-4)
        and bool(np.allclose(mine, theirs, rtol=1e-2))
    )


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
