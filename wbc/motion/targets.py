"""Targets: where the frames of a robot of its own size should be, frame by frame, and where its contacts stand still.

Places in the world are scaled by one number s, the ratio of the legs: a foot that stands still in the person's motion
then stands still in the robot's. Arms have the robot's own lengths along the person's directions.

**Axes** of a part are those of a person who stands upright: x ahead, y to the left, z up. They come from the joints,

    pelvis   y along the hips, z near the line to the spine
    chest    y along the shoulders, z near the line from the hips
    foot     x along ankle and toes, less the slope of that line in standing; y level

so a file may use any axes for its bones. Where the file says how a part is turned, R_file(t), its turning is more
exact than that of few joints: then R(t) = R_file(t) R₀, with the constant R₀ nearest to R_file(t)ᵀ R_joints(t).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import coal
import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.ndimage import grey_closing, grey_opening
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInput, UnknownName
from wbc.models.feet import Foot
from wbc.models.pinocchio_ import PinocchioModel
from wbc.motion.clip import NEEDED, PARTS, SIDES, Motion
from wbc.motion.mapping import Table
from wbc.report.measure import spans
from wbc.stack.contact import Anchor, Contact
from wbc.types import Flags, Mat, Vec

#: The robot stretches its legs to this share of what the person does, so that its knees stay bent a little.
_STRETCH = 0.97
#: A foot leaves and comes to its place of standing within so many seconds.
_EASE = 0.1
#: Soles that stand beside each other are so far apart [m]: feet are a little larger than their soles.
_APART = 0.02
#: A foot stands that is nearer to its height in standing [m] and slower [m/s] than this; a hand holds the ground.
_NEAR, _SLOW = 0.035, 0.22
_HAND = 0.12
#: Shorter gaps and shorter contacts are none [s].
_SHORT = 0.09
#: The share of frames in which a foot is supposed to stand when its height in standing is looked for.
_SHARE = 5.0


class _Stand(NamedTuple):
    """One time of holding, the frames from start to stop, and its pose."""

    start: int
    stop: int
    goal: Vec
    turn: Rotation


def targets(person: Motion, robot: PinocchioModel, table: Table) -> tuple[Motion, float]:
    """Positions and rotations of the frames of a mapping's parts, and the robot's size over the person's.

    Contacts are those of feet that stand and hands that hold; a target is constant meanwhile. The size is fitted to
    that of the robot in its reference configuration.

    Raises:
        InvalidInput: a robot without floating base, or whose feet are not those of the mapping; a part is missing.
    """
    (at, axes), body = _reference(robot, table), posed(person)
    p, rate = body.positions, body.rate
    places, turned = {}, dict(body.rotations)

    def length(side: str, one: str, other: str) -> float:
        return float(np.linalg.norm(at[f"{side}_{one}"] - at[f"{side}_{other}"]))

    def limb(start: Mat, side: str, one: str, other: str) -> Mat:
        return start + length(side, one, other) * unit(p[f"{side}_{other}"] - p[f"{side}_{one}"])

    bones = [(side, *pair) for side in SIDES for pair in (("hip", "knee"), ("knee", "ankle"))]
    legs = [np.median(np.linalg.norm(p[f"{s}_{one}"] - p[f"{s}_{other}"], axis=1)) for s, one, other in bones]
    scale = table.scale or float(_STRETCH * sum(length(*bone) for bone in bones) / sum(legs))
    heights = {side: standing(p[f"{side}_ankle"]) for side in SIDES}
    above = np.array([0.0, 0.0, at["left_ankle"][2]])
    hips = scale * (0.5 * (p["left_hip"] + p["right_hip"]) - [0.0, 0.0, np.mean(list(heights.values()))]) + above
    places["pelvis"] = hips + turned["pelvis"] @ (at["pelvis"] - 0.5 * (at["left_hip"] + at["right_hip"]))
    places["chest"] = places["pelvis"] + turned["pelvis"] @ (at["chest"] - at["pelvis"])
    places["head"] = places["chest"] + turned["chest"] @ (at["head"] - at["chest"])
    turned.setdefault("head", turned["chest"])
    stands: dict[str, list[_Stand]] = {}
    for side in SIDES:
        foot = f"{side}_foot"
        ankle = scale * (p[f"{side}_ankle"] - [0.0, 0.0, heights[side]]) + above
        raised = ankle + turned[foot] @ (at[foot] - at[f"{side}_ankle"])
        sole, own = robot.feet[table.followers[foot].frame], turned[foot] @ axes[foot]
        low = sole.lowest_in_world(raised, own)[:, :, 2].min(axis=1)
        places[foot] = raised + np.maximum(0.0, -low)[:, None] * [0.0, 0.0, 1.0]
        stands[foot] = _stands(places[foot], turned[foot], body.contacts[foot], at[foot][2])
    _part(stands, {foot: (robot.feet[table.followers[foot].frame], axes[foot]) for foot in stands})
    for side in SIDES:
        foot, wrist = f"{side}_foot", f"{side}_wrist"
        places[foot], turned[foot] = _anchored(places[foot], turned[foot], stands[foot], rate)
        hip = places[f"{side}_hip"] = places["pelvis"] + turned["pelvis"] @ (at[f"{side}_hip"] - at["pelvis"])
        places[f"{side}_knee"] = limb(hip, side, "hip", "knee")
        shoulder = places["chest"] + turned["chest"] @ (at[f"{side}_shoulder"] - at["chest"])
        elbow = limb(shoulder, side, "shoulder", "elbow")
        still = np.tile(np.eye(3), (person.frames, 1, 1))
        hand = limb(elbow, side, "elbow", "wrist")
        hand, _ = _anchored(hand, still, _stands(hand, still, body.contacts[wrist], None), rate)
        places |= {f"{side}_shoulder": shoulder, f"{side}_elbow": elbow, wrist: hand}
    for part, follower in table.followers.items():
        places[part] = places[part] + turned.get(part, turned["chest"]) @ np.array(follower.offset)
    frames = {part: turned[part] @ axes[part] for part in table.followers if part in turned}
    return Motion(rate, places, frames, body.contacts, person.name), scale


def anchor(contact: Contact, targets: Motion, part: str, k: int) -> Anchor:
    """Where a contact of a part is to be in frame k."""
    R = targets.rotations[part][k] if contact.dim == 6 else np.eye(3)
    return Anchor(R, targets.positions[part][k] + R @ getattr(contact, "origin", np.zeros(3)))


def _reference(robot: PinocchioModel, table: Table) -> tuple[dict[str, Vec], dict[str, Mat]]:
    """Places (3,) of a robot's frames by part, upright with straight arms and legs, x ahead, and of its ankles; and the
    axes (3, 3) of the frames there. Those of feet are level: z is up."""
    feet = {side: table.followers[f"{side}_foot"].frame for side in SIDES}
    if robot.nq - robot.nj != 7 or not all(foot in robot.feet for foot in feet.values()):
        asked, known = " and ".join(feet.values()), ", ".join(robot.feet) or "none"
        raise InvalidInput(f"{robot.name} needs a floating base and feet {asked}; its feet are: {known}")
    state = robot.state()
    state.update(0.0, robot.on_ground(robot.q0), np.zeros(robot.nv))
    found = {part: state.frame(one.frame).position.copy() for part, one in table.followers.items()}
    axes = {part: state.frame(one.frame).rotation.copy() for part, one in table.followers.items()}
    found.setdefault("head", found["chest"])
    for side, foot in feet.items():
        # The ankle is where the leg's joints end: the frame of the joint that carries the foot.
        joint = robot.pinocchio.frames[robot.frames[foot]].parentJoint
        found[f"{side}_ankle"] = state.data.oMi[joint].translation.copy()
    left = found["left_hip"] - found["right_hip"]
    ahead = _yaw(np.arctan2(left[0], left[1]))
    axes = {part: ahead @ R for part, R in axes.items()}
    for foot in (f"{side}_foot" for side in SIDES):
        axes[foot] = _yaw(np.arctan2(*axes[foot][1::-1, 0]))
    return {part: ahead @ p for part, p in found.items()}, axes


def _yaw(angle: float) -> Mat:
    return np.asarray(Rotation.from_euler("z", angle).as_matrix())


def _stands(places: Mat, turned: Vec, held: Flags, level: float | None) -> list[_Stand]:
    """One pose for each time of holding, the mean; level feet at height ``level``."""
    found, own = [], Rotation.from_matrix(turned)
    for start, stop in spans(held):
        goal, turn = places[start:stop].mean(axis=0), own[start:stop].mean()
        if level is not None:
            x = turn.as_matrix()[:, 0]
            goal[2], turn = level, Rotation.from_euler("z", np.arctan2(x[1], x[0]))
        found.append(_Stand(start, stop, goal, turn))
    return found


def _part(stands: Mapping[str, list[_Stand]], feet: Mapping[str, tuple[Foot, Mat]]) -> None:
    """Soles that stand at a time are apart: the later one is moved aside, as little as that needs."""
    soles = {
        name: coal.Box(2.0 * foot.half_size[0], 2.0 * foot.half_size[1], 1.0)
        for name, (foot, _) in feet.items()
        if foot.half_size
    }
    made = sorted(((one.start, name, one) for name in soles for one in stands[name]), key=lambda each: each[:2])
    for i, (start, name, late) in enumerate(made):
        for _, other, early in made[:i]:
            if name != other and early.stop > start:
                found, poses = coal.DistanceResult(), []
                for (foot, axes), (_, _, goal, turn) in ((feet[other], early), (feet[name], late)):
                    R = turn.as_matrix() @ axes
                    poses.append(coal.Transform3s(R, goal + R @ np.array(foot.origin)))
                coal.distance(soles[other], poses[0], soles[name], poses[1], coal.DistanceRequest(), found)
                late.goal[:2] += max(0.0, _APART - found.min_distance) * found.normal[:2]


def _anchored(places: Mat, turned: Vec, stands: Sequence[_Stand], rate: float) -> tuple[Mat, Vec]:
    """The same motion with the pose of each time of holding meanwhile.

    Between two of them the motion is moved evenly from the one's pose to the next one's, and eased out of the first and
    into the second by cubics, with which it has no velocity where a contact begins or ends.
    """
    if not stands:
        return places, turned
    frames, own = np.arange(len(places)), Rotation.from_matrix(turned)
    around = own[np.minimum(frames + 1, frames[-1])] * own[np.maximum(frames - 1, 0)].inv()
    speed = np.hstack([np.gradient(places, axis=0), 0.5 * around.as_rotvec()])
    off, held, ease = np.zeros((len(places), 6)), np.zeros(len(places), dtype=bool), max(_EASE * rate, 1.0)
    for start, stop, goal, turn in stands:
        off[start:stop] = np.hstack([goal - places[start:stop], (turn * own[start:stop].inv()).as_rotvec()])
        held[start:stop] = True
    first, last = stands[0].start, stands[-1].stop - 1
    knots = {first - ease: (off[first], np.zeros(6)), last + ease: (off[last], np.zeros(6))}
    knots |= {end: (off[end], -speed[end]) for one in stands for end in (one.start, one.stop - 1)}
    for a, b in ((one.stop - 1, other.start) for one, other in pairwise(stands)):
        even, e = (off[b] - off[a]) / (b - a), min(ease, 0.4 * (b - a))
        knots |= {a + e: (off[a] + e * even, even), b - e: (off[b] - e * even, even)}
    at = np.array(sorted(knots))
    values, slopes = (np.array([knots[x][i] for x in at]) for i in (0, 1))
    swing = CubicHermiteSpline(at, values, slopes)(frames.clip(at[0], at[-1]))
    off = np.where(held[:, None], off, swing)
    return places + off[:, :3], (Rotation.from_rotvec(off[:, 3:]) * own).as_matrix()


def posed(motion: Motion) -> Motion:
    """The same motion with ``rotations`` of pelvis, chest, feet and perhaps head in the axes of a person, and with
    ``contacts`` of feet and wrists; feet are called "left_foot" and "right_foot" there.

    Raises:
        InvalidInput: a part that is needed is missing.
    """
    p = motion.positions
    lacking = [part for part in NEEDED if part not in p]
    if lacking:
        raise InvalidInput(f"{motion.name} has no {', '.join(lacking)}; there are: {', '.join(p)}")
    for part in (*motion.rotations, *motion.contacts):
        if part not in p and part not in PARTS:
            raise UnknownName(part, [*PARTS], f"{motion.name} has rotations or contacts of it")
    hips, shoulders = (0.5 * (p[f"left_{part}"] + p[f"right_{part}"]) for part in ("hip", "shoulder"))
    turned = {
        "pelvis": _axes(p["left_hip"] - p["right_hip"], p.get("spine", shoulders) - hips),
        "chest": _axes(p["left_shoulder"] - p["right_shoulder"], shoulders - hips),
    }
    holds: dict[str, Flags] = {}
    for side in SIDES:
        ankle, toe, wrist = (p[f"{side}_{part}"] for part in ("ankle", "toe", "wrist"))
        rests = [_rests(part, standing(part) + _NEAR, motion.rate) for part in (ankle, toe)]
        stands = holds[f"{side}_foot"] = _said(motion, f"{side}_ankle", rests[0] & rests[1])
        holds[f"{side}_wrist"] = _said(motion, f"{side}_wrist", _rests(wrist, standing(toe) + _HAND, motion.rate))
        turned[f"{side}_foot"] = _foot(toe - ankle, stands)
    for part in ("pelvis", "head", *(f"{side}_ankle" for side in SIDES)):
        if part in motion.rotations:
            mine = part.replace("ankle", "foot")
            when = holds.get(mine, np.ones(motion.frames, dtype=bool))
            turned[mine] = _calibrated(motion.rotations[part], turned.get(mine, turned["chest"]), when)
    return replace(motion, rotations=turned, contacts=holds)


def standing(places: Mat) -> float:
    """The height of a part of a foot (N, 3) in standing [m]."""
    return float(np.percentile(places[:, 2], _SHARE))


def _rests(places: Mat, below: float, rate: float) -> Flags:
    """In which frames a part is low and slow enough to hold."""
    slow = np.linalg.norm(np.gradient(places, axis=0), axis=1) * rate < _SLOW
    return np.asarray(slow & (places[:, 2] < below))


def _said(motion: Motion, part: str, found: Flags) -> Flags:
    """What the file says of a contact, else what was found, without gaps and contacts that are too short."""
    if part in motion.contacts:
        return np.asarray(motion.contacts[part], dtype=bool)
    size = max(round(_SHORT * motion.rate), 1)
    closed = grey_closing(found.astype(np.int8), size, mode="nearest")
    return np.asarray(grey_opening(closed, size, mode="nearest") > 0)


def unit(v: Mat) -> Mat:
    """Directions (…, 3) of length 1."""
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9))


def _axes(y: Mat, up: Mat) -> Vec:
    """Rotations (N, 3, 3) with this y and a z near ``up``."""
    y = unit(y)
    x = unit(np.cross(y, up))
    return np.stack([x, y, np.cross(x, y)], axis=2)


def _foot(ahead: Mat, stands: Flags) -> Vec:
    """Rotations of a foot with y level, from the line (N, 3) of ankle and toes; level on average while it stands."""
    heading = np.arctan2(ahead[:, 1], ahead[:, 0])
    slope = np.arctan2(ahead[:, 2], np.linalg.norm(ahead[:, :2], axis=1))
    level = float(np.median(slope[stands] if stands.any() else slope))
    return np.asarray(Rotation.from_euler("ZY", np.column_stack([heading, level - slope])).as_matrix())


def _calibrated(said: Vec, joints: Vec, when: Flags) -> Vec:
    """R_file(t) R₀ with the rotation R₀ that is nearest to R_file(t)ᵀ R_joints(t) on average over some frames."""
    own = Rotation.from_matrix(said)
    between = own.inv() * Rotation.from_matrix(joints)
    return np.asarray((own * (between[when] if when.any() else between).mean()).as_matrix())
