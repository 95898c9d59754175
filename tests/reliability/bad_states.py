"""Bad states: what is no state raises if it is no vector of numbers, and is answered within the limits if it is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np

import wbc
from tests.reliability.faults import excess, limited
from tests.reliability.forked import Case
from wbc.errors import NotSupported
from wbc.qp.solvers import by_name
from wbc.types import Status

LEVELS = {"velocity": wbc.VelocityLevel(), "acceleration": wbc.AccelerationLevel(), "torque": wbc.InverseDynamics()}


@cache
def robot(name: str) -> Any:
    return wbc.load(name)


def controller(name: str, level: str, solver: str) -> wbc.Controller:
    """A controller with limits on everything; solvers that it refuses are refused by name."""
    try:
        return wbc.Controller(robot(name), limited(robot(name), LEVELS[level]), level=LEVELS[level], solver=solver)
    except NotSupported:
        assert by_name(solver).offline
        return wbc.Controller(robot(name), limited(robot(name), LEVELS[level]), level=LEVELS[level])


def bounded(name: str, level: str, t: Any, q: Any, v: Any, *, invalid: bool) -> Callable[[str], str]:
    """A tick with this state after a good one, and another good one: finite, within the limits, solved again."""

    def call(solver: str) -> str:
        control = controller(name, level, solver)
        still = np.zeros(control.model.nv)
        assert control.tick(0.0, control.model.q0, still).status.ok
        command = control.tick(t, q, v)
        assert excess(control, command) <= 1e-6, f"{command} {excess(control, command)}"
        assert (command.status is Status.INVALID_STATE) == invalid, f"{command}"
        if invalid:
            assert control.why, "it says why"
        assert control.tick(1.0, control.model.q0, still).status.ok
        return str(command)

    return call


def raising(t: Any, q: Any, v: Any) -> Callable[[str], object]:
    return lambda solver: controller("arm", "velocity", solver).tick(t, q, v)


def cases() -> Iterator[Case]:
    """Bad inputs of this kind."""
    zero = np.zeros(7)

    def third(value: float) -> Any:
        return np.where(np.arange(7) == 2, value, 0.0)

    for level in LEVELS:
        for value in (np.nan, np.inf, -np.inf, 1e300, 1e20):
            yield Case(f"{level}: q[2] = {value:g}", bounded("arm", level, 1e-3, third(value), zero, invalid=True))
            yield Case(f"{level}: v[2] = {value:g}", bounded("arm", level, 1e-3, zero, third(value), invalid=True))
        for name, q, v in (
            ("q[2] = 1e+06", third(1e6), zero), ("q[2] = -1000", third(-1e3), zero), ("v[2] = 1e4", zero, third(1e4)),
            ("v a quarter above its limit", zero, np.full(7, 2.5)),
            ("all joints outside", np.minimum(robot("arm").limits.q_max + 0.1, 4.0), zero),
            ("denormals", np.full(7, 5e-324), np.full(7, -5e-324)),
        ):  # fmt: skip
            yield Case(f"{level}: {name}", bounded("arm", level, 1e-3, q, v, invalid=False))
    for t in (np.nan, np.inf, 1e300):
        yield Case(f"t = {t:g}", bounded("arm", "torque", t, zero, zero, invalid=True))
    yield Case("whole numbers", bounded("arm", "torque", 1, np.zeros(7, int), [0] * 7, invalid=False))
    yield Case("time goes back", bounded("arm", "torque", -5.0, zero, zero, invalid=False))
    for name in ("quadruped", "humanoid"):
        q0, still = np.array(robot(name).q0), np.zeros(robot(name).nv)
        place = np.arange(len(q0))
        for norm in (0.0, 2.0, np.nan, 1e30):
            q = np.where((3 <= place) & (place < 7), norm * q0, q0)
            yield Case(f"{name}: quaternion of norm {norm:g}", bounded(name, "torque", 1e-3, q, still, invalid=True))
        lifted = q0 + 0.3 * (place == 2)
        yield Case(f"{name}: feet in the air", bounded(name, "torque", 1e-3, lifted, still, invalid=False))
        yield Case(f"{name}: fast", bounded(name, "torque", 1e-3, q0, still + 3.0, invalid=False))
    for name, t, q, v, says in (
        ("q one short", 0.0, np.zeros(6), zero, ("q", "(7,)", "(6,)")),
        ("q one long", 0.0, np.zeros(8), zero, ("q", "(7,)", "(8,)")),
        ("v one short", 0.0, zero, np.zeros(6), ("v", "(7,)", "(6,)")),
        ("q a matrix", 0.0, np.zeros((7, 1)), zero, ("q", "(7,)", "(7, 1)")),
        ("q and v in one", 0.0, np.zeros(14), zero, ("q", "(14,)")),
        ("q None", 0.0, None, zero, ("tick", "real number")),
        ("v of words", 0.0, zero, ["a"] * 7, ("tick",)),
        ("q a word", 0.0, "stand", zero, ("tick",)),
        ("q ragged", 0.0, [[0.0], 1.0], zero, ("tick",)),
        ("t None", None, zero, zero, ("tick",)),
        ("t a word", "now", zero, zero, ("tick",)),
        ("t a vector", zero, zero, zero, ("tick",)),
    ):
        yield Case(name, raising(t, q, v), says)
