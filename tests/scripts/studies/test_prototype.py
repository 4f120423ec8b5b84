"""The study of the machine as built: its machines, its files, its published results."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from rimless_gym import PROTOTYPE, THESIS_PHYSICAL
from scripts.studies.thesis import prototype
from scripts.studies.thesis.prototype import (
    MOST_TURNS,
    SCALES,
    VARIANTS,
    Point,
    cheapest,
    followed,
    searched,
    shared,
    whirling,
)
from trajopt.gaits.library import shipped
from trajopt.gaits.problem import MIN_NORMAL_FORCE
from trajopt.gaits.solution import Solution
from trajopt.gaits.verify import simulated, verify

DOCS = Path(__file__).parents[3] / "docs"
STOCK, STRONG, GEARED = VARIANTS


def slow_whirl() -> Solution:
    of = [g for g in shipped() if g.params == THESIS_PHYSICAL]
    return next(g for g in of if g.steps == 1 and abs(g.speed - 0.5) < 1e-6)


def test_the_scales_run_from_the_machine_simulated_to_the_machine_built() -> None:
    assert SCALES[0] == 4.0
    assert SCALES[-1] == 1.0
    assert STOCK.machine(1.0, 1.0) == PROTOTYPE
    simulated, table = STOCK.machine(4.0, 1.0).to_dict(), THESIS_PHYSICAL.to_dict()
    assert simulated.pop("pendulum_inertia") == pytest.approx(table.pop("pendulum_inertia"))
    assert simulated == table
    assert STOCK.scale_and_gear(slow_whirl()) == (4.0, 1.0)


def test_more_voltage_or_another_gear_admits_the_stock_supplys_gaits_not_the_reverse() -> None:
    assert STRONG.admits(STOCK)
    assert GEARED.admits(STOCK)
    assert not STOCK.admits(STRONG)
    assert not STOCK.admits(GEARED)
    assert not GEARED.admits(STRONG)


def test_random_starts_make_the_turns_that_they_are_labelled_with() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        (phase,), turns = whirling(STOCK.params, rng)
        gained = phase.end[1] - phase.start[1]
        assert gained == pytest.approx(2 * np.pi * turns)
        assert abs(turns) <= MOST_TURNS


def test_a_gait_can_be_continued_to_a_smaller_pendulum() -> None:
    curve = followed(STOCK, slow_whirl(), 3.9)
    assert curve.reached
    assert curve.values[0] == 4.0
    assert curve.solutions[0].transcribed_cost <= slow_whirl().cot * 1.01  # at a speed of its own
    problem = curve.solutions[-1].problem
    assert dict(problem.parameters) == {"scale": 3.9, "gear": 1.0}


def test_scales_are_searched_from_large_to_small_each_from_gaits_of_those_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stored = {
        "scale 4.000": {variant.file_name: slow_whirl() for variant in VARIANTS},
        "scale 2.000": {variant.file_name: "nothing leads there" for variant in VARIANTS},
    }
    monkeypatch.setattr(prototype, "SCALES", (4.0, 2.0))
    given = {}

    def stage(name: str, tasks: dict, work: object) -> dict:
        given[name] = tasks
        return stored[name]

    points = searched(stage)
    assert [(p.variant, p.scale) for p in points] == [(v, s) for v in VARIANTS for s in (4.0, 2.0)]
    assert [p.gait is None for p in points] == [False, True] * len(VARIANTS)
    assert {p.reason for p in points} == {"", "nothing leads there"}
    _, _, known = given["scale 2.000"][STOCK.file_name]
    assert known[0].to_dict() == slow_whirl().to_dict()  # that of the scale before


def test_a_supply_without_a_gait_takes_that_of_a_weaker_supply() -> None:
    points = [Point(v, 4.0, slow_whirl() if v == STOCK else None, "none") for v in VARIANTS]
    stock, strong, geared = shared(points)
    assert stock.gait is not None
    assert strong.gait is not None
    assert geared.gait is not None
    assert stock.gait.cot == strong.gait.cot == geared.gait.cot
    assert strong.gait.params.voltage_limit == STRONG.voltage
    assert shared([Point(STOCK, 1.0, None, "none")])[0].gait is None


@pytest.fixture(scope="module")
def published() -> dict:
    return json.loads((DOCS / "figures" / "prototype" / "results.json").read_text())


def test_the_page_has_the_published_table(published: dict) -> None:
    assert prototype.table(published) in (DOCS / "thesis.md").read_text()


def test_every_published_gait_is_verified_within_all_limits(published: dict) -> None:
    walking = [row for row in published["gaits"] if row["cot"] is not None]
    assert len(walking) > len(SCALES)
    limits = {variant.name: variant.voltage for variant in VARIANTS}
    for row in walking:
        assert row["state_error"] <= 1e-6
        assert row["min_normal_force_over_weight"] >= 0.999 * MIN_NORMAL_FORCE
        assert row["max_friction_demand"] <= 1.001
        assert row["peak_voltage"] <= limits[row["variant"]] * (1 + 1e-9)


def test_a_supply_that_admits_more_costs_no_more(published: dict) -> None:
    cost = {(row["variant"], row["scale"]): row["cot"] for row in published["gaits"]}
    for scale in SCALES:
        stock = cost[STOCK.name, scale]
        for richer in (STRONG, GEARED):
            if stock is not None:
                assert cost[richer.name, scale] <= 1.002 * stock


@pytest.mark.slow
def test_the_machine_as_built_walks_with_another_gear(published: dict) -> None:
    """Its gait is played back by the reference simulator, which knows nothing of the study."""
    gait = Solution.load(DOCS / "figures" / "prototype" / "as_built_20_V_gear_ratio_free.npz")
    expected = GEARED.machine(1.0, gait.params.gear_ratio / PROTOTYPE.gear_ratio)
    assert gait.params == expected
    assert verify(gait.params, gait.phases, gait.theta_turns).passed
    run = simulated(gait.params, gait.phases, gait.duration + 1e-6)
    assert run.steps == 1
    assert run.min_normal_force > 0.0
    assert run.friction_demand <= 1.001
    row = next(
        r for r in published["gaits"] if (r["variant"], r["scale"]) == (GEARED.name, SCALES[-1])
    )
    assert run.ledger.cost_of_transport(gait.params) == pytest.approx(row["cot"], rel=1e-3)


@pytest.mark.slow
def test_the_search_finds_a_walk_of_the_machine_as_built_with_another_gear() -> None:
    gait = cheapest(GEARED, 1.0)
    assert isinstance(gait, Solution), gait
    assert gait.verification.passed
