"""A block, and trajectories of it with any control, for tests of refinement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from trajopt import Phase, PhaseTrajectory
from trajopt.ocp.schemes import radau_nodes


def block(force: float = 1.0) -> Phase:
    return Phase(
        "move",
        states=("x", "v"),
        controls=("u",),
        flow=lambda x, u, p: (x[1], u),
        powers=lambda x, u, p: u * x[1],
        bounds={"u": (-force, force)},
    )


def sampled(
    edges: Sequence[float] | np.ndarray, control: Callable[[np.ndarray], Any], degree: int = 6
) -> PhaseTrajectory:
    """A trajectory whose states and control are those of u = control(t), x = v = 1 + u."""
    nodes, edges = radau_nodes(degree), np.array(edges)
    t = edges[:-1, None] + np.diff(edges)[:, None] * nodes
    u = np.array(control(t))
    return PhaseTrajectory(
        np.array(edges), nodes, np.stack([1 + u, 1 + u], axis=-1), nodes, u[..., None]
    )
