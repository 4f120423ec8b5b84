"""Training: seeds, what it starts from, what it leaves, and how it goes on after a stop."""

import errno
import functools
import json
import os
import signal
import time
from multiprocessing import get_context
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from agents import training
from agents.evaluate import evaluate
from agents.imitation import LASTING
from agents.learner import LEARNERS, Learner, LearnerSettings, PolicyParts
from agents.policy_files import (
    LAW_ACTIONS,
    NOTHING,
    PRETRAINED,
    CheckpointError,
    TrainingEffort,
    load_policy,
    read_record,
)
from agents.sb3 import learner as sb3
from agents.training import Trainer, read_state, walking_economy
from rimless_gym import BUILDABLE, PROTOTYPE
from rimless_gym.envs.task import TERM_NAMES
from tests.agents.runs import (
    BRIEF,
    QUICK,
    SETTLED,
    STEPS,
    assert_same_policies,
    config,
    killed_after,
    run,
    scalars,
    weights,
)
from trajopt.store import Store

ROUGH = {
    "ranges": {"pendulum_mass": (2.0, 2.4)},
    "disturbances": {
        "pushes": {"rate": 2.0, "impulse": (0.1, 0.3)},
        "sensor_noise": {"leg_rate": 0.1},
        "actuator_delay": (0, 2),
    },
}


def test_the_same_seed_gives_the_same_policy_and_the_default_is_seed_0(tmp_path):
    default, zero, other = (
        run(tmp_path / name, timesteps=128, **seed)
        for name, seed in (("a", {}), ("b", {"seed": np.int64(0)}), ("c", {"seed": 1}))
    )
    np.testing.assert_array_equal(weights(default.last), weights(zero.last))
    assert json.loads((tmp_path / "a" / "train.json").read_text())["inputs"]["seed"] == 0
    assert not np.array_equal(weights(default.last), weights(other.last))


def test_the_best_policy_is_the_one_that_evaluates_best(tmp_path):
    scores = iter([1, 3.0, 3.0, np.nan, *[0.0] * 20])
    result = run(tmp_path, score=lambda evaluation: next(scores))
    assert read_record(result.best)["score"] == 3.0
    assert read_record(result.best)["timesteps"] == result.curve[1].intervals
    assert len(result.curve) == 5


def test_the_better_policy_walks_efficiently_and_from_more_starts():
    def score(share, cot):
        return walking_economy(SimpleNamespace(walking_share=share, cot=cot))

    assert score(0.5, 2.0) == 0.5**4 / 2.0
    assert score(0.0, np.nan) == 0.0
    assert score(0.98, 0.052) < score(1.0, 0.055) < score(0.98, 0.048)
    assert score(0.99, 0.05) / score(1.0, 0.05) == pytest.approx(0.96, abs=1e-3)  # 4 % of energy


@pytest.mark.parametrize("algo", ["ppo", pytest.param("sac", marks=pytest.mark.slow)])
def test_a_training_in_which_nothing_walks_goes_on_and_logs_no_gait(tmp_path, algo):
    result = run(tmp_path, algo, params=BUILDABLE.replace(slope=-0.3), protocol=SETTLED)
    assert result.timesteps == STEPS[algo]
    assert {each.walking_share for each in result.curve} == {0.0}
    shown = scalars(tmp_path)
    wanted = {"walk/return", "walk/speed", "walk/falls", "eval/objective"}
    assert wanted <= set(shown)
    assert not {"eval/cot", "eval/speed"} & set(shown)
    assert all(np.isfinite(event.value) for events in shown.values() for event in events)


def test_the_actor_waits_until_the_critic_has_warmed_up(tmp_path, monkeypatch, swing):
    assert sb3.CRITIC_WARM_UP == 0.15
    monkeypatch.setattr(sb3, "CRITIC_WARM_UP", 10.0)
    result = run(tmp_path, init="imitation", expert=swing, cloning=QUICK, timesteps=128)
    cloned, trained = (
        sb3.Ppo.actor(load_policy(path).model) for path in (result.clone, result.last)
    )
    for before, after in zip(cloned.weights, trained.weights, strict=True):
        assert torch.equal(before, after)
    assert not np.array_equal(weights(result.clone), weights(result.last))


