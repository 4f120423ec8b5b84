"""The study of a lower bound by a storage function."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from rimless_gym.equations import DOUBLE, SINGLE
from scripts.studies import bounds
from scripts.studies.bounds import PARAMS, Basis, C


def test_the_storage_function_is_one_at_rest_on_either_foot_and_its_gradients_are_right() -> None:
    basis, rng = Basis(4), np.random.default_rng(0)
    x = rng.normal(size=(4, 20)) + np.array([[math.pi / 2], [0], [0], [0]])
    for i, gradient in enumerate(basis.gradients(x)):
        step = 1e-6 * np.eye(4)[:, [i]]
        change = (basis.values(x + step) - basis.values(x - step)) / 2e-6
        assert np.allclose(gradient, change, atol=1e-6)
    rest = np.array([np.full(20, C.a), x[1], np.zeros(20), x[3]])
    other = rest.copy()
    other[0] = C.b
    assert np.allclose(basis.values(rest), basis.values(other))


def test_the_interior_point_is_near_the_optimum_and_admissible() -> None:
    rng = np.random.default_rng(0)
    a, b, cost = rng.normal(size=(200, 10)), rng.uniform(0.1, 1, 200), rng.normal(size=10)
    best = linprog(cost, A_ub=a, b_ub=b, bounds=(None, None)).fun
    y = bounds.interior_point(a, b, cost)
    assert np.all(a @ y <= b + 1e-5)
    assert best <= cost @ y <= best * (1 - 1.1 * bounds.GAP)


@pytest.mark.parametrize("mode", [SINGLE, DOUBLE])
def test_samples_lie_in_the_region_and_on_its_border(mode: int) -> None:
    x = bounds._states(mode, 500, np.random.default_rng(0))
    energy = bounds._eq.mechanical_energy(*x, C)
    low, high = bounds.REGION[[0, 2, 3]].T[:, :, None]
    assert np.all((low <= x[[0, 2, 3]]) & (x[[0, 2, 3]] <= high))
    assert np.all(energy <= bounds.ENERGY + 1e-9)
    assert np.isclose(energy, bounds.ENERGY).any()
    assert (x[0] == C.a).any()


@pytest.mark.parametrize("mode", [SINGLE, DOUBLE])
def test_no_admissible_voltage_violates_the_inequality_more_than_the_one_found(mode: int) -> None:
    basis, rng = Basis(3), np.random.default_rng(1)
    z = rng.normal(size=len(basis.powers)) / len(basis.powers)
    x = bounds._states(mode, 2_000, rng)
    _, found = bounds.least_margin(basis, mode, x, z, 0.04)
    tried = 0
    for volts in np.linspace(-PARAMS.voltage_limit, PARAMS.voltage_limit, 41):
        u = np.full(x.shape[1], volts)
        some = (bounds._limits(mode, x, u) >= 0.0).all(axis=0)
        rates = bounds._flow_rows(basis, mode, x, u)
        margin = rates @ np.append(z, [0.04, 1.0])
        assert np.all(found[some] <= margin[some] + 0.01 + 0.01 * np.abs(margin[some]))
        tried += some.sum()
    assert tried > 1_000
