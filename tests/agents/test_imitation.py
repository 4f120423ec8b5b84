import dataclasses

import numpy as np
import pytest
import torch

from agents.conditions import Conditions
from agents.evaluate import evaluate
from agents.experts import OwnLaws
from agents.imitation import COMMAND_LASTS, Cloning, Teaching, clone, walk
from agents.rollout import controller_policy, draw_starts, learned_policy
from rimless_gym import BUILDABLE, THESIS_PHYSICAL
from trajopt import periodic_gait
from trajopt.feedback import laws

CONDITIONS = Conditions(THESIS_PHYSICAL)
QUICK = Cloning(
    rounds=2,
    expert_starts=10,
    seconds=1.5,
    starts=10,
    labels=400,
    gait_starts=10,
    gait_labels=400,
    gradient_steps=100,
    batch_size=128,
)

SHORT = dataclasses.replace(QUICK, gradient_steps=20, seconds=0.5)


@pytest.fixture
def new_actor(new_learner):
    """Makes the actor of a new model."""

    def make(algo="ppo", seed=0):
        learner = new_learner(algo, seed)
        return learner.actor(learner.model)

    return make


def teach(actor, controller, config=QUICK, seed=0):
    expert = controller_policy(THESIS_PHYSICAL, controller)
    return clone(actor, Teaching(expert, CONDITIONS, config, seed))


def weights(actor):
    return torch.cat([p.detach().ravel() for p in actor.model.policy.parameters()]).numpy()


def error(actor, controller):
    """Root-mean-square error on walks of the controller that were not used for training."""
    label = controller_policy(THESIS_PHYSICAL, controller)
    seen = walk(CONDITIONS, label, draw_starts(THESIS_PHYSICAL, 10, 999), 150)
    return np.sqrt(np.mean((actor.act(seen.observations) - seen.actions) ** 2))


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_cloning_reduces_the_error_on_states_that_it_did_not_learn_from(new_actor, swing, algo):
    actor = new_actor(algo)
    critic = getattr(actor.model, "critic", None) or actor.model.policy.value_net
    before, critic_before = error(actor, swing), [p.clone() for p in critic.parameters()]
    report = teach(actor, swing, seed=1)
    assert error(actor, swing) < 0.5 * before
    assert all(map(torch.equal, critic_before, critic.parameters()))
    assert len(report.errors) == 2
    assert 0 < report.samples <= 10 * 150 + 800


def test_cloning_gives_the_same_policy_for_the_same_seed_only(new_actor, swing):
    actors = [new_actor() for _ in range(3)]
    for actor, seed in zip(actors, (5, 5, 6), strict=True):
        teach(actor, swing, SHORT, seed=seed)
    same, again, other = (weights(actor) for actor in actors)
    np.testing.assert_array_equal(same, again)
    assert not np.array_equal(same, other)


def test_the_expert_teaches_under_the_conditions_of_the_training(new_actor, swing):
    calm, rough = new_actor(), new_actor()
    conditions = Conditions.of(
        THESIS_PHYSICAL, {"pendulum_mass": (2.0, 2.4)}, {"sensor_noise": {"leg_rate": 0.2}}
    )
    teach(calm, swing, SHORT)
    clone(rough, Teaching(controller_policy(THESIS_PHYSICAL, swing), conditions, SHORT, 0))
    assert not np.array_equal(weights(calm), weights(rough))


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_the_differentiable_action_is_the_one_that_the_model_takes(new_actor, algo):
    actor = new_actor(algo)
    x = np.random.default_rng(0).uniform(-1, 1, (40, 6)).astype(np.float32)
    with torch.no_grad():
        mean = actor.mean_action(torch.from_numpy(x)).numpy()
    np.testing.assert_allclose(np.clip(mean, -1, 1), actor.act(x), atol=1e-6)


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_exploration_noise_can_be_set(new_actor, algo):
    actor = new_actor(algo)
    actor.set_noise(-5.0)
    x = np.zeros((4000, 6), dtype=np.float32)
    noisy, _ = actor.model.predict(x, deterministic=False)
    assert np.std(noisy) == pytest.approx(np.exp(-5.0), rel=0.1)


