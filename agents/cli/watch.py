"""`rimless watch`, `play`, `page` and `data`: walks to see, to drive and to pass on."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from agents.cli.options import (
    Count,
    Fields,
    Flag,
    MaybePath,
    MaybePreset,
    Names,
    Positive,
    Preset,
    Whole,
    machine,
    one,
    require_file,
    require_folder,
    several,
    whole,
)

if TYPE_CHECKING:
    from agents.film import GroupFilm
    from rimless_gym.params import WheelParams
    from trajopt import Solution

#: The word for the optimal gait.
OPTIMUM = "optimum"

#: How the name of a file ends that is an animated GIF, a video, or a gait.
GIF, VIDEO, GAIT = ".gif", ".mp4", ".npz"

#: Pictures of a window per second; of a GIF, which counts in 1/100 s; of a video.
FPS, GIF_FPS, VIDEO_FPS = 25, 100 / 6, 50

#: Longest GIF (s); its pictures are all in memory.
LONGEST_GIF = 60.0

#: Size of a GIF's palette, and pictures from which it is chosen.
COLOURS, SAMPLES = 32, 9


def watch(
    names: Names = (OPTIMUM,),
    *,
    preset: MaybePreset = None,
    params: Fields = None,
    speed: Positive = 0.62,
    steps: Count = 1,
    seconds: Positive = 20.0,
    trust_pickle: Flag = False,
    out: MaybePath = None,
    size: Annotated[tuple[int, int], several("WIDTH HEIGHT", whole(50, 4000), 2)] = (720, 468),
) -> int:
    """Watch gaits, feedback laws and policies walk: in a window, as a GIF or a video.

    The first is drawn solid, the others as ghosts. Below is where the energy goes. Laws and
    policies start from rest. The optimum has no start of its own: behind another it joins once that
    has walked some steps.

    Args:
        names: at most 4 of: optimum (the optimal gait whose voltage is held for 10 ms), a feedback
            law about it, a policy that comes with the package (see `rimless list`), the file of a
            policy or of a gait (.npz)
        preset: machine; by default that of a policy or a gait, otherwise BUILDABLE
        params: fields that differ from the preset's: hub_damping=0.01 n_legs=6
        speed: of the gait, or commanded (m/s)
        steps: of the gait, per stride
        seconds: of walking
        trust_pickle: also read files of plain stable-baselines3, which runs any code their author
            put in
        out: a .gif or .mp4 to write instead of showing a window
        size: of the picture, in pixels
    """
    from agents.film import MOST
    from rimless_gym.rendering.display import ffmpeg

    kind = out and out.suffix.lower()
    if kind == GIF and seconds > LONGEST_GIF:
        raise ValueError(f"--seconds {seconds:g}: must be at most {LONGEST_GIF:g} for a GIF")
    if len(names) > MOST:
        raise ValueError(f"{len(names)} names: at most {MOST} fit into one picture")
    if len(set(names)) < len(names):
        raise ValueError(f"{' '.join(names)}: name each only once")
    params_ = machine(preset, params) if preset or params else None
    if out is None:
        _require_display("write a GIF with --out walk.gif")
    elif kind not in (GIF, VIDEO):
        raise ValueError(f"--out {out}: give a name that ends with {GIF} or {VIDEO}")
    else:
        if kind == VIDEO:
            ffmpeg()  # refused before the walks are computed
        require_file(out)
    _write(_film(names, params_, speed, steps, seconds, size, trust_pickle), out)
    if out is not None:
        print(out)
    return 0


def play(*, preset: Preset = "BUILDABLE", params: Fields = None) -> int:
    """Walk yourself: the left and right arrow keys set the motor's voltage. Needs a display.

    Args:
        preset: machine
        params: fields that differ from the preset's: hub_damping=0.01 n_legs=6
    """
    import gymnasium
    from gymnasium.utils.play import play as played

    params_ = machine(preset, params)
    _require_display("rimless page writes a page to play on in a browser")
    played(gymnasium.make("RimlessWheel-v0", params=params_, render_mode="rgb_array"))
    return 0


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
            policy (see `rimless list`) or its file; by default all of them but the laws that take
            minutes, and policies of another machine
        out: folder, Minari's MINARI_DATASETS_PATH
        episodes: of every policy, at most 10,000
        seed: of the first episode, and of random voltages
        speed: of the gait that laws hold (m/s)
        preset: machine; by default a policy's own, and BUILDABLE for the others
        params: fields that differ from the preset's: hub_damping=0.01 n_legs=6
    """
    from agents.datasets import CARD, DatasetConfig, missing, standard, write
    from trajopt.pool import progress_bar
    from trajopt.store import Store

    require_folder(out)
    params_ = machine(preset, params) if preset or params else None
    names = tuple(dict.fromkeys(policies or standard(params_)))
    config = DatasetConfig(params_, episodes, seed, speed)
    with Store(out):
        todo = missing(out, names, config)
        with progress_bar("data", total=len(names), initial=len(names) - len(todo)) as bar:
            for name in todo:
                bar.set_postfix_str(name)
                id_, figures = write(out, name, config)
                bar.write(f"{id_}: {figures['steps']:,} steps, return {figures['mean']:.2f} m")
                bar.update()
    print(f"{out}: set MINARI_DATASETS_PATH to it; each dataset has its card, {CARD}")
    return 0


