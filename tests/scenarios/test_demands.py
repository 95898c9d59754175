"""What verdicts on robots that lose motors demand: good outcomes meet it, and each flaw fails what speaks of it."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import wbc
from tasks import MomentumObserver, feet
from tasks.components.diagnosis import ACTUATOR, Diagnosis
from tasks.components.load import Load
from tasks.scenarios import fault_scenario
from tasks.scenarios.diagnosis_statistics import Case as Judged
from tasks.scenarios.diagnosis_statistics import DiagnosisStatistics, Draw
from tasks.scenarios.fault_family import PERIOD
from tasks.scenarios.fault_scenario import FaultScenario, reason
from tasks.scenarios.fault_statistics import Fault, FaultStatistics, Stretch
from tasks.scenarios.fault_trials import Case, Outcome, Pair, Stand, true_error
from tasks.scenarios.humanoid_joint_loss import HumanoidJointLoss
from tasks.scenarios.humanoid_stand import STANCES
from tasks.scenarios.least_torque import least_torque
from tasks.scenarios.quadruped_actuator_weak import QuadrupedActuatorWeak
from tasks.scenarios.quadruped_joint_loss import QuadrupedJointLoss
from tests.scenarios.runs import failed, parameters, resting, trial
from wbc.control.recorder import Run
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.disturbance import Payload
from wbc.sim.scenario import Check

HUMANOID = wbc.load("humanoid", base="floating")
JOINT, FAULT, LEFT = "the joint", 1.0, 0.5
TIMES = 1e-3 * np.arange(4000)
each_scenario = pytest.mark.parametrize(
    "scenario", [HumanoidJointLoss(), QuadrupedJointLoss(), QuadrupedActuatorWeak()], ids=lambda one: one.name
)


def outcome(
    *, stands: bool, error: float, delay: float = 3e-3, named: str | None = JOINT, share: float = LEFT
) -> Outcome:
    """A robot that stands or not, off by ``error`` [m]; ``named`` the joint that was diagnosed after ``delay`` [s]."""
    at = FAULT + delay
    said = [] if named is None else [Diagnosis("total", 0, named, at, at, np.zeros(1))]
    run = Run({"t": TIMES, "signal.FaultReaction.share": np.where(TIMES < at, 1.0, share)[:, None]})
    trial: Any = SimpleNamespace(run=run)
    fault = ActuatorFault(joint=JOINT, start=FAULT)
    return Outcome(trial, fault, said, stands, np.full(len(TIMES), error), slip=1e-3)


LOST, MENDED = {"stands": False, "error": 0.3}, {"stands": True, "error": 1e-3}
#: What is wrong with one of four outcomes with an answer, and how the demands begin that this fails.
FLAWS: dict[str, tuple[dict[str, Any], set[str]]] = {
    "it falls": ({"stands": False}, {"with it, it stands"}),
    "it is off by a decimetre": ({"error": 0.1}, {"CoM error"}),
    "another joint is named": ({"named": "another joint"}, {"first diagnosis names the joint"}),
    "the answer takes a tenth of a second": ({"delay": 0.1}, {"longest from fault to answer"}),
    "no answer comes": ({"named": None}, {"first diagnosis names the joint", "longest from fault to answer"}),
}


def demanded(
    scenario: FaultScenario, without: list[dict[str, Any]], answered: list[dict[str, Any]], *, noise: bool = False
) -> list[Check]:
    robot = "quadruped" if "quadruped" in scenario.name else "humanoid"
    p = parameters(scenario, f"robot={robot}", f"noise={noise}")
    return list(scenario.demand([outcome(**one) for one in without], [outcome(**one) for one in answered], p))


@each_scenario
@pytest.mark.parametrize("noise", [False, True], ids=["clean", "noise"])
def test_good_outcomes_meet_every_demand_in_words_and_a_unit(scenario: FaultScenario, noise: bool) -> None:
    checks = demanded(scenario, 4 * [LOST], 4 * [MENDED], noise=noise)
    assert checks and not failed(checks)
    assert len({check.text for check in checks}) == len(checks)
    assert all(isinstance(check.text, str) and check.text and check.unit for check in checks)


@each_scenario
@pytest.mark.parametrize("noise", [False, True], ids=["clean", "noise"])
@pytest.mark.parametrize("flaw", FLAWS)
def test_a_flaw_of_one_outcome_fails_the_demand_that_speaks_of_it(
    scenario: FaultScenario, noise: bool, flaw: str
) -> None:
    spoilt, texts = FLAWS[flaw]
    found = failed(demanded(scenario, 4 * [LOST], [*3 * [MENDED], MENDED | spoilt], noise=noise))
    assert len(found) == len(texts) and all(text.startswith(tuple(texts)) for text in found)


@pytest.mark.parametrize("noise", [False, True], ids=["clean", "noise"])
def test_of_eight_moments_one_may_be_survived_by_chance_and_one_lost_where_masses_are_not_known(noise: bool) -> None:
    humanoid, fallen = HumanoidJointLoss(), MENDED | {"stands": False}
    for unharmed, lost in product((0, 1, 2), (0, 1, 2)):
        without = [*(8 - unharmed) * [LOST], *unharmed * [MENDED]]
        answered = [*(8 - lost) * [MENDED], *lost * [fallen]]
        found = failed(demanded(humanoid, without, answered, noise=noise))
        assert ("without an answer it falls or slides away" in found) is (unharmed > 1)
        assert ("with it, it stands on its spot" in found) is (lost > (1 if noise else 0))


@each_scenario
def test_a_fault_that_harms_nothing_needs_no_answer_and_is_no_success(scenario: FaultScenario) -> None:
    (text,) = failed(demanded(scenario, 4 * [MENDED], 4 * [MENDED]))
    assert "without an answer" in text


def test_what_came_of_a_trial_is_read_from_its_plant_and_its_record() -> None:
    for fallen in (False, True):
        error = np.tile([[3e-3, 0.0, 4e-3]], (len(TIMES), 1))
        slip = np.linspace(0.0, 0.02, len(TIMES))[:, None] * [[1.0, 0.0]]
        run = Run(
            {"t": TIMES, "error.CenterOfMass": error, "plant.slip.foot": slip, "plant.slip.other": 0.0 * slip},
            {"dt": 1e-3},
        )
        case = Case(Stand("humanoid", STANCES["humanoid"], 0.5), ActuatorFault(joint=JOINT, start=FAULT), None)  # type: ignore[arg-type]
        plant = SimpleNamespace(fallen=fallen, feet=[SimpleNamespace(name="other"), SimpleNamespace(name="foot")])
        before = Diagnosis("total", 0, JOINT, 0.5, 0.5, np.zeros(1))
        reaction = SimpleNamespace(events=[(before, ()), (replace(before, t=FAULT + 2e-3), ())])
        trial: Any = SimpleNamespace(about=(case, reaction), run=run, setup=SimpleNamespace(plant=plant))
        came = Outcome.of(trial)
        assert came.stands is not fallen and came.fate.startswith("falls" if fallen else "stands")
        assert came.false_alarms == 1 and came.delay == pytest.approx(2e-3)
        assert came.rms == pytest.approx(5e-3) and 0.015 < came.slip < 0.02


def test_where_masses_are_wrong_the_error_is_that_of_the_true_centre_of_mass() -> None:
    stand = Stand("humanoid", STANCES["humanoid"], 0.5, masses=0.3, seed=3)
    true, believed, rng = stand.robot(), stand.believed(), np.random.default_rng(0)
    q = np.array([true.random_configuration(rng) for _ in range(3)])
    target, errors, expected = np.array([0.1, 0.2, 0.9]), [], []
    for robot, off in ((believed, errors), (true, expected)):
        state = robot.state()
        for one in q:
            state.update(0.0, one, np.zeros(robot.nv))
            off.append(target - state.com)
    run = Run({"error.CenterOfMass": np.array(errors), "q": q, "plant.q": q})
    np.testing.assert_allclose(true_error(run, stand), np.linalg.norm(expected, axis=1), atol=1e-12)
    assert np.abs(np.array(errors) - expected).max() > 1e-3


def test_the_least_torque_is_that_at_the_fault_and_the_most_that_of_the_sway_before_it() -> None:
    leans = np.linspace(0.0, 0.06, 161)
    q = np.tile(HUMANOID.q0, (len(leans), 1))
    q[:, -HUMANOID.nj + HUMANOID.joint("waist_pitch")] += leans - leans[80]
    run = Run({"t": 0.01 * np.arange(161), "plant.q": q}, {"dt": 0.01})
    fault = ActuatorFault(joint="waist_pitch", start=1.6)
    without: Any = SimpleNamespace(run=run, fault=fault)
    stand = Stand("humanoid", STANCES["humanoid"], 0.5)
    now, most = reason(stand, Pair("", without, without))
    robot = stand.robot()
    torques = [least_torque(robot, feet(robot), q[k], "waist_pitch") for k in (40, 160)]
    assert now == pytest.approx(torques[1], abs=1e-6) and most >= max(torques) - 1e-6
    assert abs(torques[1] - torques[0]) > 0.1


def test_a_fault_is_laid_to_the_joint_that_is_largest_when_its_alarm_rings() -> None:
    """Whatever comes later. An alarm takes two ticks; sizes and peaks count in thresholds."""
    threshold, at = np.array([1.0, 2.0, 0.5]), 200
    residual = np.zeros((600, 3))
    residual[at + 8 :, 1], residual[at + 20 :, 2] = 3.0, 5.0
    residual[at + 3, 0] = 9.0  # for one tick
    fault = ActuatorFault(joint="second", effectiveness=1.0, bias=6.0, start=1e-3 * at, end=1e-3 * (at + 60))
    waving: Any = SimpleNamespace(threshold=threshold)
    stretch = Stretch(waving, 0.6, [(100, 1, "bias", fault)], seed=0)
    run = Run({"tau": np.zeros((600, 3)), "signal.MomentumObserver.residual": residual})
    (found,) = stretch.found(run)
    assert (found.joint, found.kind, found.found) == (1, "bias", 1)
    assert (found.size, found.peak, found.delay) == pytest.approx((3.0, 1.5, 9e-3))
    assert stretch.sound(run) == [(100, 0.0)]


def test_drawn_faults_are_of_the_kind_that_they_are_called_and_leave_time_between_them() -> None:
    robot = wbc.load("arm")
    waving: Any = SimpleNamespace(
        robot=robot, threshold=np.full(robot.nj, 0.5), random=np.random.default_rng(0), seed=lambda: 0
    )
    stretch, free = Stretch.of(waving, 60), 0.5
    assert {kind for _, _, kind, _ in stretch.faults} == {"total", "partial", "bias"}
    for before, joint, kind, fault in stretch.faults:
        assert fault.joint == robot.joint_names[joint] and fault.start - 1e-3 * before == pytest.approx(free)
        left = fault.effectiveness
        assert {"total": left == 0.0, "partial": 0.2 < left < 0.8, "bias": left == 1.0}[kind]
        assert (fault.bias != 0.0) is (kind == "bias") and abs(fault.bias) <= 8.0 * 0.5
        assert fault.end is not None and 0.05 < fault.end - fault.start < 0.1
        free = fault.end + 0.5
    assert stretch.seconds == pytest.approx(free)


def test_a_calm_run_is_looked_at_in_seconds_once_the_robot_has_settled() -> None:
    waving: Any = SimpleNamespace(threshold=np.array([2.0]))
    residual = np.zeros((2600, 1))
    residual[:400], residual[900:902], residual[2000] = 50.0, 3.0, 50.0
    run = Run({"signal.MomentumObserver.residual": residual})
    assert Stretch(waving, 2.6, [], seed=0).sound(run) == [(1000, 1.5), (1000, 0.0), (100, 0.0)]


@each_scenario
def test_motors_fail_at_moments_of_one_period_of_the_full_sway_each_without_and_with_an_answer(
    scenario: FaultScenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fault_scenario, "learnt", lambda stand, solver: None)
    robot = "quadruped" if "quadruped" in scenario.name else "humanoid"
    p = parameters(scenario, f"robot={robot}")
    cases = [case["case"] for case in scenario.cases(p).values()]
    for without, answered in zip(cases[::2], cases[1::2], strict=True):
        assert answered.react and vars(without) == vars(answered) | {"react": False}
    moments = [case.fault.start for case in cases[::2] if case.label.startswith("fault at")]
    assert len(moments) == p["moments"] and moments == sorted(set(moments))
    assert moments[0] > 1.0 and moments[-1] < PERIOD + moments[0]
    assert all(case.fault.start in moments for case in cases)


CLEAR = Fault(joint=1, kind="total", size=4.0, peak=5.0, delay=5e-3, found=1)
SEEN: dict[str, tuple[list[Fault], tuple[int, float], str]] = {
    "three of a hundred are missed": (
        [*97 * [CLEAR], *3 * [replace(CLEAR, peak=0.5, delay=np.inf, found=-1)]], (10**6, 0.5), "detected",
    ),
    "one of ten is laid to another joint": ([*90 * [CLEAR], *10 * [replace(CLEAR, found=2)]], (10**6, 0.5), "laid to"),
    "alarms take a tenth of a second": (100 * [replace(CLEAR, delay=0.1)], (10**6, 0.5), "median delay"),
    "one of a thousand sound ticks rings": (100 * [CLEAR], (10**3, 1.5), "alarms without a fault"),
    "nothing": (100 * [CLEAR], (10**6, 0.5), ""),
}  # fmt: skip


@pytest.mark.parametrize("flaw", SEEN)
def test_statistics_of_faults_demand_each_of_their_figures(flaw: str) -> None:
    faults, window, said = SEEN[flaw]
    robot, scenario = wbc.load("arm"), FaultStatistics()
    about = SimpleNamespace(
        found=lambda run: faults, sound=lambda run: [window], waving=SimpleNamespace(threshold=np.ones(robot.nj))
    )
    plant, run = resting(robot)
    result = scenario.judge(iter([trial(plant, about, run)]), parameters(scenario, "robot=arm"))
    texts = failed(result)
    assert len(texts) == len(said and [said]) and all(said in text for text in texts)
    assert result.ok is not bool(said)


# ---- what each diagnosis counts as in the statistics, and what share may be wrong
ARM = wbc.load("arm")
MOTOR, OTHER = 1, 3


def said(kind: str, joint: int = MOTOR, **more: Any) -> Diagnosis:
    return Diagnosis(kind, joint, ARM.joint_names[joint], 1.0, 1.0, np.zeros(ARM.nj), **more)


def weighed(mass: float, **more: Any) -> Diagnosis:
    return said("payload", OTHER, load=Load("tool", mass, np.zeros(3)), **more)


def drawn(truth: str, *, missing: float = 8.0) -> Any:
    """What happened: it misses ``missing`` thresholds; a load weighs 2 kg."""
    disturbance = Payload("tool", mass=2.0, start=0.5) if truth == "payload" else None
    waving = SimpleNamespace(threshold=np.full(ARM.nj, 0.5))
    return SimpleNamespace(
        truth=truth, joint=MOTOR, start=0.5, disturbance=disturbance, waving=waving,
        missing=-0.5 * missing * np.eye(ARM.nj)[MOTOR],
    )  # fmt: skip


@pytest.mark.parametrize("kind", ACTUATOR)
def test_a_motor_is_called_by_its_law_and_another_motor_is_blamed(kind: str) -> None:
    right, wrong = (Judged.of(drawn(kind), [said(kind, joint)]) for joint in (MOTOR, OTHER))
    assert (right.first, right.final, right.accused) == (kind, kind, (False, False))
    assert (wrong.first, wrong.final, wrong.accused) == ("another motor", "another motor", (True, True))
    assert right.size == pytest.approx(8.0)


def test_of_several_diagnoses_the_first_and_what_is_held_in_the_end_count() -> None:
    push = Judged.of(drawn("push"), [said("total"), said("external", instead_of=(MOTOR,))])
    assert (push.first, push.final, push.accused) == ("total", "external", (True, False))
    motor = Judged.of(drawn("partial"), [said("external", OTHER), said("partial")])
    assert (motor.first, motor.final) == ("external", "partial"), "a motor before a push"
    load = Judged.of(drawn("payload"), [said("external", OTHER), said("bias"), weighed(2.5)])
    assert (load.first, load.final) == ("external", "payload"), "a load before a motor"
    assert load.mass_error == pytest.approx(0.5)
    nothing = Judged.of(drawn("push"), [])
    assert (nothing.first, nothing.final, nothing.accused) == ("nothing", "nothing", (False, False))


RIGHT = {
    "total": [said("total")], "push": [said("external")], "payload": [said("external"), weighed(2.0)],
}  # fmt: skip
#: Of twenty of a kind so many are taken for this, and the demand begins so that it fails.
MISTAKES: dict[str, tuple[str, int, list[Diagnosis], str]] = {
    "motors unseen": ("total", 2, [], "failing motors named at once"),
    "motors called loads later": ("total", 1, [said("total"), weighed(1.0, instead_of=(MOTOR,))], "motors called a"),
    "loads taken for pushes": ("payload", 3, [said("external")], "loads recognised"),
    "pushes called loads": ("push", 2, [weighed(1.0)], "pushes called a load"),
    "pushes blamed on motors": ("push", 3, [said("total", OTHER)], "pushes blamed on a motor in the end"),
    "nothing": ("push", 0, [], ""),
}


def test_whatever_may_happen_to_an_arm_has_an_answer() -> None:
    waving: Any = SimpleNamespace(
        robot=ARM, observer=lambda: MomentumObserver(gain=50.0), noise_of_a_tick=None,
        setup=lambda duration, **given: given,
    )  # fmt: skip
    nothing: Any = None
    given: Any = Draw(waving, "push", 0.5, MOTOR, nothing, np.zeros(ARM.nj), 0).setup()
    observer, reaction = given["components"]
    assert reaction.observer is observer
    assert {when.kind for when in reaction.table} == {*ACTUATOR, "payload"}


@pytest.mark.parametrize("flaw", MISTAKES)
def test_a_share_of_wrong_diagnoses_fails_the_demand_that_speaks_of_it(flaw: str) -> None:
    spoilt, count, wrong, text = MISTAKES[flaw]
    plant, run = resting(ARM)
    unclear = [("total", [], 1.0), ("push", [said("total")], 1.0)]  # of what misses little nothing is demanded
    cases = [(truth, right, 8.0) for truth, right in RIGHT.items() for _ in range(20)] + 20 * unclear
    for k in [k for k, (truth, _, _) in enumerate(cases) if truth == spoilt][:count]:
        cases[k] = (spoilt, wrong, 8.0)
    trials = []
    for truth, events, missing in cases:
        before = said("total", OTHER)  # before anything happened
        told = [(Diagnosis(**vars(before) | {"t": 0.4}), ()), *((event, ()) for event in events)]
        trials.append(trial(plant, (drawn(truth, missing=missing), SimpleNamespace(events=told)), run))
    scenario = DiagnosisStatistics()
    result = scenario.judge(iter(trials), parameters(scenario, "robot=arm"))
    assert len(result.verdict) == 5 and result.ok is not bool(text)
    assert len(failed(result)) == len(text and [text]) and all(one.startswith(text) for one in failed(result))
