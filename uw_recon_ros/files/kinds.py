"""What a file is by its first bytes, in words: what a user gave where something else was expected."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

#: First bytes enough for `describe`.
HEAD = 64

_VIDEOS = (b"\x1aE\xdf\xa3", b"\0\0\1\xba", b"OggS", b"\0\0\0\1\x67")
_ARCHIVES = (b"PK\3\4", b"\x1f\x8b", b"7z\xbc\xaf", b"Rar!", b"BZh", b"\xfd7zXZ")
_IMAGES = (b"\x89PNG", b"\xff\xd8\xff", b"II\x2a\0", b"MM\0\x2a", b"RIFF", b"BM")


def _is_video(head: bytes) -> bool:
    boxed = head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide")
    return boxed or head.startswith(_VIDEOS) or (head[:4] == b"RIFF" and head[8:12] == b"AVI ")


def _is_text(head: bytes) -> bool:
    return all(32 <= byte < 127 or byte in b"\t\r\n" for byte in head)


def _begins(*magics: bytes) -> Callable[[bytes], bool]:
    return lambda head: head.startswith(magics)


_KINDS: tuple[tuple[Callable[[bytes], bool], str], ...] = (
    (lambda head: not head, "an empty file"),
    (_begins(b"#ROSBAG V"), "a ROS 1 bag: convert it with rosbags-convert"),
    (_is_video, "a video: take its frames out as PNG files, left and right in folders of their own"),
    (_begins(*_ARCHIVES), "a packed archive: unpack it first"),
    (_begins(*_IMAGES), "an image"),
    (_begins(b"\x89MCAP0\r\n"), "an MCAP bag"),
    (_begins(b"SQLite format 3\0"), "an SQLite database"),
    (_begins(b"Pf\n", b"PF\n"), "a PFM map"),
    (
        _begins(b"\x80\x03", b"\x80\x04", b"\x80\x05"),
        "a pickle of Python, which is not opened: save the matrices with numpy.savez",
    ),
    (_begins(b"\x93NUMPY"), "one array of numpy: save all matrices by their names with numpy.savez"),
    (_begins(b"GIF8"), "a GIF, whose colours are too few"),
    (_begins(b"%PDF"), "a PDF document"),
    (_begins(b"version https://git-lfs"), "a pointer of Git LFS: run git lfs pull"),
    (_is_text, "a text file"),
)


def describe(head: bytes) -> str:
    """Name a kind of file, with what to do about it where that is known.

    Parameters
    ----------
    head : bytes
        Its first `HEAD` bytes.
    """
    return next((name for fits, name in _KINDS if fits(head)), f"a file that begins with {head[:8]!r}")


def describe_file(path: Path) -> str:
    """As `describe`, of a file that is there. Raises `OSError`."""
    if not path.is_file():
        return "a pipe or a device"
    with path.open("rb") as stream:
        return describe(stream.read(HEAD))
