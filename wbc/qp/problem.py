"""A quadratic program whose rows have owners, labels and units."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput, InvalidProblem
from wbc.files import Place, written
from wbc.npz import read_json, read_npz
from wbc.tolerances import MODERATE, ROUNDING, SAME, TINY
from wbc.types import Frozen, Mat, Vec

if TYPE_CHECKING:
    import qpsolvers


class Row(NamedTuple):
    """The name of a row: its member, its label, and the unit of its bounds."""

    owner: str
    label: str = ""
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.owner}: {self.label}" if self.label else self.owner


class Objective(NamedTuple):
    """A task whose squared error is a part of the cost: its name, rows S (m, n), target s (m,) and unit of S x − s.

    The certificate says how far S x can be from its optimum.
    """

    name: str
    rows: Mat
    target: Vec
    unit: str = ""


class Shape(NamedTuple):
    """Sizes of a QP: variables, equality rows, two-sided rows."""

    n: int
    n_eq: int
    n_in: int


@dataclass(frozen=True, eq=False)
class QP(Frozen, metaclass=TellsArguments):
    """minimise ½ xᵀHx + gᵀx  subject to  A x = b,  cl ≤ C x ≤ cu,  lb ≤ x ≤ ub.

    Shapes: H (n, n) symmetric, g (n,), A (n_eq, n), C (n_in, n). Bounds may be ±inf and stay
    bounds. ``rows`` names the equality rows, then the two-sided rows, then the variables.
    All rows live in one block of memory, ``matrix`` = [A; C], and all bounds in another, ``sides`` (2, m + n): lower
    and upper sides of the rows, then of the variables. ``A``, ``C``, ``b``, ``cl``, ``cu``, ``lower``, ``upper`` (of
    all rows, m), ``lb`` and ``ub`` are views into these.

    ``tasks`` names parts (name, S (m, n), s (m,), unit) of the cost, each a multiple of |S x − s|². It changes nothing
    in the answer: the certificate then bounds the distance of each S x from its optimum, in the task's unit. Without
    tasks it bounds the distance of every variable.

    Raises:
        InvalidProblem: wrong shapes, NaN, lb > ub or cl > cu, H not symmetric or not positive semidefinite.

    Example:
        >>> import wbc
        >>> qp = wbc.QP([[2.0]], [-2.0], lb=[-0.5], ub=[0.5])
        >>> wbc.solve(qp).x
        array([0.5])
    """

    H: Mat
    g: Vec
    matrix: Mat
    sides: Mat
    n_eq: int
    rows: tuple[Row, ...]
    tasks: tuple[Objective, ...]

    def __init__(
        self,
        H: Any,
        g: Any,
        *,
        A: Any = None,
        b: Any = None,
        C: Any = None,
        cl: Any = None,
        cu: Any = None,
        lb: Any = None,
        ub: Any = None,
        rows: Sequence[Row | tuple[str, str, str]] | None = None,
        tasks: Sequence[Objective | tuple[str, Any, Any, str]] = (),
    ) -> None:
        bad = InvalidProblem
        g = checks.array("g", g, (None,), error=bad)
        n = g.size
        if n == 0:
            raise bad("a QP has at least one variable: g is empty")
        H = checks.array("H", H, (n, n), error=bad)
        if (A is None) != (b is None):
            raise bad("A and b come together: one of them is missing")
        if C is None and (cl is not None or cu is not None):
            raise bad("cl and cu are bounds on C x: C is missing")
        A = np.zeros((0, n)) if A is None else checks.array("A", A, (None, n), error=bad)
        b = np.zeros(0) if b is None else checks.array("b", b, (len(A),), error=bad)
        C = np.zeros((0, n)) if C is None else checks.array("C", C, (None, n), error=bad)
        side = {"cl": (cl, len(C), -np.inf), "cu": (cu, len(C), np.inf), "lb": (lb, n, -np.inf), "ub": (ub, n, np.inf)}
        sides = {
            name: np.full(size, none) if value is None else checks.array(name, value, (size,), finite=False, error=bad)
            for name, (value, size, none) in side.items()
        }
        self._set(
            H=H, g=g, matrix=np.vstack([A, C]),
            sides=np.array([[*b, *sides["cl"], *sides["lb"]], [*b, *sides["cu"], *sides["ub"]]]),
            n_eq=len(A), rows=_named(rows, n, len(A), len(C)), tasks=_objectives(tasks, n),
        )  # fmt: skip
        self.check()
        self._refuse_non_convex()

    @classmethod
    def empty(cls, shape: Shape, rows: Sequence[Row] | None = None) -> QP:
        """Memory for a QP of this shape, NaN where something has still to be written."""
        n, n_eq, n_in = shape
        nan, m = np.nan, n_eq + n_in
        qp = object.__new__(cls)
        qp._set(
            H=np.full((n, n), nan), g=np.full(n, nan), matrix=np.full((m, n), nan),
            sides=np.array([[nan] * m + [-np.inf] * n, [nan] * m + [np.inf] * n]),
            n_eq=n_eq, rows=_named(rows, n, n_eq, n_in), tasks=(),
        )  # fmt: skip
        return qp

    def __repr__(self) -> str:
        n, n_eq, n_in = self.shape
        return f"QP({n} variables, {n_eq} equality rows, {n_in} two-sided rows)"

    # ---- views
    @property
    def lower(self) -> Vec:
        """Lower sides of all rows (m,)."""
        return self.sides[0, : len(self.matrix)]

    @property
    def upper(self) -> Vec:
        """Upper sides of all rows (m,)."""
        return self.sides[1, : len(self.matrix)]

    @property
    def lb(self) -> Vec:
        """Lower bounds of the variables (n,)."""
        return self.sides[0, len(self.matrix) :]

    @property
    def ub(self) -> Vec:
        """Upper bounds of the variables (n,)."""
        return self.sides[1, len(self.matrix) :]

    @property
    def n(self) -> int:
        """Number of variables."""
        return self.g.size

    @property
    def shape(self) -> Shape:
        """Sizes (n, n_eq, n_in)."""
        return Shape(self.g.size, self.n_eq, len(self.matrix) - self.n_eq)

    @property
    def A(self) -> Mat:
        """Equality rows (n_eq, n)."""
        return self.matrix[: self.n_eq]

    @property
    def b(self) -> Vec:
        """Right side of the equality rows (n_eq,)."""
        return self.upper[: self.n_eq]

    @property
    def C(self) -> Mat:
        """Two-sided rows (n_in, n)."""
        return self.matrix[self.n_eq :]

    @property
    def cl(self) -> Vec:
        """Lower side of the two-sided rows (n_in,)."""
        return self.lower[self.n_eq :]

    @property
    def cu(self) -> Vec:
        """Upper side of the two-sided rows (n_in,)."""
        return self.upper[self.n_eq :]

    def cost(self, x: Vec) -> float:
        """½ xᵀHx + gᵀx."""
        return float(0.5 * x @ (self.H @ x) + self.g @ x)

    # ---- the gate every solver stands behind
    def check(self) -> None:
        """Check shapes, finite numbers and bounds. It takes a few microseconds, and every solve begins with it.

        Raises:
            InvalidProblem: NaN or inf in H, g, A, b or C; NaN in a bound; crossed bounds; H not symmetric.
        """
        sound = (
            moderate(self.H)
            and moderate(self.g)
            and moderate(self.matrix)
            and self._symmetric()
            and _ordered(*self.sides)
            and bool((self.lower[: self.n_eq] == self.upper[: self.n_eq]).all())
        )
        if not sound:
            self._refuse()

    def _symmetric(self) -> bool:
        """Whether H u = Hᵀu to rounding for a fixed vector u without pattern: the cheapest test of all entries."""
        H, probe = self.H, _probe(len(self.H))
        skew = H.dot(probe) - probe.dot(H)
        return bool(skew.dot(skew) <= ROUNDING**2 * np.vdot(H, H))

    def _refuse(self) -> None:
        """Look at everything one by one and raise for the first fault; huge numbers have none."""
        for name, value in (("H", self.H), ("g", self.g), ("A", self.A), ("C", self.C)):
            checks.array(name, value, value.shape, error=InvalidProblem)
        self._refuse_bounds()
        checks.array("b", self.b, self.b.shape, error=InvalidProblem)
        unequal = self.lower[: self.n_eq] != self.b
        if unequal.any():
            row = self.rows[int(unequal.argmax())]
            raise InvalidProblem(f"row {row} is an equality: its lower and upper side must be the same number")
        checks.symmetric("H", self.H, error=InvalidProblem)

    def _refuse_bounds(self) -> None:
        lower, upper = self.sides
        possible = (lower <= upper) & (lower < np.inf) & (upper > -np.inf)
        if possible.all():
            return
        i = int(possible.argmin())
        low, high, row = lower[i], upper[i], self.rows[i]
        if np.isnan(low) or np.isnan(high):
            raise InvalidProblem(f"a bound of row {row} is NaN: [{low}, {high}]")
        if low > high:
            raise InvalidProblem(f"the bounds of row {row} are crossed: {low:g} > {high:g} {row.unit}".rstrip())
        raise InvalidProblem(f"the bounds of row {row} are [{low:g}, {high:g}]: nothing can satisfy it")

    def _refuse_non_convex(self) -> None:
        """A point that meets the optimality conditions of a non-convex problem need not be a minimum."""
        slack = SAME * np.abs(self.H).max(initial=0.0)
        try:
            np.linalg.cholesky(self.H + max(slack, TINY) * np.eye(self.n))
        except np.linalg.LinAlgError:
            smallest = float(np.linalg.eigvalsh(self.H)[0])
            if smallest < -slack:
                raise InvalidProblem(
                    f"H is not positive semidefinite, the problem is not convex: an eigenvalue is {smallest:g}"
                ) from None

    def name_tasks(self, tasks: Sequence[Objective]) -> None:
        """Assign the tasks of the cost without checks, for code that writes into the memory of the problem."""
        self._set(tasks=tuple(tasks))

    def copy(self) -> QP:
        """The same problem in memory of its own."""
        qp = object.__new__(QP)
        arrays = {name: getattr(self, name).copy() for name in ("H", "g", "matrix", "sides")}
        tasks = tuple(t._replace(rows=t.rows.copy(), target=t.target.copy()) for t in self.tasks)
        qp._set(**arrays, n_eq=self.n_eq, rows=self.rows, tasks=tasks)
        return qp

    # ---- files and other libraries
    def save(self, path: Place) -> None:
        """Write an .npz that :meth:`load` reads back to the same bits (no pickle).

        Raises:
            InvalidInput: the file cannot be written.
        """
        names = json.dumps([list(r) for r in self.rows])
        tasks = json.dumps([[t.name, t.unit, len(t.rows)] for t in self.tasks])
        task_rows = np.concatenate([np.zeros((0, self.n)), *(t.rows for t in self.tasks)])
        targets = np.concatenate([np.zeros(0), *(t.target for t in self.tasks)])
        with written(path) as aside, aside.open("xb") as file:
            np.savez(file, H=self.H, g=self.g, A=self.A, b=self.b, C=self.C, cl=self.cl, cu=self.cu,
                     lb=self.lb, ub=self.ub, rows=np.array(names), tasks=np.array(tasks), task_rows=task_rows,
                     targets=targets)  # fmt: skip

    @classmethod
    def load(cls, path: Place) -> QP:
        """Read what :meth:`save` wrote.

        Raises:
            InvalidProblem: not such a file.
        """
        try:
            data: dict[str, Any] = dict(read_npz(path))
            rows = [Row(*map(_text, r)) for r in read_json("rows", str(data.pop("rows")))]
            tasks = _stored_tasks(data)
            data = {k: data[k] for k in ("H", "g", "A", "b", "C", "cl", "cu", "lb", "ub")}
        except (InvalidInput, KeyError, TypeError, ValueError) as cause:
            raise InvalidProblem(f"{checks.shown(str(path))} is not a QP saved by this library: {cause}") from cause
        return cls(data.pop("H"), data.pop("g"), rows=rows, tasks=tasks, **data)

    def to_qpsolvers(self) -> qpsolvers.Problem:
        """The same problem for the qpsolvers package: G x ≤ h holds each finite side as one row."""
        import qpsolvers

        up, low = np.isfinite(self.cu), np.isfinite(self.cl)
        G = np.vstack([self.C[up], -self.C[low]])
        h = np.concatenate([self.cu[up], -self.cl[low]])
        bounded = np.isfinite(self.lb).any(), np.isfinite(self.ub).any()
        return qpsolvers.Problem(
            self.H.copy(), self.g.copy(),
            G if len(h) else None, h if len(h) else None,
            self.A.copy() if self.n_eq else None, self.b.copy() if self.n_eq else None,
            self.lb.copy() if bounded[0] else None, self.ub.copy() if bounded[1] else None,
        )  # fmt: skip

    @classmethod
    def from_qpsolvers(cls, problem: qpsolvers.Problem) -> QP:
        """The same problem in our form; sparse matrices become dense."""
        P, q, G, h, A, b, lb, ub = problem.unpack()

        def dense(matrix: Any) -> Any:
            return matrix.toarray() if hasattr(matrix, "toarray") else matrix

        return cls(dense(P), q, A=dense(A), b=b, C=dense(G), cu=h, lb=lb, ub=ub)


def _objectives(tasks: Any, n: int) -> tuple[Objective, ...]:
    """Tasks as given, checked and copied."""
    bad = InvalidProblem
    try:
        given = [Objective(*task) for task in tasks]
    except TypeError as cause:
        raise bad(f"tasks must be a list of (name, rows, target, unit), not {tasks!r}") from cause
    found = []
    for i, task in enumerate(given):
        if not (isinstance(task.name, str) and isinstance(task.unit, str)):
            raise bad(f"tasks[{i}]: name and unit are text, not {task.name!r}, {task.unit!r}")
        rows = checks.array(f"tasks[{i}].rows", task.rows, (None, n), error=bad)
        target = checks.array(f"tasks[{i}].target", task.target, (len(rows),), error=bad)
        found.append(Objective(task.name, rows, target, task.unit))
    return tuple(found)


def _stored_tasks(data: dict[str, Any]) -> list[Objective]:
    """The tasks of a file."""
    tasks, start = [], 0
    for name, unit, size in read_json("tasks", str(data["tasks"])):
        own = slice(start, start + int(size))
        tasks.append(Objective(name, data["task_rows"][own], data["targets"][own], unit))
        start = own.stop
    return tasks


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"a row's name is text, not {value!r}")
    return value


@lru_cache(maxsize=128)
def _probe(n: int) -> Vec:
    """Numbers between one half and three halves, in no order."""
    return 1.0 + 0.5 * np.sin(np.arange(n) ** 2)


def moderate(values: Vec | Mat) -> bool:
    """Whether all entries are finite, and not so large that their squares overflow."""
    if not values.size:
        return True
    # argmin and argmax cost a quarter of min(), max() and all() on arrays of this size; they find a NaN first.
    flat = values.ravel()
    return bool(-MODERATE < flat[flat.argmin()] and flat[flat.argmax()] < MODERATE)


def _ordered(lower: Vec, upper: Vec) -> bool:
    """Whether every interval [lower, upper] has a point."""
    ordered = lower <= upper
    return bool(ordered[ordered.argmin()] and upper[upper.argmin()] > -np.inf and lower[lower.argmax()] < np.inf)


def _named(rows: Sequence[Row | tuple[str, str, str]] | None, n: int, n_eq: int, n_in: int) -> tuple[Row, ...]:
    """Names of all rows and variables; short lists are completed with A[i], C[i], x[i]."""
    default = [Row(f"A[{i}]") for i in range(n_eq)] + [Row(f"C[{i}]") for i in range(n_in)]
    default += [Row(f"x[{i}]") for i in range(n)]
    if rows is None:
        return tuple(default)
    try:
        given = [Row(*r) for r in rows]
    except TypeError as cause:
        raise InvalidProblem(f"rows must be a list of (owner, label, unit), not {rows!r}") from cause
    if len(given) not in (n_eq + n_in, n_eq + n_in + n):
        raise InvalidProblem(f"rows must name {n_eq + n_in} rows (or those and {n} variables), not {len(given)}")
    return tuple(given + default[len(given) :])
