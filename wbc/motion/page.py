"""The page of a retargeted motion: the person beside the robot, and what is impossible when."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio

from wbc.control.recorder import Run
from wbc.models.collision import Obstacle
from wbc.models.geometry import Sphere
from wbc.motion.body import spans
from wbc.motion.clip import BONES, Motion
from wbc.motion.judged import Judged
from wbc.motion.verdict import KINDS, UNITS
from wbc.motion.witness import velocities
from wbc.report.build import require_extras
from wbc.report.document import (
    Cell,
    Clock,
    Curve,
    Event,
    Link,
    Plot,
    Report,
    Scene,
    Section,
    Strip,
    Table,
    Text,
    Tile,
    percent,
)
from wbc.report.folder import HTML, replaced, write
from wbc.report.record import judgement
from wbc.report.replay import replay, together
from wbc.report.shapes import Part, capsule, parts
from wbc.sim.scenario import Check, ScenarioResult
from wbc.types import Mat, Vec

#: Radius of a bone [m] and its colour; how far beside the robot the person is drawn [m].
_RADIUS, _BONE = 0.03, (185, 140, 90)
_BESIDE = np.array([0.0, 0.9, 0.0])
_STRIPS, _DISTANCE = "impossible", "distance"


def save_page(found: Judged, folder: Path) -> Path:
    """Write ``report.html`` and ``report.md`` into a folder, with the motion beside them, as files and as the record of
    a run; the path of the page.

    Raises:
        NotSupported: a package that reports need is not installed. InvalidInput: something else stands there.
    """
    require_extras()
    with replaced(folder) as pending:
        found.save(pending / "motion.npz")
        found.to_csv(pending / "motion.csv")
        demand = Check("frames certified", found.certified, ">=", 1.0)
        result = ScenarioResult(_run(found), demand.ok, {}, {}, [demand])
        result.run.meta |= judgement(result)
        result.run.save(pending)
        write(page(found), pending)
    return folder / HTML


def page(found: Judged) -> Report:
    """Everything worth saying about a retargeted motion."""
    times, runs = found.times, _runs(found)
    events = [
        Event(fault[0] / found.rate, fault[1] / found.rate, kind, "failed", _STRIPS)
        for kind in KINDS
        for fault in spans(_flags(found, kind))
    ][:100]
    tiles = [
        Tile("frames certified", percent(found.certified), "good" if found.certified == 1.0 else "bad"),
        Tile("frames", str(len(found.q))),
        Tile("robot over person", f"{found.targets.scale:.3f}"),
    ]
    if found.before is not None:
        tiles.insert(1, Tile("before repair", percent(found.before.certified)))
        tiles.insert(2, Tile("time added", f"{found.added:.2f} s"))
    sections = [_verdicts(found), _impossible(runs, times), _distances(runs, times)]
    end = "" if found.certified == 1.0 else f"; first impossible: {_first(found)}"
    said = f"{percent(found.certified)} of {len(found.q)} frames of {found.motion.name} are certified{end}."
    return Report(
        f"{found.motion.name} · {found.robot.name}", said, found.certified == 1.0, sections, tiles,
        Clock(float(times[-1]), 1.0 / found.rate, events), _scene(found),
    )  # fmt: skip


def _runs(found: Judged) -> dict[str, Judged]:
    """The motion by what it is called, and the one before repair."""
    return {"": found} if found.before is None else {"repaired": found, "before repair": found.before}


def _first(found: Judged) -> str:
    k = next(k for k, verdict in enumerate(found.verdicts) if not verdict.certified)
    return f"{found.verdicts[k].faults[0]} at {k / found.rate:.2f} s"


def _flags(found: Judged, kind: str) -> Any:
    return np.array([any(fault.kind == kind for fault in verdict.faults) for verdict in found.verdicts])


def _verdicts(found: Judged) -> Section:
    rows: list[list[Cell]] = [
        [kind, frames, amount, UNITS[kind], part, Link(f"{k / found.rate:.2f} s", _STRIPS, k / found.rate)]
        for kind, (frames, k, amount, part) in found.faults().items()
    ]
    told = Table(("impossible", "frames", "worst", "unit", "part", "where"), rows)
    certified = Text("Forces and torques within all limits exist for every frame, with proof.")
    return Section("Verdict", [told] if rows else [certified])


def _impossible(runs: dict[str, Judged], times: Vec) -> Section:
    strips = []
    for k, (name, found) in enumerate(runs.items()):
        flags = {kind: _flags(found, kind) for kind in KINDS}
        flags |= {f"{found.contacts[part].frame} holds": held for part, held in found.holds.items() if k == 0}
        strips += [
            Strip(
                f"{kind}{f', {name}' if name else ''}",
                [(a / found.rate, b / found.rate) for a, b in spans(one)],
                k if len(runs) > 1 else None,
            )
            for kind, one in flags.items()
            if one.any()
        ]
    plot = Plot(_STRIPS, "What is impossible, and what holds", "", times, strips=strips, wide=True)
    return Section("Over time", [plot])


def _distances(runs: dict[str, Judged], times: Vec) -> Section:
    curves: list[Curve] = []
    rows: list[list[Cell]] = []
    for k, (name, found) in enumerate(runs.items()):
        far = {part: 1e3 * d for part, d in found.distances().items() if not part.endswith("knee")}
        curves += [
            Curve(
                f"{part}{f', {name}' if name else ''}", d, run=k if name else None, dash=i if name else 0, x=found.times
            )
            for i, (part, d) in enumerate(far.items())
        ]
        rows += [[part, name, *(round(float(x), 3) for x in (np.median(d), d.max()))] for part, d in far.items()]
    plot = Plot(
        _DISTANCE, "Distance to where the person's parts are, at the robot's size", "mm", times, curves, zero=True
    )
    return Section("Distance to the person", [plot, Table(("part", "motion", "median [mm]", "largest [mm]"), rows)])


def _scene(found: Judged) -> Scene | None:
    solid = parts(found.robot)
    if not solid:
        return None
    scenes = []
    for k, (name, one) in enumerate(_runs(found).items()):
        person, bones = _person(one.motion, one.targets.scale) if k == 0 else ([], [])
        scenes.append(replay(_run(one), one.robot, [*solid, *bones], obstacles=person, called=name, place=k))
    scene = together(scenes) if len(scenes) > 1 else scenes[0]
    return Scene(scene.name, f"Beside the robot the person, at its size. {scene.caption}", scene.content, scene.ghosts)


def _run(found: Judged) -> Run:
    """The record of a motion: what is drawn, and exported, as a run is."""
    robot = found.robot
    v, _, _ = velocities(robot, found.q, found.rate)
    limits = {key: getattr(robot.limits, key).tolist() for key in ("q_min", "q_max", "v_max", "tau_max")}
    meta = {
        "scenario": "retarget", "motion": found.motion.name, "robot": robot.name, "base": robot.base,
        "joint_names": list(robot.joint_names), "dt": 1.0 / found.rate, "limits": limits, "time_added": found.added,
    }  # fmt: skip
    return Run({"t": found.times, "q": found.q, "v": v}, meta)


def _person(motion: Motion, scale: float) -> tuple[list[Obstacle], list[Part]]:
    """The lines between the parts of a body, as things that move beside the robot."""
    moving, solid = [], []
    for one, other in BONES:
        if one not in motion.positions or other not in motion.positions:
            continue
        start, end = (scale * motion.positions[part] + _BESIDE for part in (one, other))
        name = f"{one} to {other} of the person"
        moving.append(Obstacle(name, Sphere(_RADIUS), partial(_bone, start, end, motion.rate)))
        bone = capsule(_RADIUS, float(np.median(np.linalg.norm(end - start, axis=1))))
        solid.append(Part(name, bone.vertices, bone.faces, _BONE))
    return moving, solid


def _bone(start: Mat, end: Mat, rate: float, t: float) -> Any:
    """The pose halfway between two places (N, 3), z towards the second."""
    k = min(max(round(t * rate), 0), len(start) - 1)
    turned = pinocchio.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end[k] - start[k])
    return pinocchio.SE3(turned.matrix(), 0.5 * (start[k] + end[k]))
