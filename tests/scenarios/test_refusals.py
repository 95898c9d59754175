"""What makes no sense in a scenario is refused before its first tick, by its name."""

from __future__ import annotations

import pytest

from tests.scenarios.runs import run
from wbc.errors import InvalidInput, UnknownFrame, UnknownJoint, UnknownRobot


@pytest.mark.parametrize(
    ("name", "setting", "duration", "kind", "says"),
    [
        *((name, "robot=talo", None, UnknownRobot, "talos") for name in (
            "humanoid-stand", "humanoid-step", "humanoid-joint-loss", "stand-family", "fault-family")),
        ("dual-arm", "robot=humanoit", None, UnknownRobot, "humanoid"),
        ("arm-payload", "robot=pand", None, UnknownRobot, "panda"),
        ("position-drives", "robot=pr2", None, UnknownRobot, "position-drives knows what these can do"),
        ("arm-payload", "", 2.0, InvalidInput, "the load comes at 3 s"),
        ("arm-reach", "robot=arm", 2.0, InvalidInput, r"1\.5 s"),
        ("stand-family", "robot=quadruped", 1.2, InvalidInput, r"come at 1\.2 s"),
        ("arm-actuator-loss", "robot=arm joints=9", None, InvalidInput, "has 7 joints"),
        ("arm-collision", "robot=arm link=elbo", None, UnknownFrame, "elbow"),
        ("arm-reach", "robot=arm frame=tol", None, UnknownFrame, "tool"),
        ("arm-reach", "robot=humanoid", None, InvalidInput, "has 5 ends, such as left_hand, .*; say --set frame=NAME"),
        ("arm-reach", "robot=arm level=torque", None, InvalidInput, "level"),
        ("collision-dodge", "margin=0", 0.05, InvalidInput, "margin is"),
        ("collision-dodge", "margin=0.5", 0.05, InvalidInput, "margin is"),
        ("humanoid-joint-loss", "robot=humanoid joint=left_kne", None, UnknownJoint, "left_knee"),
        ("humanoid-stand", "robot=humanoid push=hard", None, InvalidInput,
         "'push' must be a number, not 'hard', or auto for what is usual"),
        ("humanoid-step", "robot=humanoid first=both", None, InvalidInput, "first"),
        ("humanoid-step", "robot=humanoid steps=0", None, InvalidInput, "steps"),
        ("fault-family", "robot=humanoid joints=elbow", None, InvalidInput, "elbow"),
        ("fault-family", "robot=humanoid answer=maybe", None, InvalidInput, "answer"),
        ("stand-family", "robot=quadruped push=0", None, InvalidInput, "nothing"),
        ("stand-family", "robot=humanoid load=heavy", None, InvalidInput, "load"),
        ("quadruped-joint-loss", "robot=quadruped moments=0", None, InvalidInput, "moments"),
        ("quadruped-actuator-weak", "robot=quadruped moments=0", None, InvalidInput, "moments"),
        ("quadruped-actuator-weak", "robot=quadruped left=0", None, InvalidInput, "left"),
        ("4p-adaptive", "kd=0", None, InvalidInput, "kd"),
        ("4p-adaptive", "m=0,0,0,0", None, InvalidInput, "singular"),
        ("pr-fault", "threshold=0,1", None, InvalidInput, "threshold"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(
    name: str, setting: str, duration: float | None, kind: type[Exception], says: str
) -> None:
    with pytest.raises(kind, match=says):
        run(name, *setting.split(), duration=duration)


def test_physics_is_not_for_what_decides_velocities() -> None:
    with pytest.raises(InvalidInput, match="level=dynamics"):
        run("arm-reach", "robot=arm", plant="mujoco")
