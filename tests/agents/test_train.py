import errno
import json
import os
import shutil
import signal

import gymnasium as gym
import numpy as np
import pytest
import torch
from agents.callbacks import LogWalking, SaveState
from agents.checkpoint import CheckpointError, load_policy, read_record, save_policy
from agents.hyperparameters import hyperparameters
from agents.imitate import Cloning, actor_of
from agents.resumption import FORMAT, StateError, load_state
from agents.training_env import training_env
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from agents import train as training
from agents.evaluate import Protocol
from agents.folder import sole_user
from agents.train import train
from agents.trees import to_arrays
from rimless_gym import PROTOTYPE, THESIS_PHYSICAL, Task
from trajopt.files import read_arrays, write_arrays

BRIEF = Protocol(starts=4, seed=1, duration=1.0, window=0.5, alive=0.5)
QUICK = Cloning(
    rounds=1, expert_starts=10, seconds=0.5, gradient_steps=20, batch_size=64, gait_labels=50
)
STEPS = {"ppo": 512, "sac": 160}


@pytest.fixture(autouse=True)
def small(monkeypatch):
    shrink(monkeypatch)


def shrink(monkeypatch):
    """Two environments and short roll-outs, all else as published."""

    def smaller(algo, imitation):
        settings = hyperparameters(algo, imitation)
        changes = {"n_steps": 64, "batch_size": 64} if algo == "ppo" else {"learning_starts": 50}
        changes |= {} if algo == "ppo" else {"buffer_size": 2000}
        return type(settings)(
            2, 512, settings.reward_scale, settings.algorithm | changes, settings.written
        )

    monkeypatch.setattr(training, "hyperparameters", smaller)


def run(out, algo="ppo", **changes):
    arguments = {"timesteps": STEPS[algo], "protocol": BRIEF, "progress": False} | changes
    return train(algo, out=out, **arguments)


def weights(path):
    policy = load_policy(path).model.policy
    return torch.cat([p.detach().ravel() for p in policy.parameters()]).numpy()


def scalars(folder):
    events = EventAccumulator(str(folder)).Reload()
    return {tag: events.Scalars(tag) for tag in events.Tags()["scalars"]}


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_training_twice_with_one_seed_gives_the_same_policy(tmp_path, algo):
    first, second, other = (
        run(tmp_path / name, algo, seed=seed) for name, seed in (("a", 1), ("b", 1), ("c", 2))
    )
    np.testing.assert_array_equal(weights(first.last), weights(second.last))
    assert not np.array_equal(weights(first.last), weights(other.last))


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_tensorboard_shows_return_cost_of_transport_speed_steps_and_energies(tmp_path, algo):
    run(tmp_path, algo)
    shown = scalars(tmp_path)
    wanted = {"walk/return", "walk/speed", "walk/steps", "walk/falls", "eval/walking_share"}
    wanted |= {f"energy/{name}" for name in ("copper", "collision", "electrical", "friction")}
    assert wanted <= set(shown)
    assert all(np.isfinite(event.value) for tag in wanted for event in shown[tag])


def test_what_is_logged_are_ratios_of_sums_of_the_infos():
    def info(distance, energy):
        rest = dict.fromkeys(("copper", "friction", "drag", "collision", "shaft", "idle"), 0.0)
        rest |= {"electrical": 0.0, "reward_distance": 0.5 * distance, "reward_energy": -0.1}
        rest |= {"reward_end": 0.0, "steps": 1, "elapsed": 0.01, "failure": 0}
        return rest | {"distance": distance, "electrical_positive": energy}

    seen = {}

    class Logger:
        def record(self, name, value):
            seen[name] = value

        def dump(self, step):
            pass

    callback = LogWalking(THESIS_PHYSICAL)
    callback.model = type("Model", (), {"logger": Logger(), "num_timesteps": 2})()
    callback.locals = {"infos": [info(0.01, 1.0), info(0.03, 0.2)]}
    callback.on_step()
    callback.on_training_end()
    assert seen["walk/cot"] == pytest.approx(1.2 / (THESIS_PHYSICAL.weight * 0.04))
    assert seen["walk/speed"] == pytest.approx(2.0)
    assert seen["walk/return"] == pytest.approx((0.5 * 0.04 - 0.2) / 2 * 2000)


