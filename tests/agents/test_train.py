"""Training: the same seed gives the same policy; what it starts from; what it refuses."""

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from agents import learners
from agents.cli import train as command
from agents.policy_files import PRETRAINED, CheckpointError, load_policy, read_record
from agents.rollout import draw_starts
from agents.sb3 import learner as sb3
from agents.train import train, walking_economy
from rimless_gym import BUILDABLE, THESIS_PHYSICAL
from rimless_gym.envs.layout import observe
from tests.agents.runs import QUICK, SETTLED, STEPS, run, scalars, small, weights


@pytest.mark.parametrize("algo", ["ppo", pytest.param("sac", marks=pytest.mark.slow)])
def test_training_twice_with_one_seed_gives_the_same_policy(tmp_path, algo):
    first, second, other = (
        run(tmp_path / name, algo, seed=seed, timesteps=STEPS[algo] // 2)
        for name, seed in (("a", 1), ("b", 1), ("c", 2))
    )
    np.testing.assert_array_equal(weights(first.last), weights(second.last))
    assert not np.array_equal(weights(first.last), weights(other.last))


def test_the_best_policy_is_the_one_that_evaluates_best(tmp_path):
    scores = iter([1.0, 3.0, 2.0, *[0.0] * 20])
    result = run(tmp_path, score=lambda evaluation: next(scores))
    assert read_record(result.best)["score"] == 3.0
    assert read_record(result.best)["timesteps"] == result.evaluations[1][0]


def test_the_better_policy_walks_cheaply_and_surely():
    def score(share, cot):
        return walking_economy(SimpleNamespace(walking_share=share, cot=cot))

    best = [score(1.0, 0.05), score(0.9, 0.05), score(1.0, 0.7), score(0.5, 0.7)]
    assert best == sorted(best, reverse=True)
    assert score(0.0, np.nan) == 0.0 < min(best)
    assert score(0.98, 0.052) < score(1.0, 0.055) < score(0.98, 0.048)


def test_a_score_that_is_undefined_or_an_integer_does_not_stop_a_training(tmp_path):
    for name, score in (("nan", lambda evaluation: np.nan), ("integer", lambda evaluation: 3)):
        first = run(tmp_path / name, timesteps=256, score=score)
        assert first.best.exists()
        assert run(tmp_path / name, timesteps=512, score=score).timesteps == 512


@pytest.mark.parametrize("algo", ["ppo", pytest.param("sac", marks=pytest.mark.slow)])
def test_a_training_in_which_nothing_walks_goes_on_and_logs_no_gait(tmp_path, algo):
    settings = small(algo)
    looks = dataclasses.replace(settings.pacing, every=STEPS[algo] // 4, starts=4, seconds=0.5)
    settings = dataclasses.replace(settings, pacing=looks)
    uphill = BUILDABLE.replace(slope=-0.3)
    result = run(tmp_path, algo, settings=settings, params=uphill, protocol=SETTLED)
    assert result.timesteps == STEPS[algo]
    assert result.best.exists()
    assert {evaluation.walking_share for _, evaluation in result.evaluations} == {0.0}
    shown = scalars(tmp_path)
    assert {event.value for event in shown["pacing/share"]} == {0.0}
    assert not {"eval/cot", "eval/speed", "pacing/cot"} & set(shown)
    assert all(np.isfinite(event.value) for events in shown.values() for event in events)


@pytest.mark.parametrize("algo", ["ppo", pytest.param("sac", marks=pytest.mark.slow)])
def test_the_actor_waits_until_the_critic_has_warmed_up(tmp_path, monkeypatch, swing, algo):
    monkeypatch.setattr(sb3, "CRITIC_WARM_UP", 10.0)
    result = run(tmp_path, algo, init="imitation", expert=swing, cloning=QUICK)
    actor = learners.learner(algo).actor
    cloned, trained = (actor(load_policy(path).model) for path in (result.clone, result.last))
    for before, after in zip(cloned.weights, trained.weights, strict=True):
        assert torch.equal(before, after)
    assert not np.array_equal(weights(result.clone), weights(result.last))


def test_fine_tuning_can_start_from_a_checkpoint(tmp_path, swing):
    first = run(tmp_path / "a", init="imitation", expert=swing, cloning=QUICK, timesteps=0)
    np.testing.assert_array_equal(weights(first.clone), weights(first.best))
    second = run(tmp_path / "b", init=first.clone, timesteps=0)
    np.testing.assert_array_equal(weights(second.best), weights(first.clone))
    with pytest.raises(CheckpointError, match="cannot start sac"):
        run(tmp_path / "c", "sac", init=first.clone)
    with pytest.raises(CheckpointError, match=r"none\.zip.*check the path"):
        run(tmp_path / "d", init=tmp_path / "none.zip")


@pytest.mark.slow
def test_a_policy_of_one_learner_is_distilled_into_another(tmp_path, swing):
    teacher = run(tmp_path / "a", init="imitation", expert=swing, cloning=QUICK, timesteps=0).best
    longer = dataclasses.replace(QUICK, gradient_steps=800)
    clone = {"init": "imitation", "expert": str(teacher), "timesteps": 0, "cloning": longer}
    learned = run(tmp_path / "b", "sac", **clone).best
    seen = observe(THESIS_PHYSICAL, draw_starts(THESIS_PHYSICAL, 200, 0))
    taught, shown = (load_policy(path).act(seen) for path in (teacher, learned))
    assert np.corrcoef(taught, shown)[0, 1] > 0.9
    with pytest.raises(ValueError, match=r"init = imitation of ppo policy"):
        run(tmp_path / "b", "sac", **clone | {"expert": swing})
    with pytest.raises(CheckpointError, match="nobody: no such file"):
        run(tmp_path / "c", init="imitation", expert="nobody")


def test_an_expert_without_imitation_is_refused(tmp_path):
    with pytest.raises(ValueError, match="expert = 'pid': is imitated only with init"):
        run(tmp_path, expert="pid")


def test_numpy_integers_are_accepted_as_seed_and_number_of_steps(tmp_path, finished):
    run(tmp_path, seed=np.int64(0), timesteps=np.int32(128))
    assert json.loads((tmp_path / "train.json").read_text())["seed"] == 0
    np.testing.assert_array_equal(weights(tmp_path / "last.zip"), weights(finished / "last.zip"))


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        (
            {"seed": -1},
            ValueError,
            "seed = -1: must be an integer of at least 0 and at most 4294967295",
        ),
        ({"seed": np.int64(-3)}, ValueError, "seed = -3"),
        ({"seed": 2**32}, ValueError, "seed = 4294967296"),
        ({"seed": 1.0}, TypeError, r"seed = 1\.0: must be an integer"),
        ({"seed": True}, TypeError, "seed = True"),
        ({"seed": None}, TypeError, "seed = None"),
        ({"timesteps": -1}, ValueError, "timesteps = -1"),
        ({"timesteps": "many"}, TypeError, "timesteps = 'many'"),
    ],
)
def test_seeds_and_numbers_of_steps_out_of_range_are_refused(tmp_path, changes, error, message):
    with pytest.raises(error, match=message):
        run(tmp_path / "out", **changes)
    assert not (tmp_path / "out").exists()


