"""The search for a gait, on pretended walks, and the learner that simulates them."""

import contextlib
import dataclasses
import subprocess
import sys

import numpy as np
import pytest

from agents.evaluate import SHORT_PROTOCOL, evaluate
from agents.evolution.search import (
    FAMILIES,
    SENSES,
    Answer,
    EvolutionSettings,
    EvolvingPolicy,
    Generation,
    search,
)
from agents.evolution.walks import SIZE, Duration
from agents.learner import DoesNotWalkError
from agents.policy_files import FORMAT, load_policy
from agents.reward_weight import NO_WALK, CleanWalking
from agents.training import train
from agents.training_config import TrainingConfig
from tests.agents.runs import SETTLED, assert_same_policies, killed_after, run, scalars
from trajopt.store import read_arrays, write_arrays

SETTINGS = EvolutionSettings(screened=40, retained=5, candidates=2, trial=10, finalists=1, race=10)
WANTED = np.linspace(-0.5, 0.5, SIZE)


def pretended(request):
    """Family -1 is efficient if the weights are near `WANTED`, family 0 never is."""
    off = ((request.weights - WANTED) ** 2).sum(axis=1)
    apart = {SENSES: [0, 1], FAMILIES: [0, -1]}
    known = apart.get(request.groups, [request.groups])
    scores = np.array([-off if group else -5.0 - off for group in known])
    cot = float(0.05 + off[0]) if known[0] else 0.9
    return Answer(np.array(known, float), scores, CleanWalking(1.0, cot, 0.5))


def requests(count, settings=SETTINGS, seed=0, start=None):
    running, found = search(settings, seed, 0.5, start), []
    request = next(running)
    for _ in range(count):
        found.append(request)
        request = running.send(pretended(request))
    return found


@pytest.fixture(scope="module")
def whole_search():
    return requests(400)


def test_every_family_races_and_the_most_efficient_is_refined(whole_search):
    glance, walk, *rest = whole_search
    assert len(glance.weights) == 40
    assert SETTINGS.retained <= len(walk.weights) <= 2 * SETTINGS.retained
    assert glance.duration.intervals < walk.duration.intervals
    assert (glance.groups, walk.groups) == (SENSES, FAMILIES)
    families = [request.groups for request in rest]
    assert families[0] == 0
    assert set(families) == {0, -1}
    assert set(families[-200:]) == {-1}
    # one trial of ten generations, and a check: such a family is easy to find
    assert families.index(-1) == 11


def test_more_starts_count_and_the_weight_falls_to_the_true_one(whole_search):
    counted = [request.counted for request in whole_search[2:] if len(request.weights) > 1]
    assert (counted[0], counted[-1]) == (SETTINGS.least_counted, 1.0)
    weights = [request.distance_weight for request in whole_search[-300:]]
    assert whole_search[0].distance_weight == SETTINGS.first_weight
    assert weights == sorted(weights, reverse=True)
    assert weights[-1] == 0.5


def test_long_walks_from_few_starts_and_short_ones_from_many_take_turns(whole_search):
    refining = whole_search[-100:]
    long = (SETTINGS.refining_starts, SETTINGS.refining_intervals)
    short = (SETTINGS.start_up_starts, SETTINGS.start_up_intervals)
    walks = [(r.starts, r.duration.intervals) for r in refining if len(r.weights) > 1]
    assert set(walks[::2]) | set(walks[1::2]) == {long, short}
    assert len(set(walks[::2])) == len(set(walks[1::2])) == 1
    checks = [(r.starts, r.duration.intervals) for r in refining if len(r.weights) == 1]
    assert set(checks) == {(SETTINGS.refining_checked_starts, long[1])}


def test_evolution_finds_what_is_wanted_and_the_same_again():
    settings = dataclasses.replace(SETTINGS, spread=1.0)
    one, other = requests(900, settings), requests(100, settings)
    assert np.abs(one[-1].best - WANTED).max() < 0.1
    for first, second in zip(one, other, strict=False):
        assert np.array_equal(first.weights, second.weights)
        assert first[1:-1] == second[1:-1]
    assert not np.array_equal(requests(1, settings, seed=4)[0].weights, one[0].weights)


