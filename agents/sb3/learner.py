"""PPO of stable-baselines3 in our vector environment, and what such learners share."""

from __future__ import annotations

import dataclasses
import math
import random
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.save_util import recursive_getattr
from stable_baselines3.common.utils import check_for_correct_spaces
from stable_baselines3.common.vec_env import VecMonitor
from torch import nn

from agents import learner
from agents.conditions import Conditions
from agents.imitation import CloneReport, Cloning, Teaching, clone
from agents.learner import (
    NO_CHANGES,
    SCRATCH,
    Callback,
    LearnerSettings,
    PolicyParts,
    Training,
    require_known,
)
from agents.prior import PotentialShaping, ReferenceStarts, WithPrior
from agents.rollout import Act, Policy, ShapeChecked
from agents.sb3.feedforward import SCALE, BackEmfFeedforward, Feedforward, commanding_voltages
from agents.sb3.hyperparameters import (
    ACTIVATIONS,
    Annealed,
    Hyperparameters,
    hyperparameters,
    policy_kwargs,
)
from agents.sb3.vec_env import Sb3VecEnv
from agents.sb3.wrappers import training_env, wrapped
from rimless_gym.checks import positive
from rimless_gym.envs import EPISODE_STEPS
from rimless_gym.envs.arguments import USUAL, Control
from rimless_gym.envs.layout import COMMANDED_SIZE
from rimless_gym.envs.speed import PERIOD, SPEEDS
from rimless_gym.envs.task import TERM_NAMES, Task
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Floats

#: Share of a fine-tuning in which only the critic learns.
CRITIC_WARM_UP = 0.15

#: The entries of `info` whose sums are logged.
LOGGED = (*TERM_NAMES, "distance", "elapsed", "electrical_positive", "idle")

#: Fewest control intervals over which they are summed.
LOG_INTERVALS = 2000

#: Counters and rates of stable-baselines3's algorithms that outlast a roll-out.
COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_current_progress_remaining")

#: The columns of a replay buffer.
REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


@dataclasses.dataclass(frozen=True)
class NetworkPolicy:
    """The deterministic policy of a stable-baselines3 `model`: observations -> actions."""

    model: Any
    feedforward: Feedforward | None = None  # to what its actions are added; None: they are voltages

    def __call__(self, observations: NDArray[np.float32]) -> Floats:
        """Actions (N,) in [-1, 1] for observations (N, 6)."""
        actions, _ = self.model.predict(observations, deterministic=True)
        if self.feedforward is not None:
            actions = self.feedforward.voltages(actions, observations)
        return np.asarray(actions[:, 0], dtype=np.float64)


@dataclasses.dataclass(frozen=True)
class Actor:
    """The part of a stable-baselines3 model that chooses actions."""

    model: Any  # to which it belongs
    # the deterministic action (N,) as a differentiable function of observations
    mean_action: Callable[[torch.Tensor], torch.Tensor]
    weights: list[nn.Parameter]  # of that function
    # parameters of the exploration noise that learning changes by themselves
    noise: list[nn.Parameter]
    # gives the noise this natural logarithm of its standard deviation in all states
    set_noise: Callable[[float], None]
    # keeps it so large while learning: PPO's parameter is fixed, SAC has it as target entropy
    hold_noise: Callable[[float], None]

    @property
    def act(self) -> NetworkPolicy:
        """The deterministic policy, for NumPy arrays."""
        return NetworkPolicy(self.model)

    def freeze(self, frozen: bool) -> None:
        """Let learning change only the critic, or the actor too; never the parameters of noise."""
        for parameter in self.noise:
            parameter.requires_grad_(False)
        for weight in self.weights:
            weight.requires_grad_(not frozen)


