"""Parameters of the nodes themselves, beside their stages'. No ROS in here, so that offline readers know the names."""

from __future__ import annotations

from dataclasses import dataclass

from uw_recon_ros.board_kinds import CHECKERBOARD, KINDS
from uw_recon_ros.bounds import LARGEST_PIXELS
from uw_recon_ros.pairing import PAIR_TOLERANCE_MS
from uw_recon_ros.params import Params, param
from uw_recon_ros.topics import TRANSPORTS


@dataclass(frozen=True)
class NodeParams(Params):
    """What every stage node knows."""

    pair_tolerance_ms: float = param(
        PAIR_TOLERANCE_MS,
        "Largest difference of stamps within one group of messages (left and right image).",
        unit="ms",
        low=0,
        high=1e3,
    )
    stall_warning_s: float = param(
        5.0,
        "Silence on a topic that has a publisher, or on a required one, before a warning.",
        unit="s",
        low=0.1,
        high=1e6,
    )
    autostart: bool = param(
        True,
        "Whether the node configures and activates itself; false: a lifecycle manager does.",
        read_only=True,
    )


@dataclass(frozen=True)
class CameraParams(Params):
    """What nodes that read the cameras' images know besides."""

    image_transport: str = param(
        "auto",
        "Which of image_raw and its transports, e.g. image_raw/compressed, is read; auto takes the first in the order "
        "listed that has a publisher. ffmpeg and foxglove need the extra 'video' and their message packages.",
        choices=("auto", *TRANSPORTS),
    )
    max_pixels: int = param(
        4096 * 3072,
        "Pixels an image may have; larger ones are refused before they are decoded. Time and memory grow with them.",
        unit="px",
        low=1,
        high=LARGEST_PIXELS,
    )
    max_rate_hz: float = param(
        0.0, "Pairs per second worked on at most, the others passed over; 0: no limit.", unit="Hz", low=0, high=1e3
    )


@dataclass(frozen=True)
class DisparityMessageParams(Params):
    """What nodes that send or receive disparities know besides."""

    disparity_adjusted: bool = param(
        False,
        "Whether disparities on the wire include cx_right - cx_left, as stereo_image_proc's do; else u_left - u_right.",
    )


@dataclass(frozen=True)
class CloudParams(Params):
    """What nodes that read disparities know besides."""

    assumed_sigma_px: float = param(
        0.5, "Standard deviation of a disparity where disparity/sigma has no publisher.", unit="px", low=1e-3, high=100
    )
    image_memory_mb: int = param(
        256, "Memory for images that wait for their disparity, beyond a few.", unit="MB", low=1, high=65_536
    )


@dataclass(frozen=True)
class RateParams(Params):
    """What nodes that match know besides."""

    target_rate_hz: float = param(
        0.0,
        "Rate to hold by spending less than effort where need be; 0: effort is always spent.",
        unit="Hz",
        low=0,
        high=1e3,
    )
    better_every: int = param(
        0,
        "With target_rate_hz: pairs at least from one matched at the next better effort, where the mean rate allows, "
        "to the following one; such a pair comes late. 0: none.",
        low=0,
        high=1000,
    )


@dataclass(frozen=True)
class OdometryNodeParams(Params):
    """What the odometry node knows besides."""

    odom_frame: str = param("odom", "Frame in which the way begins; never jumps (REP 105).")
    publish_tf: bool = param(
        False, "Whether the pose goes to tf too, odom_frame to base_frame; needs base_frame and tf2_msgs."
    )
    path_spacing_m: float = param(0.05, "Distance between poses of path.", unit="m", low=0.0, high=100.0)
    path_poses: int = param(
        2000, "Poses of path at most; where they were more, every second one goes.", low=10, high=100_000
    )


@dataclass(frozen=True)
class ModelNodeParams(Params):
    """What the model node knows besides."""

    map_frame: str = param("map", "Frame of the model: odometry's, moved where loops say so (REP 105).")
    publish_map_tf: bool = param(False, "Whether tf is told of map_frame to odometry's frame; needs tf2_msgs.")
    model_folder: str = param(
        "",
        "Folder that ~/save writes to, empty or not there before; frames wait on the disk for it. Empty: no files.",
    )


@dataclass(frozen=True)
class CalibrateNodeParams(Params):
    """What the calibrating node knows besides."""

    board: str = param(CHECKERBOARD, "Kind of the board that is held before the cameras.", choices=KINDS)
    board_columns: int = param(
        0, "Inner corners of a checkerboard across, squares of ChArUco, tags or circles; 0: a checkerboard's is found.",
        low=0, high=200,
    )  # fmt: skip
    board_rows: int = param(0, "The same down.", low=0, high=200)
    board_square_mm: float = param(
        0.0, "Side of a square, or from tag to tag, or from circle to circle; 0: not known, and nothing is in metres.",
        unit="mm", low=0.0, high=1e4,
    )  # fmt: skip
    board_marker_mm: float = param(0.0, "Side of a marker; 0: the usual share.", unit="mm", low=0.0, high=1e4)
    board_dictionary: str = param("", "Of a ChArUco board's markers, e.g. DICT_5X5_250.")
    board_medium: str = param("unknown", "What the board is held in.", choices=("water", "air", "unknown"))
    calibration_dir: str = param("", "Folder that the calibration is written into; empty: nothing is written.")
    calibration_overwrite: bool = param(False, "Whether files of an earlier session may be replaced in that folder.")
    calibration_pairs: int = param(150, "Pairs kept at most.", low=4, high=2000)
