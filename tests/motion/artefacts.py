"""Artefacts as retargeted motions have them, put into motions that have none: by kind, with the frames they are in.

Feet and the centre of mass are moved by Newton steps on Pinocchio's own Jacobians, nothing of ours.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio

import wbc
from wbc.motion import Retargeted, Witness, made
from wbc.report.measure import spans

KINDS = ("slip", "penetration", "jump", "speed", "centre of pressure")
MOTIONS, STEPPING = ("squat", "reach", "dance", "turn", "walk"), ("turn", "walk")
SLIP, DEPTH, JUMP, OUTSIDE = 0.03, 0.02, np.deg2rad(10.0), 0.05
#: How much faster than its motor a joint moves, and the shortest swing that shows it [frames].
FASTER, SHORTEST = 1.3, 7


@dataclass(frozen=True)
class Artefact:
    """``kind`` and ``part`` that the witness should name first, in some of the frames from ``start`` to ``stop``."""

    kind: str
    part: str
    q: np.ndarray
    start: int
    stop: int


def bump(n: int, rise: int) -> np.ndarray:
    """(n,) from 0 to 1 within ``rise`` frames and back in as many at the end, smooth to the second derivative."""
    s = np.clip(np.minimum(np.arange(n), np.arange(n)[::-1]) / rise, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def inject(kind: str, found: Retargeted, rng: np.random.Generator) -> Artefact | None:
    """An artefact of a kind somewhere in a motion; None where the draw does not fit."""
    if kind in ("slip", "penetration"):
        return _foot(kind, found, rng)
    return {"jump": _jump, "speed": _fast, "centre of pressure": _outside}[kind](found, rng)


def _foot(kind: str, found: Retargeted, rng: np.random.Generator) -> Artefact | None:
    part = str(rng.choice(["left_foot", "right_foot"]))
    long = [span for span in spans(found.holds[part]) if span[1] - span[0] > 60]
    first, last = long[rng.integers(len(long))]
    n = int(rng.integers(24, (last - first) // 2))
    start = int(rng.integers(first, last - n))
    angle = rng.uniform(0.0, 2.0 * np.pi)
    along = SLIP * np.array([np.cos(angle), np.sin(angle), 0.0])
    along = np.array([0.0, 0.0, -DEPTH]) if kind == "penetration" else along
    q, frame = found.q.copy(), found.contacts[part].frame
    for k, share in enumerate(bump(n, 8), start=start):
        moved = _moved(found, q[k], {frame: share * along}, [found.robot.pinocchio.getFrameId(frame)])
        if moved is None:
            return None
        q[k] = moved
    return Artefact(kind, frame, q, start, start + n)


def _jump(found: Retargeted, rng: np.random.Generator) -> Artefact | None:
    joint, n = int(rng.integers(found.robot.nj)), int(rng.integers(1, 30))
    start = int(rng.integers(5, len(found.q) - n - 5))
    q = found.q.copy()
    q[start : start + n, 7 + joint] += rng.choice([-1.0, 1.0]) * JUMP
    return _within(Artefact("jump", found.robot.joint_names[joint], q, start, start + n + 1), found, joint)


def _fast(found: Retargeted, rng: np.random.Generator) -> Artefact | None:
    legs = {j for part in ("left_foot", "right_foot") for j in _support(found, found.contacts[part].frame)}
    joint = int(rng.choice([j for j in range(found.robot.nj) if 6 + j not in legs]))
    size = rng.uniform(0.3, 1.8)
    n = round(np.pi * size / (FASTER * found.robot.limits.v_max[joint]) * found.rate)
    if n < SHORTEST:
        return None
    start = int(rng.integers(3, len(found.q) - n - 3))
    q = found.q.copy()
    swing = 0.5 * (1.0 - np.cos(2.0 * np.pi * np.arange(n + 1) / n))
    q[start : start + n + 1, 7 + joint] += rng.choice([-1.0, 1.0]) * size * swing
    return _within(Artefact("speed", found.robot.joint_names[joint], q, start, start + n + 2), found, joint)


def _outside(found: Retargeted, rng: np.random.Generator) -> Artefact | None:
    """The centre of mass, and slowly moved the centre of pressure with it, 5 cm over an edge of the soles."""
    held = np.all([found.holds[part] for part in ("left_foot", "right_foot")], axis=0)
    n, rise = 170, 75
    long = [span for span in spans(held) if span[1] - span[0] > n]
    if not long:
        return None
    first, last = long[0]
    start = int(rng.integers(first, last - n))
    model, data = found.robot.pinocchio, found.robot.pinocchio.createData()
    way = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]][rng.integers(4)])
    middle = found.q[start + n // 2]
    com = pinocchio.centerOfMass(model, data, middle)[:2].copy()
    edge = max(float(corner @ way) for corner in _corners(found, data))
    shift = np.append((edge + OUTSIDE - float(com @ way)) * way, 0.0)
    q, feet = found.q.copy(), [model.getFrameId(found.contacts[part].frame) for part in ("left_foot", "right_foot")]
    for k, share in enumerate(bump(n, rise), start=start):
        moved = _moved(found, q[k], {"com": share * shift}, feet)
        if moved is None:
            return None
        q[k] = moved
    return Artefact("centre of pressure", "", q, start, start + n)


def _within(artefact: Artefact, found: Retargeted, joint: int) -> Artefact | None:
    limits, angles = found.robot.limits, artefact.q[:, 7 + joint]
    fits = angles.min() >= limits.q_min[joint] and angles.max() <= limits.q_max[joint]
    return artefact if fits else None


def _support(found: Retargeted, frame: str) -> list[int]:
    """Velocity indices of the joints that carry a frame, without the base."""
    model = found.robot.pinocchio
    joint = model.frames[model.getFrameId(frame)].parentJoint
    return [model.joints[j].idx_v for j in model.supports[joint] if j > 1]


def _corners(found: Retargeted, data: Any) -> Iterator[np.ndarray]:
    model = found.robot.pinocchio
    pinocchio.updateFramePlacements(model, data)
    for part in ("left_foot", "right_foot"):
        contact: Any = found.contacts[part]
        pose = data.oMf[model.getFrameId(contact.frame)]
        for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            yield pose.act(contact.origin + np.append(signs * contact.half_size, 0.0))[:2]


def _moved(found: Retargeted, q: np.ndarray, by: dict[str, np.ndarray], feet: list[int]) -> np.ndarray | None:
    """q with a foot moved ``by`` so much by its leg, or the centre of mass by all joints while the feet stay."""
    model, data = found.robot.pinocchio, found.robot.pinocchio.createData()
    pinocchio.framesForwardKinematics(model, data, q)
    goals = {foot: pinocchio.SE3(data.oMf[foot]) for foot in feet}
    columns = list(range(model.nv))
    for name, shift in by.items():
        if name != "com":
            goals[model.getFrameId(name)].translation += shift
            columns = _support(found, name)
    com = pinocchio.centerOfMass(model, data, q) + by["com"] if "com" in by else None
    for _ in range(30):
        pinocchio.computeJointJacobians(model, data, q)
        pinocchio.updateFramePlacements(model, data)
        errors, rows = [], []
        for foot, goal in goals.items():
            errors.append(pinocchio.log6(data.oMf[foot].actInv(goal)).vector)
            rows.append(pinocchio.getFrameJacobian(model, data, foot, pinocchio.LOCAL))
        if com is not None:
            errors.append((com - pinocchio.centerOfMass(model, data, q))[:2])
            rows.append(pinocchio.jacobianCenterOfMass(model, data, q)[:2])
        error, J = np.concatenate(errors), np.vstack(rows)[:, columns]
        if np.abs(error).max() < 1e-6:
            joints, limits = q[7:], found.robot.limits
            return q if (joints >= limits.q_min).all() and (joints <= limits.q_max).all() else None
        step = np.zeros(model.nv)
        step[columns] = J.T @ np.linalg.solve(J @ J.T + 1e-8 * np.eye(len(J)), error)
        q = pinocchio.integrate(model, q, step)
    return None


@dataclass
class Count:
    """What came of ``tried`` artefacts: ``found`` at all, ``named`` rightly first, and frames that were ``clean``, and
    blamed all the same (``false``)."""

    tried: int = 0
    found: int = 0
    named: int = 0
    clean: int = 0
    false: int = 0


def count(robots: list[str], each: int, *, motions: Sequence[str] = MOTIONS, seed: int = 0) -> dict[str, Count]:
    """``each`` artefacts of every kind in motions of our own, on these robots in turn."""
    rng = np.random.default_rng(seed)
    counts = {kind: Count() for kind in KINDS}
    kept: dict[tuple[str, str, int], Retargeted] = {}
    for kind, tally in counts.items():
        while tally.tried < each:
            name = str(rng.choice([name for name in motions if kind != "centre of pressure" or name not in STEPPING]))
            key = robots[tally.tried % len(robots)], name, int(rng.integers(2))
            if key not in kept:
                kept[key] = wbc.retarget(made(name, seed=key[2]), wbc.load(key[0], base="floating"))
            found = kept[key]
            artefact = inject(kind, found, rng)
            if artefact is not None:
                _tell(tally, found, artefact)
    return counts


def _tell(tally: Count, found: Retargeted, artefact: Artefact) -> None:
    verdicts = Witness(found.robot, found.contacts).judge(artefact.q, found.rate, found.holds)
    new = []
    for k in range(artefact.start - 1, artefact.stop + 1):
        known = {fault[:2] for fault in found.verdicts[k].faults}
        new += [fault for fault in verdicts[k].faults[:1] if fault[:2] not in known]
    tally.tried += 1
    tally.found += bool(new)
    first = min(new, key=lambda fault: wbc.motion.witness.KINDS.index(fault.kind), default=None)
    tally.named += first is not None and first.kind == artefact.kind and artefact.part in ("", first.part)
    for k, verdict in enumerate(verdicts):
        # Differences look one frame ahead and one back.
        if found.verdicts[k].certified and not artefact.start - 2 <= k <= artefact.stop + 1:
            tally.clean += 1
            tally.false += not verdict.certified