class Sb3Learner(learner.Learner):
    """An algorithm of stable-baselines3 in our vector environment.

    torch runs on one thread: sums depend on how they are split among threads, and these networks
    are too small to gain from more.

    Attributes:
        algorithm: of stable-baselines3.
        hyperparameter_file: name of its file in `agents/hyperparams`.
        networks: its entries of `net_arch`, and what the names of their weights begin with.
        prior_wrappers: of the native environment, in a training with a prior.
        model: that learns.
    """

    takes_prior = True
    algorithm: ClassVar[Any]
    hyperparameter_file: ClassVar[str]
    networks: ClassVar[Mapping[str, str]]
    prior_wrappers: ClassVar[tuple[type[WithPrior], ...]] = (ReferenceStarts, PotentialShaping)

    def __init__(self, training: Training, start: PolicyParts | None = None) -> None:
        torch.set_num_threads(1)
        settings = training.settings
        if not isinstance(settings, Hyperparameters):
            raise TypeError(f"settings = {settings!r}: must be agents.sb3 Hyperparameters")
        prior = training.prior
        assert not isinstance(prior, str)  # `agents.training.train` makes it
        self.training = training
        self._feedforward: Feedforward | None = None
        for kind, given in settings.wrappers:
            if kind is BackEmfFeedforward:
                self._feedforward = Feedforward(training.conditions.params, given["scale"])
        scale = None if self._feedforward is None else self._feedforward.scale
        if start is not None and start.record.get(SCALE) != scale:
            raise ValueError(
                f"init = {training.init!r}: its actions are {_meaning(start.record.get(SCALE))}, "
                f"and those of this training are {_meaning(scale)}; begin from scratch, or change "
                "vec_env_wrapper"
            )
        self._env = training_env(
            settings.n_envs,
            training.conditions,
            training.task,
            training.seed,
            settings.wrappers,
            settings.episode_steps,
            [partial(kind, prior=prior) for kind in self.prior_wrappers]
            if prior is not None
            else [],
        )
        if start is not None:
            self.require_layers(start)
        self.model = self._new_model({} if start is None else start.record)
        if start is not None:
            put_weights(self.model, start.weights)

    def _new_model(self, described: dict[str, Any], **more: Any) -> Any:
        """A new model with the networks of the hyperparameters, or those that are described."""
        settings = self.training.settings
        assert isinstance(settings, Hyperparameters)
        arguments = {"env": self._env, "seed": self.training.seed, **settings.algorithm, **more}
        if "policy_kwargs" in described:
            arguments["policy_kwargs"] = policy_kwargs(described["policy_kwargs"])
        try:
            return self.algorithm(device="cpu", **arguments)
        except Exception as error:  # stable-baselines3 refuses arguments in many ways
            raise ValueError(f"{error!r}, with the hyperparameters {settings.algorithm}") from error

    @property
    def _shaping(self) -> Any:
        """What adds a prior's potential to the rewards, with a `weight`."""
        return wrapped(self._env, Sb3VecEnv).env

    @staticmethod
    @abstractmethod
    def actor(model: Any) -> Actor:
        """The part of a model of this algorithm that chooses actions."""

    @classmethod
    def settings(cls, init: str, changes: Mapping[str, Any] = NO_CHANGES) -> LearnerSettings:
        """The entry of the algorithm's file in `agents/hyperparams`, as rl-zoo3 writes it."""
        return hyperparameters(cls.algorithm, cls.hyperparameter_file, init, changes)

    @classmethod
    def load(cls, parts: PolicyParts, conditions: Conditions, task: Task) -> Act:
        """The policy in `parts`; its model has stable-baselines3's default settings."""
        torch.set_num_threads(1)
        cls.require_layers(parts)
        model = cls.algorithm(
            policy="MlpPolicy",
            env=training_env(1, conditions, task, seed=0),
            device="cpu",
            policy_kwargs=policy_kwargs(parts.record["policy_kwargs"]),
        )
        put_weights(model, parts.weights)
        model.num_timesteps = int(parts.record["timesteps"])
        model.policy.set_training_mode(False)
        scale = parts.record.get(SCALE)
        return NetworkPolicy(
            model, None if scale is None else Feedforward(conditions.params, positive(SCALE, scale))
        )

    @classmethod
    def require_layers(cls, parts: PolicyParts) -> None:
        """Refuse a record that describes other layers than the weights are of.

        A network is as large as the record describes it, whatever the size of the file.
        """
        described = parts.record["policy_kwargs"]
        units = described.get("net_arch", {})
        critics = described.get("n_critics")
        if critics is not None and f"critic.qf{critics - 1}.0.weight" not in parts.weights:
            raise ValueError(f"n_critics = {critics}: the weights are of others")
        for name, prefix in cls.networks.items():
            asked = units.get(name) if isinstance(units, Mapping) else units
            found = [
                len(weights)
                for layer, weights in parts.weights.items()
                if layer.startswith(prefix) and weights.ndim == 2
            ]
            if asked is not None and list(asked) != found[: len(asked)]:
                raise ValueError(f"net_arch: {name} = {asked}, but the weights are of {found}")

    @property
    def steps(self) -> int:  # type: ignore[override]  # stable-baselines3 counts them
        """Time steps so far, all environments together."""
        return int(self.model.num_timesteps)

    @property
    def act(self) -> Act:
        """The deterministic policy as it is now."""
        return NetworkPolicy(self.model, self._feedforward)

    def imitate(self, expert: Policy, cloning: Cloning, progress: bool) -> CloneReport:
        """Clone the expert into the actor."""
        if self._feedforward is not None:
            raise ValueError(
                "vec_env_wrapper: a clone commands voltages; leave out the feedforward"
            )
        teaching = Teaching(expert, self.training.conditions, cloning, self.training.seed)
        return clone(self.actor(self.model), teaching, progress)

    def learn(self, until: int, callback: Callback) -> None:
        """Learn until there have been `until` steps; a roll-out that was begun is ended.

        Without a prior, the actor of a policy to start from stays as it is for a while.
        """
        env = wrapped(self._env, Sb3VecEnv)
        figures = LogWalking(self.training.conditions.params, env)
        callbacks = [figures, Forward(callback), *self._changing(until)]
        self.model.set_logger(callback.log)
        self.model.learn(max(0, until - self.steps), callbacks, reset_num_timesteps=False)

    def _changing(self, until: int) -> list[BaseCallback]:
        """The callbacks that change settings or weights during the training."""
        actor, settings = self.actor(self.model), self.training.settings
        assert isinstance(settings, Hyperparameters)
        if self.training.prior is not None:
            return [Anneal(actor, settings.annealed, self._shaping)]
        if self.training.init != SCRATCH:
            return [FreezeActor(actor, round(CRITIC_WARM_UP * until))]
        return []

    def parts(self) -> PolicyParts:
        """The networks' architecture and weights."""
        scale = {} if self._feedforward is None else {SCALE: self._feedforward.scale}
        return PolicyParts(
            {"policy_kwargs": architecture(self.model), **scale}, weights_of(self.model)
        )

    def state(self) -> dict[str, Any]:
        """Model, environments and all random generators, between two roll-outs."""
        return {"policy_kwargs": architecture(self.model), **model_state(self.model)}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        if state["policy_kwargs"] != architecture(self.model):
            self.model = self._new_model(state)
        restore_model(self.model, state)

    def close(self) -> None:
        """Close the environments."""
        self._env.close()