def test_fine_tuning_can_start_from_a_checkpoint(tmp_path, swing):
    first = run(tmp_path / "a", init="imitation", expert=swing, cloning=QUICK, timesteps=0)
    np.testing.assert_array_equal(weights(first.clone), weights(first.best))
    second = run(tmp_path / "b", init=str(first.clone), timesteps=0)
    np.testing.assert_array_equal(weights(second.best), weights(first.clone))
    clone, tuned = (read_record(file) for file in (first.clone, second.best))
    assert clone["prior"] == tuned["prior"] == LAW_ACTIONS
    assert clone["intervals"] == tuned["intervals"] == clone["cloning"]["samples"]
    assert 0.0 < clone["minutes"] < tuned["curve"][0]["minutes"] <= tuned["minutes"]
    with pytest.raises(CheckpointError, match="cannot start sac"):
        run(tmp_path / "c", "sac", init=str(first.clone))
    with pytest.raises(ValueError, match="init"):  # it is known by the policy that it began with
        run(tmp_path / "b", timesteps=0)


def test_a_policy_is_distilled_into_another_learner_with_one_cloning_only(tmp_path):
    clone = {"init": "imitation", "expert": str(PRETRAINED["evolution"]), "timesteps": 0}
    learned = run(tmp_path, "sac", cloning=QUICK, **clone).best
    assert load_policy(learned).algo == "sac"
    source, distilled = (TrainingEffort.of(read_record(file)) for file in ("evolution", learned))
    assert distilled.prior == source.prior == NOTHING
    assert distilled.intervals > source.intervals
    before, *after = (read_record(file)["curve"] for file in ("evolution", learned))
    assert after[0][: len(before)] == before
    assert after[0][len(before)]["intervals"] > before[-1]["intervals"]
    longer = config("sac", startup=True, cloning={"rounds": 3}, **clone).how_to_clone
    assert (longer.rounds, longer.seconds) == (3, LASTING.seconds)
    with pytest.raises(ValueError, match="startup, speeds"):
        config("sac", startup=True, speeds=(0.5, 0.6), **clone).training()
    with pytest.raises(ValueError, match="startup: expert = 'lqr' is a feedback law"):
        config("sac", startup=True, **clone | {"expert": "lqr"}).training()
    with pytest.raises(ValueError, match="gradient_steps"):
        run(tmp_path, "sac", cloning=QUICK | {"gradient_steps": 21}, **clone)


def test_a_training_for_commanded_speeds_observes_them(tmp_path, finished):
    speeds = {"speeds": (0.4, 0.6), "control_period": 0.02}
    result = run(tmp_path / "a", timesteps=128, **speeds)
    policy = load_policy(result.last)
    assert (policy.conditions.control.speeds, policy.conditions.control.period) == (
        (0.4, 0.6),
        0.02,
    )
    assert read_record(result.last)["task"]["distance_weight"] == 5.0
    assert policy.act(np.zeros((3, 8), dtype=np.float32)).shape == (3,)
    for changes, message in (
        ({"init": str(result.last)}, "with a commanded speed"),
        ({"init": "imitation", "expert": "front"}, "with a commanded speed"),
        ({"init": str(finished / "last.zip"), "speeds": (0.4, 0.6)}, "without a commanded speed"),
        ({"init": str(finished / "last.zip"), "control_period": 0.04}, "not every 0.04 s"),
    ):
        with pytest.raises(CheckpointError, match=message):
            run(tmp_path / "b", **changes)
    assert not (tmp_path / "b").exists()  # what is refused claims no folder


