"""A load in a hand: what it asks of the joints, and which load explains torques that are missing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.models.model import RobotState
from wbc.types import Mat, Vec

#: Ticks that are added up before they count: white noise of the velocity telescopes within.
BLOCK = 20
#: Blocks from which on an answer is tried, and after which it is given up.
SHORTEST, LONGEST = 25, 150
#: What may be left of the missing torques: this share, and half a threshold of each joint.
UNEXPLAINED, HALF = 0.2, 0.5
#: How many times as much constant torques of the same joints must leave: then the robot has moved enough to tell.
CLEARLY = 2.0
#: Farther from its frame's origin than this nothing is carried [m].
REACH = 0.3
#: Where in the inertia its six parameters stand.
INERTIA = ([0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2])
#: How often the fit is made: each time but the first with the inertia about the origin of the load found before.
ROUNDS = 10
#: Directions of π that show nothing are left at 0 by this share of the largest curvature.
FAINT = 1e-8


@final
@dataclass(frozen=True, eq=False)
class Load:
    """A body of ``mass`` [kg] whose centre of mass is at ``centre`` (3,) [m] in the axes of ``frame``.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.tasks.components.load import Load
        >>> state = wbc.load("arm").state()
        >>> load = Load("tool", mass=2.0, centre=np.zeros(3))
        >>> lift = state.frame("tool").jacobian()[2] * 2.0 * 9.81
        >>> bool(np.allclose(load.weight(state), lift))
        True
    """

    frame: str
    mass: float
    centre: Vec

    @property
    def parameters(self) -> Vec:
        """π (10,) of a point: mass, first moments, and xx, yy, zz, xy, xz, yz of the inertia about the frame's origin
        [kg, kg m, kg m²]."""
        m, c = self.mass, self.centre
        inertia = m * (c @ c * np.eye(3) - np.outer(c, c))
        return np.concatenate([[m], m * c, inertia[INERTIA]])

    def jacobian(self, state: RobotState) -> Mat:
        """Of the centre of mass (3, nv), world axes."""
        frame = state.frame(self.frame)
        J, arm = frame.jacobian(), frame.rotation @ self.centre
        result: Mat = J[:3] - np.cross(arm, J[3:].T).T
        return result

    def weight(self, state: RobotState) -> Vec:
        """What it adds to gravity's torques g(q) (nv,) [N m, N]."""
        result: Vec = -self.mass * self.jacobian(state).T @ state.model.gravity
        return result

    def inertia(self, state: RobotState) -> Mat:
        """What it adds to M(q) (nv, nv), as a point."""
        J = self.jacobian(state)
        result: Mat = self.mass * J.T @ J
        return result


@final
class LoadRegressor:
    """Y (nv, 10): the generalised force Y π that a load π = (m, m c, I) at ``frame`` takes, mean over a tick.

    With v_o, ω the velocity of the frame's origin and its angular velocity, s = R m c, I the inertia about the origin,
    g the acceleration of gravity, all in world axes, the force and the moment about the origin that move the load are

        f = d/dt (m v_o + ω × s) − m g,   n = d/dt (s × v_o + I ω) + v_o × (ω × s) + g × s,   Y π = Jᵀ (f, n);

    differences over the tick stand for d/dt, so that no acceleration is measured. Without ``weight`` g is 0.

    Source: Newton's and Euler's equations about a moving point; docs/adaptive.md.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.tasks.components.load import LoadRegressor
        >>> state, regressor = wbc.load("arm").state(), LoadRegressor("tool")
        >>> regressor.step(state, 1e-3) is None  # the first state; from the next on there is an interval
        True
        >>> regressor.step(state, 1e-3).shape
        (7, 10)
    """

    def __init__(self, frame: str, *, weight: bool = True) -> None:
        self.frame, self._weight = frame, weight
        self._before: tuple[Mat, Mat, Mat] | None = None

    def step(self, state: RobotState, dt: float) -> Mat | None:
        """Y (nv, 10) of the interval dt that ends at ``state``; None at the first call and where dt is 0."""
        frame = state.frame(self.frame)
        J, R = np.array(frame.jacobian()), np.array(frame.rotation)
        v, w = (J @ state.v).reshape(2, 3)
        momentum, rest = np.zeros((6, 10)), np.zeros((6, 10))
        turning = np.cross(w, R.T).T  # ω × s of the three unit moments
        momentum[:3, 0], momentum[:3, 1:4] = v, turning
        momentum[3:, 1:4] = np.cross(R.T, v).T
        x, y, z = R.T @ w
        momentum[3:, 4:] = R @ [[x, 0.0, 0.0, y, z, 0.0], [0.0, y, 0.0, x, 0.0, z], [0.0, 0.0, z, 0.0, x, y]]
        rest[3:, 1:4] = np.cross(v, turning.T).T
        if self._weight:
            rest[:3, 0] = -state.model.gravity
            rest[3:, 1:4] += np.cross(state.model.gravity, R.T).T
        before, self._before = self._before, (J, momentum, rest)
        if before is None or dt == 0.0:
            return None
        wrench = (momentum - before[1]) / dt + 0.5 * (rest + before[2])
        result: Mat = 0.5 * (J + before[0]).T @ wrench
        return result


