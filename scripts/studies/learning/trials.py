"""How a seed is trained by `agents.train`, and how its policies are judged."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, Self

from agents import learners, protocol
from agents.commanded import evaluate_commanded, walk_through
from agents.evaluate import evaluate
from agents.folder import BEST
from agents.imitation import Cloning
from agents.policy_files import load_policy
from agents.train import EXPERT, EXPERT_SPEED, EXPERT_STEPS, train
from agents.training import IMITATION, SCRATCH
from rimless_gym.envs.speed import PERIOD, SPEEDS
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from scripts.studies.learning.figures import Figures
from trajopt.feedback import laws
from trajopt.feedback.law import Controller
from trajopt.files import jsonable
from trajopt.gaits.fronts import cot_front

#: The file of a finished cell, in the folder of its training.
RESULT = "cell.json"

#: Folder of the laws' plans, in that of the study: all seeds share them.
PLANS = "plans"

#: Control intervals of a trial that only shows that it runs, where a learner has no other least.
BRIEF_STEPS = 4096

#: A cloning of such a trial.
BRIEF_CLONING = {"rounds": 1, "expert_starts": 4, "gradient_steps": 10}


class Trial(Protocol):
    """How one seed is trained and judged. It must be picklable."""

    @property
    def settings(self) -> dict[str, Any]:
        """All that its result depends on besides seed, machine and protocol: plain JSON values."""

    @property
    def period(self) -> float:
        """How long its policies hold an action (s); gaps are to optima that do the same."""

    def train(self, seed: int, folder: Path, params: WheelParams) -> int:
        """Train into a folder, or go on there; the environment steps in all.

        It notes its time in the folder, with `agents.stopwatch`, as `agents.train` does.

        Raises:
            KeyboardInterrupt: somebody asked to stop; what was learned so far is kept.
        """

    def judge(self, folder: Path, params: WheelParams, by: protocol.Protocol) -> dict[str, Figures]:
        """The policies that were trained, each by what distinguishes it from the others."""

    def brief(self) -> Trial:
        """A trial that learns nothing, but shows that everything runs."""


@dataclasses.dataclass(frozen=True)
class Trained:
    """A training by `agents.train`, on `RimlessWheel-v0`.

    Attributes:
        algo: name of the learner.
        init: "scratch" or "imitation", which also says whose settings are used.
        timesteps: control intervals; None: as many as the learner says.
        judged: what distinguishes a policy -> its file in the training's folder.
        hyperparameters: that differ from the learner's own.
        cloning: fields of `agents.imitation.Cloning` that differ from its own.
        task: prices in training that differ from the environment's.
        disturbances: in training, as the environment takes them.
    """

    algo: str
    init: str = SCRATCH
    timesteps: int | None = None
    judged: tuple[tuple[str, str], ...] = (("", BEST),)
    _: dataclasses.KW_ONLY
    hyperparameters: Mapping[str, Any] = dataclasses.field(default_factory=dict, hash=False)
    cloning: Mapping[str, Any] = dataclasses.field(default_factory=dict, hash=False)
    task: Mapping[str, float] = dataclasses.field(default_factory=dict, hash=False)
    disturbances: Mapping[str, Any] = dataclasses.field(default_factory=dict, hash=False)

    @property
    def settings(self) -> dict[str, Any]:
        """The fields, with what the learner says and how it clones, defaults included."""
        own = learners.learner(self.algo).settings(self.init)
        cloning = None if self.cloned is None else dataclasses.asdict(self.cloned)
        fields = dataclasses.asdict(self) | {"learner": own.written, "cloning": cloning}
        return dict(jsonable(fields))

    def train(self, seed: int, folder: Path, params: WheelParams) -> int:
        """Train, or go on from the last state."""
        trained = train(
            self.algo,
            self.start(seed, folder),
            seed,
            folder,
            timesteps=self.timesteps,
            params=params,
            settings=learners.learner(self.algo).settings(self.init, self.hyperparameters),
            expert=self.expert(seed, folder, params),
            cloning=self.cloned,
            plans=folder.parent / PLANS,
            progress=False,
            **self.environment,
        )
        if trained.interrupted:
            raise KeyboardInterrupt
        return trained.timesteps

    @property
    def period(self) -> float:
        """How long its policies hold an action (s)."""
        return CONTROL_PERIOD

    @property
    def environment(self) -> dict[str, Any]:
        """Arguments of `agents.train` that choose the environment."""
        return {"task": self.task, "disturbances": self.disturbances}

    @property
    def cloned(self) -> Cloning | None:
        """How it clones; None if it does not."""
        return Cloning.of(self.cloning) if self.init == IMITATION else None

    def start(self, seed: int, folder: Path) -> str:
        """What it begins from: the name of a way to begin, or a policy's file."""
        return self.init

    def expert(self, seed: int, folder: Path, params: WheelParams) -> Controller | str:
        """Whom it imitates, if it does."""
        return EXPERT

    def judge(self, folder: Path, params: WheelParams, by: protocol.Protocol) -> dict[str, Figures]:
        """Every policy by the protocol."""
        found = {}
        for which, file in self.judged:
            policy = load_policy(folder / file, params).policy
            found[which] = Figures.of(evaluate(policy, params, by))
        return found

    def brief(self) -> Self:
        """The same with the fewest steps, of cloning too; one that only imitates still does."""
        silent = learners.learner(self.algo).settings(self.init).silent
        least = 0 if self.timesteps == 0 else max(BRIEF_STEPS, 2 * silent)
        return dataclasses.replace(self, timesteps=least, cloning={**self.cloning, **BRIEF_CLONING})


