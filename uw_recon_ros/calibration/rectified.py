"""Images that come rectified already: known by their topic's name, and described by P alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from uw_recon_ros.types import CameraModel, StereoCalibration

_WORDS = {"rect", "rectified"}


def named_rectified(topic: str) -> bool:
    """Whether an image topic's name says so: ``image_rect``, ``image_rect_color``, ``image_rectified``, ``rect/image``.

    Source: image_proc's and stereo_image_proc's names; the word alone counts, not letters within another
    (``direct``, ``debug_rig``), and not a name space further up.
    """
    parts = [part for part in topic.lower().split("/") if part not in ("", "compressed")]
    return bool(_WORDS & {word for part in parts[-1:] for word in part.split("_")} or _WORDS & set(parts[-2:-1]))


def rectified_by_name(told: str, *topics: str) -> bool:
    """What ``images_rectified`` says; ``auto``: the names of the topics that images came by."""
    return told == "yes" or (told == "auto" and any(map(named_rectified, topics)))


def as_rectified(camera: CameraModel) -> CameraModel:
    """The camera of the rectified image: P's numbers, no distortion, no rotation; K, D and R are the raw image's."""
    return replace(camera, k=camera.p[:, :3].copy(), d=np.zeros_like(camera.d), r=np.eye(3))


def rig_as_imaged(calibration: StereoCalibration, rectified: tuple[bool, bool]) -> StereoCalibration:
    """The rig whose left, or right, or both images came rectified."""
    left, right = (
        as_rectified(camera) if is_rectified else camera
        for camera, is_rectified in zip((calibration.left, calibration.right), rectified, strict=True)
    )
    return replace(calibration, left=left, right=right)
