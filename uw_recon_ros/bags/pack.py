"""`pack`: two folders of stills become a rosbag2 MCAP bag."""

from __future__ import annotations

import glob
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from uw_recon_ros.bags.files import natural_order
from uw_recon_ros.bags.writer import BagWriter
from uw_recon_ros.errors import BagError
from uw_recon_ros.files.images import read_image
from uw_recon_ros.system_errors import told_as
from uw_recon_ros.types import RawImage, StereoCalibration

Pair = tuple[Path, Path]

LEFT_FRAME = "stereo_left_optical_frame"
RIGHT_FRAME = "stereo_right_optical_frame"
_IMAGES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".ppm", ".webp"}
_FIRST_NS = 1_000_000_000  # zero stamps would look like forgotten ones


def pack(
    left: str,
    right: str,
    bag: str | Path,
    *,
    calibration: StereoCalibration | None = None,
    rate_hz: float = 2.0,
    overwrite: bool = False,
    progress: Callable[[list[Pair]], Iterable[Pair]] = iter,
) -> int:
    """Write a bag of image files, bits unchanged: ``/left/image_raw``, ``/right/image_raw`` and, with a calibration,
    ``/left/camera_info``, ``/right/camera_info``.

    Parameters
    ----------
    left, right : str
        Glob patterns or folders; sorted as people count (2 before 10) and paired by order.
    bag : path
        Folder to make; with the suffix ``.mcap`` a bare file.
    calibration : StereoCalibration, optional
    rate_hz : float
        Pairs a second; the first stamp is 1 s.
    overwrite : bool
        Whether to replace a bag that stands there.
    progress : callable, optional
        Given the list of pairs, yields them one by one while it shows how far it is.

    Returns
    -------
    int
        Number of pairs.

    Raises
    ------
    BagError
        No files, different counts or sizes, a frame missing on one side, a name that is taken.
    ImageError
        A file that is no image.
    """
    if not rate_hz > 0:
        raise ValueError(f"rate_hz: expected > 0 Hz, got {rate_hz}")
    pairs = _matched(find_images(left), find_images(right), left, right)
    frames = LEFT_FRAME, RIGHT_FRAME
    if calibration is not None:
        frames = calibration.left.frame_id or LEFT_FRAME, calibration.right.frame_id or RIGHT_FRAME
    with BagWriter(bag, overwrite=overwrite) as writer:
        first: RawImage | None = None
        for index, paths in enumerate(progress(pairs)):
            time_ns = _FIRST_NS + round(index * 1e9 / rate_hz)
            images = read_image(paths[0]), read_image(paths[1])
            first = images[0] if first is None else first
            for side, path, image, frame in zip(("left", "right"), paths, images, frames, strict=True):
                _check(path, image, pairs[0][0], first, calibration)
                writer.image(f"/{side}/image_raw", image, time_ns=time_ns, frame_id=frame)
            if calibration is not None:
                writer.camera_info("/left/camera_info", calibration.left, time_ns=time_ns, frame_id=frames[0])
                writer.camera_info("/right/camera_info", calibration.right, time_ns=time_ns, frame_id=frames[1])
    return len(pairs)


def find_images(pattern: str) -> list[Path]:
    """Image files a glob pattern or folder names, in natural order.

    Raises
    ------
    BagError
        There are none.
    """
    with told_as(BagError, pattern, "image files"):
        paths = _images_at(Path(pattern).expanduser())
    if not paths:
        raise BagError(f"{pattern}: expected image files, found none")
    return sorted(paths, key=lambda path: (natural_order(path), str(path)))


def _images_at(folder: Path) -> list[Path]:
    if folder.is_dir():
        return [path for path in folder.iterdir() if path.suffix.lower() in _IMAGES]
    return [path for path in map(Path, glob.glob(str(folder), recursive=True)) if path.is_file()]


def _matched(left: list[Path], right: list[Path], left_name: str, right_name: str) -> list[Pair]:
    if len(left) != len(right):
        raise BagError(
            f"expected as many left as right images, got {len(left)} ({left_name}) and {len(right)} ({right_name})"
        )
    if {path.resolve() for path in left} & {path.resolve() for path in right}:
        raise BagError(f"left and right name the same files, e.g. {left[0]}")
    _check_numbering(left, right)
    return list(zip(left, right, strict=True))


def _check_numbering(left: Sequence[Path], right: Sequence[Path]) -> None:
    """Frames numbered alike that do not line up: one is missing on either side."""
    numbers = [[_last_number(path) for path in paths] for paths in (left, right)]
    common = {n for n in numbers[0] if n is not None} & {n for n in numbers[1] if n is not None}
    if 2 * len(common) < len(left):
        return  # numbered independently
    for a, b, number_a, number_b in zip(left, right, *numbers, strict=True):
        if number_a != number_b:
            raise BagError(f"pairs do not line up: {a.name} would meet {b.name}; is a frame missing on one side?")


def _last_number(path: Path) -> int | None:
    digits = re.findall(r"[0-9]+", path.stem)
    return int(digits[-1]) if digits else None


def _check(
    path: Path, image: RawImage, first_path: Path, first: RawImage, calibration: StereoCalibration | None
) -> None:
    if image.shape != first.shape or image.dtype != first.dtype:
        raise BagError(f"{path}: expected {_shape(first)} as {first_path.name}, got {_shape(image)}")
    camera = calibration.left if calibration is not None else None
    if camera is not None and (camera.height, camera.width) != image.shape[:2]:
        raise BagError(f"{path}: expected {camera.width}x{camera.height} px as in the calibration, got {_shape(image)}")


def _shape(image: RawImage) -> str:
    return (
        f"{image.shape[1]}x{image.shape[0]} px {'colour' if image.ndim == 3 else 'mono'} {8 * image.dtype.itemsize} bit"
    )
