"""The list of solvers, their settings, the gate in front of them and the judgement behind them."""

from __future__ import annotations

import importlib.util
import re
import sys
import tomllib
from collections.abc import Callable
from dataclasses import FrozenInstanceError, dataclass, fields
from pathlib import Path
from typing import Any, final

import numpy as np
import pytest

import wbc
from tasks import JointVelocityLimits, Posture
from tests.families.qps import FAMILIES, problem
from tests.qp.rows.test_row_solvers import row_problem
from tests.qp.zoo import random_qp, sequence
from wbc.errors import InvalidProblem, SolverMissing, UnknownSolver, WbcError
from wbc.qp import QP, Session, Shape, Solver, solve
from wbc.qp.rows.standard import StandardSolver
from wbc.qp.solver import Answer
from wbc.qp.solvers import (
    EXTRAS,
    SOLVERS,
    Clarabel,
    Daqp,
    Osqp,
    Piqp,
    ProxQp,
    QpSolvers,
    by_name,
    names,
    usable,
)
from wbc.qp.solvers.kept import KeptSession
from wbc.types import Status

DOCUMENT = Path(__file__).parents[2] / "docs" / "solvers.md"
CORE = ["pdas", "daqp", "proxqp", "osqp", "clarabel"]


@final
@dataclass(frozen=True)
class Spy(Solver):
    """Counts the problems that reach it, and answers what it is told."""

    name = "spy"
    seen: list[QP]
    answer: Answer | None = None

    def open(self, shape: Shape) -> Session:
        return SpySession(self, shape)


@final
class SpySession(Session):
    def __init__(self, solver: Spy, shape: Shape) -> None:
        super().__init__(solver, shape)
        self.spy = solver

    def _solve(self, qp: QP) -> Answer:
        self.spy.seen.append(qp)
        return self.spy.answer or Answer.none(qp.shape, Status.FAILED)


@final
@dataclass(frozen=True)
class Returns(Solver):
    """Returns whatever it is told to."""

    made: Callable[[QP], Any]
    name = "mine"

    def open(self, shape: Shape) -> Session:
        session = SpySession(self, shape)  # type: ignore[arg-type]
        session._solve = self.made  # type: ignore[method-assign]
        return session


def with_part(which: str, change: Callable[[np.ndarray], Any]) -> Callable[[QP], Any]:
    """An answer of zeros with one part changed."""

    def made(qp: QP) -> Answer:
        sizes = {"x": qp.n, "y": len(qp.b), "z": len(qp.cl), "z_box": qp.n}
        parts: dict[str, Any] = {name: np.zeros(size) for name, size in sizes.items()}
        return Answer(Status.SOLVED, **(parts | {which: change(parts[which])}))

    return made


ODD = {
    "None": lambda part: None, "long": lambda part: np.append(part, 0.0), "a column": lambda part: part[:, None],
    "complex": lambda part: part + 1j, "text": lambda part: "abc", "a number": lambda part: 1.0,
}  # fmt: skip
NO_ANSWERS: dict[str, Callable[[QP], Any]] = {
    "None": lambda qp: None, "a pair": lambda qp: (np.zeros(qp.n), 1),
    "a status of another kind": lambda qp: Answer("optimal", *(4 * [np.zeros(qp.n)])),  # type: ignore[arg-type]
    "no status": lambda qp: Answer(None, *(4 * [np.zeros(qp.n)])),  # type: ignore[arg-type]
    "failed": lambda qp: Answer(Status.FAILED, *(4 * [None])),  # type: ignore[arg-type]
    "infeasible": lambda qp: Answer(Status.INFEASIBLE, *(4 * [None])),  # type: ignore[arg-type]
    **{f"{which} {how}": with_part(which, change) for which in ("x", "y", "z", "z_box") for how, change in ODD.items()},
}  # fmt: skip


@pytest.mark.parametrize("made", NO_ANSWERS.values(), ids=NO_ANSWERS)
def test_what_is_no_answer_is_told_by_the_name_of_the_solver(made: Callable[[QP], Any]) -> None:
    qp = QP(np.eye(2), [-1.0, 0.0], A=[[1.0, 1.0]], b=[1.0], C=[[1.0, 0.0]], cl=[0.0], cu=[0.5], lb=[-1.0, -1.0])
    found = solve(qp, Returns(made))
    assert found.status is Status.FAILED and found.x.shape == (2,)
    assert found.reason.startswith("solver 'mine' returned ")
    robot = wbc.load("arm")
    stack = wbc.Stack([Posture(robot.q0 + 0.1)], subject_to=[JointVelocityLimits()])
    controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), solver=Returns(made))
    assert controller.tick(0.0, robot.q0, np.zeros(robot.nv)).fallback_level == "other solver"
    assert controller.why.startswith("solver 'mine' returned ")


