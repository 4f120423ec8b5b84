"""Independent verification: a gait is accepted only as far as the reference simulator agrees.

`verify` simulates a gait's voltage forward and measures the result; `playback` is that voltage as a
function of time. `monodromy` and `floquet_multipliers` linearise a gait about itself, touchdowns
included.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from rimless_gym import hybrid
from rimless_gym.params import WheelParams
from rimless_gym.reference import simulate
from rimless_gym.rules import LIMIT_TOLERANCE, VIOLATIONS, Extremes, violations
from rimless_gym.symbolic import HybridModel
from rimless_gym.trajectory import Trajectory
from trajopt.gaits.problem import MIN_NORMAL_FORCE, stands
from trajopt.ocp.arrays import Array
from trajopt.ocp.schemes import differentiation_matrix, radau_nodes
from trajopt.ocp.trajectory import PhaseTrajectory

STATE_TOLERANCE = 1e-6  # of re-simulated against interpolated states (rad, rad/s)
AUDIT_TOLERANCE = 1e-6  # of the periodic energy balance (J)
SPARE_TIMES = (1e-8, 5e-8, 2e-7, 1e-6)  # past the end of a stride, for its last touchdown (s)

#: Where deviations may have grown by more within a step, its simulation begins anew from the gait,
#: so that the simulator's rounding, 1e-13, stays below a tenth of `STATE_TOLERANCE`.
MOST_GROWTH = 1e6

#: A chain of steps that deviates by more (rad, rad/s) is not followed further.
LOST = 0.01

#: Distance that the feet may slide when the wheel stops on both of them (m).
MOST_SLIDING = 1e-7

#: Time around a touchdown (s) within which the simulation is expected to land.
SWITCHED = 1e-5


@dataclasses.dataclass(frozen=True)
class Verification:
    """What forward simulation measures of a gait.

    Attributes:
        state_error: largest deviation from the interpolated state, and from the start of the next
            span, when every span is simulated from its own start without feedback (rad, rad/s);
            infinite if a touchdown does not match.
        energy_audit: |E - (idle + losses + collisions - work of the slope)| (J).
        electrical_positive: E+ of the stride, idle included (J).
        electrical: E of the stride, idle included (J).
        distance: length of the stride (m).
        time: duration of the stride (s).
        min_normal_force: smallest Fy (N).
        min_normal_force_over_weight: the same over (m1 + m2) g.
        max_friction_demand: largest |Fx|/Fy in stance.
        max_impulse_friction_demand: largest |Px|/Py of a touchdown's impulse.
        peak_voltage: largest |V| (V).
        clearance: smallest height of the pendulum's end (m); where the machine walks on a floor
            (`rimless_gym.rules.has_floor`), it must not be negative.
        failures: the checks that failed, in words; empty if the gait passed.
        repeat_error: of a gait with a hold, largest change of the state over a stride that the
            stepping kernel makes interval by interval, whole turns left out (rad, rad/s); else NaN.
        repeat_residual: |residual| of the ledger of that stride (J); else NaN.
        chain_error: the state error when each step is simulated from where the one before ended. It
            need not be small: over a stride of many steps the smallest deviation makes the wheel
            fall. Infinite once it exceeds `LOST`.
        spans: simulations of which the stride is made; a span is a step, or a part of one in which
            deviations grow too much. 0 of gaits saved by earlier versions: one for every step.
    """

    state_error: float
    energy_audit: float
    electrical_positive: float
    electrical: float
    distance: float
    time: float
    min_normal_force: float
    min_normal_force_over_weight: float
    max_friction_demand: float
    max_impulse_friction_demand: float
    peak_voltage: float
    clearance: float
    failures: tuple[str, ...]
    repeat_error: float = math.nan
    repeat_residual: float = math.nan
    chain_error: float = math.nan
    spans: int = 0

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return not self.failures

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values; `from_dict` is the inverse."""
        return dataclasses.asdict(self) | {"failures": list(self.failures)}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Verification:
        """From what `to_dict` returned, of earlier versions too, which had more figures."""
        known = {f.name: values[f.name] for f in dataclasses.fields(cls) if f.name in values}
        return cls(**known | {"failures": tuple(values["failures"])})