@pytest.mark.parametrize(
    ("algo", "changes", "error", "message"),
    [
        ("td3", {}, ValueError, r"algo = 'td3': choose from \['cma_es', 'evolution', 'gradi"),
        ("ppo", {"seed": 2**32}, ValueError, "seed = 4294967296: must be .* at most 4294967295"),
        ("ppo", {"init": "none.zip"}, CheckpointError, r"none\.zip.*check the path"),
        (
            "ppo",
            {"cloning": QUICK},
            ValueError,
            "expert, startup and cloning are for init = 'imitation'",
        ),
        ("ppo", {"hyperparameters": {"gama": 1}}, ValueError, "'gama' is not known"),
        ("evolution", {"init": "imitation"}, ValueError, "cannot imitate; begin from 'scratch'"),
    ],
)
def test_a_config_that_cannot_work_is_refused(tmp_path, algo, changes, error, message):
    with pytest.raises(error, match=message):
        run(tmp_path, algo, **changes)
    assert not (tmp_path / "train.json").exists()


def test_a_training_that_diverges_keeps_its_last_good_policy(tmp_path):
    with pytest.raises(ValueError, match=r"has diverged: after \d+ steps .* keeps what they were"):
        run(tmp_path, hyperparameters={"learning_rate": 1e30})
    assert np.isfinite(weights(tmp_path / "last.zip")).all()


def stopped_after(rollouts, number, monkeypatch, begin):
    """Train until a signal before the next roll-out stops it."""
    on_iteration, seen = Trainer.on_iteration, []

    def interrupted(self):
        seen.append(1)
        if len(seen) > rollouts:
            signal.raise_signal(number)
        on_iteration(self)

    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "on_iteration", interrupted)
        with pytest.raises(KeyboardInterrupt):
            begin()


