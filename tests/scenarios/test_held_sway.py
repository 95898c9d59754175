"""What a robot can hold without a joint, the sway that stays there, and both sides of a robot treated alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
from tasks import Sole, Thresholds, feet
from tasks.scenarios import fault_family
from tasks.scenarios.fault_trials import Case, Outcome, Stand
from tasks.scenarios.held_sway import (
    CHANGES,
    LEVEL,
    UP,
    ChangedSway,
    Held,
    HeldSway,
    Region,
    changed,
    fading,
    reach,
    reserve,
    table_with,
    ways,
)
from tasks.scenarios.humanoid_stand import STANCES
from tasks.scenarios.least_torque import least_torque
from tasks.scenarios.standing import Stance, standing_stack
from tests.robots.examples import needs_examples
from tests.scenarios.runs import run
from wbc.sim.actuator_fault import ActuatorFault

HUMANOID = wbc.load("humanoid", base="floating")
LEGS = [f"{joint}" for joint in HUMANOID.joint_names if "hip" in joint or "knee" in joint or "ankle" in joint]


def mirrored(joint: str) -> str:
    return joint.replace("left", "RIGHT").replace("right", "left").replace("RIGHT", "right")


# ---- what can be held
def test_with_rough_floor_and_all_motors_the_reserve_is_the_way_to_the_edge_of_the_soles() -> None:
    """All bodies accelerate alike, so the centre of pressure is at c − c̈ z / g, and must stay between the soles."""
    contacts = [
        Sole(foot.frame, half_size=foot.half_size, origin=foot.origin, friction=5.0) for foot in HUMANOID.feet.values()
    ]
    state, corners = HUMANOID.state(), []
    for foot in HUMANOID.feet.values():
        frame = state.frame(foot.frame)
        assert foot.half_size is not None
        for x in (-1.0, 1.0):
            for y in (-1.0, 1.0):
                corner = np.array(foot.origin) + np.array([x * foot.half_size[0], y * foot.half_size[1], 0.0])
                corners.append(frame.position + frame.rotation @ corner)
    low, high, com = np.min(corners, axis=0), np.max(corners, axis=0), state.com
    way = min(*(com - low)[:2], *(high - com)[:2])
    height = com[2] - low[2]
    assert reserve(HUMANOID, contacts, HUMANOID.q0) == pytest.approx(way * 9.81 / height, rel=1e-4)


def test_between_two_reaches_and_free_fall_everything_is_in_reach() -> None:
    """What :meth:`Region.left` takes for granted: the accelerations that forces and torques allow are a convex set."""
    rng, contacts = np.random.default_rng(0), feet(HUMANOID)
    for dead in ([], ["left_knee"]):
        corners = [*LEVEL, UP]
        far = reach(HUMANOID, contacts, HUMANOID.q0, np.array(corners), dead)[:, None] * corners
        for _ in range(10):
            inside = rng.dirichlet(np.ones(len(far) + 1)) @ np.vstack([far, -9.81 * UP])
            assert reach(HUMANOID, contacts, HUMANOID.q0, inside[None], dead)[0] >= 1.0 - 1e-9


@pytest.mark.parametrize("joint", ["left_knee", "left_ankle_roll", "right_ankle_pitch", "waist_pitch", "left_hip_roll"])
def test_a_robot_that_stands_still_without_a_joint_is_one_with_a_reserve(joint: str) -> None:
    for lean in (0.0, 0.05):
        q = HUMANOID.q0.copy()
        q[-HUMANOID.nj + HUMANOID.joint("waist_pitch")] += lean
        torque = least_torque(HUMANOID, feet(HUMANOID), q, joint)
        assert (reserve(HUMANOID, feet(HUMANOID), q, [joint]) >= 0.0) == (torque == 0.0)


def test_losing_joints_never_adds_to_the_reserve_and_both_sides_have_the_same() -> None:
    contacts = feet(HUMANOID)
    sound = reserve(HUMANOID, contacts, HUMANOID.q0)
    for joint in LEGS:
        lame = reserve(HUMANOID, contacts, HUMANOID.q0, [joint])
        assert lame <= sound + 1e-9
        assert lame == pytest.approx(reserve(HUMANOID, contacts, HUMANOID.q0, [mirrored(joint)]), abs=1e-6)
    assert reserve(HUMANOID, contacts, HUMANOID.q0, ["left_knee", "right_knee"]) <= reserve(
        HUMANOID, contacts, HUMANOID.q0, ["left_knee"]
    )


# ---- the sway
@pytest.fixture(scope="module")
def wide() -> HeldSway:
    """Our humanoid, swaying wider than a dead knee allows."""
    stance = replace(STANCES["humanoid"], hand=None, sway=(0.03, 0.05, 0.03))
    return HeldSway(stance.robot("humanoid"), stance, least=0.2)


@pytest.mark.slow
def test_a_dead_knee_moves_the_sway_to_the_other_side_and_makes_it_smaller(wide: HeldSway) -> None:
    left, right = wide.held(["left_knee"]), wide.held(["right_knee"])
    assert left is not None and right is not None
    assert left.share == right.share < 1.0
    assert left.offset[1] < 0.0 < right.offset[1]
    np.testing.assert_allclose(left.offset * [1, -1, 1], right.offset, atol=1e-9)
    assert left.reserve == pytest.approx(right.reserve, abs=1e-3)


def test_of_the_reserve_of_a_sway_is_taken_what_it_accelerates_itself(wide: HeldSway) -> None:
    sways = wide.region(["left_knee"]).sways
    resting = min(sway.reserve for sway in sways if sway.share == 0.0)
    (whole,) = (sway for sway in sways if sway.share == 1.0)
    stack = standing_stack(wide.robot, wide.stance)
    target = next(task for task in stack.tasks if task.name == "CenterOfMass").target
    most = max(float(np.linalg.norm(target(t)[2])) for t in np.arange(1.0, 11.0, 0.01))
    assert most <= resting - whole.reserve <= 1.2 * most


def test_what_nothing_else_can_do_is_not_answered_with_a_sway(wide: HeldSway) -> None:
    assert wide.held(["left_shoulder_pitch"]) is None


def test_one_sway_goes_over_into_the_other_without_a_jump() -> None:
    stance: Stance = STANCES["humanoid"]
    robot = stance.robot("humanoid")
    usual = next(task for task in standing_stack(robot, stance).tasks if task.name == "CenterOfMass").target
    held = Held(np.array([0.01, -0.02, 0.0]), 0.5, 0.3)
    target = ChangedSway(usual, usual, held, 2.3, np.array([0.8, 0.8, 0.5]))
    for now, before in zip(target(2.3)[:2], usual(2.3)[:2], strict=True):
        np.testing.assert_allclose(now, before, atol=1e-12)
    h = 1e-5
    for t in (2.3 + 0.3 * 0.8, 2.3 + 0.5, 2.3 + 0.8):
        (x0, v0, _), (_, v, a), (x1, v1, _) = target(t - h), target(t), target(t + h)
        np.testing.assert_allclose((x1 - x0) / (2 * h), v, atol=1e-6)
        np.testing.assert_allclose((v1 - v0) / (2 * h), a, atol=1e-2)
    late = 2.3 + 2 * 0.8
    centre = usual(0.0)[0]
    np.testing.assert_allclose(target(late)[0], centre + held.offset + 0.5 * (usual(late)[0] - centre))
    np.testing.assert_allclose(target(late)[2], 0.5 * usual(late)[2])


Path = tuple[np.ndarray, np.ndarray, np.ndarray]
EDGE, FALL = 0.03, 15.0


def pendulum() -> Region:
    """A body of constant height over a floor that ends at x = ±EDGE: c̈ = FALL (c − p), and it may push at any |p| <=
    EDGE. It may come to rest at three places."""
    x = np.linspace(-0.02, 0.02, 5)
    most = np.array([FALL * (EDGE + np.sign(d[0]) * x) / max(abs(d[0]), 1e-3) for d in LEVEL])
    reached = np.concatenate([most, np.full((1, 5), 1e3)])[:, :, None, None] + np.zeros((9, 5, 5, 5))
    rest = [Held(np.array([at, 0.0, 0.0]), 0.0, FALL * (EDGE - abs(at))) for at in (-0.02, 0.0, 0.02)]
    return Region(reached, np.full(3, 0.02), 9.81, FALL, rest)


def still(t: float) -> Path:
    return np.zeros(3), np.zeros(3), np.zeros(3)


def test_what_is_left_of_a_pendulum_is_the_way_of_its_pressure_to_the_edge() -> None:
    region, rng = pendulum(), np.random.default_rng(0)
    place, a = np.zeros((2, 50, 3))
    place[:, 0], a[:, 0] = rng.uniform(-0.02, 0.02, 50), rng.uniform(-1.0, 1.0, 50)
    found, left = region.left(place, a), FALL * (EDGE - np.abs(place[:, 0] - a[:, 0] / FALL))
    inside = left > 0.0
    assert 10 < inside.sum() < 45
    np.testing.assert_allclose(found[inside], left[inside], atol=1e-3)
    assert (found[~inside] < 0.0).all()
    middle, falling = np.zeros((1, 3)), -0.5 * 9.81 * UP[None]
    assert region.left(middle, falling) == pytest.approx(0.5 * region.left(middle, 0.0 * middle))


def test_what_can_be_caught_is_caught_however_it_accelerates_at_that_moment() -> None:
    """A pendulum can be caught exactly if its capture point x + v/ω is over the floor (Koolen et al., IJRR 2012)."""
    region, rng, omega = pendulum(), np.random.default_rng(0), FALL**0.5
    for _ in range(200):
        x, a = rng.uniform(-0.02, 0.02), rng.uniform(-1.0, 1.0)
        capture = rng.uniform(-1.5, 1.5) * EDGE
        v = omega * (capture - x)

        def moving(t: float, x: float = x, v: float = v, a: float = a) -> Path:
            return (np.array([x + v * t + 0.5 * a * t**2, 0.0, 0.0]), np.array([v + a * t, 0.0, 0.0]),
                    np.array([a, 0.0, 0.0]))  # fmt: skip

        left = float(ways(region, still, moving, 0.0, region.sways).max())
        if abs(capture) < 0.7 * EDGE:
            assert left > 0.0
        elif abs(capture) > EDGE + 1e-3:
            assert left < 0.0


def test_the_way_to_a_sway_counts_as_much_as_the_sway() -> None:
    """A robot at rest in the middle stays there; one that moves comes to rest on the way that leaves most of all."""
    region = pendulum()

    def moving(t: float) -> Path:
        return np.array([0.01 + 0.05 * t, 0.0, 0.0]), np.array([0.05, 0.0, 0.0]), np.zeros(3)

    calm, hard = changed(region, still, still, 0.0, least=0.2), changed(region, still, moving, 0.0, least=0.2)
    assert calm is not None and hard is not None
    assert calm.held is region.sways[1]
    times = np.linspace(0.0, 2.0, 200)

    def least(target: ChangedSway) -> float:
        places, _, accelerations = (np.array(part) for part in zip(*(target(t) for t in times), strict=True))
        return min(float(region.left(places, accelerations).min()), target.held.reserve)

    others = [ChangedSway(still, moving, sway, 0.0, duration) for sway in region.sways for duration in CHANGES]
    assert 0.0 < max(least(other) for other in others) <= least(hard) + 0.02


@settings(max_examples=20)
@given(st.lists(st.floats(-2, 2), min_size=4, max_size=4), st.floats(0.1, 2.0))
def test_a_difference_fades_to_rest_and_its_rates_are_its_derivatives(numbers: list[float], duration: float) -> None:
    moving, last = np.array(numbers).reshape(2, 2), np.array([duration, 0.5 * duration])
    np.testing.assert_allclose(fading(*moving, last, 0.0)[:2], moving, atol=1e-9)
    for late in (duration, duration + 1.0):
        np.testing.assert_array_equal(fading(*moving, last, late), np.zeros((3, 2)))
    t, h = 0.4 * duration, 1e-5 * duration
    before, now, after = (fading(*moving, last, time) for time in (t - h, t, t + h))
    np.testing.assert_allclose((after[0] - before[0]) / (2 * h), now[1], atol=1e-5 * (1 + 1 / duration))
    np.testing.assert_allclose((after[1] - before[1]) / (2 * h), now[2], atol=1e-4 * (1 + 1 / duration**2))


# ---- both sides, in physics
@pytest.fixture(scope="module")
def g1() -> Stand:
    return Stand("g1", STANCES["g1"], floor=0.5)


@needs_examples
@pytest.mark.physics
@pytest.mark.slow
@pytest.mark.parametrize(
    ("ahead", "react"),
    [
        pytest.param(1.1, True, id="before"),
        pytest.param(0.1, True, id="at", marks=pytest.mark.deep),
        pytest.param(1.1, False, id="release alone", marks=pytest.mark.deep),
    ],
)
def test_g1_without_either_knee_stands_where_the_sway_asks_most_of_it(g1: Stand, ahead: float, react: bool) -> None:
    """The sway is back, low and over the dead knee: at 2.3 s of its period of 10 s over the left one, at 9.3 s over the
    right one. The motor fails a second ahead of that, or on the way there. Released alone, both are lost that fail a
    second ahead."""
    sway, threshold = HeldSway.of(g1), np.ones(g1.robot().nj)
    known = Thresholds(threshold, 0.0 * threshold, 0.0 * threshold, 0.0 * threshold)
    table = {"table": table_with(sway)} if react else {}
    outcomes: dict[str, Outcome] = {}
    for side, worst in (("left", 2.3), ("right", 9.3)):
        stand = replace(g1, stance=replace(g1.stance, begun=worst - ahead - 1.2))
        fault = ActuatorFault(joint=f"{side}_knee_joint", start=1.2)
        outcomes[side] = Outcome.of(Case(stand, fault, known, **table).setup(1.8).run(duration=3.0))
    for outcome in outcomes.values():
        assert outcome.found is not None and outcome.found.joint_name == outcome.fault.joint
        assert outcome.delay <= 4e-3
        assert (outcome.stands and outcome.error[-1] < 2e-3) == react
        assert outcome.slip < 5e-3 or not react


@pytest.mark.slow
@pytest.mark.physics
def test_the_family_has_a_row_for_each_joint_and_says_why() -> None:
    result = run("fault-family", "robot=quadruped", "joints=front_left_hip_roll", "moments=1", duration=0.3)
    (row,) = result.figures["rows"]
    assert row["joint"] == "front_left_hip_roll" and row["stood"] == row["moments"] == 1
    assert row["why"] == "sways on" and row["share"] == 1.0
    (section,) = result.sections
    assert section.title == "Every joint"


def test_a_row_is_written_in_millimetres_and_milliseconds() -> None:
    held = Held(np.array([0.01, -0.02, 0.0]), 0.5, 0.3)
    row = fault_family.Row("knee", 4, 3, 4, 1, [0.5], delay=3e-3, error=2e-3, held=held, enough=True).as_dict()
    assert (row["delay_ms"], row["com_rms_mm"], row["offset_mm"]) == (3.0, 2.0, [10.0, -20.0, 0.0])


@pytest.mark.parametrize("robot, count", [("humanoid", 12), ("quadruped", 12)])
def test_the_joints_of_the_legs_are_those_that_move_the_feet(robot: str, count: int) -> None:
    legs = fault_family.leg_joints(wbc.load(robot, base="floating"))
    assert len(legs) == count
    assert not any(part in joint for joint in legs for part in ("waist", "shoulder", "elbow", "neck"))
