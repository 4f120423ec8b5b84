"""PPO from screened random policies: its policy, its race, and what stops and starts it."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode

from agents.conditions import Conditions
from agents.evaluate import SHORT_PROTOCOL, evaluate
from agents.evolution import policy
from agents.evolution.policy import SIZE
from agents.evolution.settings import EvolutionSettings
from agents.evolution.walks import Duration
from agents.learners import screened_ppo
from agents.pacing import CleanWalking
from agents.policy_files import load_policy
from agents.sb3 import stages
from agents.sb3.hard_starts import HardStarts
from agents.sb3.layers import layer_of
from agents.sb3.products import Products, policy_of, put_policy
from agents.sb3.setting_off import SettingOff
from agents.sb3.stages import Contest
from agents.sb3.stepping_back import SteppingBack
from agents.sb3.training_env import Offer
from agents.train import train
from agents.training import Training
from rimless_gym.envs.task import Task
from tests.agents.runs import BRIEF, scalars

#: Time steps of a roll-out, of a turn, and of a training: two families, of one policy each, have a
#: trial and two heats; then the best settles.
ROLLOUT, TURN, STEPS = 128, 256, 2000


@pytest.fixture(autouse=True)
def brief(monkeypatch, request):
    """Screen and compare few policies for a moment, unless a test is slow anyway."""
    if request.node.get_closest_marker("slow"):
        return
    few = EvolutionSettings(screened=400, kept=20, screen_intervals=400, contenders=2)
    monkeypatch.setattr(screened_ppo, "SCREENING", few)
    short = [stage._replace(steps=stage.steps and TURN) for stage in stages.STAGES]
    monkeypatch.setattr(stages, "STAGES", short)
    monkeypatch.setattr(screened_ppo, "CONTENDERS", 1)
    monkeypatch.setattr(screened_ppo, "COMPARED", Duration.judged_in_second_half(500))
    monkeypatch.setattr(screened_ppo, "LOOK", Duration.judged_in_second_half(500))
    monkeypatch.setattr(screened_ppo, "COMPARED_STARTS", 16)
    monkeypatch.setattr(screened_ppo, "SEEN_INTERVALS", 100)
    monkeypatch.setattr(screened_ppo, "LOOK_STARTS", 16)
    monkeypatch.setattr(screened_ppo, "LOOK_EVERY", 128)


def small():
    settings = screened_ppo.Learner.settings("scratch")
    algorithm = settings.algorithm | {"n_steps": 32, "batch_size": 32}
    layers = settings.offer.layers | {SettingOff: {"intervals": 30}, HardStarts: {"share": 0.3}}
    offer = Offer(layers, episode_steps=100)
    return dataclasses.replace(settings, n_envs=4, algorithm=algorithm, offer=offer)


def run(out, **changes):
    arguments = {"settings": small(), "protocol": BRIEF, "timesteps": STEPS} | changes
    return train("screened_ppo", out=out, progress=False, **arguments)


def contest(stage):
    return Contest(np.zeros((1, SIZE)), np.zeros(1, dtype=np.int64), stage)


def weights(path):
    return load_policy(path).parts.weights["weights"]


@pytest.fixture
def learner():
    found = screened_ppo.Learner(
        Training("screened_ppo", "scratch", 0, Conditions(), Task(), small())
    )
    yield found
    found.close()


@pytest.fixture
def observations(rng):
    envs = Conditions().envs(64, autoreset_mode=AutoresetMode.SAME_STEP)
    seen = [envs.reset(seed=0)[0]]
    for _ in range(50):
        seen.append(envs.step(rng.uniform(-1.0, 1.0, size=(64, 1)).astype(np.float32))[0])
    envs.close()
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
    expected = policy.act(given, observations)
    np.testing.assert_allclose(np.clip(actions, -1.0, 1.0), expected, atol=1e-3)


def test_whitened_products_vary_alike_in_all_directions(observations, learner):
    products = Products(learner.model.observation_space)
    seen = torch.from_numpy(observations)

    def spread():
        found = products(seen).numpy().astype(np.float64)
        variances = np.linalg.eigvalsh(found.T @ found / len(found))
        return variances[-1] / variances[1]

    before = spread()
    products.whiten(observations)
    assert spread() < 20.0 < 100.0 < before


def test_price_noise_and_learning_rate_fall_while_it_learns(tmp_path):
    settings = small()
    looks = dataclasses.replace(settings.pacing, every=256, least_share=0.0, starts=8)
    result = run(tmp_path, settings=dataclasses.replace(settings, pacing=looks))
    assert result.timesteps >= STEPS
    shown = {name: [event.value for event in events] for name, events in scalars(tmp_path).items()}
    assert {"walk/return", "eval/objective"} <= set(shown)
    assert max(shown["train/std"]) == pytest.approx(stages.STAGES[0].noise[0])
    assert min(shown["train/std"]) < stages.STAGES[-1].noise[0]
    assert min(shown["pacing/price"]) < settings.pacing.first_price
    assert shown["train/learning_rate"][-1] < 0.5 * shown["train/learning_rate"][0]


def test_killed_in_every_stage_and_resumed_it_ends_with_the_same_policy(tmp_path, monkeypatch):
    monkeypatch.setattr("agents.session.SAVE_INTERVAL", 0.0)
    whole = run(tmp_path / "whole")
    restored, restore = [], screened_ppo.Learner.restore

    def noted(self, state):
        restore(self, state)
        restored.append((self._contest.stage, len(self._contest.gaits)))

    monkeypatch.setattr(screened_ppo.Learner, "restore", noted)
    improve, out = screened_ppo.Learner._improve, tmp_path / "broken"
    for turns in (1, 3, 3, 3):  # the last of them is killed after its first roll-out

        def killed(self, until, ends, watch, left=[turns]):  # noqa: B006
            left[0] -= 1
            last = not left[0]
            improve(self, self.steps + ROLLOUT if last else until, ends, watch)
            if last:
                watch.between()
                raise SystemExit

        with monkeypatch.context() as patch:
            patch.setattr(screened_ppo.Learner, "_improve", killed)
            with pytest.raises(SystemExit):
                run(out)
    resumed = run(out)
    assert restored == [(0, 0), (1, 0), (2, 0), (3, 0)]
    for one, other in ((resumed.last, whole.last), (resumed.best, whole.best)):
        np.testing.assert_array_equal(weights(one), weights(other))


def test_resumed_before_the_first_time_step_it_begins_at_the_same_price(learner):
    learner._enter(contest(0))
    learner._paced.price = 0.7
    again = screened_ppo.Learner(learner.training)
    again.restore(learner.state())
    assert again._paced.pacing.first_price == 0.7
    again.close()


def test_the_best_policy_that_it_looked_at_is_kept_and_not_the_last(tmp_path, monkeypatch):
    shares = iter([0.5, 0.9, 0.7, 0.0])
    looked = []

    def looked_at(self, weights):
        looked.append(weights)
        return CleanWalking(next(shares, 0.6), 0.1, 0.5)

    monkeypatch.setattr(screened_ppo.Learner, "_looked_at", looked_at)
    result = run(tmp_path)
    assert len(looked) > 3
    np.testing.assert_array_equal(
        weights(result.last), looked[1].astype(weights(result.last).dtype)
    )
    shown = scalars(tmp_path)
    assert [round(event.value, 3) for event in shown["looks/share"]][:2] == [0.5, 0.9]


def test_only_who_settles_is_charged_for_steps_backward_and_must_walk_from_most_starts(learner):
    shares, charges, again = [], [], []
    stepping_back, hard_starts = (layer_of(learner._env, k) for k in (SteppingBack, HardStarts))
    for stage in range(len(stages.STAGES)):
        learner._enter(contest(stage))
        learner.model.learn = lambda *_, **__: charges.append(stepping_back.charge)
        learner._improve(1, 1, SimpleNamespace(log=None))
        shares.append(learner._paced.pacing.least_share)
        again.append(hard_starts.share)
    assert charges == [0.0, 0.0, 0.0, 0.1]
    assert shares == [0.5, 0.5, 0.5, 0.8]
    assert again == [0.0, 0.0, 0.0, 0.3]


def test_advantages_that_would_be_normalised_twice_are_refused(tmp_path):
    settings = small()
    twice = settings.algorithm | {"normalize_advantage": True}
    with pytest.raises(ValueError, match=r"normalize_advantage = true: .* leave it false"):
        run(tmp_path, settings=dataclasses.replace(settings, algorithm=twice))


def test_it_goes_on_from_its_own_policy_and_races_with_none(tmp_path):
    begun = run(tmp_path / "begun", timesteps=TURN // 2)
    second = run(tmp_path / "second", init=begun.last, timesteps=0)
    np.testing.assert_allclose(weights(second.last), weights(begun.last), atol=1e-4)
    assert run(tmp_path / "on", init=begun.last, timesteps=TURN).timesteps == TURN


def test_what_it_cannot_train_with_is_refused(tmp_path):
    with pytest.raises(ValueError, match="nominal machine without disturbances"):
        run(tmp_path / "a", ranges={"pendulum_mass": (1.5, 1.7)})
    with pytest.raises(ValueError, match=r"holds a voltage for 0\.01 s"):
        run(tmp_path / "b", control_period=0.04)
    with pytest.raises(ValueError, match="cannot imitate"):
        run(tmp_path / "c", init="imitation", expert=lambda x, mode: x[:, 0])


@pytest.mark.slow
def test_from_nothing_it_walks_more_cheaply_than_anything_that_leans(tmp_path):
    result = train(
        "screened_ppo", seed=0, out=tmp_path, timesteps=20_000_000, protocol=SHORT_PROTOCOL
    )
    walk = evaluate(load_policy(result.best).policy, protocol=SHORT_PROTOCOL)
    assert walk.walking_share > 0.8
    assert walk.cot < 0.3
