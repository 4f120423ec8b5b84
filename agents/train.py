"""Training PPO and SAC, from scratch or from a clone of the optimal gait's controller."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from agents.begin import Training, cloned, started_from
from agents.callbacks import Freeze, KeepBest, LogWalking, Progress, SaveState
from agents.checkpoint import architecture, save_policy
from agents.evaluate import SHORT_PROTOCOL, Evaluation, Protocol
from agents.folder import BEST, CLONE, CLONING, LAST, STATE, claim, sole_user
from agents.hyperparameters import hyperparameters
from agents.imitate import Cloning
from agents.interrupts import requests
from agents.logs import event_log
from agents.policies import Controller
from agents.resumption import StateError, load_state, restore, save_state
from rimless_gym.checks import integer
from rimless_gym.envs.task import Task
from rimless_gym.params import THESIS_PHYSICAL, WheelParams

#: Share of a fine-tuning in which only the critic learns.
CRITIC_WARM_UP = 0.15

#: The largest that numpy's global generator takes.
MAX_SEED = 2**32 - 1

#: Evaluations of a training, besides the one at its start.
EVALUATIONS = 10


@dataclasses.dataclass(frozen=True)
class TrainResult:
    """Where a training left its policies.

    Attributes:
        best: the policy that did best in the periodic evaluations.
        last: the policy as it is now.
        clone: the clone that it began from, if any.
        timesteps: environment steps in the saved state, from which the same call goes on.
        interrupted: whether somebody asked to stop, be it in its last moments.
        evaluations: (timesteps, evaluation) pairs of this call, by the short protocol.
    """

    best: Path
    last: Path
    clone: Path | None
    timesteps: int
    interrupted: bool
    evaluations: tuple[tuple[int, Evaluation], ...]


@dataclasses.dataclass
class Standing:
    """How far a training has come, apart from the state of its model.

    Attributes:
        best: the best score so far.
        due: time steps at which the next evaluation is due; None: at the start.
        over: time steps that were asked for when it last came to its end; None if it never has.
        logged: figures that are recorded but not yet written to the log.
    """

    best: float = -math.inf
    due: int | None = None
    over: int | None = None
    logged: dict[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        steps = [step for step in (self.due, self.over) if step is not None]
        if not (type(self.best) is float and all(type(step) is int for step in steps)):
            raise TypeError(f"{self}: a score, and whole numbers of steps")
        self.logged = dict(self.logged)


def train(
    algo: str,
    init: str | Path = "scratch",
    seed: int = 0,
    out: str | Path = "runs/train",
    *,
    timesteps: int | None = None,
    params: WheelParams = THESIS_PHYSICAL,
    task: Task | None = None,
    expert: Controller | None = None,
    cloning: Cloning | None = None,
    score: Callable[[Evaluation], float] | None = None,
    protocol: Protocol = SHORT_PROTOCOL,
    progress: bool = True,
) -> TrainResult:
    """Train a policy into a folder: best.zip, last.zip, train.json, state.npz, TensorBoard events.

    The same seed gives the same policy. The state of the training is written every half minute and
    after each evaluation. However it was stopped, the same call goes on from the last state and
    ends with the same policy as without a stop. Ctrl-C and SIGTERM stop it after the current
    roll-out. torch runs on one thread: sums depend on how they are split among threads, and these
    networks are too small to gain from more.

    Args:
        algo: "ppo" or "sac".
        init: "scratch", "imitation" (clone `expert` first), or a policy's file to start from.
        seed: of everything random, from 0 to 2**32 - 1.
        out: folder; new, or that of the same training.
        timesteps: environment steps in all; default: hyperparams/*.yml. A finished training
            goes on if more are asked for.
        params: the machine.
        task: the reward, default `Task()`.
        expert: to imitate; default: LQR about the optimal gait at 0.5 m/s.
        cloning: how, default `Cloning()`.
        score: what "best" means, larger is better; default: reward per second.
        protocol: of the periodic evaluations.
        progress: whether to show progress bars.

    Raises:
        ValueError: an argument is out of range, or `out` is a file or holds another training.
        TypeError: seed or timesteps is not an integer.
        CheckpointError: a policy to start from does not fit.
        StateError: the state to go on from is damaged.
        OSError: the disk is full, or `out` cannot be written; the last state is kept.
    """
    torch.set_num_threads(1)
    out, task = Path(out), task or Task()
    settings = hyperparameters(algo, imitation=str(init) != "scratch")
    seed = integer("seed", seed, 0, MAX_SEED)
    total = settings.n_timesteps if timesteps is None else integer("timesteps", timesteps, 0)
    silent = int(settings.algorithm.get("learning_starts", 0))
    if 0 < total <= silent:
        raise ValueError(
            f"timesteps = {total}: {algo} only collects experience for the first {silent} "
            "(learning_starts in agents/hyperparams); ask for more"
        )
    training = Training(algo, str(init), seed, params, task, settings)
    keeper = KeepBest(params, task, max(1, math.ceil(total / EVALUATIONS)), score, protocol)
    with sole_user(out):
        claim(out, training.identity)
        if (out / STATE).exists():
            model, standing = _resumed(training, out)
        else:
            model, standing = _begun(training, out, expert, cloning, progress), Standing()
        try:
            return _learned(training, total, out, model, standing, keeper, progress)
        finally:
            model.env.close()


def _begun(
    training: Training,
    out: Path,
    expert: Controller | None,
    cloning: Cloning | None,
    progress: bool,
) -> Any:
    """The model with which a training begins."""
    if training.init == "scratch":
        return training.model(training.env())
    if training.init == "imitation":
        return cloned(training, training.env(), out, expert, cloning, progress)
    return started_from(training, training.env())


def _resumed(training: Training, out: Path) -> tuple[Any, Standing]:
    """The model with which a training goes on, and how far it has come.

    Raises:
        StateError: its state is damaged, or of another training.
        ValueError: a policy that it had saved is missing.
    """
    needed = [BEST, LAST] + [CLONE] * (training.init == "imitation")
    missing = [name for name in needed if not (out / name).exists()]
    if missing:
        raise ValueError(
            f"{out}: {' and '.join(missing)} is missing: put it back, or remove {out} to train anew"
        )
    state, remedy = load_state(out / STATE), f"remove {out} to train anew"
    try:
        notes = state["notes"]
        if notes["identity"] != json.loads(json.dumps(training.identity)):
            raise ValueError("it is of another training")
        standing = Standing(**notes["standing"])
        model = training.model(training.env(), notes["policy_kwargs"])
        restore(model, state["model"])
    except StateError:
        raise
    except Exception as error:  # stable-baselines3 raises almost anything
        raise StateError(f"{out / STATE}: {error!r}; {remedy}") from error
    return model, standing


def _learned(
    training: Training,
    total: int,
    out: Path,
    model: Any,
    standing: Standing,
    keeper: KeepBest,
    progress: bool,
) -> TrainResult:
    """Learn until `total` time steps, or until asked to stop."""
    of = (model, training.params, training.task, training.seed)
    identity = training.identity

    def keep(evaluation: Evaluation, score: float) -> None:
        save_policy(out / BEST, *of, score=score, evaluation=evaluation.to_dict())

    def save() -> None:
        standing.best, standing.due = keeper.best, keeper.due
        standing.logged = dict(model.logger.name_to_value)
        save_policy(out / LAST, *of)
        notes = {"identity": identity, "standing": vars(standing)}
        save_state(out / STATE, model, notes | {"policy_kwargs": architecture(model)})
        (out / CLONING).unlink(missing_ok=True)

    kept, interrupted = model.num_timesteps, False
    if standing.over is None or standing.over < total:
        keeper.best, keeper.due, keeper.keep = standing.best, standing.due, keep
        model.set_logger(event_log(out, model.num_timesteps))
        for name, value in standing.logged.items():
            model.logger.record(name, value)
        bar = Progress(total, f"{training.algo} {Path(training.init).stem}", progress)
        place, loss = "at the end of this roll-out", "at most half a minute of training"
        with requests(place, loss) as stop:
            saver = SaveState(save, stop, keeper)
            callbacks = [LogWalking(training.params), keeper, saver, bar]
            if training.init != "scratch":
                callbacks.append(Freeze(round(CRITIC_WARM_UP * total)))
            try:
                steps = max(0, total - model.num_timesteps)
                model.learn(steps, callbacks, reset_num_timesteps=False)
                standing.over = total
                saver.save()
            except KeyboardInterrupt:
                interrupted = True
            finally:
                bar.close()
            kept, interrupted = saver.kept, interrupted or stop.made
        model.logger.close()
    return TrainResult(
        best=out / BEST,
        last=out / LAST,
        clone=out / CLONE if (out / CLONE).exists() else None,
        timesteps=kept,
        interrupted=interrupted,
        evaluations=tuple(keeper.history),
    )
