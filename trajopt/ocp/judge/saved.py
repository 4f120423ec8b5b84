"""Solutions in files: everything but the problem, whose functions cannot be saved as plain data.

`load` therefore takes the problem and detects a wrong one; `load_phases` needs none.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from trajopt.files import (
    array_of,
    jsonable,
    phases_from_arrays,
    phases_to_arrays,
    read_arrays,
    require_names,
    write_arrays,
)
from trajopt.ocp.judge.accuracy import audit
from trajopt.ocp.judge.costates import Certificate, hamiltonian
from trajopt.ocp.judge.extremal import Attempt, Extremal
from trajopt.ocp.judge.resimulation import Resimulation
from trajopt.ocp.pose.problem import Array, Phase, Problem
from trajopt.ocp.transcribe.mesh import Mesh
from trajopt.ocp.transcribe.packing import evaluated
from trajopt.ocp.transcribe.rows import Breach
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

FORMAT = "trajopt extremal 1"

REMEDY = "copy it again, or solve its problem again"

#: Attributes of a solution that are dataclasses, or tuples of them.
TABLES = ("mesh", "resimulation", "attempts", "breaches", "audit")

#: Those that are JSON values themselves: all that are neither tables, nor arrays, nor the problem.
PLAIN = tuple(
    field.name
    for field in dataclasses.fields(Extremal)
    if field.name not in (*TABLES, "problem", "phases", "parameters", "certificate")
)


class ExtremalFileError(ValueError):
    """A file is not a solution that this version saved, is damaged, or is of another problem."""


def save(extremal: Extremal, path: str | Path) -> None:
    """Write a solution as `trajopt.files` does."""
    write_arrays(path, FORMAT, _header(extremal), _arrays(extremal))


def _arrays(extremal: Extremal) -> dict[str, Array]:
    certificate, arrays = extremal.certificate, phases_to_arrays(extremal.phases)
    for i, costates in enumerate(certificate.costates):
        arrays[f"phase{i}_costates"] = costates
        arrays[f"phase{i}_hamiltonian"] = certificate.hamiltonian[i]
        arrays[f"phase{i}_mean_hamiltonian"] = certificate.mean_hamiltonian[i]
    arrays["parameters"] = extremal.parameters
    arrays["duration_price"] = certificate.duration_price
    return arrays


def _certificate(arrays: dict[str, Any], phases: tuple[PhaseTrajectory, ...]) -> Certificate:
    tables: list[list[Array]] = [[], [], []]
    for i, phase in enumerate(phases):
        elements = len(phase.edges) - 1
        shapes = (elements + 1, phase.states.shape[-1]), (elements, 2), (elements,)
        names = ("costates", "hamiltonian", "mean_hamiltonian")
        for table, name, shape in zip(tables, names, shapes, strict=True):
            table.append(array_of(arrays, f"phase{i}_{name}", shape))
    costates, values, means = map(tuple, tables)
    return Certificate(costates, values, means, array_of(arrays, "duration_price", (len(phases),)))


def _alike(one: Array, other: Array) -> bool:
    return one.shape == other.shape and bool(np.allclose(one, other, rtol=1e-6, atol=1e-12))


def load(path: str | Path, problem: Problem) -> Extremal:
    """Read a solution of `problem`.

    Names, the Hamiltonian along the trajectory and the limits between its nodes are computed again
    and must be as they were saved; otherwise the problem is another one.

    Raises:
        FileNotFoundError: there is no such file.
        ExtremalFileError: it is not a solution saved by this version, was edited or damaged, or is
            of another problem.
    """
    header, arrays = read_arrays(path, FORMAT, ExtremalFileError, REMEDY)
    try:
        return _from_file(path, header, arrays, problem)
    except ExtremalFileError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ExtremalFileError(f"{path}: no valid solution ({error}); {REMEDY}") from error


def _from_file(
    path: str | Path, header: dict[str, Any], arrays: dict[str, Any], problem: Problem
) -> Extremal:
    if header["names"] != _names(problem):
        raise ExtremalFileError(
            f"{path}: a solution of a problem with {header['names']}, while the problem given has "
            f"{_names(problem)}; `load_phases` reads it as a guess"
        )
    phases, shape = phases_from_arrays(arrays), (len(problem.parameters),)
    sizes = [(p.states.shape[-1], p.controls.shape[-1]) for p in phases]
    if sizes != [(len(p.states), len(p.controls)) for p in problem.phases]:
        raise ValueError(f"states and controls of its phases: {sizes}")
    certificate = _certificate(arrays, phases)
    extremal = Extremal(
        problem=problem,
        mesh=Mesh.from_dict(header["mesh"]),
        phases=phases,
        parameters=array_of(arrays, "parameters", shape),
        certificate=certificate,
        resimulation=_resimulation(header["resimulation"]),
        attempts=tuple(Attempt(**a) for a in header["attempts"]),
        breaches=tuple(Breach(**b) for b in header["breaches"]),
        audit=tuple(Breach(**b) for b in header["audit"]),
        **{name: header[name] for name in PLAIN},
    )
    fitting = tuple(np.diff(t.edges) / t.duration for t in phases)
    if not all(map(_alike, fitting, map(np.diff, extremal.mesh.fractions))):
        raise ValueError("its mesh is not that of its trajectory")
    require_names(arrays, _arrays(extremal))
    found = _difference(extremal)
    if found:
        raise ExtremalFileError(
            f"{path}: a solution of another problem than the one given: {found}; `load_phases` "
            "reads it as a guess"
        )
    return extremal


def load_phases(path: str | Path) -> tuple[PhaseTrajectory, ...]:
    """The trajectory that `save` wrote, a guess for any problem with such phases, on any mesh.

    Raises:
        FileNotFoundError: there is no such file.
        ExtremalFileError: it is not a solution saved by this version, or was edited or damaged.
    """
    arrays = read_arrays(path, FORMAT, ExtremalFileError, REMEDY)[1]
    try:
        return phases_from_arrays(arrays)
    except ValueError as error:
        raise ExtremalFileError(f"{path}: no valid solution ({error}); {REMEDY}") from error


def figures(extremal: Extremal) -> dict[str, Any]:
    """Figures and provenance as plain JSON values (infinities and NaN as null)."""
    pairs = zip(extremal.problem.phases, extremal.phases, strict=True)
    parameters = zip(extremal.problem.parameters, extremal.parameters, strict=True)
    values = {
        "converged": extremal.converged,
        "failures": extremal.failures,
        "cost": extremal.cost,
        "duration": extremal.duration,
        "durations": [[phase.name, trajectory.duration] for phase, trajectory in pairs],
        "parameters": dict(parameters),
        "hamiltonian_spread": extremal.certificate.hamiltonian_spread,
        "transversality_error": extremal.certificate.transversality_error,
        **_header(extremal),
    }
    return dict(jsonable(values))


def _header(extremal: Extremal) -> dict[str, Any]:
    return {
        "names": _names(extremal.problem),
        **{name: _as_dicts(getattr(extremal, name)) for name in TABLES},
        **{name: getattr(extremal, name) for name in PLAIN},
    }


def _names(problem: Problem) -> dict[str, Any]:
    phases = [[phase.name, list(phase.states), list(phase.controls)] for phase in problem.phases]
    return {"phases": phases, "parameters": list(problem.parameters)}


def _as_dicts(value: Any) -> Any:
    if isinstance(value, tuple):
        return [dataclasses.asdict(item) for item in value]
    return None if value is None else dataclasses.asdict(value)


def _resimulation(values: dict[str, Any] | None) -> Resimulation | None:
    if values is None:
        return None
    return Resimulation(**{**values, "phase_errors": tuple(values["phase_errors"])})


def _difference(extremal: Extremal) -> str:
    """How the saved figures differ from the trajectory's in the problem; "" if they agree."""
    problem, p, certificate = extremal.problem, extremal.parameters, extremal.certificate
    saved = certificate.costates, certificate.hamiltonian
    for phase, trajectory, costates, before in zip(
        problem.phases, extremal.phases, *saved, strict=True
    ):
        gap = _less_integrals(
            phase, trajectory, before - hamiltonian(phase, trajectory, costates, p), p
        )
        if np.any(np.abs(gap) > 1e-8 * (1.0 + np.abs(before))):
            return f"the flow or the running cost of phase {phase.name!r} is different"
    known = {(b.kind, b.name, b.phase): b.amount for b in extremal.audit}
    for breach in audit(problem, extremal.phases, p):
        if breach.amount > known.get((breach.kind, breach.name, breach.phase), 0.0) + 1e-8:
            return str(breach)
    return ""


def _less_integrals(phase: Phase, trajectory: PhaseTrajectory, gap: Array, p: Array) -> Array:
    """A gap of Hamiltonians (M, 2), less the part that prices of integral constraints explain."""
    if phase.integral is None or not np.isfinite(gap).all():
        return gap
    x, u = trajectory.states[:, [0, -1]], trajectory.controls[:, [0, -1]]
    integrands = evaluated(phase.integral.function, x, u, p)
    flat = integrands.reshape(gap.size, -1)
    prices = np.linalg.lstsq(flat, gap.ravel(), rcond=None)[0]
    return np.asarray(gap - integrands @ prices)
