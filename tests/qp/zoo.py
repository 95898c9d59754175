"""Small problems with answers one can work out by hand, and problems that have none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wbc.qp import QP
from wbc.types import Status

inf = np.inf
I2 = np.eye(2)
FLAT = np.diag([1.0, 0.0])  # no cost along the second variable


@dataclass(frozen=True)
class Case:
    """A problem and what is known of its answer; ``None`` where it is not unique."""

    name: str
    make: Callable[[], QP]
    x: tuple[float, ...] | None = None
    y: tuple[float, ...] | None = None
    z: tuple[float, ...] | None = None
    z_box: tuple[float, ...] | None = None
    strictly_convex: bool = True
    status: Status = Status.SOLVED

    def __str__(self) -> str:
        return self.name.replace(" ", "-")


SOLVABLE = [
    Case("no row at all", lambda: QP(I2, [-1, -2]), (1, 2), (), (), (0, 0)),
    Case("one variable", lambda: QP([[2.0]], [-2.0], ub=[0.5]), (0.5,), (), (), (1,)),
    Case("equality", lambda: QP(I2, [0, 0], A=[[1, 1]], b=[1]), (0.5, 0.5), (-0.5,), (), (0, 0)),
    Case("row at its upper side", lambda: QP(I2, [-1, -1], C=[[1, 1]], cu=[1]), (0.5, 0.5), (), (0.5,), (0, 0)),
    Case("row at its lower side", lambda: QP(I2, [1, 1], C=[[1, 1]], cl=[-1]), (-0.5, -0.5), (), (-0.5,), (0, 0)),
    Case("bounds", lambda: QP(I2, [-3, 3], lb=[-1, -1], ub=[1, 1]), (1, -1), (), (), (2, -2)),
    Case("bounds that do not matter", lambda: QP(I2, [-3, 1], lb=[-1e6, -1e6], ub=[1e6, 1e6]), (3, -1), (), (), (0, 0)),
    Case(
        "two-sided rows", lambda: QP(I2, [3, 3], C=[[1, 1], [1, -1]], cl=[-1, -5], cu=[2, 5]),
        (-0.5, -0.5), (), (-2.5, 0), (0, 0),
    ),
    Case(
        "equality and bound", lambda: QP(I2, [0, 0], A=[[1, 1]], b=[2], ub=[0.5, inf]),
        (0.5, 1.5), (-1.5,), (), (1, 0),
    ),
    Case(
        "everything at once",
        lambda: QP(np.eye(3), [-1, -2, -3], A=[[1, 1, 0]], b=[1], C=[[0, 0, 1]], cl=[-1], cu=[2], lb=[0.5, -9, -9]),
        (0.5, 0.5, 2), (1.5,), (1,), (-1, 0, 0),
    ),
    Case("variable fixed below", lambda: QP(I2, [-1, -1], lb=[0.5, -inf], ub=[0.5, inf]), (0.5, 1), (), (), (0.5, 0)),
    Case("variable fixed above", lambda: QP(I2, [-1, -1], lb=[2, -inf], ub=[2, inf]), (2, 1), (), (), (-1, 0)),
    Case(
        "row with one value", lambda: QP(I2, [-1, -1], C=[[1, 1]], cl=[0.5], cu=[0.5]),
        (0.25, 0.25), (), (0.75,), (0, 0),
    ),
    Case(
        "row without a side", lambda: QP(I2, [-1, -1], C=[[1, 1], [1, 1]], cl=[-inf, -inf], cu=[inf, 1]),
        (0.5, 0.5), (), (0, 0.5), (0, 0),
    ),
    Case("row of zeros", lambda: QP(I2, [-1, -1], C=[[0, 0]], cl=[-1], cu=[1]), (1, 1), (), (0,), (0, 0)),
    Case("duplicated equalities", lambda: QP(I2, [0, 0], A=[[1, 1], [1, 1], [2, 2]], b=[1, 1, 2]), (0.5, 0.5)),
    Case("more equalities than variables", lambda: QP(I2, [0, 0], A=[[1, 1], [1, 0], [0, 1]], b=[3, 1, 2]), (1, 2)),
    Case(
        "degenerate vertex",
        lambda: QP(I2, [-3, -3], C=[[1, 0], [0, 1], [1, 1], [1, 1]], cu=[1, 1, 2, 2], ub=[1, 1]),
        (1, 1),
    ),
    Case("equality held by bounds", lambda: QP(I2, [-3, -3], A=[[1, 1]], b=[2], ub=[1, 1]), (1, 1)),
    Case("equality of one variable", lambda: QP(I2, [1, 1], A=[[2, 0]], b=[1], lb=[0.5, -9], ub=[0.5, 9]), (0.5, -1)),
    Case("touching without pushing", lambda: QP(I2, [-1, 0], C=[[1, 0]], cu=[1], lb=[-9, 0]), (1, 0), (), (0,), (0, 0)),
    Case(
        "units far apart", lambda: QP(1e6 * I2, [-3e6, 1e6], C=[[1e-3, 1e-3]], cu=[1e-3], lb=[-1, -1]),
        (2, -1), (), (1e9,), (0, -1e6),
    ),
    Case(
        "linear program", lambda: QP(0 * I2, [1, 1], C=[[1, 2]], cl=[1], lb=[0, 0]),
        (0, 0.5), (), (-0.5,), (-0.5, 0), strictly_convex=False,
    ),
    Case(
        "linear program on a simplex",
        lambda: QP(np.zeros((3, 3)), [1, 2, 3], A=[[1, 1, 1]], b=[1], lb=[0, 0, 0], ub=[0.6, 0.6, 0.6]),
        (0.6, 0.4, 0), (-2,), (), (1, 0, -1), strictly_convex=False,
    ),
    Case(
        "flat cost, equality", lambda: QP(FLAT, [1, 0], A=[[0, 1]], b=[1]),
        (-1, 1), (0,), (), (0, 0), strictly_convex=False,
    ),
    Case(
        "flat cost, row", lambda: QP(FLAT, [1, 1], C=[[1, 1]], cl=[0], cu=[3]),
        (0, 0), (), (-1,), (0, 0), strictly_convex=False,
    ),
    Case("many minima", lambda: QP(FLAT, [1, 0], lb=[-5, -5], ub=[5, 5]), strictly_convex=False),
]  # fmt: skip

INFEASIBLE = [
    Case("rows against each other", lambda: QP(I2, [0, 0], C=[[1, 1], [1, 1]], cl=[-inf, 2], cu=[1, inf])),
    Case("row against bounds", lambda: QP(I2, [0, 0], C=[[1, 1]], cl=[3], lb=[0, 0], ub=[1, 1])),
    Case("equalities against each other", lambda: QP(I2, [0, 0], A=[[1, 1], [1, 1]], b=[1, 2])),
    Case("too many equalities", lambda: QP(I2, [0, 0], A=[[1, 1], [1, 0], [0, 1]], b=[3, 1, 2.5])),
    Case("equality against bounds", lambda: QP(I2, [0, 0], A=[[1, 1]], b=[3], ub=[1, 1])),
    Case("row of zeros that must be one", lambda: QP(I2, [0, 0], C=[[0, 0]], cl=[1])),
    Case("flat cost, row against bounds", lambda: QP(FLAT, [1, 1], C=[[1, 1]], cl=[3], lb=[0, 0], ub=[1, 1])),
]

UNBOUNDED = [
    Case("linear cost, no row", lambda: QP(0 * I2, [1, 0])),
    Case("linear cost in a cone", lambda: QP(0 * I2, [-1, -1], A=[[1, -1]], b=[0], lb=[0, 0])),
    Case("slope along the flat direction", lambda: QP(FLAT, [1, 1])),
    Case("slope that no row stops", lambda: QP(FLAT, [1, 1], C=[[1, 1]], cu=[5])),
]


def random_qp(seed: int, n: int, n_eq: int, n_in: int, *, tight: float = 0.5, curvature: float = 0.1) -> QP:
    """A strictly convex problem that a known point satisfies; ``tight`` is how near its rows are."""
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((n, n))
    A, C, point = rng.standard_normal((n_eq, n)), rng.standard_normal((n_in, n)), rng.standard_normal(n)
    room = tight * rng.uniform(0.0, 2.0, (4, max(n, n_in)))
    room[rng.uniform(size=room.shape) < 0.25] = inf
    return QP(
        J.T @ J / n + curvature * np.eye(n), 2.0 * rng.standard_normal(n),
        A=A, b=A @ point, C=C, cl=C @ point - room[0, :n_in], cu=C @ point + room[1, :n_in],
        lb=point - room[2, :n], ub=point + room[3, :n],
    )  # fmt: skip


def sequence(ticks: int, seed: int = 0, *, n: int = 12, n_eq: int = 2, n_in: int = 8, rate: float = 0.02) -> list[QP]:
    """Problems that change a little from each to the next, with rows that become active and free again."""
    rng = np.random.default_rng(seed)
    J, A, C, g, swing = (rng.standard_normal(shape) for shape in ((n, n), (n_eq, n), (n_in, n), n, n))
    width, room = rng.uniform(1.0, 2.0, n_in) * np.sqrt(n) / 2, rng.uniform(0.5, 1.5, n)
    turn = rng.standard_normal((n, n))
    problems = []
    for k in range(ticks):
        Jk = J + 0.3 * np.sin(rate * k) * turn
        H, gk = Jk.T @ Jk / n + 0.2 * np.eye(n), g + np.sin(3 * rate * k) * swing
        problems.append(QP(H, gk, A=A, b=np.zeros(n_eq), C=C, cl=-width, cu=width, lb=-room, ub=room))
    return problems
