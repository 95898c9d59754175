"""A load in a hand is told from a push and from a failing motor by its weight and its inertia, in motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tasks as T
import wbc
from tasks.components.diagnosis import Diagnosis
from tasks.components.draft import Draft
from tasks.components.load import BLOCK, Load, LoadFit, LoadRegressor
from wbc.models.pinocchio_ import PinocchioModel
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.disturbance import Disturbance, Payload, Push, SensorNoise
from wbc.sim.simulate import simulate
from wbc.types import Vec

ARM, QUADRUPED = wbc.load("arm"), wbc.load("quadruped", base="floating")
TOOLS = {ARM: "tool", QUADRUPED: next(iter(QUADRUPED.feet.values())).frame}
ROBOTS = pytest.mark.parametrize("robot", [ARM, QUADRUPED], ids=["arm", "quadruped"])


def loaded(robot: PinocchioModel, load: Load) -> pin.Model:
    """The robot with the load in its hand, by Pinocchio."""
    model = robot.pinocchio.copy()
    frame = model.frames[robot.frames[load.frame]]
    body = pin.Inertia(load.mass, load.centre, np.zeros((3, 3)))
    model.inertias[frame.parentJoint] += frame.placement.act(body)
    return model


@ROBOTS
@settings(max_examples=max(15, settings.default.max_examples // 6))
@given(seed=st.integers(0, 9999))
def test_weight_and_inertia_are_the_difference_that_the_load_makes(robot: PinocchioModel, seed: int) -> None:
    rng = np.random.default_rng(seed)
    load = Load(TOOLS[robot], rng.uniform(0.1, 3.0), 0.2 * rng.standard_normal(3))
    q, still = robot.random_configuration(rng), np.zeros(robot.nv)
    state, model = robot.state(), loaded(robot, load)
    state.update(0.0, q, still)
    data = model.createData()
    pin.crba(model, data, q)
    M = np.triu(data.M) + np.triu(data.M, 1).T
    np.testing.assert_allclose(load.inertia(state), M - state.M, atol=1e-10)
    g = pin.computeGeneralizedGravity(model, data, q)
    np.testing.assert_allclose(load.weight(state), g - state.g, atol=1e-9)


def test_two_loads_weigh_and_resist_together() -> None:
    state, draft = ARM.state(), Draft(cast("Any", None))
    loads = [Load("tool", 1.0, np.array([0.0, 0.1, 0.0])), Load("forearm", 0.5, np.zeros(3))]
    for load in loads:
        carried = Diagnosis("payload", 0, ARM.joint_names[0], 0.0, 0.0, np.zeros(ARM.nj), load=load)
        T.Carry(T.MomentumObserver(gain=1.0)).hold(carried, state, draft)
    np.testing.assert_allclose(draft.bias, loads[0].weight(state) + loads[1].weight(state), atol=1e-12)
    np.testing.assert_allclose(draft.inertia, loads[0].inertia(state) + loads[1].inertia(state), atol=1e-12)


def along(robot: PinocchioModel, q: Vec, v: Vec, a: Vec, t: float) -> tuple[Vec, Vec]:
    """Where a motion of constant a is after time t, up to t³."""
    return robot.integrate(q, v * t + 0.5 * a * t**2), v + a * t


@ROBOTS
@settings(max_examples=max(25, settings.default.max_examples // 4))
@given(seed=st.integers(0, 9999))
def test_the_regressor_is_what_inverse_dynamics_asks_for_the_load(robot: PinocchioModel, seed: int) -> None:
    """From two states and no acceleration, up to the length of a tick, however far the load is from the frame."""
    rng, dt = np.random.default_rng(seed), 1e-5
    load = Load(TOOLS[robot], rng.uniform(0.1, 3.0), 0.2 * rng.standard_normal(3))
    q, (v, a) = robot.random_configuration(rng), rng.standard_normal((2, robot.nv))
    model, state, regressor = loaded(robot, load), robot.state(), LoadRegressor(load.frame)
    steps = []
    for t in (-0.5 * dt, 0.5 * dt):
        state.update(t, *along(robot, q, v, a, t))
        steps.append(regressor.step(state, dt))
    assert steps[0] is None and steps[1] is not None
    asked = pin.rnea(model, model.createData(), q, v, a)
    asked = asked - pin.rnea(robot.pinocchio, robot.pinocchio.createData(), q, v, a)
    assert np.abs(steps[1] @ load.parameters - asked).max() < 1e-3 * np.abs(asked).max()


def fitted(missing: object, *, ticks: int = 40 * BLOCK, moving: float = 1.0) -> Load | None:
    """What a fit says of an arm that moves along sines and misses ``missing(state, Y)`` (nj,) in each tick."""
    state, regressor = ARM.state(), LoadRegressor("tool")
    fit = LoadFit("tool", np.full(ARM.nj, 0.3), np.ones(ARM.nj))
    wave = T.Sinusoid(ARM.q0, amplitude=0.3 * moving, frequency=np.linspace(0.3, 0.6, ARM.nj))
    found = None
    for k in range(ticks):
        q, v, _ = wave(1e-3 * k)
        state.update(1e-3 * k, q, v)
        Y = regressor.step(state, 1e-3)
        fit.add(state, 1e-3, np.zeros(ARM.nj) if Y is None else missing(state, Y), None)  # type: ignore[operator]
        found = found or fit.load()
    return found


@settings(max_examples=max(4, settings.default.max_examples // 20))
@given(mass=st.floats(0.5, 4.0), x=st.floats(-0.15, 0.15), y=st.floats(-0.15, 0.15), z=st.floats(-0.15, 0.15))
def test_a_load_is_found_with_its_mass_and_its_centre(mass: float, x: float, y: float, z: float) -> None:
    load = Load("tool", mass, np.array([x, y, z]))
    found = fitted(lambda state, Y: Y @ load.parameters)
    assert found is not None
    assert found.mass == pytest.approx(mass, rel=1e-3)
    np.testing.assert_allclose(found.centre, load.centre, atol=1e-3)


def test_what_is_no_load_is_not_called_one() -> None:
    load = Load("tool", 2.0, np.zeros(3))

    def push(*force: float) -> object:
        return lambda state, Y: -state.frame("tool").jacobian()[:3].T @ np.array(force)

    def one(state: object, Y: object) -> Vec:
        return np.asarray(np.eye(ARM.nj)[1] * 8.0)

    assert fitted(push(0.0, 0.0, 20.0)) is None, "lifts"
    assert fitted(push(20.0, 0.0, 0.0)) is None, "pushes forward"
    assert fitted(lambda state, Y: -Y @ load.parameters) is None, "puts down what the model has"
    assert fitted(one) is None, "one joint alone"
    assert fitted(lambda state, Y: Y @ load.parameters, moving=0.0) is None, "at rest nobody can tell"
    assert fitted(lambda state, Y: np.zeros(ARM.nj)) is None, "nothing is missing"


class Carries(wbc.Component):
    """What :class:`Carry` says of a load, from the first tick on."""

    def __init__(self, load: Load, observer: T.MomentumObserver) -> None:
        super().__init__()
        self.carry, self.load = T.Carry(observer), load

    def before(self, state: Any, last: object, plan: Any) -> wbc.Overrides:
        found = Diagnosis("payload", 0, ARM.joint_names[0], 0.0, 0.0, np.zeros(ARM.nj), load=self.load)
        if last is None:
            self.carry.decide(found, state, plan)
        draft = Draft(plan)
        self.carry.hold(found, state, draft)
        return wbc.Overrides(bias=draft.bias, inertia=draft.inertia)


@settings(max_examples=max(3, settings.default.max_examples // 30))
@given(seed=st.integers(0, 9999))
def test_of_a_load_that_is_carried_nothing_is_missing(seed: int) -> None:
    """The observer and the dynamics mean the same load: no motion, however fast, looks like a failing motor."""
    rng, dt = np.random.default_rng(seed), 1e-3
    load = Load("tool", rng.uniform(1.0, 3.0), 0.1 * rng.standard_normal(3))
    observer, model = T.MomentumObserver(gain=100.0), loaded(ARM, load)
    stack = wbc.Stack([T.Posture(ARM.q0, kp=100)], components=[observer, Carries(load, observer)])
    controller = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    q, v, data = ARM.q0.copy(), rng.choice([-3.0, 3.0], ARM.nv), model.createData()
    missing = 0.0
    for k in range(100):
        tau = controller.tick(k * dt, q, v).tau
        missing = max(missing, np.abs(observer.residual).max())
        for _ in range(4):
            middle = v + 0.125 * dt * pin.aba(model, data, q, v, tau)
            a = pin.aba(model, data, q + 0.125 * dt * v, middle, tau)
            q, v = q + 0.25 * dt * middle, v + 0.25 * dt * a
    assert missing < 0.1


# ---- in a stack that runs
def waving(
    disturbances: Sequence[Disturbance], *, carries: bool = True, duration: float = 2.4, noise: float = 0.0
) -> tuple[wbc.Run, T.FaultReaction]:
    """Our arm waves in physics."""
    from wbc.sim.mujoco_ import MujocoPlant

    observer = T.MomentumObserver(gain=100.0, threshold=0.3 if not noise else 6.0, persistence=2, release=0.5)
    table = [T.When("external", [T.Comply(0.5)]), T.When("total", [T.Release()])]
    table += [T.When("payload", [T.Carry(observer)])] if carries else []
    reaction = T.FaultReaction(observer, table=table, start=0.1, hands=["tool"], noise=20.0 if noise else 0.0)
    wave = T.Sinusoid(ARM.q0, amplitude=0.3, frequency=np.linspace(0.3, 0.6, ARM.nj))
    stack = wbc.Stack(
        [T.Posture(wave, kp=100), reaction.limits], subject_to=[T.TorqueLimits(), T.JointPositionLimits()],
        components=[observer, reaction],
    )  # fmt: skip
    plant = MujocoPlant(ARM)
    plant.reset(ARM.q0)
    controller = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    sensors = [SensorNoise(velocity=noise)] if noise else []
    return simulate(controller, plant, duration=duration, disturbances=[*disturbances, *sensors]), reaction


@pytest.mark.physics
def test_a_load_that_was_taken_for_a_push_is_recognised_and_carried() -> None:
    load = Payload("tool", mass=2.0, start=0.5)
    run, reaction = waving([load])
    kinds = [d.kind for d, _ in reaction.events]
    assert kinds[0] == "external" and kinds[-1] == "payload"
    found = reaction.events[-1][0].load
    assert found is not None and found.mass == pytest.approx(2.0, abs=0.02)
    carried = round(reaction.events[-1][0].t * 1e3)
    assert not run["signal.MomentumObserver.residual"][carried].any(), "all residuals start anew"
    lost, _ = waving([load], carries=False)
    error, before = (np.abs(r["error.Posture"]).max(axis=1) for r in (run, lost))
    assert error[-200:].max() < 0.1 * before[-200:].max()
    residual = np.abs(run["signal.MomentumObserver.residual"])
    assert residual[-200:].max() < 0.1, "of what is carried nothing is missing any more"
    assert run["status"].max() == 0


@pytest.mark.physics
@pytest.mark.parametrize(
    "wrong",
    [
        Push("tool", (20.0, 0.0, 0.0), 0.5, 2.0),
        Push("tool", (0.0, 0.0, -20.0), 0.5, 0.3),
        ActuatorFault(joint=ARM.joint_names[1], effectiveness=0.6, start=0.5),
        ActuatorFault(joint=ARM.joint_names[3], start=0.5),
    ],
    ids=["push", "short push downwards", "weak motor", "dead motor"],
)
def test_pushes_and_failing_motors_are_not_called_loads(wrong: Disturbance) -> None:
    _, reaction = waving([wrong])
    kinds = {d.kind for d, _ in reaction.events}
    assert kinds and "payload" not in kinds


@pytest.mark.physics
def test_noise_hides_the_centre_before_it_hides_the_mass() -> None:
    _, reaction = waving([Payload("tool", mass=3.0, start=0.5)], noise=0.005)
    found = reaction.events[-1][0].load
    assert found is not None and found.mass == pytest.approx(3.0, abs=0.15)


@pytest.mark.physics
@pytest.mark.deep
def test_a_standing_humanoid_knows_in_which_hand_the_load_is() -> None:
    """On a base that floats, the feet's wrenches measured; the hand that draws a circle tells more than one at rest."""
    from tasks.scenarios.fault_trials import Stand, standing
    from tasks.scenarios.humanoid_stand import STANCES

    hands = ["left_hand", "right_hand"]
    observer = T.MomentumObserver(gain=100.0, threshold=0.3, persistence=2, release=0.5)
    reaction = T.FaultReaction(observer, table=[T.When("payload", [T.Carry(observer)])], hands=hands)
    setup = standing(
        Stand("humanoid", STANCES["humanoid"], 0.3), [observer, reaction], [reaction.limits], duration=4.0,
        disturbances=[Payload("left_hand", mass=1.0, start=1.0)],
    )  # fmt: skip
    run = setup.run(duration=4.0).run
    found = [d.load for d, _ in reaction.events if d.load is not None]
    assert [load.frame for load in found] == ["left_hand"]
    assert found[0].mass == pytest.approx(1.0, abs=0.05)
    assert np.abs(run["signal.MomentumObserver.residual"][-200:]).max() < 0.3