class Span(NamedTuple):
    """A step, or a part of one in which deviations grow by no more than `MOST_GROWTH`."""

    step: int  # index of the step
    element: int  # index of the span's first element in the step
    phase: PhaseTrajectory  # the motion
    after: Array  # state at which the next span begins, shape (4,)
    following: PhaseTrajectory | None  # the step that follows, if the span ends its step


def spans(params: WheelParams, phases: Sequence[PhaseTrajectory], turns: int) -> list[Span]:
    """A stride in spans."""
    found: list[Span] = []
    for i, (phase, after) in enumerate(zip(phases, successors(phases, turns), strict=True)):
        following, last = phases[(i + 1) % len(phases)], len(phase.edges) - 1
        begins, growth = [0], np.eye(4)
        for e, matrix in enumerate(transitions(params, phase)):
            if not stands(phase) and np.linalg.norm(matrix @ growth, 2) > MOST_GROWTH and e > 0:
                begins.append(e)
                growth = np.eye(4)
            growth = matrix @ growth
        for begin, end in pairwise([*begins, last]):
            ends = (after, following) if end == last else (phase.states[end, 0], None)
            found.append(Span(i, begin, elements_between(phase, begin, end), *ends))
    return found


def elements_between(phase: PhaseTrajectory, begin: int, end: int) -> PhaseTrajectory:
    """The phase's elements from one index up to another, which is left out."""
    return dataclasses.replace(
        phase,
        edges=phase.edges[begin : end + 1] - phase.edges[begin],
        states=phase.states[begin:end],
        controls=phase.controls[begin:end],
    )


def simulated_span(params: WheelParams, span: Span, spare_times: Sequence[float]) -> Trajectory:
    """Simulate a span from its own start; see `simulated_stride`."""
    if span.following is None:
        return simulated(params, [span.phase], span.phase.duration)
    return simulated_stride(params, [span.phase], spare_times, span.following)


def state_error(
    params: WheelParams, phases: Sequence[PhaseTrajectory], turns: int
) -> tuple[float, list[tuple[Span, Trajectory]]]:
    """See `Verification.state_error`; and the spans with their simulations."""
    runs = [(s, simulated_span(params, s, SPARE_TIMES)) for s in spans(params, phases, turns)]
    return max(deviation(run, span) for span, run in runs), runs


def successors(phases: Sequence[PhaseTrajectory], turns: int) -> list[Array]:
    """The state after each step of a periodic gait: the start of the next one."""
    first = phases[0].start + np.array([0.0, 2 * math.pi * turns, 0.0, 0.0])
    return [*(phase.start for phase in phases[1:]), first]


def chain_error(params: WheelParams, phases: Sequence[PhaseTrajectory], turns: int) -> float:
    """See `Verification.chain_error`."""
    error, start = 0.0, phases[0].start
    for i, after in enumerate(successors(phases, turns)):
        following = phases[(i + 1) % len(phases)]
        run = simulated_stride(params, [begun(phases[i], start)], SPARE_TIMES, following)
        error = max(error, deviation(run, Span(i, 0, phases[i], after, following)))
        if error > LOST:
            return math.inf
        start = run.events[0].after
    return error


def begun(phase: PhaseTrajectory, start: Array, element: int = 0) -> PhaseTrajectory:
    """A phase with another state, shape (4,), at the start of an element."""
    states = phase.states.copy()
    states[element, 0] = start
    return dataclasses.replace(phase, states=states)


def deviation(run: Trajectory, span: Span) -> float:
    """Largest deviation of a simulated span from its interpolated states and the next span's start.

    A step ends with a touchdown, or in double stance with a lift-off. If the events do not match,
    the deviation is infinite.
    """
    phase, expected = span.phase, list[tuple[str, int]]()
    if span.following is not None:
        expected.append(("lift_off" if stands(phase) else "touchdown", 1))
    if [(event.kind, event.direction) for event in run.events] != expected:
        return math.inf
    margin = min(1e-6, 1e-3 * phase.duration)
    t = np.linspace(margin, phase.duration - margin, 200)
    gaps = [run.state(t) - phase.state(t)]
    ends = [(event.before, event.after) for event in run.events] or [(run.x[-1], run.x[-1])]
    gaps += [gap for before, after in ends for gap in (before - phase.end, after - span.after)]
    return float(max(np.abs(gap).max() for gap in gaps))


