"""Pictures and meshes as text inside a page."""

from __future__ import annotations

import base64
import json
import zlib
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.report.colors import color_table
from uw_recon_ros.report.content import Clickable, Layer, Map, Overlay
from uw_recon_ros.types import ByteImage, FloatImage, Surface

_JPEG_QUALITY = 88
_TEXTURE_SIDE = 2048  # px; more than most screens show, and every WebGL2 device takes it


def picture_uri(image: ByteImage, *, max_side: int, lossless: bool = False) -> str:
    """``data:`` URI of an RGB picture, shrunk to `max_side` px; PNG when `lossless`, else JPEG.

    Raises
    ------
    ValueError
        It is not an (H, W, 3) uint8 picture with pixels.
    """
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
        raise ValueError(f"image: expected (H, W, 3) uint8, got {image.shape} {image.dtype}")
    kind, options = ("png", [cv2.IMWRITE_PNG_COMPRESSION, 9]) if lossless else ("jpeg", [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])  # fmt: skip # noqa: E501
    shrunk = _shrink(image, max_side, lossless)
    done, data = cv2.imencode(f".{kind}", np.ascontiguousarray(shrunk[..., ::-1]), options)
    if not done:
        raise ValueError(f"image: expected a picture that can be written as {kind}, got {image.shape}")
    return f"data:image/{kind};base64,{base64.b64encode(data.tobytes()).decode()}"


def cutout_uri(image: ByteImage) -> str:
    """``data:`` URI of a picture (H, W, 4) uint8 with opacity, as WebP."""
    options = [cv2.IMWRITE_WEBP_QUALITY, _JPEG_QUALITY]
    done, data = cv2.imencode(".webp", np.ascontiguousarray(image[..., [2, 1, 0, 3]]), options)
    if not done:
        raise ValueError(f"image: expected a picture that can be written as webp, got {image.shape}")
    return f"data:image/webp;base64,{base64.b64encode(data.tobytes()).decode()}"


def _shrink(image: ByteImage, max_side: int, lossless: bool) -> ByteImage:
    """Colour maps are sampled, not averaged: a mean of two colours means nothing."""
    scale = max_side / max(image.shape[:2])
    if scale >= 1:
        return image
    size = max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale))
    how = cv2.INTER_NEAREST if lossless else cv2.INTER_AREA
    shrunk: ByteImage = np.asarray(cv2.resize(image, size, interpolation=how), np.uint8)
    return shrunk


def mesh_json(surface: Surface, overlay: Overlay | None = None) -> str:
    """A surface, and what is shown beside it, as JSON for ``viewer.js``, safe inside a ``<script>`` element.

    Positions and texture coordinates are whole numbers of 16 bits over their range (an error under 1/100 000 of the
    surface's extent), normals of 8 bits, all little-endian in base64.
    """
    overlay = overlay or Overlay()
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    extent = np.maximum(high - low, 1e-9).astype(np.float64)
    positions = np.rint((surface.vertices - low) / extent * 65535).astype("<u2")
    index = "<u2" if len(surface.vertices) <= 65536 else "<u4"
    document: dict[str, Any] = {
        "low": low.tolist(),
        "extent": extent.tolist(),
        "metric": surface.metric,
        "positions": _base64(positions),
        "uv": _base64(np.rint(np.clip(surface.uv, 0, 1) * 65535).astype("<u2")),
        "normals": _base64(np.rint(np.clip(surface.normals, -1, 1) * 127).astype("i1")),
        "indexBits": 16 if index == "<u2" else 32,
        "index": _base64(surface.faces.astype(index)),
        "colors": _base64(color_table("plasma_r")),
        "texture": picture_uri(surface.texture, max_side=_TEXTURE_SIDE),
        "turn": [1, 1, 1] if overlay.upright else [1, -1, -1],
        "layers": [_layer(layer) for layer in overlay.layers],
        "tracks": [{"color": track.color, "points": _base64(track.points.astype("<f4"))} for track in overlay.tracks],
    }
    return script_safe(json.dumps(document))


def _layer(layer: Layer) -> dict[str, str]:
    shade = (layer.values - layer.bar.low) / max(layer.bar.high - layer.bar.low, 1e-12)
    values = np.rint(255 * np.nan_to_num(shade).clip(0, 1)).astype(np.uint8)
    return {"values": _base64(values), "colors": _base64(color_table(layer.bar.colormap))}


def map_json(shown: Map) -> str:
    """A map as JSON for ``map.js``, safe inside a ``<script>`` element."""
    rows, columns = shown.layers[0].image.shape[:2]
    return script_safe(json.dumps({
        "layers": [cutout_uri(layer.image) for layer in shown.layers], "width": columns, "height": rows,
        "pixel": shown.pixel, "west": shown.west, "north": shown.north, "unit": shown.unit,
    }))  # fmt: skip


def clickable_json(shown: Clickable) -> str:
    """A view to measure in as JSON for ``measure.js``, safe inside a ``<script>`` element.

    Disparities and their sigmas are whole numbers of 16 bits over their range (a thousandth of a px, mostly), deflated.
    """
    frame, geometry = shown.frame, shown.frame.geometry
    height, width = frame.disparity.shape
    rgb = frame.left if frame.left.ndim == 3 else np.repeat(frame.left[..., None], 3, axis=2)
    (fx, _, cx), (_, fy, cy), _ = geometry.intrinsics_left.tolist()
    return script_safe(json.dumps({
        "name": shown.name, "stamp": str(frame.stamp_ns), "width": width, "height": height,
        "picture": picture_uri(rgb, max_side=max(width, height)),
        "disparity": _packed(frame.disparity), "sigma": _packed(frame.sigma),
        "fx": fx, "fy": fy, "cx": cx, "cy": cy, "focal": geometry.focal_px, "offset": geometry.offset_px,
        "focalTimesBaseline": geometry.focal_times_baseline, "unit": "m" if geometry.metric else "baselines",
        "calibration": [list(row) for row in shown.calibration] or None, "reliable": shown.reliable,
    }))  # fmt: skip


_NOTHING = 65535  # a number that stands for NaN


def _packed(values: FloatImage) -> dict[str, Any]:
    known = np.isfinite(values)
    low, high = (float(values[known].min()), float(values[known].max())) if known.any() else (0.0, 0.0)
    step = max((high - low) / (_NOTHING - 1), 1e-9)
    whole = np.rint((np.where(known, values, low).astype(np.float64) - low) / step)
    data = np.where(known, whole, _NOTHING).astype("<u2")
    return {"low": low, "step": step, "values": base64.b64encode(zlib.compress(data.tobytes(), 6)).decode()}


def script_safe(text: str) -> str:
    """JSON that cannot end the ``<script>`` element it stands in."""
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _base64(array: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
