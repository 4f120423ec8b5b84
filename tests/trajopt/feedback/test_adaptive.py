"""The adaptive controller: its table of laws, and what it remembers."""

from __future__ import annotations

import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from agents.conditions import Conditions
from agents.rollout import AdaptivePolicy, Rollout
from rimless_gym.equations import SINGLE
from rimless_gym.kernel.stepping import FOOT, MODE, advance, hybrid_states
from trajopt.feedback import adaptive
from trajopt.feedback.adaptive import AdaptiveController, forgotten, sturdy
from trajopt.feedback.gait_table import ALIKE, GaitTable, flat, gains_of, law_about, own_gait
from trajopt.feedback.law import Law
from trajopt.feedback.laws import lqr
from trajopt.feedback.orbit import squared_distances
from trajopt.identification.fit import physical
from trajopt.store import Store


@dataclasses.dataclass(frozen=True)
class Startup:
    """In place of a start-up controller."""

    params: object
    volts: float = 0.0

    def __call__(self, x, mode):
        return np.full(len(x), self.volts)


@pytest.fixture(scope="module")
def controller(held, law):
    """Its table knows the pendulum's length, and of that only a shift of the voltage.

    Up and down shift it differently, so between machines it is a parabola.
    """
    row = flat(law.data)
    shift = np.zeros_like(row)
    n = len(law.data.voltages)
    shift[13 * n : 14 * n] = 0.5
    table = GaitTable(
        held, law, ("pendulum_length",), np.array([row, row + shift, row - 0.6 * shift])
    )
    return AdaptiveController(table, Startup(held.params), 0.5, held)


def walk_on(walks, held, ticks):
    """One walk of the nominal machine, from its gait, that lasts."""

    def policy(states, observations):
        modes = states[:, MODE].astype(np.int64)
        return (
            walks(np.arange(1), states[:, :4], modes, states[:, FOOT]) / held.params.voltage_limit
        )

    start = hybrid_states(held.state([0.1]), SINGLE)
    assert len(list(Rollout(Conditions(held.params), policy, start, ticks))) == ticks


def test_a_table_has_its_machines_laws_and_a_parabola_between_them(controller, law) -> None:
    table, nominal = controller.table, controller.params
    np.testing.assert_array_equal(table.flat_law(nominal), table.rows[0])
    for share in (0.02, 0.013, -0.02, -0.01):
        length = (1 + share) * nominal.pendulum_length
        between = table.flat_law(dataclasses.replace(nominal, pendulum_length=length))
        x = share / 0.02
        shift = 0.8 * x + 0.2 * x**2  # 1 at x = 1, -0.6 at x = -1
        wanted = table.rows[0] + shift * (table.rows[1] - table.rows[0])
        np.testing.assert_allclose(between, wanted, atol=1e-12)
    x = law.data.orbit.states[5:40:7] + 0.01
    for row, shift in zip(table.rows, (0.0, 0.5, -0.3), strict=True):
        volts = dataclasses.replace(law, data=gains_of(row, law.data))(x)
        np.testing.assert_allclose(volts, law(x) + shift, atol=1e-12)


def test_a_changed_machine_is_identified_and_a_restored_walk_goes_on_bit_for_bit(
    controller, held, tmp_path, monkeypatch
) -> None:
    """Each by its own memory; then it holds its own gaits, each of shorter steps."""
    planned = controller.table.rows[1]
    monkeypatch.setattr(AdaptiveController, "own_laws", lambda *given: [planned, planned])
    monkeypatch.setattr(AdaptiveController, "shorter", 1)
    monkeypatch.setattr(adaptive, "PLANNED", (1, 1))
    monkeypatch.setattr(adaptive, "SOLVING", 0.1)
    lengths = held.params.pendulum_length * np.array([1.01, 0.99])
    machines = [held.params.replace(pendulum_length=length) for length in lengths]
    start = hybrid_states(held.state([0.1, 0.3]), SINGLE)
    kept = controller.begin(2)

    def policy(states, observations, walks=kept):
        rows = np.arange(len(states))
        modes = states[:, 4].astype(np.int64)
        return walks(rows, states[:, :4], modes, states[:, 5]) / held.params.voltage_limit

    rollout = Rollout(Conditions(held.params), policy, start, 230, machines=machines)
    states = [each.states for each in rollout]
    assert [len(each) for each in states] == [2] * 230
    assert (kept.identified == 1).all()
    assert not kept.delays.any()
    found = [machine.pendulum_length for machine in kept.machines]
    np.testing.assert_allclose(found, lengths, rtol=3e-3)
    assert [(plan.tick, plan.shorter) for plan in kept.plans] == [(220, 1), (220, 1)]

    first = controller.begin(2)
    for each in states[:215]:
        policy(each, None, first)
    Store(tmp_path).save("walks", first.state())
    other = controller.begin(2, seed=1)
    other.restore(Store(tmp_path).load("walks"))
    assert [(plan.tick, plan.shorter) for plan in other.plans] == [(210, 0), (210, 0)]
    for each in states[215:]:
        np.testing.assert_array_equal(policy(each, None, other), policy(each, None, first))
    assert [plan.shorter for plan in other.plans] == [1, 1]
    assert (other.identified == 1).all()
    np.testing.assert_array_equal(other.since, [220, 220])


