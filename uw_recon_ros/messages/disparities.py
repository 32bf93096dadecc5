"""`DisparityMap` <-> ``stereo_msgs/DisparityImage`` and its companions: status, sigma and confidence.

On the wire as inside, ``d = u_left - u_right``, and ``Z = f B / (d + cx_right - cx_left)`` with the principal points of
the rectified CameraInfo. Where these are equal, as in calibrated rigs most often, this is the message's own ``Z = f T /
d``. Where they are not, the message's definition wants the difference added beforehand ("pre-adjusted", as
``stereo_image_proc`` does it): `adjusted` reads and writes that.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.errors import ImageError
from uw_recon_ros.messages.factory import MessageFactory
from uw_recon_ros.messages.headers import header, stamp_ns
from uw_recon_ros.messages.images import float_image_from_message, image_from_message, image_message
from uw_recon_ros.types import ByteImage, DisparityMap, FloatImage, Status, StereoGeometry

DISPARITY = "stereo_msgs/msg/DisparityImage"
EFFORT = "diagnostic_msgs/msg/DiagnosticArray"
_INTEGER_STEP, _SUBPIXEL_STEP = 1.0, 1.0 / 16.0
_LARGEST_PX = 65_536.0


def disparity_message(make: MessageFactory, disparity: DisparityMap, *, adjusted: bool = False) -> Any:
    """Make the ``DisparityImage`` of a disparity map; invalid pixels stay NaN."""
    geometry, values = disparity.geometry, disparity.disparity
    offset = np.float32(geometry.offset_px if adjusted else 0.0)
    head = _head(make, disparity)
    valid = values[np.isfinite(values)]
    height, width = values.shape
    return make(
        DISPARITY,
        header=head,
        image=image_message(make, values + offset if offset else values, head),
        f=float(geometry.focal_px),
        t=math.nan if geometry.baseline_m is None else float(geometry.baseline_m),
        valid_window=make("sensor_msgs/msg/RegionOfInterest", height=height, width=width),
        # Refinement may step out of the searched integers; by definition a value under the minimum would be invalid.
        min_disparity=float(valid.min(initial=disparity.min_disparity) + offset),
        max_disparity=float(valid.max(initial=disparity.max_disparity) + offset),
        delta_d=_INTEGER_STEP if np.array_equal(valid, np.rint(valid)) else _SUBPIXEL_STEP,
    )


def status_message(make: MessageFactory, disparity: DisparityMap) -> Any:
    """Make the ``disparity/status`` message: `Status` bits as ``mono8``."""
    return image_message(make, disparity.status, _head(make, disparity))


def sigma_message(make: MessageFactory, disparity: DisparityMap) -> Any:
    """Make the ``disparity/sigma`` message: px as ``32FC1``."""
    return image_message(make, disparity.sigma, _head(make, disparity))


def confidence_message(make: MessageFactory, disparity: DisparityMap) -> Any:
    """Make the ``disparity/confidence`` message: 0 to 1 as ``32FC1``; NaN everywhere where it is not known."""
    known = disparity.confidence
    values = np.full_like(disparity.disparity, np.nan) if known is None else known
    return image_message(make, values, _head(make, disparity))


def effort_message(make: MessageFactory, disparity: DisparityMap, effort: str) -> Any:
    """Make the ``disparity/effort`` message: what was spent on the disparity of the same stamp."""
    values = [
        make("diagnostic_msgs/msg/KeyValue", key=key, value=value)
        for key, value in (("effort", effort), ("method", disparity.method))
    ]
    status = make("diagnostic_msgs/msg/DiagnosticStatus", name="disparity", message=effort, values=values)
    return make(EFFORT, header=_head(make, disparity), status=[status])


def _head(make: MessageFactory, disparity: DisparityMap) -> Any:
    return header(make, disparity.stamp_ns, disparity.frame_id)


def disparity_from_message(
    message: Any,
    geometry: StereoGeometry,
    *,
    sigma: Any = None,
    status: Any = None,
    confidence: Any = None,
    assumed_sigma_px: float = 0.5,
    adjusted: bool = False,
) -> DisparityMap:
    """Read a disparity image, ours or any other node's.

    Parameters
    ----------
    message : DisparityImage
        A value that is not finite, or under ``min_disparity``, is invalid.
    geometry : StereoGeometry
        Of the rectified pair.
    sigma, status : Image or None
        ``disparity/sigma`` and ``disparity/status`` of the same moment.
    confidence : Image or None
        ``disparity/confidence``.
    assumed_sigma_px : float
        Standard deviation where there is no `sigma`, px.
    adjusted : bool
        Whether the offset of the principal points is in the message's disparities already.

    Raises
    ------
    ImageError
        Naming what is wrong with which of them.
    """
    _check_fields(message)
    received = float_image_from_message(message.image)
    low, high = message.min_disparity, message.max_disparity
    offset = np.float32(geometry.offset_px if adjusted else 0.0)
    valid = np.isfinite(received) & ((received >= np.float32(low)) | (low >= high))
    values = np.where(valid, received - offset if offset else received, np.float32(np.nan)).astype(np.float32)
    return DisparityMap(
        disparity=values,
        sigma=_sigma(sigma, valid, assumed_sigma_px),
        status=_status(status, valid),
        confidence=None if confidence is None else _confidence(confidence, valid),
        min_disparity=math.floor(_limit(low) - offset),
        max_disparity=math.ceil(_limit(high) - offset),
        geometry=geometry,
        method="",  # a message does not say
        stamp_ns=stamp_ns(message),
        frame_id=message.header.frame_id,
    )


def _check_fields(message: Any) -> None:
    """Refuse what no matcher means: a NaN is an unknown baseline in `t`, and nothing elsewhere."""
    if not math.isfinite(message.f) or math.isinf(message.t):
        raise ImageError(f"disparity: expected finite f and T, got f = {message.f:g}, T = {message.t:g}")
    low, high = message.min_disparity, message.max_disparity
    if any(math.isnan(limit) or _LARGEST_PX < abs(limit) < math.inf for limit in (low, high)):
        raise ImageError(
            f"disparity: expected min_disparity and max_disparity within {_LARGEST_PX:g} px, got {low:g} and {high:g}"
        )
    window, image = message.valid_window, message.image
    if window.x_offset + window.width > image.width or window.y_offset + window.height > image.height:
        raise ImageError(
            f"disparity: expected a valid_window within {image.width}x{image.height} px, got "
            f"{window.width}x{window.height} at ({window.x_offset}, {window.y_offset})"
        )


def _limit(value: float) -> float:
    """A limit that an outsider may have left at infinity."""
    return value if math.isfinite(value) else 0.0


def _sigma(message: Any, valid: NDArray[np.bool_], assumed_px: float) -> FloatImage:
    if message is None:
        sigma = np.full(valid.shape, assumed_px, np.float32)
    else:
        sigma = float_image_from_message(message)
        _check_shape("disparity/sigma", sigma.shape, valid.shape)
    checked: FloatImage = np.where(valid, sigma, np.float32(np.nan)).astype(np.float32)
    return checked


def _confidence(message: Any, valid: NDArray[np.bool_]) -> FloatImage:
    confidence = float_image_from_message(message)
    _check_shape("disparity/confidence", confidence.shape, valid.shape)
    return confidence


def _status(message: Any, valid: NDArray[np.bool_]) -> ByteImage:
    reasons = np.zeros(valid.shape, np.uint8)
    if message is not None:
        reasons = image_from_message(message)
        _check_shape("disparity/status", reasons.shape, valid.shape)
        if reasons.dtype != np.uint8:
            raise ImageError(f"disparity/status: expected 8 bits a pixel, got {reasons.dtype}")
    unexplained = np.where(reasons == 0, np.uint8(Status.OUT_OF_RANGE), reasons)
    return np.where(valid, np.uint8(Status.VALID), unexplained).astype(np.uint8)


def _check_shape(name: str, got: tuple[int, ...], expected: tuple[int, ...]) -> None:
    if got != expected:
        raise ImageError(f"{name}: expected the disparity's {expected[1]}x{expected[0]} px mono, got shape {got}")
