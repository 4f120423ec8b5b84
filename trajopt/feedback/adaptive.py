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
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rimless_gym.checks import require_kind
from rimless_gym.energy import ROW
from rimless_gym.equations import SINGLE
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import MODE, advance, hybrid_states
from rimless_gym.params import WheelParams
from rimless_gym.rules import exceeds
from trajopt.feedback.controller import ContactGuard, SwitchingController, margin_for
from trajopt.feedback.gait_table import (
    FAR,
    IDENTIFIED_BLEND,
    GaitTable,
    flat,
    gains_of,
    law_about,
    own_gait,
)
from trajopt.feedback.law import Floats, Law
from trajopt.feedback.laws import lqr
from trajopt.feedback.orbit import Orbit, has_clock, squared_distances
from trajopt.feedback.startup import StartUpController, lost_return, near_for, startup_for
from trajopt.gaits.periodic import periodic_gait
from trajopt.gaits.solution import Solution
from trajopt.identification.fit import identify
from trajopt.identification.log import Log, LogError

#: After so many fits a machine far from the table's, and one that is to walk at another speed, has
#: its own gait solved for first; then again, whenever there are twice as many fits, and after
#: every fit for as long as no law was found.
PLANNED = 1, 2

#: Time (s) that a gait takes to solve for and to try, on average, on one core: a law is used so
#: much later for every gait that was tried.
SOLVING = 2.0

#: A shorter step costs at most so many times as much as the longer one: beyond its own speed of
#: least cost, a machine's gait changes its kind within a control period.
COSTLY = 1.1

#: From which share of the distance between two gaits a law takes over on a slope beyond the table,
#: where the start-up controller has walked by itself: from farther away, it fails at +2 degrees.
STEEP = 1 / 6

#: How many walks try the law about such a gait in a simulation, and for how long (s).
TRIALS, TRIAL = 4, 6.0

#: At how many states the distance between two gaits is measured.
COMPARED = 32

#: Least rate of the leg at a touchdown (rad/s) of the gait that is walked first.
LANDING = 0.75

#: When a machine is first identified, and then again and again (s). What earlier fits have found
#: is known to the next one, which takes it to be less sure: its covariance so many times larger.
FIRST, EVERY, FORGETTING = 2.0, 4.0, 1.2
_FIRST, _EVERY = round(FIRST / CONTROL_PERIOD), round(EVERY / CONTROL_PERIOD)
_HALF = CONTROL_PERIOD / 2


class Plan(NamedTuple):
    """The law about the gait of an identified machine, flat.

    Attributes:
        tick: from which on it is used.
        fits: how many there had been.
        law: None if none was found, which takes its time, too.
    """

    tick: int
    fits: int
    law: Floats | None


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

    def around(self, orbit: Orbit, share: float) -> Approach:
        """The approach to another orbit, whose law acts from farther away.

        By this share of the largest distance between the two.
        """
        states = self.gait.state(self.gait.duration * (np.arange(COMPARED) + 0.5) / COMPARED)
        apart = np.sqrt(squared_distances(np.ascontiguousarray(states), orbit)).max()
        return self._replace(near=self.near + share * float(apart))


def sturdy(gait: Solution) -> Solution:
    """The gait itself or, if it lands more slowly than `LANDING`, one whose steps last longer."""
    slower: Solution | None = gait
    while slower and min(each.states[-1, -1, 2] for each in slower.phases) < LANDING:
        gait, slower = slower, own_gait(slower, slower.params, 1)
    return slower or gait


