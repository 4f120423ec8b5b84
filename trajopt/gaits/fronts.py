"""The front of optimal cost of transport over speed."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rimless_gym.checks import flag, integer, positive, real_array
from rimless_gym.params import WheelParams
from rimless_gym.presets import Machine, as_params
from trajopt.gaits.held_stride import held_speed
from trajopt.gaits.library import Entry, candidates, ranked, shipped
from trajopt.gaits.periodic import MOST_STEPS, NoGaitError, periodic_gait
from trajopt.gaits.solution import Solution
from trajopt.ocp.arrays import Array
from trajopt.ocp.ranking import clearly_less
from trajopt.pool import progress_bar
from trajopt.store import Store, key


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
    """The shipped gaits of a machine without regeneration and without stops on two feet.

    Raises:
        NoFrontError: there are none.
    """
    gaits = tuple(
        gait
        for gait in shipped(params)
        if not (gait.regeneration or gait.double_stance) and gait.verification.passed
    )
    if not gaits:
        raise NoFrontError(
            "no gaits of this machine are shipped: choose a preset that has a front, such as "
            "BUILDABLE, or compute one with `trajopt.cot_front`"
        )
    return CotFront(gaits)


def cot_front(
    params: Machine,
    speeds: Sequence[float],
    steps: Sequence[int] = (1, 2, 3),
    *,
    regeneration: bool = False,
    hold: float | None = None,
    folder: Path | None = None,
    progress: bool = True,
) -> CotFront:
    """The best gaits known at each of `speeds`, by continuation from their neighbours.

    A stride is left out where the most promising shipped gait repeats one of fewer steps, which is
    asked for as well: solved again, it would be the same gait.

    With a `hold`, the gaits are those of `periodic_gait` with that hold, each continued from one
    without it. Their speeds are those nearest to `speeds` at which a *step* lasts a whole number of
    periods, so that strides of any number of steps share them.

    Args:
        params: the machine, or a preset's name.
        speeds: m/s.
        steps: numbers of steps per stride to consider.
        regeneration: whether the battery takes energy back.
        hold: period of the clock between whose ticks the voltage is constant (s), or None.
        folder: where each gait is saved when it has been solved, and read from if it is there.
        progress: whether to show a progress bar on a terminal.

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
    bar = progress_bar("front", progress, total=len(steps) * len(speeds), unit="gait")
    for count in steps:
        free: list[Solution] = []
        held: list[Solution] = []
        for speed in _from_known_outwards(params, speeds, count):
            bar.update()
            if _repeats(params, speed, count, steps):
                continue
            bar.set_postfix_str(f"{count} steps, {speed:g} m/s")
            wanted = Wanted(params, speed, count, regeneration)
            gait = solved(wanted, free, folder)
            if isinstance(gait, Solution):
                free.append(gait)
                if hold is not None:
                    gait = solved(wanted._replace(hold=hold), [gait], folder)
            if isinstance(gait, str):
                missing.append((count, speed, gait))
            elif hold is not None:
                held.append(gait)
        solutions += sorted(free if hold is None else held, key=lambda s: s.speed)
    bar.close()
    verified = tuple(s for s in solutions if s.verification.passed)
    for s in solutions:
        if not s.verification.passed:
            missing.append((s.steps, s.speed, "; ".join(s.verification.failures)))
    if not verified:
        raise NoGaitError("\n".join(why for _, _, why in missing))
    return CotFront(verified, tuple(missing))


def _repeats(params: WheelParams, speed: float, count: int, steps: Sequence[int]) -> bool:
    """Whether the best guess for a stride is a shorter one, repeated, that is asked for as well."""
    known = candidates(params, speed, count)
    return bool(known) and known[0].repeated > 1 and count // known[0].repeated in steps


def _row(name: str, values: Any) -> list[Any]:
    """The numbers of a sequence with at least one."""
    array = real_array(name, values)
    if array.ndim != 1 or not len(array):
        raise ValueError(f"{name} = {values!r}: must be a sequence of one or more numbers")
    return list(array.tolist())


class Wanted(NamedTuple):
    """A gait of a front: the arguments of `periodic_gait`."""

    params: WheelParams
    speed: float
    steps: int
    regeneration: bool
    hold: float | None = None


def front_file(steps: int, speed: float, hold: float | None = None) -> str:
    """The name of the file of a gait of a front."""
    clock = "" if hold is None else f"_hold_{hold:g}"
    return f"front_{steps}_steps_{speed:g}{clock}.npz"


def solved(wanted: Wanted, known: Sequence[Solution], folder: Path | None) -> Solution | str:
    """A gait, or why there is none: read from the folder if it is there, else solved and saved.

    Args:
        wanted: the gait.
        known: gaits of this front to continue from.
        folder: of the front, if it has one.
    """
    if folder is None:
        return _found(wanted, known)
    store, file = Store(folder), front_file(wanted.steps, wanted.speed, wanted.hold)
    task = key(Path(file).stem, **wanted._asdict())
    if task in store:
        return str(store.load(task)) or Solution.load(folder / file)
    gait = _found(wanted, known)
    if isinstance(gait, str):
        store.save(task, gait)
    else:
        gait.save(folder / file)
        store.save(task, "", [file])
    return gait


def _found(wanted: Wanted, known: Sequence[Solution]) -> Solution | str:
    """A gait continued from the most promising known one, or why there is none.

    A held gait is continued from the free one of its speed, the only one in `known`. Others may be
    continued from shipped gaits, too.
    """
    params, speed, steps, regeneration, hold = wanted
    entries = [] if hold else candidates(params, speed, steps)
    gaits: list[Entry | Solution] = [*entries, *known]
    best = next(iter(ranked(gaits, speed)), None)
    guess = best.load() if isinstance(best, Entry) else best
    try:
        return periodic_gait(
            *(params, speed, steps, regeneration), hold=hold, guess=guess, progress=False
        )
    except NoGaitError as error:
        return str(error)


def _from_known_outwards(params: WheelParams, speeds: Sequence[float], steps: int) -> list[float]:
    centre = float(np.mean(speeds))
    known = candidates(params, centre, steps)
    centre = known[0].speed if known else centre
    # Rounded, so that of two speeds equally far from the centre the slower comes first.
    return sorted(map(float, speeds), key=lambda speed: (round(abs(speed - centre), 6), speed))
