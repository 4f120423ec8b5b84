"""The study `rejax_ppo`: PPO of rejax with a law as its prior, all on the accelerator at hand.

Its hyperparameters are those of `rimless train --algo ppo --prior law`, of which rejax knows no
schedules, no starts and no potential: they are here, as docs/learning.md describes them. What is
trained is saved as PPO of stable-baselines3, so that `rimless evaluate` measures it and `rimless
train --init` goes on from it.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import trange

from agents import prior as law
from agents.cli.options import Count, MaybeCount
from agents.conditions import Conditions
from agents.learner import LAST, NO_CHANGES, PRIOR, SCRATCH, Training
from agents.policy_files import save_policy
from agents.prior import Fitted, Prior, law_prior
from agents.sb3.feedforward import RATES, BackEmfFeedforward, back_emf_gains
from agents.sb3.hyperparameters import Hyperparameters
from agents.sb3.learner import Ppo, put_weights, weights_of
from rimless_gym.checks import extra
from rimless_gym.envs.task import Task
from rimless_gym.kernel.stepping import HybridState

with extra("jax"):
    import jax
    import jax.numpy as jnp

    from rimless_gym.jax import EnvState, WheelEnv, compiler_options
with extra("peers"):  # rejax itself by `make peers`
    import optax
    from rejax import PPO

#: The weights of an actor in stable-baselines3, in the order of rejax's; those are transposed.
NAMES = tuple(
    f"{layer}.{part}"
    for layer in ("action_net", "mlp_extractor.policy_net.0", "mlp_extractor.policy_net.2")
    for part in ("bias", "weight")
)


class PriorParams(NamedTuple):
    """Steps of an episode, and how much more the potential counts than the reward."""

    max_steps_in_episode: Any
    weight: Any = 1.0


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class PriorEnv(WheelEnv):
    """The task with a prior: its starts, and its potential in the reward.

    Args:
        prior: whose potential is a fitted network.
        episode: steps of an episode.
        scale: the deviation from the back-EMF for an action of 1, in voltage limits.
    """

    prior: Prior
    episode: int
    scale: float

    @property
    def default_params(self) -> Any:
        """Episodes of so many steps."""
        return PriorParams(self.episode)

    def reset(self, key: Any, params: Any = None) -> tuple[Any, EnvState]:
        """Begin an episode, perhaps in a state of the law's walks."""
        usual_key, place_key, share_key = jax.random.split(key, 3)
        _, state = super().reset(usual_key)
        row = jax.random.choice(place_key, jnp.asarray(self.prior.states, self.dtype))
        wheel = HybridState(*row[:4], *row[4:].astype(jnp.int32))
        chosen = jax.random.uniform(share_key) < law.SHARE
        wheel = jax.tree.map(lambda x, y: jnp.where(chosen, x, y), wheel, state.wheel)
        state = state._replace(wheel=wheel)
        return self.observe(state), state

    def step_env(
        self, key: Any, state: EnvState, action: Any, params: Any
    ) -> tuple[Any, EnvState, Any, Any, dict[str, Any]]:
        """With the change of the potential in the reward; an action deviates from the back-EMF.

        The voltage is held for the whole decision. In stable-baselines3 the deviation is.
        """
        back_emf = self.observe(state)[RATES] @ back_emf_gains(self.prior.params)
        action = jnp.clip(back_emf + self.scale * action, -1.0, 1.0)
        final, after, reward, failed, info = super().step_env(key, state, action, params)
        reached = jnp.where(failed, self.prior.fallen, self.potential(final))
        reward = reward / params.weight + reached - self.potential(self.observe(state))
        return final, after, reward, failed, info

    def step(self, key: Any, state: EnvState, action: Any, params: Any = None) -> Any:
        """An end by time is not reported; rejax then bootstraps with the value of another start."""
        seen, after, reward, failed, _, info = super().step(key, state, action, params)
        return seen, after, reward, failed, info

    def potential(self, x: Any) -> Any:
        """The potential of an observation (m); see `agents.prior.Fitted`."""
        assert isinstance(self.prior.potential, Fitted)
        weights = [w.detach().numpy() for w in self.prior.potential.network.parameters()]
        *hidden, last, level = weights  # a matrix and a bias for each layer
        for matrix, bias in zip(hidden[::2], hidden[1::2], strict=True):
            x = jnp.tanh(matrix @ x + bias)
        return jnp.clip((last @ x + level)[0], law.LOWEST, law.LEVEL)


