"""The simulator in JAX does what the compiled one does, and can be differentiated."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rimless_gym import BUILDABLE, Ranges
from rimless_gym.checks import MissingExtraError
from rimless_gym.energy import ROW
from rimless_gym.envs.env import RimlessWheelEnv
from rimless_gym.envs.starts import Starts, draw_start
from rimless_gym.kernel.stepping import HybridState, advance
from rimless_gym.params import WheelParams
from rimless_gym.presets import PRESETS

TWO_DEVICES, FAST = "--xla_force_host_platform_device_count=2", "--xla_disable_hlo_passes=fusion"
os.environ.setdefault("XLA_FLAGS", f"{TWO_DEVICES} {FAST}")  # compiles twice as fast
jax: Any = pytest.importorskip("jax")
jnp: Any = pytest.importorskip("jax.numpy")
from rimless_gym.jax import EnvState, WheelEnv  # noqa: E402

jax.config.update("jax_enable_x64", True)
LOSSY = BUILDABLE.replace(slope=0.02, hub_damping=0.01, drag=0.2, pendulum_drag=1e-3)
FEW = 7  # rows, which take a third of the compilation


def played(params: WheelParams, n: int, ticks: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """States (n, 6) in random play, where many wheels stand and rock, and voltages (n,)."""
    rng, moving = np.random.default_rng(3), Starts(rest=0.0, whirling=0.0)
    states = np.stack([draw_start(params, rng, moving) for _ in range(n)])
    for tick in range(ticks):
        if tick % 10 == 0:
            volts = rng.uniform(-1, 1, n) * params.voltage_limit
        for row in np.flatnonzero(advance(params, states, volts)[:, ROW.failure]):
            states[row] = draw_start(params, rng)
    states[:, 1] = np.remainder(states[:, 1] + np.pi, 2 * np.pi) - np.pi
    states[:, 5] = 0
    return states, rng.uniform(-1, 1, n) * params.voltage_limit


def state_of(env: WheelEnv, states: np.ndarray) -> EnvState:
    """The environment's states (N,) with these hybrid states (N, 6)."""
    angles = (jnp.asarray(x, env.dtype) for x in states.T[:4])
    whole = (jnp.asarray(x, jnp.int32) for x in states.T[4:])
    zero = jnp.zeros(len(states), env.dtype)
    return EnvState(HybridState(*angles, *whole), zero, zero, zero, {})


def check(env: WheelEnv, params: WheelParams, n: int, limit: float, ticks: int = 40) -> None:
    """Compare intervals with the kernel's; rocking wheels multiply errors, so a few may be more."""
    states, volts = (x.astype(env.dtype).astype(float) for x in played(params, n, ticks))
    given = state_of(env, states), jnp.asarray(volts, env.dtype)
    wheel, totals = jax.jit(jax.vmap(env.interval))(*given)
    rows = advance(params, states, volts)
    for name in ("failure", "touchdowns", "steps"):
        assert np.array_equal(getattr(totals, name), rows[:, getattr(ROW, name)])
    assert np.array_equal(wheel.mode, states[:, 4])
    off = np.stack(wheel[:4], axis=1) - states[:, :4]
    off[:, 1] = np.remainder(off[:, 1] + np.pi, 2 * np.pi) - np.pi
    assert np.quantile(np.abs(off), 0.99) < limit
    assert np.abs(off).max() < max(100 * limit, 1e-7)  # 2e-8 with every loss, 2e-10 without
    for name in ("distance", "electrical_positive", "elapsed"):
        off = np.abs(np.asarray(getattr(totals, name)) - rows[:, getattr(ROW, name)])
        assert np.quantile(off, 0.99) < limit
        assert off.max() < 100 * limit


def test_intervals_agree_with_the_kernel() -> None:
    check(WheelEnv(dtype="float64"), BUILDABLE, FEW, 1e-11, ticks=2)


