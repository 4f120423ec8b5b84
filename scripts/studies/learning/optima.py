"""The environment's own optimum at the speeds that were learned, solved once for all cells."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from concurrent.futures import as_completed
from pathlib import Path

from tqdm import tqdm

from agents.gaps import best_held, gap_to_gaits, ticks_around
from rimless_gym.params import WheelParams
from scripts.studies.learning.figures import Figures
from trajopt import Solution
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
        ticks = sorted({n for each in policies for n in ticks_around(params, each.speed)})
        self._gaits = _solved(params, ticks, folder / GAITS, workers)

    def gap(self, of: Figures) -> float | None:
        """CoT over the optimum at the same speed, minus 1; None without a walk or a gait."""
        around = ticks_around(self._params, of.speed)
        return gap_to_gaits(of.cot, of.speed, [self._gaits.get(n) for n in around])


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