def test_only_a_state_of_as_many_walks_and_positive_errors_are_accepted(controller) -> None:
    walks = controller.begin(2)
    with pytest.raises(ValueError, match=r"\(3, 1\).*\(2, 1\)"):
        walks.restore(controller.begin(3).state())
    with pytest.raises(ValueError, match=r"encoders = 0"):
        dataclasses.replace(controller, encoders=0.0)


def test_a_voltage_that_comes_late_is_that_of_the_predicted_state(controller, held) -> None:
    """A restored walk goes on bit for bit."""
    late = Conditions.of(held.params, None, {"actuator_delay": 1})
    walks, seen, commanded, restored = controller.begin(1), [], [], controller.begin(1)

    def policy(states, observations):
        if len(seen) == 220:
            restored.restore(walks.state())
        seen.append(states[:, :4].copy())
        given = np.arange(1), seen[-1], states[:, 4].astype(np.int64), states[:, 5]
        commanded.append(walks(*given))
        if len(seen) > 220:
            np.testing.assert_array_equal(restored(*given), commanded[-1])
        return commanded[-1] / held.params.voltage_limit

    start = hybrid_states(held.state([0.1]), SINGLE)
    for _ in Rollout(late, policy, start, 240):
        assert walks.delays == (len(seen) > 200)
    assert (walks.identified, len(seen)) == (1, 240)
    own = controller.controller_for(walks.machines[0])
    ahead = own(np.concatenate(seen[206:]), np.zeros(34, dtype=np.int64))
    np.testing.assert_allclose(np.concatenate(commanded[205:-1]), ahead, atol=0.05)
    assert np.abs(np.concatenate(commanded[206:]) - ahead).max() > 0.3


@pytest.mark.parametrize(("holds", "shorter"), [(True, 1), (False, 0)])
def test_a_law_stays_in_use_while_it_holds_what_the_machine_is_now_known_to_be(
    controller, held, monkeypatch, holds, shorter
) -> None:
    """Even if now none of steps as short is found."""
    rows = controller.table.rows
    found = iter([[rows[0], rows[0]], [rows[0]]])
    monkeypatch.setattr(AdaptiveController, "own_laws", lambda *given: next(found))
    monkeypatch.setattr(AdaptiveController, "holds", lambda self, *given: holds)
    monkeypatch.setattr(AdaptiveController, "shorter", 1)
    monkeypatch.setattr(adaptive, "PLANNED", (1, 1))
    monkeypatch.setattr(adaptive, "SOLVING", 0.1)
    walks = controller.begin(1)
    walk_on(walks, held, 420)
    assert walks.plans[0].shorter == shorter


def test_steps_get_shorter_once_the_wheel_is_on_its_gait(controller, held) -> None:
    walks, row = controller.begin(2), controller.table.rows[0]
    state = {**walks.state(), "plans": [[0, 1, 0, row]] * 2, "ladders": [[[0, 1, 1, row]]] * 2}
    walks.restore(state)
    x = hybrid_states(held.state(np.full(2, 0.2)), SINGLE)
    x[1, 2] += 2.0
    walks(np.arange(2), x[:, :4], np.zeros(2, dtype=np.int64), np.zeros(2))
    assert [plan.shorter for plan in walks.plans] == [1, 0]


