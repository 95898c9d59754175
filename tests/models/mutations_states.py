"""Slips in what a robot's state computes."""

from __future__ import annotations

STATE, TESTS = "wbc/models/pinocchio_state.py", "tests/models/test_states.py"

MUTATIONS = [
    (STATE, "dgemv, -1.0, momentum_map", "dgemv, 1.0, momentum_map", TESTS),
    (STATE, "model.gravity = pin.Motion.Zero()", "pass", TESTS),
    (STATE, 'partial(setattr, data, "a", data.a_gf)', "partial(id, data.a_gf)", "tests/models/test_learning.py"),
    (STATE, 'state._learn("drift")', "pass", "tests/models/test_learning.py"),
]