def rejax_ppo(
    *, seeds: Count = 1, decisions: MaybeCount = None, out: Path = Path("runs/rejax_ppo")
) -> int:
    """Train with the law as prior, and save the policies for `rimless evaluate`.

    Args:
        seeds: how many are trained at once.
        decisions: of each; by default as many as stable-baselines3's PPO makes with this prior.
        out: folder of a folder for each seed.
    """
    changes = {} if decisions is None else {"n_timesteps": decisions}
    trained(law_prior(Conditions(), Task()), seeds, out, changes)
    return 0


def trained(
    prior: Prior, seeds: int, out: Path, changes: Mapping[str, Any] = NO_CHANGES
) -> list[Path]:
    """Train policies of so many seeds side by side; returns their files.

    `changes` are of the hyperparameters in `agents/hyperparams/ppo.yml`.
    """
    conditions, settings = Conditions(prior.params), Ppo.settings(PRIOR, changes)
    assert isinstance(settings, Hyperparameters)
    trainings = [
        Training("ppo", SCRATCH, seed, conditions, prior.task, settings, prior)
        for seed in range(seeds)
    ]
    learners = [Ppo(training) for training in trainings]
    weights = [weights_of(learner.model) for learner in learners]
    ppo, iterations = ppo_of_rejax(prior, settings)
    state = jax.vmap(ppo.init_state)(jax.vmap(jax.random.key)(jnp.arange(seeds)))
    noise, *_ = jax.tree.leaves(state.actor_ts.params)
    layers = [np.stack([each[name].T for each in weights]) for name in NAMES]
    state = with_actor(state, noise, layers)

    @functools.partial(jax.jit, compiler_options=compiler_options())
    def iterate(state: Any, noise: Any, weight: Any) -> Any:
        log_std, *layers = jax.tree.leaves(state.actor_ts.params)
        state = with_actor(state, jnp.full_like(log_std, jnp.log(noise)), layers)
        now = ppo.replace(env_params=ppo.env_params._replace(weight=weight))
        return jax.vmap(now.train_iteration)(state)

    annealed = [settings.annealed[name] for name in ("noise", "potential")]
    for i in trange(iterations, unit_scale=seeds * settings.n_timesteps // iterations):
        state = iterate(state, *(each.at(i / iterations) for each in annealed))
    _, *layers = map(np.asarray, jax.tree.leaves(state.actor_ts.params))
    files = []
    for seed, (training, learner) in enumerate(zip(trainings, learners, strict=True)):
        actor = {name: layer[seed].T.copy() for name, layer in zip(NAMES, layers, strict=True)}
        put_weights(learner.model, weights[seed] | actor)
        learner.model.num_timesteps = settings.n_timesteps
        files.append(save_policy(out / str(seed) / LAST, training, learner, library="rejax"))
        learner.close()
    return files


def with_actor(state: Any, log_std: Any, layers: Sequence[Any]) -> Any:
    """The state of a training with the logarithm of the noise, and weights as `NAMES`."""
    structure = jax.tree.structure(state.actor_ts.params)
    params = jax.tree.unflatten(structure, [log_std, *layers])
    return state.replace(actor_ts=state.actor_ts.replace(params=params))


def ppo_of_rejax(prior: Prior, settings: Hyperparameters) -> tuple[Any, int]:
    """PPO with these hyperparameters, and its iterations."""
    given, rollout = settings.algorithm, settings.n_envs * settings.algorithm["n_steps"]
    iterations, batches = settings.n_timesteps // rollout, rollout // given["batch_size"]
    if not iterations:
        raise ValueError(
            f"decisions = {settings.n_timesteps}: must be at least {rollout}, a roll-out"
        )
    updates, rate = iterations * given["n_epochs"] * batches, given["learning_rate"]
    ppo = PPO.create(
        env=prior_env(prior, settings),
        num_envs=settings.n_envs,
        num_steps=given["n_steps"],
        num_epochs=given["n_epochs"],
        num_minibatches=batches,
        learning_rate=optax.linear_schedule(rate(1.0), rate(0.0), updates),
        clip_eps=given["clip_range"],
        max_grad_norm=given["max_grad_norm"],
        gamma=given["gamma"],
        gae_lambda=given["gae_lambda"],
        ent_coef=0.0,
        agent_kwargs={"activation": "tanh"},
    )
    return ppo, iterations


def prior_env(prior: Prior, settings: Hyperparameters) -> PriorEnv:
    """The environment of a prior, with the episodes and the steps of the hyperparameters."""
    assert settings.episode_steps is not None
    return PriorEnv(
        params=prior.params,
        task=prior.task,
        control_period=settings.intervals_per_step * prior.period,
        prior=prior,
        episode=settings.episode_steps // settings.intervals_per_step,
        scale=dict(settings.wrappers)[BackEmfFeedforward]["scale"],
    )
