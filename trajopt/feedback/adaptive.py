"""A controller that identifies its machine while it walks, and holds the gait that suits it.

A law about the gait of another machine forces that orbit on this one, and the volts that hold it
there are copper loss. So the controller walks with the nominal law, identifies the machine from
what its encoders have logged, and goes on with the law about that machine's own gait. It takes the
law from a table: the gaits of machines of which one parameter differs, and their gains. The time of
a step stays the same, so that all of them keep to the same clock.

Near the speed of least cost, where the wheel hardly falls from foot to foot, there is no such
table: a little more of a parameter, and the optimum jumps to another branch. There it walks a
slower gait first, then the identified machine's own, whose steps get shorter by a control period at
a time.

The fitted model has the structure of the simulator's; what it lacks is in docs/feedback.md.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rimless_gym.checks import positive, require_kind
from rimless_gym.energy import ROW
from rimless_gym.equations import SINGLE
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import (
    FOOT,
    MODE,
    STATE_SIZE,
    advance,
    hybrid_states,
    require_steppable,
)
from rimless_gym.params import WheelParams
from rimless_gym.rules import Extremes, violations
from trajopt.feedback.controller import ContactGuard, SwitchingController, margin_for
from trajopt.feedback.gait_table import (
    IDENTIFIED_BLEND,
    STEEP_BLEND,
    GaitTable,
    flat,
    gains_of,
    law_about,
    own_gait,
)
from trajopt.feedback.law import Floats, Law
from trajopt.feedback.laws import lqr
from trajopt.feedback.orbit import has_clock, squared_distances
from trajopt.feedback.startup import StartUpController, lost_return, near_for, startup_for
from trajopt.gaits.periodic import periodic_gait
from trajopt.gaits.solution import Solution
from trajopt.identification.fit import Noise, identify, tolerances
from trajopt.identification.log import Log, LogError

#: After so many fits a machine far from the table's, and one that is to walk at another speed, has
#: its own gait solved for first; then again, whenever there are twice as many fits, and after
#: every fit for as long as no law was found.
PLANNED = 1, 2

#: Time (s) that a gait takes to solve for and to try, on average, on one core at most: the laws of
#: ever shorter steps are used so much after each other.
SOLVING = 1.0

#: A shorter step costs at most so many times as much as the longer one: beyond its own speed of
#: least cost, a machine's optimum may jump to another branch within a control period.
COSTLY = 1.1

#: A law about the first gait that was solved for, and one about a gait of shorter steps, acts from
#: so many times as far away as one of the table: it takes over from another gait.
WIDER = 1.25, 2.0

#: What the design of a law about a gait, and of what leads there, may raise.
NO_LAW = ValueError, RuntimeError

#: How many simulated walks try such a law, each with another machine that is likely, and how long
#: (s) they last.
TRIALS, TRIAL = 4, 6.0

#: The deviations of those machines, as a share of the fit's. With all of it a law that holds the
#: identified machine itself is often refused, and the walk stays at a slower gait.
SPREAD = 0.5

#: A walk is on its gait within this share of the distance up to which the nominal law acts. A law
#: is given up if the walk is beyond that distance once the law has been in use for so long (s).
ON_GAIT, SETTLED = 0.5, 1.5

#: For a machine whose first fit is far from the table, the first steps are longer by so many
#: control periods: the nominal machine's value function leads to that gait, even if its own one
#: lands slowly.
LONGER = 3

#: Least rate of the leg at a touchdown (rad/s) of the gait that is walked first.
LANDING = 0.75

#: When a machine is first identified, and then again and again (s). What earlier fits have found
#: is known to the next one, which takes it to be less sure: it has so many times less information
#: from them (`forgotten`).
FIRST, EVERY, FORGETTING = 2.0, 4.0, 1.2
_FIRST, _EVERY = round(FIRST / CONTROL_PERIOD), round(EVERY / CONTROL_PERIOD)

#: By which share of their difference a measured angle corrects the one that the identified machine
#: is predicted to have; one that is so many standard deviations of the encoders' errors away counts
#: as measured.
CORRECTED, SURPRISING = 0.3, 5.0


class Plan(NamedTuple):
    """The law about a gait of an identified machine, flat.

    Attributes:
        tick: from which on it is used.
        fits: how many there had been.
        shorter: by how many control periods a step is shorter than that of the first gait.
        law: the law.
    """

    tick: int
    fits: int
    shorter: int
    law: Floats


def forgotten(covariance: Floats, prior: Floats) -> Floats:
    """A covariance (k, k) with less information, but for that of the deviations before, (k,).

    Without the latter, directions that no log shows would be less and less known.
    """
    scale = np.outer(prior, prior)
    kept = np.linalg.inv(covariance / scale) / FORGETTING
    return np.asarray(np.linalg.inv(kept + (1 - 1 / FORGETTING) * np.eye(len(prior))) * scale)


def likely_machines(
    params: WheelParams, names: Sequence[str], covariance: Floats
) -> list[WheelParams]:
    """An identified machine, and `TRIALS` - 1 drawn with `SPREAD` times its fit's deviations.

    The draws are the same at every call. Shares are drawn: machines of which only the scale differs
    walk alike, and so remain alike. A draw that cannot be, or be simulated, is the identified
    machine instead.
    """
    values = np.array([getattr(params, name) for name in names])
    shares = np.array([name != "slope" for name in names])
    scale = np.where(shares, values, 1.0)
    draws = SPREAD * np.random.default_rng(0).standard_normal((TRIALS - 1, len(names)))
    steps = draws @ np.linalg.cholesky(covariance / np.outer(scale, scale)).T
    machines = [params]
    for row in np.where(shares, values * np.exp(steps), values + steps):
        try:
            machine = dataclasses.replace(params, **dict(zip(names, row, strict=True)))
            require_steppable(machine)
        except ValueError:
            machine = params
        machines.append(machine)
    return machines


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
        startup: leads the nominal machine to that gait; another machine's uses its value function.
        near: distance from a gait up to which its law acts.
        wanted: the gait to come to: the first one, or one of shorter steps.
        encoders: standard deviation of the encoders' errors (rad), > 0; errors of this size are
            added to the logged angles, which a simulation has exactly.
        folder: where start-up controllers for slopes are stored; None: nowhere.
        on_slopes: those that were needed so far, by whole degrees.

    Raises:
        TypeError, ValueError: `encoders` is not a positive number.
    """

    table: GaitTable
    startup: StartUpController
    near: float
    wanted: Solution
    encoders: float = 1e-3
    folder: Path | None = None
    on_slopes: dict[int, StartUpController] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        positive("encoders", self.encoders)

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
        table = GaitTable.about(sturdy(gait), folder)
        params, orbit = table.params, table.law.data.orbit
        near = near_for(params, orbit)
        weights = lost_return(params, table.gait.speed, table.gait.cot)
        startup = startup_for(params, orbit, near, weights, folder)
        return cls(table, startup, near, gait, folder=folder)

    @property
    def params(self) -> WheelParams:
        """The nominal machine."""
        return self.table.params

    @property
    def shorter(self) -> int:
        """By how many control periods a step of the wanted gait is shorter than the first one's."""
        longer = self.table.gait.duration - self.wanted.duration
        return round(longer / self.wanted.steps / CONTROL_PERIOD)

    @property
    def margin(self) -> float:
        """Of the contact guard, which must not act on either gait."""
        return min(margin_for(self.table.gait), margin_for(self.wanted))

    def with_startup(self, law: Law) -> ContactGuard:
        """A law with what leads to its gait, from the gait that is walked first."""
        startup = dataclasses.replace(self.startup_on(law.params.slope), params=law.params)
        switching = SwitchingController(law, startup, law.reach * self.near)
        return ContactGuard(law.params, switching, self.margin)

    def startup_on(self, slope: float) -> StartUpController:
        """What leads the nominal machine to the gait that is walked first, on a slope (rad).

        On one that the table does not have it is that of the nearest whole degree, which takes 20 s
        of one core to compute where it is not in the folder. Costs to go of level ground would lead
        into cycles far from the gait.
        """
        if self.table.has(slope):
            return self.startup
        degrees = round(math.degrees(slope))
        if degrees not in self.on_slopes:
            startup, params = self.startup, self.params.replace(slope=math.radians(degrees))
            gait = own_gait(self.table.gait, params, 0)
            if gait is not None:
                with contextlib.suppress(*NO_LAW):
                    orbit = law_about(gait).data.orbit
                    startup = startup_for(params, orbit, self.near, startup.weights, self.folder)
            self.on_slopes[degrees] = startup
        return self.on_slopes[degrees]

    def controller_for(self, params: WheelParams) -> ContactGuard:
        """The table's law about a machine's own gait, with what leads to it.

        On a slope that the table does not have, the start-up controller by itself.
        """
        if not self.table.has(params.slope):
            startup = dataclasses.replace(self.startup_on(params.slope), params=params)
            return ContactGuard(params, startup, self.margin)
        return self.with_startup(self.law_of(params))

    def law_of(self, params: WheelParams) -> Law:
        """The table's law about a machine's own gait."""
        data = gains_of(self.table.flat_law(params), self.table.law.data)
        return Law(params, lqr.volts, data)

    def planned(self, params: WheelParams, law: Floats, shorter: int) -> ContactGuard:
        """A flat law about an identified machine's own gait, with what leads to it; see `Plan`."""
        blend = IDENTIFIED_BLEND if self.table.has(params.slope) else STEEP_BLEND
        data = gains_of(law, self.table.law.data)._replace(blend=blend)
        return self.with_startup(Law(params, lqr.volts, data, reach=WIDER[shorter > 0]))

    def own_laws(self, machines: Sequence[WheelParams], first: int = 0) -> list[Floats]:
        """The laws about a machine's own gaits, flat, each one's steps a control period shorter.

        The laws are those of the first machine; they must hold the others as well.

        The first one's steps last as long as those of the gait that is walked first, or `first`
        control periods longer, the last one's as those of the wanted gait, or as little longer as
        is found: each gait is continued from the one before, costs at most `COSTLY` times as much,
        and its law holds it.
        """
        gait, params, laws = self.table.gait, machines[0], list[Floats]()
        for longer in (first, *[-1] * (first + self.shorter)):
            own = own_gait(gait, params, longer)
            passed = own is not None and own.verification.passed
            if own is None or not passed or (laws and own.cot > COSTLY * gait.cot):
                break
            try:
                law = flat(law_about(own).data)
            except NO_LAW:
                break
            times = gait.duration * (np.arange(len(machines)) + 0.5) / len(machines)
            if not self.holds(machines, law, len(laws), gait.state(times)):
                break
            laws.append(law)
            gait = own
        return laws

    def holds(
        self, machines: Sequence[WheelParams], law: Floats, shorter: int, states: Floats
    ) -> bool:
        """Whether simulated walks from states (N, 4) come to a law's gait, and stay on it.

        Each of the N machines has one walk; the law is that of the first. The angles have the noise
        that is left after filtering. A broken rule (`rimless_gym.rules`) is a failure, except with
        the first gait, to which the way may be far.
        """
        controller, states = self.planned(machines[0], law, shorter), hybrid_states(states, SINGLE)
        ticks = round(TRIAL / CONTROL_PERIOD)
        rng, errors = np.random.default_rng(0), np.zeros((len(states), 4))
        for tick in range(ticks):
            noise = self.encoders * rng.standard_normal((len(states), 2))
            errors[:, :2] += CORRECTED * (noise - errors[:, :2])
            volts = controller(states[:, :4] + errors, states[:, MODE].astype(np.int64))
            late = shorter > 0 and tick > ticks / 2
            for i, machine in zip(range(len(states)), machines, strict=True):
                row = advance(machine, states[i : i + 1], volts[i : i + 1])[0]
                broken = shorter > 0 and violations(machine, Extremes.of_row(row))
                if broken or row[ROW.failure]:
                    return False
            if late and self.off(states[:, :4], law) > ON_GAIT:
                return False
        return self.off(states[:, :4], law) < 1.0

    def off(self, states: Floats, law: Floats) -> float:
        """How far the farthest of states (N, 4) is from a flat law's gait, as a share of `near`."""
        orbit = gains_of(law, self.table.law.data).orbit
        return math.sqrt(squared_distances(np.ascontiguousarray(states), orbit).max()) / self.near

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
        delays: by how many control periods each one's voltage is late, 0 or 1.
        longer: by how many the first steps on a gait of its own are longer; if not 0, the nominal
            law acts until that gait is found.
        plans: the plan of each that is in use, or None.
        since: the tick at which each plan was taken up.
        tick: how many decisions were made.
    """

    def __init__(self, controller: AdaptiveController, n: int, seed: int = 0) -> None:
        self.controller, self.tick = controller, 0
        self.machines = [controller.params] * n
        self.identified, self.delays, self.longer = np.zeros((3, n), dtype=np.int64)
        self._controllers = [controller.with_startup(controller.table.law)] * n
        self.plans: list[Plan | None] = [None] * n
        self.since = np.zeros(n, dtype=np.int64)
        # plans of the last search that may still be used, each of shorter steps than the one before
        self._ladders: list[list[Plan]] = [[] for _ in range(n)]
        # of what is known of each machine; NaN of one that is as in the table
        k = len(controller.table.names)
        self._covariance = np.full((n, k, k), np.nan)
        self._rng = [np.random.default_rng([seed, row]) for row in range(n)]
        # phi, theta, foot, mode, V of the last samples, the latest last
        self._memory = np.full((n, _EVERY, 5), np.nan)
        self._predicted, self._commanded = np.full((n, STATE_SIZE), np.nan), np.zeros(n)

    def __call__(
        self, rows: NDArray[np.int64], states: Floats, modes: NDArray[np.int64], feet: Floats
    ) -> Floats:
        """Voltages of some walks: their numbers (M,), states (M, 4), modes and stance feet (M,)."""
        due = self.tick == _FIRST or (self.tick and self.tick % _EVERY == 0)
        for i, row in enumerate(rows.tolist()):
            self._change_plan(row, states[i])
            if due:
                self._identify(row)
        volts = np.array(
            [self._volts(row, states[i], modes[i], feet[i]) for i, row in enumerate(rows.tolist())]
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
            "since": self.since.copy(),
            "ladders": [[list(plan) for plan in each] for each in self._ladders],
            "identified": self.identified.copy(),
            "delays": self.delays.copy(),
            "longer": self.longer.copy(),
            "commanded": self._commanded.copy(),
            "memory": self._memory.copy(),
            "predicted": self._predicted.copy(),
            "random": [each.bit_generator.state for each in self._rng],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a `state` of as many walks with the same controller; else a ValueError."""
        if np.shape(state["covariance"]) != self._covariance.shape:
            raise ValueError(
                f"state: of walks and parameters {np.shape(state['covariance'])[:2]}; here there "
                f"are {self._covariance.shape[:2]}; begin as many walks with the same controller"
            )
        self.tick = int(state["tick"])
        self.machines = [WheelParams(**each) for each in state["machines"]]
        self.identified, self._memory = np.array(state["identified"]), np.array(state["memory"])
        self._covariance = np.array(state["covariance"])
        self._predicted = np.array(state["predicted"])
        self._commanded = np.array(state["commanded"])
        self.delays, self.longer = np.array(state["delays"]), np.array(state["longer"])
        self.plans = [plan and Plan(*plan) for plan in state["plans"]]
        self.since = np.array(state["since"])
        self._ladders = [[Plan(*plan) for plan in each] for each in state["ladders"]]
        for row in range(len(self.machines)):
            self._choose(row)
        for each, known in zip(self._rng, state["random"], strict=True):
            each.bit_generator.state = known

    def _change_plan(self, row: int, state: Floats) -> None:
        """Use the next plan, or the one before.

        The next one once it is due and, if its steps are shorter, this gait holds; the one before,
        of longer steps, if the wheel does not hold this gait.
        """
        plan, coming = self.plans[row], self._coming(row)
        off = self.controller.off(state[None], plan.law) if plan else 0.0
        shorter = plan is not None and coming is not None and coming.shorter > plan.shorter
        if coming and coming.tick <= self.tick and (off < ON_GAIT or not shorter):
            self._use(row, coming)
        elif plan and off > 1.0 and self.tick > self.since[row] + SETTLED / CONTROL_PERIOD:
            ladder = self._ladders[row]
            before = [each for each in ladder if each.shorter < plan.shorter]
            if before and before[-1].tick <= self.tick:
                # the laws of a later fit are still to be tried
                self._ladders[row] = ladder if before[-1].fits > plan.fits else before
                self._use(row, before[-1])

    def _coming(self, row: int) -> Plan | None:
        """The next plan: of later fits or of shorter steps; if there is one, of steps no longer."""
        plan, ladder = self.plans[row], self._ladders[row]
        if plan is None:
            return ladder[0] if ladder else None
        later = [each for each in ladder if (each.fits, each.shorter) > (plan.fits, plan.shorter)]
        as_short = [each for each in later if each.shorter >= plan.shorter]
        return next(iter(as_short or later[-1:]), None)

    def _use(self, row: int, plan: Plan) -> None:
        self.plans[row], self.since[row] = plan, self.tick
        self._choose(row)

    def _volts(self, row: int, state: Floats, mode: int, foot: float) -> float:
        """The law's voltage; once the machine is identified, its angles are filtered.

        If voltages come a control period late, it is the law's for the predicted state.
        """
        predicted, x = self._predicted[row], state.copy()
        if self.identified[row] and (predicted[MODE], predicted[FOOT]) == (mode, foot):
            error = predicted[:2] - state[:2]
            error -= 2 * np.pi * np.round(error / (2 * np.pi))
            if np.abs(error).max() < SURPRISING * self.controller.encoders:
                x[:2] += (1 - CORRECTED) * error
        predicted[:4], predicted[MODE], predicted[FOOT] = x, mode, foot
        motion = self.machines[row], self._predicted[row : row + 1], self._commanded[row : row + 1]
        if self.delays[row]:
            advance(*motion, CONTROL_PERIOD)
        self._commanded[row] = self._controllers[row](predicted[:4].copy(), int(predicted[MODE]))
        if not self.delays[row]:
            advance(*motion, CONTROL_PERIOD)
        return float(self._commanded[row])

    def _choose(self, row: int) -> None:
        """The law in use: the plan's, or else the table's or the nominal one."""
        controller, plan, machine = self.controller, self.plans[row], self.machines[row]
        if plan is not None:
            self._controllers[row] = controller.planned(machine, plan.law, plan.shorter)
        elif self.longer[row] and controller.table.has(machine.slope):
            self._controllers[row] = controller.with_startup(controller.table.law)
        else:
            self._controllers[row] = controller.controller_for(machine)

    def _identify(self, row: int) -> None:
        """Another law, if what was logged since the last time is of some machine."""
        table, memory = self.controller.table, self._memory[row]
        samples = memory[~np.isnan(memory[:, 0])]
        self._memory[row] = np.nan
        known, candidates = not np.isnan(self._covariance[row]).any(), []
        prior = tolerances(table.params, table.names)
        for delay in [self.delays[row]] if known else (0, 1):
            phi, theta, foot, mode, _ = samples[delay:].T
            time = np.asarray(CONTROL_PERIOD * np.arange(len(phi)), dtype=np.float64)
            try:
                fit = identify(
                    Log(time, phi, theta, foot, mode, samples[: len(phi), 4]),
                    self.machines[row] if known else table.params,
                    table.names,
                    covariance=forgotten(self._covariance[row], prior) if known else None,
                    noise=Noise(angle=self.controller.encoders),
                )
            except LogError:
                continue
            candidates.append((delay, fit))
        if not candidates:
            self._covariance[row] = np.nan  # what was known may be wrong; the law stays
            return
        self.delays[row], found = min(candidates, key=lambda each: each[1].chi2)
        self.machines[row], self._covariance[row] = found.params, found.covariance
        self.identified[row] += 1
        if self.identified[row] == 1:
            self.longer[row] = LONGER * (table.far(found.params) and table.has(found.params.slope))
        self._choose(row)
        coming = self._coming(row)
        if coming is None or coming.tick < self.tick - _EVERY:
            self._plan(row)

    def _plan(self, row: int) -> None:
        """Solve for the gaits of a machine that needs its own.

        Where none of steps as short is found, the law in use stays if it holds the machine as it
        is now known, or if no other is found.
        """
        controller, params, plan = self.controller, self.machines[row], self.plans[row]
        other, fits = controller.shorter > 0, int(self.identified[row])
        far, enough = controller.table.far(params), 2 * plan.fits if plan else PLANNED[other]
        if not (other or far) or fits < enough:
            return
        machines = likely_machines(params, controller.table.names, self._covariance[row])
        laws = controller.own_laws(machines, int(self.longer[row]))
        if not laws and plan is None and self.longer[row]:
            self.longer[row] = 0
            self._choose(row)
            laws = controller.own_laws(machines)
        if plan is not None and len(laws) <= plan.shorter:
            states = gains_of(plan.law, controller.table.law.data).orbit.states
            few = states[len(states) // 8 :: len(states) // TRIALS]
            if controller.holds(machines, plan.law, plan.shorter, few):
                self.plans[row] = plan._replace(fits=fits)
                return
        if laws:
            self._ladders[row] = [
                Plan(self.tick + round(SOLVING * (k + 1) / CONTROL_PERIOD), fits, k, law)
                for k, law in enumerate(laws)
            ]
