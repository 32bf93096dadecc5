"""`bag_info`: what a bag holds, and whether a surface can be reconstructed from it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from uw_recon_ros.bags import messages
from uw_recon_ros.bags.contents import BagInfo, CameraImages
from uw_recon_ros.bags.model import RawMessage, plain
from uw_recon_ros.bags.reader import BagReader, open_bag
from uw_recon_ros.bags.stereo import CameraInfoCache, StereoTopics
from uw_recon_ros.bags.verdict import judge, judge_calibration
from uw_recon_ros.bags.video_packets import image_of
from uw_recon_ros.errors import BagError, ReconError
from uw_recon_ros.pairing import PAIR_TOLERANCE_MS, align

_TOLERANCE_NS = round(PAIR_TOLERANCE_MS * 1e6)


def bag_info(
    path: str | Path,
    left: str | None = None,
    right: str | None = None,
    *,
    tolerance_ns: int = _TOLERANCE_NS,
    images_rectified: str = "auto",
) -> BagInfo:
    """Read a whole bag and judge it.

    Parameters
    ----------
    path : path
    left, right : str or None
        Image topics; None = found by type and name.
    tolerance_ns : int
        Largest difference of stamps within a pair, ns.
    images_rectified : {'auto', 'yes', 'no'}
        Whether the images come rectified; auto: by the names of their topics.

    Raises
    ------
    BagError
        Nothing in it can be read, or it has no topic of a given name.
    """
    with open_bag(path) as bag:
        try:
            topics = bag.stereo_topics(left, right)
        except BagError as error:
            if left or right:
                raise
            return _without_pairs(bag, str(error))
        return _inspect(bag, topics, tolerance_ns, topics.rectified(images_rectified))


def _without_pairs(bag: BagReader, reason: str) -> BagInfo:
    for _ in bag.raw_messages():  # for the damage
        pass
    damage = tuple(bag.damage)
    return BagInfo(str(bag.path), bag.start_ns, bag.end_ns, tuple(bag.topics), damage=damage, reasons=(reason,))


def _inspect(bag: BagReader, topics: StereoTopics, tolerance_ns: int, rectified: tuple[bool, bool]) -> BagInfo:
    sides = (
        CameraImages(topics.left, topics.left_info, rectified=rectified[0]),
        CameraImages(topics.right, topics.right_info, rectified=rectified[1]),
    )
    infos = CameraInfoCache(rectified[0]), CameraInfoCache(rectified[1])
    takers: dict[str, Callable[[RawMessage], None]] = {}
    for side, cache in zip(sides, infos, strict=True):
        takers[side.topic] = _image_taker(side)
        if side.info_topic:
            takers[side.info_topic] = cache.update
    for raw in bag.raw_messages(takers):
        try:
            takers[raw.topic](raw)
        except BagError as error:
            bag.note(str(error))
    numbers = _pair_numbers(sides[0].stamps_ns, sides[1].stamps_ns, tolerance_ns)
    state, baseline, findings = judge_calibration(infos, (sides[0].width, sides[0].height))
    found = BagInfo(
        str(bag.path), bag.start_ns, bag.end_ns, tuple(bag.topics), *sides, **numbers, calibration=state,
        baseline_m=baseline, calibration_findings=findings, damage=tuple(bag.damage),
    )  # fmt: skip
    return judge(found, changes=max(cache.changes for cache in infos))


def _image_taker(side: CameraImages) -> Callable[[RawMessage], None]:
    def take(raw: RawMessage) -> None:
        image = messages.decode(raw)
        if not side.stamps_ns:
            _describe_first(side, image)
        elif _differs(side, image):
            side.odd += 1
        side.stamps_ns.append(messages.stamp_ns(image))

    return take


def _describe_first(side: CameraImages, image: Any) -> None:
    side.frame_id = plain(image.header.frame_id if hasattr(image, "header") else image.frame_id)
    side.encoding = plain(getattr(image, "encoding", "") or getattr(image, "format", ""))
    try:
        shown = image_of(image)
    except ReconError as error:
        side.problem = str(error)
        return
    side.height, side.width = shown.shape[:2]
    side.kind = f"{'colour' if shown.ndim == 3 else 'mono'}, {8 * shown.itemsize} bits"


def _differs(side: CameraImages, image: Any) -> bool:
    if not hasattr(image, "step"):
        return plain(getattr(image, "format", "") or getattr(image, "encoding", "")) != side.encoding
    whole = 2 * len(image.data) in (2 * image.step * image.height, 3 * image.step * image.height)  # YUV 4:2:0
    return not whole or (image.width, image.height, plain(image.encoding)) != (side.width, side.height, side.encoding)


def _pair_numbers(left: list[int], right: list[int], tolerance_ns: int) -> dict[str, Any]:
    """The fields of `BagInfo` that follow from the stamps."""
    in_order = sorted(left), sorted(right)
    groups, _ = align(in_order, tolerance_ns)
    intervals = np.diff(np.array([in_order[0][i] for i, _ in groups], np.int64)) * 1e-9
    numbers: dict[str, Any] = {"pairs": len(groups), "stamp_offset_s": _nearest_offset(*in_order)}
    if intervals.size:
        typical = np.float64(np.median(intervals))
        numbers["rate_hz"] = float(1.0 / typical) if typical > 0 else float("nan")
        numbers["largest_gap_s"] = float(intervals.max())
        numbers["gaps"] = int((intervals > 2.5 * typical).sum())
    return numbers


def _nearest_offset(left: list[int], right: list[int]) -> float:
    if not left or not right:
        return float("nan")
    ours, theirs = np.array(left, np.int64), np.array(right, np.int64)
    after = np.searchsorted(theirs, ours).clip(0, len(theirs) - 1)
    before = (after - 1).clip(0)
    return float(np.median(np.minimum(abs(theirs[after] - ours), abs(theirs[before] - ours)))) * 1e-9