def _film(
    names: Sequence[str],
    given: WheelParams | None,
    speed: float,
    steps: int,
    seconds: float,
    size: tuple[int, int],
    trust_pickle: bool,
) -> GroupFilm:
    """The walks of the names."""
    from agents.film import GroupFilm, Recording, ghost, record_gait, record_policy
    from agents.policy_files import named_policy
    from rimless_gym import BUILDABLE
    from rimless_gym.hybrid import CONTROL_PERIOD
    from trajopt import Solution, periodic_gait

    saved = {name: Solution.load(name) for name in names if name.lower().endswith(GAIT)}

    @lru_cache
    def gait_for(params: WheelParams) -> Solution:
        return periodic_gait(params, speed, steps, hold=CONTROL_PERIOD)

    gaits = {name: _held(gait) for name, gait in saved.items()}
    policies = {
        name: named_policy(name, gait_for, given, trust_pickle=trust_pickle)
        for name in names
        if name != OPTIMUM and name not in gaits
    }
    machines = [*(w.params for w in policies.values()), *(gait.params for gait in gaits.values())]
    params = given or next(iter(machines), BUILDABLE)
    for name, gait in gaits.items():
        if gait.params != params:
            raise ValueError(
                f"{name}: is a gait of another machine: {gait.params.differences(params)}; watch "
                "it without policies of other machines, --preset and --params"
            )
    walks: list[Recording] = []
    for name in names:
        if name in gaits:
            walks.append(record_gait(name, gaits[name], seconds))
        elif name != OPTIMUM:
            command = speed if policies[name].conditions.commanded else None
            walks.append(record_policy(policies[name], seconds, command))
        elif walks:
            walks.append(ghost(gait_for(params), walks[0]))
        else:
            walks.append(record_gait(OPTIMUM, gait_for(params), seconds))
    return GroupFilm(walks, size)


def _held(gait: Solution) -> Solution:
    """The gait if its voltage is held; otherwise the held gait that is nearest to it."""
    from rimless_gym.hybrid import CONTROL_PERIOD
    from trajopt import periodic_gait

    if gait.hold is not None:
        return gait
    return periodic_gait(
        *(gait.params, gait.speed, gait.steps, gait.regeneration), hold=CONTROL_PERIOD, guess=gait
    )


def _write(film: GroupFilm, out: Path | None) -> None:
    """Write the walks as an animated GIF or a video, or show them in a window."""
    from agents.film import times
    from rimless_gym.rendering.display import Window, save_gif, save_mp4
    from trajopt.pool import progress_bar
    from trajopt.store import write_bytes

    kind = out and out.suffix.lower()
    fps = FPS if out is None else GIF_FPS if kind == GIF else VIDEO_FPS
    moments = times(film.ends, fps)
    if out is None:
        window = Window(film.size, FPS)
        for time in moments:
            if window.is_open:
                window.show(film.frame(time))
        window.close()
        return
    frames = (film.frame(time) for time in progress_bar(out.name, iterable=moments, unit="picture"))
    if kind == VIDEO:
        save_mp4(frames, out, fps)
        return
    encoded = io.BytesIO()
    samples = [film.frame(time) for time in moments[:: math.ceil(len(moments) / SAMPLES)]]
    save_gif(frames, encoded, fps, colours=COLOURS, samples=samples)
    write_bytes(out, encoded.getvalue())


def _require_display(remedy: str) -> None:
    """Refuse to go on where no window can be shown."""
    from rimless_gym.rendering.display import has_display

    if not has_display():
        raise ValueError(f"no display: nothing can be shown here; {remedy}")
