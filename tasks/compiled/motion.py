"""Rows about velocities and momenta, and of the robot as a whole its capture point and its zero moment point."""

from __future__ import annotations

from wbc.compiled import callee
from wbc.stack.compiled.row_kernel import rows


@callee
def velocity(at: int) -> int:
    """Velocities are the target, or zero where there is none. Of joints; or of a thing those of its six that
    ``numbers`` say, behind a factor."""
    k = rows(at)
    for r in range(len(k.e)):
        k.e[r] = 0.0
        if len(k.place) > 0:
            k.C[r, int(k.numbers[1 + r])] = k.numbers[0]
        if len(k.value) > 0:
            k.rate_ref[r], k.acc_ref[r] = k.value[r], k.rate[r]
    return 1


@callee
def capture_point(at: int) -> int:
    """c̈ = ω (ξ̇_target + rate (ξ_target − ξ) − ċ) for ξ = c + ċ / ω; ``numbers``: ω, rate."""
    k = rows(at)
    omega, rate = k.numbers[0], k.numbers[1]
    for r in range(2):
        velocity = k.motion[0, r]
        missing = k.value[r] - k.place[0, 9 + r] - velocity / omega
        k.C[r, r] = 1.0
        k.e[r] = omega * (k.rate[r] + rate * missing - velocity)
    return 1


@callee
def zero_moment_point(at: int) -> int:
    """The moment (−N_y, N_x) about the target, over the weight, is none; ``numbers``: mass, height of the ground,
    gravity (3,). Of the momentum and the centre of mass."""
    k = rows(at)
    mass, g = k.numbers[0], k.numbers[2:5]
    x, y, z = k.place[1, 9] - k.value[0], k.place[1, 10] - k.value[1], k.place[1, 11] - k.numbers[1]
    weight = -mass * g[2]
    # N = k̇ + m (c − o) × (c̈ − g)
    k.C[0, 4], k.C[0, 6], k.C[0, 8] = -1.0 / weight, -mass * z / weight, mass * x / weight
    k.C[1, 3], k.C[1, 7], k.C[1, 8] = 1.0 / weight, -mass * z / weight, mass * y / weight
    k.e[0] = mass * (x * g[2] - z * g[0]) / weight
    k.e[1] = mass * (y * g[2] - z * g[1]) / weight
    return 1
