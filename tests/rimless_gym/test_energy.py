"""The table of energies: every channel is accounted, reported and documented under its name."""

from __future__ import annotations

import re

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL, RimlessWheelEnv, hybrid
from rimless_gym.energy import ACCOUNTED, CHANNELS, ROW, Ledger, balance
from rimless_gym.envs.task import TERM_NAMES
from rimless_gym.equations import LOSSES, SINGLE
from rimless_gym.kernel.stepping import STATE_SIZE, advance

LOSSY = THESIS_PHYSICAL.replace(
    hub_damping=0.05,
    drag=0.5,
    pendulum_drag=0.02,
    hub_friction=0.1,
    gear_loss=0.2,
    rotor_inertia=1e-7,
)


@pytest.mark.parametrize("name", LOSSES)
def test_a_loss_takes_energy_at_every_speed_and_voltage(name: str) -> None:
    rng = np.random.default_rng(0)
    for dphi, dpsi, ddpsi, u in rng.uniform(-20, 20, (200, 4)):
        assert getattr(hybrid.losses(dphi, dpsi, ddpsi, u, LOSSY.constants), name) > 0
    assert getattr(hybrid.losses(0.0, 0.0, 0.0, 0.0, LOSSY.constants), name) == 0


@pytest.mark.parametrize("name", LOSSES)
def test_the_loss_is_the_integral_of_its_power(name: str) -> None:
    p, u = LOSSY.constants, 3.0
    state = np.array([[1.5, 0.4, 0.8, -2.0, 0.0, 0.0]])
    powers, total = [], 0.0
    for _ in range(200):
        phi, theta, dphi, dtheta = state[0, :4]
        ddpsi = hybrid.relative_rate(
            *hybrid.accelerations(SINGLE, phi, theta, dphi, dtheta, u, p), p
        )
        dpsi = hybrid.relative_rate(dphi, dtheta, p)
        powers.append(getattr(hybrid.losses(dphi, dpsi, ddpsi, u, p), name))
        total += advance(LOSSY, state, np.full(1, u), 1e-4)[0, getattr(ROW, name)]
    assert total == pytest.approx(1e-4 * sum(powers), rel=0.01)


def test_every_channel_and_term_is_measured_and_in_the_documentation() -> None:
    env = RimlessWheelEnv(LOSSY)
    env.reset(seed=0)
    env.step(np.zeros(1, np.float32))
    info = env.measurements
    page = RimlessWheelEnv.__doc__ or ""
    for name in (*(channel.name for channel in CHANNELS), *TERM_NAMES):
        assert name in info
        assert name in page
    assert abs(sum(balance(info))) < 1e-12


def test_every_measurement_is_in_the_documentation() -> None:
    env = RimlessWheelEnv()
    words = set(re.findall(r"\w+", env.__doc__ or ""))
    assert [name for name in env.measurements if name not in words] == []


def test_the_ledger_has_every_channel_that_the_kernel_accounts() -> None:
    states = np.zeros((1, STATE_SIZE))
    states[0, 0] = 1.5
    ledger = Ledger.from_rows(advance(LOSSY, states, np.full(1, 3.0))[0], LOSSY).to_dict()
    assert {channel.name for channel in ACCOUNTED} < ledger.keys()
    assert ledger["residual"] == pytest.approx(sum(balance(ledger)), abs=1e-15)
    assert abs(ledger["residual"]) < 1e-12
