"""``flinders ros-package``: a ROS 2 package with a node that calibrates."""

from __future__ import annotations

from flinders.cli import _options as option
from flinders.cli import _program as program
from flinders.cli._output import print_json, say


class RosPackage(program.Group):
    """Options of the command."""

    folder: str = program.member(
        "-o", "--output", required=True, metavar="DIR", help="Folder to create for the package."
    )
    force: bool = option.force()
    as_json: bool = option.as_json()


@program.command_of(
    "ros-package",
    RosPackage,
    common=("folder", "force", "as_json"),
    epilog="""\b
Example:
  flinders ros-package -o ~/ros2_ws/src/flinders_ros
  flinders watch --ros2 /imu/mag --publish /imu/mag_corrected
""",
)
def command(options: RosPackage) -> None:
    """Write a ROS 2 package with a node that calibrates a magnetometer while its robot works.

    The package needs ROS: colcon builds it, and its node uses this program as a library. Without ROS, flinders watch
    --ros2 does the same over DDS.
    """
    from flinders.apps.vehicles.ros2 import node_package

    files = node_package.write(options.folder, force=options.force)
    if options.as_json:
        print_json({"folder": options.folder, "version": node_package.VERSION, "files": list(map(str, files))})
        return
    say(f"{len(files)} files in {options.folder}: build it with colcon build --packages-select flinders_ros")
