"""What an inspection of a recording finds."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np

from uw_recon_ros.bags.model import TopicInfo
from uw_recon_ros.findings import Finding

CalibrationState = Literal["none", "zero", "inconsistent", "consistent", "metric"]


@dataclass
class CameraImages:
    """The images of one camera.

    Parameters
    ----------
    topic : str
        Or folder, or file.
    info_topic : str or None
        Its CameraInfo.
    stamps_ns : list of int
        Header stamps as recorded.
    frame_id, encoding : str
        Of the first image; a CompressedImage's format.
    width, height : int
        Of the first image, px; 0 when it cannot be decoded.
    kind : str
        Of the first image, as ``colour, 8 bits``; empty when it cannot be decoded.
    odd : int
        Images of another size or encoding than the first.
    unreadable : list of str
        Why files cannot be read, one each.
    problem : str
        Why the first image cannot be decoded; empty when it can.
    before_key : int
        Packets of video before the first key frame, which have no image.
    rectified : bool
        Whether the images come rectified already, so that P alone describes them.
    """

    topic: str
    info_topic: str | None
    stamps_ns: list[int] = field(default_factory=list, repr=False)
    frame_id: str = ""
    encoding: str = ""
    width: int = 0
    height: int = 0
    kind: str = ""
    odd: int = 0
    problem: str = ""
    rectified: bool = False
    unreadable: list[str] = field(default_factory=list)
    before_key: int = 0

    @property
    def backwards(self) -> int:
        """How many stamps are older than the one before."""
        return int((np.diff(np.array(self.stamps_ns, np.int64)) < 0).sum())


@dataclass(frozen=True)
class RecordingInfo:
    """What `inspect_recording` found.

    Parameters
    ----------
    path : str
    start_ns, end_ns : int
        First and last log time; of stills and videos, stamp.
    kind : {'bag', 'stills', 'video'}
    topics : tuple of TopicInfo
        Of a bag.
    left, right : CameraImages or None
        None where there is no stereo pair.
    pairs : int
        Left and right images of one stamp.
    rate_hz : float
        Of the pairs, from the median interval; NaN with fewer than two.
    largest_gap_s : float
        Longest time between pairs; NaN with fewer than two.
    gaps : int
        Intervals of more than 2.5 times the median.
    stamp_offset_s : float
        Median distance from a left stamp to the nearest right one; NaN without images.
    calibration : {'none', 'zero', 'inconsistent', 'consistent', 'metric'}
        No CameraInfo; all zeros; contradictory; without scale; with scale.
    baseline_m : float
        NaN unless `calibration` is ``metric``.
    calibration_findings : tuple of Finding
        What is wrong with it, by codes.
    damage : tuple of str
        What could not be read.
    reasons : tuple of str
        Why it cannot be reconstructed; empty when it can.
    warnings : tuple of str
        What to know besides.
    """

    path: str
    start_ns: int
    end_ns: int
    topics: tuple[TopicInfo, ...] = ()
    kind: str = "bag"
    left: CameraImages | None = None
    right: CameraImages | None = None
    pairs: int = 0
    rate_hz: float = float("nan")
    largest_gap_s: float = float("nan")
    gaps: int = 0
    stamp_offset_s: float = float("nan")
    calibration: CalibrationState = "none"
    baseline_m: float = float("nan")
    calibration_findings: tuple[Finding, ...] = ()
    damage: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def reconstructable(self) -> bool:
        """Whether nothing speaks against it."""
        return not self.reasons

    def as_dict(self) -> dict[str, Any]:
        """For JSON: as the fields, stamps left out, NaN as None."""
        found = asdict(self) | {"reconstructable": self.reconstructable}
        for name in ("left", "right"):
            if found[name] is not None:
                found[name]["images"] = len(found[name].pop("stamps_ns"))
        found["calibration_findings"] = [finding.as_dict() for finding in self.calibration_findings]
        nan = {name: None for name, value in found.items() if isinstance(value, float) and not math.isfinite(value)}
        return found | nan

    def __str__(self) -> str:
        """The findings as lines of text."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        seconds = (self.end_ns - self.start_ns) * 1e-9
        held = f"{sum(topic.count for topic in self.topics)} messages" if self.kind == "bag" else self.kind
        yield f"{self.path}: {seconds:.1f} s, {held}"
        width = max((len(topic.name) for topic in self.topics), default=0)
        for topic in self.topics:
            yield f"  {topic.name:{width}}  {topic.count:6d}  {topic.type}"
        for name, side in (("left", self.left), ("right", self.right)):
            if side is not None:
                yield (
                    f"{name}: {side.topic}, {len(side.stamps_ns)} images {side.width}x{side.height} {side.encoding}"
                    + (", already rectified: described by P alone" if side.rectified else "")
                )
        if self.left is not None:
            rate = "rate unknown" if math.isnan(self.rate_hz) else f"{self.rate_hz:.2f} Hz"
            gap = "" if math.isnan(self.largest_gap_s) else f", longest gap {self.largest_gap_s:.2f} s"
            yield f"pairs: {self.pairs} at {rate}{gap}"
            scale = f", baseline {self.baseline_m:.4f} m" if self.calibration == "metric" else ""
            yield f"calibration: {self.calibration}{scale}"
        yield from (f"damage: {sentence}" for sentence in self.damage)
        yield from (f"warning: {sentence}" for sentence in self.warnings)
        yield from (f"cannot be reconstructed: {sentence}" for sentence in self.reasons)
        if self.reconstructable:
            yield "can be reconstructed" + ("" if self.calibration == "metric" else ", scale unknown")
