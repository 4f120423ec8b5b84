"""The contest of screened policies: who goes on to the next stage."""

import numpy as np

from agents.pacing import NO_WALK, CleanWalking
from agents.sb3.stages import STAGES, Contest

FAMILIES = [0, 0, 0, -1, -1, 1]
GAITS = [
    CleanWalking(1.0, 0.2, 0.5),
    CleanWalking(0.6, 0.1, 0.5),
    CleanWalking(0.9, 0.2, 0.5),
    NO_WALK,
    CleanWalking(1.0, 0.4, 0.5),
    CleanWalking(0.9, 0.8, 0.5),
]


def six():
    """Six policies of one weight, which tells them apart."""
    return Contest(np.arange(6.0)[:, None], np.array(FAMILIES))


def end_stage(contest):
    """Let every policy of a stage learn nothing; who goes on, and of which families."""
    for weights in contest.contenders.copy():
        contest.end_turn(weights, GAITS[int(weights[0])])
    return contest.contenders[:, 0].tolist(), contest.families.tolist()


def test_the_most_promising_two_of_each_family_go_on_and_the_best_of_all_settles():
    contest = six()
    assert end_stage(contest) == ([1, 0, 4, 5, 3], [0, 0, -1, 1, -1])
    assert end_stage(contest) == ([1, 0], [0, 0])
    assert not contest.settles
    assert end_stage(contest) == ([1], [0])
    assert contest.settles
    assert contest.rules == STAGES[-1]


def test_a_policy_goes_on_as_what_it_has_become():
    contest = six()
    for k in range(6):
        assert contest.contender.tolist() == [k]
        contest.end_turn(np.array([10.0 + k]), GAITS[k])
    assert contest.contenders[:, 0].tolist() == [11, 10, 14, 15, 13]


def test_a_contest_that_was_kept_goes_on_with_the_same_turn():
    contest = six()
    contest.end_turn(np.array([10.0]), GAITS[0])
    again = Contest.read(contest.state())
    assert again.gaits == [GAITS[0]]
    assert again.contender.tolist() == [1]
    assert (again.stage, again.contenders[0, 0]) == (0, 10.0)
    assert Contest.read(six().state()).gaits == []


def test_a_policy_that_is_alone_settles():
    contest = Contest.settling(np.array([3.0, 4.0]))
    assert contest.settles
    assert contest.contender.tolist() == [3.0, 4.0]
