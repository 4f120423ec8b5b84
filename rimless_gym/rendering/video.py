"""Videos: H.264 in an MP4 file, written by the ffmpeg that the extra `video` brings."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np

from rimless_gym.extras import MissingExtraError, extra
from rimless_gym.rendering.display import Frame

#: x264's constant rate factor, from 0, without loss, to 51: thin lines and text stay sharp.
RATE_FACTOR = 10


def ffmpeg() -> str:
    """The program that writes videos.

    Raises:
        MissingExtraError: the extra `video` is not installed, or brings no ffmpeg here.
    """
    with extra("video"):
        import imageio_ffmpeg
    try:
        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except RuntimeError as error:
        raise MissingExtraError(
            "imageio-ffmpeg has no ffmpeg for this computer: install one, or name its file in the "
            "environment variable IMAGEIO_FFMPEG_EXE"
        ) from error


def save_mp4(frames: Iterable[Frame], path: Path, fps: float) -> None:
    """Write a video; a file of this name is replaced once the new one is complete.

    Args:
        frames: uint8 arrays of shape (height, width, 3), all of one shape.
        path: of the file.
        fps: frames per second.

    Raises:
        MissingExtraError: see `ffmpeg`.
        ValueError: there are no frames.
        OSError: the file cannot be written; one that was there is kept.
    """
    pictures = iter(frames)
    first = next(pictures, None)
    if first is None:
        raise ValueError("frames: there are none; give one or more")
    height, width = _even(first).shape[:2]
    unfinished = path.with_name(path.name + ".part")
    command = [
        *(ffmpeg(), "-y", "-v", "error"),
        *("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{fps:g}"),
        *("-i", "-", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", str(RATE_FACTOR)),
        *("-movflags", "+faststart", "-f", "mp4"),
        f"file:{unfinished}",  # or a colon or a first dash in the name would mean something
    ]
    try:
        with _fed(command, path) as film:
            film.write(_even(first).tobytes())
            for frame in pictures:
                film.write(_even(frame).tobytes())
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)


@contextmanager
def _fed(command: list[str], path: Path) -> Iterator[IO[bytes]]:
    """The input of ffmpeg, whose exit status says whether the file is complete.

    Raises:
        OSError: it cannot be run, or failed; the first thing that it said is in the message.
    """
    with tempfile.TemporaryFile() as said:
        program = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=said,
            start_new_session=True,  # Ctrl-C is for us: we end it
        )
        assert program.stdin is not None
        broken = False
        try:
            with program.stdin as film:
                yield film
        except BrokenPipeError:  # it has ended, and said why
            broken = True
        except BaseException:
            program.kill()
            raise
        finally:
            status = program.wait()
        if status or broken:
            said.seek(0)
            why = said.readline().decode(errors="replace").strip() or f"exit status {status}"
            raise OSError(
                f"{path}: ffmpeg cannot write it ({why}); make room, or give another place"
            )


def _even(frame: Frame) -> Frame:
    """A frame whose height and width are even, as the format needs them: edges are repeated."""
    height, width = frame.shape[:2]
    return np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
