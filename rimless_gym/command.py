"""The command `rimless`, as it is installed."""

from __future__ import annotations

import sys
from importlib import import_module

from rimless_gym.shadowing import ShadowedError, require_ours


def main() -> int:
    """Run `scripts.rimless`, if that and what it needs is ours; the exit status is 2 if not."""
    try:
        require_ours()
    except ShadowedError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return int(import_module("scripts.rimless").main())
