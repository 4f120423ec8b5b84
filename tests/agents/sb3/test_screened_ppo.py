"""PPO from screened random policies: its policy, its race, and how it goes on after a kill."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from agents.conditions import Conditions
from agents.evaluate import SHORT_PROTOCOL, evaluate
from agents.evolution.search import EvolutionSettings
from agents.evolution.walks import SIZE, Duration, act
from agents.learner import Training
from agents.policy_files import load_policy
from agents.reward_weight import NO_WALK, CleanWalking
from agents.sb3 import screened_ppo
from agents.sb3.screened_ppo import (
    ROUNDS,
    NormalizeByPhase,
    ScreenedPpo,
    Tournament,
    policy_of,
    put_policy,
)
from agents.sb3.wrappers import StartUpPhase, training_env, wrapped
from agents.training import TrainingConfig, read_state, train
from rimless_gym.envs.task import Task
from tests.agents.runs import assert_same_policies, killed_after, run, scalars, weights

#: Time steps of a candidate's turn, and of a training: two families, of one policy each, have a
#: trial and two rounds; then the best goes on.
TURN, STEPS = 256, 1800

START_UP = 5


@pytest.fixture(autouse=True)
def brief(monkeypatch, request):
    """Screen and compare few policies for a moment, unless a test is slow anyway."""
    if request.node.get_closest_marker("slow"):
        return
    few = EvolutionSettings(screened=400, retained=20, screen_intervals=400, candidates=2)
    monkeypatch.setattr(screened_ppo, "SCREENING", few)
    short = tuple(each._replace(steps=each.steps and TURN) for each in ROUNDS)
    monkeypatch.setattr(screened_ppo, "ROUNDS", short)
    for name, value in {
        "CANDIDATES": 1,
        "COMPARED": Duration.second_half(500),
        "CHECK": Duration.second_half(500),
        "COMPARED_STARTS": 16,
        "WHITENED_INTERVALS": 100,
        "CHECK_STARTS": 16,
        "CHECK_EVERY": 128,
    }.items():
        monkeypatch.setattr(screened_ppo, name, value)


def small():
    entry = ScreenedPpo.settings("scratch").entry
    [(adaptive, schedule)] = entry["callback"][0].items()
    return {
        "n_envs": 4,
        "n_steps": 32,
        "batch_size": 32,
        "env_wrapper": [{"gymnasium.wrappers.TimeLimit": {"max_episode_steps": 100}}],
        "vec_env_wrapper": [
            {"agents.sb3.wrappers.StartUpPhase": {"intervals": 30, "penalty": 0.1}},
            *entry["vec_env_wrapper"][1:],
        ],
        "callback": [
            {adaptive: schedule | {"every": 256, "least_share": 0.0, "starts": 8, "seconds": 3.0}}
        ],
    }


def trained(out, **changes):
    changes = {"timesteps": STEPS, "hyperparameters": small()} | changes
    return run(out, "screened_ppo", **changes)


@pytest.fixture
def learner():
    settings = ScreenedPpo.settings("scratch", small())
    learner = ScreenedPpo(Training("screened_ppo", "scratch", 0, Conditions(), Task(), settings))
    yield learner
    learner.close()


@pytest.fixture
def observations(rng):
    envs = Conditions().envs(64, autoreset_mode=AutoresetMode.SAME_STEP)
    seen = [envs.reset(seed=0)[0]]
    for _ in range(50):
        seen.append(envs.step(rng.uniform(-1.0, 1.0, size=(64, 1)).astype(np.float32))[0])
    return np.concatenate(seen)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_the_network_acts_as_the_policy_whose_weights_it_was_given(learner, observations, rng):
    given, network = rng.normal(size=SIZE), learner.model.policy
    network.features_extractor.whiten(observations)
    put_policy(network, given)
    np.testing.assert_allclose(policy_of(network), given, atol=1e-4)
    with torch.no_grad():
        actions = learner.actor(learner.model).mean_action(torch.from_numpy(observations)).numpy()
    np.testing.assert_allclose(np.clip(actions, -1.0, 1.0), act(given, observations), atol=1e-3)


def test_killed_in_a_round_and_resumed_it_ends_with_the_same_policy(tmp_path, monkeypatch):
    whole = trained(tmp_path / "whole")
    assert whole.timesteps >= STEPS
    killed_after(410, monkeypatch, lambda: trained(tmp_path / "broken"))
    assert read_state(tmp_path / "broken" / "state.pt")["learner"]["race"]["round"] == 3
    assert_same_policies(trained(tmp_path / "broken"), whole)
    shown = {
        name: [event.value for event in events]
        for name, events in scalars(tmp_path / "whole").items()
    }
    assert max(shown["train/std"]) == pytest.approx(ROUNDS[0].noise[0])
    assert min(shown["train/std"]) < ROUNDS[-1].noise[0]
    assert min(shown["reward_weight/distance"]) < 5.0
    assert shown["train/learning_rate"][-1] < 0.5 * shown["train/learning_rate"][0]


def test_the_best_policy_of_its_checks_is_kept_and_not_the_last(tmp_path, monkeypatch):
    shares, checked = iter([0.5, 0.9, 0.7, 0.0]), []

    def check(self, weights):
        checked.append(weights)
        return CleanWalking(next(shares, 0.6), 0.1, 0.5)

    monkeypatch.setattr(ScreenedPpo, "_checked", check)
    result = trained(tmp_path, timesteps=2000)
    assert len(checked) > 3
    np.testing.assert_allclose(weights(result.last), checked[1], rtol=1e-6)


def test_only_the_last_candidate_has_a_penalty_for_steps_backward_and_must_walk_from_most_starts(
    learner,
):
    shares, penalties = [], []
    learner._schedule = dataclasses.replace(learner._schedule, least_share=0.8)
    for number in range(len(ROUNDS)):
        learner._race = Tournament(np.zeros((1, SIZE)), np.zeros(1, dtype=np.int64), number)
        learner._begin()
        wrapper = wrapped(learner._env, StartUpPhase)
        learner.model.learn = lambda *_, wrapper=wrapper, **__: penalties.append(wrapper.penalty)
        learner._improve(1, 1, SimpleNamespace(log=None))
        shares.append(learner._adaptive.schedule.least_share)
    assert penalties == [0.0, 0.0, 0.0, 0.1]
    assert shares == [0.5, 0.5, 0.5, 0.8]


def test_it_goes_on_from_its_own_policy_without_a_race(tmp_path):
    begun = trained(tmp_path / "begun", timesteps=TURN // 2)
    second = trained(tmp_path / "second", init=str(begun.last), timesteps=0)
    np.testing.assert_allclose(weights(second.last), weights(begun.last), atol=1e-4)
    assert trained(tmp_path / "on", init=str(begun.last), timesteps=TURN).timesteps == TURN


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ranges": {"pendulum_mass": (1.5, 1.7)}}, "nominal machine without disturbances"),
        ({"control_period": 0.04}, r"holds a voltage for 0\.01 s"),
        ({"init": "imitation"}, "cannot imitate"),
        ({"hyperparameters": {"normalize_advantage": True}}, "normalize_advantage: false"),
    ],
)
def test_what_it_cannot_train_with_is_refused(tmp_path, changes, message):
    with pytest.raises(ValueError, match=message):
        run(tmp_path, "screened_ppo", **changes)


GAITS = [
    CleanWalking(1.0, 0.2, 0.5),
    CleanWalking(0.6, 0.1, 0.5),
    CleanWalking(0.9, 0.2, 0.5),
    NO_WALK,
    CleanWalking(1.0, 0.4, 0.5),
    CleanWalking(0.9, 0.8, 0.5),
]


def end_round(race):
    """Let every policy of a round learn nothing; who goes on, and of which families."""
    for candidate in race.candidates.copy():
        assert (race.candidate == candidate).all()
        race.advance(candidate, GAITS[int(candidate[0]) % 10])
    return race.candidates[:, 0].tolist(), race.families.tolist()


def test_the_best_two_of_each_family_go_on_and_the_best_of_all_learns_to_the_end():
    race = Tournament(np.arange(6.0)[:, None], np.array([0, 0, 0, -1, -1, 1]))
    assert end_round(race) == ([1, 0, 4, 5, 3], [0, 0, -1, 1, -1])
    assert end_round(race) == ([1, 0], [0, 0])
    race.advance(np.array([11.0]), GAITS[1])  # it goes on as what it has become
    race = Tournament.read(dataclasses.asdict(race))
    assert (race.gaits, race.decided) == ([GAITS[1]], False)
    race.advance(np.array([10.0]), GAITS[0])
    assert (race.candidates.tolist(), race.decided) == ([[11.0]], True)
    assert race.rules == ROUNDS[-1]


class Spreads(BaseCallback):
    """Notes means and spreads of advantages: of start-up, of walking, and of stalled wheels."""

    def __init__(self):
        super().__init__()
        self.ages, self.early, self.steps, self.found = np.zeros(8, dtype=int), [], 0, []

    def _on_step(self):
        self.early.append(self.ages < START_UP)
        self.ages = np.where(self.locals["dones"], 0, self.ages + 1)
        self.steps = self.steps + self.training_env.unwrapped.last_info["steps"]
        return True

    def _on_rollout_end(self):
        advantages, early = self.locals["rollout_buffer"].advantages, np.array(self.early)
        parts = [early, ~early & (self.steps > 0), ~early & (self.steps <= 0)]
        self.found += [[(advantages[part].mean(), advantages[part].std()) for part in parts]]
        self.early, self.steps = [], 0


def test_advantages_of_start_up_of_walking_and_of_stalled_wheels_have_the_same_spread():
    phase = StartUpPhase, {"intervals": START_UP}
    env = training_env(8, Conditions(), Task(), 7, [phase], episode_steps=50)
    settings = {"n_steps": 64, "batch_size": 64, "n_epochs": 1, "normalize_advantage": False}
    spreads = Spreads()
    PPO("MlpPolicy", env, device="cpu", seed=0, **settings).learn(
        1024, [NormalizeByPhase(wrapped(env, StartUpPhase)), spreads]
    )
    np.testing.assert_allclose(spreads.found, [[(0.0, 1.0)] * 3] * 2, atol=1e-4)


@pytest.mark.slow
def test_from_nothing_it_walks_at_a_lower_cost_than_anything_that_leans(tmp_path):
    config = TrainingConfig("screened_ppo", timesteps=20_000_000, protocol=SHORT_PROTOCOL)
    walk = evaluate(load_policy(train(config, tmp_path).best).policy, protocol=SHORT_PROTOCOL)
    assert walk.walking_share > 0.8
    assert walk.cot < 0.3
