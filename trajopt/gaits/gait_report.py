"""What a solved gait's report says: its figures as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from trajopt.gaits.solution import Solution

#: A gait that costs this many times an optimum of the search, whose mesh is coarse, is clearly
#: dearer.
CLEARLY_DEARER = 1.05


def report(gait: Solution) -> str:
    """The gait's figures as text; failures in capitals."""
    v = gait.verification
    verdict = "passed" if v.passed else "FAILED: " + "; ".join(v.failures)
    hold = f"{v.cot_at_100hz_hold:.4f}" if not v.hold_failure else f"none ({v.hold_failure})"
    demand, impulse = v.max_friction_demand, v.max_impulse_friction_demand
    lines = [
        f"Periodic gait, {gait.steps} step(s) per stride at {gait.speed:.4f} m/s{_held(gait)}",
        f"  verification            {verdict}",
        f"  cost of transport       {gait.cot:.6f} at {gait.speed:.4f} m/s (with regeneration "
        f"{gait.cot_with_regeneration:.6f})",
        f"  energy of a stride      {gait.cost:.6f} J"
        f" ({'E, with' if gait.regeneration else 'E+, no'} regeneration)",
        f"  times of touchdown      {', '.join(f'{t:.6f}' for t in gait.phase_times[1:])} s",
        f"  turns of theta          {gait.theta_turns} per stride",
        f"  peak voltage            {v.peak_voltage:.3f} of {gait.params.voltage_limit:g} V",
        f"  least normal force      {v.min_normal_force:.3f} N, "
        f"{v.min_normal_force_over_weight:.4f} of the weight",
        f"  friction demand         {demand:.4f} in stance, {impulse:.4f} at touchdown "
        f"(ground offers {gait.params.friction:g})",
        f"  pendulum's clearance    {v.clearance:.3f} m",
        f"  re-simulated state      off by {v.state_error:.1e} (a stride), "
        f"{v.phase_state_error:.1e} (a phase)",
        f"  energy audit            off by {v.energy_audit:.1e} J",
        f"  CoT if held for 10 ms   {hold}",
        f"  mesh error              {gait.optimality.mesh_error:.1e}",
        *_certainty(gait),
        f"  Floquet, open loop      {', '.join(f'{abs(m):.3g}' for m in gait.floquet)}",
    ]
    for o in gait.optima:
        turns = f"{o.theta_turns} turn(s)"
        lines.append(f"  optimum met             CoT {o.cot:.4f}, {turns}, {o.found} time(s)")
    return "\n".join([*lines, *_doubt(gait)])


def _doubt(gait: Solution) -> list[str]:
    """A warning if the search has met a clearly cheaper optimum that did not become a gait."""
    cheapest = min((o.cot for o in gait.optima), default=gait.cot)
    if CLEARLY_DEARER * cheapest >= gait.cot:
        return []
    return [
        f"  A CHEAPER ONE WAS MET   CoT {cheapest:.4f}, but it did not become a verified "
        "gait; try more starts, another seed, or a guess"
    ]


def _held(gait: Solution) -> str:
    """What a report's heading says of the clock."""
    if gait.hold is None:
        return ""
    ticks = round(gait.duration / gait.hold)
    return f", voltage held for {1e3 * gait.hold:g} ms ({ticks} intervals)"


def _certainty(gait: Solution) -> list[str]:
    """What a report says of optimality or, under a clock, of how the stride repeats itself."""
    v, o = gait.verification, gait.optimality
    if gait.hold is None:
        return [
            f"  Hamiltonian             spread {o.hamiltonian_spread:.1e}, "
            f"transversality {o.transversality_error:.1e}"
        ]
    return [
        f"  stepped on the kernel   repeats itself to {v.repeat_error:.1e}, "
        f"ledger off by {v.repeat_residual:.1e} J",
        f"  first tick              {gait.first_tick:.6f} s after the touchdown",
    ]
