"""Where pictures go: a window on the screen, an animated GIF, or a video."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import BinaryIO

import numpy as np
from PIL import Image

from rimless_gym.checks import MissingExtraError, extra
from rimless_gym.rendering.canvas import Frame, pygame

#: x264's constant rate factor, from 0, without loss, to 51: thin lines and text stay sharp.
RATE_FACTOR = 10


class Window:
    """A window of `size` pixels that shows frames at a steady rate; only this needs a display.

    `is_open` is False once the user or `close` has closed it. SDL has one window in a process:
    several of them show their frames in turn, until the last one is closed.
    """

    _open = 0  # how many there are

    def __init__(self, size: tuple[int, int], fps: float) -> None:
        pygame.display.init()
        self._screen = pygame.display.set_mode(size)
        pygame.display.set_caption("rimless-gym")
        self._clock = pygame.time.Clock()
        self._fps = fps
        self.is_open = True
        Window._open += 1

    def show(self, frame: Frame) -> None:
        """Show a frame, uint8 of shape (height, width, 3); without effect on a closed window."""
        if not self.is_open:
            return
        if any(event.type == pygame.QUIT for event in pygame.event.get()):
            self.close()
            return
        pygame.surfarray.blit_array(self._screen, frame.swapaxes(0, 1))
        pygame.display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        """Close the window; closing twice is fine."""
        if self.is_open:
            self.is_open = False
            Window._open -= 1
            if not Window._open:
                pygame.display.quit()


def has_display() -> bool:
    """Whether a window can be shown."""
    screens = {"DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"}
    if sys.platform == "linux" and not screens & set(os.environ):
        return False  # where there is none, SDL prints errors
    try:
        pygame.display.init()
    except pygame.error:
        return False
    return pygame.display.get_driver() not in ("dummy", "offscreen")


def save_gif(
    frames: Iterable[Frame],
    to: str | Path | BinaryIO,
    fps: float,
    *,
    colours: int = 64,
    samples: Sequence[Frame] = (),
) -> None:
    """Write an endless animation.

    All frames share one palette and nothing is dithered: this keeps the file small and areas of one
    colour steady.

    Args:
        frames: uint8 arrays of shape (height, width, 3).
        to: path of the file, or an open one.
        fps: frames per second, at most 50; a GIF counts in 1/100 s, so 50, 25 or 20 are exact.
        colours: size of the palette, at most 255.
        samples: frames with all colours, for the palette; default: some of `frames`, which are then
            all in memory at once.
    """
    if not 0 < fps <= 50:
        raise ValueError(
            f"fps = {fps}: must be above 0 and at most 50; leave out frames if need be"
        )
    if not samples:
        frames = list(frames)
        samples = frames[:: max(1, len(frames) // 8)]
    if not samples:
        raise ValueError("cannot save a GIF of no frames")
    palette = Image.fromarray(np.concatenate(samples)).quantize(
        colours, method=Image.Quantize.MEDIANCUT, kmeans=1
    )
    images = (
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in frames
    )
    next(images).save(
        to,
        format="GIF",
        save_all=True,
        append_images=images,
        duration=10 * round(100 / fps),
        loop=0,
        optimize=False,
    )


def save_mp4(frames: Iterable[Frame], path: Path, fps: float) -> None:
    """Write a video, H.264 in an MP4 file; an existing one is replaced when this is complete.

    The frames are uint8 arrays (height, width, 3), all of one shape, `fps` of them per second.
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
    program = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
    assert program.stdin is not None
    try:
        with contextlib.suppress(BrokenPipeError):  # ffmpeg has ended: see its exit status
            for frame in chain([first], pictures):
                program.stdin.write(_even(frame).tobytes())
        _, complaint = program.communicate()
        if program.returncode:
            raise OSError(f"{path}: ffmpeg cannot write it ({complaint.decode().strip()})")
        os.replace(unfinished, path)
    finally:
        program.kill()
        program.wait()
        unfinished.unlink(missing_ok=True)


def ffmpeg() -> str:
    """The program that writes videos."""
    with extra("video"):
        import imageio_ffmpeg
    try:
        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except RuntimeError as error:
        raise MissingExtraError(
            "imageio-ffmpeg has no ffmpeg for this computer: install one, or name its file in the "
            "environment variable IMAGEIO_FFMPEG_EXE"
        ) from error


def _even(frame: Frame) -> Frame:
    """A frame whose height and width are even, as the format needs them: edges are repeated."""
    height, width = frame.shape[:2]
    return np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
