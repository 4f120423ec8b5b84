"""The documents' code runs from top to bottom, as a reader would run it."""

import pytest
from sybil import Document
from sybil.parsers.markdown import PythonCodeBlockParser

from tests.documents.pages import PAGES, ROOT, names

WITH_BLOCKS = [path for path in PAGES[1:] if "```python" in path.read_text()]


def blocks_of(path):
    document = Document.parse(str(path), PythonCodeBlockParser())
    return document, list(document.examples())


@pytest.mark.slow
def test_every_block_of_the_readme_runs_by_itself_and_prints_something(
    capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("trajopt.feedback.startup.COUNTS", (7, 9, 8, 17))  # a coarse plan
    document, blocks = blocks_of(ROOT / "README.md")
    assert blocks
    for block in blocks:
        document.namespace.clear()
        block.evaluate()
        assert capsys.readouterr().out.strip(), f"README.md, line {block.line}: prints nothing"


@pytest.mark.slow
@pytest.mark.parametrize("path", WITH_BLOCKS, ids=names(WITH_BLOCKS))
def test_the_blocks_of_a_page_run_one_after_the_other(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for block in blocks_of(path)[1]:
        block.evaluate()
