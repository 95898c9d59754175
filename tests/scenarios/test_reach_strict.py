"""A hand asked for too much: the same stack, ranked and weighed."""

from __future__ import annotations

import pytest

from tasks.scenarios.reach_strict import ReachStrict
from wbc.sim.scenario import ScenarioResult, Settings

REACH = ReachStrict()


def run(plant: str, hierarchy: str, *settings: str, duration: float = 0.05) -> ScenarioResult:
    chosen = REACH.choose(plant=plant, hierarchy=hierarchy, duration=duration)
    return REACH.run(REACH.parse(settings), Settings(**chosen))


@pytest.mark.parametrize("hierarchy", REACH.hierarchies)
def test_fifty_ticks_under_every_hierarchy(hierarchy: str) -> None:
    result = run("integrator", hierarchy)
    assert result.run.rows == 50 and result.figures["certified_share"] == 1.0
    assert next(iter(result.figures["balance_rms_m"])) == hierarchy
    assert set(result.figures["balance_rms_m"]) == set(REACH.hierarchies)
    assert result.figures["hand_error_m"] < 0.01  # the target has not left yet
    assert result.run.meta["hierarchy"].lower().startswith(hierarchy)


@pytest.mark.physics
@pytest.mark.slow
def test_in_physics_balance_does_not_give_where_weights_let_it() -> None:
    pytest.importorskip("mujoco")
    result = run("mujoco", "strict", "reach=1.0", duration=1.3)
    rms = result.figures["balance_rms_m"]
    assert rms["strict"] < 1e-3
    assert rms["weighted"] > 10.0 * rms["strict"]
    (section,) = result.sections
    assert [row[0] for row in section.items[1].rows] == ["strict", "weighted", "scaled"]
