"""Files of others read whole, up to a bound."""

from __future__ import annotations

import stat
from pathlib import Path

from uw_recon_ros.errors import ReconError
from uw_recon_ros.system_errors import reason


def read_bounded(path: str | Path, most: int, kind: type[ReconError] = ReconError) -> bytes:
    """Read a file whole.

    Parameters
    ----------
    path : path
    most : int
        Bytes it may have.
    kind : class
        Of the error.

    Raises
    ------
    ReconError
        Of that kind; the text does not name the file. It is missing, unreadable, no plain file (a pipe or device would
        be waited for, for ever), or larger.
    """
    try:
        size = expect_file(path, kind)
        with Path(path).open("rb") as stream:
            content = stream.read(min(size, most) + 1)
    except OSError as error:
        raise kind(reason(error)) from error
    except ValueError as error:  # a NUL in the name
        raise kind("a name that no file can have: check the name") from error
    if len(content) > most:
        raise kind(f"expected at most {most} bytes, got {max(size, len(content))}")
    return content


def expect_file(path: str | Path, kind: type[ReconError]) -> int:
    """Bytes of a file; a pipe or a device, which would be waited for, is refused. A folder is not: opening it fails."""
    found = Path(path).stat()
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
        raise kind("expected a file, got a pipe or a device: copy its content to a file")
    return found.st_size
