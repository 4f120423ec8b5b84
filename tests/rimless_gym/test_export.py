"""The exported files: they load, their joints mean what is documented, and they walk."""

import itertools
import math
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import pytest

from rimless_gym import simulate
from rimless_gym.energy import ROW
from rimless_gym.equations import DOUBLE
from rimless_gym.export import JOINTS, TIMESTEP, joint_state, to_mjcf, to_urdf
from rimless_gym.kernel.stepping import advance
from rimless_gym.presets import BUILDABLE, PRESETS, THESIS_PHYSICAL

BARE = THESIS_PHYSICAL.replace(
    n_legs=8, slope=0.08, wheel_inertia=0.0, pendulum_length=0.0, motor_constant=0.0, friction=5.0
)
LOSSY = THESIS_PHYSICAL.replace(
    rotor_inertia=3e-7, hub_damping=0.2, hub_friction=0.1, slope=-0.1, n_legs=3
)
MACHINES = {
    **PRESETS,
    "lossy": LOSSY,
    "frame mount": LOSSY.replace(motor_mount="frame"),
    "bare": BARE,
    "massless wheel": THESIS_PHYSICAL.replace(wheel_mass=0.0),
    "no motor": THESIS_PHYSICAL.replace(motor_constant=0.0, rotor_inertia=1e-7),
}


@pytest.fixture(params=MACHINES.values(), ids=MACHINES)
def params(request):
    return request.param


def load(text: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(text)


@pytest.mark.parametrize("export", [to_mjcf, to_urdf])
def test_files_load_in_mujoco_with_the_machines_joints_and_mass(params, export):
    model = load(export(params))
    assert tuple(model.joint(i).name for i in range(model.njnt)) == JOINTS
    assert sum(model.body_mass) == pytest.approx(params.total_mass, rel=1e-13)
    assert model.nu == (export is to_mjcf and params.motor_constant > 0)


def test_both_files_describe_the_same_machine(params):
    """Except for rotor inertia, which MuJoCo does not read from URDF.

    A wheel without inertia has no accelerations to compare while it is in the air.
    """
    params = params.replace(rotor_inertia=0.0, wheel_inertia=max(params.wheel_inertia, 0.01))
    models = [load(export(params)) for export in (to_mjcf, to_urdf)]
    rng = np.random.default_rng(0)
    for q, v in rng.uniform(-3, 3, (20, 2, 4)):
        accelerations = []
        for model in models:
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
            data = mujoco.MjData(model)
            data.qpos[:], data.qvel[:] = q, v
            if model is models[1]:  # there the ground is tilted, not gravity
                model.opt.gravity[:] = [0, 0, -params.gravity]
            mujoco.mj_forward(model, data)
            accelerations.append(data.qacc)
        np.testing.assert_allclose(*accelerations, rtol=1e-9, atol=1e-9)


def test_every_foot_it_stands_on_is_at_rest_on_the_ground(params, free_wheel):
    wheel, rng = free_wheel(params), np.random.default_rng(1)
    p = params.constants
    for foot, _ in itertools.product((-4, -1, 0, 1, 2, 9), range(5)):
        x = rng.uniform([p.a, -7, -6, -12], [p.b, 7, 6, 12])
        q, v = joint_state(params, x, foot)
        wheel.move(q, v)
        assert wheel.foot(foot) == pytest.approx([foot * params.step_length, 0], abs=1e-14)
        assert wheel.jacobian(foot) @ v == pytest.approx([0, 0], abs=1e-13)
        rod = wheel.data.xipos[wheel.model.body("pendulum").id] - wheel.data.xpos[wheel.wheel]
        hanging = np.array([math.sin(x[1]), 0, -math.cos(x[1])])
        assert rod == pytest.approx(params.pendulum_length * hanging, abs=1e-14)


def test_keyframe_stands_on_two_feet_and_stays():
    params = THESIS_PHYSICAL.replace(n_legs=7)
    model = load(to_mjcf(params))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("rest").id)
    height = data.qpos[1]
    mujoco.mj_step(model, data, 2000)
    assert data.ncon == 2
    assert data.qpos[1] == pytest.approx(height, abs=1e-4)
    assert abs(data.qvel).max() < 1e-6


def test_dry_friction_stops_the_pendulum_where_it_stops_in_mujoco():
    params = THESIS_PHYSICAL.replace(
        motor_constant=0.0, hub_friction=0.4, friction_width=1e-3, pendulum_mass=0.5
    )
    model = load(to_mjcf(params))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("rest").id)
    angle = data.qpos[3]
    data.qpos[3] += 0.9
    state = np.array([[params.constants.a, 0.9, 0.0, 0.0, DOUBLE, 0.0]])
    theirs, ours = [], []
    for _ in range(400):
        mujoco.mj_step(model, data, round(0.01 / TIMESTEP))
        advance(params, state, np.zeros(1))
        theirs.append(data.qpos[3] - angle)
        ours.append(state[0, 1])
    assert state[0, 4] == DOUBLE
    assert abs(ours[-1] - ours[-20]) < 1e-3  # it stands
    assert np.abs(np.subtract(theirs, ours)).max() < 0.01


def test_a_driven_pendulum_with_losses_swings_as_in_mujoco():
    """The default machine, but for what the gear loses under load, which MuJoCo does not have."""
    params = BUILDABLE.replace(gear_loss=0.0, friction_width=1e-2, hub_damping=0.02)
    model, p = load(to_mjcf(params)), params.constants
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("rest").id)
    angle = data.qpos[3]
    state = np.array([[p.a, 0.0, 0.0, 0.0, DOUBLE, 0.0]])
    stall = 0.3 * p.S2 * p.gy * p.Rm / p.K  # V: the motor holds the pendulum 0.3 rad up
    theirs, ours, friction = [], [], 0.0
    for k in range(300):
        data.ctrl[0] = stall * math.sin(0.06 * k)
        mujoco.mj_step(model, data, round(0.01 / TIMESTEP))
        friction += advance(params, state, data.ctrl.copy())[0, ROW.friction]
        theirs.append(data.qpos[3] - angle)
        ours.append(state[0, 1])
        assert state[0, 4] == DOUBLE
    assert np.ptp(ours) > 0.3
    assert friction > 0.01
    assert np.abs(np.subtract(theirs, ours)).max() < 0.003 * np.ptp(ours)


def test_urdf_contains_what_mujoco_does_not_read():
    root = ElementTree.fromstring(to_urdf(LOSSY))
    drake = "{http://drake.mit.edu}"
    read = {name: root.find(f".//{drake}{name}") for name in ("rotor_inertia", "gear_ratio")}
    assert {name: float(element.get("value")) for name, element in read.items()} == {
        "rotor_inertia": LOSSY.rotor_inertia,
        "gear_ratio": LOSSY.gear_ratio,
    }


def test_exported_wheel_rolls_down_a_slope_in_mujoco_as_it_does_here():
    """MuJoCo's own contacts are compliant, and its feet have a radius."""
    params = BARE.replace(wheel_inertia=0.05)
    model = load(to_mjcf(params))
    data = mujoco.MjData(model)
    start = [params.constants.a, params.slope, 2.0, 0.0]
    data.qpos[:], data.qvel[:] = joint_state(params, start)
    duration = 3.0
    mujoco.mj_step(model, data, round(duration / model.opt.timestep))
    ours = simulate(params, start, lambda t, x: 0.0, duration)
    q, _ = joint_state(params, ours.x[-1], ours.foot[-1])
    assert ours.steps == 5
    assert data.qpos[2] == pytest.approx(q[2], rel=0.02)
