"""Walk yourself: the left and right arrow keys set the motor's voltage. Needs a display."""

from __future__ import annotations

from collections.abc import Sequence

import gymnasium
from gymnasium.utils.play import play

import rimless_gym  # noqa: F401  # registers the environments
from agents.cli.commandline import DEFAULT_PRESET, Parser
from agents.cli.watch import require_display


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, until the window is closed."""
    parser = Parser(__doc__)
    parser.add_machine(DEFAULT_PRESET)
    options = parser.parse_args(arguments)
    params = parser.machine(options)
    require_display(parser, "rimless page writes a page to play on in a browser")
    play(gymnasium.make("RimlessWheel-v0", params=params, render_mode="rgb_array"))
    return 0
