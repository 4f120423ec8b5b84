import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from rimless_gym.checks import MissingExtraError
from scripts.studies.thesis.experiments import document, report
from scripts.studies.thesis.experiments.cases import (
    EXPERIMENTS,
    every_case,
    experiment_1,
    experiment_2,
    experiment_6,
)
from scripts.studies.thesis.experiments.power import powers
from scripts.studies.thesis.experiments.run import run
from scripts.studies.thesis.experiments.solve import solved
from scripts.studies.thesis.experiments.starts import WaypointStarts
from scripts.studies.thesis.experiments.steps import steps
from scripts.studies.thesis.experiments.tables import COST_4_5, TABLE_4_4
from tests.agents.reports.checks import assert_loads_nothing, assert_valid
from trajopt import Mesh, solve
from trajopt.gaits.verify import simulated
from trajopt.ocp.multi_start import multi_start

KEYS = {
    "experiment": int,
    "variant": str,
    "thesis_cost": float,
    "cost": float,
    "thesis_energy_J": float,
    "energy_J": float,
    "final_time": float,
    "max_state_error": float,
    "touchdown_time_error": float,
    "min_normal_force_over_weight": float,
    "peak_voltage": float,
    "converged": bool,
    "starts": int,
    "starts_reaching_best": int,
}
DOCS = Path(__file__).parents[3] / "docs"


@pytest.fixture(scope="module")
def elastic_chain():
    """Experiment 1 with cost 4.4, and its continuation in Experiment 6."""
    first = solved(experiment_1()[1])
    return first, solved(experiment_6()[0], first)


def test_experiment_1_comes_out_to_all_printed_digits(elastic_chain):
    (row,) = elastic_chain[0].rows()
    assert f"{row['cost']:.6f}" == "0.040904"
    assert row["energy_J"] == pytest.approx(0.001559, abs=2e-6)
    assert row["peak_voltage"] < 4e-6
    assert row["converged"]
    assert row["starts_reaching_best"] == row["starts"]


def test_the_elastic_chain_comes_out_to_all_printed_digits(elastic_chain):
    (row,) = elastic_chain[1].rows()
    assert f"{row['cost']:.6f}" == "0.040907"
    assert row["energy_J"] == pytest.approx(0.003125, abs=5e-6)
    assert row["converged"]
    assert row["touchdown_time_error"] < 1e-8
    assert max(row["thesis_style_touchdown_time_errors"]) < 1e-8


def test_the_chain_is_simulated_from_its_first_step(elastic_chain):
    first, second = elastic_chain
    assert len(second.motion) == 2
    assert len(second.simulated.touchdown_time_errors) == 2
    assert second.simulated.times[-1] == pytest.approx(
        first.extremal.duration + second.extremal.duration, abs=1e-6
    )


def test_results_have_every_key_with_a_value_of_its_type(elastic_chain):
    for solution in elastic_chain:
        for row in solution.rows():
            for key, kind in KEYS.items():
                assert isinstance(row[key], kind), key
            json.dumps(row, allow_nan=False)


