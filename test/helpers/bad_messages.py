"""Strategies for messages that no honest node sends: each is a good message and what to do to it.

`Bad.words` is what the node's refusal must say. What is merely strange, and may be taken or refused, is `odd_*`.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from hypothesis import strategies as st

NOT_FINITE = (math.nan, math.inf, -math.inf)
HUGE = (2**31, 2**32 - 1, 65_537)
Spoil = Callable[[Any], None]


@dataclass(frozen=True)
class Bad:
    """What to do to a good message of a topic; `alone`: refused before its partners matter."""

    what: str
    topic: str
    spoil: Spoil = field(repr=False)
    words: str = ""
    alone: bool = False


@dataclass(frozen=True)
class Flaw:
    """As `Bad`, of whatever topic."""

    what: str
    spoil: Spoil = field(repr=False)
    words: str
    alone: bool = False

    def on(self, topic: str) -> Bad:
        return Bad(self.what, topic, self.spoil, self.words, self.alone)


def setting(words: str, **values: Any) -> Flaw:
    """Fields set; a double underscore stands for a dot."""

    def spoil(message: Any) -> None:
        for name, value in values.items():
            *path, last = name.split("__")
            target = message
            for step in path:
                target = getattr(target, step)
            setattr(target, last, value)

    return Flaw(" ".join(f"{name} = {str(value)[:60]!r}" for name, value in values.items()), spoil, words)


def entry(name: str, index: int, value: float, words: str) -> Flaw:
    """One number of an array set."""

    def spoil(message: Any) -> None:
        getattr(message, name)[index] = value

    return Flaw(f"{name}[{index}] = {value}", spoil, words)


def refill(data: Any, content: bytes) -> None:
    del data[:]
    data.frombytes(content)


def resized(change: Callable[[bytes], bytes], what: str, words: str) -> Flaw:
    """The image's bytes changed."""

    def spoil(message: Any) -> None:
        data = getattr(message, "image", message).data
        refill(data, change(data.tobytes()))

    return Flaw(what, spoil, words)


# headers

control = st.sampled_from(["\n", "\r\n", "\x1b[2J", "\x07", "\u202e", "\u2028"])
bad_headers = st.one_of(
    st.builds(lambda n: setting("stamp: expected", header__stamp__nanosec=n), st.integers(10**9, 2**32 - 1)),
    st.builds(lambda n: setting("stamp: expected", header__stamp__sec=n), st.integers(-(2**31), -1)),
    st.builds(
        lambda a, c, b: setting("frame_id: expected", header__frame_id=a + c + b),
        st.text("abc/._-", max_size=9), control, st.text("xyz", max_size=9),
    ),
    st.sampled_from([86, 1000, 350_000]).map(lambda n: setting("frame_id: expected", header__frame_id="../" * n)),
).map(lambda flaw: Flaw(flaw.what, flaw.spoil, flaw.words, alone=True))  # fmt: skip


# raw images

ENCODINGS = ("32FC1", "64FC1", "8SC1", "rgb8 ", "RGB8", "mono10p", "h264", "../../etc/passwd", "8UC2", "nv61", "", "\n")
bad_encodings = st.builds(
    lambda name: setting("encoding: expected", encoding=name),
    st.one_of(st.sampled_from([*ENCODINGS, "x" * 1_000_000]), st.text(max_size=20).map(lambda t: "?" + t)),
)


def bad_sizes(words: str = "") -> st.SearchStrategy[Flaw]:
    """Sizes that the step or the data contradict."""
    axis = st.sampled_from(["height", "width"])
    return st.one_of(
        st.builds(lambda name, n: setting(words, **{name: n}), axis, st.sampled_from([0, *HUGE])),
        st.builds(lambda w, h: setting(words, width=w, height=h), st.sampled_from(HUGE), st.sampled_from(HUGE)),
        st.builds(lambda n: setting(words, height=n), st.integers(100, 2**32 - 1)),
        st.builds(lambda n: setting(words, width=n), st.integers(1000, 2**32 - 1)),
        st.builds(lambda n: setting(words, step=n), st.integers(1000, 2**32 - 1)),
        st.builds(lambda n: setting(words, step=n), st.integers(0, 40)),
        st.just(setting(words, width=2**31, height=2**31, step=2**31)),
        st.just(setting(words, width=2**20, height=2**12 - 1, step=2**20)),
    )


def bad_data(words: str = "") -> st.SearchStrategy[Flaw]:
    """Bytes missing, or too many."""
    return st.one_of(
        st.builds(
            lambda share: resized(lambda b: b[: int(share * len(b))], f"data cut to {share:.2f}", words),
            st.floats(0, 0.999),
        ),
        st.builds(
            lambda n: resized(lambda b: b + b"\xa5" * n, f"{n} bytes more", words), st.sampled_from([1, 7, 4096, 2**20])
        ),
    )


