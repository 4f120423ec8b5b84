#!/usr/bin/env python
"""Regenerate every figure and every number of docs/physics.md and docs/thesis-errata.md.

Writes PNG files and numbers.json. The tables of the two documents are printed, to be pasted where
they changed; a test compares the documents with numbers.json, and numbers.json with the code.
"""

from __future__ import annotations

import argparse
import cmath
import dataclasses
import io
import json
import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image
from tqdm import tqdm

from rimless_gym import THESIS_PHYSICAL, WheelParams, hybrid, simulate
from rimless_gym import energy as row
from rimless_gym.canvas import Canvas
from rimless_gym.energy import Ledger
from rimless_gym.equations import equations
from rimless_gym.events import BACKWARD, FORWARD, LIFT_OFF, force_guard
from rimless_gym.hybrid import CONTROL_PERIOD, DOUBLE, MODE_NAMES, SINGLE
from rimless_gym.integration import rk8
from rimless_gym.params import PRESETS
from rimless_gym.rendering import Scene, draw
from rimless_gym.stepping import DPHI, MODE, STATE_SIZE, THETA, advance, scratch, smooth_step
from rimless_gym.stepping import step_length as kernel_step
from rimless_gym.trajectory import Trajectory

Array = NDArray[np.float64]
eq = equations(np.sin, np.cos)  # of arrays


@dataclasses.dataclass(frozen=True)
class Motion:
    """A start, and voltages held for one control interval each.

    `grazes` is when the leg turns at its guard (s), if it does, `depth` how deep the foot then is.
    """

    params: WheelParams
    start: Array
    volts: Array
    grazes: tuple[float, ...] = ()
    depth: float = 0.0


# -- motions to compare on ------------------------------------------------------------------------


def hybrid_state(phi: float, theta: float, dphi: float, dtheta: float, mode: int = SINGLE) -> Array:
    """A state of the stepping kernel, on the first foot."""
    return np.array([phi, theta, dphi, dtheta, mode, 0.0])


def walking(name: str, rng: np.random.Generator) -> Motion:
    """The pendulum held ahead of the hub; downhill where the motor alone does not suffice."""
    slope = {"THESIS_PHYSICAL": 0.0, "THESIS_NOMINAL": 0.1, "PROTOTYPE": 0.45}[name]
    params, lean = PRESETS[name].replace(slope=slope), rng.uniform(1.0, 1.4)
    start = hybrid_state(params.constants.a, lean, rng.uniform(1.5, 2.5), 0.0)
    state, volts = start[None].copy(), []
    for _ in range(150):
        push = 30 * (lean - state[0, THETA]) - 3 * state[0, 3] + 3 * state[0, DPHI] + 10
        volts.append(np.clip(push, -params.voltage_limit, params.voltage_limit))
        advance(params, state, np.array(volts[-1:]), pull=math.inf)
    return Motion(params, start, np.array(volts))


def falling_back(name: str, rng: np.random.Generator) -> Motion:
    """Thrown backward from mid-stance, at random voltages."""
    params = PRESETS[name]
    start = hybrid_state(rng.uniform(1.2, 1.8), rng.uniform(-1, 1), rng.uniform(-4, -2), 0.0)
    return Motion(params, start, rng.uniform(-8, 8, 80))


def rocking(name: str, rng: np.random.Generator) -> Motion:
    """To and fro over two feet under an alternating voltage."""
    params = PRESETS[name]
    volts = 20 * np.sin(rng.uniform(5, 9) * CONTROL_PERIOD * np.arange(150) + rng.uniform(0, 6))
    start = hybrid_state(params.constants.a + 0.02, rng.uniform(-1.5, 1.5), 0.0, 0.0)
    return Motion(params, start, volts)


def resting(name: str, rng: np.random.Generator) -> Motion:
    """Down to rest on two feet by a Zeno sequence, then off again by a full voltage."""
    params = PRESETS[name]
    start = hybrid_state(
        params.constants.a + rng.uniform(0.01, 0.05), rng.uniform(-0.3, 0.3), 0.0, 0.0
    )
    sign = rng.choice([-1.0, 1.0])
    return Motion(params, start, np.where(np.arange(150) < 100, 0.0, 20 * sign))


def several_touchdowns(name: str, rng: np.random.Generator) -> Motion:
    """Nearly at rest: three and more touchdowns in the first control interval."""
    params, p = PRESETS[name], PRESETS[name].constants
    while True:
        start = hybrid_state(p.a, rng.uniform(-0.5, 0.5), rng.uniform(0.002, 0.04), 0.0)
        motion = Motion(params, start, rng.uniform(-1, 1, 2))
        rows = advance(params, start[None].copy(), motion.volts[:1], pull=math.inf)
        if rows[0, row.TOUCHDOWNS] >= 3:
            return motion


