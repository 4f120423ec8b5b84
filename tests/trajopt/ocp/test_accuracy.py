"""Estimates of errors, simulations and costates, compared with known solutions."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from scripts.studies import textbook
from tests.trajopt.ocp.problems import (
    NONE,
    ones,
    passive_wheel,
    passive_wheel_rate,
    solve_once,
    solved,
)
from trajopt import Extremal, Linkage, Mesh, Phase, PhaseTrajectory, Problem, nonnegative, solve
from trajopt.ocp import resimulation
from trajopt.ocp.accuracy import assess, audit, cost_errors
from trajopt.ocp.guesses import straight_lines
from trajopt.ocp.resimulation import resimulate
from trajopt.ocp.scaling import scales_of
from trajopt.ocp.transcription import Transcription


def pendulum(**more: Any) -> Problem:
    swing = Phase(
        "swing",
        states=("q", "dq"),
        flow=lambda x, u, p: (x[1], -ca.sin(x[0])),
        start={"q": 2.0, "dq": 0.0},
        duration=6.0,
        **more,
    )
    return Problem((swing,))


def exact(t: np.ndarray, start: np.ndarray) -> np.ndarray:
    run = solve_ivp(
        lambda t, x: [x[1], -math.sin(x[0])],
        (t[0], t[-1]),
        start,
        "DOP853",
        t,
        rtol=1e-13,
        atol=1e-14,
    )
    return run.y.T


@pytest.mark.parametrize(
    ("scheme", "degree", "elements"),
    [
        ("trapezoid", 2, 40),
        ("hermite-simpson", 3, 12),
        ("radau", 4, 6),
        ("radau", 6, 4),
    ],
)
def test_the_reported_error_of_an_element_is_the_true_one_within_a_factor(
    scheme: str, degree: int, elements: int
) -> None:
    problem = pendulum()
    mesh = Mesh.uniform(problem, elements, degree, scheme)
    found = Transcription(problem, mesh).solve(straight_lines(problem), tol=1e-12)
    trajectory = found.phases[0]
    quality = assess(problem.phases[0], trajectory, NONE, ones(problem.phases[0]))
    scale = 1 + np.abs(trajectory.states).max(axis=(0, 1))
    for e in range(elements):
        t = np.linspace(trajectory.edges[e], trajectory.edges[e + 1], 30)
        t[-1] -= 1e-9
        within = np.abs(trajectory.state(t) - exact(t, trajectory.states[e, 0])) / scale
        assert within.max() / 4 < quality.state_error[e] + 1e-12
        assert quality.state_error[e] < 20 * within.max() + 1e-12


def test_a_simulation_finds_the_exact_cost_of_a_wrong_quadrature() -> None:
    problem = textbook.least_effort_move()
    coarse = solve(problem, mesh=Mesh.uniform(problem, 4, scheme="trapezoid"), passes=0)
    t = np.linspace(0.0, coarse.duration, 200001)
    u = coarse.phases[0].control(t)[:, 0]
    assert coarse.cost == pytest.approx(np.mean(0.5 * (u[1:] ** 2 + u[:-1] ** 2)), rel=1e-8)
    assert abs(coarse.cost - coarse.transcribed_cost) > 0.1


@pytest.mark.parametrize("floor", [0.0, 0.3, -math.inf])
def test_a_simulation_finds_the_exact_cost_of_a_power_that_passes_its_floor(floor: float) -> None:
    """v' = u and u linear in time, one second long: u v is cubic, and so are all its pieces."""
    flow, power = (lambda x, u, p: (u[0],)), (lambda x, u, p: u[0] * x[0])
    phase = Phase("push", ("v",), flow, ("u",), powers=power, floor=floor)
    problem = Problem((phase,))
    rng, nodes = np.random.default_rng(1), np.array([0.0, 0.5, 1.0])
    for _ in range(10):
        u = np.polynomial.Polynomial(rng.uniform([-2.0, 3.0], [-1.0, 5.0]))
        v = u.integ() + rng.uniform(-1.0, 1.0)
        trajectory = PhaseTrajectory(
            *(np.array([0.0, 1.0]), nodes, v(nodes)[None, :, None]),
            *(nodes[::2], u(nodes[::2])[None, :, None]),
        )
        excess = u * v - (0.0 if math.isinf(floor) else floor)
        roots = excess.roots()
        inside = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0) & (roots.real < 1)]
        pieces = np.diff(excess.integ()(np.array([0.0, *np.sort(inside), 1.0])))
        exact = pieces.sum() if math.isinf(floor) else floor + pieces[pieces > 0].sum()
        scales = scales_of(problem, [trajectory])
        simulated = resimulate(problem, [trajectory], NONE, scales)
        assert simulated.chain_error < 1e-12
        assert simulated.cost == pytest.approx(exact, abs=1e-13)


