"""Where pictures go: a window on the screen, or an animated GIF."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rimless_gym.rendering._pygame import pygame

Frame = NDArray[np.uint8]

#: The file descriptor of stderr.
STDERR = 2


class Window:
    """A window that shows frames at a steady rate; the only thing here that needs a display.

    Args:
        size: width and height in pixels.
        fps: frames per second that `show` keeps to by waiting.
        title: of the window.

    Attributes:
        is_open: False once the user or `close` has closed the window.
    """

    def __init__(self, size: tuple[int, int], fps: float, title: str = "rimless-gym") -> None:
        with _silent_libraries():
            pygame.display.init()
        self._screen = pygame.display.set_mode(size)
        pygame.display.set_caption(title)
        self._clock = pygame.time.Clock()
        self._fps = fps
        self.is_open = True

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
            pygame.display.quit()


def has_display() -> bool:
    """Whether a window can be shown."""
    try:
        with _silent_libraries():
            pygame.display.init()
    except pygame.error:
        return False
    return pygame.display.get_driver() not in ("dummy", "offscreen")


@contextmanager
def _silent_libraries() -> Iterator[None]:
    """Keep from stderr what compiled libraries print there, besides the error that they give."""
    sys.stderr.flush()
    kept = os.dup(STDERR)
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), STDERR)
    try:
        yield
    finally:
        os.dup2(kept, STDERR)
        os.close(kept)


def save_gif(
    frames: Iterable[Frame],
    to: str | Path | BinaryIO,
    fps: float,
    *,
    colours: int = 64,
    samples: Sequence[Frame] = (),
) -> None:
    """Write an endless animation.

    All frames share one palette, nothing is dithered, and what does not change is left out: this
    keeps the file small and areas of one colour steady.

    Args:
        frames: uint8 arrays of shape (height, width, 3).
        to: path of the file, or an open one.
        fps: frames per second, at most 50; a GIF counts in 1/100 s, so 50, 25 or 20 are exact.
        colours: size of the palette, at most 255.
        samples: frames with all colours, for the palette; default: some of `frames`, which are then
            all in memory at once.

    Raises:
        ValueError: there are no frames, or more per second than browsers show.
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
    images = _changes(frames, palette)
    next(images).save(
        to,
        format="GIF",
        save_all=True,
        append_images=images,
        duration=10 * round(100 / fps),
        loop=0,
        optimize=False,
        transparency=len(_entries(palette)),
        disposal=1,  # what is transparent stays as it was
    )


def _entries(palette: Image.Image) -> NDArray[np.uint8]:
    """The colours of a palette, (n, 3)."""
    return np.array(palette.getpalette(), np.uint8).reshape(-1, 3)


def _changes(frames: Iterable[Frame], palette: Image.Image) -> Iterator[Image.Image]:
    """The first frame, and of the others what changes; the rest is transparent."""
    entries = _entries(palette)
    shown: NDArray[np.uint8] | None = None  # indices
    for frame in frames:
        picture = Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        indices = np.asarray(picture)
        changes = indices if shown is None else np.where(indices == shown, len(entries), indices)
        shown = indices
        image = Image.fromarray(changes.astype(np.uint8)).convert("P")
        image.putpalette([*entries.ravel().tolist(), 0, 0, 0])
        yield image
