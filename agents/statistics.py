"""Averages over seeds that a single lucky seed does not move."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def _scores(values: ArrayLike) -> NDArray[np.float64]:
    scores = np.asarray(values, dtype=np.float64)
    if scores.ndim == 1:
        scores = scores[:, np.newaxis]
    if scores.ndim != 2 or scores.size == 0 or not np.isfinite(scores).all():
        raise ValueError(
            f"values = {values!r}: give finite numbers of shape (seeds,) or (seeds, tasks); "
            "leave out seeds that do not walk, and report their share"
        )
    return scores


def _trimmed_mean(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean of the middle half along the last axis; values at its ends count in part."""
    n = scores.shape[-1]
    weights = np.clip(np.minimum(np.arange(1, n + 1) - n / 4, 3 * n / 4 - np.arange(n)), 0, 1)
    return np.sort(scores, axis=-1) @ weights / weights.sum()


def interquartile_mean(values: ArrayLike) -> float:
    """Mean of the middle half of `values`, (seeds,) or (seeds, tasks).

    Raises:
        ValueError: there are none, or one is not finite.
    """
    return float(_trimmed_mean(_scores(values).ravel()))


def bootstrap_interval(
    values: ArrayLike, resamples: int = 10_000, seed: int = 0
) -> tuple[float, float]:
    """95 % percentile interval of the interquartile mean, seeds resampled within each task.

    Args:
        values: (seeds,) or (seeds, tasks).
        resamples: number of bootstrap samples.
        seed: of the resampling.

    Raises:
        ValueError: values are missing or not finite.
    """
    scores = _scores(values)
    n_seeds, n_tasks = scores.shape
    picks = np.random.default_rng(seed).integers(n_seeds, size=(resamples, n_seeds, n_tasks))
    drawn = scores[picks, np.arange(n_tasks)].reshape(resamples, -1)
    low, high = np.quantile(_trimmed_mean(drawn), [0.025, 0.975])
    return float(low), float(high)
