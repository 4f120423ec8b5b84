"""Gradients through the simulator: from a policy that walks down to the optimum near it.

Energy that is drawn counts, energy that is fed back does not, so that noise on actions costs
energy, and the policy that is best under noise is not the best without. Here nothing is noisy:
`rimless_gym.jax` is differentiated through a policy's own walk, touchdowns included, over a short
horizon (Xu et al., Accelerated policy learning with parallel differentiable simulation, ICLR 2022).
What comes after the horizon is no fitted critic but the walk itself: for as long again the same
weights act as constants, so that energy taken out of the motion must be put back.

What is minimised is the energy of the walk less the distance times its cost of transport so far:
at the minimum, the cost of transport has no gradient. No gradient leads through a fall, and a walk
of two steps shows nothing of the start-up. So the actions there are tied to the first policy's.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from agents.conditions import require_usual
from agents.imitation import walk
from agents.learner import Callback, PolicyParts, Training
from agents.rollout import draw_starts, learned_policy
from agents.sb3.learner import FineTuner, architecture
from rimless_gym.checks import extra
from rimless_gym.kernel.stepping import HybridState
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Floats

with extra("jax"):
    import jax
    import jax.numpy as jnp

    from rimless_gym.jax import WheelEnv

#: Walks side by side, and the control intervals of the horizon, and of the walk after it.
ROWS, HORIZON = 64, 84

#: Updates of a training, and the rate at its beginning; it falls to 0 along a cosine.
UPDATES, LEARNING_RATE = 60, 1e-4

#: Control intervals of a training.
TIMESTEPS = UPDATES * ROWS * 2 * HORIZON

#: The weight of the squared change of actions in the start-up (m), and in how many states.
TIE, TIED = 10.0, 2048

#: Below this share of the weight the foot's force costs something, and so does a friction demand
#: above this share of the limit: so much at none, or at the limit (m in an interval).
LEAST_FORCE, MOST_FRICTION, UNSAFE = 0.06, 0.94, 0.02

#: A gradient longer than so many times the usual one is shortened.
LONGEST = 3.0

#: The share of the walks that begin anew after each update.
RENEWED = 0.02

#: Ordinary starts, and seconds of their walks; before this time they are in the start-up, after it
#: on the gait.
SHOWN_STARTS, SHOWN, START_UP = 256, 6.0, 2.5

#: A policy's network: weights and biases of its layers.
Layers = tuple[tuple[Any, Any], ...]


class Gradients(FineTuner):
    """Follows the gradient of the cost of transport, from a policy as PPO has it."""

    name, timesteps = "gradients", TIMESTEPS

    def __init__(self, training: Training, start: PolicyParts | None = None) -> None:
        require_usual(self.name, training.conditions)
        super().__init__(training, start)
        activation = architecture(self.model).get("activation_fn", "Tanh")
        if activation != "Tanh":
            raise ValueError(f"activation_fn = {activation!r}: {self.name} needs layers of Tanh")
        self._descent: Descent | None = None

    def learn(self, until: int, callback: Callback) -> None:
        """Update until there have been `until` steps.

        Raises:
            ValueError: the first policy falls from most starts.
        """
        while self.steps < until:
            callback.on_iteration()
            if self._descent is None:
                self._descent = Descent(self.training, self.actor(self.model))
            figures = self._descent.update(self.steps / until)
            self.model.num_timesteps += ROWS * 2 * HORIZON
            for name, value in figures.items():
                callback.log.record(f"gradients/{name}", value)
            callback.on_step()
            callback.log.dump(self.steps)

    def state(self) -> dict[str, Any]:
        """The networks, and the descent."""
        descent = None if self._descent is None else self._descent.state()
        return {**super().state(), "descent": descent}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        super().restore(state)
        if state["descent"] is not None:
            self._descent = Descent(self.training, self.actor(self.model), state["descent"])


class Descent:
    """The walks under way, and the optimiser.

    Raises:
        ValueError: the first policy falls from most starts.
    """

    def __init__(self, training: Training, actor: Any, state: Mapping[str, Any] | None = None):
        self._params, self._actor = training.conditions.params, actor
        self._optimizer = torch.optim.Adam(actor.weights, lr=LEARNING_RATE)
        if state is None:
            state = self._begun(training)
        else:
            self._optimizer.load_state_dict(state["optimizer"])
        self._rng = np.random.default_rng()
        self._rng.bit_generator.state = state["generator"]
        self._gait, self._tied, self._wanted = (state[k] for k in ("gait", "tied", "wanted"))
        self._walks, self._worth, self._usual = (state[k] for k in ("walks", "worth", "usual"))

    def _begun(self, training: Training) -> dict[str, Any]:
        """The first policy's walks from ordinary starts."""
        rng, period = np.random.default_rng((training.seed, 3)), training.conditions.control.period
        lasting, starting = round(SHOWN / period), round(START_UP / period)
        starts = draw_starts(self._params, SHOWN_STARTS, (training.seed, 2))
        given = training.conditions, learned_policy(self._actor.act), starts, lasting
        shown = walk(*given, training.seed)
        lasts = np.bincount(shown.which, minlength=SHOWN_STARTS) == lasting
        if lasts.mean() < 0.5:
            raise ValueError(
                f"init = {training.init!r}: falls within {SHOWN:g} s from {1 - lasts.mean():.0%} "
                f"of {SHOWN_STARTS} starts; begin from a policy that walks"
            )
        early = np.flatnonzero(lasts[shown.which] & (shown.when < starting))
        early = early[rng.integers(len(early), size=10 * TIED)]
        gait = shown.states[lasts[shown.which] & (shown.when >= lasting - starting)]
        gait = gait[rng.integers(len(gait), size=10 * TIED)]
        return {
            "generator": rng.bit_generator.state,
            "gait": gait,
            "tied": shown.observations[early],
            "wanted": shown.actions[early].astype(np.float32),
            "walks": gait[:ROWS],
            "worth": 0.0,
            "usual": 0.0,
        }

    def state(self) -> dict[str, Any]:
        """Everything, as arrays and numbers."""
        return {
            "generator": self._rng.bit_generator.state,
            "optimizer": self._optimizer.state_dict(),
            "gait": self._gait,
            "tied": self._tied,
            "wanted": self._wanted,
            "walks": self._walks,
            "worth": self._worth,
            "usual": self._usual,
        }

    def update(self, done: float) -> dict[str, float]:
        """One step of the optimiser, at a share `done` of the training; figures of the walks."""
        if not self._worth:  # of the first policy's walk
            self._worth = self._walked()[1]
        slopes, cot, alive, after = self._walked()
        size = float(np.sqrt(sum(np.sum(slope**2) for slope in slopes)))
        if np.isfinite(size):
            self._usual = self._usual or size
            self._step([slope * min(1.0, LONGEST * self._usual / size) for slope in slopes], done)
            self._usual += 0.1 * (min(size, LONGEST * self._usual) - self._usual)
        self._worth += 0.1 * (cot - self._worth)
        anew = ~alive | (self._rng.random(ROWS) < RENEWED)
        chosen = self._gait[self._rng.integers(len(self._gait), size=ROWS)]
        self._walks = np.where(anew[:, None], chosen, after)
        return {"cot": cot, "gradient": size, "walking": float(alive.mean())}

    def _walked(self) -> tuple[list[Floats], float, NDArray[np.bool_], Floats]:
        """Slopes by each weight, cost of transport, which walks last, states after the horizon."""
        weights = [w.detach().numpy().astype(np.float64) for w in self._actor.weights]
        layers = tuple(zip(weights[::2], weights[1::2], strict=True))
        with jax.enable_x64(True):
            found = _differentiated(self._params)(layers, self._walks, self._worth)
            slopes, (after, alive, energy, distance) = jax.tree.map(np.asarray, found)
        return (
            [slope for layer in slopes for slope in layer],
            float(energy / distance),
            alive,
            after,
        )

    def _step(self, slopes: list[Floats], done: float) -> None:
        batch = torch.from_numpy(self._rng.integers(len(self._wanted), size=TIED))
        seen, wanted = torch.from_numpy(self._tied)[batch], torch.from_numpy(self._wanted)[batch]
        self._optimizer.zero_grad()
        (TIE * nn.functional.mse_loss(self._actor.mean_action(seen), wanted)).backward()
        for weight, slope in zip(self._actor.weights, slopes, strict=True):
            assert weight.grad is not None
            weight.grad += torch.from_numpy(slope.astype(np.float32))
        for group in self._optimizer.param_groups:
            group["lr"] = LEARNING_RATE * 0.5 * (1 + np.cos(np.pi * min(1.0, done)))
        self._optimizer.step()