class Ppo(Sb3Learner):
    """Proximal policy optimisation (Schulman et al., 2017)."""

    algorithm = PPO
    hyperparameter_file = "ppo.yml"
    networks: ClassVar = {"pi": "mlp_extractor.policy_net.", "vf": "mlp_extractor.value_net."}

    def parts(self) -> PolicyParts:
        """The networks' architecture and weights; the actor commands voltages."""
        parts = super().parts()
        if self._feedforward is None:
            return parts
        return commanding_voltages(parts, self._feedforward)

    @staticmethod
    def actor(model: Any) -> Actor:
        """The Gaussian actor; its noise is the same in all states."""
        policy = model.policy

        def mean_action(observations: torch.Tensor) -> torch.Tensor:
            latent = policy.mlp_extractor.forward_actor(observations)
            return policy.action_net(latent)[:, 0]

        def set_noise(log_std: float) -> None:
            with torch.no_grad():
                policy.log_std.fill_(log_std)

        modules = policy.mlp_extractor.policy_net, policy.action_net
        weights = [weight for module in modules for weight in module.parameters()]

        def hold_noise(log_std: float) -> None:
            policy.log_std.requires_grad_(False)
            set_noise(log_std)

        return Actor(model, mean_action, weights, [policy.log_std], set_noise, hold_noise)


class FineTuner(Ppo):
    """Goes on from a policy of PPO's that walks, without a prior.

    Attributes:
        name: of the learner.
        timesteps: control intervals of a training, unless others are given.
    """

    takes_prior = False
    name: ClassVar[str]
    timesteps: ClassVar[int]

    @classmethod
    def settings(cls, init: str, changes: Mapping[str, Any] = NO_CHANGES) -> LearnerSettings:
        """Those of PPO from a policy, with time steps of its own."""
        if init == SCRATCH:
            raise ValueError(
                f"init = {init!r}: {cls.name} goes on from a policy that walks; begin from "
                "'imitation', or from a policy's file"
            )
        require_known(changes, ["n_timesteps", "policy_kwargs"])
        return super().settings(init, {"n_timesteps": cls.timesteps, **changes})

    def state(self) -> dict[str, Any]:
        """The networks, and the time steps so far."""
        weights = {name: w.copy() for name, w in weights_of(self.model).items()}
        described = {"policy_kwargs": architecture(self.model), "steps": self.steps}
        return {**described, "weights": weights}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        if state["policy_kwargs"] != architecture(self.model):
            self.model = self._new_model(state)
        put_weights(self.model, state["weights"])
        self.model.num_timesteps = int(state["steps"])


