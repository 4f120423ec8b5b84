"""The model against MuJoCo: motion, ground reaction and touchdown of a machine free of the ground.

MuJoCo computes inertia, forces and Jacobians of the feet for the floating machine that
`rimless_gym.export` writes (x, z and two angles). The tests pin or stop its foot with nothing but
linear algebra.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from rimless_gym.equations import DOUBLE, equations
from rimless_gym.export import joint_state
from rimless_gym.hybrid import after_touchdown
from rimless_gym.params import WheelParams
from rimless_gym.presets import PRESETS, THESIS_PHYSICAL
from rimless_gym.symbolic import HybridModel

number = equations(math.sin, math.cos)
N_STATES = 200
EXACT = 1e-9  # rad/s: MuJoCo's dry friction has no width
LOSSES = {
    "rotor_inertia": 3e-7,
    "hub_damping": 0.2,
    "drag": 0.5,
    "hub_friction": 0.4,
    "gear_loss": 0.3,
}
EXTRAS = {
    "plain": {"n_legs": 5},
    "downhill, every loss": LOSSES | {"slope": 0.15, "n_legs": 8},
    "uphill, every loss, frame mount": LOSSES
    | {"slope": -0.2, "motor_mount": "frame", "n_legs": 4},
}
CASES = {
    f"{name}, {extra}": machine.replace(friction_width=EXACT, **changes)
    for name, machine in PRESETS.items()
    for extra, changes in EXTRAS.items()
}


@pytest.fixture(scope="module", params=CASES.values(), ids=CASES)
def params(request):
    return request.param


@pytest.fixture(scope="module")
def wheel(params, free_wheel):
    return free_wheel(params)


def random_states(params: WheelParams, count: int = N_STATES) -> tuple[np.ndarray, np.ndarray]:
    rng, p = np.random.default_rng(params.n_legs), params.constants
    x = rng.uniform([p.a, -7, -6, -12], [p.b, 7, 6, 12], (count, 4))
    return x, rng.uniform(-params.voltage_limit, params.voltage_limit, count)


def dry_friction(params: WheelParams, v: np.ndarray, u: np.ndarray, psi: np.ndarray) -> np.ndarray:
    """Size of the dry friction at joint rates v, volts u and the pendulum joint's acceleration.

    MuJoCo is given it, because in MuJoCo the friction does not depend on what the gear transmits.
    It is right only if MuJoCo then finds that same acceleration.
    """
    motor = params.motor_constant * params.gear_ratio
    torque = motor * (u - motor * v[:, 3]) / params.armature_resistance
    rotor = params.rotor_inertia * params.gear_ratio**2
    return np.hypot(params.hub_friction, params.gear_loss * (torque - rotor * psi))


def transposed(matrices: np.ndarray) -> np.ndarray:
    return np.swapaxes(matrices, -1, -2)


def rolled(params: WheelParams, jacobian: np.ndarray) -> np.ndarray:
    """Joint rates per (phi', theta') that keep one foot still, from its Jacobian: (..., 4, 2)."""
    assert np.allclose(jacobian[..., :2], np.eye(2), atol=1e-15)
    angles = np.array([[1, 0], [params.constants.d1, 1]])  # wheel and pendulum joints
    top = -jacobian[..., 2:] @ angles
    return np.concatenate([top, np.broadcast_to(angles, top.shape)], axis=-2)


def pinned(params: WheelParams, free: SimpleNamespace, v: np.ndarray) -> SimpleNamespace:
    """Accelerations (phi'', theta'') and ground reaction of the machine pinned at its foot."""
    shapes = rolled(params, free.jacobian)
    drift = np.zeros_like(v)
    drift[:, :2] = -np.einsum("nij,nj->ni", free.jacobian_rate, v)
    inertia = transposed(shapes) @ free.inertia @ shapes
    right = free.force - np.einsum("nij,nj->ni", free.inertia, drift)
    generalised = transposed(shapes) @ right[..., None]
    accelerations = np.linalg.solve(inertia, generalised)
    joints = (shapes @ accelerations)[..., 0] + drift
    pull = np.einsum("nij,nj->ni", free.inertia, joints) - free.force
    return SimpleNamespace(
        accelerations=accelerations[..., 0],
        reaction=pull[:, :2],
        condition=np.linalg.cond(inertia),
    )


def stopped(inertia: np.ndarray, jacobian: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Joint rates after the feet of `jacobian` have come to rest: M v+ = M v- + J' impulse."""
    rank = np.linalg.matrix_rank(jacobian[0])
    shapes = transposed(np.linalg.svd(jacobian)[2][:, rank:])
    momentum = transposed(shapes) @ inertia @ v[..., None]
    return (shapes @ np.linalg.solve(transposed(shapes) @ inertia @ shapes, momentum))[..., 0]


