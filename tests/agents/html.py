"""Whether a report is valid HTML, and whether it loads anything."""

from __future__ import annotations

import re
from html.parser import HTMLParser

VOID = {"meta", "link", "br", "hr", "img", "input"}
FLOW = {"p", "div", "table", "ul", "ol", "figure", "section", "h1", "h2", "h3"}
#: What may stand directly in these.
CHILDREN = {
    "table": {"thead", "tbody", "caption"},
    "thead": {"tr"},
    "tbody": {"tr"},
    "tr": {"th", "td"},
    "ul": {"li"},
}


class Checker(HTMLParser):
    """Follows the elements of a page; what is wrong is in `faults`."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.faults: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        parent = self.open[-1] if self.open else ""
        if tag not in CHILDREN.get(parent, {tag}):
            self.faults.append(f"<{tag}> in <{parent}>")
        if tag in FLOW and "p" in self.open:
            self.faults.append(f"<{tag}> in <p>")
        names = [name for name, _ in attrs]
        if len(set(names)) < len(names):
            self.faults.append(f"<{tag}> has an attribute twice: {names}")
        self.ids += [value or "" for name, value in attrs if name == "id"]
        self.links += [value or "" for name, value in attrs if name in ("href", "src")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.faults.append(f"</{tag}> closes another element")

    def handle_decl(self, decl: str) -> None:
        if decl.lower() != "doctype html":
            self.faults.append(decl)


def assert_valid(text: str) -> None:
    """Check that elements are nested properly, and that identities and links within agree."""
    checker = Checker()
    checker.feed(text)
    checker.close()
    assert text.startswith("<!doctype html>")
    assert checker.faults == []
    assert checker.open == []
    assert len(set(checker.ids)) == len(checker.ids)
    assert {link[1:] for link in checker.links if link.startswith("#")} <= set(checker.ids)


def assert_loads_nothing(text: str) -> None:
    """Check that no address of another file stands where a browser would load it."""
    text = re.sub(r'src="data:[^"]*"', "", text)
    assert not re.search(r"//cdn|@import|<link[^>]+href=\"(?!data:)|\bsrc=|fetch\(|url\(", text)
    addresses = set(re.findall(r"https?://[^'\" ]*", text))
    assert addresses <= {"http://www.w3.org/2000/svg"}  # a name that browsers know, not a place
