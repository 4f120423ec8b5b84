"""The documents, and what stands in them."""

import json
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
NOTEBOOKS = sorted((ROOT / "docs").rglob("*.ipynb"))

_FENCE = re.compile(r"^```(\S*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
_SPAN = re.compile(r"`([^`\n]+)`")


def text_of(path):
    """The Markdown of a page or of a notebook."""
    if path.suffix == ".md":
        return path.read_text()
    cells = json.loads(path.read_text())["cells"]
    return "\n\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")


def prose_of(path):
    """A page without its blocks of code."""
    return _FENCE.sub("", text_of(path))


def commands_of(path):
    """All that a page shows as a command line: lines of shell blocks, and code in the text."""
    text = text_of(path)
    for language, block in _FENCE.findall(text):
        if language in ("bash", ""):
            lines = block.replace("\\\n", " ").splitlines()
            yield from (line.split(" #")[0].strip() for line in lines)
    yield from _SPAN.findall(_FENCE.sub("", text))


def names(paths):
    """How tests call the pages."""
    return [str(path.relative_to(ROOT)) for path in paths]
