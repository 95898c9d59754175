"""Rows about joints: their Jacobian never changes, and is not written here."""

from __future__ import annotations

from wbc.compiled import callee
from wbc.stack.compiled.row_kernel import rows


@callee
def steady(at: int) -> int:
    """The motion of now."""
    k = rows(at)
    for r in range(len(k.e)):
        k.e[r], k.rate_ref[r] = 0.0, k.v[r]
    return 1


@callee
def position(at: int) -> int:
    """The target is a position."""
    k = rows(at)
    for r in range(len(k.e)):
        k.e[r], k.rate_ref[r], k.acc_ref[r] = k.value[r] - k.q[r], k.rate[r], k.second[r]
    return 1


@callee
def admittance(at: int) -> int:
    """The target yields to a torque; ``numbers``: which joints are held, compliances, mobilities, (nj,) each."""
    k = rows(at)
    n = len(k.e)
    for r in range(n):
        torque = k.value[n + r]
        k.e[r] = k.numbers[r] * (k.value[r] + k.numbers[n + r] * torque - k.q[r])
        k.rate_ref[r], k.acc_ref[r] = k.rate[r] + k.numbers[2 * n + r] * torque, k.second[r]
    return 1


@callee
def linear(at: int) -> int:
    """e = offset − A q; ``numbers``: the offsets (dim,), A by rows, behind columns of the base."""
    k = rows(at)
    n, nj = len(k.e), len(k.q)
    width = len(k.numbers) // n - 1
    for r in range(n):
        k.e[r] = k.numbers[r]
        for j in range(nj):
            k.e[r] -= k.numbers[n + (r + 1) * width - nj + j] * k.q[j]
    return 1
