"""Filling a member's rows the way a plan does, and seeing everything it does wrong with the memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, final

import numpy as np

from wbc.models.model import RobotModel, RobotState
from wbc.stack.member import explained
from wbc.testing.failure import require
from wbc.testing.robots import Moment
from wbc.types import Vec

Arrays = dict[str, Vec]
_GUARD = 12345.678


@final
@dataclass(frozen=True, eq=False)
class Filling:
    """How one member fills: ``write(state, out)`` into an ``out`` with arrays of ``shapes``.

    Arrays in ``zero`` start at zero and may be left alone, those in ``optional`` start as NaN and may be left alone;
    all others must be written.
    """

    name: str
    model: RobotModel
    write: Callable[[RobotState, Any], None]
    out: Callable[[], Any]
    shapes: Mapping[str, tuple[int, ...]]
    zero: frozenset[str] = frozenset()
    optional: frozenset[str] = frozenset()
    may_be_infinite: frozenset[str] = frozenset()

    def at(self, moment: Moment, poison: float = np.nan) -> Arrays:
        """The rows at a moment, from fresh memory; nothing wrong with them, or CheckFailed."""
        return self._fill(self._memory(poison), moment, self._state)

    def check_purity(self, twin: Filling, when: list[Moment]) -> None:
        """Twice the same bits: whatever was in the memory, whatever was filled between or before.

        ``twin``, a copy, meets the moments in the other order. Beside each of ``when`` stand those that have another
        time, configuration or velocity alone: who keeps numbers by one of these gives those of another moment.

        Raises:
            CheckFailed: naming the array.
        """
        around = []
        for (t, q, v), (other_t, other_q, _) in zip(when, [*when[1:], when[0]], strict=True):
            around += [(other_t, q, v), (t, other_q, v), (t, q, 0.0 * v), (t, q, v)]
        for first, second in zip(around, [*around[1:], around[0]], strict=True):
            fresh = self.at(first)
            # Another state object, while the first one has moved on: who kept a view of the first reads it now.
            memory, other_state = self._memory(1e3), self.model.state()
            self.at(second)
            self._fill(memory, second, other_state)
            self._require_same(
                self._fill(memory, first, other_state), fresh,
                "of one state came out differently after another was filled; it must depend on the state alone, and "
                "write all it ever writes",
            )  # fmt: skip
        for moment, other in zip(around, reversed([twin.at(moment) for moment in reversed(around)]), strict=True):
            said = "depends on the state that was filled first; it must depend on the state alone"
            self._require_same(other, self.at(moment), said)

    def _require_same(self, found: Arrays, expected: Arrays, said: str) -> None:
        for array in expected:
            same = found[array].tobytes() == expected[array].tobytes()
            require(same, f"{self.name}.fill is not pure: out.{array} {said}")

    @cached_property
    def _state(self) -> RobotState:
        return self.model.state()

    def _memory(self, poison: float) -> tuple[Any, dict[str, tuple[Vec, Vec]]]:
        out, memory = self.out(), {}
        for array, shape in self.shapes.items():
            wide = np.full([size + 2 for size in shape], _GUARD)
            inner = wide[tuple(slice(1, -1) for _ in shape)]
            inner[:] = 0.0 if array in self.zero else np.nan if array in self.optional else poison
            setattr(out, array, inner)
            memory[array] = (wide, inner)
        return out, memory

    def _fill(self, memory: tuple[Any, dict[str, tuple[Vec, Vec]]], moment: Moment, state: RobotState) -> Arrays:
        out, arrays = memory
        state.update(*moment)
        name = self.name
        with explained(f"{name}.fill"):
            self.write(state, out)
        require(
            np.array_equal(state.q, moment[1]) and np.array_equal(state.v, moment[2]), f"{name}.fill changed the state"
        )
        for array, (wide, inner) in arrays.items():
            around = np.ones(wide.shape, dtype=bool)
            around[tuple(slice(1, -1) for _ in inner.shape)] = False
            require((wide[around] == _GUARD).all(), f"{name}.fill wrote beside out.{array}")
            bad = np.isnan(inner) if array in self.may_be_infinite else ~np.isfinite(inner)
            if array not in self.optional and bad.any():
                at = tuple(int(i) for i in np.argwhere(bad)[0])
                require(
                    False, f"{name}.fill left {inner[at]} in out.{array}{list(at)}; write it, as by out.{array}[:] = …"
                )
        return {array: inner.copy() for array, (_, inner) in arrays.items()}