def shrunk(message: Any) -> None:
    """A sound image of another size: two rows fewer."""
    image = getattr(message, "image", message)
    image.height -= 2
    refill(image.data, image.data.tobytes()[: image.step * image.height])


SMALLER = Flaw("two rows fewer", shrunk, "expected")
bad_images = st.one_of(bad_headers, bad_encodings, bad_sizes(), bad_data())
bad_bytes = st.one_of(bad_encodings, bad_sizes(), bad_data())
bad_partners = st.one_of(bad_images, st.just(SMALLER), st.sampled_from(["mono16", "rgba8"]).map(
    lambda name: setting("expected", encoding=name)))  # fmt: skip


# float images

bad_floats = st.one_of(
    bad_headers,
    st.builds(
        lambda name: setting("encoding: expected", encoding=name), st.sampled_from(["mono8", "16UC1", "64FC1", ""])
    ),
    bad_sizes(),
    bad_data(),
    st.just(SMALLER),
)


# compressed images


def png(width: int, height: int, body: bytes = b"") -> bytes:
    """A PNG's header that declares a size, with the checksum it must have, and a deflated body."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(body)) + chunk(b"IEND", b"")


def jpeg(width: int, height: int) -> bytes:
    """A JPEG's frame header that declares a size, and an end."""
    frame = struct.pack(">HBHHB", 17, 8, height, width, 3) + b"\x01\x22\x00\x02\x11\x01\x03\x11\x01"
    return b"\xff\xd8\xff\xe0" + struct.pack(">H", 16) + b"JFIF\0\1\1\0\0\1\0\1\0\0" + b"\xff\xc0" + frame + b"\xff\xd9"


def tiff(width: int, height: int) -> bytes:
    """A little-endian TIFF directory that declares a size."""
    tags = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in ((256, width), (257, height)))
    return struct.pack("<2sHIH", b"II", 42, 8, 2) + tags + b"\0\0\0\0"


