"""The study `rejax_ppo`: PPO of rejax with a law as its prior, all on the accelerator at hand.

rejax knows no schedules, no starts and no potential; they are here, as docs/learning.md describes
them. What is trained is saved as PPO of stable-baselines3, so that `rimless evaluate` measures it
and `rimless train --init` goes on from it.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from agents import prior as law
from agents.cli.options import Count
from agents.conditions import Conditions
from agents.evaluate import evaluate
from agents.learner import LAST, PRIOR, SCRATCH, Training
from agents.policy_files import load_policy, save_policy
from agents.prior import Fitted, Prior, law_prior
from agents.sb3.learner import Ppo, put_weights, weights_of
from rimless_gym.checks import extra
from rimless_gym.envs.task import Task
from rimless_gym.kernel.stepping import HybridState

with extra("jax"):
    import jax
    import jax.numpy as jnp

    from rimless_gym.jax import EnvState, RejaxEnv
with extra("peers"):  # rejax itself by `make peers`
    import optax
    from flax import struct
    from rejax import PPO

#: How long an action is held (s), and how many of them are an episode.
PERIOD, EPISODE = 0.02, 250

#: The hyperparameters, of networks of 64 x 64; the rate falls to a fiftieth.
RATE, LAST_RATE = 0.0013, 0.02
SETTINGS = {"gamma": 0.95, "gae_lambda": 0.95, "clip_eps": 0.3, "ent_coef": 0.0}
SIZE = {"num_envs": 1024, "num_steps": 32, "num_minibatches": 8, "num_epochs": 4}

#: The noise on actions, and the share of the training after which it falls to the last.
NOISE, LAST_NOISE, HELD = 0.088, 0.0285, 0.3

#: How many times as much as the reward the potential counts: at first, and in the end. It falls in
#: this part of the training.
WEIGHT, LAST_WEIGHT, FALLS = 7.2, 1.7, (0.4, 0.9)

#: The layers of an actor in stable-baselines3.
LAYERS = "mlp_extractor.policy_net.0", "mlp_extractor.policy_net.2", "action_net"


class PriorParams(NamedTuple):
    """What changes during the training."""

    max_steps_in_episode: Any = EPISODE
    weight: Any = WEIGHT


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class PriorEnv(RejaxEnv):
    """The task with a prior: its starts, and its potential in the reward.

    Args:
        layers: weights and biases of the potential's network.
        states: of the law's walks, (M, STATE_SIZE).
        fallen: the potential after a fall (m).
    """

    layers: tuple[tuple[Any, Any], ...]
    states: Any
    fallen: float

    @property
    def default_params(self) -> Any:
        """Episodes of 5 s."""
        return PriorParams()

    def reset(self, key: Any, params: Any = None) -> tuple[Any, EnvState]:
        """Begin an episode, perhaps in a state of the law's walks."""
        usual_key, place_key, share_key = jax.random.split(key, 3)
        _, state = super().reset(usual_key)
        row = jnp.asarray(self.states)[jax.random.randint(place_key, (), 0, len(self.states))]
        wheel = HybridState(*row[:4], *row[4:].astype(jnp.int32))
        chosen = jax.random.uniform(share_key) < law.SHARE
        wheel = jax.tree.map(lambda x, y: jnp.where(chosen, x, y), wheel, state.wheel)
        state = state._replace(wheel=wheel)
        return self.observe(state), state

    def step(
        self, key: Any, state: EnvState, action: Any, params: Any = None
    ) -> tuple[Any, EnvState, Any, Any, dict[str, Any]]:
        """An end by time is not reported; rejax then bootstraps with the value of another start."""
        params = params or self.default_params
        before = self.potential(self.observe(state))
        final, after, reward, failed, info = self.step_env(key, state, action, params)
        reached = jnp.where(failed, self.fallen, self.potential(final))
        reward = reward / params.weight + reached - before
        ends = failed | (after.time >= params.max_steps_in_episode)
        first, begun = self.reset(key)
        seen, following = jax.tree.map(
            lambda x, y: jnp.where(ends, x, y), (first, begun), (final, after)
        )
        return seen, following, reward, failed, info

    def potential(self, x: Any) -> Any:
        """The potential of an observation (m); see `agents.prior.Fitted`."""
        *hidden, (weights, biases) = self.layers
        for matrix, shift in hidden:
            x = jnp.tanh(matrix @ x + shift)
        return jnp.clip((weights @ x + biases)[0], law.LOWEST, law.LEVEL)


