"""Training a learner, from scratch, from a clone of the optimal gait's law, or from a policy."""

from __future__ import annotations

import dataclasses
import json
import sys
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from tqdm import tqdm

from agents import learners
from agents.conditions import Conditions
from agents.evaluate import Evaluation
from agents.folder import BEST, CLONE, CLONING, LAST, NOTES, STATE, claim, sole_user
from agents.imitation import Cloning
from agents.interrupts import requests
from agents.ladder import ladder_of_laws
from agents.learner import Learner
from agents.milestones import Milestone
from agents.policies import Policy, controller_policy, seeing_policy
from agents.policy_files import (
    Checkpoint,
    CheckpointError,
    load_policy,
    origin,
    read_record,
    save_policy,
)
from agents.protocol import TRAINING_PROTOCOL, Protocol
from agents.scores import economy
from agents.session import Plan, Session, Standing
from agents.stopwatch import timed
from agents.training import IMITATION, INITS, SCRATCH, Settings, Training
from agents.training_state import StateError, read_state
from rimless_gym.checks import integer
from rimless_gym.envs.arguments import as_task
from rimless_gym.envs.disturbances import Disturbances, Ranges
from rimless_gym.envs.task import Task
from rimless_gym.presets import BUILDABLE, Machine
from trajopt import periodic_gait
from trajopt.feedback import laws
from trajopt.feedback.law import Controller

#: What is imitated where nothing else is given: a feedback law, and the gait that it holds.
EXPERT, EXPERT_SPEED, EXPERT_STEPS = "lqr", 0.56, 1

#: The largest that numpy's global generator takes.
MAX_SEED = 2**32 - 1


@dataclasses.dataclass(frozen=True)
class TrainResult:
    """Where a training left its policies.

    Attributes:
        best: the policy that did best in the periodic evaluations.
        last: the policy as it is now.
        clone: the clone that it began from, if any.
        timesteps: environment steps in the saved state, from which the same call goes on.
        interrupted: whether somebody asked to stop, even if it came to its end all the same.
        evaluations: (timesteps, evaluation) pairs of this call, by the short protocol.
        curve: the figures of all evaluations, those of earlier calls included.
    """

    best: Path
    last: Path
    clone: Path | None
    timesteps: int
    interrupted: bool
    evaluations: tuple[tuple[int, Evaluation], ...]
    curve: tuple[Milestone, ...]


def reward_per_second(evaluation: Evaluation) -> float:
    """The reward alone, as a score."""
    return evaluation.objective


def walking_economy(evaluation: Evaluation) -> float:
    """The score by which the best policy is chosen, unless another is given."""
    return economy(evaluation.walking_share, evaluation.cot)


