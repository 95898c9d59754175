"""CollisionAvoidance: keeps links away from each other and from obstacles, by control barriers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Self, final

import numpy as np
import pinocchio

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.collision import Distances, Obstacle, obstacles_in
from wbc.models.geometry import Sphere
from wbc.models.model import RobotModel, RobotState
from wbc.stack.constraint import Barrier, BarrierRows

#: Pairs that are nearer than the margin and this [m] have rows also for what would be nearest if they were turned.
_CLOSE = 0.01


@final
class CollisionAvoidance(Barrier):
    """h = d − margin >= 0 [m] for the shapes of two links, or of a link and an obstacle.

    d is the distance of the shapes, negative if they penetrate each other. Pairs farther apart than ``reach`` have no
    row. If a pair is nearer than the margin, its rows lead back at the same rate; by default they have a slack, because
    the robot may not be able to. There are ``count`` rows in every tick. Rows without a pair are empty; if there are
    too few rows, ``controller.why`` says how many pairs have none. docs/limits.md says which pairs have rows, what
    holds between ticks, and what was measured.

    Args:
        obstacles: bodies that stand or move in the world.
        pairs: names of two links, or of a link and an obstacle, to keep only these apart; None: all pairs.
        self_collision: with ``pairs=None``, whether links are kept apart from each other.
        margin: distance kept [m].
        count: number of rows; None: 64 plus two for each pair in the reference configuration, at most 1024.
        reach: distance from which on a pair has a row [m], more than the margin.
        rate: γ [1/s]; slack: see :class:`~wbc.stack.constraint.Barrier`.

    Raises:
        InvalidInput: a reach within the margin, a negative margin, no pair, no obstacle.
        NotSupported: the robot has no shapes.
        UnknownName: a pair of a link or obstacle that is none; when a stack is compiled.

    Source: Ames et al., ECC 2019 (barriers); Faverjon, Tournassoud, ICRA 1987 (the same as a velocity damper); turning
    shapes to find several points of contact is common in physics engines.

    Example:
        >>> import numpy as np, pinocchio, wbc
        >>> from wbc.tasks import CollisionAvoidance, Obstacle
        >>> from wbc.models.geometry import Sphere
        >>> ball = Obstacle("ball", Sphere(0.1), pinocchio.SE3(np.eye(3), np.array([0.4, 0.0, 0.4])))
        >>> constraint = CollisionAvoidance([ball], margin=0.03)
        >>> robot = wbc.load("arm")
        >>> constraint.prepare(robot)
        >>> constraint.closest(robot.state())[0][:2]
        ('flange', 'ball')
    """

    units = "m"

    read_once = frozenset({"count", "margin", "obstacles", "pairs", "reach", "self_collision"})

    def __init__(
        self, obstacles: Iterable[Obstacle] = (), *, pairs: Sequence[tuple[str, str]] | None = None,
        self_collision: bool = True, margin: float = 0.02, count: int | None = None, reach: float = 0.12,
        rate: float = 15.0, slack: float | None = 1e6, name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(rate=rate, slack=slack, name=name)
        self.reach = checks.number(f"{self.name}.reach", reach, low=0.0, strict=True)
        self.margin = checks.number(f"{self.name}.margin", margin, low=0.0)
        if self.reach <= self.margin:
            raise InvalidInput(
                f"{self.name}.reach is {self.reach:g} m; it must be more than the margin of {self.margin:g} m"
            )
        self.obstacles = tuple(obstacles_in(f"{self.name}.obstacles", obstacles))
        self.pairs, self.self_collision = pairs, checks.truth(f"{self.name}.self_collision", self_collision)
        self.count = None if count is None else int(checks.number(f"{self.name}.count", count, low=1))
        self._distances: Distances | None = None

    def __getstate__(self) -> dict[str, Any]:
        """A copy measures by itself: which pair has which row is memory."""
        return super().__getstate__() | {"_distances": None}

    def prepare(self, model: RobotModel) -> None:
        if self._distances is None or self._distances.model is not model:
            self._distances = Distances(
                model, pairs=self.pairs, obstacles=self.obstacles, self_collision=self.self_collision,
                count=self.count, reach=self.reach, margin=self.margin, ahead=1.0 / self.rate,
                close=self.margin + _CLOSE,
            )  # fmt: skip
        self.dim, self.codes = self._distances.count, self._distances.which

    def fill(self, state: RobotState, out: BarrierRows) -> None:
        distances = self._distances
        assert distances is not None, "prepare comes first"
        distances.ahead = 1.0 / self.rate
        distances.read(state)
        missing = distances.missing
        self.note = f"{self.name}: {missing} pairs within reach have no row (count = {self.dim})" if missing else ""
        np.subtract(distances.distance, self.margin, out.h)
        out.J[:], out.drift[:], out.rate[:] = distances.jacobian, distances.drift, distances.rate

    def reset(self) -> None:
        if self._distances is not None:
            self._distances.reset()

    def closest(self, state: RobotState) -> list[tuple[str, str, float]]:
        """The pairs that have a row in this state, the nearest first: two names and their distance [m].

        Raises:
            InvalidInput: an obstacle has no pose at the time of the state.
        """
        self.prepare(state.model)
        distances = self._distances
        assert distances is not None, "it is prepared"
        distances.read(state)
        found: dict[int, float] = {}
        for pair, d in zip(distances.which.tolist(), distances.distance.tolist(), strict=True):
            if pair >= 0:
                found[pair] = min(d, found.get(pair, np.inf))
        return sorted(((*distances.pairs[pair], d) for pair, d in found.items()), key=lambda entry: entry[2])

    @property
    def names(self) -> tuple[tuple[str, str], ...]:
        """What the numbers ``codes`` of the pairs mean: the two names; of shapes of the same two links several."""
        assert self._distances is not None, "prepare comes first"
        return self._distances.pairs

    def about(self, row: int) -> str:
        pair = -1 if self.codes is None else int(self.codes[row])
        return self.label(row) if pair < 0 else " and ".join(self.names[pair])

    def label(self, row: int) -> str:
        return f"pair {row}"

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        still = pinocchio.SE3(np.eye(3), np.array([0.4, 0.2, 0.3]))
        balls = [Obstacle("still ball", Sphere(0.1), still), Obstacle("thrown ball", Sphere(0.05), _thrown)]
        return [cls(balls, self_collision=False, reach=1.0), cls(balls, self_collision=False, count=8, reach=0.3)]


def _thrown(t: float) -> Any:
    """Pose at time t [s] of the ball of a sample."""
    return pinocchio.SE3(np.eye(3), np.array([0.8 - 0.4 * t, 0.1 * t, 0.6 - 0.2 * t**2]))
