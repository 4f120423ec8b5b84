"""Textbook problems with known answers, which a solver has to find before it is believed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any, Literal

import casadi as ca
from scipy.optimize import brentq
from tqdm import tqdm

from agents.cli.options import Count, Names, Positive, chosen
from scripts.studies.documents.markdown import table
from trajopt import Extremal, Linkage, Mesh, Phase, Problem, equal, nonnegative, solve

#: In m/s^2.
GRAVITY = 9.81


def brachistochrone(x: float = 1.0, y: float = 1.0) -> Problem:
    """The wire along which a bead slides fastest, from rest, to x (m) along and y (m) down."""
    slide = Phase(
        "slide",
        states=("x", "y", "v"),
        controls=("slope",),  # from the vertical
        flow=lambda s, u, p: (s[2] * ca.sin(u), s[2] * ca.cos(u), GRAVITY * ca.cos(u)),
        cost=lambda s, u, p: 1.0,
        bounds={"slope": (0.0, math.pi)},
        start={"x": 0.0, "y": 0.0, "v": 0.0},
        end={"x": x, "y": y},
    )
    return Problem((slide,))


def brachistochrone_time(x: float = 1.0, y: float = 1.0) -> float:
    """The least time (s), on a cycloid (Bernoulli).

    x = r (q - sin q), y = r (1 - cos q) at time q sqrt(r / g).
    """
    q = _root(lambda q: (q - math.sin(q)) * y - (1 - math.cos(q)) * x, 1e-3, 2 * math.pi - 1e-9)
    return q * math.sqrt(y / (1 - math.cos(q)) / GRAVITY)


def cart_pole() -> Problem:
    """Swing a pole up in 2 s while its cart moves 1 m (Kelly, SIAM Review 59 (2017), 6)."""
    m1, m2, length, g = 1.0, 0.3, 0.5, GRAVITY

    def flow(x: Any, u: Any, p: Any) -> Any:
        s, c = ca.sin(x[1]), ca.cos(x[1])
        push = length * m2 * s * x[3] ** 2 + u
        d = m1 + m2 * s**2
        cart = (push + m2 * g * c * s) / d
        pole = -(push * c + (m1 + m2) * g * s) / (length * d)
        return x[2], x[3], cart, pole

    swing = Phase(
        "swing-up",
        states=("q1", "q2", "dq1", "dq2"),
        controls=("u",),
        flow=flow,
        cost=lambda x, u, p: u**2,
        bounds={"u": (-20.0, 20.0), "q1": (-2.0, 2.0)},
        start={"q1": 0.0, "q2": 0.0, "dq1": 0.0, "dq2": 0.0},
        end={"q1": 1.0, "q2": math.pi, "dq1": 0.0, "dq2": 0.0},
        duration=2.0,
    )
    return Problem((swing,))


#: The least cost of `cart_pole`. It has no closed form; it comes from shooting with Pontryagin's
#: conditions, which the tests repeat.
SWING_UP = 58.80766746


def bouncing_ball(distance: float = 3.0, restitution: float = 0.8) -> Problem:
    """Throw a ball from the ground so that it lands for the third time `distance` (m) away.

    The launch is free; it costs its kinetic energy.
    """

    def flight(name: str, start: dict[str, float], end: dict[str, float]) -> Phase:
        return Phase(
            name,
            states=("x", "y", "vx", "vy"),
            flow=lambda s, u, p: (s[2], s[3], 0.0, -GRAVITY),
            start={"vy": (0.0, math.inf), **start},
            end={"y": 0.0, **end},
            duration=(0.01, 10.0),
        )

    def bounce(s: Any, p: Any) -> Any:
        return s[0], s[1], s[2], -restitution * s[3]

    return Problem(
        phases=(
            flight("first flight", {"x": 0.0, "y": 0.0}, {}),
            flight("second flight", {}, {}),
            flight("third flight", {}, {"x": distance}),
        ),
        linkages=(Linkage(0, 1, bounce), Linkage(1, 2, bounce)),
        endpoint_cost=lambda starts, ends, durations, p: 0.5 * ca.sumsqr(starts[0][2:]),
    )


def bouncing_ball_energy(distance: float = 3.0, restitution: float = 0.8) -> float:
    """The least energy per kg.

    Flights last 2 vy / g each, and vy falls by the factor e at each bounce, so that the distance is
    (2 / g) vx vy (1 + e + e^2). Of all vx and vy with that product, equal ones cost least.
    """
    e = restitution
    return distance * GRAVITY / (2 * (1 + e + e**2))


def fastest_move(distance: float = 1.0, brake: float = 1.0) -> Problem:
    """Move a block of 1 kg from rest to rest as fast as a force from -brake to 1 N allows."""
    timed = {"cost": lambda x, u, p: 1.0, "duration": (0.1, 10.0)}
    return Problem((_block((-brake, 1.0), distance, **timed),))


def fastest_move_time(distance: float = 1.0, brake: float = 1.0) -> float:
    """The least time (s): full force, then full brake."""
    return math.sqrt(2 * distance * (1 + 1 / brake))


def least_effort_move() -> Problem:
    """Move a block of 1 kg by 1 m in 1 s, from rest to rest, at least integral of force squared.

    That is 12, by a force of 6 - 12 t.
    """
    return Problem((_block((-math.inf, math.inf), cost=lambda x, u, p: u**2),))


def least_work_move(force: float = 10.0) -> Problem:
    """The same move at least work: braking costs nothing and returns nothing."""
    return Problem((_block((-force, force), powers=lambda x, u, p: u * x[1]),))


def least_work(force: float = 10.0) -> float:
    """The least work: push, coast at v, brake (Kelly, SIAM Review 59 (2017), 5).

    The block gets 1 m = v 1 s - v^2 / force far.
    """
    v = 0.5 * force * (1 - math.sqrt(1 - 4 / force))
    return 0.5 * v**2


def bryson_denham(limit: float = 1 / 9) -> Problem:
    """Turn a moving block round within `limit` (m) at least effort."""
    turn = Phase(
        "turn",
        states=("x", "v"),
        controls=("u",),
        flow=lambda x, u, p: (x[1], u),
        cost=lambda x, u, p: 0.5 * u**2,
        bounds={"x": (-math.inf, limit)},
        start={"x": 0.0, "v": 1.0},
        end={"x": 0.0, "v": -1.0},
        duration=1.0,
    )
    return Problem((turn,))


def bryson_denham_cost(limit: float = 1 / 9) -> float:
    """The least cost, for a limit of at most 1/6 (Bryson and Ho, Applied Optimal Control, 3.11)."""
    return 4 / (9 * limit)


def gear(motor: float = 0.02, load: float = 0.5) -> Problem:
    """Turn a load by 1 rad in 1 s, from rest to rest, through the gear that takes least torque.

    Inertias are in kg m^2. The motor turns `ratio` times as fast as the load.
    """
    turn = Phase(
        "turn",
        states=("angle", "rate"),
        controls=("torque",),
        flow=lambda x, u, p: (x[1], u * p / (motor * p**2 + load)),
        cost=lambda x, u, p: u**2,
        start={"angle": 0.0, "rate": 0.0},
        end={"angle": 1.0, "rate": 0.0},
        duration=1.0,
    )
    return Problem((turn,), parameters={"ratio": (0.1, 100.0)})


def gear_cost(motor: float = 0.02, load: float = 0.5) -> float:
    """The least cost: the least effort at the ratio sqrt(load / motor), at which inertias match.

    The torque is (motor ratio + load / ratio) times the load's acceleration.
    """
    return 12.0 * 4 * motor * load


def coasting() -> Problem:
    """Bring x to 0 at least integral of x^2, 1/3: full speed for 1 s, then a singular arc."""
    coast = Phase(
        "coast",
        states=("x",),
        controls=("u",),
        flow=lambda x, u, p: u,
        cost=lambda x, u, p: x**2,
        bounds={"u": (-1.0, 1.0)},
        start={"x": 1.0},
        duration=2.0,
    )
    return Problem((coast,))


def unstable(duration: float = 40.0) -> Problem:
    """Hold x' = x + u at least integral of x^2 + u^2: an error grows by exp(duration)."""
    hold = Phase(
        "hold",
        states=("x",),
        controls=("u",),
        flow=lambda x, u, p: x + u,
        cost=lambda x, u, p: x**2 + u**2,
        start={"x": 1.0},
        duration=duration,
    )
    return Problem((hold,))


