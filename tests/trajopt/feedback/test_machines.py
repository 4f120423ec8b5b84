"""Parts that are made for different machines are not put together."""

from __future__ import annotations

import numpy as np
import pytest

from agents.policies import controller_policy
from rimless_gym import THESIS_PHYSICAL
from trajopt.feedback import laws
from trajopt.feedback.closed_loop import multipliers
from trajopt.feedback.guard import Guarded
from trajopt.feedback.joined import Joined
from trajopt.feedback.law import Law
from trajopt.feedback.laws import lqr
from trajopt.feedback.tuning import Trial, score

P = THESIS_PHYSICAL
OTHER = P.replace(wheel_mass=2.0)


@pytest.fixture(scope="module")
def law(held):
    return lqr.design(held)


@pytest.fixture(scope="module")
def foreign(law):
    return Law(OTHER, law.volts, law.data)


def zero(x, mode):
    return 0 * x[:, 0]


class Resting:
    """A catch that knows its machine."""

    params = OTHER

    def __call__(self, x, mode):
        return 0 * x[:, 0]


@pytest.mark.parametrize(
    "joining",
    [
        lambda law, gait: Guarded(P, law),
        lambda law, gait: Guarded(P, Joined(law, zero)),
        lambda law, gait: Joined(lqr.design(gait), Resting()),
        lambda law, gait: multipliers(law, gait),
        lambda law, gait: score(law, gait, Trial.about(gait, law.data.orbit, 8, 0)),
        lambda law, gait: laws.holding(law, gait),
        lambda law, gait: controller_policy("THESIS_PHYSICAL", law),
    ],
    ids=["guard", "joined", "catch", "multipliers", "score", "holding", "policy"],
)
def test_what_is_for_another_machine_is_refused_and_the_fields_that_differ_are_named(
    joining, foreign, held
):
    with pytest.raises(ValueError, match=r"another machine: {'wheel_mass': '2.0 \(not ") as raised:
        joining(foreign, held)
    assert str(raised.value).count("(not") == 1


def test_a_policy_of_a_machines_name_is_that_of_the_machine(law, held):
    x, seen = np.zeros((3, 6)), np.zeros((3, 6), np.float32)
    x[:, :4] = held.state(np.array([0.1, 0.3, 0.5]))
    named, plain = (controller_policy(each, law)(x, seen) for each in ("THESIS_PHYSICAL", P))
    assert np.array_equal(named, plain)