def _meaning(scale: Any) -> str:
    """What actions are, in words."""
    return "voltages" if scale is None else f"{scale} times deviations from the back-EMF"


class LogWalking(BaseCallback):
    """Logs the noisy walking of training: `walk/*`, of which `walk/return` is the reward for 20 s.

    Of an action that is held for several control intervals, the last one is logged.
    """

    def __init__(self, params: WheelParams, env: Sb3VecEnv) -> None:
        super().__init__()
        self._weight, self._env = params.weight, env
        self._clear()

    def _clear(self) -> None:
        self._sums, self._falls, self._intervals = np.zeros(len(LOGGED)), 0, 0

    def _on_step(self) -> bool:
        info = self._env.last_info
        self._sums += [info[name].sum() for name in LOGGED]
        self._falls += int(np.count_nonzero(info["failure"]))
        self._intervals += len(info["failure"])
        return True

    def _on_rollout_end(self) -> None:
        if self._intervals >= LOG_INTERVALS:
            self._record()

    def _on_training_end(self) -> None:
        if self._intervals:
            self._record()
        self.logger.dump(self.num_timesteps)

    def _record(self) -> None:
        """Record the figures, and start summing again."""
        sums = dict(zip(LOGGED, self._sums.tolist(), strict=True))
        record, total = self.logger.record, sum(sums[name] for name in TERM_NAMES)
        record("walk/return", total * EPISODE_STEPS * CONTROL_PERIOD / sums["elapsed"])
        record("walk/speed", sums["distance"] / sums["elapsed"])
        record("walk/falls", self._falls)
        if sums["distance"] > 0:
            energy = sums["electrical_positive"] + sums["idle"]
            record("walk/cot", energy / (self._weight * sums["distance"]))
        self._clear()


class Forward(BaseCallback):
    """Calls the callback of a training before every roll-out and at every step."""

    def __init__(self, callback: Callback) -> None:
        super().__init__()
        self._callback = callback

    def _on_rollout_start(self) -> None:
        self._callback.on_iteration()

    def _on_step(self) -> bool:
        self._callback.on_step()
        return True


class Anneal(BaseCallback):
    """Sets the exploration noise and the weight of the potential `shaping`, before every roll-out.

    Noise costs energy, so learning would make it small long before the wheel leaves rest.
    """

    def __init__(self, actor: Actor, annealed: Mapping[str, Annealed], shaping: Any) -> None:
        super().__init__()
        self._actor, self._annealed, self._shaping = actor, annealed, shaping

    def _on_rollout_start(self) -> None:
        done = self.num_timesteps / self.model._total_timesteps
        values = {name: each.at(done) for name, each in self._annealed.items()}
        if "noise" in values:
            self._actor.hold_noise(math.log(values["noise"]))
        if "potential" in values:
            self._shaping.weight = values["potential"]

    def _on_step(self) -> bool:
        return True


class FreezeActor(BaseCallback):
    """Keeps the actor as it is for some time steps, until the critic has learned what it is worth.

    The exploration noise of PPO stays as it is for good; SAC's is held by its target entropy.
    """

    def __init__(self, actor: Actor, until: int) -> None:
        super().__init__()
        self._actor, self._until = actor, until

    def _on_rollout_start(self) -> None:
        self._actor.freeze(self.num_timesteps < self._until)

    def _on_step(self) -> bool:
        return True


def architecture(model: Any) -> dict[str, Any]:
    """The `policy_kwargs` of a model as JSON values, the activation by its name."""
    names = {kind: name for name, kind in ACTIVATIONS.items()}
    kwargs = dict(model.policy_kwargs)
    kwargs.pop("use_sde", None)  # SAC adds it by itself
    if "activation_fn" in kwargs:
        if kwargs["activation_fn"] not in names:
            raise ValueError(f"activation_fn: choose from {list(ACTIVATIONS)}")
        kwargs["activation_fn"] = names[kwargs["activation_fn"]]
    return kwargs


