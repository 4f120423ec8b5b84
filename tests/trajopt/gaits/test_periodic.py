from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL, simulate
from rimless_gym.symbolic import HybridModel
from trajopt import CotFront, NoGaitError, Solution, cot_front, periodic_gait
from trajopt.gaits import fronts
from trajopt.gaits import verify as verifying
from trajopt.gaits.library import nearest, ranked, repeated, shipped
from trajopt.gaits.search import GaitFamily, random_guess, same_gait, search_gaits
from trajopt.gaits.solution import LocalOptimum
from trajopt.gaits.stability import monodromy
from trajopt.gaits.verify import playback, verify
from trajopt.ocp.search.optima import Outcome, distinct

MODEL = HybridModel(THESIS_PHYSICAL)


def columns(function, *arguments):
    return np.asarray(function.map(arguments[0].shape[1])(*arguments))


def test_the_two_step_gait_beats_its_target(gait):
    assert gait.verification.passed
    assert gait.cot <= 0.105
    assert gait.speed == pytest.approx(0.5, abs=1e-12)


def test_the_swinging_family_beats_the_target_without_whirling_the_pendulum():
    swinging = next(s for s in nearest(THESIS_PHYSICAL, 0.5, 2) if s.theta_turns == 0)
    solved = periodic_gait(THESIS_PHYSICAL, 0.5, 2, guess=swinging)
    assert solved.verification.passed
    assert solved.theta_turns == 0
    assert solved.cot <= 0.105


def test_an_independent_simulation_follows_the_gait_over_the_whole_stride(gait):
    breakpoints, volts = playback(gait.phases)
    run = simulate(
        gait.params,
        gait.state(0.0),
        volts,
        gait.duration,
        breakpoints=breakpoints,
        rtol=1e-9,  # far below what is asked for; finer, it takes much longer
        atol=1e-10,
    )
    t = np.linspace(0, gait.duration, 301)[1:-1]
    t = t[np.abs(t[:, None] - gait.phase_times).min(axis=1) > 1e-6]
    assert np.abs(run.state(t) - gait.state(t)).max() < 1e-6
    np.testing.assert_allclose([volts(time, None) for time in t], gait.control(t), atol=1e-9)


def test_the_energy_audit_closes(gait):
    assert gait.verification.energy_audit < 1e-6
    assert gait.cost == gait.verification.electrical_positive
    assert gait.cot_with_regeneration <= gait.cot


def test_touchdowns_link_the_phases_and_the_last_one_closes_the_ring(gait):
    for time in gait.phase_times[1:]:
        before, after = gait.state(time, side="left"), gait.state(time)
        assert before[0] == pytest.approx(gait.params.constants.b, abs=1e-9)
        assert np.allclose(np.asarray(MODEL.touchdown(before)).ravel(), after, atol=1e-9)
        assert before[2] > 0
        assert after[2] > 0


def test_limits_hold_between_the_nodes(gait):
    t = np.linspace(0, gait.duration, 20_000, endpoint=False)
    x, u = gait.state(t).T, gait.control(t)
    fx, fy = columns(MODEL.functions["ground_reaction"], x, u[None])
    p = gait.params
    assert x[0].min() >= p.constants.a - 1e-7
    assert x[0].max() <= p.constants.b + 1e-7
    assert np.abs(u).max() <= p.voltage_limit * (1 + 1e-9)
    assert fy.min() >= 0.05 * p.weight * (1 - 1e-3)
    assert (np.abs(fx) / fy).max() <= p.friction * (1 + 1e-3)


def test_the_state_is_periodic_but_for_the_turns_of_theta(gait):
    t = np.array([0.1, 0.7, 1.3])
    shift = np.array([0, 2 * math.pi * gait.theta_turns, 0, 0])
    assert np.allclose(gait.state(t + gait.duration), gait.state(t) + shift)
    assert np.allclose(gait.state(t - 2 * gait.duration), gait.state(t) - 2 * shift)
    assert np.allclose(gait.control(t + gait.duration), gait.control(t))
    assert gait.state(0.3).shape == (4,)
    assert isinstance(gait.control(0.3), float)


