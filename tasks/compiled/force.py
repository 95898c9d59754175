"""Rows about torques and forces: what they are wanted to be."""

from __future__ import annotations

from wbc.compiled import callee
from wbc.stack.compiled.row_kernel import rows


@callee
def target(at: int) -> int:
    """The target; A, where it is written, is the identity."""
    k = rows(at)
    if 0 < k.C.shape[1] < len(k.e):
        return 0
    for r in range(len(k.e)):
        k.e[r] = k.value[r]
        if k.C.shape[1] > 0:
            k.C[r, r] = 1.0
    return 1


@callee
def centre_of_pressure(at: int) -> int:
    """No moments about the target."""
    k = rows(at)
    if k.C.shape[1] != 6:
        return 0
    k.e[0] = k.e[1] = 0.0
    k.C[0, 2], k.C[0, 4] = k.value[0], 1.0
    k.C[1, 2], k.C[1, 3] = -k.value[1], 1.0
    return 1


@callee
def gravity(at: int) -> int:
    """The bias; ``numbers``: of each row its joint."""
    k = rows(at)
    nb = len(k.bias) - len(k.q)
    for r in range(len(k.e)):
        k.e[r] = k.bias[nb + int(k.numbers[r])]
    return 1


@callee
def impedance(at: int) -> int:
    """The bias, a spring and a damper; ``numbers``: of each row its joint, stiffness, damping, (dim,) each."""
    k = rows(at)
    n, nb = len(k.e), len(k.bias) - len(k.q)
    for r in range(n):
        j = int(k.numbers[r])
        spring = k.numbers[n + r] * (k.value[j] - k.q[j])
        k.e[r] = k.bias[nb + j] + spring + k.numbers[2 * n + r] * (k.rate[j] - k.v[j])
    return 1