def grazing(depth: float) -> Callable[[str, np.random.Generator], Motion]:
    """The swing foot at `depth` (m) below the ground at the turning point of the leg's motion.

    The turning point is drawn, and the start is 3 to 7 ms before it, by integrating backward.
    """

    def motion(name: str, rng: np.random.Generator) -> Motion:
        params, p = PRESETS[name], PRESETS[name].constants
        forward = bool(rng.integers(2))
        phi = p.b + depth / params.step_length if forward else p.a - depth / params.step_length
        while True:
            theta, dtheta = rng.uniform(-math.pi, math.pi), rng.uniform(-8, 8)
            u = rng.uniform(-params.voltage_limit, params.voltage_limit)
            before = -rng.uniform(0.003, 0.007)
            *_, y = smooth_states(params, (phi, theta, 0.0, dtheta), u, before, 32)
            turns_back = (y[2] > 0) == forward and abs(y[2]) > 1e-3
            if p.a < y[0] < p.b and turns_back and abs(y[3]) < 40:
                start = hybrid_state(y[0], y[1], y[2], y[3])
                return Motion(params, start, np.array([u]), (-before,), depth)

    return motion


CASES: dict[str, Callable[[str, np.random.Generator], Motion]] = {
    "walking": walking,
    "falling back": falling_back,
    "rocking": rocking,
    "resting, lift-off": resting,
    "several touchdowns": several_touchdowns,
}
CASES |= {
    f"graze {depth:+.0e} m": grazing(depth) for depth in (1e-5, 1e-7, 1e-9, 1e-11, -1e-11, -1e-9)
}


# -- accuracy of the kernel ---------------------------------------------------------------------


def smooth_states(
    params: WheelParams, y: tuple[float, ...], u: float, duration: float, steps: int
) -> Iterator[tuple[float, ...]]:
    """States after each of `steps` single-stance integrator steps, guards ignored."""
    p, k = params.constants, scratch()
    for _ in range(steps):
        y = rk8(SINGLE, y, hybrid.single_stance(*y, u, p), u, duration / steps, p, k)[0]
        yield y


def located_touchdowns(motion: Motion, state: Array, u: float) -> tuple[list[float], Array]:
    """Times of the touchdowns that the kernel locates in one control interval, and its end state.

    `stepping.advance_kernel` reports only how many there were: this is its loop, told by the same
    end state.
    """
    params, p, k = motion.params, motion.params.constants, scratch()
    mode, foot, y, t, times = int(state[MODE]), state[5], tuple(state[:4]), 0.0, []
    event = None
    while t < CONTROL_PERIOD:
        if event == LIFT_OFF or (
            mode == DOUBLE and force_guard(LIFT_OFF, mode, y, u, math.inf, p) > 0.0
        ):
            phi, shift = hybrid.after_lift_off(y[1], y[3], u, p)
            mode, foot, y = SINGLE, foot + shift, (phi, y[1], 0.0, y[3])
        left = CONTROL_PERIOD - t
        limit = kernel_step(left, params.motor_pole, abs(y[2]) + abs(y[3]))
        acc = hybrid.accelerations(mode, *y, u, p)
        h, y, _, _, _, event = smooth_step(mode, y, acc, u, limit, math.inf, p, k)
        t = CONTROL_PERIOD if h == left else t + h
        if event in (FORWARD, BACKWARD):
            times.append(t)
            after = hybrid.after_touchdown(event, y[1], y[2], y[3], u, p)
            mode, foot, y = after[0], foot + after[4], (after[1], y[1], after[3], after[2])
    return times, np.array([*y, mode, foot])


def foot_height(params: WheelParams, phi: float, direction: int) -> float:
    """Height (m) of the foot that comes down next."""
    swing = phi - direction * params.leg_angle
    p = params.constants
    return float(eq.hub_position(phi, p)[1] - eq.hub_position(swing, p)[1])


