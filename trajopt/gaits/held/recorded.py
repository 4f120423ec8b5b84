"""A held gait's phases, from the states at the ticks."""

from __future__ import annotations

import numpy as np

from rimless_gym.reference import simulate
from rimless_gym.trajectory import Trajectory
from trajopt.gaits.held.replay import Held, Replay, after
from trajopt.ocp.arrays import Array
from trajopt.ocp.schemes import radau_nodes
from trajopt.ocp.trajectory import PhaseTrajectory

#: Nodes of the states within an interval: enough for intervals of 20 ms and more.
NODES: Array = radau_nodes(12)

#: Where in its interval the one value of a held voltage is kept.
MIDDLE: Array = np.array([0.5])


def recorded(held: Held, replay: Replay) -> tuple[PhaseTrajectory, ...]:
    """One phase per step, from touchdown to touchdown.

    Args:
        held: the stride's voltages, from one tick to the same tick of the next stride.
        replay: the stride from the tick after its first touchdown; its last interval has the last
            touchdown, and no interval has two.
    """
    states = _inside(held, replay.states[:-1])
    steps, phases = np.flatnonzero(replay.touchdown_times >= 0.0).tolist(), []
    landings = [_landing(held, replay.states[k], held.voltages[k]) for k in steps]
    first, shift = 0, held.shift
    for i, last in enumerate(steps):
        run = landings[i - 1]
        left = held.hold - run.touchdowns[0].time
        ahead = _after(run, held.hold) - shift  # the part of an interval before the first tick
        lengths = np.full(last - first + 2, held.hold)
        lengths[0], lengths[-1] = left, landings[i].touchdowns[0].time
        volts = held.voltages[np.arange(first - 1, last + 1)]
        phases.append(
            PhaseTrajectory(
                edges=np.concatenate([[0.0], np.cumsum(lengths)]),
                nodes=NODES,
                states=np.concatenate(
                    [ahead[None], states[first:last], _before(landings[i])[None]]
                ),
                control_nodes=MIDDLE,
                controls=volts[:, None, None],
            )
        )
        first, shift = last + 1, np.zeros(4)
    return tuple(phases)


def _inside(held: Held, states: Array) -> Array:
    """States at the nodes of all intervals (ticks, nodes, 4); not where there is a touchdown."""
    inner = [after(held, states, s * held.hold) for s in NODES[1:]]
    return np.stack([states, *inner], axis=1)


def _landing(held: Held, state: Array, volts: float) -> Trajectory:
    """An interval with a touchdown, by the reference simulator."""
    return simulate(held.params, state, lambda t, x: float(volts), held.hold)


def _before(run: Trajectory) -> Array:
    event = run.touchdowns[0]
    return np.vstack([run.state(NODES[:-1] * event.time), event.before])


def _after(run: Trajectory, hold: float) -> Array:
    event = run.touchdowns[0]
    left = hold - event.time
    return np.vstack([event.after, run.state(event.time + NODES[1:] * left)])
