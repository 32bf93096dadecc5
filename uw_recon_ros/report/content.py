"""What a page is made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from uw_recon_ros.report.colors import ColorBar
from uw_recon_ros.types import ByteImage, Surface

Reason = tuple[tuple[int, int, int], str, float]


@dataclass(frozen=True, eq=False)
class Figure:
    """A picture with its caption.

    Parameters
    ----------
    image : (H, W, 3) uint8
        RGB.
    title, caption : str
        Plain text; the title is set in bold before the caption.
    bar : ColorBar or None
        Legend of a colour map.
    reasons : sequence of (colour, words, share)
        Legend of the invalid pixels, see `colors.reasons_in`.
    over : (H, W, 3) uint8 or None
        A second picture of the same size; a slider moves between it (left) and `image` (right).
    labels : (str, str)
        Of `over` and of `image`.
    wide : bool
        Over the full width of the page.
    """

    image: ByteImage
    title: str
    caption: str = ""
    bar: ColorBar | None = None
    reasons: Sequence[Reason] = ()
    over: ByteImage | None = None
    labels: tuple[str, str] = ("before", "after")
    wide: bool = False

    @property
    def lossless(self) -> bool:
        """Whether the picture is a colour map, whose colours are values."""
        return self.bar is not None


@dataclass(frozen=True, eq=False)
class Section:
    """A heading with text, a 3-D view, figures and a table.

    Parameters
    ----------
    title, text : str
    figures : sequence of Figure
    rows : sequence of sequences of str
        Table; the first cell of a row names it.
    header : sequence of str
        Of the table; empty: none.
    surface : Surface or None
        Shown in an interactive view; None or without triangles: no view.
    """

    title: str = ""
    text: str = ""
    figures: Sequence[Figure] = ()
    rows: Sequence[Sequence[str]] = ()
    header: Sequence[str] = ()
    surface: Surface | None = None

    @property
    def has_view(self) -> bool:
        """Whether there is a surface to show."""
        return self.surface is not None and len(self.surface.faces) > 0


@dataclass(frozen=True)
class Summary:
    """What stands on top of the page.

    Parameters
    ----------
    lead : str
        A sentence under the title.
    facts : sequence of (name, value)
        The few numbers that matter most.
    warnings : sequence of str
    alarms : sequence of str
        Why the result is not to be trusted; shown first, in red.
    """

    lead: str = ""
    facts: Sequence[tuple[str, str]] = ()
    warnings: Sequence[str] = ()
    alarms: Sequence[str] = ()
