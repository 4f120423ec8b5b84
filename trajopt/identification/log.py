"""A log of a walk: what the sensors of a wheel report at every tick, in memory, as CSV or npz."""

from __future__ import annotations

import dataclasses
import math
import zipfile
import zlib
from pathlib import Path

import numpy as np

from rimless_gym.checks import real_array, require_kind
from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.hybrid import MAX_RATE
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Floats

#: The columns that every log has, and those of sensors that a wheel may lack.
NEEDED = ("time", "phi", "theta", "foot", "mode", "voltage")
OPTIONAL = ("current", "dphi", "dtheta")

#: How much the time between two samples may differ from the median, as a share of it.
JITTER = 0.1

#: How far beyond its touchdowns the leg may be, by errors of the sensor (rad).
BEYOND = 0.1

#: How far short of a touchdown the leg may be when the foot changes, beyond what it moves from one
#: sample to the next, and how far past it, in the median (rad).
OFF = 0.03

#: Least length of a log (s), least turn of the pendulum in it (rad), and most time between samples
#: (s), in which a wheel takes a large part of a step.
SHORTEST, STILLEST, COARSEST = 0.3, 0.2, 0.1


class LogError(ValueError):
    """A log that nothing can be identified from; the message has the number that shows it."""


@dataclasses.dataclass(frozen=True)
class Log:
    """What was measured at n ticks, evenly spaced in time.

    Attributes:
        time: s, shape (n,), as all.
        phi: the stance leg's angle from the ground (rad).
        theta: the pendulum's from the ground's normal (rad), with or without whole turns.
        foot: the stance foot, counted in legs forward of the first one.
        mode: `rimless_gym.equations.SINGLE` or `DOUBLE`; in double stance, foot and phi are those
            of the leading leg.
        voltage: at the motor, constant from each tick to the next (V).
        current: just after the tick (A); None without a sensor.
        dphi, dtheta: the angles' rates (rad/s); None without sensors.

    Raises:
        TypeError: a column is not of real numbers.
        LogError: the columns are of different lengths or not finite, the clock jumps or stands
            still, or a mode is unknown.
    """

    time: Floats
    phi: Floats
    theta: Floats
    foot: Floats
    mode: Floats
    voltage: Floats
    current: Floats | None = None
    dphi: Floats | None = None
    dtheta: Floats | None = None

    def __post_init__(self) -> None:
        for name in (*NEEDED, *OPTIONAL):
            values = getattr(self, name)
            if values is None and name in OPTIONAL:
                continue
            column = np.array(real_array(name, values), dtype=np.float64)
            if column.shape != (len(self),) or len(self) < 2:
                raise LogError(
                    f"{name}: has shape {column.shape}, and time {np.shape(self.time)}; every "
                    "column must have one number per sample, of at least 2"
                )
            if not np.isfinite(column).all():
                raise LogError(
                    f"{name}: sample {np.argmin(np.isfinite(column))} is not finite; leave out the "
                    "log before or after it"
                )
            object.__setattr__(self, name, column)
        steps = np.diff(self.time)
        off = np.abs(steps - self.period)
        if not self.period > 0 or off.max() > JITTER * self.period:
            k = int(off.argmax())
            raise LogError(
                f"time: {steps[k]:.6g} s pass from sample {k} to the next, and {self.period:.6g} s "
                "usually; the clock must not jump: leave out the log before or after it"
            )
        if not (known := np.isin(self.mode, (SINGLE, DOUBLE))).all():
            k = int(known.argmin())
            raise LogError(
                f"mode: is {self.mode[k]:g} at sample {k}; must be {SINGLE} (single stance) or "
                f"{DOUBLE} (double stance)"
            )

    def __len__(self) -> int:
        return len(np.atleast_1d(self.time))

    @property
    def period(self) -> float:
        """Time from one sample to the next (s)."""
        return float(np.median(np.diff(self.time)))

    @classmethod
    def load(cls, path: str | Path) -> Log:
        """Read a log, of `save` or with the same columns from elsewhere.

        Raises:
            FileNotFoundError: there is no such file.
            LogError: it is damaged, lacks a column, or see `Log`.
        """
        path = Path(path)
        try:
            if path.suffix.lower() == ".npz":
                with np.load(path, allow_pickle=False) as data:
                    columns = {name: data[name] for name in data.files}
            else:
                # a table of a spreadsheet may begin with a byte order mark
                if not (text := path.read_text("utf-8-sig").splitlines()):
                    raise ValueError("empty")
                table = np.genfromtxt(text, delimiter=",", names=True, ndmin=1)
                columns = {name: table[name] for name in table.dtype.names or ()}
        except FileNotFoundError as error:
            raise FileNotFoundError(f"{path}: not found; `rimless log` writes a log") from error
        except (
            *(OSError, EOFError, ValueError, LookupError, TypeError),
            *(zipfile.BadZipFile, zlib.error),
        ) as error:
            (first, *_) = str(error).splitlines() or [repr(error)]
            raise LogError(f"{path}: damaged, or no log ({first})") from error
        if missing := [name for name in NEEDED if name not in columns]:
            raise LogError(f"{path}: has no column {', '.join(missing)}; needs {', '.join(NEEDED)}")
        return cls(**{name: columns[name] for name in (*NEEDED, *OPTIONAL) if name in columns})

    def save(self, path: str | Path) -> None:
        """Write the log, as .npz or, with any other suffix, as CSV."""
        path = Path(path)
        columns = {name: getattr(self, name) for name in (*NEEDED, *OPTIONAL)}
        columns = {name: column for name, column in columns.items() if column is not None}
        if path.suffix.lower() == ".npz":
            with path.open("wb") as file:  # numpy adds another suffix to a name in capitals
                np.savez_compressed(file, **columns)
        else:
            table = np.column_stack(list(columns.values()))
            np.savetxt(path, table, "%.15g", ",", header=",".join(columns), comments="")