@dataclasses.dataclass
class Accuracy:
    """Worst disagreement of the kernel with the reference simulator over some motions.

    States and energies are compared where both see the same touchdowns and lift-offs.
    """

    motions: int = 0
    touchdowns: int = 0
    lift_offs: int = 0
    state: float = 0.0  # rad, rad/s
    height: float = 0.0  # m
    energy: float = 0.0  # J
    residual: float = 0.0  # J, of the energy balance of one control interval
    disagreements: int = 0  # motions with another number of events, or another mode or foot

    def add(self, motion: Motion) -> None:
        """Compare on one more motion."""
        params, volts = motion.params, motion.volts
        duration = len(volts) * CONTROL_PERIOD
        # The reference watches its guards at samples: a shallow graze must be one of them.
        reference = simulate(params, motion.start[:4], volts, duration, breakpoints=motion.grazes)
        state, total, times, error = motion.start[None].copy(), np.zeros(row.N_ROWS), [], 0.0
        for k, u in enumerate(volts):
            located, end = located_touchdowns(motion, state[0], u)
            out = advance(params, state, np.array([u]), pull=math.inf)[0]
            if out[row.TOUCHDOWNS] != len(located) or np.abs(end - state[0]).max() > 1e-13:
                raise RuntimeError("located_touchdowns is no longer the kernel's own loop")
            times += [k * CONTROL_PERIOD + t for t in located]
            total += out
            self.residual = max(self.residual, abs(Ledger.from_rows(out, params).residual))
            theirs = reference.state((k + 1) * CONTROL_PERIOD, side="left")
            error = max(error, float(np.abs(state[0, :4] - theirs).max()))
        self.motions += 1
        self.touchdowns += len(times)
        self.lift_offs += sum(event.kind == "lift_off" for event in reference.events)
        same = len(times) == len(reference.touchdowns) and state[0, 5] == reference.foot[-1]
        if not (same and MODE_NAMES[int(state[0, MODE])] == reference.final_mode):
            self.disagreements += 1
        else:
            ours = np.array(dataclasses.astuple(Ledger.from_rows(total, params)))
            energies = np.array(dataclasses.astuple(reference.ledger))
            self.energy = max(self.energy, float(np.abs(ours - energies).max()))
            self.state = max(self.state, error)
        self.height = max([self.height, *self._heights(motion, times, reference)])

    def _heights(self, motion: Motion, times: list[float], reference: Trajectory) -> list[float]:
        """How high or deep the foot is at the kernel's touchdowns, or where one is passed over."""
        theirs = [event.time for event in reference.touchdowns]
        ends = {arc.end: arc for arc in reference.arcs}
        heights = []
        for ours, event in zip(times, reference.touchdowns, strict=False):
            if abs(ours - event.time) > 1e-3:
                break
            phi = ends[event.time].dense(ours)[0]
            heights.append(abs(foot_height(motion.params, phi, event.direction)))
        if len(heights) < min(1, len(theirs)):  # there is a touchdown, but not to the kernel
            heights.append(abs(motion.depth))
        elif len(heights) < min(1, len(times)):  # there is none, but to the kernel
            phi = float(reference.state(times[0])[0])
            heights.append(abs(foot_height(motion.params, phi, 1 if phi > math.pi / 2 else -1)))
        return heights


def accuracy(count: int = 6, grazes: int = 40) -> dict[str, dict[str, Any]]:
    """`Accuracy` of each preset and case, with seeded motions."""
    table: dict[str, dict[str, Any]] = {}
    for name in tqdm(PRESETS, desc="accuracy", file=sys.stderr):
        table[name] = {}
        for case, motion in CASES.items():
            measured, rng = Accuracy(), np.random.default_rng(11)
            for _ in range(grazes if "graze" in case else count):
                measured.add(motion(name, rng))
            table[name][case] = dataclasses.asdict(measured)
    return table


def missed_dips(count: int) -> dict[str, dict[str, float]]:
    """Control intervals that start near a guard, against the same in eight parts.

    Where the leg turns twice inside one integrator step, a dip below the ground can be passed over.
    """
    table = {}
    for name, params in tqdm(PRESETS.items(), desc="missed dips", file=sys.stderr):
        p, rng = params.constants, np.random.default_rng(0)
        start = np.zeros((count, STATE_SIZE))
        start[:, 0] = p.a + 10 ** rng.uniform(-7, -2.5, count)
        start[:, 1] = rng.uniform(-math.pi, math.pi, count)
        start[:, 2] = -(10 ** rng.uniform(-4, -0.3, count)) * rng.choice([1, 1, -1], count)
        start[:, 3] = rng.uniform(-15, 15, count)
        volts, whole, parts = rng.uniform(-20, 20, count), start.copy(), start.copy()
        advance(params, whole, volts, pull=math.inf)
        for _ in range(8):
            advance(params, parts, volts, CONTROL_PERIOD / 8, math.inf)
        unlike, depth = np.flatnonzero(np.abs(whole - parts).max(1) > 1e-6), 0.0
        for i in unlike:
            steps = smooth_states(params, tuple(start[i, :4]), volts[i], CONTROL_PERIOD, 400)
            heights = np.array([foot_height(params, y[0], -1) for y in steps])
            below = np.flatnonzero(heights < 0)
            back = np.flatnonzero(heights[below[0] :] > 0) if len(below) else below
            if len(back):
                depth = max(depth, -heights[below[0] : below[0] + back[0]].min())
        table[name] = {"intervals": count, "unlike": len(unlike), "deepest": float(depth)}
    return table


def convergence(count: int = 20) -> dict[str, dict[str, Any]]:
    """Error of the integrator over halved steps (root mean square over starts), and its order."""
    table = {}
    for name, params in PRESETS.items():
        rng, squares = np.random.default_rng(3), np.zeros(7)
        duration = 0.01 if name == "PROTOTYPE" else 0.2  # its motor pole is that much faster
        sizes = duration / 2.0 ** np.arange(7)
        for start in rng.uniform([1.2, -2, -2, -6], [1.8, 2, 2, 6], (count, 4)):
            *_, exact = smooth_states(params, tuple(start), 10.0, duration, 512)
            for i in range(7):
                *_, end = smooth_states(params, tuple(start), 10.0, duration, 2**i)
                squares[i] += np.abs(np.subtract(end, exact)).max() ** 2 / count
        errors = np.sqrt(squares)
        fit = (errors > 2e-13) & (errors < 1e-5)
        order = float(np.polyfit(np.log(sizes[fit]), np.log(errors[fit]), 1)[0])
        table[name] = {"h": sizes.tolist(), "error": errors.tolist(), "order": order}
    return table


