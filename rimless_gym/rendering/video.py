"""Videos: H.264 in an MP4 file, written by the ffmpeg that the extra `video` brings."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from rimless_gym.extras import extra
from rimless_gym.rendering.display import Frame

#: Of imageio-ffmpeg, from 0 to 10: thin lines and text stay sharp.
QUALITY = 8


def require_ffmpeg() -> None:
    """Check that videos can be written.

    Raises:
        MissingExtraError: the extra `video` is not installed.
    """
    with extra("video"):
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()


def save_mp4(frames: Iterable[Frame], path: Path, fps: float) -> None:
    """Write a video; a file of this name is replaced once the new one is complete.

    Args:
        frames: uint8 arrays of shape (height, width, 3), all of one shape.
        path: of the file.
        fps: frames per second.

    Raises:
        MissingExtraError: the extra `video` is not installed.
        ValueError: there are no frames.
        OSError: the file cannot be written; one that was there is kept.
    """
    with extra("video"):
        from imageio_ffmpeg import write_frames
    pictures = iter(frames)
    first = next(pictures, None)
    if first is None:
        raise ValueError("frames: there are none")
    height, width = _even(first).shape[:2]
    unfinished = path.with_name(path.name + ".part")
    writer = write_frames(
        str(unfinished),
        (width, height),
        fps=fps,
        codec="libx264",
        quality=QUALITY,
        macro_block_size=1,
        output_params=["-f", "mp4", "-movflags", "+faststart"],
    )
    try:
        writer.send(None)
        writer.send(_even(first).tobytes())
        for frame in pictures:
            writer.send(_even(frame).tobytes())
        writer.close()
        os.replace(unfinished, path)
    finally:
        writer.close()
        unfinished.unlink(missing_ok=True)


def _even(frame: Frame) -> Frame:
    """A frame whose height and width are even, as the format needs them: edges are repeated."""
    height, width = frame.shape[:2]
    return np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
