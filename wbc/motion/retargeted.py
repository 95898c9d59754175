"""Retargeted: a robot's motion after a person's, with a verdict for every frame, what can be said of both, and the page
that shows the person beside the robot, and what is impossible when."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self, final

import numpy as np
from scipy.interpolate import CubicSpline

from wbc.control.recorder import ARRAYS_FILE, Run
from wbc.control.ticks import about_robot
from wbc.files import Place
from wbc.models.along import placed, velocities
from wbc.models.collision import Obstacle
from wbc.models.pinocchio_ import PinocchioModel
from wbc.motion.clip import BONES, Motion
from wbc.motion.mapping import Table
from wbc.motion.witness import KINDS, UNITS, Verdict
from wbc.npz import write_npz
from wbc.report import document as doc
from wbc.report.build import require_extras, scene
from wbc.report.folder import HTML, replaced, write
from wbc.report.measure import intervals
from wbc.report.record import judgement
from wbc.report.sections import motion
from wbc.sim.scenario import Check, ScenarioResult
from wbc.stack.contact import Contact
from wbc.types import Flags, Mat, Vec

#: Radius of a bone [m]; how far beside the robot the person is drawn [m].
_RADIUS, _BESIDE = 0.03, np.array([0.0, 0.9, 0.0])
_STRIPS, _DISTANCE = "impossible", "distance"


@final
@dataclass(frozen=True, eq=False)
class Retargeted:
    """What :func:`wbc.retarget` gives, a motion of ``robot``: configurations ``q`` (N, nq) at ``rate`` [1/s], and a
    verdict for each.

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
    before: Retargeted | None = field(default=None, repr=False)

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
        frames = Counter(kind for verdict in self.verdicts for kind in {fault.kind for fault in verdict.faults})
        told = [(KINDS.index(x.kind), x.amount, k, x.part) for k, one in enumerate(self.verdicts) for x in one.faults]
        # The worst of a kind comes last, and stays.
        return {KINDS[i]: (frames[KINDS[i]], k, amount, part) for i, amount, k, part in sorted(told)}

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
        holds = {f"holds.{part}": held for part, held in self.holds.items()}
        certified = [verdict.certified for verdict in self.verdicts]
        write_npz(path, q=self.q, rate=self.rate, joint_names=self.robot.joint_names, certified=certified, **holds)

    def to_csv(self, path: Place, *, joints: Any = None) -> None:
        """Write a table as of a run: time, base and joints, and their velocities; ``joints``: names, such as
        ``JointMap.joints``, for another order.

        Raises:
            InvalidInput: the file cannot be written, or a joint that the robot has not.
        """
        (self.run if joints is None else self.run.ordered(joints)).to_csv(path)

    def report(self, folder: Place) -> Path:
        """Write ``report.html`` and ``report.md`` into a folder, with the motion beside them, as files and as the
        record of a run; the path of the page.

        Raises:
            NotSupported: a package that reports need is not installed. InvalidInput: something else stands there.
        """
        require_extras()
        with replaced(Path(folder), ARRAYS_FILE) as pending:
            self.save(pending / "motion.npz")
            self.to_csv(pending / "motion.csv")
            result = _result(self)
            result.run.meta |= judgement(result)
            result.run.save(pending)
            write(page(self), pending)
        return Path(folder) / HTML