def coming_to_rest() -> dict[str, Any]:
    """A Zeno sequence of touchdowns and its end in double stance."""
    p = THESIS_PHYSICAL.constants
    motion = simulate(THESIS_PHYSICAL, [p.a + 0.05, 0.0, 0.0, 0.0], np.zeros(60), 0.6)
    falls = motion.touchdowns
    return {
        "touchdowns": len(falls),
        "time": [event.time for event in falls],
        "rate": [abs(float(event.before[2])) for event in falls],
        "loss": [event.loss for event in falls],
        "final_mode": motion.final_mode,
    }


# -- errata ----------------------------------------------------------------------------------------


def single_inertia(params: WheelParams) -> WheelParams:
    """The printed map with I1 counted once, as in its closed form (3.85-3.87).

    The wheel's mass enters (3.75-3.82) through Je1 alone, so that taking I1 from Je1 is enough.
    """
    spare = params.wheel_inertia / params.leg_length**2
    return params.replace(impact_law="thesis", wheel_mass=max(params.wheel_mass - spare, 0.0))


def impact_ratios(
    params: WheelParams, law: str, theta: Any, dphi: Any, dtheta: Any
) -> tuple[Any, Any]:
    """(phi'+, kinetic energy after / before) of a forward touchdown."""
    p, q = params.constants, params.replace(impact_law=law).constants
    after = eq.impact(p.a, p.b, theta, dphi, dtheta, q)
    energy = eq.kinetic_energy(p.a, theta, *after, p)
    return after[0], energy / eq.kinetic_energy(p.b, theta, dphi, dtheta, p)


def pre_impact_states(count: int) -> tuple[Array, Array, Array]:
    """(theta, phi', theta'), uniform in [-pi, pi], [0, 4] rad/s and [-8, 8] rad/s."""
    rng = np.random.default_rng(0)
    return (
        rng.uniform(-math.pi, math.pi, count),
        rng.uniform(0, 4, count),
        rng.uniform(-8, 8, count),
    )


def printed_impact(count: int = 200_000) -> dict[str, Any]:
    """What the map (3.82) does, as printed, beside the plastic one."""
    states = pre_impact_states(count)
    shares = {}
    machines = PRESETS | {
        f"THESIS_PHYSICAL, n = {n}": THESIS_PHYSICAL.replace(n_legs=n) for n in (4, 6, 8, 12)
    }
    for name, params in machines.items():
        rate, gain = impact_ratios(params, "thesis", *states)
        plastic = impact_ratios(params, "plastic", *states)
        p, once = params.constants, single_inertia(params).constants
        closed = -eq.impact(p.a, p.b, *states, once)[0]
        shares[name] = {
            "creates": float(np.mean(gain > 1)),
            "largest": float(gain.max()),
            "median": float(np.median(gain)),
            "reverses": float(np.mean(rate < 0)),
            "closed_form_reverses": float(np.mean(closed < 0)),
            "plastic_largest": float(plastic[1].max()),
            "plastic_reverses": float(np.mean(plastic[0] < 0)),
        }
    typical = []
    for theta in (-0.5, 0.0, 0.5, 1.0, 1.5, math.pi):
        typical.append({"theta": theta})
        for law in ("plastic", "thesis"):
            rate, gain = impact_ratios(THESIS_PHYSICAL, law, theta, 1.0, 0.0)
            typical[-1] |= {f"{law}_rate": float(rate), f"{law}_energy": float(gain)}
        p, q = THESIS_PHYSICAL.constants, single_inertia(THESIS_PHYSICAL).constants
        typical[-1]["closed_form_rate"] = -float(eq.impact(p.a, p.b, theta, 1.0, 0.0, q)[0])
    return {"random": shares, "typical": typical, "kappa": kappa_range(THESIS_PHYSICAL)}


def kappa_range(params: WheelParams) -> list[float]:
    """Least and largest phi'+ / phi'- of a plastic touchdown over all pendulum angles."""
    rates = impact_ratios(params, "plastic", np.linspace(-math.pi, math.pi, 100_001), 1.0, 0.0)[0]
    return [float(rates.min()), float(rates.max())]


def new_foot_momentum(count: int = 100_000) -> dict[str, float]:
    """Error of (3.66), the momentum about the new foot before impact, by number of legs.

    Root mean square over random states, relative to that of the momentum itself. The printed one
    is that of a new leg at 90 degrees to the old one.
    """
    theta, dphi, dtheta = pre_impact_states(count)

    def momentum(p: Any, phi_new: float) -> Array:
        m11, m12, m21, m22 = eq.mass_matrix(phi_new, p.b, theta, p)
        return np.asarray((m21 - m11) * dphi + (m22 - m12) * dtheta)

    table = {}
    for n in (3, 4, 5, 6, 8, 12):
        p = THESIS_PHYSICAL.replace(n_legs=n).constants
        right, printed = momentum(p, p.a), momentum(p, p.b - math.pi / 2)
        table[str(n)] = float(np.sqrt(np.mean((printed - right) ** 2) / np.mean(right**2)))
    return table