def test_a_saved_gait_loads_exactly(gait, tmp_path):
    path = tmp_path / "gait.npz"
    gait.save(path)
    loaded = Solution.load(path)
    t = np.linspace(-1, 3, 100)
    assert np.array_equal(loaded.state(t), gait.state(t))
    assert np.array_equal(loaded.control(t), gait.control(t))
    assert loaded.params == gait.params
    assert loaded.verification.failures == ()
    assert loaded.cot == gait.cot
    assert loaded.provenance == gait.provenance
    assert loaded.report() == gait.report()


def test_foreign_and_missing_files_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        Solution.load(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("not a file of format 'rimless-gym gait")
    with pytest.raises(ValueError, match="not a file of format 'rimless-gym gait"):
        Solution.load(tmp_path / "text.npz")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with pytest.raises(ValueError, match="not a file of format 'rimless-gym gait"):
        Solution.load(tmp_path / "other.npz")


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan, math.inf])
def test_impossible_speeds_are_refused_by_name(speed):
    with pytest.raises(ValueError, match=r"speed = .*: must be (finite|greater than 0)"):
        periodic_gait(THESIS_PHYSICAL, speed)


@pytest.mark.slow
def test_a_gait_is_led_to_a_far_speed_in_several_steps(one_step):
    slower = periodic_gait(THESIS_PHYSICAL, 0.43, 1, guess=one_step)
    assert slower.verification.passed
    assert slower.theta_turns == one_step.theta_turns
    assert slower.speed == pytest.approx(0.43, abs=1e-12)
    assert slower.cot > one_step.cot


@pytest.mark.slow
def test_leading_a_gait_too_far_reports_the_speed_that_was_reached(one_step):
    with pytest.raises(NoGaitError, match=r"; 0\.60\d m/s was reached"):
        periodic_gait(THESIS_PHYSICAL, 0.63, 1, guess=one_step)


def test_the_error_for_a_speed_beyond_reach_names_the_limits_that_bind():
    with pytest.raises(NoGaitError, match=r"1\.5 m/s(.|\n)*violated(.|\n)*reached"):
        periodic_gait(THESIS_PHYSICAL, 1.5, 1, guess=nearest(THESIS_PHYSICAL, 1.0, 1)[0])


def test_the_report_says_that_a_clearly_cheaper_optimum_was_met(one_step):
    for cot, told in ((0.5 * one_step.cot, True), (0.97 * one_step.cot, False)):
        met = dataclasses.replace(one_step, optima=(LocalOptimum(cot, -1, 1),))
        assert ("A CHEAPER ONE WAS MET" in met.report()) is told


def test_a_wheel_with_more_legs_is_led_from_the_shipped_gait_to_its_cheap_family():
    gait = periodic_gait({"n_legs": 8}, 0.5, starts=0)
    assert gait.verification.passed
    assert (gait.theta_turns, gait.cot < 0.053) == (-1, True)


@pytest.mark.slow
def test_a_gait_from_which_its_simulation_strays_is_solved_on_a_finer_mesh(monkeypatch):
    own = {"pendulum_mass": 1.9}
    usual = periodic_gait(own, 0.55, starts=0)
    monkeypatch.setattr(verifying, "STATE_TOLERANCE", 0.5 * usual.verification.state_error)
    finer = periodic_gait(own, 0.55, starts=0)
    assert finer.verification.passed
    assert finer.optimality.mesh_error < usual.optimality.mesh_error
    assert finer.cot == pytest.approx(usual.cot, rel=1e-5)


def test_the_report_shows_a_failed_verification(one_step):
    phases = [dataclasses.replace(p, controls=p.controls + 0.1) for p in one_step.phases]
    spoilt = verify(THESIS_PHYSICAL, phases, one_step.theta_turns)
    assert not spoilt.passed
    assert "FAILED" in dataclasses.replace(one_step, verification=spoilt).report()


def test_regeneration_never_costs_more(one_step):
    solved = periodic_gait(THESIS_PHYSICAL, 0.5, 1, regeneration=True, guess=one_step)
    assert solved.verification.passed
    assert solved.cot_with_regeneration <= one_step.cot_with_regeneration + 1e-6


