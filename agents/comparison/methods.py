"""The methods of a comparison: optimal gaits, feedback laws, trained learners, shipped policies.

`methods` lists them. A feedback law in `trajopt/feedback/laws` is added by itself, unless it is one
of `laws.SLOW`, which `scripts/studies` measure. A learner is added as one more `LearnedMethod`.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeAlias

import numpy as np

from agents.comparison.study import Setting, Study
from agents.comparison.table import (
    ADAPTIVE,
    DISTILLED,
    EVOLVED,
    FRONT_POLICY,
    PPO_PRIOR,
    REST,
    SAC_PRIOR,
    Row,
    gait_row,
    policy_row,
)
from agents.evaluate import EPISODE, PROTOCOL, evaluate_commanded
from agents.experts import EXPERT
from agents.gaps import best_at_any_speed, reward_rate
from agents.learner import BEST, CLONE, IMITATION, INITS, LAST, SCRATCH, DoesNotWalkError
from agents.policy_files import BASELINES, PRETRAINED, TrainingEffort, load_policy, read_record
from agents.rollout import AdaptivePolicy, controller_policy, law_title
from agents.training import train
from agents.training_config import TrainingConfig
from rimless_gym.envs.task import USUAL_TASK
from rimless_gym.hybrid import CONTROL_PERIOD
from trajopt import NoGaitError, Solution, periodic_gait
from trajopt.feedback import laws
from trajopt.feedback.adaptive import AdaptiveController
from trajopt.feedback.law import Controller
from trajopt.gaits.fronts import CotFront, cot_front, front_file
from trajopt.gaits.library import warm_starts
from trajopt.pool import cores
from trajopt.store import Store, jsonable

#: JSON values; "files" names the files that the method made in the study's folder.
Result: TypeAlias = dict[str, Any]

#: The shipped policies; by the name alone, a file in the current folder would be loaded.
FRONT_FILE = PRETRAINED["front"]
BEST_SEEDS = {PPO_PRIOR: PRETRAINED["ppo"], SAC_PRIOR: PRETRAINED["sac"]}

#: Speeds between the study's at which the policy for the front walks too (m/s), to plot its curve.
BETWEEN = (0.58, 0.61)


class Method(Protocol):
    """A method that is compared. Its work is one task, perhaps in a process of its own."""

    @property
    def name(self) -> str:
        """Name of its result and of its files."""

    @property
    def after(self) -> tuple[str, ...]:
        """Names of the methods whose results it needs; they are listed before it."""

    def compute(self, setting: Setting) -> Result:
        """The result of its work."""

    def rows(self, setting: Setting, result: Result) -> list[Row]:
        """Its rows of the table, once all methods have results."""


def methods(study: Study) -> tuple[Method, ...]:
    """All methods, in the order in which they stand in the table within their speed."""
    others = [name for name in laws.names() if name not in (*laws.SLOW, EXPERT)]
    return (
        OptimalGait("searched", None, searched_gait),
        FrontMethod("front"),
        FrontMethod("held_front", ("front",), held=True),
        OptimalGait("least", "optimal at any speed", least_gait, ("held_front",)),
        OptimalGait("swinging", "optimal while the pendulum swings", swinging_gait),
        RestMethod("rest"),
        *(LawMethod(name, name, (EXPERT,)) for name in others),
        LawMethod(EXPERT, EXPERT, ("held_front",)),
        AdaptiveMethod("adaptive", ("held_front",)),
        *front_policy(study),
        LearnedMethod(
            "imitation", IMITATION, "imitation", CLONE, (EXPERT,), at_study_speed=True, curve=True
        ),
        LearnedMethod(
            "scratch", SCRATCH, "PPO from scratch", BEST, budget="scratch_timesteps", curve=True
        ),
        *best_of_seeds(study),
        *(_shipped_trainings() if study.shipped else TRAININGS),
    )


@dataclasses.dataclass(frozen=True)
class OptimalGait:
    """An optimal gait, at the study's speed or at the best one."""

    # name, after: see `Method`
    name: str
    title: str | None  # of its row; None: its number of steps per stride
    solve: Callable[[Setting], Solution | str]  # returns it, or the reason why there is none
    after: tuple[str, ...] = ()

    @property
    def file(self) -> str:
        """In the study's folder; `trajopt.store` uses the name alone for arrays."""
        return f"{self.name}_gait.npz"

    def compute(self, setting: Setting) -> Result:
        """Solve it."""
        gait = self.solve(setting)
        if isinstance(gait, str):
            return {"missing": gait}
        if not gait.verification.passed:
            return {"missing": "; ".join(gait.verification.failures)}
        gait.save(setting.out / self.file)
        return gait_result(gait) | {"files": [self.file]}

    def rows(self, setting: Setting, result: Result) -> list[Row]:
        """Its row, if there is one."""
        if "missing" in result:
            return []
        gait = Solution.load(setting.out / self.file)
        speed = None if self.name == "least" else setting.study.speed  # it belongs to no speed
        return [_gait_row(setting, self.title or _steps_title(gait), gait, speed)]


