"""The worst answer that is still called SOLVED: how far its tasks are from their optimum, weight by weight."""

from __future__ import annotations

import numpy as np
import pytest

from tests.seeds import SEED
from wbc.qp import QP, Objective, certificate, solve
from wbc.types import Status, Vec

#: A certified task is this near to its optimum, beside the size of what is asked.
PROMISED = 1e-4


def ranked_by_weight(seed: int, weights: list[float]) -> tuple[QP, np.ndarray]:
    """A heavy task, lighter ones and a posture, with rows and bounds that push; also the rows that are free to move."""
    rng = np.random.default_rng(seed)
    n = 7
    H, g, tasks = np.zeros((n, n)), np.zeros(n), []
    for k, weight in enumerate(weights):
        last = k == len(weights) - 1
        S, s = (np.eye(n) if last else rng.standard_normal((2, n))), 100.0 * rng.standard_normal(n if last else 2)
        H, g = H + weight * S.T @ S, g - weight * S.T @ s
        tasks.append(Objective(f"weight {weight:g}", S, s, "m/s²"))
    A, C = rng.standard_normal((1, n)), rng.standard_normal((2, n))
    free = np.linalg.solve(H, -g)
    cut = np.array([free[0] - 1.0, *np.full(n - 1, np.inf)])
    qp = QP(H, g, A=A, b=[0.5], C=C, cl=C @ free + 1.0, cu=C @ free + 9.0, ub=cut, tasks=tasks)
    return qp, A


def directions(qp: QP, x: Vec, z: Vec, z_box: Vec) -> list[Vec]:
    """Every eigenvector of H, and of H on what the equalities and the rows that push leave free."""
    held = np.vstack([qp.A, qp.C[z != 0.0], np.eye(qp.n)[z_box != 0.0]])
    free = np.linalg.svd(held)[2][len(held) :].T
    return [*np.linalg.eigh(qp.H)[1].T, *(free @ np.linalg.eigh(free.T @ qp.H @ free)[1]).T]


def farthest(qp: QP, point: tuple[Vec, Vec, Vec, Vec], along: Vec) -> float:
    """How far x may go along a direction and be certified, whichever multipliers the active rows are given there."""
    x, y, z, z_box = point
    on = [np.ones(len(y), bool), z != 0.0, z_box != 0.0]
    E = np.vstack([qp.A, qp.C[on[1]], np.eye(qp.n)[on[2]]])
    root = np.linalg.inv(np.linalg.cholesky(qp.H))

    def holds(t: float) -> bool:
        moved = qp.H @ (t * along)
        change = np.linalg.lstsq(root @ E.T, -root @ moved, rcond=None)[0]
        parts = [part.copy() for part in (y, z, z_box)]
        for part, mask, own in zip(parts, on, np.split(change, np.cumsum([m.sum() for m in on])[:-1]), strict=True):
            part[mask] += own
        return any(certificate(qp, x + t * along, *forces).ok for forces in ((y, z, z_box), tuple(parts)))

    low, high = -20.0, 6.0
    if not holds(10.0**low):
        return 0.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(10.0**middle) else (low, middle)
    return 10.0**low


@pytest.mark.parametrize("weights", [[1.0, 1.0], [1e3, 1e-3], [1e6, 1.0, 1e-3], [1e3, 1.0, 1e-6], [1e-6], [1e6, 1e-6]])
@pytest.mark.parametrize("seed", range(3))
def test_every_task_of_a_certified_answer_is_near_its_optimum(weights: list[float], seed: int):
    qp, _ = ranked_by_weight(SEED + seed, weights)
    best = solve(qp)
    assert best.status is Status.SOLVED or max(weights) / min(weights) > 1e11, best.reason
    if best.status is not Status.SOLVED:  # twelve decades are more than a sum of products in double precision holds
        return
    for along in directions(qp, best.x, best.z, best.z_box):
        for sign in (1.0, -1.0):
            far = farthest(qp, (best.x, best.y, best.z, best.z_box), sign * along)
            for task in qp.tasks:
                off = np.abs(task.rows @ (far * along)) / (1.0 + np.abs(task.target))
                assert off.max() <= PROMISED, f"{task.name}: {off.max():.2g} of its size"


@pytest.mark.parametrize("scale", [2.0**-20, 2.0**20, 1e-6, 1e-3, 1e3, 1e6])
def test_a_verdict_does_not_depend_on_the_unit_of_the_cost(scale: float):
    rounds = np.frexp(scale)[0] != 0.5  # a power of two changes no digit
    for seed in range(5):
        rng = np.random.default_rng(SEED + seed)
        qp, _ = ranked_by_weight(SEED + seed, [1.0, 1e-3])
        other = QP(scale * qp.H, scale * qp.g, A=qp.A, b=qp.b, C=qp.C, cl=qp.cl, cu=qp.cu, ub=qp.ub, tasks=qp.tasks)
        best = solve(qp)
        for size in 10.0 ** rng.uniform(-9, 1, 20):
            x = best.x + size * rng.standard_normal(qp.n)
            proofs = [certificate(p, x, k * best.y, k * best.z, k * best.z_box) for p, k in ((qp, 1.0), (other, scale))]
            assert proofs[0].ok == proofs[1].ok
            same = {"rel": 1e-3, "abs": 1e-4 * PROMISED} if rounds else {"rel": 1e-15, "abs": 0.0}
            assert proofs[1].distance == pytest.approx(proofs[0].distance, **same)


def test_tasks_nine_decades_apart_are_certified():
    """Their gradients are sums of numbers that nearly cancel: digits of the light one are lost in a plain sum."""
    for seed in range(20):
        for weights in ([1e6, 1.0, 1e-3], [1e3, 1.0, 1e-6]):
            qp, _ = ranked_by_weight(SEED + 1000 * seed, weights)
            assert solve(qp).status is Status.SOLVED, (seed, weights)


@pytest.mark.parametrize("solver", ["pdas", "daqp", "proxqp", "osqp", "clarabel"])
def test_a_bound_is_an_upper_bound_of_what_a_task_misses(solver: str):
    for seed in range(5):
        qp, _ = ranked_by_weight(SEED + seed, [1e3, 1.0, 1e-3])
        answer, best = solve(qp, solver), solve(qp)
        assert answer.status is Status.SOLVED and set(answer.certificate.bounds) == {t.name for t in qp.tasks}
        rng = np.random.default_rng(seed)
        held = np.vstack([qp.A, qp.C[best.z != 0.0], np.eye(qp.n)[best.z_box != 0.0]])
        free = np.linalg.svd(held)[2][len(held) :].T
        for size in 10.0 ** rng.uniform(-8, 1, 10):
            x = best.x + size * (free @ rng.standard_normal(free.shape[1]))
            proof = certificate(qp, x, best.y, best.z, best.z_box)
            for task in qp.tasks:
                assert np.abs(task.rows @ (x - best.x)).max() <= proof.bounds[task.name] + 1e-9
