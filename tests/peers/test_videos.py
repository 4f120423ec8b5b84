"""Wrappers of Gymnasium and stable-baselines3 that record the rows of a vector environment."""

from __future__ import annotations

import pytest
from gymnasium.wrappers.vector import RecordVideo
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecVideoRecorder

from agents import Sb3VecEnv, load_policy
from tests.rimless_gym.envs.rows import NEXT, SAME, make, swinging

pytestmark = pytest.mark.peers


@pytest.mark.parametrize("mode", [NEXT, SAME], ids=lambda mode: mode.value)
@pytest.mark.filterwarnings("ignore:.*same-step")
def test_every_row_is_in_the_video(tmp_path, mode):
    envs = make(4, mode, render_mode="rgb_array", max_episode_steps=20)
    envs = RecordVideo(envs, str(tmp_path / "videos"), episode_trigger=lambda episode: episode == 0)
    envs.reset(seed=0)
    for actions in swinging(4, 30):
        envs.step(actions)
    envs.close()
    assert_four_rows(tmp_path / "videos", envs.metadata["render_fps"])


def test_stable_baselines3_records_a_policy_in_every_row(tmp_path):
    arguments = {"render_mode": "rgb_array", "max_episode_steps": 20}
    native = make_vec_env("RimlessWheel-v0", 4, 0, env_kwargs=arguments, vec_env_cls=Sb3VecEnv)
    folder = str(tmp_path / "videos")
    envs = VecVideoRecorder(native, folder, lambda step: step == 0, video_length=20)
    evaluate_policy(load_policy("evolution"), envs, 4, warn=False)
    envs.close()
    assert_four_rows(tmp_path / "videos", native.metadata["render_fps"])


def assert_four_rows(folder, fps):
    video = pytest.importorskip("moviepy.editor")
    (path,) = folder.glob("*.mp4")
    with video.VideoFileClip(str(path)) as clip:
        assert clip.size == [2 * 600, 2 * 400]
        assert clip.fps == fps
        frame = clip.get_frame(0.1)
    quarters = [frame[y : y + 400, x : x + 600] for y in (0, 400) for x in (0, 600)]
    assert all(quarter.std() > 10 for quarter in quarters)
    assert len({quarter.tobytes() for quarter in quarters}) == 4
