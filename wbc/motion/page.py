"""The page of a retargeted motion: the person beside the robot, and what is impossible when."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio

from wbc.models.collision import Obstacle
from wbc.models.geometry import Sphere
from wbc.motion.body import spans
from wbc.motion.clip import BONES, Flags, Motion
from wbc.motion.judged import Judged
from wbc.motion.verdict import KINDS, UNITS
from wbc.report import document as doc
from wbc.report.build import require_extras
from wbc.report.document import Cell, Report, Scene, Section
from wbc.report.folder import HTML, replaced, write
from wbc.report.record import judgement
from wbc.report.replay import replay, together
from wbc.report.sections import motion
from wbc.report.shapes import Part, capsule, parts
from wbc.sim.scenario import Check, ScenarioResult
from wbc.types import Mat

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
        result = ScenarioResult(found.run, demand.ok, {}, {}, [demand])
        result.run.meta |= judgement(result)
        result.run.save(pending)
        write(page(found), pending)
    return folder / HTML


def page(found: Judged) -> Report:
    """Everything worth saying about a retargeted motion."""
    rate, good = found.rate, found.certified == 1.0
    told = [(kind, a / rate, b / rate) for kind, flags in _flags(found).items() for a, b in spans(flags)]
    events = [doc.Event(a, b, kind, "failed", _STRIPS) for kind, a, b in told if kind in KINDS][:100]
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
    moments = motion.section(ScenarioResult(found.run, good, {}, {}, (), robot=found.robot))
    sections = [_verdicts(found), *([moments] if moments else []), _impossible(runs), _distances(runs)]
    return Report(f"{found.motion.name} · {found.robot.name}", f"{said}.", good, sections, tiles, clock, _scene(runs))


def _flags(found: Judged) -> dict[str, Flags]:
    """Which frames are certified, and which have a fault of each kind."""
    kinds = [{fault.kind for fault in verdict.faults} or {"certified"} for verdict in found.verdicts]
    return {kind: np.array([kind in of_frame for of_frame in kinds]) for kind in ("certified", *KINDS)}


def _verdicts(found: Judged) -> Section:
    rows: list[list[Cell]] = [
        [kind, frames, amount, UNITS[kind], part, doc.Link(f"{k / found.rate:.2f} s", _STRIPS, k / found.rate)]
        for kind, (frames, k, amount, part) in found.faults().items()
    ]
    told = doc.Table(("impossible", "frames", "worst", "unit", "part", "where"), rows)
    certified = doc.Text("Forces and torques within all limits exist for every frame, with proof.")
    return Section("Verdict", [told] if rows else [certified])


def _impossible(runs: dict[str, Judged]) -> Section:
    strips, times = [], next(iter(runs.values())).times
    for k, (name, found) in enumerate(runs.items()):
        flags = _flags(found)
        flags |= {f"{found.contacts[part].frame} holds": held for part, held in found.holds.items() if k == 0}
        for what, one in flags.items():
            if one.any():
                label = f"{what}, {name}" if name else what
                moments = [(a / found.rate, b / found.rate) for a, b in spans(one)]
                strips.append(doc.Strip(label, moments, k if name else None))
    title = "Certified frames, impossible frames, and contacts"
    plot = doc.Plot(_STRIPS, title, "", times, strips=strips, wide=True)
    return Section("Over time", [plot])


def _distances(runs: dict[str, Judged]) -> Section:
    far = [{part: 1e3 * d for part, d in found.distances().items() if "knee" not in part} for found in runs.values()]
    curves = [
        doc.Curve(name or "farthest", np.max([*d.values()], axis=0), run=k if name else None, x=found.times)
        for k, ((name, found), d) in enumerate(zip(runs.items(), far, strict=True))
    ]
    title, times = "Largest distance of a part from the scaled person", next(iter(runs.values())).times
    plot = doc.Plot(_DISTANCE, title, "mm", times, curves, zero=True)
    rows: list[list[Cell]] = [
        [part.replace("_", " "), *(round(float(x), 2) for x in (np.median(d), d.max()))] for part, d in far[0].items()
    ]
    told = doc.Table(("part", "median", "largest"), rows, "Distance of each part from the scaled person [mm].")
    return Section("Distance to the person", [plot, told])


def _scene(runs: dict[str, Judged]) -> Scene | None:
    found = next(iter(runs.values()))
    person, bones = _person(found.motion, found.scale)
    solid = parts(found.robot)
    if not solid:
        return None
    scenes = [
        replay(one.run, one.robot, [*solid, *bones * (k == 0)], obstacles=person * (k == 0), called=name, place=k)
        for k, (name, one) in enumerate(runs.items())
    ]
    scene = together(scenes) if len(scenes) > 1 else scenes[0]
    return Scene(scene.name, f"Beside the robot the person, at its size. {scene.caption}", scene.content, scene.ghosts)


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
