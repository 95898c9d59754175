"""What makes no sense together is refused where it is said, by its name: one table for all but the library's members.

Numbers without sense in a single argument, and texts in their place, are in tests/reliability/walker.py; members of the
library in tests/tasks/test_refusals.py.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import tasks as T
import wbc
import wbc.robots
from wbc.control.watchdog import Watchdog
from wbc.errors import (
    Infeasible,
    InvalidInput,
    InvalidProblem,
    ModelError,
    NoClosedForm,
    NotSupported,
    SimulationError,
    UnknownFrame,
    UnknownJoint,
    UnknownName,
    UnknownRobot,
    UnknownSlot,
    UnknownSolver,
    WbcError,
)
from wbc.methods import (
    ContactEstimate,
    FaultFraction,
    ForceDistribution,
    MomentumResidual,
    NullSpaceSaturation,
    ParameterUpdate,
    ProjectedGradientStep,
    PseudoInertia,
    WeightedTorque,
)
from wbc.models import Planar4P, PlanarPR, load
from wbc.models.collision import Distances, Obstacle
from wbc.models.feet import Foot
from wbc.models.geometry import Sphere
from wbc.models.inertial_regressor import InertialRegressor
from wbc.models.lagrange import Chain
from wbc.models.pinocchio_ import PinocchioModel
from wbc.qp import QP, solve
from wbc.qp.problem import Row
from wbc.qp.solvers import Clarabel, Daqp, Osqp, Piqp, ProxQp, QpSolvers
from wbc.robots import SENSORS, BaseEstimator, EstimatedBase, JointMap, Loop, MotorBoard, Ros2Control, UnitreeGo2
from wbc.robots.device import Order
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.disturbance import Delay, Payload, Push, SensorNoise
from wbc.sim.drives import PositionDrives
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.plant import ForwardDynamicsPlant, IntegratorPlant
from wbc.sim.simulate import simulate
from wbc.stack.interval import JointIntervals

ARM, HUMANOID, QUADRUPED = (load(name) for name in ("arm", "humanoid", "quadruped"))
LEVEL, TORQUE = wbc.VelocityLevel(), wbc.InverseDynamics()
REACH = T.Position("tool", target=[0.4, 0.2, 0.5])
ONE, EYE, ZEROS = [[1.0]], np.eye(2), np.zeros(3)
PR = PlanarPR(m1=1.0, m2=1.0, l2=0.5, d2=0.25, I2=0.1)
LEGS, SLOTS = ("left_hip", "left_knee", "right_hip", "right_knee"), ("m0", "m1", "m2", "m3")
FEET = list(QUADRUPED.feet)


def controller(*tasks: Any, on: Any = ARM, level: Any = LEVEL, **settings: Any) -> wbc.Controller:
    names = {name: settings.pop(name) for name in ("subject_to", "contacts", "components") if name in settings}
    return wbc.Controller(on, wbc.Stack(list(tasks) or [T.Posture(on.q0)], **names), level=level, **settings)


def physics(*given: Any, **settings: Any) -> MujocoPlant:
    pytest.importorskip("mujoco", reason="the extra `sim`")
    return MujocoPlant(*given, **settings)


def ball(name: str) -> Obstacle:
    return Obstacle(name, Sphere(0.1), pin.SE3.Identity())


def board(**settings: Any) -> MotorBoard:
    return MotorBoard(Ros2Control(ARM.joint_names, rate=500.0), physics(ARM), **settings)


def loop(**settings: Any) -> Loop:
    device = board()
    return Loop(device, controller(level=TORQUE, dt=2e-3), **settings)


def environment(**other: Any) -> object:
    pytest.importorskip("gymnasium", reason='needs the extra "gym"')
    driven, plant = controller(REACH, dt=2e-3), IntegratorPlant(ARM, level="velocity", dt=2e-3)
    bounds = [(REACH, ZEROS, np.ones(3))]
    given = {"plant": plant, "targets": bounds, "reward": lambda env: 0.0, "duration": 0.4} | other
    return wbc.robots.TargetEnv(driven, given.pop("plant"), given.pop("targets"), **given)


def with_base(norm: float) -> Any:
    return HUMANOID.q0 * np.where(np.isin(np.arange(HUMANOID.nq), range(3, 7)), norm, 1.0)


def changed(make: Callable[..., object], **good: Any) -> Callable[..., object]:
    return lambda **bad: make(**(good | bad))


forces = changed(ForceDistribution, G=np.eye(3), wrench=[0.0, 0.0, 1.0])
saturation = changed(NullSpaceSaturation, J=[[1.0, 1.0]], target=[1.0], lower=-1.0, upper=1.0)
parameters = changed(ParameterUpdate, Y=EYE, s=[1.0, 1.0], gain=1.0, a_hat=[1.0, 1.0], lower=0.0)
step = changed(ProjectedGradientStep, v_task=[0.0, 0.0], v_null=[1.0, 1.0], v_min=-1.0, v_max=1.0)
torque = changed(WeightedTorque, M=EYE, n=[0.0, 0.0], J=[[1.0, 0.0]], task_acceleration=[1.0])
planar = changed(PlanarPR, m1=1.0, m2=1.0, l2=0.5, d2=0.25, I2=0.1)
joints = changed(JointMap, joints=LEGS, slots=SLOTS, device=SLOTS)

METHODS = (
    (lambda: ContactEstimate(np.eye(3), np.ones(3), normal=[0, 0, 1.0]), "come together"),
    (lambda: ContactEstimate(np.eye(3), np.ones(3), normal=ZEROS, friction=1.0), "length 0"),
    (lambda: ContactEstimate(np.eye(3), np.ones(3), normal=[0, 0, 1.0], friction=1.0).closed_form(),
     "friction cone", NoClosedForm),
    (lambda: FaultFraction([1.0, 2.0], [1.0]), r"residual must have shape \(2,\), not \(1,\)"),
    (lambda: FaultFraction([1.0, np.inf], [1.0, 1.0]), r"tau\[1\] is inf"),
    (lambda: FaultFraction([1.0, 1.0], [0.0, 0.0], weight=[1.0, -1.0]), r"weight\[1\] is -1; it must be positive"),
    (lambda: FaultFraction([1.0, 1.0], [0.0, 0.0], weight=[[1.0, 3.0], [3.0, 1.0]]), "an eigenvalue is -2"),
    (lambda: forces(wrench=[1.0]), "wrench must have shape"),
    (lambda: forces(G=[[np.inf, 0.0, 0.0]] * 3), r"G\[\(0, 0\)\] is inf"),
    (lambda: forces(weight=[1.0, 0.0, 1.0]), r"weight\[1\] is 0"),
    (lambda: forces(weight=[[1, 2, 0], [0, 1, 0], [0, 0, 1]]), r"weight is not symmetric: weight\[0, 1\] = 2"),
    (lambda: forces(G=EYE, wrench=[0, 1], friction=0.5), "G has 2 columns"),
    (lambda: forces(f_min=1.0, f_max=0.0), r"f_min\[0\] is 1 and f_max\[0\] is 0"),
    (lambda: MomentumResidual(gain=[1.0, 250.0], dt=0.01, scheme="euler"), r"gain\[1\] dt is 2.5;.* below 2"),
    (lambda: MomentumResidual(gain=200.0, dt=0.01, scheme="euler"), "gain is 200, so gain dt is 2;"),
    (lambda: MomentumResidual(gain=[10.0, -1.0], dt=0.01), r"gain\[1\] is -1; it must be positive"),
    (lambda: MomentumResidual(gain=EYE, dt=0.01), r"gain must have shape \(any,\), not \(2, 2\)"),
    (lambda: MomentumResidual(gain=1.0, dt=0.01, scheme="trapezoidal"), "it must be one of exact, euler"),
    (lambda: MomentumResidual(gain=1.0, dt=0.01).update([0.0], [0.0], [0.0]), "before reset", NotSupported),
    (lambda: MomentumResidual(gain=1.0, dt=0.01).value, "before reset", NotSupported),
    (lambda: saturation(target=[1.0, 2.0]), "target must have shape"),
    (lambda: saturation(J=[[np.nan, 1.0]]), r"J\[\(0, 0\)\] is nan"),
    (lambda: saturation(lower=[2.0, 0.0]), r"lower\[0\] is 2 and upper\[0\] is 1"),
    (lambda: saturation(drift=[np.inf]), r"drift\[0\] is inf"),
    (lambda: NullSpaceSaturation.prioritised([], lower=-1, upper=1), "empty"),
    *((lambda second=second: NullSpaceSaturation.prioritised([(ONE, [1.0]), second], lower=-1, upper=1), says)
      for second, says in (((ONE, [1.0, 2.0]), r"tasks\[1\].target"), (([[1.0, 2.0]], [1.0]), "has 2 columns"),
                           *((wrong, r"tasks\[1\] is .*; it must be \(J, target\) or")
                             for wrong in (3, (ONE,), (ONE, [1.0], [0.0], [0.0]))))),
    (lambda: parameters(a_hat=[1.0, -0.5]), r"a_hat\[1\] is -0.5 < 0: outside the set"),
    (lambda: parameters(a_hat=[1.0, 3.0], upper=2.0), r"a_hat\[1\] is 3 > 2: outside the set"),
    (lambda: parameters(C=[[1.0, 1.0]], d=[1.5]), r"a_hat is outside the set: C\[0\] a_hat is 2 > 1.5"),
    (lambda: parameters(C=[[1.0, 1.0]]), "C and d come together"),
    (lambda: parameters(gain=[1.0, 0.0]), r"gain\[1\] is 0; it must be positive"),
    (lambda: parameters(gain=[[1.0, 2.0], [2.0, 1.0]]), "gain is not positive definite: an eigenvalue is -1"),
    (lambda: parameters(lower=[0.0, 2.0], upper=[1.0, 1.0]), r"lower\[1\] is 2 and upper\[1\] is 1"),
    (lambda: parameters(Y=np.ones((2, 3))), r"Y must have shape \(any, 2\), not \(2, 3\)"),
    (lambda: parameters(s=[1, 1, 1]), r"s must have shape \(2,\), not \(3,\)"),
    (lambda: ParameterUpdate(EYE, [1, 1], gain=1.0, a_hat=[0.0, 0.0]).step(0.0), "dt is 0; it must be > 0"),
    (lambda: step(v_null=[1.0]), "v_null must have shape"),
    (lambda: step(v_min=[2.0, -1.0]), r"v_min\[0\] is 2 and v_max\[0\] is 1"),
    (lambda: step(v_max=[1.0, np.nan]), r"v_max\[1\] is nan"),
    (lambda: step(v_max=[np.inf, np.inf]), "alpha_max is inf"),
    (lambda: ProjectedGradientStep([0.0], [1.0], v_min=[-1], v_max=[1]).qp_over_velocity(1.0), "from_gr", NotSupported),
    (lambda: ProjectedGradientStep([0.0], [1.0], v_min=[-1], v_max=[1]).plot(), "2 joints", NotSupported),
    *((lambda junk=junk: MomentumResidual(gain=1.0, dt=0.1).restart(junk), "", WbcError)
      for junk in ("a", None, [], 1j, np.nan)),
    *((lambda junk=junk: PseudoInertia.metric(junk), "", WbcError) for junk in ("a", None, [], 1j, np.nan, -1)),
    (lambda: PseudoInertia([1.0]), r"parameters must have shape \(10,\)"),
    (lambda: torque(M=[[1.0, 2.0], [2.0, 1.0]]), "M is not positive definite: an eigenvalue is -1"),
    (lambda: torque(M=[[1.0, 0.5], [0.2, 1.0]]), r"M is not symmetric: M\[0, 1\] = 0.5, M\[1, 0\] = 0.2"),
    (lambda: torque(n=[0.0, np.nan]), r"n\[1\] is nan"),
    (lambda: torque(J=[[1.0, 0.0, 0.0]]), r"J must have shape \(any, 2\), not \(1, 3\)"),
    (lambda: torque(task_acceleration=[1.0, 2.0]), r"task_acceleration must have shape \(1,\), not \(2,\)"),
    (lambda: torque(weight=[1.0, 0.0]), r"weight\[1\] is 0; it must be positive"),
    (lambda: torque(weight="inertia"), "weight is 'inertia'; it must be an array or one of inverse_inertia"),
    (lambda: torque(tau_min=[0.0, 2.0], tau_max=1.0), r"tau_min\[1\] is 2 and tau_max\[1\] is 1"),
    (lambda: torque(equalities=([[1.0, 0.0]], [1.0, 2.0])), r"equalities\[1\] must have shape \(1,\), not \(2,\)"),
    (lambda: torque(equalities=[[1.0, 0.0]]), r"equalities is \[\[1.0, 0.0\]\]; it must be \(E, e\)"),
    (lambda: WeightedTorque(EYE, [0.0, 0.0], [[1.0, 0.0]], [1.0]).solve(form="velocity"), "form is 'velocity'"),
    (lambda: WeightedTorque(EYE, [0.0, 0.0], [[1.0, 0.0]], [1.0]).closed_form("lq"), "form is 'lq'"),
)  # fmt: skip
MODELS = (
    (lambda: Distances(ARM, pairs=[("base", "hand")]), "there is no link or obstacle 'hand'", UnknownName),
    (lambda: Distances(ARM, obstacles=[ball("forearm")]), "obstacle 'forearm' has the name of a link"),
    (lambda: Distances(ARM, obstacles=[ball("a"), ball("a")]), "obstacle 'a' has the name of another"),
    (lambda: Distances(ARM, self_collision=False), "no pair of shapes is left"),
    (lambda: Distances(ARM, reach=0.0), "reach is 0"),
    (lambda: Distances(ARM, count=0), "count is 0"),
    (lambda: Distances(PR), "has no collision shapes", NotSupported),
    (lambda: Obstacle("thing", Sphere(0.1), [0, 0, 0]), "a pose is a pinocchio.SE3"),
    *((lambda thing=thing: load(thing), "a robot is loaded by name or path, or from a model of Pinocchio or MuJoCo")
      for thing in (3, None, [], SimpleNamespace(model=3), ModuleType("empty"))),
    (lambda: load(pin.Model()), "no joint moves", ModelError),
    (lambda: load("quadrupet"), "no robot 'quadrupet'; did you mean 'quadruped'", UnknownRobot),
    (lambda: load(Path("arm")), "arm: there is no such file", ModelError),
    (lambda: PinocchioModel(ARM.urdf, feet=[Foot("tol", "point", 0.5)]),
     "no frame 'tol'; did you mean 'tool'", LookupError),
    (lambda: InertialRegressor(QUADRUPED), "quadruped has a floating base", NotSupported),
    (lambda: InertialRegressor(PR), "a regressor needs a robot from a URDF", NotSupported),
    *((lambda word=word: Chain.parse(word), says) for word, says in
      (("", "no joint"), ("PQ", "at 'Q'"), ("Rx", "at 'x'"), ("P R", "at ' R'"), ("R" * 7, "7 joints"), ("4", "at '4'"),
       (3, "not by int"))),
    (lambda: Chain(("R", "Pz")), r"joints\[1\] is 'Pz'"),
    (lambda: planar(I2="heavy"), "I2 must be a number, not 'heavy'"),
    (lambda: planar(m1=0.0, I2=0.0), "inertia matrix of planar_pr is singular"),
    (lambda: planar(m2=0.0, I2=0.0), "inertia matrix of planar_pr is singular"),
    (lambda: planar(tau_max=(1.0, 0.0)), r"tau_max\[1\] is 0"),
    (lambda: planar(q_min=1.0, q_max=(2.0, 0.5)), r"q_min\[1\] is 1 and q_max\[1\] is 0.5"),
    *((lambda m=m: Planar4P(m=m), says) for m, says in
      (((1, 1, 1), r"m must have shape \(4,\), not \(3,\)"), ((1, 1, -1, 1), r"m\[2\] is -1; it must be >= 0"),
       ((1, 1, 1, 0), "singular"), ((0, 0, 1, 1), "singular"), ((1, 0, 0, 1), "singular"))),
)  # fmt: skip
CONTROL = (
    (lambda: T.CollisionAvoidance(reach=0.01, margin=0.02),
     "reach is 0.01 m; it must be more than the margin of 0.02 m"),
    (lambda: T.CollisionAvoidance(count=0), "count is 0"),
    (lambda: controller(subject_to=[T.CollisionAvoidance(pairs=[("fore", "base")])]), "no link or obstacle 'fore'",
     UnknownName),
    (lambda: T.SupportPolygon.under(QUADRUPED, ["front_left_foo"]), "front_left_foo", UnknownFrame),
    (lambda: T.SupportPolygon.under(ARM), "nothing is known about the feet", NotSupported),
    (lambda: controller(T.Posture(ARM.q0, rate=np.inf)), "rate is inf"),
    (lambda: controller(level=TORQUE, contacts=[T.Point("tool", friction=0.5, kp=100.0, kd=3000.0)]),
     r"Point\[tool\]\.kd is 3000"),
    *((lambda given=given: T.JointLimits(**given).prepare(ARM), says) for given, says in (
        ({"without": ["speed"]}, "without.0. is 'speed'; it must be one of position, velocity, torque"),
        ({"without": ["torque"], "tau_max": 3.0}, "is without torque and has limits on it"),
        ({"without": "position", "upper": 3.0}, "is without position and has limits on it"),
        ({"a_max": -1.0}, "JointLimits.acceleration.a_max of joint"),
        ({"j_max": 0.0}, "JointLimits.jerk.j_max of joint"))),
    (lambda: wbc.run_many([controller(), controller(on=HUMANOID)], [(0.0, ARM.q0, 0 * ARM.q0)] * 2), "other joints"),
    (lambda: wbc.run_many([], [(0.0, ARM.q0, 0 * ARM.q0)]), "0 controllers for 1 states"),
    (lambda: wbc.run_many(controller(), []), "states is empty"),
    (lambda: wbc.run_many(controller(), [(0.0, np.zeros(3), 0 * ARM.q0)] * 2, workers=2), "q must have shape"),
    (lambda: controller(REACH, on=[ARM, HUMANOID]),
     "robot is 2 robots, and a controller has one: give each free robot", NotSupported),
    (lambda: controller().replace(wbc.Stack([])), r"the stack is empty: write wbc\.Stack\(\[\.\.\.\]\) with tasks"),
    (lambda: wbc.Rate(1e-3).percentile(101), "percent"),
    (lambda: wbc.Rate(1e-3, warm=True), "warm is"),
    *((lambda norm=norm: wbc.reach(HUMANOID, [T.CenterOfMass(target=ZEROS)], start=with_base(norm)),
       rf"start: the base's quaternion q\[3:7\] has norm {norm:g}") for norm in (0.0, 5.0)),
    *((lambda none=none: wbc.reach(ARM, none), "no task in its first level") for none in ([], [[]], [[], [REACH]])),
    (lambda: wbc.reach(ARM, [REACH, T.Damping()]), "Damping has kp = 0, so it has no error that could be met"),
    (lambda: wbc.reach(ARM, [REACH], subject_to=[T.TorqueLimits()]), "TorqueLimits", NotSupported),
    *((lambda given=given: wbc.Recovery(**given), next(iter(given))) for given in (
        {"relax": ("torques",)}, {"relax": "constraints"}, {"relax": ("constraints", "constraints")},
        {"relax": ([1],)})),
    *((lambda name=name: controller(solver=name), name, NotSupported)
      for name in wbc.solvers() if wbc.qp.solvers.by_name(name).offline),
    *((lambda given=given: controller().tick(**{"t": 0.0, "q": ARM.q0, "v": 0 * ARM.q0} | given),
       f"takes a time .s. and two vectors of real numbers; {next(iter(given))} is ") for given in (
        {name: junk} for name in "tqv" for junk in (
            np.zeros(7, complex), ["a"] * 7, np.zeros(7, "datetime64[s]"), [object()] * 7, [[0.0], 6 * [0.0]]))),
    (lambda: wbc.Setpoint(controller(), feedback="open"), "feedback"),  # type: ignore[arg-type]
    (lambda: wbc.Setpoint(controller(), max_drift=[0.1]), "max_drift"),
    (lambda: Watchdog(late=1.0), "late"),
    (lambda: wbc.Strict(budget=0), "budget"),
    (lambda: T.Sole("foot", half_size=(0.1, 0.1), friction=0.5, f_min=30.0, f_max=20.0), "f_min is 30 N, above f_max"),
    (lambda: setattr(T.Point("foot", friction=0.5, f_min=30.0), "f_max", 20.0), "f_min is 30 N, above f_max, 20 N"),
    (lambda: setattr(T.JointCoupling("a", to={"b": 1.0}).with_reaction(), "f_max", 1.0), "it pushes and pulls"),
    (lambda: JointIntervals([T.JointVelocityLimits()], ARM, dt=0.0), "dt is 0"),
    *((lambda given=given: REACH.within(*given).prepare(ARM), says) for given, says in (
        ((0.1, -0.1), "row 0 is left nothing: lower 0.1, upper -0.1"), ((0.0,), "row 0 is left nothing"),
        (([0.1, 0.1],), r"lower must have shape \(3,\)"), ((np.nan, 1.0), "lower.* is nan"),
        ((-np.inf, np.inf), "has no finite bound"))),
    *((lambda place=place, given=given: wbc.Stack(**{"tasks": [], place: given}), says) for place, given, says in (
        ("contacts", 3, "contacts is 3; it must be a contact, such as .*, in a list"),
        ("contacts", ["left_sole"], r"contacts\[0\] is 'left_sole'; it must be a contact, such as"),
        ("subject_to", [3], r"subject_to\[0\] is 3; it must be a constraint, such as"),
        ("components", [3], r"components\[0\] is 3; it must be a component"),
        ("components", [T.Damping()], r"components\[0\] is Damping.*; it belongs in tasks$"),
        ("subject_to", [T.Damping()], r"it belongs in tasks; its exactly\(\) belongs here$"),
        ("contacts", [T.Damping()], r"it belongs in tasks; its with_reaction\(\) belongs here$"),
        ("tasks", [T.JointVelocityLimits()], r"belongs in subject_to; its softly\(\) belongs here$"))),
)  # fmt: skip
PROBLEMS = (
    *((lambda levels=levels: wbc.lexicographic(levels), says, InvalidProblem) for levels, says in (
        ([], "levels is empty"), ([([[1.0, 0.0]], [1.0], [0.0])], "crossed"),
        ([([[1.0, np.nan]], [0.0], [0.0])], r"levels\[0\].A"),
        ([([[1.0, 0.0]], [0.0], [0.0]), (ONE, [0.0], [0.0])], "has 1 columns"),
        ([([[1.0, 0.0]], [0.0, 0.0], [0.0])], "lo"),
        *((nothing, "") for nothing in (
            None, 3, "levels", [None], [3], [(1, 2)], [(ONE, [0.0])], ["abc"], [(np.zeros((0, 2)), [], [])],
            [(ONE, [0.0], [0.0]), (np.zeros((0, 1)), [], [])], [([[10**400]], [0.0], [0.0])], [(None, None, None)])))),
    (lambda: wbc.lexicographic([(ONE, [0.0], [0.0])], lb=[1.0], ub=[0.0]), "crossed", InvalidProblem),
    *((lambda given=given, more=more: QP(*given, **more), "", InvalidProblem) for given, more in (
        (([[10**400]], [0]), {}), ((ONE, [10**400]), {}), ((None, [0.0]), {}), ((ONE, "a"), {}),
        *(((ONE, [0.0]), {"rows": rows}) for rows in ([3], 3)),
        *(((ONE, [0.0]), {"tasks": tasks}) for tasks in (
            3, [3], [("a", [[1.0, 2.0]], [0.0], "")], [(1, ONE, [0.0], "")], [("a", ONE, [np.nan], "")])))),
    (lambda: QP(EYE, [0, 0], C=[[1, 1]], cl=[2], cu=[1], rows=[Row("friction[left_sole]", "fx - mu fz", "N")]),
     r"row friction\[left_sole\]: fx - mu fz are crossed: 2 > 1 N", InvalidProblem),
    *((lambda thing=thing: solve(thing), r"qp is .* it must be a wbc\.QP") for thing in (None, 3, "qp", ONE, object())),
    *((lambda make=make, given=given: make(**given), next(iter(given))) for make, given in (
        (Daqp, {"primal_tol": 0.0}), (Daqp, {"max_iter": 0}), (Daqp, {"eta_prox": -1.0}), (Daqp, {"eps_prox": np.nan}),
        (ProxQp, {"eps_abs": np.nan}), (Piqp, {"eps_abs": -1.0}), (Osqp, {"max_iter": -5}), (Clarabel, {"tol": 0.0}))),
    (lambda: QpSolvers("higs"), "did you mean 'highs'", UnknownSolver),
)  # fmt: skip
ROBOTS = (
    (lambda: UnitreeGo2().pack(np.zeros(11), 0.0, 0.0, 1.0, 1.0), "12 motors"),
    (lambda: UnitreeGo2().pack(np.zeros(20), 0.0, 0.0, 1.0, 1.0), "12 motors"),
    (lambda: BaseEstimator(ARM), "floating base"),
    (lambda: BaseEstimator(QUADRUPED, [FEET[0], FEET[0]]), "contacts"),
    (lambda: BaseEstimator(QUADRUPED, [Foot(FEET[0], "sole", 0.6)]), "is a sole without half_size"),
    (lambda: BaseEstimator(QUADRUPED, imu_frame=FEET[0]), "link of the base"),
    (lambda: BaseEstimator(QUADRUPED, make=0.01, break_=0.02), "break_"),
    (lambda: BaseEstimator(QUADRUPED).reset(np.zeros(19), np.zeros(18)), "length"),
    (lambda: BaseEstimator(QUADRUPED).reset(QUADRUPED.q0, np.zeros(17)), "shape"),
    (lambda: BaseEstimator(QUADRUPED, contacts=["nose"]), "nose", UnknownFrame),
    (lambda: EstimatedBase(SENSORS["exact"]).begin(IntegratorPlant(QUADRUPED)), "force sensors"),
    (lambda: joints(joints=["left_hip", "left_hip", "right_hip", "right_knee"]), "each once"),
    (lambda: joints(slots=["m0", "m1", "m1", "m3"]), "slot 'm1' is given twice, to left_knee and right_hip"),
    (lambda: joints(slots=["m0", "m1", "m2", "m9"]), "no slot 'm9'; there are: m0, m1, m2, m3", UnknownSlot),
    (lambda: joints(slots=["m0", "m1", "m2"]), "slots has 3 names for 4 joints"),
    (lambda: joints(device=[*SLOTS, "m4"]), "slot 'm4' has no joint; map one to it, or name it in idle"),
    (lambda: joints(idle=["m0"]), "slot 'm0' is given twice, to left_hip and idle"),
    (lambda: joints(idle=["m7"]), "'m7'", UnknownSlot),
    (lambda: joints(gear={"left_knee": 0}), "gear of left_knee is 0; it must be > 0"),
    (lambda: joints(sign={"right_hip": 0}), "sign of right_hip is 0; it must be 1 or -1"),
    (lambda: joints(sign={"right_hp": -1}), "did you mean 'right_hip'", UnknownJoint),
    (lambda: joints(offset=[0, 0, np.nan, 0]), r"offset\[2\] is nan"),
    (lambda: joints(unit={"left_hip": "degrees"}), "unit of left_hip is 'degrees'"),
    (lambda: joints(unit=["rad"]), "unit has 1 entries for 4 joints"),
    (lambda: JointMap.of(ARM, ARM.joint_names, joints=["elbw"]), "did you mean 'elbow'", UnknownJoint),
    (lambda: JointMap.of(ARM, ARM.joint_names, names={"elbw": "elbow"}), "'elbw'", UnknownJoint),
    (lambda: JointMap.of(ARM, ARM.joint_names[1:]), ARM.joint_names[0], UnknownSlot),
    (lambda: JointMap.of(ARM, ARM.joint_names, signs=1), "a map has sign, offset, gear and unit"),
    (lambda: JointMap(LEGS, SLOTS, SLOTS).position_from_device([0, 0, np.nan, 0]), r"p\[2\] is nan; it must be finite"),
    (lambda: JointMap(LEGS, SLOTS, SLOTS).position_to_device([0.0]), r"q must have shape \(4,\)"),
    (lambda: MotorBoard(Ros2Control(ARM.joint_names), IntegratorPlant(ARM)), "motors give torques"),
    *((lambda given=given: board(**given), next(iter(given))) for given in (
        {"delay": -1.0}, {"timeout": 0.0}, {"on_timeout": "fall"}, {"sensors": 0.1}, {"imu": ZEROS},
        {"imu": np.ones((3, 3))}, {"imu": -np.eye(3)})),
    *((lambda given=given: board(disturbances=[given]), "delay=, state_delay= and sensors=")
      for given in (Delay(0.01), SensorNoise(position=0.1))),
    *((lambda given=given: loop(**given), says) for given, says in (
        ({"rate": 1000}, "give it dt"), ({"ramp": 0.0}, "ramp"), ({"at_end": "fall"}, "at_end"), ({"kp": -1.0}, "kp"),
        *(({"hold_for": value}, "hold_for") for value in (-1.0, np.nan, "long")))),
    *((lambda given=given: Order(ZEROS, **(dict.fromkeys(("dq", "tau", "kp", "kd"), ZEROS) | given)), next(iter(given)))
      for given in ({"kp": -1.0}, {"tau": np.nan}, {"dq": [1.0, 2.0]}, {"weight": 1.5}, {"weight": "all"})),
    *((lambda given=given: environment(**given), says) for given, says in (
        ({"targets": []}, "at least one task"), ({"targets": [1]}, "targets"), ({"ticks": 0}, "ticks"),
        ({"targets": [(T.Position("tool", target=ZEROS), ZEROS, np.ones(3))]}, "a task of the stack"),
        ({"targets": [(REACH, ZEROS[:2], np.ones(3))]}, "low of targets"), ({"ticks": 2.5}, "ticks"),
        ({"targets": [(REACH, np.ones(3), ZEROS)]}, "below its high"), ({"duration": 0.0}, "duration"),
        ({"plant": IntegratorPlant(QUADRUPED, level="velocity", dt=2e-3)}, "the plant is"), ({"noise": -1.0}, "noise"),
        ({"plant": IntegratorPlant(ARM, dt=2e-3)}, "takes acceleration"),
        ({"plant": physics(ARM, dt=2e-3, drives=PositionDrives())}, "takes positions"))),
)  # fmt: skip
SIMULATION = (
    (lambda: physics(ARM.replace(limits=replace(ARM.limits, tau_max=np.full(7, -1.0)))), "a torque limit of -1",
     SimulationError),
    (lambda: physics(QUADRUPED).push("trunc", np.ones(3)), "did you mean 'trunk'", UnknownFrame),
    *((lambda told=told, name=name: physics(ARM, contacts=[told.with_reaction(name=name)]), "part of the mechanism",
       NotSupported) for name in (None, "tool") for told in
      (T.JointCoupling("elbow", to={"shoulder_pitch": -2.0}), T.FrozenJoints(["elbow"]), REACH)),
    (lambda: Push("tool", (1, 0, 0), 0.0, 0.1).begin(IntegratorPlant(ARM)), "knows no forces", NotSupported),
    (lambda: Payload("tool", 1.0).begin(IntegratorPlant(ARM)), "cannot change its masses", NotSupported),
    (lambda: ActuatorFault(joint="q1").begin(IntegratorPlant(Planar4P())), "no torques that could", NotSupported),
    *((lambda make=make: make(), says) for make, says in (
        (lambda: Push("a", (1, 2), 0, 1), r"force must have shape \(3,\)"),
        (lambda: Push("a", ZEROS, -1, 1), "start is -1"),
        (lambda: Push("a", (1, 2, np.nan), 0, 1), r"force\[2\] is nan"),
        (lambda: Push(None, ZEROS, 0, 1), "frame is None"),
        (lambda: Push("a", ZEROS, 0, 0), "duration is 0"), (lambda: Payload("a", 0.0), "mass is 0"),
        (lambda: SensorNoise(velocity=-1e-3), "velocity is -0.001"), (lambda: SensorNoise(seed=True), "seed is True"),
        (lambda: Delay(-0.1), "seconds is -0.1"))),
    *((lambda given=given: ActuatorFault(**{"joint": "q1", **given}), says) for given, says in (
        ({"effectiveness": 1.2}, "effectiveness is 1.2; it must be between 0 and 1"), ({"bias": np.nan}, "bias is nan"),
        ({"start": 2.0, "end": 1.0}, "end is 1; it must be after start, 2"), ({"end": "later"}, "end must be an array"),
        ({"ceiling": None}, "ceiling must be an array of numbers"), ({"ceiling": np.nan}, "ceiling is nan"),
        ({"joint": 1}, "joint is 1; it must be text"))),
    (lambda: ActuatorFault(joint="q9").begin(ForwardDynamicsPlant(Planar4P())), "q9", UnknownJoint),
    *((lambda given=given: PositionDrives(**given).gains(ARM), says) for given, says in (
        ({"stiffness": -1.0}, "stiffness"), ({"damping": [1.0, np.nan]}, "damping"), ({"stiffness": "stiff"}, "stiff"),
        ({"stiffness": [1.0, 2.0]}, "has 7 joints"), ({"damping": np.zeros((7, 1))}, "a number or"))),
    (lambda: IntegratorPlant(ARM).push("tool", np.ones(3)), "IntegratorPlant knows no forces", NotSupported),
    (lambda: IntegratorPlant(ARM).add_mass("tool", 1.0), "cannot change its masses", NotSupported),
    (lambda: IntegratorPlant(ARM, level="torque"), "level is 'torque'"),  # type: ignore[arg-type]
    (lambda: ForwardDynamicsPlant(ARM, substeps=0), "substeps is 0"),
    (lambda: simulate(controller(), IntegratorPlant(ARM, dt=2e-3), duration=1.0), "the plant steps 0.002 s"),
    (lambda: simulate(controller(), IntegratorPlant(QUADRUPED), duration=1.0), "drives arm, the plant is quadruped"),
    (lambda: simulate(controller(), IntegratorPlant(ARM), duration=1.0), r"IntegratorPlant\(robot, level='velocity'\)"),
    (lambda: simulate(controller(), IntegratorPlant(ARM, level="velocity"), duration=1e-4), "shorter than one tick"),
    *((lambda at=at: simulate(controller(), IntegratorPlant(ARM, level="velocity"), duration=1.0, disturbances=at),
       *says) for at, says in (
        ([Push("tool", (1, 0, 0), 0, 1)], ("nothing can push 'tool'", NotSupported)),
        (Push("tool", (1, 0, 0), 0, 1), (r"disturbances is Push\(.*; write disturbances=\[Push\(…\)\]",)))),
    (lambda: IntegratorPlant(QUADRUPED).reset(q=ZEROS), "q must have shape"),
    (lambda: IntegratorPlant(QUADRUPED).reset(q=np.full(QUADRUPED.nq, np.nan)), r"q\[0\] is nan"),
    (lambda: IntegratorPlant(QUADRUPED).reset(q=0 * QUADRUPED.q0), r"q\[3:7\] is a quaternion of length 0"),
    (lambda: IntegratorPlant(QUADRUPED).reset(q=QUADRUPED.q0, v=ZEROS), "v must have shape"),
)  # fmt: skip
#: What is made, words of the refusal, and its kind where it is not InvalidInput.
REFUSED: Mapping[str, tuple[Any, ...]] = {
    f"{room} {i}: {row[1]}": row
    for room, rows in {
        "methods": METHODS, "models": MODELS, "control": CONTROL, "problems": PROBLEMS, "robots": ROBOTS,
        "simulation": SIMULATION,
    }.items()
    for i, row in enumerate(rows)
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_makes_no_sense_is_refused_by_name(name: str) -> None:
    call, says, *kind = REFUSED[name]
    with pytest.raises(kind[0] if kind else InvalidInput, match=says or None):
        call()


def test_a_contradiction_that_holds_in_every_state_is_refused() -> None:
    with pytest.raises(Infeasible):
        controller(subject_to=[T.JointVelocityLimits(0.1), T.JointVelocity(np.ones(ARM.nj)).exactly()])
