"""The planar robots of the tests, and the same chains in Pinocchio: an oracle that shares no formula with ours."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import sympy as sp

from wbc.models import Chain, Planar4P, PlanarPR
from wbc.models.lagrange import derive

_JOINTS = {"R": pin.JointModelRZ, "Px": pin.JointModelPX, "Py": pin.JointModelPY}

#: Every kind of joint after every kind, constant and moving inertias, one to four joints.
CHAINS = ("R", "Py", "PR", "RP", "RPy", "PyR", "RR", "PPyPPy", "PRP", "RPyR", "RRR", "RPRPy")


def some_parameters(chain: Chain, seed: int = 0) -> dict[str, float]:
    """Numbers between 0.2 and 1.5 for every parameter, some offsets negative."""
    rng = np.random.default_rng([seed, len(chain)])
    sign = {name: -1.0 if name[0] == "d" and rng.random() < 0.3 else 1.0 for name in chain.parameters}
    return {name: sign[name] * float(rng.uniform(0.2, 1.5)) for name in chain.parameters}


def in_pinocchio(chain: Chain, parameters: dict[str, float], gravity: float) -> pin.Model:
    """A Pinocchio model with frames called link1, …, end_effector."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, -gravity, 0.0])
    parent, tip = 0, np.zeros(3)
    for i, kind in enumerate(chain.joints, start=1):
        mass, length, offset, inertia = (parameters.get(f"{name}{i}", 0.0) for name in "mldI")
        along = np.array([0.0, 1.0, 0.0]) if kind == "Py" else np.array([1.0, 0.0, 0.0])
        parent = model.addJoint(parent, _JOINTS[kind](), pin.SE3(np.eye(3), tip), f"q{i}")
        model.appendBodyToJoint(parent, pin.Inertia(mass, offset * along, inertia * np.eye(3)), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"link{i}", parent, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
        tip = length * along
    model.addFrame(pin.Frame("end_effector", parent, pin.SE3(np.eye(3), tip), pin.FrameType.OP_FRAME))
    return model


@cache
def derived_formulas(word: str) -> dict[str, Any]:
    """Each formula of a derivation as a function of q, v, w, a, parameters and g0."""
    d = derive(word)
    p = d.parametrisation
    expressions = {name: getattr(d, name) for name in ("M", "c", "S", "g", "J", "Jdot_v", "momentum", "beta")}
    expressions |= {"energy": sp.Matrix([d.T + d.U]), "regressor": p.Y, "coefficients": p.coefficients}
    symbols = [d.q, d.v, p.v_reference, d.a, list(d.parameters.values()), d.g0]
    return {name: sp.lambdify(symbols, value, "numpy") for name, value in expressions.items()}


def check_against_derivation(robot: Any, q: Any, v: Any, w: Any, a: Any, *, rtol: float, atol: float) -> None:
    """That a robot answers what is derived in symbols for its chain."""
    numbers = (q, v, w, a, list(robot.parameters.values()), robot.g0)
    answers = {
        "M": robot.M(q), "c": robot.c(q, v), "S": robot.S(q, v), "g": robot.g(q), "J": robot.J(q),
        "Jdot_v": robot.Jdot_v(q, v), "momentum": robot.momentum(q, v), "beta": robot.beta(q, v),
        "energy": robot.energy(q, v), "regressor": robot.regressor(q, v, w, a), "coefficients": robot.coefficients,
    }  # fmt: skip
    for name, formula in derived_formulas(str(robot.chain)).items():
        expected = np.reshape(formula(*numbers), np.shape(answers[name]))
        assert np.allclose(answers[name], expected, rtol=rtol, atol=atol), name


PR = PlanarPR(m1=1.0, m2=1.0, l2=0.5, d2=0.25, I2=0.1)
FOUR = Planar4P(m=(1.3, 0.8, 1.7, 0.6))
DERIVED = derive("RPyR").robot(some_parameters(derive("RPyR").chain))
ROBOTS = {"planar_pr": PR, "planar_4p": FOUR, "derived": DERIVED}
robots = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
