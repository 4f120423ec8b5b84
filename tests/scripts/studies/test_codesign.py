"""The study behind BUILDABLE: its budget, its cases, its files."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from rimless_gym import BUILDABLE
from scripts.studies.codesign.command import MARKS, tables
from scripts.studies.codesign.gaits import (
    LIFTED_SHARE,
    figures,
    neighbours,
    random_step,
)
from scripts.studies.codesign.machine import (
    BOB_RADIUS,
    CLEARANCE,
    GPX_22_UP,
    TOP_SPEED,
    TOTAL_MASS,
    Build,
    chosen,
    preset_build,
)
from scripts.studies.stages import stage
from trajopt.gaits.library import shipped
from trajopt.store import Store

DOCS = Path(__file__).parents[3] / "docs"
BUILD = preset_build()


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
    with pytest.raises(ValueError, match="shorten the arm"):
        BUILD.machine(1.0, BUILD.longest_arm + 0.001)


@pytest.mark.slow
def test_the_presets_gaits_stay_within_what_motor_and_gearhead_endure() -> None:
    whirling = [g for g in shipped(BUILDABLE)[::3] if g.theta_turns == -g.steps]
    assert len(whirling) > 3
    for gait in whirling:
        made = figures(gait)
        assert made["peak_torque"] < BUILD.gearhead.continuous_torque
        assert made["motor_speed"] < TOP_SPEED


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


def test_neighbours_differ_by_the_next_gear_or_number_of_legs() -> None:
    cases = [Build(gear, legs) for legs in (5, 6, 7) for gear in GPX_22_UP]
    near = neighbours(Build(GPX_22_UP[1], 6), cases)
    places = {(each.n_legs, each.gearhead.ratio) for each in near}
    ratios = [gear.ratio for gear in GPX_22_UP]
    assert places == {(6, ratios[0]), (6, ratios[2]), (5, ratios[1]), (7, ratios[1])}


def test_random_steps_make_one_turn_backwards() -> None:
    rng = np.random.default_rng(0)
    for _ in range(4):
        (phase,) = random_step(BUILD, rng)
        assert phase.end[1] - phase.start[1] == pytest.approx(-2 * np.pi)


def doubled(number: float) -> dict[str, float]:
    return {"twice": 2 * number}


def test_a_stage_computes_only_what_is_missing_or_damaged(tmp_path: Path) -> None:
    run, gait = partial(stage, Store(tmp_path), workers=1), shipped(BUILDABLE)[0]
    assert run("doubling", {"three": (3,)}, doubled) == {"three": {"twice": 6}}
    assert run("gaits", {"one": (gait,)}, lambda g: g)["one"].to_dict() == gait.to_dict()
    both = {"three": (3,), "four": (4,)}
    results = run("doubling", both, lambda number: {"computed": number})
    assert results == {"three": {"twice": 6}, "four": {"computed": 4}}
    (tmp_path / "doubling" / "three.json").write_text('{"twi')
    results = run("doubling", both, lambda number: {"again": number})
    assert results == {"three": {"again": 3}, "four": {"computed": 4}}


def test_the_page_has_a_place_for_every_table_and_the_budget_of_the_preset() -> None:
    row = figures(shipped(BUILDABLE)[0]) | {"joined": 1.0, "walking": 1.0, "cot_of_walks": 0.1}
    results = {"finals": {"": row}, "preset": {"": row}}
    made, text = tables(results), (DOCS / "machine.md").read_text()
    assert made.keys() == MARKS.keys()
    for name, around in MARKS.items():
        assert around.search(text), name
    assert made["budget"] in text
