"""Rows about one frame whose target gives way to what is measured."""

from __future__ import annotations

from wbc.compiled import callee
from wbc.stack.compiled.geometry import log3, turn_by
from wbc.stack.compiled.row_kernel import rows


@callee
def admittance(at: int) -> int:
    """A pose that a wrench moves; ``numbers``: which rows are held, compliances, mobilities, six each."""
    k = rows(at)
    held, compliance, mobility, wrench = k.numbers[:6], k.numbers[6:12], k.numbers[12:18], k.value[12:18]
    turn, target, S, w = k.work[:3], k.work[3:12], k.work[12:21].reshape((3, 3)), k.work[21:24]
    for i in range(3):
        k.e[i] = k.value[9 + i] + compliance[i] * wrench[i] - k.place[0, 9 + i]
        turn[i] = compliance[3 + i] * wrench[3 + i]
    turn_by(1.0, turn, k.value[:9], target)
    R = k.place[0]
    for i in range(3):
        for j in range(3):
            S[i, j] = target[3 * i] * R[3 * j] + target[3 * i + 1] * R[3 * j + 1] + target[3 * i + 2] * R[3 * j + 2]
    log3(S, w)
    for i in range(3):
        k.e[3 + i] = w[i]
    for r in range(6):
        k.e[r] *= held[r]
        k.C[r, r] = 1.0
        k.rate_ref[r], k.acc_ref[r] = k.rate[r] + mobility[r] * wrench[r], k.second[r]
    return 1
