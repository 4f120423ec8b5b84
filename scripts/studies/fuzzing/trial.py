"""One trial of a fuzz, which its seed determines."""

from __future__ import annotations

import dataclasses
import time
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from rimless_gym import Disturbances, Pushes, RimlessWheelVectorEnv, SensorNoise, WheelParams
from rimless_gym.equations import IMPACT_LAWS
from scripts.studies.fuzzing import draws
from scripts.studies.fuzzing.reintegration import DIFFERENCE, Interval, difference
from scripts.studies.fuzzing.rules import Rules, followed
from scripts.studies.fuzzing.tally import Case, Tally
from scripts.studies.fuzzing.twin import OTHER_START, Twin

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

LENGTH = 250  # intervals
ROWS = (1, 2, 7, 16, 64, 64, 64, 64, 64, 600)
REINTEGRATED = 20  # intervals to compare with the reference simulator
MOST_CASES = 5  # that one trial reports

#: Processor time (s) that a step may take: for each row, and for the call. It is ten times what the
#: stiffest machine that the environment accepts needs.
SLOWEST_ROW, SLOWEST_CALL = 0.01, 0.2


def warm_up() -> None:
    """Compile or load what a trial needs, so that its steps are not timed with that."""
    everything = Disturbances(
        pushes=Pushes(rate=1.0, impulse=(0.0, 0.1)), sensor_noise=SensorNoise(leg_angle=0.1)
    )
    envs = RimlessWheelVectorEnv(1, disturbances=everything)
    envs.reset(seed=0)
    envs.step(np.zeros((1, 1), dtype=np.float32))


@dataclasses.dataclass(frozen=True)
class Step:
    """One step of the vector environment.

    Attributes:
        number: of the step, from 0.
        machines: of the rows.
        before: hybrid states before it (N, STATE_SIZE).
        actions: (N, 1).
        seen: what `step` returned.
        after: hybrid states after it; in rows that were reset, those of the new episodes.
        begun: rows that were reset instead of stepped (N,).
    """

    number: int
    machines: tuple[WheelParams, ...]
    before: Floats
    actions: NDArray[np.float32]
    seen: Any
    after: Floats
    begun: Bools

    @property
    def info(self) -> dict[str, Any]:
        """The `info` of the step."""
        info: dict[str, Any] = self.seen[4]
        return info

    @property
    def ended(self) -> Bools:
        """Rows whose episode ended."""
        ended: Bools = self.seen[2] | self.seen[3]
        return ended


