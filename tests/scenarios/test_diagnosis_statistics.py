"""What each diagnosis counts as in the statistics, and what share of them may be wrong."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import wbc
from tasks import Damping, MomentumObserver
from tasks.components.diagnosis import ACTUATOR, Diagnosis
from tasks.components.load import Load
from tasks.scenarios.diagnosis_statistics import Case, DiagnosisStatistics, Draw
from wbc.sim.disturbance import Payload
from wbc.sim.plant import ForwardDynamicsPlant
from wbc.sim.scenario import Parameters, Settings, Trial
from wbc.sim.simulate import simulate

ARM = wbc.load("arm")
JOINT, OTHER = 1, 3


def said(kind: str, joint: int = JOINT, **more: Any) -> Diagnosis:
    return Diagnosis(kind, joint, ARM.joint_names[joint], 1.0, 1.0, np.zeros(ARM.nj), **more)


def weighed(mass: float, **more: Any) -> Diagnosis:
    return said("payload", OTHER, load=Load("tool", mass, np.zeros(3)), **more)


def drawn(truth: str, *, missing: float = 8.0) -> Any:
    """What happened: it misses ``missing`` thresholds; a load weighs 2 kg."""
    disturbance = Payload("tool", mass=2.0, start=0.5) if truth == "payload" else None
    waving = SimpleNamespace(threshold=np.full(ARM.nj, 0.5))
    return SimpleNamespace(
        truth=truth, joint=JOINT, start=0.5, disturbance=disturbance, waving=waving,
        missing=-0.5 * missing * np.eye(ARM.nj)[JOINT],
    )  # fmt: skip


@pytest.mark.parametrize("kind", ACTUATOR)
def test_a_motor_is_called_by_its_law_and_another_motor_is_blamed(kind: str) -> None:
    right, wrong = (Case.of(drawn(kind), [said(kind, joint)]) for joint in (JOINT, OTHER))
    assert (right.first, right.final, right.accused) == (kind, kind, (False, False))
    assert (wrong.first, wrong.final, wrong.accused) == ("another motor", "another motor", (True, True))
    assert right.size == pytest.approx(8.0)


def test_of_several_diagnoses_the_first_and_what_is_held_in_the_end_count() -> None:
    push = Case.of(drawn("push"), [said("total"), said("external", instead_of=(JOINT,))])
    assert (push.first, push.final, push.accused) == ("total", "external", (True, False))
    motor = Case.of(drawn("partial"), [said("external", OTHER), said("partial")])
    assert (motor.first, motor.final) == ("external", "partial"), "a motor before a push"
    load = Case.of(drawn("payload"), [said("external", OTHER), said("bias"), weighed(2.5)])
    assert (load.first, load.final) == ("external", "payload"), "a load before a motor"
    assert load.mass_error == pytest.approx(0.5)
    nothing = Case.of(drawn("push"), [])
    assert (nothing.first, nothing.final, nothing.accused) == ("nothing", "nothing", (False, False))


RIGHT = {
    "total": [said("total")], "push": [said("external")], "payload": [said("external"), weighed(2.0)],
}  # fmt: skip
#: Of twenty of a kind so many are taken for this, and the demand begins so that it fails.
FLAWS: dict[str, tuple[str, int, list[Diagnosis], str]] = {
    "motors unseen": ("total", 2, [], "failing motors named at once"),
    "motors called loads later": ("total", 1, [said("total"), weighed(1.0, instead_of=(JOINT,))], "motors called a"),
    "loads taken for pushes": ("payload", 3, [said("external")], "loads recognised"),
    "pushes called loads": ("push", 2, [weighed(1.0)], "pushes called a load"),
    "pushes blamed on motors": ("push", 3, [said("total", OTHER)], "pushes blamed on a motor in the end"),
    "nothing": ("push", 0, [], ""),
}


def test_whatever_may_happen_to_an_arm_has_an_answer() -> None:
    waving = SimpleNamespace(
        robot=ARM,
        observer=lambda: MomentumObserver(gain=50.0),
        noise_of_a_tick=None,
        setup=lambda duration, **given: given,
    )
    nothing = cast("Any", None)
    given = cast("Any", Draw(cast("Any", waving), "push", 0.5, JOINT, nothing, np.zeros(ARM.nj), 0).setup())
    observer, reaction = given["components"]
    assert reaction.observer is observer
    assert {when.kind for when in reaction.table} == {*ACTUATOR, "payload"}


@pytest.mark.parametrize("flaw", FLAWS)
def test_a_share_of_wrong_diagnoses_fails_the_demand_that_speaks_of_it(flaw: str) -> None:
    spoilt, count, wrong, text = FLAWS[flaw]
    plant, none = ForwardDynamicsPlant(ARM), cast("Any", None)
    plant.reset(ARM.q0)
    run = simulate(wbc.Controller(ARM, wbc.Stack([Damping()]), level=wbc.InverseDynamics()), plant, duration=2e-3)
    unclear = [("total", [], 1.0), ("push", [said("total")], 1.0)]  # of what misses little nothing is demanded
    cases = [(truth, right, 8.0) for truth, right in RIGHT.items() for _ in range(20)] + 20 * unclear
    for k in [k for k, (truth, _, _) in enumerate(cases) if truth == spoilt][:count]:
        cases[k] = (spoilt, wrong, 8.0)
    trials = []
    for truth, events, missing in cases:
        before = said("total", OTHER)  # before anything happened
        told = [(Diagnosis(**vars(before) | {"t": 0.4}), ()), *((event, ()) for event in events)]
        about = (drawn(truth, missing=missing), SimpleNamespace(events=told))
        setup: Any = SimpleNamespace(robot=None, plant=plant, about=about, stack=wbc.Stack([Damping()]))
        trials.append(Trial("", setup, none, run))
    scenario = DiagnosisStatistics()
    p = Parameters(scenario.parse(["robot=arm"]), Settings("mujoco", "weighted", 1.0))
    result = scenario.judge(iter(trials), p)
    failed = [check.text for check in result.verdict if not check.ok]
    assert len(result.verdict) == 5 and result.ok is not bool(text)
    assert len(failed) == len(text and [text]) and all(one.startswith(text) for one in failed)
