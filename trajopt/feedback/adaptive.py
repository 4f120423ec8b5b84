"""A controller that identifies its machine while it walks, and holds the gait that suits it.

A law about the gait of another machine forces that orbit on this one, and the volts that hold it
there are copper loss. So the controller walks with the nominal law, identifies the machine from
what its encoders have logged, and goes on with the law about that machine's own gait. It takes the
law from a table: the gaits of machines of which one parameter differs, and their gains. The time of
a step stays the same, so that all of them keep to the same clock.

The fitted model has the structure of the simulator's; what it lacks is in docs/feedback.md.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rimless_gym.checks import require_kind
from rimless_gym.equations import DOUBLE
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.jit import cached
from rimless_gym.params import WheelParams
from trajopt.feedback.controller import ContactGuard, margin_for
from trajopt.feedback.law import Floats, Law
from trajopt.feedback.laws import lqr
from trajopt.feedback.orbit import Clock, Orbit, has_clock, located
from trajopt.feedback.startup import StartUpController, lost_return, near_for, startup_for
from trajopt.gaits.periodic import periodic_gait
from trajopt.gaits.solution import Solution
from trajopt.identification.fit import Noise, identify, physical
from trajopt.identification.log import Log, LogError
from trajopt.pool import run
from trajopt.store import Store, key

#: By how much each parameter differs in the table, up and down: a share, and of the slope (rad).
SPREAD, SLOPE_SPREAD = 0.02, math.radians(0.25)

#: Largest change of a number's slope in the table, as a share of its change: beyond, gaits change
#: their kind within it.
BENT = 0.5

#: A machine so many steps away (the root of the sum of squares) has its gait solved for, which
#: takes so long (s); until then it has the table's law, and then the table's with a correction.
FAR, PLANNING = 2.5, 4.0

#: Gentler than the LQR's own, which must hold machines that are not known (`lqr.GENTLE`, `BLEND`):
#: what is left of a wrong model then costs less.
GENTLE, BLEND = 1.0, 0.2

#: When a machine is first identified, and then again and again (s). What earlier fits have found
#: is known to the next one, which takes it to be less sure: its covariance so many times larger.
FIRST, EVERY, FORGETTING = 2.0, 4.0, 1.2
_FIRST, _EVERY = round(FIRST / CONTROL_PERIOD), round(EVERY / CONTROL_PERIOD)


class Neighbour(NamedTuple):
    """One gait of a table: that of a machine, continued from the nominal one's."""

    gait: Solution
    params: WheelParams


class Plan(NamedTuple):
    """By how much a law that is solved for differs from the table's, and the tick when it does."""

    tick: int
    correction: Floats


def law_of(task: Neighbour) -> Floats | None:
    """The LQR about the gait of a machine, with the nominal gait's time of a step; flat.

    None where there is no such gait, or none that a law holds.
    """
    gait, params = task
    try:
        if params != gait.params:
            gait = periodic_gait(
                *(params, None, gait.steps, gait.regeneration),
                step_time=gait.duration / gait.steps,
                hold=CONTROL_PERIOD,
                guess=gait,
                progress=False,
            )
        return flat(law_about(gait).data)
    except (ValueError, RuntimeError):
        return None


def law_about(gait: Solution) -> Law:
    """The LQR about a gait, as the table has it."""
    law = lqr.design(gait, GENTLE)
    return dataclasses.replace(law, data=law.data._replace(blend=BLEND))


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
    def about(
        cls,
        gait: Solution,
        names: Sequence[str] | None = None,
        folder: Path | None = None,
        workers: int | None = None,
    ) -> GaitTable:
        """Solve for the gaits, which takes some 3 s of one core each.

        Args:
            gait: the nominal one, held for a control period.
            names: of the parameters that may differ; by default the physical ones and the slope.
            folder: where finished rows are stored; None: nowhere.
            workers: processes; by default one for every core.

        Raises:
            ValueError: a machine that differs has no such gait, or too different a law.
        """
        nominal = gait.params
        names = (*physical(nominal), "slope") if names is None else tuple(names)
        machines = [nominal] + [
            dataclasses.replace(nominal, **{name: getattr(nominal, name) + sign * step})
            for name, step in zip(names, _steps(nominal, names), strict=True)
            for sign in (1, -1)
        ]
        states = np.stack([phase.states[0, 0] for phase in gait.phases])
        common = {"states": states, "duration": gait.duration, "gentle": GENTLE}
        keys = [key("law", params=each, **common) for each in machines]
        store = None if folder is None else Store(folder)
        rows = {k: store.load(k) for k in keys if store is not None and k in store}
        todo = [
            Neighbour(gait, each) for each, k in zip(machines, keys, strict=True) if k not in rows
        ]
        for task, row in run(law_of, todo, workers, progress="gaits of changed machines"):
            name = keys[machines.index(task.params)]
            rows[name] = row
            if store is not None:
                store.save(name, row)
        return cls(gait, law_about(gait), names, _smooth([rows[k] for k in keys], gait, names))

    @property
    def params(self) -> WheelParams:
        """The nominal machine."""
        return self.law.params

    def steps(self, params: WheelParams) -> Floats:
        """How many of the table's steps a machine is away in every parameter, (k,)."""
        changes = [getattr(params, name) - getattr(self.params, name) for name in self.names]
        return np.array(changes) / _steps(self.params, self.names)

    def at(self, params: WheelParams) -> Floats:
        """The `flat` law of a machine, (m,)."""
        d = self.steps(params)[:, None]
        up, down = self.rows[1::2] - self.rows[0], self.rows[2::2] - self.rows[0]
        return np.asarray(self.rows[0] + ((up - down) * d + (up + down) * d**2).sum(axis=0) / 2)


