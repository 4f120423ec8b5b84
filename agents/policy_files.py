"""Policies in files and by name: weights, and a record of what they were trained for.

A file is an archive of plain arrays with a JSON record and a digest (`trajopt.store`). Reading it
executes nothing: the learner that is named in the record builds the policy and puts the weights in.
Files written by plain stable-baselines3 are pickles, which can run any code. By name there are
these policies, feedback laws about a gait, and two baselines.
"""

from __future__ import annotations

import dataclasses
import functools
import pkgutil
import sys
import zipfile
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.conditions import Conditions
from agents.learner import Learner, PolicyParts, Training, learner_class
from agents.rollout import (
    AdaptivePolicy,
    Policy,
    Predictor,
    ShapeChecked,
    controller_policy,
    learned_policy,
)
from rimless_gym.envs.arguments import USUAL, Control
from rimless_gym.envs.layout import (
    LEG_RATE_SCALE,
    MIDDLE_SPEED,
    PENDULUM_RATE_SCALE,
    SPEED_SCALE,
)
from rimless_gym.envs.task import Task
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE, Machine, as_params, nearest_preset
from trajopt.feedback import laws
from trajopt.feedback.adaptive import AdaptiveController
from trajopt.feedback.law import Floats
from trajopt.gaits.solution import Solution
from trajopt.store import digest, provenance, read_arrays, write_arrays

FORMAT = "rimless-gym policy 2"

#: Policies that come with the package, by name.
PRETRAINED = {
    path.stem: path for path in sorted((Path(__file__).parent / "pretrained").glob("*.zip"))
}

#: What plain stable-baselines3 puts into its files.
_FOREIGN = ("data", "policy.pth")

#: What a policy sees; one trained on another layout is not loaded.
OBSERVATION_LAYOUT = (
    "(phi - pi/2) / (alpha/2)",
    "sin theta",
    "cos theta",
    f"phi' / {LEG_RATE_SCALE} rad/s",
    f"theta' / {PENDULUM_RATE_SCALE} rad/s",
    "resting",
)

#: What it sees besides where a speed is commanded.
COMMANDED_LAYOUT = (f"(speed - {MIDDLE_SPEED} m/s) / {SPEED_SCALE} m/s", "credit / step length")

_REMEDY = "copy it again, or train it again with `rimless train`"


#: What is known before a training: see `TrainingEffort`.
NOTHING, LAW_STATES, LAW_ACTIONS = "none", "law's states", "law's actions"


class TrainingEffort(NamedTuple):
    """What a policy took, with the policies that it began from or imitates; None: not known.

    Attributes:
        prior: what was known before, such as `NOTHING`.
        intervals: of control, and those that an expert labelled.
        minutes: of one core.
    """

    prior: str | None = None
    intervals: int | None = None
    minutes: float | None = None

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> TrainingEffort:
        """That in the record of a policy."""
        return cls(*(record.get(name) for name in cls._fields))


#: The controller that identifies its machine (`trajopt.feedback.adaptive`). It is designed for the
#: nearest preset, and walks on the machine that is given.
ADAPTIVE = "adaptive"


class CheckpointError(ValueError):
    """A policy file is missing, damaged, in another format, or for another machine or layout."""


@dataclasses.dataclass(frozen=True)
class Checkpoint(Predictor):
    """A loaded policy. Its `predict` is that of stable-baselines3's models.

    Attributes:
        policy: `act` as what is evaluated, with laws that see the state (`agents.rollout`).
        conditions, params: machine and control in which it was trained.
        act: the policy: observations of the environment, (N, 6) or with a commanded speed (N, 8)
            -> actions (N,) in [-1, 1]; without N, a single one.
        algo: name of the learner.
        task: the reward that it was trained for.
        seed: of the training.
        parts: what the file held; the record has everything that was saved with the weights.
    """

    act: ShapeChecked
    algo: str
    task: Task
    seed: int
    parts: PolicyParts

    @property
    def record(self) -> dict[str, Any]:
        """Everything that was saved with the weights."""
        return self.parts.record

    @property
    def model(self) -> Any:
        """The stable-baselines3 model, with that library's default settings of learning.

        That of SAC with a prior gives deviations from the back-EMF; `predict` gives voltages.

        Raises:
            AttributeError: the learner is not one of stable-baselines3.
        """
        return self.act.act.model  # type: ignore[attr-defined]


def layout(commanded: bool) -> list[str]:
    """What a policy sees, in words."""
    return [*OBSERVATION_LAYOUT, *(COMMANDED_LAYOUT if commanded else ())]


def save_policy(path: str | Path, training: Training, learner: Learner, **notes: Any) -> Path:
    """Write a learner's policy with its record and plain JSON `notes`; return the path.

    The file is complete, or left as it was.

    Raises:
        ValueError: the policy cannot be described by plain values.
        OSError: the file cannot be written.
    """
    versions = {name: version(name) for name in ("torch", "stable-baselines3", "gymnasium")}
    made_by, parts = provenance(), learner.parts()
    if parts is None:
        raise ValueError(f"algo = {training.algo!r}: its policies are not kept in files")
    record = {
        "algo": training.algo,
        "seed": training.seed,
        "timesteps": learner.steps,
        "observation_layout": layout(training.conditions.commanded),
        **training.conditions.to_dict(),
        "task": dataclasses.asdict(training.task),
        "versions": made_by["versions"] | versions,
        "git_revision": made_by["git_revision"],
        **parts.record,
        **notes,
    }
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_arrays(path, FORMAT, record, parts.weights)
    return path


