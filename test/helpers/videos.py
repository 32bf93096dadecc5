"""Videos made by a real encoder."""

from __future__ import annotations

import os
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

Image = NDArray[np.uint8]


def write_video(
    path: Path, images: Iterable[Image], rate: float = 10, codec: str = "libx264", times: list[float] | None = None,
    quality: int = 16,
) -> Path:  # fmt: skip
    """Encode RGB images; `times` (s) make the rate variable."""
    av = pytest.importorskip("av", reason="videos need the extra 'video'")
    with av.open(str(path), "w") as out:
        stream = None
        for number, image in enumerate(images):
            if stream is None:
                stream = out.add_stream(codec, rate=Fraction(rate).limit_denominator(1001))
                stream.width, stream.height = image.shape[1], image.shape[0]
                stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
                if codec != "mjpeg":
                    stream.options = {"crf": str(quality), "preset": "ultrafast", "g": "12"}
                if times is not None:
                    stream.codec_context.time_base = Fraction(1, 1000)
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
            if times is not None:
                frame.time_base = Fraction(1, 1000)
                frame.pts = round(1000 * times[number])
            out.mux(stream.encode(frame))
        if stream is not None:
            out.mux(stream.encode())
    return path


_ENCODERS = {"h264": "libx264", "h265": "libx265", "vp9": "libvpx-vp9", "av1": "libsvtav1"}


def packets(images: Iterable[Image], codec: str, every: int = 4, **options: str) -> list[bytes]:
    """One packet an image, as drivers send them: no frames out of order, a key frame `every` so many."""
    av = pytest.importorskip("av", reason="videos need the extra 'video'")
    images = [np.ascontiguousarray(image) for image in images]
    if _ENCODERS[codec] not in av.codecs_available:
        pytest.skip(f"this PyAV has no {_ENCODERS[codec]}")
    encoder = av.CodecContext.create(_ENCODERS[codec], "w")
    encoder.width, encoder.height, encoder.pix_fmt = images[0].shape[1], images[0].shape[0], "yuv420p"
    encoder.time_base = Fraction(1, 10)
    encoder.options = {
        "h264": {"preset": "ultrafast", "tune": "zerolatency", "bf": "0"},
        "h265": {
            "preset": "ultrafast", "tune": "zerolatency",
            "x265-params": f"keyint={every}:bframes=0:log-level=none:annexb=1",
        },
        "vp9": {"deadline": "realtime", "lag-in-frames": "0", "auto-alt-ref": "0", "b": "0"},
        "av1": {"preset": "12", "svtav1-params": "pred-struct=1:lookahead=0"},
    }[codec] | {"crf": "14", "g": str(every)} | options  # fmt: skip
    found, policy, priority = [], os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        for image in images:
            found += encoder.encode(av.VideoFrame.from_ndarray(image, format="rgb24"))
        return [bytes(packet) for packet in found + encoder.encode(None)]
    finally:  # SVT-AV1 run by root makes its caller a real-time thread, and so all that is started later
        os.sched_setscheduler(0, policy, priority)


def texture(seed: int, shape: tuple[int, int] = (180, 240), grain: float = 1.5) -> Image:
    noise = np.random.default_rng(seed).normal(size=(*shape, 3)).astype(np.float32)
    return np.clip(128 + 55 * grain * cv2.GaussianBlur(noise, (0, 0), grain), 0, 255).astype(np.uint8)


def views(number: int, disparity: int = 9, shape: tuple[int, int] = (180, 240)) -> tuple[Image, Image]:
    """Left and right view of a flat texture, another for each number."""
    wide = texture(number, (shape[0], shape[1] + disparity))
    return wide[:, : shape[1]].copy(), wide[:, disparity:].copy()


def way(t: float, seed: int = 1) -> tuple[float, float]:
    """Where a rig that sways is, px."""
    dice = np.random.default_rng(seed)
    x = y = 400.0
    for _ in range(9):
        f, a = dice.uniform(0.07, 1.3), dice.uniform(4, 24)
        x += a / (1 + f) * np.sin(2 * np.pi * f * t + dice.uniform(0, 6.28))
        y += a / (1 + f) * np.sin(2 * np.pi * f * t + dice.uniform(0, 6.28))
    return x + 1.7 * t, y


def swaying(begin: float, rate: float, seconds: float, shift: float = 0.0, clock: float = 1.0) -> Iterable[Image]:
    """Frames of a camera that started at `begin` on the rig's way."""
    ground = texture(77, (900, 1200), 3.0)
    noise = np.random.default_rng(round(1e3 * (begin + shift)) + 7)
    for number in range(int(seconds * rate)):
        x, y = way(begin + number / rate * clock)
        part = cv2.getRectSubPix(ground, (240, 180), (x + shift, y)).astype(np.float32)
        yield np.clip(part + noise.normal(0, 4, part.shape), 0, 255).astype(np.uint8)
