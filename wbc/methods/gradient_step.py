"""What a projected gradient step is made of, and what it comes to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from wbc.types import Mat, Vec


@final
@dataclass(frozen=True, eq=False)
class Step:
    """The step α, its velocity v = v_task + α v_null (n,), and what stops it.

    ``interval`` holds all feasible steps; ``active`` the joints at the limit that ends it, none where α_max does.
    Infeasible: α and v are NaN, and the lower end of ``interval`` is above the upper.
    """

    alpha: float
    v: Vec
    interval: tuple[float, float]
    active: tuple[int, ...]
    feasible: bool


@final
@dataclass(frozen=True, eq=False)
class Projection:
    """Where v_task and v_null come from: J (m, n), the task velocity ṙ (m,) and the gradient ∇H (n,).

    ``rounding`` is what last bits of J and ṙ move v_task by: their part of v_task, and of what ṙ asks for in vain over
    the least singular value, times the condition of J.
    """

    J: Mat
    task_velocity: Vec
    gradient: Vec
    rounding: float
