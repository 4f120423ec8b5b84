"""The Gymnasium environment."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from rimless_gym import energy as row
from rimless_gym.hybrid import CONTACT_LOST, CONTROL_PERIOD, FAILURES, MODE_NAMES, RATE_EXCEEDED
from rimless_gym.params import THESIS_PHYSICAL, WheelParams
from rimless_gym.stepping import (
    FOOT,
    MODE,
    PHI,
    STATE_SIZE,
    THETA,
    advance_kernel,
    require_steppable,
    scratch,
)
from rimless_gym.symbolic import HybridModel
from rimless_gym.task import OBSERVATION_BOUND, Task, draw_start, normal_force, observe
from rimless_gym.trajectory import validated_start

RESET_OPTIONS = ("state", "mode", "params")
_INFO_ROWS = (
    ("distance", row.DISTANCE),
    ("electrical", row.ELECTRICAL),
    ("electrical_positive", row.ELECTRICAL_POSITIVE),
    ("copper", row.COPPER),
    ("friction", row.FRICTION),
    ("drag", row.DRAG),
    ("collision", row.COLLISION),
    ("shaft", row.SHAFT),
    ("mechanical_change", row.MECHANICAL_CHANGE),
    ("force_x", row.FORCE_X),
    ("force_y", row.FORCE_Y),
    ("min_normal_force", row.MIN_NORMAL_FORCE),
    ("friction_demand", row.FRICTION_DEMAND),
    ("impulse_friction_demand", row.IMPULSE_FRICTION_DEMAND),
    ("clearance", row.CLEARANCE),
    ("elapsed", row.TIME),
)


class RimlessWheelEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """An actuated rimless wheel that should walk far on little energy.

    ## Description
    A wheel of `n_legs` spokes and no rim walks on its spokes. A DC motor at the hub swings a
    pendulum; that swing is the only actuation. The wheel stands on one foot or two, every
    touchdown is a plastic impact, and the battery cannot be recharged. The model is that of
    Mihevc, *Dynamic Optimization of a Rimless Wheel with an Actuated Pendulum* (RIT, 2015),
    corrected and extended; `rimless_gym.equations` holds every equation.

    ## Action Space
    `Box(-1, 1, (1,), float32)`: motor voltage in units of `params.voltage_limit`, held for 10 ms.
    Actions outside are clipped; NaN and other shapes raise `ValueError`.

    ## Observation Space
    `Box` of 6 float32 numbers:

    | # | quantity | bound |
    |---|---|---|
    | 0 | leg angle (phi - pi/2) / (alpha/2), in the ground's frame | 1 |
    | 1 | sin theta, pendulum from the ground's normal | 1 |
    | 2 | cos theta | 1 |
    | 3 | phi' / (5 rad/s) | 12 |
    | 4 | theta' / (10 rad/s) | 6 |
    | 5 | 1 while resting on two feet, else 0 | 1 |

    ## Rewards
    In metres: `r = value_of_distance * dx - E+ / ((m1+m2) g)`, with dx the hub's travel along the
    ground and E+ the electrical energy drawn, without regeneration, plus idle power. An episode
    that ends early is charged `value_of_distance * fall_distance` and the idle energy of
    `horizon`. The three terms
    are `info["reward_distance"]`, `info["reward_energy"]` and `info["reward_end"]`; their sum in
    this order is the reward, exactly. Resting earns 0 (idle power apart).

    ## Starting State
    One start in four is at rest on two feet, theta within 0.5 rad of hanging and theta' within
    1 rad/s. The others are in single stance: phi in [a, b], theta in [-pi, pi], phi' in [0, 2]
    and theta' in [-3, 3] rad/s, drawn evenly and kept if the foot presses on the ground.
    `reset(options=...)` takes `state` (phi, theta, phi', theta'), with it `mode`
    ("single_stance", the default, or "double_stance", in which phi = a), and `params` (a
    `WheelParams`, from then on). `mode` "double_stance" alone is a wheel at rest, its pendulum
    hanging.

    ## Episode End
    Terminates where the model ends: when the ground would have to pull a foot (contact lost;
    located as an event, the step ends there) or a rate exceeds 60 rad/s; `info["failure"]` says
    which. Resting and whole turns of the pendulum are legal. Truncates after 2000 steps (20 s).

    ## Arguments
    - `params`: the machine, default `THESIS_PHYSICAL`.
    - `task`: `rimless_gym.Task(value_of_distance=0.5, fall_distance=2.0, horizon=20.0)`.
    - `render_mode`: `"rgb_array"` (needs no display) or `"human"`.

    `info` holds each term of the step's energy ledger (J), the net and total touchdowns `steps`
    and `touchdowns`, the ground reaction at the end of the step and its extremes (N), the
    pendulum's clearance (m), `mode`, `failure`, and `slips`: whether a force or an impulse asked
    for more friction than `params.friction` offers (the model's foot holds all the same).

    ## Version History
    - v0: first version, unreleased.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": ["human", "rgb_array"],
        "render_fps": round(1 / CONTROL_PERIOD),
    }

    def __init__(
        self,
        params: WheelParams = THESIS_PHYSICAL,
        task: Task | None = None,
        render_mode: str | None = None,
    ) -> None:
        if not isinstance(params, WheelParams):
            raise TypeError(
                f"params = {params!r}: give a WheelParams, e.g. rimless_gym.preset('PROTOTYPE')"
            )
        if task is not None and not isinstance(task, Task):
            raise TypeError(f"task = {task!r}: give a rimless_gym.Task")
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            modes = self.metadata["render_modes"]
            raise ValueError(f"render_mode = {render_mode!r}: choose from {modes} or None")
        require_steppable(params)
        self.params = params
        self.task = Task() if task is None else task
        self.render_mode = render_mode
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = spaces.Box(-OBSERVATION_BOUND, OBSERVATION_BOUND)
        self._state: NDArray[np.float64] | None = None
        self._out = np.zeros(row.N_ROWS)
        self._scratch = scratch()
        self._time = 0.0
        self._voltage = 0.0
        self._ended = False
        self._window: Any = None

    @cached_property
    def model(self) -> HybridModel:
        """The hybrid model as CasADi functions, for optimisation and model-based control."""
        return HybridModel(self.params)

    @property
    def state(self) -> NDArray[np.float64]:
        """A copy of the hybrid state: phi, theta, phi', theta', mode, foot."""
        if self._state is None:
            raise RuntimeError("no episode has begun: call reset() first")
        return self._state.copy()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode; see "Starting State" for the options.

        Raises:
            ValueError: an option is unknown or its value out of range.
        """
        super().reset(seed=seed)
        options = dict(options or {})
        for name in options:
            if name not in RESET_OPTIONS:
                raise ValueError(f"unknown reset option {name!r}: choose from {RESET_OPTIONS}")
        params = options.get("params", self.params)
        if not isinstance(params, WheelParams):
            raise ValueError(f"params = {params!r}: give a WheelParams")
        require_steppable(params)
        if options.get("mode") == "double_stance":
            options.setdefault("state", (params.constants.a, params.slope, 0.0, 0.0))
        if "mode" in options and "state" not in options:
            raise ValueError("reset option 'mode' goes with 'state': give both")
        if "state" in options:
            mode = options.get("mode", "single_stance")
            self._state = _given_start(params, options["state"], mode)
        else:
            self._state = draw_start(params, self.np_random)
        if params is not self.params:
            self.params = params
            self.__dict__.pop("model", None)
        self._time, self._voltage, self._ended = 0.0, 0.0, False
        if self.render_mode == "human":
            self.render()
        return observe(self.params, self._state), {"mode": MODE_NAMES[int(self._state[MODE])]}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Hold a voltage for 10 ms; see the class for what comes back.

        Raises:
            ValueError: the action is NaN or not of shape (1,).
            RuntimeError: no episode is running, or the motion left the model's range.
        """
        if self._state is None or self._ended:
            raise RuntimeError("no episode is running: call reset() first")
        if getattr(action, "shape", None) != (1,) and np.shape(action) != (1,):
            raise ValueError(f"action = {action!r}: must have shape (1,), not {np.shape(action)}")
        command = float(action[0])
        if command != command:
            raise ValueError("action = NaN: must be a number in [-1, 1]; check the policy's output")
        params, out, state = self.params, self._out, self._state
        self._voltage = params.voltage_limit * min(max(command, -1.0), 1.0)
        failure = advance_kernel(
            params.constants_array,
            params.motor_pole,
            state,
            self._voltage,
            CONTROL_PERIOD,
            0.0,
            out,
            self._scratch,
        )
        terminated = failure in (CONTACT_LOST, RATE_EXCEEDED)
        if failure and not terminated:
            raise RuntimeError(
                f"the motion left the model's range ({FAILURES[failure]}) at t = {self._time} s, "
                f"state {state}: check the parameters, {params}"
            )
        rows = out.tolist()
        self._time += rows[row.TIME]
        info: dict[str, Any] = {name: rows[index] for name, index in _INFO_ROWS}
        info["idle"] = params.idle_power * rows[row.TIME]
        info["steps"], info["touchdowns"] = int(rows[row.STEPS]), int(rows[row.TOUCHDOWNS])
        demand = max(info["friction_demand"], info["impulse_friction_demand"])
        info["slips"] = demand > params.friction
        info["mode"] = MODE_NAMES[int(state[MODE])]
        info["failure"] = FAILURES[failure] if terminated else None
        terms = self.task.reward_terms(
            params,
            rows[row.DISTANCE],
            rows[row.ELECTRICAL_POSITIVE] + info["idle"],
            float(terminated),
        )
        info["reward_distance"], info["reward_energy"], info["reward_end"] = terms
        self._ended = terminated
        if self.render_mode == "human":
            self.render()
        return observe(params, state), terms[0] + terms[1] + terms[2], terminated, False, info

    def render(self) -> NDArray[np.uint8] | None:
        """The current frame (H, W, 3) in mode "rgb_array"; drawn to a window in mode "human"."""
        if self.render_mode is None:
            gym.logger.warn("render() without a render_mode: give one to gym.make()")
            return None
        from rimless_gym.rendering import Scene, Window, draw  # pygame only when it is needed

        state = self.state
        scene = Scene(
            phi=state[PHI],
            theta=state[THETA],
            mode=int(state[MODE]),
            foot_x=state[FOOT] * self.params.step_length,
            voltage=self._voltage,
            time=self._time,
        )
        frame = draw(self.params, scene)
        if self.render_mode == "rgb_array":
            return frame
        if self._window is None:
            self._window = Window((frame.shape[1], frame.shape[0]), self.metadata["render_fps"])
        self._window.show(frame)
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None


def _given_start(params: WheelParams, x: ArrayLike, mode: str) -> NDArray[np.float64]:
    state = np.zeros(STATE_SIZE)
    state[:4], state[MODE] = validated_start(params, x, mode, "state")
    force = normal_force(params, state)
    if force <= 0:
        raise ValueError(
            f"state = {x!r}: without voltage the ground would have to pull the foot "
            f"({force:.3g} N); give a slower state"
        )
    return state
