"""The robots that ``load`` knows by name: three of our own, and those of the package example-robot-data."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, final

from wbc.errors import ModelError
from wbc.models.feet import Foot

OWN_ROBOTS = Path(__file__).parent / "robots"


@final
@dataclass(frozen=True)
class Entry:
    """Where a robot's files are, how it stands, and what it stands on.

    The stance is given by joint name, or by ``pose``, a group state of the SRDF beside the file (with a floating base:
    the one in which it stands); joints that are not named rest.
    """

    urdf: str
    base: Literal["fixed", "floating"] = "fixed"
    stance: Mapping[str, float] = field(default_factory=dict)
    pose: str | None = None
    rigid: tuple[str, ...] = ()
    feet: tuple[Foot, ...] | None = None


def example_robots() -> Path:
    """The folder of the package example-robot-data, found without importing it.

    Raises:
        ModelError: it is not installed.
    """
    import pinocchio

    prefixes = [*Path(pinocchio.__file__).parents, *(Path(entry) / "cmeel.prefix" for entry in sys.path)]
    for prefix in prefixes:
        folder = prefix / "share" / "example-robot-data"
        if (folder / "robots").is_dir():
            return folder
    raise ModelError("the package example-robot-data is not installed; pip install example-robot-data")


def _points(radius: float, friction: float, *frames: str) -> tuple[Foot, ...]:
    return tuple(Foot(frame, "point", friction, radius=radius) for frame in frames)


def _soles(half_size: tuple[float, float] | None, friction: float, *frames: str) -> tuple[Foot, ...]:
    return tuple(Foot(frame, "sole", friction, half_size=half_size) for frame in frames)


def _both(**joints: float) -> dict[str, float]:
    """The same positions on the left and on the right."""
    return {f"{side}_{joint}": q for side in ("left", "right") for joint, q in joints.items()}


def _legs(names: tuple[str, ...], **joints: float) -> dict[str, float]:
    return {f"{leg}_{joint}": q for leg in names for joint, q in joints.items()}


_CORNERS = ("front_left", "front_right", "rear_left", "rear_right")
_UNITREE = ("FL", "FR", "RL", "RR")
_UNITREE_STANCE = _legs(_UNITREE, hip_joint=0.0, thigh_joint=0.8, calf_joint=-1.6)

OWN: Mapping[str, Entry] = {
    "arm": Entry("arm.urdf", stance={"shoulder_pitch": 0.4, "elbow": 1.4, "wrist_pitch": 1.0}),
    "quadruped": Entry(
        "quadruped.urdf",
        "floating",
        stance=_legs(_CORNERS, hip_roll=0.0, hip_pitch=0.7, knee=-1.4),
        feet=_points(0.02, 0.6, *(f"{corner}_foot" for corner in _CORNERS)),
    ),
    "humanoid": Entry(
        "humanoid.urdf",
        "floating",
        stance=_both(hip_pitch=0.35, knee=0.7, ankle_pitch=0.35, shoulder_pitch=0.1, shoulder_roll=0.2, elbow=0.9),
        feet=_soles((0.11, 0.05), 0.6, "left_sole", "right_sole"),
    ),
}

EXAMPLES: Mapping[str, Entry] = {
    # ---- arms and hands
    "panda": Entry(
        "panda_description/urdf/panda.urdf",
        stance=dict(
            zip((f"panda_joint{i}" for i in range(1, 8)), (0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.785), strict=True)
        ),
        rigid=("panda_finger_joint1", "panda_finger_joint2"),
    ),
    "ur3": Entry("ur_description/urdf/ur3_robot.urdf"),
    "ur5": Entry("ur_description/urdf/ur5_robot.urdf"),
    "ur10": Entry("ur_description/urdf/ur10_robot.urdf"),
    "kinova": Entry("kinova_description/robots/kinova.urdf"),
    "xarm7": Entry("xarm_description/urdf/xarm7.urdf"),
    "z1": Entry("z1_description/urdf/z1.urdf", pose="home"),
    "so100": Entry("so_arm_description/urdf/so100.urdf"),
    "so101": Entry("so_arm_description/urdf/so101.urdf"),
    "talos_arm": Entry("talos_data/robots/talos_left_arm.urdf"),
    "baxter": Entry("baxter_description/urdf/baxter.urdf"),
    "allegro_left": Entry("allegro_hand_description/urdf/allegro_left_hand.urdf"),
    "allegro_right": Entry("allegro_hand_description/urdf/allegro_right_hand.urdf"),
    "finger_edu": Entry("finger_edu_description/robots/finger_edu.urdf"),
    "double_pendulum": Entry("double_pendulum_description/urdf/double_pendulum.urdf"),
    # ---- wheeled, the wheels and casters joints like any other
    "pr2": Entry("pr2_description/urdf/pr2.urdf"),
    "tiago": Entry("tiago_description/robots/tiago.urdf"),
    "tiago_dual": Entry("tiago_description/robots/tiago_dual.urdf"),
    "tiago_pro": Entry("tiago_pro_description/robots/tiago_pro.urdf"),
    # ---- four legs
    "go2": Entry(
        "go2_description/urdf/go2.urdf",
        "floating",
        stance=_UNITREE_STANCE,
        feet=_points(0.022, 0.5, *(f"{leg}_foot" for leg in _UNITREE)),
    ),
    "go1": Entry("go1_description/urdf/go1.urdf", "floating"),
    "a1": Entry("a1_description/urdf/a1.urdf", "floating"),
    "b1": Entry("b1_description/urdf/b1.urdf", "floating"),
    "laikago": Entry("laikago_description/urdf/laikago.urdf", "floating"),
    "anymal": Entry("anymal_b_simple_description/robots/anymal.urdf", "floating"),
    "anymal_c": Entry("anymal_c_simple_description/urdf/anymal.urdf", "floating"),
    "hyq": Entry("hyq_description/robots/hyq_no_sensors.urdf", "floating"),
    "solo8": Entry("solo_description/robots/solo.urdf", "floating"),
    "solo12": Entry("solo_description/robots/solo12.urdf", "floating"),
    "centauro": Entry("centauro_description/urdf/centauro.urdf", "floating"),
    # ---- two legs
    "talos": Entry(
        "talos_data/robots/talos_reduced.urdf",
        "floating",
        feet=_soles((0.10, 0.065), 0.3, "left_sole_link", "right_sole_link"),
    ),
    "talos_full": Entry(
        "talos_data/robots/talos_full_v2.urdf",
        "floating",
        feet=_soles((0.10, 0.065), 0.3, "left_sole_link", "right_sole_link"),
    ),
    "g1": Entry(
        "g1_description/urdf/g1_29dof_rev_1_0.urdf",
        "floating",
        stance=_both(
            hip_pitch_joint=-0.3, knee_joint=0.6, ankle_pitch_joint=-0.3, shoulder_pitch_joint=0.2, elbow_joint=0.7
        )
        | {"left_shoulder_roll_joint": 0.25, "right_shoulder_roll_joint": -0.25},
        feet=_soles(None, 0.4, "left_ankle_roll_link", "right_ankle_roll_link"),
    ),
    "bolt": Entry("bolt_description/robots/bolt.urdf", "floating"),
    "icub": Entry("icub_description/robots/icub.urdf", "floating"),
    "romeo": Entry("romeo_description/urdf/romeo.urdf", "floating"),
    "human": Entry("human_description/robots/human.urdf", "floating"),
    "simple_humanoid": Entry("simple_humanoid_description/urdf/simple_humanoid.urdf", "floating"),
    "alex": Entry("alex_description/urdf/alex_nub_hands.urdf", "floating"),
    "alexander": Entry("alexander_description/urdf/alexander_v1.lowerBodyOnly.urdf", "floating"),
}
