"""What every walk must respect, an optimal gait and a learned policy alike.

The model's foot holds whatever it is asked for, and its pendulum swings through the floor. Neither
would be a walk on a real floor. `violations` alone decides that: gaits are verified with it
(`trajopt.gaits.verify`), policies are evaluated with it (`agents.evaluate`), and the environment
flags and penalises slipping by the same limit.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from rimless_gym import hybrid
from rimless_gym.energy import ROW
from rimless_gym.jit import inner
from rimless_gym.params import WheelParams

#: By how much (relative) a walk may exceed a limit: optimal gaits are held to their limits at the
#: nodes of a mesh, and may exceed them a little in between.
LIMIT_TOLERANCE = 1e-3

#: The rules, each by the name of its violation, in the order in which they are checked.
VIOLATIONS = {
    "lifts": "the stance foot is not pressed down",
    "slips": "the stance foot slips",
    "slips_at_touchdown": "a touchdown slips",
    "touches": "the pendulum touches the floor",
}


class Extremes(NamedTuple):
    """The extremes of a walk, named as in `info`."""

    min_normal_force: float  # least normal force in stance (N)
    friction_demand: float  # largest |Fx| / Fy in stance
    impulse_friction_demand: float  # largest |Px| / Py of a touchdown's impulse
    clearance: float  # least height of the pendulum's end over the floor (m)

    @classmethod
    def of_row(cls, row: Any) -> Extremes:
        """Those of a row (len(ROW),) of the kernel, a control interval."""
        return cls(*(float(row[getattr(ROW, name)]) for name in cls._fields))


def violations(params: WheelParams, extremes: Extremes) -> tuple[str, ...]:
    """The rules that a walk breaks, by their names in `VIOLATIONS`; none for a walk that counts.

    A foot must be pressed down, no more: that optimal gaits keep a margin
    (`trajopt.gaits.problem.MIN_NORMAL_FORCE`) is a choice of their design, not a limit of the
    ground.
    """
    broken = {
        "lifts": not extremes.min_normal_force > 0.0,
        "slips": exceeds(extremes.friction_demand, params.friction),
        "slips_at_touchdown": exceeds(extremes.impulse_friction_demand, params.friction),
        "touches": has_floor(params) and extremes.clearance < -_tolerance(params),
    }
    return tuple(name for name in VIOLATIONS if broken[name])


@inner
def exceeds(demand: Any, friction: Any) -> Any:
    """Whether a friction demand makes a foot slip, on ground of this friction coefficient."""
    return demand > friction * (1.0 + LIMIT_TOLERANCE)


def has_floor(params: WheelParams) -> bool:
    """Whether the machine walks on a floor that its pendulum must not touch.

    A pendulum that hangs clear of the ground under the highest hub must clear it always. One that
    is as long as a leg or longer cannot hang over a floor at all: such a machine, as the thesis's
    `THESIS_NOMINAL` and `THESIS_PHYSICAL`, stands for one on a raised track or between two rims of
    legs.
    """
    return _hanging_clearance(params, math.pi / 2) > _tolerance(params)


def least_clearance(params: WheelParams) -> float:
    """The pendulum's least height over the ground (m) in any pose: it hangs, on two feet."""
    return _hanging_clearance(params, params.constants.a)


def may_touch(params: WheelParams) -> bool:
    """Whether the machine has a floor that its pendulum touches in some pose."""
    return has_floor(params) and least_clearance(params) < 0.0


def _hanging_clearance(params: WheelParams, phi: float) -> float:
    return float(hybrid.pendulum_clearance(phi, 0.0, params.constants))


def _tolerance(params: WheelParams) -> float:
    """Depth (m) to which a pendulum may enter the floor."""
    return LIMIT_TOLERANCE * params.leg_length
