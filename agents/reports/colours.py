"""The colours of plots, on white and on a dark screen."""

from __future__ import annotations

#: Name -> colour on white, in print too.
LIGHT = {
    "ink": "#26303b",
    "faint": "#8a97a6",
    "teal": "#0b8f83",
    "orange": "#e5562e",
    "blue": "#3b6fb6",
    "ochre": "#b0892b",
    "violet": "#8459a8",
}

#: Name -> colour on a dark screen.
DARK = {
    "ink": "#e8edf3",
    "faint": "#7f8d9c",
    "teal": "#35c4b2",
    "orange": "#ff7a52",
    "blue": "#6ea8f2",
    "ochre": "#e0b64e",
    "violet": "#b78ee0",
}


def style_sheet() -> str:
    """The colours as variables of CSS, `--series-NAME`."""

    def variables(colours: dict[str, str]) -> str:
        return " ".join(f"--series-{name}: {colour};" for name, colour in colours.items())

    return (
        f":root {{ {variables(LIGHT)} }}\n"
        f"@media (prefers-color-scheme: dark) {{ :root {{ {variables(DARK)} }} }}"
    )
