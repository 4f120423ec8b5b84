"""Options for IPOPT, checked before a solver is built."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import casadi as ca

#: IPOPT's options where a caller sets no others.
IPOPT = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-8,
    "constr_viol_tol": 1e-10,
    "compl_inf_tol": 1e-8,
    "acceptable_iter": 0,
    "max_iter": 500,
    "mu_strategy": "monotone",
    "bound_relax_factor": 0.0,
    "honor_original_bounds": "yes",
}

QUIET = {"print_time": False, "error_on_fail": False}

LIST = "https://coin-or.github.io/Ipopt/OPTIONS.html lists them"


def require_options(options: Mapping[str, Any]) -> None:
    """Refuse options that IPOPT does not have, and values that an option does not accept.

    Raises:
        TypeError: a value is neither a number nor text.
        ValueError: there is no such option, or it does not accept the value.
    """
    for name, value in options.items():
        if not isinstance(value, (int, float, str)):
            raise TypeError(f"{name} = {value!r}: an option of IPOPT is a number or text; {LIST}")
        if isinstance(value, float) and math.isnan(value):
            raise ValueError(f"{name} = {value}: must be a number; it is an option of IPOPT")
        whole = isinstance(IPOPT.get(name), int)
        if whole and (isinstance(value, bool) or not isinstance(value, int)):
            raise TypeError(f"{name} = {value!r}: must be an integer; it is an option of IPOPT")
        _try(name, value)


@lru_cache(maxsize=256)
def _try(name: str, value: float | str) -> None:
    """Let IPOPT itself check an option, on a trivial problem."""
    x = ca.SX.sym("x")
    settings: dict[str, Any] = {"ipopt": {"print_level": 0, "sb": "yes", name: value}, **QUIET}
    try:
        ca.nlpsol("options", "ipopt", {"x": x, "f": x**2}, settings)
    except RuntimeError as error:
        if "No such IPOPT option" in str(error):
            raise ValueError(
                f"{name} = {value!r}: neither a setting of this function nor an option of IPOPT; "
                f"{LIST}"
            ) from None
        raise ValueError(
            f"{name} = {value!r}: this option of IPOPT does not accept that value; {LIST}"
        ) from None
