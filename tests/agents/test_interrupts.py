import signal

import pytest

from agents.interrupts import requests


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_two_requests_are_noted_and_the_third_stops_at_once(capfd, number):
    with requests("after this", "a minute") as stop:
        assert not stop.made
        signal.raise_signal(number)
        assert stop.made
        signal.raise_signal(number)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
    said = capfd.readouterr().err
    assert "stopping after this: nothing is lost" in said
    assert "once more to stop at once, which loses a minute" in said


def test_a_request_made_while_held_off_interrupts_afterwards():
    written = []

    def write(stop):
        with stop.held_off():
            for _ in range(5):
                signal.raise_signal(signal.SIGINT)
                written.append(1)

    with requests("", "") as stop, pytest.raises(KeyboardInterrupt):
        write(stop)
    assert len(written) == 5


def test_signal_handlers_are_restored_afterwards():
    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    with requests("", ""):
        pass
    assert (signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)) == before