def _smooth(rows: Sequence[Floats | None], gait: Solution, names: Sequence[str]) -> Floats:
    """The rows of a table; refuses a gait near which others change their kind."""
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


def flat(data: lqr.LqrGains) -> Floats:
    """What differs between the laws of two machines, as one row; see `_voltages`."""
    orbit = data.orbit
    parts = orbit.states, data.gentle, data.firm, orbit.times, data.voltages, data.timing
    return np.concatenate([*(np.ravel(each) for each in parts), orbit.metric, [data.clock.tick]])


@cached()
def _voltages(x, modes, laws, which, shared):  # type: ignore[no-untyped-def]
    """Of states (N, 4): the voltage by law `which[i]` of `laws`, and the squared distance, (N, 2).

    What all laws have in common is in `shared`.
    """
    out, n = np.empty((len(x), 2)), len(shared.orbit.times)
    for i in range(len(x)):
        row = laws[which[i]]
        times, volts, timing = row[12 * n : 13 * n], row[13 * n : 14 * n], row[14 * n : 15 * n]
        orbit = Orbit(
            row[: 4 * n].reshape(n, 4),
            times,
            volts,
            shared.orbit.continued,
            row[15 * n : 15 * n + 4],
            shared.orbit.limit,
        )
        data = lqr.LqrGains(
            orbit,
            volts,
            row[4 * n : 8 * n].reshape(n, 4),
            row[8 * n : 12 * n].reshape(n, 4),
            timing,
            Clock(row[15 * n + 4], shared.clock.ahead),
            shared.blend,
        )
        out[i, 0] = lqr.volts(x[i], modes[i], data)
        out[i, 1] = located(x[i], orbit).squared
    return out


@dataclasses.dataclass(frozen=True, repr=False)
class AdaptiveController:
    """What does not change while it walks; `begin` gives what does.

    Attributes:
        table: of laws.
        startup: leads the nominal machine to its gait; another machine's uses its costs to go.
        near: distance from a gait up to which its law acts.
        margin: of the contact guard.
        noise: of the encoders that log the walk.
        encoders: standard deviation of the errors that are added to the logged angles (rad), where
            a simulation's are exact.
    """

    table: GaitTable
    startup: StartUpController
    near: float
    margin: float
    noise: Noise = dataclasses.field(default_factory=Noise)
    encoders: float = 1e-3

    @classmethod
    def about(
        cls, gait: Solution, folder: Path | None = None, workers: int | None = None
    ) -> AdaptiveController:
        """The controller whose nominal machine and gait are these; see `GaitTable.about`.

        A gait whose voltage is not held for a control period is solved again with that.
        """
        require_kind("gait", gait, Solution)
        if not has_clock(gait):
            gait = periodic_gait(
                *(gait.params, gait.speed, gait.steps, gait.regeneration),
                hold=CONTROL_PERIOD,
                guess=gait,
            )
        table = GaitTable.about(gait, folder=folder, workers=workers)
        near = near_for(table.law)
        startup = startup_for(table.law, near, lost_return(gait), folder)
        return cls(table, startup, near, margin_for(gait))

    @property
    def params(self) -> WheelParams:
        """The nominal machine."""
        return self.table.params

    def begin(self, n: int, seed: int = 0) -> AdaptiveWalks:
        """The memory of `n` walks that begin now; `seed` is that of the encoders' errors."""
        return AdaptiveWalks(self, n, seed)