@functools.lru_cache(maxsize=2)
def _differentiated(params: WheelParams) -> Any:
    """The gradient of the mean cost of walks (N, STATE_SIZE) by the layers, and what came of them.

    Of each walk: the states after the horizon, and whether it lasted; energy (J per N of weight)
    and distance (m) of those that did, over the horizon.
    """
    env = WheelEnv(params=params, dtype="float64")
    template = env.reset(jax.random.key(0))[1]

    def cost(layers: Layers, states: Any, worth: Any) -> Any:
        def tick(carry: Any, k: Any) -> Any:
            wheels, alive, kept = carry
            acting = jax.tree.map(
                lambda w: jnp.where(k < HORIZON, w, jax.lax.stop_gradient(w)), layers
            )
            seen = jax.vmap(lambda wheel: env.observe(template._replace(wheel=wheel)))(wheels)
            volts = params.voltage_limit * _action(acting, seen)
            moved = jax.vmap(lambda w, u: env.interval(template._replace(wheel=w), u))
            after, totals = moved(wheels, volts)
            alive &= totals.failure == 0
            idle = params.idle_power * totals.elapsed
            energy = (totals.electrical_positive + idle) / params.weight
            light = 1.0 - totals.min_normal_force / (LEAST_FORCE * params.weight)
            slips = totals.friction_demand / params.friction - MOST_FRICTION
            unsafe = jnp.maximum(light, 0.0) + jnp.clip(slips / (1 - MOST_FRICTION), 0.0, 10.0)
            objective = energy - worth * totals.distance + UNSAFE * unsafe
            after, kept = (
                jax.tree.map(functools.partial(jnp.where, test), *both)
                for test, both in ((alive, (after, wheels)), (k < HORIZON, (after, kept)))
            )
            return (after, alive, kept), (objective, energy, totals.distance)

        wheels = HybridState(*states.T[:4], *states.T[4:].astype(jnp.int32))
        begin, ticks = (wheels, jnp.ones(len(states), bool), wheels), jnp.arange(2 * HORIZON)
        (_, alive, kept), rows = jax.lax.scan(tick, begin, ticks)
        objective, *measured = (jnp.where(alive, row, 0.0) for row in rows)
        energy, distance = (row[:HORIZON].sum() for row in measured)
        after = jnp.stack([x.astype(states.dtype) for x in kept], axis=1)
        return objective.sum() / jnp.maximum(alive.sum(), 1), (after, alive, energy, distance)

    return jax.jit(jax.grad(cost, has_aux=True))


def _action(layers: Layers, seen: Any) -> Any:
    """The policy's actions (N,)."""
    *hidden, (last, bias) = layers
    for matrix, shift in hidden:
        seen = jnp.tanh(seen @ matrix.T + shift)
    return jnp.clip((seen @ last.T + bias)[:, 0], -1.0, 1.0)