def test_what_was_returned_for_another_problem_is_not_told_again() -> None:
    p = row_problem(0)
    solver = StandardSolver(p, Returns(lambda qp: None))
    assert solver.solve() is Status.FAILED and solver.fault.startswith("solver 'mine' returned None")
    p.G[:] = np.nan
    assert solver.solve() is Status.FAILED and solver.fault == ""


@pytest.mark.parametrize("kind", [list, np.float32])
def test_numbers_of_another_kind_are_an_answer(kind: Any) -> None:
    qp = QP(np.eye(2), [0.0, 0.0])
    as_given = with_part("x", lambda x: x.tolist() if kind is list else x.astype(kind))
    assert solve(qp, Returns(as_given)).status is Status.SOLVED


class Scripted(KeptSession):
    """A workspace that ends as it is told, one status after the other; at the optimum where that is SOLVED."""

    def __init__(self, statuses: list[Status], qp: QP) -> None:
        super().__init__(Spy([]), qp.shape)
        self.statuses, self.log, self.optimum = statuses, [], solve(qp)

    def _write(self, qp: QP) -> bool:
        return True

    def _make(self, qp: QP) -> Any:
        self.log.append("make")
        return object()

    def _update(self, qp: QP, workspace: Any) -> None:
        self.log.append("update")

    def _run(self, qp: QP, workspace: Any) -> Answer:
        status, best = self.statuses.pop(0), self.optimum
        return Answer(status, best.x, best.y, best.z, best.z_box) if status.ok else Answer.none(qp.shape, status)


# ---- names


def test_every_name_is_known_once_and_the_default_comes_first():
    assert names()[0] == "pdas"
    assert len(set(names())) == len(names()) == len(SOLVERS)
    assert set(usable()) <= set(names())
    assert set(CORE) <= set(usable())


def test_a_name_or_a_solver_will_do():
    tight = Daqp(primal_tol=1e-12)
    assert by_name("daqp") == Daqp() and by_name(tight) is tight
    qp = random_qp(0, 4, 1, 3)
    np.testing.assert_allclose(solve(qp, tight).x, solve(qp).x, atol=1e-8)


@pytest.mark.parametrize(("wrong", "near"), [("dapq", "daqp"), ("prox-qp", "proxqp"), ("OSQP", "osqp")])
def test_an_unknown_name_is_answered_with_near_ones(wrong: str, near: str):
    with pytest.raises(UnknownSolver) as caught:
        solve(random_qp(0, 2, 0, 0), wrong)
    assert near in caught.value.available
    assert wrong == "OSQP" or f"did you mean '{near}'" in str(caught.value)


def test_an_unknown_name_is_answered_with_the_installed_solvers_first(monkeypatch: pytest.MonkeyPatch):
    missing = {"piqp", "highspy", "scs", "quadprog", "gurobipy"}
    find = importlib.util.find_spec
    monkeypatch.setattr("wbc.qp.solver.find_spec", lambda module: None if module in missing else find(module))
    with pytest.raises(UnknownSolver, match=r"^there is no solver 'x'; installed: pdas, daqp") as said:
        by_name("x")
    here, *others = str(said.value).split("; ")[1:]
    assert here == f"installed: {', '.join(usable())}"
    extras = ("[solvers]' for highs, piqp, scs", "[gpl]' for quadprog")
    assert others[:2] == [f"from a clone of wbc: pip install '.{extra}" for extra in extras]
    assert others[2].startswith("packages of their own for ") and "gurobi" in others[2] and "daqp" not in others[2]
    monkeypatch.setattr("wbc.qp.solver.find_spec", lambda module: module)
    with pytest.raises(UnknownSolver) as said:
        by_name("x")
    assert str(said.value) == f"there is no solver 'x'; installed: {', '.join(names())}"


