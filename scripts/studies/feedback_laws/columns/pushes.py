"""The largest push on the hub that is survived, by phase of the step and direction.

Pushes are those of the environment (`rimless_gym.hybrid.push`). At each phase a row of impulses is
tried; then the first one that is not survived and the one before it are bisected. So all smaller
ones that were tried are survived, too.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.evaluate import Protocol, evaluate
from agents.outcomes import FALLS, STOPS
from rimless_gym.envs.starts import normal_force
from rimless_gym.hybrid import push
from rimless_gym.params import WheelParams
from scripts.studies.feedback_laws.columns.changes import on_the_gait
from scripts.studies.feedback_laws.sizes import Sizes
from scripts.studies.feedback_laws.subject import Walker
from trajopt.feedback.law import Floats

#: A wheel must walk again so long after a push, and for so long (s).
RECOVERY, WALK = 5.0, 3.0

#: The largest impulse that is tried, in units of the machine's momentum on the gait.
LARGEST = 4.0


def pushes(walker: Walker, sizes: Sizes) -> dict[str, Any]:
    """Impulses (N s) at phases of the stride, in shares of its time; both kinds of survival."""
    states = on_the_gait(walker.gait, sizes.phases)
    largest = LARGEST * walker.params.total_mass * walker.gait.speed
    row = largest * (np.arange(sizes.impulses + 1) / sizes.impulses) ** 2  # finer for small ones
    phases = ((np.arange(sizes.phases) + 0.5) / sizes.phases).tolist()
    found: dict[str, Any] = {"phases": phases, "largest_tried": largest}
    for name, sign in (("backward", -1.0), ("forward", 1.0)):
        tried = sign * np.tile(row, len(states))
        all_good = survived(walker, np.repeat(states, len(row), axis=0), tried)
        for kind, good in all_good._asdict().items():
            low, high = _bracket(row, good.reshape(len(states), -1))
            for _ in range(sizes.bisections):
                middle = 0.5 * (low + high)
                fine = getattr(survived(walker, states, sign * middle), kind)
                low, high = np.where(fine, middle, low), np.where(fine, high, middle)
            found[f"{name}_{kind}"] = low.tolist()
    return found


def _bracket(row: Floats, good: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """The last impulse before the first that is not survived, and that one, for each state.

    Args:
        row: impulses, rising from 0, (m,).
        good: whether they are survived, (states, m).
    """
    failing = np.where(good.all(axis=1), len(row), good.argmin(axis=1))
    low, high = row[np.maximum(failing - 1, 0)], row[np.minimum(failing, len(row) - 1)]
    return low, high  # both are 0 where not even no push is survived


class Survived(NamedTuple):
    """Which states survive their pushes.

    Attributes:
        walking: they walk by the rules again, (n,).
        stepping: they take steps again, and perhaps slip or hardly press a foot down, (n,).
    """

    walking: NDArray[np.bool_]
    stepping: NDArray[np.bool_]


def survived(walker: Walker, states: Floats, impulses: Floats) -> Survived:
    """Push states (n, STATE_SIZE) in single stance by impulses (N s), and see what happens."""
    params = walker.params
    pushed = pushed_states(params, states, impulses)
    limit = params.voltage_limit
    pressed = np.array([normal_force(params, state, limit) > 0.0 for state in pushed])
    found = Survived(np.zeros(len(states), dtype=bool), np.zeros(len(states), dtype=bool))
    if pressed.any():
        protocol = Protocol(duration=RECOVERY + WALK, window=WALK, alive=WALK)
        walk = evaluate(walker.policy, params, protocol, starts=pushed[pressed])
        found.walking[pressed] = walk.walking
        found.stepping[pressed] = [outcome not in (FALLS, STOPS) for outcome in walk.outcomes]
    return found


def pushed_states(params: WheelParams, states: Floats, impulses: Floats) -> Floats:
    """Hybrid states after impulses (N s) on the hub along the ground."""
    pushed = states.copy()
    for x, impulse in zip(pushed, impulses, strict=True):
        x[2], x[3] = push(*x[:4], impulse, 0.0, params.constants)
    return pushed