@final
class LoadFit:
    """Adds up missing torques over a motion, and says which load in a hand explains them, if one does.

    ``scale`` (nj,): thresholds of the joints; ``counted`` (nj,): those that count, 0 or 1. Sums of ``BLOCK`` ticks are
    compared with Y π by weighted least squares. The mass and the first moments are fitted; the inertia about the origin
    is that of a point, which follows from them: of the mass and centre that were fitted the time before. A load is the
    answer if it leaves little, if it has a mass and a centre within ``REACH`` of the hand, and if constant torques of
    the same joints leave much more: where the robot is at rest, a weight, a push and a bias are the same.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.tasks.components.load import LoadFit
        >>> robot = wbc.load("arm")
        >>> fit = LoadFit("tool", scale=np.full(robot.nj, 0.3), counted=np.ones(robot.nj))
        >>> fit.add(robot.state(), 1e-3, missing=np.zeros(robot.nj), rows=None)
        >>> fit.load() is None  # nothing is missing
        True
    """

    def __init__(self, frame: str, scale: Vec, counted: Vec) -> None:
        self._regressor = LoadRegressor(frame)
        self._weight = np.where(np.isfinite(scale), counted / scale, 0.0)
        self._N, self._c, self._mm = np.zeros((10, 10)), np.zeros(10), 0.0
        self._sum, self._Y, self._m = np.zeros(len(scale)), np.zeros((len(scale), 10)), np.zeros(len(scale))
        self._ticks, self.blocks = 0, 0

    def add(self, state: RobotState, dt: float, missing: Vec, rows: Mat | None) -> None:
        """One more tick: ``missing`` (nj,) of the interval that ends at ``state``, of T w where ``rows`` T is given."""
        Y = self._regressor.step(state, dt)
        if Y is None:
            return
        if rows is not None:
            Y = rows @ Y
        self._Y += Y[state.model.nb :]
        self._m += missing
        self._ticks += 1
        if self._ticks < BLOCK:
            return
        Y, m = (self._weight * self._Y.T / BLOCK).T, self._weight * self._m / BLOCK
        self._N += Y.T @ Y
        self._c += Y.T @ m
        self._mm += float(m @ m)
        self._sum += m
        self._Y[:], self._m[:], self._ticks = 0.0, 0.0, 0
        self.blocks += 1

    @property
    def over(self) -> bool:
        """Whether this went on long enough for nothing."""
        return self.blocks >= LONGEST

    def load(self) -> Load | None:
        """The load that explains what was added so far; None: nothing is, or not yet."""
        if self.blocks < SHORTEST or self._ticks or not self._mm > 0.0:
            return None
        N = self._N[:4, :4] + FAINT * np.trace(self._N[:4, :4]) * np.eye(4)
        inertia = np.zeros(6)
        for _ in range(ROUNDS):
            found = np.linalg.solve(N, self._c[:4] - self._N[:4, 4:] @ inertia)
            mass = float(found[0])
            if not mass > 0.0:
                return None
            centre = found[1:] / mass
            distance = float(np.linalg.norm(centre))
            within = centre * (REACH / max(distance, REACH))  # or what is too far away would go on to infinity
            inertia = Load(self._regressor.frame, mass, within).parameters[4:]
        load = Load(self._regressor.frame, mass, centre)
        parameters = load.parameters
        left = max(self._mm + float((self._N @ parameters - 2.0 * self._c) @ parameters), 0.0)
        constant = max(self._mm - float(self._sum @ self._sum) / self.blocks, 0.0)
        rows = self.blocks * np.count_nonzero(self._weight)
        allowed = UNEXPLAINED**2 * self._mm + HALF**2 * rows
        return None if distance > REACH or left > allowed or constant < CLEARLY**2 * left else load