def test_steps_get_longer_again_if_the_wheel_does_not_hold_its_gait(controller, held) -> None:
    """Not at once after a change, and only to those that are known; then these stay.

    Those of a later fit are still to come.
    """
    walks, row = controller.begin(5), controller.table.rows[0]
    ladder = [[0, 1, 0, row], [0, 1, 1, row]]
    ladders = [*[ladder] * 3, ladder[1:], [[0, 2, 0, row], [1000, 2, 1, row]]]
    state = {**walks.state(), "plans": [[0, 1, 1, row]] * 5, "ladders": ladders}
    since = np.array([0, 0, 170, 0, 0])
    walks.restore(state | {"tick": 180, "since": since})
    x = hybrid_states(held.state(np.full(5, 0.2)), SINGLE)
    x[1:, 2] += 2.0

    def shorter():
        walks(np.arange(5), x[:, :4], np.zeros(5, dtype=np.int64), np.zeros(5))
        return [plan.shorter for plan in walks.plans]

    assert shorter() == [1, 0, 1, 1, 0]
    x[1, 2] = x[0, 2]
    assert shorter() == [1, 0, 1, 1, 0]
    assert [len(each) for each in walks.state()["ladders"]] == [2, 1, 2, 1, 2]


def test_gaits_are_solved_for_again_if_the_next_one_is_never_reached(
    controller, held, monkeypatch
) -> None:
    solved = []
    rows = controller.table.rows

    def own_laws(*given):
        solved.append(walks.tick)
        return [rows[0], rows[0]]

    monkeypatch.setattr(AdaptiveController, "own_laws", own_laws)
    monkeypatch.setattr(AdaptiveController, "off", lambda *given: 0.7)
    monkeypatch.setattr(AdaptiveController, "shorter", 1)
    monkeypatch.setattr(adaptive, "PLANNED", (1, 1))
    walks = controller.begin(1)
    walk_on(walks, held, 1210)
    assert len(solved) == 2
    assert walks.plans[0].shorter == 0