class PriorPPO(PPO):
    """PPO with schedules for a training of so many `decisions`."""

    decisions: int = struct.field(pytree_node=False, default=1)

    def train_iteration(self, state: Any) -> Any:
        """One roll-out and its updates, with the noise and the weight of this moment."""
        done = state.global_step / self.decisions
        late = jnp.clip((done - HELD) / (1 - HELD), 0.0, 1.0)
        log_std = (1 - late) * jnp.log(NOISE) + late * jnp.log(LAST_NOISE)
        params = {**state.actor_ts.params["params"], "action_log_std": jnp.full(1, log_std)}
        state = state.replace(actor_ts=state.actor_ts.replace(params={"params": params}))
        late = jnp.clip((done - FALLS[0]) / (FALLS[1] - FALLS[0]), 0.0, 1.0)
        weight = WEIGHT ** (1 - late) * LAST_WEIGHT**late
        now = self.replace(env_params=PriorParams(weight=weight))
        return super(PriorPPO, now).train_iteration(state)


def rejax_ppo(
    *, seeds: Count = 1, decisions: Count = 6_900_000, out: Path = Path("runs/rejax_ppo")
) -> int:
    """Train with the law as prior, save the policies, and evaluate them by the protocol.

    Args:
        seeds: how many are trained at once.
        decisions: of each, every 20 ms.
        out: folder of a folder for each seed.
    """
    for file in trained(law_prior(Conditions(), Task()), seeds, decisions, out):
        walks = evaluate(load_policy(file).policy, progress=False)
        share = f"{100 * walks.walking_share:.0f} % of the starts walk"
        print(f"{file}: {share}, CoT {walks.cot:.4f} at {walks.speed:.3f} m/s", flush=True)
    return 0


def trained(
    prior: Prior, seeds: int, decisions: int, out: Path, size: Mapping[str, int] = SIZE
) -> list[Path]:
    """Train policies of so many seeds side by side; returns their files."""
    conditions = Conditions(prior.params)
    trainings = [
        Training("ppo", SCRATCH, seed, conditions, prior.task, Ppo.settings(PRIOR), prior)
        for seed in range(seeds)
    ]
    learners = [Ppo(training) for training in trainings]
    actors = [to_rejax(weights_of(learner.model)) for learner in learners]
    iterations = decisions // (size["num_envs"] * size["num_steps"])
    updates = iterations * size["num_epochs"] * size["num_minibatches"]
    rate = optax.linear_schedule(RATE, LAST_RATE * RATE, updates)
    settings = {"agent_kwargs": {"activation": "tanh"}, "learning_rate": rate, **SETTINGS, **size}
    ppo = PriorPPO.create(env=prior_env(prior), decisions=decisions, **settings)
    state = jax.vmap(ppo.init_state)(jax.vmap(jax.random.key)(jnp.arange(seeds)))
    params = state.actor_ts.params["params"] | jax.tree.map(lambda *x: np.stack(x), *actors)
    state = state.replace(actor_ts=state.actor_ts.replace(params={"params": params}))
    iterate = jax.jit(jax.vmap(ppo.train_iteration))
    state = jax.block_until_ready(iterate(state))  # compiles
    begin = time.perf_counter()
    for _ in range(iterations - 1):
        state = iterate(state)
    params = jax.tree.map(np.asarray, state.actor_ts.params["params"])
    fast = seeds * (iterations - 1) * size["num_envs"] * size["num_steps"]
    print(f"{fast / (time.perf_counter() - begin):,.0f} decisions per second", flush=True)
    files = []
    for seed, (training, learner) in enumerate(zip(trainings, learners, strict=True)):
        actor = from_rejax(jax.tree.map(lambda x, seed=seed: x[seed], params))
        put_weights(learner.model, weights_of(learner.model) | actor)
        learner.model.num_timesteps = decisions
        files.append(save_policy(out / str(seed) / LAST, training, learner, library="rejax"))
        learner.close()
    return files


def prior_env(prior: Prior) -> PriorEnv:
    """The environment of a prior whose potential is a fitted network."""
    assert isinstance(prior.potential, Fitted)
    layers = [m for m in prior.potential.network.modules() if isinstance(m, torch.nn.Linear)]
    return PriorEnv(
        params=prior.params,
        task=prior.task,
        control_period=PERIOD,
        layers=tuple((m.weight.detach().numpy(), m.bias.detach().numpy()) for m in layers),
        states=prior.states.astype(np.float32),
        fallen=prior.fallen,
    )


def to_rejax(weights: Mapping[str, Any]) -> dict[str, Any]:
    """An actor of stable-baselines3 as one of rejax."""
    first, second, last = (
        {"kernel": weights[f"{name}.weight"].T, "bias": weights[f"{name}.bias"]} for name in LAYERS
    )
    return {"features": {"Dense_0": first, "Dense_1": second}, "action_mean": last}


def from_rejax(actor: Mapping[str, Any]) -> dict[str, Any]:
    """The inverse of `to_rejax`."""
    hidden = (actor["features"][f"Dense_{i}"] for i in range(2))
    weights = dict[str, Any]()
    for name, layer in zip(LAYERS, (*hidden, actor["action_mean"]), strict=True):
        weights |= {f"{name}.weight": layer["kernel"].T.copy(), f"{name}.bias": layer["bias"]}
    return weights