@dataclasses.dataclass(frozen=True)
class Following(Trained):
    """A training on `RimlessWheelSpeed-v0`, judged at constant commands and as they change.

    Attributes:
        speeds: between which one is commanded in training (m/s).
        control_period: how long an action is held (s).
        commands: that stay for the whole walk (m/s).
        changes: one after the other, every 10 s, in one walk (m/s).
    """

    speeds: tuple[float, float] = SPEEDS
    control_period: float = PERIOD
    commands: tuple[float, ...] = ()
    changes: tuple[float, ...] = ()

    @property
    def period(self) -> float:
        """How long its policies hold an action (s)."""
        return self.control_period

    @property
    def environment(self) -> dict[str, Any]:
        """With speeds and control period."""
        own = {"speeds": self.speeds, "control_period": self.control_period}
        return super().environment | own

    def judge(self, folder: Path, params: WheelParams, by: protocol.Protocol) -> dict[str, Figures]:
        """The policy at every command."""
        ((_, file),) = self.judged
        policy, period = load_policy(folder / file, params).policy, self.control_period
        found = {
            f"{each.command:g} m/s": Figures.of(each.evaluation)
            for each in evaluate_commanded(policy, self.commands, params, by, control_period=period)
        }
        stretches = walk_through(policy, self.changes, params, by, control_period=period)
        for before, stretch in itertools.pairwise(stretches):
            found[f"{stretch.command:g} m/s after {before.command:g}"] = Figures.of_stretch(stretch)
        return found


@dataclasses.dataclass(frozen=True)
class Disturbed(Trained):
    """A training under disturbances, judged with them and without."""

    def judge(self, folder: Path, params: WheelParams, by: protocol.Protocol) -> dict[str, Figures]:
        """Every policy, undisturbed, with each of the disturbances, and with all of them."""
        each = {name: {name: value} for name, value in self.disturbances.items()}
        judged: dict[str, Mapping[str, Any]] = {"undisturbed": {}, **each}
        judged["all disturbances"] = self.disturbances
        found = {}
        for which, file in self.judged:
            policy = load_policy(folder / file, params).policy
            for name, disturbances in judged.items():
                walk = evaluate(policy, params, by, disturbances=disturbances)
                found[f"{which}: {name.replace('_', ' ')}"] = Figures.of(walk)
        return found


@dataclasses.dataclass(frozen=True)
class Holding(Trained):
    """An imitation of the usual law, about the best held gait of one step nearest to a speed.

    Attributes:
        speed: m/s.
    """

    speed: float = EXPERT_SPEED

    def expert(self, seed: int, folder: Path, params: WheelParams) -> Controller:
        """The law. Its gait and its plans are shared by all seeds."""
        plans = folder.parent / PLANS
        plans.mkdir(exist_ok=True)
        front = cot_front(params, [self.speed], [EXPERT_STEPS], hold=CONTROL_PERIOD, folder=plans)
        return laws.design(EXPERT, front.envelope[0], plans)
