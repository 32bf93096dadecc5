"""What the doctor takes from messages, well formed or not."""

from __future__ import annotations

import array

import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from stereo_msgs.msg import DisparityImage

from uw_recon_ros.ros.messages import header, image_message
from uw_recon_ros.ros.observer.recorder import Recorder, camera_numbers

SECOND = 1_000_000_000


def heard(*messages: object) -> Recorder:
    recorder = Recorder()
    for message in messages:
        recorder(message)
    return recorder


def cloud(z: np.ndarray, step: int = 16) -> PointCloud2:
    """An organised cloud whose z lies at byte 8 of each point."""
    fields = [PointField(name=n, offset=4 * k, datatype=PointField.FLOAT32, count=1) for k, n in enumerate("xyz")]
    points = np.zeros((z.size, step // 4), np.float32)
    points[:, 2] = z.ravel()
    message = PointCloud2(header=header(SECOND, "cam"), height=z.shape[0], width=z.shape[1], fields=fields)
    message.point_step, message.row_step = step, step * z.shape[1]
    message.data = array.array("B", points.tobytes())
    return message


def test_nothing_came() -> None:
    assert heard().arrivals(5.0).count == 0


def test_images() -> None:
    messages = [Image(header=header(k * SECOND, "cam"), height=2, width=3, encoding="mono8") for k in (1, 2, 3)]
    for message in messages:
        message.data = array.array("B", bytes(6))
    came = heard(*messages).arrivals(2.0)
    assert (came.count, came.width, came.height, came.encoding, came.size_bytes) == (3, 3, 2, "mono8", 6)
    assert came.stamps_ns == (SECOND, 2 * SECOND, 3 * SECOND)
    assert came.behind_ns > 1e18  # stamps of 1970
    assert came.frame_id == "cam"
    assert came.valid_share is None
    assert heard(messages[0]).arrivals(2.0).rate_hz == pytest.approx(0.5)


def test_share_of_valid_disparities() -> None:
    values = np.array([[3, np.nan], [-1, 7]], np.float32)  # -1: how others mark invalid ones
    message = DisparityImage(header=header(SECOND, "cam"), image=image_message(values, header(SECOND, "cam")))
    assert heard(message).arrivals(1.0).valid_share == 0.5
    message.image.data = array.array("B", bytes(7))
    assert heard(message).arrivals(1.0).valid_share is None


def test_share_of_points() -> None:
    z = np.array([[1, np.nan, 2], [np.nan, np.nan, np.inf]], np.float32)
    assert heard(cloud(z)).arrivals(1.0).valid_share == pytest.approx(2 / 6)
    flat = cloud(z.reshape(1, 6))  # without rows: nothing to compare with
    assert heard(flat).arrivals(1.0).valid_share is None


def test_a_cloud_that_lies_about_itself() -> None:
    for step in (0, 5, 2**31):
        message = cloud(np.ones((2, 3), np.float32))
        message.point_step = step
        assert heard(message).arrivals(1.0).valid_share is None
    message = cloud(np.ones((2, 3), np.float32))
    message.fields[2].offset = 14
    assert heard(message).arrivals(1.0).valid_share is None


def test_numbers_of_a_camera() -> None:
    info = CameraInfo(width=4, height=3, d=[0.5])
    info.p[3] = -40.0
    numbers = camera_numbers(info)
    assert (numbers.width, numbers.height, numbers.d, numbers.p[3]) == (4, 3, (0.5,), -40.0)