@pytest.mark.parametrize("coordinate", range(4))
def test_the_monodromy_matrix_predicts_the_reference_simulation(one_step, coordinate):
    column = monodromy(THESIS_PHYSICAL, one_step.phases)[:, coordinate]
    T, spare, size = one_step.duration, 0.002, 1e-6
    far_below = {"rtol": 1e-10, "atol": 1e-11}  # differences of 1e-6 to half a percent
    before_edge, after_edge = float(np.nextafter(T, 0)), float(np.nextafter(T, 2 * T))
    _, volts = playback([*one_step.phases, *one_step.phases])

    def end(change):
        """State at T + spare; the touchdown, not the clock, switches the voltage."""
        x0 = one_step.state(0.0) + change
        x0[0] = max(x0[0], THESIS_PHYSICAL.constants.a)
        step = simulate(
            THESIS_PHYSICAL,
            x0,
            lambda t, x: volts(min(t, before_edge), None),
            T + spare,
            breakpoints=[*one_step.breakpoints, T],
            **far_below,
        )
        touchdown = step.touchdowns[0]
        following = simulate(
            THESIS_PHYSICAL,
            touchdown.after,
            lambda t, x: volts(max(t + touchdown.time, after_edge), None),
            T + spare - touchdown.time,
            breakpoints=[T - touchdown.time] if touchdown.time < T else [],
            **far_below,
        )
        return following.x[-1]

    def later(x):
        law = lambda t, _: volts(max(t + T, after_edge), None)  # noqa: E731
        return simulate(THESIS_PHYSICAL, x, law, spare).x[-1]

    direction = np.eye(4)[coordinate] * size
    sides = (1, 0) if coordinate == 0 else (1, -1)  # a leg cannot start below the ground
    moved = (end(sides[0] * direction) - end(sides[1] * direction)) / (sides[0] - sides[1])
    at_T = one_step.state(T)
    at_T[0] += 1e-4  # clear of the guard, on both sides
    predicted = (later(at_T + size * column / 2) - later(at_T - size * column / 2)) / size
    assert np.allclose(moved / size, predicted, rtol=5e-3, atol=5e-3 * np.abs(predicted).max())


def test_shipped_gaits_repeat_into_longer_strides():
    one = nearest(THESIS_PHYSICAL, 0.5, 1)[0]
    three = repeated(one, 3)
    t = np.linspace(0, three.duration, 50)
    assert np.allclose(three.state(t), one.state(t), atol=1e-9)


def test_every_shipped_gait_was_verified():
    assert shipped()
    assert all(s.verification.passed for s in shipped())


def test_random_guesses_depend_on_nothing_but_the_seed():
    first, second = (
        random_guess(THESIS_PHYSICAL, 2, 1.7, np.random.default_rng([3, 4])) for _ in range(2)
    )
    assert first[1] == second[1]
    for mine, theirs in zip(first[0], second[0], strict=True):
        assert np.array_equal(mine.states, theirs.states)


def test_the_same_optimum_found_twice_is_listed_once_with_both_starts(gait):
    shifted = gait.phases[1:] + gait.phases[:1]
    starts = [(gait.phases, 1.0), (shifted, 1.0), (gait.phases, 2.0)]
    outcomes = [
        Outcome(i, "0", times * gait.cost, phases, np.empty(0), 1, "")
        for i, (phases, times) in enumerate(starts)
    ]
    assert [o.found for o in distinct(outcomes, same_gait)] == [(0, 1), (2,)]


def test_the_front_interpolates_its_lower_envelope_and_refuses_to_extrapolate():
    front = CotFront(shipped())
    speeds = [s.speed for s in front.envelope]
    middle = 0.5 * (speeds[0] + speeds[1])
    expected = 0.5 * (front.envelope[0].cot + front.envelope[1].cot)
    assert front(middle) == pytest.approx(expected)
    assert front(0.5) <= min(s.cot for s in shipped() if abs(s.speed - 0.5) < 1e-9) + 1e-12
    with pytest.raises(ValueError, match="solved for"):
        front(5.0)


def test_among_equally_good_gaits_the_front_takes_the_first(gait):
    v, hair = gait.verification, 1 + 1e-9
    for factor in (hair, 1.0, 1 / hair):
        other = dataclasses.replace(
            gait,
            verification=dataclasses.replace(v, electrical_positive=factor * v.electrical_positive),
        )
        assert CotFront((gait, other)).envelope[0] is gait
        assert CotFront((other, gait)).envelope[0] is other


