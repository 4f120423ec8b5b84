"""Arguments of the environments' constructors and of `reset(options=...)`, checked once.

Wrong types raise a `TypeError`, values out of their range a `ValueError`.
"""

from __future__ import annotations

import copy
import dataclasses
import enum
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from numpy.typing import ArrayLike, NDArray

from rimless_gym.checks import KindError, as_instance, real, real_array
from rimless_gym.envs import EPISODE_STEPS
from rimless_gym.envs.disturbances import as_disturbances, as_ranges
from rimless_gym.envs.layout import (
    COMMANDED_BOUND,
    COMMANDED_SIZE,
    MOST_SPEED,
    OBSERVATION_BOUND,
    OBSERVATION_SIZE,
)
from rimless_gym.envs.starts import DRAWN, GIVEN, HANGING, USUAL_STARTS, Starts, normal_force
from rimless_gym.envs.task import USUAL_TASK, Task
from rimless_gym.equations import MODE_NAMES
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import MODE, STATE_SIZE, require_steppable
from rimless_gym.params import WheelParams
from rimless_gym.presets import as_params
from rimless_gym.trajectory import validated_start

if TYPE_CHECKING:
    from rimless_gym.envs.batch import Batch

#: What an action may be, and whether that is the motor's current rather than a voltage.
ACTIONS = {"voltage": False, "current": True}

#: Most ticks of 10 ms in a control interval.
MOST_TICKS = 10


@dataclasses.dataclass(frozen=True)
class Control:
    """How an agent acts on a wheel. It cannot be changed between episodes.

    Attributes:
        period: length of a control interval (s), a whole multiple of 10 ms up to 100 ms.
        actions: what an action commands, one of `ACTIONS`.
        speeds: least and greatest speed (m/s) between which each episode draws the one that is
            commanded; None where none is.
    """

    period: float = CONTROL_PERIOD
    actions: str = "voltage"
    speeds: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        period = real("control_period", self.period)
        ticks = round(period / CONTROL_PERIOD)
        if not (1 <= ticks <= MOST_TICKS and abs(period - ticks * CONTROL_PERIOD) < 1e-9):
            raise ValueError(
                f"control_period = {period:g} s: must be a whole multiple of {CONTROL_PERIOD:g} s, "
                f"from {CONTROL_PERIOD:g} to {MOST_TICKS * CONTROL_PERIOD:g}"
            )
        if self.actions not in ACTIONS:
            raise ValueError(f"actions = {self.actions!r}: choose from {tuple(ACTIONS)}")
        object.__setattr__(self, "period", ticks * CONTROL_PERIOD)
        if self.speeds is not None:
            least, greatest = as_speeds("speeds", self.speeds, 2).tolist()
            if least > greatest:
                raise ValueError(f"speeds = {self.speeds}: must be in order, the least first")
            object.__setattr__(self, "speeds", (least, greatest))

    @property
    def ticks(self) -> int:
        """Length of a control interval, in units of 10 ms."""
        return round(self.period / CONTROL_PERIOD)

    @property
    def by_current(self) -> bool:
        """Whether an action is the motor's current."""
        return ACTIONS[self.actions]

    @property
    def width(self) -> int:
        """Size of an observation."""
        return OBSERVATION_SIZE if self.speeds is None else COMMANDED_SIZE

    def action_space(self) -> spaces.Space[NDArray[np.float32]]:
        """The space of one action."""
        return spaces.Box(-1.0, 1.0, (1,), np.float32)

    def observation_space(self) -> spaces.Space[NDArray[np.float32]]:
        """The space of one observation."""
        bound = OBSERVATION_BOUND if self.speeds is None else COMMANDED_BOUND
        return spaces.Box(-bound, bound)

    @property
    def episode_steps(self) -> int:
        """The number of intervals that make 20 s, rounded up."""
        return -(-EPISODE_STEPS // self.ticks)


#: A voltage, held for 10 ms.
USUAL = Control()


def as_speeds(name: str, speeds: Any, n: int) -> NDArray[np.float64]:
    """Speeds that may be commanded (m/s), one for all or one each, as a new array (N,)."""
    given = real_array(name, speeds)
    if given.shape not in ((), (n,)):
        raise ValueError(f"{name} = {speeds!r}: give one number, or {n}, not {given.shape}")
    each = np.zeros(n) + given
    if not ((each > 0.0) & (each <= MOST_SPEED)).all():
        raise ValueError(
            f"{name} = {speeds!r}: must be greater than 0 and at most {MOST_SPEED:g} m/s"
        )
    return each


def as_task(task: Any, present: Task = USUAL_TASK) -> Task:
    """The task, given as such or as a mapping of the fields that differ from the present one's.

    None stands for the present one.
    """
    if isinstance(task, Mapping):
        task = dataclasses.asdict(present) | dict(task)
    return as_instance(Task, "task", task, present)


def as_starts(starts: Starts | Mapping[str, Any] | None) -> Starts:
    """Shares, given as such or as a mapping of their fields; None for the usual ones."""
    return as_instance(Starts, "starts", starts, USUAL_STARTS)


def as_options(options: Any) -> dict[str, Any]:
    """Options of a reset, as a new dictionary; None stands for none."""
    if not (options is None or isinstance(options, Mapping)):
        raise KindError(f"options = {options!r}: must be a dictionary of options, or None")
    return dict(options or {})


def as_params_list(params: Any, n: int) -> list[WheelParams]:
    """`params`, one for all rows or one per row, as a list of N."""
    many = isinstance(params, (list, tuple))
    each = [as_params(one) for one in params] if many else [as_params(params)] * n
    _require_one_per_row("params", each, n)
    for one in dict.fromkeys(each):
        require_steppable(one)
    return each


def require_render_mode(render_mode: Any, render_modes: Sequence[str]) -> None:
    """Refuse a render mode that an environment does not have."""
    if render_mode is not None and render_mode not in render_modes:
        raise ValueError(f"render_mode = {render_mode!r}: choose from {render_modes} or None")


@dataclasses.dataclass(frozen=True)
class EpisodeStart:
    """How K episodes begin."""

    kind: int = DRAWN  # kind of start; see `rimless_gym.envs.starts`
    # (phi, theta, phi', theta', mode) of each, (K, 5); empty unless `kind` is GIVEN
    states: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.empty((0, 5)))
    # commanded speed of each (m/s), (K,); None to draw them
    speeds: NDArray[np.float64] | None = None


