"""The node: it connects ``core`` to the topics, parameters, timers and services of ROS 2, and decides nothing."""

from __future__ import annotations

from dataclasses import fields
from threading import Thread
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from pfslam.errors import DataError
from pfslam.recording import Recording
from pfslam_ros import messages
from pfslam_ros.core import Core, Parameters, findings

KEPT = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""For the map and the path: who comes late gets the last one."""
STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
OFTEN = QoSProfile(depth=100)
SENSOR = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
"""For what a driver sends: this gets on with publishers of either kind."""
SAVE_EVERY, SAY_EVERY, JUDGE_EVERY = 60.0, 10.0, 1.0
"""Seconds."""


class SlamNode(Node):
    """A robot's map, or its place in one."""

    def __init__(self) -> None:
        super().__init__("pfslam")
        self.core = Core(self._declared())
        p = self.core.parameters
        self.tf = self.create_publisher(TFMessage, "/tf", OFTEN)
        self.poses = self.create_publisher(PoseWithCovarianceStamped, "pose", 10)
        self.maps, self.paths = (
            self.create_publisher(*what, KEPT) for what in ((OccupancyGrid, "map"), (Path, "path"))
        )
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_subscription(TFMessage, "/tf_static", self.core.on_tf, STATIC)
        self.create_subscription(TFMessage, "/tf", self._then(self.core.on_tf), OFTEN)
        self.create_subscription(LaserScan, p.scan_topic, self._then(self.core.on_scan), SENSOR)
        self.create_subscription(PoseWithCovarianceStamped, "initialpose", self.core.on_initial_pose, 10)
        if p.odom_topic:
            self.create_subscription(Odometry, p.odom_topic, self._then(self.core.on_odometry), SENSOR)
        self.create_service(Trigger, "~/save", self._on_save)
        self.create_timer(p.map_update_interval, self._publish_map)
        self.create_timer(JUDGE_EVERY, self._judge)
        self.create_timer(SAY_EVERY, self._say)
        self.create_timer(SAVE_EVERY, self.save)
        self.drawn = 0
        self.doubted: str | None = None

    def _declared(self) -> Parameters:
        values: dict[str, Any] = {}
        for field in fields(Parameters):
            # An empty list would not tell what it is a list of.
            default: Any = Parameter.Type.DOUBLE_ARRAY if field.name == "mask" else field.default
            value = self.declare_parameter(field.name, default).value
            values[field.name] = tuple(value or ()) if field.name == "mask" else value
        return Parameters(**values)

    def _then(self, take: Any) -> Any:
        """Make a callback that takes a message, and publishes what has become due."""

        def callback(message: Any) -> None:
            take(message)
            for step in self.core.due():
                self._publish(step)

        return callback

    def _publish(self, step: Any) -> None:
        core, p = self.core, self.core.parameters
        t = core.stamp(step.t)
        self.poses.publish(
            messages.pose_of(PoseWithCovarianceStamped, t, p.map_frame, step.estimate, core.filter.covariance)
        )
        if core.located:
            later, where = t + p.transform_tolerance, core.map_to_odom(step)
            sent = messages.transform_of(TransformStamped, later, p.map_frame, p.odom_frame, where)
            self.tf.publish(TFMessage(transforms=[sent]))
        if (recording := core.first_seconds()) is not None:
            Thread(target=self._check, args=(recording,), daemon=True).start()

    def _publish_map(self) -> None:
        core, frame = self.core, self.core.parameters.map_frame
        if core.steps == self.drawn:
            return
        t = core.stamp(core.path[-1][0])
        if core.known is None or not self.drawn:
            self.maps.publish(messages.map_of(OccupancyGrid, t, frame, core.filter.grid))
        path = [(core.stamp(t), pose) for t, pose in core.path]
        self.paths.publish(messages.path_of(Path, PoseStamped, path, frame))
        self.drawn = core.steps

    def _judge(self) -> None:
        core, now = self.core, self.get_clock().now().nanoseconds * 1e-9
        doubt, values = core.doubt(), {"scans used": core.steps} | core.left_out
        told = messages.diagnosis_of(DiagnosticArray, DiagnosticStatus, KeyValue, now, doubt, values)
        self.diagnostics.publish(told)
        if doubt != self.doubted:
            self.doubted = doubt
            self.get_logger().warning(doubt or "the pose is not in doubt any more")

    def _say(self) -> None:
        for line in self.core.decided():
            self.get_logger().info(line)
        for line in self.core.news():
            self.get_logger().warning(line)

    def _check(self, recording: Recording) -> None:
        """Check the first seconds up: a second's work, in a thread of its own, so that no scan waits."""
        try:
            lines = findings(recording, self.core.parameters)
        except DataError as error:
            lines = [str(error)]
        for line in lines or ["nothing to put right"]:
            self.get_logger().warning(f"check-up: {line}")

    def _on_save(self, _: Any, response: Any) -> Any:
        said = self.save()
        response.success = said is not None
        response.message = said or "nothing to save: it takes mode mapping, a map_file_name, and scans"
        return response

    def save(self) -> str | None:
        """Save the map, if there is one and a file for it."""
        try:
            return self.core.save()
        except (DataError, OSError) as error:
            self.get_logger().error(f"not saved: {error}")
            return None


def main(args: list[str] | None = None) -> None:
    """Run the node until it is stopped, and save the map then."""
    rclpy.init(args=args)
    try:
        node = SlamNode()
    except DataError as error:  # of the parameters, or of the map that they name
        rclpy.try_shutdown()
        raise SystemExit(f"pfslam: {error}") from None
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.save()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
