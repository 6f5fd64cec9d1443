"""The controller manager with a robot's description, and tiller's controller: ros2 launch tiller_ros2_control
pendulum.launch.py description:=/path/to/robot.urdf. The description's <ros2_control> tag names the hardware."""
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import Command, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description():
    controllers = Path(__file__).resolve().parent.parent / "config" / "controllers.yaml"
    description = ParameterValue(Command(["cat ", LaunchConfiguration("description")]), value_type=str)
    return LaunchDescription([
        DeclareLaunchArgument("description", description="URDF with a <ros2_control> tag"),
        Node(package="robot_state_publisher", executable="robot_state_publisher",
             parameters=[{"robot_description": description}]),
        Node(package="controller_manager", executable="ros2_control_node", parameters=[str(controllers)],
             remappings=[("~/robot_description", "/robot_description")]),
        # it begins to move as soon as it is active: start it by hand where somebody has to look first
        Node(package="controller_manager", executable="spawner", arguments=["joint_state_broadcaster"]),
        Node(package="controller_manager", executable="spawner", arguments=["tiller_controller", "--inactive"]),
    ])
