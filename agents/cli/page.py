"""Write the page that people pass on: one HTML file that loads nothing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from agents.cli.commandline import Parser
from agents.page.write import write_page


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 when the page is written."""
    parser = Parser(__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/page.html"), help="file to write")
    parser.add_argument(
        "--policy",
        default="imitation",
        help="a policy file, or the name of a policy that comes with the package",
    )
    options = parser.parse_args(arguments)
    parser.require_file(options.out)
    with parser.refusing():
        written = write_page(options.out, options.policy)
    print(f"{written}: {written.stat().st_size / 1000:.0f} kB; open it in any browser")
    return 0
