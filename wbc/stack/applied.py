"""Applied: the bounds and parameters of the present tick: the limits of the stack with its components' overrides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import is_
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, NotSupported, UnknownName
from wbc.models.model import RobotModel, RobotState
from wbc.stack.constraint import TorqueBySpeed
from wbc.stack.contact import Contact, keys
from wbc.stack.interval import JointIntervals, refuse_bounds
from wbc.stack.level import Level
from wbc.stack.member import Binding, Tried
from wbc.stack.overrides import QUANTITIES, Actuators, Motor, Overrides
from wbc.tolerances import ROUNDING
from wbc.types import Mat, Vec, read_only

Said = Sequence[tuple[str, Overrides]]
#: The parts of overrides that bounds on joints and normal forces are made of.
_OF_BOUNDS = (*QUANTITIES, "lifted", "motors", "normal_limits", "normal_floors")
_Bounds = tuple[Vec, Vec]


@final
class Applied:
    """Bounds, bias, inertia, motors and normal forces of one tick; the plans of one stack share it.

    ``apply`` checks all changes before it makes any: if it raises, the values of the tick before stay.
    ``version`` rises whenever bounds on torques or normal forces may have changed. The arrays are read-only to
    everybody else, and their memory never moves: compiled code reads it.
    """

    def __init__(
        self, model: RobotModel, level: Level, binding: Binding, contacts: Sequence[Contact], intervals: JointIntervals
    ) -> None:
        self._model, self._level, self._binding = model, level, binding
        order = {contact.name: i for i, contact in enumerate(contacts)}
        #: Place of each contact among those of the stack, by its name, and by its frame where no other has the same.
        self.places: Mapping[str, int] = {key: order[name] for key, name in keys(contacts)}
        self.intervals = intervals
        #: The bounds (nj,) of the stack, by quantity.
        self._own = {quantity: intervals.bounds(quantity) for quantity in QUANTITIES}
        #: Those of this tick.
        self._in_force = dict(self._own)
        intervals.seal()
        self._torque = intervals.bounds("torque")
        #: Bounds on the torques (lower, upper), (nj,) each.
        self.torque_bounds = read_only(self._torque[0].view()), read_only(self._torque[1].view())
        self._bias = np.zeros(model.nv)
        self.bias = read_only(self._bias.view())
        self.inertia: Mat | None = None
        self._limits, self._floors = np.full(len(contacts), np.inf), np.full(len(contacts), -np.inf)
        self.normal_limits, self.normal_floors = read_only(self._limits.view()), read_only(self._floors.view())
        self.actuators = Actuators(np.ones(model.nj), np.zeros(model.nj))
        self._motors: Mapping[int, Motor] = {}
        self.version = 0
        #: The overrides in force, by the names of the components that said them.
        self.said: Said = ()
        self._made_of: list[Any] = []

    def reset(self) -> None:
        """Nothing is overridden, and no acceleration is remembered."""
        self.apply(())
        self.intervals.remember(np.zeros(self._model.nj))

    def apply(self, said: Said) -> None:
        """From now on these overrides are in force, by the names of the components that said them, and no others.

        Raises:
            WbcError: something in them makes no sense, by the component's name; then nothing has changed.
        """
        if len(said) == len(self.said) and all(one[1] is two[1] for one, two in zip(said, self.said, strict=True)):
            return
        self._binding.refresh()  # overrides are tried on what users assigned
        made_of = [getattr(overrides, what) for _, overrides in said for what in _OF_BOUNDS]
        is_same = len(made_of) == len(self._made_of) and all(map(is_, made_of, self._made_of))
        motors: dict[int, Motor] = {}
        settings: Mapping[str, Mapping[str, Any]] = {}
        tried: Tried = []
        for name, overrides in said:
            motors |= {} if is_same else self._checked_motors(name, overrides)
            if overrides.tasks:
                settings, tried = self._tried_settings(name, settings, overrides)
        actuators = self.actuators if is_same or motors == self._motors else self._moved(motors)
        bounds = {} if is_same else self._bounds(said, actuators)
        normals = (self._limits, self._floors) if is_same else self._normals(said)
        bias, inertia = self._added(said)
        # Nothing is refused any more.
        self.said, self._bias[:], self.inertia = said, bias, inertia
        self._binding.override(settings, tried)
        if is_same:
            return
        self._made_of, self._motors, self.actuators = made_of, motors, actuators
        for quantity, pair in bounds.items():
            former, self._in_force[quantity] = self._in_force[quantity], pair
            if pair is former or all(map(np.array_equal, pair, former)):
                continue
            if quantity == "torque":
                self._torque[0][:], self._torque[1][:] = pair
            else:
                self.intervals.replace(quantity, *pair, by_plan=True)
        self._limits[:], self._floors[:] = normals
        self.version += 1

    def _moved(self, motors: Mapping[int, Motor]) -> Actuators:
        share, offset = np.ones(self._model.nj), np.zeros(self._model.nj)
        for joint, motor in motors.items():
            share[joint], offset[joint] = motor
        return Actuators(share, offset)

    # ---- bounds on joints
    def _bounds(self, said: Said, motors: Actuators) -> dict[str, _Bounds]:
        """The bounds of this tick, by quantity."""
        own = dict(self._own)
        if self._level.dynamics and not motors.is_sound:
            own["torque"] = low, high = _given(*self._own["torque"], motors.share, motors.offset)
            crossed = low > high
            if crossed.any():
                joint = int(crossed.argmax())
                name = next(name for name, overrides in reversed(said) if joint in overrides.motors)
                refuse_bounds(self._model, f"{name}.motors", "torque", low, high)
        if not self._level.dynamics:
            for name, overrides in said:
                if overrides.torque is not None or "torque" in overrides.lifted:
                    raise NotSupported(f"{name} overrides torques, which the {self._level.name} does not decide")
        return {quantity: self._overridden(quantity, *bounds, said) for quantity, bounds in own.items()}

    def torques_at(self, v: Vec, by_speed: Sequence[TorqueBySpeed]) -> _Bounds:
        """Bounds on the torques (lower, upper), (nj,) each, at joint velocities v (nj,), which commands keep too."""
        low, high = (bound.copy() for bound in self._own["torque"])
        for limit in by_speed:
            limit.narrow(v, low, high)
        low, high = _given(low, high, self.actuators.share, self.actuators.offset)
        for _, overrides in self.said:
            lifted = list(overrides.lifted.get("torque", ()))
            low[lifted], high[lifted] = -np.inf, np.inf
        low, high = np.maximum(low, self._torque[0]), np.minimum(high, self._torque[1])
        return np.minimum(low, high), high  # a component may have left less than the state leaves

    def _checked_motors(self, name: str, overrides: Overrides) -> dict[int, Motor]:
        if overrides.motors and not self._level.dynamics:
            raise NotSupported(f"{name}: motors take torques, which the {self._level.name} does not decide")
        found = {}
        for joint, motor in overrides.motors.items():
            i = self._joint(name, "motors", joint)
            share, offset = motor if isinstance(motor, tuple | list) and len(motor) == 2 else (motor, 0.0)
            share = checks.number(f"{name}.motors[{i}].share", share, low=0.0, high=1.0)
            if 0.0 < share < _LEAST_SHARE:
                raise InvalidInput(f"{name}.motors[{i}].share is {share:g}; it must be 0 or at least {_LEAST_SHARE:g}")
            found[i] = Motor(share, checks.number(f"{name}.motors[{i}].offset", offset))
        return found

    def _overridden(self, quantity: str, low: Vec, high: Vec, said: Said) -> _Bounds:
        """The stack's own bounds where none is lifted, narrowed."""
        if not any(overrides.lifted or getattr(overrides, quantity) is not None for _, overrides in said):
            return low, high
        low, high = low.copy(), high.copy()
        for name, overrides in said:
            lifted = self._lifted(name, quantity, overrides)
            low[lifted], high[lifted] = -np.inf, np.inf
        for name, overrides in said:
            low, high = self._narrowed(name, quantity, overrides, low, high)
        return low, high

    def _narrowed(self, name: str, quantity: str, overrides: Overrides, low: Vec, high: Vec) -> _Bounds:
        given = getattr(overrides, quantity)
        if given is None:
            return low, high
        nj = self._model.nj
        lower, upper = (
            checks.each(f"{name}.{quantity}.{side}", v, nj, finite=False)
            for side, v in zip(("lower", "upper"), given, strict=True)
        )
        refuse_bounds(self._model, name, quantity, lower, upper)
        low, high = np.maximum(low, lower), np.minimum(high, upper)
        refuse_bounds(self._model, name, quantity, low, high, beside=" beside the limits that hold already")
        return low, high

    def _lifted(self, name: str, quantity: str, overrides: Overrides) -> list[int]:
        for what in overrides.lifted:
            if what not in QUANTITIES:
                raise InvalidInput(f"{name}.lifted has {what!r}; it may have {', '.join(QUANTITIES)}")
        joints: Any = overrides.lifted.get(quantity, ())
        checks.instance(f"{name}.lifted[{quantity!r}]", joints, tuple, "indices of joints")
        return [self._joint(name, f"lifted[{quantity!r}]", joint) for joint in joints]

    def _joint(self, name: str, where: str, joint: Any) -> int:
        if isinstance(joint, bool) or not isinstance(joint, int | np.integer) or not 0 <= joint < self._model.nj:
            raise InvalidInput(
                f"{name}.{where} names joint {checks.shown(joint)}; there are joints 0 to {self._model.nj - 1}"
            )
        return int(joint)

    # ---- the rest
    def refuse_no_inertia(self, state: RobotState) -> None:
        """Kinetic energy is positive, whatever components add to M.

        Raises:
            InvalidInput: M + inertia has a negative eigenvalue in this state, by the names of the components.
        """
        if self.inertia is None or not self._level.dynamics:
            return
        M = state.M + self.inertia
        try:
            np.linalg.cholesky(M)
        except np.linalg.LinAlgError:
            values = np.linalg.eigvalsh(M)
            if values[0] < -ROUNDING * values[-1]:  # zeros are links without mass
                names = ", ".join(name for name, overrides in self.said if overrides.inertia is not None)
                raise InvalidInput(
                    f"{names}.inertia: M + inertia has the eigenvalue {values[0]:.3g}; an inertia has none below 0"
                ) from None

    def _tried_settings(
        self, name: str, before: Mapping[str, Mapping[str, Any]], overrides: Overrides
    ) -> tuple[Mapping[str, Mapping[str, Any]], Tried]:
        """Settings of members, also those of components ``before``, and what they change."""
        settings = {**before, **{task: {**before.get(task, {}), **said} for task, said in overrides.tasks.items()}}
        try:
            return settings, self._binding.tried(settings)
        except Exception as cause:  # a target function is a user's, and is called here
            raise InvalidInput(f"{name}.tasks: {type(cause).__name__}: {cause}") from cause

    def _normals(self, said: Said) -> _Bounds:
        limits, floors = np.full_like(self._limits, np.inf), np.full_like(self._floors, -np.inf)
        for name, overrides in said:
            for bounds, values, what, narrower in (
                (limits, overrides.normal_limits, "normal_limits", min),
                (floors, overrides.normal_floors, "normal_floors", max),
            ):
                for contact, value in values.items():
                    if contact not in self.places:
                        raise UnknownName(contact, self.places, f"{name}.{what} speaks of a contact")
                    if not isinstance(value, int | float | np.number) or np.isnan(value):
                        where = f"{name}.{what}[{checks.shown(contact)}]"
                        raise InvalidInput(f"{where} is {checks.shown(value)}; it must be a number [N]")
                    place = self.places[contact]
                    bounds[place] = narrower(bounds[place], float(value))
            crossed = ~((floors <= limits) & (limits >= 0.0) & (floors < np.inf))
            if crossed.any():
                i = int(np.argmax(crossed))
                contact = next(key for key, place in self.places.items() if place == i)
                raise InvalidInput(
                    f"{name}: contact {contact!r} is left no normal force: from {floors[i]:g} to {limits[i]:g} N"
                )
        return limits, floors

    def _added(self, said: Said) -> tuple[Vec | float, Mat | None]:
        bias: Vec | float = 0.0
        inertia: Mat | None = None
        nv = self._model.nv
        for name, overrides in said:
            if overrides.bias is not None:
                bias = bias + checks.array(f"{name}.bias", overrides.bias, (nv,))
            if overrides.inertia is not None:
                more = checks.array(f"{name}.inertia", overrides.inertia, (nv, nv))
                checks.symmetric(f"{name}.inertia", more)
                inertia = more if inertia is None else inertia + more
        return bias, inertia


#: A motor that gives a smaller share is none: commands are divided by it.
_LEAST_SHARE = 1e-3


def _given(low: Vec, high: Vec, share: Vec, offset: Vec) -> _Bounds:
    """Bounds on the torques that motors give, which hold for what they are sent too."""
    with np.errstate(invalid="ignore"):  # 0 · inf of a motor that gives nothing and has no limit
        return (
            np.maximum(low, np.where(share > 0.0, share * low, 0.0) - offset),
            np.minimum(high, np.where(share > 0.0, share * high, 0.0) - offset),
        )