@pytest.mark.parametrize("algo", ["ppo", "sac"])
@pytest.mark.parametrize("rollouts", [1, 4])
def test_a_training_that_was_stopped_ends_with_the_same_policies(
    tmp_path, monkeypatch, algo, rollouts
):
    whole = run(tmp_path / "whole", algo, timesteps=2 * STEPS[algo])
    begun = SaveState._on_rollout_start
    seen = []

    def ask(self):
        seen.append(self.num_timesteps)
        if len(seen) > rollouts:
            signal.raise_signal(signal.SIGTERM if algo == "sac" else signal.SIGINT)
        begun(self)

    monkeypatch.setattr(SaveState, "_on_rollout_start", ask)
    broken = run(tmp_path / "broken", algo, timesteps=2 * STEPS[algo])
    monkeypatch.setattr(SaveState, "_on_rollout_start", begun)
    assert broken.interrupted
    assert broken.timesteps == seen[-1] < whole.timesteps
    assert read_record(broken.last)["timesteps"] == broken.timesteps
    resumed = run(tmp_path / "broken", algo, timesteps=2 * STEPS[algo])
    assert (resumed.interrupted, resumed.timesteps) == (False, whole.timesteps)
    for policy in ("best", "last"):
        np.testing.assert_array_equal(
            weights(getattr(resumed, policy)), weights(getattr(whole, policy))
        )


def test_what_was_logged_after_the_last_state_is_logged_once(tmp_path, monkeypatch):
    learned = LogWalking._on_step

    def killed(self):
        if self.num_timesteps > 400:
            raise SystemExit
        return learned(self)

    monkeypatch.setattr(LogWalking, "_on_step", killed)
    monkeypatch.setattr(training, "EVALUATIONS", 2)  # and so few states
    monkeypatch.setattr("agents.callbacks.LOG_INTERVALS", 1)
    with pytest.raises(SystemExit):
        run(tmp_path)
    monkeypatch.setattr(LogWalking, "_on_step", learned)
    run(tmp_path)
    steps = [event.step for event in scalars(tmp_path)["walk/return"]]
    assert steps == [128, 256, 384, 512]


def test_a_training_killed_while_its_state_is_written_goes_on_from_the_one_before(
    tmp_path, monkeypatch
):
    whole = run(tmp_path / "whole")
    replaced, states = os.replace, []

    def killed(source, target):
        if str(target).endswith("state.npz"):
            states.append(target)
            if len(states) == 2:
                raise SystemExit  # as it stands, half written beside the last one
        replaced(source, target)

    monkeypatch.setattr(os, "replace", killed)
    with pytest.raises(SystemExit):
        run(tmp_path / "killed")
    monkeypatch.setattr(os, "replace", replaced)
    resumed = run(tmp_path / "killed")
    np.testing.assert_array_equal(weights(resumed.last), weights(whole.last))


def test_a_full_disk_ends_a_training_with_its_last_state_kept(tmp_path, monkeypatch):
    whole = run(tmp_path / "whole")
    written, count = np.savez_compressed, []

    def full(file, **arrays):
        count.append(file)
        if len(count) > 5:
            file.write(b"half of it")
            raise OSError(errno.ENOSPC, "No space left on device")
        written(file, **arrays)

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(OSError, match="No space left"):
        run(tmp_path / "full")
    assert not list((tmp_path / "full").glob("*.part"))
    monkeypatch.setattr(np, "savez_compressed", written)
    resumed = run(tmp_path / "full")
    np.testing.assert_array_equal(weights(resumed.last), weights(whole.last))


