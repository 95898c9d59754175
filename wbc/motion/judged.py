"""Judged: a robot's motion after a person's, with a verdict for every frame, and what can be said of both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from scipy.interpolate import CubicSpline

from wbc import checks
from wbc.control.recorder import Run
from wbc.control.ticks import about_robot
from wbc.files import Place, written
from wbc.models.pinocchio_ import PinocchioModel
from wbc.motion.clip import Flags, Motion
from wbc.motion.kinematics import placed, velocities
from wbc.motion.mapping import Table
from wbc.motion.verdict import KINDS, UNITS, Verdict
from wbc.stack.contact import Contact
from wbc.types import Mat, Vec


@dataclass(frozen=True, eq=False)
class Judged:
    """A motion of ``robot``: configurations ``q`` (N, nq) at ``rate`` [1/s], and a verdict for each.

    ``motion`` is the person's, ``targets`` what its parts ask of the robot's frames, which is ``scale`` times the
    person's size, ``contacts`` {part: contact} with the friction that was counted on.
    """

    robot: PinocchioModel
    motion: Motion
    table: Table
    targets: Motion
    scale: float
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
        return self.motion.times

    @property
    def holds(self) -> Mapping[str, Flags]:
        """When each contact holds: {part: (N,)} of feet that stand and hands that hold."""
        return {part: self.targets.contacts[part] for part in self.contacts}

    def held(self, k: int) -> dict[str, Contact]:
        """The contacts that hold in frame k, by part."""
        return {part: contact for part, contact in self.contacts.items() if self.targets.contacts[part][k]}

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
        q, limits = CubicSpline(np.arange(len(self.q)), self.q)(moments), self.robot.limits
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
        q[:, 7:] = q[:, 7:].clip(limits.q_min, limits.q_max)  # at which splines overshoot
        return replace(self, motion=self.motion.at(moments), targets=self.targets.at(moments), q=q, verdicts=())

    def faults(self) -> dict[str, tuple[int, int, float, str]]:
        """{kind: (frames, worst frame, worst amount [``UNITS[kind]``], its part)}, causes first."""
        told: dict[str, list[tuple[float, int, str]]] = {kind: [] for kind in KINDS}
        for k, verdict in enumerate(self.verdicts):
            for fault in verdict.faults:
                told[fault.kind].append((fault.amount, k, fault.part))
        worst = {kind: (len({k for _, k, _ in of}), *max(of)) for kind, of in told.items() if of}
        return {kind: (frames, k, amount, part) for kind, (frames, amount, k, part) in worst.items()}

    def distances(self) -> dict[str, Vec]:
        """{part: (N,)} how far the robot's frames are from where the person's parts ask them to be [m]."""
        frames = {part: one.frame for part, one in self.table.followers.items() if one.position > 0.0}
        actual = placed(self.robot, self.q, frames)
        return {part: np.linalg.norm(at - self.targets.positions[part], axis=1) for part, (at, _) in actual.items()}

    def __str__(self) -> str:
        """The verdict in words."""
        said = [f"{100 * self.certified:.1f} % of {len(self.q)} frames certified"]
        for kind, (frames, k, amount, part) in self.faults().items():
            where = f" of {part}" if part else ""
            said.append(f"{kind}: {frames} frames, worst {amount:.3g} {UNITS[kind]}{where} at {k / self.rate:.2f} s")
        if self.unsolved:
            said.append(f"limits and contacts contradict each other in {len(self.unsolved)} frames")
        return "\n".join(said)

    @property
    def run(self) -> Run:
        """The motion as the record of a run, with ``q`` and ``v``: what is drawn, exported, and written as a table."""
        v, _, _ = velocities(self.robot, self.q, self.rate)
        about = {"scenario": "retarget", "motion": self.motion.name, "dt": 1.0 / self.rate, "time_added": self.added}
        return Run({"t": self.times, "q": self.q, "v": v}, about_robot(self.robot) | about)

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
        """Write a table as of a run: time, base and joints, and their velocities; ``joints``: names, such as
        ``JointMap.joints``, for another order.

        Raises:
            InvalidInput: the file cannot be written, or a joint that the robot has not.
        """
        run, names = self.run, self.robot.joint_names
        chosen = names if joints is None else checks.names("joints", joints, names)
        order = [names.index(name) for name in chosen]
        q, v = (np.hstack([run[x][:, :n], run[x][:, n:][:, order]]) for x, n in (("q", 7), ("v", 6)))
        meta = {"joint_names": list(chosen), "joint_units": [self.robot.joint_units[j] for j in order]}
        Run({"t": run["t"], "q": q, "v": v}, run.meta | meta).to_csv(path)
