"""The output bag's bytes are those that the nodes' own messages serialise to.

ROS leaves the padding between fields as it was in memory, so its bytes are read and written again with zeros there.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from uw_recon_ros.bags import messages
from uw_recon_ros.pipeline import Products, Stages
from uw_recon_ros.reconstruct.stage import Reconstruct, ReconstructParams
from uw_recon_ros.ros.messages import (
    cloud_message,
    confidence_message,
    depth_messages,
    disparity_message,
    header,
    image_message,
    rectified_infos,
    sigma_message,
    status_message,
    surface_message,
)
from uw_recon_ros.survey.output_bag import frame_messages
from uw_recon_ros.types import (
    DisparityMap,
    EnhancedPair,
    RectificationQuality,
    RectifiedPair,
    StereoGeometry,
    StereoPair,
    Window,
)

HORIZONTAL = StereoGeometry(60.0, 30.5, 33.25, 20.0, 0.1, focal_across_px=61.0)
VERTICAL = StereoGeometry(60.0, 19.5, 19.5, 30.0, -0.1, axis="vertical")
UNSCALED = StereoGeometry(60.0, 30.5, 33.25, 20.0, axis="vertical", baseline_sign=-1)
STAMP = 1_700_000_000_123_456_789


def products(geometry: StereoGeometry, frame_id: str = "left_optical_frame", *, whole: bool = False) -> Products:
    """A wavy plane with holes, at odd sizes so that padding matters."""
    rng = np.random.default_rng(3)
    height, width = 41, 63
    colors = [rng.integers(0, 256, (height, width, 3), np.uint8) for _ in range(2)]
    monos = [rng.integers(0, 256, (height, width), np.uint8) for _ in range(2)]
    sign = -1.0 if (geometry.baseline_m or geometry.baseline_sign) < 0 else 1.0
    waves = np.sin(np.arange(height)[:, None] / 5)
    values = (sign * (9 + np.linspace(0, 3, width) + waves)).astype(np.float32)
    values = np.rint(values) if whole else values
    values[10:14, 20:30] = np.nan
    holes = np.isnan(values)
    named = {"stamp_ns": STAMP, "frame_id": frame_id}
    disparity = DisparityMap(
        values, np.where(holes, np.float32(np.nan), np.float32(0.2)), holes.astype(np.uint8), -13, 13, geometry,
        confidence=np.where(holes, np.float32(np.nan), np.float32(0.9)), **named,
    )  # fmt: skip
    stage = Reconstruct(ReconstructParams(speckle_area_px=0))
    quality = RectificationQuality("calibrated")
    rectified = RectifiedPair(*colors, *monos, geometry, quality, Window(2, 3, 50, 30), None, **named)
    enhanced = EnhancedPair(*colors, *monos, **named)
    return Products(StereoPair(*colors), Stages(lambda _: enhanced, lambda _: rectified, lambda _: disparity, stage))


def of_the_nodes(p: Products) -> dict[str, Any]:
    head = header(STAMP, p.enhanced.frame_id)
    infos = rectified_infos(p.rectified)
    made: dict[str, Any] = {
        "left/image_matching": image_message(p.enhanced.left_matching, head),
        "right/image_matching": image_message(p.enhanced.right_matching, head),
        "left/image_enhanced": image_message(p.enhanced.left, head),
        "right/image_enhanced": image_message(p.enhanced.right, head),
        "rectified/left/camera_info": infos[0],
        "rectified/right/camera_info": infos[1],
        "rectified/left/image_rect_color": image_message(p.rectified.left, head),
        "rectified/right/image_rect_color": image_message(p.rectified.right, head),
        "rectified/left/image_rect": image_message(p.rectified.left_matching, head),
        "rectified/right/image_rect": image_message(p.rectified.right_matching, head),
        "disparity/status": status_message(p.disparity),
        "disparity/sigma": sigma_message(p.disparity),
        "disparity/confidence": confidence_message(p.disparity),
        "disparity": disparity_message(p.disparity),
    }
    if p.depth.geometry.metric:
        image, sigma, info = depth_messages(p.depth)
        made |= {"depth/camera_info": info, "depth/sigma": sigma, "depth/image_rect": image}
        made |= {"points2": cloud_message(p.cloud), "points2_filtered": cloud_message(p.thinned)}
    else:
        made["points_unscaled"] = cloud_message(p.cloud)
    return made | {"surface": surface_message(p.surface)}


def ros_bytes(message: Any) -> bytes:
    store = messages.typestore()
    kind = type_name(message)
    return bytes(store.serialize_cdr(store.deserialize_cdr(serialize_message(message), kind), kind))


def type_name(message: Any) -> str:
    return f"{type(message).__module__.split('.')[0]}/msg/{type(message).__name__}"


@pytest.mark.parametrize("frame_id", ["left_optical_frame", "l", "", "abc"])  # every alignment of what follows
@pytest.mark.parametrize("geometry", [HORIZONTAL, VERTICAL, UNSCALED], ids=["horizontal", "vertical", "unscaled"])
def test_bytes_are_the_nodes(geometry: StereoGeometry, frame_id: str) -> None:
    p = products(geometry, frame_id, whole=frame_id == "l")
    mine = {message.topic: message for message in frame_messages(p, 7)}
    theirs = of_the_nodes(p)
    assert list(mine) == [f"/{topic}" for topic in theirs]
    for topic, message in theirs.items():
        assert mine[f"/{topic}"].type == type_name(message), topic
        assert mine[f"/{topic}"].data == ros_bytes(message), topic
        assert mine[f"/{topic}"].log_ns == 7
        deserialize_message(mine[f"/{topic}"].data, type(message))


def test_the_surface_has_corners() -> None:
    """Else the test above would compare markers without any."""
    assert len(products(HORIZONTAL).surface.faces) > 10


def test_an_empty_surface_deletes_the_one_before() -> None:
    p = products(HORIZONTAL)
    empty = replace(p.depth, depth=np.full_like(p.depth.depth, np.nan))
    p.depth = empty
    [marker] = frame_messages(p, 7, frozenset({"surface"}))
    assert marker.data == ros_bytes(surface_message(p.surface))


def test_topics_are_chosen_by_name() -> None:
    chosen = frozenset({"depth/image_rect", "points2_filtered"})
    assert {m.topic for m in frame_messages(products(HORIZONTAL), 7, chosen)} == {
        "/depth/image_rect",
        "/points2_filtered",
    }
