"""InvariantFilter: a right-invariant extended Kalman filter of an IMU and of points that stand on the ground.

The state: R (3, 3) turns vectors from the axes of the IMU to those of the world; v (3,) [m/s] and p (3,) [m] are the
velocity and the position of the IMU in the world; d_i (3,) [m] is where point i stands in the world; b_g (3,) [rad/s]
and b_a (3,) [m/s²] are the biases of gyroscope and accelerometer, in the axes of the IMU.

Motion. With a sample ω̃ = ω + b_g + noise and ã = Rᵀ (v̇ − g) + b_a + noise, the mean over the time dt up to now, and
φ = dt (ω̃ − b_g), a = ã − b_a, g (3,) [m/s²] the gravity in the world:

    R⁺ = R Exp(φ)     v⁺ = v + dt (R Γ₁ a + g)     p⁺ = p + dt v + dt² (R Γ₂ a + ½ g)     d⁺ = d     b⁺ = b

Exp(φ) = I + φ× + ½ φ×² + …, Γ₁ = I + ½ φ× + …, Γ₂ = ½ I + ⅙ φ× + …. φ× is the matrix with φ× y = φ × y.

Error. ξ stacks ξ_R [rad], ξ_v [m/s], ξ_p [m], the errors of b_g and b_a, and the ξ_d [m]; in world axes, those of the
biases in the axes of the IMU. Hats are estimates:

    R̂ = Exp(ξ_R) R     v̂ = Exp(ξ_R) v + Γ₁(ξ_R) ξ_v, and p̂, d̂ likewise     b̂ = b + ξ_b

    ξ̇_R = −R ξ_g    ξ̇_v = g× ξ_R − v× R ξ_g − R ξ_a    ξ̇_p = ξ_v − p× R ξ_g    ξ̇_d = −d× R ξ_g

Measurement. The encoders give where point i is as seen from the IMU; turned to world axes this is y_i (3,) [m], with
covariance N. The innovation is linear in ξ with constant coefficients:

    r_i = d̂_i − p̂ − y_i = ξ_d − ξ_p + noise

Neither the motion of ξ without biases nor the measurement depends on the estimate. So no measurement ever claims to
see the four directions that nothing here can see, the position and the heading: a shift of p and all d by the same
vector, and a turn of the world about the vertical, ξ_R = z.

A new point has ξ_d = ξ_p + noise: rows and columns of p are copied, and N is added. A point that no longer stands is
left out, which is exact.

R. Hartley, M. Ghaffari, R. M. Eustice, J. W. Grizzle: Contact-aided invariant extended Kalman filtering for robot state
estimation, International Journal of Robotics Research 39(4), 2020. A. Barrau, S. Bonnabel: The invariant extended
Kalman filter as a stable observer, IEEE Transactions on Automatic Control 62(4), 2017.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtrs

from wbc import checks
from wbc.types import Index, Mat, Vec

_R, _V, _P, _BG, _BA = (slice(3 * i, 3 * i + 3) for i in range(5))
#: How many errors there are beside those of the points.
BODY = 15
_I = np.eye(3)
_DIAGONAL = np.arange(3)


@final
@dataclass(frozen=True)
class ImuNoise:
    """The errors of an IMU, each one standard deviation; the data sheet of an IMU has them.

    ``gyro`` [rad/s/√Hz] and ``accelerometer`` [m/s²/√Hz]: densities of the white noise. ``gyro_bias`` [rad/s] and
    ``accelerometer_bias`` [m/s²]: of the biases when it is switched on. ``gyro_walk`` [rad/s²/√Hz] and
    ``accelerometer_walk`` [m/s³/√Hz]: how the biases wander. ``gyro_range`` [rad/s] and ``accelerometer_range`` [m/s²]:
    a larger number is no measurement.

    Raises:
        InvalidInput: a negative number, or one that is not finite.

    Example:
        >>> from wbc.robots import ImuNoise
        >>> ImuNoise(gyro=1.2e-4, accelerometer=1e-3).gyro_bias
        0.003
    """

    gyro: float = 1.7e-4
    accelerometer: float = 1e-3
    gyro_bias: float = 3e-3
    accelerometer_bias: float = 0.05
    gyro_walk: float = 1e-5
    accelerometer_walk: float = 1e-4
    gyro_range: float = 35.0
    accelerometer_range: float = 160.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            checks.number(f"{name} of ImuNoise", value, low=0.0)


@final
class InvariantFilter:
    """Estimate (``R``, ``v``, ``p``, ``d`` (k, 3), ``gyro_bias``, ``accelerometer_bias``) and covariance ``P`` of ξ
    (15 + 3k, 15 + 3k), in the order R, v, p, b_g, b_a, d. Every call makes new arrays: what was kept stays as it was.

    Of points that do not stand, ``d`` and the rows of ``P`` mean nothing.
    """

    def __init__(self, points: int, noise: ImuNoise, gravity: Vec) -> None:
        self._gravity, self._gravity_cross = gravity, cross_matrix(gravity)
        self._white = np.repeat([noise.gyro**2, noise.accelerometer**2], 3)
        self._walk = np.repeat([noise.gyro_walk**2, noise.accelerometer_walk**2], 3)
        self._bias = np.repeat([noise.gyro_bias**2, noise.accelerometer_bias**2], 3)
        self._size = BODY + 3 * points
        self._identity = np.eye(self._size)
        self.start(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(9))

    def start(self, R: Mat, v: Vec, p: Vec, variance: Vec) -> None:
        """Begin at R, v, p with errors of those variances (9,), in world axes: of the orientation [rad²], of v [m²/s²]
        and of p [m²]; nothing stands, biases are 0."""
        self.R, self.v, self.p = R, v, p
        self.gyro_bias, self.accelerometer_bias = np.zeros(3), np.zeros(3)
        self.d = np.zeros(((self._size - BODY) // 3, 3))
        self.P = np.zeros((self._size, self._size))
        self.P[range(9, 15), range(9, 15)] = self._bias
        self.doubt(variance)

    def doubt(self, variance: Vec) -> None:
        """Add independent errors of R, v and p with those variances (9,), as :meth:`start`."""
        into = np.eye(9)  # ξ_v = error of v + v × ξ_R
        into[_V, _R], into[_P, _R] = cross_matrix(self.v), cross_matrix(self.p)
        self.P = self.P.copy()
        self.P[:9, :9] += (into * variance) @ into.T

    def predict(self, dt: float, gyro: Vec, acceleration: Vec, wander: Mat) -> None:
        """``dt`` seconds on, with the mean rate [rad/s] and specific force [m/s²] that the IMU says of that time.

        ``wander`` (3, 3) [m²/s]: of each point, world axes.
        """
        R, size = self.R, self._size
        phi, a = dt * (gyro - self.gyro_bias), acceleration - self.accelerometer_bias
        turn, gamma_1, gamma_2 = exponentials(phi)
        F = self._identity.copy()
        F[_V, _R] = dt * self._gravity_cross
        F[_P, _R] = 0.5 * dt * F[_V, _R]
        F[_P, _V] = dt * _I
        F[:, _BG] = self._by_gyro(dt)
        F[_V, _BA] = -dt * R
        F[_P, _BA] = -0.5 * dt**2 * R
        noise = F[:, 9:15] * np.sqrt(self._white / dt)
        noise[9:15] = 0.0
        P = F @ self.P @ F.T
        P += noise @ noise.T
        diagonal = P.reshape(-1)[:: size + 1]
        diagonal[9:15] += dt * self._walk
        for i in range(BODY, size, 3):
            P[i : i + 3, i : i + 3] += dt * wander
        self.p = self.p + dt * self.v + dt**2 * (R @ (gamma_2 @ a) + 0.5 * self._gravity)
        self.v = self.v + dt * (R @ (gamma_1 @ a) + self._gravity)
        self.R = R @ turn
        self.P = P

    def _by_gyro(self, dt: float) -> Mat:
        """What a bias of the gyroscope (3,) does to ξ in ``dt`` seconds (15 + 3k, 3), and to itself."""
        R, places = self.R, np.zeros((self._size // 3, 3))
        places[1], places[2], places[5:] = self.v, self.p, self.d
        found = _crosses(places) @ (-dt * R)
        found[0] = -dt * R
        pull = -0.5 * dt**2 * (self._gravity_cross @ R)
        found[1] += pull
        found[2] += 0.5 * dt * (found[1] - pull) + dt / 3.0 * pull
        found[3] = _I
        return found.reshape(-1, 3)

    def innovation(self, points: Index, y: Mat, N: Mat) -> tuple[Vec, Mat, Mat]:
        """r (3m,) of the ``points`` (m,) that the encoders see at ``y`` (m, 3), covariance S (3m, 3m) of r with that of
        the encoders ``N`` (3m, 3m), and H P (3m, 15 + 3k)."""
        rows, m = _rows(points), len(points)
        seen = self.P[rows]
        seen.reshape(m, 3, -1)[...] -= self.P[_P]
        S = seen[:, rows] + N
        S.reshape(3 * m, m, 3)[...] -= seen[:, None, _P]
        return (self.d[points] - self.p - y).reshape(-1), S, seen

    def correct(self, r: Vec, S: Mat, seen: Mat, most: float = math.inf) -> bool:
        """Take up an innovation r (3m,) with S (3m, 3m) and H P (3m, 15 + 3k), unless rᵀ S⁻¹ r is more than ``most``:
        False, and nothing is done.

        Raises:
            LinAlgError: S is not positive definite.
        """
        factor, failed = dpotrf(S, lower=1)
        if failed:
            raise np.linalg.LinAlgError("the covariance of an innovation is not positive definite")
        whitened, _ = dtrtrs(factor, r, lower=1)
        if whitened @ whitened > most:
            return False
        half, _ = dtrtrs(factor, seen, lower=1)
        step = -(whitened @ half)
        turn, gamma_1, _ = exponentials(step[_R])
        moves = step.reshape(-1, 3) @ gamma_1.T
        self.R = turn @ self.R
        self.v = turn @ self.v + moves[1]
        self.p = turn @ self.p + moves[2]
        self.gyro_bias = self.gyro_bias + step[_BG]
        self.accelerometer_bias = self.accelerometer_bias + step[_BA]
        self.d = self.d @ turn.T + moves[5:]
        self.P = self.P - half.T @ half
        return True

    def place(self, points: Index, y: Mat, N: Mat) -> None:
        """Let the ``points`` (m,) stand where the encoders see them: at ``y`` (m, 3), with covariance N (3m, 3m)."""
        rows, P = _rows(points), self.P.copy()
        source = np.tile(np.arange(_P.start, _P.stop), len(points))
        P[rows] = P[source]
        P[:, rows] = P[:, source]
        P[np.ix_(rows, rows)] += N
        self.d, self.P = self.d.copy(), P
        self.d[points] = self.p + y


def cross_matrix(x: Vec) -> Mat:
    """x× (3, 3), with x× y = x × y."""
    a, b, c = x.tolist()
    return np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])


def exponentials(phi: Vec) -> tuple[Mat, Mat, Mat]:
    """Exp(φ), Γ₁(φ) and Γ₂(φ), (3, 3) each, of φ (3,) [rad]: Σ φ×ⁿ/n!, Σ φ×ⁿ/(n+1)! and Σ φ×ⁿ/(n+2)!."""
    square = float(phi @ phi)
    if square < 1e-4:  # the next terms are below rounding
        a, b = 1.0 - square / 6.0 + square**2 / 120.0, 0.5 - square / 24.0 + square**2 / 720.0
        c, d = 1.0 / 6.0 - square / 120.0 + square**2 / 5040.0, 1.0 / 24.0 - square / 720.0 + square**2 / 40320.0
    else:
        angle = math.sqrt(square)
        a, b = math.sin(angle) / angle, 2.0 * (math.sin(0.5 * angle) / angle) ** 2
        c, d = (1.0 - a) / square, (0.5 - b) / square
    X = cross_matrix(phi)
    XX = np.outer(phi, phi) - square * _I
    return _I + a * X + b * XX, _I + b * X + c * XX, 0.5 * _I + c * X + d * XX


def _crosses(x: Mat) -> Mat:
    """x× (k, 3, 3) of each row of x (k, 3)."""
    result = np.zeros((len(x), 3, 3))
    result[:, 2, 1], result[:, 0, 2], result[:, 1, 0] = x[:, 0], x[:, 1], x[:, 2]
    return result - result.transpose(0, 2, 1)


def _rows(points: Index) -> Index:
    """Where the errors of these points are in ξ."""
    found: Index = (BODY + 3 * points[:, None] + _DIAGONAL).reshape(-1)
    return found
