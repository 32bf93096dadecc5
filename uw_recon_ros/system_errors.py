"""What the operating system refused, in plain words.

The one place that knows errno: no other sentence about a file that cannot be read or written is made up elsewhere.
"""

from __future__ import annotations

import errno
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from uw_recon_ros.errors import ReconError

#: Environment variable: whether the trace of an unforeseen error is printed.
TRACEBACK = "UW_RECON_TRACEBACK"

_WORDS = {
    errno.ENOENT: "there is no such file or folder: check the name",
    errno.ENOTDIR: "a part of this path is a file where a folder is needed: check the path",
    errno.EISDIR: "expected a file, got a folder: name a file in it",
    errno.EACCES: "no permission: change the owner or the mode of it, or take another place",
    errno.EPERM: "no permission: change the owner or the mode of it, or take another place",
    errno.EROFS: "the disk is mounted for reading only: take another place",
    errno.ENOSPC: "no space is left on the disk: make room, or take another place",
    errno.EDQUOT: "the disk quota is used up: make room, or take another place",
    errno.EFBIG: "larger than this file system or a limit on this process allows: take another place",
    errno.EEXIST: "already exists: choose another name",
    errno.ENOTEMPTY: "expected an empty folder, there are files in it: take another name",
    errno.ENAMETOOLONG: "the name is too long for this file system: take a shorter one",
    errno.ELOOP: "links that lead to each other: name the file itself",
    errno.EMFILE: "too many files are open: raise the limit (ulimit -n), or use fewer jobs",
    errno.ENFILE: "too many files are open on this machine: close some programs",
    errno.EIO: "the disk reports an error: copy the file to a sound disk, if it can still be read",
    errno.ENODEV: "the device is gone: connect it again",
    errno.ENXIO: "the device is gone: connect it again",
    errno.ESTALE: "the network disk has lost it: connect it again",
    errno.ETIMEDOUT: "no answer in time: check the network",
    errno.ECONNREFUSED: "connection refused: check the address and that the other end runs",
    errno.ENOMEM: "no memory is left: close some programs, or use fewer jobs",
    errno.EBUSY: "in use by another program: close it first",
    errno.ETXTBSY: "in use by another program: close it first",
    errno.EXDEV: "on another disk than its folder: take a place on one disk",
    errno.EINVAL: "the system does not allow this here: check the name, or take another place",
    errno.EPIPE: "nobody reads the output any more",
}


def reason(error: OSError) -> str:
    """What happened and what to do, without the file's name; one line."""
    known = _WORDS.get(error.errno) if error.errno is not None else None
    number = f"error {error.errno}" if error.errno is not None else type(error).__name__
    return known or f"the system refused it ({number}): check the disk and the name"


def explain(error: OSError) -> str:
    """What happened, to which file, and what to do; one line."""
    names = [str(name) for name in (error.filename, error.filename2) if isinstance(name, (str, bytes, Path))]
    return f"{names[-1]}: {reason(error)}" if names else reason(error)


def our_fault(error: Exception) -> str:
    """What to say about an error that nobody foresaw; its trace goes to standard error where `TRACEBACK` is set."""
    if os.environ.get(TRACEBACK):
        traceback.print_exception(error, file=sys.stderr)
    frames = traceback.extract_tb(error.__traceback__)
    place = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else "an unknown place"
    return (
        f"internal error, not a fault of your data ({type(error).__name__} at {place}): "
        f"please report it, with the command and what {TRACEBACK}=1 before it prints"
    )


@contextmanager
def told_as(kind: type[ReconError], name: str | Path, expected: str) -> Iterator[None]:
    """Turn an `OSError` within into an error of the project: the file's name, what was expected, what happened."""
    try:
        yield
    except OSError as error:
        raise kind(f"{name}: expected {expected}: {reason(error)}") from error
