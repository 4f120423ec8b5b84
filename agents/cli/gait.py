"""`rimless gait`, `rimless list` and `rimless warmup`."""

from __future__ import annotations

import json
import sys
import time
from typing import Annotated

from tyro.conf import arg

from agents.cli.options import (
    Count,
    Fields,
    Flag,
    MaybePath,
    MaybePositive,
    MaybeWhole,
    Positive,
    Preset,
    Whole,
    machine,
    require_file,
)

#: Speeds (m/s) that differ by less are the same in a report.
SAME = 5e-5


def gait(
    *,
    preset: Preset = "BUILDABLE",
    params: Fields = None,
    speed: Positive = 0.62,
    steps: Count = 1,
    regeneration: Flag = False,
    hold: MaybePositive = None,
    starts: MaybeWhole = None,
    seed: Whole = 0,
    guess: MaybePath = None,
    workers: Count = 1,
    out: MaybePath = None,
    json_: Annotated[bool, arg(name="json", help_behavior_hint="")] = False,
) -> int:
    """Find the optimal gait of a machine: of least cost of transport, verified.

    The exit status is 1 if the gait does not pass verification, 2 if none is found.

    Args:
        preset: machine
        params: fields that differ from the preset's: hub_damping=0.01 n_legs=6
        speed: mean speed (m/s)
        steps: touchdowns per stride
        regeneration: let the battery take energy back
        hold: hold the voltage for so long (s), as the environment does for 0.01; the speed is then
            the nearest at which a stride lasts a whole number of such intervals
        starts: random starts; by default none with --guess or where a shipped gait is of the same
            machine, else 60
        seed: of the random starts
        guess: a gait (.npz, from --out) of as many steps to start from, in place of shipped ones
        workers: processes
        out: file to save the gait in (.npz)
        json_: print figures as JSON
    """
    from trajopt import Solution, periodic_gait

    if out is not None:
        require_file(out)
    solution = periodic_gait(
        machine(preset, params),
        speed,
        steps,
        regeneration,
        hold=hold,
        starts=starts,
        seed=seed,
        guess=None if guess is None else Solution.load(guess),
        workers=workers,
    )
    try:  # a full disk must not lose the report, nor a closed pipe the file
        if out is not None:
            solution.save(out)
    finally:
        if json_:
            print(json.dumps(solution.to_dict(), indent=2))
        else:
            print(solution.report())
            if abs(solution.speed - speed) > SAME:
                print(
                    f"  requested speed         {speed:g} m/s; at no speed nearer to it does a "
                    "stride last a whole number of intervals"
                )
    return 0 if solution.verification.passed else 1


def catalog() -> int:
    """List policies, feedback laws, learners, machines and shipped gaits."""
    from agents.learner import LEARNERS
    from agents.policy_files import ADAPTIVE, PRETRAINED
    from rimless_gym.presets import PRESETS
    from trajopt.feedback import laws
    from trajopt.gaits.library import index

    for title, names in (
        ("policies", PRETRAINED),
        ("feedback laws", laws.names()),
        ("controller that identifies its machine", [ADAPTIVE]),
        ("learners", sorted(LEARNERS)),
    ):
        print(f"{title}: {', '.join(names)}")
    for name, params in PRESETS.items():
        gaits = [each for each in index() if each.params == params]
        speeds = [each.speed for each in gaits]
        about = f"{params.n_legs} legs, {params.total_mass:.3g} kg"
        if gaits:
            steps = sorted({each.steps for each in gaits})
            about += (
                f"; {len(gaits)} shipped gaits of {', '.join(map(str, steps))} steps, "
                f"{min(speeds):.3f} to {max(speeds):.3f} m/s"
            )
        print(f"preset {name}: {about}")
    return 0


def warmup() -> int:
    """Compile the simulator now, and keep the compiled code."""
    import gymnasium
    import numpy as np

    from agents.evaluate import Protocol, evaluate
    from rimless_gym import BUILDABLE, simulate

    def environment() -> None:
        env = gymnasium.make("RimlessWheel-v0")
        env.reset(seed=0)
        env.step(np.zeros(1, np.float32))

    def vector_environment() -> None:
        envs = gymnasium.make_vec("RimlessWheel-v0", num_envs=16)
        envs.reset(seed=0)
        envs.step(np.zeros((16, 1), np.float32))

    def evaluation() -> None:
        brief = Protocol(starts=2, duration=0.2, window=0.1, alive=0.1)
        evaluate(lambda states, observations: np.zeros(len(states)), protocol=brief)

    def reference_simulator() -> None:
        simulate(BUILDABLE, [1.5, 0.0, 2.0, 0.0], lambda t, x: 4.0, duration=0.1)

    for part in (environment, vector_environment, evaluation, reference_simulator):
        begun = time.perf_counter()
        part()
        print(f"{part.__name__.replace('_', ' ')}: {time.perf_counter() - begun:.1f} s")
        sys.stdout.flush()
    return 0
