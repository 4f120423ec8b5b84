#!/usr/bin/env python
"""Train a walking policy with PPO or SAC, from scratch or from a clone of the optimal gait.

Writes best.zip (best in the periodic evaluations), last.zip (to resume from), clone.zip (with
--init imitation), train.json and TensorBoard events into a folder.
"""

from __future__ import annotations

import argparse
import sys

from agents.train import INITS, train
from rimless_gym.params import PRESETS, preset


def main() -> int:
    """Run the command line; the exit status is 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    parser.add_argument("--algo", choices=("ppo", "sac"), default="ppo", help="algorithm")
    parser.add_argument(
        "--init", default="scratch", help=f"{' or '.join(INITS)}, or a checkpoint to start from"
    )
    parser.add_argument("--seed", type=int, default=0, help="of everything random")
    parser.add_argument("--out", default="runs/train", help="folder of the results")
    parser.add_argument("--resume", action="store_true", help="go on with the training in --out")
    parser.add_argument(
        "--timesteps", type=int, help="control intervals in all; None: agents/hyperparams"
    )
    parser.add_argument(
        "--preset", choices=sorted(PRESETS), default="THESIS_PHYSICAL", help="machine"
    )
    arguments = parser.parse_args()
    try:
        result = train(
            arguments.algo,
            arguments.init,
            arguments.seed,
            arguments.out,
            timesteps=arguments.timesteps,
            resume=arguments.resume,
            params=preset(arguments.preset),
        )
    except ValueError as error:
        parser.exit(2, f"error: {error}\n")
    except KeyboardInterrupt:
        print("\ninterrupted before the training began: the same command starts anew")
        return 130
    if result.interrupted:
        print(f"interrupted at {result.timesteps} steps; go on with the same command and --resume")
        return 130
    print(f"best policy: {result.best}; measure it with scripts/evaluate.py {result.best}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
