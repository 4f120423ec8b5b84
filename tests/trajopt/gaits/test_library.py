"""The shipped gaits: their archive, their verification, and which of them a search starts from."""

from __future__ import annotations

import numpy as np
import pytest

from rimless_gym import BUILDABLE, THESIS_PHYSICAL
from rimless_gym.envs.env import RimlessWheelEnv
from rimless_gym.envs.starts import normal_force
from trajopt import Solution
from trajopt.gaits.library import (
    Entry,
    index,
    nearest,
    ranked,
    repeated,
    shipped,
    warm_starts,
)
from trajopt.gaits.verify import verify


def test_every_shipped_gait_is_verified_and_what_the_index_says() -> None:
    machines = {entry.params for entry in index()}
    assert machines == {BUILDABLE, THESIS_PHYSICAL}
    for entry in index():
        gait = entry.load()
        assert gait.verification.passed
        assert (gait.params, gait.steps, gait.theta_turns) == entry[1:4]
        assert (gait.speed, gait.cot) == (entry.speed, entry.cot)
    assert len(shipped()) == sum(len(shipped(params)) for params in machines)


def verified_again(gait: Solution) -> None:
    found = verify(gait.params, gait.phases, gait.theta_turns)
    assert found.failures == gait.verification.failures == ()
    assert found.state_error < 1e-6
    sums, extremes = ("electrical_positive", "electrical"), ("min_normal_force", "clearance")
    # Extremes are sampled. Those in the files were sampled only at the ends of the simulator's
    # steps, at other times than today's. That alone changes a clearance by up to 3.8e-4 m.
    for figure in (*sums, *extremes):
        stored = getattr(gait.verification, figure)
        close = pytest.approx(stored, rel=1e-5 if figure in sums else 2e-3, abs=1e-6)
        assert getattr(found, figure) == close, figure


@pytest.mark.parametrize(("params", "steps"), [(BUILDABLE, 1), (THESIS_PHYSICAL, 2)])
def test_the_shipped_gaits_at_half_a_metre_per_second_pass_verification_again(
    params, steps
) -> None:
    verified_again(nearest(params, 0.5, steps)[0].load())


@pytest.mark.slow
@pytest.mark.parametrize("entry", index(), ids=lambda entry: entry.name)
def test_every_shipped_gait_passes_verification_again(entry: Entry) -> None:
    verified_again(entry.load())


def test_shipped_gaits_repeat_into_longer_strides() -> None:
    one = nearest(THESIS_PHYSICAL, 0.5, 1)[0].load()
    three = repeated(one, 3)
    t = np.linspace(0, three.duration, 50)
    assert np.allclose(three.state(t), one.state(t), atol=1e-9)


@pytest.mark.parametrize("rounding", [-1e-10, 0.0, 1e-10])
def test_rounding_does_not_change_which_gait_is_first(rounding: float) -> None:
    # Gaits at 0.45 and 0.55 m/s are equally near to 0.5 m/s, and 0.05 m/s is 2.5 times `NEAR`:
    # both their order and the rounding to `NEAR` could depend on the last bits.
    gaits = [e for e in index() if e.steps == 2 and e.params == THESIS_PHYSICAL]
    gaits = ranked(gaits, 0.5)
    again = ranked(gaits[::-1], 0.5 + rounding)
    assert [e.speed for e in again] == [e.speed for e in gaits]


def test_the_gait_nearest_in_speed_leads_its_family_even_if_slower_ones_cost_less() -> None:
    family = [e for e in index() if (e.params, e.steps, e.theta_turns) == (THESIS_PHYSICAL, 1, -1)]
    assert min(family, key=lambda e: e.cot).speed < 0.59
    assert ranked(family, 0.6)[0].speed == pytest.approx(0.6)


def test_warm_starts_of_two_steps_include_shorter_strides_repeated() -> None:
    starts = warm_starts(BUILDABLE, 0.5, 2)
    assert {gait.steps for gait in starts} == {2}
    assert any(gait.verification.distance < 1.5 * BUILDABLE.step_length for gait in starts)
    assert [gait.cot for gait in warm_starts(BUILDABLE, 0.5, 2, 1)] == [starts[0].cot]


def test_an_episode_can_start_in_every_state_of_the_shipped_gaits() -> None:
    """The environment begins in any state of an optimal gait, however fast the pendulum whirls."""
    pulled = 0
    for gait in shipped()[::4]:
        env = RimlessWheelEnv(gait.params)
        for t in np.linspace(0.0, gait.duration, 8):
            state = gait.state(t)
            env.reset(options={"state": state})
            assert np.array_equal(env.state[:4], state)
            pulled += normal_force(gait.params, env.state) <= 0
            action = np.array([gait.control(t) / gait.params.voltage_limit])
            env.step(action)
            assert env.measurements["elapsed"] > 0
    assert pulled > 5  # these need the gait's voltage to stand