@pytest.mark.parametrize("rounding", [-1e-10, 0.0, 1e-10])
def test_rounding_does_not_change_which_gait_leads(rounding):
    # Gaits at 0.45 and 0.55 m/s are equally near to 0.5 m/s, and 0.05 m/s is 2.5 times `NEAR`:
    # both their order and the rounding to `NEAR` could depend on the last bits.
    leads = [s for s in shipped() if s.steps == 2 and s.params == THESIS_PHYSICAL]
    leads = ranked(leads, THESIS_PHYSICAL, 0.5)
    again = ranked(leads[::-1], THESIS_PHYSICAL, 0.5 + rounding)
    assert [s.speed for s in again] == [s.speed for s in leads]


def test_the_gait_nearest_in_speed_leads_its_family_even_if_slower_ones_cost_less():
    family = [s for s in shipped() if s.steps == 1 and s.theta_turns == -1]
    assert min(family, key=lambda s: s.cot).speed < 0.59
    assert ranked(family, THESIS_PHYSICAL, 0.6)[0].speed == pytest.approx(0.6)


@pytest.mark.slow
def test_a_folder_keeps_the_gaits_of_a_front_and_why_others_are_missing(tmp_path, monkeypatch):
    gait = next(s for s in shipped() if s.steps == 1)
    speeds = [gait.speed, 20.0]
    front = cot_front(THESIS_PHYSICAL, speeds, steps=(1,), folder=tmp_path)
    assert len(front.missing) == 1

    def solved_again(*_, **__):
        raise AssertionError("it was kept")

    monkeypatch.setattr(fronts, "periodic_gait", solved_again)
    again = cot_front(THESIS_PHYSICAL, speeds, steps=(1,), folder=tmp_path)
    assert again.missing == front.missing
    assert [s.cot for s in again.solutions] == [s.cot for s in front.solutions]
    with pytest.raises(AssertionError, match="it was kept"):
        cot_front(THESIS_PHYSICAL.replace(friction=0.9), speeds, steps=(1,), folder=tmp_path)
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(AssertionError, match="it was kept"):
        cot_front(THESIS_PHYSICAL, speeds, steps=(1,), folder=tmp_path)


@pytest.mark.slow
def test_the_front_is_solved_from_shipped_gaits():
    front = cot_front(THESIS_PHYSICAL, [0.45, 0.5], steps=(1, 2))
    assert not front.missing
    assert [s.speed for s in front.envelope] == pytest.approx([0.45, 0.5])
    best = min(s.cot for s in front.solutions if s.speed > 0.49)
    assert front(0.5) == pytest.approx(best, rel=1e-12)


def test_the_plot_of_a_gait_shows_its_states_and_voltage(one_step, tmp_path):
    figure = one_step.plot(tmp_path / "gait.png")
    assert (tmp_path / "gait.png").stat().st_size > 10_000
    labels = [axes.get_ylabel() for axes in figure.axes if axes.get_ylabel()]
    assert sorted(labels) == ["V", "phi", "phi'", "theta", "theta'"]
    volts = next(axes for axes in figure.axes if axes.get_ylabel() == "V").lines
    limit = one_step.params.voltage_limit
    assert max(np.max(line.get_ydata()) for line in volts) <= limit * (1 + 1e-9)


def test_random_starts_are_the_same_in_other_processes():
    family = GaitFamily.of(THESIS_PHYSICAL, 0.5, 1, regeneration=True)
    alone, shared = (search_gaits(family, 2, workers=workers) for workers in (1, 2))
    assert [o.cost for o in alone.outcomes] == [o.cost for o in shared.outcomes]
    assert [o.index for o in shared.outcomes] == [0, 1]


def test_at_a_shipped_speed_the_gait_is_verified_and_costs_no_more_than_the_shipped_one():
    slowest = min((g for g in shipped() if g.steps == 1), key=lambda g: g.speed)
    again = periodic_gait(slowest.params, slowest.speed, 1)
    assert again.verification.passed
    assert again.cot <= (1 + 1e-3) * slowest.cot
