"""Every textbook problem, by every scheme, against its closed form."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from scripts.studies import textbook
from scripts.studies.textbook import PROBLEMS, Example
from tests.trajopt.ocp.problems import solve_once, solved
from trajopt import Extremal, Mesh, solve
from trajopt.ocp.refinement import Tolerances

#: Errors of the cost, relative to the closed form, where they exceed 1e-7; they are larger
#: where the solution has kinks or a constraint on the state, which holds to 1e-6.
LOOSER = {
    "least work move": 3e-6,
    "bryson denham": 3e-6,
    "free flying robot": 1e-5,
    "coasting": 3e-7,
}


@pytest.mark.parametrize("example", PROBLEMS, ids=lambda e: e.name)
def test_radau_finds_the_closed_forms_cost_with_few_elements(example: Example) -> None:
    found, known = solved(example.name), example.known()
    assert found.converged, found.report()
    assert found.cost == pytest.approx(known, rel=LOOSER.get(example.name, 1e-7))
    assert found.transcribed_cost == pytest.approx(known, rel=LOOSER.get(example.name, 1e-7))
    assert found.mesh.elements <= 40
    assert len(found.attempts) <= 15


def require_right_estimate(found: Extremal, known: float) -> None:
    """Within a factor of ten of the error, or both below the tolerance of the cost.

    It may exceed the error further where limits are violated: violations hide other errors.
    """
    whole = found.scales.cost + abs(known)
    error, estimate = abs(found.cost - known) / whole, found.certificate.suboptimality / whole
    assert error < 10 * estimate + 1e-8  # not all costs are known to more digits
    if not found.audit or found.audit[0].relative < found.limit_tolerance:
        assert estimate < 10 * error + Tolerances().cost


@pytest.mark.parametrize("example", PROBLEMS, ids=lambda e: e.name)
def test_how_far_a_cost_is_from_the_least_is_known_within_a_factor_of_ten(example: Example) -> None:
    require_right_estimate(solved(example.name), example.known())
    problem = example.problem()
    coarse = solve_once(problem, mesh=Mesh.uniform(problem, 7))
    require_right_estimate(coarse, example.known())


@pytest.mark.parametrize("elements", [20, 40])
def test_it_is_known_where_a_low_order_misses_a_bounded_integral(elements: int) -> None:
    problem = textbook.hanging_chain()
    mesh = Mesh.uniform(problem, elements, scheme="trapezoid")
    found = solve(problem, mesh=mesh, passes=0)
    error = abs(found.cost - textbook.hanging_chain_energy())
    assert error / 10 < found.certificate.suboptimality < 10 * error


@pytest.mark.slow
@pytest.mark.parametrize("elements", [5, 7, 13])
@pytest.mark.parametrize("example", PROBLEMS, ids=lambda e: e.name)
def test_it_is_known_on_the_mesh_that_refinement_makes_of_any(
    example: Example, elements: int
) -> None:
    problem = example.problem()
    found = solve(problem, mesh=Mesh.uniform(problem, elements))
    require_right_estimate(found, example.known())


@pytest.mark.parametrize(
    "example", [e for e in PROBLEMS if e.name in ("brachistochrone", "bouncing ball", "gear")]
)
@pytest.mark.parametrize(("scheme", "error"), [("hermite-simpson", 2e-5), ("trapezoid", 3e-2)])
def test_other_schemes_find_the_cost_as_accurately_as_their_order_allows(
    example: Example, scheme: str, error: float
) -> None:
    problem = example.problem()
    found = solve_once(problem, mesh=Mesh.uniform(problem, 12, scheme=scheme))
    assert found.succeeded
    assert found.cost == pytest.approx(example.known(), rel=error)


def test_the_brachistochrone_is_a_cycloid() -> None:
    x, y, time = math.pi, 2.0, math.pi / math.sqrt(9.81)  # half a turn
    assert textbook.brachistochrone_time(x, y) == pytest.approx(time, rel=1e-14)
    found = solve(textbook.brachistochrone(x, y))
    assert found.cost == pytest.approx(time, rel=1e-7)
    q = np.linspace(0.0, time, 9) * math.sqrt(9.81)
    exact = np.stack([q - np.sin(q), 1 - np.cos(q)], axis=1)
    np.testing.assert_allclose(found.phases[0].state(q / math.sqrt(9.81))[:, :2], exact, atol=3e-6)


@pytest.mark.parametrize(("brake", "elements"), [(0.5, 7), (3.0, 10)])
def test_full_force_switches_to_full_brake_at_one_time(brake: float, elements: int) -> None:
    problem = textbook.fastest_move(2.0, brake)
    found = solve(problem, mesh=Mesh.uniform(problem, elements), verify=False)
    time = textbook.fastest_move_time(2.0, brake)
    assert found.cost == pytest.approx(time, rel=1e-6)
    switch, margin = time * brake / (1 + brake), 0.02 * time
    assert found.control(switch - margin) == pytest.approx(1.0, abs=1e-5)
    assert found.control(switch + margin) == pytest.approx(-brake, abs=1e-5)


def test_a_block_rests_at_its_limit_in_bryson_denhams_problem() -> None:
    limit = 0.05
    found = solve(textbook.bryson_denham(limit), verify=False)
    assert found.cost == pytest.approx(textbook.bryson_denham_cost(limit), rel=1e-5)
    t = np.linspace(0.0, 1.0, 301)
    highest = found.phases[0].state(t)[:, 0]
    assert highest.max() == pytest.approx(limit, abs=1e-6)
    assert np.all(highest[(t > 3 * limit) & (t < 1 - 3 * limit)] > limit - 1e-4)


def test_the_ball_is_thrown_at_45_degrees_and_bounces_by_its_restitution() -> None:
    found = solved("bouncing ball")
    flights = found.phases
    assert flights[0].start[2] == pytest.approx(flights[0].start[3], rel=1e-6)
    rates = [flight.start[3] for flight in flights]
    assert rates[1:] == pytest.approx([0.8 * rates[0], 0.64 * rates[0]], rel=1e-9)
    durations = [flight.duration for flight in flights]
    assert durations == pytest.approx([2 * v / 9.81 for v in rates], rel=1e-9)


def test_the_gears_ratio_matches_the_inertias() -> None:
    found = solved("gear")
    assert found.parameters == pytest.approx([5.0], rel=1e-6)


def test_the_swing_up_satisfies_pontryagins_conditions_found_another_way() -> None:
    """Kelly's cart-pole by the indirect method: u = -costate . d flow / du / 2, by shooting."""
    found = solved("cart pole")
    problem = found.problem
    x, costates = ca.SX.sym("x", 4), ca.SX.sym("costates", 4)
    flow, u = problem.phases[0].flow, ca.SX.sym("u")
    pushed = ca.jacobian(flow(x, u, ca.SX(0, 1)), u)
    best = -0.5 * ca.dot(costates, pushed)
    least = best**2 + ca.dot(costates, flow(x, best, ca.SX(0, 1)))
    fixed = u**2 + ca.dot(costates, flow(x, u, ca.SX(0, 1)))
    slope = ca.substitute(-ca.gradient(fixed, x), u, best)
    rhs = ca.Function("rhs", [x, costates], [ca.vertcat(ca.gradient(least, costates), slope), best])

    def shot(costate: np.ndarray) -> np.ndarray:
        def rates(t: float, y: np.ndarray) -> np.ndarray:
            slopes, u = (np.asarray(part).ravel() for part in rhs(y[:4], y[4:8]))
            return np.concatenate([slopes, u**2])

        y = np.concatenate([found.phases[0].start, costate, [0.0]])
        return solve_ivp(rates, (0.0, 2.0), y, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]

    ours = found.certificate.costates[0][0]
    costate, _, ok, _ = fsolve(
        lambda guess: shot(guess)[:4] - found.phases[0].end, ours, full_output=True
    )
    assert ok == 1
    assert found.cost == pytest.approx(shot(costate)[-1], rel=1e-9)
    assert ours == pytest.approx(costate, rel=1e-6)
