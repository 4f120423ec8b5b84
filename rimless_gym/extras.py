"""What the base installation leaves out, and what to install where it is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class MissingExtraError(ImportError):
    """A package that comes with an extra of rimless-gym is not installed."""


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Imports of packages that come with an extra.

    Args:
        name: of the extra in pyproject.toml, such as "learn".

    Raises:
        MissingExtraError: a package is missing; it says which, and how to install it.
    """
    try:
        yield
    except MissingExtraError:
        raise
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"{error.name} is not installed: it comes with pip install 'rimless-gym[{name}]', or "
            f"in a checkout with pip install -e '.[{name}]'",
            name=error.name,
        ) from error
