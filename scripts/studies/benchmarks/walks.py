"""Recorded walks: states on an optimal gait that an LQR stabilises, and the LQR's actions.

Replaying recorded actions times the simulator without the LQR, on the motion that matters. Without
feedback a gait is unstable, so replays are short: after 2 s, simulators that agree to rounding
error still walk alike.
"""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rimless_gym import BUILDABLE, WheelParams
from rimless_gym.envs.layout import observe
from rimless_gym.envs.starts import normal_force
from rimless_gym.jit import fingerprint
from rimless_gym.kernel.stepping import MODE, STATE_SIZE

Floats = NDArray[np.float64]

PARAMS: WheelParams = BUILDABLE
SPEED, STEPS = 0.5, 1
WALKS, SETTLING, RECORDED = 128, 1000, 2000

#: Control intervals of one replay, 2 s.
WINDOW = 200

#: Largest difference between states of a replay and the recorded ones (rad, rad/s). A missed or
#: wrong touchdown makes more than a tenth.
TOLERANCE = 1e-4


@dataclasses.dataclass(frozen=True)
class Walks:
    """M pieces of walks, each `WINDOW` control intervals long.

    Attributes:
        starts: phi, theta, phi', theta', (M, 4).
        modes: stance modes at the start, (M,), numbered as in `rimless_gym.hybrid`.
        actions: as the environment takes them, (WINDOW, M) float32.
        ends: states (M, 4) after the last interval.
        touchdowns: share of the control intervals that have a touchdown.
    """

    starts: Floats
    modes: NDArray[np.int64]
    actions: NDArray[np.float32]
    ends: Floats
    touchdowns: float

    def take(self, n: int) -> Walks:
        """The first n pieces, repeated if there are fewer."""
        return self.pieces(np.arange(n) % len(self.starts))

    def piece(self, i: int) -> Walks:
        """Only piece i."""
        return self.pieces(np.array([i]))

    def pieces(self, index: NDArray[np.int64]) -> Walks:
        """The pieces of these numbers."""
        return Walks(
            self.starts[index],
            self.modes[index],
            np.ascontiguousarray(self.actions[:, index]),
            self.ends[index],
            self.touchdowns,
        )

    def about(self) -> dict[str, float]:
        """What a worker says of them: the number of `starts`, and the `touchdown_share`."""
        return {"starts": len(np.unique(self.starts, axis=0)), "touchdown_share": self.touchdowns}

    def check(self, states: Floats) -> float:
        """The largest difference (rad, rad/s) of states (M, 4) from the recorded ends.

        Raises:
            RuntimeError: it is above `TOLERANCE`, so the replay was not this walk.
        """
        difference = float(np.abs(states - self.ends).max())
        if not difference <= TOLERANCE:
            raise RuntimeError(f"the replay left the recorded walk by {difference:.3g}")
        return difference

    def check_observations(self, observations: NDArray[np.float32]) -> float:
        """The same for observations (M, 6), in their own units, where states are not known.

        Raises:
            RuntimeError: as for `check`.
        """
        states = np.zeros((len(self.ends), STATE_SIZE))
        states[:, :4] = self.ends  # in single stance, as every piece ends
        difference = float(np.abs(observations - observe(PARAMS, states)).max())
        if not difference <= TOLERANCE:
            raise RuntimeError(f"the replay left the recorded walk by {difference:.3g}")
        return difference


def load_walks(folder: Path) -> Walks:
    """The walks for this version of the sources, which are recorded if the folder has none."""
    path = folder / f"walks-{fingerprint('rimless_gym')}.npz"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part.npz")
        np.savez(part, **dataclasses.asdict(record_walks()))
        os.replace(part, path)
    with np.load(path, allow_pickle=False) as arrays:
        values = {name: arrays[name] for name in arrays.files}
    return Walks(**values | {"touchdowns": float(values["touchdowns"])})


def record_walks(walks: int = WALKS, settling: int = SETTLING, recorded: int = RECORDED) -> Walks:
    """Let the LQR walk from the evaluation protocol's starts, and record the settled walks.

    Args:
        walks: how many.
        settling: control intervals that are not recorded, at the beginning.
        recorded: control intervals after that.

    Raises:
        RuntimeError: a walk ended in a fall.
    """
    # Workers that find recorded walks need none of these.
    from agents.conditions import Conditions
    from agents.policies import controller_policy
    from agents.protocol import PROTOCOL
    from agents.rollout import Rollout, draw_starts
    from trajopt.feedback import laws
    from trajopt.gaits.shipped import nearest

    gait = nearest(PARAMS, SPEED, STEPS)[0]
    expert = controller_policy(PARAMS, laws.design("lqr", gait))

    def policy(states: Floats, observations: NDArray[np.float32]) -> Floats:
        return expert(states, observations).astype(np.float32).astype(np.float64)

    starts = draw_starts(PARAMS, walks, PROTOCOL.seed)
    states, actions, touchdowns = [], [], []
    rollout = Rollout(Conditions(PARAMS), policy, starts, settling + recorded)
    for i, interval in enumerate(rollout):
        if i < settling:
            continue
        states.append(interval.states)
        actions.append(interval.actions.astype(np.float32))
        touchdowns.append(interval.info["touchdowns"] > 0)
        last = interval.after
    if len(last) < walks:
        raise RuntimeError(f"only {len(last)} of {walks} walks lasted")
    states.append(last)
    edges = np.array(states[::WINDOW])  # (windows + 1, walks, STATE_SIZE)
    pieces = np.array(actions).reshape(-1, WINDOW, walks).swapaxes(0, 1)
    first, end = edges[:-1].reshape(-1, STATE_SIZE), edges[1:].reshape(-1, STATE_SIZE)
    whole = Walks(
        first[:, :4],
        first[:, MODE].astype(np.int64),
        pieces.reshape(WINDOW, -1),
        end[:, :4],
        float(np.mean(touchdowns)),
    )
    # reset() takes only states in which the foot presses before there is a voltage.
    return whole.pieces(np.flatnonzero([normal_force(PARAMS, state) > 0 for state in first]))
