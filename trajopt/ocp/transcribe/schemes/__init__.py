"""Collocation schemes, one per file, and the names by which a mesh asks for them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from trajopt.ocp.transcribe.schemes.hermite_simpson import hermite_simpson
from trajopt.ocp.transcribe.schemes.radau import radau
from trajopt.ocp.transcribe.schemes.scheme import Scheme
from trajopt.ocp.transcribe.schemes.trapezoid import trapezoid

__all__ = ["SCHEMES", "Family", "Scheme"]


class Family(NamedTuple):
    """The schemes of one name.

    Attributes:
        of_degree: (degree of the state, highest degree of the control or None) -> the scheme.
        degree: of the state, if all elements have the same one.
    """

    of_degree: Callable[[int, int | None], Scheme]
    degree: int | None = None


SCHEMES = {
    "trapezoid": Family(lambda degree, control_degree: trapezoid(), degree=2),
    "hermite-simpson": Family(lambda degree, control_degree: hermite_simpson(), degree=3),
    "radau": Family(radau),
}