def test_the_extras_bring_what_is_said_of_them():
    described = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))
    packages = {solver.name: solver.package.removeprefix("qpsolvers ") for solver in SOLVERS}
    for extra, brought in EXTRAS.items():
        listed = described["project"]["optional-dependencies"][extra]
        assert [re.match("[a-z]+", one)[0] for one in listed] == [packages[name] for name in sorted(brought)]


def test_a_solver_that_is_not_installed_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("wbc.qp.solver.find_spec", lambda module: None)
    with pytest.raises(SolverMissing, match="solver 'clarabel' is not installed; pip install clarabel"):
        by_name("clarabel")
    with pytest.raises(SolverMissing, match="pip install qpsolvers cvxopt"):
        by_name("cvxopt")
    with pytest.raises(SolverMissing, match="pip install daqp"):
        Daqp().open(Shape(1, 0, 0))
    assert usable() == ["pdas"]


def test_listing_the_solvers_imports_none(monkeypatch: pytest.MonkeyPatch):
    for module in ("piqp", "highspy", "scs"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    usable()
    assert not {"piqp", "highspy", "scs"} & set(sys.modules)


def test_whatever_qpsolvers_can_run_has_a_name_here():
    import qpsolvers

    assert set(qpsolvers.available_solvers) <= set(names())


# ---- settings


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.name)
def test_settings_are_frozen(solver: Solver):
    for setting in fields(solver):  # type: ignore[arg-type]
        with pytest.raises(FrozenInstanceError):
            setattr(solver, setting.name, 1)


def test_proxqp_gives_up_after_its_inner_iterations() -> None:
    """Three times two steps, and one for each start; at its own 1500 it has taken half a minute in a tick."""
    solver, most = ProxQp(max_iter=3, max_iter_in=2), 0
    for index in range(20):
        for family in FAMILIES:
            most = max(most, solver.solve(QP(**problem(family, 5, index))).iterations)
    assert 6 <= most <= 9


@pytest.mark.parametrize(
    "solver", [Daqp(max_iter=1), ProxQp(max_iter=1), Piqp(max_iter=1), Osqp(max_iter=1), Clarabel(max_iter=1)]
)
def test_an_iteration_limit_is_told(solver: Solver):
    if not solver.available():
        pytest.skip(f"{solver.name} is not installed")
    qp = sequence(6)[5]
    word = solver.open(qp.shape).unguarded(qp)
    assert word.status is Status.MAX_ITERATIONS
    assert not word.certificate(qp).ok
    answer = solver.solve(qp)  # what is left over may be enough to name the active rows
    assert answer.status is (Status.SOLVED if answer.certificate.ok else Status.MAX_ITERATIONS)
    assert answer.status.ok or answer.reason


# ---- the gate before, the judgement after


def nan_cost(qp: QP) -> None:
    qp.H[0, 0] = np.nan


def nan_gradient(qp: QP) -> None:
    qp.g[0] = np.nan


def nan_row(qp: QP) -> None:
    qp.C[0, 0] = np.nan


def infinite_row(qp: QP) -> None:
    qp.A[0, 0] = np.inf


def nan_bound(qp: QP) -> None:
    qp.ub[0] = np.nan


def crossed(qp: QP) -> None:
    qp.lb[0], qp.ub[0] = 1.0, 0.0


def crossed_row(qp: QP) -> None:
    qp.cl[0], qp.cu[0] = 1.0, 0.0


def asymmetric(qp: QP) -> None:
    qp.H[0, 1] += 1.0


@pytest.mark.parametrize(
    "spoil", [nan_cost, nan_gradient, nan_row, infinite_row, nan_bound, crossed, crossed_row, asymmetric]
)
def test_what_is_refused_never_reaches_a_back_end(spoil: Any):
    spy, qp = Spy([]), random_qp(0, 3, 1, 2)
    session = spy.open(qp.shape)
    session.solve(qp)
    spoil(qp)
    with pytest.raises(InvalidProblem):
        session.solve(qp)
    assert len(spy.seen) == 1


def test_another_shape_is_refused_before_the_back_end():
    spy = Spy([])
    with pytest.raises(InvalidProblem, match=r"opened for Shape\(n=2, n_eq=0, n_in=0\), not Shape\(n=3"):
        spy.open(Shape(2, 0, 0)).solve(random_qp(0, 3, 0, 0))
    assert spy.seen == []