def weights_of(model: Any) -> dict[str, NDArray[Any]]:
    """The weights of a model's networks by name."""
    return {name: w.detach().cpu().numpy() for name, w in model.policy.state_dict().items()}


def put_weights(model: Any, weights: Mapping[str, NDArray[Any]]) -> None:
    """Give a model's networks the weights that `weights_of` named."""
    model.policy.load_state_dict({name: torch.from_numpy(w) for name, w in weights.items()})


def model_state(model: Any) -> dict[str, Any]:
    """The state of a learning model in a `training_env`, between two roll-outs.

    With it a resumed training does exactly what it would have done without a break.
    """
    _, variables = model._get_torch_save_params()
    monitor, replay = wrapped(model.env, VecMonitor), getattr(model, "replay_buffer", None)
    envs = wrapped(model.env, Sb3VecEnv).native.get_state()
    return {
        "parameters": model.get_parameters(),
        "variables": {name: recursive_getattr(model, name) for name in variables},
        "counters": {name: getattr(model, name) for name in COUNTERS if hasattr(model, name)},
        "episodes": model.ep_info_buffer,
        "last_observations": model._last_obs,
        "last_starts": model._last_episode_starts,
        "replay": replay
        and {
            "columns": {name: getattr(replay, name)[: replay.size()] for name in REPLAY},
            "position": replay.pos,
            "full": replay.full,
        },
        "environments": {
            "arrays": {k: v for k, v in envs["batch"].items() if isinstance(v, np.ndarray)},
            "generators": envs["generators"],
            "seen": envs["seen"],
        },
        "monitored": {"returns": monitor.episode_returns, "lengths": monitor.episode_lengths},
        "generators": {
            "torch": torch.get_rng_state(),
            "numpy": np.random.get_state(legacy=False),  # noqa: NPY002  stable-baselines3's
            "python": random.getstate(),
            "actions": model.action_space.np_random.bit_generator.state,
        },
    }


def restore_model(model: Any, state: dict[str, Any]) -> None:
    """Put a new model, made with the same settings, into a state of `model_state`."""
    model.set_parameters(state["parameters"], exact_match=True)
    for name, value in state["variables"].items():
        recursive_getattr(model, name).data.copy_(value)
    for name, value in state["counters"].items():
        setattr(model, name, value)
    model.ep_info_buffer = deque(state["episodes"], maxlen=model._stats_window_size)
    model.ep_success_buffer = deque(maxlen=model._stats_window_size)
    model._last_obs = state["last_observations"]
    model._last_episode_starts = state["last_starts"]
    if state["replay"] is not None:
        buffer, replay = model.replay_buffer, state["replay"]
        for name, column in replay["columns"].items():
            getattr(buffer, name)[: len(column)] = column
        buffer.pos, buffer.full = replay["position"], replay["full"]
    monitor = wrapped(model.env, VecMonitor)
    monitor.episode_returns = state["monitored"]["returns"]
    monitor.episode_lengths = state["monitored"]["lengths"]
    envs, saved = wrapped(model.env, Sb3VecEnv).native, state["environments"]
    arrays = envs.get_state()["batch"] | saved["arrays"]
    envs.set_state({"batch": arrays, "generators": saved["generators"], "seen": saved["seen"]})
    generators = state["generators"]
    torch.set_rng_state(generators["torch"])
    np.random.set_state(generators["numpy"])  # noqa: NPY002
    version, words, gauss = generators["python"]
    random.setstate((version, tuple(words), gauss))
    model.action_space.np_random.bit_generator.state = generators["actions"]


def unpickled(path: Path, params: WheelParams) -> tuple[str, ShapeChecked, Conditions]:
    """The learner, the policy and the conditions of a file of plain stable-baselines3.

    Such files are pickles: reading one runs whatever code it has.
    """
    causes = []
    for name, kind in (("ppo", PPO), ("sac", SAC)):
        try:
            model = kind.load(path, device="cpu")
            (size,) = model.observation_space.shape or ()
            control = Control(PERIOD, speeds=SPEEDS) if size == COMMANDED_SIZE else USUAL
            conditions = Conditions(params, control=control)
            env = training_env(1, conditions, conditions.default_task, seed=0)
            check_for_correct_spaces(env, model.observation_space, model.action_space)
            return name, ShapeChecked(NetworkPolicy(model), size), conditions
        except Exception as error:  # unpickling can raise anything
            causes.append(f"{name}: {error!r}")
    raise ValueError(f"{path}: not a model of a known algorithm ({'; '.join(causes)})")
