#!/usr/bin/env python
"""Watch a gait, a feedback law or a policy walk, in a window or as a GIF."""

from __future__ import annotations

import argparse
import io
import itertools
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

if not __package__:  # run as a file
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from agents.film import film, film_of_gait
from agents.policy_files import PRETRAINED
from agents.rollout import Rollout, at_rest
from agents.walkers import walker
from rimless_gym import BUILDABLE
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from rimless_gym.rendering.display import Frame, Window, has_display, save_gif
from scripts.commandline import INTERRUPTED, Parser, more_than_zero, whole
from trajopt import Solution, periodic_gait
from trajopt.feedback import laws

#: What is watched as it was solved.
GAIT = "gait"

#: Pictures of a GIF per second; of a window.
FPS = 25

#: Longest GIF (s); its pictures are all in memory.
LONGEST = 300.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, until the window is closed or the time is over."""
    parser = Parser(__doc__)
    parser.add_argument(
        "what",
        nargs="?",
        default=GAIT,
        help=f"{GAIT}: the optimal gait as it was solved; a feedback law about it, from rest: "
        f"{', '.join(laws.names())}; a policy that comes with the package, from rest: "
        f"{', '.join(PRETRAINED)}; or a policy's file",
    )
    parser.add_machine(None, "machine; None: a policy's own, otherwise BUILDABLE")
    parser.add_argument(
        "--speed", type=more_than_zero, default=0.56, help="of the gait, or commanded (m/s)"
    )
    parser.add_argument("--steps", type=whole(1), default=1, help="of the gait, per stride")
    parser.add_argument("--seconds", type=more_than_zero, default=20.0, help="of walking")
    parser.add_argument("--out", type=Path, help="a GIF to write instead of showing a window")
    parser.add_argument(
        "--size", type=whole(50, 4000), nargs=2, default=(600, 360), metavar=("WIDTH", "HEIGHT")
    )
    options = parser.parse_args(arguments)
    least, most = 1 / FPS, LONGEST if options.out else math.inf
    if not least <= options.seconds <= most:
        parser.error(
            f"--seconds {options.seconds:g}: must be at least {least:g}, one picture, and in a GIF "
            f"at most {LONGEST:g}"
        )
    chosen = options.preset or options.params
    params = parser.machine(options) if chosen else None
    if options.out is None:
        require_display(parser, "write a GIF with --out walk.gif")
    elif options.out.suffix.lower() != ".gif":
        parser.error(f"--out {options.out}: is written as a GIF; give a name that ends with .gif")
    else:
        parser.require_file(options.out)
    try:
        with parser.refusing():
            frames = frames_of(options, params)
            if options.out is None:
                show(frames, tuple(options.size))
            else:
                encoded = io.BytesIO()
                save_gif(list(frames), encoded, FPS)
                with parser.out_of_room(options.out.parent):
                    options.out.write_bytes(encoded.getvalue())
                print(options.out)
    except KeyboardInterrupt:
        return INTERRUPTED
    return 0


def frames_of(options: argparse.Namespace, given: WheelParams | None) -> Iterator[Frame]:
    """The pictures that were asked for.

    Args:
        options: of the command line.
        given: the machine; None: a policy's own, or the default.

    Raises:
        ValueError: there is no such gait, law or policy.
    """
    size, params = tuple(options.size), given or BUILDABLE
    if options.what == GAIT:
        gait = periodic_gait(params, options.speed, options.steps)
        return film_of_gait(gait, options.seconds, fps=FPS, size=size)

    def gait_for(machine: WheelParams) -> Solution:
        return periodic_gait(machine, options.speed, options.steps, hold=CONTROL_PERIOD)

    one = walker(options.what, gait_for, given)
    command = options.speed if one.conditions.commanded else None
    n_intervals = round(options.seconds / one.period)
    start = at_rest(one.params)[None]
    walk = Rollout(one.conditions, one.policy, start, n_intervals, command=command)
    return film(one.params, walk, fps=FPS, size=size, period=one.period)


def show(frames: Iterator[Frame], size: tuple[int, ...]) -> None:
    """Show pictures in a window until it is closed or there are no more."""
    width, height = size
    window = Window((width, height), FPS)
    for frame in itertools.takewhile(lambda _: window.is_open, frames):
        window.show(frame)
    window.close()


def require_display(parser: Parser, remedy: str) -> None:
    """Refuse to go on where no window can be shown."""
    if not has_display():
        parser.error(f"no display: nothing can be shown here; {remedy}")


if __name__ == "__main__":
    sys.exit(main())
