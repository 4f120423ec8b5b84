"""The front of optimal cost of transport over speed."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from tqdm import tqdm

from rimless_gym.checks import flag, integer, positive, real_array
from rimless_gym.params import WheelParams
from rimless_gym.presets import Machine, as_params
from trajopt.gaits.front_files import Wanted, keep, kept
from trajopt.gaits.held.clock import held_speed
from trajopt.gaits.periodic import MOST_STEPS, NoGaitError, periodic_gait
from trajopt.gaits.resting import Rest, rests
from trajopt.gaits.shipped import by_promise, leads_for, shipped
from trajopt.gaits.solution import Solution
from trajopt.ocp.arrays import Array
from trajopt.ocp.ranking import clearly_less


@dataclasses.dataclass(frozen=True)
class CotFront:
    """Gaits over speed, and the lower envelope of their costs of transport.

    Attributes:
        solutions: every verified gait, in order of steps, then speed.
        missing: (steps, speed, why) where none was found.
    """

    solutions: tuple[Solution, ...]
    missing: tuple[tuple[int, float, str], ...] = ()

    @cached_property
    def envelope(self) -> tuple[Solution, ...]:
        """The best gait at each speed, in order of speed; of gaits that tie, the first."""
        best: dict[float, Solution] = {}
        for solution in self.solutions:
            speed = round(solution.speed, 9)
            if speed not in best or clearly_less(solution.cot, best[speed].cot):
                best[speed] = solution
        return tuple(best[speed] for speed in sorted(best))

    @cached_property
    def rests(self) -> tuple[Rest | None, ...]:
        """For every gait of the envelope what walking faster and resting in between would cost.

        None where walking on is no dearer. A bound: see `trajopt.gaits.resting`.
        """
        best, params = self.envelope, self.envelope[0].params
        speeds, cots = [s.speed for s in best], [s.cot for s in best]
        return rests(speeds, cots, params.weight, params.idle_power)

    def __call__(self, speed: ArrayLike) -> Array:
        """Optimal CoT at speed (m/s), linear between the gaits; of any shape.

        Raises:
            ValueError: outside the speeds that were solved for.
        """
        speeds = np.array([s.speed for s in self.envelope])
        wanted = real_array("speed", speed)
        inside = (wanted >= speeds[0] - 1e-9) & (wanted <= speeds[-1] + 1e-9)
        if not np.all(inside):
            raise ValueError(
                f"speed = {wanted}: the front was solved for {speeds[0]:.3f} to {speeds[-1]:.3f} "
                "m/s; pass cot_front speeds that enclose it"
            )
        return np.interp(wanted, speeds, [s.cot for s in self.envelope])


class NoFrontError(ValueError):
    """No gaits of this machine are shipped."""


def shipped_front(params: WheelParams) -> CotFront:
    """The shipped gaits of a machine without regeneration.

    Raises:
        NoFrontError: there are none.
    """
    found = tuple(
        gait
        for gait in shipped()
        if gait.params == params and not gait.regeneration and gait.verification.passed
    )
    if not found:
        raise NoFrontError(
            "no gaits of this machine are shipped: choose a preset that has a front, such as "
            "BUILDABLE, or search one with `rimless front`"
        )
    return CotFront(found)


def cot_front(
    params: Machine,
    speeds: Sequence[float],
    steps: Sequence[int] = (1, 2, 3),
    *,
    regeneration: bool = False,
    hold: float | None = None,
    folder: Path | None = None,
    progress: bool = False,
) -> CotFront:
    """The best gaits known at each of `speeds`, by continuation from their neighbours.

    With a `hold`, the gaits are those of `periodic_gait` with that hold, each led from one without
    it. Their speeds are those nearest to `speeds` at which a *step* lasts a whole number of
    periods, so that strides of any number of steps share them.

    Args:
        params: the machine, or a preset's name.
        speeds: m/s.
        steps: numbers of steps per stride to consider.
        regeneration: whether the battery takes energy back.
        hold: period of the clock between whose ticks the voltage is constant (s), or None.
        folder: where each gait is saved when it has been solved, and read from if it is there.
        progress: whether to show a progress bar.

    Raises:
        NoGaitError: no gait was found at any speed.
        TypeError: an argument is of the wrong type.
        ValueError: no speed or number of steps is given, or one is out of its range.
    """
    params = as_params(params)
    regeneration, progress = flag("regeneration", regeneration), flag("progress", progress)
    speeds = [positive("speeds", speed) for speed in _row("speeds", speeds)]
    steps = [integer("steps", count, 1, MOST_STEPS) for count in _row("steps", steps)]
    if hold is not None:
        hold = positive("hold", hold)
        speeds = sorted({held_speed(params, speed, 1, hold) for speed in speeds})
    solutions: list[Solution] = []
    missing: list[tuple[int, float, str]] = []
    bar = tqdm(total=len(steps) * len(speeds), desc="front", unit="gait", disable=not progress)
    for count in steps:
        own: list[Solution] = []
        held: list[Solution] = []
        for speed in _from_known_outwards(params, speeds, count):
            bar.set_postfix_str(f"{count} steps, {speed:g} m/s")
            wanted = Wanted(params, speed, count, regeneration)
            solution = _known(wanted, own, folder)
            if isinstance(solution, Solution):
                own.append(solution)
                if hold is not None:
                    solution = _known(wanted._replace(hold=hold), [solution], folder)
            if isinstance(solution, str):
                missing.append((count, speed, solution))
            elif hold is not None:
                held.append(solution)
            bar.update()
        solutions += sorted(own if hold is None else held, key=lambda s: s.speed)
    bar.close()
    verified = tuple(s for s in solutions if s.verification.passed)
    for s in solutions:
        if not s.verification.passed:
            missing.append((s.steps, s.speed, "; ".join(s.verification.failures)))
    if not verified:
        raise NoGaitError("\n".join(why for _, _, why in missing))
    return CotFront(verified, tuple(missing))


def _row(name: str, values: Any) -> list[Any]:
    """The numbers of a sequence with at least one."""
    array = real_array(name, values)
    if array.ndim != 1 or not len(array):
        raise ValueError(f"{name} = {values!r}: must be a sequence of one or more numbers")
    return list(array.tolist())


def _known(wanted: Wanted, own: Sequence[Solution], folder: Path | None) -> Solution | str:
    """A gait, or why there is none: from the folder if it is there, else solved and kept there."""
    found = None if folder is None else kept(folder, wanted)
    if found is None:
        found = _best_of(wanted, own) if wanted.hold is None else _held(wanted, own[0])
        if folder is not None:
            keep(folder, wanted, found)
    return found


def _held(wanted: Wanted, lead: Solution) -> Solution | str:
    """A gait under a clock, led from one without; or why there is none."""
    params, speed, steps, regeneration, hold = wanted
    try:
        return periodic_gait(params, speed, steps, regeneration, hold=hold, guess=lead)
    except NoGaitError as error:
        return str(error)


def _best_of(wanted: Wanted, own: Sequence[Solution]) -> Solution | str:
    """A gait led from the most promising known one; or why there is none.

    Known are the shipped gaits and those already on this front.
    """
    params, speed, steps, regeneration, _ = wanted
    known = [s for s in [*leads_for(params, speed, steps), *own] if s.params == params]
    guess = next(iter(by_promise(known, params, speed)), None)
    try:
        return periodic_gait(params, speed, steps, regeneration, guess=guess)
    except NoGaitError as error:
        return str(error)


def _from_known_outwards(params: WheelParams, speeds: Sequence[float], steps: int) -> list[float]:
    known = [s.speed for s in leads_for(params, float(np.mean(speeds)), steps)]
    centre = known[0] if known else float(np.mean(speeds))
    # Rounded, so that of two speeds equally far from the centre the slower comes first.
    return sorted(map(float, speeds), key=lambda speed: (round(abs(speed - centre), 6), speed))
