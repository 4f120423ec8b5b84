"""The machine for other people's simulators: MJCF for MuJoCo, URDF for Drake and others.

Both files describe the same planar tree. It has four joints with these names and coordinates, in
the ground's frame (x downhill along the ground, z normal to it)::

    hub_x      slide  hub from the first stance foot, along the ground (m)
    hub_z      slide  height of the hub less the leg length (m)
    wheel      hinge  phi - pi/2 + foot alpha, forward positive, with the wheel on leg `foot`
    pendulum   hinge  mount "wheel": the angle psi from the wheel, theta + wheel
                      mount "frame": theta, from a hub that does not turn

Positive theta swings the pendulum forward, so the pendulum's axis is opposite to the wheel's. At
zero the wheel stands upright on leg 0 and the pendulum hangs. `joint_state` converts states.

The hub itself is massless. MuJoCo wants every moving body to have a mass, so both files set a
least one, 1e-14 kg (and kg m^2), in place of zeros.

Neither format has air drag, idle power, losses that grow with the gear's torque or an impact law,
so the files leave them out. A touchdown
is what the other simulator's contact model makes of it; in the MJCF it is inelastic to about 1 %.
Feet are spheres, so small that rolling on them hardly matters. They touch when their centres reach
height 0. The pendulum touches nothing, as in our model.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rimless_gym.params import WheelParams

JOINTS = ("hub_x", "hub_z", "wheel", "pendulum")
FOOT_RADIUS = 1e-3  # in leg lengths
LEG_RADIUS, ROD_RADIUS = 0.02, 0.015  # for looks only, in leg lengths
LEAST = 1e-14  # kg and kg m^2: MuJoCo refuses zero
TIMESTEP = 5e-4  # s
CONTACT_TIME = 2e-3  # s, time constant of MuJoCo's contacts


def joint_state(
    params: WheelParams, x: ArrayLike, foot: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions and rates of the four joints for a wheel that stands on leg number `foot`.

    Args:
        params: the machine.
        x: (..., 4) states (phi, theta, phi', theta') in rad and rad/s.
        foot: legs forward of the first stance foot.

    Returns:
        Positions (..., 4) and rates (..., 4), in the order of `JOINTS`.
    """
    phi, theta, dphi, dtheta = np.moveaxis(np.asarray(x, dtype=np.float64), -1, 0)
    length, relative = params.leg_length, params.constants.d1
    wheel = phi - math.pi / 2 + foot * params.leg_angle
    hub_x = foot * params.step_length - length * np.cos(phi)
    hub_z = length * (np.sin(phi) - 1)
    rates = (length * np.sin(phi) * dphi, length * np.cos(phi) * dphi, dphi)
    return (
        np.stack([hub_x, hub_z, wheel, theta + relative * wheel], axis=-1),
        np.stack([*rates, dtheta + relative * dphi], axis=-1),
    )


def _text(*values: float) -> str:
    """Numbers as XML text that reads back as exactly the same floats."""
    return " ".join(repr(float(value)) for value in values)


def _feet(params: WheelParams) -> list[str]:
    """Positions of the feet from the hub as XML text; leg 0 is down, leg 1 the next one ahead."""
    angles = params.leg_angle * np.arange(params.n_legs)
    length = params.leg_length
    return [_text(length * math.sin(k), 0, -length * math.cos(k)) for k in angles]


