"""`rimless page` and `rimless data`: what other people use."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from agents.cli.options import (
    Fields,
    MaybePreset,
    Names,
    Positive,
    Whole,
    machine,
    one,
    require_file,
    require_folder,
    whole,
)


def page(*, out: Path = Path("runs/page.html"), policy: str = "imitation") -> int:
    """Write one HTML file to pass on: the front, and a wheel to drive. It loads nothing.

    Args:
        out: file to write
        policy: a policy's file, or one that comes with the package
    """
    from agents.page import page as page_of
    from trajopt.store import write_text

    require_file(out)
    write_text(out, page_of(policy))
    print(f"{out}: {out.stat().st_size / 1000:.0f} kB; open it in any browser")
    return 0


def data(
    policies: Names = (),
    *,
    out: Path = Path("runs/data"),
    episodes: Annotated[int, one("INT", whole(1, 10_000))] = 100,
    seed: Whole = 0,
    speed: Positive = 0.62,
    preset: MaybePreset = None,
    params: Fields = None,
) -> int:
    """Write walks as Minari datasets, for offline learners.

    The optimal gaits (their voltage held for 10 ms), feedback laws, policies and random voltages
    walk from seeded starts of the environment. However it was stopped, the same command writes
    what is missing. Set MINARI_DATASETS_PATH to the folder to read the datasets.

    Args:
        policies: optimal (an episode on each of several gaits), idle, random, a feedback law, or a
            policy (see `rimless list`) or its file; by default all that walk fast enough
        out: folder, Minari's MINARI_DATASETS_PATH
        episodes: of every policy, at most 10,000
        seed: of the first episode, and of random voltages
        speed: of the gait that laws hold (m/s)
        preset: machine; by default a policy's own, and BUILDABLE for the others
        params: fields that differ from the preset's: hub_damping=0.01 n_legs=6
    """
    from tqdm import tqdm

    from agents.datasets import CARD, DatasetConfig, missing, standard, write
    from trajopt.store import Store

    require_folder(out)
    params_ = machine(preset, params) if preset or params else None
    names = tuple(dict.fromkeys(policies or standard()))
    config = DatasetConfig(params_, episodes, seed, speed)
    with Store(out):
        todo = missing(out, names, config)
        with tqdm(total=len(names), initial=len(names) - len(todo), desc="data") as bar:
            for name in todo:
                bar.set_postfix_str(name)
                id_, figures = write(out, name, config)
                bar.write(f"{id_}: {figures['steps']:,} steps, return {figures['mean']:.2f} m")
                bar.update()
    print(f"{out}: set MINARI_DATASETS_PATH to it; each dataset has its card, {CARD}")
    return 0
