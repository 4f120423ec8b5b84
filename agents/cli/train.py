"""Train a walking policy from scratch, from a clone of the optimal gait's law, or from a policy.

Writes best.zip (best in the periodic evaluations), last.zip, clone.zip (with --init imitation),
train.json, state.npz (all that is needed to go on) and TensorBoard events into a folder. However it
was stopped, the same command goes on, and ends with the same policies.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents import learners
from agents.cli.command import INTERRUPTED
from agents.cli.commandline import (
    DEFAULT_PRESET,
    DISTURBANCES,
    RANGES,
    TASK,
    Parser,
    json_object,
    more_than_zero,
    terminated_like_ctrl_c,
    whole,
)
from agents.conditions import Conditions
from agents.imitation import Cloning
from agents.train import EXPERT, train
from agents.training import INITS, Settings
from rimless_gym.envs.arguments import as_task
from rimless_gym.envs.disturbances import as_disturbances, as_ranges
from trajopt.feedback import laws


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit status is 130 after Ctrl-C or SIGTERM."""
    parser = Parser(__doc__)
    parser.add_argument("--algo", choices=learners.names(), default="ppo", help="learner")
    parser.add_argument(
        "--init", default="scratch", help=f"{' or '.join(INITS)}, or a policy's file to start from"
    )
    parser.add_argument(
        "--expert",
        default=EXPERT,
        help=f"what to imitate: {', '.join(laws.names())}, or a policy's file to distil",
    )
    parser.add_argument("--seed", type=whole(0), default=0, help="of everything random")
    parser.add_argument("--out", type=Path, default=Path("runs/train"), help="results' folder")
    parser.add_argument(
        "--timesteps",
        type=whole(0),
        help="time steps in all; by default as the learner says",
    )
    parser.add_machine(DEFAULT_PRESET)
    parser.add_argument("--task", type=json_object(dict), help=TASK)
    parser.add_argument("--ranges", type=json_object(as_ranges), help=RANGES)
    parser.add_argument("--disturbances", type=json_object(as_disturbances), help=DISTURBANCES)
    parser.add_argument(
        "--speeds",
        type=more_than_zero,
        nargs=2,
        metavar=("LEAST", "GREATEST"),
        help="command a speed between these (m/s), as in RimlessWheelSpeed-v0",
    )
    parser.add_argument(
        "--control-period",
        type=more_than_zero,
        help="how long an action is held (s); by default as in the environment",
    )
    parser.add_argument(
        "--settings",
        type=json_object(dict),
        default={},
        help="""JSON: hyperparameters that differ from the learner's own, '{"gamma": 0.995}'""",
    )
    parser.add_argument(
        "--cloning",
        type=json_object(Cloning.of),
        help="""JSON: how to imitate, '{"gait_labels": 80000}'; the fields of """
        "agents.imitation.Cloning",
    )
    options = parser.parse_args(arguments)
    params, speeds = parser.machine(options), tuple(options.speeds) if options.speeds else None
    with parser.refusing():
        settings = chosen(options.algo, options.init, options.settings)
        rough = options.ranges, options.disturbances
        conditions = Conditions.of(params, *rough, speeds, options.control_period)
        try:
            task = as_task(options.task, conditions.default_task)
        except TypeError as error:
            parser.error(f"--task: {error}")
    parser.require_folder(options.out)
    try:
        with terminated_like_ctrl_c(), parser.refusing(), parser.out_of_room(options.out):
            result = train(
                options.algo,
                options.init,
                options.seed,
                options.out,
                timesteps=options.timesteps,
                params=params,
                expert=options.expert,
                task=task,
                ranges=options.ranges,
                disturbances=options.disturbances,
                speeds=speeds,
                settings=settings,
                cloning=options.cloning,
                control_period=options.control_period,
            )
    except KeyboardInterrupt:
        print(
            "\ninterrupted before the first step: the same command goes on, with the rounds of "
            "cloning that were finished",
            file=sys.stderr,
        )
        return INTERRUPTED
    if result.interrupted:
        print(
            f"interrupted: {result.timesteps} steps are kept; the same command goes on",
            file=sys.stderr,
        )
        return INTERRUPTED
    if not result.evaluations:
        print(f"{options.out} holds this training, which is over")
    best = options.out / learners.learner(options.algo).recommended
    print(f"best policy: {best}; measure it with `rimless evaluate {best}`")
    return 0


def chosen(algo: str, init: str, changes: dict[str, Any]) -> Settings:
    """The learner's own hyperparameters with some changes.

    Raises:
        ValueError: one is unknown, or its value is of the wrong kind or out of its range.
    """
    try:
        return learners.learner(algo).settings(init, changes)
    except (TypeError, ValueError) as error:
        raise ValueError(f"--settings: {str(error).removeprefix('settings: ')}") from error
