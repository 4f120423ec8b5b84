"""The share of a training by `agents.train` that goes into our environments, logs included.

A measurement is a tenth of a training: roll-outs of PPO with its updates, figures of walking logged
at every step, and at the end one evaluation of the policy and one saved state.
"""

from __future__ import annotations

import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

from agents import learners
from agents.conditions import Conditions
from agents.interrupts import StopRequest
from agents.protocol import SHORT_PROTOCOL
from agents.sb3.callbacks import LogWalking
from agents.sb3.hyperparameters import Hyperparameters
from agents.sb3.training_env import Offer
from agents.session import EVALUATIONS, Plan, Session, Standing
from agents.train import reward_per_second
from agents.training import SCRATCH, Training
from rimless_gym import RimlessWheelVectorEnv
from rimless_gym.envs.task import Task

from ..protocol import Measure, serve
from ..walks import PARAMS

#: Control intervals of a whole training.
TOTAL = 500_000

#: Steps after which a session would evaluate by itself, as it does at its end: never.
NEVER = 10**18


class Stopwatch:
    """Adds up the time that is spent in some functions, which may call each other."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._running = False

    def watch(self, owner: Any, name: str) -> None:
        """Time all calls of a function of an object, or of a class, from now on."""
        function = getattr(owner, name)

        def timed(*arguments: Any, **settings: Any) -> Any:
            if self._running:
                return function(*arguments, **settings)
            self._running, begin = True, time.perf_counter()
            try:
                return function(*arguments, **settings)
            finally:
                self.seconds += time.perf_counter() - begin
                self._running = False

        setattr(owner, name, timed)


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Train with PPO on one thread, however long a measurement takes.

    An answer has the `share` of all of it, and of that the parts in `learning` and in `logging`;
    the rest is in evaluations.
    """
    hyperparameters = Hyperparameters(
        n_timesteps=TOTAL,
        n_envs=settings["n"],
        offer=Offer(),
        algorithm={"policy": "MlpPolicy", **settings["ppo"]},
        entry={},
    )
    conditions, seed = Conditions(PARAMS), 0
    training = Training("ppo", SCRATCH, seed, conditions, Task(), hyperparameters)
    learner: Any = learners.learner("ppo")(training)
    watches = {name: Stopwatch() for name in ("learning", "logging", "share")}
    watches["learning"].watch(learner.model.env, "step")  # the adapter included
    watches["logging"].watch(LogWalking, "on_step")
    for owner, name in (
        (learner.model.env, "step"),
        (LogWalking, "on_step"),
        (RimlessWheelVectorEnv, "reset"),  # this one and the next for evaluations
        (RimlessWheelVectorEnv, "step"),
    ):
        watches["share"].watch(owner, name)

    def measure(seconds: float) -> dict[str, Any]:
        before = {name: watch.seconds for name, watch in watches.items()}
        steps, begin = learner.steps, time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            plan = Plan(
                training=training,
                out=Path(folder),
                total=steps + TOTAL // EVALUATIONS,
                score=reward_per_second,
                protocol=SHORT_PROTOCOL,
                progress=False,
                minutes=lambda: 0.0,
            )
            stop = StopRequest("never", "nothing")
            session = Session(plan, learner, Standing(due=NEVER), stop)
            try:
                session.run()
            finally:
                session.close()
        elapsed = time.perf_counter() - begin
        return {
            "steps": learner.steps - steps,
            "seconds": elapsed,
            **{name: (watch.seconds - before[name]) / elapsed for name, watch in watches.items()},
        }

    return measure, {"version": f"stable-baselines3 {version('stable_baselines3')}"}


if __name__ == "__main__":
    serve(setup)
