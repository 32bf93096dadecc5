"""Maps as GeoTIFF (OGC 19-008), by tifffile alone: tiled, deflated, written tile by tile in bounded memory."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.georeference.crs import Crs

#: Side of the tiles, px.
TIFF_TILE = 128
_PIXEL_SCALE, _TIEPOINT, _KEYS, _ASCII_KEYS, _NODATA = 33550, 33922, 34735, 34737, 42113
_BIG = 3 * 2**30  # bytes, from which offsets need 64 bits
_METRE, _USER_DEFINED, _PROJECTED = 9001, 32767, 1


@dataclass(frozen=True)
class Placement:
    """Where a map lies.

    Parameters
    ----------
    west, north : float
        Outer corner of the top-left pixel in the coordinate system, m, origin included.
    pixel : float
        Ground sample distance, m.
    crs : Crs
    """

    west: float
    north: float
    pixel: float
    crs: Crs


def geo_keys(crs: Crs) -> tuple[list[int], str]:
    """Entries of the directory of keys (tag 34735), and the text they refer to (34737)."""
    name = f"{crs.text}|"
    raster = (1025, 0, 1, 1)  # a pixel is an area
    if crs.epsg is None:
        entries = [(1024, 0, 1, _USER_DEFINED), raster, (1026, 34737, len(name), 0)]
    else:
        entries = [(1024, 0, 1, _PROJECTED), raster, (1026, 34737, len(name), 0), (3072, 0, 1, crs.epsg)]
    entries += [(3076, 0, 1, _METRE)] if crs.metric else []
    return [1, 1, 0, len(entries), *(number for entry in entries for number in entry)], name


def tags_of(place: Placement, nodata: float | None) -> list[tuple[int, Any, int, Any, bool]]:
    """The tags that make a TIFF a GeoTIFF, as tifffile takes them."""
    keys, text = geo_keys(place.crs)
    tags: list[tuple[int, Any, int, Any, bool]] = [
        (_PIXEL_SCALE, "d", 3, (place.pixel, place.pixel, 0.0), True),
        (_TIEPOINT, "d", 6, (0.0, 0.0, 0.0, place.west, place.north, 0.0), True),
        (_KEYS, "H", len(keys), tuple(keys), True),
        (_ASCII_KEYS, "s", 0, text, True),
    ]
    return tags if nodata is None else [*tags, (_NODATA, "s", 0, f"{nodata:g}", True)]


def write_geotiff(
    path: str | Path, raster: NDArray[Any], place: Placement, *, nodata: float | None = None, alpha: bool = False,
    description: str = "",
) -> None:  # fmt: skip
    """Write a map, whole or not at all.

    Parameters
    ----------
    path : path
    raster : (H, W) or (H, W, C) uint8 or float32
        North up; may be mapped from a file, it is read tile by tile.
    place : Placement
    nodata : float, optional
        The value (NaN for floats) that means: nothing is known.
    alpha : bool
        Whether the last channel is one.
    description : str
        For people.
    """
    import tifffile  # loaded where it is needed: commands that write no map need not wait for it

    path = Path(path)
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    colour = raster.ndim == 3
    try:
        with tifffile.TiffWriter(partial, bigtiff=raster.nbytes > _BIG) as writer:
            writer.write(
                _tiles(raster), shape=raster.shape, dtype=raster.dtype, tile=(TIFF_TILE, TIFF_TILE),
                photometric="rgb" if colour else "minisblack", planarconfig="contig" if colour else None,
                extrasamples=["unassalpha"] if alpha else None, compression="zlib", compressionargs={"level": 6},
                software=False, metadata=None, datetime=False, description=description or None,
                extratags=tags_of(place, nodata),
            )  # fmt: skip
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def _tiles(raster: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Row by row, those on the rim filled up with their own edge."""
    rows, columns = raster.shape[:2]
    for v in range(0, rows, TIFF_TILE):
        for u in range(0, columns, TIFF_TILE):
            yield _filled_up(np.ascontiguousarray(raster[v : v + TIFF_TILE, u : u + TIFF_TILE]))


def _filled_up(tile: NDArray[Any]) -> NDArray[Any]:
    missing = [(0, TIFF_TILE - tile.shape[0]), (0, TIFF_TILE - tile.shape[1]), (0, 0)][: tile.ndim]
    return np.pad(tile, missing, mode="edge")
