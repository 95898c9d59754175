"""The problems drawn are the ones that matter: enough of them are at a limit, infeasible, or short of rank."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.methods.problems import bare_steps, distributions, drawn, scaled_tasks, steps
from tests.methods.test_diagnosis import faults
from tests.methods.test_parameter_update import updates
from tests.methods.torque_problems import problems
from wbc.methods import (
    FaultFraction,
    ForceDistribution,
    NullSpaceSaturation,
    ParameterUpdate,
    ProjectedGradientStep,
    WeightedTorque,
)
from wbc.methods.shared import factors

Signs = dict[str, bool]


def short_of_rank(A: np.ndarray) -> bool:
    return len(factors(A).V) < min(A.shape)


def of_step(problem: ProjectedGradientStep) -> Signs:
    found = problem.closed_form()
    deficient = problem.origin is not None and short_of_rank(problem.origin.J)
    return {"active": bool(found.active), "infeasible": not found.feasible, "deficient": deficient}


def of_task(problem: NullSpaceSaturation) -> Signs:
    found = problem.solve("daqp")
    return {"active": bool(found.saturated), "infeasible": not found.feasible, "deficient": short_of_rank(problem.J)}


def of_distribution(problem: ForceDistribution) -> Signs:
    found = problem.solve("daqp")
    room = np.concatenate([problem.qp().C @ found.f, found.f - problem.f_min, problem.f_max - found.f])
    active = found.feasible and bool(room.min(initial=np.inf) <= 1e-6 * np.abs(found.f).max())
    return {"active": active, "infeasible": not found.feasible, "deficient": short_of_rank(problem.G)}


def of_torque(problem: WeightedTorque) -> Signs:
    found = problem.solve()
    room = np.minimum(found.tau - problem.tau_min, problem.tau_max - found.tau)
    active = bool((room <= 1e-9 * np.abs(found.tau).max()).any())
    return {"active": active, "infeasible": not found.feasible, "deficient": short_of_rank(problem.J)}


def of_update(problem: ParameterUpdate) -> Signs:
    """Staying where it is is always possible."""
    return {"active": bool(problem.solve().active), "infeasible": True, "deficient": short_of_rank(problem.Y)}


def of_fault(problem: FaultFraction) -> Signs:
    """Every share is possible; of a joint that is asked for nothing it is not known."""
    fraction = problem.solve().fraction
    active = bool(((fraction == 0.0) | (fraction == 1.0)).any())
    return {"active": active, "infeasible": True, "deficient": not problem.identifiable.all()}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("strategy", "signs"),
    [
        (st.one_of(steps(), bare_steps(), steps()), of_step),
        (scaled_tasks(), of_task),
        (distributions(), of_distribution),
        (problems(limited=True), of_torque),
        (updates(), of_update),
        (faults(), of_fault),
    ],
    ids=["projected gradient", "saturation", "force distribution", "torque", "parameters", "faults"],
)
def test_three_in_ten_are_at_a_limit_one_in_twenty_infeasible_one_in_twenty_deficient(
    strategy: st.SearchStrategy[Any], signs: Callable[[Any], Signs]
):
    count: Counter[str] = Counter()

    @settings(max_examples=drawn(300), database=None, deadline=None, suppress_health_check=list(HealthCheck))
    @given(strategy)
    def draw(problem: Any) -> None:
        count.update(name for name, present in signs(problem).items() if present)
        count["drawn"] += 1

    draw()
    shares = {name: count[name] / count["drawn"] for name in ("active", "infeasible", "deficient")}
    assert count["drawn"] >= 0.9 * drawn(300)
    assert shares["active"] >= 0.30, shares
    assert shares["infeasible"] >= 0.05, shares
    assert shares["deficient"] >= 0.05, shares
