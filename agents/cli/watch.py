"""Watch gaits, feedback laws and policies walk on one ground: in a window, as a GIF or a video.

The first is drawn solid, the others as ghosts. Below are the phase plane and where the energy goes.
Laws and policies start from rest. The optimum has no start of its own: behind a walker it joins
once that has walked some steps.
"""

from __future__ import annotations

import argparse
import io
import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from tqdm import tqdm

from agents.cli.command import INTERRUPTED
from agents.cli.commandline import Parser, more_than_zero, whole
from agents.film import times
from agents.policy_files import PRETRAINED
from agents.race import GHOST, MOST, SIZE, Race, ghost
from agents.recording import Recording, record_gait, record_walker
from agents.walkers import walker
from rimless_gym import BUILDABLE
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from rimless_gym.presets import machine_name
from rimless_gym.rendering.display import Window, ffmpeg, has_display, save_gif, save_mp4
from trajopt import Solution, periodic_gait
from trajopt.feedback import laws
from trajopt.files import write_bytes
from trajopt.gaits.library import shipped

#: How the name of a file ends that is to be an animated GIF, or a video.
GIF, VIDEO = ".gif", ".mp4"

#: How the name of a gait's file ends.
GAIT = ".npz"

#: Pictures of a window per second; of a GIF, which counts in 1/100 s; of a video.
FPS, GIF_FPS, VIDEO_FPS = 25, 100 / 6, 50

#: Longest walk, and longest GIF (s); its pictures are all in memory.
LONGEST, LONGEST_GIF = 600.0, 60.0

