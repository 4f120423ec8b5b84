"""The model against Drake: MultibodyPlant made from our URDF and MJCF."""

from __future__ import annotations

import numpy as np
import pytest

from rimless_gym.export import JOINTS, joint_state, to_mjcf, to_urdf
from rimless_gym.params import WheelParams
from rimless_gym.presets import PRESETS
from rimless_gym.symbolic import HybridModel

pytestmark = pytest.mark.peers
pytest.importorskip("pydrake")

from pydrake.multibody.parsing import Parser  # noqa: E402
from pydrake.multibody.plant import MultibodyPlant  # noqa: E402
from pydrake.multibody.tree import JacobianWrtVariable  # noqa: E402

FRICTIONLESS = {"hub_friction": 0.0, "gear_loss": 0.0}  # Drake's joints have no dry friction
LOSSES = {"rotor_inertia": 3e-7, "hub_damping": 0.2, "drag": 0.5}
EXTRAS = {
    "plain": {},
    "downhill, losses": LOSSES | {"slope": 0.15},
    "uphill, losses, frame mount": LOSSES | {"slope": -0.2, "motor_mount": "frame"},
}
CASES = {
    f"{name}, {n_legs} legs, {extra}": machine.replace(n_legs=n_legs, **FRICTIONLESS, **changes)
    for name, machine in PRESETS.items()
    for n_legs in (4, 5, 6, 8)
    for extra, changes in EXTRAS.items()
}
FILES = {"urdf": to_urdf, "xml": to_mjcf}


@pytest.fixture(scope="module", params=CASES.values(), ids=CASES)
def params(request):
    return request.param


def load(params: WheelParams, kind: str) -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(FILES[kind](params), kind)
    if kind == "urdf":
        plant.mutable_gravity_field().set_gravity_vector([0, 0, -params.gravity])
    plant.Finalize()
    return plant


class Free:
    """Inertia, forces and Jacobian of foot 0 of the floating machine, computed by Drake."""

    def __init__(self, params: WheelParams, kind: str) -> None:
        self.params, self.plant = params, load(params, kind)
        self.context = self.plant.CreateDefaultContext()
        self.ground = self.plant.world_frame()
        if kind == "urdf":
            self.ground = self.plant.GetFrameByName("ground")
        self.wheel = self.plant.GetFrameByName("wheel")
        self.damping = self.plant.GetJointByName("pendulum").default_damping()
        shaft = params.motor_constant * params.gear_ratio
        self.effort_per_volt = shaft / params.armature_resistance

    def at(self, q: np.ndarray, v: np.ndarray, u: float):
        plant, context = self.plant, self.context
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        inertia = plant.CalcMassMatrix(context)
        effort = plant.MakeActuationMatrix()[:, 0] * u * self.effort_per_volt
        gravity = plant.CalcGravityGeneralizedForces(context)
        force = effort + gravity - plant.CalcBiasTerm(context)
        force[3] -= self.damping * v[3]
        plant.get_actuation_input_port().FixValue(context, [u * self.effort_per_volt])
        flying = plant.get_generalized_acceleration_output_port().Eval(context)
        assert np.linalg.solve(inertia, force) == pytest.approx(flying, rel=1e-8, abs=1e-8)
        force[:2] -= self.params.drag * np.hypot(*v[:2]) * v[:2]
        foot = (JacobianWrtVariable.kV, self.wheel, [0, 0, -self.params.leg_length])
        frames = (self.ground, self.ground)
        jacobian = plant.CalcJacobianTranslationalVelocity(context, *foot, *frames)[::2]
        bias = plant.CalcBiasTranslationalAcceleration(context, *foot, *frames)[::2]
        return inertia, force, jacobian, bias


@pytest.mark.parametrize("kind", FILES)
def test_accelerations_and_ground_reaction_are_drakes(params, kind):
    free, rng, p = Free(params, kind), np.random.default_rng(params.n_legs), params.constants
    x = rng.uniform([p.a, -7, -6, -12], [p.b, 7, 6, 12], (1000, 4))
    u = rng.uniform(-params.voltage_limit, params.voltage_limit, 1000)
    q, v = joint_state(params, x)
    model = HybridModel(params)
    ours = np.asarray(model.flow(x.T, u[None])).T[:, 2:]
    forces = np.asarray(model.ground_reaction(x.T, u[None])).T
    for state, spin, reaction in zip(zip(q, v, u, strict=True), ours, forces, strict=True):
        inertia, force, jacobian, bias = free.at(*state)
        system = np.block([[inertia, -jacobian.T], [jacobian, np.zeros((2, 2))]])
        solution = np.linalg.solve(system, np.concatenate([force, -bias.ravel()]))
        theirs = solution[2:4] - [0, p.d1 * solution[2]]
        shapes = np.vstack([-jacobian[:, 2:], np.eye(2)]) @ [[1, 0], [p.d1, 1]]
        allowed = 1e-12 * np.linalg.cond(shapes.T @ inertia @ shapes)
        assert np.linalg.norm(spin - theirs) <= allowed * np.linalg.norm(theirs)
        size = params.weight + np.linalg.norm(solution[4:])
        assert np.linalg.norm(reaction - solution[4:]) <= allowed * size


@pytest.mark.parametrize("kind", FILES)
def test_files_load_in_drake_with_the_machines_joints_mass_and_motor(params, kind):
    plant = load(params, kind)
    context = plant.CreateDefaultContext()
    names = [plant.get_joint(index).name() for index in plant.GetJointIndices()]
    assert tuple(name for name in names if name in JOINTS) == JOINTS
    assert plant.num_positions() == 4
    assert plant.num_actuators() == 1
    assert plant.CalcTotalMass(context) == pytest.approx(params.total_mass, rel=1e-12)