def searched_gait(setting: Setting) -> Solution:
    """The study's gait, searched for from a shipped guess and from random starts."""
    study = setting.study
    return periodic_gait(
        setting.params,
        study.on_tick(study.speed),
        study.steps,
        starts=study.starts,
        seed=study.seed,
        workers=cores(),
        progress=setting.progress,
    )


def least_gait(setting: Setting) -> Solution:
    """The environment's best gait at any speed."""
    known = min(setting.held_front.envelope, key=lambda gait: gait.cot)
    best = best_at_any_speed(
        *(setting.params, known.speed, setting.out, setting.progress, setting.study.front_steps)
    )
    return known if best is None or known.cot < best.cot else best


def swinging_gait(setting: Setting) -> Solution | str:
    """The best gait whose pendulum does not whirl, where one is shipped to start from."""
    study = setting.study
    speed = study.on_tick(study.speed)
    known = warm_starts(setting.params, speed, study.steps)
    swinging = [gait for gait in known if gait.theta_turns == 0]
    if not swinging:
        return f"no swinging gait of {study.steps} steps is shipped for this machine"
    try:
        return periodic_gait(setting.params, speed, study.steps, guess=swinging[0])
    except NoGaitError as error:
        return str(error)


def _steps_title(gait: Solution) -> str:
    return f"optimal, {gait.steps} step{'s' if gait.steps > 1 else ''} per stride"


def gait_result(gait: Solution) -> Result:
    """The figures of an optimal gait."""
    return {
        "cot": gait.cot,
        "speed": gait.speed,
        "theta_turns": gait.theta_turns,
        "verification": jsonable(dataclasses.asdict(gait.verification)),
    }


@dataclasses.dataclass(frozen=True)
class FrontMethod:
    """A front of optimal gaits. Its rows are those of the best gaits at the study's speeds."""

    # name, after: see `Method`
    name: str
    after: tuple[str, ...] = ()
    # False: the voltage is continuous. True: it is held for the environment's 10 ms, at the speeds
    # and with the steps of the best gaits of the other front
    held: bool = False

    def compute(self, setting: Setting) -> Result:
        """Solve the gaits of the front that are not in the folder yet."""
        front = _held_front(setting) if self.held else _free_front(setting)
        return {
            "files": [front_file(s.steps, s.speed, s.hold) for s in front.solutions],
            "gaits": [gait_result(s) | {"steps": s.steps} for s in front.solutions],
            "missing": [list(each) for each in front.missing],
        }

    def rows(self, setting: Setting, result: Result) -> list[Row]:
        """The rows of the gaits at, or nearest to, the study's speeds."""
        rows = []
        for speed in setting.study.speeds:
            gait = setting.held_gait(speed) if self.held else setting.best_gait(speed)
            title = f"optimal, voltage held for {1e3 * CONTROL_PERIOD:g} ms"
            title = title if self.held else _steps_title(gait)
            rows.append(_gait_row(setting, title, gait, speed))
        return rows


def _free_front(setting: Setting) -> CotFront:
    study = setting.study
    return cot_front(
        *(study.params, study.front_speeds, study.front_steps),
        folder=setting.out,
        progress=setting.progress,
    )


def _held_front(setting: Setting) -> CotFront:
    best = setting.front.envelope
    solutions: list[Solution] = []
    missing: list[tuple[int, float, str]] = []
    for steps in sorted({gait.steps for gait in best}):
        speeds = [gait.speed for gait in best if gait.steps == steps]
        try:
            front = cot_front(
                *(setting.params, speeds, [steps]),
                hold=CONTROL_PERIOD,
                folder=setting.out,
                progress=setting.progress,
            )
        except NoGaitError as error:
            missing += [(steps, speed, str(error)) for speed in speeds]
            continue
        solutions += front.solutions
        missing += front.missing
    if not solutions:
        raise NoGaitError("\n".join(reason for _, _, reason in missing))
    return CotFront(tuple(solutions), tuple(missing))


@dataclasses.dataclass(frozen=True)
class RestMethod:
    """No voltage: what a policy has to return more than."""

    # name, after: see `Method`
    name: str
    after: ClassVar[tuple[str, ...]] = ()

    def compute(self, setting: Setting) -> Result:
        """Evaluate it."""
        return {"evaluations": [setting.evaluated(BASELINES["idle"](0))]}

    def rows(self, setting: Setting, result: Result) -> list[Row]:
        """Its row."""
        return [_policy_row(setting, REST, result["evaluations"][0], None)]


