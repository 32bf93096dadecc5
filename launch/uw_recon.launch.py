"""The four stage nodes, and a bag where one is given.

ros2 launch uw_recon_ros uw_recon.launch.py namespace:=rov params_file:=/path/params.yaml bag:=/path/bag rate:=0.5
"""

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution, PathJoinSubstitution
from launch_ros.actions import Node

from launch import LaunchDescription

PACKAGE = "uw_recon_ros"
STAGES = ("preprocess_node", "rectify_node", "disparity_node", "point_cloud_node")
PLAYER = "bag_player_node"


def generate_launch_description() -> LaunchDescription:
    namespace, bag = LaunchConfiguration("namespace"), LaunchConfiguration("bag")
    defaults = PathJoinSubstitution([get_package_share_directory(PACKAGE), "config", "default.yaml"])
    arguments = [
        DeclareLaunchArgument("namespace", default_value="", description="Name space of all nodes and topics."),
        DeclareLaunchArgument("params_file", default_value=defaults, description="ROS parameter file for all nodes."),
        DeclareLaunchArgument("bag", default_value="", description="Bag to replay; none: live cameras."),
        DeclareLaunchArgument("rate", default_value="1.0", description="Speed of the replay."),
    ]
    stages = [
        Node(
            package=PACKAGE,
            executable=stage,
            name=stage,
            namespace=namespace,
            parameters=[LaunchConfiguration("params_file")],
            output="screen",
        )
        for stage in STAGES
    ]
    player = Node(
        package=PACKAGE,
        executable=PLAYER,
        name=PLAYER,
        namespace=namespace,
        arguments=[bag, "--rate", LaunchConfiguration("rate"), "--wait-for-subscribers"],
        condition=IfCondition(NotEqualsSubstitution(bag, "")),
        output="screen",
    )
    return LaunchDescription([*arguments, *stages, player])
