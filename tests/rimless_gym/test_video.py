"""Videos: what is in the file, and that one which cannot be written costs nothing."""

from __future__ import annotations

from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from rimless_gym.checks import MissingExtraError
from rimless_gym.rendering.display import ffmpeg, save_mp4

FRAMES = [np.full((63, 97, 3), shade, dtype=np.uint8) for shade in (0, 100, 200)]


@pytest.mark.parametrize("name", ["walk.mp4", "-y.mp4", "a:b.mp4"])
def test_a_video_keeps_the_frames_and_their_rate(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    save_mp4(FRAMES, Path(name), fps=100 / 6)
    film = imageio_ffmpeg.read_frames(f"file:{name}")
    told = next(film)
    assert told["size"] == (98, 64)  # even, as the format needs them
    assert told["fps"] == pytest.approx(100 / 6, abs=0.01)
    shades = [np.frombuffer(each, np.uint8).mean() for each in film]
    assert shades == pytest.approx([0, 100, 200], abs=4)
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("last", ["cat > /dev/null; exit 1", "exit 1"])
def test_where_ffmpeg_fails_the_former_file_is_kept(
    last: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program, film = tmp_path / "ffmpeg", tmp_path / "walk.mp4"
    unfinished = tmp_path / "walk.mp4.part"
    program.write_text(f"#!/bin/sh\necho half > {unfinished}\necho No space left >&2\n{last}\n")
    program.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(program))
    film.write_text("the former")
    with pytest.raises(OSError, match=r"walk\.mp4: ffmpeg cannot write it \(No space left\)"):
        save_mp4(200 * FRAMES, film, fps=50)
    assert film.read_text() == "the former"
    assert not unfinished.exists()


def test_a_video_of_no_frames_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="frames: there are none"):
        save_mp4([], tmp_path / "walk.mp4", fps=50)
    assert not list(tmp_path.iterdir())


def test_a_computer_without_ffmpeg_is_told_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> str:
        raise RuntimeError("No ffmpeg exe could be found")

    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", missing)
    with pytest.raises(MissingExtraError, match="IMAGEIO_FFMPEG_EXE"):
        ffmpeg()