@dataclasses.dataclass(frozen=True)
class LawMethod:
    """A feedback law that holds the environment's best gait nearest to the study's speed."""

    # name, after: see `Method`. The first law computes the start-up for all
    name: str
    law: str  # one of `trajopt.feedback.laws.names()`
    after: tuple[str, ...]

    def compute(self, setting: Setting) -> Result:
        """Evaluate it."""
        gait = setting.held_gait(setting.study.speed)
        controller = laws.design(self.law, gait, setting.out)
        return {"evaluations": [setting.evaluated(controller_policy(setting.params, controller))]}

    def rows(self, setting: Setting, result: Result) -> list[Row]:
        """Its row."""
        title = f"{law_title(self.law)} about the optimum"
        (evaluation,) = result["evaluations"]
        return [_policy_row(setting, title, evaluation, setting.study.speed)]


@dataclasses.dataclass(frozen=True)
class AdaptiveMethod:
    """The adaptive controller, brought to the gait that the laws hold."""

    # name, after: see `Method`
    name: str
    after: tuple[str, ...]
    # fewer than the others': for every walk it solves for gaits, which takes 20 s of one core
    starts: int = 8

    def compute(self, setting: Setting) -> Result:
        """Evaluate it."""
        gait = setting.held_gait(setting.study.speed)
        try:
            controller = AdaptiveController.about(gait, setting.out)
        except (ValueError, RuntimeError) as error:  # gaits of near machines differ too much
            return {"missing": str(error)}
        by = dataclasses.replace(PROTOCOL, starts=self.starts)
        # not among "evaluations": what is attained from each start is of those from all starts
        return {"evaluation": setting.evaluated(AdaptivePolicy(controller), by)}

    def rows(self, setting: Setting, result: Result) -> list[Row]:
        """Its row, if there is one."""
        if "missing" in result:
            return []
        return [_policy_row(setting, ADAPTIVE, result["evaluation"], setting.study.speed)]


@dataclasses.dataclass(frozen=True)
class LearnedMethod:
    """A learner's policy."""

    # name, after: see `Method`; the name is that of the folder of its training, too
    name: str
    init: str  # "scratch", "imitation", or a policy's file in the study's folder
    title: str  # of its row
    file: str  # of the policy in the training's folder
    after: tuple[str, ...] = ()
    _: dataclasses.KW_ONLY
    algo: str = "ppo"  # the learner
    # whether it walks at the study's speed; else it chooses its speed itself
    at_study_speed: bool = False
    # the field of the study that has its control intervals; None: it is not trained
    budget: str | None = None
    curve: bool = False  # whether it is in the plot of learning curves
    # a policy's file in the study's folder that is imitated near its gait, and elsewhere the
    # start-up controller of that gait; None: the best law is
    teacher: str | None = None
    # that differ from the learner's own
    hyperparameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def compute(self, setting: Setting) -> Result:
        """Train and evaluate it, if what it begins from walks."""
        for before in map(Store(setting.out).load, self.after):
            if "missing" in before:
                return {"missing": before["missing"]}
        config = TrainingConfig(
            self.algo,
            self.init if self.init in INITS else str(setting.out / self.init),
            setting.study.seed,
            timesteps=0 if self.budget is None else getattr(setting.study, self.budget),
            params=setting.params,
            hyperparameters=self.hyperparameters,
            expert=self._expert(setting),
            startup=self.teacher is not None,
        )
        try:
            trained = train(config, setting.out / self.name, progress=setting.progress)
        except DoesNotWalkError as error:
            return {"missing": str(error)}
        file = setting.out / self.name / self.file
        record = read_record(trained.last)  # the whole training's, also where the first policy won
        return {
            "evaluations": [setting.evaluated(load_policy(file).policy)],
            "effort": TrainingEffort.of(record)._asdict(),
            "curve": record["curve"],
            "files": [f"{self.name}/{self.file}"],
        }

    def rows(self, setting: Setting, result: Result) -> list[Row]:
        """Its row, if there is one."""
        if "missing" in result:
            return []
        speed = setting.study.speed if self.at_study_speed else None
        return [_policy_row(setting, self.title, result["evaluations"][0], speed, result["effort"])]

    def _expert(self, setting: Setting) -> Controller | str:
        """The expert to imitate, for `train`."""
        if self.teacher is not None:
            return str(setting.out / self.teacher)
        if self.init != IMITATION:
            return EXPERT
        return laws.design(EXPERT, setting.held_gait(setting.study.speed), setting.out)