def verify(
    params: WheelParams,
    phases: Sequence[PhaseTrajectory],
    turns: int,
) -> Verification:
    """Re-simulate a gait and measure everything that is claimed of it.

    Args:
        params: the machine.
        phases: one per step.
        turns: whole turns that theta gains in a stride.
    """
    error, simulations = state_error(params, phases, turns)
    runs = [run for _, run in simulations]
    surplus = sum(_surplus(params, span.phase.duration, run) for span, run in simulations)
    least_force = min(run.min_normal_force for run in runs)
    ends = [(span.phase, run) for span, run in simulations if span.following is not None]
    impulses = [_impulse_demand(params, phase, run) for phase, run in ends]
    figures: dict[str, Any] = {
        "state_error": error,
        "energy_audit": abs(surplus),
        "electrical_positive": sum(run.ledger.energy for run in runs),
        "electrical": sum(run.ledger.energy_with_regeneration for run in runs),
        "distance": sum(not stands(phase) for phase in phases) * params.step_length,
        "time": sum(p.duration for p in phases),
        "min_normal_force": least_force,
        "min_normal_force_over_weight": least_force / params.weight,
        "max_friction_demand": max(run.friction_demand for run in runs),
        "max_impulse_friction_demand": max(impulses),
        "peak_voltage": peak_voltage(phases),
        "clearance": min(run.clearance for run in runs),
        # a stride of one span is simulated as it is chained: once is enough
        "chain_error": chain_error(params, phases, turns) if len(runs) > 1 else error,
        "spans": len(runs),
    }
    return Verification(**figures, failures=tuple(_failures(params, figures)))


def _surplus(params: WheelParams, duration: float, run: Trajectory) -> float:
    """Energy (J) that went in during a step and is in no loss, apart from the mechanical energy.

    Its sum over the steps of a stride that ends as it began is 0: over such a stride the mechanical
    energy changes by the work of the slope alone, whatever the losses.
    """
    ledger = run.ledger
    slope_work = params.weight * math.sin(params.slope) * ledger.distance
    unexplained = ledger.residual + ledger.mechanical_change + slope_work
    return unexplained - _gained_after_last_event(params, duration, run)


def _impulse_demand(params: WheelParams, phase: PhaseTrajectory, run: Trajectory) -> float:
    """|Px|/Py of the touchdown that ends a phase; 0 where none does, or a stop hardly slides.

    The impulse of a stop may lie outside the friction cone: the feet then slide until the friction
    under the weight has taken up the energy that the stop loses, which is nearly none.
    """
    if stands(phase):
        return 0.0
    stops = run.final_mode == "double_stance"
    if stops and run.ledger.collision <= MOST_SLIDING * params.friction * params.weight:
        return 0.0
    return run.impulse_friction_demand if run.touchdowns else math.inf


def _gained_after_last_event(params: WheelParams, duration: float, run: Trajectory) -> float:
    """Mechanical energy (J) gained in the spare time, if the stride ended on time."""
    if not run.events or abs(run.events[-1].time - duration) > SPARE_TIMES[-1]:
        return 0.0
    ends = run.x[-1], run.events[-1].after
    after, before = (hybrid.mechanical_energy(*map(float, x), params.constants) for x in ends)
    return float(after - before)


def peak_voltage(phases: Sequence[PhaseTrajectory]) -> float:
    """Largest |V|, sampled densely within every element (V)."""
    peaks = []
    for phase in phases:
        s = np.linspace(0.0, 1.0 - 1e-9, 33)
        t = (phase.edges[:-1, None] + phase.element_durations[:, None] * s).ravel()
        peaks.append(np.abs(phase.control(t)).max())
    return float(max(peaks))


def _failures(params: WheelParams, f: dict[str, Any]) -> list[str]:
    extremes = Extremes(
        min_normal_force=f["min_normal_force"],
        friction_demand=f["max_friction_demand"],
        impulse_friction_demand=f["max_impulse_friction_demand"],
        clearance=f["clearance"],
    )
    checks = [
        (f["state_error"] <= STATE_TOLERANCE, "re-simulated states differ"),
        (f["energy_audit"] <= AUDIT_TOLERANCE, "the energy balance does not close"),
        (
            f["min_normal_force_over_weight"] >= MIN_NORMAL_FORCE / (1 + LIMIT_TOLERANCE),
            "the normal force falls too low",
        ),
        (f["peak_voltage"] <= params.voltage_limit * (1 + 1e-9), "the voltage limit is exceeded"),
    ]
    failures = [message for good, message in checks if not good]
    return failures + [VIOLATIONS[name] for name in violations(params, extremes)]


