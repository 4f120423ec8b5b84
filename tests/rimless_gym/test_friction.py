"""Dry friction: consistent with the gear's torque, never a source of energy."""

from __future__ import annotations

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL, WheelParams, hybrid, simulate
from rimless_gym.energy import ROW, Ledger
from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.kernel.stepping import advance

MACHINE = THESIS_PHYSICAL.replace(
    gear_ratio=120.0,
    motor_constant=0.02,
    rotor_inertia=2e-6,
    hub_friction=0.3,
    gear_loss=0.3,
    pendulum_mass=0.8,
    pendulum_inertia=0.01,
    hub_damping=0.01,
    voltage_limit=6.0,
)
SMOOTH = MACHINE.replace(hub_friction=0.0, gear_loss=0.0)


def accelerations(params: WheelParams, mode: int, y: np.ndarray, u: float) -> np.ndarray:
    return np.array(hybrid.accelerations(float(mode), *y, u, params.constants))


def psi_rate(params: WheelParams, rates: np.ndarray) -> float:
    return float(hybrid.relative_rate(*rates, params.constants))


@pytest.mark.parametrize("mount", ["wheel", "frame"])
@pytest.mark.parametrize("mode", [SINGLE, DOUBLE])
def test_friction_is_a_share_of_the_torque_that_the_gear_transmits(mode: int, mount: str) -> None:
    machine, smooth = (params.replace(motor_mount=mount) for params in (MACHINE, SMOOTH))
    p, rng = machine.constants, np.random.default_rng(0)
    for _ in range(200):
        y = rng.uniform([p.a, -3, -3, -6], [p.b, 3, 3, 6])
        if mode == DOUBLE:
            y[[0, 2]] = p.a, 0.0
        u = rng.uniform(-20, 20)
        moving = accelerations(machine, mode, y, u)
        dpsi, ddpsi = psi_rate(machine, y[2:]), psi_rate(machine, moving)
        transmitted = p.K * (u - p.K * dpsi) / p.Rm - p.Jr * ddpsi
        size = np.hypot(machine.hub_friction, machine.gear_loss * transmitted)
        friction = size * dpsi / np.hypot(dpsi, machine.friction_width)
        weaker = u - friction * p.Rm / p.K  # the voltage whose torque is less by the friction
        assert moving == pytest.approx(accelerations(smooth, mode, y, weaker), rel=1e-10, abs=1e-10)


@pytest.mark.parametrize(("width", "loss"), [(10.0, 0.3), (0.1, 0.9), (0.01, 0.0)])
def test_friction_never_creates_energy_and_the_ledger_closes(width: float, loss: float) -> None:
    machine = MACHINE.replace(friction_width=width, gear_loss=loss)
    rng, n = np.random.default_rng(1), 32
    states = np.zeros((n, 6))
    states[:, :4] = rng.uniform([1.2, -3, 0.0, -9], [1.9, 3, 2.0, 9], (n, 4))
    states[:, 5] = 0
    for volts in rng.uniform(-6, 6, (30, n)):
        rows = advance(machine, states, volts, pull=np.inf)
        assert rows[:, [ROW.friction, ROW.gear]].min() >= 0.0
        energies = [Ledger.from_rows(row, machine) for row in rows]
        assert max(abs(one.residual) for one in energies) < 1e-9


@pytest.mark.parametrize("mode", [SINGLE, DOUBLE])
def test_the_kernel_agrees_with_the_reference_simulator(mode: int) -> None:
    y = [1.5 if mode == SINGLE else MACHINE.constants.a, 0.6, 0.0, -2.0]
    volts = 6.0 * np.sin(0.1 * np.arange(80))
    names = ("single_stance", "double_stance")
    reference = simulate(MACHINE, y, volts, 0.8, mode=names[mode], pull=np.inf)
    state = np.array([[*y, mode, 0.0]])
    total = sum(advance(MACHINE, state, np.full(1, u), pull=np.inf)[0] for u in volts)
    assert state[0, :4] == pytest.approx(reference.x[-1], abs=1e-9)
    ledger = Ledger.from_rows(total, MACHINE)
    for name in ("friction", "gear"):
        theirs = getattr(reference.ledger.losses, name)
        assert getattr(ledger.losses, name) == pytest.approx(theirs, abs=1e-9)
        assert theirs > 0.01


def test_a_gear_that_loses_nearly_all_under_a_heavy_rotor_is_resolved_too() -> None:
    params = THESIS_PHYSICAL.replace(
        hub_friction=0.0212,
        friction_width=0.0029,
        gear_loss=1 - 3.2e-8,
        rotor_inertia=1.02e-3,
        motor_mount="frame",
        motor_constant=0.0,
        slope=0.4,
    )
    start = [1.81458, 1.35063, 4.25349, 7.68653]
    state, volts = np.array([[*start, 0.0, 0.0]]), np.array([1.02])
    rows = advance(params, state, volts, pull=np.inf)
    known = simulate(params, start, volts, 0.01)
    assert state[0, :4] == pytest.approx(known.x[-1], abs=1e-5)
    assert abs(Ledger.from_rows(rows[0], params).residual) < 1e-6


def test_violent_gravity_ends_the_motion_instead_of_hanging() -> None:
    params = THESIS_PHYSICAL.replace(hub_friction=0.02, gravity=1e12)
    rows = advance(params, np.array([[1.4, 0.5, 0.5, 1.0, 0.0, 0.0]]), np.zeros(1), pull=np.inf)
    assert rows[0, ROW.failure] == hybrid.RATE_EXCEEDED
