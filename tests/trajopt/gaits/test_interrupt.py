"""Ctrl-C reaches the user through CasADi, which catches it."""

from __future__ import annotations

import signal
import threading

import pytest

from rimless_gym import THESIS_PHYSICAL
from trajopt.gaits.fronts import cot_front


def press_ctrl_c() -> None:
    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)


def solve_fronts() -> None:
    for _ in range(4):
        cot_front(THESIS_PHYSICAL, (0.43, 0.47, 0.52), (2,))


@pytest.mark.parametrize("delay", [0.7, 1.1, 1.6])
def test_an_interrupted_front_is_not_returned_with_gaits_missing(
    delay: float, capsys: pytest.CaptureFixture[str]
) -> None:
    timer = threading.Timer(delay, press_ctrl_c)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        solve_fronts()
    timer.join()
    assert not capsys.readouterr().err  # where CasADi would tell of its own exception
