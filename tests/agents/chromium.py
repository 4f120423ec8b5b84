"""A page in a headless Chromium, with a program that reports what it finds there."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)

#: Marks of tests that need it.
NEEDS_CHROMIUM = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here"),
]

#: Collects errors from the beginning; `report` writes what was found into the document.
BEFORE = """<script>
const problems = [];
addEventListener('error', (event) => problems.push(event.message));
addEventListener('unhandledrejection', (event) => problems.push(String(event.reason)));
const complain = console.error;
console.error = (...all) => { problems.push(all.join(' ')); complain(...all); };
function report(found) {
  const place = document.createElement('pre');
  place.id = 'found';
  place.textContent = JSON.stringify({ problems, ...found });
  document.body.append(place);
}
</script>"""


def in_chromium(text: str, tmp_path: Path, program: str, size: str = "1280,800") -> dict[str, Any]:
    """What a program in a page reports; it runs after the first frames.

    Args:
        text: the page.
        tmp_path: a folder for the browser.
        program: JavaScript that calls `report` with an object.
        size: width and height of the window.
    """
    run = f"<script>setTimeout(() => {{ {program} }}, 500);</script></body>"
    watched = text.replace("<head>", f"<head>{BEFORE}", 1)
    file = tmp_path / "page.html"
    file.write_text(run.join(watched.rsplit("</body>", 1)), encoding="utf-8")
    assert CHROMIUM is not None
    done = subprocess.run(
        [
            *(CHROMIUM, "--no-sandbox", "--headless=new", "--disable-gpu", "--dump-dom"),
            *(f"--window-size={size}", "--virtual-time-budget=1500"),
            *(f"--user-data-dir={tmp_path / 'profile'}", file.as_uri()),
        ],
        capture_output=True,
        text=True,
        timeout=600,
        check=True,
    )
    found = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, flags=re.DOTALL)
    assert found is not None, done.stderr[-2000:]
    values: dict[str, Any] = json.loads(html.unescape(found[1]))
    assert values["problems"] == []
    return values
