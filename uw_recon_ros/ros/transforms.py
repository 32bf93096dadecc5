"""Moving frames in tf, where tf2_msgs is installed."""

from __future__ import annotations

from uw_recon_ros.ros.declared_topics import Output
from uw_recon_ros.ros.message_types import message_class
from uw_recon_ros.ros.messages import transform_message
from uw_recon_ros.ros.outputs import Outputs
from uw_recon_ros.types import Matrix

TOPIC = "/tf"
_MESSAGE = message_class("tf2_msgs/msg/TFMessage")
#: What a node that tells tf publishes; empty where tf2_msgs is not installed.
TF = (Output(TOPIC, _MESSAGE, quiet=True),) if _MESSAGE is not None else ()


def send_transform(outputs: Outputs, stamp_ns: int, frame_id: str, child_frame_id: str, pose: Matrix) -> None:
    """Tell tf how `child_frame_id` lies in `frame_id`: (4, 4), m."""
    if _MESSAGE is not None:
        transform = transform_message(stamp_ns, frame_id, child_frame_id, pose)
        outputs.tell(TOPIC, (stamp_ns, child_frame_id), lambda: _MESSAGE(transforms=[transform]))
