"""JointMap: which joint of a robot is which slot of a device, with sign, offset, gear and unit. Not tried on hardware.

With the slot p of a joint q, s = ±1, gear ratio g > 0, u the device's units in a radian (1, or 180/π) and the offset o:

    position    p = s g u q + o             q = (p − o) / (s g u)
    velocity    ṗ = s g u q̇                 q̇ = ṗ / (s g u)
    torque      τ_p = τ / (s g)             τ = s g τ_p
    gain        k_p = k / (g² u)            k = g² u k_p

Torque goes the other way than velocity: a motor that turns g times as fast as its joint gives 1/g of the torque, and
the power is the same at both, τ_p ṗ / u = τ q̇. Gains are those of τ = k (q* − q), so signs cancel. A torque is in N m
on both sides, also where angles are degrees; a gain is then N m per degree.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput, UnknownJoint, UnknownSlot
from wbc.models.model import RobotModel
from wbc.types import Index, Vec, read_only

#: Units of a slot's position, and how many of each there are in our rad (or m).
UNITS = {"rad": 1.0, "deg": 180.0 / np.pi, "m": 1.0}


@final
@dataclass(frozen=True, eq=False)
class JointMap(metaclass=TellsArguments):
    """Joints of a robot on the slots of a device. Not tried on hardware.

    Its functions turn arrays (n,), in the order of ``joints``, into arrays (size,), in the order of ``device``, and
    back. Every slot is named: by ``slots``, the slot of each joint, or by ``idle``, the slots without joint of ours.
    Both ways are each other's inverse: to the last bit if only order and signs differ, within rounding with gears,
    offsets and degrees. ``index`` (n,) has the place of each joint's slot on the device.

    Args:
        joints: names of the robot's joints, in the order of our arrays.
        slots: name of the slot of each joint, in the same order.
        device: names of all slots that the device has, in its order.
        sign: +1 or −1; as the other three: one for all joints, (n,), or {joint: value} for those that differ.
        offset: o [unit of the device]: the device's value where the joint is at 0.
        gear: g > 0, turns of the device's axis per turn of the joint.
        unit: "rad", "deg" or "m"; a gripper that counts 0 to 100 has "rad", gear and offset.
        idle: names of the slots without joint of ours.

    Raises:
        InvalidInput: a joint or slot twice; a slot with neither joint nor ``idle``; another sign, a gear that is not
            positive, a number that is not finite, another unit.
        UnknownSlot, UnknownJoint: a name that the device, or ``joints``, does not have.

    Example:
        >>> from wbc.robots import JointMap
        >>> slots, device = ["m1", "m0"], ["m0", "m1", "m2"]
        >>> leg = JointMap(["hip", "knee"], slots, device, sign={"knee": -1}, gear=[1, 2], idle=["m2"])
        >>> leg.position_to_device([0.1, 0.2])
        array([-0.4,  0.1,  0. ])
        >>> leg.torque_to_device([1.0, 4.0])
        array([-2.,  1.,  0.])
        >>> leg.position_from_device([-0.4, 0.1, 0.0])
        array([0.1, 0.2])
    """

    joints: Any
    slots: Any
    device: Any
    sign: Any = 1.0
    offset: Any = 0.0
    gear: Any = 1.0
    unit: Any = "rad"
    idle: Any = ()
    index: Index = field(init=False)
    _position: Vec = field(init=False, repr=False)
    _torque: Vec = field(init=False, repr=False)
    _gain: Vec = field(init=False, repr=False)

    def __post_init__(self) -> None:
        device, joints = checks.names("device", self.device), checks.names("joints", self.joints)
        slots, idle = checks.items("slots", self.slots, "names"), checks.items("idle", self.idle, "names")
        if len(slots) != len(joints):
            raise InvalidInput(f"slots has {len(slots)} names for {len(joints)} joints; give the slot of each joint")
        owner: dict[str, str] = {}
        for slot, who in [*zip(slots, joints, strict=True), *((slot, "idle") for slot in idle)]:
            if not isinstance(slot, str) or slot not in device:
                raise UnknownSlot(slot, device)
            if slot in owner:
                raise InvalidInput(f"slot {slot!r} is given twice, to {owner[slot]} and {who}; give each slot once")
            owner[slot] = who
        if gaps := [slot for slot in device if slot not in owner]:
            raise InvalidInput(f"slot {gaps[0]!r} has no joint; map one to it, or name it in idle")
        values = {name: _numbers(name, getattr(self, name), joints) for name in ("sign", "offset", "gear")}
        units = _each(self.unit, "unit", joints, "rad")
        factor = np.array([UNITS[checks.one_of(f"unit of {j}", u, UNITS)] for j, u in zip(joints, units, strict=True)])
        for joint, sign, gear in zip(joints, values["sign"], values["gear"], strict=True):
            if abs(sign) != 1.0:
                raise InvalidInput(f"sign of {joint} is {sign:g}; it must be 1 or -1, and a ratio belongs in gear")
            if gear <= 0.0:
                raise InvalidInput(f"gear of {joint} is {gear:g}; it must be > 0, and a direction belongs in sign")
        index = np.array([device.index(slot) for slot in slots], dtype=np.intp)
        scale = values["sign"] * values["gear"]
        made = {"joints": joints, "slots": tuple(slots), "device": device, "idle": tuple(idle), **values}
        made |= {"unit": tuple(units), "index": index, "_torque": scale, "_position": scale * factor}
        for name, value in {**made, "_gain": values["gear"] ** 2 * factor}.items():
            if isinstance(value, np.ndarray):
                read_only(value)
            object.__setattr__(self, name, value)

    @classmethod
    def of(
        cls,
        robot: RobotModel,
        device: Any,
        *,
        names: Any = None,
        joints: Any = None,
        idle: Any = (),
        **conventions: Any,
    ) -> JointMap:
        """The map of a robot's joints, in the robot's order, to the slots that have their names.

        Args:
            robot: from ``wbc.load``.
            device: names of all slots that the device has, in its order.
            names: {joint: slot} for joints whose slot is called otherwise.
            joints: those of the robot's joints that the device drives; default: all.
            idle: names of the slots without joint of ours.
            **conventions: ``sign``, ``offset``, ``gear``, ``unit``, as above.

        Raises:
            InvalidInput, UnknownSlot, UnknownJoint: as above, for a joint that the robot does not have, and for degrees
                of a joint that slides.

        Example:
            >>> import wbc
            >>> from wbc.robots import JointMap
            >>> robot = wbc.load("arm")
            >>> arm = JointMap.of(robot, sorted(robot.joint_names), unit="deg")
            >>> arm.index.tolist()
            [3, 2, 4, 0, 1, 5, 6]
        """
        if not isinstance(robot, RobotModel):
            raise InvalidInput(f"robot is {checks.shown(robot)}; it must be a robot from wbc.load")
        wanted = robot.joint_names if joints is None else checks.names("joints", joints)
        called = {} if names is None else names
        if not isinstance(called, Mapping):
            raise InvalidInput(f"names is {checks.shown(names)}; it must be a dictionary {{joint: slot}}")
        for joint in (*wanted, *called):
            robot.joint(joint)
        try:
            made = cls(wanted, [called.get(joint, joint) for joint in wanted], device, idle=idle, **conventions)
        except TypeError as cause:
            raise InvalidInput(f"{cause}; a map has sign, offset, gear and unit") from cause
        for joint, unit in zip(made.joints, made.unit, strict=True):
            if unit == "deg" and robot.joint_units[robot.joint(joint)] == "m":
                raise InvalidInput(f"unit of {joint} is deg; it slides, so it must be m")
        return made

    @property
    def size(self) -> int:
        """The number of slots of the device."""
        return len(self.device)

    def position_to_device(self, q: Any, *, rest: float = 0.0) -> Vec:
        """p (size,) [unit] of q (n,) [rad, m]; ``rest`` stands in idle slots."""
        return self._out(self._of_joints("q", q) * self._position + self.offset, rest)

    def position_from_device(self, p: Any) -> Vec:
        """q (n,) [rad, m] of p (size,) [unit]; idle slots may have any number."""
        q: Vec = (self._in("p", p) - self.offset) / self._position
        return q

    def velocity_to_device(self, v: Any, *, rest: float = 0.0) -> Vec:
        """ṗ (size,) [unit/s] of q̇ (n,) [rad/s, m/s]."""
        return self._out(self._of_joints("v", v) * self._position, rest)

    def velocity_from_device(self, p: Any) -> Vec:
        """q̇ (n,) [rad/s, m/s] of ṗ (size,) [unit/s]."""
        return self._in("velocity", p) / self._position

    def torque_to_device(self, tau: Any) -> Vec:
        """τ_p (size,) [N m] of τ (n,) [N m]; 0 in idle slots."""
        return self._out(self._of_joints("tau", tau) / self._torque, 0.0)

    def torque_from_device(self, tau: Any) -> Vec:
        """τ (n,) [N m] of τ_p (size,) [N m]."""
        return self._in("tau", tau) * self._torque

    def gain_to_device(self, gain: Any) -> Vec:
        """k_p (size,) [N m/unit] of k (n,) [N m/rad], kp as kd; 0 in idle slots."""
        return self._out(self._of_joints("gain", gain) / self._gain, 0.0)

    def gain_from_device(self, gain: Any) -> Vec:
        """k (n,) [N m/rad] of k_p (size,) [N m/unit]."""
        return self._in("gain", gain) * self._gain

    def _of_joints(self, name: str, value: Any) -> Vec:
        return checks.array(name, value, (len(self.joints),))

    def _out(self, values: Vec, rest: float) -> Vec:
        result = np.full(self.size, checks.number("rest", rest))
        result[self.index] = values
        return result

    def _in(self, name: str, value: Any) -> Vec:
        every = checks.array(name, value, (self.size,))
        found: Vec = every[self.index]
        return found


def _each(value: Any, name: str, joints: tuple[str, ...], rest: Any) -> list[Any]:
    """``value`` of each joint: one for all, a list, or a dictionary by joint, with ``rest`` for the others."""
    if isinstance(value, Mapping):
        for joint in value:
            if joint not in joints:
                raise UnknownJoint(joint, joints, f"in {name}")
        return [value.get(joint, rest) for joint in joints]
    if isinstance(value, str):
        return [value] * len(joints)
    found = checks.items(name, value, "one for each joint")
    if len(found) != len(joints):
        raise InvalidInput(
            f"{name} has {len(found)} entries for {len(joints)} joints; give one for each, or one for all"
        )
    return found


def _numbers(name: str, value: Any, joints: tuple[str, ...]) -> Vec:
    if isinstance(value, Mapping):
        by_joint = _each(value, name, joints, 0.0 if name == "offset" else 1.0)
        return np.array([checks.number(f"{name} of {j}", one) for j, one in zip(joints, by_joint, strict=True)])
    return checks.each(name, value, len(joints))