#: Size of a GIF's palette, and pictures from which it is chosen.
COLOURS, SAMPLES = 32, 9


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, until the window is closed or the time is over."""
    parser = Parser(__doc__)
    parser.add_argument(
        "names",
        nargs="*",
        metavar="WALKER",
        default=[GHOST],
        help=f"{GHOST}: the optimal gait whose voltage is held for {1e3 * CONTROL_PERIOD:g} ms; a "
        f"feedback law about it: {', '.join(laws.names())}; a policy that comes with the package: "
        f"{', '.join(PRETRAINED)}; or the file of a policy, or of a gait ({GAIT}); at most {MOST}",
    )
    parser.add_machine(None, "machine; by default that of a policy or a gait, otherwise BUILDABLE")
    parser.add_argument(
        "--speed", type=more_than_zero, default=0.56, help="of the gait, or commanded (m/s)"
    )
    parser.add_argument("--steps", type=whole(1), default=1, help="of the gait, per stride")
    parser.add_argument("--seconds", type=more_than_zero, default=20.0, help="of walking")
    parser.add_trust()
    parser.add_argument(
        "--out", type=Path, help="a .gif or .mp4 to write instead of showing a window"
    )
    parser.add_argument(
        "--size",
        type=whole(50, 4000),
        nargs=2,
        default=SIZE,
        metavar=("WIDTH", "HEIGHT"),
        help="of the picture, in pixels",
    )
    options = parser.parse_args(arguments)
    kind = options.out and options.out.suffix.lower()
    longest = LONGEST_GIF if kind == GIF else LONGEST
    if not 1 / GIF_FPS <= options.seconds <= longest:
        parser.error(
            f"--seconds {options.seconds:g}: must be at least {1 / GIF_FPS:g}, one picture, and "
            f"at most {longest:g}"
        )
    if len(options.names) > MOST:
        parser.error(f"{len(options.names)} walkers: at most {MOST} fit into one picture")
    for name in options.names:
        if options.names.count(name) > 1:
            parser.error(f"{name}: is named twice; name each walker once")
    chosen = options.preset or options.params
    params = parser.machine(options) if chosen else None
    if options.out is None:
        require_display(parser, "write a GIF with --out walk.gif")
    elif kind not in FILMS:
        parser.error(f"--out {options.out}: give a name that ends with {' or '.join(FILMS)}")
    else:
        if kind == VIDEO:
            ffmpeg()  # refused before the walks are computed
        parser.require_file(options.out)
    try:
        with parser.refusing():
            race = race_of(options, params)
            if options.out is None:
                show(race)
            else:
                with parser.writing(options.out):
                    FILMS[kind](race, options.out)
                print(options.out)
    except KeyboardInterrupt:
        return INTERRUPTED
    return 0


def race_of(options: argparse.Namespace, given: WheelParams | None) -> Race:
    """The walks that were asked for.

    Args:
        options: of the command line.
        given: the machine; None: that of the first policy or law, or else gait, or the default.

    Raises:
        ValueError: there is no such gait, law or policy, or they are of several machines.
    """

    saved = {name: Solution.load(name) for name in options.names if name.lower().endswith(GAIT)}

    @lru_cache
    def gait_for(machine: WheelParams) -> Solution:
        require_near(machine, options.speed)
        near = (g for g in saved.values() if (g.params, g.steps) == (machine, options.steps))
        return periodic_gait(
            *(machine, options.speed, options.steps),
            hold=CONTROL_PERIOD,
            guess=next((gait for gait in near if gait.hold is None), None),
            progress=True,
        )

    gaits = {name: as_held(gait) for name, gait in saved.items()}
    named = [name for name in options.names if name != GHOST and name not in gaits]
    trust = options.trust_pickle
    found = {name: walker(name, gait_for, given, trust_pickle=trust) for name in named}
    own = [*(one.params for one in found.values()), *(gait.params for gait in gaits.values())]
    params = given or next(iter(own), BUILDABLE)
    for name, gait in gaits.items():
        if gait.params != params:
            raise ValueError(
                f"{name}: is a gait of another machine: {gait.params.differences(params)}; watch "
                "it without walkers of other machines, --preset and --params"
            )
    solved = GHOST in options.names or any(one.gait for one in found.values())
    cycle: Solution | None
    if solved or (not gaits and any(gait.params == params for gait in shipped())):
        cycle = gait_for(params)
    else:  # a search would take minutes
        cycle = next(iter(gaits.values()), None)
    walks: list[Recording] = []
    for name in options.names:
        if name in gaits:
            walks.append(record_gait(name, gaits[name], options.seconds))
        elif name != GHOST:
            command = options.speed if found[name].conditions.commanded else None
            walks.append(record_walker(found[name], options.seconds, command))
        elif walks:
            walks.append(ghost(gait_for(params), walks[0]))
        else:
            walks.append(record_gait(GHOST, gait_for(params), options.seconds))
    return Race(walks, cycle, tuple(options.size))


def as_held(gait: Solution) -> Solution:
    """The gait if its voltage is held; otherwise the held gait to which it leads.

    Only that can be stepped in the environment. Its speed may differ a little.

    Raises:
        NoGaitError: it leads to none.
    """
    if gait.hold is not None:
        return gait
    return periodic_gait(
        *(gait.params, gait.speed, gait.steps, gait.regeneration), hold=CONTROL_PERIOD, guess=gait
    )


def require_near(machine: WheelParams, speed: float) -> None:
    """Refuse a speed (m/s) beyond all shipped gaits of a machine, if it has any.

    Raises:
        ValueError: a search there would take minutes, and most likely find nothing.
    """
    known = [gait.speed for gait in shipped() if gait.params == machine]
    if known and not min(known) <= speed <= max(known):
        chosen = f"--preset {machine_name(machine)} --speed {speed:g}"  # a front's is a preset
        raise ValueError(
            f"--speed {speed:g}: must be on this machine's front, from {min(known):.4g} to "
            f"{max(known):.4g} m/s; beyond it, `rimless gait {chosen}` searches"
        )


def gif(race: Race, path: Path) -> None:
    """Write the walks as an animated GIF."""
    moments, encoded = times(race.ends, GIF_FPS), io.BytesIO()
    samples = [race.frame(time) for time in moments[:: math.ceil(len(moments) / SAMPLES)]]
    frames = (race.frame(time) for time in tqdm(moments, desc="gif", unit="picture"))
    save_gif(frames, encoded, GIF_FPS, colours=COLOURS, samples=samples)
    write_bytes(path, encoded.getvalue())


def video(race: Race, path: Path) -> None:
    """Write the walks as a video."""
    moments = times(race.ends, VIDEO_FPS)
    frames = (race.frame(time) for time in tqdm(moments, desc="video", unit="picture"))
    save_mp4(frames, path, VIDEO_FPS)


#: How walks are written, by how a file's name ends.
FILMS = {GIF: gif, VIDEO: video}


def show(race: Race) -> None:
    """Show walks in a window until it is closed or they end."""
    window = Window(race.size, FPS)
    for time in times(race.ends, FPS):
        if not window.is_open:
            break
        window.show(race.frame(time))
    window.close()


def require_display(parser: Parser, remedy: str) -> None:
    """Refuse to go on where no window can be shown."""
    if not has_display():
        parser.error(f"no display: nothing can be shown here; {remedy}")
