"""The node ``ranging`` with its parameters and topics: see README.md."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

PARAMETERS = Path(get_package_share_directory("usvnet_ros"), "config", "ranging.yaml")
ARGUMENTS = {
    "params_file": ("parameters of the node", str(PARAMETERS)),
    "image": ("sensor_msgs/Image", "/camera/image_raw"),
    "camera_info": ("sensor_msgs/CameraInfo", "/camera/camera_info"),
    "imu": ("sensor_msgs/Imu, read where use_imu is set", "/imu/data"),
}


def generate_launch_description() -> LaunchDescription:
    """Called by ``ros2 launch``."""
    arguments = [
        DeclareLaunchArgument(name, description=what, default_value=default)
        for name, (what, default) in ARGUMENTS.items()
    ]
    node = Node(
        package="usvnet_ros",
        executable="ranging",
        output="screen",
        parameters=[LaunchConfiguration("params_file")],
        remappings=[(topic, LaunchConfiguration(topic)) for topic in ("image", "camera_info", "imu")],
    )
    return LaunchDescription([*arguments, node])
