"""Commands that the documents show exist, with their options."""

import re
import shlex
import tomllib
from importlib import import_module

import pytest

from agents.cli.command import COMMANDS
from scripts.studies.__main__ import STUDIES
from tests.documents.pages import PAGES, ROOT, commands_of, names

EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
TARGETS = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
RUN = re.compile(r'run\("([\w.]+)"\)')  # in a file of scripts/


@pytest.mark.parametrize("path", PAGES, ids=names(PAGES))
def test_every_command_has_the_options_with_which_it_is_shown(path, capsys):
    for command in commands_of(path):
        match command.split()[:2]:
            case ["make", target]:
                assert target in TARGETS, command
            case ["pip", "install"]:
                for extra in re.findall(r"\[([\w,]+)\]", command):
                    assert set(extra.split(",")) <= set(EXTRAS), command
            case ["rimless", word]:
                assert word in COMMANDS, command
                require_options(command, f"agents.cli.{COMMANDS[word].module}", capsys)
            case ["python", "-m"] if command.split()[2] == "scripts.studies":
                module = f"scripts.studies.{STUDIES[command.split()[3]]}"
                require_options(command, module, capsys)
            case ["python", script] if script.startswith("scripts/") and "NAME" not in script:
                assert (ROOT / script).is_file(), command
                require_options(command, RUN.search((ROOT / script).read_text())[1], capsys)


def require_options(command, module, capsys):
    main = import_module(module).main
    options = {word.split("=")[0] for word in shlex.split(command) if word.startswith("--")}
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    assert options <= set(re.findall(r"--[\w-]+", capsys.readouterr().out)), command