def test_an_unknown_learner_is_refused_with_the_names_of_the_known_ones(tmp_path):
    known = r"algo = 'td3': choose from \['evolution', 'ppo', 'sac', 'screened_ppo'\]"
    with pytest.raises(ValueError, match=known):
        train("td3", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_training_for_commanded_speeds_sees_them_and_so_does_its_policy(tmp_path):
    result = run(tmp_path / "a", timesteps=256, speeds=(0.4, 0.6), control_period=0.02)
    found = load_policy(result.last)
    assert found.conditions.control.speeds == (0.4, 0.6)
    assert found.conditions.control.period == 0.02
    assert read_record(result.last)["task"]["distance_weight"] == 5.0
    assert len(read_record(result.last)["observation_layout"]) == 8
    assert found.act(np.zeros((3, 8), dtype=np.float32)).shape == (3,)
    again = run(tmp_path / "b", timesteps=256, speeds=(0.4, 0.6), control_period=0.02)
    np.testing.assert_array_equal(weights(result.last), weights(again.last))


def test_a_policy_for_commanded_speeds_starts_no_training_without_them(tmp_path, finished):
    commanded = run(tmp_path / "commanded", timesteps=128, speeds=(0.4, 0.6)).last
    with pytest.raises(CheckpointError, match="with a commanded speed"):
        run(tmp_path / "a", init=str(commanded))
    with pytest.raises(CheckpointError, match="without a commanded speed"):
        run(tmp_path / "b", init=str(finished / "last.zip"), speeds=(0.4, 0.6))
    with pytest.raises(CheckpointError, match="without a commanded speed"):
        run(tmp_path / "c", init="imitation", expert=str(finished / "last.zip"), speeds=(0.4, 0.6))


def test_a_policy_is_neither_distilled_nor_started_from_across_control_periods(tmp_path, finished):
    path = str(finished / "last.zip")
    with pytest.raises(CheckpointError, match=r"every 0.01 s, not every 0.04 s"):
        run(tmp_path / "a", init=path, control_period=0.04)
    with pytest.raises(CheckpointError, match=r"every 0.01 s, not every 0.04 s"):
        run(tmp_path / "b", init="imitation", expert=path, control_period=0.04)


def test_an_expert_that_does_not_fit_leaves_the_folder_free(tmp_path):
    with pytest.raises(CheckpointError, match=r"walks with a commanded speed; train with speeds"):
        run(tmp_path, init="imitation", expert="front", timesteps=0)
    with pytest.raises(ValueError, match="evolution cannot imitate"):
        run(tmp_path, "evolution", init="imitation", timesteps=0)
    assert run(tmp_path, timesteps=0).timesteps == 0


def test_a_training_that_diverges_keeps_its_last_good_state(tmp_path, monkeypatch):
    monkeypatch.setattr("agents.session.SAVE_INTERVAL", 0.0)
    usual = small("ppo")
    wild = dataclasses.replace(usual, algorithm=usual.algorithm | {"learning_rate": 1e30})
    with pytest.raises(ValueError, match=r"has diverged: after \d+ steps .* keeps what they were"):
        run(tmp_path, settings=wild)
    assert np.isfinite(weights(tmp_path / "last.zip")).all()


def test_hyperparameters_that_the_library_refuses_leave_the_folder_free(tmp_path):
    usual = learners.learner("ppo").settings("scratch")
    wrong = dataclasses.replace(usual, algorithm=usual.algorithm | {"n_steps": 16.5})
    with pytest.raises(ValueError, match=r"with the hyperparameters.*16\.5"):
        train("ppo", out=tmp_path, settings=wrong, timesteps=64, progress=False)
    assert run(tmp_path, timesteps=64).timesteps >= 64


def test_the_command_line_trains_for_the_prices_of_the_environment_with_commands(tmp_path):
    task = {"distance_weight": 0.8}
    train("ppo", out=tmp_path / "a", task=task, speeds=(0.4, 0.6), timesteps=0, progress=False)
    line = ["--task", json.dumps(task), "--speeds", "0.4", "0.6", "--timesteps", "0"]
    assert command.main([*line, "--out", str(tmp_path / "b")]) == 0
    one, other = (read_record(tmp_path / name / "last.zip")["task"] for name in "ab")
    assert one == other
    assert one["fall_penalty"] == 0.5


def test_evolution_takes_no_commanded_speeds(tmp_path):
    with pytest.raises(ValueError, match="no speed is commanded"):
        run(tmp_path, "evolution", speeds=(0.4, 0.6))


def test_settings_of_a_cloning_need_an_expert_to_clone(tmp_path):
    with pytest.raises(ValueError, match="cloning: nothing is cloned; give init = 'imitation'"):
        run(tmp_path / "new", cloning=QUICK)
    assert not (tmp_path / "new").exists()


def test_a_training_goes_on_only_with_the_cloning_that_it_began_with(tmp_path):
    expert = str(PRETRAINED["evolution"])
    arguments = {"init": "imitation", "expert": expert, "timesteps": 0, "params": BUILDABLE}
    run(tmp_path, cloning=QUICK, **arguments)
    other = dataclasses.replace(QUICK, gradient_steps=21)
    with pytest.raises(ValueError, match="gradient_steps"):
        run(tmp_path, cloning=other, **arguments)
    assert run(tmp_path, cloning=QUICK, **arguments).timesteps == 0
