"""One trial: all that follows from a seed."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from rimless_gym import RimlessWheelVectorEnv, WheelParams
from rimless_gym.params import IMPACT_LAWS
from scripts.fuzzing import draws
from scripts.fuzzing.reintegration import DIFFERENCE, Interval, difference
from scripts.fuzzing.rules import Rules
from scripts.fuzzing.tally import Case, Tally
from scripts.fuzzing.twin import Twin

Floats = NDArray[np.float64]

LENGTH = 250  # intervals
ROWS = (1, 2, 7, 16, 64, 64, 64, 64, 64, 600)
ANEW = 20  # intervals that are integrated anew
MOST_CASES = 5  # that one trial tells of

#: Processor time (s) that a step may take: of every row, and besides. Ten times what the stiffest
#: machine needs that is admitted.
SLOWEST_ROW, SLOWEST_CALL = 0.01, 0.2


def warm_up() -> None:
    """Compile or load what a trial needs, so that its steps take their own time alone."""
    envs = RimlessWheelVectorEnv(1)
    envs.reset(seed=0)
    envs.step(np.zeros((1, 1), dtype=np.float32))


class Trial:
    """A vector environment of random machines under random voltages, checked at every step.

    Args:
        seed: all that is random follows from it.
        kind: the class of the environment.
    """

    def __init__(
        self, seed: int, kind: type[RimlessWheelVectorEnv] = RimlessWheelVectorEnv
    ) -> None:
        self._seed, self._kind = seed, kind
        self._rng = rng = np.random.default_rng(seed)
        n = int(rng.choice(ROWS))
        self._machines = self._draw_machines(n)
        settings: dict[str, Any] = {}
        if rng.random() < 0.4:
            settings["disturbances"] = draws.disturbances(rng, self._machines[0])
        if n <= 16 and rng.random() < 0.5:
            settings["ranges"] = draws.ranges(rng, self._machines[0])
            self._machines = [self._machines[0]] * n
        self._plain = not settings
        settings["max_episode_steps"] = int(rng.integers(5, 2 * LENGTH))
        self._mode = AutoresetMode(rng.choice([mode.value for mode in AutoresetMode]))
        self._settings = settings
        self._tally = Tally(seeds=1)
        self._cases: list[Case] = []

    def _draw_machines(self, n: int) -> list[WheelParams]:
        """One for all rows, or one each; of many rows, several have the same."""
        one = self._rng.random() < 0.3
        # The thesis's law ends all rows' step where one goes backward.
        laws = IMPACT_LAWS if one else ("plastic", "plastic", "plastic", "relabel")
        each = [draws.machine(self._rng, laws) for _ in range(1 if one else min(n, 64))]
        return [each[i % len(each)] for i in range(n)]

    def run(self) -> Tally:
        """Step to the end, or until the environment cannot begin an episode."""
        n = len(self._machines)
        one = all(machine is self._machines[0] for machine in self._machines)
        envs = self._kind(
            n,
            self._machines[0] if one else self._machines,
            autoreset_mode=self._mode,
            num_threads=2 if n > 512 else 1,
            **self._settings,
        )
        try:
            self._step_through(envs)
        except RuntimeError as error:
            if "no start found" not in str(error):
                raise
        finally:
            envs.close()
        return self._tally + Tally(cases=tuple(self._cases))

    def _step_through(self, envs: RimlessWheelVectorEnv) -> None:
        rng, n = self._rng, envs.num_envs
        envs.reset(seed=self._seed)
        starts = [
            draws.start(rng, machine) if rng.random() < 0.7 else None for machine in envs.params
        ]
        if "ranges" in self._settings:  # which draw other machines in every episode
            starts = [None] * n
        given = np.array([start is not None for start in starts])
        if given.any():
            chosen = [start for start in starts if start is not None]
            options = {name: [start[name] for start in chosen] for name in chosen[0]}
            envs.reset(options={**options, "reset_mask": given})
        twin: Twin | None = self._twin(int(rng.integers(n)), starts)
        voltages = draws.Voltages(rng, list(envs.params))
        rules, resting = Rules(envs.params), np.zeros(n, dtype=bool)
        anew = set(rng.choice(LENGTH, ANEW, replace=False).tolist()) if self._plain else set()
        for step in range(LENGTH):
            before = envs.states
            actions = voltages.next(before)
            began = time.process_time()
            try:
                seen = envs.step(actions)
            except RuntimeError as error:
                if "left the model's range" not in str(error):
                    raise
                # The rows have been stepped, but nothing of it can be seen.
                self._tally += Tally(steps=int(n - resting.sum()), ends=1)
                envs.reset()
                resting[:], twin, rules = False, None, Rules(envs.params)
                continue
            seconds = time.process_time() - began
            if seconds > n * SLOWEST_ROW + SLOWEST_CALL:
                self._note(f"a step took {seconds:.1f} s", step)
            after = envs.states
            ended = seen[2] | seen[3]
            self._check(step, envs, rules, before, after, actions, seen, resting)
            if twin is not None:
                self._compare(step, twin, actions, seen)
            if step in anew:
                self._integrate_anew(step, before, after, actions, seen, resting)
            if self._mode is AutoresetMode.NEXT_STEP:
                resting = ended
            elif self._mode is AutoresetMode.DISABLED and ended.any():
                observations, _ = envs.reset(options={"reset_mask": ended})
                if twin is not None and ended[twin.row]:
                    self._tell(twin.begin(observations[twin.row]), step, twin.row)
            if "ranges" in self._settings and (ended.any() or resting.any()):
                rules = Rules(envs.params)

    def _twin(self, row: int, starts: list[Any]) -> Twin:
        settings = self._settings | {"params": self._machines[row]}
        return Twin(self._mode, settings, row, self._seed, starts[row])

    def _check(
        self,
        step: int,
        envs: RimlessWheelVectorEnv,
        rules: Rules,
        before: Floats,
        after: Floats,
        actions: Any,
        seen: Any,
        resting: Any,
    ) -> None:
        """Look at the rules; rows that were begun anew in this step are not looked at."""
        observations, rewards, terminated, truncated, info = seen
        ended = terminated | truncated
        of = self._settings
        if "ranges" in of and self._mode is AutoresetMode.SAME_STEP:
            resting = resting | ended  # they have another machine by now
        stepped = ~resting
        broken = rules.broken(before, after, stepped & ~ended, observations, rewards, info)
        for trouble, rows in broken:
            rows = rows & stepped
            if rows.any():
                row = int(np.flatnonzero(rows)[0])
                self._note(trouble, step, row, before[row], actions[row, 0])
        residual = float(rules.residuals(before, info)[stepped].max(initial=0.0))
        self._tally += Tally(
            steps=int(stepped.sum()), ends=int(terminated.sum()), residual=residual
        )

    def _compare(self, step: int, twin: Twin, actions: Any, seen: Any) -> None:
        self._tell(twin.trouble(actions[twin.row], seen), step, twin.row)
        self._tally += Tally(twinned=1)

    def _integrate_anew(
        self, step: int, before: Floats, after: Floats, actions: Any, seen: Any, resting: Any
    ) -> None:
        _, _, terminated, truncated, info = seen
        rows = np.flatnonzero(~resting & (info["elapsed"] > 0.0))
        if not len(rows):
            return
        i = int(self._rng.choice(rows))
        params = self._machines[i]
        unseen = terminated[i] or (truncated[i] and self._mode is AutoresetMode.SAME_STEP)
        voltage = params.voltage_limit * float(np.clip(np.float64(actions[i, 0]), -1.0, 1.0))
        if truncated[i] and unseen and not terminated[i]:
            return
        amounts = [float(info[name][i]) for name in ("elapsed", "electrical", "distance")]
        apart, borderline = difference(
            Interval(params, before[i], voltage, None if unseen else after[i], *amounts)
        )
        if np.isnan(apart):
            return
        if apart > DIFFERENCE and not borderline:
            self._note(f"{apart:.3g} from the reference", step, i, before[i], actions[i, 0])
        self._tally += Tally(
            reintegrated=1,
            borderline=int(borderline),
            difference=0.0 if borderline else apart,
        )

    def _tell(self, trouble: str | None, step: int, row: int) -> None:
        if trouble is not None:
            self._note(trouble, step, row)

    def _note(
        self,
        trouble: str,
        step: int,
        row: int | None = None,
        state: Any = None,
        voltage: Any = None,
    ) -> None:
        if len(self._cases) < MOST_CASES:
            self._cases.append(
                Case(
                    self._seed,
                    trouble,
                    step,
                    row,
                    None if row is None else self._machines[row].to_dict(),
                    None if state is None else [float(x) for x in state],
                    None if voltage is None else float(voltage),
                )
            )
