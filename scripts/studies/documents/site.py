"""What Sphinx needs to build the site from pages that code-hosting sites show too.

An environment's class docstring is its documentation page, written in Markdown as Gymnasium's
are: a comment `class-page` stands where the site has it, below a link to the class's file.
"""

from __future__ import annotations

import inspect
import re
from importlib import import_module
from typing import Any

from sphinx.application import Sphinx

#: A comment that stands for the docstring of `module.Class`.
_CLASS_PAGE = re.compile(r"^<!-- class-page (\S+) -->$", re.MULTILINE)

#: How Sphinx prints an alias of a type in a union.
_ALIAS = re.compile(r"TypeAliasForwardRef\('(\w+)'\)")

#: A heading in the docstring of a class with a page of its own. All other docstrings have none, and
#: are read as reStructuredText.
_HEADING = "## "


def with_docstrings(page: str) -> str:
    """A page with the classes' docstrings in place of its `class-page` comments."""
    return _CLASS_PAGE.sub(_docstring, page)


def _docstring(block: re.Match[str]) -> str:
    module, _, name = block[1].rpartition(".")
    text = inspect.getdoc(getattr(import_module(module), name)) or ""
    return text.replace(f"\n{_HEADING}", f"\n#{_HEADING}")  # under the page's heading


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("source-read", _read)
    app.connect("autodoc-process-docstring", _adapted)
    app.connect("autodoc-process-signature", _named)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _read(app: Sphinx, page: str, source: list[str]) -> None:
    source[0] = with_docstrings(source[0])


def _adapted(
    app: Sphinx, what: str, name: str, documented: Any, options: Any, lines: list[str]
) -> None:
    """Leave a class's headed sections to its page; let | be the sign of absolute values."""
    first = next((n for n, line in enumerate(lines) if line.startswith(_HEADING)), None)
    if what == "class" and first is not None:
        lines[first:] = ["Its documentation page has the rest.", ""]
    lines[:] = [line.replace("|", r"\|") for line in lines]


def _named(
    app: Sphinx, what: str, name: str, documented: Any, options: Any, given: str, back: str
) -> tuple[str, str]:
    """Call aliases of types by their names in unions too, where Sphinx prints its own object."""
    bare = [_ALIAS.sub(r"\1", text) if text else text for text in (given, back)]
    return bare[0], bare[1]
