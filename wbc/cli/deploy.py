"""``wbc deploy``: look whether a robot is what a program takes it for, before it moves."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbc.cli.console import NO, one_sentence, progress, say, table
from wbc.cli.options import AsJson

if TYPE_CHECKING:
    from wbc.robots.device import Device
    from wbc.robots.motor_board import MotorBoard

_LEGS = {"FR": "front_right", "FL": "front_left", "RR": "rear_right", "RL": "rear_left"}
_PARTS = {"hip": "hip_roll", "thigh": "hip_pitch", "calf": "knee"}
#: The device of each robot.
_DEVICES = {
    "g1": "UnitreeG1",
    "go2": "UnitreeGo2",
    "quadruped": "UnitreeGo2",
    "panda": "Franka",
    "arm": "Franka",
    "so101": "LeRobot",
}


@one_sentence
def deploy(
    robot: Annotated[str, typer.Argument(help=f"One of {', '.join(_DEVICES)}.")],
    *,
    check: Annotated[bool, typer.Option("--check", help="Small motions prove order, signs, units and IMU.")] = False,
    ros2: Annotated[
        bool, typer.Option("--ros2", help="An effort group of ros2_control instead of its device.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Of the sensors' noise in the dry run.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Check a robot against a motor board in physics: a dry run of the check. Exit code 0: nothing found.

    A robot is checked by the same function through its own connection; see docs/robots.md. Not tried on hardware.
    """
    from wbc.errors import InvalidInput, UnknownRobot
    from wbc.robots.check import check as look
    from wbc.robots.hands import BoardHands

    if robot not in _DEVICES:
        raise UnknownRobot(robot, _DEVICES)
    if not check:
        raise InvalidInput(f"say what to do: wbc deploy {robot} --check")
    board = _board(robot, seed, ros2=ros2)
    with progress(f"checking {robot}, dry") as step:
        found = look(board, board.plant.model, joint_map=board.joint_map, hands=BoardHands(board), progress=step)
    if as_json:
        told: dict[str, Any] = {
            "robot": robot, "ok": found.ok, "dry": True, "figures": found.figures, "unproven": found.unproven,
            "findings": [{"kind": one.kind, "sentence": one.sentence} for one in found.findings],
        }  # fmt: skip
        print(json.dumps(told, ensure_ascii=False))
    else:
        made = table(f"{robot} as {board.device!r}, dry", "", "")
        for one in found.findings:
            made.add_row("wrong", one.sentence)
        for text in found.unproven:
            made.add_row("not proven", text)
        if "rate" in found.figures:
            made.add_row("rate", f"{found.figures['rate']:.4g} Hz")
        if "latency" in found.figures:
            late, period = 1e3 * found.figures["latency"], 1e3 / board.device.rate
            made.add_row("latency", f"{late:.3g} ms, give or take {period:.3g} ms")
        say(made, "", "nothing wrong was found" if found.ok else f"{len(found.findings)} wrong")
    raise typer.Exit(0 if found.ok else NO)


def _board(name: str, seed: int, *, ros2: bool) -> MotorBoard:
    """A robot that hangs, behind its frames, with noisy sensors."""
    from wbc import robots
    from wbc.models import load
    from wbc.robots.motor_board import MotorBoard, holding_gains
    from wbc.sim.engine import PhysicsSettings
    from wbc.sim.mujoco_ import MujocoPlant

    kind = _DEVICES[name]
    model = load(name, base="fixed")
    names: dict[str, str] = {}
    device: Device
    if ros2:
        gains = [0.3 * gain for gain in holding_gains(model)]
        device = robots.Ros2Control(model.joint_names, gains=(gains[0], gains[1]))
    elif kind == "LeRobot":
        device = robots.LeRobot(model.joint_names)
    else:
        device = getattr(robots, kind)()
    if name == "quadruped" and not ros2:
        names = {f"{_LEGS[a]}_{_PARTS[b]}": f"{a}_{b}_joint" for a in _LEGS for b in _PARTS}
    elif name == "arm" and not ros2:
        names = dict(zip(model.joint_names, device.motors, strict=True))
    plant = MujocoPlant(model, settings=PhysicsSettings(armature=0.01, joint_friction=0.02, joint_damping=0.05))
    return MotorBoard(
        device, plant, joint_map=device.joint_map(model, names=names), delay=2e-3, mode_machine=5,
        sensors=robots.SENSORS["mti-300"], seed=seed,
    )  # fmt: skip
