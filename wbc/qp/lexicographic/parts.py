"""What is ranked: stages, each a list of what it says about tasks, and what damps them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, final

from wbc.qp.rows import RowTask
from wbc.types import Vec

#: What the share that is given up of a task is called as a bound.
GIVEN_UP = "given up"


@final
@dataclass(frozen=True, eq=False)
class Part:
    """What a stage says about one task: all of it, the direction alone, or the share alone."""

    task: RowTask
    kind: Literal["whole", "direction", "share"] = "whole"

    def __str__(self) -> str:
        return self.task.name if self.kind == "whole" else f"{self.kind} of {self.task.name}"


Stage = Sequence[Part]


class Pull(NamedTuple):
    """What damps a stage while it is decided, ½ Σ ``share`` wⱼ (yⱼ − tⱼ)² on a part of y; no stage below keeps it.

    ``weights`` and ``wanted`` are views that follow the plan; where all weights are 0 nothing is damped.
    """

    columns: slice
    weights: Vec
    wanted: Vec
    share: float
