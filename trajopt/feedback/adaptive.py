"""A controller that identifies its machine while it walks, and holds the gait that suits it.

A law about the gait of another machine forces that orbit on this one, and the volts that hold it
there are copper loss. So the controller walks with the nominal law, identifies the machine from
what its encoders have logged, and goes on with the law about that machine's own gait. It takes the
law from a table: the gaits of machines of which one parameter differs, and their gains. The time of
a step stays the same, so that all of them keep to the same clock.

Near the speed of least cost, where the wheel hardly falls from foot to foot, there is no such
table: a little more of a parameter, and the gait changes its kind. The nominal law falls there, and
so it walks with a slower gait until it has solved for the identified machine's own.

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
from trajopt.gaits.periodic import NoGaitError, periodic_gait
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

#: After so many fits the wanted gait is solved for, where it is not the table's: each time, about
#: twice as much is known.
REPLANNED = (2, 4, 8, 16)

#: Least rate of the leg at a touchdown (rad/s) of the gait that is walked first.
LANDING = 0.75

#: Gentler than the LQR's own, which must hold machines that are not known (`lqr.GENTLE`, `BLEND`):
#: what is left of a wrong model then costs less.
GENTLE, BLEND = 1.0, 0.2

#: When a machine is first identified, and then again and again (s). What earlier fits have found
#: is known to the next one, which takes it to be less sure: its covariance so many times larger.
FIRST, EVERY, FORGETTING = 2.0, 4.0, 1.2
_FIRST, _EVERY = round(FIRST / CONTROL_PERIOD), round(EVERY / CONTROL_PERIOD)


class Neighbour(NamedTuple):
    """A machine, and a gait of the nominal one, from which its own is continued.

    Its steps may last up to `longest` control periods longer.
    """

    gait: Solution
    params: WheelParams
    longest: int = 0


class Plan(NamedTuple):
    """The law about the gait of an identified machine, and the tick from which on it is used."""

    tick: int
    params: WheelParams
    law: Floats


def law_of(task: Neighbour) -> Floats | None:
    """The LQR about the gait of a machine; flat.

    Its steps last as long as the nominal ones or, as long as that costs less, one or more periods
    longer. None where there is no such gait, or none that a law holds.
    """
    best: Solution | None = None
    try:
        for longer in range(task.longest + 1):
            gait = task.gait if task.params == task.gait.params else _own(*task[:2], longer)
            if gait is None or not gait.verification.passed:
                continue
            if best is not None and gait.cot >= best.cot:
                break
            best = gait
        return None if best is None else flat(law_about(best).data)
    except (ValueError, RuntimeError):
        return None


def _own(gait: Solution, params: WheelParams, longer: int) -> Solution | None:
    """The gait of a machine, whose steps last some control periods longer than another's.

    The search starts from the other gait as it is, which takes a second, or from that which is
    continued to this machine.
    """
    for guess in (dataclasses.replace(gait, params=params), gait):
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
        keys = [key("flat_law", params=each, **common) for each in machines]
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
    """What differs between the laws of two machines, as one row; `_gains` is the inverse."""
    orbit = data.orbit
    parts = orbit.states, data.gentle, data.firm, orbit.times, data.voltages, data.timing
    columns = (*parts, orbit.continued, orbit.metric, [data.clock.tick])
    return np.concatenate([np.ravel(each).astype(np.float64) for each in columns])


def _gains(row: Floats, shared: lqr.LqrGains) -> lqr.LqrGains:
    """The law of a `flat` row; what all laws have in common is in `shared`."""
    n = (len(row) - 5) // 16
    states, gentle, firm = row[: 12 * n].reshape(3, n, 4)
    times, volts, timing, continued = row[12 * n : 16 * n].reshape(4, n)
    metric, tick = row[16 * n : 16 * n + 4], float(row[-1])
    orbit = Orbit(states, times, volts, continued > 0.5, metric, shared.orbit.limit)
    clock = Clock(tick, shared.clock.ahead)
    return lqr.LqrGains(orbit, volts, gentle, firm, timing, clock, shared.blend)


@cached()
def _voltage(x, mode, data):  # type: ignore[no-untyped-def]
    """The voltage of a law for a state (4,), and the squared distance from its orbit."""
    return lqr.volts(x, mode, data), located(x, data.orbit).squared


class Approach(NamedTuple):
    """How a gait of the nominal machine is reached.

    Attributes:
        gait: of the nominal machine.
        startup: leads the nominal machine to it; another machine's uses its costs to go.
        near: distance from the gait up to which its law acts.
    """

    gait: Solution
    startup: StartUpController
    near: float

    @classmethod
    def to(cls, gait: Solution, folder: Path | None) -> Approach:
        """The approach to a gait, which takes up to half a minute to compute."""
        law = law_about(gait)
        near = near_for(law)
        return cls(gait, startup_for(law, near, lost_return(gait), folder), near)


def sturdy(gait: Solution) -> Solution:
    """The gait itself or, if it lands more slowly than `LANDING`, one with longer steps."""
    slower: Solution | None = gait
    while slower and min(each.states[-1, -1, 2] for each in slower.phases) < LANDING:
        gait, slower = slower, _own(slower, slower.params, 1)
    return slower or gait


@dataclasses.dataclass(frozen=True, repr=False)
class AdaptiveController:
    """What does not change while it walks; `begin` gives what does.

    Attributes:
        table: of laws about the gait that is walked first.
        first: the approach to it.
        wanted: the approach to another gait, if it is another one.
        noise: of the encoders that log the walk.
        encoders: standard deviation of the errors that are added to the logged angles (rad), where
            a simulation's are exact.
    """

    table: GaitTable
    first: Approach
    wanted: Approach | None = None
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
        first = sturdy(gait)
        table = GaitTable.about(first, folder=folder, workers=workers)
        wanted = None if first is gait else Approach.to(gait, folder)
        return cls(table, Approach.to(first, folder), wanted)

    @property
    def params(self) -> WheelParams:
        """The nominal machine."""
        return self.table.params

    @property
    def margin(self) -> float:
        """Of the contact guard, which must not act on either gait."""
        return min(margin_for(each.gait) for each in (self.first, self.wanted) if each)

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
        plans: the gait of each that was solved for and is in use, or None.
        tick: how many decisions were made.
    """

    def __init__(self, controller: AdaptiveController, n: int, seed: int = 0) -> None:
        self.controller, self.tick = controller, 0
        self.machines = [controller.params] * n
        self.identified = np.zeros(n, dtype=np.int64)
        self._data = [controller.table.law.data] * n
        self.plans: list[Plan | None] = [None] * n  # in use
        self._next: list[Plan | None] = [None] * n
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
            plan = self._next[row]
            if plan is not None and plan.tick <= self.tick:
                self.plans[row], self._next[row] = plan, None
                self._choose(row)
            if due:
                self._identify(row)
        guard = ContactGuard(
            *(self.controller.params, lambda x, m: self._volts(rows, x, m)),
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
            "covariance": self._covariance.copy(),
            **{
                name: [None if p is None else [p.tick, p.params.to_dict(), p.law] for p in plans]
                for name, plans in (("plans", self.plans), ("next", self._next))
            },
            "identified": self.identified.copy(),
            "memory": self._memory.copy(),
            "random": [each.bit_generator.state for each in self._rng],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a `state` of as many walks with the same controller."""
        self.tick = int(state["tick"])
        self.machines = [WheelParams(**each) for each in state["machines"]]
        self.identified, self._memory = np.array(state["identified"]), np.array(state["memory"])
        self._covariance = np.array(state["covariance"])
        self.plans, self._next = (
            [p and Plan(p[0], WheelParams(**p[1]), np.array(p[2])) for p in state[name]]
            for name in ("plans", "next")
        )
        for row in range(len(self.machines)):
            self._choose(row)
        for each, known in zip(self._rng, state["random"], strict=True):
            each.bit_generator.state = known

    def _approach(self, row: int) -> Approach:
        """To the gait that a walk's law is about."""
        first, wanted = self.controller.first, self.controller.wanted
        return first if wanted is None or self.plans[row] is None else wanted

    def _choose(self, row: int) -> None:
        """The law in use: the table's, corrected by a plan, or the plan's."""
        table, plan = self.controller.table, self.plans[row]
        law = table.at(self.machines[row])
        if plan is not None:
            wanted = self.controller.wanted is not None
            law = plan.law if wanted else plan.law + law - table.at(plan.params)
        self._data[row] = _gains(law, table.law.data)

    def _volts(self, rows: NDArray[np.int64], x: Floats, modes: NDArray[np.int64]) -> Floats:
        """The law's voltage near its gait, and the start-up controller's elsewhere."""
        volts = np.empty(len(x))
        for i, row in enumerate(rows.tolist()):
            approach = self._approach(row)
            volts[i], squared = _voltage(x[i], modes[i], self._data[row])
            if modes[i] == DOUBLE or squared > approach.near**2:
                startup = dataclasses.replace(approach.startup, params=self.machines[row])
                volts[i] = startup(x[i], modes[i])
        return volts

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
        self._choose(row)
        self.identified[row] += 1
        if self._next[row] is None:
            self._plan(row)

    def _plan(self, row: int) -> None:
        """Solve for the gait of a machine that needs its own."""
        controller, params = self.controller, self.machines[row]
        table, wanted, count = controller.table, controller.wanted, int(self.identified[row])
        far = np.linalg.norm(table.steps(params)) > FAR
        if wanted is not None and count in REPLANNED:
            slower = controller.first.gait.duration - wanted.gait.duration
            periods = round(slower / wanted.gait.steps / CONTROL_PERIOD)
            law = law_of(Neighbour(wanted.gait, params, periods - 1))
        elif wanted is None and far and self.plans[row] is None:
            law = law_of(Neighbour(table.gait, params))
        else:
            return
        if law is not None:
            self._next[row] = Plan(self.tick + round(PLANNING / CONTROL_PERIOD), params, law)