def test_a_back_end_that_calls_garbage_solved_is_not_believed():
    qp, zeros = QP(np.eye(2), [-1.0, -1.0], ub=[2.0, 2.0]), (np.zeros(0), np.zeros(0), np.zeros(2))
    for x in ([np.nan, 0.0], [np.inf, 0.0], [1e300, 0.0]):
        answer = Spy([], Answer(Status.SOLVED, np.array(x), *zeros)).solve(qp)
        assert answer.status is Status.INACCURATE and answer.reason and not answer.certificate.ok
    near = Spy([], Answer(Status.SOLVED, np.array([0.99, 1.01]), *zeros)).solve(qp)
    assert near.status is Status.SOLVED
    np.testing.assert_allclose(near.x, [1.0, 1.0])
    for x in ([0.0, 0.0], [5.0, 5.0]):
        answer = Spy([], Answer(Status.SOLVED, np.array(x), *zeros)).solve(qp)
        assert answer.status is Status.INACCURATE and "size away" in answer.reason


@pytest.mark.parametrize("status", [Status.MAX_ITERATIONS, Status.FAILED, Status.SOLVED])
def test_the_certificate_decides_and_not_the_word_of_the_back_end(status: Status):
    modest = Answer(status, np.ones(2), np.zeros(0), np.zeros(0), np.zeros(2))
    assert Spy([], modest).solve(QP(np.eye(2), [-1.0, -1.0])).status is Status.SOLVED


@pytest.mark.parametrize("status", [Status.MAX_ITERATIONS, Status.FAILED])
def test_how_a_back_end_ended_without_an_answer_is_passed_on(status: Status):
    qp = random_qp(0, 2, 0, 1)
    answer = Spy([], Answer.none(qp.shape, status)).solve(qp)
    assert answer.status is status and answer.reason


@pytest.mark.parametrize("status", [Status.INFEASIBLE, Status.UNBOUNDED])
def test_that_there_is_no_answer_is_nobodys_word(status: Status):
    qp = random_qp(0, 2, 0, 1)
    answer = Spy([], Answer.none(qp.shape, status)).solve(qp)
    assert answer.status is Status.FAILED and "no proof" in answer.reason


def test_a_workspace_is_made_once_and_a_failure_believed_only_from_a_fresh_one():
    qp = random_qp(0, 3, 1, 2)
    ok, bad = Status.SOLVED, Status.MAX_ITERATIONS
    session = Scripted([ok, ok, bad, ok, ok, bad, bad, ok], qp)
    assert [session.solve(qp).status for _ in range(6)] == [ok, ok, ok, ok, bad, ok]
    assert session.log == ["make", "update", "update", "make", "update", "update", "make", "make"]
    session.reset()
    session.statuses.append(ok)
    session.solve(qp)
    assert session.log[-1] == "make"


@pytest.mark.parametrize("claim", [Status.INFEASIBLE, Status.UNBOUNDED])
def test_a_wrong_claim_that_there_is_no_answer_is_a_failure(claim: Status):
    qp = random_qp(0, 3, 1, 2)
    assert Scripted([claim], qp).solve(qp).status is Status.FAILED


@pytest.mark.parametrize("word", [Status.MAX_ITERATIONS, Status.FAILED, Status.SOLVED])
def test_a_back_end_that_does_not_know_why_it_failed_is_told(word: Status):
    good = random_qp(0, 3, 1, 2)
    bad = QP(good.H, good.g, A=good.A, b=good.b, C=np.concatenate([good.A, good.A]), cl=good.b[[0, 0]] + 1.0)
    assert Scripted([word], good).solve(bad).status is Status.INFEASIBLE


@pytest.mark.parametrize("name", ["pdas", "daqp"])
@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1e3, 1e6])
def test_rows_may_be_in_any_unit(name: str, unit: float):
    qp = QP(1e6 * np.eye(2), [-3e6, 1e6], A=[[unit, unit]], b=[unit], lb=[-1, -1])
    answer = solve(qp, name)
    assert answer.status is Status.SOLVED
    np.testing.assert_allclose(answer.x, [2.0, -1.0], atol=1e-6)


@pytest.mark.parametrize("name", ["pdas", "daqp", "clarabel"])
@pytest.mark.parametrize("angle", [1e-4, 3e-6, 1e-6])
def test_rows_that_are_nearly_parallel_are_no_contradiction(name: str, angle: float):
    """Both rows are active, and they meet in (1, 1)."""
    qp = QP(np.eye(2), np.zeros(2), C=[[1.0, 0.0], [1.0, angle]], cl=[-np.inf, 1.0 + angle], cu=[1.0, np.inf])
    answer = solve(qp, name)
    assert answer.status is Status.SOLVED
    np.testing.assert_allclose(qp.C @ answer.x, [1.0, 1.0 + angle], rtol=0, atol=1e-8)


