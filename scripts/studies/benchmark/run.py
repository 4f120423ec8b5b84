"""The study `benchmark`: docs/benchmark.md, and the figures of the README."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tqdm import tqdm

from agents.cli.options import Count, Positive, Several, chosen
from scripts.studies.benchmark.page import page, quoted
from scripts.studies.benchmark.rows import OPTIMISATION, OURS, ROWS, BenchmarkRow
from trajopt.store import provenance

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[3]

#: Where virtual environments and recorded walks stay for the next run.
CACHE = ROOT / "runs" / "bench"

#: Longest time that a measurement may take (s): it may have to compile everything.
PATIENCE = 600.0


def benchmark(
    *, rounds: Count = 5, seconds: Positive = 1.0, only: Several = (), out: Path = CACHE
) -> int:
    """Measure the speed of this package and of its peers in one run, in turn, and write the page.

    Peers are other people's packages. Each runs in a virtual environment of its own, which is made
    the first time; that takes a minute or two. If one cannot be installed, its row shows why. Every
    measurement is a process of its own. Ctrl-C keeps what was measured. Nothing else should run on
    the computer meanwhile.

    Args:
        rounds: over all rows.
        seconds: of each measurement.
        only: some rows; all by default.
        out: folder for benchmark.json and benchmark.md; a README beside it quotes the figures.
    """
    out.mkdir(parents=True, exist_ok=True)
    CACHE.mkdir(parents=True, exist_ok=True)
    keys = chosen(only, [row.key for row in ROWS])
    results = measure_all([row for row in ROWS if row.key in keys], rounds, seconds)
    write(out, {**about(rounds, seconds), "results": results})
    return 0


def about(rounds: int, seconds: float) -> dict[str, Any]:
    """How and where the benchmark runs."""
    cpu = platform.processor() or platform.machine()
    if (described := Path("/proc/cpuinfo")).exists():
        models = re.findall(r"model name\s*: (.*)", described.read_text())
        cpu = models[0] if models else cpu
    computer = {
        "cpu": cpu,
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "load": os.getloadavg()[0],
    }
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    settings = {"rounds": rounds, "seconds": seconds, "date": date}
    return settings | {"machine": computer} | provenance()


def measure_all(rows: Sequence[BenchmarkRow], rounds: int, seconds: float) -> list[dict[str, Any]]:
    """Measure all rows once in each round. Every other round goes backwards.

    If a row fails, it keeps its earlier answers and gets an error.

    Returns:
        For each row: `key`, `answers` (one for each round) and `error` (None if nothing failed).
    """
    results: list[dict[str, Any]] = [{"key": r.key, "answers": [], "error": None} for r in rows]
    pairs = list(zip(rows, results, strict=True))
    bar = tqdm(total=sum(min(rounds, row.most) for row in rows), unit="row")
    try:
        for number in range(rounds):
            for row, result in pairs[:: 1 if number % 2 == 0 else -1]:
                if number >= row.most or result["error"] is not None:
                    continue
                bar.set_description(f"round {number + 1}/{rounds} {row.key}")
                try:
                    result["answers"].append({"round": number} | measured(row, seconds))
                except (subprocess.SubprocessError, RuntimeError) as error:
                    result["error"] = str(error)
                bar.update()
    except KeyboardInterrupt:
        bar.write("interrupted: what was measured is kept", file=sys.stderr)
    bar.close()
    return results


def measured(row: BenchmarkRow, seconds: float) -> dict[str, Any]:
    """One measurement, by a process of its own.

    Raises:
        RuntimeError: the peer cannot be installed, or the process failed.
    """
    settings = {"measure": row.measure, "seconds": seconds, **row.settings}
    if row.python == OURS:
        settings["folder"] = str(CACHE)
        program = ["-m", "scripts.studies.benchmark.ours"]
    else:
        program = [str(HERE / ("swing_up.py" if row.group == OPTIMISATION else "peers.py"))]

    def pin() -> None:
        if row.one_core and hasattr(os, "sched_setaffinity"):  # only Linux can
            os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

    run = subprocess.run(
        [str(interpreter(row.python)), *program, json.dumps(settings)],
        cwd=ROOT,
        preexec_fn=pin,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    if run.returncode:
        raise RuntimeError((run.stderr.strip().splitlines() or ["no reason given"])[-1])
    return dict(json.loads(run.stdout.splitlines()[-1]))


def interpreter(name: str) -> Path:
    """The Python of a virtual environment, which is first made if it does not exist.

    Raises:
        RuntimeError: its packages cannot be installed.
    """
    if name == OURS:
        return Path(sys.executable)
    requirements = HERE / "requirements" / f"{name}.txt"
    home = CACHE / f"{name}-{hashlib.sha256(requirements.read_bytes()).hexdigest()[:8]}"
    python, ready = home / "bin" / "python", home / "ready"
    if not ready.exists():
        tqdm.write(f"installing {name} into an environment of its own, once", file=sys.stderr)
        shutil.rmtree(home, ignore_errors=True)
        subprocess.run([sys.executable, "-m", "venv", str(home)], check=True)
        pip = [str(python), "-m", "pip", "install", "-q", "-r", str(requirements)]
        done = subprocess.run(pip, capture_output=True, text=True, check=False)
        if done.returncode:
            reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
            raise RuntimeError(f"cannot be installed here: {reason}")
        ready.touch()
    return python


def write(folder: Path, run: dict[str, Any]) -> None:
    """Write benchmark.json and benchmark.md into a folder, and quote it in a README beside it."""
    (folder / "benchmark.json").write_text(json.dumps(run, indent=1) + "\n")
    (folder / "benchmark.md").write_text(page(run))
    readme = folder.parent / "README.md"
    if readme.exists():
        readme.write_text(quoted(readme.read_text(), run))
