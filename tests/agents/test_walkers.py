"""Walkers by name."""

import numpy as np
import pytest

from agents.policy_files import PRETRAINED, CheckpointError
from agents.rollout import at_rest
from agents.walkers import walker
from rimless_gym import BUILDABLE, PROTOTYPE, THESIS_PHYSICAL
from rimless_gym.envs.arguments import USUAL
from trajopt.gaits.library import nearest


def no_gait(params):
    pytest.fail("no law was asked for")


def shipped_gait(params):
    return nearest(THESIS_PHYSICAL, 0.5, 1)[0].load()


def test_a_policy_of_the_package_walks_as_the_one_in_its_file():
    by_name, by_path = (walker(str(n), no_gait) for n in ("evolution", PRETRAINED["evolution"]))
    assert (by_name.name, by_name.params, by_name.gait) == ("evolution", BUILDABLE, None)
    assert by_name.conditions.control == USUAL
    assert by_name.task is not None
    states, seen = at_rest(BUILDABLE)[None], np.full((1, 6), 0.1, np.float32)
    assert np.array_equal(by_name.policy(states, seen), by_path.policy(states, seen))


def test_a_law_holds_the_gait_that_is_found_for_the_machine(monkeypatch):
    def designed(name, gait):
        return lambda states, modes: np.full(len(states), gait.speed)

    monkeypatch.setattr("agents.walkers.laws.design", designed)  # designing takes long
    asked = []
    one = walker("lqr", lambda params: asked.append(params) or shipped_gait(params))
    assert asked == [BUILDABLE]
    assert one.params == one.gait.params == THESIS_PHYSICAL  # that of the gait
    action = one.policy(at_rest(THESIS_PHYSICAL)[None], np.zeros((1, 6), np.float32))
    assert action == pytest.approx(one.gait.speed / THESIS_PHYSICAL.voltage_limit)


def test_walkers_of_other_machines_and_strangers_are_refused():
    with pytest.raises(ValueError, match="lqr: is to hold a gait of another machine"):
        walker("lqr", shipped_gait, PROTOTYPE)
    with pytest.raises(CheckpointError, match="trained on another machine"):
        walker("evolution", no_gait, PROTOTYPE)
    with pytest.raises(CheckpointError, match="no policy of that name"):
        walker("nobody", no_gait)
