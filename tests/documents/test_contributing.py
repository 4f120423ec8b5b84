"""The page for contributors."""

import pytest

from tests.documents.pages import ROOT

PAGE = (ROOT / "docs" / "contributing.md").read_text()
PACKAGES = ("rimless_gym", "trajopt", "agents", "scripts/studies")
FOLDERS = sorted(file.parent for name in PACKAGES for file in (ROOT / name).glob("*/__init__.py"))


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_every_package_is_named_to_contributors(folder):
    assert f"{folder.name}/" in PAGE
