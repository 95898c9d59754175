"""What makes no sense together is refused where it is said, by its name: one table for the library.

Numbers without sense in a single argument, and texts in their place, are in tests/reliability/walker.py.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio
import pytest

import tasks as T
import wbc
from tests.models.builders import quietly
from wbc.errors import InvalidInput, NotSupported, UnknownContact, UnknownFrame, UnknownJoint, UnknownName
from wbc.models import Planar4P, PlanarPR

ARM, HUMANOID, QUADRUPED = (wbc.load(name) for name in ("arm", "humanoid", "quadruped"))
POINTS = [T.Point(f"{leg}_foot", friction=0.6) for leg in ("front_left", "rear_right")]
MIRROR = np.diag([1.0, 1.0, -1.0])
EYE, ZEROS = np.eye(4), np.zeros(3)
OBSERVER = T.MomentumObserver(gain=100.0, threshold=0.3)
PR = PlanarPR(m1=1.0, m2=1.0, l2=0.5, d2=0.25, I2=0.1)


def arm(change: Callable[[Any], object]) -> Any:
    """The arm with a change in its model."""
    model = ARM.pinocchio.copy()
    change(model)
    return quietly(model)


FLOATS, TILTED = (arm(lambda model, g=g: setattr(model.gravity, "linear", np.array(g))) for g in (ZEROS, [3, 0, -9.0]))
LIGHT = arm(lambda model: model.inertias[7].setZero())
VELOCITY, TORQUE = wbc.VelocityLevel(), wbc.InverseDynamics()


def built(*tasks: Any, on: Any = ARM, level: Any = TORQUE, **stack: Any) -> wbc.Controller:
    return wbc.Controller(on, wbc.Stack(tasks, **stack), level=level)


def reacting(*tasks: Any, **settings: Any) -> object:
    stack = wbc.Stack(tasks or [T.Posture(ARM.q0)], subject_to=[T.TorqueLimits()],
                      components=[OBSERVER, T.FaultReaction(OBSERVER, **settings)])  # fmt: skip
    return wbc.Controller(ARM, stack, level=TORQUE).tick(0.0, ARM.q0, 0 * ARM.q0)


def adapting(model: Any = ARM, **settings: Any) -> object:
    target = np.zeros(model.nj)
    adaptive = T.SlotineLi(**{"target": target, "kp": 10.0, "kd": 10.0, "gain": 1.0} | settings)
    return built(adaptive.torque, on=model, components=[adaptive])


def observing() -> T.MomentumObserver:
    observer = T.MomentumObserver(gain=1.0)
    observer.prepare(QUADRUPED)
    return observer


#: What is made, words of the refusal, and its kind where it is not InvalidInput.
REFUSED: list[tuple[Callable[[], object], str] | tuple[Callable[[], object], str, type[Exception]]] = [
    *((lambda task=task, robot=robot: task.prepare(robot), "gravity along −z", NotSupported)
      for robot in (PR, FLOATS, TILTED)
      for task in (T.ZeroMomentPoint(target=[0.0, 0.0]), T.CapturePoint(target=[0.0, 0.0], height=0.5))),
    *((lambda task=task: task.prepare(LIGHT), r"M > 0, and no inertia moves with joint 'wrist_roll'$", NotSupported)
      for task in (T.KineticEnergy(), T.Impedance("tool", target=EYE, stiffness=1.0, damping=1.0))),
    (lambda: built(T.CenterOfPressure(QUADRUPED.frame_names[-1]), T.Posture(QUADRUPED.q0), on=QUADRUPED,
                   contacts=[T.Point(QUADRUPED.frame_names[-1], friction=0.5)]), "of 3 numbers has no moments"),
    (lambda: built(T.CenterOfPressure("left_sole"), on=HUMANOID, level=VELOCITY,
                   contacts=[T.Sole("left_sole", half_size=(0.1, 0.05), friction=0.5)]),
     r"is about force, which the velocity level does not decide; use InverseDynamics\(\)", NotSupported),
    # Joints and rows by name.
    (lambda: built(T.Posture(ARM.q0, joints=["elbw"])), "no joint 'elbw'; did you mean 'elbow'", UnknownJoint),
    (lambda: built(T.Posture(ARM.q0, weight={"wheel_.*": 0.0})), r"Posture.weight", UnknownJoint),
    (lambda: built(T.Posture(ARM.q0, joints=["elbow"], kp={"wrist_.*": 1.0})), "there are: elbow", UnknownJoint),
    (lambda: built(T.Posture(ARM.q0), T.FrozenJoints(["wheel.*"])), "no joint 'wheel", UnknownJoint),
    (lambda: built(T.Torque(joints=["wheel.*"])), "no joint 'wheel", UnknownJoint),
    (lambda: built(T.GravityCompensation(joints=["elbw"])), "did you mean 'elbow'", UnknownJoint),
    (lambda: built(T.Posture(ARM.q0, joints=ARM.joint_names[::-1])), "all joints in another order"),
    (lambda: built(T.Posture([1.0, 2.0], joints=["elbow"])), r"shape \(1,\) or \(7,\)"),
    (lambda: built(T.Posture(ARM.q0, joints=["elbow"], weight=[1.0, 2.0])), r"shape \(1,\) or \(7,\)"),
    (lambda: built(T.Posture({"elbow": 0.1})), r"must be an array of .* robot.configuration\({...}\)"),
    (lambda: built(T.Posture(np.zeros(5))), r"Posture.target must have shape \(7,\) on arm, not \(5,\)"),
    (lambda: built(T.Torque(np.zeros(6))), r"Torque.target must have shape \(7,\)"),
    (lambda: built(T.JointAdmittance(ARM.q0, inertia={"elbow": 1.0}, damping=1.0, stiffness=1.0)), "inertia says"),
    (lambda: built(T.JointImpedance(ARM.q0, stiffness={"elbow": 1.0}, damping=1.0)), "stiffness says nothing of"),
    (lambda: built(T.JointImpedance(ARM.q0, stiffness=-1.0, damping=1.0)), "stiffness is -1; it must be >= 0"),
    (lambda: built(T.JointAdmittance(ARM.q0, inertia=0.0, damping=1.0, stiffness=1.0)), r"inertia\[0\] is 0"),
    (lambda: T.Posture(ARM.q0, joints="elbow"), "it must be names"),
    (lambda: T.Posture(ARM.q0, joints=["el(bow"]), "no regular expression"),
    (lambda: T.Posture(ARM.q0, weight={"elbow": -1.0}), r"weight\['elbow'\] is -1"),
    (lambda: T.Posture(ARM.q0, kp={3: 1.0}), "a key of Posture.kp is 3"),  # type: ignore[dict-item]
    (lambda: T.Frame("tool", target=EYE, weight={"pitsch": 1.0}), "did you mean 'pitch'", UnknownName),
    (lambda: T.Position("tool", target=ZEROS, kp={"roll": 1.0}), "there are: x, y, z", UnknownName),
    (lambda: T.JointCoupling("a", to={}), "it must give other joints a ratio"),
    (lambda: T.JointCoupling("a", to={"a": 1.0}), "it must give other joints a ratio"),
    (lambda: T.JointCoupling("a", to={"b": 0.0}), "ratio that is not zero"),
    (lambda: T.JointCoupling("elbo", to={"elbow": 1.0}).prepare(ARM), "no joint 'elbo'", UnknownJoint),
    (lambda: T.FrozenJoints([]), "it must be names"),
    (lambda: T.FrozenJoints(["a", "a"]), "each once"),
    (lambda: T.FrozenJoints(["a"], kp=10.0), "no positions to hold"),
    (lambda: T.FrozenJoints({"a": np.nan}), "'a'"),
    (lambda: T.Torque(joints=["a"], weight="inverse_inertia"), "of all joints"),
    (lambda: T.JointPositionLimits(2.0), "nothing by position|positional", TypeError),  # type: ignore[misc]
    (lambda: T.JointLimits(2.0), "nothing by position|positional", TypeError),  # type: ignore[misc]
    (lambda: T.JointPositionLimits(lower=np.inf).prepare(ARM), "has limits"),
    (lambda: T.JointVelocityLimits({"elbow": [1.0, 2.0]}).prepare(ARM), r"v_max\['elbow'\] must have shape"),
    (lambda: T.TorqueSpeedLimits(1.0, corner_speed=2.0).prepare(ARM), "has the corner speed 2; it must be .* below"),
    (lambda: T.TorqueSpeedLimits(1.0, corner_speed=-1.0).prepare(ARM), "has the corner speed -1"),
    (lambda: T.TorqueSpeedLimits(1.0, np.inf).prepare(ARM), "has a no-load speed and no tau_max"),
    # Frames, directions and targets.
    (lambda: T.AxisAlignment("tool", axis=ZEROS, target=[0, 0, 1]), "axis is .* a direction is not zero"),
    (lambda: T.AxisAlignment("tool", axis=[0, 0, 1], target=ZEROS), "target is .* a direction is not zero"),
    (lambda: T.Distance("tool", to=[0, 0], target=0.1), r"to must have shape \(3,\)"),
    (lambda: T.Distance("tool", to="tool", target=0.1).prepare(ARM), "seen from itself never moves"),
    *((lambda kind=kind, target=target: kind("head", reference="head", target=target).prepare(HUMANOID),
       "'head' seen from itself never moves") for kind, target in
      ((T.RelativeFrame, EYE), (T.RelativePosition, ZEROS), (T.RelativeOrientation, np.eye(3)))),
    (lambda: T.RelativePosition("head", reference="heads", target=ZEROS).prepare(HUMANOID), "'head'", UnknownFrame),
    (lambda: T.RelativePosition("heads", reference="head", target=ZEROS).prepare(HUMANOID), "'head'", UnknownFrame),
    (lambda: T.Frame("tool", target=np.eye(3)), r"target must have shape \(4, 4\), not \(3, 3\)"),
    (lambda: T.Frame("tool", target=[0] * 7), r"\(7,\); of a .* pinocchio.SE3\(pinocchio.Quaternion\(w, x, y, z\), p"),
    (lambda: T.Frame("tool", target=(ZEROS, np.eye(3))), r"must be a pinocchio.SE3\(rotation, position\) or a"),
    (lambda: T.Orientation("tool", target=[1, 0, 0, 0]), r"\(4,\); of a .* pinocchio.Quaternion\(w, x, y, z\).matrix"),
    (lambda: T.Frame("tool", target=pinocchio.SE3(MIRROR, ZEROS)), "its determinant is -1"),
    (lambda: T.Orientation("tool", target=np.eye(3) + 1e-5), "not a rotation"),
    (lambda: T.Position("tool", target=lambda t: (ZEROS, ZEROS)), r"\(value, rate, acceleration\)"),
    (lambda: T.Position("tool", target=lambda t: (0.4, 0.2, 0.5)), "several numbers as a list or an array, not as a"),
    (lambda: T.Position("tool", axes="xz", target=T.Sinusoid(ZEROS, amplitude=0.1, frequency=1.0)),
     r"target must have shape \(2,\), not \(3,\)"),
    (lambda: T.Position("tool", target=[0.0, 0.0], axes="yx"), "axes is 'yx'; it must be one of xyz, xy, yz"),
    (lambda: T.LocalPosition("tool", target=ZEROS, axes="zx"), r"LocalPosition\[tool\].axes"),
    (lambda: T.ContactForce("sole", target=[1.0, 2.0]), r"must have shape \(3,\) or \(6,\), not \[1.0, 2.0\]"),
    (lambda: T.Torque(weight="inertia"), "weight is 'inertia'; it must be numbers or 'inverse_inertia'"),
    (lambda: T.Admittance("tool", target=EYE, inertia=1.0, damping=[1, 1, 1, 1, 0, 1], stiffness=1.0),
     r"damping\[4\] is 0; it must be > 0"),
    (lambda: T.MeasuredWrench("tool", wrench=[1.0, 2.0]), r"wrench must have shape \(3,\) or \(6,\), not \(2,\)"),
    (lambda: built(T.Posture(ARM.q0), components=[T.MeasuredWrench("toll")]), "did you mean 'tool'", UnknownFrame),
    (lambda: T.ManipulabilityTask("tool", target=0.1, rows=["q"]), r"rows\[0\] is 'q'"),
    (lambda: T.ManipulabilityTask("tool", target=lambda t: -1.0), r"target is -1; it must be >= 0"),
    (lambda: T.ProjectedGradient("manipulability"), "must be a Criterion, not 'manipulability'"),  # type: ignore[arg-type]
    (lambda: T.ProjectedGradient(T.MidRange(), gain=np.nan), r"ProjectedGradient\[mid-range\].gain is nan"),
    (lambda: T.Manipulability("tool", rows=["x", "y", "x"]), r"rows\[2\] is 'x'; each is one of x, y, z, rx, ry, rz"),
    (lambda: T.Manipulability("tool", rows=[]), r"rows is \[\]; it must be names, at least one"),
    (lambda: T.Clearance("tool"), "a point or a plane"),
    (lambda: T.Clearance("tool", point=ZEROS, plane=([0, 0, 1], 0)), "a point or a plane"),
    (lambda: T.Clearance("tool", plane=(ZEROS, 0)), "length 0"),
    (lambda: built(T.ProjectedGradient(T.Manipulability("toll")), level=VELOCITY), "did you mean 'tool'", UnknownFrame),
    (lambda: built(T.ProjectedGradient(T.Clearance("toll", point=ZEROS)), level=VELOCITY), "mean 'tool'", UnknownFrame),
    # Limits on frames.
    (lambda: T.HalfSpaceLimit("tool", normal=ZEROS, offset=0), "normal is a vector of length 0"),
    (lambda: T.BoxLimits("tool"), "has no finite side"),
    (lambda: T.BoxLimits("tool", lower=1.0, upper=[2.0, 0.5, 2.0]), "y is left no room: lower 1, upper 0.5"),
    (lambda: T.ConeLimit("tool", apex=ZEROS, axis=[0, 0, 1], angle=2.0), "angle is 2; it must be between 0 and"),
    (lambda: T.ConeLimit("tool", apex=[0, 0], axis=[0, 0, 1], angle=0.5), "apex must have shape"),
    (lambda: T.AxisConeLimit("tool", axis=[0, 0, 1], direction=ZEROS, angle=0.5), "is a vector of length 0"),
    (lambda: T.FrameVelocityLimits("tool"), "limits nothing; give linear= or angular="),
    (lambda: T.FrameVelocityLimits("tool", linear=[1, -1, 1]), r"linear\[1\] is -1; a limit is positive"),
    (lambda: T.SupportPolygon([[0, 0], [1, 1], [2, 2]]), "span no area"),
    (lambda: T.SupportPolygon([[0, 0], [1, 0], [0, 1]], margin=1.0), "a margin of 1 m leaves nothing"),
    (lambda: T.SupportPolygon([[0, 0], [1, 0]]), r"must have shape \(k, 2\) or \(k, 3\)"),
    # Trajectories.
    (lambda: T.Sinusoid([0.0] * 3, amplitude=[0.1] * 2, frequency=1.0), r"^Sinusoid.amplitude must have shape"),
    (lambda: T.MinimumJerk([0.0], [1.0, 2.0], duration=1.0), r"end must have shape \(1,\)"),
    (lambda: T.MinimumJerk([0.0], [1.0], duration=1.0, end_rate=[np.inf]), r"end_rate\[0\] is inf"),
    (lambda: T.PoseInterpolation(np.eye(3), EYE, duration=1.0), "start must"),
    (lambda: T.PoseInterpolation(EYE, 2 * EYE, duration=1.0), "end"),
    (lambda: T.Piecewise([]), "at least one"),
    (lambda: T.Piecewise([(1.0, None), (1.0, None)]), r"pieces\[1\] starts at 1 s, not after"),
    (lambda: T.Samples([], period=0.1), "at least one sample"),
    (lambda: T.Samples([[1.0], [np.nan]], period=0.1), r"values\[\(1, 0\)\] is nan"),
    (lambda: T.Samples([EYE, 2.0 * EYE], period=0.1), r"values\[1\]"),
    (lambda: T.Samples([[1.0, 2.0], [1.0]], period=0.1), "values"),
    (lambda: T.Samples([[1.0]], period=0.1, rates=[[1.0]]), "rates and accelerations come together"),
    (lambda: T.Samples([[1.0]], period=0.1, rates=[[1.0]], accelerations=[[1.0, 2.0]]), "accelerations"),
    (lambda: T.Follow([]), "nothing to follow"),
    (lambda: T.Follow(np.zeros((2, 3))), "must have shape"),
    (lambda: T.Follow([0.0, 0.0], velocity=[1.0, 0.0]), r"velocity\[1\] is 0; a limit is positive"),
    (lambda: T.Follow([0.0], angular_jerk=1.0), "angular_jerk is given"),
    (lambda: T.Follow(np.eye(3), velocity=1.0), "velocity is given"),
    # Contacts.
    (lambda: T.ContactSchedule([]), "timeline is empty"),
    (lambda: T.ContactSchedule([(0.0, ["a"]), (0.0, ["b"])]), r"timeline\[1\] is at 0 s, not after 0 s"),
    (lambda: T.ContactSchedule([(0.0, "left")]), "has the text 'left'; give a list of names"),
    (lambda: T.ContactSchedule([(0.0, ["a"]), (1.0, [])], period=1.0), r"outside its period, \[0, 1\) s"),
    (lambda: T.ContactSchedule([(np.nan, ["a"])]), r"timeline\[0\] time is nan"),
    (lambda: built(T.Posture(QUADRUPED.q0), on=QUADRUPED, contacts=POINTS,
                   components=[T.ContactSchedule([(0.0, ["hoof"])])]), "no contact 'hoof'", UnknownName),
    (lambda: T.Sole("sole", half_size=(0.1, 0.1), friction=0.5, sides=6), "sides is 6; it must be 4 or 8"),
    (lambda: T.Sole("sole", half_size=(0.1, 0.1), friction=0.5, origin=[0.0]), r"origin must have shape \(3,\)"),
    (lambda: T.Sole("sole", half_size=(0.1, 0.1), friction=0.5, target=np.diag([1.0, 1.0, -1.0, 1.0])),
     r"Sole\[sole\].target is not a rotation"),
    (lambda: T.Point("foot", friction=0.5, axes=2 * np.eye(3)), "axes is not a rotation"),
    (lambda: T.Edge("toe", half_length=0.1, friction=0.5, direction=(0, 0, 0)), "direction is .*points nowhere"),
    (lambda: T.Rolling("w", radius=0.1, axle=[0, 0, 0]), "a direction is not zero"),
    (lambda: T.OmniWheel("w", radius=0.1, roller=1.6), "roller is 1.6; it must be between"),
    (lambda: T.InternalForce(POINTS[:1]), "at least two"),
    (lambda: T.InternalForce([POINTS[0], POINTS[0]]), "each once"),
    (lambda: T.InternalForce([POINTS[0], "rear"]), r"contacts\[1\] is 'rear'"),  # type: ignore[list-item]
    (lambda: T.InternalForce([POINTS[0], T.LoopClosure("trunk", to="foot")]), "a contact with the world"),
    (lambda: built(T.InternalForce([POINTS[0], T.Point("trunk", friction=0.5)]), on=QUADRUPED, contacts=POINTS),
     r"Point\[trunk\]", UnknownContact),
    (lambda: T.LoopClosure("a", to="b", rows=["x", "x"]), r"rows\[1\] is 'x'"),
    (lambda: T.LoopClosure("a", to="b", rows=[]), "at least one"),
    (lambda: T.LoopClosure("head", to="head").prepare(HUMANOID), "seen from itself"),
    (lambda: T.LoopClosure("head", to="heads").prepare(HUMANOID), "did you mean 'head'", UnknownFrame),
    (lambda: T.LoopClosure("a", to="b", rows=["rx"], target=[0, 0, 0]), "a position; a contact of 1"),
    # Diagnosis and adaptation.
    (lambda: T.Thresholds.learnt(np.zeros((1000, 2)), gain=[100.0, 0.0], dt=1e-3), r"gain\[1\] is 0"),
    (lambda: T.Thresholds.learnt(np.zeros((1000, 7)), gain=100.0, dt=1e-3, floor=[1.0, 2.0]), "must have shape"),
    (lambda: T.Thresholds.learnt(np.zeros((10, 3)), gain=100.0, dt=1e-3), "two windows"),
    (lambda: T.Thresholds.predicted(ARM.state(), velocity=0.01, gain=np.nan, dt=1e-3), "gain is nan"),
    (lambda: T.MomentumObserver(gain=[1.0, -2.0]), r"gain\[1\] is -2; it must be > 0"),
    (lambda: T.MomentumObserver(gain=1.0, release=1.5), "release is 1.5"),
    (lambda: T.MomentumObserver(gain=1.0, viscous=[0.0, -1.0]).prepare(PR), r"viscous\[1\] is -1"),
    (lambda: T.MomentumObserver(gain=1.0, coulomb="some").prepare(PR), "coulomb must be .* 'some'"),  # type: ignore[arg-type]
    (lambda: T.MomentumObserver(gain=[1.0, 2.0, 3.0]).prepare(PR), r"gain must have shape \(2,\)"),
    (lambda: built(T.Posture(ARM.q0), level=VELOCITY, components=[OBSERVER]),
     "observes torques, which the velocity level does not decide", NotSupported),
    (lambda: setattr(observing(), "threshold", [1.0, 2.0]), r"threshold must have shape \(12,\)"),
    (lambda: observing().restart(12), "joint is 12; there are joints 0 to 11"),
    (lambda: setattr(T.MeasuredWrench("tool"), "wrench", [0.0, np.nan, 0.0]), r"wrench\[1\] is nan; it must be finite"),
    (lambda: T.When("broken", [T.Release()]), "kind is 'broken'; it must be one of total, partial"),  # type: ignore[arg-type]
    (lambda: T.When("total", [T.Release]), r"reactions\[0\] is .*; it must be a reaction such as Release\(\)"),  # type: ignore[list-item]
    (lambda: T.FaultReaction(3.0), "observer is 3.0; it must be a MomentumObserver"),  # type: ignore[arg-type]
    (lambda: T.FaultReaction(OBSERVER, table=[T.Release()]), r"table\[0\] is Release\(\)"),  # type: ignore[list-item]
    (lambda: T.FaultReaction(OBSERVER, table=[T.When("payload", [T.Carry(T.MomentumObserver(gain=1.0))])]),
     r"table\[0\]: Carry needs FaultReaction's own observer"),
    (lambda: built(T.Posture(ARM.q0), components=[T.FaultReaction(OBSERVER), OBSERVER]),
     "needs its observer in the stack's components, before it"),
    (lambda: reacting(noise=-1.0), "noise is -1"),
    (lambda: reacting(noise=[1.0, 2.0]), "noise must have"),
    (lambda: reacting(hands=["tol"]), "tool", UnknownFrame),
    (lambda: reacting(table=[T.When("total", [T.Release()], joints=["sholder_pitch"])]), "shoulder", UnknownJoint),
    (lambda: reacting(table=[T.When("total", [T.Weigh("Postur", 0.0)])]), "a task of the stack", UnknownName),
    (lambda: reacting(T.Position("tool", target=[0.4, 0.2, 0.5]), T.Damping(), table=[T.When("total", [T.Stop()])]),
     "Stop holds the joints by a task on them", NotSupported),
    (lambda: built(T.Posture(ARM.q0), T.FaultReaction(OBSERVER).limits, components=[OBSERVER]),
     "FaultReaction limits needs its FaultReaction in the stack's components"),
    (lambda: adapting(kp=0.0), r"SlotineLi.kp\[0\] is 0; it must be > 0"),
    (lambda: adapting(kd=[1.0, 1.0, -1.0, 1.0, 1.0, 1.0, 1.0]), r"SlotineLi.kd\[2\] is -1"),
    (lambda: adapting(gain=0.0), "gain is 0"),
    (lambda: adapting(gain="much"), "SlotineLi.gain must be a number, not 'much'"),
    (lambda: adapting(Planar4P(), a_hat=[1.0, 2.0]), r"SlotineLi.a_hat must have shape \(4,\)"),
    (lambda: adapting(Planar4P(), gain=np.eye(3)), r"SlotineLi.gain must have shape \(4, 4\)"),
    (lambda: adapting(Planar4P(), physical=True, a_hat=[0.0, 1.0, 0.0, 0.0]), "a_hat"),
    (lambda: adapting(target=[0.0, 0.0]), r"SlotineLi.target must have shape \(7,\)"),
    (lambda: adapting(a_hat=-1.0), "no body is like the link"),
    (lambda: adapting(links=[]), r"links is \[\]; it must be names"),
    (lambda: adapting(truth=[1.0]), r"truth must have shape \(70,\)"),
    *((lambda settings=settings: adapting(Planar4P(), **settings), "robots from URDFs", NotSupported)
      for settings in ({"composite": 1.0}, {"window": 1.0}, {"estimate_floor": 1.0}, {"links": ["q1"]})),
    (lambda: adapting(wbc.load("quadruped")), "floating base; the regressor needs a fixed one", NotSupported),
    (lambda: adapting(PR, physical=True), "possible coefficients of planar_pr", NotSupported),
    *((lambda others=others: built(T.SlotineLi(ARM.q0, kp=10.0, kd=10.0, gain=1.0).torque, components=others),
       "SlotineLi torque needs its SlotineLi in the stack's components")
      for others in ([], [T.SlotineLi(ARM.q0, kp=10.0, kd=10.0, gain=1.0)])),
]  # fmt: skip


@pytest.mark.parametrize("case", REFUSED, ids=[f"{i} {row[1]}" for i, row in enumerate(REFUSED)])
def test_what_makes_no_sense_is_refused_by_name(case: tuple[Any, ...]) -> None:
    call, says, *kind = case
    with pytest.raises(kind[0] if kind else InvalidInput, match=says):
        call()