def to_mjcf(params: WheelParams) -> str:
    """The wheel as an MJCF document for MuJoCo.

    The control of its one actuator is the motor voltage (V), limited to ``voltage_limit``; its
    gear is K / Rm with K = motor_constant * gear_ratio. The pendulum joint's damping is back-EMF,
    K^2 / Rm, plus hub damping, its armature is the rotor inertia, and its friction loss is the
    hub's dry friction. With a motor constant of 0 there is no actuator. The ground is level in the
    file; gravity is tilted by the slope. Foot k has the site ``foot{k}``.
    Keyframe ``rest`` is the wheel at rest on feet 0 and n - 1 with the pendulum hanging. Drake
    reads the file too, but takes the actuator's control as torque at the hub (N m). See
    `rimless_gym.export` for the coordinates.
    """
    c, length = params.constants, params.leg_length
    volt = c.K / c.Rm
    legs = "\n".join(
        f"""\
        <geom class="look" fromto="0 0 0 {foot}" size="{_text(LEG_RADIUS * length)}"/>
        <geom class="foot" name="foot{k}" pos="{foot}"/>
        <site name="foot{k}" pos="{foot}" size="{_text(LEG_RADIUS * length)}"/>"""
        for k, foot in enumerate(_feet(params))
    )
    pendulum = f"""\
        <body name="pendulum">
          <joint name="pendulum" type="hinge" axis="0 -1 0" armature="{_text(c.Jr)}" \
damping="{_text(c.damping + c.K * volt)}" frictionloss="{_text(c.F0)}" \
solreffriction="{2 * TIMESTEP} 1"/>
          <inertial pos="{_text(0, 0, -c.L2)}" mass="{_text(c.m2)}" \
diaginertia="{_planar_inertia(params.pendulum_inertia)}"/>
          <geom class="look" type="cylinder" fromto="0 0 0 0 0 {_text(min(-c.reach, -1e-3))}" \
size="{_text(ROD_RADIUS * length)}" rgba="0.8 0.3 0.2 1"/>
        </body>"""
    inner, outer = (pendulum, "") if params.motor_mount == "wheel" else ("", pendulum)
    motor = f"""\
    <motor name="motor" joint="pendulum" gear="{_text(volt)}" ctrllimited="true" \
ctrlrange="{_text(-params.voltage_limit, params.voltage_limit)}"/>"""
    rest, _ = joint_state(params, [c.a, params.slope, 0, 0])
    friction = _text(params.friction, 0, 0)
    return f"""\
<mujoco model="rimless_wheel">
  <compiler angle="radian" boundmass="{LEAST}" boundinertia="{LEAST}"/>
  <option gravity="{_text(c.gx, 0, -c.gy)}" \
timestep="{TIMESTEP}" integrator="implicitfast" cone="elliptic" impratio="100"/>
  <default>
    <geom contype="0" conaffinity="0"/>
    <default class="look">
      <geom type="capsule" group="1" rgba="0.3 0.4 0.6 1"/>
    </default>
    <default class="foot">
      <geom type="sphere" size="{_text(FOOT_RADIUS * length)}" contype="1" friction="{friction}" \
solref="{CONTACT_TIME} 1"/>
    </default>
  </default>
  <worldbody>
    <light pos="0 0 5" mode="trackcom"/>
    <geom name="ground" type="plane" pos="{_text(0, 0, -FOOT_RADIUS * length)}" size="0 0 1" \
conaffinity="1" friction="{friction}" solref="{CONTACT_TIME} 1" rgba="0.9 0.9 0.9 1"/>
    <body name="hub" pos="{_text(0, 0, length)}">
      <joint name="hub_x" type="slide" axis="1 0 0"/>
      <joint name="hub_z" type="slide" axis="0 0 1"/>
      <body name="wheel">
        <joint name="wheel" type="hinge" axis="0 1 0"/>
        <inertial pos="0 0 0" mass="{_text(c.m1)}" diaginertia="{_planar_inertia(c.I1)}"/>
{legs}
{inner}
      </body>
{outer}
    </body>
  </worldbody>
  <actuator>
{motor if volt > 0 else ""}
  </actuator>
  <keyframe>
    <key name="rest" qpos="{_text(*rest)}"/>
  </keyframe>
</mujoco>
"""


def _planar_inertia(inertia: float) -> str:
    """Principal moments of a plane body; only the middle one, about y, ever matters."""
    return _text(inertia / 2, inertia, inertia / 2)