def train(
    algo: str,
    init: str | Path = SCRATCH,
    seed: int = 0,
    out: str | Path = "runs/train",
    *,
    timesteps: int | None = None,
    params: Machine = BUILDABLE,
    task: Task | Mapping[str, float] | None = None,
    ranges: Ranges | Mapping[str, Any] | None = None,
    disturbances: Disturbances | Mapping[str, Any] | None = None,
    speeds: tuple[float, float] | None = None,
    control_period: float | None = None,
    settings: Settings | None = None,
    expert: Controller | str = EXPERT,
    cloning: Cloning | None = None,
    plans: Path | None = None,
    score: Callable[[Evaluation], float] | None = None,
    protocol: Protocol = TRAINING_PROTOCOL,
    progress: bool = True,
) -> TrainResult:
    """Train a policy into a folder: best.zip, last.zip, train.json, state.npz, TensorBoard events.

    minutes.json there has the minutes of one core that it took (`agents.stopwatch`).

    The same seed gives the same policy. The state of the training is written every half minute and
    after each evaluation. However it was stopped, the same call goes on from the last state and
    ends with the same policy as without a stop. Ctrl-C and SIGTERM stop it after the current
    iteration of the learner.

    Args:
        algo: name of a learner, one of `agents.learners.names()`.
        init: "scratch", "imitation" (clone `expert` first), or a policy's file to start from.
        seed: of everything random, from 0 to 2**32 - 1.
        out: folder; new, or that of the same training.
        timesteps: environment steps in all; default: that of the settings. A finished training
            goes on if more are asked for.
        params: the machine, as the environment takes it.
        task: the reward, default: that of the environment; or a dictionary of some of its fields.
        ranges: of parameters, as the environment takes them, for training and evaluation.
        disturbances: as the environment takes them, for training and evaluation.
        speeds: between which a speed is commanded (m/s), as in `RimlessWheelSpeed-v0`, two
            different ones; None: no speed is commanded, as in `RimlessWheel-v0`.
        control_period: how long an action is held (s), default: that of the environment.
        settings: hyperparameters; default: the learner's own.
        expert: to imitate. A name is that of a feedback law, about the optimal gait at
            `EXPERT_SPEED` whose voltage is held as the environment holds it, or about those of all
            commanded speeds (`agents.ladder`); or of a policy's file: its policy is distilled into
            the learner's.
        cloning: how, default `Cloning()`.
        plans: folder in which the plans of feedback laws are kept for other trainings.
        score: what "best" means, larger is better; default: `walking_economy`, or the reward
            where a speed is commanded.
        protocol: of the periodic evaluations.
        progress: whether to show progress bars.

    Warns:
        UserWarning: with these hyperparameters it cannot learn to walk.

    Raises:
        ValueError: an argument is out of range, or `out` is a file or holds another training.
        TypeError: an argument is of the wrong kind.
        CheckpointError: a policy to start from does not fit.
        StateError: the state to go on from is damaged.
        OSError: the disk is full, or `out` cannot be written; the last state is kept.
    """
    out, init = Path(out), str(init)
    settings = settings or learners.learner(algo).settings(init)
    conditions = Conditions.of(params, ranges, disturbances, speeds, control_period)
    training = Training(
        algo,
        _described(init, expert, cloning),
        integer("seed", seed, 0, MAX_SEED),
        conditions,
        as_task(task, conditions.default_task),
        settings,
    )
    total = settings.n_timesteps if timesteps is None else integer("timesteps", timesteps, 0)
    if 0 < total <= settings.silent:
        raise ValueError(
            f"timesteps = {total}: {algo} only collects experience in the first "
            f"{settings.silent}; ask for more"
        )
    if init == IMITATION and not learners.learner(algo).imitates:
        raise ValueError(
            f"init = 'imitation': {algo} cannot imitate; begin from 'scratch', or from a policy's "
            "file"
        )
    if init != IMITATION and expert != EXPERT:
        raise ValueError(f"expert = {expert!r}: is imitated only with init = 'imitation'")
    if init != IMITATION and cloning is not None:
        raise ValueError("cloning: nothing is cloned; give init = 'imitation', or leave it out")
    score = score or (reward_per_second if conditions.commanded else walking_economy)
    with sole_user(out):
        begun = (out / STATE).exists()
        if begun or (out / NOTES).exists():
            claim(out, training.identity)
        if begun:
            learner, standing = _resumed(training, out)
        else:
            for reason in learners.learner(algo).advice(training):
                warnings.warn(reason, stacklevel=2)
            learner, standing = _new(init, training), Standing()
        try:
            with timed(out) as minutes:
                plan = Plan(training, out, total, score, protocol, progress, minutes, plans)
                imitated = None if begun or init != IMITATION else _imitated(expert, plan)
                claim(out, training.identity)  # what was refused so far has claimed no folder
                if imitated is not None:
                    _imitate(learner, plan, imitated, cloning or Cloning())
                return _learned(plan, learner, standing)
        finally:
            learner.close()


def _described(init: str, expert: Controller | str, cloning: Cloning | None) -> str:
    """What a training begins from, so that its folder is known by it."""
    if init != IMITATION:
        return init if init in INITS else origin(init)
    described, usual = init, dataclasses.asdict(Cloning())
    if isinstance(expert, str) and expert != EXPERT:
        described += f" of {expert if expert in laws.names() else origin(expert)}"
    if cloning is None:
        return described
    changed = {k: v for k, v in dataclasses.asdict(cloning).items() if v != usual[k]}
    return described + (f" with {json.dumps(changed)}" if changed else "")


def _named(expert: str, plan: Plan) -> Policy:
    """The feedback law of this name, or the policy in this file.

    Raises:
        CheckpointError: it is neither, or the policy is for another machine or control.
    """
    conditions = plan.training.conditions
    params, period = conditions.params, conditions.control.period
    if expert not in laws.names():
        return seeing_policy(params, _fitting(expert, conditions).act)
    if conditions.commanded:
        return ladder_of_laws(expert, conditions, [EXPERT_STEPS], plan.plans, plan.progress)
    gait = periodic_gait(params, EXPERT_SPEED, EXPERT_STEPS, hold=period, progress=plan.progress)
    return controller_policy(params, laws.design(expert, gait, plan.plans))


