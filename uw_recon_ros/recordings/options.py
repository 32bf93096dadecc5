"""What can be said of a recording that it does not say itself."""

from __future__ import annotations

from dataclasses import dataclass

from uw_recon_ros.pairing import PAIR_TOLERANCE_MS


def is_clock_offset(text: str) -> bool:
    """Whether it is what `Options.clock_offset` may be."""
    try:
        return text == "auto" or abs(float(text)) < 1e9
    except ValueError:
        return False


@dataclass(frozen=True)
class Options:
    """How a recording is listed.

    Parameters
    ----------
    left_topic, right_topic : str
        Image topics; empty: found by type and name.
    pair_tolerance_ms : float
        Largest difference of stamps within a pair, ms.
    stills_rate : float
        Pairs a second of stills that carry no time, Hz.
    layout : str
        How both views lie in one image, one of `layout.LAYOUTS`; ``auto``: found.
    clock_offset : str
        Seconds that the right camera's clock is ahead of the left one's; ``auto``: found from the images of two
        videos, 0 elsewhere.
    """

    left_topic: str = ""
    right_topic: str = ""
    pair_tolerance_ms: float = PAIR_TOLERANCE_MS
    stills_rate: float = 2.0
    layout: str = "auto"
    clock_offset: str = "auto"

    @property
    def offset_ns(self) -> int | None:
        """The offset told, ns; None: to be found."""
        return None if self.clock_offset == "auto" else round(float(self.clock_offset) * 1e9)
