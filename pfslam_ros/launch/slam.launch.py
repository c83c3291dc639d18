"""Start the node: ``ros2 launch pfslam_ros slam.launch.py params_file:=my.yaml use_sim_time:=true``."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description() -> LaunchDescription:
    """Describe what is started, and the arguments."""
    params = Path(get_package_share_directory("pfslam_ros")) / "config" / "params.yaml"
    sim_time = ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)
    node = Node(
        package="pfslam_ros",
        executable="slam",
        name="pfslam",
        output="screen",
        parameters=[LaunchConfiguration("params_file"), {"use_sim_time": sim_time}],
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument("params_file", default_value=str(params), description="The parameters"),
            DeclareLaunchArgument(
                "use_sim_time", default_value="false", description="Whether /clock tells the time"
            ),
            node,
        ]
    )
