"""AdaptiveLaw: what an adaptive controller takes the robot for, and how that changes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, NotSupported
from wbc.methods import ParameterUpdate, PseudoInertia
from wbc.models.inertial_regressor import InertialRegressor
from wbc.models.model import RobotModel
from wbc.models.planar import PlanarRobot
from wbc.stack.by_name import all_meant, patterns
from wbc.types import Mat, Vec

#: Speed over which Coulomb friction turns its sign [rad/s, m/s].
SIGN_SPEED = 0.01


class AdaptiveLaw(ABC):
    """Parameters â (p,) that are linear in the dynamics, their set, and the metric Γ⁻¹ they are adapted in."""

    start: Vec
    a_hat: Vec
    names: Sequence[str]
    #: Inertia of each joint beside Y â (nj,) [kg m², kg], known.
    rotors: Vec

    @abstractmethod
    def regressor(self, q: Vec, v: Vec, v_r: Vec, a_r: Vec) -> Mat:
        """Y (nj, p)."""

    @abstractmethod
    def step(self, gradient: Vec, dt: float) -> Vec:
        """â (p,) after dt seconds of â̇ = Γ ``gradient``, kept in the set."""

    @abstractmethod
    def squared(self, off: Vec) -> float:
        """offᵀ Γ⁻¹ off, of the parameters that are adapted."""

    def reset(self) -> None:
        """Start again."""
        self.a_hat = self.start.copy()

    @property
    def smallest(self) -> float:
        """The smallest eigenvalue of what must be positive for a body to be possible [kg]; NaN: not known."""
        return float("nan")


@final
class PlanarLaw(AdaptiveLaw):
    """The dynamic coefficients of a planar robot, in the polyhedron of masses that are not negative or free."""

    def __init__(self, name: str, model: PlanarRobot, *, gain: Any, start: Any, physical: bool) -> None:
        p, self.rotors = len(model.coefficients), np.zeros(model.nj)
        self._model = model
        self.names = tuple(f"a{i + 1}" for i in range(p))
        self._gain = checks.array(f"{name}.gain", gain, (p,) * max(checks.ndim(gain), 0))
        self.start = spread(f"{name}.a_hat", 0.0 if start is None else start, p)
        self._possible: tuple[Any, Any] = model.possible_coefficients() if physical else (None, None)
        self.reset()
        self._update(np.zeros(p))  # refuses a gain or a start that makes no sense

    def _update(self, gradient: Vec) -> ParameterUpdate:
        C, d = self._possible
        return ParameterUpdate(gradient[None, :], [1.0], gain=self._gain, a_hat=self.a_hat, C=C, d=d)

    def regressor(self, q: Vec, v: Vec, v_r: Vec, a_r: Vec) -> Mat:
        return self._model.regressor(q, v, v_r, a_r)

    def step(self, gradient: Vec, dt: float) -> Vec:
        self.a_hat = self._update(gradient).step(dt)
        return self.a_hat

    def squared(self, off: Vec) -> float:
        return float(off @ (np.linalg.solve(self._gain, off) if self._gain.ndim == 2 else off / self._gain))


@final
class InertialLaw(AdaptiveLaw):
    """Ten numbers for each link of an arm, and its friction: always those of bodies that can be.

    Γ = γ Q⁻¹ for each link, with Q the metric of its scaled pseudo-inertia (:class:`wbc.methods.PseudoInertia`), in
    which cutting off eigenvalues is the exact projection. ``links``: the joints whose links are adapted (default: all);
    friction, viscous v_r + coulomb sign(v_r) of each joint, is adapted with ``friction_gain`` and kept at 0 or above.
    """

    def __init__(
        self, name: str, model: RobotModel, *, gain: Any, start: Any, links: Sequence[str] | None,
        friction_gain: float, length: float, floor: float,
    ) -> None:  # fmt: skip
        self.inertial = regressor = InertialRegressor(model)
        self.rotors = regressor.rotors
        named = (".*",) if links is None else patterns(f"{name}.links", links)
        joints = sorted(all_meant(f"{name}.links", named, model.joint_names))
        self._links = [slice(10 * i, 10 * i + 10) for i in joints]
        self._length, self._floor = length, floor
        self._gain = checks.number(f"{name}.gain", gain, low=0.0, strict=True)
        self._metric = PseudoInertia.metric(length)
        self._inverse = self._gain * np.linalg.inv(self._metric)
        self._friction_gain, self._rubs = friction_gain, friction_gain > 0.0
        self.p_links = len(regressor.parameters)
        self.names = regressor.names
        nominal = regressor.parameters
        if self._rubs:
            nominal = np.concatenate([nominal, np.zeros(2 * model.nj)])
            for kind in ("viscous", "coulomb"):
                self.names += tuple(f"{joint} {kind}" for joint in model.joint_names)
        self.start = nominal.copy() if start is None else spread(f"{name}.a_hat", start, len(nominal))
        for where in self._links:
            smallest = PseudoInertia(self.start[where], length=length, floor=floor).smallest
            if not smallest >= 0.0:
                link = model.joint_names[where.start // 10]
                raise InvalidInput(
                    f"{name}.a_hat: no body is like the link of {link!r}: an eigenvalue of its pseudo-inertia is "
                    f"{smallest:.3g} kg"
                )
        adapted = np.concatenate([np.arange(where.start, where.stop) for where in self._links])
        #: Columns of Y that are adapted, of links alone; and those of them that show in torques independently.
        self.adapted, (self.independent, self.grouping) = adapted, regressor.grouped(adapted)
        self.reset()

    def regressor(self, q: Vec, v: Vec, v_r: Vec, a_r: Vec) -> Mat:
        Y = self.inertial(q, v, v_r, a_r)
        return np.hstack([Y, np.diag(v_r), np.diag(np.tanh(v_r / SIGN_SPEED))]) if self._rubs else Y

    def step(self, gradient: Vec, dt: float) -> Vec:
        a_hat = self.a_hat.copy()
        for where in self._links:
            moved = a_hat[where] + dt * (self._inverse @ gradient[where])
            a_hat[where] = PseudoInertia(moved, length=self._length, floor=self._floor).closed_form().parameters
        if self._rubs:
            a_hat[self.p_links :] += dt * self._friction_gain * gradient[self.p_links :]
            np.maximum(a_hat[self.p_links :], 0.0, out=a_hat[self.p_links :])
        self.a_hat = a_hat
        return a_hat

    def squared(self, off: Vec) -> float:
        total = sum(float(off[where] @ self._metric @ off[where]) for where in self._links) / self._gain
        if self._rubs:
            total += float(off[self.p_links :] @ off[self.p_links :]) / self._friction_gain
        return total

    @property
    def smallest(self) -> float:
        return min(PseudoInertia(self.a_hat[w], length=self._length, floor=self._floor).smallest for w in self._links)


def law_of(name: str, model: RobotModel, *, physical: bool, **settings: Any) -> AdaptiveLaw:
    """The law for a model: of coefficients on planar robots, of links on arms from URDFs.

    Raises:
        NotSupported: another model, or a setting that it has no use for.
    """
    if not isinstance(model, PlanarRobot):
        return InertialLaw(name, model, **settings)
    if settings["links"] is not None or settings["friction_gain"]:
        raise NotSupported(f"{name}: links and friction are those of robots from URDFs; {model.name} is planar")
    return PlanarLaw(name, model, gain=settings["gain"], start=settings["start"], physical=physical)


def spread(name: str, value: Any, size: int) -> Vec:
    """``value`` (size,), a number standing for all."""
    return checks.each(name, value, size)
