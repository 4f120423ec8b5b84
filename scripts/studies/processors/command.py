"""Run the tests as other processors would run them: with their linear algebra and instructions.

Results may differ between processors in the last bits, and the tests must pass on all of them. A
processor whose instructions this machine does not have is skipped.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence

from agents.cli.commandline import Parser
from scripts.studies.processors.imitated import PROCESSORS, Processor, kernels


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the tests on one processor after the other; 1 if any failed."""
    parser = Parser(__doc__)
    names = [processor.name for processor in PROCESSORS]
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"of {', '.join(names)}; all by default"
    )
    parser.add_argument("--pytest", default="", help="arguments of pytest, in one string")
    options = parser.parse_args(arguments)
    if unknown := set(options.names) - set(names):
        parser.error(f"unknown processor {', '.join(sorted(unknown))}: choose from {names}")
    chosen = [p for p in PROCESSORS if not options.names or p.name in options.names]
    results = [f"{p.name:<10} {_result(p, options.pytest.split())}" for p in chosen]
    print("\n" + "\n".join(results))
    return int(any("FAILED" in result for result in results))


def _result(processor: Processor, arguments: Sequence[str]) -> str:
    """Whether pytest passed with these arguments, and how long it took; or why it was skipped."""
    if processor.missing:
        return f"skipped: this machine has no {', '.join(processor.missing)}"
    begin = time.perf_counter()
    environment = os.environ | processor.environment
    variables = " ".join(f"{k}='{v}'" for k, v in processor.environment.items())
    print(f"\n=== {processor.name}: {variables}", flush=True)
    print(f"=== OpenBLAS's kernels: {kernels(environment) or 'unknown'}", flush=True)
    command = [sys.executable, "-m", "pytest", *arguments]
    passed = subprocess.run(command, check=False, env=environment).returncode == 0
    return f"{'passed' if passed else 'FAILED'} in {time.perf_counter() - begin:.0f} s"
