"""Pictures of a solution show all that they should."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes

from trajopt.ocp.extremal import Extremal
from trajopt.ocp.problem import Linkage, Phase, Problem
from trajopt.ocp.solve import solve
from trajopt.ocp.trajectory import PhaseTrajectory


def flight() -> Problem:
    """A rocket on a line, powered, then coasting without a control."""
    powered = Phase(
        "powered",
        states=("height", "speed"),
        controls=("thrust",),
        flow=lambda x, u, p: [x[1], u[0] - 1.0],
        cost=lambda x, u, p: u[0] ** 2,
        bounds={"thrust": (0.0, 6.0)},
        start={"height": 0.0, "speed": 0.0},
        duration=1.0,
    )
    coasting = Phase(
        "coasting",
        states=("height", "speed"),
        flow=lambda x, u, p: [x[1], -1.0],
        end={"height": 1.0, "speed": 0.0},
        duration=(0.1, 2.0),
    )
    return Problem((powered, coasting), (Linkage(0, 1),))


@pytest.fixture(scope="module")
def extremal() -> Extremal:
    return solve(flight())


def panels(extremal: Extremal) -> dict[str, Axes]:
    return {panel.get_ylabel(): panel for panel in extremal.plot().axes if panel.axison}


def test_every_state_and_control_has_a_panel_and_so_has_the_hamiltonian(
    extremal: Extremal,
) -> None:
    assert set(panels(extremal)) == {"height", "speed", "thrust", "Hamiltonian"}


def test_a_picture_is_written_without_a_display_and_without_open_figures(
    extremal: Extremal, tmp_path: Path
) -> None:
    before = plt.get_fignums()
    extremal.plot(tmp_path / "flight.png")
    assert (tmp_path / "flight.png").read_bytes().startswith(b"\x89PNG")
    assert plt.get_fignums() == before


def test_the_elements_edges_are_marked(extremal: Extremal) -> None:
    marked = {
        round(float(np.asarray(line.get_xdata())[0]), 9)
        for line in panels(extremal)["height"].lines
        if len(np.asarray(line.get_xdata())) == 2
    }
    first, second = extremal.phases
    edges = {*first.edges.round(9), *(second.edges + first.duration).round(9)}
    assert edges <= marked


def test_bounds_are_dashed(extremal: Extremal) -> None:
    dashed = [line for line in panels(extremal)["thrust"].lines if line.get_linestyle() == "--"]
    assert [np.asarray(line.get_ydata())[0] for line in dashed] == [0.0, 6.0]


def test_the_solution_played_back_lies_on_the_solution_and_a_wrong_one_does_not(
    extremal: Extremal,
) -> None:
    phase = extremal.phases[0]
    wrong = dataclasses.replace(phase, states=phase.states + [0.0, 0.1] * (phase.nodes[:, None]))
    for shown, off in ((extremal, 1e-6), (with_phase(extremal, wrong), 0.05)):
        lines = panels(shown)["speed"].lines
        dotted = next(line for line in lines if line.get_linestyle() == ":")
        t = np.asarray(dotted.get_xdata(), dtype=float)
        gap = np.abs(np.asarray(dotted.get_ydata()) - shown.phases[0].state(t)[:, 1]).max()
        assert (gap < off) == (shown is extremal)


def with_phase(extremal: Extremal, phase: PhaseTrajectory) -> Extremal:
    return dataclasses.replace(extremal, phases=(phase, *extremal.phases[1:]))


def test_the_title_says_whether_the_solution_failed(extremal: Extremal) -> None:
    coarse = dataclasses.replace(extremal, mesh_error=1.0)
    assert "FAILED" in coarse.plot().get_suptitle()
    assert "converged" in extremal.plot().get_suptitle()
