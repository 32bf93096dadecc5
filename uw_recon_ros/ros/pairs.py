"""Groups of messages <-> pairs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image

from uw_recon_ros.bounds import LARGEST_PIXELS
from uw_recon_ros.calibration import camera_from_info
from uw_recon_ros.calibration.rectified import rig_as_imaged
from uw_recon_ros.errors import ImageError
from uw_recon_ros.findings import Finding
from uw_recon_ros.image_pair import as_pair
from uw_recon_ros.images import to_gray
from uw_recon_ros.messages.headers import stamp_ns
from uw_recon_ros.messages.images import image_from_message
from uw_recon_ros.ros.geometry import check_size, geometry_from_infos, window_from_info
from uw_recon_ros.ros.message_groups import Group
from uw_recon_ros.ros.video import VideoImage
from uw_recon_ros.types import (
    ByteImage,
    EnhancedPair,
    RawImage,
    RectificationQuality,
    RectifiedPair,
    StereoCalibration,
    StereoPair,
)


def raw_pair(
    group: Group, calibration: StereoCalibration | None = None, most_pixels: int = LARGEST_PIXELS
) -> StereoPair:
    """Decode the messages ``left`` and ``right``, of at most so many pixels each.

    Raises
    ------
    ImageError
        An image cannot be read, or the two are not of one size and type.
    """
    left, right, findings = _two_images(group, "left", "right", most_pixels)
    return StereoPair(left, right, stamp_ns(group["left"]), group["left"].header.frame_id, calibration, findings)


def enhanced_pair(group: Group, calibration: StereoCalibration | None) -> EnhancedPair:
    """Decode ``left``, ``right``, ``left_matching`` and ``right_matching``: at least either two of them."""
    names = ("left_matching", "right_matching") if group.keys() >= _MATCHING else ("left", "right")
    first, second, findings = _two_images(group, *names)
    left, right = as_mono(first), as_mono(second)
    message = group[names[0]]
    return EnhancedPair(
        _picture("left", group, left), _picture("right", group, right), left, right,
        stamp_ns(message), message.header.frame_id, calibration, findings,
    )  # fmt: skip


_MATCHING = {"left_matching", "right_matching"}


def _picture(side: str, group: Group, matching: ByteImage) -> ByteImage:
    """A camera's enhanced image; what is matched where it did not come."""
    if side not in group:
        return matching
    picture = as_color(_decode(side, group[side], LARGEST_PIXELS))
    expect_size("matching images", matching, picture)
    return picture


def rectified_pair(group: Group) -> RectifiedPair:
    """Decode ``left``, ``right`` and the rectified ``left_info``, ``right_info``.

    Raises
    ------
    ImageError, CalibrationError
    """
    first, second, _ = _two_images(group, "left", "right")  # gray in any case
    left, right = as_mono(first), as_mono(second)
    infos = group["left_info"], group["right_info"]
    for info in infos:
        check_size(info, left.shape)
    windows = [window_from_info(info) for info in infos]
    return RectifiedPair(
        left=left, right=right, left_matching=left, right_matching=right,
        geometry=geometry_from_infos(*infos), quality=RectificationQuality("given"),
        valid_left=windows[0], valid_right=windows[1],
        stamp_ns=stamp_ns(group["left"]), frame_id=group["left"].header.frame_id,
    )  # fmt: skip


def is_calibrated(info: CameraInfo) -> bool:
    """Whether a camera claims to be calibrated: ``K[0] = 0`` is ROS's way to deny it."""
    return bool(info.k[0] != 0.0)


def calibration_from_infos(
    left: CameraInfo | None, right: CameraInfo | None, rectified: tuple[bool, bool] = (False, False)
) -> StereoCalibration | None:
    """Read both cameras; None where one is missing or says that it is not calibrated.

    Parameters
    ----------
    left, right : CameraInfo or None
    rectified : (bool, bool)
        Whether the left and the right images come rectified.

    Raises
    ------
    CalibrationError
        Numbers that make no sense.
    """
    if left is None or right is None or not (is_calibrated(left) and is_calibrated(right)):
        return None
    return rig_as_imaged(StereoCalibration(camera_from_info(left), camera_from_info(right)), rectified)


def color_image(message: Image) -> ByteImage:
    """Decode an 8-bit image as RGB, mono or not."""
    return as_color(image_from_message(message))


def as_color(image: RawImage) -> ByteImage:
    """RGB of an 8-bit image, mono or RGB."""
    _expect_bytes(image)
    return image if image.ndim == 3 else np.repeat(image[..., np.newaxis], 3, axis=2)


def as_mono(image: RawImage) -> ByteImage:
    """Luma of an 8-bit image, mono or RGB."""
    _expect_bytes(image)
    return np.ascontiguousarray(to_gray(image))


def _expect_bytes(image: RawImage) -> None:
    if image.dtype != np.uint8:
        raise ImageError(f"image: expected 8 bits a channel, got {image.dtype}")


def _two_images(
    group: Group, left: str, right: str, most_pixels: int = LARGEST_PIXELS
) -> tuple[RawImage, RawImage, tuple[Finding, ...]]:
    return as_pair(_decode(left, group[left], most_pixels), _decode(right, group[right], most_pixels))


def _decode(name: str, message: Any, most_pixels: int) -> RawImage:
    try:
        if isinstance(message, VideoImage):
            return message.decode(most_pixels)
        return image_from_message(message, most_pixels)
    except ImageError as error:
        raise ImageError(f"{name} image: {error}", error.code) from error


def expect_size(name: str, got: NDArray[Any], expected: NDArray[Any]) -> None:
    """Raise `ImageError` where `got` is not as large as `expected`."""
    if got.shape[:2] != expected.shape[:2]:
        sizes = [f"{array.shape[1]}x{array.shape[0]} px" for array in (expected, got)]
        raise ImageError(f"{name}: expected {sizes[0]}, got {sizes[1]}")