def generalised_force() -> dict[str, dict[str, float]]:
    """Energy balance of one step at 20 V if f = (0, T) with the motor on the wheel, and right.

    A stator that does not turn but has the back-EMF of one on the wheel is mount `frame` at the
    voltage less K phi'.
    """
    wheel, volts = THESIS_PHYSICAL, 20.0
    p, start = wheel.constants, [THESIS_PHYSICAL.constants.a, 0.0, 4.0, 0.0]
    laws: dict[str, tuple[WheelParams, Any]] = {
        "printed": (
            wheel.replace(motor_mount="frame"),
            lambda t, x: volts - eq.relative_rate(x[2], 0.0, p) * p.K,
        ),
        "right": (wheel, lambda t, x: volts),
    }
    table = {}
    for name, (machine, law) in laws.items():
        motion = simulate(machine, start, law, 1.0)
        end = motion.touchdowns[0].time
        t = np.linspace(0, end, 20_001)
        x = motion.state(t, side="left").T
        dpsi = eq.relative_rate(x[2], x[3], p)
        drawn = np.trapezoid(eq.electrical_power(dpsi, volts, p), t)
        copper = np.trapezoid(eq.losses(x[2], dpsi, volts, p)[0], t)
        energy = eq.mechanical_energy(*x, p)
        gained = energy[-1] - energy[0]
        table[name] = {
            "time": float(end),
            "drawn": float(drawn),
            "copper": float(copper),
            "gained": float(gained),
            "missing": float(drawn - copper - gained),
            "rate_at_touchdown": float(x[2, -1]),
        }
    return table


def rotor(jm: float = 1e-7) -> dict[str, Any]:
    """A rotor of 1e-7 kg m^2 (a small DC motor's) as the hub feels it, right and as printed."""
    ratio = THESIS_PHYSICAL.gear_ratio
    table: dict[str, Any] = {"jm": jm, "factor": ratio**4}
    for name, params in PRESETS.items():
        right, none = params.replace(rotor_inertia=jm), params.replace(rotor_inertia=0.0)
        printed = params.replace(rotor_inertia=jm / ratio**4)
        table[name] = {
            "right": right.constants.Jr,
            "printed": printed.constants.Jr,
            "pendulum": none.constants.Je2,
            "pole": none.motor_pole,
            "pole_right": right.motor_pole,
            "pole_printed": printed.motor_pole,
        }
    return table


def reach_and_hub(params: WheelParams) -> list[float]:
    """The rod's reach below the hub, and the hub's height on two feet (m)."""
    p = params.constants
    hub = float(eq.hub_position(p.a, p)[1])
    return [hub - float(eq.pendulum_clearance(p.a, 0.0, p)), hub]


def numbers(scale: float = 1.0) -> dict[str, Any]:
    """Everything that the two documents quote; `scale` < 1 measures accuracy on fewer motions."""
    return {
        "accuracy": accuracy(max(1, round(10 * scale)), max(1, round(400 * scale))),
        "missed_dips": missed_dips(max(1, round(200_000 * scale))),
        "convergence": convergence(),
        "coming_to_rest": coming_to_rest(),
        "printed_impact": printed_impact(),
        "new_foot_momentum": new_foot_momentum(),
        "generalised_force": generalised_force(),
        "rotor": rotor(),
        "motor_pole": {name: params.motor_pole for name, params in PRESETS.items()},
        "reach_and_hub": {name: reach_and_hub(params) for name, params in PRESETS.items()},
        "kappa": {name: kappa_range(params) for name, params in PRESETS.items()},
    }


# -- figures ---------------------------------------------------------------------------------------

INK, TEAL, ORANGE, GREY = "#262f3c", "#009688", "#e5562e", "#76849a"


def picture(params: WheelParams, scene: Scene, size: tuple[int, int]) -> tuple[Any, Any]:
    """The renderer's drawing, and a function from the ground's frame (complex m) to its pixels."""
    canvas = Canvas(params, scene.hub(params)[0], size, (255, 255, 255))

    def pixel(point: complex) -> tuple[float, float]:
        x, y = canvas.pixel(point)
        return x * size[0] / canvas.width, y * size[0] / canvas.width

    return draw(params, scene, size=size), pixel


def panel(figure: Figure, place: tuple[float, float, float, float], frame: Any) -> Axes:
    """Axes in pixels of a frame, at (left, bottom, width, height) of the figure."""
    axes = figure.add_axes(place)
    axes.imshow(frame, interpolation="antialiased")
    axes.set_axis_off()
    return axes