def test_the_angles_of_an_identified_machine_are_filtered_but_not_after_a_push(
    controller, law, held
) -> None:
    walks = controller.begin(1)
    state = walks.state()
    walks.restore({**state, "identified": np.ones(1, dtype=np.int64)})
    states = hybrid_states(held.state([0.1]), SINGLE)
    rng, errors = np.random.default_rng(0), []

    def volts(x):
        modes = states[:, MODE].astype(np.int64)
        return walks(np.arange(1), x, modes, states[:, FOOT])

    for _ in range(150):
        measured = states[:, :4].copy()
        measured[:, :2] += 1e-3 * rng.standard_normal((1, 2))
        given = volts(measured)
        errors.append((given - law(states[:, :4]), law(measured) - law(states[:, :4])))
        advance(held.params, states, given)
    filtered, raw = np.std(np.array(errors)[20:, :, 0], axis=0)
    assert filtered < 0.6 * raw
    pushed = states[:, :4] + [0.02, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(volts(pushed), law(pushed), atol=1e-9)


def test_a_policy_keeps_the_memories_of_walks_apart_when_others_have_ended(
    controller, monkeypatch
) -> None:
    """One walk ends; the last one has been identified: its angles are filtered."""
    begun = []
    begin = AdaptiveController.begin

    def identified(made, n):
        begun.append(begin(made, n))
        known = np.arange(n) == n - 1
        begun[-1].restore({**begun[-1].state(), "identified": known.astype(np.int64)})
        return begun[-1]

    monkeypatch.setattr(AdaptiveController, "begin", identified)
    rows = itertools.chain([np.arange(3)], itertools.repeat(np.array([0, 2])))
    x = hybrid_states(controller.table.gait.state([0.1, 0.2, 0.3]), SINGLE)
    machines = (controller.params,) * 3
    policy = AdaptivePolicy(controller).begin(machines, lambda: next(rows))
    together = AdaptivePolicy(controller).begin(machines, lambda: np.arange(3))
    volts = controller.params.voltage_limit * policy(x, None)
    together(x, None)
    advance(controller.params, x, volts)
    x[:, 0] += 0.003  # which a filter takes for noise
    np.testing.assert_array_equal(policy(x[[0, 2]], None), together(x, None)[[0, 2]])


def test_what_no_log_shows_is_known_no_less_after_many_fits() -> None:
    prior = np.array([0.07, 3e-3, 0.5])
    shown = np.diag([1.0, 1e-3, 0.0]) / prior**2  # information of each log
    covariance = np.diag(prior**2)
    for _ in range(300):
        covariance = np.linalg.inv(np.linalg.inv(forgotten(covariance, prior)) + shown)
    deviations = np.sqrt(np.diag(covariance))
    assert deviations[2] == pytest.approx(prior[2])
    assert deviations[1] < prior[1]
    assert deviations[0] < 0.5 * prior[0]


def test_on_a_slope_beyond_the_table_the_start_up_controller_walks_by_itself(controller, held):
    steep = {2: Startup(held.params, 0.25)}  # in degrees, the nearest to 0.03 rad
    controller = dataclasses.replace(controller, on_slopes=steep)
    walks = controller.begin(2)
    state = walks.state()
    state["machines"][1]["slope"] = 0.03
    walks.restore(state)
    x = hybrid_states(held.state(np.full(2, 0.2)), SINGLE)
    volts = walks(np.arange(2), x[:, :4], np.zeros(2, dtype=np.int64), np.zeros(2))
    assert abs(volts[0]) > 0.5
    assert volts[1] == 0.25


def test_an_identified_machines_law_is_firmer_on_a_steep_slope(controller, held, monkeypatch):
    monkeypatch.setattr(AdaptiveController, "startup_on", lambda *given: Startup(held.params))
    level, steep = (
        controller.planned(held.params.replace(slope=slope), controller.table.rows[0], 0)
        for slope in (0.0, 0.03)
    )
    assert steep.controller.law.data.blend < level.controller.law.data.blend


def test_what_leads_to_the_gait_on_a_steep_slope_is_of_whole_degrees_and_made_once(
    controller, held, monkeypatch
) -> None:
    made = []

    def startup_for(params, orbit, near, weights, folder):
        made.append(np.degrees(params.slope))
        return Startup(params, 0.5)

    monkeypatch.setattr(adaptive, "own_gait", lambda gait, params, longer: params)
    monkeypatch.setattr(
        adaptive, "law_about", lambda params: SimpleNamespace(data=SimpleNamespace(orbit=None))
    )
    monkeypatch.setattr(adaptive, "startup_for", startup_for)
    fresh = dataclasses.replace(controller, startup=SimpleNamespace(weights=None), on_slopes={})
    assert fresh.startup_on(np.radians(0.5)) is fresh.startup
    assert {fresh.startup_on(np.radians(degrees)).volts for degrees in (0.9, 1.2, 1.0)} == {0.5}
    assert made == pytest.approx([1.0])
    monkeypatch.setattr(adaptive, "law_about", lambda params: (_ for _ in ()).throw(ValueError()))
    assert fresh.startup_on(np.radians(2.2)) is fresh.startup


def test_a_machine_that_is_found_far_from_the_table_walks_by_the_nominal_law_at_first(
    controller, law, held, monkeypatch
) -> None:
    """Until a gait of its own is found, whose steps are longer. Later fits are not decisive."""
    wanted: list[int] = []
    monkeypatch.setattr(adaptive, "own_gait", lambda gait, params, longer: wanted.append(longer))
    start = hybrid_states(held.state([0.1]), SINGLE)

    def walked(length):
        machine = dataclasses.replace(held.params, pendulum_length=length)
        walks = controller.begin(1)

        def policy(states, observations):
            modes = states[:, 4].astype(np.int64)
            return walks(np.arange(1), states[:, :4], modes, states[:, 5]) / machine.voltage_limit

        for _ in Rollout(Conditions(machine), policy, start, 202):
            pass
        return walks

    near, far = (walked(share * held.params.pendulum_length) for share in (1.02, 1.06))
    assert (near.longer, far.longer, wanted) == (0, 0, [3, 0])
    x = np.ascontiguousarray(held.state([0.2]))
    for longer, shift in ((3, 0.0), (0, 1.625)):
        walks = controller.begin(1)
        walks.restore(far.state() | {"longer": np.array([longer])})
        volts = walks(np.arange(1), x, np.zeros(1, dtype=np.int64), np.zeros(1))
        np.testing.assert_allclose(volts, law(x) + shift, atol=0.02)


def test_a_share_by_which_everything_is_heavier_is_no_distance_in_the_table(held, law) -> None:
    """The motion does not depend on it."""
    table = GaitTable(held, law, physical(held.params), np.zeros((1, 1)))

    def changed(**factors):
        fields = {name: share * getattr(held.params, name) for name, share in factors.items()}
        return dataclasses.replace(held.params, **fields)

    alike = {name: 1.1**sign for name, sign in ALIKE.items()}
    states = [hybrid_states(held.state([0.1, 0.3]), SINGLE) for _ in range(2)]
    for params, x in zip((held.params, changed(**alike)), states, strict=True):
        advance(params, x, np.array([3.0, -4.0]), 0.01)
    np.testing.assert_allclose(states[0], states[1], atol=1e-9)
    assert not table.far(changed(**alike))
    np.testing.assert_allclose(table.steps(changed(**alike)), 0.0, atol=0.5)
    assert table.far(changed(**alike, pendulum_length=1.06))
    assert table.far(changed(wheel_mass=1.1))


def test_a_law_must_hold_its_gait_with_noise_and_on_likely_machines(controller, held) -> None:
    states = held.state(held.duration * np.array([0.2, 0.7]))
    heavier = held.params.replace(pendulum_mass=1.1 * held.params.pendulum_mass)
    for errors, other, holds in (
        (1e-3, held.params, True),
        (0.03, held.params, False),
        (1e-3, heavier, False),
    ):
        walking = dataclasses.replace(controller, encoders=errors)
        machines = held.params, other
        assert walking.holds(machines, controller.table.rows[0], 1, states) == holds


def test_the_scale_of_everything_makes_no_difference_to_likely_machines(held) -> None:
    """No log shows it. A draw that cannot be is the identified machine."""
    names = (*physical(held.params), "slope")
    scale = np.array([getattr(held.params, name) for name in names[:-1]] + [1.0])
    alike = scale * [ALIKE.get(name, 0.0) for name in names]
    covariance = np.diag((1e-7 * scale) ** 2) + 0.05**2 * np.outer(alike, alike)
    first, *others = adaptive.likely_machines(held.params, names, covariance)
    assert first == held.params
    masses = [each.wheel_mass / held.params.wheel_mass - 1.0 for each in others]
    assert 0.02 < np.abs(masses).max() < 0.2
    states = [hybrid_states(held.state([0.1, 0.3]), SINGLE) for _ in range(2)]
    for params, x in zip((first, others[0]), states, strict=True):
        advance(params, x, np.array([3.0, -4.0]), 0.05)
    np.testing.assert_allclose(states[0], states[1], atol=1e-5)
    short = held.params.replace(pendulum_reach=held.params.pendulum_length)
    longer = adaptive.likely_machines(short, ("pendulum_length",), np.array([[1e-4]]))
    assert short in longer[1:]


@pytest.mark.slow
def test_an_identified_machine_walks_its_own_gait_from_the_nominal_one(controller, held) -> None:
    """The law leads there from the nominal gait, and stays."""
    length = 1.02 * held.params.pendulum_length
    machine = dataclasses.replace(held.params, pendulum_length=length)
    (row,) = controller.own_laws([machine] * adaptive.TRIALS)
    data = gains_of(row, controller.table.law.data)
    states = hybrid_states(held.state(held.duration * np.array([0.2, 0.7])), SINGLE)
    for _ in range(800):
        volts = Law(machine, lqr.volts, data)(states[:, :4], states[:, MODE].astype(int))
        advance(machine, states, volts)
    assert (squared_distances(states[:, :4], data.orbit) < 0.01**2).all()


@pytest.mark.slow
def test_a_table_gives_a_machine_between_its_rows_the_law_about_its_own_gait(held) -> None:
    table = GaitTable.about(held)
    assert len(table.rows) == 2 * len(table.names) + 1
    changes = {"pendulum_length": 1.013, "wheel_mass": 0.99}
    machine = held.params.replace(
        **{name: share * getattr(held.params, name) for name, share in changes.items()}
    )
    nominal, own = table.rows[0], flat(law_about(own_gait(held, machine, 0)).data)
    assert np.abs(table.flat_law(machine) - own).max() < 0.1 * np.abs(nominal - own).max()


@pytest.mark.slow
def test_the_gait_that_is_walked_first_lands_firmly(held, monkeypatch) -> None:
    def landing(gait):
        return min(phase.end[2] for phase in gait.phases)

    assert sturdy(held) is held
    monkeypatch.setattr(adaptive, "LANDING", 1.02 * landing(held))
    first = sturdy(held)
    assert landing(first) > 1.02 * landing(held)
    assert first.duration > held.duration + 0.005