def test_the_error_of_the_cost_is_what_its_quadrature_misses() -> None:
    problem = textbook.least_effort_move()
    transcription = Transcription(problem, Mesh.uniform(problem, 4, scheme="trapezoid"))
    result = transcription.solve(straight_lines(problem))
    scales = result.scales
    cost = resimulate(problem, result.phases, NONE, scales).cost
    errors = cost_errors(transcription, result, scales)[0]
    assert errors.sum() * (scales.cost + result.cost) == pytest.approx(result.cost - cost, rel=1e-9)


def test_the_quadrature_of_bounded_integrals_is_checked_too() -> None:
    problem = textbook.hanging_chain()
    transcription = Transcription(problem, Mesh.uniform(problem, 4, scheme="trapezoid"))
    result = transcription.solve(straight_lines(problem))
    coarse = cost_errors(transcription, result, result.scales)[0]
    assert coarse.max() > 1e-3


def test_a_perturbed_solution_is_detected() -> None:
    problem = textbook.cart_pole()
    right = solved("cart pole").phases[0]
    wrong = PhaseTrajectory(
        right.edges, right.nodes, right.states, right.control_nodes, right.controls + 1e-3
    )
    scales = solved("cart pole").scales
    assert assess(problem.phases[0], right, NONE, scales.phases[0]).state_error.max() < 1e-7
    assert assess(problem.phases[0], wrong, NONE, scales.phases[0]).state_error.max() > 1e-6
    assert max(resimulate(problem, [wrong], NONE, scales).phase_errors) > 1e-4


def test_violations_between_the_nodes_are_detected_even_close_to_an_edge() -> None:
    """A polynomial of degree 9, within its bound but for 0.5 % of the element."""
    nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(10) / 9)
    bump = np.polynomial.Polynomial([0.0, 1.0, -200.0])  # t - 200 t^2: positive up to t = 0.005
    states = bump(nodes)[None, :, None]
    trajectory = PhaseTrajectory(
        np.array([0.0, 1.0]), nodes, states, np.array([0.0, 1.0]), np.zeros((1, 2, 0))
    )
    phase = Phase("one", ("x",), lambda x, u, p: (x,), bounds={"x": (-math.inf, 0.0)})
    problem = Problem((phase,))
    worst = audit(problem, [trajectory], NONE, scales_of(problem, [trajectory]))[0]
    assert worst.amount > 0.4 * 0.00125
    assert worst.time < 0.005
    assert "bound of x of phase 'one' at t = 0.004" in str(worst)


def test_path_constraints_are_audited_by_name() -> None:
    path = nonnegative(lambda x, u, p: (1 - x[0], x[1] + 0.2), "below one", "not back")
    problem = pendulum(path=path)
    t = np.linspace(0.0, 6.0, 40)
    states = np.stack([exact(t, np.array([2.0, 0.0]))[:-1], exact(t, np.array([2.0, 0.0]))[1:]], 1)
    ends = np.array([0.0, 1.0])
    trajectory = PhaseTrajectory(t, ends, states, ends, np.zeros((39, 2, 0)))
    violations = audit(problem, [trajectory], NONE, scales_of(problem, [trajectory]))
    names = {violation.name: violation for violation in violations}
    assert names["below one"].amount == pytest.approx(1.0, abs=1e-3)
    assert names["not back"].amount > 1.0


