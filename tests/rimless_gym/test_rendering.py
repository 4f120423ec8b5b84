"""The drawing: what it shows, that it needs no display, and where pictures go."""

import math
import os
import subprocess
import sys
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from rimless_gym import BUILDABLE
from rimless_gym.equations import DOUBLE
from rimless_gym.presets import PRESETS, PROTOTYPE, THESIS_PHYSICAL
from rimless_gym.rendering.canvas import (
    FACE,
    FIRST,
    OPTIMUM,
    ROD,
    STANCE,
    pygame,
)
from rimless_gym.rendering.display import Window, save_gif, save_mp4
from rimless_gym.rendering.panels import Shown, draw_several
from rimless_gym.rendering.wheel import Scene, draw

STANDING = Scene(phi=math.pi / 2, theta=0.0)


def near(frame: np.ndarray, colour: tuple[int, int, int], tolerance: int = 8) -> np.ndarray:
    """Where the frame has approximately that colour, (rows, columns)."""
    return np.argwhere(np.abs(frame.astype(int) - colour).max(axis=2) <= tolerance)


@settings(max_examples=15)
@given(
    st.sampled_from(list(PRESETS.values())),
    st.floats(0.5, 2.6),
    st.floats(-100, 100),
    st.floats(-1e4, 1e4),
    st.floats(-1.2, 1.2),
    st.sampled_from([0, 1]),
)
def test_the_wheel_is_visible_in_any_scene(params, phi, theta, foot_x, slope, mode):
    scene = Scene(phi=phi, theta=theta, foot_x=foot_x, mode=mode, voltage=3.0, time=1.0)
    frame = draw(params.replace(slope=slope), scene, size=(300, 200))
    assert (frame.shape, frame.dtype) == ((200, 300, 3), np.uint8)
    for colour in (ROD, STANCE):
        assert len(near(frame, colour)) > 10


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


def test_the_hub_moves_continuously_across_a_touchdown():
    p, step = PROTOTYPE.constants, PROTOTYPE.step_length
    before = Scene(phi=p.b, theta=0.0).hub(PROTOTYPE)
    after = Scene(phi=p.a, theta=0.0, foot_x=step, mode=DOUBLE).hub(PROTOTYPE)
    assert before == pytest.approx(after, abs=1e-12)


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


def test_closing_one_of_two_windows_leaves_the_other_open():
    frame = draw(THESIS_PHYSICAL, STANDING, size=(300, 200))
    first, second = (Window((300, 200), fps=1000) for _ in range(2))
    first.close()
    second.show(frame)
    assert second.is_open
    second.close()
    assert not pygame.display.get_init()


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


# -- panels of several walkers ---------------------------------------------------------------------

SIZE = (720, 300)


def walkers(*places):
    scenes = [Scene(phi=1.4, theta=0.4, foot_x=x, speed=0.5, cot=0.05) for x in places]
    return [
        Shown(name=name, colour=colour, scene=scene)
        for name, colour, scene in zip(("one", "two"), (FIRST, OPTIMUM), scenes, strict=False)
    ]


def test_a_ghost_is_drawn_where_it_is():
    alone = draw_several(BUILDABLE, walkers(0.0), SIZE, lines=2)
    for away in (-0.4, 0.4):
        both = draw_several(BUILDABLE, walkers(0.0, away), SIZE, lines=2)
        changed = np.argwhere((alone != both).any(axis=2) & (np.arange(300)[:, None] > 110))
        pixels = np.median(changed[:, 1]) - 360
        assert pixels == pytest.approx(away * 400, rel=0.25)  # 1 m is about 400 pixels here


# -- videos ----------------------------------------------------------------------------------------

FRAMES = [np.full((63, 97, 3), shade, dtype=np.uint8) for shade in (0, 100, 200)]


@pytest.mark.parametrize("name", ["walk.mp4", "-a:b.mp4"])
def test_a_video_keeps_the_frames_and_their_rate(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    save_mp4(FRAMES, Path(name), fps=100 / 6)
    film = imageio_ffmpeg.read_frames(f"file:{name}")
    meta = next(film)
    assert meta["size"] == (98, 64)  # even, as the format needs them
    assert meta["fps"] == pytest.approx(100 / 6, abs=0.01)
    shades = [np.frombuffer(each, np.uint8).mean() for each in film]
    assert shades == pytest.approx([0, 100, 200], abs=4)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_where_ffmpeg_fails_the_former_file_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program, film = tmp_path / "ffmpeg", tmp_path / "walk.mp4"
    program.write_text("#!/bin/sh\necho half > walk.mp4.part\necho No space left >&2\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(program))
    monkeypatch.chdir(tmp_path)
    film.write_text("the former")
    with pytest.raises(OSError, match=r"walk\.mp4: ffmpeg cannot write it \(No space left\)"):
        save_mp4(200 * FRAMES, Path("walk.mp4"), fps=50)
    assert film.read_text() == "the former"
    assert not (tmp_path / "walk.mp4.part").exists()
