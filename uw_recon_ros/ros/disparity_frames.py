"""Groups of messages -> frames of a dive, for the nodes that go on from disparity."""

from __future__ import annotations

import numpy as np

from uw_recon_ros import rigid
from uw_recon_ros.camera_mount import MountParams
from uw_recon_ros.node_params import CloudParams, DisparityMessageParams
from uw_recon_ros.ros.declared_topics import Input, input_topic
from uw_recon_ros.ros.geometry import check_size, geometry_from_infos
from uw_recon_ros.ros.message_groups import Group
from uw_recon_ros.ros.messages import disparity_from_message
from uw_recon_ros.ros.pairs import color_image, expect_size
from uw_recon_ros.ros.parameters import ParameterSet
from uw_recon_ros.topics import SIDES
from uw_recon_ros.trajectory import DisparityFrame, pose_matrix
from uw_recon_ros.types import Matrix, StereoGeometry, optical_frame

FRAME_INPUTS = (
    Input("sigma", (input_topic("disparity/sigma"),), "optional"),
    Input("left", (input_topic("rectified/left/image_rect_color"), input_topic("rectified/left/image_rect"))),
    *(Input(f"{side}_info", (input_topic(f"rectified/{side}/camera_info"),)) for side in SIDES),
    Input("disparity", (input_topic("disparity"),)),
)


def disparity_frame(group: Group, params: ParameterSet) -> tuple[DisparityFrame, str]:
    """Decode the messages of `FRAME_INPUTS`; also the name of the frame they are in.

    Raises
    ------
    ImageError, CalibrationError, MessageError
    """
    geometry = geometry_from_infos(group["left_info"], group["right_info"])
    disparity = disparity_from_message(
        group["disparity"], geometry, sigma=group.get("sigma"), status=None,
        assumed_sigma_px=params[CloudParams].assumed_sigma_px,
        adjusted=params[DisparityMessageParams].disparity_adjusted,
    )  # fmt: skip
    left = color_image(group["left"])
    expect_size("rectified left image", left, disparity.disparity)
    check_size(group["left_info"], left.shape)
    frame = DisparityFrame(disparity.stamp_ns, left, disparity.disparity, disparity.sigma, disparity.geometry)
    return frame, disparity.frame_id


def view_from_child(mount: MountParams, geometry: StereoGeometry, frame_id: str) -> tuple[str, Matrix]:
    """The frame that odometry is of, and (4, 4) the left rectified view <- it.

    That is `base_frame` where it is known, else the left camera's optical frame.
    """
    rect_from_raw = pose_matrix(np.zeros(3), np.asarray(geometry.rect_from_raw_left, np.float64))
    if not mount.base_frame:
        return optical_frame(frame_id), rect_from_raw
    base_from_optical = pose_matrix(mount.place, mount.base_from_optical)
    return mount.base_frame, rect_from_raw @ rigid.inverse(base_from_optical)
