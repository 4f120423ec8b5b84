"""CMA-ES on a network's last layer: it lowers the cost of a walk, and goes on after a kill."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from agents.evaluate import Protocol, evaluate
from agents.policy_files import PRETRAINED, load_policy
from agents.rollout import Rollout
from agents.sb3 import cma_es
from rimless_gym.presets import BUILDABLE
from tests.agents.runs import assert_same_policies, killed_after, run, weights

CLONE, FRONT = str(PRETRAINED["imitation"]), str(PRETRAINED["front"])

#: Control intervals of a generation, as `short` has them.
GENERATION = 16 * 4 * 300


@pytest.fixture(autouse=True)
def short(monkeypatch):
    for name, value in {
        "POPULATION": 16,
        "GAIT_STARTS": 2,
        "HARD_STARTS": 1,
        "ORDINARY_STARTS": 1,
        "SHOWN_STARTS": 8,
        "OBSERVED": 1000,
        "DURATION": 3.0,
        "WINDOW": 2.0,
    }.items():
        monkeypatch.setattr(cma_es, name, value)


def test_only_the_last_layer_changes_and_a_clone_walks_at_less_cost(tmp_path):
    protocol = Protocol(starts=8, seed=1, duration=6.0, window=3.0, alive=3.0)
    result = run(tmp_path, "cma_es", init=CLONE, timesteps=8 * GENERATION, protocol=protocol)
    before, after = (load_policy(path).parts.weights for path in (CLONE, result.last))
    assert {name for name in before if not np.array_equal(before[name], after[name])} == {
        "action_net.weight",
        "action_net.bias",
    }
    assert min(each.cot for each in result.curve) < 0.995 * result.curve[0].cot


def test_its_starts_are_chosen_anew_and_its_search_begins_anew(tmp_path, monkeypatch):
    ends = []
    for renewed, anew in ((99, 99), (1, 99), (1, 1)):
        monkeypatch.setattr(cma_es, "RENEWED", renewed)
        monkeypatch.setattr(cma_es, "ANEW", anew * GENERATION)
        out = tmp_path / f"{renewed}_{anew}"
        ends.append(weights(run(out, "cma_es", init=CLONE, timesteps=2 * GENERATION).last))
    assert not any(np.array_equal(*pair) for pair in itertools.combinations(ends, 2))


def test_policies_of_a_generation_walk_with_the_same_machines_each_start_with_its_own(
    tmp_path, monkeypatch
):
    scores, machines = [], []
    monkeypatch.setattr(cma_es, "SPREAD", 1e-12)  # the policies differ by nothing
    monkeypatch.setattr(cma_es, "ORDINARY_STARTS", 4)
    monkeypatch.setattr(cma_es, "VARIED_STARTS", 5)
    tell = cma_es.LastLayer.tell
    monkeypatch.setattr(
        cma_es.LastLayer, "tell", lambda search, new: (scores.append(new), tell(search, new))
    )

    def remembered(*arguments, **named):
        rollout = Rollout(*arguments, **named)
        machines.append(rollout.machines[: len(rollout.machines) // cma_es.POPULATION])
        return rollout

    monkeypatch.setattr(cma_es, "Rollout", remembered)
    ranges = {"pendulum_mass": (1.605, 1.615)}
    run(tmp_path, "cma_es", init=CLONE, timesteps=6 * GENERATION, ranges=ranges)
    assert np.ptp(scores, axis=1) == pytest.approx(0.0, abs=1e-6)
    first, last = ({machine.pendulum_mass for machine in machines[k]} for k in (0, -1))
    assert len(machines[0]) >= 5 + 4
    assert len(first) > 1
    assert first != last


def test_an_ordinary_start_that_walks_counts_by_its_return_alone(tmp_path, monkeypatch):
    scores, tell, draw = [], cma_es.LastLayer.tell, cma_es.draw_starts
    monkeypatch.setattr(
        cma_es.LastLayer, "tell", lambda search, new: (scores.append(new), tell(search, new))
    )
    for name, value in {"DURATION": 6.0, "WINDOW": 3.0, "SHOWN_STARTS": 9}.items():
        monkeypatch.setattr(cma_es, name, value)
    for weight, seed in itertools.product((0.0, 2.0), (1, 2)):  # whose start-ups differ
        monkeypatch.setattr(
            cma_es, "draw_starts", lambda params, n, of, s=seed: draw(params, n, of if n > 1 else s)
        )
        weighed = {"return_weight": weight}
        out = tmp_path / f"{weight}_{seed}"
        run(out, "cma_es", init=CLONE, timesteps=1, hyperparameters=weighed)
    one, other, returned, other_returned = scores
    assert one.all()
    assert other == pytest.approx(one, rel=1e-9)
    for seed, start in ((1, returned / one), (2, other_returned / other)):
        policy, protocol = load_policy(CLONE).policy, Protocol(1, 0, 6.0, 3.0, 1.0)
        expected = evaluate(policy, protocol=protocol, starts=draw(BUILDABLE, 1, seed))
        assert np.log(start) / 2.0 == pytest.approx(expected.returns[0], abs=0.03)


def test_commands_are_spread_evenly_and_are_the_same_for_all_policies(tmp_path, monkeypatch):
    given, counted, shown = [], [], []
    monkeypatch.setattr(cma_es, "VARIED_STARTS", 6)

    def remembered(*arguments, command):
        given.append(command.reshape(cma_es.POPULATION, -1))
        return Rollout(*arguments, command=command)

    def cost(commands, window, some):
        counted.append(some.reshape(cma_es.POPULATION, -1))
        return penalised_costs(commands, window, some)

    def walked(*arguments):
        shown.append(walk(*arguments))
        return shown[-1]

    penalised_costs, walk = cma_es.penalised_costs, cma_es.walk
    monkeypatch.setattr(cma_es, "walk", walked)
    monkeypatch.setattr(cma_es, "Rollout", remembered)
    monkeypatch.setattr(cma_es, "penalised_costs", cost)
    speeds = {"speeds": (0.52, 0.6), "control_period": 0.01}
    run(tmp_path, "cma_es", init=FRONT, timesteps=1, **speeds)
    (commands,), (some,) = given, counted
    assert (commands == commands[0]).all()
    which, observed = shown[0].which, shown[0].observations[:, 6]
    commanded = set(zip(which, observed, strict=True))
    assert len(commanded) == len(set(which))  # the starts are on the gait of their own command
    assert ((commands >= 0.52 - 1e-6) & (commands <= 0.6 + 1e-6)).all()
    assert (np.diff(commands[0, :6]) > 0.0).all()
    assert commands[0, 5] - commands[0, 0] > 0.05
    assert not some[:, 6:].any()  # what the start-up costs does not count
    assert some[:, :6].mean() > 0.8


def test_a_walk_off_its_command_by_six_percent_counts_as_twice_as_expensive():
    walk = SimpleNamespace(distance=1.2, time=2.0, cost_of_transport=lambda machine: 0.05)
    window = SimpleNamespace(ledgers=lambda: [walk] * 3, machines=[None] * 3)
    commands, some = np.array([0.6, 0.6 / 1.06, 0.6]), np.array([True, True, False])
    costs = cma_es.penalised_costs(commands, window, some)
    assert costs == pytest.approx([0.05, 0.1, np.nan], nan_ok=True)
    assert cma_es.geometric_mean(np.array([0.01, 0.04])) == pytest.approx(0.02)
    assert cma_es.geometric_mean(costs[:0]) == np.inf


@pytest.mark.parametrize(
    ("init", "speeds"),
    [
        pytest.param(CLONE, {}, id="plain", marks=pytest.mark.slow),
        pytest.param(FRONT, {"speeds": (0.52, 0.6), "control_period": 0.01}, id="commanded"),
    ],
)
def test_killed_it_ends_with_the_same_policies(tmp_path, monkeypatch, init, speeds):
    def begin(name):
        return run(tmp_path / name, "cma_es", init=init, timesteps=3 * GENERATION, **speeds)

    monkeypatch.setattr(cma_es, "VARIED_STARTS", 2)
    monkeypatch.setattr(cma_es, "RENEWED", 1)
    monkeypatch.setattr(cma_es, "ANEW", GENERATION)
    whole = begin("whole")
    killed_after(2, monkeypatch, lambda: begin("broken"))
    assert_same_policies(begin("broken"), whole)
    assert not np.array_equal(weights(whole.last), weights(init))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, "goes on from a policy that walks; begin from 'imitation'"),
        ({"init": CLONE, "hyperparameters": {"gamma": 0.9}}, "'gamma' is not known"),
        ({"init": CLONE, "hyperparameters": {"return_weight": -1.0}}, "must be at least 0"),
        ({"init": "evolution"}, "a policy of evolution, which cannot start cma_es"),
    ],
)
def test_what_it_cannot_begin_from_is_refused(tmp_path, changes, message):
    with pytest.raises(ValueError, match=message):
        run(tmp_path, "cma_es", **changes)


def test_a_policy_that_stands_is_refused(tmp_path):
    standing = run(tmp_path / "ppo", "ppo", timesteps=0).last
    with pytest.raises(ValueError, match="no policy near it walks; begin from one that walks"):
        run(tmp_path / "cma_es", "cma_es", init=str(standing), timesteps=GENERATION)
