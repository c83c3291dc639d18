"""A stand-in for rclpy and the packages of messages: what the node calls, with the signatures of the real ones.

Messages are those of rosbags. Nothing runs by itself: a test delivers messages and lets time pass.
"""

import json
import sys
from contextlib import contextmanager
from enum import Enum
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from unittest.mock import patch

from bag_files import Messages

INTERFACE = json.loads((Path(__file__).parent / "rclpy_interface.json").read_text())
"""What rclpy 9.1.2 (ROS 2 Kilted) takes: the parameters of each callable; ``*`` before those that need their name."""
NEW = Messages()
KINDS = {
    "diagnostic_msgs.msg": ("DiagnosticArray", "DiagnosticStatus", "KeyValue"),
    "geometry_msgs.msg": ("PoseStamped", "PoseWithCovarianceStamped", "TransformStamped"),
    "nav_msgs.msg": ("OccupancyGrid", "Odometry", "Path"),
    "sensor_msgs.msg": ("LaserScan",),
    "tf2_msgs.msg": ("TFMessage",),
}
DurabilityPolicy = Enum("DurabilityPolicy", "TRANSIENT_LOCAL VOLATILE")
ReliabilityPolicy = Enum("ReliabilityPolicy", "RELIABLE BEST_EFFORT")


class ExternalShutdownException(Exception):
    """Raised where ROS is shut down while a node spins."""


class Parameter:
    """Only its types."""

    Type = Enum("Type", "DOUBLE_ARRAY")


class QoSProfile:
    """Keeps what it is given."""

    def __init__(
        self, *, depth=0, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.VOLATILE
    ):
        self.depth, self.reliability, self.durability = depth, reliability, durability


class Node:
    """A node whose topics, timers and services a test works by hand."""

    overrides: dict = {}  # noqa: RUF012

    def __init__(self, node_name):
        self.name, self.published, self.qos, self.said = node_name, {}, {}, []
        self.subscribed, self.timers, self.services, self.now, self.destroyed = {}, [], {}, 0.0, False

    def create_publisher(self, msg_type, topic, qos_profile):
        self.published[topic], self.qos[topic] = [], qos_profile
        return SimpleNamespace(publish=self.published[topic].append)

    def create_subscription(self, msg_type, topic, callback, qos_profile):
        self.subscribed[topic], self.qos[topic] = callback, qos_profile

    def create_service(self, srv_type, srv_name, callback):
        self.services[srv_name] = callback

    def create_timer(self, timer_period_sec, callback):
        self.timers.append([timer_period_sec, self.now, callback])

    def declare_parameter(self, name, value=None):
        default = None if isinstance(value, Parameter.Type) else value
        return SimpleNamespace(value=self.overrides.get(name, default))

    def get_logger(self):
        return SimpleNamespace(**dict.fromkeys(("info", "warning", "error"), self.said.append))

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=int(self.now * 1e9)))

    def destroy_node(self):
        self.destroyed = True

    def until(self, t):
        """Let the time pass to ``t`` (s), and the timers run down."""
        self.now = max(self.now, t)
        for timer in self.timers:
            while timer[1] + timer[0] <= self.now:
                timer[1] = self.now if timer[1] == 0.0 else timer[1] + timer[0]
                timer[2]()


def init(*, args=None):
    """Nothing to begin."""


def spin(node):
    """Nothing comes by itself."""
    raise KeyboardInterrupt


def try_shutdown():
    """Nothing to end."""


@contextmanager
def installed(**overrides):
    """Let ``import rclpy`` find the stand-in; the parameters of the node are these."""
    modules = {
        "rclpy": {"init": init, "spin": spin, "try_shutdown": try_shutdown},
        "rclpy.node": {"Node": type("Node", (Node,), {"overrides": overrides})},
        "rclpy.parameter": {"Parameter": Parameter},
        "rclpy.executors": {"ExternalShutdownException": ExternalShutdownException},
        "rclpy.qos": {kind.__name__: kind for kind in (QoSProfile, DurabilityPolicy, ReliabilityPolicy)},
        "std_srvs.srv": {"Trigger": SimpleNamespace(Response=SimpleNamespace)},
    }
    for package, names in KINDS.items():
        kind = package.replace(".", "/")
        modules[package] = {name: partial(NEW.make, f"{kind}/{name}") for name in names}
    made = {}
    for name, content in modules.items():
        made.setdefault(name.partition(".")[0], ModuleType(name.partition(".")[0]))
        made.setdefault(name, ModuleType(name)).__dict__.update(content)
    with patch.dict(sys.modules, made):
        sys.modules.pop("pfslam_ros.node", None)
        yield
        sys.modules.pop("pfslam_ros.node", None)
