"""Targets: where the frames of a robot of its own size should be, frame by frame, and where its contacts stand still.

Places in the world are scaled by one number s, the ratio of the legs: a foot that stands still in the person's motion
then stands still in the robot's. Arms have the robot's own lengths along the person's directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInput
from wbc.models.pinocchio_ import PinocchioModel
from wbc.motion.body import SIDES, Body, Flags, spans, unit
from wbc.motion.clip import between
from wbc.motion.mapping import Table
from wbc.types import Mat, Vec

#: The robot stretches its legs to this share of what the person does, so that its knees stay bent a little.
_STRETCH = 0.97
#: A foot leaves and comes to its place of standing within so many seconds.
_EASE = 0.1


@final
@dataclass(frozen=True, eq=False)
class Targets:
    """``places`` {part: (N, 3)} [m], ``turned`` {part: (N, 3, 3)} of the frames of a mapping's parts, z = 0 the floor.

    ``holds`` {part: (N,)}: a foot that stands, a hand that holds; the target is constant meanwhile. ``scale`` is the
    robot's size over the person's, ``heights`` {foot: its frame over the floor in standing [m]}.
    """

    places: dict[str, Mat]
    turned: dict[str, Vec]
    holds: dict[str, Flags]
    scale: float

    @classmethod
    def of(cls, body: Body, robot: PinocchioModel, table: Table) -> Targets:
        """Fitted to the size of the robot, as it is in its reference configuration.

        Raises:
            InvalidInput: a robot without floating base, or whose feet are not those of the mapping.
        """
        at = _reference(robot, table)
        p = body.motion.positions
        leg = np.mean([at.length(side, "hip", "knee") + at.length(side, "knee", "ankle") for side in SIDES])
        scale = table.scale or float(_STRETCH * leg / body.leg)
        places, turned = {}, dict(body.turned)
        hips = 0.5 * (p["left_hip"] + p["right_hip"])
        floor = float(np.mean(list(body.standing.values())))
        hips = scale * (hips - [0.0, 0.0, floor]) + [0.0, 0.0, at.ankle]
        middle = 0.5 * (at["left_hip"] + at["right_hip"])
        places["pelvis"] = hips + turned["pelvis"] @ (at["pelvis"] - middle)
        places["chest"] = places["pelvis"] + turned["pelvis"] @ (at["chest"] - at["pelvis"])
        places["head"] = places["chest"] + turned["chest"] @ (at["head"] - at["chest"])
        turned.setdefault("head", turned["chest"])
        holds: dict[str, Flags] = {}
        for side in SIDES:
            foot, wrist = f"{side}_foot", f"{side}_wrist"
            ankle = scale * (p[f"{side}_ankle"] - [0.0, 0.0, body.standing[foot]]) + [0.0, 0.0, at.ankle]
            raised = ankle + turned[foot] @ (at[foot] - at[f"{side}_ankle"])
            raised[:, 2] += np.maximum(0.0, -_lowest(robot, table.followers[foot].frame, raised, turned[foot]))
            holds[foot] = body.holds[foot]
            level = at[foot][2]
            places[foot], turned[foot] = _anchored(raised, turned[foot], holds[foot], body.motion.rate, level)

            def limb(start: Mat, one: str, other: str, side: str = side) -> Mat:
                line = p[f"{side}_{other}"] - p[f"{side}_{one}"]
                return start + at.length(side, one, other) * unit(line)

            hip = places["pelvis"] + turned["pelvis"] @ (at[f"{side}_hip"] - at["pelvis"])
            shoulder = places["chest"] + turned["chest"] @ (at[f"{side}_shoulder"] - at["chest"])
            elbow = limb(shoulder, "shoulder", "elbow")
            hand = limb(elbow, "elbow", "wrist")
            places |= {f"{side}_hip": hip, f"{side}_knee": limb(hip, "hip", "knee")}
            holds[wrist] = body.holds[wrist]
            still = np.tile(np.eye(3), (len(hand), 1, 1))
            if holds[wrist].any():
                hand, _ = _anchored(hand, still, holds[wrist], body.motion.rate, None)
            places[f"{side}_shoulder"], places[f"{side}_elbow"], places[wrist] = shoulder, elbow, hand
        for part, follower in table.followers.items():
            if any(follower.offset):
                around = turned.get(part, turned["chest"])
                places[part] = places[part] + around @ np.array(follower.offset)
        return cls(places, turned, holds, scale)

    def at(self, moments: Vec) -> Targets:
        """The same at other moments (M,), in frames from 0 to N − 1."""
        places, turned, holds = (
            {part: between(values, moments) for part, values in one.items()}
            for one in (self.places, self.turned, self.holds)
        )
        return Targets(places, turned, holds, self.scale)


@final
class _Reference(dict[str, Vec]):
    """Places (3,) of a robot's frames by part, upright with straight arms and legs; and of its ankles."""

    ankle: float

    def length(self, side: str, one: str, other: str) -> float:
        """Of a limb [m]."""
        return float(np.linalg.norm(self[f"{side}_{one}"] - self[f"{side}_{other}"]))


