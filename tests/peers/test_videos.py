"""Gymnasium's wrappers that record the rows of a vector environment."""

from __future__ import annotations

import pytest
from gymnasium.wrappers.vector import RecordVideo

from tests.rimless_gym.envs.rows import NEXT, SAME, make, swinging

pytestmark = pytest.mark.peers


@pytest.mark.parametrize("mode", [NEXT, SAME], ids=lambda mode: mode.value)
@pytest.mark.filterwarnings("ignore:.*same-step")
def test_every_row_is_in_the_video(tmp_path, mode):
    video = pytest.importorskip("moviepy.editor")
    envs = make(4, mode, render_mode="rgb_array", max_episode_steps=20)
    envs = RecordVideo(envs, str(tmp_path / "videos"), episode_trigger=lambda episode: episode == 0)
    envs.reset(seed=0)
    for actions in swinging(4, 30):
        envs.step(actions)
    envs.close()
    (path,) = tmp_path.glob("videos/*.mp4")
    with video.VideoFileClip(str(path)) as clip:
        assert clip.size == [2 * 600, 2 * 400]
        assert clip.fps == envs.metadata["render_fps"]
        frame = clip.get_frame(0.1)
    quarters = [frame[y : y + 400, x : x + 600] for y in (0, 400) for x in (0, 600)]
    assert all(quarter.std() > 10 for quarter in quarters)
    assert len({quarter.tobytes() for quarter in quarters}) == 4