def test_the_third_ctrl_c_stops_at_once_and_tells_what_is_kept(tmp_path, monkeypatch):
    learned = LogWalking._on_step

    def hammer(self):
        if self.num_timesteps == 200:
            for _ in range(3):
                signal.raise_signal(signal.SIGINT)
        return learned(self)

    monkeypatch.setattr(LogWalking, "_on_step", hammer)
    broken = run(tmp_path)
    assert broken.interrupted
    assert broken.timesteps == read_record(broken.last)["timesteps"] == 128
    monkeypatch.setattr(LogWalking, "_on_step", learned)
    assert not run(tmp_path).interrupted


def test_two_processes_do_not_train_in_one_folder(folder):
    with sole_user(folder), pytest.raises(ValueError, match=r"another process works in .*--out"):
        run(folder)


def test_a_training_that_is_over_is_left_alone_unless_more_is_asked_for(folder):
    before = (folder / "state.npz").read_bytes()
    again = run(folder, timesteps=128)
    assert (again.timesteps, again.evaluations) == (128, ())
    assert (folder / "state.npz").read_bytes() == before
    assert run(folder, timesteps=256).timesteps == 256


def test_a_folder_with_another_training_is_not_touched(folder):
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(ValueError, match=r"seed = 0, not 1: go on with the same, or .* --out"):
        run(folder, seed=1)
    with pytest.raises(ValueError, match="params"):
        run(folder, params=PROTOTYPE)
    with pytest.raises(ValueError, match="algo = ppo, not sac"):
        run(folder, "sac")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A short PPO training that is over; copy it before changing it."""
    with pytest.MonkeyPatch.context() as patch:
        shrink(patch)
        out = tmp_path_factory.mktemp("finished")
        run(out, timesteps=128)
    return out


@pytest.fixture
def folder(finished, tmp_path):
    return shutil.copytree(finished, tmp_path / "training")


def test_policies_without_a_record_of_their_training_are_not_overwritten(folder):
    (folder / "train.json").unlink()
    (folder / "state.npz").unlink()
    before = {name: (folder / name).read_bytes() for name in ("best.zip", "last.zip")}
    for kept in (("best.zip", "last.zip"), ("best.zip",), ("last.zip",)):
        for name, content in before.items():
            (folder / name).unlink(missing_ok=True)
            if name in kept:
                (folder / name).write_bytes(content)
        with pytest.raises(ValueError, match=rf"{' and '.join(kept)} but no train\.json.*--out"):
            run(folder)
        assert all((folder / name).read_bytes() == before[name] for name in kept)


@pytest.mark.parametrize("text", ["", "{", "null", "[]", "\xff", "[" * 100_000])
def test_a_damaged_record_of_a_training_is_named(folder, text):
    (folder / "train.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(ValueError, match=r"train\.json: damaged.*cannot go on.*--out"):
        run(folder)


@pytest.mark.parametrize("content", [b"", b"garbage", b"\x80\x04garbage" * 9])
def test_a_damaged_state_is_named_with_the_remedy(folder, content):
    (folder / "state.npz").write_bytes(content)
    with pytest.raises(StateError, match=r"state\.npz: damaged.*delete it.*--out"):
        run(folder)


@pytest.mark.parametrize(
    ("part", "content", "message"),
    [
        ("parameters", "stranger.zip", "parameters are a str"),
        ("counters", {"dict": [["policy", 3]]}, "counters.*policy"),
    ],
)
def test_a_signed_state_of_other_parts_is_refused(folder, part, content, message):
    header, arrays = read_arrays(folder / "state.npz", FORMAT, StateError, "")
    [[_, model]] = [pair for pair in header["tree"]["dict"] if pair[0] == "model"]
    [pair] = [pair for pair in model["dict"] if pair[0] == part]
    pair[1] = content
    write_arrays(folder / "state.npz", FORMAT, {"tree": header["tree"]}, arrays)
    with pytest.raises(StateError, match=message):
        run(folder, timesteps=256)


@pytest.mark.parametrize("name", ["best.zip", "last.zip"])
def test_a_training_whose_policies_are_missing_does_not_go_on(folder, name):
    (folder / name).unlink()
    with pytest.raises(ValueError, match=rf"{name} is missing: put it back, or remove"):
        run(folder)


def test_a_state_of_another_training_is_refused(folder, tmp_path):
    run(tmp_path / "other", seed=1, timesteps=128)
    shutil.copyfile(tmp_path / "other" / "state.npz", folder / "state.npz")
    with pytest.raises(StateError, match=r"state\.npz: .*of another training"):
        run(folder, timesteps=256)


@pytest.mark.parametrize(
    "notes",
    [
        {"standing": {"best": "high"}},
        {"standing": {"due": "soon"}},
        {"standing": {"logged": [1]}},
        {"standing": {"much": 1}},
        {"standing": 3},
        {"policy_kwargs": 3},
        {"policy_kwargs": {"net_arch": "wide"}},
    ],
)
def test_a_signed_state_of_the_wrong_kind_is_named(folder, notes):
    tree = load_state(folder / "state.npz")
    plain, arrays = to_arrays(tree | {"notes": tree["notes"] | notes})
    write_arrays(folder / "state.npz", FORMAT, {"tree": plain}, arrays)
    with pytest.raises(StateError, match=r"state\.npz: .*remove .* to train anew"):
        run(folder, timesteps=256)


def test_a_request_in_the_last_moments_is_not_lost(tmp_path, monkeypatch):
    ended = LogWalking._on_training_end

    def ask(self):
        signal.raise_signal(signal.SIGTERM)
        ended(self)

    monkeypatch.setattr(LogWalking, "_on_training_end", ask)
    result = run(tmp_path)
    assert (result.interrupted, result.timesteps) == (True, STEPS["ppo"])
    assert not run(tmp_path).interrupted


def test_a_clone_is_kept_until_the_training_has_a_state(tmp_path, swing, monkeypatch):
    whole = run(tmp_path / "whole", init="imitation", expert=swing, cloning=QUICK)

    def killed(*arguments):
        raise SystemExit

    monkeypatch.setattr(training, "save_state", killed)
    with pytest.raises(SystemExit):
        run(tmp_path / "killed", init="imitation", expert=swing, cloning=QUICK)
    monkeypatch.undo()
    shrink(monkeypatch)

    def never(x, mode):
        raise AssertionError("the expert is asked again")

    resumed = run(tmp_path / "killed", init="imitation", expert=never, cloning=QUICK)
    np.testing.assert_array_equal(weights(resumed.last), weights(whole.last))
    assert not (tmp_path / "killed" / "cloning.npz").exists()


def test_a_policy_to_start_from_is_known_by_its_weights(tmp_path, swing):
    first = run(tmp_path / "a", init="imitation", expert=swing, cloning=QUICK, timesteps=0)
    run(tmp_path / "b", init=first.clone, timesteps=0)
    loaded = load_policy(first.clone)
    note = {"note": "made by another revision"}
    save_policy(tmp_path / "c.zip", loaded.model, loaded.params, loaded.task, 0, **note)
    run(tmp_path / "b", init=tmp_path / "c.zip", timesteps=0)
    with pytest.raises(ValueError, match="with init = ppo policy"):
        run(tmp_path / "b", timesteps=0)


def test_a_record_with_an_entry_missing_is_another_training(folder):
    notes = json.loads((folder / "train.json").read_text())
    del notes["task"]
    (folder / "train.json").write_text(json.dumps(notes))
    with pytest.raises(ValueError, match="task = None"):
        run(folder)


def test_a_training_killed_before_its_first_state_begins_anew(folder, finished):
    (folder / "state.npz").unlink()
    run(folder, timesteps=128)
    np.testing.assert_array_equal(weights(folder / "last.zip"), weights(finished / "last.zip"))


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("precious")
    with pytest.raises(ValueError, match=r"is a file: choose a folder"):
        run(tmp_path / "file")
    assert (tmp_path / "file").read_text() == "precious"


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


def test_a_seed_of_numpy_is_as_good(tmp_path, finished):
    run(tmp_path, seed=np.int64(0), timesteps=np.int32(128))
    assert json.loads((tmp_path / "train.json").read_text())["seed"] == 0
    np.testing.assert_array_equal(weights(tmp_path / "last.zip"), weights(finished / "last.zip"))


def test_the_best_policy_is_the_one_that_evaluates_best(tmp_path):
    scores = iter([1.0, 3.0, 2.0, *[0.0] * 20])
    result = run(tmp_path, score=lambda evaluation: next(scores))
    assert read_record(result.best)["score"] == 3.0
    assert read_record(result.best)["timesteps"] == result.evaluations[1][0]


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_the_actor_waits_until_the_critic_has_warmed_up(tmp_path, monkeypatch, swing, algo):
    monkeypatch.setattr(training, "CRITIC_WARM_UP", 10.0)
    result = run(tmp_path, algo, init="imitation", expert=swing, cloning=QUICK)
    cloned, trained = (load_policy(path).model for path in (result.clone, result.last))
    for before, after in zip(actor_of(cloned)[1], actor_of(trained)[1], strict=True):
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


def test_rewards_are_scaled_for_the_learner_only():
    plain, scaled = (training_env(1, THESIS_PHYSICAL, Task(), 3, scale) for scale in (1.0, 100.0))
    for env in (plain, scaled):
        env.reset()
    action = np.full((1, 1), 0.7, dtype=np.float32)
    (_, small, _, infos), (_, large, _, _) = plain.step(action), scaled.step(action)
    assert large[0] == pytest.approx(100 * small[0])
    terms = ("reward_distance", "reward_energy", "reward_end")
    assert small[0] == pytest.approx(sum(infos[0][name] for name in terms))


@pytest.mark.parametrize("voltage", [0.0, 1.0])
def test_an_episodes_last_observation_and_the_reason_of_its_end_reach_the_learner(voltage):
    # At rest time runs out, and under full voltage the wheel falls: compared with the plain
    # environment, which no vector environment resets.
    vector = training_env(3, THESIS_PHYSICAL, Task(), 4)
    alone = [gym.make("RimlessWheel-v0", params=THESIS_PHYSICAL, task=Task()) for _ in range(3)]
    first = np.array([env.reset(seed=4 + i)[0] for i, env in enumerate(alone)])
    np.testing.assert_array_equal(vector.reset(), first)
    running, reasons = {0, 1, 2}, []
    while running:
        seen, _, dones, infos = vector.step(np.full((3, 1), voltage, dtype=np.float32))
        for i in sorted(running):
            last, _, terminated, truncated, _ = alone[i].step(np.array([voltage], np.float32))
            assert dones[i] == (terminated or truncated)
            assert infos[i]["TimeLimit.truncated"] == (truncated and not terminated)
            if not dones[i]:
                np.testing.assert_array_equal(seen[i], last)
                continue
            np.testing.assert_array_equal(infos[i]["terminal_observation"], last)
            np.testing.assert_array_equal(seen[i], alone[i].reset()[0])
            assert not np.array_equal(seen[i], last)
            reasons.append("time" if truncated else "fall")
            running.remove(i)
    assert ("fall" if voltage else "time") in reasons


def test_unknown_algorithms_are_refused_with_the_choice():
    with pytest.raises(ValueError, match=r"algo = 'td3': choose from \['ppo', 'sac'\]"):
        hyperparameters("td3", False)
