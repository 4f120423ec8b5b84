"""Commands that the documents show exist, with their options."""

import re
import shlex
import tomllib
from contextlib import suppress
from functools import partial

import pytest

from agents.cli.main import COMMANDS, main
from rimless_gym.checks import MissingExtraError
from scripts.studies.__main__ import run_study
from tests.documents.pages import PAGES, ROOT, commands_of, names

EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
TARGETS = set(" ".join(re.findall(r"^([\w -]+):", (ROOT / "Makefile").read_text(), re.M)).split())
RUN = re.compile(r'main\(\["(\w+)",')  # in a file of scripts/


@pytest.mark.parametrize("path", PAGES, ids=names(PAGES))
def test_every_command_has_the_options_with_which_it_is_shown(path, capsys):
    for command in commands_of(path):
        match command.split()[:2]:
            case ["make", target]:
                assert target in TARGETS, command
            case ["pip", "install"]:
                for extra in re.findall(r"\[([\w,]+)\]", command):
                    assert set(extra.split(",")) <= set(EXTRAS), command
            case ["rimless", word] if re.match("[a-z]", word):
                assert word in COMMANDS, command
                require_options(command, partial(main, [word, "--help"]), capsys)
            case ["python", "-m"] if command.split()[2] == "scripts.studies":
                with suppress(MissingExtraError):  # a study of the peers
                    study = partial(run_study, command.split()[3], ["--help"])
                    require_options(command, study, capsys)
            case ["python", script] if script.startswith("scripts/") and "NAME" not in script:
                assert (ROOT / script).is_file(), command
                word = RUN.search((ROOT / script).read_text())[1]
                require_options(command, partial(main, [word, "--help"]), capsys)


def require_options(command, help_of, capsys):
    options = {word.split("=")[0] for word in shlex.split(command) if word.startswith("--")}
    with pytest.raises(SystemExit) as ended:
        help_of()
    assert not ended.value.code
    assert options <= set(re.findall(r"--[\w-]+", capsys.readouterr().out)), command
