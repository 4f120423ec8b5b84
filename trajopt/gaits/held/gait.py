"""The periodic gait of least cost under a held voltage, from a gait with a continuous one."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from rimless_gym.hybrid import Failure
from rimless_gym.params import WheelParams
from trajopt.gaits.held.program import Found, HeldProgram
from trajopt.gaits.held.recorded import recorded
from trajopt.gaits.held.replay import Held, Replay, repeating, replayed
from trajopt.gaits.held.stride import Stride
from trajopt.gaits.held.verified import verified
from trajopt.gaits.optimality import LocalOptimum, Optimality
from trajopt.gaits.solution import Solution
from trajopt.ocp.arrays import Array
from trajopt.provenance import provenance

#: Phases of the clock to start from, one after the other until one leads to an optimum: how much
#: of its interval lies before the first touchdown. All lead to about the same one, in which the
#: touchdowns come with the ticks: there the voltage of an optimum jumps.
SHARES = (0.02, 0.5, 0.98)

#: IPOPT's first barrier, and its iterations.
BARRIER, ITERATIONS = 1e-4, 300

#: By what fraction a neighbouring pattern must cost less, and how many are followed.
WORTHWHILE, MOST_MOVES = 1e-5, 10

#: Costs of local optima that differ by a smaller fraction are the same.
SAME_COST = 1e-4


def held_gait(
    lead: Solution,
    hold: float,
    ticks: int,
    regeneration: bool,
    settings: Mapping[str, object],
) -> tuple[Solution | None, list[str]]:
    """The held gait that the optimisation finds near another gait, verified; or None, and why.

    Args:
        lead: a gait of the same machine and number of steps, of about as many intervals.
        hold: s.
        ticks: intervals per stride.
        regeneration: whether the battery takes energy back.
        settings: of the search, for the provenance.
    """
    search = _Search(lead.params, lead.theta_turns, regeneration)
    for share in SHARES:
        search.solve(Stride.of_gait(lead, hold, ticks, share))
        if search.found:
            break
    search.descend()
    if search.best is None:
        return None, search.failures
    return _finished(search, settings)


class _Search:
    """Local optima of one stride, and where their touchdowns fall.

    Attributes:
        found: the local optima.
        failures: why others were not found.
    """

    def __init__(self, params: WheelParams, turns: int, regeneration: bool) -> None:
        self.params, self.turns, self.regeneration = params, turns, regeneration
        self.found: list[Found] = []
        self.failures: list[str] = []

    @property
    def best(self) -> Found | None:
        """The optimum that costs least."""
        return min(self.found, key=lambda found: found.energy, default=None)

    def solve(self, guess: Stride) -> None:
        """Look for an optimum near a guess."""
        program = HeldProgram(self.params, guess.pattern, self.turns, self.regeneration)
        found = program.solve(guess, mu_init=BARRIER, max_iter=ITERATIONS)
        if found.success:
            self.found.append(found)
        else:
            self.failures.append(f"{found.status} with the voltage held")

    def descend(self) -> None:
        """Move single touchdowns by an interval for as long as that saves energy."""
        tried = {found.stride.step_ticks for found in self.found}
        for _ in range(MOST_MOVES):
            best = self.best
            if best is None:
                return
            for guess in best.stride.neighbours():
                if guess.step_ticks not in tried:
                    tried.add(guess.step_ticks)
                    self.solve(guess)
            least = self.best
            if least is None or least.energy > best.energy - WORTHWHILE * abs(best.energy):
                return

    def optima(self, idle: float) -> tuple[LocalOptimum, ...]:
        """Costs of transport of the distinct optima, least first."""
        optima: list[LocalOptimum] = []
        for found in sorted(self.found, key=lambda found: found.energy):
            steps = found.stride.pattern.steps
            cot = (found.energy + idle) / (self.params.weight * steps * self.params.step_length)
            if optima and math.isclose(cot, optima[-1].cot, rel_tol=SAME_COST):
                optima[-1] = dataclasses.replace(optima[-1], found=optima[-1].found + 1)
            else:
                optima.append(LocalOptimum(cot, self.turns, 1))
        return tuple(optima)


def _finished(search: _Search, settings: Mapping[str, object]) -> tuple[Solution | None, list[str]]:
    """The best optimum as a gait: its states those of the kernel, verified."""
    assert search.best is not None
    stride, params = search.best.stride, search.params
    hold = stride.pattern.hold
    volts = representable(np.roll(stride.voltages, -1), params.voltage_limit)
    held = Held(params, hold, volts, search.turns)
    near = np.concatenate([phase.states[1:, 0] for phase in stride.phases])
    states = repeating(held, near)
    replay = replayed(held, states[0])
    obstacle = _obstacle(replay, stride)
    if obstacle:
        return None, [*search.failures, obstacle]
    phases = recorded(held, replay)
    error = np.abs(states - near).max() / (1.0 + np.abs(near).max())
    idle = params.idle_power * hold * stride.pattern.ticks
    gait = Solution(
        params=params,
        phases=phases,
        theta_turns=search.turns,
        regeneration=search.regeneration,
        verification=verified(held, replay, phases),
        optimality=Optimality(float(error), math.nan, math.nan),
        optima=search.optima(idle),
        provenance=provenance(**settings),
        hold=hold,
    )
    return gait, search.failures


def representable(voltages: Array, limit: float) -> Array:
    """The nearest voltages that are a float32 share of the limit, as the environment's actions."""
    return np.asarray(limit * np.float32(voltages / limit).astype(np.float64))


def _obstacle(replay: Replay, stride: Stride) -> str:
    """Why a stride on the kernel is not the one that was optimised; empty if it is."""
    if replay.failure != Failure.NONE:
        return f"{replay.failure.name.lower()} on the kernel"
    apart = (replay.touchdown_times >= 0.0).sum() == replay.touchdowns == stride.pattern.steps
    if not apart or replay.touchdown_times[-1] < 0.0:
        return f"{replay.touchdowns} touchdowns on the kernel, not {stride.pattern.steps}"
    return ""