#: Trainings whose policies come with the package, under the names of the methods, and what those
#: begin from.
TRAININGS = (
    LearnedMethod(
        *("fine_tuned", f"{IMITATION}/{CLONE}", "fine-tuned by CMA-ES", LAST, (IMITATION,)),
        algo="cma_es",
        budget="timesteps",
        curve=True,
    ),
    LearnedMethod(
        *("evolution", SCRATCH, "evolution from scratch", BEST),
        algo="evolution",
        budget="evolution_timesteps",
        curve=True,
    ),
    LearnedMethod(
        *("distilled", IMITATION, DISTILLED, CLONE, ("evolution",)),
        teacher=f"evolution/{BEST}",
    ),
    LearnedMethod(
        *("evolved", f"distilled/{CLONE}", EVOLVED, BEST, ("distilled",)),
        algo="cma_es",
        hyperparameters={"return_weight": 1.0},
        budget="timesteps",
        curve=True,
    ),
)


def _shipped_trainings() -> Iterator[ShippedMethod]:
    """What the package has of `TRAININGS`."""
    for each in TRAININGS:
        if each.name in PRETRAINED:
            yield ShippedMethod(PRETRAINED[each.name], each.title, curve=each.curve)


@dataclasses.dataclass(frozen=True)
class ShippedMethod:
    """A policy that comes with the package."""

    # file, title: of the policy, and of its rows
    file: Path
    title: str
    # speeds at which it walks (m/s); none: it chooses its speed itself
    commands: tuple[float, ...] = ()
    curve: bool = False  # whether it is in the plot of learning curves
    after: ClassVar[tuple[str, ...]] = ()

    @property
    def name(self) -> str:
        """Name of its result: that of another file or of other commands is another one."""
        content = self.file.read_bytes() + repr(self.commands).encode()
        return f"{self.file.stem}_{hashlib.sha256(content).hexdigest()[:8]}"

    def compute(self, setting: Setting) -> Result:
        """Evaluate it."""
        policy = load_policy(self.file)
        kept = {
            "effort": TrainingEffort.of(policy.record)._asdict(),
            "curve": policy.record.get("curve", []),
        }
        if not self.commands:
            return {"evaluations": [setting.evaluated(policy.policy)], **kept}
        commanded = evaluate_commanded(
            policy.policy,
            self.commands,
            setting.params,
            task=USUAL_TASK,  # whose returns the other rows have
            control_period=policy.conditions.control.period,
            progress=setting.progress,
        )
        return {"evaluations": [each.to_dict() for each in commanded], **kept}

    def rows(self, setting: Setting, result: Result) -> list[Row]:
        """A row for every speed."""
        study_speeds = {setting.study.on_tick(speed): speed for speed in setting.study.speeds}
        speeds: list[float | None] = [study_speeds.get(c, c) for c in self.commands]
        return [
            _policy_row(setting, self.title, evaluation, speed, result["effort"])
            for speed, evaluation in zip(speeds or [None], result["evaluations"], strict=True)
        ]


def best_of_seeds(study: Study) -> tuple[ShippedMethod, ...]:
    """The shipped policies that are the best of their seeds, if the machine is their own."""
    return tuple(
        ShippedMethod(file, title, curve=True)
        for title, file in BEST_SEEDS.items()
        if load_policy(file).params == study.params
    )


def front_policy(study: Study) -> tuple[ShippedMethod, ...]:
    """The shipped policy for the front, if the study's machine is its own.

    It walks at the study's speeds and between them, as far as it was trained for them.
    """
    conditions = load_policy(FRONT_FILE).conditions
    assert conditions.control.speeds is not None
    slowest, fastest = conditions.control.speeds
    inner = [study.on_tick(speed) for speed in study.speeds]
    between = [speed for speed in BETWEEN if min(inner) < speed < max(inner)]
    commands = tuple(s for s in sorted({*inner, *between}) if slowest <= s <= fastest)
    if conditions.params != study.params or not commands:
        return ()
    return (ShippedMethod(FRONT_FILE, FRONT_POLICY, commands),)


def _policy_row(
    setting: Setting,
    title: str,
    evaluation: Mapping[str, Any],
    study_speed: float | None,
    effort: Mapping[str, Any] | None = None,
) -> Row:
    cot = evaluation["cot"]
    row = policy_row(title, evaluation, setting.gap(cot, evaluation["speed"]), study_speed)
    share = float(np.mean(evaluation["returns"])) / setting.best_return
    over_least = setting.over_least(cot)
    return dataclasses.replace(row, over_least=over_least, return_share=share, **effort or {})


def _gait_row(setting: Setting, title: str, gait: Solution, study_speed: float | None) -> Row:
    row = gait_row(title, gait, setting.gap(gait.cot, gait.speed), study_speed)
    share = EPISODE * reward_rate(gait) / setting.best_return
    return dataclasses.replace(row, over_least=setting.over_least(gait.cot), return_share=share)