def test_the_step_error_is_that_of_an_adaptive_integrator() -> None:
    problem = textbook.cart_pole()
    found = solve(problem, passes=0, verify=False)
    trajectory, phase = found.phases[0], problem.phases[0]
    quality = assess(phase, trajectory, NONE, ones(phase))
    scale = 1 + np.abs(trajectory.states).max(axis=(0, 1))
    for e in (0, 4, 9):
        begin, end = trajectory.edges[e : e + 2]

        def rates(t: float, x: np.ndarray) -> np.ndarray:
            inside = min(max(t, begin + 1e-9), end - 1e-9)  # noqa: B023 - used at once
            return np.asarray(phase.flow(x, trajectory.control(inside)[0], NONE)).ravel()

        start = trajectory.states[e, 0]
        run = solve_ivp(rates, (begin, end), start, "RK45", rtol=1e-10, atol=1e-12)
        error = np.abs(run.y[:, -1] - trajectory.states[e, -1]) / scale
        assert quality.step_error[e] == pytest.approx(error.max(), rel=0.1, abs=1e-8)


def test_a_simulation_gives_up_on_what_an_explicit_integrator_cannot_follow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(resimulation, "EFFORT", 2000)
    stiff = Phase(
        "stiff",
        states=("x", "y"),
        controls=("u",),
        flow=lambda x, u, p: (u[0], -1e5 * (x[1] - ca.sin(5 * x[0]))),
        cost=lambda x, u, p: u[0] ** 2 + x[1] ** 2,
        start={"x": 0.0, "y": 1.0},
        end={"x": 1.0},
        duration=1.0,
    )
    found = solve(Problem((stiff,)), passes=0)
    assert found.succeeded
    assert not found.converged
    assert found.resimulation is not None
    assert found.resimulation.chain_error == math.inf


def test_a_stiff_motion_needs_no_short_elements() -> None:
    """A lag of 1 ms before one of 1 s: the cost is 1 / integral of the impulse response squared."""
    rate = 1e3
    lagging = Phase(
        "lag",
        states=("x", "y"),
        controls=("u",),
        flow=lambda x, u, p: (x[1] - x[0], rate * (u[0] - x[1])),
        cost=lambda x, u, p: u[0] ** 2,
        start={"x": 0.0, "y": 0.0},
        end={"x": 1.0},
        duration=1.0,
    )
    found = solve(Problem((lagging,)), verify=False)
    assert found.converged, found.report()
    assert found.mesh.elements < 40
    t, slow, fast = (-math.expm1(-k) / k for k in (2.0, 1.0 + rate, 2.0 * rate))
    assert found.cost == pytest.approx(((rate - 1) / rate) ** 2 / (t - 2 * slow + fast), rel=1e-7)


@pytest.mark.parametrize("duration", [40.0, 100.0])
def test_an_unstable_motion_is_simulated_in_spans_over_which_errors_grow_little(
    duration: float,
) -> None:
    found = solve(textbook.unstable(duration))
    assert found.converged, found.report()
    assert found.cost == pytest.approx(textbook.HELD, rel=1e-8)
    assert found.resimulation is not None
    assert found.resimulation.growth[0] == pytest.approx(duration / math.log(10), rel=1e-6)
    assert found.resimulation.spans[0] >= found.resimulation.growth[0] / 3
    assert "errors grow by 1e" in found.report()


def test_a_simulation_that_leaves_its_solution_has_no_say_in_the_cost() -> None:
    problem = textbook.unstable()
    good = solve(problem, passes=2)
    (path,) = good.phases
    wrong = dataclasses.replace(path, controls=path.controls + 0.5)
    scales = scales_of(problem, [wrong])
    astray = dataclasses.replace(good, resimulation=resimulate(problem, [wrong], NONE, scales))
    assert not astray.converged
    assert astray.cost == good.transcribed_cost


# -- costates and Hamiltonian -------------------------------------------------------------------


SCHEMES = [("trapezoid", 8e-3), ("hermite-simpson", 2e-5), ("radau", 1e-9)]


def regulator(**more: Any) -> Problem:
    """x' = u at least integral of x^2 + u^2: the costate is 2 x tanh(time left)."""
    phase = Phase(
        "regulate",
        states=("x",),
        controls=("u",),
        flow=lambda x, u, p: (u,),
        cost=lambda x, u, p: x**2 + u**2,
        start={"x": 1.0},
        **{"duration": 2.0} | more,
    )
    return Problem((phase,))