#: The least cost of `unstable`, if it lasts long, by Riccati's equation.
HELD = 1 + math.sqrt(2)


def free_flying_robot() -> Problem:
    """Move a robot with four jets to a dock in 12 s with the least fuel (Sakawa 1999)."""

    def flow(x: Any, u: Any, p: Any) -> Any:
        left, right = u[0] - u[1], u[2] - u[3]
        push, turn = left + right, 0.2 * (left - right)
        return x[3], x[4], x[5], push * ca.cos(x[2]), push * ca.sin(x[2]), turn

    names, jets = ("x", "y", "angle", "vx", "vy", "rate"), ("u1", "u2", "u3", "u4")
    rest = dict.fromkeys(names, 0.0)
    fly = Phase(
        *("fly", names, flow, jets),
        cost=lambda x, u, p: ca.sum1(u),
        path=nonnegative(lambda x, u, p: (1 - u[0] - u[1], 1 - u[2] - u[3]), "left", "right"),
        bounds=dict.fromkeys(jets, (0.0, 1.0)),
        start=rest | {"x": -10.0, "y": -10.0, "angle": math.pi / 2},
        end=rest,
        duration=12.0,
    )
    return Problem((fly,))


#: The least fuel of `free_flying_robot` (Betts, Practical Methods for Optimal Control, 2nd ed.,
#: 6.13): jets switch twelve times.
FLOWN = 7.9101471