def test_a_policy_to_start_from_is_refined_in_its_own_family():
    found = requests(30, start=WANTED + 0.01)
    assert found[0].starts == SETTINGS.checked_starts
    assert {request.groups for request in found[1:]} == {-1}


def test_a_search_that_finds_nothing_ends_with_a_remedy():
    running = search(SETTINGS, 0, 0.5, None)
    running.send(pretended(next(running)))
    with pytest.raises(DoesNotWalkError, match=r"screened = 40: none of .* another seed"):
        running.send(Answer(np.empty(0), np.empty((0, 40)), NO_WALK))
    running = search(SETTINGS, 0, 0.5, None)

    def go_on(request):
        while True:
            request = running.send(pretended(request)._replace(gait=NO_WALK))

    with pytest.raises(DoesNotWalkError, match=r"still walks after 10 generations: try"):
        go_on(next(running))


@pytest.mark.parametrize("setting", [{"trial": 9}, {"glance": 1}, {"start_up_intervals": 1}])
def test_walks_and_trials_without_a_measurement_are_refused(setting):
    with pytest.raises(ValueError, match="must be an integer of at least"):
        EvolutionSettings(**setting)


def test_a_gait_that_lasts_only_short_walks_does_not_stay_the_best():
    one = EvolvingPolicy(SETTINGS, -1, WANTED, (0, 0), 0.5)
    for intervals, gait in ((100, CleanWalking(1.0, 0.045, 0.6)), (1000, NO_WALK)):
        schedule = (Generation(4, Duration.second_half(intervals)),)
        running = one.evolve(10, schedule, 8, None)
        request = next(running)
        for _ in range(1 if gait is NO_WALK else 10):
            request = running.send(pretended(request)._replace(gait=gait))
        with contextlib.nullcontext() if gait is NO_WALK else pytest.raises(StopIteration):
            running.send(pretended(request)._replace(gait=gait))
        assert (one.score > 0.0) == (gait is not NO_WALK)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A training that nothing disturbed; not to be changed."""
    return run(tmp_path_factory.mktemp("whole"), "evolution")


def test_killed_and_resumed_it_ends_with_the_same_policy(tmp_path, monkeypatch, whole):
    killed_after(30, monkeypatch, lambda: run(tmp_path, "evolution"))
    assert_same_policies(run(tmp_path, "evolution"), whole)
    shown = scalars(tmp_path)
    wanted = {"evolution/distance_weight", "evolution/family", "evolution/score", "eval/objective"}
    assert wanted <= set(shown)


def test_begun_from_a_policy_that_does_not_walk_it_goes_on_and_logs_no_gait(tmp_path, whole):
    record, _ = read_arrays(whole.last, FORMAT, ValueError, "")
    idle = 1e-3 * np.random.default_rng(0).normal(size=SIZE)
    write_arrays(tmp_path / "idle.zip", FORMAT, record, {"weights": idle})
    begun = {"init": str(tmp_path / "idle.zip"), "timesteps": 200_000, "protocol": SETTLED}
    result = run(tmp_path / "out", "evolution", **begun)
    assert {each.walking_share for each in result.curve} == {0.0}
    shown = scalars(tmp_path / "out")
    assert not {"eval/cot", "eval/speed", "walk/cot"} & set(shown)


def test_a_shipped_policy_walks_without_what_only_learning_needs():
    code = (
        "import sys; sys.modules.update(cma=None, torch=None, stable_baselines3=None)\n"
        "from agents import load_policy; import numpy as np\n"
        "print(load_policy('evolution').act(np.zeros((1, 6), np.float32)).shape)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "(1,)\n"


@pytest.mark.slow
def test_from_nothing_it_walks_from_most_starts_without_slipping(tmp_path):
    config = TrainingConfig(
        "evolution",
        timesteps=150_000_000,
        hyperparameters={"screened": 4000, "candidates": 3},
        protocol=SHORT_PROTOCOL,
    )
    walk = evaluate(load_policy(train(config, tmp_path).best).policy, protocol=SHORT_PROTOCOL)
    assert walk.walking_share > 0.6
    assert walk.cot < 1.0
