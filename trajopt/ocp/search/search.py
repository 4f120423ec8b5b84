"""A search: its starts, their outcomes and optima; its report and its file."""

from __future__ import annotations

import collections
import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from trajopt.files import array_of, read_arrays, require_names, write_arrays
from trajopt.ocp.checks import integer
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.search.optima import Optimum, Outcome, Same, Start, StartFamily, distinct
from trajopt.ocp.transcribe.mesh import Mesh
from trajopt.ocp.transcribe.stored import phases_from_arrays, phases_to_arrays
from trajopt.provenance import provenance

FORMAT = "trajopt search 1"

REMEDY = "search again"

#: Attributes of an outcome that a file keeps as arrays.
_ARRAYS = ("phases", "parameters")


class SearchFileError(ValueError):
    """A file is no search saved by this version, or was edited or damaged since."""


@dataclasses.dataclass(frozen=True, repr=False)
class Search:
    """Starts of a multi-start and what they found.

    Attributes:
        problem: what was solved.
        family: of the starts.
        starts: how many were asked for.
        seed: of the family.
        mesh: that all starts share.
        options: of IPOPT, over `options.IPOPT`.
        outcomes: of the starts that are finished, by index.
        same: (outcome, outcome) -> whether they are the same optimum.
        provenance: versions and git revision.
    """

    problem: Problem
    family: StartFamily
    starts: int
    seed: int
    mesh: Mesh
    options: Mapping[str, Any]
    outcomes: tuple[Outcome, ...] = ()
    same: Same = Outcome.same_as
    provenance: dict[str, Any] = dataclasses.field(default_factory=provenance)

    def start(self, index: int) -> Start:
        """Start number `index`, the same one every time.

        Raises:
            TypeError: the family gives something else than a guess or a `Start`.
        """
        drawn = self.family(np.random.default_rng([self.seed, index]), index)
        if not isinstance(drawn, (Start, Sequence)):
            raise TypeError(f"family: gives {drawn!r}; must be a Start, or a trajectory per phase")
        start = drawn if isinstance(drawn, Start) else Start(tuple(drawn))
        return dataclasses.replace(start, problems=start.problems or (self.problem,))

    @cached_property
    def optima(self) -> tuple[Optimum, ...]:
        """Different local optima, best first."""
        return distinct(self.outcomes, self.same)

    @property
    def failures(self) -> tuple[Outcome, ...]:
        """The starts that led nowhere, by index."""
        return tuple(outcome for outcome in self.outcomes if outcome.failure)

    @property
    def complete(self) -> bool:
        """Whether every start is finished."""
        return len(self.outcomes) == self.starts

    def __repr__(self) -> str:
        best = f"best cost {self.optima[0].cost:.6g}" if self.optima else "none found"
        return (
            f"Search({len(self.outcomes)} of {self.starts} starts, {len(self.optima)} local "
            f"optima, {best}, {len(self.failures)} failed)"
        )

    def report(self, most: int = 10) -> str:
        """At most so many of the best optima and the reasons of failure, as text."""
        most = integer("most", most, 0)
        done, optima = len(self.outcomes), self.optima
        lines = [f"Multi-start, {done} of {self.starts} starts (seed {self.seed})"]
        for optimum in optima[:most]:
            times, kind = len(optimum.found), optimum.best.kind
            lines.append(
                f"  cost {optimum.cost:<15.9g} from {times} start(s), {times / done:.1%}"
                + (f", {kind}" if kind else "")
            )
        if len(optima) > most:
            lines.append(f"  and {len(optima) - most} more, up to {optima[-1].cost:.9g}")
        if not optima:
            lines.append("  NO LOCAL OPTIMUM FOUND")
        reasons = collections.Counter(o.failure.split(":")[0] for o in self.failures)
        lines += [f"  {count} failed: {reason}" for reason, count in reasons.most_common()]
        return "\n".join(lines)

    def save(self, path: str | Path) -> None:
        """Write everything but problem and family to an .npz file.

        Raises:
            OSError: it cannot be written.
        """
        names = [f.name for f in dataclasses.fields(Outcome) if f.name not in _ARRAYS]
        header = {
            "starts": self.starts,
            "seed": self.seed,
            "mesh": dataclasses.asdict(self.mesh),
            "options": dict(self.options),
            "outcomes": [{name: getattr(o, name) for name in names} for o in self.outcomes],
            "provenance": self.provenance,
        }
        arrays: dict[str, Any] = {}
        for outcome in self.outcomes:
            prefix = f"start{outcome.index}_"
            arrays |= phases_to_arrays(outcome.phases, prefix)
            arrays[prefix + "parameters"] = outcome.parameters
        write_arrays(path, FORMAT, header, arrays)

    @classmethod
    def load(
        cls,
        path: str | Path,
        problem: Problem,
        family: StartFamily,
        same: Same = Outcome.same_as,
    ) -> Search:
        """Read what `save` wrote. The caller gives problem and family, which the file lacks.

        Raises:
            FileNotFoundError: there is no such file.
            SearchFileError: it is not a search saved by this version, or was edited or damaged.
        """
        header, arrays = read_arrays(path, FORMAT, SearchFileError, REMEDY)
        try:
            return cls(
                problem=problem,
                family=family,
                starts=header["starts"],
                seed=header["seed"],
                mesh=Mesh.from_dict(header["mesh"]),
                options=header["options"],
                outcomes=_outcomes(header["outcomes"], arrays, problem),
                same=same,
                provenance=header["provenance"],
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise SearchFileError(f"{path}: no valid search ({error}); {REMEDY}") from error


def _outcomes(
    entries: Sequence[Mapping[str, Any]], arrays: Mapping[str, Any], problem: Problem
) -> tuple[Outcome, ...]:
    """The outcomes in a file, of a problem with such phases."""
    outcomes, known = [], set[str]()
    for entry in entries:
        prefix = f"start{integer('index', entry['index'], 0)}_"
        phases = phases_from_arrays(arrays, prefix)
        sizes = [(p.states.shape[-1], p.controls.shape[-1]) for p in phases]
        if sizes != [(len(p.states), len(p.controls)) for p in problem.phases]:
            raise ValueError("a search of another problem")
        shape = (len(problem.parameters),)
        parameters = array_of(arrays, prefix + "parameters", shape)
        outcomes.append(Outcome(phases=phases, parameters=parameters, **entry))
        known |= {*phases_to_arrays(phases, prefix), prefix + "parameters"}
    require_names(arrays, known)
    return tuple(outcomes)
