"""Our optimal control engine on the cart-pole."""

from __future__ import annotations

import time
from typing import Any

from trajopt.ocp.solving.guesses import straight_lines
from trajopt.ocp.textbook import cart_pole
from trajopt.ocp.transcribe.mesh import Mesh
from trajopt.ocp.transcribe.nlp import Transcription

from .. import cartpole
from ..protocol import Measure, serve


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Each repetition builds the problem and solves it on one mesh."""
    return lambda seconds: cartpole.repeated(once, seconds), {"version": "rimless-gym"}


def once() -> dict[str, float]:
    """Build and solve."""
    begin = time.perf_counter()
    problem = cart_pole()
    mesh = Mesh.uniform(problem, elements=cartpole.SEGMENTS, scheme="hermite-simpson")
    transcription = Transcription(problem, mesh)
    transcription.solver()
    built = time.perf_counter()
    result = transcription.solve(straight_lines(problem))
    return {
        "build": built - begin,
        "solve": time.perf_counter() - built,
        "iterations": result.iterations,
        "cost": result.cost,
    }


if __name__ == "__main__":
    serve(setup)
