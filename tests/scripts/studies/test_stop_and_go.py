"""Walks from rest to rest."""

from __future__ import annotations

import numpy as np
import pytest

from agents.experts import EXPERT_SPEED
from agents.rollout import at_rest
from rimless_gym import BUILDABLE
from rimless_gym.energy import ROW, Ledger
from rimless_gym.equations import SINGLE
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import FOOT, THETA, hybrid_states
from scripts.studies import stop_and_go as study
from trajopt import periodic_gait
from trajopt.feedback.law import Floats
from trajopt.gaits.fronts import shipped_front


def from_rest(states: Floats) -> Floats:
    """How far wheels are from where a cycle begins, whatever the foot and the turns, (N, 6)."""
    away = states - at_rest(BUILDABLE)
    away[:, THETA] = np.remainder(away[:, THETA] + np.pi, 2 * np.pi) - np.pi
    away[:, FOOT] = 0.0
    return away


def test_a_short_circuited_wheel_comes_to_rest_and_its_energies_add_up() -> None:
    gait = min(shipped_front(BUILDABLE).envelope, key=lambda gait: gait.cot)
    times = gait.duration * np.linspace(0.1, 0.9, 5)
    after, moving, sums = study.stopped(BUILDABLE, hybrid_states(gait.state(times), SINGLE))
    rests = np.flatnonzero(np.isfinite(moving))  # where no foot lifts or slips
    assert len(rests) >= 2
    assert np.abs(from_rest(after[rests])).max() < 2 * study.REST
    for i in rests:
        ledger = Ledger.from_rows(sums[i], BUILDABLE)
        assert ledger.time == pytest.approx(moving[i])
        assert ledger.residual == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
def test_a_cycle_repeats_itself() -> None:
    gait = periodic_gait(BUILDABLE, EXPERT_SPEED, hold=CONTROL_PERIOD)
    controller, start, energies = study.efficient(gait), at_rest(BUILDABLE), list[float]()
    for _ in range(2):
        states, rows = study.walk(controller, start, 20)
        after, moving, sums = study.stopped(BUILDABLE, states[-1:])
        assert np.isfinite(moving).all()
        energies.append(rows[:, ROW.electrical_positive].sum() + sums[0, ROW.electrical_positive])
        start = after[0]
        start[FOOT] = 0.0
    assert energies[1] == pytest.approx(energies[0], rel=1e-4)
