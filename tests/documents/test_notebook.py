"""The notebooks run, and what is stored in them is what they give."""

import re

import nbformat
import pytest
from nbclient import NotebookClient

from tests.documents.pages import NOTEBOOKS, names

NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def text_of(cell):
    """All that a cell prints, in however many pieces it came; not what is being compiled."""
    return "".join(each.text for each in cell.outputs if each.get("name") == "stdout")


def pictures_of(cell):
    return sum("image/png" in output.get("data", ()) for output in cell.outputs)


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=names(NOTEBOOKS))
def test_a_notebook_runs_and_gives_what_is_stored_in_it(path, monkeypatch):
    monkeypatch.delenv("MPLBACKEND")  # a notebook shows its figures itself
    stored = nbformat.read(path, as_version=4)
    fresh = nbformat.read(path, as_version=4)
    NotebookClient(fresh, timeout=300, kernel_name="python3").execute()
    cells = [
        (old, new)
        for old, new in zip(stored.cells, fresh.cells, strict=True)
        if old.cell_type == "code"
    ]
    assert sum(pictures_of(old) for old, _ in cells) >= 4
    for old, new in cells:
        assert pictures_of(old) == pictures_of(new)
        before, after = text_of(old), text_of(new)
        assert NUMBER.sub("", before) == NUMBER.sub("", after)
        known = [float(number) for number in NUMBER.findall(before)]
        assert list(map(float, NUMBER.findall(after))) == pytest.approx(known, rel=0.02, abs=0.02)
