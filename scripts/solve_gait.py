"""Find the periodic gait of least cost of transport, verify it, report and save it."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from rimless_gym.params import PRESETS, preset
from trajopt import NoGaitError, periodic_gait


def main() -> int:
    """Run the command line; 0 if the gait passed verification, 1 if not, 2 if none was found."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    parser.add_argument(
        "--preset", default="THESIS_PHYSICAL", choices=list(PRESETS), help="machine"
    )
    parser.add_argument("--speed", type=float, default=0.5, help="mean speed, m/s")
    parser.add_argument("--steps", type=int, default=2, help="touchdowns per stride")
    parser.add_argument(
        "--regeneration", action="store_true", help="let the battery take energy back"
    )
    parser.add_argument(
        "--starts",
        type=int,
        help="random starts; by default none where a shipped gait is of the same machine, else 24",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the random starts")
    parser.add_argument("--workers", type=int, default=1, help="processes for the random starts")
    parser.add_argument("--out", help="file to save the gait in (.npz)")
    parser.add_argument("--json", action="store_true", help="print figures as JSON")
    options = parser.parse_args()
    if options.out:
        Path(options.out).parent.mkdir(parents=True, exist_ok=True)
    try:
        solution = periodic_gait(
            preset(options.preset),
            options.speed,
            options.steps,
            options.regeneration,
            starts=options.starts,
            seed=options.seed,
            workers=options.workers,
            progress=True,
        )
    except NoGaitError as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\ninterrupted: nothing was written", file=sys.stderr)
        return 130
    if options.out:
        solution.save(options.out)
    print(json.dumps(solution.to_dict(), indent=2) if options.json else solution.report())
    return 0 if solution.verification.passed else 1


if __name__ == "__main__":
    sys.exit(main())