def impulses(inertia: np.ndarray, jacobian: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The smallest impulses on the feet that cause a change of rates; they must explain it all."""
    pushes = np.linalg.pinv(transposed(jacobian)) @ inertia @ change[..., None]
    assert np.allclose(transposed(jacobian) @ pushes, inertia @ change[..., None], atol=1e-9)
    return pushes[..., 0]


def test_accelerations_and_ground_reaction_agree_with_mujoco(params, wheel):
    x, u = random_states(params)
    q, v = joint_state(params, x)
    model = HybridModel(params)
    ours = np.asarray(model.flow(x.T, u[None])).T[:, 2:]
    friction = dry_friction(params, v, u, ours[:, 1] + params.constants.d1 * ours[:, 0])
    theirs = pinned(params, wheel.stack(q, v, u, friction=friction), v)
    force = np.asarray(model.ground_reaction(x.T, u[None])).T
    size = np.linalg.norm(theirs.accelerations, axis=1)
    miss = np.linalg.norm(ours - theirs.accelerations, axis=1) / size
    force_size = params.weight + np.linalg.norm(theirs.reaction, axis=1)
    force_miss = np.linalg.norm(force - theirs.reaction, axis=1) / force_size
    assert np.max(miss / theirs.condition) <= 1e-12
    assert np.max(force_miss / theirs.condition) <= 1e-12


def test_each_foot_presses_in_double_stance_as_in_mujoco(params, wheel):
    x, u = random_states(params)
    x[:, 0], x[:, 2] = params.constants.a, 0.0
    q, v = joint_state(params, x)
    model = HybridModel(params)
    spin = np.asarray(model.flow(x.T, u[None], "double_stance"))[3]
    friction = dry_friction(params, v, u, spin)
    free = wheel.stack(q, v, u, feet=(0, -1), friction=friction)
    joints = np.zeros_like(v)
    joints[:, 3] = free.force[:, 3] / free.inertia[:, 3, 3]
    missing = np.einsum("nij,nj->ni", free.inertia, joints) - free.force
    feet = impulses(np.broadcast_to(np.eye(4), free.inertia.shape), free.jacobian, missing)
    force = np.asarray(model.ground_reaction(x.T, u[None], "double_stance")).T
    size = params.weight + np.linalg.norm(missing, axis=1)
    assert np.max(abs(spin - joints[:, 3]) / (1 + abs(joints[:, 3]))) <= 1e-12
    assert np.max(abs(force - feet[:, :2] - feet[:, 2:]) / size[:, None]) <= 1e-12
    guards = np.asarray(model.functions["lift_off_guards"](x.T, u[None]))
    certain = abs(feet[:, 1::2]) > 1e-9 * size[:, None]  # normal force of the leading, trailing
    assert np.all(((guards[1] > 0) == (feet[:, 1] > 0)) | ~certain[:, 0])
    assert np.all(((guards[0] < 0) == (feet[:, 3] > 0)) | ~certain[:, 1])


@pytest.mark.parametrize("direction", [1, -1])
def test_touchdown_stops_the_new_foot_as_in_mujoco(params, wheel, direction):
    p = params.constants
    old, new = (p.b, p.a) if direction > 0 else (p.a, p.b)
    x, u = random_states(params)
    x[:, 0], x[:, 2] = old, direction * abs(x[:, 2])
    q, v = joint_state(params, x)
    free = wheel.stack(q, v, u, feet=(direction,))
    after = stopped(free.inertia, free.jacobian, v)
    push = impulses(free.inertia, free.jacobian, after - v)
    rates = np.array([number.impact(new, old, *row[1:], p) for row in x])
    before = np.array([number.linear_momentum(*row, p) for row in x])
    landed = np.column_stack([np.full(len(x), new), x[:, 1], rates])
    jump = np.array([number.linear_momentum(*row, p) for row in landed]) - before
    _, ours = joint_state(params, landed, direction)
    size = np.linalg.norm(v, axis=1)
    scale = np.linalg.norm(push, axis=1) + params.total_mass * params.leg_length * size
    assert np.max(np.linalg.norm(ours - after, axis=1) / size) <= 1e-11
    assert np.max(np.linalg.norm(jump - push, axis=1) / scale) <= 1e-11
    if direction > 0:
        smooth = np.asarray(HybridModel(params).touchdown(x.T)).T
        np.testing.assert_allclose(smooth, landed, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("n_legs", [3, 5])
@pytest.mark.parametrize("mount", ["wheel", "frame"])
def test_the_wheel_stops_on_two_feet_if_the_old_foot_cannot_lift_off(
    free_wheel, mount, n_legs, direction
):
    """Complementarity: after a touchdown the old foot moves away, or it is pushed, but not both.

    Our wheel may rest where it would creep away with less energy than `hybrid.REST_ENERGY`.
    """
    params = THESIS_PHYSICAL.replace(n_legs=n_legs, motor_mount=mount, rotor_inertia=1e-7)
    p = params.constants
    x, u = random_states(params)
    x[:, 0], x[:, 2] = p.b if direction > 0 else p.a, direction * abs(x[:, 2])
    q, v = joint_state(params, x)
    free = free_wheel(params).stack(q, v, u, feet=(direction, 0))
    rolling = stopped(free.inertia, free.jacobian[:, :2], v)
    rising = np.einsum("nij,nj->ni", free.jacobian[:, 2:], rolling)[:, 1]
    standing = stopped(free.inertia, free.jacobian, v)
    pushes = impulses(free.inertia, free.jacobian, standing - v)
    certain = np.abs(rising) > 1e-9
    assert np.array_equal((rising > 0)[certain], (pushes[:, 3] < 0)[certain])
    ours = [after_touchdown(direction, *row[1:], volts, p) for row, volts in zip(x, u, strict=True)]
    stays = np.array([landing.mode == DOUBLE for landing in ours])
    creeping = (rising > 0) & (rising < 5e-4)
    assert np.array_equal(stays | creeping, (rising <= 0) | creeping)
    assert np.all(pushes[stays, 1] > 0)
    spin = np.array([landing.dtheta for landing in ours])
    assert spin[stays] == pytest.approx(standing[stays, 3], rel=1e-11, abs=1e-11)
