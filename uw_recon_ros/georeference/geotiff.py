"""GeoTIFF (OGC 19-008r4) by tifffile alone: place, cell size, coordinate system and nodata in tags."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.errors import ReconError

_ASCII, _SHORT, _DOUBLE = 2, 3, 12
_PROJECTED, _USER_DEFINED, _PIXEL_IS_AREA, _METRE = 1, 32767, 1, 9001
LOCAL = "local engineering, m"


@dataclass(frozen=True)
class Place:
    """Where a raster lies.

    Parameters
    ----------
    west, north : float
        Outer edges of the first cell, world coordinates.
    cell : float
    epsg : int or None
        Of the projected coordinate system; None: a local engineering one.
    local : str
        What the local one is called; any other name than `LOCAL` is not in metres.
    """

    west: float
    north: float
    cell: float
    epsg: int | None = None
    local: str = LOCAL


def geo_keys(place: Place) -> tuple[tuple[int, ...], str]:
    """The key directory (tag 34735), and the texts it points to (tag 34737)."""
    texts = f"{place.local}|"
    keys, unit = [(1025, 0, 1, _PIXEL_IS_AREA)], [(3076, 0, 1, _METRE)] if place.local == LOCAL else []
    if place.epsg is None:
        keys = [(1024, 0, 1, _USER_DEFINED), *keys, (1026, 34737, len(texts), 0), *unit]
    else:
        keys = [(1024, 0, 1, _PROJECTED), *keys, (3072, 0, 1, place.epsg), (3076, 0, 1, _METRE)]
    return (1, 1, 1, len(keys), *(x for key in keys for x in key)), texts


def geotiff(cells: NDArray[Any], place: Place, nodata: str | None = None) -> bytes:
    """A raster as the bytes of a GeoTIFF, the same each time.

    Parameters
    ----------
    cells : (H, W) float32, or (H, W, 4) uint8
        Row 0 in the north; RGB and alpha (0 = nothing there).
    place : Place
    nodata : str or None
        What stands where there is nothing, e.g. ``nan``.

    Raises
    ------
    ReconError
        tifffile is not installed.
    """
    try:
        import tifffile
    except ImportError as error:
        raise ReconError("GeoTIFF: expected tifffile to be installed: pip install tifffile") from error
    directory, texts = geo_keys(place)
    tags: list[tuple[int, int, int, Any, bool]] = [
        (33550, _DOUBLE, 3, (place.cell, place.cell, 0.0), True),
        (33922, _DOUBLE, 6, (0.0, 0.0, 0.0, place.west, place.north, 0.0), True),
        (34735, _SHORT, len(directory), directory, True),
    ]
    if place.epsg is None:
        tags.append((34737, _ASCII, len(texts) + 1, texts, True))
    if nodata is not None:
        tags.append((42113, _ASCII, len(nodata) + 1, nodata, True))
    stream = BytesIO()
    color: dict[str, Any] = {"photometric": "minisblack"}
    if cells.ndim == 3:
        color = {"photometric": "rgb", "extrasamples": ["unassalpha"]}
    tifffile.imwrite(
        stream, np.ascontiguousarray(cells), compression="zlib", tile=(256, 256), metadata=None,
        software="uw_recon_ros", extratags=tags, **color,
    )  # fmt: skip
    return stream.getvalue()
