"""What TensorBoard shows of a training."""

import io

import numpy as np
import pytest
from PIL import Image
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from agents.logs import EventLog
from agents.walking_figures import WalkingFigures
from rimless_gym import THESIS_PHYSICAL
from rimless_gym.energy import CHANNELS
from rimless_gym.envs.task import TERM_NAMES
from tests.agents.runs import run, scalars


@pytest.mark.parametrize("algo", ["ppo", pytest.param("sac", marks=pytest.mark.slow)])
def test_tensorboard_shows_return_cost_of_transport_speed_steps_and_energies(tmp_path, algo):
    run(tmp_path, algo)
    shown = scalars(tmp_path)
    wanted = {"walk/return", "walk/speed", "walk/steps", "walk/falls", "eval/walking_share"}
    wanted |= {f"energy/{name}" for name in ("copper", "collision", "electrical", "friction")}
    assert wanted <= set(shown)
    assert all(np.isfinite(event.value) for tag in wanted for event in shown[tag])


def test_logged_figures_are_ratios_of_sums_over_the_infos():
    names = [channel.name for channel in CHANNELS]
    info = {name: np.zeros(2) for name in (*names, *TERM_NAMES, "failure")}
    info |= {"steps": np.ones(2), "elapsed": np.full(2, 0.01), "distance": np.array([0.01, 0.03])}
    info |= {"electrical_positive": np.array([1.0, 0.2]), "reward_energy": np.full(2, -0.1)}
    info |= {"reward_distance": 0.5 * info["distance"]}
    seen = {}

    class Log:
        def record(self, name, value):
            seen[name] = value

    figures = WalkingFigures(THESIS_PHYSICAL)
    for _ in range(2):
        figures.add(info)
    assert figures.intervals == 4
    figures.record(Log())
    assert figures.intervals == 0
    assert seen["walk/cot"] == pytest.approx(1.2 / (THESIS_PHYSICAL.weight * 0.04))
    assert seen["walk/speed"] == pytest.approx(2.0)
    assert seen["walk/steps"] == 4
    assert sum(seen[f"walk/{name}"] for name in TERM_NAMES) == pytest.approx(seen["walk/return"])
    assert seen["walk/return"] == pytest.approx((0.5 * 0.04 - 0.2) / 2 * 2000)


def test_a_film_is_among_the_images_of_the_log(tmp_path):
    log = EventLog(tmp_path, 0)
    frames = [np.full((40, 60, 3), shade, np.uint8) for shade in (0, 120, 240)]
    log.film("walk", frames, 10, 7)
    log.close()
    events = EventAccumulator(str(tmp_path), size_guidance={"images": 0}).Reload()
    (image,) = events.Images("walk")
    assert (image.step, image.width, image.height) == (7, 60, 40)
    assert Image.open(io.BytesIO(image.encoded_image_string)).n_frames == 3