# ---- in a control loop


class Arm:
    """Seven joints follow a hand that asks for more than their limits allow. One tick is 1 ms."""

    dt, n = 1e-3, 7

    def __init__(self) -> None:
        rng = np.random.default_rng(7)
        self.base, self.sway, self.turn = rng.standard_normal((3, 6, self.n))
        self.phase = rng.uniform(0, 2 * np.pi, 6)
        self.rows = rng.standard_normal((2, self.n))
        self.q = np.zeros(self.n)
        self.v_max, self.q_max, self.row_max = np.linspace(0.5, 1.5, self.n), np.linspace(0.2, 0.5, self.n), 1.0

    def qp(self, t: float) -> QP:
        """½ ‖J v − r‖² + posture, |v| ≤ v_max, |q + v dt| ≤ q_max, |C v| ≤ 1: velocities in rad/s."""
        J = self.base + 0.3 * np.sin(3 * t) * self.sway + 0.3 * np.outer(np.ones(6), self.q) * self.turn
        r = 4.0 * np.sin(2 * np.pi * 1.5 * t + self.phase)
        lower = np.maximum(-self.v_max, (-self.q_max - self.q) / self.dt)
        upper = np.minimum(self.v_max, (self.q_max - self.q) / self.dt)
        H, g = J.T @ J + 0.01 * np.eye(self.n), -J.T @ r + 0.01 * 5.0 * self.q
        side = np.full(2, self.row_max)
        return QP(0.5 * (H + H.T), g, C=self.rows, cl=-side, cu=side, lb=lower, ub=upper)

    def violation(self, v: np.ndarray) -> float:
        """Worst limit broken so far by this tick [rad, rad/s]."""
        self.q = self.q + self.dt * v
        return max(
            float((np.abs(v) - self.v_max).max()),
            float((np.abs(self.q) - self.q_max).max()),
            float((np.abs(self.rows @ v) - self.row_max).max()),
        )


@pytest.mark.parametrize("name", [n for n in usable() if not by_name(n).offline])
def test_in_a_loop_no_limit_is_broken_by_more_than_a_millionth(name: str):
    arm = Arm()
    session = by_name(name).open(arm.qp(0.0).shape)
    worst, at_limit = 0.0, 0
    for k in range(1000):
        answer = session.solve(arm.qp(k * arm.dt))
        assert answer.status is Status.SOLVED, f"tick {k}: {answer.status}, {answer.certificate}"
        worst = max(worst, arm.violation(answer.x))
        at_limit += bool((np.abs(answer.z_box) > 1e-3).any())
    assert at_limit > 500, "the loop must run into its limits"
    assert worst <= 1e-6


# ---- the document


def table() -> str:
    """All solvers and the tolerances a name stands for, in Markdown."""
    columns = ("name", "pip install", "settings", "singular H", "same bits twice", "in a control loop")
    lines = [f"| {' | '.join(columns)} |", "|" + " --- |" * len(columns)]
    for solver in SOLVERS:
        told = {f.name: getattr(solver, f.name) for f in fields(solver)}  # type: ignore[arg-type]
        if isinstance(solver, QpSolvers):
            told = solver.settings
        settings = ", ".join(f"{key} = {value}" for key, value in told.items()) or "its own"
        marks = ("yes" if mark else "no" for mark in (solver.semidefinite, solver.repeatable, not solver.offline))
        lines.append(f"| `{solver.name}` | {solver.package or 'nothing more'} | {settings} | {' | '.join(marks)} |")
    return "\n".join(lines)


def test_the_table_in_the_document_is_the_one_of_the_classes():
    text = DOCUMENT.read_text(encoding="utf-8")
    assert table() in text, f"write this into {DOCUMENT.name}:\n{table()}"


def test_the_table_has_every_solver():
    rows = table().splitlines()[2:]
    assert [row.split("`")[1] for row in rows] == names()


def test_errors_have_one_base():
    assert issubclass(UnknownSolver, WbcError) and issubclass(SolverMissing, WbcError)
