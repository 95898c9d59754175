"""Whatever a method is given, it is made or refused with the project's own error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from wbc import methods
from wbc.errors import WbcError

ROW = np.ones((1, 2))
#: What makes each method, and arguments that it takes.
MADE: Mapping[str, tuple[Callable[..., object], dict[str, Any]]] = {
    "saturation": (methods.NullSpaceSaturation, {"J": ROW, "target": [1.0], "lower": -1.0, "upper": 1.0, "drift": [0]}),
    "prioritised": (methods.NullSpaceSaturation.prioritised, {"tasks": [(ROW, [1.0])], "lower": -1.0, "upper": 1.0}),
    "step": (
        methods.ProjectedGradientStep,
        {"v_task": [0.1, 0.2], "v_null": [1.0, 0], "v_min": -1.0, "v_max": 1.0, "alpha_max": 2.0, "origin": None},
    ),
    "step from gradient": (
        methods.ProjectedGradientStep.from_gradient,
        {"J": ROW, "task_velocity": [1.0], "gradient": [1.0, 0], "v_min": -1.0, "v_max": 1.0, "alpha_max": 2.0},
    ),
    "forces": (
        methods.ForceDistribution,
        {"G": np.eye(3), "wrench": [0, 0, 1.0], "weight": 1.0, "friction": 0.5, "friction_model": "inner",
         "f_min": -1.0, "f_max": 1.0},
    ),
    "torque": (
        methods.WeightedTorque,
        {"M": np.eye(2), "n": [0.0, 0], "J": ROW, "task_acceleration": [1.0], "drift": 0.0, "tau_0": 0.0,
         "tau_external": 0.0, "weight": "identity", "tau_min": -1.0, "tau_max": 1.0, "equalities": (ROW, [0.0]),
         "damping": 0.0},
    ),
    "fractions": (methods.FaultFraction, {"tau": [1.0, 2.0], "residual": [0.0, 1.0], "weight": 1.0}),
    "parameters": (
        methods.ParameterUpdate,
        {"Y": ROW, "s": [1.0], "gain": 1.0, "a_hat": [0.5, 0.5], "lower": 0.0, "upper": 1.0, "C": ROW, "d": [3.0]},
    ),
    "inertia": (methods.PseudoInertia, {"parameters": np.ones(10), "length": 0.1, "floor": 1e-6}),
    "contact": (
        methods.ContactEstimate,
        {"J": np.ones((3, 2)), "residual": [1.0, 2.0], "weight": 1.0, "normal": [0, 0, 1.0], "friction": 0.5},
    ),
    "residual": (methods.MomentumResidual, {"gain": 1.0, "dt": 0.1, "scheme": "exact"}),
}  # fmt: skip
JUNK: tuple[Any, ...] = (
    None, "a", b"a", [], {}, object(), np.nan, 1j, np.datetime64("2020-01-01"), 10**400, [[1], [2, 3]],
    np.ones((2, 2, 2)), np.array([None, 1.0]), 3, -1, True, lambda: 0, "1.0", (1, 2), np.inf, -np.inf, np.array(1.0),
)  # fmt: skip


@pytest.mark.parametrize(
    ("name", "argument"), [(name, argument) for name, (_, arguments) in MADE.items() for argument in arguments]
)
def test_every_argument_is_taken_or_refused_by_name(name: str, argument: str):
    made, arguments = MADE[name]
    made(**arguments)
    for junk in JUNK:
        try:
            made(**{**arguments, argument: junk})
        except WbcError as refused:
            assert str(refused)


def test_names_of_forms_and_numbers_of_components_are_checked_too():
    torque = methods.WeightedTorque(np.eye(1), [0.0], [[1.0]], [1.0])
    residual = methods.MomentumResidual(gain=1.0, dt=0.1)
    residual.reset(np.zeros(2))
    calls: tuple[Callable[[Any], object], ...] = (
        torque.closed_form, lambda form: torque.solve(form=form), residual.restart,
        methods.PseudoInertia.metric,
    )  # fmt: skip
    for call in calls:
        for junk in ("a", None, [], 1j, np.nan, -1):
            with pytest.raises(WbcError):
                call(junk)
