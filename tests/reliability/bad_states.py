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
    nq = nv = 7
    zero = np.zeros(7)

    def spoilt(size: int, value: float, at: int = 2) -> Any:
        vector = np.zeros(size)
        vector[at] = value
        return vector

    for level in LEVELS:
        for value in (np.nan, np.inf, -np.inf, 1e300, 1e20):
            for which in "qv":
                q, v = (spoilt(7, value), zero) if which == "q" else (zero, spoilt(7, value))
                yield Case(f"{level}: {which}[2] = {value:g}", bounded("arm", level, 1e-3, q, v, invalid=True))
        for value in (1e6, -1e3):
            yield Case(f"{level}: q[2] = {value:g}", bounded("arm", level, 1e-3, spoilt(7, value), zero, invalid=False))
        yield Case(f"{level}: v[2] = 1e4", bounded("arm", level, 1e-3, zero, spoilt(7, 1e4), invalid=False))
        yield Case(
            f"{level}: v a quarter above its limit", bounded("arm", level, 1e-3, zero, np.full(7, 2.5), invalid=False)
        )
        outside = robot("arm").limits.q_max + 0.1
        yield Case(
            f"{level}: all joints outside", bounded("arm", level, 1e-3, np.minimum(outside, 4.0), zero, invalid=False)
        )
        yield Case(
            f"{level}: denormals", bounded("arm", level, 1e-3, np.full(7, 5e-324), np.full(7, -5e-324), invalid=False)
        )
    for t in (np.nan, np.inf, 1e300):
        yield Case(f"t = {t:g}", bounded("arm", "torque", t, zero, zero, invalid=True))
    yield Case("whole numbers", bounded("arm", "torque", 1, np.zeros(7, int), [0] * 7, invalid=False))
    yield Case("time goes back", bounded("arm", "torque", -5.0, zero, zero, invalid=False))
    for name in ("quadruped", "humanoid"):
        model = robot(name)
        still = np.zeros(model.nv)
        for norm in (0.0, 2.0, np.nan, 1e30):
            q = np.array(model.q0)
            q[3:7] = q[3:7] * norm
            yield Case(f"{name}: quaternion of norm {norm:g}", bounded(name, "torque", 1e-3, q, still, invalid=True))
        far = np.array(model.q0)
        far[2] += 0.3
        yield Case(f"{name}: feet in the air", bounded(name, "torque", 1e-3, far, still, invalid=False))
        yield Case(f"{name}: fast", bounded(name, "torque", 1e-3, model.q0, np.full(model.nv, 3.0), invalid=False))
    for name, t, q, v, says in (
        ("q one short", 0.0, np.zeros(nq - 1), zero, ("q", "(7,)", "(6,)")),
        ("q one long", 0.0, np.zeros(nq + 1), zero, ("q", "(7,)", "(8,)")),
        ("v one short", 0.0, zero, np.zeros(nv - 1), ("v", "(7,)", "(6,)")),
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
