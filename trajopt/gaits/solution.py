"""A solved gait: its states and voltage at any time, its figures of merit, a report."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from rimless_gym.checks import real_array
from rimless_gym.params import WheelParams
from trajopt.files import jsonable
from trajopt.gaits.gait_file import read_gait, write_gait
from trajopt.gaits.gait_problem import gait_problem
from trajopt.gaits.gait_report import report
from trajopt.gaits.optimality import LocalOptimum, Optimality
from trajopt.gaits.stability import floquet_multipliers
from trajopt.gaits.verify import Verification
from trajopt.ocp.arrays import Array
from trajopt.ocp.trajectory import PhaseTrajectory, require_side
from trajopt.provenance import provenance

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclasses.dataclass(frozen=True, repr=False)
class Solution:
    """A periodic gait with its verification.

    All energies, and thus every CoT, are integrals over the re-simulated stride.

    Attributes:
        params: the machine.
        phases: one single-stance phase per step.
        theta_turns: whole turns k that theta gains in a stride.
        regeneration: whether the objective was E (the battery takes energy back), not E+.
        verification: what independent re-simulation says.
        optimality: of the problem's solution that it came from.
        optima: distinct local optima met in the search, best first.
        provenance: versions, git revision and settings with which it was made.
        hold: period of the clock (s) between whose ticks the voltage is constant; None if it may
            change at any time.
    """

    params: WheelParams
    phases: tuple[PhaseTrajectory, ...]
    theta_turns: int
    regeneration: bool
    verification: Verification
    optimality: Optimality
    optima: tuple[LocalOptimum, ...] = ()
    provenance: dict[str, Any] = dataclasses.field(default_factory=provenance)
    hold: float | None = None

    def __repr__(self) -> str:
        verdict = "passed" if self.verification.passed else "FAILED"
        held = "" if self.hold is None else f"held for {1e3 * self.hold:g} ms, "
        return (
            f"Solution({self.steps} steps per stride at {self.speed:.4g} m/s, CoT {self.cot:.4g}, "
            f"{held}verification {verdict})"
        )

    # -- trajectory ---------------------------------------------------------------------------

    @property
    def steps(self) -> int:
        """Touchdowns per stride."""
        return len(self.phases)

    @cached_property
    def phase_times(self) -> Array:
        """Times of the stride's start and of its touchdowns (s), shape (steps + 1,)."""
        return np.cumsum([0.0, *(phase.duration for phase in self.phases)])

    @property
    def duration(self) -> float:
        """Time of a stride (s)."""
        return float(self.phase_times[-1])

    def state(self, t: ArrayLike, side: str = "right") -> Array:
        """State (phi, theta, phi', theta') at time t, relabelled at touchdowns.

        Periodic beyond the stride, theta then shifted by 2 pi `theta_turns` per stride.

        Args:
            t: times (s), a scalar or of shape (N,).
            side: "right": after a touchdown at its time; "left": before it.

        Returns:
            Shape (4,) for a scalar, else (N, 4).

        Raises:
            ValueError: `side` is neither, or a time is not finite.
        """
        stride, phase, local = self._locate(t, side)
        states = np.empty((len(local), 4))
        for i, trajectory in enumerate(self.phases):
            here = phase == i
            states[here] = trajectory.state(local[here])
        states[:, 1] += 2 * math.pi * self.theta_turns * stride
        return states if np.ndim(t) else states[0]

    def control(self, t: ArrayLike, side: str = "right") -> Any:
        """Voltage (V) at time t (s): a float for a scalar, else shape (N,).

        The transcription's own polynomials; it may jump between elements. With a `hold` it is
        constant from tick to tick.
        """
        _, phase, local = self._locate(t, side)
        volts = np.empty(len(local))
        for i, trajectory in enumerate(self.phases):
            here = phase == i
            volts[here] = trajectory.control(local[here], side)[:, 0]
        return volts if np.ndim(t) else float(volts[0])

    def foot(self, t: ArrayLike) -> Any:
        """Legs by which the stance foot has moved forward at time t (s): an int, or shape (N,)."""
        stride, phase, _ = self._locate(t, "right")
        legs = stride.astype(np.int64) * self.steps + phase
        return legs if np.ndim(t) else int(legs[0])

    @cached_property
    def breakpoints(self) -> Array:
        """Times within a stride at which the control may jump (s), its end included."""
        starts = zip(self.phase_times, self.phases, strict=False)
        return np.append(np.concatenate([t + p.edges[:-1] for t, p in starts])[1:], self.duration)

    @property
    def first_tick(self) -> float:
        """Time (s) of the first tick of the clock, at which a stride can begin that is held.

        Raises:
            ValueError: the voltage is not held.
        """
        if self.hold is None:
            raise ValueError("hold = None: this gait has no clock; solve it with hold=0.01")
        return float(self.phases[0].edges[1])

    @property
    def held_voltages(self) -> Array:
        """Voltages (V) of the control intervals from `first_tick` on, a stride of them, (ticks,).

        Divided by `params.voltage_limit` they are numbers of single precision, as the environment's
        actions are.

        Raises:
            ValueError: the voltage is not held.
        """
        first, hold = self.first_tick, self.hold
        assert hold is not None
        ticks = round(self.duration / hold)
        return np.asarray(self.control(first + hold * (np.arange(ticks) + 0.5)))

    def _locate(self, t: ArrayLike, side: str) -> tuple[Array, Any, Array]:
        require_side(side)
        times = np.atleast_1d(real_array("t", t))
        if times.ndim != 1:
            raise ValueError(f"t: of shape {times.shape}; give one time, or a row of them")
        if not np.all(np.isfinite(times)):
            raise ValueError("t: every time must be finite")
        T, marks = self.duration, self.phase_times
        stride = np.floor(times / T) if side == "right" else np.ceil(times / T) - 1
        within = np.clip(times - stride * T, 0.0, T)
        phase = np.searchsorted(marks, within, side=side) - 1  # type: ignore[call-overload]
        # Rounding may put a multiple of the stride on either side of it.
        phase = np.clip(phase, 0, self.steps - 1)
        return stride, phase, within - marks[phase]

    # -- figures ------------------------------------------------------------------------------

    @property
    def speed(self) -> float:
        """Mean speed along the ground (m/s)."""
        return self.steps * self.params.step_length / self.duration

    @property
    def cost(self) -> float:
        """The objective: energy of a stride (J); E with regeneration, else E+."""
        v = self.verification
        return v.electrical if self.regeneration else v.electrical_positive

    @property
    def cot(self) -> float:
        """Cost of transport by E+: the battery cannot be recharged."""
        return self.verification.electrical_positive / self._weight_times_distance

    @property
    def cot_with_regeneration(self) -> float:
        """Cost of transport by E: the battery can be recharged."""
        return self.verification.electrical / self._weight_times_distance

    @property
    def _weight_times_distance(self) -> float:
        return self.params.weight * self.verification.distance

    @cached_property
    def floquet(self) -> Array:
        """Multipliers of a stride in open loop, largest first, complex, shape (4,).

        Open loop: each step's voltage is played back in time, switched by the touchdowns. By the
        variational equation with saltation (`trajopt.gaits.stability.monodromy`).
        """
        return floquet_multipliers(self.params, self.phases)

    # -- output -------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """Figures and provenance as plain JSON values (infinities and NaN as null)."""
        figures = {
            "params": self.params.to_dict(),
            "speed": self.speed,
            "steps": self.steps,
            "theta_turns": self.theta_turns,
            "regeneration": self.regeneration,
            "hold": self.hold,
            "cost": self.cost,
            "cot": self.cot,
            "cot_with_regeneration": self.cot_with_regeneration,
            "phase_times": self.phase_times.tolist(),
            "floquet": [abs(m) for m in self.floquet],
            "passed": self.verification.passed,
            "verification": self.verification.to_dict(),
            "optimality": dataclasses.asdict(self.optimality),
            "optima": [dataclasses.asdict(o) for o in self.optima],
            "provenance": self.provenance,
        }
        return dict(jsonable(figures))

    def report(self) -> str:
        """The gait's figures as text; failures in capitals."""
        return report(self)

    def plot(self, path: str | Path | None = None) -> Figure:
        """States and voltage of a stride against time; written to `path` as well, if given."""
        from trajopt.ocp.plots import plot

        problem = gait_problem(
            self.params,
            speed=self.speed,
            steps=self.steps,
            theta_turns=self.theta_turns,
            regeneration=self.regeneration,
        )
        figure = plot(problem, self.phases, np.empty(0), str(self))
        if path is not None:
            figure.savefig(Path(path))
        return figure

    def save(self, path: str | Path) -> None:
        """Write an .npz of plain arrays, everything else in it as JSON text, with a digest."""
        write_gait(path, {f.name: getattr(self, f.name) for f in dataclasses.fields(self)})

    @classmethod
    def load(cls, path: str | Path) -> Solution:
        """Read what `save` wrote, if it has not changed since.

        Raises:
            FileNotFoundError: there is no such file.
            trajopt.gaits.gait_file.GaitFileError: it is not a gait saved by this version, or was
                edited or damaged.
        """
        return cls(**read_gait(path))