def hanging_chain(length: float = 1.5) -> Problem:
    """How a chain between two nails 1 m apart hangs lowest; "time" runs from nail to nail."""
    chain = Phase(
        "chain",
        states=("height",),
        controls=("slope",),
        flow=lambda x, u, p: (u,),
        cost=lambda x, u, p: x * ca.sqrt(1 + u**2),
        integral=equal(lambda x, u, p: ca.sqrt(1 + u**2), [length], "length"),
        start={"height": 0.0},
        end={"height": 0.0},
        duration=1.0,
    )
    return Problem((chain,))


def hanging_chain_energy(length: float = 1.5) -> float:
    """The least energy, of the catenary a cosh(x / a) - a cosh(1 / 2a), 2 a sinh(1 / 2a) long."""
    a = _root(lambda a: 2 * a * math.sinh(0.5 / a) - length, 0.05, 50.0)
    return 0.5 * a * (1 + a * math.sinh(1 / a)) - a * math.cosh(0.5 / a) * length


def compass_walker(slope: float = 0.009) -> Problem:
    """The longer cycle of a bare compass down a slope: massless legs, feet lighter than the hip.

    The stance leg's angle is from the slope's normal, the swing leg's from the stance leg; time is
    in units of sqrt(length / gravity). The cost is the stance leg's angle after a step.
    """

    def flow(x: Any, u: Any, p: Any) -> Any:
        stance, swing, rate, swing_rate = ca.vertsplit(x)
        lean = stance - slope
        pull = rate**2 * ca.sin(swing) - ca.cos(lean) * ca.sin(swing)
        return rate, swing_rate, ca.sin(lean), ca.sin(lean) + pull

    def step(x: Any, p: Any) -> Any:
        kept = ca.cos(2 * x[0]) * x[2]
        return -x[0], -2 * x[0], kept, (1 - ca.cos(2 * x[0])) * kept

    stance = Phase(
        "stance",
        states=("stance", "swing", "stance rate", "swing rate"),
        flow=flow,
        at_end=equal(lambda x, p: x[1] - 2 * x[0], [0.0], "both feet on the slope"),
        start={"stance": (0.15, 0.25), "stance rate": (-0.3, -0.1)},
        end={"stance": (-0.25, -0.15)},
        duration=(3.8, 4.5),
    )
    return Problem(
        (stance,),
        linkages=(Linkage(0, 0, step),),
        endpoint_cost=lambda starts, ends, durations, p: starts[0][0],
    )


