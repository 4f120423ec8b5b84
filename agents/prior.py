"""A feedback law as a learner's prior: a potential for the reward, and starts along its walks.

A learner from nothing finds no efficient gait: untrained walks cost more than they are rewarded,
and the efficient family is a revolution of the pendulum away from what it tries first. A law that
holds an optimal gait knows the way. The learner is not shown what the law does, only how good the
states are that it passes:

- `PotentialShaping` adds the change of a potential to the reward (Ng, Harada and Russell, ICML
  1999): the law's differential value, that is what it will collect from a state on beyond the
  average reward of its gait. It is level above its average on the gait, where the learner may
  find a better one.
- `ReferenceStarts` lets some episodes begin in states of the law's walks (reference state
  initialisation: Peng, Abbeel, Levine and van de Panne, SIGGRAPH 2018).

Both wrap the native vector environment, so that any learner can use them; `agents.sb3.sac` uses
only the second, and adds the potential to the rewards that it samples::

    import gymnasium as gym
    from agents.conditions import Conditions
    from agents.prior import PotentialShaping, ReferenceStarts, law_prior
    from rimless_gym import Task

    prior = law_prior(Conditions(), Task())
    envs = gym.make_vec("RimlessWheel-v0", num_envs=64, autoreset_mode="SameStep")
    envs = PotentialShaping(ReferenceStarts(envs, prior), prior)
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from numpy.typing import NDArray

from agents.conditions import Conditions
from agents.experts import EXPERT
from agents.rollout import Policy, Rollout, controller_policy, draw_starts
from rimless_gym import RimlessWheelVectorEnv
from rimless_gym.checks import extra, real, real_array, require_kind
from rimless_gym.envs.layout import OBSERVATION_SIZE, observe
from rimless_gym.envs.task import TERM_NAMES, Task
from rimless_gym.equations import MODE_NAMES
from rimless_gym.hybrid import OK, motor_voltage, relative_rate
from rimless_gym.kernel.stepping import DPHI, DTHETA, MODE, STATE_SIZE
from rimless_gym.params import WheelParams
from trajopt import periodic_gait
from trajopt.feedback import laws
from trajopt.feedback.law import Floats
from trajopt.pool import announce

with extra("learn"):
    import torch
    from torch import nn

#: What a vector environment's step returns.
Stepped: TypeAlias = tuple[Any, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]

#: The prior that a law is, on the command line.
LAW = "law"

#: The gait that the law holds (m/s): it is not as near to losing the foot as faster ones.
SPEED = 0.56

#: The law's walks: how many from usual starts, and as many from states that clumsy walks visit; for
#: how long, and the part at their end that is on the gait (s).
WALKS, SECONDS, ON_GAIT = 1024, 5.0, 2.0

#: Clumsy walks: how long they are and how long they hold a current (s), the currents' standard
#: deviations in units of that of the stalled motor, and how they begin.
CLUMSY_SECONDS, HELD = 4.0, 0.1
CURRENTS = (0.05, 0.15, 0.4, 1.0)
CLUMSY_STARTS = {"rest": 0.2, "moving": 0.5, "whirling": 0.3}

#: The potential is clipped to these (m): above, to its average on the gait; below, where few states
#: are worse.
LEVEL, LOWEST = 0.0, -1.6

#: How much lower than anywhere else the potential is after a fall (m).
FALL = 0.3

#: How the potential's network is made and fitted.
WIDTH, GRADIENT_STEPS, BATCH_SIZE, LEARNING_RATE = 64, 6000, 2048, 3e-3

#: The share of the episodes that begin in a state of the law's walks.
SHARE = 0.7

#: The seed of the law's walks, and of the fit.
SEED = (20150503,)


@dataclasses.dataclass(frozen=True)
class Prior:
    """What a learner is given of a law.

    Attributes:
        name: of the law.
        params: the machine on which it walks.
        task: whose rewards it collects.
        period: how long it holds a voltage (s).
        states: of its walks, (M, STATE_SIZE).
        potential: observations (N, 6) -> how good they are (m), (N,).
        fallen: the potential after a fall (m).

    Raises:
        TypeError, ValueError: `fallen` or `states` are not finite numbers, `states` are of another
            shape or have unknown modes.
    """

    name: str
    params: WheelParams
    task: Task
    period: float
    states: Floats
    potential: Callable[[NDArray[np.float32]], Floats]
    fallen: float

    def __post_init__(self) -> None:
        real("fallen", self.fallen)
        states = real_array("states", self.states)
        if states.ndim != 2 or not len(states) or states.shape[1] != STATE_SIZE:
            raise ValueError(f"states: must be (M, {STATE_SIZE}) with M >= 1, not {states.shape}")
        if (bad := ~np.isfinite(states).all(axis=1)).any():
            raise ValueError(f"states: {bad.sum()} of {len(states)} are not finite; leave them out")
        if unknown := set(states[:, MODE]) - set(range(len(MODE_NAMES))):
            modes = dict(enumerate(MODE_NAMES))
            raise ValueError(
                f"states: the modes {sorted(map(float, unknown))} must be among {modes}"
            )

    def __str__(self) -> str:
        return self.name

    def require(self, params: WheelParams, task: Task, period: float) -> None:
        """Refuse to be the prior of another machine, task or control period.

        Raises:
            ValueError: it is for another one.
        """
        if params != self.params:
            other = self.params.differences(params)
            raise ValueError(f"prior {self.name}: its machine has {other}; make another")
        for name, wanted in {"task": task, "period": period}.items():
            own = getattr(self, name)
            if own != wanted:
                raise ValueError(f"prior {self.name}: {name} = {own}, not {wanted}; make another")

    def at(self, observations: NDArray[np.float32]) -> Floats:
        """The potential of observations (N, 6), (N,).

        Raises:
            ValueError: it is not finite, or of another shape.
        """
        values = real_array("the potential", self.potential(observations))
        if values.shape != (len(observations),) or not np.isfinite(values).all():
            raise ValueError(
                f"prior {self.name}: its potential of {len(observations)} observations has the "
                f"shape {values.shape}, or is not finite; it must be one finite number for each"
            )
        return values


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A potential that is a network, (N, 6) -> (N, 1), clipped to `LOWEST` and `LEVEL`."""

    network: nn.Module

    def __call__(self, observations: NDArray[np.float32]) -> Floats:
        """The potential of observations (N, 6), (N,) in m."""
        with torch.no_grad():
            fitted = self.network(torch.from_numpy(observations))[:, 0].numpy()
        return np.clip(fitted.astype(np.float64), LOWEST, LEVEL)


