"""Judged: a robot's motion after a person's, with a verdict for every frame, and what can be said of both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from scipy.spatial.transform import Rotation

from wbc import checks
from wbc.files import Place, written
from wbc.models.pinocchio_ import PinocchioModel
from wbc.motion.body import Flags
from wbc.motion.clip import Motion, between
from wbc.motion.mapping import Table
from wbc.motion.targets import Targets
from wbc.motion.verdict import KINDS, UNITS, Verdict
from wbc.motion.witness import placed
from wbc.stack.contact import Contact
from wbc.types import Mat, Vec


@dataclass(frozen=True, eq=False)
class Judged:
    """A motion of ``robot``: configurations ``q`` (N, nq) at ``rate`` [1/s], and a verdict for each.

    ``motion`` is the person's, ``targets`` what its parts ask of the robot's frames, ``holds`` {part: (N,)} when a foot
    stands or a hand holds, ``contacts`` {part: contact} with the friction that was counted on.
    """

    robot: PinocchioModel
    motion: Motion
    table: Table
    targets: Targets
    contacts: Mapping[str, Contact]
    q: Mat
    verdicts: tuple[Verdict, ...]
    #: Frames whose stack had no solution: limits and contacts contradict each other there.
    unsolved: tuple[int, ...] = ()
    before: Judged | None = field(default=None, repr=False)

    @property
    def rate(self) -> float:
        """Frames per second."""
        return self.motion.rate

    @property
    def times(self) -> Vec:
        """Time (N,) of each frame [s]."""
        return np.arange(len(self.q)) / self.rate

    @property
    def holds(self) -> Mapping[str, Flags]:
        """When each contact holds."""
        return {part: self.targets.holds[part] for part in self.contacts}

    @property
    def certified(self) -> float:
        """The share of frames for which forces and torques within all limits exist, with proof."""
        return float(np.mean([verdict.certified for verdict in self.verdicts]))

    @property
    def added(self) -> float:
        """By how much longer the motion is than before its repair [s]."""
        return 0.0 if self.before is None else (len(self.q) - len(self.before.q)) / self.rate

    def at(self, moments: Vec) -> Self:
        """The same motion at other moments (M,), in frames from 0 to N − 1, before anybody judged it there."""
        turned = Rotation.from_quat(self.q[:, 3:7]).as_matrix()
        quaternions = Rotation.from_matrix(between(turned, moments)).as_quat()
        signs = np.sign(np.vecdot(np.vstack([self.q[:1, 3:7], quaternions[:-1]]), quaternions))
        quaternions *= np.cumprod(signs)[:, None]  # of two that are the same rotation, the one near that before
        limits = self.robot.limits  # at which splines overshoot
        joints = between(self.q[:, 7:], moments).clip(limits.q_min, limits.q_max)
        q = np.hstack([between(self.q[:, :3], moments), quaternions, joints])
        motion, targets = self.motion.at(moments), self.targets.at(moments)
        return replace(self, motion=motion, targets=targets, q=q, verdicts=())

    def faults(self) -> dict[str, tuple[int, int, float, str]]:
        """{kind: (frames, worst frame, worst amount [``UNITS[kind]``], its part)}, causes first."""
        found: dict[str, tuple[int, int, float, str]] = {}
        for kind in KINDS:
            of_kind = [
                (f.amount, k, f.part) for k, one in enumerate(self.verdicts) for f in one.faults if f.kind == kind
            ]
            if of_kind:
                amount, k, part = max(of_kind)
                found[kind] = len({k for _, k, _ in of_kind}), k, amount, part
        return found

    def distances(self) -> dict[str, Vec]:
        """{part: (N,)} how far the robot's frames are from where the person's parts ask them to be [m]."""
        frames = {part: one.frame for part, one in self.table.followers.items() if one.position > 0.0}
        actual = placed(self.robot, self.q, frames)
        return {part: np.linalg.norm(at - self.targets.places[part], axis=1) for part, (at, _) in actual.items()}

    def __str__(self) -> str:
        """The verdict in words."""
        said = [f"{100 * self.certified:.1f} % of {len(self.q)} frames certified"]
        for kind, (frames, k, amount, part) in self.faults().items():
            where = f" of {part}" if part else ""
            said.append(f"{kind}: {frames} frames, worst {amount:.3g} {UNITS[kind]}{where} at {k / self.rate:.2f} s")
        if self.unsolved:
            said.append(f"limits and contacts contradict each other in {len(self.unsolved)} frames")
        return "\n".join(said)

    def save(self, path: Place) -> None:
        """Write ``.npz``: ``q``, ``rate``, ``joint_names``, ``certified`` (N,), and when each contact holds.

        Raises:
            InvalidInput: the file cannot be written.
        """
        columns: dict[str, Any] = {f"holds.{part}": held for part, held in self.holds.items()}
        columns["certified"] = np.array([verdict.certified for verdict in self.verdicts])
        columns["joint_names"] = np.array(self.robot.joint_names)
        with written(path) as aside, aside.open("wb") as file:
            np.savez_compressed(file, q=self.q, rate=np.array(self.rate), **columns)

    def to_csv(self, path: Place, *, joints: Any = None) -> None:
        """Write a table: time, base position and quaternion (x y z w), then joints, by default in the robot's order.

        ``joints``: names, such as ``JointMap.joints``, for another order.

        Raises:
            InvalidInput: the file cannot be written, or a joint that the robot has not.
        """
        names = self.robot.joint_names
        chosen = names if joints is None else checks.names("joints", joints, names)
        columns = [7 + names.index(name) for name in chosen]
        head = ["time", "x", "y", "z", "qx", "qy", "qz", "qw", *chosen]
        table = np.column_stack([self.times, self.q[:, :7], self.q[:, columns]])
        with written(path) as aside:
            np.savetxt(aside, table, delimiter=",", header=",".join(head), comments="", fmt="%.9g")
