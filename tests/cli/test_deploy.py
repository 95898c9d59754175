"""``wbc deploy``: a dry check of a robot, and its refusals."""

from __future__ import annotations

import json

import pytest


@pytest.mark.physics
def test_a_dry_check_of_an_arm_finds_nothing(wbc):
    pytest.importorskip("mujoco")
    answer = wbc("deploy", "arm", "--check", "--json")
    told = json.loads(answer.out)
    assert answer.code == 0 and told["ok"] and told["dry"] and told["findings"] == []
    assert told["figures"]["rate"] == pytest.approx(1000.0, rel=0.05)
