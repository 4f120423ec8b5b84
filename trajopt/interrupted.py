"""Ctrl-C that keeps what was found until then."""

from __future__ import annotations

from typing import Generic, TypeVar

T = TypeVar("T")


class Interrupted(KeyboardInterrupt, Generic[T]):
    """Ctrl-C, with what had been finished.

    Attributes:
        partial: of the kind that would have been returned.
    """

    def __init__(self, partial: T) -> None:
        super().__init__("interrupted: what was finished is in `partial`")
        self.partial = partial
