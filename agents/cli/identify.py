"""`rimless log` and `rimless identify`: a walk's sensors in a file, and the machine from it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from agents.cli.options import (
    NO_DEFAULT,
    Fields,
    MaybePath,
    MaybeWhole,
    Positive,
    Preset,
    Several,
    Whole,
    machine,
    one,
    require_file,
)

#: A file without an option before it.
File = Annotated[Positional[Path], one("FILE", Path), NO_DEFAULT]


def log(
    policy: Annotated[Positional[str], one("NAME", str)] = "lqr",
    *,
    out: Path = Path("runs/log.csv"),
    seconds: Positive = 4.0,
    preset: Preset = "BUILDABLE",
    params: Fields = None,
    speed: Positive = 0.62,
    start: MaybeWhole = None,
    angle: Positive = 1e-3,
    current: Positive = 5e-3,
    rate: Positive = 1e-2,
    seed: Whole = 0,
) -> int:
    """Log what the sensors of a walking wheel report, with their errors, until it falls.

    The policy or law is that of the preset, and the machine that walks may differ from it.

    Args:
        policy: a feedback law, a policy (see `rimless list`), its file, or module:function
        out: file to write, .csv or .npz
        seconds: to log
        preset: machine that the policy is for
        params: fields in which the machine that walks differs: pendulum_length=0.145
        speed: of the gait that a law holds (m/s)
        start: number of one of the random starts; by default at rest
        angle: standard deviation of the angles' errors (rad)
        current: of the current's (A)
        rate: of the rates' (rad/s)
        seed: of the errors
    """
    from agents.policy_files import named_policy
    from agents.rollout import at_rest, draw_starts, logged
    from rimless_gym.hybrid import CONTROL_PERIOD
    from rimless_gym.kernel.stepping import require_steppable
    from trajopt import periodic_gait
    from trajopt.identification import Noise
    from trajopt.identification.log import SHORTEST

    if out.suffix.lower() not in (".csv", ".npz"):
        raise ValueError(f"{out}: must end in .csv or .npz")
    require_file(out)
    if seconds < SHORTEST:
        raise ValueError(f"seconds = {seconds:g}: must be at least {SHORTEST:g}, to identify from")
    require_steppable(walking := machine(preset, params))
    named = named_policy(
        policy, lambda each: periodic_gait(each, speed, hold=CONTROL_PERIOD), machine(preset, None)
    )
    if named.conditions.commanded:
        raise ValueError(f"{policy}: is commanded a speed; log a policy that chooses its own")
    if named.period != CONTROL_PERIOD:
        raise ValueError(
            f"{policy}: decides every {named.period:g} s; log one that does every "
            f"{CONTROL_PERIOD:g} s"
        )
    first = at_rest(walking) if start is None else draw_starts(walking, start + 1, 0)[start]
    walk = logged(named.policy, walking, first, seconds, Noise(angle, current, rate), seed)
    walk.save(out)
    fell = walk.time[-1] < seconds - 2 * CONTROL_PERIOD
    print(
        f"{out}: {len(walk)} samples, {walk.time[-1]:.2f} s, to foot {walk.foot[-1]:.0f}"
        + (", where the wheel fell" if fell else "")
    )
    return 0


def identify(
    file: File = Path("runs/log.csv"),
    *,
    preset: Preset = "BUILDABLE",
    params: Fields = None,
    free: Several = (),
    tolerance: Fields = None,
    angle: Positive = 1e-3,
    current: Positive = 5e-3,
    rate: Positive = 1e-2,
    out: MaybePath = None,
) -> int:
    """Identify a machine from a log: its parameters, their errors, and what the log does not show.

    A log has the columns time, phi, theta, foot, mode and voltage, and perhaps current, dphi and
    dtheta, as `rimless log` writes them. One that is too short, too still, in other units, or of
    another machine is refused.

    Args:
        file: the log, .csv or .npz
        preset: machine that is known before
        params: fields that differ from the preset's: hub_damping=0.01 n_legs=6
        free: all unknown parameters, in place of the masses, inertias, lengths, motor and friction
            that are free by default; slope may be one
        tolerance: standard deviations of what is known before, in the parameters' units
            (pendulum_drag=1e-5); by default 5 % of each parameter
        angle: standard deviation of the angles' errors (rad)
        current: of the current's (A)
        rate: of the rates' (rad/s)
        out: file (.json) to write the machine to; other commands read it with --params
    """
    from trajopt.identification import Log, Noise
    from trajopt.identification import identify as identified
    from trajopt.store import write_text

    if out is not None:
        if out.suffix != ".json":
            raise ValueError(f"{out}: must end in .json: --params reads such files")
        require_file(out)
    known, noise = machine(preset, params), Noise(angle, current, rate)
    found = identified(Log.load(file), known, free or None, tolerance=tolerance or {}, noise=noise)
    if out is not None:
        write_text(out, json.dumps(found.params.to_dict(), indent=1) + "\n")
    print(found.report())
    if out is not None:
        print(f"{out}: the machine")
    return 0