class Trial:
    """A vector environment of random machines under random voltages, checked at every step.

    Args:
        seed: determines everything random.
        kind: class of the environment.
    """

    def __init__(
        self, seed: int, kind: type[RimlessWheelVectorEnv] = RimlessWheelVectorEnv
    ) -> None:
        self._seed, self._kind = seed, kind
        self._rng = rng = np.random.default_rng(seed)
        n = int(rng.choice(ROWS))
        self._machines = self._draw_machines(n)
        settings: dict[str, Any] = {"max_episode_steps": int(rng.integers(5, 2 * LENGTH))}
        if rng.random() < 0.4:
            settings["disturbances"] = draws.disturbances(rng, self._machines[0])
        self._ranged = n <= 16 and rng.random() < 0.5
        if self._ranged:
            settings["ranges"] = draws.ranges(rng, self._machines[0])
            self._machines = [self._machines[0]] * n
        self._plain = not self._ranged and "disturbances" not in settings
        self._mode = AutoresetMode(rng.choice([mode.value for mode in AutoresetMode]))
        self._settings = settings
        self._tally = Tally(seeds=1)
        self._cases: list[Case] = []

    def _draw_machines(self, n: int) -> list[WheelParams]:
        """One machine for all rows, or up to 64 different ones."""
        one = self._rng.random() < 0.3
        # Under the thesis's law a backward touchdown in one row stops the whole environment.
        laws = IMPACT_LAWS if one else ("plastic", "plastic", "plastic", "relabel")
        each = [draws.machine(self._rng, laws) for _ in range(1 if one else min(n, 64))]
        return [each[i % len(each)] for i in range(n)]

    def run(self) -> Tally:
        """Step to the end, or until the environment cannot find a start for an episode."""
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
            self._step_through(envs, self._begin(envs))
        except RuntimeError as error:
            if "no start found" not in str(error):
                raise
        finally:
            envs.close()
        return self._tally + Tally(cases=tuple(self._cases))

    def _begin(self, envs: RimlessWheelVectorEnv) -> Twin:
        """Begin all episodes, most of them in states drawn here. One row gets a twin."""
        rng, n = self._rng, envs.num_envs
        first, _ = envs.reset(seed=self._seed)
        starts: list[Any] = [None] * n
        if not self._ranged:  # ranges would draw other machines for the start
            starts = [draws.start(rng, m) if rng.random() < 0.7 else None for m in envs.params]
        given = np.array([start is not None for start in starts])
        if given.any():
            chosen = [start for start in starts if start is not None]
            options = {name: [start[name] for start in chosen] for name in ("state", "mode")}
            first, _ = envs.reset(options={**options, "reset_mask": given})
        row = int(rng.integers(n))
        settings = self._settings | {"params": self._machines[row]}
        twin = Twin(self._mode, settings, row, self._seed, starts[row])
        if not np.array_equal(twin.first, first[row]):
            self._note(OTHER_START, 0, row, envs.params[row])
        return twin

    def _step_through(self, envs: RimlessWheelVectorEnv, first_twin: Twin) -> None:
        rng, n = self._rng, envs.num_envs
        twin: Twin | None = first_twin
        machines, begun = envs.params, np.zeros(n, dtype=np.bool_)
        voltages, rules = draws.Voltages(rng, list(machines)), Rules(machines)
        chosen = (
            set(rng.choice(LENGTH, REINTEGRATED, replace=False).tolist()) if self._plain else set()
        )
        for number in range(LENGTH):
            before = envs.states
            actions = voltages.next(before)
            clock = time.process_time()
            try:
                seen = envs.step(actions)
            except RuntimeError as error:
                if "left the model's range" not in str(error):
                    raise
                # The rows have been stepped, but there is nothing to check.
                self._tally += Tally(steps=int(n - begun.sum()), ends=1)
                envs.reset()
                machines, begun, twin = envs.params, np.zeros(n, dtype=np.bool_), None
                rules = Rules(machines)
                continue
            seconds = time.process_time() - clock
            if seconds > n * SLOWEST_ROW + SLOWEST_CALL:
                self._note(f"a step took {seconds:.1f} s", number)
            step = Step(number, machines, before, actions, seen, envs.states, begun)
            self._check(step, rules)
            if twin is not None:
                self._compare(step, twin)
            if number in chosen:
                self._reintegrate(step)
            if self._mode is AutoresetMode.DISABLED and step.ended.any():
                observations, _ = envs.reset(options={"reset_mask": step.ended})
                if twin is not None and step.ended[twin.row]:
                    self._tell(twin.begin(observations[twin.row]), step, twin.row)
            if self._ranged and (step.ended.any() or begun.any()):
                machines = envs.params
                rules = Rules(machines)
            begun = step.ended if self._mode is AutoresetMode.NEXT_STEP else np.zeros_like(begun)

    def _check(self, step: Step, rules: Rules) -> None:
        """Note every rule that the step breaks."""
        stepped = ~step.begun
        observations, rewards, terminated, _, info = step.seen
        running = stepped & ~step.ended
        broken = rules.broken(step.before, step.after, running, observations, rewards, info)
        for trouble, rows in broken:
            if (rows & stepped).any():
                self._tell(trouble, step, int(np.flatnonzero(rows & stepped)[0]))
        residuals = rules.residuals(step.before, info)[stepped]
        self._tally += Tally(
            steps=int(stepped.sum()),
            ends=int(terminated.sum()),
            residual=float(residuals.max(initial=0.0)),
        )

    def _compare(self, step: Step, twin: Twin) -> None:
        self._tell(twin.trouble(step.actions[twin.row], step.seen), step, twin.row)
        self._tally += Tally(twinned=1)

    def _reintegrate(self, step: Step) -> None:
        """Compare one row's interval with the reference simulator's.

        The row's machine must be `followed`, and the state after the interval known.
        """
        _, _, terminated, truncated, info = step.seen
        rows = ~step.begun & (info["elapsed"] > 0.0)
        rows &= [followed(machine) for machine in step.machines]
        if self._mode is AutoresetMode.SAME_STEP:
            rows &= terminated | ~truncated
        if not rows.any():
            return
        i = int(self._rng.choice(np.flatnonzero(rows)))
        command = float(np.clip(np.float64(step.actions[i, 0]), -1.0, 1.0))
        interval = Interval(
            params=step.machines[i],
            before=step.before[i],
            voltage=step.machines[i].voltage_limit * command,
            after=None if terminated[i] else step.after[i],
            **{name: float(info[name][i]) for name in ("elapsed", "electrical", "distance")},
        )
        apart, borderline = difference(interval)
        if np.isnan(apart):
            return
        if apart > DIFFERENCE and not borderline:
            self._tell(f"{apart:.3g} from the reference", step, i)
        self._tally += Tally(
            reintegrated=1, borderline=int(borderline), difference=0.0 if borderline else apart
        )

    def _tell(self, trouble: str | None, step: Step, row: int) -> None:
        """Note a trouble with a row, if it is not None."""
        if trouble is not None:
            state, voltage = step.before[row].tolist(), float(step.actions[row, 0])
            self._note(trouble, step.number, row, step.machines[row], state, voltage)

    def _note(
        self,
        trouble: str,
        step: int,
        row: int | None = None,
        machine: WheelParams | None = None,
        state: list[float] | None = None,
        voltage: float | None = None,
    ) -> None:
        if len(self._cases) < MOST_CASES:
            params = None if machine is None else machine.to_dict()
            self._cases.append(Case(self._seed, trouble, step, row, params, state, voltage))
