"""The simulator as one JavaScript text, for browsers and Node."""

from __future__ import annotations

import json
from importlib.resources import files

from scipy.integrate import DOP853

from rimless_gym.javascript.physics import physics
from rimless_gym.params import WheelParams

#: What the text gives to those that use it.
_EXPORTED = (
    *("constants", "advance", "atRest", "rates", "observation", "electrical_power"),
    *("relative_rate", "motor_current", "motor_voltage", "hub_position", "pendulum_clearance"),
    *("after_touchdown", "after_lift_off", "ground_reaction", "mechanical_energy"),
    *("CONTROL_PERIOD", "LOSSES", "OK", "SINGLE", "DOUBLE"),
)


def simulator(params: WheelParams) -> str:
    """JavaScript that defines `wheel`, an object of functions; it needs nothing else.

    ``wheel.constants(machine)`` gives the constants of a machine, an object with the fields of
    `WheelParams`; ``wheel.advance(state, volts, seconds, constants)`` advances a wheel; see
    `stepping.js`, and `rimless_gym.javascript.physics.physics` for what `params` decides.
    """
    tableau = {"A": DOP853.A, "B": DOP853.B, "E3": DOP853.E3, "E5": DOP853.E5}
    stepping = (files(__package__) / "stepping.js").read_text(encoding="utf-8")
    parts = [
        physics(params),
        *(f"const {name} = {json.dumps(weights.tolist())};" for name, weights in tableau.items()),
        stepping,
        f"return {{ {', '.join(_EXPORTED)} }};",
    ]
    body = "\n\n".join(parts)
    return f"const wheel = (() => {{\n'use strict';\n{body}\n}})();\n"