#: The angle of `compass_walker` after a step at a slope of 0.009 (Garcia, Chatterjee, Ruina and
#: Coleman, The simplest walking model, J. Biomech. Eng. 120 (1998)).
COMPASS = 0.200310900544287


def _block(force: tuple[float, float], distance: float = 1.0, **more: Any) -> Phase:
    """A block of 1 kg moved from rest to rest."""
    return Phase(
        "move",
        states=("x", "v"),
        controls=("force",),
        flow=lambda x, u, p: (x[1], u),
        bounds={"force": force},
        start={"x": 0.0, "v": 0.0},
        end={"x": distance, "v": 0.0},
        **{"duration": 1.0} | more,
    )


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(brentq(function, low, high, xtol=1e-15, rtol=1e-15))


@dataclasses.dataclass(frozen=True)
class Example:
    """A problem and its least cost."""

    problem: Callable[[], Problem]  # makes the problem
    known: Callable[[], float]  # computes the cost

    @property
    def name(self) -> str:
        """The problem's name in words."""
        return self.problem.__name__.replace("_", " ")


PROBLEMS = (
    Example(brachistochrone, brachistochrone_time),
    Example(cart_pole, lambda: SWING_UP),
    Example(bouncing_ball, bouncing_ball_energy),
    Example(fastest_move, fastest_move_time),
    Example(least_effort_move, lambda: 12.0),
    Example(least_work_move, least_work),
    Example(bryson_denham, bryson_denham_cost),
    Example(gear, gear_cost),
    Example(hanging_chain, hanging_chain_energy),
    Example(compass_walker, lambda: COMPASS),
    Example(coasting, lambda: 1 / 3),
    Example(unstable, lambda: HELD),
    Example(free_flying_robot, lambda: FLOWN),
)

#: As in docs/optimal-control.md.
HEAD = ("problem", "known", "found", "error", "estimate", "runs")


def row(example: Example, found: Extremal) -> tuple[str, ...]:
    """One line of the table."""
    known = example.known()
    error = f"{abs(found.cost - known) / abs(known):.0e}"
    return (
        example.name,
        f"{known:.10g}",
        f"{found.cost:.10g}",
        error if found.converged else f"**{found.failures[0]}**",
        f"{found.certificate.suboptimality / abs(known):.0e}",
        str(len(found.attempts)),
    )


def textbook(
    *,
    problems: Names = (),
    scheme: Literal["radau", "hermite-simpson", "trapezoid"] = "radau",
    elements: Count = 10,
    degree: Count = 4,
    tolerance: Positive = 1e-7,
) -> int:
    """Solve textbook problems and print a table; the exit status is 1 if one does not converge.

    Args:
        problems: some of them, by the names of their functions; all by default.
        scheme: transcription.
        elements: per phase, to begin with.
        degree: of radau, to begin with.
        tolerance: of the mesh.
    """
    known = {example.problem.__name__: example for example in PROBLEMS}
    rows, converged = [], True
    for name in tqdm(chosen(problems, list(known)), desc="problems"):
        problem = known[name].problem()
        mesh = Mesh.uniform(problem, elements, degree, scheme)
        found = solve(problem, mesh=mesh, tolerance=tolerance)
        rows.append(row(known[name], found))
        converged = converged and found.converged
    print(table(HEAD, rows))
    return 0 if converged else 1
