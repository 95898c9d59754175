"""Numbers that look like another unit are warned about, and used as they are."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import wbc
from tasks import JointVelocityLimits, Position, Posture, TorqueLimits
from wbc.models.plausible import ImplausibleUnit

ARM = wbc.load("arm")
LEVEL = wbc.VelocityLevel()


def test_degrees_milliseconds_and_millimetres_are_doubted():
    for task, settings, said in (
        (Posture(np.full(7, 45.0)), {}, r"Posture.target has 45 rad for joint .*degrees"),
        (Position("tool", target=[400.0, 200.0, 500.0]), {}, r"Position\[tool\].target is .*millimetres"),
        (Posture(ARM.q0, rate=1.0), {"dt": 1.0}, r"dt is 1 s: .*milliseconds"),
    ):
        with pytest.warns(ImplausibleUnit, match=said):
            control = wbc.Controller(
                ARM, wbc.Stack([task], subject_to=[JointVelocityLimits()]), level=LEVEL, **settings
            )
        assert control.tick(0.0, ARM.q0, np.zeros(7)).status.ok


def test_a_first_state_in_degrees_is_doubted_once():
    control = wbc.Controller(ARM, wbc.Stack([Posture(ARM.q0)], subject_to=[JointVelocityLimits()]), level=LEVEL)
    with pytest.warns(ImplausibleUnit, match="q has 30 rad"):
        control.tick(0.0, np.full(7, 30.0), np.zeros(7))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        control.tick(1e-3, np.full(7, 30.0), np.zeros(7))


def test_what_is_far_but_possible_is_not_doubted():
    humanoid = wbc.load("humanoid")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for robot, task in (
            (ARM, Posture(np.full(7, 6.0))), (ARM, Position("tool", target=[2.0, 0.0, 0.0])),
            (humanoid, Position(humanoid.frame_names[-1], target=[500.0, 0.0, 0.0])),
        ):  # fmt: skip
            wbc.Controller(robot, wbc.Stack([task]), level=LEVEL, dt=0.05).tick(0.0, robot.q0, np.zeros(robot.nv))


@pytest.mark.parametrize(("most", "doubted"), [(2e-5, True), (1e-3, False)])
def test_torques_limited_to_what_counts_as_met_are_doubted(most: float, *, doubted: bool):
    stack = wbc.Stack([Posture(ARM.q0)], subject_to=[TorqueLimits(np.full(7, most))])
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    found = [str(one.message) for one in said if issubclass(one.category, ImplausibleUnit)]
    assert bool(found) == doubted
    assert all("a limit counts as met within 1e-06 N m: is this another unit?" in sentence for sentence in found)
