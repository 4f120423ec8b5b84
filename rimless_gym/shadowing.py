"""Whether the packages installed with this one are ours: others may be called the same."""

from __future__ import annotations

import importlib.util
from importlib.metadata import packages_distributions
from pathlib import Path

#: Packages that are installed with this one. The text of their `__init__.py` holds `MARK`.
PACKAGES = ("trajopt", "agents")

MARK = "rimless-gym"


class ShadowedError(ImportError):
    """Another package has the name of one of ours, and is found first."""


def require_ours() -> None:
    """Check, without importing them, that the packages installed with this one are ours.

    Raises:
        ShadowedError: one is not; it says what is in its place, where, and the remedy.
    """
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        found = None if spec is None else spec.origin
        if found is None:
            raise ShadowedError(
                f"the package {name!r} of rimless-gym is not there; install rimless-gym again"
            )
        if MARK not in Path(found).read_text(encoding="utf-8", errors="replace"):
            raise ShadowedError(
                f"another package called {name!r} hides that of rimless-gym: {found}"
                f"{_owner(name)}. Install rimless-gym in a virtual environment of its own, or "
                "remove the other package, then install rimless-gym again"
            )


def _owner(name: str) -> str:
    """The distributions, other than ours, that bring a package of this name."""
    others = {each for each in packages_distributions().get(name, ()) if each != MARK}
    return f" (of {', '.join(sorted(others))})" if others else ""