def coordinates_figure() -> Figure:
    """Angles and lengths, drawn on the renderer's picture."""
    params = THESIS_PHYSICAL.replace(pendulum_length=0.24, slope=0.14)
    scene, size = Scene(phi=1.08, theta=1.1), (1300, 860)
    frame, pixel = picture(params, scene, size)
    figure = plt.figure(figsize=(9.2, 6.3), dpi=100)
    axes = panel(figure, (0, 0, 1, 1), frame)
    axes.set(xlim=(230, 1150), ylim=(795, 165))
    foot, hub, unit = 0j, complex(*scene.hub(params)), params.leg_length

    def label(text: str, point: complex, colour: str = INK) -> None:
        box = {"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.75}
        x, y = pixel(point)
        axes.text(x, y, text, color=colour, fontsize=20, ha="center", va="center", bbox=box)

    def dashed(start: complex, end: complex) -> None:
        ends = zip(pixel(start), pixel(end), strict=True)
        axes.plot(*ends, color=INK, lw=1.2, ls=(0, (4, 3)))

    def arrow(start: complex, end: complex, colour: str) -> None:
        style = {"arrowstyle": "-|>,head_width=0.3,head_length=0.6", "lw": 2, "color": colour}
        axes.annotate("", pixel(end), pixel(start), arrowprops=style | {"shrinkA": 0, "shrinkB": 0})

    def arc(centre: complex, radius: float, start: float, end: float, colour: str) -> None:
        points = [centre + radius * cmath.exp(1j * t) for t in np.linspace(start, end, 80)]
        axes.plot(*zip(*map(pixel, points[:-4]), strict=True), lw=2, color=colour)
        arrow(points[-7], points[-1], colour)

    leg, rod = cmath.exp(1j * (math.pi - scene.phi)), -1j * cmath.exp(1j * scene.theta)
    downward = -1j * cmath.exp(1j * params.slope)
    dashed(foot, -0.3 + 0j)
    dashed(hub, hub - 0.27j)
    arc(foot, 0.13, math.pi, math.pi - scene.phi, TEAL)
    label(r"$\varphi$", 0.165 * cmath.exp(1j * (math.pi - 0.5 * scene.phi)), TEAL)
    arc(hub, 0.13, -math.pi / 2, scene.theta - math.pi / 2, ORANGE)
    label(r"$\theta$", hub + 0.165 * cmath.exp(-0.8j), ORANGE)
    following = params.leg_angle - scene.phi
    arc(hub, 0.33, following, -scene.phi, INK)
    label(r"$\alpha$", hub + 0.37 * cmath.exp(1j * (following - 0.30)))
    label("$L_1$", foot + 0.4 * unit * leg + 0.06, TEAL)
    label("$L_2$", hub + 0.62 * params.pendulum_length * rod + 0.05j * rod, ORANGE)
    label("$m_2, I_2$", hub + 1.95 * params.pendulum_length * rod + 0.075j * rod, ORANGE)
    label("$m_1, I_1$", hub + 0.1 + 0.085j)
    corner = -0.56 + 0.03j
    for end, name in ((0.14, "$x$"), (0.14j, "$y$")):
        arrow(corner, corner + end, INK)
        label(name, corner + 1.22 * end)
    arrow(-0.5 + 0.42j, -0.5 + 0.42j + 0.14 * downward, GREY)
    label("$g$", -0.46 + 0.36j, GREY)
    level, edge = downward * 1j, 0.08 - 0.033j
    axes.plot(*zip(pixel(edge), pixel(edge + 0.33 * level), strict=True), color="white", lw=1.2)
    label(r"$\gamma$", edge + 0.36 * cmath.exp(0.5j * params.slope))
    return figure


def modes_figure() -> Figure:
    """The two modes and what leads from one to the other."""
    params = THESIS_PHYSICAL.replace(pendulum_length=0.17)
    figure = plt.figure(figsize=(13, 4.3), dpi=100)
    over = figure.add_axes((0, 0, 1, 1))
    over.set(xlim=(0, 1), ylim=(0, 1))
    over.set_axis_off()
    scenes = (
        (0.155, "single stance", Scene(phi=1.75, theta=0.5)),
        (0.61, "double stance", Scene(phi=params.constants.a, theta=0.25, mode=DOUBLE)),
    )
    for left, name, scene in scenes:
        frame, _ = picture(params, scene, (540, 400))
        panel(figure, (left, 0.15, 0.265, 0.595), frame)
        over.text(left + 0.1325, 0.82, name, fontsize=16, weight="bold", color=INK, ha="center")

    def arrow(start: tuple[float, float], end: tuple[float, float], bend: float) -> None:
        style = {"arrowstyle": "-|>,head_width=0.35,head_length=0.7", "lw": 2, "color": TEAL}
        style |= {"connectionstyle": f"arc3,rad={bend}"}
        over.annotate("", end, start, arrowprops=style)

    def note(x: float, y: float, *lines: str) -> None:
        text = "\n".join(lines)
        over.text(x, y, text, fontsize=12, color=INK, ha="center", va="center", linespacing=1.4)

    arrow((0.425, 0.56), (0.605, 0.56), -0.2)
    note(
        0.515,
        0.80,
        "touchdown that stops",
        "the wheel, or leaves it",
        "< REST_ENERGY with",
        "both feet pressing",
    )
    arrow((0.605, 0.36), (0.425, 0.36), -0.2)
    note(
        0.515,
        0.13,
        "lift-off",
        r"$\ddot\varphi(a) > 0$: forward",
        r"$\ddot\varphi(b) < 0$: backward",
    )
    arrow((0.15, 0.36), (0.15, 0.56), -1.1)
    note(0.075, 0.80, "touchdown:", "forward at $b$,", "backward at $a$")
    note(0.075, 0.17, r"$\varphi^+ = \varphi^- \mp\alpha$", r"$M_{++}v^+ = M_{+-}v^-$")
    note(0.2875, 0.075, r"$\varphi$ and $\theta$ move: $M\dot v = Q$")
    note(0.7425, 0.075, r"only $\theta$ moves: $\dot\varphi = 0$")
    arrow((0.88, 0.45), (0.92, 0.45), 0.0)
    note(0.958, 0.45, "contact", "lost:", "$F_y < 0$", "(either", "mode)")
    return figure


def convergence_figure(table: dict[str, dict[str, Any]]) -> Figure:
    """Error against step, and a line of order 8."""
    figure, axes = plt.subplots(figsize=(6.4, 4.2), dpi=110, layout="constrained")
    for (name, result), colour in zip(table.items(), (INK, TEAL, ORANGE), strict=True):
        axes.loglog(result["h"], result["error"], "o-", color=colour, ms=4, label=name)
    h = np.array([0.0125, 0.2])
    axes.loglog(h, 1e-5 * (h / 0.2) ** 8 * 200, "--", color=GREY, lw=1, label="order 8")
    axes.set(xlabel="step (s)", ylabel="error after 0.2 s (PROTOTYPE: 10 ms)", ylim=(1e-15, 1e-2))
    axes.grid(alpha=0.25)
    axes.legend(frameon=False)
    return figure


def rest_figure(rest: dict[str, Any]) -> Figure:
    """Coming to rest: the leg's angle, and the speed at each touchdown."""
    p = THESIS_PHYSICAL.constants
    motion = simulate(THESIS_PHYSICAL, [p.a + 0.05, 0.0, 0.0, 0.0], np.zeros(60), 0.13)
    t = np.linspace(0, 0.13, 2000)
    states, arcs = motion.state(t), motion.arcs
    foot = np.array(
        [arcs[max(np.searchsorted([a.start for a in arcs], s, "right") - 1, 0)].foot for s in t]
    )
    tilt = states[:, 0] - p.a + foot * p.alpha
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), dpi=110, layout="constrained")
    left.plot(1e3 * t, 1e3 * tilt, color=INK, lw=1.4)
    left.plot(1e3 * np.array(rest["time"]), np.zeros(rest["touchdowns"]), "o", color=TEAL, ms=5)
    left.axhline(0, color=GREY, lw=0.8, ls=":")
    left.set(xlabel="time (ms)", ylabel="tilt from two feet (mrad)")
    count = np.arange(1, rest["touchdowns"] + 1)
    right.semilogy(count, rest["rate"], "o-", color=TEAL, label=r"$|\dot\varphi^-|$ (rad/s)")
    right.semilogy(count, rest["loss"], "s-", color=ORANGE, label="energy lost (J)")
    right.set(xlabel="touchdown", xticks=count)
    right.legend(frameon=False)
    for axes in (left, right):
        axes.grid(alpha=0.25)
    return figure


