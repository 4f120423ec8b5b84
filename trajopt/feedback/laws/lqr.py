"""LQR near the gait, lookahead far from it, and a guard that keeps the foot pressed down."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from rimless_gym.checks import positive
from rimless_gym.hybrid import DOUBLE, SINGLE
from trajopt.feedback.guard import Guarded
from trajopt.feedback.law import Controller, Floats, states_and_modes
from trajopt.feedback.lookahead import Follower, Lookahead, Plan
from trajopt.feedback.lqr import TransverseLqr, follow
from trajopt.gaits.solution import Solution

#: Number of voltages that the lookahead tries, evenly spread between the limits.
CANDIDATES = 11


@dataclasses.dataclass(frozen=True)
class LimitCycleLqr:
    """The LQR in single stance near its gait, the lookahead everywhere else; no memory.

    Attributes:
        lqr: the LQR.
        lookahead: on where the LQR leads.
        near: distance from the gait up to which the LQR acts alone, in standard deviations of the
            gait's own motion.
    """

    lqr: TransverseLqr
    lookahead: Lookahead
    near: float = 0.5

    @classmethod
    def from_solution(
        cls, solution: Solution, *, effort: float = 0.1, near: float = 0.5
    ) -> LimitCycleLqr:
        """The law for a gait.

        Args:
            solution: the gait.
            effort: see `TransverseLqr.from_solution`.
            near: see above; > 0.

        Raises:
            TypeError: an argument is of the wrong type.
            ValueError: a number is not finite and positive.
        """
        lqr = TransverseLqr.from_solution(solution, effort=effort)
        limit = solution.params.voltage_limit
        plan = Plan(np.linspace(-limit, limit, CANDIDATES))
        lookahead = Lookahead(solution.params, Follower(follow, lqr.orbit), plan)
        return cls(lqr, lookahead, positive("near", near))

    def __call__(self, x: ArrayLike, mode: ArrayLike = SINGLE) -> Floats:
        """Voltages for states.

        Args:
            x: states, shape (N, 4) or (4,).
            mode: stance modes, shape (N,), or one for all states.

        Returns:
            Volts within the limit, shape (N,) or ().

        Raises:
            TypeError: the states or modes are not real numbers.
            ValueError: they have another shape, or a mode is neither SINGLE nor DOUBLE.
        """
        states, modes = states_and_modes(x, mode)
        volts, squared_distances = self.lqr(states)
        far = (modes == DOUBLE) | (squared_distances > self.near**2)
        if far.any():
            volts[far] = self.lookahead(states[far], modes[far])
        return volts if np.ndim(x) == 2 else volts[0]


def design(solution: Solution) -> Controller:
    """The law that holds a gait, and joins it from rest and from most other starts.

    Args:
        solution: the gait.

    Raises:
        TypeError: `solution` is not a `trajopt.Solution`.
    """
    return Guarded(solution.params, LimitCycleLqr.from_solution(solution))