# -- forward simulation ---------------------------------------------------------------------------


def playback(
    phases: Sequence[PhaseTrajectory],
) -> tuple[list[float], Callable[[float, Any], float]]:
    """The voltage of phases one after the other, and the times at which it may jump.

    Args:
        phases: each with one control.

    Returns:
        Times (s), and a function (t, x) -> V of t alone, but for `SWITCHED` around a touchdown
        between two phases: there a state shows whether the foot has landed. (The simulation lands a
        picosecond early or late, and the next step's voltage could make the old foot slip.) The
        state may be None. Where the wheel stops, contact (phi = b) already switches the voltage: it
        decides whether both feet stay on the ground. A lift-off is when the voltage jumps. After
        the end the last element's polynomial goes on.
    """
    begins = np.cumsum([0.0, *(p.duration for p in phases)])
    edges = np.concatenate([b + p.edges[:-1] for b, p in zip(begins, phases, strict=False)])
    edges = np.append(edges, begins[-1])
    polynomials = [element for phase in phases for element in _polynomials(phase)]
    first = np.cumsum([len(p.edges) - 1 for p in phases])
    joints = zip(begins[1:-1], first[:-1], pairwise(phases), strict=True)
    landings = [
        # not beyond the elements beside the touchdown: of a held gait they may last microseconds
        (
            begin,
            min(SWITCHED, (edges[i] - edges[i - 1]) / 2, (edges[i + 1] - edges[i]) / 2),
            int(i),
            phase.end[0] if stands(following) else math.inf,
        )
        for begin, i, (phase, following) in joints
        if not stands(phase)
    ]

    def law(t: float, x: Any) -> float:
        i = int(np.searchsorted(edges, t, side="right")) - 1
        i = min(max(i, 0), len(polynomials) - 1)
        if x is not None:
            for begin, window, landed, contact in landings:
                if abs(t - begin) < window:
                    i = landed - (x[0] > math.pi / 2 and x[0] != contact)
        s, value = (t - edges[i]) / (edges[i + 1] - edges[i]), 0.0
        for coefficient in polynomials[i]:
            value = value * s + coefficient
        return float(value)

    return [float(t) for t in edges[1:]], law


def _polynomials(phase: PhaseTrajectory) -> Array:
    """The voltage in every element over [0, 1]: coefficients, highest power first, by element."""
    inverse = np.linalg.inv(np.vander(phase.control_nodes))
    return np.asarray(phase.controls[:, :, 0] @ inverse.T)


def simulated(
    params: WheelParams, phases: Sequence[PhaseTrajectory], duration: float
) -> Trajectory:
    """Simulate from the start of the phases, under their voltage, for a duration (s)."""
    breakpoints, law = playback(phases)
    return simulate(params, phases[0].start, law, duration, breakpoints=breakpoints)


def simulated_stride(
    params: WheelParams,
    phases: Sequence[PhaseTrajectory],
    spare_times: Sequence[float],
    following: PhaseTrajectory | None = None,
) -> Trajectory:
    """Simulate until there have been as many touchdowns and lift-offs as there are phases.

    The last one is at the very end, but for rounding, so a little more is simulated, under the
    following phase's voltage.

    Args:
        params: the machine.
        phases: each ends with a touchdown, or in double stance with a lift-off.
        spare_times: additions to the phases' duration (s), ascending. The first that is enough for
            the last event is taken; if none is, the last one.
        following: the phase after these; the first one of them by default.
    """
    duration = sum(p.duration for p in phases)
    breakpoints, law = playback([*phases, phases[0] if following is None else following])
    mode = "double_stance" if stands(phases[0]) else "single_stance"
    for spare in spare_times:
        time = duration + spare
        run = simulate(params, phases[0].start, law, time, mode=mode, breakpoints=breakpoints)
        if len(run.events) >= len(phases):
            break
    return run


