import numpy as np
import pytest

from agents.evaluate import bootstrap_interval, interquartile_mean


def test_the_interquartile_mean_ignores_the_outer_quarters():
    assert interquartile_mean([-100, 1, 2, 3, 4, 5, 6, 100]) == pytest.approx(3.5)


def test_values_on_the_quartiles_count_in_part():
    # Of five values the middle half holds 2.5: the middle one, and three quarters of its neighbours
    assert interquartile_mean([0, 1, 2, 4, 50]) == pytest.approx((0.75 * 1 + 2 + 0.75 * 4) / 2.5)
    assert interquartile_mean([7.0]) == 7.0


def test_the_bootstrap_interval_covers_the_true_mean_about_as_often_as_it_says():
    rng = np.random.default_rng(1)
    covered = 0
    for trial in range(200):
        low, high = bootstrap_interval(rng.normal(3.0, 1.0, size=20), resamples=400, seed=trial)
        covered += low <= 3.0 <= high
    assert 0.87 <= covered / 200 <= 0.99


def test_seeds_are_resampled_within_each_task():
    # Two tasks far apart: resampling across them would scatter the mean by their distance.
    values = np.column_stack([np.zeros(8), np.full(8, 100.0)])
    assert bootstrap_interval(values) == (50.0, 50.0)


def test_the_same_values_give_the_same_interval():
    values = [0.1, 0.12, 0.11, 0.2]
    assert bootstrap_interval(values) == bootstrap_interval(values)


@pytest.mark.parametrize("values", [[], [1.0, np.nan], np.zeros((2, 2, 2))])
def test_missing_values_are_refused(values):
    with pytest.raises(ValueError, match="finite numbers"):
        interquartile_mean(values)