@pytest.mark.slow
def test_a_clone_of_the_optimal_gaits_controller_walks_from_almost_every_start(new_actor):
    gait = periodic_gait(THESIS_PHYSICAL, speed=0.5, steps=1)
    actor = new_actor()
    teach(actor, laws.design("lqr", gait), Cloning())
    result = evaluate(learned_policy(actor.act), THESIS_PHYSICAL)
    assert result.walking_share >= 0.95
    assert result.cot < 1.25 * gait.cot
    assert result.speed == pytest.approx(0.5, abs=0.03)


def test_commanded_speeds_change_within_the_walks_that_teach():
    conditions = Conditions.of(BUILDABLE, None, None, (0.4, 0.6), 0.01)
    still = learned_policy(lambda observations: np.zeros(len(observations)))
    seen = walk(conditions, still, draw_starts(BUILDABLE, 3, 0), 700, seed=1)
    commands = np.full((3, 700), np.nan)
    commands[seen.which, seen.when] = 0.45 + 0.2 * seen.observations[:, 6]
    changes = {int(k) + 1 for k in np.flatnonzero(np.diff(commands[0]))}
    lasting = round(COMMAND_LASTS / 0.01)
    assert changes == {lasting + 1, 2 * lasting + 1}
    assert len(np.unique(commands[:, -1].round(6))) == 3
    assert ((commands > 0.4 - 1e-6) & (commands < 0.6 + 1e-6)).all()


@dataclasses.dataclass(frozen=True)
class OfPendulum(OwnLaws):
    """Each machine's law asks for its pendulum's length."""

    def controller_for(self, machine):
        return lambda x, modes: np.full(len(x), machine.pendulum_length)


def test_walks_that_fall_get_further_labels_where_wanted():
    conditions = Conditions.of(BUILDABLE, None, None)
    still = learned_policy(lambda observations: np.zeros(len(observations)))
    wanted = dataclasses.replace(QUICK, seconds=2.0, lost_labels=150)
    teaching = Teaching(still, conditions, wanted, 0)
    first = teaching.first_round()

    def later(config):
        taught = dataclasses.replace(teaching, config=config)
        return taught.later_round(1, first, topple, np.random.default_rng(0))

    def topple(seen):
        return np.sign(seen[:, 1] + 0.3)

    *without, lost = later(wanted)
    for one, other in zip(without, later(dataclasses.replace(wanted, lost_labels=0)), strict=True):
        np.testing.assert_array_equal(one.states, other.states)
    assert len(lost.when) == 150
    seen = walk(conditions, learned_policy(topple), draw_starts(BUILDABLE, 10, (0, 2, 1)), 200)
    lasting = np.flatnonzero(np.bincount(seen.which, minlength=10) == 200)
    assert 0 < len(lasting) < 10
    assert not np.isin(lost.which, lasting).any()


def test_each_walk_is_labelled_by_its_own_machine() -> None:
    drawn = Conditions.of(BUILDABLE, {"pendulum_length": (0.13, 0.15)}, None)
    teaching = Teaching(OfPendulum(None), drawn, SHORT, 0)
    first = teaching.first_round()
    rounds = teaching.later_round(
        1, first, lambda seen: np.zeros(len(seen)), np.random.default_rng(0)
    )
    for walks in (first, *rounds):
        lengths = np.array([machine.pendulum_length for machine in walks.machines])
        assert len(np.unique(lengths)) == 10
        wanted = lengths[walks.which] / BUILDABLE.voltage_limit
        np.testing.assert_allclose(walks.actions, wanted, rtol=1e-6)


def test_an_expert_whose_walks_all_end_soon_is_refused() -> None:
    forward = learned_policy(lambda observations: np.ones(len(observations)))
    teaching = Teaching(forward, Conditions.of(BUILDABLE, None, None), QUICK, 0)
    first = teaching.first_round()
    soon = first.take(np.flatnonzero(first.when < 75))
    with pytest.raises(ValueError, match=r"expert: all of its walks end within 0.75 s"):
        teaching.later_round(1, soon, forward, np.random.default_rng(0))
