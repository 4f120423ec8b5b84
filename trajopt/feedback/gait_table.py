"""A table of feedback laws: the LQR about the gait of every machine near a nominal one.

It has the gaits of machines of which one parameter differs, and their gains, and a parabola through
each of their numbers. The time of a step is the same in all of them, and so is the clock.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Floats, Law
from trajopt.feedback.laws import lqr
from trajopt.feedback.orbit import Clock, Orbit
from trajopt.gaits.periodic import NoGaitError, periodic_gait
from trajopt.gaits.solution import Solution
from trajopt.identification.fit import physical
from trajopt.pool import run
from trajopt.store import Store, key

#: By how much each parameter differs in the table, up and down: a share, and of the slope (rad).
SPREAD, SLOPE_SPREAD = 0.02, math.radians(0.25)

#: How far (in steps) the table is extrapolated in each parameter; a machine farther away in all of
#: them (the root of the sum of squares) has its gait solved for.
FAR = 2.5

#: A gait stays the same if all these change by one share, the resistance the other way. From angles
#: and voltages alone that share is not identified (docs/feedback.md).
ALIKE = {
    **dict.fromkeys(("wheel_mass", "wheel_inertia", "pendulum_mass", "pendulum_inertia"), 1.0),
    **dict.fromkeys(("rotor_inertia", "hub_friction", "hub_damping"), 1.0),
    **dict.fromkeys(("drag", "pendulum_drag"), 1.0),
    "armature_resistance": -1.0,
}

#: Largest second difference of a table's numbers, as a share of their largest first difference:
#: beyond, the optimum jumps to another branch within the table.
BENT = 0.5

#: Gentler than the LQR's own, which must hold machines that are not known (`lqr.GENTLE`, `BLEND`):
#: what is left of a wrong model then costs less. An identified machine has a firmer blend, and a
#: still firmer one on a slope beyond the table: up one degree a gentler one leaves the wheel in
#: another cycle, for a third more, and 0.1 for 2 to 4 % more.
TABLE_GENTLE, TABLE_BLEND, IDENTIFIED_BLEND, STEEP_BLEND = 1.0, 0.2, 0.1, 0.05


@dataclasses.dataclass(frozen=True, repr=False)
class GaitTable:
    """Gaits and gains as quadratic functions of each parameter by itself.

    Attributes:
        gait: the nominal one.
        law: the nominal law.
        names: of k parameters.
        rows: `flat` laws (2 k + 1, m): the nominal one, then one with each parameter a step more
            and one with it a step less.
    """

    gait: Solution
    law: Law
    names: tuple[str, ...]
    rows: Floats

    @classmethod
    def about(cls, gait: Solution, folder: Path | None = None) -> GaitTable:
        """Solve for the gaits, which takes some 3 s of one core each.

        Args:
            gait: the nominal one, held for a control period.
            folder: where finished rows are stored; None: nowhere.

        Raises:
            ValueError: a machine that differs has no such gait, or too different a law.
        """
        nominal = gait.params
        names = (*physical(nominal), "slope")
        machines = [nominal] + [
            dataclasses.replace(nominal, **{name: getattr(nominal, name) + sign * step})
            for name, step in zip(names, _steps(nominal, names), strict=True)
            for sign in (1, -1)
        ]
        states = np.stack([phase.states[0, 0] for phase in gait.phases])
        common = {"states": states, "duration": gait.duration, "gentle": TABLE_GENTLE}
        keys = [key("flat_law", params=each, **common) for each in machines]
        store = None if folder is None else Store(folder)
        rows = {k: store.load(k) for k in keys if store is not None and k in store}
        todo = [
            Neighbour(gait, each) for each, k in zip(machines, keys, strict=True) if k not in rows
        ]
        for task, row in run(law_of, todo, progress="gaits of changed machines"):
            name = keys[machines.index(task.params)]
            rows[name] = row
            if store is not None:
                store.save(name, row)
        return cls(gait, law_about(gait), names, _smooth_rows([rows[k] for k in keys], gait, names))

    @property
    def params(self) -> WheelParams:
        """The nominal machine."""
        return self.law.params

    def steps(self, params: WheelParams) -> Floats:
        """How many of the table's steps a machine is away in every parameter, (k,).

        The component along `ALIKE`, on which no gait depends, is projected out.
        """
        changes = [getattr(params, name) - getattr(self.params, name) for name in self.names]
        d = np.array(changes) / _steps(self.params, self.names)
        alike = np.array([ALIKE.get(name, 0.0) for name in self.names])
        return np.asarray(d - alike * (alike @ d) / max(alike @ alike, 1.0))

    def has(self, slope: float) -> bool:
        """Whether the table reaches a slope (rad)."""
        return abs(slope - self.params.slope) <= FAR * SLOPE_SPREAD

    def far(self, params: WheelParams) -> bool:
        """Whether a machine is farther away than `FAR`, all parameters together."""
        return bool(np.linalg.norm(self.steps(params)) > FAR)

    def flat_law(self, params: WheelParams) -> Floats:
        """The `flat` law of a machine, (m,); of the nearest one within `FAR`."""
        d = np.clip(self.steps(params), -FAR, FAR)[:, None]
        up, down = self.rows[1::2] - self.rows[0], self.rows[2::2] - self.rows[0]
        return np.asarray(self.rows[0] + ((up - down) * d + (up + down) * d**2).sum(axis=0) / 2)


def _smooth_rows(rows: Sequence[Floats | None], gait: Solution, names: Sequence[str]) -> Floats:
    """The rows of a table; refuses a gait near which the optimum jumps to another branch."""
    for name, up, down in zip(names, rows[1::2], rows[2::2], strict=True):
        if rows[0] is None or up is None or down is None:
            found = "no gait was found that a law holds"
        else:
            bent = np.abs(up + down - 2 * rows[0]).max() / np.abs(up - down).max()
            found = "" if bent < BENT else f"the law bends by {bent:.2f} of its change"
        if found:
            raise ValueError(
                f"{gait.speed:.4g} m/s: with a little more or less of {name}, {found}, of which at "
                f"most {BENT} fits a table; choose another speed, such as 0.566 m/s of BUILDABLE"
            )
    return np.array(rows)


def _steps(params: WheelParams, names: Sequence[str]) -> Floats:
    """By how much parameters differ in a table."""
    return np.array([SLOPE_SPREAD if n == "slope" else SPREAD * getattr(params, n) for n in names])


class Neighbour(NamedTuple):
    """A machine, and a gait of the nominal one, from which its own is continued."""

    gait: Solution
    params: WheelParams


def law_of(task: Neighbour) -> Floats | None:
    """The LQR about the gait of a machine, with the nominal gait's time of a step; flat.

    None where there is no such gait, or none that a law holds.
    """
    gait = task.gait if task.params == task.gait.params else own_gait(*task, 0)
    try:
        return None if gait is None else flat(law_about(gait).data)
    except (ValueError, RuntimeError):
        return None


def own_gait(gait: Solution, params: WheelParams, longer: int) -> Solution | None:
    """The gait of a machine, whose steps last some control periods longer than another's.

    The search starts from the other gait as it is, which takes a second, or, where that is of
    another machine, from what it is continued to.
    """
    as_it_is = dataclasses.replace(gait, params=params)
    for guess in (as_it_is,) if gait.params == params else (as_it_is, gait):
        try:
            return periodic_gait(
                *(params, None, gait.steps, gait.regeneration),
                step_time=gait.duration / gait.steps + longer * CONTROL_PERIOD,
                hold=CONTROL_PERIOD,
                guess=guess,
                progress=False,
            )
        except NoGaitError:
            continue
    return None


def law_about(gait: Solution, ahead: float | None = lqr.AHEAD) -> Law:
    """The LQR about a gait, as the table has it; without a clock if `ahead` is None."""
    law = lqr.design(gait, TABLE_GENTLE, ahead)
    return dataclasses.replace(law, data=law.data._replace(blend=TABLE_BLEND))


def flat(data: lqr.LqrGains) -> Floats:
    """What differs between the laws of two machines, as one row; `gains_of` is the inverse."""
    orbit = data.orbit
    parts = orbit.states, data.gentle, data.firm, orbit.times, data.voltages, data.timing
    columns = (*parts, orbit.continued, orbit.metric, [data.clock.tick])
    return np.concatenate([np.ravel(each).astype(np.float64) for each in columns])


def gains_of(row: Floats, shared: lqr.LqrGains) -> lqr.LqrGains:
    """The law of a `flat` row; what all laws have in common is in `shared`."""
    n = (len(row) - 5) // 16
    states, gentle, firm = row[: 12 * n].reshape(3, n, 4)
    times, volts, timing, continued = row[12 * n : 16 * n].reshape(4, n)
    metric, tick = row[16 * n : 16 * n + 4], float(row[-1])
    orbit = Orbit(states, times, volts, continued > 0.5, metric, shared.orbit.limit)
    clock = Clock(tick, shared.clock.ahead)
    return lqr.LqrGains(orbit, volts, gentle, firm, timing, clock, shared.blend)
