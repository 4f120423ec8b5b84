"""The JavaScript printed from the equations does what the compiled code does."""

from __future__ import annotations

import json
import shutil
import subprocess
from typing import Any

import numpy as np
import pytest

from rimless_gym import BUILDABLE
from rimless_gym import reference as compiled
from rimless_gym.energy import ROW
from rimless_gym.envs.layout import observe
from rimless_gym.equations import DOUBLE, LOSSES, SINGLE
from rimless_gym.javascript import simulator
from rimless_gym.kernel.stepping import MODE, STATE_SIZE, advance, hybrid_states
from rimless_gym.params import WheelParams

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="no Node here")

MACHINES = {
    "buildable": BUILDABLE,
    "uphill, every loss": BUILDABLE.replace(
        slope=-0.03,
        gear_ratio=25.0,
        hub_friction=0.08,
        gear_loss=0.2,
        hub_damping=0.01,
        drag=0.2,
        pendulum_drag=1e-3,
    ),
}


def in_node(program: str, given: Any) -> Any:
    """What a program prints that has the simulator and `given`."""
    assert NODE is not None
    text = f"{simulator()}\nconst given = {json.dumps(given)};\n{program}"
    done = subprocess.run([NODE, "-"], input=text, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


# -- physics -----------------------------------------------------------------------------------


@needs_node
@pytest.mark.parametrize("name", MACHINES)
def test_right_hand_sides_agree_with_the_compiled_ones(name: str) -> None:
    params, rng = MACHINES[name], np.random.default_rng(1)
    p = params.constants
    low, high = [p.a, -7, -6, -20, -12], [p.b, 7, 6, 20, 12]
    cases = rng.uniform(low, high, (100, 5)).tolist()
    found = in_node(
        """
        const p = wheel.constants(given.machine);
        const all = given.cases.map(([phi, theta, dphi, dtheta, u]) => [
          wheel.rates(wheel.SINGLE, [phi, theta, dphi, dtheta], u, p),
          wheel.rates(wheel.DOUBLE, [p.a, theta, 0, dtheta], u, p),
        ]);
        console.log(JSON.stringify({ p, all }));
        """,
        {"machine": params.to_dict(), "cases": cases},
    )
    assert found["p"] == pytest.approx(p._asdict(), rel=1e-14)
    for (phi, theta, dphi, dtheta, u), both in zip(cases, found["all"], strict=True):
        single = compiled.state_rates(SINGLE, phi, theta, dphi, dtheta, u, params.constants_array)
        double = compiled.state_rates(DOUBLE, p.a, theta, 0.0, dtheta, u, params.constants_array)
        for (motion, lost), theirs in zip((single, double), both, strict=True):
            assert theirs == pytest.approx([*motion[:4], *lost], rel=1e-12, abs=1e-12)


@needs_node
def test_touchdowns_agree_with_the_compiled_ones() -> None:
    rng = np.random.default_rng(2)
    cases = [
        [direction, theta, direction * speed, dtheta, u]
        for direction in (1, -1)
        for speed in (1e-6, 0.3, 2.0)
        for theta, dtheta, u in rng.uniform([-4, -12, -12], [4, 12, 12], (20, 3)).tolist()
    ]
    found = in_node(
        """
        const p = wheel.constants(given.machine);
        console.log(JSON.stringify(given.cases.map((one) => wheel.after_touchdown(...one, p))));
        """,
        {"machine": BUILDABLE.to_dict(), "cases": cases},
    )
    for case, theirs in zip(cases, found, strict=True):
        ours = compiled.after_touchdown(*case, BUILDABLE.constants_array)
        assert theirs == pytest.approx(ours._asdict(), rel=1e-12, abs=1e-12)


@needs_node
def test_observations_agree_with_the_environments() -> None:
    rng = np.random.default_rng(3)
    states = np.zeros((50, STATE_SIZE))
    states[:, :4] = rng.uniform([1, -9, -70, -70], [2.2, 9, 70, 70], (50, 4))
    states[:, MODE] = rng.integers(0, 2, 50)
    found = in_node(
        """
        const p = wheel.constants(given.machine);
        console.log(JSON.stringify(given.states.map(
          (one) => wheel.observation(...one.slice(0, 5), 2 / p.alpha))));
        """,
        {"machine": BUILDABLE.to_dict(), "states": states.tolist()},
    )
    np.testing.assert_allclose(found, observe(BUILDABLE, states), rtol=0, atol=1e-6)


# -- trajectories ------------------------------------------------------------------------------

INTERVALS = 120  # of 10 ms: 1.2 s

VOLTAGES = {
    "pumped": 5.0 * np.sign(np.sin(7.2 * 0.01 * np.arange(INTERVALS))),
    "whirling": -7.0 + 3.0 * np.sin(0.2 * np.arange(INTERVALS)),
    "random": np.repeat(np.random.default_rng(4).uniform(-12, 12, INTERVALS // 10), 10),
}

#: Walks from every start under every row of voltages, until they fail.
ADVANCED = """
const p = wheel.constants(given.machine);
const walks = given.starts.flatMap((start) => given.voltages.map((volts) => {
  const [phi, theta, dphi, dtheta, mode] = start;
  let state = { phi, theta, dphi, dtheta, mode, foot: 0 };
  const walked = [];
  for (const u of volts) {
    const next = wheel.advance(state, u, 0.01, p, given.pull);
    state = next.state;
    walked.push({ state: Object.values(state), totals: next.totals });
    if (next.totals.failure) break;
  }
  return walked;
}));
console.log(JSON.stringify(walks));
"""


def starts_of(params: WheelParams) -> list[list[float]]:
    """At rest with a swinging pendulum, and two in motion."""
    p, rng = params.constants, np.random.default_rng(5)
    moving = rng.uniform([p.a, -3, 0.5, -3], [p.b, 3, 2, 3], (2, 4))
    return [[p.a, 0.3, 0.0, -0.5, DOUBLE], *([*x, SINGLE] for x in moving.tolist())]


def walked_by(params: WheelParams, pull: float) -> list[Any]:
    """Start, voltages and what Node made of them, for every walk."""
    starts, rows = starts_of(params), list(VOLTAGES.values())
    given = {"machine": params.to_dict(), "starts": starts, "pull": pull}
    found = in_node(ADVANCED, given | {"voltages": [row.tolist() for row in rows]})
    pairs = [(start, volts) for start in starts for volts in rows]
    return [(*pair, walked) for pair, walked in zip(pairs, found, strict=True)]


@needs_node
@pytest.mark.parametrize("name", MACHINES)
def test_trajectories_agree_with_the_kernel(name: str) -> None:
    params, touchdowns = MACHINES[name], 0
    for start, volts, walked in walked_by(params, pull=0.0):
        state = hybrid_states([start[:4]], start[4])
        for step, u in zip(walked, volts, strict=False):
            row, totals = advance(params, state, np.array([u]))[0], step["totals"]
            np.testing.assert_allclose(step["state"], state[0], rtol=0, atol=1e-6)
            assert totals["failure"] == row[ROW.failure]
            assert len(totals["touchdowns"]) == row[ROW.touchdowns]
            for time in totals["touchdowns"][-1:]:
                assert time == pytest.approx(row[ROW.touchdown_time], abs=1e-6)
                touchdowns += 1
            for energy in ("elapsed", "distance", "electrical_positive", "collision"):
                assert totals[energy] == pytest.approx(row[getattr(ROW, energy)], abs=1e-6)
        assert len(walked) == INTERVALS or walked[-1]["totals"]["failure"]
    assert touchdowns > 8


@needs_node
def test_energy_balances_in_every_interval() -> None:
    for _, _, walked in walked_by(BUILDABLE, pull=1e9):
        for totals in (step["totals"] for step in walked):
            lost = sum(totals[name] for name in LOSSES) + totals["collision"]
            assert totals["electrical"] == pytest.approx(
                lost + totals["mechanical_change"], abs=1e-9
            )
