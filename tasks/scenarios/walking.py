"""A quasi-static walk as functions of time: footsteps, their contacts, the ways of the feet and of the weight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np
import pinocchio

from wbc.models.feet import Foot
from wbc.models.model import RobotState
from wbc.types import Vec

from .. import MinimumJerk, Piecewise, PoseInterpolation
from ..trajectories import Trajectory

#: Standing before the first step, with the weight over the one foot before the other is lifted, and with both feet down
#: before the weight goes on; at the end, in the middle [s].
START, SETTLE, LOAD, END = 0.3, 0.1, 0.15, 0.5


@final
@dataclass(frozen=True)
class Gait:
    """``length`` of a step ahead of the standing foot and ``lift`` of the swinging one [m]; time to ``shift`` the
    weight and to ``swing`` a foot [s]; ``inset`` [m] of the weight from the middle of the standing foot to the other.

    A shift by Δ in T accelerates by up to 5.8 Δ / T², so the centre of pressure is up to 5.8 Δ / T² · z / g away from
    below the centre of mass, which is at height z: it has to stay within the foot.
    """

    length: float
    lift: float
    shift: float
    swing: float
    inset: float


class Footstep(NamedTuple):
    """A foot is lifted and is down again at these times [s]; ``position`` (3,) of its frame then."""

    frame: str
    lifted: float
    down: float
    position: Vec


@final
@dataclass(frozen=True)
class Walk:
    """Contacts as :class:`~tasks.components.contact_schedule.ContactSchedule` takes them; targets of the centre of mass
    and of each foot's frame; the steps one by one; and when it is over [s]."""

    timeline: list[tuple[float, list[str]]]
    com: Trajectory
    feet: Mapping[str, Trajectory]
    steps: list[Footstep]
    duration: float


def walk(state: RobotState, feet: Mapping[str, Foot], gait: Gait, steps: int, *, first: int = 0) -> Walk:
    """``steps`` steps in turn, the foot with index ``first`` of the two in ``feet`` first, from the stance that
    ``state`` is in; the weight ends between the feet."""
    names = list(feet)
    poses = {name: pinocchio.SE3(state.frame(name).placement) for name in names}
    weight, t = np.array(state.com), START
    timeline: list[tuple[float, list[str]]] = [(0.0, names)]
    shifts: list[tuple[float, Trajectory]] = []
    swings: dict[str, list[tuple[float, Trajectory]]] = {name: [] for name in names}
    done: list[Footstep] = []

    def middle(name: str) -> Vec:
        point: Vec = poses[name].act(np.array(feet[name].origin))
        return point

    def move_weight(x: float, y: float) -> None:
        nonlocal weight, t
        goal = np.array([x, y, weight[2]])
        shifts.append((t, MinimumJerk(weight, goal, duration=gait.shift, start_time=t)))
        weight, t = goal, t + gait.shift

    for k in range(steps):
        swinging, standing = names[(first + k) % 2], names[(first + k + 1) % 2]
        across = (middle(swinging) - middle(standing))[:2]
        move_weight(*(middle(standing)[:2] + gait.inset * across / np.linalg.norm(across)))
        t += SETTLE
        goal = pinocchio.SE3(poses[swinging])
        goal.translation = np.array([poses[standing].translation[0] + gait.length, *goal.translation[1:]])
        swing = PoseInterpolation(poses[swinging], goal, duration=gait.swing, start_time=t, lift=gait.lift)
        swings[swinging].append((t, swing))
        done.append(Footstep(swinging, t, t + gait.swing, np.array(goal.translation)))
        timeline += [(t, [standing]), (t + gait.swing, names)]
        poses[swinging], t = goal, t + gait.swing + LOAD
    move_weight(*(0.5 * (middle(names[0]) + middle(names[1]))[:2]))
    ways: dict[str, Trajectory] = {
        name: Piecewise(swings[name] or [(0.0, PoseInterpolation(poses[name], poses[name], duration=1.0))])
        for name in names
    }
    return Walk(timeline, Piecewise(shifts), ways, done, t + END)
