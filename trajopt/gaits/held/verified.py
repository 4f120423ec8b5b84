"""Verification of a held gait: by both simulators."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from rimless_gym.hybrid import CONTROL_PERIOD
from trajopt.gaits.held.replay import Held, Replay
from trajopt.gaits.playback import played
from trajopt.gaits.verify import AUDIT_TOLERANCE, STATE_TOLERANCE, Verification, verify
from trajopt.ocp.trajectory import PhaseTrajectory

#: Largest residual of the kernel's ledger over a stride (J).
LEDGER_TOLERANCE = 1e-9

#: By what fraction the simulators' E+ may differ. An optimal voltage is held such that the current
#: just reaches zero within an interval, where the kernel finds the zero to fewer digits.
SAME_ENERGY = 1e-4


def verified(held: Held, replay: Replay, phases: Sequence[PhaseTrajectory]) -> Verification:
    """What the reference simulator says about a gait, with the energies of the stepping kernel.

    Args:
        held: the stride under its clock.
        replay: the same on the kernel.
        phases: the same from touchdown to touchdown.
    """
    intervals = held.hold / CONTROL_PERIOD
    own: tuple[float, str] | None = None
    if math.isclose(intervals, round(intervals), abs_tol=1e-9):
        own = replay.ledger.cost_of_transport(held.params), ""
    reference = verify(held.params, phases, held.theta_turns, own)
    ledger = replay.ledger
    repeat = float(np.abs(replay.states[-1] - replay.states[0] - held.shift).max())
    twin = played(held.params, phases, len(held.voltages) * held.hold).ledger
    audit = abs(twin.energy_with_regeneration - ledger.energy_with_regeneration)
    positive = abs(twin.energy - ledger.energy)
    checks = [
        (repeat <= STATE_TOLERANCE, "the kernel does not repeat the stride"),
        (abs(ledger.residual) <= LEDGER_TOLERANCE, "the kernel's ledger does not close"),
        (
            audit <= AUDIT_TOLERANCE and positive <= SAME_ENERGY * ledger.energy + AUDIT_TOLERANCE,
            "the two simulators differ in energy",
        ),
    ]
    return dataclasses.replace(
        reference,
        energy_audit=max(reference.energy_audit, audit),
        electrical_positive=ledger.energy,
        electrical=ledger.energy_with_regeneration,
        repeat_error=repeat,
        repeat_residual=abs(ledger.residual),
        failures=(*reference.failures, *(message for good, message in checks if not good)),
    )
