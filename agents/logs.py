"""TensorBoard events of a training that may have been interrupted."""

from __future__ import annotations

from pathlib import Path

from rimless_gym.extras import extra

with extra("learn"):
    from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
    from torch.utils.tensorboard import SummaryWriter


class _Continued(TensorBoardOutputFormat):
    """Replaces what was logged after `step`, because those steps are trained again."""

    def __init__(self, folder: Path, step: int) -> None:
        # The base class's __init__ would open a file without purging anything.
        self.writer = SummaryWriter(log_dir=str(folder), purge_step=step + 1 if step else None)
        self._is_closed = False


def event_log(folder: Path, step: int) -> Logger:
    """A logger for stable-baselines3 that continues a folder's events after `step` time steps.

    Raises:
        OSError: the folder cannot be written.
    """
    return Logger(str(folder), [_Continued(folder, step)])
