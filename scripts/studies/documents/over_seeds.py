"""What docs/learning.md says of a learner over many seeds, in a few words for the headline."""

from __future__ import annotations

from collections.abc import Mapping

from agents.comparison.shipped import SCREENED, TITLE

#: Row of the comparison -> the cells with which its line in a table of the study begins.
STUDIED: Mapping[str, tuple[str, ...]] = {
    "imitation": ("imitation of the LQR",),
    "fine-tuned, best kept": ("imitation, fine-tuned by PPO, best kept",),
    TITLE: ("imitation of a gain schedule", "0.56 m/s"),
    "evolution from scratch": ("evolution from scratch, best kept",),
    SCREENED: ("PPO from screened policies, best kept",),
    "PPO from scratch": ("PPO from scratch, best kept",),
}

#: Columns of the study's tables.
WALKING, GAP = "seeds that walk", "gap to the optimum"


def over_seeds(page: str) -> dict[str, str]:
    """The gap over seeds, its interval, and how many seeds walk, for each row of the comparison.

    Args:
        page: the text of docs/learning.md.

    Raises:
        ValueError: a row of `STUDIED` is in no table of the page.
    """
    found: dict[str, str] = {}
    head: list[str] = []
    for line in page.splitlines():
        cells = [cell.strip() for cell in line.strip("| ").split(" | ")]
        if not line.startswith("|"):  # the table has ended
            head = []
        elif WALKING in cells:
            head = cells
        for title, beginning in STUDIED.items():
            if tuple(cells[: len(beginning)]) == beginning and len(cells) == len(head):
                told = dict(zip(head, cells, strict=True))
                found.setdefault(title, f"{told[GAP]}, {told[WALKING]} walk")
    missing = [" | ".join(STUDIED[title]) for title in STUDIED if title not in found]
    if missing:
        raise ValueError(
            f"no table has the lines {missing}: put them back, or run their rows with `make study`"
        )
    return found
