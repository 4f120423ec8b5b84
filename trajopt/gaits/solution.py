"""A solved gait: its states and voltage at any time, its figures of merit, its report and file."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike

from rimless_gym.checks import real_array
from rimless_gym.params import WheelParams
from trajopt.gaits.bounds import cot_bound
from trajopt.gaits.problem import stands
from trajopt.gaits.verify import Verification, floquet_multipliers
from trajopt.ocp.arrays import Array
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.trajectory import (
    PhaseTrajectory,
    phases_from_arrays,
    phases_to_arrays,
    require_side,
)
from trajopt.store import jsonable, provenance, read_arrays, write_arrays

#: The format of a gait's file, and what to do about a file that is not of it.
FORMAT, REMEDY = "rimless-gym gait 3", "copy it again, or solve it again with `rimless gait`"

#: A gait that fewer starts of a search met may not be the best one.
FEW = 3


class GaitFileError(ValueError):
    """A file is not a gait that this version saved, or was edited or damaged since."""


@dataclasses.dataclass(frozen=True)
class Optimality:
    """How accurately a gait was solved for, and how well it meets first-order optimality."""

    mesh_error: float  # largest estimated relative error of the states within an element
    hamiltonian_spread: float  # see `trajopt.ocp.certificate.Certificate`
    transversality_error: float  # see there as well

    @classmethod
    def from_extremal(cls, extremal: Extremal) -> Optimality:
        """The optimality of a solved problem."""
        certificate = extremal.certificate
        return cls(
            extremal.mesh_error, certificate.hamiltonian_spread, certificate.transversality_error
        )


@dataclasses.dataclass(frozen=True, repr=False)
class Solution:
    """A periodic gait with its verification.

    All energies, and thus every CoT, are integrals over the re-simulated stride.

    Attributes:
        params: the machine.
        phases: one single-stance phase per step; of a gait that stops, the last one is in double
            stance, and the stride begins with the lift-off.
        theta_turns: whole turns k that theta gains in a stride.
        regeneration: whether the objective was E (the battery takes energy back), not E+.
        verification: what independent re-simulation measures.
        optimality: of the problem's solution that it came from.
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
    provenance: dict[str, Any] = dataclasses.field(default_factory=provenance)
    hold: float | None = None

    def __repr__(self) -> str:
        outcome = "passed" if self.verification.passed else "FAILED"
        held = "" if self.hold is None else f"held for {1e3 * self.hold:g} ms, "
        return (
            f"Solution({self.steps} steps per stride at {self.speed:.4g} m/s, CoT {self.cot:.4g}, "
            f"{held}verification {outcome})"
        )

    # -- trajectory ---------------------------------------------------------------------------

    @property
    def steps(self) -> int:
        """Touchdowns per stride."""
        return len(self.phases) - self.double_stance

    @property
    def double_stance(self) -> bool:
        """Whether the wheel stops on two feet in every stride."""
        return stands(self.phases[-1])

    @cached_property
    def phase_times(self) -> Array:
        """Times of the stride's start and of its touchdowns (s), shape (steps + 1,).

        Of a gait that stops, the lift-off follows: shape (steps + 2,).
        """
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
        phase = np.clip(phase, 0, len(self.phases) - 1)
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
    def cot_bound(self) -> float:
        """A cost of transport by E+ below which no gait of this speed, steps and turns can walk."""
        return cot_bound(
            self.params, speed=self.speed, steps=self.steps, theta_turns=self.theta_turns
        )

    @property
    def _weight_times_distance(self) -> float:
        return self.params.weight * self.verification.distance

    @cached_property
    def floquet(self) -> Array:
        """Multipliers of a stride in open loop, largest first, complex, shape (4,).

        Open loop: each step's voltage is played back in time, switched by the touchdowns. By the
        variational equation with saltation (`trajopt.gaits.verify.monodromy`).
        """
        return floquet_multipliers(self.params, self.phases)

    # -- output -------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """Figures and provenance as plain JSON values (infinities and NaN as null)."""
        figures = {
            "params": self.params.to_dict(),
            "speed": self.speed,
            "steps": self.steps,
            "double_stance": self.double_stance,
            "theta_turns": self.theta_turns,
            "regeneration": self.regeneration,
            "hold": self.hold,
            "cost": self.cost,
            "cot": self.cot,
            "cot_with_regeneration": self.cot_with_regeneration,
            "cot_bound": self.cot_bound,
            "phase_times": self.phase_times.tolist(),
            "floquet": [abs(m) for m in self.floquet],
            "passed": self.verification.passed,
            "verification": self.verification.to_dict(),
            "optimality": dataclasses.asdict(self.optimality),
            "provenance": self.provenance,
        }
        return dict(jsonable(figures))

    def report(self) -> str:
        """The gait's figures as text; failures in capitals."""
        return _report(self)

    def save(self, path: str | Path) -> None:
        """Write an .npz of plain arrays, everything else in it as JSON text, with a digest."""
        header = {
            "theta_turns": self.theta_turns,
            "regeneration": self.regeneration,
            "provenance": self.provenance,
            "hold": self.hold,
            "params": self.params.to_dict(),
            "verification": self.verification.to_dict(),
            "optimality": dataclasses.asdict(self.optimality),
        }
        write_arrays(path, FORMAT, header, phases_to_arrays(self.phases))

    @classmethod
    def load(cls, path: str | Path | IO[bytes]) -> Solution:
        """Read what `save` wrote, if it has not changed since.

        Raises:
            FileNotFoundError: there is no such file.
            trajopt.gaits.solution.GaitFileError: it is not a gait saved by this version, or was
                edited or damaged.
        """
        header, arrays = read_arrays(path, FORMAT, GaitFileError, REMEDY)
        try:
            return cls(
                params=WheelParams(**header["params"]),
                phases=phases_from_arrays(arrays),
                theta_turns=header["theta_turns"],
                regeneration=header["regeneration"],
                verification=Verification.from_dict(header["verification"]),
                optimality=Optimality(**header["optimality"]),
                provenance=header["provenance"],
                hold=header.get("hold"),  # gaits saved by earlier versions have none
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise GaitFileError(f"{path}: no valid gait ({error!r}); {REMEDY}") from error


# -- report ---------------------------------------------------------------------------------------


def _report(gait: Solution) -> str:
    v = gait.verification
    outcome = "passed" if v.passed else "FAILED: " + "; ".join(v.failures)
    # Gaits saved by earlier versions were simulated in one and have no chain.
    part = "a step" if v.spans <= len(gait.phases) else f"{v.spans} spans"
    chain = "" if math.isnan(v.chain_error) else f", {v.chain_error:.1e} in a chain of steps"
    touchdowns = gait.phase_times[1 : gait.steps + 1]
    demand, impulse = v.max_friction_demand, v.max_impulse_friction_demand
    lines = [
        f"Periodic gait, {gait.steps} step(s) per stride at {gait.speed:.4f} m/s{_held(gait)}",
        f"  verification            {outcome}",
        f"  cost of transport       {gait.cot:.6f} at {gait.speed:.4f} m/s (with regeneration "
        f"{gait.cot_with_regeneration:.6f})",
        f"  lower bound             {gait.cot_bound:.6f} for these steps and turns{_above(gait)}",
        f"  energy of a stride      {gait.cost:.6f} J"
        f" ({'E, with' if gait.regeneration else 'E+, no'} regeneration)",
        f"  times of touchdown      {', '.join(f'{t:.6f}' for t in touchdowns)} s",
        *_standing(gait),
        f"  turns of theta          {gait.theta_turns} per stride",
        f"  peak voltage            {v.peak_voltage:.3f} of {gait.params.voltage_limit:g} V",
        f"  least normal force      {v.min_normal_force:.3f} N, "
        f"{v.min_normal_force_over_weight:.4f} of the weight",
        f"  friction demand         {demand:.4f} in stance, {impulse:.4f} at touchdown "
        f"(ground offers {gait.params.friction:g})",
        f"  pendulum's clearance    {v.clearance:.3f} m",
        f"  re-simulated            off by {v.state_error:.1e} in {part}{chain}",
        f"  energy audit            off by {v.energy_audit:.1e} J",
        f"  mesh error              {gait.optimality.mesh_error:.1e}",
        *_certainty(gait),
        *_search(gait),
        f"  Floquet, open loop      {', '.join(f'{abs(m):.3g}' for m in gait.floquet)}",
    ]
    return "\n".join(lines)


def _above(gait: Solution) -> str:
    """How far a gait is above its lower bound, for its report; empty where that is 0."""
    if gait.cot_bound == 0:
        return ""
    return f"; the gait is {gait.cot / gait.cot_bound - 1:.2%} above it"


def _search(gait: Solution) -> list[str]:
    """How many starts of a search met the gait, and what to do if few did."""
    met, tried = (gait.provenance.get(name, 0) for name in ("met", "tried"))
    few = f"; few did: try starts={2 * tried}, or another seed" if met < FEW else ""
    return (
        [f"  search                  {met} of {tried} starts met this gait{few}"] if tried else []
    )


def _standing(gait: Solution) -> list[str]:
    """The line on double stance, for the report of a gait that stops."""
    if not gait.double_stance:
        return []
    begin, end = gait.phase_times[-2:]
    return [f"  on two feet             {end - begin:.6f} s, until it lifts off at {end:.6f} s"]


def _held(gait: Solution) -> str:
    """The clock, for the heading of a report."""
    if gait.hold is None:
        return ""
    ticks = round(gait.duration / gait.hold)
    return f", voltage held for {1e3 * gait.hold:g} ms ({ticks} intervals)"


def _certainty(gait: Solution) -> list[str]:
    """Lines on optimality or, under a clock, on how the stride repeats itself."""
    v, o = gait.verification, gait.optimality
    if gait.hold is None:
        return [
            f"  Hamiltonian             spread {o.hamiltonian_spread:.1e}, "
            f"transversality {o.transversality_error:.1e}"
        ]
    return [
        f"  stepped on the kernel   repeats itself to {v.repeat_error:.1e}, "
        f"ledger off by {v.repeat_residual:.1e} J",
        f"  first tick              {gait.first_tick:.6f} s after the touchdown",
    ]
