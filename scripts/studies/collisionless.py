"""Follow gaits to ever softer landings: the tables and the figure of docs/collisionless.md.

From the gait of least cost at a speed, the landing rate, phi' just before touchdown, is imposed and
moved: up to harder landings and down towards 0. Every gait on the way is one of least cost among
those that land at this rate, verified by the reference simulator. It takes some ten minutes of one
core.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

from agents.cli.options import MaybeCount, MaybePath
from rimless_gym.equations import equations
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE, PRESETS
from scripts.studies.documents.markdown import formatted, marks, refresh
from trajopt import pool
from trajopt.gaits.finish import finished
from trajopt.gaits.library import warm_starts
from trajopt.gaits.problem import CONTROL_DEGREE, MIN_TOUCHDOWN_RATE, gait_problem
from trajopt.ocp.arrays import Array
from trajopt.ocp.constraints import Constraint
from trajopt.ocp.continuation import continued
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.problem import Problem
from trajopt.ocp.solve import WARM_BARRIER, solve

#: Machines and speeds (m/s) of shipped gaits of one step.
CASES = (
    *(("BUILDABLE", speed) for speed in (0.55, 0.6, 0.6375)),
    *(("THESIS_PHYSICAL", speed) for speed in (0.5, 0.55, 0.575)),
)

#: ImposedLanding rates on the way (rad/s), and how many that are harder than the optimum's.
RATES, HARDER = (2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005), 4

#: Least phi' after touchdown, as a share of the landing rate. The usual bound, 0.01 rad/s, would
#: forbid the softest landings.
KEPT = 0.1

#: Landings without deceleration: at this rate (rad/s), with phi'' >= -STIFFNESS (b - phi), a bound
#: (1/s^2) that is tight only within the last hundredths of a second.
SOFT, STIFFNESS = 0.01, 1e4
AT_REST = "without deceleration"

#: The mesh of all gaits, and settings of their solves.
ELEMENTS, DEGREE = 24, 7
QUICK: dict[str, Any] = {"passes": 0, "verify": False, "option_sets": ({},), "max_iter": 200}

MARKS = marks("collisionless", ("landings", "at rest"))

_eq = equations(np.sin, np.cos, sqrt=np.sqrt)


class ImposedLanding(NamedTuple):
    """A gait of least cost among those that land in a certain way."""

    machine: str  # name of the preset
    speed: float  # m/s
    kind: str  # "shipped", "imposed" (a rate), or `AT_REST`
    rate: float  # phi' before touchdown (rad/s)
    acceleration: float  # phi'' before touchdown (rad/s^2)
    onwards: float  # phi'' after it (rad/s^2)
    theta: float  # angle of the pendulum at touchdown, from -pi to pi (rad)
    dtheta: float  # its rate there (rad/s)
    volts: float  # voltage there (V)
    cot: float  # cost of transport
    loss: float  # energy that the touchdown takes (J)


def collisionless(*, workers: MaybeCount = None, docs: MaybePath = None) -> int:
    """Follow gaits to ever softer landings.

    Args:
        workers: processes; by default one for every core.
        docs: a page, docs/collisionless.md, to put the tables into; the figure goes beside it.
    """
    found = dict(pool.run(followed, CASES, workers, progress="collisionless"))
    landings = [landing for case in CASES for landing in found[case]]
    sections = {"landings": _landings_table(landings), "at rest": _at_rest_table(landings)}
    if docs:
        refresh(docs, MARKS, sections)
        _figure(landings).savefig(docs.with_name("collisionless.png"), dpi=90)
    print("\n".join(sections.values()))
    return 0


def followed(case: tuple[str, float]) -> list[ImposedLanding]:
    """The verified gaits of a machine at a speed, from hard landings to soft ones, and at rest."""
    params = PRESETS[case[0]]
    known = warm_starts(params, case[1], 1, 1)[0]
    problem = gait_problem(params, speed=known.speed, steps=1, theta_turns=known.theta_turns)
    usual = float(known.phases[0].end[2])

    def landing_at(rate: float) -> Problem:
        return with_landing(problem, rate)

    mesh = Mesh.uniform(problem, ELEMENTS, DEGREE, control_degree=CONTROL_DEGREE)
    first = solve(landing_at(usual), known.phases, mesh, mu_init=WARM_BARRIER, **QUICK)
    hits: dict[float, Extremal] = {}
    for rates in (
        [rate for rate in RATES[::-1] if rate > 1.01 * usual][:HARDER],
        [rate for rate in RATES if rate < 0.99 * usual],
    ):
        if rates:
            curve = continued(landing_at, first, [usual, *rates], **QUICK)
            hits |= dict(zip(curve.values, curve.solutions, strict=True))
    kinds = {usual: "shipped"} | dict.fromkeys(RATES, "imposed")
    reached = [(kinds[rate], hits[rate]) for rate in sorted(hits, reverse=True) if rate in kinds]
    if SOFT in hits:
        gentle = without_deceleration(landing_at(SOFT), params)
        at_rest = solve(gentle, hits[SOFT].phases, mesh, mu_init=1e-3, **QUICK)
        reached += [(AT_REST, at_rest)] if at_rest.succeeded else []
    landings = [_measured(case, kind, each, known.theta_turns) for kind, each in reached]
    return [landing for landing in landings if landing is not None]


def with_landing(problem: Problem, rate: float) -> Problem:
    """A problem of one step with an imposed landing rate (rad/s)."""
    (stance,) = problem.phases
    assert stance.at_end is not None
    least = np.append(stance.at_end.lower[:-1], min(MIN_TOUCHDOWN_RATE, KEPT * rate))
    at_end = dataclasses.replace(stance.at_end, lower=least)
    stance = dataclasses.replace(stance, at_end=at_end, end={**stance.end, "phi'": rate})
    return dataclasses.replace(problem, phases=(stance,))


def without_deceleration(problem: Problem, params: WheelParams) -> Problem:
    """A problem of one step whose foot lands with phi'' >= 0."""
    (stance,) = problem.phases
    limits = stance.path
    assert limits is not None

    def inside(x: Any, u: Any, p: Any) -> Any:
        allowed = STIFFNESS * (params.constants.b - x[0])
        return ca.vertcat(limits.function(x, u, p), stance.flow(x, u, p)[2] + allowed)

    path = Constraint(
        inside,
        np.append(limits.lower, 0.0),
        np.append(limits.upper, np.inf),
        (*limits.names, "deceleration of the foot"),
    )
    return dataclasses.replace(problem, phases=(dataclasses.replace(stance, path=path),))


def _measured(
    case: tuple[str, float], kind: str, extremal: Extremal, turns: int
) -> ImposedLanding | None:
    """The figures of a gait; None if the simulator does not repeat it."""
    params = PRESETS[case[0]]
    gait = finished(params, extremal, turns, False, {"study": "collisionless"})
    if not gait.verification.passed:
        return None
    (step,) = gait.phases
    before, after = step.end, step.start
    volts = float(step.control(step.duration, "left")[0, 0])
    energies = [_eq.mechanical_energy(*state, params.constants) for state in (before, after)]
    return ImposedLanding(
        *case,
        kind,
        rate=float(before[2]),
        acceleration=_acceleration(params, before, volts),
        onwards=_acceleration(params, after, float(step.control(0.0)[0, 0])),
        theta=math.remainder(before[1], 2 * math.pi),
        dtheta=float(before[3]),
        volts=volts,
        cot=gait.cot,
        loss=float(energies[0] - energies[1]),
    )


def _acceleration(params: WheelParams, state: Array, volts: float) -> float:
    return float(_eq.single_stance(*state, volts, params.constants)[0])


# -- tables and figure ----------------------------------------------------------------------------

COLUMNS = {
    "machine": "`{machine}`",
    "speed (m/s)": "{speed:g}",
    "least CoT": "{cot:.5f}",
    "lands at (rad/s)": "{rate:.3f}",
    "loses (J)": "{loss:.1e}",
    "CoT at 0.1 rad/s": "{ten:.5f}",
    "at 0.01 rad/s": "{soft:.5f}",
    "at 0, extrapolated": "{limit:.5f}",
}
REST_COLUMNS = {
    "machine": "`{machine}`",
    "speed (m/s)": "{speed:g}",
    "CoT": "{cot:.5f}",
    "φ'' before and after landing (rad/s²)": "{acceleration:.2f}, {onwards:.2f}",
    "θ (rad), θ' (rad/s)": "{theta:.2f}, {dtheta:.2f}",
    "voltage (V)": "{volts:.2f}",
}


def _landings_table(landings: Sequence[ImposedLanding]) -> str:
    rows = []
    for case in CASES:
        line = [each for each in landings if each[:2] == case and each.kind != AT_REST]
        best, (before, last) = min(line, key=lambda each: each.cot), line[-2:]
        slope = (before.cot - last.cot) / (before.rate - last.rate)
        costs = {each.rate: each.cot for each in line}
        row = best._asdict() | {"ten": costs.get(10 * SOFT), "soft": costs.get(SOFT)}
        rows.append(row | {"limit": last.cot - slope * last.rate})
    return formatted(COLUMNS, rows) + "\n"


def _at_rest_table(landings: Sequence[ImposedLanding]) -> str:
    """The gaits that land at `SOFT`, with and without deceleration; and what stands still."""
    rows = [each._asdict() for each in landings if each.rate == SOFT]
    theta = np.linspace(-math.pi, math.pi, 721)[:, None]
    dtheta = -np.linspace(0.0, 20.0, 2001)
    coasting = _at_guard(theta, dtheta, None)
    least = -dtheta[(coasting <= 0.0).any(axis=0)].max()
    volts = -np.linspace(0.0, BUILDABLE.voltage_limit, 1201)
    weakest = -volts[(_at_guard(theta, 0.0, volts) <= 0.0).any(axis=0)].max()
    return (
        f"{formatted(REST_COLUMNS, rows)}\n\nA coasting pendulum of `BUILDABLE` balances the wheel "
        f"at its guard if it turns backwards at {least:.1f} rad/s or more; one that is at rest "
        f"itself does so if at least {weakest:.1f} V of {BUILDABLE.voltage_limit:g} V drive it.\n"
    )


def _at_guard(theta: Any, dtheta: Any, volts: Any) -> Array:
    """phi'' (rad/s^2) of `BUILDABLE` at rest at its guard; without volts, the motor coasts."""
    c = BUILDABLE.constants
    applied = _eq.motor_voltage(dtheta, 0.0, c) if volts is None else volts
    return np.asarray(_eq.single_stance(c.b, theta, 0.0, dtheta, applied, c)[0])


def _figure(landings: Sequence[ImposedLanding]) -> Figure:
    """CoT over the landing rate; and where the pendulum balances the wheel at its guard."""
    figure = Figure(figsize=(12, 4), layout="constrained")
    *panels, last = figure.subplots(1, 3)
    for panel, machine in zip(panels, dict.fromkeys(name for name, _ in CASES), strict=True):
        for case in (each for each in CASES if each[0] == machine):
            line = [each for each in landings if each[:2] == case]
            free = [(each.rate, each.cot) for each in line if each.kind != AT_REST]
            (drawn,) = panel.plot(*zip(*free, strict=True), ".-", label=f"{case[1]:g} m/s")
            rest = [(each.rate, each.cot) for each in line if each.kind == AT_REST]
            panel.plot(*np.reshape(rest, (-1, 2)).T, "x", color=drawn.get_color())
        panel.set(title=machine, xscale="log", xlabel="φ' at landing (rad/s)", ylim=(0, 0.2))
        panel.grid(alpha=0.3)
        panel.legend()
    panels[0].set_ylabel("least cost of transport (crosses: no deceleration)")
    theta, dtheta = np.meshgrid(np.linspace(0, 2 * math.pi, 201), np.linspace(-16, 4, 201))
    for volts, colour in ((-12.0, "C0"), (-6.0, "C1"), (0.0, "C2"), (None, "k")):
        last.contour(theta, dtheta, _at_guard(theta, dtheta, volts), [0.0], colors=colour)
        last.plot([], [], colour, label="coasting" if volts is None else f"{volts:g} V")
    rests = [each for each in landings if each[::2][:2] == ("BUILDABLE", AT_REST)]
    last.plot([each.theta % (2 * math.pi) for each in rests], [each.dtheta for each in rests], "kx")
    last.set(title="BUILDABLE: φ' = φ'' = 0 at landing", xlabel="θ (rad)", ylabel="θ' (rad/s)")
    last.legend()
    return figure
