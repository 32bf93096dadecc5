"""Compiled kernels: numba with a cache that works wherever the package is installed. Import numba from nowhere else.

Where the machine code is kept: ``$NUMBA_CACHE_DIR`` if it can be written, else the user's cache directory, else a
private directory among the temporary files, else nowhere. Inside, every package folder has a directory named by a
digest of its sources: numba itself looks only at the file a function stands in and would keep calling the old version
of a kernel imported from another file; and processes that start at once never meet half-written or outdated code.

Rules for kernels
-----------------
- Call each with arguments of one set of types only. (Two processes that compile different signatures of one function at
  the same moment may overwrite each other's cache entry.)
- They release the GIL and never use ``parallel=True``: numba's default threading layer aborts the process when two
  Python threads enter it.
- A kernel may call kernels of its own package folder only.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import tempfile
import threading
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec, TypeVar, overload

P = ParamSpec("P")
R = TypeVar("R")
_lock = threading.Lock()


def _writable(directory: Path) -> bool:
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            return True
    except OSError:
        return False


def _user_cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(base) / "uw_recon_ros" / "numba"


def _temporary_cache() -> Path | None:
    """A directory that only this user can write: cached code is run, so nobody else may put it there."""
    try:
        shared = Path(tempfile.gettempdir()) / f"uw_recon_ros-numba-{os.getuid()}"
        shared.mkdir(mode=0o700, exist_ok=True)
        status = shared.lstat()
        private = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o022
        return shared if private and _writable(shared) else Path(tempfile.mkdtemp(prefix="uw_recon_ros-numba-"))
    except OSError:
        return None


def _find_cache() -> Path | None:
    given = os.environ.get("NUMBA_CACHE_DIR")
    for directory in ([Path(given).absolute()] if given else []) + [_user_cache()]:
        if directory.is_absolute() and _writable(directory):
            return directory
    return _temporary_cache()


#: Where machine code is kept; None: nowhere, every process compiles afresh.
CACHE_DIRECTORY = _find_cache()
if CACHE_DIRECTORY is not None:
    os.environ["NUMBA_CACHE_DIR"] = str(CACHE_DIRECTORY)

import numba  # noqa: E402  (reads the environment when first imported)
from numba.core.compiler import Flags  # noqa: E402
from numba.core.cpu import CPUTargetOptions  # noqa: E402
from numba.core.options import TargetOptions  # noqa: E402


def _postpone_blas() -> None:
    """Let numba load SciPy's BLAS when a kernel multiplies matrices, not already when it first loads code: 0.1 s.

    All that follows from "no BLAS" there is how `numpy.convolve` sums its products.
    """
    try:
        from numba.np import linalg
    except ImportError:
        return
    ensure = getattr(linalg, "ensure_blas", None)
    if ensure is None or "numba.np.arraymath" in sys.modules:
        return

    def later() -> None:
        if not hasattr(sys.modules.get("numba.np.arraymath"), "_HAVE_BLAS"):
            raise ImportError("not needed yet")
        ensure()

    linalg.ensure_blas = later


_postpone_blas()


def _offer_noalias() -> None:
    """Let kernels promise that their arrays lie apart: numba knows how to pass that on, but has no option for it."""
    if "noalias" in getattr(Flags, "options", ()) and not hasattr(CPUTargetOptions, "noalias"):
        CPUTargetOptions.noalias = TargetOptions.Mapping("noalias")


_offer_noalias()
_OPTIONS = dir(CPUTargetOptions)  # do without those that this numba does not know: ``_nrt`` is private
_digests: dict[Path, str] = {}
_directories: dict[Path, Path | None] = {}
_kernels: list[Any] = []


class CacheUse(NamedTuple):
    """What this process has compiled, and what it found compiled: numbers of signatures of kernels."""

    compiled: int
    loaded: int


def cache_use() -> CacheUse:
    """Of all kernels so far."""
    stats = [kernel.stats for kernel in _kernels]
    return CacheUse(*(sum(sum(counts.values()) for counts in kind) for kind in (
        [s.cache_misses for s in stats], [s.cache_hits for s in stats])))  # fmt: skip


def is_cold(folder: Path) -> bool:
    """Whether nothing is kept yet of the kernels of a package folder: the first call will compile."""
    if CACHE_DIRECTORY is None:
        return True
    return not any((CACHE_DIRECTORY / f"{folder.name}-{_digest(folder)}").rglob("*.nbc"))


def _digest(folder: Path) -> str:
    """Of all sources in `folder`."""
    if folder not in _digests:
        hasher = hashlib.sha256(version("numba").encode())
        for source in sorted(folder.glob("*.py")):
            hasher.update(source.name.encode() + b"\0" + source.read_bytes() + b"\0")
        _digests[folder] = hasher.hexdigest()[:16]
    return _digests[folder]


def _cache_for(function: Callable[..., Any]) -> Path | None:
    """Cache directory of `function`'s package folder; None where it cannot be made."""
    source = Path(function.__code__.co_filename)
    if CACHE_DIRECTORY is None or not source.is_file():
        return None
    folder = source.parent
    if folder not in _directories:
        directory = CACHE_DIRECTORY / f"{folder.name}-{_digest(folder)}"
        _directories[folder] = directory if _writable(directory) else None
    return _directories[folder]


@overload
def kernel(function: Callable[P, R]) -> Callable[P, R]: ...
@overload
def kernel(
    *, fastmath: bool = False, inline: bool = False, allocates: bool = True, apart: bool = False
) -> Callable[[Callable[P, R]], Callable[P, R]]: ...
def kernel(
    function: Callable[..., Any] | None = None,
    *,
    fastmath: bool = False,
    inline: bool = False,
    allocates: bool = True,
    apart: bool = False,
) -> Any:
    """Compile a function to machine code when first called: no GIL, no bounds checks, cached on disk.

    Used bare (``@kernel``) or with options (``@kernel(fastmath=True)``).

    Parameters
    ----------
    function : callable
        Written in the subset of Python that numba compiles. It keeps its static type; the Python original is its
        ``py_func``.
    fastmath : bool
        Allow sums to be reordered: faster, but bits then depend on the machine.
    inline : bool
        Always paste the machine code into the calling kernel: for helpers that are handed many arrays.
    allocates : bool
        Whether it makes arrays (views apart). Where not, numba can leave out the counting of references, which takes
        more than half of the time of small kernels that hand arrays to each other.
    apart : bool
        A promise: nothing that is written through one array is read or written through another. Short loops over many
        arrays else spend more time comparing addresses than working. Where numba cannot use it, it is slower only.

    Returns
    -------
    callable
        Of the same signature. Division by zero gives inf or NaN, as in numpy.
    """
    options: dict[str, Any] = {"nogil": True, "boundscheck": False, "error_model": "numpy", "fastmath": fastmath}
    if inline and "forceinline" in _OPTIONS:
        options["forceinline"] = True
    if not allocates and "_nrt" in _OPTIONS:
        options["_nrt"] = False
    if apart and "noalias" in _OPTIONS:
        options["noalias"] = True
    if function is None:
        return lambda decorated: _compile(decorated, options)
    return _compile(function, options)


def _compile(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    with _lock:
        directory, before = _cache_for(function), numba.config.CACHE_DIR
        numba.config.CACHE_DIR = str(directory or "")
        try:
            compiled = numba.njit(function, cache=directory is not None, **options)
            _kernels.append(compiled)
            return compiled
        finally:
            numba.config.CACHE_DIR = before
