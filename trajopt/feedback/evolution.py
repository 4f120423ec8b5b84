"""Evolution: numbers of little loss, found by trying generations of candidates (CMA-ES).

Hansen, The CMA evolution strategy: a tutorial, arXiv:1604.00772.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from tqdm import tqdm

from rimless_gym.checks import extra
from trajopt.feedback.law import Floats
from trajopt.processes import cores

with extra("learn"):
    import cma


def evolved(
    loss: Callable[[Floats], float],
    count: int,
    spread: float,
    generations: int,
    seed: int,
    progress: bool,
) -> Floats:
    """The numbers (count,) of the least loss that CMA-ES finds from zero.

    Args:
        loss: of numbers.
        count: how many there are.
        spread: standard deviation of the first generation.
        generations: how many follow each other.
        seed: of the evolution.
        progress: whether to show a progress bar.
    """
    rng = np.random.default_rng(seed)
    options = {
        "CMA_diagonal": True,  # too few generations for a full covariance
        "randn": lambda *shape: rng.standard_normal(shape),
        "seed": np.nan,  # numpy's global generator stays as it is
        "verbose": -9,
    }
    strategy = cma.CMAEvolutionStrategy(count * [0.0], spread, options)
    best, least = np.zeros(count), loss(np.zeros(count))
    with (
        ThreadPoolExecutor(cores()) as threads,
        tqdm(total=generations, desc="tune", unit="generation", disable=not progress) as bar,
    ):
        for _ in range(generations):
            candidates = strategy.ask()
            losses = list(threads.map(loss, candidates))
            strategy.tell(candidates, losses)
            first = int(np.argmin(losses))
            if losses[first] < least:
                best, least = np.array(candidates[first]), losses[first]
            bar.set_postfix(loss=f"{least:.4f}")
            bar.update()
    return best
