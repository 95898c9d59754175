"""Robots that need no download, and a command that is only numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from tasks import CenterOfMass, Orientation, Point, Posture, Sole, TorqueLimits
from wbc.control.controller import Controller
from wbc.stack.formulation import InverseDynamics
from wbc.stack.stack import Stack


@dataclass
class Numbers:
    """A command made by hand."""

    tau: np.ndarray
    a: np.ndarray
    v: np.ndarray


@pytest.fixture(scope="session")
def standing():
    """The contacts of a robot that stands on all its feet."""

    def contacts(model, friction=0.6):
        return [
            Point(foot.frame, radius=foot.radius, friction=friction)
            if foot.kind == "point"
            else Sole(foot.frame, half_size=foot.half_size, origin=foot.origin, friction=friction)
            for foot in model.feet.values()
        ]

    return contacts


@pytest.fixture(scope="session")
def stander(standing):
    """A controller that keeps a robot where it stands."""

    def make(model, contacts=None, **settings):
        state = model.state()
        base = state.frame(model.frame_names[0])
        upright = Orientation(base.name, target=base.rotation.copy(), weight=0.1)
        tasks = [CenterOfMass(target=state.com.copy()), upright, Posture(model.q0, kp=10, weight=1e-3)]
        contacts = standing(model) if contacts is None else contacts
        stack = Stack(tasks, subject_to=[TorqueLimits()], contacts=contacts)
        return Controller(model, stack, level=InverseDynamics(), **settings)

    return make


@pytest.fixture
def command():
    """A command for a robot: zeros, or what is given."""

    def make(model, *, tau=None, a=None, v=None):
        def vector(values, size):
            return np.zeros(size) if values is None else np.asarray(values, dtype=float)

        return Numbers(vector(tau, model.nj), vector(a, model.nv), vector(v, model.nv))

    return make
