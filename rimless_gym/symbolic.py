"""The hybrid model as CasADi functions, traced from `rimless_gym.equations`."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import casadi as ca

from rimless_gym.equations import MODE_NAMES, equations
from rimless_gym.params import WheelParams, shorthand
from rimless_gym.presets import Machine, as_params

_eq = equations(ca.sin, ca.cos, sqrt=ca.sqrt)


@dataclasses.dataclass(frozen=True)
class Design:
    """Parameters of the machine that an optimisation chooses.

    Attributes:
        names: names of the design variables p.
        fields: p -> fields of `WheelParams` by name, as expressions in p. `n_legs`, the motor
            mount and the impact law cannot be chosen.
    """

    names: tuple[str, ...]
    fields: Callable[[Any], Mapping[str, Any]]

    @classmethod
    def of(cls, *fields: str) -> Design:
        """A design whose variables are fields of `WheelParams`: ``Design.of("gear_ratio")``."""
        return cls(fields, lambda p: {name: p[i] for i, name in enumerate(fields)})

    def machine(self, params: WheelParams, p: Any) -> WheelParams:
        """`params` with the values p (np,) of the design variables."""
        values: dict[str, Any] = {name: float(value) for name, value in self.fields(p).items()}
        return dataclasses.replace(params, **values)


class HybridModel:
    """CasADi functions of the model at `params`.

    The state is x = (phi, theta, phi', theta') in rad and rad/s, the input u the motor voltage
    (V). Every method takes numbers, `DM`, `SX` or `MX`; it returns `DM` for numbers, and otherwise
    the type it was given. `functions` holds the underlying `casadi.Function` objects by name, for
    `map`, `jacobian` and code generation. Double stance holds the wheel at phi = a of its leading
    leg.

    Args:
        params: the machine, a preset's name, or a dictionary of fields that differ from the
            default's.
        design: the parameters to choose. If given, every one of `functions` takes the design
            variables ``p`` as its last input.

    Example:
        >>> from rimless_gym import THESIS_PHYSICAL
        >>> HybridModel(THESIS_PHYSICAL).flow([1.57, 0.0, 1.0, 0.0], 0.0).shape
        (4, 1)
    """

    def __init__(self, params: Machine, design: Design | None = None) -> None:
        self.params, self.design = as_params(params), design

    @cached_property
    def functions(self) -> dict[str, ca.Function]:
        """All functions by name; inputs ``x`` (4) and, where it matters, ``u`` (1)."""
        x, u, p, chosen = ca.SX.sym("x", 4), ca.SX.sym("u"), self.params.constants, []
        if self.design is not None:
            chosen = [ca.SX.sym("p", len(self.design.names))]
            machine = dataclasses.asdict(self.params) | dict(self.design.fields(chosen[0]))
            p = shorthand(SimpleNamespace(**machine), ca.sin, ca.cos)
        phi, theta, dphi, dtheta = ca.vertsplit(x)
        rate = _eq.relative_rate(dphi, dtheta, p)
        ddphi, ddtheta = _eq.single_stance(phi, theta, dphi, dtheta, u, p)
        standing = _eq.double_stance(p.a, theta, 0, dtheta, u, p)
        names = "x", "u"
        outputs: dict[str, tuple[list[Any], Any]] = {
            "flow": ([x, u], (dphi, dtheta, ddphi, ddtheta)),
            "flow_double_stance": ([x, u], (0, dtheta, 0, standing)),
            "touchdown": ([x], _eq.touchdown(phi, theta, dphi, dtheta, p)),
            "touchdown_backward": ([x], _eq.touchdown_backward(phi, theta, dphi, dtheta, p)),
            "ground_reaction": (
                [x, u],
                _eq.ground_reaction(phi, theta, dphi, dtheta, ddphi, ddtheta, p),
            ),
            "ground_reaction_double_stance": (
                [x, u],
                _eq.ground_reaction(p.a, theta, 0, dtheta, 0, standing, p),
            ),
            "lift_off_guards": ([x, u], _eq.lift_off_guards(theta, dtheta, u, p)),
            "stop_on_two_feet": (
                [x],
                (p.a, theta, 0, _eq.stop_on_two_feet(phi, theta, dphi, dtheta, p)),
            ),
            "electrical_power": ([x, u], (_eq.electrical_power(rate, u, p),)),
            "losses": ([x, u], _eq.losses(dphi, rate, _eq.relative_rate(ddphi, ddtheta, p), u, p)),
            "losses_double_stance": ([x, u], _eq.losses(0, dtheta, standing, u, p)),
            "motor_current": ([x, u], (_eq.motor_current(rate, u, p),)),
            "motor_torque": ([x, u], (_eq.motor_torque(rate, u, p),)),
            "relative_rate": ([x], (rate,)),
            "mechanical_energy": ([x], (_eq.mechanical_energy(phi, theta, dphi, dtheta, p),)),
            "weight": ([x], ((p.m1 + p.m2) * self.params.gravity,)),  # in any state
            "linear_momentum": ([x], _eq.linear_momentum(phi, theta, dphi, dtheta, p)),
            "hub_position": ([x], _eq.hub_position(phi, p)),
            "pendulum_clearance": ([x], (_eq.pendulum_clearance(phi, theta, p),)),
        }
        return {
            name: ca.Function(
                name,
                [*inputs, *chosen],
                [ca.vertcat(*out)],
                [*names[: len(inputs)], *("p" for _ in chosen)],
                ["out"],
            )
            for name, (inputs, out) in outputs.items()
        }

    def flow(self, x: Any, u: Any, mode: str = "single_stance") -> Any:
        """x' (4) in the given stance mode."""
        return self.functions[_with_mode("flow", mode)](x, u)

    def touchdown(self, x: Any) -> Any:
        """The smooth forward touchdown map: the state (4) on the next stance leg."""
        return self.functions["touchdown"](x)

    def touchdown_backward(self, x: Any) -> Any:
        """The smooth backward touchdown map: the state (4) on the leg behind.

        Raises:
            ValueError: the impact law is "thesis", which covers forward touchdowns only.
        """
        if self.params.impact_law == "thesis":
            raise ValueError(
                "impact_law = 'thesis' covers forward touchdowns only: use another law"
            )
        return self.functions["touchdown_backward"](x)

    def ground_reaction(self, x: Any, u: Any, mode: str = "single_stance") -> Any:
        """(Fx, Fy) on the stance foot in N; in double stance, summed over both feet."""
        return self.functions[_with_mode("ground_reaction", mode)](x, u)

    def electrical_power(self, x: Any, u: Any) -> Any:
        """V i at the terminals (W), without idle power."""
        return self.functions["electrical_power"](x, u)

    def mechanical_energy(self, x: Any) -> Any:
        """Kinetic and potential energy (J), measured from the stance foot."""
        return self.functions["mechanical_energy"](x)


def _with_mode(name: str, mode: str) -> str:
    if mode not in MODE_NAMES:
        raise ValueError(f"mode = {mode!r}: choose from {MODE_NAMES}")
    return name if mode == "single_stance" else f"{name}_double_stance"