def law_prior(
    conditions: Conditions, task: Task, cache: Path | None = None, progress: bool = True
) -> Prior:
    """The prior that the usual feedback law is, on the nominal machine without disturbances.

    Where no law has walked, a potential means nothing. So the law walks from usual starts and from
    states of clumsy walks, as a learner's first ones are.

    Args:
        conditions: machine and control period; no speed is commanded.
        task: whose rewards the law collects.
        cache: folder of start-up controllers that other trainings use too.
        progress: whether to show progress on a terminal.

    Raises:
        ValueError: the law falls from most starts.
        NoGaitError: there is no gait at its speed.
    """
    if progress:
        announce(f"designing {EXPERT} and fitting the potential of its walks (a minute)")
    nominal = Conditions(conditions.params, control=conditions.control)
    gait = periodic_gait(nominal.params, SPEED, hold=nominal.control.period, progress=progress)
    law = controller_policy(nominal.params, laws.design(EXPERT, gait, cache))
    starts = draw_starts(nominal.params, WALKS, SEED), clumsy_states(nominal, WALKS)
    walks = [differential_values(nominal, task, law, each) for each in starts]
    _, observations, values = (np.concatenate(each) for each in zip(*walks, strict=True))
    potential = Fitted(_fitted(observations, np.clip(values, LOWEST, LEVEL)))
    return Prior(
        f"{EXPERT} at {SPEED:g} m/s",
        nominal.params,
        task,
        nominal.control.period,
        walks[0][0],
        potential,
        LOWEST - FALL,
    )


