"""The study behind BUILDABLE: its budget, its cases, its files."""

from __future__ import annotations

import json
import math
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from rimless_gym import BUILDABLE
from scripts.studies.codesign import page, problem
from scripts.studies.codesign.budget import BOB_RADIUS, CLEARANCE, TOTAL_MASS, Build
from scripts.studies.codesign.campaign import same_study
from scripts.studies.codesign.gaits import random_step
from scripts.studies.codesign.parts import GPX_22_UP
from scripts.studies.codesign.problem import LIFTED_SHARE, Case, chosen, neighbours
from scripts.studies.codesign.stages import stage
from scripts.studies.codesign.startup import figures
from trajopt.gaits.library import shipped

DOCS = Path(__file__).parents[3] / "docs"
GEAR = min(GPX_22_UP, key=lambda gear: abs(gear.ratio - BUILDABLE.gear_ratio))
BUILD = Build(GEAR, BUILDABLE.n_legs)


def test_the_preset_is_the_machine_of_the_budget_rounded() -> None:
    machine = BUILD.machine(*chosen(BUILDABLE)).to_dict()
    for name, value in BUILDABLE.to_dict().items():
        if isinstance(value, float):
            assert value == pytest.approx(machine[name], rel=0.02), name
        else:
            assert value == machine[name], name


def test_the_preset_is_within_the_total_mass_and_clears_the_floor_in_every_pose() -> None:
    assert BUILDABLE.total_mass == pytest.approx(TOTAL_MASS)
    assert chosen(BUILDABLE)[0] <= BUILD.heaviest_bob
    assert BUILDABLE.pendulum_reach is not None
    lowest = BUILDABLE.leg_length * math.cos(math.pi / BUILDABLE.n_legs)
    assert lowest - BUILDABLE.pendulum_reach >= CLEARANCE


def test_the_motor_can_lift_the_presets_pendulum() -> None:
    assert BUILD.holding_torque(chosen(BUILDABLE)) <= LIFTED_SHARE * BUILD.lifting_torque()


def test_an_arm_that_would_touch_the_floor_is_refused() -> None:
    assert BUILD.machine(1.0, BUILD.longest_arm).pendulum_reach is not None
    with pytest.raises(ValueError, match="shorten the pendulum"):
        BUILD.machine(1.0, BUILD.longest_arm + 0.001)


def test_the_presets_gaits_stay_within_what_motor_and_gearhead_endure() -> None:
    whirling = [g for g in shipped() if g.params == BUILDABLE and g.theta_turns == -g.steps]
    assert len(whirling) > 3
    for gait in whirling:
        made = figures(gait)
        assert made["peak_torque"] < BUILD.gearhead.continuous_torque
        assert made["motor_speed"] < BUILD.motor.top_speed


def test_results_of_a_study_with_other_numbers_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    same_study(tmp_path / "study.json")
    same_study(tmp_path / "study.json")
    monkeypatch.setattr(problem, "NORMAL_FORCE", 0.2)
    with pytest.raises(ValueError, match=r"another problem\.NORMAL_FORCE; give another --out"):
        same_study(tmp_path / "study.json")


def test_the_parts_make_up_the_mass_and_the_pendulum_turns_about_the_hub_as_a_whole() -> None:
    bob, arm = 1.5, 0.2
    machine = BUILD.machine(bob, arm)
    assert machine.total_mass == pytest.approx(TOTAL_MASS)
    payload = machine.wheel_mass - sum(mass for mass, _ in BUILD.wheel_parts().values())
    assert payload > 0
    assert chosen(machine) == pytest.approx((bob, arm))
    assert machine.pendulum_reach == pytest.approx(arm + BOB_RADIUS)
    about_hub = machine.pendulum_inertia + machine.pendulum_mass * machine.pendulum_length**2
    assert about_hub > bob * arm**2


def test_symbols_give_the_same_pendulum_as_numbers() -> None:
    p = ca.SX.sym("p", 2)
    fields = BUILD.pendulum(ca.vertsplit(p))
    values = ca.Function("fields", [p], list(fields.values()))(ca.DM([1.4, 0.18]))
    numbers = BUILD.pendulum((1.4, 0.18)).values()
    np.testing.assert_allclose([float(v) for v in values], list(numbers), rtol=1e-14)


def test_a_bob_too_heavy_for_the_build_is_refused() -> None:
    with pytest.raises(ValueError, match=r"bob = 3\.0"):
        _ = Case(BUILD, bob=3.0).bounds


def test_given_values_are_the_bounds_and_others_are_free() -> None:
    bounds = Case(BUILD, bob=1.5).bounds
    assert bounds["bob"] == pytest.approx((1.5, 1.5), abs=1e-5)
    assert bounds["arm"][1] == BUILD.longest_arm


def test_neighbours_differ_by_the_next_gear_or_number_of_legs() -> None:
    cases = [Case(Build(gear, legs)) for legs in (5, 6, 7) for gear in GPX_22_UP]
    near = neighbours(Case(Build(GPX_22_UP[1], 6)), cases)
    places = {(each.build.n_legs, each.build.gearhead.ratio) for each in near}
    ratios = [gear.ratio for gear in GPX_22_UP]
    assert places == {(6, ratios[0]), (6, ratios[2]), (5, ratios[1]), (7, ratios[1])}


def test_random_steps_make_the_turns_of_their_case() -> None:
    rng = np.random.default_rng(0)
    for turns in (-2, -1, 0, 1):
        (phase,) = random_step(Case(BUILD, turns), rng)
        assert phase.end[1] - phase.start[1] == pytest.approx(2 * np.pi * turns)


def test_a_stage_keeps_what_it_found_and_does_not_do_it_again(tmp_path: Path) -> None:
    tasks = {"three": ([("twice", 6)],), "four": ([("twice", 8)],)}
    first = stage(tmp_path, "doubling", {"three": tasks["three"]}, dict, 1)
    assert first == {"three": {"twice": 6}}
    (tmp_path / "doubling" / "three.json").write_text(json.dumps({"twice": "kept"}))
    again = stage(tmp_path, "doubling", tasks, dict, 1)
    assert again == {"three": {"twice": "kept"}, "four": {"twice": 8}}


def test_the_page_has_a_place_for_every_table_and_the_budget_of_the_preset() -> None:
    text = (DOCS / "machine.md").read_text()
    for marks in page.MARKS.values():
        assert marks.search(text)


def test_a_damaged_result_of_a_stage_is_computed_again(tmp_path: Path) -> None:
    tasks = {"one": ([("twice", 2)],)}
    stage(tmp_path, "numbers", tasks, dict, 1)
    (tmp_path / "numbers" / "one.json").write_text('{"twi')
    assert stage(tmp_path, "numbers", tasks, dict, 1) == {"one": {"twice": 2}}


def test_a_damaged_account_of_a_study_is_named(tmp_path: Path) -> None:
    (tmp_path / "study.json").write_text("")
    with pytest.raises(ValueError, match=r"study\.json: damaged"):
        same_study(tmp_path / "study.json")