def require_usable(log: Log, params: WheelParams) -> None:
    """Refuse a log that is too short, too still, or in other units, with a `LogError`."""
    require_kind("log", log, Log)
    c, single = params.constants, log.mode == SINGLE
    outside = np.maximum(c.a - log.phi, log.phi - c.b) * single
    if outside.max() > BEYOND:
        raise LogError(
            f"phi = {log.phi[outside.argmax()]:.4g}: must be from {c.a:.3g} to {c.b:.3g} rad, "
            f"where the {params.n_legs} legs touch down; degrees, or another machine?"
        )
    early, late = _touchdowns_off(log, c.a, c.b)
    if max(early, late) > OFF:
        off, where = (early, "before") if early > late else (late, "after")
        raise LogError(
            f"foot: it changes {off:.2g} rad {where} the leg is where {params.n_legs} legs touch "
            "down; another machine, or an angle that is not measured from the ground?"
        )
    if log.period > COARSEST:
        raise LogError(
            f"time: {log.period:.4g} s pass between samples; must be at most {COARSEST:g} s; "
            "milliseconds?"
        )
    turns = np.abs(np.diff(np.unwrap(log.theta))) / log.period
    if turns.max() > MAX_RATE:
        raise LogError(
            f"theta: turns at {turns.max():.4g} rad/s; must be at most {MAX_RATE:g}; degrees, or "
            "samples that are missing?"
        )
    if (length := log.period * (len(log) - 1)) < SHORTEST:
        raise LogError(f"the log lasts {length:.3g} s: must be at least {SHORTEST:g} s")
    if (turned := float(np.ptp(np.unwrap(log.theta)))) < STILLEST:
        raise LogError(
            f"the pendulum turns by {turned:.2g} rad in the log: must be at least {STILLEST:g} "
            f"({math.degrees(STILLEST):.0f} degrees); drive it farther"
        )


def _touchdowns_off(log: Log, first: float, last: float) -> tuple[float, float]:
    """How far short of a touchdown the leg is when the foot changes, and how far past it (rad).

    In the median; what it moves from one sample to the next is taken off where it is short.
    Touchdowns are at `first` and `last`.
    """
    k = np.flatnonzero(np.diff(log.foot) * (log.mode[:-1] == SINGLE))
    k = k[k > 0]
    if not len(k):
        return 0.0, 0.0
    left = np.minimum(log.phi[k] - first, last - log.phi[k])
    moved = np.abs(log.phi[k] - log.phi[k - 1])
    return float(np.median(left - moved)), float(np.median(-left))
