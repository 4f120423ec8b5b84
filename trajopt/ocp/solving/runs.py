"""Runs of IPOPT: the ladder of options on a first mesh, warm starts on finer ones, the log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from trajopt.ocp.arrays import Array
from trajopt.ocp.judge.candidate import Candidate
from trajopt.ocp.results.record import Attempt
from trajopt.ocp.solving.minimum import minimum
from trajopt.ocp.solving.ties import clearly_smaller
from trajopt.ocp.transcribe.nlp import Result, Transcription
from trajopt.ocp.transcribe.options import require_options
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

#: Options that are tried one set after the other where IPOPT fails.
LADDER: tuple[dict[str, Any], ...] = (
    {},
    {"mu_strategy": "adaptive"},
    {"mu_init": 1.0, "bound_push": 0.1, "bound_frac": 0.1},
    {"mu_strategy": "adaptive", "nlp_scaling_method": "none", "max_iter": 1500},
)

#: IPOPT's first barrier for a warm start. It is small, so that the run does not leave for another
#: optimum. On a finer mesh the second is tried where the first fails.
WARM_BARRIER, WARM_BARRIERS = 1e-4, (1e-4, 1e-6)
WARM_ITERATIONS = 150


class Runs:
    """Runs IPOPT and keeps a log.

    Attributes:
        options: of IPOPT, in all runs.
        attempts: the log.
    """

    def __init__(self, options: Mapping[str, Any]) -> None:
        self.options = dict(options)
        self.attempts: list[Attempt] = []

    def climb(
        self,
        transcription: Transcription,
        guess: Sequence[PhaseTrajectory],
        parameters: Array | None,
        ladder: Sequence[Mapping[str, Any]],
    ) -> Candidate:
        """Solve with the ladder's options one after the other: the first success, or the best."""
        best: Result | None = None
        for rung in ladder:
            tried = {**self.options, **rung}
            result = minimum(transcription, guess, parameters=parameters, **tried)
            self._log(transcription, tried, result)
            if result.success:
                return Candidate(transcription, result)
            if best is None or clearly_smaller(_violation(result), _violation(best)):
                best = result
        assert best is not None  # the ladder has rungs
        return Candidate(transcription, best)

    def again(self, transcription: Transcription, near: Result) -> Candidate:
        """Solve near a result, on another mesh."""
        for barrier in WARM_BARRIERS:
            warm = {"mu_init": barrier} | self.options | {"max_iter": WARM_ITERATIONS}
            found = transcription.solve(near.phases, parameters=near.parameters, **warm)
            self._log(transcription, warm, found)
            if found.success:
                break
        return Candidate(transcription, found)

    def _log(self, transcription: Transcription, options: dict[str, Any], result: Result) -> None:
        elements = transcription.mesh.elements
        self.attempts.append(Attempt(elements, options, result.status, result.iterations))


def _violation(result: Result) -> float:
    return result.breaches[0].amount if result.breaches else 0.0


def require_ladder(ladder: Any, options: Mapping[str, Any]) -> None:
    """Refuse a ladder that is not a sequence of options, and options that IPOPT does not have.

    Raises:
        TypeError: the ladder is not a sequence of mappings, or a value is of the wrong type.
        ValueError: the ladder is empty, or IPOPT has no such option or does not accept its value.
    """
    if not isinstance(ladder, Sequence) or not all(isinstance(r, Mapping) for r in ladder):
        raise TypeError(f"ladder = {ladder!r}: must be a sequence of options, such as ({{}},)")
    if not ladder:
        raise ValueError("ladder: give at least one set of options, such as {}")
    for rung in (options, *ladder):
        require_options(rung)