class AdaptiveWalks:
    """N walks with a controller, each with its own memory and law.

    Args:
        controller: of all.
        n: how many.
        seed: of the encoders' errors.

    Attributes:
        machines: what each is taken to be.
        identified: how often each has been identified.
        tick: how many decisions were made.
    """

    def __init__(self, controller: AdaptiveController, n: int, seed: int = 0) -> None:
        self.controller, self.tick = controller, 0
        self.machines = [controller.params] * n
        self.identified = np.zeros(n, dtype=np.int64)
        self._laws = np.tile(controller.table.rows[:1], (n, 1))
        self._correction = np.zeros_like(self._laws)
        self._planned: list[Plan | None] = [None] * n
        # of what is known of each machine; NaN of one that is as in the table
        self._covariance = np.full(
            (n, len(controller.table.names), len(controller.table.names)), np.nan
        )
        self._rng = [np.random.default_rng([seed, row]) for row in range(n)]
        # phi, theta, foot, mode, V of the last samples, the latest last
        self._memory = np.full((n, round(EVERY / CONTROL_PERIOD), 5), np.nan)

    def __call__(
        self, rows: NDArray[np.int64], states: Floats, modes: NDArray[np.int64], feet: Floats
    ) -> Floats:
        """Voltages of some walks: their numbers (M,), states (M, 4), modes and stance feet (M,)."""
        due = self.tick in (_FIRST, 2 * _FIRST) or (self.tick and self.tick % _EVERY == 0)
        for row in rows.tolist():
            plan = self._planned[row]
            if due:
                self._identify(row)
            elif plan is not None and plan.tick <= self.tick:
                self._correction[row], self._planned[row] = plan.correction, None
                self._laws[row] += plan.correction
        guard = ContactGuard(
            *(self.controller.params, lambda x, m: self._chosen(rows, x, m)),
            self.controller.margin,
        )
        volts = guard(states, modes)
        errors = self.controller.encoders * np.array(
            [self._rng[row].standard_normal(2) for row in rows]
        )
        samples = np.column_stack([states[:, :2] + errors, feet, modes, volts])
        self._memory[rows, :-1] = self._memory[rows, 1:]
        self._memory[rows, -1] = samples
        self.tick += 1
        return volts

    def state(self) -> dict[str, Any]:
        """Everything that is remembered, as JSON values and arrays (`trajopt.store`)."""
        return {
            "tick": self.tick,
            "machines": [each.to_dict() for each in self.machines],
            "laws": self._laws.copy(),
            "correction": self._correction.copy(),
            "covariance": self._covariance.copy(),
            "planned": [None if each is None else list(each) for each in self._planned],
            "identified": self.identified.copy(),
            "memory": self._memory.copy(),
            "random": [each.bit_generator.state for each in self._rng],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a `state` of as many walks with the same controller."""
        self.tick = int(state["tick"])
        self.machines = [WheelParams(**each) for each in state["machines"]]
        self.identified, self._memory = np.array(state["identified"]), np.array(state["memory"])
        self._laws, self._covariance = np.array(state["laws"]), np.array(state["covariance"])
        self._correction = np.array(state["correction"])
        self._planned = [None if each is None else Plan(*each) for each in state["planned"]]
        for each, known in zip(self._rng, state["random"], strict=True):
            each.bit_generator.state = known

    def _chosen(self, rows: NDArray[np.int64], x: Floats, modes: NDArray[np.int64]) -> Floats:
        """The law's voltage near its gait, and the start-up controller's elsewhere."""
        out = _voltages(x, modes, self._laws, rows, self.controller.table.law.data)
        far = (modes == DOUBLE) | (out[:, 1] > self.controller.near**2)
        for i in np.flatnonzero(far):
            startup = dataclasses.replace(self.controller.startup, params=self.machines[rows[i]])
            out[i, 0] = startup(x[i], modes[i])
        return out[:, 0]

    def _identify(self, row: int) -> None:
        """Another law, if what was logged since the last time is of some machine."""
        table, memory = self.controller.table, self._memory[row]
        phi, theta, foot, mode, volts = memory[~np.isnan(memory[:, 0])].T
        self._memory[row] = np.nan
        time = np.asarray(CONTROL_PERIOD * np.arange(len(phi)), dtype=np.float64)
        known = not np.isnan(self._covariance[row]).any()
        try:
            found = identify(
                Log(time, phi, theta, foot, mode, volts),
                self.machines[row] if known else table.params,
                table.names,
                covariance=FORGETTING * self._covariance[row] if known else None,
                noise=self.controller.noise,
            )
        except LogError:
            self._covariance[row] = np.nan  # what was known may be wrong; the law stays
            return
        self.machines[row], self._covariance[row] = found.params, found.covariance
        self._laws[row] = table.at(found.params) + self._correction[row]
        self.identified[row] += 1
        far = np.linalg.norm(table.steps(found.params)) > FAR
        if far and self._planned[row] is None and not self._correction[row].any():
            law = law_of(Neighbour(table.gait, found.params))
            if law is not None:
                ready = self.tick + round(PLANNING / CONTROL_PERIOD)
                self._planned[row] = Plan(ready, law - table.at(found.params))
