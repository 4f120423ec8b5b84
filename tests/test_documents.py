"""The documents' code runs from top to bottom, as a reader would run it."""

from pathlib import Path

import pytest
from sybil import Document
from sybil.parsers.markdown import PythonCodeBlockParser

ROOT = Path(__file__).resolve().parents[1]


def blocks_of(name):
    document = Document.parse(str(ROOT / name), PythonCodeBlockParser())
    return document, list(document.examples())


def test_every_block_of_the_readme_runs_by_itself_and_prints_something(
    capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("trajopt.feedback.catch.catch.COUNTS", (7, 9, 8, 17))  # a coarse plan
    document, blocks = blocks_of("README.md")
    assert blocks
    for block in blocks:
        document.namespace.clear()
        block.evaluate()
        assert capsys.readouterr().out.strip(), f"README.md, line {block.line}: prints nothing"


@pytest.mark.slow
@pytest.mark.parametrize(
    "path",
    [path for path in sorted((ROOT / "docs").glob("*.md")) if "```python" in path.read_text()],
    ids=lambda path: path.name,
)
def test_the_blocks_of_a_page_run_one_after_the_other(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for block in blocks_of(path)[1]:
        block.evaluate()