def to_urdf(params: WheelParams) -> str:
    """The wheel as a URDF document, with Drake's elements for rotor inertia and friction.

    The effort of its one actuator is torque at the hub (N m): volts times K / Rm, with
    K = motor_constant * gear_ratio. The damping of the joint ``pendulum`` is back-EMF, K^2 / Rm,
    plus hub damping; its friction is the hub's dry friction, which Drake does not use. The
    slope is a fixed joint between world and ground, so gravity stays vertical; set its
    magnitude (``params.gravity``) in the simulator. MuJoCo reads the file too, without rotor
    inertia and actuator. See `rimless_gym.export` for the coordinates.
    """
    c, length = params.constants, params.leg_length
    volt = c.K / c.Rm
    foot_radius = _text(FOOT_RADIUS * length)
    contact = f"""<drake:proximity_properties>
        <drake:mu_static value="{_text(params.friction)}"/>
        <drake:mu_dynamic value="{_text(params.friction)}"/>
      </drake:proximity_properties>"""
    feet = "\n".join(
        f"""\
    <collision name="foot{k}">
      <origin xyz="{foot}"/>
      <geometry><sphere radius="{foot_radius}"/></geometry>
      {contact}
    </collision>"""
        for k, foot in enumerate(_feet(params))
    )
    legs = "\n".join(
        f"""\
    <visual>
      <origin xyz="{_text(*(0.5 * float(value) for value in foot.split()))}" \
rpy="{_text(0, -k * params.leg_angle, 0)}"/>
      <geometry>
        <cylinder radius="{_text(LEG_RADIUS * length)}" length="{_text(length)}"/>
      </geometry>
    </visual>"""
        for k, foot in enumerate(_feet(params))
    )
    parent = "wheel" if params.motor_mount == "wheel" else "hub"
    return f"""\
<?xml version="1.0"?>
<robot name="rimless_wheel" xmlns:drake="http://drake.mit.edu">
  <mujoco>
    <compiler boundmass="{LEAST}" boundinertia="{LEAST}"/>
  </mujoco>
  <link name="world"/>
  <link name="ground">
    <collision name="ground">
      <origin xyz="{_text(0, 0, -0.05 - FOOT_RADIUS * length)}"/>
      <geometry><box size="100 2 0.1"/></geometry>
      {contact}
    </collision>
  </link>
  <link name="rail"/>
  <link name="hub"/>
  <link name="wheel">
    {_urdf_inertial(0.0, c.m1, c.I1)}
{legs}
{feet}
  </link>
  <link name="pendulum">
    {_urdf_inertial(-c.L2, c.m2, params.pendulum_inertia)}
    <visual>
      <origin xyz="{_text(0, 0, -0.5 * c.reach)}"/>
      <geometry><cylinder radius="{_text(ROD_RADIUS * length)}" \
length="{_text(max(c.reach, 1e-3))}"/></geometry>
    </visual>
  </link>
  <joint name="slope" type="fixed">
    <parent link="world"/>
    <child link="ground"/>
    <origin rpy="{_text(0, params.slope, 0)}"/>
  </joint>
  <joint name="hub_x" type="prismatic">
    <parent link="ground"/>
    <child link="rail"/>
    <origin xyz="{_text(0, 0, length)}"/>
    <axis xyz="1 0 0"/>
    <limit lower="-1e6" upper="1e6" effort="0" velocity="1e6"/>
  </joint>
  <joint name="hub_z" type="prismatic">
    <parent link="rail"/>
    <child link="hub"/>
    <axis xyz="0 0 1"/>
    <limit lower="-1e6" upper="1e6" effort="0" velocity="1e6"/>
  </joint>
  <joint name="wheel" type="continuous">
    <parent link="hub"/>
    <child link="wheel"/>
    <axis xyz="0 1 0"/>
  </joint>
  <joint name="pendulum" type="continuous">
    <parent link="{parent}"/>
    <child link="pendulum"/>
    <axis xyz="0 -1 0"/>
    <limit effort="{_text(max(volt * params.voltage_limit, LEAST))}" velocity="1e6"/>
    <dynamics damping="{_text(c.damping + c.K * volt)}" friction="{_text(c.F0)}"/>
  </joint>
  <transmission name="motor">
    <type>transmission_interface/SimpleTransmission</type>
    <joint name="pendulum">
      <hardwareInterface>hardware_interface/EffortJointInterface</hardwareInterface>
    </joint>
    <actuator name="motor">
      <drake:rotor_inertia value="{_text(params.rotor_inertia)}"/>
      <drake:gear_ratio value="{_text(params.gear_ratio)}"/>
    </actuator>
  </transmission>
</robot>
"""


def _urdf_inertial(z: float, mass: float, inertia: float) -> str:
    side = _text(inertia / 2)
    return f"""<inertial>
      <origin xyz="{_text(0, 0, z)}"/>
      <mass value="{_text(mass)}"/>
      <inertia ixx="{side}" ixy="0" ixz="0" iyy="{_text(inertia)}" iyz="0" izz="{side}"/>
    </inertial>"""