def _reference(robot: PinocchioModel, table: Table) -> _Reference:
    feet = [table.followers[f"{side}_foot"].frame for side in SIDES]
    if robot.nq - robot.nj != 7 or not all(foot in robot.feet for foot in feet):
        raise InvalidInput(
            f"{robot.name} needs a floating base and feet {' and '.join(feet)}; "
            f"its feet are: {', '.join(robot.feet) or 'none'}"
        )
    state = robot.state()
    state.update(0.0, robot.on_ground(robot.q0), np.zeros(robot.nv))
    found = _Reference({part: state.frame(one.frame).position.copy() for part, one in table.followers.items()})
    found.setdefault("head", found["chest"])
    for side, foot in zip(SIDES, feet, strict=True):
        # The ankle is where the leg's joints end: the frame of the joint that carries the foot.
        joint = robot.pinocchio.frames[robot.frames[foot]].parentJoint
        found[f"{side}_ankle"] = state.data.oMi[joint].translation.copy()
    found.ankle = float(found["left_ankle"][2])
    return found


def _lowest(robot: PinocchioModel, frame: str, places: Mat, turned: Vec) -> Vec:
    """Height (N,) of the lowest point of a foot."""
    heights = [places[:, 2] + turned[:, 2] @ np.array(point) - below for point, below in robot.feet[frame].lowest()]
    return np.asarray(np.min(heights, axis=0))


def _anchored(places: Mat, turned: Vec, held: Flags, rate: float, level: float | None) -> tuple[Mat, Vec]:
    """The same motion with one pose for each time of holding; level feet at height ``level``.

    Between two times of holding the motion is shifted evenly from the one's pose to the next one's, and eased out of
    the first and into the second, so that velocity does not jump where a contact begins or ends.
    """
    found, frames, kept = spans(held), np.arange(len(places)), np.flatnonzero(held)
    if not found:
        return places, turned
    goals, turns = [], []
    for start, stop in found:
        goal, turn = places[start:stop].mean(axis=0), Rotation.from_matrix(turned[start:stop]).mean()
        if level is not None:
            x = turn.as_matrix()[:, 0]
            goal[2], turn = level, Rotation.from_euler("z", np.arctan2(x[1], x[0]))
        goals.append(goal)
        turns.append(turn.as_matrix())
    # Of each frame, how far it is from frames that hold, and which of the times of holding is the nearest.
    after = np.searchsorted(kept, frames)
    following = np.minimum(after, len(kept) - 1)
    back = np.where(after > 0, frames - kept[after - 1], np.inf)
    ahead = np.where(after < len(kept), kept[following] - frames, np.inf)
    time = np.repeat(np.arange(len(found)), np.diff(found).ravel())[np.where(back < ahead, after - 1, following)]
    goal, turn = np.array(goals)[time], Rotation.from_matrix(np.array(turns)[time])
    own = Rotation.from_matrix(turned)
    off = np.hstack([goal - places, (turn * own.inv()).as_rotvec()])
    ends = np.unique(np.array(found) - [0, 1])
    even = np.column_stack([np.interp(frames, ends, column) for column in off[ends].T])
    moved, rolled = places + even[:, :3], Rotation.from_rotvec(even[:, 3:]) * own
    ease = np.minimum(max(round(_EASE * rate), 1), 0.5 * (back + ahead - 1.0)) + 1.0
    share = np.minimum(np.minimum(back, ahead) / ease, 1.0)[:, None]
    near = 1.0 - share**2 * (3.0 - 2.0 * share)  # with no speed at either end
    eased = Rotation.from_rotvec(near * (turn * rolled.inv()).as_rotvec()) * rolled
    return moved + near * (goal - moved), eased.as_matrix()
