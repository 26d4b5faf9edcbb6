"""Starts the node: ``ros2 launch flinders_ros calibrate.launch.py topic:=/imu/mag state:=/var/lib/compass.state``."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

TYPES = {"target_deg": float}


def generate_launch_description():
    """Return the node with its parameters."""
    arguments = {
        "topic": ("/imu/mag", "sensor_msgs/MagneticField of the sensor, uncorrected"),
        "corrected_topic": ("/imu/mag_corrected", "topic of the corrected readings"),
        "state": ("", "file of the state, read at the start and saved; empty for none"),
        "target_deg": ("1.0", "target of the heading error, degrees"),
    }
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value, description=words)
                for name, (value, words) in arguments.items()
            ),
            Node(
                package="flinders_ros",
                executable="calibrate",
                name="flinders",
                output="screen",
                parameters=[
                    {
                        name: ParameterValue(LaunchConfiguration(name), value_type=TYPES.get(name, str))
                        for name in arguments
                    }
                ],
            ),
        ]
    )
