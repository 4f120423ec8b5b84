"""A solved case: its motion, how it replays, and its row beside what the thesis printed."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from rimless_gym.params import WheelParams
from scripts.studies.thesis.experiments.case import Case, Key
from scripts.studies.thesis.experiments.cases import case_of
from scripts.studies.thesis.experiments.power import energy, least_normal_force
from scripts.studies.thesis.experiments.replay import Replay, sampled_times
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.trajectory import PhaseTrajectory

#: The largest errors of a converged case: of the mesh, the simulated states, the touchdowns (s).
MESH_ERROR, STATE_ERROR, TIME_ERROR = 1e-7, 1e-6, 1e-8


@dataclasses.dataclass(frozen=True)
class Solved:
    """A case and its solution.

    Attributes:
        key: of the case.
        extremal: the best solution, refined.
        motion: its steps, after those that it continues.
        optima: cost, number of starts and duration (s) of each local optimum, best first.
        failed: number of starts that failed.
        reaching: number of starts that reached the best optimum.
        simulated: the motion under its own control.
        resampled: the motion as the thesis simulated it.
        seconds: time that the search and the simulations took.
    """

    key: Key
    extremal: Extremal
    motion: tuple[PhaseTrajectory, ...]
    optima: tuple[tuple[float, int, float], ...]
    failed: int
    reaching: int
    simulated: Replay
    resampled: Replay
    seconds: float

    @property
    def case(self) -> Case:
        """The case."""
        return case_of(self.key)

    @property
    def machine(self) -> WheelParams:
        """The machine, with the values found for what was to be chosen."""
        return self.case.machine(self.extremal.parameters)

    @property
    def energy(self) -> float:
        """Integral of the motor's power without sign over all steps (J), as the thesis has it."""
        return energy(self.machine, self.motion)

    @property
    def converged(self) -> bool:
        """Whether the solver converged and the simulation confirms it."""
        if not (self.extremal.converged and self.extremal.mesh_error <= MESH_ERROR):
            return False
        return bool(
            self.case.limit
            or (
                self.simulated.state_error <= STATE_ERROR
                and max(self.simulated.touchdown_time_errors) <= TIME_ERROR
            )
        )

    def rows(self) -> list[dict[str, Any]]:
        """Rows of `results.json`: one for every time that the thesis prints the case."""
        return [
            {
                "experiment": self.case.experiment,
                "variant": printed.variant,
                "thesis_cost": printed.cost,
                "cost": self.extremal.cost,
                "thesis_energy_J": printed.energy,
                "energy_J": self.energy,
                "thesis_touchdown_time_error": printed.late,
                **self._figures(),
            }
            for printed in self.case.printed
        ]

    @property
    def _played_back(self) -> float | None:
        played = self.extremal.resimulation
        return max(played.phase_errors) if played else None

    def _figures(self) -> dict[str, Any]:
        extremal, exact, coarse = self.extremal, self.simulated, self.resampled
        names = extremal.problem.parameters
        peak = max(np.abs(p.control(sampled_times(p))).max() for p in self.motion)
        return {
            "final_time": extremal.duration,
            "max_state_error": exact.state_error,
            "touchdown_time_error": _number(max(exact.touchdown_time_errors)),
            "min_normal_force_over_weight": least_normal_force(self.machine, self.motion),
            "peak_voltage": float(peak),
            "converged": self.converged,
            "starts": self.case.effort.starts,
            "starts_reaching_best": self.reaching,
            "starts_failed": self.failed,
            "local_optima": [list(optimum) for optimum in self.optima],
            "parameters": dict(zip(names, extremal.parameters.tolist(), strict=True)),
            "mesh_error": extremal.mesh_error,
            "played_back_error": self._played_back,
            "thesis_style_state_error": coarse.state_error,
            "thesis_style_touchdown_time_errors": [
                _number(e) for e in coarse.touchdown_time_errors
            ],
            "seconds": self.seconds,
        }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
