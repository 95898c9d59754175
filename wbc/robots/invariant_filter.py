"""A right-invariant extended Kalman filter of an IMU and of points that stand on the ground.

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
left out, which is exact. Where the floor is known to be level, the height of a new point along the vertical z is that
of the floor, h, up to noise: the only measurement whose coefficients depend on the estimate,

    r = z·d̂ − h = z·ξ_d + (d̂ × z)·ξ_R + noise

R. Hartley, M. Ghaffari, R. M. Eustice, J. W. Grizzle: Contact-aided invariant extended Kalman filtering for robot state
estimation, International Journal of Robotics Research 39(4), 2020. A. Barrau, S. Bonnabel: The invariant extended
Kalman filter as a stable observer, IEEE Transactions on Automatic Control 62(4), 2017.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.robots.compiled.filter_kernel import BODY, LAYOUT, Filter, doubt
from wbc.types import Mat, Vec


@final
@dataclass(frozen=True)
class ImuNoise(metaclass=TellsArguments):
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


def made(points: int, noise: ImuNoise, gravity: Vec, wander: Mat) -> Filter:
    """The memory of a filter of so many points that stand and wander by ``wander`` (3, 3) [m²/s]."""
    return LAYOUT.arrays(
        np.array([points, 0]),
        white=np.repeat([noise.gyro**2, noise.accelerometer**2], 3),
        walk=np.repeat([noise.gyro_walk**2, noise.accelerometer_walk**2], 3),
        gravity=np.array(gravity),
        wander=wander,
    )


def start(f: Filter, R: Mat, v: Vec, p: Vec, *, noise: ImuNoise, variance: Vec, about: Vec) -> None:
    """Begin at R, v, p; nothing stands, biases are 0.

    ``variance`` (9,) is that of a turn about a point (3,), world axes [rad²], of v [m²/s²] and of p [m²].
    """
    f.R[:], f.v[:], f.p[:], f.bias[:], f.d[:], f.P[:] = R, v, p, 0.0, 0.0, 0.0
    f.P[range(9, BODY), range(9, BODY)] = np.repeat([noise.gyro_bias**2, noise.accelerometer_bias**2], 3)
    doubt(f, variance, about)
