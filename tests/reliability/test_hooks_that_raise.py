"""Whatever a member overrides may raise, or give what none can be: no tick raises, and the next sound one is solved."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import wbc
from tasks import JointLimits, Point, Position, Posture, TorqueLimits
from wbc.errors import InvalidInput

ROBOT = wbc.load("quadruped")
STILL = np.zeros(ROBOT.nv)
ON = {"reset": ["anchor", "reset"], "assign": ["gains", "weights", "cone", "f_max"], "tick": ["note"]}
#: What each is called in ``why``; a property is read where its value is used.
SAID = {"f_max": "bounds on the force", "note": "the tick"}
WRONG = {"raises": OSError("gone"), "nothing": None, "a number": np.nan, "an array": np.full((7, 2), np.inf)}


class Hooks:
    """What each hook does instead of what it should; nothing where all are sound."""

    broken: tuple[str, Any] | None = None

    @classmethod
    def of(cls, kind: type[Any], name: str) -> type[Any]:
        """A class whose method or property ``name`` does as it should until it is broken."""
        own = next(base.__dict__[name] for base in kind.__mro__ if name in base.__dict__)

        def answer(self: Any, *arguments: Any) -> Any:
            if cls.broken is not None and cls.broken[0] == name:
                if isinstance(cls.broken[1], Exception):
                    raise cls.broken[1]
                return cls.broken[1]
            return own.fget(self) if isinstance(own, property) else own(self, *arguments)

        return type(kind.__name__, (kind,), {name: property(answer, own.fset) if isinstance(own, property) else answer})


class Height(wbc.Barrier):
    """The trunk stays above the ground."""

    dim, units, note = 1, "m", ""

    def fill(self, state: Any, out: Any) -> None:
        trunk = state.frame("trunk")
        out.h[:], out.J[:], out.drift[:] = trunk.position[2], trunk.jacobian()[2:3], trunk.drift()[2:3]


def members(name: str) -> tuple[Any, Any, Any]:
    """A task, a contact and a barrier, of which those that have a hook of this name can break."""
    barrier = type("Height", (Height,), {"note": property(lambda _: "", lambda *_: None)}) if name == "note" else Height
    kinds = (Position, Point, barrier)
    task, contact, barrier = (Hooks.of(kind, name) if hasattr(kind, name) else kind for kind in kinds)
    foot, *_ = ROBOT.feet
    return (
        task("trunk", target=ROBOT.state().frame("trunk").position),
        contact(foot, friction=0.6, f_max=300.0),
        barrier(),
    )


CASES = [(when, name) for when, names in ON.items() for name in names]


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize(("when", "name"), CASES, ids=[name for _, name in CASES])
def test_no_tick_raises_and_why_names_the_hook(when: str, name: str, wrong: str, monkeypatch: Any) -> None:
    task, contact, barrier = members(name)
    others = [Point(foot, friction=0.6) for foot in list(ROBOT.feet)[1:]]
    stack = wbc.Stack(
        [task, Posture(ROBOT.q0, weight=1e-2)], contacts=[contact, *others],
        subject_to=[JointLimits(), TorqueLimits(), barrier],
    )  # fmt: skip
    controller = wbc.Controller(ROBOT, stack, level=wbc.InverseDynamics())
    assert controller.tick(0.0, ROBOT.q0, STILL).status.ok

    def again() -> None:
        if when == "reset":
            controller.reset()
        if when == "assign":
            task.weight, contact.kd = 2.0, 30.0

    again()
    monkeypatch.setattr(Hooks, "broken", (name, WRONG[wrong]))
    for k in (1, 2):
        command = controller.tick(1e-3 * k, ROBOT.q0, STILL)
        harmless = name in ("reset", "f_max", "weights") or (name == "note" and wrong == "nothing")
        if command.status.ok:
            assert harmless and wrong != "raises", "what it gave makes sense"
            continue
        assert np.isfinite(command.tau).all() and (np.abs(command.tau) <= ROBOT.limits.tau_max + 1e-9).all()
        said = SAID.get(name, f".{name}"), "is not finite", "is NaN"
        assert any(words in controller.why for words in said), controller.why
    monkeypatch.setattr(Hooks, "broken", None)
    again()
    assert controller.tick(3e-3, ROBOT.q0, STILL).status.ok


def test_a_component_that_refuses_a_stack_leaves_the_others_with_the_plan_that_stays() -> None:
    class Plans(wbc.Component):
        seen: Any = None

        def check(self, plan: Any) -> None:
            self.seen = plan

    class Picky(wbc.Component):
        def check(self, plan: Any) -> None:
            raise KeyError("not for me")

    arm, kept = wbc.load("arm"), Plans()
    controller = wbc.Controller(arm, wbc.Stack([Posture(arm.q0)], components=[kept]), level=wbc.AccelerationLevel())
    controller.tick(0.0, arm.q0, np.zeros(arm.nv))
    first = kept.seen
    with pytest.raises(wbc.errors.WbcError, match=r"Picky\.check raised KeyError"):
        controller.replace(wbc.Stack([Posture(arm.q0, weight=2.0)], components=[kept, Picky()]))
    assert kept.seen is first is controller.plan
    with pytest.raises(InvalidInput):
        controller.replace(wbc.Stack([Posture(arm.q0[:3])], components=[kept]))
    assert kept.seen is first and controller.tick(1e-3, arm.q0, np.zeros(arm.nv)).status.ok
