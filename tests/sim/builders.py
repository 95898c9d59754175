"""Robots that need no download, and a command that is only numbers."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

import wbc
from tasks import CenterOfMass, Orientation, Posture, TorqueLimits, feet


def standing(model: Any) -> list[Any]:
    """The contacts of a robot that stands on all its feet."""
    return feet(model, friction_share=1.0)


def stander(model: Any, **settings: Any) -> wbc.Controller:
    """A controller that keeps a robot where it stands."""
    state = model.state()
    base = state.frame(model.frame_names[0])
    upright = Orientation(base.name, target=base.rotation.copy(), weight=0.1)
    tasks = [CenterOfMass(target=state.com.copy()), upright, Posture(model.q0, kp=10, weight=1e-3)]
    stack = wbc.Stack(tasks, subject_to=[TorqueLimits()], contacts=standing(model))
    return wbc.Controller(model, stack, level=wbc.InverseDynamics(), **settings)


def command(model: Any, **given: Any) -> Any:
    """A command for a robot: τ, a and v that are zero, or what is given."""
    zero = {"tau": np.zeros(model.nj), "a": np.zeros(model.nv), "v": np.zeros(model.nv)}
    return SimpleNamespace(**zero | {name: np.asarray(values, dtype=float) for name, values in given.items()})
