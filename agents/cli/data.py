"""Write walks as Minari datasets, with a card each, for other people's offline learners.

The optimal gaits (their voltage held for 10 ms), feedback laws, policies and random voltages walk
from seeded starts of the environment. What is complete is kept: after Ctrl-C or a kill, the same
command writes what is missing. Set MINARI_DATASETS_PATH to the folder to read them.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from agents.cli.command import INTERRUPTED
from agents.cli.commandline import Parser, more_than_zero, terminated_like_ctrl_c, whole
from agents.data.files import CARD
from agents.data.walks import OPTIMAL, standard
from agents.data.write import Wanted, require_free, write
from agents.folder import sole_user


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 when all datasets are there, 130 after Ctrl-C or SIGTERM."""
    parser = Parser(__doc__)
    parser.add_argument(
        "walkers",
        nargs="*",
        metavar="WALKER",
        default=standard(),
        help=f"{OPTIMAL}: an episode on each of several gaits; idle; random; a feedback law; a "
        "policy that comes with the package; or a policy's file",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("runs/data"), help="folder, Minari's MINARI_DATASETS_PATH"
    )
    parser.add_argument("--episodes", type=whole(1, 10_000), default=100, help="of every walker")
    parser.add_argument(
        "--seed", type=whole(0), default=0, help="of the first episode, and of random voltages"
    )
    parser.add_argument(
        "--speed", type=more_than_zero, default=0.56, help="of the gait that laws hold (m/s)"
    )
    parser.add_machine(None, "machine; by default a policy's own, and BUILDABLE for the others")
    options = parser.parse_args(arguments)
    params = parser.machine(options) if options.preset or options.params else None
    parser.require_folder(options.out)
    names = tuple(dict.fromkeys(options.walkers))
    wanted = Wanted(params, options.episodes, options.seed, options.speed)
    try:
        with (
            terminated_like_ctrl_c(),
            parser.refusing(),
            parser.out_of_room(options.out),
            sole_user(options.out),
        ):
            missing = require_free(options.out, names, wanted)
            with tqdm(total=len(names), initial=len(names) - len(missing), desc="data") as bar:
                for name in missing:
                    bar.set_postfix_str(name)
                    id_, found = write(options.out, name, wanted)
                    bar.write(f"{id_}: {found['steps']:,} steps, return {found['mean']:.2f} m")
                    bar.update()
    except KeyboardInterrupt:
        print("\ninterrupted: the same command writes what is missing", file=sys.stderr)
        return INTERRUPTED
    print(f"{options.out}: set MINARI_DATASETS_PATH to it; each dataset has its card, {CARD}")
    return 0
