"""Ship gaits that stop on two feet once in a stride, where they cost less than a machine's front.

Where the gait of least cost lands softly, a stop costs little: the pendulum swings over the hub of
a wheel that stands. Strides of several steps and one stop are slower than that gait; they are
solved at slower and slower speeds. (The front's other gaits have one foot on the ground.)
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from agents.cli.main import run as run_command
from agents.cli.options import Count, Preset
from rimless_gym.presets import as_params
from scripts.studies.documents.markdown import marks, refresh, table
from scripts.studies.fronts.command import DOCS, chosen, ship
from trajopt import pool
from trajopt.gaits.fronts import CotFront, shipped_front
from trajopt.gaits.library import ARCHIVE, repeated, shipped
from trajopt.gaits.periodic import NoGaitError, periodic_gait
from trajopt.gaits.solution import Solution

#: Repetitions of the gait of least cost in a stride with one stop, and by how much longer than
#: without it the stride lasts (s).
REPETITIONS, LONGER = (2, 3, 4), (0.03, 0.045, 0.06)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    return run_command(stops, arguments, "python -m scripts.studies stops")


def stops(*, preset: Preset = "BUILDABLE", workers: Count | None = None) -> int:
    """Ship gaits that stop once in a stride, where they cost less than a machine's front.

    Args:
        preset: machine.
        workers: processes; by default one for every core.
    """
    params = as_params(preset)
    gaits = [gait for gait in shipped(params) if not gait.regeneration]
    front = shipped_front(params)
    for _, found in pool.run(partial(stopping, front), REPETITIONS, workers, progress="stops"):
        gaits += found
    best = chosen([], gaits)
    ship(ARCHIVE, preset, best)
    text = section(front, [gait for gait in best if gait.double_stance])
    refresh(DOCS / "front.md", marks("stops", (preset,)), {preset: text})
    return 0


def section(front: CotFront, gaits: Sequence[Solution]) -> str:
    """The table of gaits that stop, beside the front without them."""
    head = ["speed (m/s)", "CoT", "front without stops", "steps", "turns", "on two feet (s)"]
    rows = [
        [
            f"{gait.speed:.4f}",
            f"{gait.cot:.5f}",
            f"{float(front(gait.speed)):.5f}",
            gait.steps,
            gait.theta_turns,
            f"{gait.phases[-1].duration:.3f}",
        ]
        for gait in sorted(gaits, key=lambda gait: (round(gait.speed, 4), gait.steps))
    ]
    return table(head, rows) + "\n"


def stopping(front: CotFront, times: int) -> list[Solution]:
    """Gaits with one stop in so many strides of the front's best gait, if they cost less."""
    best = min(front.envelope, key=lambda gait: gait.cot)
    guess, found = repeated(best, times), list[Solution]()
    for longer in LONGER:
        speed = round(times * best.verification.distance / (times * best.duration + longer), 4)
        try:
            gait = periodic_gait(best.params, speed, guess.steps, double_stance=True, guess=guess)
        except NoGaitError:
            break
        if not gait.verification.passed or gait.cot > float(front(speed)):
            break
        found.append(gait)
        guess = gait
    return found
