"""What a model of the dive needs of a frame, in one file: enhanced left view, disparity, how sure it is, geometry."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.errors import BagError, ReconError
from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.files.packed import pack, unpack
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import FloatImage, StereoGeometry

KEPT = "model_frames"
_SUFFIX = ".frame"
_METRIC, _UNSCALED = b"m", b"b"  # the file's first byte: whether lengths are metres, without unpacking it


@dataclass(frozen=True, eq=False)
class _Packed:
    stamp_ns: int
    picture: NDArray[np.uint8]
    sigma: NDArray[np.float16]
    disparity: FloatImage
    geometry: StereoGeometry


def write_kept(path: str | Path, frame: DisparityFrame) -> None:
    """Write it, the picture without loss; sigma has three digits."""
    done, picture = cv2.imencode(".png", cv2.cvtColor(frame.left, cv2.COLOR_RGB2BGR))
    if not done:
        raise ReconError(f"{path}: the left view could not be encoded")
    packed = _Packed(
        frame.stamp_ns, np.asarray(picture, np.uint8).ravel(), frame.sigma.astype(np.float16), frame.disparity,
        frame.geometry,
    )  # fmt: skip
    write_bytes(path, (_METRIC if frame.geometry.metric else _UNSCALED) + zlib.compress(pack(packed), 3))


def is_metric(path: str | Path) -> bool:
    """Whether a kept frame's lengths are metres; reads one byte.

    Raises
    ------
    BagError
        It cannot be read.
    """
    try:
        with Path(path).open("rb") as stream:
            return stream.read(1) == _METRIC
    except OSError as error:
        raise BagError(f"{path}: expected a frame that a survey kept, got: {error}") from error


def read_kept(path: str | Path) -> DisparityFrame:
    """Read what `write_kept` wrote.

    Raises
    ------
    BagError
        It cannot be read, or is damaged.
    """
    try:
        packed = unpack(zlib.decompress(Path(path).read_bytes()[1:]), (_Packed, StereoGeometry))
        picture = cv2.imdecode(packed.picture, cv2.IMREAD_COLOR)
        if picture is None:
            raise ValueError("its picture is damaged")
    except (OSError, zlib.error, ValueError, KeyError, EOFError) as error:
        raise BagError(f"{path}: expected a frame that a survey kept, got: {error}") from error
    left = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)
    return DisparityFrame(packed.stamp_ns, left, packed.disparity, packed.sigma.astype(np.float32), packed.geometry)


def kept_name(name: str) -> str:
    """Path inside the survey's folder of the frame that is called `name`."""
    return f"{KEPT}/{name}{_SUFFIX}"
