"""Ranges and disturbances in roll-outs, evaluation and training."""

import json
import math

import numpy as np
import pytest

from agents.conditions import Conditions
from agents.evaluate import evaluate
from agents.policies import controller_policy
from agents.policy_files import read_record
from agents.protocol import Protocol
from agents.rollout import Rollout, draw_starts, measured
from rimless_gym import PROTOTYPE, THESIS_PHYSICAL
from tests.agents.runs import run, weights

SMALL = Protocol(starts=24, seed=3, duration=1.5, window=1.2, alive=1.2)
PUSHES = {"pushes": {"rate": 5.0, "impulse": (0.2, 0.5)}}
NOISE = {"sensor_noise": {"leg_angle": 0.01, "pendulum_angle": 0.3, "leg_rate": 0.2}}


def roll(states, observations):
    return np.clip(0.4 * observations[:, 3] - 0.6 * observations[:, 1], -1, 1).astype(float)


def intervals(policy=roll, n=40, seed=0, **conditions):
    conditions = Conditions.of(
        THESIS_PHYSICAL, conditions.get("ranges"), conditions.get("disturbances")
    )
    return list(Rollout(conditions, policy, draw_starts(THESIS_PHYSICAL, 12, 1), n, seed))


def after(intervals):
    return np.concatenate([interval.after.ravel() for interval in intervals])


@pytest.mark.parametrize("disturbances", [PUSHES, NOISE, {"actuator_delay": 3}])
def test_disturbances_change_a_walk_and_the_same_seed_repeats_it(disturbances):
    rough = after(intervals(disturbances=disturbances))
    np.testing.assert_array_equal(rough, after(intervals(disturbances=disturbances)))
    calm = after(intervals())
    assert len(rough) != len(calm) or not np.array_equal(rough, calm)


def test_a_law_is_given_the_state_that_noisy_sensors_measure():
    seen = []

    def law(x, mode):
        seen.append(x.copy())
        return np.zeros(len(x))

    policy = controller_policy(THESIS_PHYSICAL, law)
    exact = intervals(policy, n=5)
    for x, interval in zip(seen, exact, strict=True):
        np.testing.assert_array_equal(x, interval.states[:, :4])
    seen.clear()
    noisy = intervals(policy, n=5, disturbances=NOISE)
    for x, interval in zip(seen, noisy, strict=True):
        errors = (x - interval.states[:, :4] + math.pi) % (2 * math.pi) - math.pi
        assert 0.05 < np.std(errors[:, 1]) < 1.0
        assert 0.05 < np.std(errors[:, 2]) < 1.0
        assert np.abs(errors[:, 3]).max() < 1e-5  # this rate is measured exactly


def test_without_noise_the_measured_state_is_exact_up_to_whole_turns():
    for interval in intervals():
        x = measured(interval.observations, THESIS_PHYSICAL.leg_angle)
        states = interval.states[:, :4].copy()
        states[:, 1] = (states[:, 1] + math.pi) % (2 * math.pi) - math.pi
        np.testing.assert_allclose(x, states, atol=1e-5)


def test_every_walk_has_a_machine_of_its_own_drawn_from_the_ranges():
    ranges = {"pendulum_mass": (2.0, 2.4), "hub_damping": (0.0, 0.02)}
    conditions = Conditions.of(THESIS_PHYSICAL, ranges, None)
    starts = draw_starts(THESIS_PHYSICAL, 12, 1)
    machines = Rollout(conditions, roll, starts, 5).machines
    masses = [machine.pendulum_mass for machine in machines]
    assert len(set(masses)) == 12
    assert all(2.0 <= mass <= 2.4 for mass in masses)


def test_cost_of_transport_uses_the_weights_of_the_drawn_machines():
    exact = evaluate(roll, THESIS_PHYSICAL, SMALL)
    point = THESIS_PHYSICAL.pendulum_mass
    same = evaluate(roll, THESIS_PHYSICAL, SMALL, ranges={"pendulum_mass": (point, point)})
    assert same.cot == pytest.approx(exact.cot, rel=1e-12)
    heavier = THESIS_PHYSICAL.replace(pendulum_mass=2.3)
    starts = draw_starts(THESIS_PHYSICAL, SMALL.starts, SMALL.seed)
    one = evaluate(roll, heavier, SMALL, starts=starts)
    ranges = {"pendulum_mass": (2.3, 2.3)}
    drawn = evaluate(roll, THESIS_PHYSICAL, SMALL, starts=starts, ranges=ranges)
    assert drawn.cot == pytest.approx(one.cot, rel=1e-9)
    assert drawn.objective == pytest.approx(one.objective, rel=1e-9)
    np.testing.assert_allclose(drawn.cots, one.cots, rtol=1e-9)


def test_pushes_and_noise_change_an_evaluation_reproducibly():
    calm = evaluate(roll, protocol=SMALL)
    for disturbances in (PUSHES, NOISE):
        rough = evaluate(roll, protocol=SMALL, disturbances=disturbances)
        again = evaluate(roll, protocol=SMALL, disturbances=disturbances)
        assert rough.to_dict() == again.to_dict()
        assert rough.to_dict() != calm.to_dict()


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_ranges_and_disturbances_change_a_training_and_are_recorded_with_it(tmp_path, algo):
    rough = {"ranges": {"pendulum_mass": (2.0, 2.4)}, "disturbances": PUSHES | NOISE}
    steps = {"ppo": 256, "sac": 160}[algo]
    calm = run(tmp_path / "calm", algo, timesteps=steps)
    whole = run(tmp_path / "whole", algo, timesteps=steps, **rough)
    assert not np.array_equal(weights(calm.last), weights(whole.last))
    notes = json.loads((tmp_path / "whole" / "train.json").read_text())
    assert notes["ranges"] == {"pendulum_mass": [2.0, 2.4]}
    assert notes["disturbances"]["pushes"]["rate"] == 5.0
    assert read_record(whole.last)["ranges"] == notes["ranges"]
    with pytest.raises(ValueError, match=r"ranges = .*, not None"):
        run(tmp_path / "whole", algo, timesteps=steps)


def test_ranges_that_are_not_valid_for_the_machine_are_refused():
    with pytest.raises(ValueError, match="pendulum_mass"):
        Conditions.of(PROTOTYPE, {"pendulum_mass": (-1.0, 1.0)}, None)
    with pytest.raises(TypeError, match="params = None"):
        Conditions.of(None, None, None)


def test_a_walk_that_has_ended_does_not_stop_the_others() -> None:
    machine = THESIS_PHYSICAL.replace(impact_law="thesis")  # backward touchdowns are errors
    starts = draw_starts(machine, 40, 3)
    starts = starts[(starts[:, 0] > np.pi / 2) & (starts[:, 2] > 0.5)]
    walks = list(Rollout(Conditions(machine), lambda x, seen: np.ones(len(x)), starts, 40))
    assert 0 < len(walks[-1].running) < len(starts)
