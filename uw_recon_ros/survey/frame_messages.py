"""What the nodes would publish of a frame, as bytes for a bag: the same topics, the same bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from numpy.typing import NDArray

from uw_recon_ros.bags import QosProfile, RawMessage
from uw_recon_ros.bags.messages import MAKE, encode, encode_surface
from uw_recon_ros.messages.cameras import rectified_infos
from uw_recon_ros.messages.clouds import cloud_message, depth_messages
from uw_recon_ros.messages.disparities import disparity_message, sigma_message, status_message
from uw_recon_ros.messages.headers import header
from uw_recon_ros.messages.images import image_message
from uw_recon_ros.pipeline import Products

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
    head = header(MAKE, enhanced.stamp_ns, enhanced.frame_id)

    def made(make: Callable[..., Any], *of: Any) -> Make:
        return lambda: encode(make(MAKE, *of))

    def image(array: NDArray[Any]) -> Make:
        return made(image_message, array, head)

    makers: dict[str, Make] = {
        "left/image_matching": image(enhanced.left_matching),
        "right/image_matching": image(enhanced.right_matching),
        "left/image_enhanced": image(enhanced.left),
        "right/image_enhanced": image(enhanced.right),
        "rectified/left/camera_info": lambda: encode(rectified_infos(MAKE, rectified)[0]),
        "rectified/right/camera_info": lambda: encode(rectified_infos(MAKE, rectified)[1]),
        "rectified/left/image_rect_color": image(rectified.left),
        "rectified/right/image_rect_color": image(rectified.right),
        "rectified/left/image_rect": image(rectified.left_matching),
        "rectified/right/image_rect": image(rectified.right_matching),
        "disparity/status": made(status_message, disparity),
        "disparity/sigma": made(sigma_message, disparity),
        "disparity": made(disparity_message, disparity),
    }
    if depth.geometry.metric:
        makers |= {
            "depth/camera_info": lambda: encode(depth_messages(MAKE, depth)[2]),
            "depth/sigma": image(depth.sigma),
            "depth/image_rect": image(depth.depth),
            "points2": lambda: encode(cloud_message(MAKE, products.cloud)),
            "points2_filtered": lambda: encode(cloud_message(MAKE, products.thinned)),
        }
    else:
        makers["points_unscaled"] = lambda: encode(cloud_message(MAKE, products.cloud))
    makers["surface"] = lambda: encode_surface(products.surface)
    return makers
