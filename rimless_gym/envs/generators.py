"""The random generators of many rows, seeded as Gymnasium seeds single environments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from rimless_gym.checks import integer

Seeds = int | Sequence[int | None] | NDArray[np.integer[Any]] | None


class Generators:
    """One generator per row.

    Attributes:
        each: the generators; none before the first seeding.
        seeds: what they were seeded with.
    """

    def __init__(self, n: int) -> None:
        self.n = n
        self.each: list[np.random.Generator] = []
        self.seeds: list[int] = []

    def seed(self, seed: Seeds, rows: NDArray[np.int64]) -> None:
        """Seed `rows` by one number, counted up over all rows, or by one number or None per row.

        A generator without a seed gets one from the system's entropy. Seeds are checked before
        anything changes.

        Raises:
            TypeError: a seed is not an integer.
            ValueError: there is not one seed per row, or one is negative.
        """
        seeds = self._one_per_row(seed)
        if not self.each:
            made = [seeding.np_random(each) for each in seeds]
            self.each, self.seeds = [one for one, _ in made], [used for _, used in made]
            return
        drawn = [(i, seeding.np_random(seeds[i])) for i in rows if seeds[i] is not None]
        for i, (one, used) in drawn:
            self.each[i], self.seeds[i] = one, used

    def _one_per_row(self, seed: Any) -> list[int | None]:
        if seed is None:
            return [None] * self.n
        if np.ndim(seed) == 0:
            first = integer("seed", seed, 0)
            return [first + i for i in range(self.n)]
        if len(seed) != self.n:
            raise ValueError(f"seed: {len(seed)} seeds for {self.n} rows, must be one per row")
        return [None if each is None else integer("seed", each, 0) for each in seed]

    def keys(self, rows: NDArray[np.int64]) -> NDArray[np.uint64]:
        """The keys of the next episodes of `rows`; see `rimless_gym.envs.randomness`."""
        draws = [self.each[i].bit_generator.random_raw() for i in rows.tolist()]
        return np.array(draws, dtype=np.uint64)

    def get_state(self) -> list[dict[str, Any]]:
        """The generators' states; one without a seed gets one from the system's entropy."""
        self.seed(None, np.arange(self.n))
        return [dict(one.bit_generator.state) for one in self.each]

    def set_state(self, states: Sequence[dict[str, Any]]) -> None:
        """Restore the states that `get_state` returned, all or none.

        Raises:
            ValueError: one of them is not a state of these generators.
        """
        self.seed(None, np.arange(self.n))
        restore(self.each, states)


def restore(generators: Sequence[np.random.Generator], states: Sequence[dict[str, Any]]) -> None:
    """Put each generator into its state, all or none.

    Raises:
        ValueError: one of them is not a state of these generators.
    """
    before = [dict(one.bit_generator.state) for one in generators]
    try:
        for one, state in zip(generators, states, strict=True):
            one.bit_generator.state = state
    except Exception as error:
        for one, state in zip(generators, before, strict=True):
            one.bit_generator.state = state
        kind = type(generators[0].bit_generator).__name__
        raise ValueError(f"state: generators: {error}: must be states of NumPy's {kind}") from error
