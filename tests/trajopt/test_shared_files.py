"""Files that several processes write."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

WRITE = """
import sys
from pathlib import Path
from trajopt.files import write_text
for k in range(200):
    write_text(Path(sys.argv[1]), sys.argv[2])
"""


def test_processes_may_write_the_same_file_at_the_same_time(tmp_path: Path) -> None:
    path = tmp_path / "gait.txt"
    texts = ["one\n" * 50, "two\n" * 50]
    command = [sys.executable, "-c", WRITE, str(path)]
    writing = [subprocess.Popen([*command, text], stderr=subprocess.PIPE) for text in texts]
    complaints = [each.communicate()[1].decode() for each in writing]
    assert complaints == ["", ""]
    assert path.read_text() in texts
    assert [each.name for each in tmp_path.iterdir()] == [path.name]