def webp(width: int, height: int) -> bytes:
    """A WebP canvas that declares a size."""
    size = (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little")
    return b"RIFF\x16\0\0\0WEBPVP8X" + struct.pack("<I", 10) + bytes(4) + size


def containing(content: bytes, what: str) -> Flaw:
    return Flaw(what, lambda message: refill(message.data, content), "image: ")


BOMB = png(60_000, 60_000, bytes(2**24))  # 16 KiB that begin 10.8 GB of zeros
giants = st.builds(
    lambda make, w, h: containing(make(w, h), f"{make.__name__} of {w}x{h}"),
    st.sampled_from([png, jpeg, tiff, webp]), st.integers(8193, 65_535), st.integers(8193, 65_535),
)  # fmt: skip
bad_compressed = st.one_of(
    bad_headers,
    giants,
    st.just(containing(BOMB, "decompression bomb")),
    st.just(containing(png(2**31 - 1, 2**31 - 1), "png of 2^31 - 1")),
    st.just(containing(b"", "nothing")),
    st.binary(min_size=1, max_size=200).map(lambda b: containing(b"?" + b, f"rubbish {b[:9]!r}")),
    st.binary(max_size=60).map(lambda b: containing(b"\x89PNG\r\n\x1a\n" + b, f"png rubbish {b[:9]!r}")),
    st.binary(max_size=60).map(lambda b: containing(b"\xff\xd8\xff" + b, f"jpeg rubbish {b[:9]!r}")),
    st.floats(0.0, 0.9).map(lambda s: resized(lambda b: b[: int(s * len(b))], f"cut to {s:.2f}", "")),
    st.integers(8, 60).map(lambda i: resized(lambda b: b[:i] + bytes([b[i] ^ 0xFF]) + b[i + 1 :], f"byte {i}", "")),
    st.just(Flaw("a sound image of another size", containing(png(16, 12, bytes(12 * 49)), "").spoil, "pair: expected")),
)


# camera_info


def at(name: str, indices: tuple[int, ...], values: tuple[float, ...], words: str) -> st.SearchStrategy[Flaw]:
    return st.builds(lambda i, v: entry(name, i, v, words), st.sampled_from(indices), st.sampled_from(values))


def distorted(number: int, model: str = "plumb_bob", value: float = 0.1) -> Flaw:
    flaw = setting("expected", d=[value] * number, distortion_model=model)
    return Flaw(f"{number} times {value} as D of {model[:40]!r}", flaw.spoil, flaw.words)


def matrix(name: str, values: list[float]) -> Flaw:
    return setting(f"{name.upper()}: expected", **{name: values})


EVERY = tuple(range(9))
bad_infos = st.one_of(
    bad_headers,
    at("k", EVERY, (*NOT_FINITE, 1e300), "K: expected"),
    at("k", (0, 4), (-50.0,), "K: expected"),
    at("k", (3, 6, 7, 8), (-1.0, 0.5), "K: expected"),
    at("k", (4, 8), (0.0,), "K: expected"),
    at("r", EVERY, (*NOT_FINITE, 1e300, 0.5), "R: expected"),
    st.just(matrix("r", [2.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0])),
    st.just(matrix("r", [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0])),
    at("p", tuple(range(12)), (*NOT_FINITE, 1e300), "P: expected"),
    at("p", (0, 5), (-50.0, 0.0), "P: expected"),
    at("p", (1, 8, 9, 10, 11), (0.5,), "P: expected"),
    at("p", (3, 7), (5.0,), "P: expected"),
    st.builds(lambda n: setting("expected", width=n), st.sampled_from([0, 1, 63, *HUGE])),
    st.builds(lambda n: setting("expected", height=n), st.sampled_from([0, 1, 49, *HUGE])),
    st.sampled_from([1, 2, 3, 6, 7, 8, 9, 12, 1000, 100_000]).map(distorted),
    st.builds(distorted, st.just(5), st.sampled_from(["fish", "thin_prism", "plumb bob 5", "../d", "x" * 1_000_000])),
    st.builds(distorted, st.just(4), st.just("")),  # plumb_bob and equidistant have four both
    st.builds(distorted, st.just(5), st.just("plumb_bob"), st.sampled_from(NOT_FINITE)),
)

# of a rectified view: P says it all; NaN in P[3] or P[7] is an unknown baseline
bad_rectified_infos = st.one_of(
    bad_headers,
    at("p", (0, 1, 2, 4, 5, 6, 8, 9, 10, 11), (*NOT_FINITE, 1e300), "P = "),
    at("p", (0, 5), (-50.0, 0.0), "P = "),
    at("p", (1, 4, 8, 9, 10, 11), (0.5,), "P = "),
    at("p", (3, 7), (math.inf, -math.inf), "baseline"),
    at("p", (0, 5), (80.0,), "equal focal lengths"),
    at("p", (6,), (99.0,), "one principal point"),
    st.builds(lambda n: setting(" size", width=n), st.sampled_from([0, 1, 63, *HUGE])),
    st.builds(lambda n: setting(" size", height=n), st.sampled_from([0, 1, 49, *HUGE])),
    st.builds(
        lambda x, y, w, h: setting("within", roi__x_offset=x, roi__y_offset=y, roi__width=w, roi__height=h),
        st.sampled_from([64, 2**31]), st.sampled_from([0, 2**31]), st.sampled_from([1, 2**32 - 1]),
        st.sampled_from([1, 2**31]),
    ),
)  # fmt: skip
bad_left_rotation = st.one_of(
    at("r", EVERY, (*NOT_FINITE, 1e300, 0.5), "rotation"),
    st.just(setting("rotation", r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0])),
)


# disparity


def of_image(flaw: Flaw) -> Flaw:
    return Flaw(f"image: {flaw.what}", lambda message: flaw.spoil(message.image), flaw.words)


bad_disparities = st.one_of(
    bad_headers,
    st.one_of(bad_sizes(), bad_data(), st.just(SMALLER)).map(of_image),
    st.sampled_from(["mono8", "16UC1", "64FC1", "32FC3", ""]).map(
        lambda name: of_image(setting("encoding: expected", encoding=name))
    ),
    st.sampled_from(NOT_FINITE).map(lambda value: setting("finite f and T", f=value)),
    st.sampled_from(NOT_FINITE[1:]).map(lambda value: setting("finite f and T", t=value)),
    st.builds(
        lambda name, value: setting("min_disparity and max_disparity", **{name: value}),
        st.sampled_from(["min_disparity", "max_disparity"]), st.sampled_from([math.nan, 1e30, -1e30, 70_000.0]),
    ),
    st.builds(
        lambda x, y, w, h: setting(
            "valid_window", valid_window__x_offset=x, valid_window__y_offset=y, valid_window__width=w,
            valid_window__height=h,
        ),
        st.sampled_from([0, 64, 2**31]), st.sampled_from([0, 48, 2**31]), st.integers(65, 2**32 - 1),
        st.integers(0, 2**32 - 1),
    ),
)  # fmt: skip
