"""Disparity maps as files: PFM as Middlebury writes it, float TIFF, and PNG as KITTI writes it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from uw_recon_ros.bounds import LARGEST_IMAGE_FILE
from uw_recon_ros.errors import ImageError
from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.files.bounded import read_bounded
from uw_recon_ros.files.images import decode_any, write_image
from uw_recon_ros.types import FloatImage

_PNG_STEPS = 256  # to the px, as KITTI counts


def read_disparity(path: str | Path) -> FloatImage:
    """Read a PFM or float TIFF disparity map; not finite or negative infinity = NaN.

    Raises
    ------
    ImageError
    """
    try:
        image = decode_any(read_bounded(path, LARGEST_IMAGE_FILE, ImageError))
    except ImageError as error:
        raise ImageError(f"{path}: expected a one-channel float32 PFM or TIFF: {error}") from error
    if image.ndim != 2 or image.dtype != np.float32:
        raise ImageError(f"{path}: expected a one-channel float32 PFM or TIFF, got {image.dtype} {image.shape}")
    finite: FloatImage = np.where(np.isfinite(image), image, np.float32(np.nan))
    return finite


def write_pfm(path: str | Path, disparity: FloatImage) -> None:
    """Write a disparity map as Middlebury's PFM: invalid (NaN) = ``inf``, whole file or none."""
    rows = np.where(np.isfinite(disparity), disparity, np.float32(np.inf)).astype("<f4")
    header = f"Pf\n{rows.shape[1]} {rows.shape[0]}\n-1.0\n"  # negative scale: little-endian; rows go bottom-up
    write_bytes(path, header.encode() + rows[::-1].tobytes())


def _write_png(path: Path, disparity: FloatImage) -> None:
    known = np.isfinite(disparity)
    steps = np.round(np.where(known, disparity, 0) * _PNG_STEPS)
    if known.any() and not (steps[known].min() >= 1 and steps[known].max() < 2**16):
        low, high = disparity[known].min(), disparity[known].max()
        raise ImageError(f"{path}: a PNG holds disparities over 0 and under 256 px, got {low:g} to {high:g}: use .pfm")
    write_image(path, steps.astype(np.uint16))


_WRITERS: dict[str, Callable[[Path, FloatImage], None]] = {
    ".pfm": write_pfm,
    ".tif": write_image,
    ".tiff": write_image,
    ".png": _write_png,
}


def check_disparity_format(path: str | Path) -> None:
    """Raise `ImageError` where `write_disparity` knows no such format."""
    if Path(path).suffix.lower() not in _WRITERS:
        raise ImageError(f"{path}: expected a name that ends in {', '.join(_WRITERS)}, got {Path(path).suffix!r}")


def write_disparity(path: str | Path, disparity: FloatImage) -> None:
    """Write a disparity map in the format that the name says.

    Parameters
    ----------
    path : path
        ``.pfm`` (invalid = inf), ``.tif(f)`` (float32, invalid = NaN), ``.png`` (uint16, 256 times px, invalid = 0).
    disparity : (H, W) float32
        px; NaN = invalid.

    Raises
    ------
    ImageError
        Another format, or disparities that a PNG cannot hold.
    """
    check_disparity_format(path)
    _WRITERS[Path(path).suffix.lower()](Path(path), disparity)