def _fitting(path: str, conditions: Conditions) -> Checkpoint:
    """The policy in a file, if it sees what is seen here.

    Raises:
        CheckpointError: it is missing or damaged, or for another machine or control.
    """
    found = load_policy(path, conditions.params)
    if found.conditions.commanded != conditions.commanded:
        how = ("without", "with")[found.conditions.commanded]
        raise CheckpointError(
            f"{path}: a policy that walks {how} a commanded speed; train {how} speeds "
            "(--speeds), or give another policy"
        )
    period, wanted = found.conditions.control.period, conditions.control.period
    if period != wanted:
        raise CheckpointError(
            f"{path}: a policy that decides every {period:g} s, not every {wanted:g} s; train with "
            "its control period (--control-period), or give another policy"
        )
    return found


def _new(init: str, training: Training) -> Learner:
    """The learner with which a training begins."""
    if init in INITS:
        return learners.learner(training.algo)(training)
    return _started_from(init, training)


def _imitated(expert: Controller | str, plan: Plan) -> Policy:
    """Whom to imitate."""
    if not isinstance(expert, str):
        return controller_policy(plan.training.conditions.params, expert)
    if plan.progress and expert in laws.names():
        tqdm.write(f"designing {expert} and its start-up controller (up to a minute)", sys.stderr)
    return _named(expert, plan)


def _imitate(learner: Learner, plan: Plan, expert: Policy, cloning: Cloning) -> None:
    """Clone an expert into the learner."""
    report = learner.imitate(expert, cloning, plan.out / CLONING, plan.progress)
    save_policy(plan.out / CLONE, plan.training, learner, cloning=dataclasses.asdict(report))


def _started_from(path: str, training: Training) -> Learner:
    """A learner with the policy of a file, and its own optimiser, schedule and seed.

    Raises:
        CheckpointError: the file is missing, damaged, or for another machine or learner.
    """
    start = _fitting(path, training.conditions)
    if start.algo != training.algo:
        raise CheckpointError(
            f"{path}: a policy of {start.algo}, which cannot start {training.algo}; use one of "
            f"{training.algo}"
        )
    return learners.learner(training.algo)(training, start.parts)


def _resumed(training: Training, out: Path) -> tuple[Learner, Standing]:
    """The learner with which a training goes on, and how far it has come.

    Raises:
        StateError: its state is damaged, or of another training.
        ValueError: a policy that it had saved is missing.
    """
    needed = [BEST, LAST] + [CLONE] * training.init.startswith(IMITATION)
    missing = [name for name in needed if not (out / name).exists()]
    if missing:
        raise ValueError(
            f"{out}: {' and '.join(missing)} is missing: put it back, or remove {out} to train anew"
        )
    for name in needed:
        read_record(out / name)  # refused if it is damaged
    state = read_state(out / STATE)
    try:
        if state["identity"] != json.loads(json.dumps(training.identity)):
            raise ValueError("it is of another training")
        standing = Standing.read(state["standing"])
        learner = learners.learner(training.algo)(training)
        learner.restore(state["learner"])
    except Exception as error:  # learners may raise anything
        raise StateError(
            f"{out / STATE}: {error!r}; go on with the versions that began it, or remove {out} to "
            "train anew"
        ) from error
    return learner, standing


def _learned(plan: Plan, learner: Learner, standing: Standing) -> TrainResult:
    """Learn until the plan's end, or until asked to stop."""
    out, kept, interrupted = plan.out, learner.steps, False
    evaluations: list[tuple[int, Evaluation]] = []
    if standing.over is None or standing.over < plan.total:
        with requests("at the end of this iteration", "at most half a minute of training") as stop:
            session = Session(plan, learner, standing, stop)
            try:
                session.run()
            except KeyboardInterrupt:
                interrupted = True
            finally:
                session.close()
            kept, interrupted = session.kept, interrupted or stop.made
        evaluations = session.evaluations
    return TrainResult(
        best=out / BEST,
        last=out / LAST,
        clone=out / CLONE if (out / CLONE).exists() else None,
        timesteps=kept,
        interrupted=interrupted,
        evaluations=tuple(evaluations),
        curve=tuple(standing.curve),
    )
