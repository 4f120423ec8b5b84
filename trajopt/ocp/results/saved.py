"""Solutions in files: everything but the problem, whose functions are not plain data.

`load` is therefore given the problem, and detects a wrong one; `load_phases` needs none.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from trajopt.files import array_of, jsonable, read_arrays, require_names, write_arrays
from trajopt.ocp.arrays import Array
from trajopt.ocp.judge.accuracy import audit
from trajopt.ocp.judge.costates import Certificate, hamiltonian
from trajopt.ocp.judge.resimulation import Resimulation
from trajopt.ocp.pose.phase import Phase
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.results.record import Attempt, Record
from trajopt.ocp.transcribe.mesh import Mesh
from trajopt.ocp.transcribe.packing import evaluated
from trajopt.ocp.transcribe.rows import Breach
from trajopt.ocp.transcribe.stored import phases_from_arrays, phases_to_arrays
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

R = TypeVar("R", bound=Record)

FORMAT = "trajopt extremal 1"

REMEDY = "copy it again, or solve its problem again"

#: Attributes of a record that are dataclasses, or tuples of them.
TABLES = ("mesh", "resimulation", "attempts", "breaches", "audit")

#: Attributes that are JSON values: all but the tables, the arrays and the problem.
PLAIN = tuple(
    field.name
    for field in dataclasses.fields(Record)
    if field.name not in (*TABLES, "problem", "phases", "parameters", "certificate")
)


class ExtremalFileError(ValueError):
    """A file is no solution saved by this version, is damaged, or belongs to another problem."""


def save(record: Record, path: str | Path) -> None:
    """Write a solution to an .npz file; see `trajopt.files.write_arrays`."""
    write_arrays(path, FORMAT, _header(record), _arrays(record))


def _arrays(record: Record) -> dict[str, Array]:
    certificate, arrays = record.certificate, phases_to_arrays(record.phases)
    for i, costates in enumerate(certificate.costates):
        arrays[f"phase{i}_costates"] = costates
        arrays[f"phase{i}_hamiltonian"] = certificate.hamiltonian[i]
        arrays[f"phase{i}_mean_hamiltonian"] = certificate.mean_hamiltonian[i]
    arrays["parameters"] = record.parameters
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


def load(path: str | Path, problem: Problem, kind: type[R]) -> R:
    """Read a solution of `problem`.

    To detect another problem, its names, the Hamiltonian along the trajectory and the limits
    between the nodes are compared with what was saved.

    Args:
        path: of the file.
        problem: that was solved.
        kind: the class to make of what was saved.

    Raises:
        FileNotFoundError: there is no such file.
        ExtremalFileError: it is not a solution saved by this version, was edited or damaged, or is
            of another problem.
    """
    header, arrays = read_arrays(path, FORMAT, ExtremalFileError, REMEDY)
    try:
        return _from_file(path, header, arrays, problem, kind)
    except ExtremalFileError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ExtremalFileError(f"{path}: no valid solution ({error}); {REMEDY}") from error


def _from_file(
    path: str | Path,
    header: dict[str, Any],
    arrays: dict[str, Any],
    problem: Problem,
    kind: type[R],
) -> R:
    if header["names"] != _names(problem):
        raise ExtremalFileError(
            f"{path}: the solution of a problem with {header['names']}, while the problem given "
            f"has {_names(problem)}; `load_phases` reads it as a guess"
        )
    phases, shape = phases_from_arrays(arrays), (len(problem.parameters),)
    sizes = [(p.states.shape[-1], p.controls.shape[-1]) for p in phases]
    if sizes != [(len(p.states), len(p.controls)) for p in problem.phases]:
        raise ValueError(f"its phases have {sizes} states and controls")
    certificate = _certificate(arrays, phases)
    record = kind(
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
    if not all(map(_alike, fitting, map(np.diff, record.mesh.fractions))):
        raise ValueError("its mesh is not that of its trajectory")
    require_names(arrays, _arrays(record))
    found = _difference(record)
    if found:
        raise ExtremalFileError(
            f"{path}: the solution of another problem than the one given: {found}; "
            "`load_phases` reads it as a guess"
        )
    return record


def load_phases(path: str | Path) -> tuple[PhaseTrajectory, ...]:
    """The trajectory that `save` wrote: a guess for any problem with such phases, on any mesh.

    Raises:
        FileNotFoundError: there is no such file.
        ExtremalFileError: it is not a solution saved by this version, or was edited or damaged.
    """
    arrays = read_arrays(path, FORMAT, ExtremalFileError, REMEDY)[1]
    try:
        return phases_from_arrays(arrays)
    except ValueError as error:
        raise ExtremalFileError(f"{path}: no valid solution ({error}); {REMEDY}") from error


def figures(record: Record) -> dict[str, Any]:
    """Figures and provenance as plain JSON values (infinities and NaN as null)."""
    pairs = zip(record.problem.phases, record.phases, strict=True)
    parameters = zip(record.problem.parameters, record.parameters, strict=True)
    values = {
        "converged": record.converged,
        "failures": record.failures,
        "cost": record.cost,
        "duration": record.duration,
        "durations": [[phase.name, trajectory.duration] for phase, trajectory in pairs],
        "parameters": dict(parameters),
        "hamiltonian_spread": record.certificate.hamiltonian_spread,
        "transversality_error": record.certificate.transversality_error,
        **_header(record),
    }
    return dict(jsonable(values))


def _header(record: Record) -> dict[str, Any]:
    return {
        "names": _names(record.problem),
        **{name: _as_dicts(getattr(record, name)) for name in TABLES},
        **{name: getattr(record, name) for name in PLAIN},
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


def _difference(record: Record) -> str:
    """How the saved figures differ from those computed with the problem; "" if they agree."""
    problem, p, certificate = record.problem, record.parameters, record.certificate
    saved = certificate.costates, certificate.hamiltonian
    for phase, trajectory, costates, before in zip(
        problem.phases, record.phases, *saved, strict=True
    ):
        gap = _less_integrals(
            phase, trajectory, before - hamiltonian(phase, trajectory, costates, p), p
        )
        if np.any(np.abs(gap) > 1e-8 * (1.0 + np.abs(before))):
            return f"the flow or the running cost of phase {phase.name!r} is different"
    known = {(b.kind, b.name, b.phase): b.amount for b in record.audit}
    for breach in audit(problem, record.phases, p):
        if breach.amount > known.get((breach.kind, breach.name, breach.phase), 0.0) + 1e-8:
            return str(breach)
    return ""


def _less_integrals(phase: Phase, trajectory: PhaseTrajectory, gap: Array, p: Array) -> Array:
    """A difference of Hamiltonians (M, 2), less what prices of integral constraints explain."""
    if phase.integral is None or not np.isfinite(gap).all():
        return gap
    x, u = trajectory.states[:, [0, -1]], trajectory.controls[:, [0, -1]]
    integrands = evaluated(phase.integral.function, x, u, p)
    flat = integrands.reshape(gap.size, -1)
    prices = np.linalg.lstsq(flat, gap.ravel(), rcond=None)[0]
    return np.asarray(gap - integrands @ prices)