def impact_figure() -> Figure:
    """The printed map beside the plastic one."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.9), dpi=110, layout="constrained")
    theta = np.linspace(-math.pi, math.pi, 721)
    for law, colour, name in (
        ("plastic", TEAL, "plastic"),
        ("thesis", ORANGE, "(3.82) as printed"),
    ):
        at = [impact_ratios(THESIS_PHYSICAL, law, theta, 1.0, rate)[0] for rate in (-1.0, 0.0, 1.0)]
        left.plot(theta, at[1], color=colour, label=name)
        left.fill_between(theta, at[0], at[2], color=colour, alpha=0.18, lw=0)
    left.axhline(0, color=GREY, lw=0.8)
    left.set(
        xlim=(-math.pi, math.pi),
        xlabel=r"pendulum angle $\theta$ (rad)",
        ylabel=r"$\dot\varphi^+ / \dot\varphi^-$",
    )
    left.legend(frameon=False)
    ratio = np.linspace(-4, 4, 401)
    gain = impact_ratios(THESIS_PHYSICAL, "thesis", theta[None, :], 1.0, ratio[:, None])[1]
    levels = [0, 0.25, 0.5, 0.75, 1, 1.25, 1.5, 1.75, 2, 2.25, 2.5]
    filled = right.contourf(theta, ratio, gain, levels, cmap="RdBu_r", norm=TwoSlopeNorm(1, 0, 2.5))
    right.contour(theta, ratio, gain, [1], colors=INK, linewidths=1)
    figure.colorbar(filled, ax=right, label="kinetic energy after / before, (3.82)")
    right.set(xlabel=r"pendulum angle $\theta$ (rad)", ylabel=r"$\dot\theta^- / \dot\varphi^-$")
    return figure


def save(figure: Figure, path: Path, colours: int = 200) -> None:
    """Write a PNG with a palette, which keeps it small."""
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi="figure")
    image = Image.open(drawn).convert("RGB")
    image.quantize(colours, dither=Image.Dither.NONE).save(path, optimize=True)
    plt.close(figure)


def figures(results: dict[str, Any]) -> dict[str, Figure]:
    """Every figure by file name."""
    plt.rcParams |= {"axes.spines.top": False, "axes.spines.right": False, "font.size": 10}
    return {
        "coordinates.png": coordinates_figure(),
        "modes.png": modes_figure(),
        "convergence.png": convergence_figure(results["convergence"]),
        "rest.png": rest_figure(results["coming_to_rest"]),
        "impact.png": impact_figure(),
    }


# -- tables of the documents -----------------------------------------------------------------------


def table(head: list[str], rows: list[list[Any]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def tables(results: dict[str, Any]) -> dict[str, str]:
    """The documents' tables, as they stand there."""

    def each(cells: list[dict[str, Any]], key: str) -> str:
        return " / ".join(f"{cell[key]:.0e}" for cell in cells)

    measured = []
    for case in CASES:
        cells = [results["accuracy"][name][case] for name in PRESETS]
        counts = (sum(cell[key] for cell in cells) for key in ("motions", "touchdowns"))
        unlike = sum(cell["disagreements"] for cell in cells)
        residual = max(cell["residual"] for cell in cells)
        row_of = [each(cells, "state"), each(cells, "height"), f"{residual:.0e}", unlike]
        measured.append([case, *counts, *row_of])
    typical = [
        [f"{at['theta']:.1f}"]
        + [
            f"{at[f'{law}_{key}']:.2f}"
            for key in ("rate", "energy")
            for law in ("plastic", "thesis")
        ]
        + [f"{at['closed_form_rate']:.2f}"]
        for at in results["printed_impact"]["typical"]
    ]
    shares = [
        [
            name,
            *(f"{100 * of[key]:.0f} %" for key in ("creates", "reverses", "closed_form_reverses")),
            f"{of['largest']:.2f}",
        ]
        for name, of in results["printed_impact"]["random"].items()
    ]
    momentum, rotors = results["new_foot_momentum"], results["rotor"]
    forces = [
        [f"$f = {f}$", *(f"{of[key]:.2f}" for key in ("time", "drawn", "copper", "gained"))]
        + [f"{abs(of['missing']):.2f}", f"{of['rate_at_touchdown']:.2f}"]
        for f, of in zip(("(0, T)", "(T, T)"), results["generalised_force"].values(), strict=True)
    ]
    inertias = [
        [f"`{name}`", *(f"{rotors[name][key]:.2g}" for key in ("right", "printed", "pendulum"))]
        + [f"{rotors[name][key]:.1f}" for key in ("pole", "pole_right")]
        for name in PRESETS
    ]
    return {
        "accuracy": table(
            ["case", "motions", "touchdowns", "state (rad, rad/s)", "foot height (m)"]
            + ["ledger residual (J)", "disagree"],
            measured,
        ),
        "typical": table(
            ["θ (rad)", "rate, plastic", "rate, (3.82)", "energy, plastic", "energy, (3.82)"]
            + ["rate, (3.85-3.87)"],
            typical,
        ),
        "force": table(
            ["", "step time (s)", "drawn (J)", "copper (J)", "mechanical gain (J)"]
            + ["unexplained (J)", "rate at the end (rad/s)"],
            forces,
        ),
        "rotor": table(
            ["", "$J_mN^2$ (kg m²)", "$J_m/N^2$", "pendulum's $J_{e2}$"]
            + ["motor pole without rotor (1/s)", "with $J_mN^2$"],
            inertias,
        ),
        "shares": table(
            ["machine", "(3.82) creates energy", "(3.82) reverses the wheel"]
            + ["(3.85-3.87) reverses it"]
            + ["largest gain of (3.82)"],
            shares,
        ),
        "momentum": table(
            ["legs", *momentum],
            [["error of (3.66)", *(f"{100 * e:.0f} %" for e in momentum.values())]],
        ),
    }


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("docs/figures"), help="folder to write to")
    parser.add_argument(
        "--keep-numbers", action="store_true", help="draw from the numbers.json that is there"
    )
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    path = arguments.out / "numbers.json"
    if arguments.keep_numbers:
        results = json.loads(path.read_text())
    else:
        results = numbers()
        path.write_text(json.dumps(results, indent=1) + "\n")
    for name, figure in figures(results).items():
        save(figure, arguments.out / name)
    for name, text in tables(results).items():
        print(f"\n{name}\n\n{text}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
