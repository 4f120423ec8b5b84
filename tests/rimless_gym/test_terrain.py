"""Rough ground: it is the same in both simulators, and energy and travel are those of its shape."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rimless_gym import BUILDABLE, Terrain, WheelParams, simulate
from rimless_gym.energy import ROW, Ledger
from rimless_gym.envs.layout import MEMORY
from rimless_gym.equations import DOUBLE, equations
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import FOOT, GROUNDED_SIZE, MODE, advance
from rimless_gym.rendering.wheel import Scene, height_at, with_ground
from rimless_gym.streams import MOST_TURN, Ground, ground_turns
from tests.rimless_gym.envs.rows import SAME, make

number = equations(math.sin, math.cos)
DOWNHILL = BUILDABLE.replace(slope=0.05, hub_friction=0.005, gear_loss=0.0)
FAR = 50


def turn_of(ground: Ground, params: WheelParams = DOWNHILL):
    """The ground as the reference simulator takes it."""
    turns = ground_turns(ground, params.leg_angle, -FAR, FAR)
    return lambda k: float(turns[k + FAR])


def test_both_simulators_walk_over_the_same_ground_and_account_for_its_heights() -> None:
    """The wheel walks down, rocks, and comes to rest on two feet."""
    ground, x0, p = Ground(0.7, 0.04), [1.4, 0.3, 2.0, 6.0], DOWNHILL.constants
    volts = np.repeat(np.random.default_rng(700).uniform(-3, 4, 20), 10)
    turn, state, sums = turn_of(ground), np.zeros((1, GROUNDED_SIZE)), np.zeros(len(ROW))
    state[0, :4], state[0, -2:] = x0, ground
    for u in volts:
        sums += advance(DOWNHILL, state, np.array([u]), pull=math.inf)[0]
    motion = simulate(DOWNHILL, x0, volts, len(volts) * CONTROL_PERIOD, ground=turn)
    assert motion.x[-1] == pytest.approx(state[0, :4], abs=1e-8)
    assert (motion.foot[-1], motion.mode[-1]) == (state[0, FOOT], state[0, MODE])
    assert {1, -1} == {event.direction for event in motion.touchdowns}
    ours, theirs = Ledger.from_rows(sums, DOWNHILL), motion.ledger
    assert ours.residual == pytest.approx(0.0, abs=1e-9)
    assert theirs.residual == pytest.approx(0.0, abs=1e-9)
    for name in ("distance", "mechanical_change", "collision"):
        assert getattr(ours, name) == pytest.approx(getattr(theirs, name), abs=1e-9)

    foot = sum(np.exp(-1j * turn(k)) for k in range(int(state[0, FOOT]))) * DOWNHILL.step_length
    hubs = [complex(*number.hub_position(x[0], p)) for x in (x0, state[0])]
    assert ours.distance == pytest.approx((foot + hubs[1] - hubs[0]).real, abs=1e-12)
    weight = DOWNHILL.total_mass * complex(p.gx, -p.gy)  # gravity's force
    fallen = (foot * weight.conjugate()).real
    energies = [number.mechanical_energy(*x[:4], p) for x in (x0, state[0])]
    assert ours.mechanical_change == pytest.approx(energies[1] - energies[0] - fallen, abs=1e-10)


def test_slopes_are_normal_and_follow_from_the_seed_alone() -> None:
    turns = ground_turns(Ground(0.3, 0.05), 1.0, -5000, 5000)
    assert np.array_equal(turns[4000:6000], ground_turns(Ground(0.3, 0.05), 1.0, -1000, 1000))
    assert np.all(turns[4999:5001] == 0.0)
    assert np.std(turns) == pytest.approx(0.05, rel=0.03)
    assert np.mean(turns) == pytest.approx(0.0, abs=0.002)
    assert np.abs(np.corrcoef(turns[1:], turns[:-1])[0, 1]) < 0.04
    assert np.abs(ground_turns(Ground(0.3, 0.2), 0.1, 1, 100)).max() == MOST_TURN * 0.1


def test_every_episode_has_ground_of_its_own_and_begins_on_even_ground() -> None:
    envs = make(8, SAME, disturbances={"terrain": Terrain(slope_std=0.05)}, max_episode_steps=120)
    seen, _ = envs.reset(seed=0)
    assert np.array_equal(seen, make(8).reset(seed=0)[0])
    seeds, standing = set(), []
    for _ in range(240):
        envs.step(np.full((8, 1), 0.3, np.float32))
        seeds |= set(envs.get_state()["batch"]["memory"][MEMORY.ground_seed, :8].tolist())
        standing += envs.states[envs.states[:, MODE] == DOUBLE, 0].tolist()
    assert len(seeds) >= 16
    turns = np.abs(np.array(standing) - BUILDABLE.constants.a)
    assert 0.01 < turns.max() <= MOST_TURN * BUILDABLE.leg_angle


def test_the_drawn_feet_stand_on_the_drawn_ground() -> None:
    ground, p = Ground(0.6, 0.1), DOWNHILL.constants
    for foot in (-3, 0, 7):
        phi = p.a + turn_of(ground)(foot - 1)  # the leg behind touches down
        scene = with_ground(Scene(phi=phi, theta=0.0), DOWNHILL, ground, foot)
        hub = complex(*scene.hub(DOWNHILL))
        for k in (0, 1):
            at = hub + DOWNHILL.leg_length * np.exp(-1j * (phi + k * p.alpha))
            assert at.imag == pytest.approx(height_at(scene.ground, at.real), abs=1e-12)
        assert height_at(scene.ground, hub.real) == pytest.approx(0.0, abs=1e-12)
