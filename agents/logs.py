"""TensorBoard events of a training that may have been interrupted."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from rimless_gym.checks import extra
from rimless_gym.rendering.canvas import Frame
from rimless_gym.rendering.display import save_gif

with extra("learn"):
    from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
    from tensorboard.compat.proto.summary_pb2 import Summary
    from torch.utils.tensorboard import SummaryWriter


class _Continued(TensorBoardOutputFormat):
    """Replaces what was logged after `step`, because those steps are trained again."""

    def __init__(self, folder: Path, step: int) -> None:
        # The base class's __init__ would open a file without purging anything.
        self.writer = SummaryWriter(log_dir=str(folder), purge_step=step + 1 if step else None)
        self._is_closed = False


class EventLog(Logger):
    """A logger for stable-baselines3 that continues a folder's events.

    Args:
        folder: of the events.
        step: after which they go on.

    Raises:
        OSError: the folder cannot be written.
    """

    def __init__(self, folder: Path, step: int) -> None:
        self._events = _Continued(folder, step)
        super().__init__(str(folder), [self._events])

    def film(self, name: str, frames: Sequence[Frame], fps: float, step: int) -> None:
        """Log a film, which TensorBoard plays among its images.

        Args:
            name: of the film.
            frames: pictures, uint8 of shape (height, width, 3), one or more.
            fps: pictures per second.
            step: at which it was made.
        """
        encoded = io.BytesIO()
        save_gif(frames, encoded, fps)
        height, width, _ = frames[0].shape
        image = Summary.Image(
            height=height, width=width, colorspace=3, encoded_image_string=encoded.getvalue()
        )
        summary = Summary(value=[Summary.Value(tag=name, image=image)])
        self._events.writer._get_file_writer().add_summary(summary, step)  # as add_video does
