"""The files of one frame, in the formats asked for."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from uw_recon_ros.bags import write_bag
from uw_recon_ros.errors import BagError
from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.files.disparities import write_pfm
from uw_recon_ros.files.images import write_image
from uw_recon_ros.files.laz import write_laz
from uw_recon_ros.files.meshes import write_glb, write_ply
from uw_recon_ros.findings import Severity, worst
from uw_recon_ros.pipeline import Products
from uw_recon_ros.report.content import Clickable, clicks_section
from uw_recon_ros.report.figures import colorize_disparity
from uw_recon_ros.report.page import Summary, render_page
from uw_recon_ros.survey.kept_frame import kept_name, write_kept
from uw_recon_ros.survey.output_bag import frame_messages
from uw_recon_ros.survey.params import SurveyParams
from uw_recon_ros.survey.store import BAG_PARTS, PREVIEWS, VIEWS, frame_name
from uw_recon_ros.types import ByteImage, FloatImage

_PREVIEW_HEIGHT = 120
_MM_LIMIT = 65535
_FIRST_DATE, _LAST_DATE = 946684800, 4102444800  # s: the years 2000 and 2100; other stamps are no dates

Write = Callable[[Path], None]


def frame_files(number: int, log_ns: int, products: Products, params: SurveyParams) -> dict[str, Write]:
    """What a frame leaves: path inside the output directory, and how to write it.

    Depth appears only where it is metric; a mesh only where there is a triangle.
    """
    name, wanted = frame_name(number), params.products
    files: dict[str, Write] = {f"{PREVIEWS}/{name}.jpg": lambda path: write_image(path, preview(products))}
    if "disparity" in wanted:
        files[f"disparity/{name}.{params.disparity_format}"] = lambda p: _write_floats(p, products.disparity.disparity)
    if "depth" in wanted and products.depth.geometry.metric:
        files[f"depth/{name}.{params.depth_format}"] = lambda path: _write_depth(path, products.depth.depth)
    if "clouds" in wanted:
        files[f"clouds/{name}.{params.cloud_format}"] = lambda path: _write_cloud(path, products, params.cloud_points)
    if "meshes" in wanted and len(products.surface.faces):
        files[f"meshes/{name}.glb"] = lambda path: write_glb(path, products.surface)
    if "views" in wanted and len(products.surface.faces):
        files[f"{VIEWS}/{name}.html"] = lambda path: write_bytes(path, _view(number, products).encode())
    if "model" in wanted:
        files[kept_name(name)] = lambda path: write_kept(path, products.modelled)
    if "bag" in wanted:
        topics = params.chosen_topics
        files[f"{BAG_PARTS}/{name}.mcap"] = lambda path: _write_part(path, products, log_ns, topics)
    return files


def preview(products: Products) -> ByteImage:
    """Left view and disparity side by side, small."""
    return side_by_side(products.rectified.left, colorize_disparity(products.disparity))


def side_by_side(*images: ByteImage) -> ByteImage:
    """Pictures next to each other, of one small height."""
    scaled = []
    for image in images:
        width = max(1, round(image.shape[1] * _PREVIEW_HEIGHT / image.shape[0]))
        scaled.append(cv2.resize(image, (width, _PREVIEW_HEIGHT), interpolation=cv2.INTER_AREA))
    return np.ascontiguousarray(np.hstack(scaled))


def _view(number: int, products: Products) -> str:
    """A page with the frame's surface to turn, and its left view to measure in."""
    depth, density = products.depth, products.disparity.density
    facts = [("time stamp", time_of(depth.stamp_ns)), ("density", f"{density:.0%}")]
    reliable = worst(products.findings) < Severity.UNRELIABLE
    clicks = clicks_section(
        Clickable(products.modelled, frame_name(number), products.rectified.quality.origin.depth_sigmas, reliable)
    )
    return render_page(f"Frame {number}", Summary(facts=facts), [clicks], products.surface)


def time_of(stamp_ns: int) -> str:
    """A stamp as people read it: date and time where it counts from 1970, seconds where it counts from a start."""
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    if not _FIRST_DATE <= seconds < _LAST_DATE:
        return f"{stamp_ns / 1e9:.3f} s"
    date = datetime.datetime.fromtimestamp(seconds, datetime.timezone.utc)
    return f"{date:%Y-%m-%d %H:%M:%S}.{nanoseconds // 10**6:03d} UTC"


def _write_floats(path: Path, values: FloatImage) -> None:
    if path.suffix == ".pfm":
        write_pfm(path, values)
    else:
        write_image(path, values)


def _write_depth(path: Path, depth: FloatImage) -> None:
    if path.suffix == ".png":
        write_image(path, millimetres(depth))
    else:
        _write_floats(path, depth)


def millimetres(depth: FloatImage) -> np.ndarray[tuple[int, ...], np.dtype[np.uint16]]:
    """Depth in m as whole mm; 0 where there is none, or it does not fit into 16 bits."""
    rounded = np.rint(np.nan_to_num(depth, nan=0.0) * 1000.0)
    return np.where((rounded >= 1) & (rounded <= _MM_LIMIT), rounded, 0).astype(np.uint16)


def _write_cloud(path: Path, products: Products, choice: str) -> None:
    cloud = products.cloud if choice == "all" else products.thinned
    if path.suffix == ".laz":
        write_laz(path, cloud)
    else:
        write_ply(path, cloud)


def _write_part(path: Path, products: Products, log_ns: int, topics: frozenset[str]) -> None:
    """The frame's share of the output bag, itself a bag. A full disk is the machine's trouble, not the frame's."""
    try:
        write_bag(path, frame_messages(products, log_ns, topics))
    except BagError as error:
        if isinstance(error.__cause__, OSError):
            raise error.__cause__ from error
        raise
