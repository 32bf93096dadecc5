"""What a page is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from uw_recon_ros.report.colors import ColorBar
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import ByteImage, Matrix, Surface

Reason = tuple[tuple[int, int, int], str, float]
LARGEST_CLICKABLE = 4_000_000  #: pixels; a page carries up to four bytes for each


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
class Layer:
    """A number at every vertex of a surface, shown as a colour.

    Parameters
    ----------
    name : str
        Of the button.
    values : (N,) float
    bar : ColorBar
    """

    name: str
    values: Matrix
    bar: ColorBar


@dataclass(frozen=True, eq=False)
class Track:
    """A line in the 3-D view.

    Parameters
    ----------
    points : (N, 3) float64
        In the surface's frame.
    color : (int, int, int)
        RGB.
    words : str
        What it means.
    """

    points: Matrix
    color: tuple[int, int, int]
    words: str


@dataclass(frozen=True, eq=False)
class Overlay:
    """What the 3-D view shows beside the surface.

    Parameters
    ----------
    layers : sequence of Layer
    tracks : sequence of Track
    upright : bool
        Whether the surface's third axis points up, as a world's; else forward, as a camera's.
    """

    layers: Sequence[Layer] = ()
    tracks: Sequence[Track] = ()
    upright: bool = False

    @property
    def kinds(self) -> list[tuple[tuple[int, int, int], str]]:
        """Colours of the tracks and what they mean, each once."""
        return list(dict.fromkeys((track.color, track.words) for track in self.tracks))


@dataclass(frozen=True, eq=False)
class MapLayer:
    """A picture of the map.

    Parameters
    ----------
    name : str
        Of the button.
    image : (H, W, 4) uint8
        RGB and opacity, north up; all layers of a map have one size.
    bar : ColorBar or None
        Its legend.
    """

    name: str
    image: ByteImage
    bar: ColorBar | None = None


@dataclass(frozen=True, eq=False)
class Map:
    """Pictures from above that lengths can be measured on.

    Parameters
    ----------
    layers : sequence of MapLayer
        At least one.
    pixel : float
        Side of a pixel, in `unit`.
    west, north : float
        Outer corner of the top-left pixel, in `unit`.
    unit : str
    up : str
        A sentence's beginning: what lies upwards on it.
    """

    layers: Sequence[MapLayer]
    pixel: float
    west: float
    north: float
    unit: str
    up: str = "North is up"


@dataclass(frozen=True, eq=False)
class Clickable:
    """A view in which lengths, heights and areas are measured by clicks, as ``uw_recon measure`` does.

    Parameters
    ----------
    frame : DisparityFrame
    name : str
        Of the frame, as results tell it.
    calibration : sequence of (range_m, fraction)
        Relative standard deviation of depth by the calibration; empty: not known.
    reliable : bool
    """

    frame: DisparityFrame
    name: str
    calibration: Sequence[tuple[float, float]] = ()
    reliable: bool = True

    @property
    def shown(self) -> bool:
        """Whether the page carries it: there is depth, and not more of it than a page can."""
        return bool(np.isfinite(self.frame.disparity).any()) and self.frame.disparity.size <= LARGEST_CLICKABLE


@dataclass(frozen=True, eq=False)
class Measured:
    """A table of what is measured by clicks in a model's 3-D view and map, as ``uw_recon measure`` does.

    Parameters
    ----------
    name : str
        By which sections with a view or a map call it their `ruler`; unique on a page.
    told : mapping
        What ``measure.json`` of the model holds.
    """

    name: str
    told: Mapping[str, Any]


def clicks_section(clickable: Clickable) -> Section:
    """A section in which people measure."""
    text = (
        "In the enhanced left view, as rectified. Each result has its standard deviation, by the disparities, by how "
        "well clicks hit, and by the calibration where its report was given. Ends on a silhouette are taken from the "
        "surface that the segment lies on. The numbers are those of uw_recon measure."
    )
    return Section("Measure", text, clickable=clickable)


@dataclass(frozen=True, eq=False)
class Section:
    """A heading with text, a 3-D view, a map, figures and a table.

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
    overlay : Overlay
        What the view shows beside it.
    map : Map or None
    clickable : Clickable or None
    measured : Measured or None
    ruler : str
        Name of the `Measured` that clicks in the view and the map of this section go to; empty: none.
    """

    title: str = ""
    text: str = ""
    figures: Sequence[Figure] = ()
    rows: Sequence[Sequence[str]] = ()
    header: Sequence[str] = ()
    surface: Surface | None = None
    overlay: Overlay = Overlay()
    map: Map | None = None
    clickable: Clickable | None = None
    measured: Measured | None = None
    ruler: str = ""

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
