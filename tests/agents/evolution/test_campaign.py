from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from agents.evolution.campaign import LOOKED_AT, Answer, EvolutionSettings, campaign
from agents.evolution.policy import SIZE
from agents.evolution.worth import Gait

SETTINGS = EvolutionSettings(screened=40, contenders=2, rescreened=5, race=10, longer_race=10)


def judged(request, wanted):
    """Pretended walks: family -1 is cheap if the weights are near `wanted`, family 0 never is."""
    off = ((request.weights - wanted) ** 2).sum(axis=1)
    known = [0, -1] if request.family is None else [request.family]
    worth = np.array([-off if family else -5.0 - off for family in known])
    cot = float(0.05 + off[0]) if known[0] else 0.9
    return Answer(np.array(known, float), worth, Gait(1.0, cot, 0.5))


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
    assert stages == ["screen", "race +0", "race -1", "refine"]
    assert {r.family for r in requests if r.stage == "refine"} == {-1}
    screens = [request for request in requests if request.stage == "screen"]
    assert [len(request.weights) for request in screens] == [40, 5, 5]


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
    assert requests[0].starts == LOOKED_AT
    assert requests[-1].family == -1


def test_a_machine_on_which_nothing_walks_ends_the_campaign_with_a_remedy():
    search = campaign(SETTINGS, 0, 0.5, None)
    next(search)
    nothing = Answer(np.empty(0), np.empty((0, 40)), Gait(0.0, np.inf, 0.0))
    with pytest.raises(RuntimeError, match=r"none of 40 random policies walks .* screen more"):
        search.send(nothing)
