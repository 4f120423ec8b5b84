"""The notebooks run, and what is stored in them is what they give."""

import re

import nbformat
import pytest
from nbclient import NotebookClient

from tests.documents.pages import NOTEBOOKS, names

NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def outputs_of(notebook):
    """What every cell gives: text, and the kinds of pictures."""
    return [
        (output.get("text"), sorted(output.get("data", ())))
        for cell in notebook.cells
        for output in cell.get("outputs", ())
    ]


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=names(NOTEBOOKS))
def test_a_notebook_runs_and_gives_what_is_stored_in_it(path):
    stored = nbformat.read(path, as_version=4)
    fresh = nbformat.read(path, as_version=4)
    NotebookClient(fresh, timeout=300, kernel_name="python3").execute()
    pairs = list(zip(outputs_of(stored), outputs_of(fresh), strict=True))
    assert any("image/png" in kinds for (_, kinds), _ in pairs)
    for (old, old_kinds), (new, new_kinds) in pairs:
        assert old_kinds == new_kinds
        if old is not None:
            assert NUMBER.sub("", old) == NUMBER.sub("", new)
            before, after = (list(map(float, NUMBER.findall(text))) for text in (old, new))
            assert after == pytest.approx(before, rel=0.02, abs=0.02)