def test_the_report_is_self_contained(elastic_chain, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "write_page", lambda path: path)
    report.write(elastic_chain, tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert page.count('<figure class="card chart">') == 12
    assert_valid(page)
    assert_loads_nothing(page)
    assert 'href="page.html"' in page
    assert len(json.loads((tmp_path / "results.json").read_text())) == 2


def test_a_report_without_the_learners_has_no_link(elastic_chain, tmp_path, monkeypatch):
    def missing(path):
        raise MissingExtraError("torch is not installed")

    monkeypatch.setattr(report, "write_page", missing)
    report.write(elastic_chain, tmp_path)
    assert "page.html" not in (tmp_path / "report.html").read_text()


def test_a_passive_step_costs_no_voltage():
    solution = solved(experiment_1()[0])
    assert solution.extremal.cost < 1e-12
    assert solution.converged


def test_every_case_has_a_name_of_its_own():
    keys = [case.key for case in every_case()]
    assert len(set(keys)) == len(keys)
    assert set(EXPERIMENTS) == {key[0] for key in keys}


def test_the_page_shows_the_results_beside_it():
    rows = json.loads((DOCS / "figures" / "thesis" / "results.json").read_text())
    page = (DOCS / "thesis.md").read_text()
    assert document.filled(page, rows) == page


@pytest.fixture(scope="module")
def everything():
    return {solution.key: solution for solution in run(list(EXPERIMENTS), workers=2)}


@pytest.mark.slow
def test_every_case_converges_from_more_than_one_start(everything):
    assert set(everything) == {case.key for case in every_case()}
    for key, solution in everything.items():
        assert solution.converged, key
        assert solution.extremal.mesh_error <= 1e-7, key
        assert solution.reaching > 1, key
        for row in solution.rows():
            if not solution.case.limit:
                assert row["max_state_error"] <= 1e-6, key
                assert row["touchdown_time_error"] <= 1e-8, key


@pytest.mark.slow
def test_printed_costs_are_beaten_wherever_they_are_wrong(everything):
    for (experiment, _), solution in everything.items():
        for row in solution.rows():
            if row["thesis_cost"] is not None and experiment in (3, 4, 5):
                assert row["cost"] < row["thesis_cost"] / 100


@pytest.mark.slow
def test_a_chain_aimed_at_an_optimum_costs_as_much(everything):
    both = everything[5, "plastic, phi'(0) <= 10"].extremal.cost
    chain = [everything[6, f"plastic, step {i}"].extremal.cost for i in (1, 2)]
    assert sum(chain) == pytest.approx(both, rel=1e-6)


@pytest.mark.slow
def test_the_mass_goes_to_its_bound_unless_the_cost_is_that_of_transport(everything):
    for key, solution in everything.items():
        names = list(solution.extremal.problem.parameters)
        if key[0] == 3 and names == ["m2"] and "periodic" not in key[1]:
            low = solution.extremal.problem.parameters["m2"][0]
            assert solution.extremal.parameters[0] == pytest.approx(low, abs=1e-5)
    cheap = everything[3, "periodic, plastic, least E+, m2 free"].extremal
    assert 2.5 < cheap.parameters[0] < 3.2


@pytest.mark.slow
def test_a_collisionless_step_needs_a_floor_that_pulls(everything):
    assert everything[2, "least pull of the foot"].extremal.parameters[0] > 3
    for key, solution in everything.items():
        if "not held down" in key[1]:
            assert solution.rows()[0]["min_normal_force_over_weight"] > -1e-6


@pytest.mark.slow
def test_the_printed_bound_admits_no_collisionless_step(everything):
    slowest = everything[2, "least |theta'| at the end"].extremal
    assert math.sqrt(slowest.cost) > 4 * math.pi
    problem = steps(experiment_2()[0].params, TABLE_4_4, COST_4_5)
    starts = WaypointStarts(problem, durations=(0.15, 1.5))
    assert not multi_start(problem, starts, 10, mesh=Mesh.uniform(problem, 10)).optima


@pytest.mark.slow
def test_a_coarse_mesh_gives_what_experiment_2_printed(everything):
    fine = everything[2, "|theta'| <= 8 pi at the end"].extremal
    mesh = Mesh.uniform(fine.problem, 2, 3)
    coarse = solve(fine.problem, fine.phases, mesh, passes=0, mu_init=1e-3)
    assert coarse.cost == pytest.approx(1.246894, abs=3e-3)
    assert coarse.phases[0].start[3] / math.pi == pytest.approx(-7.14, abs=0.03)
    assert fine.cost == pytest.approx(1.267271, abs=1e-6)


def test_guesses_have_durations_in_the_given_range():
    problem = experiment_1()[1].problem(None)
    family = WaypointStarts(problem, durations=(0.3, 0.5))
    for index in range(5):
        (guess,) = family(np.random.default_rng(index), index)
        assert 0.3 <= guess.duration <= 0.5


def test_a_case_that_does_not_converge_says_so(elastic_chain):
    solution = elastic_chain[0]
    off = dataclasses.replace(solution.simulated, state_error=1e-5)
    assert not dataclasses.replace(solution, simulated=off).converged


def test_the_energy_is_the_shaft_work_of_the_reference_simulation(elastic_chain):
    solution = elastic_chain[1]
    duration = sum(phase.duration for phase in solution.motion)
    shaft = simulated(solution.machine, solution.motion, duration).ledger.shaft
    assert solution.energy == pytest.approx(shaft, rel=1e-6)
    drawn = [powers(solution.machine, phase) for phase in solution.motion]
    assert sum(np.trapezoid(d.total, d.times) for d in drawn) == pytest.approx(shaft, rel=1e-2)
