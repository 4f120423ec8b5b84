"""The thesis's experiments: their results, and the published page."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import pytest

from scripts.studies.thesis import experiments
from scripts.studies.thesis.cases import (
    EXPERIMENTS,
    Case,
    Effort,
    Key,
    every_case,
    experiment_1,
    experiment_2,
    experiment_6,
    needed,
)
from scripts.studies.thesis.problems import COST_4_5, TABLE_4_4, steps
from scripts.studies.thesis.solve import SolvedCase, WaypointStarts, solved
from trajopt import Mesh, solve
from trajopt.gaits.verify import simulated
from trajopt.ocp.multi_start import multi_start

DOCS = Path(__file__).parents[3] / "docs"
QUICK = Effort(2, elements=10)


def quick(case: Case, before: SolvedCase | None = None) -> SolvedCase:
    return solved(dataclasses.replace(case, effort=QUICK), before)


@pytest.fixture(scope="module")
def chain() -> tuple[SolvedCase, SolvedCase]:
    """Experiment 1 with cost 4.4, and its continuation in Experiment 6."""
    first = quick(experiment_1()[1])
    return first, quick(experiment_6()[0], first)


def test_experiments_1_and_6_come_out_to_all_printed_digits(
    chain: tuple[SolvedCase, SolvedCase],
) -> None:
    (first,), (second,) = (solution.rows() for solution in chain)
    assert f"{first['cost']:.6f}" == "0.040904"
    assert first["energy_J"] == pytest.approx(0.001559, abs=2e-6)
    assert first["peak_voltage"] < 4e-6
    assert f"{second['cost']:.6f}" == "0.040907"
    assert second["energy_J"] == pytest.approx(0.003125, abs=5e-6)
    assert second["touchdown_time_error"] < 1e-8
    assert first["converged"]
    assert second["converged"]


def test_a_chain_is_simulated_from_its_first_step(chain: tuple[SolvedCase, SolvedCase]) -> None:
    first, second = chain
    assert len(second.motion) == 2
    duration = first.extremal.duration + second.extremal.duration
    assert second.simulated.times[-1] == pytest.approx(duration, abs=1e-6)
    shaft = simulated(second.machine, second.motion, duration).ledger.shaft
    assert second.energy == pytest.approx(shaft, rel=1e-6)


def test_a_passive_step_costs_no_voltage() -> None:
    solution = quick(experiment_1()[0])
    assert solution.extremal.cost < 1e-12
    assert solution.converged


def test_a_case_whose_simulation_is_off_has_not_converged(
    chain: tuple[SolvedCase, SolvedCase],
) -> None:
    off = dataclasses.replace(chain[0].simulated, state_error=1e-5)
    assert not dataclasses.replace(chain[0], simulated=off).converged


def test_cases_have_names_of_their_own_and_follow_what_they_continue() -> None:
    keys = [case.key for case in every_case()]
    assert len(set(keys)) == len(keys)
    assert set(EXPERIMENTS) == {key[0] for key in keys}
    wanted = [case.key for case in needed([6])]
    assert wanted[0] == (1, "cost 4.4")
    for case in needed([6]):
        assert case.after is None or case.after.key in wanted[: wanted.index(case.key)]


def test_the_page_has_the_tables_of_the_published_results() -> None:
    rows = json.loads((DOCS / "figures" / "thesis" / "results.json").read_text())
    page = (DOCS / "thesis.md").read_text()
    for name, table in experiments.sections(rows).items():
        assert f"<!-- thesis: {name} -->\n{table}<!-- end of {name} -->" in page


@pytest.fixture(scope="module")
def everything() -> dict[Key, Any]:
    solutions = experiments.solve_all(list(EXPERIMENTS))
    return {solution.key: solution for solution in solutions}


@pytest.mark.slow
def test_every_case_converges_from_more_than_one_start(everything: dict[Key, Any]) -> None:
    assert set(everything) == {case.key for case in every_case()}
    for key, solution in everything.items():
        assert solution.converged, key
        assert solution.reaching > 1, key


@pytest.mark.slow
def test_printed_costs_are_beaten_wherever_they_are_wrong(everything: dict[Key, Any]) -> None:
    for (experiment, _), solution in everything.items():
        for row in solution.rows():
            if row["thesis_cost"] is not None and experiment in (3, 4, 5):
                assert row["cost"] < row["thesis_cost"] / 100


@pytest.mark.slow
def test_a_chain_aimed_at_an_optimum_costs_as_much(everything: dict[Key, Any]) -> None:
    both = everything[5, "plastic, phi'(0) <= 10"].extremal.cost
    parts = [everything[6, f"plastic, step {i}"].extremal.cost for i in (1, 2)]
    assert sum(parts) == pytest.approx(both, rel=1e-6)


@pytest.mark.slow
def test_the_mass_goes_to_its_bound(everything: dict[Key, Any]) -> None:
    for key, solution in everything.items():
        names = list(solution.extremal.problem.parameters)
        if key[0] == 3 and names == ["m2"]:
            low = solution.extremal.problem.parameters["m2"][0]
            assert solution.extremal.parameters[0] == pytest.approx(low, abs=1e-5)


@pytest.mark.slow
def test_the_foot_is_pulled_unless_it_must_press(everything: dict[Key, Any]) -> None:
    assert everything[2, "least pull of the foot"].extremal.parameters[0] > 3
    assert everything[2, "least |theta'| at the end"].extremal.cost > (4 * math.pi) ** 2
    (collisionless,) = everything[2, "|theta'| <= 8 pi at the end"].rows()
    assert collisionless["min_normal_force_over_weight"] < -3
    for key, solution in everything.items():
        if "not held down" in key[1]:
            assert solution.rows()[0]["min_normal_force_over_weight"] > -1e-6


@pytest.mark.slow
def test_the_printed_bound_admits_no_collisionless_step() -> None:
    problem = steps(experiment_2()[0].params, TABLE_4_4, COST_4_5)
    starts = WaypointStarts(problem, durations=(0.15, 1.5))
    assert not multi_start(problem, starts, 10, mesh=Mesh.uniform(problem, 10)).optima


@pytest.mark.slow
def test_a_coarse_mesh_gives_what_experiment_2_printed(everything: dict[Key, Any]) -> None:
    fine = everything[2, "|theta'| <= 8 pi at the end"].extremal
    coarse = solve(
        fine.problem, fine.phases, Mesh.uniform(fine.problem, 2, 3), passes=0, mu_init=1e-3
    )
    assert coarse.cost == pytest.approx(1.246894, abs=3e-3)
    assert fine.cost == pytest.approx(1.267271, abs=1e-6)
