"""The native vector environment: rows that are the single environment, and Gymnasium's contract."""

from __future__ import annotations

import copy
import hashlib
import os
import pickle
import subprocess
import sys
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from rimless_gym import (
    PROTOTYPE,
    THESIS_PHYSICAL,
    Disturbances,
    Pushes,
    RimlessWheelVectorEnv,
    SensorNoise,
    Task,
)
from rimless_gym.envs.fleet import LEAST_ROWS
from rimless_gym.envs.task import EPISODE_STEPS
from rimless_gym.hybrid import FAILURES, MODE_NAMES

NEXT, SAME, DISABLED = (
    AutoresetMode.NEXT_STEP,
    AutoresetMode.SAME_STEP,
    AutoresetMode.DISABLED,
)
ROUGH: dict[str, Any] = {
    "ranges": {"slope": (-0.03, 0.03), "pendulum_mass": (2.0, 2.4), "idle_power": (0.0, 2.0)},
    "disturbances": Disturbances(
        pushes=Pushes(rate=5.0, impulse=(0.1, 1.5)),
        sensor_noise=SensorNoise(leg_angle=0.01, pendulum_angle=0.02, leg_rate=0.1),
        actuator_delay=(0, 3),
    ),
}


def make(n: int, mode: AutoresetMode = NEXT, **settings: Any) -> RimlessWheelVectorEnv:
    envs = gym.make_vec("RimlessWheel-v0", num_envs=n, autoreset_mode=mode, **settings)
    assert isinstance(envs, RimlessWheelVectorEnv)
    return envs