def on(scheme: str, problem: Problem, elements: int = 20, degree: int = 4) -> Extremal:
    return solve_once(problem, mesh=Mesh.uniform(problem, elements, degree, scheme))


@pytest.mark.parametrize(("scheme", "error"), SCHEMES)
def test_the_regulators_costate_is_riccatis(scheme: str, error: float) -> None:
    found = on(scheme, regulator())
    t, x = found.phases[0].edges, found.phases[0].state(found.phases[0].edges)[:, 0]
    np.testing.assert_allclose(
        found.certificate.costates[0][:, 0], 2 * x * np.tanh(2.0 - t), atol=error
    )


def test_the_costate_at_the_start_is_the_derivative_of_the_least_cost() -> None:
    def swing(tilt: float) -> Extremal:
        problem = textbook.cart_pole()
        phase = problem.phases[0]
        start = {**phase.start, "q2": tilt}
        moved = Problem((Phase(**{**vars(phase), "start": start}),))
        return solve(moved, base.phases, base.mesh, passes=0, verify=False, mu_init=1e-6)

    base = solved("cart pole")
    slope = (swing(1e-3).cost - swing(-1e-3).cost) / 2e-3
    assert base.certificate.costates[0][0, 1] == pytest.approx(slope, rel=1e-4)


def test_the_multiplier_of_a_fixed_duration_is_the_hamiltonian() -> None:
    """The regulator's least cost over T is tanh T."""
    found = on("radau", regulator())
    hamiltonian = 1 - math.tanh(2.0) ** 2
    assert found.certificate.duration_multipliers == pytest.approx([hamiltonian], rel=1e-8)
    assert found.certificate.hamiltonian[0] == pytest.approx(hamiltonian, abs=1e-8)
    assert found.certificate.transversality_error < 1e-9


@pytest.mark.parametrize("name", ["brachistochrone", "fastest move"])
def test_a_free_duration_has_no_multiplier(name: str) -> None:
    found = solved(name)
    assert found.certificate.duration_multipliers == pytest.approx([0.0], abs=1e-6)
    assert found.certificate.transversality_error < 1e-5


def test_a_cost_of_the_durations_counts_in_their_multiplier() -> None:
    running = solved("brachistochrone")
    free = Phase(**{**vars(running.problem.phases[0]), "cost": None})
    ending = solve_once(Problem((free,), endpoint_cost=lambda s, e, d, p: d[0]))
    assert ending.cost == pytest.approx(running.cost, rel=1e-9)
    assert ending.certificate.duration_multipliers == pytest.approx([-1.0], abs=1e-6)
    assert ending.certificate.transversality_error < 1e-5


def test_bounded_integrals_count_in_the_hamiltonian() -> None:
    found = solved("hanging chain")
    assert found.certificate.hamiltonian_spread < 1e-7
    assert found.certificate.transversality_error < 1e-7


def test_costates_are_passed_on_through_a_linkage_by_its_transposed_jacobian() -> None:
    def kicked(x: Any, p: Any) -> Any:
        return x[0] + 0.1 * x[1], -0.5 * x[1] + ca.sin(x[0])

    def half(name: str, **ends: Any) -> Phase:
        return Phase(
            name,
            states=("x", "v"),
            controls=("u",),
            flow=lambda x, u, p: (x[1], u),
            cost=lambda x, u, p: u**2,
            duration=1.0,
            **ends,
        )

    link = Linkage(0, 1, kicked)
    phases = half("a", start={"x": 0.0, "v": 0.0}), half("b", end={"x": 2.0, "v": 0.0})
    found = solve_once(Problem(phases, (link,)))
    before, after = found.certificate.costates[0][-1], found.certificate.costates[1][0]
    x = found.phases[0].end
    jacobian = np.array([[1.0, 0.1], [math.cos(x[0]), -0.5]])
    assert before == pytest.approx(jacobian.T @ after, rel=1e-7)


def test_the_cost_of_the_residual_is_what_the_discretisation_changes() -> None:
    found = solve_once(passive_wheel(), mesh=Mesh.uniform(1, 4, 4))
    error = found.transcribed_cost - passive_wheel_rate()
    assert abs(error) > 1e-8
    assert found.certificate.defect_costs.sum() == pytest.approx(error, rel=0.05)
