"""Contact forces: normal forces, friction ratios, centres of pressure and slip."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.report import measure
from wbc.report.document import Bound, Curve, Item, Map, Plot, Section, Strip, Table
from wbc.sim.scenario import ScenarioResult

if TYPE_CHECKING:
    from wbc.control.recorder import Run


def section(result: ScenarioResult) -> Section | None:
    """For each contact: normal force, tangential ratio against friction, centre of pressure in the sole; and slip."""
    run = result.run
    names = [name for name in run.meta.get("contacts", {}) if f"f.{name}" in run or f"plant.f.{name}" in run]
    if not names or not run.rows:
        return None
    items: list[Item] = [*_loads(run, names), *_slip(result, names)]
    for name in names:
        items += [*_forces(run, name), *_pressure(run, name)]
    columns = ("contact", "controller's friction", "floor's friction", "ratio, commanded", "ratio, true", "f_z min [N]",
               "f_z max [N]", "CoP margin [mm]", "slip [mm]")  # fmt: skip
    note = (
        "Ratio: largest tangential over normal force. The commanded force keeps the controller's friction coefficient, "
        "which is smaller than the floor's. The true force may exceed it, and the contact slides where it reaches the "
        "floor's. CoP margin: smallest distance from the true centre of pressure to the edge of the sole, negative "
        "outside. Slip: largest displacement of the contact point. A dash: not measured."
    )
    items.append(Table(columns, [_row(run, name) for name in names], note))
    return Section("Contact forces", items)


def _loads(run: Run, names: list[str]) -> list[Item]:
    """Normal forces of all contacts together, and when each stands, where that changes."""
    t = measure.times(run)
    tracks = {name: _best(run, name) for name in names}
    made: list[Item] = [
        Plot("forces", "Normal force of every contact", "N", t, [Curve(n, track.normal) for n, track in tracks.items()],
             zero=True, wide=True)
    ]  # fmt: skip
    standing = measure.standing(run)
    if any(not mask.all() for mask in standing.values()):
        strips = [Strip(name, measure.intervals(run, mask)) for name, mask in standing.items()]
        made.append(Plot("standing", "When each contact is loaded", "", t, strips=strips, wide=True))
    return made


def _slip(result: ScenarioResult, names: list[str]) -> list[Item]:
    run = result.run
    asked = [
        Bound(1e3 * c.bound, f"demanded {c.sign} {1e3 * c.bound:g}") for c in result.verdict if c.place.plot == "slip"
    ]
    ways = {name: way for name in names if (way := measure.slid(run, name)) is not None}
    if not ways:
        return []
    curves = [Curve(name, 1e3 * way) for name, way in ways.items()]
    caption = "Displacement of the contact point since the robot settled; a lifted foot moves too."
    t = measure.times(run)
    return [Plot("slip", "Slip of every contact", "mm", t, curves, asked, caption=caption, zero=True, wide=True)]


def _tracks(run: Run, name: str) -> dict[str, measure.ContactTrack]:
    """The commanded and the true force, where they were recorded."""
    found = {label: measure.contact_track(run, name, true=label == "true") for label in ("commanded", "true")}
    return {label: track for label, track in found.items() if track is not None}


def _forces(run: Run, name: str) -> list[Item]:
    """The normal force, and the ratio of tangential to normal force with the friction coefficients."""
    tracks, t = _tracks(run, name), measure.times(run)
    normal = {label: track.normal for label, track in tracks.items()}
    if len(normal) == 2:
        normal["true − commanded"] = normal["true"] - normal["commanded"]
    known = {"controller's": run.meta["contacts"][name].get("friction"), "floor's": _floor(run, name)}
    bounds = [Bound(float(mu), f"{whose} friction {mu:g}") for whose, mu in known.items() if mu is not None]
    ratio = [Curve(label, track.ratio) for label, track in tracks.items()]
    return [
        Plot(f"force.{name}", f"{name}: normal force", "N", t, [Curve(*one) for one in normal.items()], scale="force"),
        Plot(f"ratio.{name}", f"{name}: tangential / normal force", "", t, ratio, bounds, zero=True, scale="ratio"),
    ]


def _pressure(run: Run, name: str) -> list[Item]:
    """The way of the centre of pressure in the sole."""
    half, track = run.meta["contacts"][name].get("half_size"), _best(run, name)
    if not half or track.cop is None:
        return []
    x, y = (1e3 * float(size) for size in half)
    sole = np.array([[x, y], [x, -y], [-x, -y], [-x, y]])
    path = 1e3 * track.cop
    title = f"{name}: centre of pressure in the sole"
    return [Map(f"cop.{name}", title, "mm", measure.times(run), path[:, 0], path[:, 1], [("sole", sole)])]


def _best(run: Run, name: str) -> measure.ContactTrack:
    """The true force where it was measured, or else the commanded one."""
    tracks = _tracks(run, name)
    return tracks.get("true") or tracks["commanded"]


def _floor(run: Run, name: str) -> float | None:
    friction = (run.meta.get("plant") or {}).get("friction")
    return float(friction[name]) if isinstance(friction, dict) and name in friction else None


def _row(run: Run, name: str) -> tuple[Any, ...]:
    contact, track, tracks = run.meta["contacts"][name], _best(run, name), _tracks(run, name)
    margin = None
    if track.cop is not None:
        gap = np.asarray(contact["half_size"], dtype=float) - np.abs(track.cop)
        margin = round(1e3 * float(np.nanmin(gap, initial=np.inf)), 3) + 0.0  # no minus before a zero
    slip = measure.slip(run, name)
    worst = [
        float(np.nanmax(tracks[label].ratio, initial=0.0)) if label in tracks else None
        for label in ("commanded", "true")
    ]
    return (name, contact.get("friction"), _floor(run, name), *worst, float(track.normal.min()),
            float(track.normal.max()), margin, None if slip is None else 1e3 * slip)  # fmt: skip
