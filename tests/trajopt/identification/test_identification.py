"""A machine identified from a log: right within its own errors, or refused with a number."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from agents.rollout import at_rest, draw_starts, logged
from rimless_gym import BUILDABLE
from rimless_gym.presets import PROTOTYPE
from trajopt import Identification, Log, LogError, Noise, identify
from trajopt.identification.fit import PHYSICAL

CHANGED = {"pendulum_length": 0.1463, "leg_length": 0.2955, "motor_constant": 0.0222}
MACHINE = dataclasses.replace(BUILDABLE, **CHANGED)

RISE = 1e-4  # s: the motor's inductance over its resistance


def driven(machine=MACHINE, seconds=2.0, seed=0, volts=6.0):
    """A log of a wheel that swings its pendulum to and fro, and rocks from leg to leg."""
    tick = iter(range(1000))
    start = draw_starts(BUILDABLE, 4, 3)[3]
    return logged(
        lambda x, seen: np.array([volts / 12.0 * np.sin(0.13 * next(tick))]),
        *(machine, start, seconds, Noise(), seed),
    )


def rocking(machine, share, seed):
    """A log of a wheel that rocks from rest, under voltages up to a share of its limit."""
    volts = iter(np.random.default_rng(seed).uniform(-share, share, 100).repeat(12))
    return logged(
        lambda x, seen: np.array([next(volts)]), machine, at_rest(machine), 4.0, Noise(), seed
    )


@pytest.fixture(scope="module")
def log() -> Log:
    return driven()


def test_the_machine_is_found_within_the_errors_that_are_reported(log: Log) -> None:
    found = identify(log, BUILDABLE)
    true = np.array([getattr(MACHINE, name) for name in PHYSICAL])
    assert (np.abs(found.values - true) < 4 * np.sqrt(np.diag(found.covariance))).all()
    assert found.params.motor_constant == pytest.approx(MACHINE.motor_constant, rel=2e-3)
    assert 0.7 < found.chi2 < 1.3
    assert {"phi", "theta", "current", "dphi", "dtheta"} == set(found.residuals)


@pytest.mark.parametrize(
    ("machine", "share", "seed"), [(BUILDABLE, 0.8, 0), (BUILDABLE, 0.7, 4), (PROTOTYPE, 0.15, 0)]
)
def test_a_wheel_that_rocks_and_a_motor_that_is_stiff_are_found_too(machine, share, seed) -> None:
    """A rocking leg touches down and comes back between samples; no log shows that.

    Once it turns back where one sees it, once not. The rates of `PROTOTYPE` decay within a third of
    a sample.
    """
    found = identify(rocking(machine, share, seed), machine)
    off = found.values - [getattr(machine, name) for name in found.free]
    assert off @ np.linalg.solve(found.covariance, off) < 4 * len(off)
    assert 0.7 < found.chi2 < 1.3


def test_without_a_current_the_scale_of_masses_is_not_identifiable(log: Log) -> None:
    """Masses, friction and 1 / resistance may all be larger by the same share."""
    bare = dataclasses.replace(log, current=None, dphi=None, dtheta=None)
    together = {name: 1.0 for name in PHYSICAL if "mass" in name or "inertia" in name}
    together |= {"hub_friction": 1.0, "armature_resistance": -1.0}

    def uncertainty(found: Identification) -> float:
        """The standard deviation in this direction, as a share of the one before."""
        direction = np.array([together.get(name, 0.0) for name in found.free]) / found.tolerance
        return np.sqrt(direction @ found.covariance @ direction) / np.sqrt(len(together))

    assert uncertainty(identify(bare, BUILDABLE)) > 0.99
    assert uncertainty(identify(log, BUILDABLE)) < 0.8


def test_a_log_that_fits_badly_counts_for_less_and_what_was_known_in_full(log: Log) -> None:
    """The true noise is 1.4 times as large as is said. In the end the log has counted three times.

    Before, it has as much information as if the noise had been said.
    """
    bare, said = dataclasses.replace(log, current=None, dphi=None, dtheta=None), Noise(7.1e-4)
    good, bad = identify(bare, BUILDABLE), identify(bare, BUILDABLE, noise=said)
    assert bad.chi2 > 1.7
    share = [np.sqrt(np.diag(each.covariance)) / good.tolerance for each in (good, bad)]
    assert share[1].min() == pytest.approx(share[0].min(), rel=0.1)
    for _ in range(2):
        bad = identify(bare, bad.params, covariance=bad.covariance, noise=said)
    known = np.sqrt(np.diag(bad.covariance)) / good.tolerance
    assert 0.9 < known.max() < 1.001


def test_a_slope_is_one_more_unknown() -> None:
    sloped = dataclasses.replace(BUILDABLE, slope=np.radians(-1.5))
    found = identify(driven(sloped, 1.0), BUILDABLE, [*PHYSICAL, "slope"])
    assert found.params.slope == pytest.approx(sloped.slope, abs=np.radians(0.2))


def test_what_a_machine_was_taken_not_to_have_is_found() -> None:
    damped = dataclasses.replace(BUILDABLE, hub_damping=0.02)
    found = identify(driven(damped), BUILDABLE, ["pendulum_length", "hub_damping"])
    error = abs(found.params.hub_damping - damped.hub_damping)
    assert error < 4 * np.sqrt(found.covariance[1, 1]) < damped.hub_damping


def test_what_the_model_lacks_shifts_lengths_by_less_than_a_percent() -> None:
    """3 % of the power goes into the air, the gear has half a degree of play, the driver 20 kHz.

    A sample of the current comes at any time of the driver's period, in which it ripples.
    """
    windy = driven(dataclasses.replace(MACHINE, pendulum_drag=3.5e-5), 3.0)
    play = np.radians(0.25) * np.sign(windy.current)
    share = np.abs(windy.voltage) / MACHINE.voltage_limit
    swing = MACHINE.voltage_limit * share * (1 - share) / (RISE * MACHINE.armature_resistance * 2e4)
    ripple = swing * np.random.default_rng(0).uniform(-0.5, 0.5, len(windy))
    log = dataclasses.replace(windy, theta=windy.theta + play, current=windy.current + ripple)
    with pytest.raises(LogError, match=r"(theta|current) is .* standard deviations off"):
        identify(log, BUILDABLE)
    angles = dataclasses.replace(log, dphi=None, dtheta=None)
    noise = Noise(angle=3e-3, current=float(np.hypot(5e-3, ripple.std())))
    found = identify(angles, BUILDABLE, noise=noise).params
    assert found.pendulum_length == pytest.approx(MACHINE.pendulum_length, rel=5e-3)
    assert found.leg_length == pytest.approx(MACHINE.leg_length, rel=1e-2)
    assert found.motor_constant == pytest.approx(MACHINE.motor_constant, rel=2e-2)


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_a_log_is_read_as_it_was_written(log: Log, tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"log{suffix}"
    log.save(file)
    read = Log.load(file)
    for field in dataclasses.fields(Log):
        np.testing.assert_allclose(getattr(read, field.name), getattr(log, field.name), 1e-8, 1e-8)
    late = dataclasses.replace(log, time=log.time + 1.7e9)  # the clock of a computer
    late.save(file)
    assert Log.load(file).period == pytest.approx(log.period, rel=1e-3)
    few = dataclasses.replace(log, current=None)
    few.save(file)
    assert Log.load(file).current is None


def test_a_fit_that_diverges_on_its_way_is_refused_with_its_chi2() -> None:
    with pytest.raises(LogError, match=r"chi2 = \d"):
        identify(rocking(PROTOTYPE, 0.15, 0), BUILDABLE.replace(n_legs=5))


def test_the_report_has_what_was_left_out_and_errors_that_are_too_large(log: Log) -> None:
    volts = log.voltage.copy()
    volts[60:68] *= -1
    found = identify(dataclasses.replace(log, voltage=volts), MACHINE)
    assert 0.0 < found.left_out < 0.4  # a stance of some
    assert f", {found.left_out:.0%} left out" in found.report()
    exact = identify(log, MACHINE, noise=Noise(0.01, 0.05, 0.1))
    assert exact.left_out == 0.0
    assert "the errors given are 10 times those of the log" in exact.report()


def test_useless_logs_are_refused_with_the_number_that_shows_it(log: Log, tmp_path: Path) -> None:
    def cut(end):
        columns = {f.name: getattr(log, f.name) for f in dataclasses.fields(Log)}
        return Log(**{name: column[:end] for name, column in columns.items()})

    shares = dataclasses.replace(log, voltage=log.voltage / BUILDABLE.voltage_limit)
    with pytest.raises(LogError, match=r"standard deviations from what was known.*units"):
        identify(shares, BUILDABLE)
    still = dataclasses.replace(log, theta=0.001 * log.theta)
    for legs, off in ((6, r"0\.0[678]\d* rad before"), (8, r"0\.0[345]\d* rad after")):
        with pytest.raises(LogError, match=f"foot: it changes {off} .* {legs} legs"):
            identify(log, BUILDABLE.replace(n_legs=legs))
    for bad, number in (
        (dataclasses.replace(log, phi=np.degrees(log.phi)), r"phi = .*degrees"),
        (dataclasses.replace(log, theta=np.degrees(log.theta)), r"rad/s.*degrees"),
        (dataclasses.replace(log, time=1000 * log.time), "10 s pass .*milliseconds"),
        (cut(20), "lasts 0.19 s"),
        (still, "turns by 0.00"),
        (driven(dataclasses.replace(BUILDABLE, pendulum_length=0.1)), r"chi2 = \d"),
    ):
        with pytest.raises(LogError, match=number):
            identify(bad, BUILDABLE, free=["leg_length", "hub_friction"])
    with pytest.raises(ValueError, match="pendulum_lenght is not free"):
        identify(log, BUILDABLE, tolerance={"pendulum_lenght": 0.01})
    with pytest.raises(ValueError, match=r"shape \(2, 2\); must be \(1, 1\)"):
        identify(log, BUILDABLE, ["leg_length"], covariance=np.eye(2))
    with pytest.raises(ValueError, match="positive definite"):
        identify(log, BUILDABLE, ["leg_length"], covariance=-np.eye(1))
    jump = log.time + 0.5 * (np.arange(len(log)) > 60)
    with pytest.raises(LogError, match=r"0.51 s pass from sample 60"):
        dataclasses.replace(log, time=jump)
    volts = log.voltage.copy()
    volts[7] = np.nan
    with pytest.raises(LogError, match="voltage: sample 7 is not finite"):
        dataclasses.replace(log, voltage=volts)
    file = tmp_path / "log.csv"
    file.write_text("time,phi\n0,1.5\n0.01,1.5\n")
    with pytest.raises(LogError, match="no column theta"):
        Log.load(file)
