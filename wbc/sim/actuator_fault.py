"""ActuatorFault: an actuator that does not deliver what is commanded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, NotSupported
from wbc.sim.disturbance import Disturbance, Effect
from wbc.sim.plant import Delivered, Drive, Plant


@final
@dataclass(frozen=True, kw_only=True)
class ActuatorFault(Disturbance):
    """From ``start`` [s] to ``end`` the actuator of ``joint`` delivers τ − τ_f, with the missing torque

        τ_f = τ − cut(effectiveness τ) + bias        [N m, N],   cut to ± ceiling

    ``effectiveness`` 0 with no bias is a total fault, between 0 and 1 a partial one, 1 with a bias a bias, 1 with a
    ceiling a saturation.

    Raises:
        InvalidInput: an effectiveness that is not between 0 and 1, a bias that is not finite, a negative ceiling, an
            end before the start.

    Example:
        >>> from wbc.sim.actuator_fault import ActuatorFault
        >>> fault = ActuatorFault(joint="q1", effectiveness=0.25, start=0.5)
        >>> print(fault, fault.missing(1.0, 8.0))
        actuator q1 delivers 25 % from 0.5 s 6.0
    """

    joint: str
    effectiveness: float = 0.0
    bias: float = 0.0
    ceiling: float = np.inf
    start: float = 0.0
    end: float = np.inf

    def __post_init__(self) -> None:
        checks.text("joint", self.joint)
        checks.number("effectiveness", self.effectiveness, low=0.0, high=1.0)
        checks.number("bias", self.bias)
        ceiling, end = (checks.array(name, getattr(self, name), (), finite=False) for name in ("ceiling", "end"))
        if ceiling < 0.0:
            raise InvalidInput(f"ceiling is {ceiling:g}; it must be >= 0")
        checks.number("start", self.start, low=0.0)
        if end <= self.start:
            raise InvalidInput(f"end is {end:g}; it must be after start, {self.start:g}")

    def missing(self, t: float, tau: float) -> float:
        """τ_f for the command τ at time t [s]."""
        if not self.start <= t < self.end:
            return 0.0
        if self.ceiling == np.inf:
            return (1.0 - self.effectiveness) * tau + self.bias
        return tau - float(np.clip(self.effectiveness * tau, -self.ceiling, self.ceiling)) + self.bias

    def begin(self, plant: Plant) -> Effect:
        if plant.takes == "position":
            raise NotSupported(f"{self}: drives that follow positions make their torques themselves")
        if plant.takes != "torque":
            raise NotSupported(f"{self}: {type(plant).__name__} takes {plant.takes}s and no torques that could be lost")
        return _Failing(self, plant)

    def __str__(self) -> str:
        less = f" {'less' if self.bias > 0.0 else 'plus'} {abs(self.bias):g}" if self.bias else ""
        most = f", at most {self.ceiling:g}" if np.isfinite(self.ceiling) else ""
        until = f" to {self.end:g} s" if np.isfinite(self.end) else ""
        return f"actuator {self.joint} delivers {100 * self.effectiveness:g} %{less}{most} from {self.start:g} s{until}"


@final
class _Failing(Effect):
    def __init__(self, fault: ActuatorFault, plant: Plant) -> None:
        self._fault, self._joint, self._t = fault, plant.model.joint(fault.joint), 0.0
        self._half_step = 0.5 * plant.dt  # t is a multiple of dt up to rounding

    def push(self, t: float) -> None:
        self._t = t + self._half_step

    def deliver(self, command: Drive) -> Drive:
        missing = self._fault.missing(self._t, float(command.tau[self._joint]))
        if missing == 0.0:
            return command
        tau = command.tau.copy()
        tau[self._joint] -= missing
        return Delivered(tau, command.a, command.v, command.q)
