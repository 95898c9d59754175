"""Who is named for a bound: of several constraints and components on one quantity the one whose bound holds."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import tasks as T
import wbc
from wbc.control.answer import active

ROBOT = wbc.load("arm")
NAMES = ROBOT.joint_names
LEVELS = {"velocity": wbc.VelocityLevel, "acceleration": wbc.AccelerationLevel, "torque": wbc.InverseDynamics}


class Narrows(wbc.Component):
    """Narrows what it is told to."""

    def __init__(self, name: str, **bounds: Any) -> None:
        super().__init__(name=name)
        self._overrides = wbc.Overrides(**bounds)

    def before(self, state: Any, last: Any, plan: Any) -> wbc.Overrides:
        return self._overrides


def limits_of(quantity: str, bound: Any, name: str) -> Any:
    kind = {"velocity": T.JointVelocityLimits, "acceleration": T.JointAccelerationLimits, "torque": T.TorqueLimits}[
        quantity
    ]
    return kind(bound, name=name)


def named(quantity: str, level: str, constraints: list[Any], components: list[Any], sign: np.ndarray) -> dict[str, str]:
    """Owners of the bounds that hold the joints when all are pulled far away, by joint."""
    far = T.Posture(ROBOT.q0 + sign, kp=5000.0, rate=100.0)
    stack = wbc.Stack([far], subject_to=constraints, components=components)
    controller = wbc.Controller(ROBOT, stack, level=LEVELS[level](), dt=1e-3)
    command = controller.tick(0.0, ROBOT.q0, np.zeros(ROBOT.nv))
    assert command.status.ok
    return {one.row.label: one.row.owner for one in active(controller)}


@pytest.mark.parametrize(
    ("quantity", "level"),
    [
        ("velocity", "velocity"), ("velocity", "acceleration"), ("acceleration", "velocity"),
        ("acceleration", "acceleration"), ("acceleration", "torque"), ("torque", "torque"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("seed", range(6))
def test_of_several_bounds_on_one_quantity_the_narrowest_is_named(quantity: str, level: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    sign = rng.choice([-1.0, 1.0], ROBOT.nj)
    # Of each joint a bound by two constraints and two components, in an order drawn for it; ties go to the first.
    sizes = np.array([rng.permutation([1.0, 1.25, 1.5, 2.0]) for _ in range(ROBOT.nj)]).T
    sizes *= {"velocity": 0.1, "acceleration": 1.0, "torque": 40.0}[quantity]
    if seed == 0:
        sizes[:] = sizes.max()
    constraints = [limits_of(quantity, sizes[k], f"limit{k}") for k in range(2)]
    components = [Narrows(f"part{k}", **{quantity: (-sizes[k], sizes[k])}) for k in (2, 3)]
    narrowest = sizes.argmin(axis=0)
    expected = {joint: ("limit0", "limit1", "part2", "part3")[k] for joint, k in zip(NAMES, narrowest, strict=True)}
    found = named(quantity, level, constraints, components, sign)
    assert found
    assert found.items() <= expected.items()


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("quantity", ["position", "velocity", "acceleration"])
@pytest.mark.parametrize("limits", [[], [T.JointVelocityLimits(1e3)]], ids=["no limits", "wide limits"])
def test_a_component_narrows_what_no_constraint_limits(level: str, quantity: str, limits: list[Any]) -> None:
    bound = {"position": ROBOT.q0 + 1e-4, "velocity": 0.01, "acceleration": 1.0}[quantity]
    low = {"position": ROBOT.q0 - 1e-4, "velocity": -0.01, "acceleration": -1.0}[quantity]
    found = named("", level, limits, [Narrows("part", **{quantity: (low, bound)})], np.ones(ROBOT.nj))
    assert found == dict.fromkeys(NAMES, "part")


def test_the_advice_of_a_conflict_names_the_component_that_narrows() -> None:
    stack = wbc.Stack(
        [T.Posture(ROBOT.q0)],
        subject_to=[T.JointVelocityLimits(1.0), T.JointVelocity(np.full(ROBOT.nj, 0.5)).exactly()],
        components=[Narrows("slow", velocity=(-0.3, 0.3))],
    )
    controller = wbc.Controller(ROBOT, stack, level=wbc.VelocityLevel())
    controller.tick(0.0, ROBOT.q0, np.zeros(ROBOT.nv))
    said = controller.explain()
    assert f"slow: {NAMES[0]} upper bound up by 0.2 rad/s" in said
    assert "JointVelocityLimits" not in said


@pytest.mark.parametrize("upper", [False, True])
def test_torques_are_named_by_the_motor_or_the_speed_that_bounds_them(upper: bool) -> None:
    sign = 1.0 if upper else -1.0
    weak = Narrows("weak", motors={0: (0.3, 0.0), 1: (1.0, 0.0), 2: (0.5, sign * 2.0)})
    found = named("torque", "torque", [T.TorqueLimits(40.0)], [weak], np.full(ROBOT.nj, sign))
    assert {joint: found[joint] for joint in NAMES[:3] if joint in found}.items() <= {
        NAMES[0]: "weak", NAMES[1]: "TorqueLimits", NAMES[2]: "weak"
    }.items()  # fmt: skip
    assert "weak" in found.values()


def test_limits_by_speed_are_named_where_they_are_the_narrower_ones() -> None:
    by_speed = T.TorqueSpeedLimits(no_load_speed=2.0, tau_max=60.0, name="by_speed")
    stack = wbc.Stack([T.Posture(ROBOT.q0 + 1.0, kp=5000.0)], subject_to=[T.TorqueLimits(50.0), by_speed])
    controller = wbc.Controller(ROBOT, stack, level=wbc.InverseDynamics(), dt=1e-3)
    v = np.zeros(ROBOT.nv)
    v[1] = 1.0
    controller.tick(0.0, ROBOT.q0, v)
    found = {one.row.label: (one.row.owner, one.bound) for one in active(controller)}
    for joint, (owner, bound) in found.items():
        assert owner == ("by_speed" if abs(bound) < 50.0 - 1e-9 else "TorqueLimits"), joint
    assert len(found) > 2


# ---- under ranked levels ``explain()`` names the bound that a row is at, also where a level above holds it there
ARM = wbc.load("arm")
ACTIVE = re.compile(r"JointLimits\.(velocity|torque): (\w+) at its (upper|lower) bound (\S+) ")


@pytest.mark.parametrize("hierarchy", [wbc.Strict(), wbc.Scaled()], ids=lambda hierarchy: type(hierarchy).__name__)
@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.InverseDynamics()], ids=lambda level: level.name)
def test_a_row_is_said_to_be_at_the_bound_where_it_is(level: Any, hierarchy: Any):
    sides, held = [], 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        tasks = [[T.Position("tool", target=2.0 * rng.normal(size=3))], [T.Posture(rng.uniform(-2.0, 2.0, ARM.nq))]]
        controller = wbc.Controller(
            ARM, wbc.Stack(tasks, subject_to=[T.JointLimits()]), level=level, hierarchy=hierarchy
        )
        command = controller.tick(0.0, ARM.q0 + 0.2 * rng.normal(size=ARM.nq), np.zeros(ARM.nv))
        assert command.status.ok
        text = controller.explain()
        decided = command.v if level.order == 1 else command.a
        for what, joint, side, bound in ACTIVE.findall(text):
            value = (command.tau if what == "torque" else decided)[ARM.joint_names.index(joint)]
            assert float(bound) == pytest.approx(value, rel=1e-3), (seed, joint)
            sides.append((side == "upper") == (value > 0.0))  # all of these limits are symmetric
        held += text.count("held for a level above")
    assert len(sides) >= 15 and all(sides) and held >= 5
