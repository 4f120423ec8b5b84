"""TensorBoard's events of a training that may have been broken off."""

from __future__ import annotations

from pathlib import Path

from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
from torch.utils.tensorboard import SummaryWriter


class _Continued(TensorBoardOutputFormat):
    """Takes the place of whatever was logged after `step`, which is trained anew."""

    def __init__(self, folder: Path, step: int) -> None:
        # Not the base class's, which opens a file from which nothing is purged.
        self.writer = SummaryWriter(log_dir=str(folder), purge_step=step + 1 if step else None)
        self._is_closed = False


def event_log(folder: Path, step: int) -> Logger:
    """A logger for stable-baselines3 that goes on after `step` time steps in a folder.

    Raises:
        OSError: the folder cannot be written.
    """
    return Logger(str(folder), [_Continued(folder, step)])