@pytest.mark.parametrize(
    ("algo", "conditions"),
    [("ppo", ROUGH), ("sac", ROUGH), pytest.param("ppo", {}, marks=pytest.mark.slow)],
)
def test_stopped_and_then_killed_a_training_ends_with_the_same_policies(
    tmp_path, monkeypatch, algo, conditions
):
    begin = functools.partial(run, tmp_path / "broken", algo, **conditions)
    whole = run(tmp_path / "whole", algo, **conditions)
    number = signal.SIGTERM if algo == "sac" else signal.SIGINT
    stopped_after(1, number, monkeypatch, begin)
    killed_after(STEPS[algo] // 4, monkeypatch, begin)
    state = read_state(tmp_path / "broken" / "state.pt")
    assert state["learner"]["counters"]["num_timesteps"] < whole.timesteps
    resumed = begin()
    assert resumed.timesteps == whole.timesteps
    assert [each.objective for each in resumed.curve] == [each.objective for each in whole.curve]
    assert_same_policies(resumed, whole)


def test_a_state_that_cannot_be_written_leaves_the_one_before(tmp_path, monkeypatch):
    error = OSError(errno.ENOSPC, "No space left on device")
    whole, replace, states = run(tmp_path / "whole"), os.replace, []

    def fails(source, target):
        if str(target).endswith("state.pt"):
            states.append(target)
            if len(states) == 2:
                raise error
        replace(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", fails)
        with pytest.raises(OSError, match="No space"):
            run(tmp_path / "broken")
    assert_same_policies(run(tmp_path / "broken"), whole)


def test_a_folder_belongs_to_one_training_and_one_process(tmp_path):
    over = run(tmp_path, timesteps=128)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(ValueError, match="seed = 0, not 1"):
        run(tmp_path, seed=1)
    with pytest.raises(ValueError, match="params"):
        run(tmp_path, params=PROTOTYPE)
    with pytest.raises(ValueError, match=r"= \{\}, not \{'gamma': 0\.98\}"):
        run(tmp_path, hyperparameters={"gamma": 0.98})
    with Store(tmp_path), pytest.raises(ValueError, match="another process is working"):
        run(tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    again = run(tmp_path, timesteps=128)
    assert (again.timesteps, repr(again.curve)) == (128, repr(over.curve))  # nan is unequal
    assert run(tmp_path, timesteps=256).timesteps == 256
    (tmp_path / "state.pt").write_bytes(b"garbage")
    with pytest.raises(ValueError, match=r"state\.pt: .*to train anew"):
        run(tmp_path)


class Bandit(Learner):
    """The least that a learner needs: it learns and acts. Constant voltages are its policies."""

    default_settings = LearnerSettings(n_timesteps=40)

    def __init__(self, training, start=None):
        self._voltage = 0.0

    def learn(self, until, callback):
        while self.steps < until:
            callback.on_iteration()
            self._voltage += 0.1
            self.steps += 10
            callback.on_step()

    @property
    def act(self):
        return lambda observations: np.full(len(observations), self._voltage)


class Saved(Bandit):
    """The same with policies in files, and a state to go on from."""

    @classmethod
    def load(cls, parts, conditions, task):
        return lambda observations: np.full(len(observations), parts.weights["voltage"][0])

    def parts(self):
        return PolicyParts({}, {"voltage": np.array([self._voltage])})

    def state(self):
        return {"steps": self.steps, "voltage": self._voltage}

    def restore(self, state):
        self.steps, self._voltage = state["steps"], state["voltage"]


@pytest.fixture
def more_learners(monkeypatch):
    monkeypatch.setitem(LEARNERS, "bandit", f"{__name__}:Bandit")
    monkeypatch.setitem(LEARNERS, "saved", f"{__name__}:Saved")


def test_a_learner_needs_two_methods(tmp_path, more_learners):
    result = run(tmp_path, "bandit")
    assert [each.intervals for each in result.curve] == [0, 10, 20, 30, 40]
    assert not result.last.exists()
    with pytest.raises(ValueError, match="cannot imitate"):
        run(tmp_path, "bandit", init="imitation")


def test_with_files_and_a_state_its_policies_are_loaded_and_it_goes_on(
    tmp_path, monkeypatch, more_learners
):
    whole = run(tmp_path / "whole", "saved")
    killed_after(3, monkeypatch, lambda: run(tmp_path / "broken", "saved"))
    resumed = run(tmp_path / "broken", "saved")
    assert_same_policies(resumed, whole)
    policy = load_policy(resumed.last)
    assert policy.record["observation_layout"]
    np.testing.assert_allclose(policy.act(np.zeros((2, 6), np.float32)), 0.4)
    assert evaluate(policy.policy, protocol=BRIEF).protocol == BRIEF
    with pytest.raises(CheckpointError, match="a policy of evolution, which cannot start saved"):
        run(tmp_path / "c", "saved", init="evolution")


def test_logged_figures_are_ratios_of_sums_over_the_infos():
    info = {name: np.zeros(2) for name in (*TERM_NAMES, "failure", "idle")}
    info |= {"elapsed": np.full(2, 0.04), "distance": np.array([0.01, 0.03])}
    info |= {"electrical_positive": np.array([1.0, 0.2]), "reward_energy": np.full(2, -0.1)}
    info |= {"reward_distance": 0.5 * info["distance"]}
    seen, env = {}, SimpleNamespace(last_info=info)
    figures = sb3.LogWalking(BUILDABLE, env)
    figures.model = SimpleNamespace(logger=SimpleNamespace(record=seen.__setitem__))
    for _ in range(2):
        figures._on_step()
    figures._record()
    assert figures._intervals == 0
    assert seen["walk/cot"] == pytest.approx(1.2 / (BUILDABLE.weight * 0.04))
    assert seen["walk/speed"] == pytest.approx(0.5)
    assert seen["walk/return"] == pytest.approx((0.5 * 0.04 - 0.2) / 0.08 * 20)


def _train(out, steps):
    config_ = config("ppo", timesteps=steps)
    training.train(config_, out, progress=False)


@pytest.mark.slow
def test_killed_at_random_moments_it_ends_with_the_same_policies(tmp_path):
    began = time.perf_counter()
    _train(tmp_path / "whole", 1280)
    longest, rng, kills = 0.6 * (time.perf_counter() - began), np.random.default_rng(0), 0
    while kills < 20:
        out = tmp_path / f"after_{kills}"
        while True:
            process = get_context("fork").Process(target=_train, args=(out, 1280))
            process.start()
            process.join(rng.uniform(0, longest))
            if process.exitcode is not None:
                assert process.exitcode == 0
                break
            process.kill()
            process.join()
            kills, longest = kills + 1, 1.1 * longest  # such that there is an end to it
        for name in ("best.zip", "last.zip"):
            np.testing.assert_array_equal(weights(out / name), weights(tmp_path / "whole" / name))
