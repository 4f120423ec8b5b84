"""The search for a periodic gait: targets, warm starts, random starts, arguments."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from rimless_gym import BUILDABLE, THESIS_PHYSICAL
from tests.trajopt.ocp.problems import unit_scales
from trajopt import NoGaitError, periodic_gait
from trajopt.gaits import verify as verifying
from trajopt.gaits.bounds import cot_bound
from trajopt.gaits.library import index, nearest
from trajopt.gaits.search import random_motion, same_gait, search_gaits
from trajopt.ocp.multi_start import Outcome, distinct


def test_the_two_step_gait_beats_its_target_and_its_audit_closes(gait):
    assert gait.verification.passed
    assert gait.cot <= 0.105
    assert gait.speed == pytest.approx(0.5, abs=1e-12)
    assert gait.verification.energy_audit < 1e-6
    assert gait.cost == gait.verification.electrical_positive
    assert gait.cot_with_regeneration <= gait.cot


@pytest.mark.slow
def test_the_swinging_family_beats_the_target_without_whirling_the_pendulum():
    entry = next(e for e in nearest(THESIS_PHYSICAL, 0.5, 2) if e.theta_turns == 0)
    solved = periodic_gait(THESIS_PHYSICAL, 0.5, 2, guess=entry.load())
    assert solved.verification.passed
    assert solved.theta_turns == 0
    assert solved.cot <= 0.105


@pytest.mark.slow
def test_a_gait_is_continued_to_a_far_speed_in_several_steps(one_step):
    slower = periodic_gait(THESIS_PHYSICAL, 0.43, 1, guess=one_step)
    assert slower.verification.passed
    assert slower.theta_turns == one_step.theta_turns
    assert slower.speed == pytest.approx(0.43, abs=1e-12)
    assert slower.cot > one_step.cot


@pytest.mark.slow
def test_continuing_a_gait_too_far_reports_the_speed_that_was_reached(one_step):
    with pytest.raises(NoGaitError, match=r"; 0\.60\d m/s was reached"):
        periodic_gait(THESIS_PHYSICAL, 0.63, 1, guess=one_step)


@pytest.mark.slow
def test_the_error_for_a_speed_beyond_reach_names_the_limits_that_bind():
    fast = nearest(THESIS_PHYSICAL, 1.0, 1)[0].load()
    with pytest.raises(NoGaitError, match=r"1\.5 m/s(.|\n)*violated(.|\n)*reached"):
        periodic_gait(THESIS_PHYSICAL, 1.5, 1, guess=fast)


def test_shipped_gaits_lead_a_wheel_with_more_legs_to_its_family_of_low_cost():
    search = search_gaits(BUILDABLE.replace(n_legs=8), 0.5, 1, starts=0, shipped=1)
    assert search.optima[0].best.kind == "-1"
    assert re.search(r"CoT 0\.052\d+ +from \d+ start", search.report())


@pytest.mark.slow
def test_the_report_of_a_wheel_that_is_not_shipped_counts_the_starts_that_met_its_gait():
    gait = periodic_gait({"n_legs": 8}, 0.5, starts=0)
    assert gait.verification.passed
    assert (gait.theta_turns, gait.cot < 0.053) == (-1, True)
    assert re.search(r"search +\d+ of \d+ starts met this gait", gait.report())


def test_a_guess_is_verified_before_it_is_believed(one_step):
    swinging = next(e for e in nearest(THESIS_PHYSICAL, 0.5, 1) if e.theta_turns == 0).load()
    posing = dataclasses.replace(swinging, verification=one_step.verification)
    assert posing.verification.passed
    solved = periodic_gait(THESIS_PHYSICAL, posing.speed, 1, guess=posing)
    assert solved.cot == pytest.approx(swinging.cot, rel=1e-3)
    assert solved.cot > 1.1 * one_step.cot


@pytest.mark.slow
def test_a_gait_from_which_its_simulation_strays_is_solved_on_a_finer_mesh(monkeypatch):
    heavier = {"pendulum_mass": 1.9, "pendulum_inertia": BUILDABLE.pendulum_inertia}
    usual = periodic_gait(heavier, 0.55, starts=0)
    monkeypatch.setattr(verifying, "STATE_TOLERANCE", 0.5 * usual.verification.state_error)
    finer = periodic_gait(heavier, 0.55, starts=0)
    assert finer.verification.passed
    assert finer.optimality.mesh_error < usual.optimality.mesh_error
    assert finer.cot == pytest.approx(usual.cot, rel=1e-5)


def test_regeneration_never_costs_more(one_step):
    solved = periodic_gait(THESIS_PHYSICAL, 0.5, 1, regeneration=True, guess=one_step)
    assert solved.verification.passed
    assert solved.cot_with_regeneration <= one_step.cot_with_regeneration + 1e-6


@pytest.mark.slow
def test_at_a_shipped_speed_the_gait_is_verified_and_costs_no_more_than_the_shipped_one():
    slowest = min((e for e in index() if e.steps == 1), key=lambda e: e.speed)
    again = periodic_gait(slowest.params, slowest.speed, 1)
    assert again.verification.passed
    assert again.cot <= (1 + 1e-3) * slowest.cot


@pytest.mark.slow
def test_where_no_gait_is_found_the_error_says_what_binds_and_what_to_try():
    weak = {"voltage_limit": 2.0}
    with pytest.raises(NoGaitError) as error:
        periodic_gait(weak, 0.9, starts=5)
    what, binds, remedy = str(error.value).splitlines()
    assert what.startswith("no gait of 1 step(s) per stride was found at 0.9 m/s")
    assert binds.startswith("what binds: ")
    assert remedy.startswith("what to try: ")


# -- random starts --------------------------------------------------------------------------------


def test_random_motions_depend_on_nothing_but_the_seed():
    first, second = (
        random_motion(THESIS_PHYSICAL, 2, 1.7, -1, np.random.default_rng([3, 4])) for _ in range(2)
    )
    for mine, theirs in zip(first, second, strict=True):
        assert np.array_equal(mine.states, theirs.states)


@pytest.mark.slow
def test_random_starts_are_the_same_in_other_processes():
    alone, shared = (
        search_gaits(THESIS_PHYSICAL, 0.5, 1, True, starts=2, shipped=0, workers=workers)
        for workers in (1, 2)
    )
    assert [o.cost for o in alone.outcomes] == [o.cost for o in shared.outcomes]
    assert [o.index for o in shared.outcomes] == [0, 1]


@pytest.mark.slow
def test_random_starts_have_turns_that_can_beat_the_best_known_gait_and_half_have_its_own():
    search = search_gaits(BUILDABLE, 0.5, 1, starts=8, shipped=1)
    known = [o for o in search.outcomes if search.family.starts[o.index][1] is not None]
    least = min(o.cost for o in known if not o.failure) / search.unit[1]
    random = [int(o.kind) for o in search.outcomes[len(known) :]]
    assert 2 * random.count(-1) >= len(random)  # the best known gait turns once backwards
    for turns in set(random):
        assert cot_bound(BUILDABLE, speed=0.5, steps=1, theta_turns=turns) < least


def test_the_same_optimum_found_twice_is_listed_once_with_both_starts(gait):
    shifted = gait.phases[1:] + gait.phases[:1]
    starts = [(gait.phases, 1.0), (shifted, 1.0), (gait.phases, 2.0)]
    outcomes = [
        Outcome(i, "0", times * gait.cost, phases, np.empty(0), 1, "", unit_scales(4))
        for i, (phases, times) in enumerate(starts)
    ]
    assert [o.starts for o in distinct(outcomes, same_gait)] == [(0, 1), (2,)]


# -- arguments ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"speed": -1.0}, ValueError, "speed = -1.0: must be greater than 0"),
        ({"speed": 23}, NoGaitError, r"speed = 23\.0: must be at most 21.05 m/s.*60 rad/s"),
        (
            {"params": BUILDABLE.replace(pendulum_length=0.01), "speed": 3},
            NoGaitError,
            r"speed = 3\.0: must be at most 2\.\d+ m/s, above which this machine's feet lift off",
        ),
        (
            {"params": {"slope": -0.1, "voltage_limit": 2}},
            NoGaitError,
            "voltage_limit = 2: the motor is .* W short of what friction, damping, drag and slope",
        ),
        (
            {"params": {"slope": 0.7, "friction": 0.5}},
            NoGaitError,
            r"friction = 0\.5: must be at least 0\.842, the tangent of the slope",
        ),
        ({"steps": 1.5}, TypeError, r"steps = 1\.5: must be an integer of at least 1"),
        ({"steps": 10**9}, NoGaitError, "steps = 1000000000: must be at most 25.*shorter stride"),
        ({"guess": "x"}, TypeError, "guess = 'x'.*Solution"),
        ({"workers": 0}, ValueError, "workers = 0"),
        ({"regeneration": "yes"}, TypeError, "regeneration = 'yes': must be True or False"),
        ({"hold": 0.0}, ValueError, "hold = 0"),
    ],
)
def test_invalid_arguments_are_refused_by_name(arguments, error, message):
    with pytest.raises(error, match=message):
        periodic_gait(**({"params": THESIS_PHYSICAL} | arguments))
