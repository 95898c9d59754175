"""Under ranked levels ``explain()`` names the bound that a row is at, also where a level above holds it there."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import wbc
from tasks import JointLimits, Position, Posture

ARM = wbc.load("arm")
ACTIVE = re.compile(r"JointLimits\.(velocity|torque): (\w+) at its (upper|lower) bound (\S+) ")


@pytest.mark.parametrize("hierarchy", [wbc.Strict(), wbc.Scaled()], ids=lambda hierarchy: type(hierarchy).__name__)
@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.InverseDynamics()], ids=lambda level: level.name)
def test_a_row_is_said_to_be_at_the_bound_where_it_is(level: Any, hierarchy: Any):
    sides, held = [], 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        tasks = [[Position("tool", target=2.0 * rng.normal(size=3))], [Posture(rng.uniform(-2.0, 2.0, ARM.nq))]]
        controller = wbc.Controller(ARM, wbc.Stack(tasks, subject_to=[JointLimits()]), level=level, hierarchy=hierarchy)
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
