"""What the nodes would publish of a frame, as bytes for a bag: the same topics, the same bytes.

The nodes make these messages with ROS's own classes, which a survey does not have: see `uw_recon_ros.survey.wire`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from numpy.typing import NDArray

from uw_recon_ros.bags import QosProfile, RawMessage, messages
from uw_recon_ros.survey.products import Products
from uw_recon_ros.survey.wire import (
    cloud_bytes,
    disparity_bytes,
    ideal_camera,
    info_bytes,
    rectified_cameras,
    surface_bytes,
)

#: Late subscribers get the last surface.
LATCHED = QosProfile(depth=1, durability="transient_local")
Make = Callable[[], tuple[str, bytes]]


def frame_messages(products: Products, log_ns: int, chosen: frozenset[str] = frozenset()) -> Iterator[RawMessage]:
    """Yield the nodes' messages of one frame, in the order in which the nodes publish them.

    Parameters
    ----------
    products : Products
    log_ns : int
        When the pair was recorded, ns.
    chosen : frozenset of str
        Topics to make; empty: all.
    """
    for topic, make in _makers(products).items():
        if not chosen or topic in chosen:
            kind, data = make()
            yield RawMessage(f"/{topic}", kind, log_ns, data)


def _makers(products: Products) -> dict[str, Make]:
    enhanced, rectified = products.enhanced, products.rectified
    disparity, depth = products.disparity, products.depth
    head: dict[str, Any] = {"time_ns": enhanced.stamp_ns, "frame_id": enhanced.frame_id}

    def image(array: NDArray[Any]) -> Make:
        return lambda: messages.encode(messages.image_message(array, **head))

    makers: dict[str, Make] = {
        "left/image_matching": image(enhanced.left_matching),
        "right/image_matching": image(enhanced.right_matching),
        "left/image_enhanced": image(enhanced.left),
        "right/image_enhanced": image(enhanced.right),
        "rectified/left/camera_info": lambda: info_bytes(*rectified_cameras(rectified)[0], head),
        "rectified/right/camera_info": lambda: info_bytes(*rectified_cameras(rectified)[1], head),
        "rectified/left/image_rect_color": image(rectified.left),
        "rectified/right/image_rect_color": image(rectified.right),
        "rectified/left/image_rect": image(rectified.left_matching),
        "rectified/right/image_rect": image(rectified.right_matching),
        "disparity/status": image(disparity.status),
        "disparity/sigma": image(disparity.sigma),
        "disparity": lambda: disparity_bytes(disparity, head),
    }
    if depth.geometry.metric:
        camera = ideal_camera(depth.geometry.intrinsics_left, depth.depth.shape)
        makers |= {
            "depth/camera_info": lambda: info_bytes(camera, None, head),
            "depth/sigma": image(depth.sigma),
            "depth/image_rect": image(depth.depth),
            "points2": lambda: cloud_bytes(products.cloud),
            "points2_filtered": lambda: cloud_bytes(products.thinned),
        }
    else:
        makers["points_unscaled"] = lambda: cloud_bytes(products.cloud)
    makers["surface"] = lambda: surface_bytes(products.surface)
    return makers
