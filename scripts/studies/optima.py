"""The environment's own optimum at the speeds that were learned, solved once for all cells."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from concurrent.futures import as_completed
from pathlib import Path

from tqdm import tqdm

from agents.comparison.entrants import FRONT_STEPS
from agents.comparison.report import gap_to_front
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from scripts.studies.figures import Figures
from trajopt import NoGaitError, Solution
from trajopt.gaits.fronts import CotFront, cot_front
from trajopt.processes import pool

#: The folder of the gaits, in that of the study.
GAITS = "front"


class Optima:
    """The best held gaits around the speeds of some policies.

    A step of a held gait lasts a whole number of control intervals. At the two such speeds around
    a policy's, the best gaits of 1 to 3 steps per stride are solved, in the folder of the study,
    from which they are read the next time.

    Args:
        params: the machine.
        policies: whose gaps are wanted.
        folder: of the study.
        workers: processes.
    """

    def __init__(
        self, params: WheelParams, policies: Iterable[Figures], folder: Path, workers: int
    ) -> None:
        self._params = params
        ticks = sorted({n for each in policies for n in self._around(each.speed)})
        self._gaits = _solved(params, ticks, folder / GAITS, workers)

    def gap(self, of: Figures) -> float | None:
        """CoT over the optimum at the same speed, minus 1; None without a walk or a gait."""
        around = [self._gaits.get(n) for n in self._around(of.speed)]
        gaits = [gait for gait in around if gait is not None]
        if len(gaits) < 2:
            return None
        return gap_to_front(of.cot, of.speed, CotFront(tuple(gaits)))

    def _around(self, speed: float | None) -> tuple[int, ...]:
        """Control intervals of a step, faster and slower than at a speed; none without one."""
        if speed is None or not speed > 0.0:
            return ()
        fewest = math.floor(self._params.step_length / (speed * CONTROL_PERIOD))
        return fewest, fewest + 1


def _solved(
    params: WheelParams, ticks: list[int], folder: Path, workers: int
) -> dict[int, Solution | None]:
    if not ticks:
        return {}
    found: dict[int, Solution | None] = {}
    with tqdm(total=len(ticks), desc="optimal gaits", file=sys.stderr) as bar:
        if workers == 1 or len(ticks) == 1:
            for n in ticks:
                found[n] = best_held(params, n, folder)
                bar.update()
            return found
        with pool(workers) as submit:
            futures = {submit(best_held, params, n, folder): n for n in ticks}
            for future in as_completed(futures):
                found[futures[future]] = future.result()
                bar.update()
    return found


def best_held(params: WheelParams, ticks: int, folder: Path) -> Solution | None:
    """The best gait whose steps last so many control intervals; None if there is none.

    It has as many steps per stride as the best one with a continuous voltage.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if ticks < 2:
        return None
    speed = params.step_length / (ticks * CONTROL_PERIOD)
    try:
        free = cot_front(params, [speed], FRONT_STEPS, folder=folder)
        steps = [gait.steps for gait in free.envelope]
        held = cot_front(params, [speed], steps, hold=CONTROL_PERIOD, folder=folder)
    except NoGaitError:
        return None
    return held.envelope[0]
