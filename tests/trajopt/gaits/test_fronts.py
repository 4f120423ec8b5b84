"""Fronts of least cost over speed."""

from __future__ import annotations

import dataclasses
import signal
import threading
from pathlib import Path

import pytest

from rimless_gym import THESIS_PHYSICAL
from trajopt import CotFront, Solution, cot_front
from trajopt.gaits import fronts
from trajopt.gaits.fronts import shipped_front
from trajopt.gaits.library import nearest


def test_the_front_interpolates_its_lower_envelope_and_refuses_to_extrapolate() -> None:
    front = shipped_front(THESIS_PHYSICAL)
    speeds = [s.speed for s in front.envelope]
    middle = 0.5 * (speeds[0] + speeds[1])
    expected = 0.5 * (front.envelope[0].cot + front.envelope[1].cot)
    assert front(middle) == pytest.approx(expected)
    there = [s.cot for s in front.solutions if abs(s.speed - 0.5) < 1e-9]
    assert front(0.5) == pytest.approx(min(there), rel=1e-9)
    with pytest.raises(ValueError, match="solved for"):
        front(5.0)


def test_among_equally_good_gaits_the_front_takes_the_first(one_step: Solution) -> None:
    v, hair = one_step.verification, 1 + 1e-9
    for factor in (hair, 1.0, 1 / hair):
        energy = factor * v.electrical_positive
        other = dataclasses.replace(
            one_step, verification=dataclasses.replace(v, electrical_positive=energy)
        )
        assert CotFront((one_step, other)).envelope[0] is one_step
        assert CotFront((other, one_step)).envelope[0] is other


@pytest.mark.slow
def test_a_folder_holds_the_gaits_of_a_front_and_why_others_are_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    speeds = [nearest(THESIS_PHYSICAL, 0.5, 1)[0].speed, 20.0]
    front = cot_front(THESIS_PHYSICAL, speeds, steps=(1,), folder=tmp_path)
    assert len(front.missing) == 1

    def solved_again(*_: object, **__: object) -> None:
        raise AssertionError("it was there")

    monkeypatch.setattr(fronts, "periodic_gait", solved_again)
    again = cot_front(THESIS_PHYSICAL, speeds, steps=(1,), folder=tmp_path)
    assert again.missing == front.missing
    assert [s.cot for s in again.solutions] == [s.cot for s in front.solutions]
    with pytest.raises(AssertionError, match="it was there"):
        cot_front(THESIS_PHYSICAL.replace(friction=0.9), speeds, steps=(1,), folder=tmp_path)
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(AssertionError, match="it was there"):
        cot_front(THESIS_PHYSICAL, speeds, steps=(1,), folder=tmp_path)


@pytest.mark.slow
def test_the_front_is_solved_from_shipped_gaits() -> None:
    front = cot_front(THESIS_PHYSICAL, [0.45, 0.5], steps=(1, 2))
    assert not front.missing
    assert [s.speed for s in front.envelope] == pytest.approx([0.45, 0.5])
    best = min(s.cot for s in front.solutions if s.speed > 0.49)
    assert front(0.5) == pytest.approx(best, rel=1e-12)


def press_ctrl_c() -> None:
    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)


def solve_fronts() -> None:
    for _ in range(20):
        cot_front(THESIS_PHYSICAL, (0.47, 0.52), (1,))


def test_an_interrupted_front_is_not_returned_with_gaits_missing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Ctrl-C reaches the user through CasADi, which catches it."""
    cot_front(THESIS_PHYSICAL, (0.52,), (1,))
    capsys.readouterr()
    timer = threading.Timer(0.4, press_ctrl_c)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        solve_fronts()
    timer.join()
    assert not capsys.readouterr().err  # where CasADi would print its own exception
