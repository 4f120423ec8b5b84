from __future__ import annotations

import contextlib
import dataclasses

import numpy as np
import pytest

from agents.evolution.asking import Among, Answer, NothingWalksError
from agents.evolution.campaign import campaign
from agents.evolution.contender import Contender, Schedule, Walking
from agents.evolution.policy import SIZE
from agents.evolution.settings import EvolutionSettings
from agents.evolution.walks import Duration
from agents.pacing import NO_WALK, CleanWalking

SETTINGS = EvolutionSettings(screened=40, kept=5, contenders=2, trial=10, finalists=1, race=10)


def judged(request, wanted):
    """Pretended walks: family -1 is cheap if the weights are near `wanted`, family 0 never is."""
    off = ((request.weights - wanted) ** 2).sum(axis=1)
    apart = {Among.SENSES: [0, 1], Among.FAMILIES: [0, -1]}
    known = apart.get(request.among, [request.among])
    worth = np.array([-off if group else -5.0 - off for group in known])
    cot = float(0.05 + off[0]) if known[0] else 0.9
    return Answer(np.array(known, float), worth, CleanWalking(1.0, cot, 0.5))


@pytest.fixture
def wanted():
    return np.linspace(-0.5, 0.5, SIZE)


def run(search, wanted, count):
    requests, request = [], next(search)
    for _ in range(count):
        requests.append(request)
        request = search.send(judged(request, wanted))
    return requests


def test_every_family_races_and_the_cheapest_is_refined(wanted):
    requests = run(campaign(SETTINGS, 0, 0.5, None), wanted, 150)
    stages = list(dict.fromkeys(request.stage for request in requests))
    assert stages[:3] == ["screen", "trial +0", "trial -1"]
    assert set(stages[3:-1]) == {"race +0", "race -1"}
    assert stages[-1] == "refine"
    assert {r.among for r in requests if r.stage == "refine"} == {-1}


def test_what_is_left_of_a_glance_at_many_walks_for_longer(wanted):
    glance, walk = run(campaign(SETTINGS, 0, 0.5, None), wanted, 2)
    assert len(glance.weights) == 40
    assert SETTINGS.kept <= len(walk.weights) <= 2 * SETTINGS.kept
    assert glance.duration.intervals < walk.duration.intervals


def test_a_family_that_is_easy_to_find_has_no_more_trials_than_finalists(wanted):
    requests = run(campaign(SETTINGS, 0, 0.5, None), wanted, 100)
    assert sum(r.stage == "trial +0" and len(r.weights) == 1 for r in requests) == 1


def test_policies_are_judged_by_more_starts_once_they_walk_from_more(wanted):
    requests = run(campaign(SETTINGS, 0, 0.5, None), wanted, 200)
    shares = [request.judged for request in requests if request.stage == "trial -1"]
    assert shares[0] == SETTINGS.least_judged
    assert requests[-1].judged == 1.0


def test_the_price_falls_to_the_true_one_with_the_cost_of_walking(wanted):
    requests = run(campaign(SETTINGS, 0, 0.5, None), wanted, 400)
    prices = [request.price for request in requests if request.stage == "refine"]
    assert requests[0].price == SETTINGS.first_price
    assert prices == sorted(prices, reverse=True)
    assert prices[-1] == 0.5


def test_evolution_finds_what_is_wanted(wanted):
    settings = dataclasses.replace(SETTINGS, spread=1.0)
    requests = run(campaign(settings, 0, 0.5, None), wanted, 1200)
    assert np.abs(requests[-1].best - wanted).max() < 0.05


def test_the_same_answers_lead_to_the_same_place(wanted):
    one, other = (run(campaign(SETTINGS, 3, 0.5, None), wanted, 200) for _ in range(2))
    for first, second in zip(one, other, strict=True):
        assert np.array_equal(first.weights, second.weights)
        assert first[:1] + first[2:-1] == second[:1] + second[2:-1]
    changed = run(campaign(SETTINGS, 4, 0.5, None), wanted, 1)
    assert not np.array_equal(changed[0].weights, one[0].weights)


def test_a_policy_to_start_from_is_refined_in_its_own_family(wanted):
    requests = run(campaign(SETTINGS, 0, 0.5, wanted + 0.01), wanted, 30)
    assert [r.stage for r in requests[:2]] == ["look", "refine"]
    assert requests[0].starts == SETTINGS.looked_at
    assert requests[-1].among == -1


def test_a_machine_on_which_nothing_walks_ends_the_campaign_with_a_remedy(wanted):
    search = campaign(SETTINGS, 0, 0.5, None)
    search.send(judged(next(search), wanted))
    nothing = Answer(np.empty(0), np.empty((0, 40)), NO_WALK)
    with pytest.raises(NothingWalksError, match=r"none of 40 random .* another seed"):
        search.send(nothing)


def test_a_trial_that_nobody_survives_ends_the_campaign_with_a_remedy(wanted):
    search, lost = campaign(SETTINGS, 0, 0.5, None), NO_WALK

    def go_on(request):
        while True:
            request = search.send(judged(request, wanted)._replace(gait=lost))

    with pytest.raises(NothingWalksError, match=r"still walks after 10 generations: try"):
        go_on(next(search))


def test_long_walks_from_few_starts_and_short_ones_from_many_take_turns(wanted):
    requests = run(campaign(SETTINGS, 0, 0.5, wanted + 0.01), wanted, 30)
    refining = [r for r in requests if r.stage == "refine"]
    looks = [r for r in refining if len(r.weights) == 1]
    walks = [(r.starts, r.duration.intervals) for r in refining if len(r.weights) > 1]
    long = (SETTINGS.refining_starts, SETTINGS.refining_intervals)
    short = (SETTINGS.setting_off_starts, SETTINGS.setting_off_intervals)
    assert walks == ([long, short] * len(walks))[: len(walks)]
    assert looks
    for look in looks:
        assert (look.starts, look.duration.intervals) == (SETTINGS.refining_looked_at, long[1])


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"trial": 9}, ValueError, "trial = 9: must be an integer of at least 10"),
        ({"screened": 0}, ValueError, "screened = 0: must be an integer of at least 1"),
        ({"population": 2.5}, TypeError, r"population = 2\.5"),
        ({"spread": 0.0}, ValueError, r"spread = 0\.0"),
        ({"least_judged": 1.5}, ValueError, r"least_judged = 1\.5: .* at most 1"),
    ],
)
def test_settings_that_cannot_work_are_refused(changes, error, message):
    with pytest.raises(error, match=message):
        dataclasses.replace(SETTINGS, **changes)


def test_a_gait_that_lasts_only_short_walks_does_not_stay_the_best(wanted):
    one = Contender(SETTINGS, -1, wanted, (0, 0), 0.5)
    cheap, lost = CleanWalking(1.0, 0.045, 0.6), NO_WALK
    walks = [
        Schedule((Walking(4, Duration.judged_in_second_half(intervals)),), 8)
        for intervals in (100, 1000)
    ]
    for walking, gait in zip(walks, (cheap, lost), strict=True):
        search = one.evolve("race", 10, walking, None)
        request = next(search)
        for _ in range(10 if gait is cheap else 1):
            request = search.send(judged(request, wanted)._replace(gait=gait))
        with pytest.raises(StopIteration) if gait is cheap else contextlib.nullcontext():
            search.send(judged(request, wanted)._replace(gait=gait))
        assert (one.merit > 0.0) == (gait is cheap)