@lru_cache(maxsize=8)
def jacobians(params: WheelParams, flow: str = "flow", reset: str = "touchdown") -> ca.Function:
    """(x, u) -> (A, B, G): derivatives of a flow by x and u, and of a reset map by x.

    Both by their names in `HybridModel.functions`.
    """
    functions = HybridModel(params).functions
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    rates, after = functions[flow](x, u), functions[reset](x)
    outputs = [ca.jacobian(rates, x), ca.jacobian(rates, u), ca.jacobian(after, x)]
    return ca.Function("jacobians", [x, u], outputs)


def transition(params: WheelParams, phase: PhaseTrajectory) -> Array:
    """d x(end) / d x(start) over one phase, with times and control fixed, shape (4, 4)."""
    total = np.eye(4)
    for matrix in transitions(params, phase):
        total = matrix @ total
    return total


def transitions(params: WheelParams, phase: PhaseTrajectory, degree: int = 8) -> Iterator[Array]:
    """`transition` over each element of a phase: the variational equation, collocated there."""
    derivatives, nodes = jacobians(params, _flow(phase)), radau_nodes(degree)
    D = differentiation_matrix(degree)
    for start, h in zip(phase.edges, phase.element_durations, strict=False):
        t = start + h * nodes[1:]  # at the last of them the control may jump
        points = zip(phase.state(t), phase.control(t, "left")[:, 0], strict=True)
        system = np.kron(D[:, 1:], np.eye(4))
        for i, (x, u) in enumerate(points):
            block = slice(4 * i, 4 * i + 4)
            system[block, block] -= h * np.asarray(derivatives(x, u)[0])
        yield np.linalg.solve(system, -np.kron(D[:, :1], np.eye(4)))[-4:]


def _flow(phase: PhaseTrajectory) -> str:
    return "flow_double_stance" if stands(phase) else "flow"


def saltation(params: WheelParams, phase: PhaseTrajectory, following: PhaseTrajectory) -> Array:
    """How the end of a phase maps a deviation at a fixed time, shape (4, 4).

    A deviation moves a touchdown in time as well as the state that it maps (Leine and Nijmeijer,
    Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 7.2). A lift-off is when the clock
    makes the voltage jump, and maps nothing.
    """
    if stands(phase):
        return np.eye(4)
    reset = "stop_on_two_feet" if stands(following) else "touchdown"
    u_before = float(phase.control([phase.duration], "left")[0, 0])
    functions, before = HybridModel(params).functions, phase.end
    flow_before = functions["flow"](before, u_before).full().ravel()
    after = functions[reset](before)
    flow_after = functions[_flow(following)](after, following.controls[0, 0, 0]).full().ravel()
    impact = np.asarray(jacobians(params, reset=reset)(before, u_before)[2])
    gradient = np.array([1.0, 0.0, 0.0, 0.0])  # of the guard phi = b
    return np.asarray(
        impact + np.outer(flow_after - impact @ flow_before, gradient) / flow_before[0]
    )


def span_map(params: WheelParams, span: Span) -> Array:
    """d x(end) / d x(start) of a span, shape (4, 4), with the end of a step after the touchdown.

    Within a step the gait's voltage is played back in time. The touchdown itself, early or late,
    switches to the voltage of the following step. (If the clock switched it, early and late
    touchdowns would have different matrices.)
    """
    through = transition(params, span.phase)
    if span.following is None:
        return through
    return np.asarray(saltation(params, span.phase, span.following) @ through)


def monodromy(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> Array:
    """d x(T) / d x(0) over a stride, shape (4, 4): the product of the `span_map` of every step."""
    total = np.eye(4)
    for phase, following in zip(phases, [*phases[1:], phases[0]], strict=True):
        total = span_map(params, Span(0, 0, phase, following.start, following)) @ total
    return total


def floquet_multipliers(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> Array:
    """Eigenvalues of `monodromy`, largest first, complex, shape (4,).

    They are those of the gait in open loop, as `monodromy` defines it. All four matter: since the
    voltage is a function of time, no direction is neutral.
    """
    values = np.linalg.eigvals(monodromy(params, phases)).astype(complex)
    return np.asarray(values[np.argsort(-np.abs(values), kind="stable")])
