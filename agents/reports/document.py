"""A report as one HTML file that loads nothing."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files

from agents.reports.colours import style_sheet
from trajopt.provenance import provenance

#: Of the page and of the report itself, in order.
STYLES = (("agents.page", "base.css"), ("agents.reports", "report.css"))
SCRIPTS = (
    ("agents.page", "numbers.js"),
    ("agents.reports", "scales.js"),
    ("agents.reports", "charts.js"),
    ("agents.reports", "hover.js"),
    ("agents.reports", "tables.js"),
)


def document(title: str, lead: str, parts: Sequence[str], page: str | None = None) -> str:
    """A report.

    Args:
        title: its heading.
        lead: the sentences under it.
        parts: HTML, as the functions of this package return it.
        page: where the page of `rimless page` lies, relative to the report; None: there is none.
    """
    style = "\n".join([*(_static(*each) for each in STYLES), style_sheet()])
    program = "\n".join(_static(*each) for each in SCRIPTS)
    body, made = "\n".join(parts), escape(json.dumps(provenance()))
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{escape(title)}</title>
<link rel="icon" href="data:,">
<style>
{style}
</style>
</head>
<body>
<main>
<header>
<p class="kicker">rimless-gym</p>
<h1>{escape(title)}</h1>
<p class="lead">{escape(lead)}</p>
{_link(page)}</header>
{body}
<footer><p>Made with {made}</p></footer>
</main>
<script>
{program}
</script>
</body>
</html>
"""


def _link(page: str | None) -> str:
    if page is None:
        return ""
    return (
        f'<p><a class="button" href="{escape(page)}">See it walk, and drive it yourself</a></p>\n'
    )


def section(title: str, *parts: str) -> str:
    """A part with a heading of its own."""
    return f"<section><h2>{escape(title)}</h2>\n" + "\n".join(parts) + "</section>"


def subsection(title: str, *parts: str, anchor: str = "") -> str:
    """A part of a section; `anchor` is its identity within the page."""
    own = f' id="{escape(anchor)}"' if anchor else ""
    return f"<div{own}><h3>{escape(title)}</h3>\n" + "\n".join(parts) + "</div>"


def paragraph(text: str) -> str:
    """Sentences."""
    return f"<p>{escape(text)}</p>"


def listed(texts: Sequence[str]) -> str:
    """A list."""
    return f"<ul>{''.join(f'<li>{escape(text)}</li>' for text in texts)}</ul>"


def _static(package: str, name: str) -> str:
    return (files(package) / "static" / name).read_text(encoding="utf-8")