@pytest.mark.slow
@pytest.mark.parametrize("params", [*PRESETS.values(), LOSSY])
def test_random_play_agrees_with_the_kernel(params: WheelParams) -> None:
    check(WheelEnv(params=params, dtype="float64"), params, 4096, 1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("params", [*PRESETS.values(), LOSSY])
def test_gradients_are_those_of_the_kernel(params: WheelParams) -> None:
    states, volts = played(params, FEW * 16, ticks=5)
    states, volts = states[states[:, 4] == 0], volts[states[:, 4] == 0]
    env = WheelEnv(params=params, dtype="float64")

    def sought(x: Any, state: EnvState) -> Any:
        moved = state._replace(wheel=HybridState(*(*x[:4], *state.wheel[4:])))
        wheel, totals = env.interval(moved, x[4])
        return wheel.dtheta + totals.distance + totals.electrical_positive

    def known(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        wheels = np.concatenate([x[:, :4], states[:, 4:]], axis=1)
        rows = advance(params, wheels, x[:, 4])
        found = wheels[:, 3] + rows[:, ROW.distance] + rows[:, ROW.electrical_positive]
        return found, np.column_stack([rows[:, [ROW.touchdowns, ROW.failure]], wheels[:, 4]])

    x, step = np.column_stack([states[:, :4], volts]), 1e-6
    found = jax.jit(jax.vmap(jax.grad(sought)))(jnp.asarray(x), state_of(env, states))
    checked = 0
    for k, change in enumerate(step * np.eye(5)[1:], start=1):  # phi might be on its guard
        (high, above), (low, below) = known(x + change), known(x - change)
        alike = (above == below).all(axis=1) & (below[:, 2] == 0)
        slope = (high - low)[alike] / (2 * step)
        assert np.asarray(found)[alike, k] == pytest.approx(slope, rel=1e-5, abs=1e-5)
        checked += alike.sum()
    assert np.isfinite(found).all()
    assert checked > 100


@pytest.mark.slow
@pytest.mark.parametrize("period", [0.01, 0.02])
def test_episodes_are_those_of_the_environment(period: float) -> None:
    ours = WheelEnv(control_period=period, dtype="float64")
    theirs = RimlessWheelEnv(control_period=period)
    begin = np.array([[1.4, 0.3, 1.2, -0.5, 0, 0]])
    theirs.reset(options={"state": begin[0, :4]})
    _, state = ours.reset(jax.random.key(0))
    state = state._replace(wheel=jax.tree.map(lambda x: x[0], state_of(ours, begin).wheel))
    for action in np.random.default_rng(0).uniform(-1, 1, (40, 1)).astype(np.float32):
        seen, state, reward, ended, _, info = ours.step(jax.random.key(0), state, action)
        observed, expected, terminated, _, wanted = theirs.step(action)
        assert np.asarray(seen) == pytest.approx(observed, abs=1e-6)
        assert float(reward) == pytest.approx(float(expected), abs=1e-9)
        assert bool(ended) == terminated
        assert float(info["reward_slip"]) == pytest.approx(wanted["reward_slip"], abs=1e-9)


@pytest.mark.slow
def test_rows_have_their_own_machines_and_do_not_influence_each_other() -> None:
    bounds = {"pendulum_mass": (1.5, 1.7), "hub_friction": (0.01, 0.03)}
    env = WheelEnv(ranges=Ranges(bounds), speeds=(0.3, 0.6), dtype="float64")
    seen, state = jax.vmap(env.reset)(jax.random.split(jax.random.key(1), 64))
    assert seen.shape == (64, 8)
    assert 0.3 <= state.target_speed.min() < state.target_speed.max() <= 0.6
    advanced, volts = jax.jit(jax.vmap(env.interval)), jnp.linspace(-10, 10, 64)
    wheel, _ = advanced(state, volts)
    order = np.random.default_rng(0).permutation(64)
    other, _ = advanced(jax.tree.map(lambda x: x[order], state), volts[order])
    assert all(np.array_equal(a[order], b) for a, b in zip(wheel, other, strict=True))
    groups = jax.tree.map(lambda x: x.reshape(8, 8), (state, volts))
    grouped, _ = jax.jit(jax.vmap(jax.vmap(env.interval)))(*groups)
    for a, b in zip(wheel, grouped, strict=True):
        assert np.asarray(b).ravel() == pytest.approx(np.asarray(a), abs=1e-12)
    for row in range(64):
        drawn = {name: float(values[row]) for name, values in state.drawn.items()}
        assert all(low <= drawn[name] <= high for name, (low, high) in bounds.items())
        known = np.array([[float(x[row]) for x in state.wheel]])
        advance(BUILDABLE.replace(**drawn), known, np.asarray(volts[row : row + 1]))
        assert [float(x[row]) for x in wheel[:4]] == pytest.approx(known[0, :4], abs=1e-9)


def without_jax() -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "jax", None)
        for name in [name for name in sys.modules if name.startswith("rimless_gym.jax")]:
            patch.delitem(sys.modules, name)
        importlib.import_module("rimless_gym.jax")


def in_single_precision() -> None:
    with jax.enable_x64(False):
        WheelEnv(dtype="float64")


def in_too_many_rows() -> None:
    env, rows = WheelEnv(), jax.ShapeDtypeStruct((10**12,), "float32")
    _, state = jax.eval_shape(env.reset, jax.random.key(0))
    jax.eval_shape(jax.vmap(lambda u, state: env.interval(state, u), (0, None)), rows, state)


def in_too_many_rows_on_a_mesh() -> None:
    with jax.set_mesh(jax.sharding.Mesh(jax.devices(), "x")):
        in_too_many_rows()


@pytest.mark.parametrize(
    ("attempt", "error", "text"),
    [
        (without_jax, MissingExtraError, r"rimless-gym\[jax\]"),
        (in_single_precision, ValueError, "jax_enable_x64"),
        (in_too_many_rows, MemoryError, "1,000,000,000,000 rows need .* step fewer at a time"),
        (in_too_many_rows_on_a_mesh, MemoryError, "1,000,000,000,000 rows need"),
        (lambda: WheelEnv(dtype="float16"), ValueError, "choose from float64, float32"),
        (lambda: WheelEnv(control_period=0.015), ValueError, r"control_period = 0\.015 s"),
    ],
)
def test_what_cannot_run_is_an_error_with_a_remedy(
    attempt: Callable[[], Any], error: type[Exception], text: str
) -> None:
    with pytest.raises(error, match=text):
        attempt()
