"""Ros2Port: a node of ROS 2 through which a loop drives a group of joints of ``ros2_control``. Not tried on hardware.

It subscribes to ``sensor_msgs/JointState`` and publishes ``std_msgs/Float64MultiArray`` for a
``forward_command_controller``. :class:`~wbc.robots.loop.Loop` does the rest: it waits for a state, ramps in, watches
what arrives, and holds. ``rclpy`` comes with ROS, or from PyPI with the extra ``ros2``; it is imported when a port is
made.
"""

from __future__ import annotations

import os
import time
from typing import Any, final

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.robots.ros2_control import Ros2Control


@final
class Ros2Port(metaclass=TellsArguments):
    """A connection (:class:`~wbc.robots.port.Port`) to the joints of ``device``.

    Args:
        device: order of the joints, interface and rate of the controller.
        states: topic of the joint states.
        commands: topic of the controller, its ``~/commands``.
        node: name of the node.

    A copy in another process, such as a guard's, is a node of its own.

    Example:
        Without ROS the error says what to install:

        >>> from wbc.robots import Ros2Control, Ros2Port
        >>> Ros2Port("effort_controller")
        Traceback (most recent call last):
        wbc.errors.InvalidInput: device is 'effort_controller'; it must be a Ros2Control
    """

    shared = True

    def __init__(
        self,
        device: Ros2Control,
        *,
        states: str = "joint_states",
        commands: str = "forward_command_controller/commands",
        node: str = "wbc",
    ) -> None:
        self.device = checks.instance("device", device, Ros2Control, "a Ros2Control")
        self._names = {"states": states, "commands": commands, "node": node}
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from rclpy.signals import SignalHandlerOptions
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Float64MultiArray

        if not rclpy.ok():  # Ctrl-C stays Python's: a loop still has to send the hold
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node(f"{node}_{os.getpid()}")
        self._message, self._newest = Float64MultiArray, None
        self._publisher = self.node.create_publisher(Float64MultiArray, commands, 1)
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # a queue would make states late
        self._subscription = self.node.create_subscription(JointState, states, self._hear, newest)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)

    def __reduce__(self) -> tuple[Any, ...]:
        return _port, (self.device, self._names)

    def _hear(self, message: Any) -> None:
        self._newest = message

    def receive(self) -> Any | None:
        """The newest joint state that has not been received yet, or None."""
        self._executor.spin_once(timeout_sec=0.0)
        message, self._newest = self._newest, None
        return message

    def send(self, frame: Any) -> None:
        """Publish efforts or positions (n,), in the order of the controller's ``joints``."""
        self._publisher.publish(self._message(data=frame.tolist()))

    clock = staticmethod(time.monotonic)

    def sleep(self, seconds: float) -> None:
        """Receive messages for this time."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def close(self) -> None:
        """Destroy the node."""
        self._executor.shutdown()
        self.node.destroy_node()


def _port(device: Ros2Control, names: dict[str, str]) -> Ros2Port:
    return Ros2Port(device, **names)