def find_policy(path: str | Path) -> Path:
    """The file at `path`, or the one that comes with the package under that name.

    Raises:
        CheckpointError: neither exists.
    """
    target = Path(path)
    for file in (target, Path(f"{path}.zip")):  # stable-baselines3 adds .zip by itself
        if file.is_file():
            return file
    if str(path) in PRETRAINED:
        return PRETRAINED[str(path)]
    raise CheckpointError(
        f"{path}: no such file, and no policy of that name comes with the package (those are "
        f"{', '.join(PRETRAINED)}); make one with `rimless train`, or check the path; "
        "`rimless list` has the names of laws"
    )


def read_record(path: str | Path) -> dict[str, Any]:
    """The record of a policy file; raises what `load_policy` raises."""
    return _read(find_policy(path))[0]


def origin(path: str | Path) -> str:
    """A policy to start from, in words: its algorithm and a digest of its weights.

    Raises:
        CheckpointError: it cannot be read.
    """
    record, weights = _read(find_policy(path))
    return f"{record.get('algo')} policy, SHA-256 of its weights {digest(weights)[:16]}"


def load_policy(
    path: str | Path, params: Machine | None = None, *, trust_pickle: bool = False
) -> Checkpoint:
    """Load a policy, if it is for this observation layout and this machine.

    Args:
        path: of the file; or the name of a policy that comes with the package (`PRETRAINED`).
        params: the machine to walk on, as the environment takes it; default: the one the policy
            was trained on.
        trust_pickle: also read files of plain stable-baselines3. Such a file is a pickle: reading
            it runs any code that its author put into it, with your rights. It does not record its
            machine, which is taken to be `params`, or the default machine if that is None. By the
            size of its observations it is taken to be of `RimlessWheel-v0` or of
            `RimlessWheelSpeed-v0`, with their default arguments.

    Raises:
        CheckpointError: there is no such file, it is damaged or in another format, or its
            observations or machine differ from those wanted.
    """
    path, params = find_policy(path), None if params is None else as_params(params)
    if trust_pickle and _is_foreign(path):
        return _unpickled(path, params or BUILDABLE)
    record, weights = _read(path)
    seen, now = record.get("observation_layout"), layout(record.get("speeds") is not None)
    if seen != now:
        raise CheckpointError(
            f"{path}: observes {seen}, but the environment now gives {now}; "
            "train it again, or use the version of rimless-gym that made it: "
            f"{record.get('git_revision')}"
        )
    try:
        trained_on = WheelParams(**record["params"])
        control = Control(record.get("control_period", USUAL.period), speeds=record.get("speeds"))
        conditions = Conditions(trained_on, control=control)
        task, algo, seed = Task(**record["task"]), record["algo"], int(record["seed"])
        kind = learner_class(algo)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise CheckpointError(
            f"{path}: its record is incomplete or invalid: {error!r}; {_REMEDY}"
        ) from error
    if params is not None and params != trained_on:
        raise CheckpointError(
            f"{path}: trained on another machine: {trained_on.differences(params)}; leave out "
            "params (--preset and --params) for its own machine. To try it on this one: "
            f"agents.evaluate.evaluate(agents.load_policy({str(path)!r}).policy, params)"
        )
    parts = PolicyParts(record, weights)
    try:
        act = ShapeChecked(kind.load(parts, conditions, task), len(now))
    except Exception as error:  # learners may raise anything
        raise CheckpointError(
            f"{path}: its record says {algo}, but its weights do not fit a {algo} policy "
            f"({error!r}), so it was edited or damaged; {_REMEDY}"
        ) from error
    return Checkpoint(learned_policy(act), conditions, act, algo, task, seed, parts)


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The record and the weights."""
    if _is_foreign(path):
        raise CheckpointError(
            f"{path}: a file of plain stable-baselines3, which is a pickle: reading it can run any "
            "code that its author put into it; if you trust the author, `rimless evaluate` and "
            "`watch` read it with --trust-pickle, and `load_policy` with trust_pickle=True"
        )
    record, weights = read_arrays(path, FORMAT, CheckpointError, _REMEDY)
    wrong = [name for name, w in weights.items() if w.dtype.kind != "f" or not np.isfinite(w).all()]
    if wrong:
        raise CheckpointError(
            f"{path}: edited: the numbers in {wrong} are not all finite; {_REMEDY}"
        )
    return record, weights


def _is_foreign(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return set(_FOREIGN) <= set(archive.namelist())
    except (OSError, zipfile.BadZipFile):
        return False


def _unpickled(path: Path, params: WheelParams) -> Checkpoint:
    """The policy in a file of plain stable-baselines3."""
    from agents.sb3.learner import unpickled  # stable-baselines3 is an extra

    try:
        algo, act, conditions = unpickled(path, params)
    except ValueError as error:
        raise CheckpointError(str(error)) from error
    record = {"algo": algo, "intervals": int(act.act.model.num_timesteps)}  # type: ignore[attr-defined]
    task, parts = conditions.default_task, PolicyParts(record, {})
    return Checkpoint(learned_policy(act), conditions, act, algo, task, 0, parts)


@dataclasses.dataclass(frozen=True)
class NamedPolicy(Predictor):
    """A policy, and the conditions in which it walks.

    Attributes:
        policy: as the environment takes it.
        conditions, params: machine and control, undisturbed.
        name: of the baseline, the law or the policy, or the file's path.
        gait: that a law holds; None for others.
        command: the commanded speed (m/s), if any.
        effort: of a learned policy.
    """

    name: str
    gait: Solution | None = None
    command: float | None = None
    effort: TrainingEffort = dataclasses.field(default_factory=TrainingEffort)

    @property
    def period(self) -> float:
        """How long an action is held (s)."""
        return self.conditions.control.period


def named_policy(
    name: str,
    gait_for: Callable[[WheelParams], Solution],
    params: WheelParams | None = None,
    *,
    seed: int = 0,
    trust_pickle: bool = False,
) -> NamedPolicy:
    """A baseline, a feedback law, a policy that comes with the package, or one in a file, by name.

    Args:
        name: of the baseline, the law or the policy, the file's path, or module:name of a function
            from observations (N, 6) to actions, or of a model with such a `predict`; it is in the
            current folder or installed.
        gait_for: returns the gait of a machine that a law holds; called only for laws.
        params: the machine; None: a policy's own, that of the gait for laws, else BUILDABLE.
        seed: of random voltages.
        trust_pickle: see `load_policy`.

    Raises:
        ValueError: the gait is of another machine than `params`, or for the adaptive controller of
            another number of legs.
        CheckpointError: there is no such law, policy or function, or the policy is for another
            machine.
        NoGaitError: there is no gait to hold.
    """
    if name in BASELINES:
        return NamedPolicy(BASELINES[name](seed), Conditions(params or BUILDABLE), name)
    if name in laws.names():
        gait = gait_for(params or BUILDABLE)
        if params is not None and gait.params != params:
            raise ValueError(
                f"{name}: is to hold a gait of another machine: {gait.params.differences(params)}; "
                "give a gait of the machine, or leave out params (--preset and --params)"
            )
        policy = controller_policy(gait.params, laws.design(name, gait))
        return NamedPolicy(policy, Conditions(gait.params), name, gait=gait)
    if name == ADAPTIVE:
        gait = gait_for(nearest_preset(params or BUILDABLE))
        walking = params or gait.params
        if walking.n_legs != gait.params.n_legs:
            raise ValueError(
                f"{name}: n_legs = {walking.n_legs}: must be {gait.params.n_legs}, as of the "
                "gait's machine: legs are not identified; give a gait of a wheel with as many"
            )
        adaptive = AdaptivePolicy(AdaptiveController.about(gait))
        return NamedPolicy(adaptive, Conditions(walking), name, gait=gait)
    if ":" in name and not Path(name).exists():
        return NamedPolicy(_imported(name), Conditions(params or BUILDABLE), name)
    loaded = load_policy(name, params, trust_pickle=trust_pickle)
    conditions = Conditions(loaded.params, control=loaded.conditions.control)
    effort = TrainingEffort.of(loaded.record)
    return NamedPolicy(loaded.policy, conditions, name, effort=effort)


def _imported(name: str) -> Policy:
    """The policy of a function, or of a model of stable-baselines3, of a module."""
    sys.path.insert(0, str(Path.cwd()))
    try:
        predict = pkgutil.resolve_name(name)
    except (ImportError, AttributeError, ValueError) as error:
        raise CheckpointError(
            f"{name}: {error}; write module:function, with the module in this folder or installed"
        ) from error
    finally:
        sys.path.pop(0)
    if hasattr(predict, "predict"):
        predict = functools.partial(predict.predict, deterministic=True)
    if not callable(predict):
        raise CheckpointError(
            f"{name}: is of type {type(predict).__name__}; name a function or a model"
        )

    def act(observations: NDArray[np.float32]) -> Floats:
        actions = predict(observations)
        if isinstance(actions, tuple):  # with a state, as models of stable-baselines3 predict
            actions = actions[0]
        return np.asarray(actions, dtype=np.float64).reshape(-1)

    return learned_policy(act)


def _idle(states: Floats, observations: NDArray[np.float32]) -> Floats:
    """No voltage."""
    return np.zeros(len(states))


def _random(seed: int) -> Policy:
    """Uniformly random voltages; every policy of one seed gives the same sequence."""
    rng = np.random.default_rng(seed)
    return lambda states, observations: rng.uniform(-1.0, 1.0, len(states))


#: Policies that are neither designed nor learned, by name; each is made from a seed.
BASELINES: dict[str, Callable[[int], Policy]] = {"idle": lambda seed: _idle, "random": _random}