def page(found: Retargeted) -> doc.Report:
    """The report of a retargeted motion as data."""
    rate, good = found.rate, found.certified == 1.0
    told = {kind: when for kind, when in _intervals(found).items() if kind in KINDS}
    events = [doc.Event(*when, kind, "failed", _STRIPS) for kind, moments in told.items() for when in moments][:100]
    tiles = [doc.Tile("frames certified", doc.percent(found.certified), "good" if good else "bad")]
    if found.before is not None:
        tiles.append(doc.Tile("before repair", doc.percent(found.before.certified)))
        tiles.append(doc.Tile("time added", f"{found.added:.2f} s"))
    tiles += [doc.Tile("frames", str(len(found.q))), doc.Tile("scale of the person", f"{found.scale:.3f}")]
    said = f"{doc.percent(found.certified)} of {len(found.q)} frames of {found.motion.name} are certified"
    if not good:
        k, worst = next((k, one.faults[0]) for k, one in enumerate(found.verdicts) if not one.certified)
        said += f"; first impossible: {worst} at {k / rate:.2f} s"
    runs = {"": found} if found.before is None else {"repaired": found, "before repair": found.before}
    clock = doc.Clock(float(found.times[-1]), 1.0 / rate, events)
    sections = [*filter(None, (_verdicts(found), motion.section(_result(found)), _impossible(runs), _distances(runs)))]
    seen = scene({name: _result(one, with_person=one is found) for name, one in runs.items()})
    if seen is not None:
        seen = replace(seen, caption=f"Beside the robot the person, at its size. {seen.caption}")
    return doc.Report(f"{found.motion.name} · {found.robot.name}", f"{said}.", good, sections, tiles, clock, seen)


def _result(found: Retargeted, *, with_person: bool = False) -> ScenarioResult:
    """The motion as the result of a run, perhaps with the bones of the person beside the robot, at its size."""
    demand, p = Check("frames certified", found.certified, ">=", 1.0), found.motion.positions
    bones = list[Obstacle]()
    for bone in BONES if with_person else ():
        if p.keys() >= set(bone):
            start, end = (found.scale * p[part] + _BESIDE for part in bone)
            bones.append(Obstacle.between(f"{' to '.join(bone)} of the person", start, end, found.rate, _RADIUS))
    return ScenarioResult(found.run, demand.ok, {}, {}, [demand], robot=found.robot, obstacles=bones)


def _intervals(found: Retargeted) -> dict[str, list[tuple[float, float]]]:
    """When [s] frames are certified, when they have a fault of each kind, and when contacts hold."""
    kinds = [{fault.kind for fault in verdict.faults} or {"certified"} for verdict in found.verdicts]
    flags = {kind: np.array([kind in of_frame for of_frame in kinds]) for kind in ("certified", *KINDS)}
    flags |= {f"{found.contacts[part].frame} holds": held for part, held in found.holds.items()}
    run = found.run
    return {what: intervals(run, those) for what, those in flags.items() if those.any()}


def _verdicts(found: Retargeted) -> doc.Section:
    rows: list[list[doc.Cell]] = [
        [kind, frames, amount, UNITS[kind], part, doc.Link(f"{k / found.rate:.2f} s", _STRIPS, k / found.rate)]
        for kind, (frames, k, amount, part) in found.faults().items()
    ]
    told = doc.Table(("impossible", "frames", "worst", "unit", "part", "where"), rows)
    certified = doc.Text("Forces and torques within all limits exist for every frame, with proof.")
    return doc.Section("Verdict", [told] if rows else [certified])


def _impossible(runs: dict[str, Retargeted]) -> doc.Section:
    strips = [
        doc.Strip(f"{what}, {name}" if name else what, moments, k if name else None)
        for k, (name, found) in enumerate(runs.items())
        for what, moments in _intervals(found).items()
    ]
    title, times = "Certified frames, impossible frames, and contacts", next(iter(runs.values())).times
    return doc.Section("Over time", [doc.Plot(_STRIPS, title, "", times, strips=strips, wide=True)])


def _distances(runs: dict[str, Retargeted]) -> doc.Section:
    far = [{part: 1e3 * d for part, d in found.distances().items() if "knee" not in part} for found in runs.values()]
    curves = [
        doc.Curve(name or "farthest", np.array([*d.values()]).max(axis=0), run=k if name else None, x=found.times)
        for k, ((name, found), d) in enumerate(zip(runs.items(), far, strict=True))
    ]
    title, times = "Largest distance of a part from the scaled person", next(iter(runs.values())).times
    plot = doc.Plot(_DISTANCE, title, "mm", times, curves, zero=True)
    rows: list[list[doc.Cell]] = [
        [part.replace("_", " "), *np.round([np.median(d), d.max()], 2).tolist()] for part, d in far[0].items()
    ]
    told = doc.Table(("part", "median", "largest"), rows, "Distance of each part from the scaled person [mm].")
    return doc.Section("Distance to the person", [plot, told])
