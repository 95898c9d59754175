"""What a robot, its state, a plan and the fallback levels do not have is not assigned: a slip is told."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import wbc
from tasks import Posture
from wbc.errors import UnknownAttribute
from wbc.models import PlanarPR, load

ARM = load("arm")
CONTROLLER = wbc.Controller(ARM, wbc.Stack([Posture(ARM.q0)]), level=wbc.VelocityLevel())


PLANAR = PlanarPR(m1=1.0, m2=1.0, d2=0.5, I2=0.1, l2=1.0)


@pytest.mark.parametrize(
    ("owner", "slip"),
    [(ARM, "limitz"), (PLANAR, "parameter"), (ARM.state(), "time"), (CONTROLLER.plan, "torque_bound"),
     (CONTROLLER.fallbacks, "failure")],
    ids=["robot", "planar robot", "state", "plan", "fallback levels"],
)  # fmt: skip
def test_an_attribute_that_does_not_exist_is_refused(owner: Any, slip: str) -> None:
    with pytest.raises(AttributeError, match=f"attribute '{slip}'"):
        setattr(owner, slip, 1.0)
    assert not hasattr(owner, slip)


def test_the_name_that_is_near_is_told() -> None:
    with pytest.raises(UnknownAttribute, match="no attribute 'limitz'; did you mean 'limits'"):
        ARM.limitz = 1.0  # type: ignore[attr-defined]
    assert CONTROLLER.tick(0.0, ARM.q0, np.zeros(ARM.nv)).status.ok
