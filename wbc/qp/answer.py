"""What comes of a QP: a back end's own word, the certified solution, and how guesses fared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.qp.certificate import TOLERANCE, Certificate, certificate
from wbc.qp.problem import QP, Shape
from wbc.types import Status, Vec


@final
@dataclass(slots=True)
class Answer:
    """What a back end returns: its own word, before anything is checked."""

    status: Status
    x: Vec
    y: Vec
    z: Vec
    z_box: Vec
    iterations: int = 0
    build_time: float = 0.0

    @classmethod
    def none(cls, shape: Shape, status: Status, iterations: int = 0) -> Answer:
        """No answer: NaN everywhere."""
        x, y, z, z_box = (np.full(size, np.nan) for size in (shape.n, shape.n_eq, shape.n_in, shape.n))
        return cls(status, x, y, z, z_box, iterations)

    @classmethod
    def checked(cls, given: Any, shape: Shape) -> tuple[Answer, str]:
        """What a back end returned, as an answer to a problem of this shape, and what is wrong with it; where anything
        is, there is no answer."""
        if not isinstance(given, cls):
            return cls.none(shape, Status.FAILED), f"{checks.shown(given)}, no wbc.qp.solver.Answer"
        status: Any = given.status
        if not isinstance(status, Status):
            return cls.none(shape, Status.FAILED), f"the status {checks.shown(status)}, no wbc.Status"
        none = cls.none(shape, Status.FAILED if status.ok else status)
        for name, size in (("x", shape.n), ("y", shape.n_eq), ("z", shape.n_in), ("z_box", shape.n)):
            value = getattr(given, name)
            if type(value) is not np.ndarray or value.dtype != np.float64:
                try:
                    value = checks.floats(value)
                except Exception:  # a conversion may raise whatever it likes
                    return none, f"{name} = {checks.shown(value)}, no array of numbers"
                setattr(given, name, value)
            if value.shape != (size,):
                return none, f"{name} of shape {value.shape}, not ({size},)"
        for name in ("iterations", "build_time"):
            if not isinstance(getattr(given, name), int | float | np.number):
                return none, f"{name} = {checks.shown(getattr(given, name))}, no number"
        return given, ""

    def certificate(self, qp: QP, tolerance: float = TOLERANCE) -> Certificate:
        """The certificate of this answer, recomputed from the data of ``qp``."""
        return certificate(qp, self.x, self.y, self.z, self.z_box, tolerance=tolerance)


@final
@dataclass(frozen=True, slots=True)
class Solution:
    """The answer to a QP: status, x (n,), multipliers y (n_eq,), z (n_in,), z_box (n,).

    ``status`` is SOLVED exactly when our own certificate holds, INFEASIBLE and UNBOUNDED exactly when multipliers or
    a direction were found that prove it; ``reason`` says in a sentence why there is no certified answer, and is empty
    where there is one. Times are in seconds: ``build_time`` is spent on turning the QP into the back end's form,
    ``solve_time`` in the back end and in the refinement of its answer.
    Arrays are NaN where there is no answer, and the best the back end has where it gave up.

    Example:
        >>> import wbc
        >>> answer = wbc.solve(wbc.QP([[1.0]], [-1.0]))
        >>> answer.status.name, answer.certificate.ok
        ('SOLVED', True)
    """

    status: Status
    x: Vec
    y: Vec
    z: Vec
    z_box: Vec
    certificate: Certificate
    iterations: int = 0
    build_time: float = 0.0
    solve_time: float = 0.0
    solver: str = ""
    reason: str = ""


@final
@dataclass(slots=True)
class Counts:
    """How often the first guess of the active set was right, had to be repaired, or led nowhere."""

    first: int = 0
    repaired: int = 0
    fallback: int = 0

    def add(self, guesses: int, steps: int) -> None:
        """Count a solve: its guesses, and the steps of the finite method after them."""
        if not steps and guesses <= 1:
            self.first += 1
        elif steps:
            self.fallback += 1
        else:
            self.repaired += 1

    @property
    def total(self) -> int:
        """All solves."""
        return self.first + self.repaired + self.fallback