@dataclasses.dataclass(frozen=True, repr=False)
class AdaptiveController:
    """What does not change while it walks; `begin` gives what does.

    Attributes:
        table: of laws about the gait that is walked first.
        first: the approach to it.
        wanted: the approach to another gait, if it is another one.
        encoders: standard deviation of the errors that are added to the logged angles (rad), where
            a simulation's are exact.
    """

    table: GaitTable
    first: Approach
    wanted: Approach | None = None
    encoders: float = 1e-3

    @classmethod
    def about(cls, gait: Solution, folder: Path | None = None) -> AdaptiveController:
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
        table = GaitTable.about(first, folder)
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

    def guarded(self, law: Law) -> ContactGuard:
        """A law with what leads to its gait: the approach to whichever of the two is nearer."""
        share = 1.0 if self.table.has(law.params.slope) else STEEP
        ways = [each.around(law.data.orbit, share) for each in (self.first, self.wanted) if each]
        approach = min(ways, key=lambda each: each.near)
        startup = dataclasses.replace(approach.startup, params=law.params)
        switching = SwitchingController(law, startup, approach.near)
        return ContactGuard(law.params, switching, self.margin)

    def own(self, params: WheelParams) -> ContactGuard:
        """The table's law about a machine's own gait, with what leads to it.

        On a slope that the table does not have, the start-up controller by itself.
        """
        if not self.table.has(params.slope):
            startup = dataclasses.replace(self.first.startup, params=params)
            return ContactGuard(params, startup, self.margin)
        return self.guarded(
            Law(params, lqr.volts, gains_of(self.table.at(params), self.table.law.data))
        )

    def efficient_law(self, params: WheelParams) -> tuple[Floats | None, int]:
        """The law about a machine's own gait, flat, and how many gaits were tried.

        A step of it lasts as long as one of the wanted gait or, if there is no such gait, its cost
        is beyond `COSTLY` or the law does not hold it, as little longer as is found: from the
        machine's own version of the gait that is walked first, steps are made shorter. A law holds
        a gait if simulated walks come to it from the first gait, and stay on it. None if none is
        held.
        """
        gait = own_gait(self.first.gait, params, 0)
        if self.wanted is None:
            return self._held_law(gait), 1
        wanted = self.wanted.gait
        limit = math.inf if gait is None else COSTLY * gait.cot
        law = self._held_law(own_gait(dataclasses.replace(wanted, params=params), params, 0), limit)
        tried, found = 2, law is not None
        while not found and gait is not None and gait.duration > wanted.duration - _HALF:
            shorter = self._held_law(gait, limit)
            if shorter is None:
                break
            law, limit = shorter, COSTLY * gait.cot
            gait, tried = own_gait(gait, params, -1), tried + 1
        return law, tried

    def _held_law(self, gait: Solution | None, limit: float = math.inf) -> Floats | None:
        """The law about a gait of at most this cost, flat, if simulated walks come to it and stay.

        None otherwise.
        """
        if gait is None or not gait.verification.passed or gait.cot > limit:
            return None
        try:
            law = law_about(gait, IDENTIFIED_BLEND)
        except RuntimeError:
            return None
        first, guarded = self.first.gait, self.guarded(law)
        times = first.duration * (np.arange(TRIALS) + 0.5) / TRIALS
        states = hybrid_states(first.state(times), SINGLE)
        ticks = round(TRIAL / CONTROL_PERIOD)
        for tick in range(ticks):
            volts = guarded(states[:, :4], states[:, MODE].astype(np.int64))
            out = advance(gait.params, states, volts, CONTROL_PERIOD)
            slips = exceeds(out[:, ROW.friction_demand].max(), gait.params.friction)
            if out[:, ROW.failure].any() or (slips and tick > ticks / 2):
                return None
        held = squared_distances(states[:, :4], law.data.orbit) < self.first.near**2
        return flat(law.data) if held.all() else None

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
        plans: the plan of each that is in use, or None.
        tick: how many decisions were made.
    """

    def __init__(self, controller: AdaptiveController, n: int, seed: int = 0) -> None:
        self.controller, self.tick = controller, 0
        self.machines = [controller.params] * n
        self.identified = np.zeros(n, dtype=np.int64)
        self._guarded = [controller.guarded(controller.table.law)] * n
        self.plans: list[Plan | None] = [None] * n
        self._next: list[Plan | None] = [None] * n
        # of what is known of each machine; NaN of one that is as in the table
        k = len(controller.table.names)
        self._covariance = np.full((n, k, k), np.nan)
        self._rng = [np.random.default_rng([seed, row]) for row in range(n)]
        # phi, theta, foot, mode, V of the last samples, the latest last
        self._memory = np.full((n, _EVERY, 5), np.nan)

    def __call__(
        self, rows: NDArray[np.int64], states: Floats, modes: NDArray[np.int64], feet: Floats
    ) -> Floats:
        """Voltages of some walks: their numbers (M,), states (M, 4), modes and stance feet (M,)."""
        due = self.tick in (_FIRST, 2 * _FIRST) or (self.tick and self.tick % _EVERY == 0)
        for row in rows.tolist():
            plan = self._next[row]
            if plan is not None and plan.tick <= self.tick:
                self._next[row] = None
                if plan.law is not None:
                    self.plans[row] = plan
                    self._choose(row)
            if due:
                self._identify(row)
        volts = np.array(
            [self._guarded[row](states[i], modes[i]) for i, row in enumerate(rows.tolist())]
        )
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
            "plans": [plan and list(plan) for plan in self.plans],
            "next": [plan and list(plan) for plan in self._next],
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
            [p and Plan(*p) for p in state[name]] for name in ("plans", "next")
        )
        for row in range(len(self.machines)):
            self._choose(row)
        for each, known in zip(self._rng, state["random"], strict=True):
            each.bit_generator.state = known

    def _choose(self, row: int) -> None:
        """The law in use: the plan's, or else the table's."""
        controller, plan, machine = self.controller, self.plans[row], self.machines[row]
        if plan is None or plan.law is None:
            self._guarded[row] = controller.own(machine)
        else:
            data = gains_of(plan.law, controller.table.law.data)._replace(blend=IDENTIFIED_BLEND)
            self._guarded[row] = controller.guarded(Law(machine, lqr.volts, data))

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
        controller, params, plan = self.controller, self.machines[row], self.plans[row]
        other, fits = controller.wanted is not None, int(self.identified[row])
        far = np.linalg.norm(controller.table.steps(params)) > FAR
        if (other or far) and fits >= (PLANNED[other] if plan is None else 2 * plan.fits):
            law, tried = controller.efficient_law(params)
            later = round(SOLVING * tried / CONTROL_PERIOD)
            self._next[row] = Plan(self.tick + later, fits, law)
