"""retarget: the motion of a person as a motion of a robot, and a verdict for every frame of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

from wbc import checks
from wbc.errors import InvalidInput
from wbc.files import Place
from wbc.models.pinocchio_ import PinocchioModel
from wbc.motion.clip import Motion
from wbc.motion.judged import Judged
from wbc.motion.mapping import Table
from wbc.motion.page import save_page
from wbc.motion.repair import repaired
from wbc.motion.retargeting import Retargeting
from wbc.motion.targets import targets
from wbc.motion.witness import Witness
from wbc.sim.scenario import Progress, silent


@final
@dataclass(frozen=True, eq=False)
class Retargeted(Judged):
    """What :func:`retarget` gives: a judged motion that can be written as a page."""

    def report(self, folder: Place) -> Path:
        """Write a page with the person beside the robot and what is impossible when, and the motion beside it.

        Raises:
            NotSupported: a package that reports need is not installed. InvalidInput: something else stands there.
        """
        return save_page(self, Path(folder))


def retarget(
    motion: Motion | Place, robot: PinocchioModel, mapping: Table | Place | None = None, *,
    acceleration: float | None = 200.0, collisions: bool = True, repair: bool = False, progress: Progress = silent,
) -> Retargeted:  # fmt: skip
    """The motion of a person as a motion of ``robot``, with a verdict for every frame.

    The person's size is fitted to the robot's; feet that stand and hands that hold are found in the motion and do not
    slip; limits of position, speed and acceleration hold; shapes of the robot stay apart. Then inverse dynamics says of
    each frame whether forces and torques for it exist, or what lacks. Equations: :mod:`wbc.motion.retargeting`,
    :mod:`wbc.motion.witness`.

    Args:
        motion: what was read by :meth:`Motion.read`, or a file.
        robot: with a floating base and two feet.
        mapping: which frame follows which part of the body: a table, a TOML file, or by default what the library has
            for the G1, Talos and its own humanoid.
        acceleration: limit on joint accelerations [rad/s²]; None: none.
        collisions: whether the robot's own shapes are kept apart.
        repair: whether to look for a motion near by that is possible, where this one is not: in turn one that is
            slower there, and one whose joints move otherwise (:mod:`wbc.motion.repair`). The motion before is kept as
            ``before``, and ``added`` is how much longer it takes now.
        progress: called with the share that is done, and a word.

    Raises:
        InvalidInput: a motion, mapping or robot that makes no sense. UnknownName: no mapping for this robot.

    Example:
        >>> import wbc
        >>> from wbc.motion import made
        >>> robot = wbc.load("humanoid", base="floating")
        >>> found = wbc.retarget(made("squat"), robot)
        >>> found.q.shape, found.certified
        ((240, 37), 1.0)
    """
    if not isinstance(robot, PinocchioModel):
        raise InvalidInput(f"robot is {checks.shown(robot)}; it must be a robot from wbc.load(..., base='floating')")
    if acceleration is not None:
        acceleration = checks.number("acceleration", acceleration, low=0.0, strict=True)
    collisions, repair = checks.truth("collisions", collisions), checks.truth("repair", repair)
    if not callable(progress):
        raise InvalidInput(f"progress is {checks.shown(progress)}; it must be a function of a share and a word")
    motion = motion if isinstance(motion, Motion) else Motion.read(motion)
    table = Table.of(robot, mapping)
    asked, scale = targets(motion, robot, table)
    stack = Retargeting(robot, table, asked, acceleration=acceleration, collisions=collisions)
    share = 0.25 if repair else 0.5
    q = stack.frames(lambda done: progress(share * done, "retargeting"))
    found = Retargeted(robot, motion, table, asked, scale, stack.contacts, q, (), tuple(stack.unsolved))
    witness = Witness(robot, stack.contacts, collisions=collisions)
    verdicts = witness.judge(q, motion.rate, found.holds, lambda done: progress(share * (1.0 + done), "judging"))
    found = replace(found, verdicts=tuple(verdicts))
    if not repair or found.certified == 1.0:
        return found
    return repaired(found, witness, lambda done, word: progress(0.5 + 0.5 * done, word))