#: A random one.
DRAWN_START = EpisodeStart()


OPTION_NAMES = ("state", "mode", "params", "task", "starts", "ranges", "disturbances")
_FOR_ALL = ("starts", "ranges", "disturbances")


def read_options(
    options: Mapping[str, Any] | None, batch: Batch, rows: NDArray[np.int64]
) -> tuple[dict[str, Any], EpisodeStart]:
    """What the options for `rows` of a batch change, for `Batch.change`, and how episodes begin.

    The options are checked, and the batch is not changed.
    """
    options = as_options(options)
    names = OPTION_NAMES if batch.control.speeds is None else (*OPTION_NAMES, "speed")
    for name in options:
        if name not in names:
            raise ValueError(f"unknown reset option {name!r}: choose from {names}")
        if name in _FOR_ALL and len(rows) < len(batch):
            raise ValueError(f"reset option {name!r} holds for all rows: give no reset_mask")
    changes: dict[str, Any] = {}
    params, n = list(batch.params), len(rows)
    if "params" in options:
        for i, one in zip(rows, as_params_list(options["params"], n), strict=True):
            params[i] = one
    if "params" in options or "ranges" in options:
        ranges = as_ranges(options["ranges"]) if "ranges" in options else batch.ranges
        ranges.require_valid(params)
        changes |= {"params": params, "ranges": ranges}
    if "task" in options:
        task, tasks = options["task"], list(batch.tasks)
        each = list(task) if isinstance(task, (list, tuple)) else [task] * n
        _require_one_per_row("task", each, n)
        for i, one in zip(rows, each, strict=True):
            tasks[i] = as_task(one, tasks[i])
        batch.require_no_target(tasks)
        changes["tasks"] = tasks
    if "starts" in options:
        changes["starts"] = as_starts(options["starts"])
    if "disturbances" in options:
        changes["disturbances"] = as_disturbances(options["disturbances"])
    speeds = as_speeds("speed", options["speed"], n) if "speed" in options else None
    if "state" in options:
        modes = options.get("mode", "single_stance")
        states = _states(options["state"], modes, [params[i] for i in rows])
        return changes, EpisodeStart(GIVEN, states, speeds)
    if "mode" not in options:
        return changes, EpisodeStart(speeds=speeds)
    if not (isinstance(options["mode"], str) and options["mode"] == "double_stance"):
        raise ValueError(
            f"reset option 'mode' = {options['mode']!r}: give 'double_stance', which is at rest, "
            f"or one of {MODE_NAMES} with a 'state'"
        )
    return changes, EpisodeStart(HANGING, speeds=speeds)


