"""The output bag: what the nodes would publish of a frame (same topics, same bytes), put together when all are done."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from uw_recon_ros.bags import BagWriter, QosProfile, RawMessage, open_bag
from uw_recon_ros.bags.messages import MAKE, encode, encode_surface
from uw_recon_ros.files.atomic import write_json
from uw_recon_ros.messages.cameras import rectified_infos
from uw_recon_ros.messages.clouds import cloud_message, depth_messages
from uw_recon_ros.messages.disparities import confidence_message, disparity_message, sigma_message, status_message
from uw_recon_ros.messages.headers import header
from uw_recon_ros.messages.images import image_message
from uw_recon_ros.pipeline import Products
from uw_recon_ros.survey.store import BAG_PARTS, Store, frame_name

BAG = "bag"
_DONE = "bag.json"
_LATCHED_TOPICS = frozenset({"/surface"})
Watch = Callable[[Iterable[Path]], Iterable[Path]]
#: Late subscribers get the last surface.
LATCHED = QosProfile(depth=1, durability="transient_local")
Make = Callable[[], tuple[str, bytes]]


def frame_messages(products: Products, log_ns: int, chosen: frozenset[str] = frozenset()) -> Iterator[RawMessage]:
    """Yield the nodes' messages of one frame, in the order in which the nodes publish them.

    All but ``disparity/effort``: a survey spends on each frame what its report says.

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
        "disparity/confidence": made(confidence_message, disparity),
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


def is_assembled(store: Store) -> bool:
    """Whether the bag is complete, so that no frame's share is needed any more."""
    return (store.state / _DONE).is_file() and (store.root / BAG).is_dir()


def assemble(store: Store, numbers: list[int], watch: Watch = iter) -> None:
    """Write the bag from the shares of frames, then remove these.

    Parameters
    ----------
    store : Store
    numbers : list of int
        Of the frames, in order.
    watch : callable
        Given the shares, yields them while it shows how far it is.

    Raises
    ------
    BagError
        It cannot be written.
    """
    parts = store.root / BAG_PARTS
    if not is_assembled(store) and numbers:
        (store.state / _DONE).unlink(missing_ok=True)
        with BagWriter(store.root / BAG, overwrite=True) as writer:
            for part in watch([parts / f"{frame_name(number)}.mcap" for number in numbers]):
                _copy(part, writer)
        write_json(store.state / _DONE, {"frames": len(numbers)})
    shutil.rmtree(parts, ignore_errors=True)


def _copy(part: Path, writer: BagWriter) -> None:
    with open_bag(part) as share:
        for message in share.raw_messages():
            if message.topic in _LATCHED_TOPICS:
                writer.raw(message, [LATCHED])
            else:
                writer.raw(message)
