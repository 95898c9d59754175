"""The momentum residual: missing torques, from positions, velocities and commands alone.

A robot whose actuators deliver τ − τ_f obeys  ṗ = τ − τ_f − β  with the momentum p = M v and β = −Sᵀ v + g, where S is
any matrix of Coriolis terms with Ṁ − 2 S skew-symmetric (β does not depend on which). The residual

    r(t) = K [ ∫₀ᵗ (τ − β − r) ds − (p(t) − p(0)) ],   K > 0 diagonal,

obeys ṙ = K (τ_f − r), r(0) = 0, whatever the robot does: every component sees its own actuator only. Neither
accelerations, nor the inverse of M, nor torque sensors are needed. Without p(0) it would start at −K p(0).

The sign is that of a *missing* torque. A torque that the environment adds, M a + h = τ + τ_ext, shows as −τ_ext: a
wrench F that is measured is compensated by giving τ + Jᵀ F instead of τ.

De Luca, Mattone: Actuator failure detection and isolation using generalized momenta, IEEE ICRA 2003. Haddadin, De Luca,
Albu-Schäffer: Robot collisions: a survey on detection, isolation, and identification, IEEE Transactions on Robotics
33(6), 2017.
"""

from __future__ import annotations

from typing import Any, final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput, NotSupported
from wbc.methods.shared import positive
from wbc.types import Vec

SCHEMES = ("exact", "euler", "implicit")


@final
class MomentumResidual(metaclass=TellsArguments):
    """The residual in steps of dt, each of which may have its own. With w = τ − β − Δp/dt, the mean of τ_f over the
    interval, r ← r + φ (w − r):

    * "exact": φ = 1 − exp(−K dt), the solution for constant τ_f;
    * "euler": φ = K dt, stable for K dt < 2 and monotone up to 1;
    * "implicit": φ = K dt / (1 + K dt), stable always.

    White noise of variance σ² in each sample of p gives r the variance 2 φ² σ² / (dt² (2 − φ)), with "euler"
    2 K² σ² / (2 − K dt): K trades speed for noise.

    Args:
        gain: K [1/s], a positive number or positive (n,).
        dt: time between updates [s], positive.
        scheme: one of the three.

    Raises:
        InvalidInput: a gain or dt that is not positive, no such scheme, or "euler" with gain · dt ≥ 2.

    Example:
        >>> import numpy as np
        >>> from wbc.methods import MomentumResidual
        >>> residual = MomentumResidual(gain=10.0, dt=0.1)
        >>> residual.reset(np.zeros(1))
        >>> print(residual.update(np.zeros(1), np.zeros(1), np.array([5.0])))  # commanded 5 N, nothing moves
        [3.16060279]
    """

    def __init__(self, *, gain: Any, dt: float, scheme: str = "exact") -> None:
        self.dt = checks.number("dt", dt, low=0.0, strict=True)
        if checks.ndim(gain) == 0:
            self.gain = np.array(checks.number("gain", gain, low=0.0, strict=True))
        else:
            self.gain = positive("gain", checks.array("gain", gain, (None,)))
        self.scheme = checks.one_of("scheme", scheme, SCHEMES)
        self._share = self._share_of(self.dt)
        self._momentum: Vec | None = None
        self._residual: Vec | None = None

    def reset(self, p0: Any) -> None:
        """Start, or start again, with the momentum p0 (n,) of this moment; r becomes zero.

        Raises:
            InvalidInput: not finite, or another size than the gain's.
        """
        size = len(self.gain) if self.gain.ndim else None
        self._momentum = checks.array("p0", p0, (size,))
        self._residual, self._missing = np.zeros(len(self._momentum)), np.zeros(len(self._momentum))

    @property
    def value(self) -> Vec:
        """The residual (n,) as it is [N m, N].

        Raises:
            NotSupported: before the first reset.
        """
        return self._started()[1].copy()

    @property
    def missing(self) -> Vec:
        """w (n,) of the last interval [N m, N], before the lag: noisy, and on time; zero before the first update."""
        self._started()
        return self._missing.copy()

    def restart(self, component: int) -> None:
        """Forget one component of the residual: it is zero again, the others stay.

        Raises:
            NotSupported: before the first reset.
            InvalidInput: there is no such component.
        """
        residual = self._started()[1]
        if not isinstance(component, int | np.integer) or not 0 <= component < len(residual):
            raise InvalidInput(f"component is {component!r}; there are components 0 to {len(residual) - 1}")
        residual[component] = 0.0

    def update(self, p: Any, beta: Any, tau: Any, rows: Any = None, *, dt: Any = None) -> Vec:
        """The residual (n,) [N m, N] at the end of one more interval.

        Args:
            p: momentum M v at the end of the interval (n,) [kg m/s, kg m²/s].
            beta: −Sᵀ v + g of the interval (n,): at its middle the error is O(dt²), at its end O(dt).
            tau: what was commanded during the interval (n,).
            rows: T (n, n); the residual then follows T w. On a floating base T = [[1, 0], [−M_jb M_bb⁻¹, 1]] leaves out
                what the base's velocity contributes to the joints, its noise included.
            dt: length of this interval [s]; None: the one given at the start.

        Raises:
            NotSupported: before the first reset.
            InvalidInput: shapes, numbers that are not finite, or a dt that would be refused at the start; the residual
                stays what it was.
        """
        before, residual = self._started()
        size = len(before)
        p, beta, tau = (checks.array(name, value, (size,)) for name, value in (("p", p), ("beta", beta), ("tau", tau)))
        dt = self.dt if dt is None else checks.number("dt", dt, low=0.0, strict=True)
        share = self._share if dt == self.dt else self._share_of(dt)
        missing = tau - beta - (p - before) / dt
        if rows is not None:
            missing = checks.array("rows", rows, (size, size)) @ missing
        self._missing = missing
        self._momentum, self._residual = p, residual + share * (missing - residual)
        return self._residual.copy()

    def _share_of(self, dt: float) -> Vec:
        """φ of an interval dt, of the gain's shape."""
        product = self.gain * dt
        if self.scheme == "euler" and (product >= 2.0).any():
            i = int((product >= 2.0).argmax())
            name = f"gain[{i}]" if self.gain.ndim else "gain"
            raise InvalidInput(
                f"{name} is {self.gain.flat[i]:g}, so {name} dt is {product.flat[i]:g}; the scheme 'euler' is stable"
                " below 2, 'exact' and 'implicit' always"
            )
        share: Vec = product
        if self.scheme == "exact":
            share = -np.expm1(-product)
        elif self.scheme == "implicit":
            share = product / (1.0 + product)
        return share

    def _started(self) -> tuple[Vec, Vec]:
        if self._momentum is None or self._residual is None:
            raise NotSupported("there is no residual before reset(p0), which takes the momentum at the start")
        return self._momentum, self._residual
