"""ContactSchedule: closes and opens contacts at given times, and ramps their normal forces."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import combinations, pairwise
from math import inf, isfinite
from typing import TYPE_CHECKING, Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.stack.component import Schedule
from wbc.stack.overrides import Overrides
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.stack.plan_view import PlanView

#: Share of a tick's step of the ramp with which a contact begins and ends: the cone over no force at all is a point.
FIRST_STEP = 0.1
#: Times that differ by less are the same [s]: a clock that adds up ticks is not exact.
_SAME = 1e-9
#: Of so many contacts that open, plans of all sets are made at once.
_ALL_SETS = 8
_NO_FORCE = (0.0, 0.0, 0.0)


@final
class ContactSchedule(Schedule):
    """A time table of contacts, with bounds on their normal forces before they open and after they close.

    ``timeline``: (time [s], names or frames of the contacts that are closed from then on). The first set holds from the
    beginning. With ``period`` [s] the timeline repeats; its times are then in [0, period).

    Ramps: the normal force of a contact is bounded by f_z <= k m min(t − t_closed, t_opens − t), k the smaller of
    ``ramp`` and ``force_rate`` [N per ms and kg of the robot's mass m]. The bound falls to nearly zero before the
    contact opens and rises after it closes. A robot that cannot stand on the other contacts falls: shift its weight
    first.

    Rates: while a contact is open, or its bound is below the robot's weight, the normal force of every contact changes
    by at most ``force_rate`` r m per ms from the last command, r in N per ms and kg (``inf``: no limit). The impact of
    one foot then does not make the forces of the others jump. This limit is relaxed first if the QP is infeasible
    (:class:`~wbc.control.recovery.Recovery`). ``standing_rate`` is the same limit for the rest of the time, while all
    contacts are closed. By default forces may then change as fast as a push needs; where the state comes from noisy
    sensors, a limit keeps their noise out of the forces. Ramps come first: a force that is above its ramp, since the
    stack was replaced while the bound was low or since it exceeds the weight, falls to it at once.

    ``touching``: a function of a contact's name that says whether a sensor feels the ground. A contact then closes when
    it touches, at most ``early`` seconds before its time; if it touches later, it closes later. A controller then makes
    a plan for each set of those that open: 2ᵏ for k contacts, of which eight take about a second. Of more than eight it
    makes those of the timeline, each also with one contact early or late; others are made between ticks when they are
    needed, and the contacts stay as they were until then.

    Where the clock goes back, or past several changes at once, the set is that of the timeline at that time. A contact
    that closes then starts a ramp; one that stays closed goes on without.

    Signals, in the order of ``names``: ``contacts`` (n,), 1 where one holds, and ``limits`` (n,) [N].

    Raises:
        InvalidInput: an empty timeline, times that do not increase or are outside the period, a ramp or rate that
            is not > 0.
        UnknownContact: a name the stack has not, when a controller is made.

    Example:
        >>> from wbc.tasks import ContactSchedule
        >>> left, right = "left_sole", "right_sole"
        >>> step = ContactSchedule([(0.0, [left, right]), (1.0, [left]), (1.8, [left, right])])
        >>> step.holds(right)
        [(-inf, 1.0), (1.8, inf)]
    """

    def __init__(
        self, timeline: Sequence[tuple[float, Iterable[str]]], *, period: float | None = None, ramp: float = 0.03,
        force_rate: float = 0.05, standing_rate: float = inf, touching: Callable[[str], bool] | None = None,
        early: float = 0.05, name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(name=name)
        self.period = None if period is None else checks.number(f"{self.name}.period", period, low=0.0, strict=True)
        starts, sets = self._read(timeline)
        self.ramp = checks.number(f"{self.name}.ramp", ramp, low=0.0, strict=True)
        self.force_rate = self._rate("force_rate", force_rate)
        self.standing_rate = self._rate("standing_rate", standing_rate)
        self.touching = touching
        self.early = checks.number(f"{self.name}.early", early, low=0.0)
        self.names = tuple(sorted(frozenset().union(*sets)))
        self._sets = sets
        self._holds = {name: self._intervals(name, starts) for name in self.names}
        n = len(self.names)
        self._made, self._until, self._limits = [-inf] * n, [-inf] * n, np.zeros(n)
        self._held: frozenset[str] = frozenset()
        self._next_change = self._now = -inf

    def _rate(self, what: str, given: float) -> float:
        forever = isinstance(given, float) and given == inf
        return inf if forever else checks.number(f"{self.name}.{what}", given, low=0.0, strict=True)

    def _read(self, timeline: Sequence[tuple[float, Iterable[str]]]) -> tuple[list[float], list[frozenset[str]]]:
        timeline = checks.pairs(f"{self.name}.timeline", timeline, "time, names")
        if not timeline:
            raise InvalidInput(f"{self.name}.timeline is empty; it has at least one (time, names)")
        starts = [checks.number(f"{self.name}.timeline[{i}] time", time) for i, (time, _) in enumerate(timeline)]
        for i, (before, after) in enumerate(pairwise(starts), start=1):
            if not before < after:
                raise InvalidInput(f"{self.name}.timeline[{i}] is at {after:g} s, not after {before:g} s")
        if self.period is not None and not (0.0 <= starts[0] and starts[-1] < self.period):
            raise InvalidInput(f"{self.name}.timeline has times outside its period, [0, {self.period:g}) s")
        for i, (_, names) in enumerate(timeline):
            if isinstance(names, str):
                raise InvalidInput(f"{self.name}.timeline[{i}] has the text {names!r}; give a list of names")
        return starts, [frozenset(names) for _, names in timeline]

    # ---- what the timeline says
    def holds(self, name: str) -> list[tuple[float, float]]:
        """When a contact holds by the timeline: (make, break) [s]; of one period, whose last may end in the next."""
        return list(self._holds[name])

    def _intervals(self, name: str, starts: list[float]) -> list[tuple[float, float]]:
        on = [name in names for names in self._sets]
        if all(on):
            return [(-inf, inf)]
        before = on[-1] if self.period is not None else False  # the first set of a timeline without period is made
        makes = [start for start, now, was in zip(starts, on, [before, *on], strict=False) if now and not was]
        breaks = [start for start, now, was in zip(starts, on, [before, *on], strict=False) if was and not now]
        if self.period is None:
            makes = [-inf, *makes[1:]] if on[0] else makes
            return list(zip(makes, [*breaks, inf], strict=False))
        if breaks[0] < makes[0]:  # it holds over the end of the period
            breaks = [*breaks[1:], breaks[0] + self.period]
        return list(zip(makes, breaks, strict=True))

    def interval(self, name: str, t: float) -> tuple[float, float]:
        """(make, break) [s] of the time of holding that t is in or that comes next; (inf, inf) where none does."""
        t += _SAME
        shifts = [0.0] if self.period is None else [self.period * (t // self.period + k) for k in (-1, 0, 1)]
        coming = ((a + shift, b + shift) for shift in shifts for a, b in self._holds[name] if b + shift > t)
        return next(coming, (inf, inf))

    # ---- in the tick
    def contact_sets(self) -> list[frozenset[str]]:
        if self.touching is None:
            return list(dict.fromkeys(self._sets))
        always = frozenset.intersection(*self._sets)  # a foot may be so late that the next ones lift before it lands
        others = sorted(frozenset(self.names) - always)
        if len(others) > _ALL_SETS:
            return list(dict.fromkeys([*self._sets, *(one ^ {name} for one in self._sets for name in others)]))
        return [always.union(some) for k in range(len(others) + 1) for some in combinations(others, k)]

    def contacts(self, state: RobotState, last: object) -> frozenset[str]:
        """The timeline's set; with a sensor, what of it has touched."""
        t = state.t
        if t < self._now:  # the clock went back
            self._until, self._next_change = [-inf] * len(self.names), -inf
        self._now = t
        if t + _SAME < self._next_change:
            return self._held
        held = set()
        for i, name in enumerate(self.names):
            if name in self._held and t + _SAME < self._until[i]:
                held.add(name)
                continue
            make, end = self.interval(name, t)
            if make <= t + _SAME if self.touching is None else make - self.early <= t + _SAME and self.touching(name):
                held.add(name)
                self._made[i] = t if make > -inf and name not in self._held else -inf
                self._until[i] = end
        self._held = frozenset(held)
        if self.touching is None:
            following = [self.interval(name, t) for name in self.names]
            self._next_change = min((a if a > t + _SAME else b for a, b in following), default=inf)
        return self._held

    def prepare(self, model: RobotModel) -> None:
        self._weight = model.weight

    def before(self, state: RobotState, last: Any, plan: PlanView) -> Overrides:
        slope = min(self.ramp, self.force_rate)  # else the bound would fall faster than the force may
        step, first, t = 1e3 * slope * plan.model.mass, FIRST_STEP * plan.dt, state.t
        for i, (made, until) in enumerate(
            zip(self._made, self._until, strict=True)
        ):  # they are few: faster than arrays
            self._limits[i] = step * max(min(t - made, until - plan.dt - t), first)
        limits: dict[str, float] = dict(zip(self.names, self._limits.tolist(), strict=True))
        floors: dict[str, float] = {}
        stands = len(self._held) == len(self.names) and min(limits.values(), default=inf) >= self._weight
        rate = self.standing_rate if stands else self.force_rate
        if last is not None and rate < inf:
            self._bound_rate(last.f, 1e3 * rate * plan.model.mass * plan.dt, limits, floors)
        return Overrides(normal_limits=limits, normal_floors=floors)

    def _bound_rate(self, former: Any, most: float, limits: dict[str, float], floors: dict[str, float]) -> None:
        """No further from what was commanded last than a tick allows, where that had an answer.

        A contact that a former stack had not is made now, and had no force.
        """
        for name in self.names:
            wrench = former.get(name, _NO_FORCE)
            force = float(wrench[2]) if len(wrench) > 2 else inf  # a part of the mechanism has no normal force
            if isfinite(force):
                limits[name] = max(min(limits[name], force + most), 0.0)
                floors[name] = min(force - most, limits[name])

    def reset(self, state: RobotState) -> None:
        self._held, self._next_change, self._now = frozenset(), -inf, -inf
        touching, self.touching = self.touching, None  # what holds at the start needs no sensor
        self.contacts(state, None)
        self.touching = touching
        self._made = [-inf if name in self._held else made for name, made in zip(self.names, self._made, strict=True)]
        self._next_change = self._next_change if touching is None else -inf

    def signals(self) -> dict[str, Vec]:
        return {"contacts": np.array([float(name in self._held) for name in self.names]), "limits": self._limits}