def _require_one_per_row(name: str, values: Sequence[Any], n: int) -> None:
    if len(values) != n:
        raise ValueError(f"{name}: {len(values)} for {n} rows, must be one per row")


def masked_rows(mask: Any, n: int, name: str = "reset_mask") -> NDArray[np.int64]:
    """Indices of the rows, out of N, that the mask `name` marks; of all without a mask."""
    if mask is None:
        return np.arange(n)
    if not (isinstance(mask, np.ndarray) and mask.dtype == np.bool_):
        raise TypeError(f"{name} = {mask!r}: must be a NumPy array of bool")
    if mask.shape != (n,) or not mask.any():
        raise ValueError(f"{name} = {mask}: must have shape ({n},) and mark a row")
    return np.flatnonzero(mask)


def _states(states: Any, modes: Any, params: Sequence[WheelParams]) -> NDArray[np.float64]:
    """Given states, one for all rows or one per row, with their modes: (N, 5)."""
    n = len(params)
    many = real_array("state", states).ndim == 2
    if not isinstance(modes, str) and np.ndim(modes) != 1:
        raise TypeError(f"mode = {modes!r}: give a name, or one per row")
    each = list(states) if many else [states] * n
    named = [modes] * n if isinstance(modes, str) else list(modes)
    _require_one_per_row("state", each, n)
    _require_one_per_row("mode", named, n)
    return np.array([_start(*one) for one in zip(params, each, named, strict=True)])


def _start(params: WheelParams, x: ArrayLike, mode: str) -> NDArray[np.float64]:
    start = np.empty(STATE_SIZE - 1)
    start[:4], start[MODE] = validated_start(params, x, mode, "state")
    limit = params.voltage_limit
    force = normal_force(params, start, limit)
    if force <= 0:
        raise ValueError(
            f"state = {x!r}: no voltage from {-limit:g} to {limit:g} V presses the foot on the "
            f"ground; the largest force is {force:.3g} N and must be greater than 0: give a slower "
            "state"
        )
    return start


def plain(value: Any) -> Any:
    """The value in JSON's types; a value that has no such form is returned unchanged."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return plain(dataclasses.asdict(value))
    if isinstance(value, enum.Enum):
        return plain(value.value)
    if isinstance(value, (np.generic, np.ndarray)):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        return [plain(each) for each in value]
    return value


def _spec(env: Any) -> EnvSpec | None:
    return getattr(env, "_spec", None)


def _set_spec(env: Any, spec: EnvSpec | None) -> None:
    if spec is not None:
        spec = copy.copy(spec)
        spec.kwargs = plain(spec.kwargs)
    env._spec = spec  # as an attribute: using __dict__ would slow down every other attribute


#: A property for environments: the `spec` that Gymnasium sets, with arguments as JSON values.
plain_spec = property(_spec, _set_spec)
