"""Links between the documents lead somewhere, on a code-hosting site and on the built one."""

import re

import gymnasium
import pytest

from scripts.studies.documents.site import with_docstrings
from tests.documents.pages import NOTEBOOKS, PAGES, ROOT, names, prose_of, text_of

LINK = re.compile(r"\]\((?![a-z]+:)([^)\s#]*)(?:#([^)\s]+))?\)")
ALL = [*PAGES, *NOTEBOOKS]


def anchors(path):
    """Of a page's headings, as code-hosting sites make them."""
    titles = re.findall(r"^#+ (.*)$", prose_of(path), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("path", ALL, ids=names(ALL))
def test_every_link_to_a_file_or_heading_leads_somewhere(path):
    for target, anchor in LINK.findall(prose_of(path)):
        file = path.parent / target if target else path
        assert file.is_file(), f"{path}: {target}"
        assert file.resolve().is_relative_to(ROOT)
        assert not anchor or anchor in anchors(file), f"{path}: {target}#{anchor}"


def test_a_page_that_no_contents_list_is_missed():
    index = ROOT / "docs"
    listed = {
        (page.parent / name).resolve()
        for page in PAGES
        for block in re.findall(r"```{toctree}\n(.*?)```", text_of(page), re.DOTALL)
        for name in block.split("\n")
        if name and not name.startswith(":")
    }
    pages = {path.resolve().with_suffix("") for path in ALL if path.is_relative_to(index)}
    assert pages - listed == {index / "index"}


def test_an_environments_docstring_is_its_page_below_the_pages_own_headings():
    page = "## It\n\n<!-- class-page rimless_gym.RimlessWheelEnv -->\n\nafter\n"
    text = with_docstrings(page)
    assert text.startswith("## It\n\nAn actuated rimless wheel")
    assert "\n### Description\n" in text
    assert text.endswith("\n\nafter\n")


def test_the_summary_of_the_environments_is_theirs():
    rows = [line.split("|")[1:-1] for line in text_of(ROOT / "docs" / "wheel.md").splitlines()]
    table = [[cell.strip(" `") for cell in row] for row in rows if len(row) == 3]
    (_, *names), _, actions, observations, steps, episodes, thresholds, _ = table[:8]
    for k, env in enumerate(map(gymnasium.make, names), start=1):
        assert actions[k] == str(env.action_space)
        assert observations[k].split()[0] == str(env.observation_space.shape[0])
        assert steps[k] == f"{env.unwrapped.control.period:g} s"
        assert episodes[k] == f"{env.spec.max_episode_steps} steps"
        assert thresholds[k] == f"{env.spec.reward_threshold:g} m"