def swinging(n: int, steps: int, seed: int = 0, hold: int = 20) -> np.ndarray:
    """Random actions (steps, n, 1), held so long that wheels fall."""
    rng = np.random.default_rng(seed)
    levels = rng.uniform(-1.2, 1.2, (-(-steps // hold), n, 1)).astype(np.float32)
    return np.repeat(levels, hold, axis=0)[:steps]


def row_of(info: dict[str, Any], i: int) -> dict[str, Any]:
    """One row of a dense info, named as the single environment names it."""
    one = {name: values[i] for name, values in info.items() if not name.startswith(("_", "final"))}
    one["mode"] = MODE_NAMES[one["mode"]]
    if "failure" in one:
        one["failure"] = FAILURES.get(int(one["failure"]))
    return one


class Singles:
    """Single environments in a row, reset by hand as each autoreset mode asks for."""

    def __init__(self, n: int, seed: int, **settings: Any) -> None:
        self.envs = [gym.make("RimlessWheel-v0", **settings) for _ in range(n)]
        self.first = [env.reset(seed=seed + i) for i, env in enumerate(self.envs)]
        self.ended = [False] * n
        self.ends = {"terminated": 0, "truncated": 0}

    def step(self, i: int, action: np.ndarray) -> tuple:
        *what, terminated, truncated, info = self.envs[i].step(action)
        self.ended[i] = terminated or truncated
        self.ends["terminated"] += terminated
        self.ends["truncated"] += truncated
        return *what, terminated, truncated, info

    def reset(self, i: int) -> tuple[np.ndarray, str]:
        self.ended[i] = False
        seen, info = self.envs[i].reset()
        return seen, info["mode"]


@pytest.mark.parametrize("settings", [{}, ROUGH], ids=["plain", "rough"])
@pytest.mark.parametrize("n", [1, 3, 16, 50, 100])
@pytest.mark.parametrize("mode", [NEXT, SAME, DISABLED], ids=lambda mode: mode.value)
def test_every_row_is_the_single_environment_to_the_last_bit(
    mode: AutoresetMode, n: int, settings: dict
) -> None:
    steps, settings = 1200 // n if n < 16 else 300, settings | {"max_episode_steps": 120}
    envs, singles = make(n, mode, **settings), Singles(n, 11, **settings)
    seen, info = envs.reset(seed=11)
    assert np.array_equal(seen, [first for first, _ in singles.first])
    assert [MODE_NAMES[code] for code in info["mode"]] == [i["mode"] for _, i in singles.first]
    for actions in swinging(n, steps):
        if mode is DISABLED and any(singles.ended):
            mask = np.array(singles.ended)
            seen, info = envs.reset(options={"reset_mask": mask})
            for i in np.flatnonzero(mask):
                expected, mode_name = singles.reset(i)
                assert np.array_equal(seen[i], expected)
                assert MODE_NAMES[info["mode"][i]] == mode_name
        seen, rewards, terminated, truncated, info = envs.step(actions)
        for i in range(n):
            if singles.ended[i]:  # left over from the last step: mode is NEXT
                expected, mode_name = singles.reset(i)
                assert np.array_equal(seen[i], expected)
                assert MODE_NAMES[info["mode"][i]] == mode_name
                assert (rewards[i], terminated[i], truncated[i]) == (0.0, False, False)
                assert info["elapsed"][i] == info["failure"][i] == 0
                continue
            expected, *others, one = singles.step(i, actions[i])
            assert [rewards[i], terminated[i], truncated[i]] == others
            transition = info
            if mode is SAME and singles.ended[i]:
                assert info["_final_obs"][i]
                assert info["_final_info"][i]
                assert np.array_equal(info["final_obs"][i], expected)
                transition = info["final_info"]
                expected, mode_name = singles.reset(i)
                assert MODE_NAMES[info["mode"][i]] == mode_name
            elif mode is SAME and "_final_obs" in info:
                assert not info["_final_obs"][i]
                assert not info["_final_info"][i]
            assert np.array_equal(seen[i], expected)
            assert row_of(transition, i) == one
    assert singles.ends["truncated"] > 0
    assert singles.ends["terminated"] > 0


@pytest.mark.parametrize("settings", [{}, ROUGH], ids=["plain", "rough"])
def test_neither_threads_nor_the_other_rows_change_a_row(settings: dict) -> None:
    n = 2 * LEAST_ROWS + 37
    actions = swinging(n, 60)

    def run(rows: slice, **threads: Any) -> list[np.ndarray]:
        envs = make(len(range(n)[rows]), **settings, **threads, max_episode_steps=40)
        out = [envs.reset(seed=list(range(n))[rows])[0]]
        for chosen in actions:
            seen, rewards, terminated, truncated, info = envs.step(chosen[rows])
            out += [seen, rewards, terminated, truncated, info["electrical"], info["mode"]]
        envs.close()
        return out

    alone = run(slice(None))
    for threads in (2, 3):
        for one, other in zip(alone, run(slice(None), num_threads=threads), strict=True):
            assert np.array_equal(one, other)
    part = slice(5, 5 + 3)
    for one, other in zip(alone, run(part), strict=True):
        assert np.array_equal(one[part], other)


PROGRAM = """
import hashlib, sys
sys.path.insert(0, {tests!r})
from test_vector_env import digest
print(digest())
"""


def digest() -> str:
    envs, value = make(7, **ROUGH, max_episode_steps=50), hashlib.sha256()
    value.update(envs.reset(seed=3)[0].tobytes())
    for actions in swinging(7, 150):
        for part in envs.step(actions)[:4]:
            value.update(part.tobytes())
    return value.hexdigest()


def test_another_process_sees_the_same_episodes() -> None:
    code = PROGRAM.format(tests=os.path.dirname(__file__))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == digest()


def test_nothing_that_is_returned_is_shared_with_anything_else() -> None:
    envs = make(4, SAME, max_episode_steps=3)
    kept = [envs.reset(seed=0)[0]]
    for actions in swinging(4, 7):
        seen, rewards, terminated, truncated, info = envs.step(actions)
        kept += [seen, rewards, terminated, truncated]
        flat = dict(info)
        final = flat.pop("final_info", {})
        kept += [*flat.values(), *final.values()]
    before = [array.copy() for array in kept]
    for array in kept:
        array.flags.writeable = True
    for k, array in enumerate(kept):
        array[...] = 1  # reaches no other array, nor the environment
        before[k][...] = 1
        assert all(np.array_equal(a, b) for a, b in zip(kept, before, strict=True))
    other = make(4, SAME, max_episode_steps=3)
    other.reset(seed=0)
    for actions in swinging(4, 7):
        other.step(actions)
    assert np.array_equal(envs.step(swinging(4, 1)[0])[0], other.step(swinging(4, 1)[0])[0])


def test_the_spaces_and_metadata_are_those_that_gymnasium_asks_for() -> None:
    envs = make(3, SAME)
    assert envs.metadata["autoreset_mode"] is SAME
    assert RimlessWheelVectorEnv.metadata["autoreset_mode"] is NEXT
    seen, _ = envs.reset(seed=0)
    assert seen in envs.observation_space
    assert envs.observation_space.shape == (3, *envs.single_observation_space.shape)
    envs.action_space.seed(0)
    seen, rewards, terminated, truncated, _ = envs.step(envs.action_space.sample())
    assert seen in envs.observation_space
    assert rewards.dtype == np.float64
    assert terminated.dtype == truncated.dtype == np.bool_
    assert envs.spec is not None
    assert envs.max_episode_steps == EPISODE_STEPS


@pytest.mark.parametrize("wrapper", ["RecordEpisodeStatistics", "DictInfoToList"])
@pytest.mark.parametrize("mode", [NEXT, SAME], ids=lambda mode: mode.value)
def test_gymnasiums_wrappers_understand_it(wrapper: str, mode: AutoresetMode) -> None:
    envs = getattr(gym.wrappers.vector, wrapper)(make(3, mode, max_episode_steps=30))
    envs.reset(seed=0)
    lengths = []
    for actions in swinging(3, 100):
        info = envs.step(actions)[-1]
        if wrapper == "DictInfoToList":
            assert isinstance(info[0]["distance"], float)
        elif "episode" in info:
            lengths += info["episode"]["l"][info["_episode"]].tolist()
    assert wrapper == "DictInfoToList" or max(lengths) == 30


def test_seeds_may_be_one_per_row_and_none_goes_on_drawing() -> None:
    envs, one = make(3), make(1)
    first, _ = envs.reset(seed=[7, 3, 7])
    assert np.array_equal(first[0], first[2])
    assert np.array_equal(first[1], one.reset(seed=3)[0][0])
    again, _ = envs.reset(seed=[None, 3, None])
    assert np.array_equal(again[1], first[1])
    assert not np.array_equal(again[0], first[0])
    assert np.array_equal(again[0], again[2])
    assert envs.np_random_seed == (7, 3, 7)
    assert len(envs.np_random) == 3
    with pytest.raises(ValueError, match="2 seeds for 3 rows"):
        envs.reset(seed=[1, 2])


def test_resets_by_mask_leave_the_other_rows_and_the_callers_options_alone() -> None:
    envs = make(4, DISABLED, **ROUGH)
    envs.reset(seed=0)
    for actions in swinging(4, 5):
        before = envs.step(actions)[0]
    states, options = envs.states, {"reset_mask": np.array([False, True, False, True])}
    after, _ = envs.reset(seed=[None, 5, None, None], options=options)
    assert list(options) == ["reset_mask"]
    assert np.array_equal(after[[0, 2]], before[[0, 2]])
    assert np.array_equal(envs.states[[0, 2]], states[[0, 2]])
    assert not np.any(np.all(after[[1, 3]] == before[[1, 3]], axis=1))
    twin = make(2, **ROUGH)
    assert np.array_equal(after[1], twin.reset(seed=[5, 0])[0][0])


@pytest.mark.parametrize(
    ("mask", "error", "message"),
    [
        ([True, False], TypeError, "NumPy array of bool"),
        (np.array([1, 0]), TypeError, "NumPy array of bool"),
        (np.array([True]), ValueError, "shape"),
        (np.array([False, False]), ValueError, "mark a row"),
    ],
)
def test_masks_that_mean_nothing_are_refused(mask: Any, error: type, message: str) -> None:
    envs = make(2)
    envs.reset(seed=0)
    with pytest.raises(error, match=message):
        envs.reset(options={"reset_mask": mask})


def test_rows_may_differ_in_machine_and_start() -> None:
    uphill = THESIS_PHYSICAL.replace(slope=-0.02)
    starts = [[1.4, 0.3, 1.0, 2.0], [1.6, 0.0, 0.0, 0.0], PROTOTYPE.constants.a * np.eye(4)[0]]
    options = {
        "params": [THESIS_PHYSICAL, uphill, PROTOTYPE],
        "state": starts,
        "mode": ["single_stance", "single_stance", "double_stance"],
    }
    envs = make(3)
    seen, info = envs.reset(seed=0, options=options)
    assert envs.params == (THESIS_PHYSICAL, uphill, PROTOTYPE)
    assert envs.states[:, :4] == pytest.approx(np.array(starts))
    assert info["mode"].tolist() == [0, 0, 1]
    for i in range(3):
        one = gym.make("RimlessWheel-v0", params=options["params"][i])
        first, _ = one.reset(options={"state": starts[i], "mode": options["mode"][i]})
        assert np.array_equal(first, seen[i])
    actions = swinging(3, 1)[0]
    after, *_ = envs.step(actions)
    assert np.array_equal(after[2], one.step(actions[2])[0])
    only, _ = envs.reset(
        options={"params": uphill, "reset_mask": np.array([True, False, False])},
    )
    assert envs.params == (uphill, uphill, PROTOTYPE)
    assert np.array_equal(only[1:], after[1:])


def test_a_reset_of_some_rows_keeps_what_was_drawn_for_the_others() -> None:
    envs = make(3, ranges={"slope": (-0.05, 0.05)})
    envs.reset(seed=0)
    slopes = [machine.slope for machine in envs.params]
    assert len(set(slopes)) == 3
    mask = np.array([False, True, False])
    envs.reset(options={"reset_mask": mask, "params": PROTOTYPE})
    now = [machine.slope for machine in envs.params]
    assert now[0] == slopes[0]
    assert now[1] != slopes[1]
    assert [machine.pendulum_mass for machine in envs.params].count(PROTOTYPE.pendulum_mass) == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sate": 0}, "unknown reset option 'sate'"),
        ({"params": [THESIS_PHYSICAL]}, "1 machines for 3 rows"),
        ({"state": np.zeros((2, 4))}, "2 states for 3 rows"),
        ({"state": [1.5, 0, 0, 0], "mode": ["single_stance"]}, "1 modes for 3 rows"),
        ({"ranges": {"slope": (0, 2)}}, "slope = 2"),
        (
            {"ranges": {}, "reset_mask": np.array([True, False, False])},
            "'ranges' holds for all rows",
        ),
    ],
)
def test_a_refused_reset_changes_nothing(options: dict, message: str) -> None:
    envs, twin = make(3), make(3)
    for each in (envs, twin):
        each.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        envs.reset(seed=8, options=options)
    assert envs.params == twin.params
    assert np.array_equal(envs.states, twin.states)
    assert np.array_equal(envs.reset()[0], twin.reset()[0])  # nor the generators


def test_wrong_actions_are_refused_by_row_and_change_nothing() -> None:
    envs = make(3)
    envs.reset(seed=0)
    states = envs.states
    actions = np.zeros((3, 1), np.float32)
    actions[[0, 2]] = np.nan
    with pytest.raises(ValueError, match=r"rows \[0, 2\] are NaN"):
        envs.step(actions)
    for shape in ((3,), (1, 3), (2, 1)):
        with pytest.raises(ValueError, match="shape"):
            envs.step(np.zeros(shape, np.float32))
    assert np.array_equal(envs.states, states)


def test_the_action_of_a_row_that_is_reset_is_ignored_even_if_it_is_nan() -> None:
    envs = make(2, max_episode_steps=1)
    envs.reset(seed=0)
    assert envs.step(np.zeros((2, 1), np.float32))[3].all()
    _, rewards, *_ = envs.step(np.full((2, 1), np.nan, np.float32))
    assert not rewards.any()


def test_float64_and_lists_are_taken_as_the_single_environment_takes_them() -> None:
    envs, one = make(1), gym.make("RimlessWheel-v0").unwrapped
    envs.reset(seed=0)
    one.reset(seed=0)
    for action in (np.array([0.1]), [0.2], np.array([1], dtype=int)):
        assert np.array_equal(envs.step([action])[0][0], one.step(action)[0])


def test_without_autoreset_an_ended_row_must_be_reset_first() -> None:
    envs = make(2, DISABLED, max_episode_steps=2)
    with pytest.raises(RuntimeError, match=r"rows \[0, 1\] have no episode"):
        envs.step(np.zeros((2, 1), np.float32))
    envs.reset(seed=0)
    for _ in range(2):
        truncated = envs.step(np.zeros((2, 1), np.float32))[3]
    assert truncated.all()
    with pytest.raises(RuntimeError, match="reset them first"):
        envs.step(np.zeros((2, 1), np.float32))
    envs.reset(options={"reset_mask": truncated})
    assert not envs.step(np.zeros((2, 1), np.float32))[3].any()


def test_stepping_before_the_first_reset_says_what_to_do() -> None:
    with pytest.raises(RuntimeError, match="reset them first"):
        make(2).step(np.zeros((2, 1), np.float32))


@pytest.mark.parametrize("mode", [NEXT, SAME, DISABLED], ids=lambda mode: mode.value)
def test_a_motion_out_of_the_models_range_names_its_row_and_the_rest_goes_on(
    mode: AutoresetMode,
) -> None:
    forward_only = THESIS_PHYSICAL.replace(impact_law="thesis")
    envs = make(3, mode, params=[THESIS_PHYSICAL, forward_only, THESIS_PHYSICAL])
    backward = {"state": [THESIS_PHYSICAL.constants.a + 0.001, 0.0, -1.0, 0.0]}
    envs.reset(seed=0, options=backward)
    still = np.zeros((3, 1), np.float32)
    with pytest.raises(RuntimeError, match="row 1: the motion left the model's range"):
        envs.step(still)
    others = envs.states[[0, 2]]
    assert np.array_equal(others[0], others[1])
    assert np.all(others[:, 5] == -1)  # they took their step back
    if mode is NEXT:
        _, rewards, _, _, info = envs.step(still)
        assert info["elapsed"][1] == rewards[1] == 0
        assert np.all(info["elapsed"][[0, 2]] > 0)
    else:
        if mode is DISABLED:
            with pytest.raises(RuntimeError, match="reset them first"):
                envs.step(still)
        envs.reset(options={"reset_mask": np.array([False, True, False])})
    assert np.all(envs.step(still)[-1]["elapsed"] > 0)


def test_nothing_that_is_not_a_number_leaves_machines_driven_absurdly() -> None:
    machines = [THESIS_PHYSICAL.replace(voltage_limit=10.0**k) for k in range(1, 8)]
    envs = make(7, params=machines)
    envs.reset(seed=0)
    for actions in swinging(7, 200, hold=5):
        try:
            seen, rewards, _, _, info = envs.step(actions)
        except RuntimeError:  # says which row's motion left the model's range
            continue
        assert np.isfinite(seen).all()
        assert np.isfinite(rewards).all()
        assert not any(np.isnan(values).any() for values in info.values())


@pytest.mark.parametrize("settings", [{}, ROUGH], ids=["plain", "rough"])
@pytest.mark.parametrize("mode", [NEXT, SAME], ids=lambda mode: mode.value)
def test_a_snapshot_a_pickle_and_a_copy_go_on_alike(mode: AutoresetMode, settings: dict) -> None:
    def future(envs: RimlessWheelVectorEnv) -> list[bytes]:
        steps = (envs.step(actions) for actions in swinging(5, 150, seed=1))
        return [part.tobytes() for step in steps for part in step[:4]]

    envs = make(5, mode, **settings, max_episode_steps=60)
    envs.reset(seed=0)
    for actions in swinging(5, 61):  # in mode NEXT some rows await their reset now
        envs.step(actions)
    snapshot, twins = envs.get_state(), [pickle.loads(pickle.dumps(envs)), copy.deepcopy(envs)]
    expected = future(envs)
    assert len(set(expected)) > 100
    for twin in twins:
        assert future(twin) == expected
    envs.set_state(snapshot)
    assert future(envs) == expected
    other = make(5, mode, max_episode_steps=60)  # of other parameters, not yet reset
    other.set_state(pickle.loads(pickle.dumps(snapshot)))
    assert future(other) == expected
    envs.set_state(snapshot)
    assert future(envs) == expected  # a snapshot can be taken up any number of times


def test_a_snapshot_of_something_else_is_refused() -> None:
    envs = make(2)
    envs.reset(seed=0)
    with pytest.raises(ValueError, match="2 rows"):
        make(3).set_state(envs.get_state())
    with pytest.raises(ValueError, match="value_of_distance"):
        make(2, task=Task(value_of_distance=1.0)).set_state(envs.get_state())


def test_arguments_that_make_no_sense_are_refused() -> None:
    for settings in (
        {"num_envs": 0},
        {"num_threads": 0},
        {"max_episode_steps": 0},
        {"autoreset_mode": "sometimes"},
        {"render_mode": "human"},
        {"params": [THESIS_PHYSICAL] * 3, "num_envs": 2},
    ):
        with pytest.raises(ValueError, match=r"must be|choose from|not a valid"):
            RimlessWheelVectorEnv(**settings)
    for settings in ({"params": "PROTOTYPE"}, {"task": 1}, {"ranges": 3}, {"disturbances": {}}):
        with pytest.raises(TypeError, match="give a"):
            RimlessWheelVectorEnv(**settings)


def test_a_few_rows_are_drawn_as_a_grid_and_all_as_a_list() -> None:
    envs = make(20, render_mode="rgb_array")
    with pytest.raises(RuntimeError, match="reset"):
        envs.render()
    envs.reset(seed=0)
    picture = envs.render()
    assert picture.dtype == np.uint8
    assert picture.shape == (608, 908, 3)  # 3 x 3 pictures of 200 x 300, 4 pixels apart
    envs.step(np.ones((20, 1), np.float32))
    assert not np.array_equal(envs.render(), picture)
    frames = make(2, render_mode="rgb_array_list")
    frames.reset(seed=0)
    assert [frame.shape for frame in frames.render()] == [(400, 600, 3)] * 2
    single = gym.make("RimlessWheel-v0", render_mode="rgb_array")
    single.reset(seed=0)
    assert np.array_equal(frames.render()[0], single.render())
