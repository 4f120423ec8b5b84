"""The drawing: what it shows, that it needs no display, and where pictures go."""

import math
import os
import subprocess
import sys
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from rimless_gym.equations import DOUBLE
from rimless_gym.presets import PRESETS, PROTOTYPE, THESIS_PHYSICAL
from rimless_gym.rendering.canvas import FACE, ROD, STANCE, TRACK, pygame
from rimless_gym.rendering.display import Window, save_gif
from rimless_gym.rendering.wheel import Scene, draw

STANDING = Scene(phi=math.pi / 2, theta=0.0)


def near(frame: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """Where the frame has approximately that colour, (rows, columns)."""
    return np.argwhere(np.abs(frame.astype(int) - colour).max(axis=2) <= 8)


@settings(max_examples=40)
@given(
    st.sampled_from(list(PRESETS.values())),
    st.floats(0.5, 2.6),
    st.floats(-100, 100),
    st.floats(-1e4, 1e4),
    st.floats(-1.2, 1.2),
    st.sampled_from([0, 1]),
)
def test_the_wheel_is_visible_in_any_scene(params, phi, theta, foot_x, slope, mode):
    scene = Scene(phi=phi, theta=theta, foot_x=foot_x, mode=mode, voltage=3.0, time=1.0, cot=0.1)
    frame = draw(params.replace(slope=slope), scene, size=(300, 200))
    assert (frame.shape, frame.dtype) == ((200, 300, 3), np.uint8)
    for colour in (ROD, STANCE):
        assert len(near(frame, colour)) > 10


def test_the_same_scene_gives_the_same_picture_in_a_new_array():
    first, second = draw(THESIS_PHYSICAL, STANDING), draw(THESIS_PHYSICAL, STANDING)
    assert np.array_equal(first, second)
    assert not np.shares_memory(first, second)
    first[:] = 0  # it is writeable, and changes no other picture
    assert np.array_equal(draw(THESIS_PHYSICAL, STANDING), second)


def test_the_camera_follows_the_wheel():
    frames = [
        draw(THESIS_PHYSICAL, Scene(phi=math.pi / 2, theta=0.3, foot_x=x)) for x in (0.0, 7.77)
    ]
    rods = [near(frame, ROD) for frame in frames]
    assert np.array_equal(*rods)
    assert not np.array_equal(*frames)  # the scale has scrolled past


def test_the_ground_tilts_downhill():
    frame = draw(THESIS_PHYSICAL.replace(slope=0.2), STANDING)
    top_of_face = [np.min(near(frame[:, columns], FACE)[:, 0]) for columns in ([20], [580])]
    assert top_of_face[1] - top_of_face[0] == pytest.approx(560 * math.tan(0.2), abs=3)


def test_a_long_pendulum_is_drawn_in_front_of_the_track():
    rod = near(draw(THESIS_PHYSICAL, STANDING), ROD)
    ground = near(draw(THESIS_PHYSICAL, Scene(phi=math.pi / 2, theta=math.pi)), TRACK)
    assert rod[:, 0].max() > ground[:, 0].max() + 50


@pytest.mark.parametrize("params", PRESETS.values(), ids=PRESETS)
def test_the_pendulum_fits_into_the_picture_at_any_angle(params):
    for theta in np.linspace(-math.pi, math.pi, 9):
        for phi in (params.constants.a, math.pi / 2):
            rod = near(draw(params, Scene(phi=phi, theta=theta)), ROD)
            assert rod.min() > 0
            assert np.all(rod.max(axis=0) < (399, 599))


def test_both_feet_light_up_in_double_stance():
    a = PROTOTYPE.constants.a
    one, two = (len(near(draw(PROTOTYPE, Scene(phi=a, theta=0.0, mode=m)), STANCE)) for m in (0, 1))
    assert two == pytest.approx(2 * one, rel=0.1)


def test_the_bar_shows_the_voltage_and_saturates():
    def bar(volts: float) -> int:
        frame = draw(THESIS_PHYSICAL, Scene(phi=math.pi / 2, theta=0.0, voltage=volts))
        return len(near(frame[:40, 400:], STANCE))

    assert bar(-20) == bar(0) == 0
    assert bar(20) == bar(200) == pytest.approx(2 * bar(10), rel=0.15)


def test_the_hub_moves_continuously_across_a_touchdown():
    p, step = PROTOTYPE.constants, PROTOTYPE.step_length
    before = Scene(phi=p.b, theta=0.0).hub(PROTOTYPE)
    after = Scene(phi=p.a, theta=0.0, foot_x=step, mode=DOUBLE).hub(PROTOTYPE)
    assert before == pytest.approx(after, abs=1e-12)


def test_the_trail_is_drawn():
    trail = [(x, 0.5) for x in np.linspace(-0.8, 0.0, 20)]
    plain, trailed = draw(PROTOTYPE, STANDING), draw(PROTOTYPE, STANDING, trail=trail)
    assert not np.array_equal(plain, trailed)


def test_invalid_scenes_and_sizes_are_refused():
    with pytest.raises(ValueError, match="must be finite"):
        draw(THESIS_PHYSICAL, Scene(phi=math.nan, theta=0.0))
    with pytest.raises(ValueError, match=r"size = \(0, 400\): width and height"):
        draw(THESIS_PHYSICAL, STANDING, size=(0, 400))


def test_drawing_is_fast_enough_for_a_video():
    draw(THESIS_PHYSICAL, STANDING)
    start = time.perf_counter()
    for k in range(20):
        draw(THESIS_PHYSICAL, Scene(phi=1.5, theta=0.1 * k))
    assert (time.perf_counter() - start) / 20 < 0.05  # 4 ms on an idle core


def test_drawing_needs_no_display_and_prints_nothing():
    code = (
        "import rimless_gym.rendering.wheel as r, rimless_gym as g, pygame;"
        "r.draw(g.PROTOTYPE, r.Scene(phi=1.5, theta=0.0, speed=1.0));"
        "assert not pygame.display.get_init()"
    )
    environment = {k: v for k, v in os.environ.items() if k not in ("SDL_VIDEODRIVER", "DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout == ""


def test_a_window_shows_frames_until_it_is_closed():
    frame = draw(THESIS_PHYSICAL, STANDING, size=(300, 200))
    window = Window((300, 200), fps=1000)
    window.show(frame)
    shown = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
    assert np.array_equal(shown, frame)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    window.show(frame)
    assert not window.is_open
    window.show(frame)
    window.close()


def test_a_gif_keeps_the_frames_their_rate_and_stays_small(tmp_path):
    frames = [
        draw(PROTOTYPE, Scene(phi=1.2 + 0.02 * k, theta=0.1 * k), size=(300, 200))
        for k in range(25)
    ]
    path = tmp_path / "walk.gif"
    save_gif(frames, path, fps=25)
    assert path.stat().st_size < 200_000
    with Image.open(path) as gif:
        assert (gif.n_frames, gif.info["duration"], gif.info["loop"]) == (25, 40, 0)
        gif.seek(24)
        back = np.asarray(gif.convert("RGB")).astype(int)
    assert np.abs(back - frames[24]).mean() < 4


def test_a_gif_without_frames_or_too_fast_for_browsers_is_refused(tmp_path):
    with pytest.raises(ValueError, match="no frames"):
        save_gif([], tmp_path / "nothing.gif", fps=25)
    with pytest.raises(ValueError, match="fps = 100: must be above 0 and at most 50"):
        save_gif([draw(PROTOTYPE, STANDING)], tmp_path / "fast.gif", fps=100)