def clumsy_states(conditions: Conditions, count: int) -> Floats:
    """States (count, STATE_SIZE) of walks under random currents, each held for a while."""
    rng, rows = np.random.default_rng(SEED), count // 4
    params, p, period = conditions.params, conditions.params.constants, conditions.control.period
    envs = conditions.envs(rows, autoreset_mode=AutoresetMode.SAME_STEP, starts=CLUMSY_STARTS)
    envs.reset(seed=int(rng.integers(2**31)))
    spread, held, seen = rng.choice(CURRENTS, size=rows), max(1, round(HELD / period)), []
    for k in range(round(CLUMSY_SECONDS / period)):
        if k % held == 0:
            seen.append(envs.states)
            current = spread * rng.standard_normal(rows)
        rates = relative_rate(envs.states[:, DPHI], envs.states[:, DTHETA], p)
        action = motor_voltage(rates, 0.0, p) / params.voltage_limit + current
        envs.step(np.clip(action, -1.0, 1.0)[:, None].astype(np.float32))
    return rng.permutation(np.concatenate(seen))[:count]


def differential_values(
    conditions: Conditions, task: Task, policy: Policy, starts: Floats
) -> tuple[Floats, NDArray[np.float32], Floats]:
    """What a policy collects from each state of its walks on, beyond its average reward.

    Walks that fall are left out.

    Returns:
        States (K, STATE_SIZE), observations (K, 6) and values (m), (K,), 0 on average on the gait.

    Raises:
        ValueError: the policy falls from most starts.
    """
    n, n_gait = (round(t / conditions.control.period) for t in (SECONDS, ON_GAIT))
    states = np.zeros((n, *starts.shape))
    observations = np.zeros((n, len(starts), OBSERVATION_SIZE), dtype=np.float32)
    rewards, fell = np.zeros(states.shape[:2]), np.zeros(len(starts), dtype=bool)
    for k, interval in enumerate(Rollout(conditions, policy, starts, n, task=task)):
        states[k, interval.running] = interval.states
        observations[k, interval.running] = interval.observations
        rewards[k, interval.running] = sum(interval.info[name] for name in TERM_NAMES)
        fell[interval.running] = interval.info["failure"] != OK
    if fell.mean() > 0.5:
        raise ValueError(f"prior: the law falls from {fell.mean():.0%} of its starts; use another")
    # Medians over the walks: a few are not on the gait yet.
    rewards = rewards[:, ~fell] - np.median(rewards[-n_gait:, ~fell].mean(axis=0))
    values = rewards[::-1].cumsum(axis=0)[::-1]
    values -= np.median(values[-n_gait:].mean(axis=0))
    first = slice(0, n - n_gait)  # what comes later is cut off too soon
    return (
        states[first, ~fell].reshape(-1, STATE_SIZE),
        observations[first, ~fell].reshape(-1, OBSERVATION_SIZE),
        values[first].ravel(),
    )


def _fitted(observations: NDArray[np.float32], values: Floats) -> nn.Module:
    """A small network, observations (N, 6) -> values (N, 1); global generators stay as they are."""
    torch.set_num_threads(1)  # sums depend on how they are split among threads
    rng = np.random.default_rng(SEED)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        network = nn.Sequential(
            *(nn.Linear(OBSERVATION_SIZE, WIDTH), nn.Tanh()),
            *(nn.Linear(WIDTH, WIDTH), nn.Tanh()),
            nn.Linear(WIDTH, 1),
        )
    optimizer = torch.optim.Adam(network.parameters(), lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, GRADIENT_STEPS)
    seen, wanted = torch.from_numpy(observations), torch.from_numpy(values.astype(np.float32))
    for _ in range(GRADIENT_STEPS):
        batch = torch.from_numpy(rng.integers(len(values), size=BATCH_SIZE))
        loss = nn.functional.mse_loss(network(seen[batch])[:, 0], wanted[batch])
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        schedule.step()
    return network


