"""Virtual environments of the peers, so that their pinned versions do not change ours."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

REQUIREMENTS = Path(__file__).parent / "requirements"

#: The environment in which this program itself runs.
OURS = "ours"


class UnavailableError(RuntimeError):
    """A peer cannot be installed on this machine."""


def interpreter(name: str, folder: Path, say: Callable[[str], None]) -> Path:
    """The Python of an environment, which is first made if it does not exist.

    Args:
        name: of its file in requirements/, or `OURS`.
        folder: where environments are kept.
        say: called with a line of text before an environment is made.

    Raises:
        UnavailableError: its packages cannot be installed.
    """
    if name == OURS:
        return Path(sys.executable)
    wanted = (REQUIREMENTS / f"{name}.txt").read_bytes()
    home = folder / f"{name}-{hashlib.sha256(wanted).hexdigest()[:8]}"
    python, ready = home / "bin" / "python", home / "ready"
    if not ready.exists():
        say(f"installing {name} into an environment of its own, once")
        shutil.rmtree(home, ignore_errors=True)
        quiet = ["-qq", "--disable-pip-version-check"]
        requirements = str(REQUIREMENTS / f"{name}.txt")
        _run([sys.executable, "-m", "venv", str(home)])
        _run([str(python), "-m", "pip", "install", *quiet, "-r", requirements])
        ready.touch()
    return python


def _run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        complaints = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
        reason = (complaints or done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise UnavailableError(f"cannot be installed here: {reason.removeprefix('ERROR: ')}")
