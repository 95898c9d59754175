"""What a plan writes: the rows that each member says, and the equations of the level, on any stack."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tasks as T
import wbc
from tasks.motions import pose_motion, swing
from wbc import AccelerationLevel, Controller, InverseDynamics, Stack, VelocityLevel
from wbc.errors import InvalidInput

ARM, HUMANOID, QUADRUPED = wbc.load("arm"), wbc.load("humanoid"), wbc.load("quadruped")
PATH = T.Sinusoid([0.4, 0.1, 0.5], amplitude=0.1, frequency=[0.5, 0.7, 0.9])
POSE = pose_motion(PATH, swing(np.eye(3), [1, 2, 3], angle=0.4, frequency=0.6))
SLOPE = pinocchio.exp3(np.array([0.3, -0.2, 0.1]))
LIMITS = [T.JointPositionLimits(), T.JointVelocityLimits(), T.JointAccelerationLimits(50.0)]


def reaching() -> Stack:
    return Stack(
        [
            T.Frame("tool", target=POSE, kp=200.0), T.Position("tool", target=[0.4, 0.2], axes="xz", weight=0.1),
            T.Orientation("tool", target=SLOPE, weight=[0.1, 0.2, 0.3]), T.Posture(ARM.q0, weight=1e-2),
            T.JointVelocity(np.zeros(ARM.nj), weight=1e-3), T.Damping(weight=1e-3),
        ],
        subject_to=LIMITS,
    )  # fmt: skip


def standing() -> Stack:
    soles = [f for f in HUMANOID.feet]
    sway = T.Sinusoid(HUMANOID.state().com, amplitude=0.02, frequency=0.5)
    return Stack(
        [T.CenterOfMass(target=sway, kp=100.0), T.Posture(HUMANOID.q0, kp=10.0, weight=1e-2)],
        subject_to=[T.TorqueLimits(), T.JointVelocityLimits()],
        contacts=[T.Sole(sole, half_size=(0.08, 0.04), friction=0.6, origin=(0.01, 0.0, -0.005)) for sole in soles],
    )


def on_points() -> Stack:
    feet = list(QUADRUPED.feet)
    contacts = [T.Point(feet[0], friction=0.7, radius=0.02), T.Point(feet[1], friction=0.7, axes=SLOPE)]
    contacts += [T.Point(foot, friction=0.7) for foot in feet[2:]]
    return Stack(
        [
            T.CenterOfMass(target=QUADRUPED.state().com, kp=100.0), T.Orientation(QUADRUPED.frame_names[0], kp=100.0),
            T.Posture(QUADRUPED.q0, weight=1e-3), T.ContactForce(feet[0], target=[0.0, 0.0, 20.0], weight=1e-4),
        ],
        subject_to=[T.TorqueLimits(), T.JointVelocityLimits()], contacts=contacts,
    )  # fmt: skip


def as_constraint() -> Stack:
    constraint = T.Position("tool", target=PATH, kp=50.0).exactly()
    return Stack([T.Posture(ARM.q0, weight=1.0)], subject_to=[constraint, *LIMITS, T.TorqueLimits()])


CASES: list[tuple[wbc.models.RobotModel, Callable[[], Stack], wbc.stack.formulation.Formulation]] = [
    (ARM, reaching, VelocityLevel()), (ARM, reaching, AccelerationLevel()), (ARM, reaching, InverseDynamics()),
    (HUMANOID, standing, InverseDynamics()), (QUADRUPED, on_points, InverseDynamics()),
    (ARM, as_constraint, InverseDynamics()),
]  # fmt: skip
NAMES = ["arm velocity", "arm acceleration", "arm torque", "humanoid", "quadruped", "constraint"]


def moments(robot: wbc.models.RobotModel, count: int = 6):
    """Times, configurations and velocities."""
    rng = np.random.default_rng(1)
    for k in range(count):
        q = robot.integrate(robot.q0, 0.2 * rng.normal(size=robot.nv)) if k else np.array(robot.q0)
        yield 0.1 * k, q, (0.5 * rng.normal(size=robot.nv) if k % 2 else np.zeros(robot.nv))


def filled(robot, stack, level, moment, state=None):
    """A plan that was filled for a moment."""
    plan, state = level.compile(robot, stack, dt=1e-3), robot.state() if state is None else state
    state.update(*moment)
    plan.start(state)
    plan.fill(state)
    return plan


@pytest.mark.parametrize(("robot", "stack", "level"), CASES, ids=NAMES)
def test_rows_say_what_gains_and_dynamics_ask_for(robot, stack, level):
    """J x = ẏ_ref + rate e or J a = ÿ_ref + kd (ẏ_ref − J v) + kp e − J̇ v, and M a + h − Jᵀ f, written in numpy."""
    for moment in moments(robot):
        v = moment[2]
        plan = filled(robot, stack(), level, moment)
        p, layout, motion = plan.problem, plan.layout, plan.motion
        first, m, nv = layout.motion_row, p.n_rows - layout.motion_row, robot.nv
        J = np.vstack([p.G[first : first + m, :nv], *[np.eye(nv)[robot.nb :]] * motion.n_joint_blocks])
        if level.order == 1:
            wanted = motion.rate_ref + motion.rate * motion.e
        else:
            wanted = motion.acc_ref + motion.kd * (motion.rate_ref - J @ v) + motion.kp * motion.e - motion.drift
        size = 1.0 + np.abs(wanted).max()
        np.testing.assert_allclose(motion.wanted, wanted, rtol=0, atol=1e-11 * size)
        np.testing.assert_array_equal(p.G[first : first + m, p.n], -motion.wanted[:m])
        pulls = (plan.shares * motion.wanted[m:].reshape(plan.shares.shape)).sum(axis=0)
        np.testing.assert_allclose(p.centre[robot.nb - layout.n_u : nv - layout.n_u], pulls, rtol=0, atol=1e-12 * size)
        if level.dynamics:
            state = robot.state()
            state.update(*moment)
            contacts = p.G[layout.contact_row : p.n_rows, :nv]
            np.testing.assert_allclose(p.G[:nv, :nv], state.M, rtol=0, atol=1e-12 * (1.0 + np.abs(state.M).max()))
            np.testing.assert_allclose(p.G[:nv, p.n], state.h, rtol=0, atol=1e-10 * (1.0 + np.abs(state.h).max()))
            forces = p.G[:nv, nv : nv + layout.nf]
            size = 1.0 + np.abs(forces).max(initial=0.0)
            np.testing.assert_allclose(forces, -contacts.T * plan.force_scale, rtol=0, atol=1e-12 * size)


def test_a_plan_may_be_filled_from_one_state_and_then_from_another():
    """States of one robot have memory of their own: the plan reads the one it is given."""
    plan, states = InverseDynamics().compile(ARM, reaching(), dt=1e-3), [ARM.state(), ARM.state()]
    found: list[list[np.ndarray]] = [[], []]
    for state, moment in zip(states, list(moments(ARM))[1:3], strict=True):
        state.update(*moment)
    for _ in range(2):
        for state, rows in zip(states, found, strict=True):
            plan.fill(state)
            rows.append(plan.problem.G[: plan.problem.n_rows].copy())
    for first, second in found:
        np.testing.assert_array_equal(first, second)
    assert np.abs(found[0][0] - found[1][0]).max() > 1e-3


def test_a_subclass_that_writes_its_own_rows_is_asked_for_them():
    class Mirrored(T.Position):
        def fill(self, state, out):
            super().fill(state, out)
            out.e[:] *= -1.0

    target = [0.4, 0.2, 0.5]
    moment = next(iter(moments(ARM)))
    stacks = [Stack([kind("tool", target=target)]) for kind in (T.Position, Mirrored)]
    plain, own = (filled(ARM, stack, VelocityLevel(), moment) for stack in stacks)
    np.testing.assert_allclose(own.motion.wanted[:3], -plain.motion.wanted[:3], rtol=1e-12)


def motion_of(kind: str, rng: np.random.Generator, n: int):
    """A motion of the library, of ``n`` numbers or of a pose, and the moments that matter to it."""
    start, duration, (one, two, *more) = rng.uniform(-1.0, 2.0), 0.1 + rng.random(), rng.normal(size=(6, n))
    if kind == "sinusoid":
        ramp = rng.choice([0.0, 1e-3, 1.0])
        return T.Sinusoid(one, amplitude=two, frequency=more[0], phase=more[1], ramp=ramp), [0.0, ramp]
    if kind == "minimum jerk":
        ends = {"start_time": start, "start_rate": more[0], "end_rate": more[1]}
        return T.MinimumJerk(one, two, duration=duration, **ends), [start, start + duration]
    if kind == "pose":  # to one turned by nothing, by next to nothing, and by nearly half a turn
        angle, axis = rng.choice([0.0, 1e-9, 1e-3 * rng.random(), 3.0 * rng.random()]), one / np.linalg.norm(one)
        first = pinocchio.SE3(pinocchio.exp3(rng.normal(size=3)), two)
        last = pinocchio.SE3(pinocchio.exp3(angle * axis) @ first.rotation, more[0])
        lift = rng.choice([0.0, 0.1])
        motion = T.PoseInterpolation(first, last, duration=duration, start_time=start, lift=lift)
        return motion, [start, start + duration]
    if kind.startswith("samples"):
        count, poses = rng.integers(1, 10), kind.endswith("poses")
        values = [pinocchio.SE3(pinocchio.exp3(x), y) if poses else y for x, y in rng.normal(size=(count, 2, n))]
        known = dict(zip(("rates", "accelerations"), rng.normal(size=(2, count, 6 if poses else n)), strict=True))
        motion = T.Samples(values, period=0.1, **(known if rng.random() < 0.5 else {}))
        return motion, 0.05 * rng.integers(-2, 2 * count + 3, 4)  # at samples, halfway, before and after
    kinds = {"pieces": ["sinusoid", "minimum jerk", "pieces"], "pieces of poses": ["pose"]}[kind]
    starts = np.sort(rng.uniform(-1.0, 3.0, rng.integers(1, 4)))
    return T.Piecewise([(start, motion_of(rng.choice(kinds), rng, n)[0]) for start in starts]), starts


@pytest.mark.parametrize("kind", ["sinusoid", "minimum jerk", "samples", "pieces"])
@pytest.mark.parametrize("axes", ["x", "xz", "xyz"])
@given(numbers=st.integers(0, 2**32 - 1), others=st.lists(st.floats(-1e3, 1e3) | st.floats(-2.0, 4.0), max_size=3))
def test_motions_of_the_library_are_evaluated_as_they_are_when_called(kind, axes, numbers, others):
    """Before, at and after each moment that matters, and between; some are made of pieces themselves."""
    motion, at = motion_of(kind, np.random.default_rng(numbers), len(axes))
    assert_evaluated_as_called(motion, lambda target: T.Position("tool", target=target, axes=axes, kp=50.0), at, others)


@pytest.mark.parametrize("kind", ["pose", "samples of poses", "pieces of poses"])
@given(numbers=st.integers(0, 2**32 - 1), others=st.lists(st.floats(-1e3, 1e3) | st.floats(-2.0, 4.0), max_size=3))
def test_motions_of_poses_are_evaluated_as_they_are_when_called(kind, numbers, others):
    motion, at = motion_of(kind, np.random.default_rng(numbers), 3)
    assert_evaluated_as_called(motion, lambda target: T.Frame("tool", target=target, kp=50.0), at, others)


def assert_evaluated_as_called(motion, make, at, others):
    """The rows of two plans: one is given the motion, the other a function that calls it."""
    called = []

    def other(t):
        called.append(t)
        return motion(t)

    stacks = [Stack([make(target)]) for target in (motion, other)]
    state, plans = ARM.state(), [AccelerationLevel().compile(ARM, stack, dt=1e-3) for stack in stacks]
    assert not plans[0]._bound.moving, "the motion is evaluated by compiled code"
    for t in [*at, *np.nextafter(at, -9.0), *others]:
        state.update(t, ARM.q0, np.ones(ARM.nv))
        for plan in plans:
            plan.fill(state)
        assert called[-1] == t
        mine, asked = (plan.motion for plan in plans)
        for what in ("e", "rate_ref", "acc_ref", "wanted"):
            found, expected = getattr(mine, what), getattr(asked, what)
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * (1.0 + np.abs(expected).max()))


def test_pieces_of_which_one_is_a_users_are_called():
    still = np.array([0.4, 0.2, 0.5])
    motion = T.Piecewise([(0.0, PATH), (1.0, lambda t: (still, np.zeros(3), np.zeros(3)))])
    plan, state = AccelerationLevel().compile(ARM, Stack([T.Position("tool", target=motion)]), dt=1e-3), ARM.state()
    for t, expected in ((0.5, PATH(0.5)[0]), (1.5, still)):
        state.update(t, ARM.q0, np.zeros(ARM.nv))
        plan.fill(state)
        np.testing.assert_allclose(plan.motion.e[:3], expected - state.frame("tool").position, rtol=0, atol=1e-12)


def test_a_motion_whose_values_change_their_size_is_refused_while_it_is_built():
    one, three = (T.Sinusoid(np.zeros(n), amplitude=0.1, frequency=1.0) for n in (1, 3))
    with pytest.raises(InvalidInput, match="1 and 3 numbers"):
        T.Piecewise([(0.0, three), (1.0, one)])
    with pytest.raises(InvalidInput, match=r"shape \(3,\)"):
        T.Position("tool", target=T.Piecewise([(0.0, one), (1.0, one)]))
    pose = T.PoseInterpolation(np.eye(4), np.eye(4), duration=1.0)
    with pytest.raises(InvalidInput, match="3 and 12 numbers"):
        T.Piecewise([(0.0, three), (1.0, T.Piecewise([(0.0, pose)]))])


def test_a_target_that_stops_moving_is_followed_to_where_it_stops():
    reach = T.Position("tool", target=PATH)
    controller = Controller(ARM, Stack([reach]), level=AccelerationLevel())
    controller.tick(0.3, ARM.q0, np.zeros(ARM.nv))
    assert np.abs(controller.plan.motion.rate_ref[:3]).max() > 0.0
    reach.target = [0.4, 0.1, 0.5]
    controller.tick(0.301, ARM.q0, np.zeros(ARM.nv))
    motion = controller.plan.motion
    assert np.abs(motion.rate_ref[:3]).max() == np.abs(motion.acc_ref[:3]).max() == 0.0
    np.testing.assert_allclose(
        motion.e[:3], np.array([0.4, 0.1, 0.5]) - controller.state.frame("tool").position, atol=1e-12
    )


def test_a_task_of_ones_own_stays_python_and_is_called():
    called = []

    class Height(wbc.Task):
        def __init__(self):
            super().__init__(kp=100.0)
            self.dim, self.units = 1, "m"

        def fill(self, state, out):
            called.append(state.t)
            frame = state.frame("tool")
            out.J[:], out.e[:], out.drift[:] = frame.jacobian()[2:3], 0.6 - frame.position[2], frame.drift()[2:3]

    stack = Stack([Height(), T.Posture(ARM.q0, weight=1e-2)], subject_to=LIMITS)
    controller = Controller(ARM, stack, level=AccelerationLevel())
    called.clear()
    answer = controller.tick(0.5, ARM.q0, np.zeros(ARM.nv))
    assert called == [0.5]
    same = Stack(
        [T.Position("tool", target=[0.6], axes="z", kp=100.0), T.Posture(ARM.q0, weight=1e-2)], subject_to=LIMITS
    )
    expected = Controller(ARM, same, level=AccelerationLevel()).tick(0.5, ARM.q0, np.zeros(ARM.nv))
    np.testing.assert_allclose(answer.a, expected.a, rtol=0, atol=1e-9)


def test_forces_and_inertia_that_components_know_of_are_in_the_torques():
    class Load(wbc.Component):
        def before(self, state, last, plan):
            return wbc.Overrides(bias=np.arange(1.0, 1.0 + len(plan.extra_bias)), inertia=0.1 * np.eye(ARM.nv))

    still = np.zeros(ARM.nv)
    stack = Stack([T.Posture(ARM.q0)], subject_to=[T.TorqueLimits()], components=[Load()])
    loaded = Controller(ARM, stack, level=InverseDynamics()).tick(0.0, ARM.q0, still)
    bare = Controller(ARM, Stack([T.Posture(ARM.q0)]), level=InverseDynamics()).tick(0.0, ARM.q0, still)
    more = np.arange(1.0, 1.0 + ARM.nv) + 0.1 * loaded.a
    np.testing.assert_allclose(loaded.tau - bare.tau, more, rtol=0, atol=1e-9)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("level", [VelocityLevel(), InverseDynamics()], ids=repr)
def test_a_row_that_is_too_large_is_called_by_its_name(level):
    class Huge(wbc.Task):
        dim, units = 1, "m"

        def fill(self, state, out):
            out.e[:], out.J[:], out.drift[:] = 0.0, 1e300, 0.0

    controller = Controller(ARM, Stack([Huge(name="mine"), T.Posture(ARM.q0)], subject_to=LIMITS), level=level)
    assert not controller.tick(0.0, ARM.q0, np.zeros(ARM.nv)).status.ok
    assert controller.why == "mine is too large"


@pytest.mark.parametrize("exactly", [False, True])
@pytest.mark.parametrize(
    ("task", "said"),
    [
        (T.Position("tool", target=lambda t: [0.4, 0.1 if t == 0.0 else np.nan, 0.5], name="P"), "P{}: y"),
        (T.Posture(lambda t: np.full(ARM.nj, 0.1 if t == 0.0 else np.nan), name="Q"), "Q{}: " + ARM.joint_names[0]),
    ],
    ids=["position", "posture"],
)
def test_a_target_that_becomes_nan_is_told_from_a_row_that_does(task, said, exactly):
    rest = T.JointVelocity(np.zeros(ARM.nj), weight=1e-3)
    stack = Stack([rest], subject_to=[task.exactly(), *LIMITS]) if exactly else Stack([task, rest], subject_to=LIMITS)
    controller = Controller(ARM, stack, level=VelocityLevel())
    for t in (0.0, 1e-3):
        controller.tick(t, ARM.q0, np.zeros(ARM.nv))
    assert controller.why == f"target of {said.format(' exactly' if exactly else '')} is not finite"
