"""Complete the environments' documentation pages, their docstrings, from the code's own tables."""

from __future__ import annotations

import inspect
from typing import Any, TypeVar

from rimless_gym.energy import CHANNELS
from rimless_gym.envs.control import Control
from rimless_gym.envs.task import TERM_NAMES, TERMS

T = TypeVar("T", bound=type[Any])


def completed(environment: T) -> T:
    """Put the terms of the reward and the energy balance into the class's docstring."""
    into, out_of = ([c.name for c in CHANNELS if c.sign == sign] for sign in (1, -1))
    terms = [
        f"    - `{name}`: {' '.join(inspect.getdoc(term).split())}"  # type: ignore[union-attr]
        for name, term in zip(TERM_NAMES, TERMS, strict=True)
    ]
    page = environment.__doc__ or ""
    page = page.replace("{task}", repr(environment.default_task))
    usual = Control(environment.default_period)
    page = page.replace("{steps}", str(usual.episode_steps))
    page = page.replace("{period}", f"{usual.period:g}")
    page = page.replace("{balance}", f"{' + '.join(into)} = {' + '.join(out_of)}")
    environment.__doc__ = page.replace("    {terms}", "\n".join(terms))
    return environment
