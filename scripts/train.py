#!/usr/bin/env python
"""Train a walking policy with PPO or SAC, from scratch or from a clone of the optimal gait.

Writes best.zip (best in the periodic evaluations), last.zip, clone.zip (with --init imitation),
train.json, state.npz (all that is needed to go on) and TensorBoard events into a folder. However it
was stopped, the same command goes on, and ends with the same policies.
"""

from __future__ import annotations

import argparse
import sys

from agents.begin import INITS
from agents.interrupts import sigterm_is_ctrl_c
from agents.train import train
from rimless_gym.params import PRESETS, preset


def main(argv: list[str] | None = None) -> int:
    """Run the command line; the exit status is 130 after Ctrl-C or SIGTERM."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    parser.add_argument("--algo", choices=("ppo", "sac"), default="ppo", help="algorithm")
    parser.add_argument(
        "--init", default="scratch", help=f"{' or '.join(INITS)}, or a policy's file to start from"
    )
    parser.add_argument("--seed", type=int, default=0, help="of everything random")
    parser.add_argument("--out", default="runs/train", help="folder of the results")
    parser.add_argument(
        "--timesteps", type=int, help="control intervals in all; None: agents/hyperparams"
    )
    parser.add_argument(
        "--preset", choices=sorted(PRESETS), default="THESIS_PHYSICAL", help="machine"
    )
    arguments = parser.parse_args(argv)
    try:
        with sigterm_is_ctrl_c():
            result = train(
                arguments.algo,
                arguments.init,
                arguments.seed,
                arguments.out,
                timesteps=arguments.timesteps,
                params=preset(arguments.preset),
            )
    except ValueError as error:
        parser.exit(2, f"error: {error}\n")
    except OSError as error:
        parser.exit(
            2,
            f"error: {error}: make room, or choose another --out; what was saved before is kept, "
            "and the same command goes on from there\n",
        )
    except KeyboardInterrupt:
        print("\ninterrupted before the training began: the same command starts anew")
        return 130
    if result.interrupted:
        print(
            f"interrupted; {result.timesteps} steps are kept, the same command goes on from there"
        )
        return 130
    over = "" if result.evaluations else f"{arguments.out} holds this training, which is over\n"
    print(f"{over}best policy: {result.best}; measure it with scripts/evaluate.py {result.best}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