class WithPrior(VectorWrapper[Any, Any, Any, Any, Any]):
    """A wrapper around the native vector environment.

    Args:
        env: native vector environment that resets in the same step, perhaps wrapped.
        prior: of its machine, task and control period.

    Raises:
        TypeError: it is another environment.
        ValueError: it resets itself at another time, or the prior does not fit.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], prior: Prior) -> None:
        super().__init__(env)
        require_kind("prior", prior, Prior)
        native = env.unwrapped
        if not isinstance(native, RimlessWheelVectorEnv):
            raise TypeError(f"env = {env}: must be gym.make_vec('RimlessWheel-v0', ...)")
        if native.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ValueError(
                f"autoreset_mode = {native.autoreset_mode}: make the environment with "
                "autoreset_mode=AutoresetMode.SAME_STEP"
            )
        if native.control.speeds is not None:
            raise ValueError(
                f"speeds = {native.control.speeds}: a prior holds one gait; take RimlessWheel-v0"
            )
        for params, task in zip(native.params, native.tasks, strict=True):
            prior.require(params, task, native.control.period)
        self.native, self.prior = native, prior


class PotentialShaping(WithPrior):
    """Adds the change of a prior's potential to the reward.

    The change is not discounted, as befits a differential value: so the reward of every interval of
    the law's own walks is about the average one of its gait, however long its start-up takes.

    Attributes:
        weight: how much more the potential counts than the reward, which is divided by it.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], prior: Prior) -> None:
        super().__init__(env, prior)
        self.weight = 1.0
        self._states, self._values = np.empty((0, STATE_SIZE)), np.empty(0)

    def step(self, actions: Any) -> Stepped:
        """What the environment returns, with other rewards.

        Raises:
            ValueError: the potential is not finite.
        """
        native, prior = self.native, self.prior
        if np.array_equal(native.states, self._states):  # no episode began since the last step
            before = self._values
        else:
            before = prior.at(observe(prior.params, native.states))
        seen, rewards, terminated, truncated, info = self.env.step(actions)
        self._states = native.states
        reached = observe(prior.params, self._states)  # without sensor noise, as before
        if "_final_obs" in info:
            ended = info["_final_obs"]
            reached[ended] = np.stack(info["final_obs"][ended])
            self._states[ended] = np.nan
        self._values = prior.at(reached)
        after = np.where(terminated, prior.fallen, self._values)
        return seen, rewards / self.weight + (after - before), terminated, truncated, info


class ReferenceStarts(WithPrior):
    """Begins a share of the episodes in states of a prior's walks.

    Resets with a given state are left as they are.
    """

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Start episodes, some of them in states of the prior's walks."""
        seen, info = self.env.reset(seed=seed, options=options)
        options = options or {}
        if options.keys() & {"state", "mode"}:
            return seen, info
        rows = options.get("reset_mask", np.ones(self.num_envs, dtype=bool))
        return self._begin(rows, seen, info), info

    def step(self, actions: Any) -> Stepped:
        """What the environment returns; some of the episodes that begin do so on the way."""
        seen, rewards, terminated, truncated, info = self.env.step(actions)
        ended = terminated | truncated
        if ended.any():
            seen = self._begin(ended, seen, info)
        return seen, rewards, terminated, truncated, info

    def _begin(self, rows: NDArray[np.bool_], seen: Any, info: dict[str, Any]) -> Any:
        """Begin some of the rows again; the rows' own generators decide which, and where."""
        generators, states = self.native.np_random, self.prior.states
        chosen = [i for i in np.flatnonzero(rows) if generators[i].random() < SHARE]
        if not chosen:
            return seen
        begin = states[[generators[i].integers(len(states)) for i in chosen]]
        mask = np.isin(np.arange(self.num_envs), chosen)
        modes = [MODE_NAMES[int(mode)] for mode in begin[:, MODE]]
        info["mode"][chosen] = begin[:, MODE]
        options = {"state": begin[:, :4], "mode": modes, "reset_mask": mask}
        return self.env.reset(options=options)[0]
