"""DisparityImage: d = u_left - u_right, or adjusted by cx_right - cx_left as its own definition says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image
from stereo_msgs.msg import DisparityImage

from uw_recon_ros.errors import ImageError
from uw_recon_ros.ros.messages import (
    disparity_from_message,
    disparity_message,
    header,
    image_message,
    sigma_message,
    status_message,
)
from uw_recon_ros.types import DisparityMap, Status, StereoGeometry

NAN = np.float32(np.nan)
GEOMETRY = StereoGeometry(500.0, 320.0, 332.0, 240.0, baseline_m=0.12)
VALUES = np.array([[-2.0, NAN, 4.5], [NAN, 7.0, -11.25]], np.float32)
STATUS = np.where(np.isfinite(VALUES), 0, [[0, Status.OCCLUDED, 0], [Status.LOW_TEXTURE, 0, 0]]).astype(np.uint8)
SIGMA = np.where(np.isfinite(VALUES), np.float32(0.25), NAN)


def sample(geometry: StereoGeometry = GEOMETRY, values: np.ndarray = VALUES) -> DisparityMap:
    return DisparityMap(values, SIGMA, STATUS, -10, 20, geometry, "test", stamp_ns=3_000_000_004, frame_id="left")


def over_the_wire(message: DisparityImage | Image) -> DisparityImage | Image:
    return deserialize_message(serialize_message(message), type(message))


def test_the_values_are_those_of_the_map() -> None:
    wire = np.frombuffer(over_the_wire(disparity_message(sample())).image.data, np.float32)
    np.testing.assert_array_equal(wire.reshape(2, 3), VALUES)


def test_adjusted_disparities_give_depth_as_the_message_defines_it() -> None:
    message = over_the_wire(disparity_message(sample(), adjusted=True))
    wire = np.frombuffer(message.image.data, np.float32).reshape(2, 3)
    front = wire > 0
    assert front.sum() == 4
    np.testing.assert_allclose(
        message.f * message.t / wire[front], GEOMETRY.depth_from_disparity(VALUES)[front], rtol=1e-6
    )
    np.testing.assert_array_equal(np.isnan(wire), np.isnan(VALUES))
    assert (message.header.frame_id, message.image.encoding) == ("left", "32FC1")
    assert message.image.header == message.header


def test_fields() -> None:
    message = disparity_message(sample())
    assert (message.f, message.t) == (500.0, 0.12)
    assert (message.valid_window.width, message.valid_window.height) == (3, 2)
    assert message.max_disparity == 20
    assert message.min_disparity == -11.25  # under the searched -10 by refinement, and valid all the same
    assert message.delta_d == 1 / 16


def test_whole_disparities_have_a_step_of_one() -> None:
    assert disparity_message(sample(values=np.rint(VALUES))).delta_d == 1.0


def test_unknown_baseline_is_nan() -> None:
    assert math.isnan(disparity_message(sample(StereoGeometry(500.0, 1.0, 1.0, 1.0))).t)


@pytest.mark.parametrize("adjusted", [False, True])
def test_the_map_survives(adjusted: bool) -> None:
    sent = sample()
    sigma, status = over_the_wire(sigma_message(sent)), over_the_wire(status_message(sent))
    message = over_the_wire(disparity_message(sent, adjusted=adjusted))
    assert (message.min_disparity, message.max_disparity) == ((0.75, 32) if adjusted else (-11.25, 20))
    got = disparity_from_message(message, GEOMETRY, sigma=sigma, status=status, adjusted=adjusted)
    np.testing.assert_array_equal(got.disparity, sent.disparity)
    np.testing.assert_array_equal(got.sigma, sent.sigma)
    np.testing.assert_array_equal(got.status, sent.status)
    assert (got.max_disparity, got.stamp_ns, got.frame_id) == (20, 3_000_000_004, "left")


def outsider(values: list[float], low: float, high: float) -> DisparityImage:
    image = image_message(np.array([values], np.float32), header(1, "left"))
    return DisparityImage(header=image.header, image=image, min_disparity=low, max_disparity=high)


def test_an_outsiders_invalid_values() -> None:
    message = outsider([-1.0, 0.0, 5.0, math.inf, math.nan], 0.0, 64.0)
    geometry = StereoGeometry(500.0, 0.0, 0.0, 0.0, baseline_m=0.1)
    got = disparity_from_message(message, geometry, assumed_sigma_px=0.75)
    np.testing.assert_array_equal(got.disparity, np.array([[NAN, 0, 5, NAN, NAN]], np.float32))
    np.testing.assert_array_equal(got.sigma, np.array([[NAN, 0.75, 0.75, NAN, NAN]], np.float32))
    np.testing.assert_array_equal(got.status == 0, np.isfinite(got.disparity))


def test_limits_left_at_zero_are_none() -> None:
    got = disparity_from_message(outsider([-3.0, 2.0], 0.0, 0.0), StereoGeometry(1.0, 0.0, 0.0, 0.0))
    np.testing.assert_array_equal(got.disparity, np.array([[-3, 2]], np.float32))


def test_infinite_limits_do_no_harm() -> None:
    got = disparity_from_message(outsider([1.0], -math.inf, math.inf), StereoGeometry(1.0, 0.0, 0.0, 0.0))
    assert got.disparity[0, 0] == 1.0
    assert (got.min_disparity, got.max_disparity) == (0, 0)


def test_a_status_that_contradicts_is_overruled() -> None:
    status = image_message(np.array([[Status.OCCLUDED, 0]], np.uint8), header(1, "left"))
    got = disparity_from_message(outsider([1.0, math.nan], 0.0, 9.0), StereoGeometry(1.0, 0, 0, 0), status=status)
    assert got.status[0, 0] == 0
    assert got.status[0, 1] != 0


@pytest.mark.parametrize("name", ["sigma", "status"])
def test_companions_of_another_size_are_refused(name: str) -> None:
    make = {"sigma": image_message, "status": image_message}[name]
    wrong = make(np.zeros((3, 2), np.float32 if name == "sigma" else np.uint8), header(1, "left"))
    with pytest.raises(ImageError, match=f"disparity/{name}: expected the disparity's 2x1 px"):
        disparity_from_message(outsider([1.0, 2.0], 0.0, 9.0), StereoGeometry(1.0, 0, 0, 0), **{name: wrong})
