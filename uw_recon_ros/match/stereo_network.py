"""A stereo network that the user has, run by ONNX Runtime (the extra ``network``): two images in, a disparity map out.

No weights come with the package. What is known of a network is what its file says: two images of 1 or 3 channels, or
one of both laid upon each other; (1, C, H, W), of fixed size or of any. What it does not say, how values are scaled,
the user does.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.match.planes.initial_disparity import enlarge
from uw_recon_ros.types import ByteImage, FloatImage

MULTIPLE = 32  #: sides of what a network of free size is given, px
_TYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16, "tensor(uint8)": np.uint8}
_MEAN, _DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of ImageNet, red first
_NAME = "start_network"


class StereoNetwork(NamedTuple):
    """A network ready to run.

    Parameters
    ----------
    session : onnxruntime.InferenceSession
    values : str
        One of `methods.NETWORK_VALUES`: what gray levels from 0 to 255 are made to be.
    output : str
        Name of the disparity; empty: the only output that is as large as the images.
    """

    session: Any
    values: str
    output: str

    def __call__(self, left: ByteImage, right: ByteImage) -> FloatImage:
        """Disparity of the left view, (H, W), px; whatever the network says, NaN included.

        Images are made smaller where the network's size is fixed and less, and continued to its size at the right
        and below.

        Parameters
        ----------
        left, right : (H, W, C) uint8
            C = 1 or 3.

        Raises
        ------
        EstimationError
            The network cannot take such images, fails, or gives nothing of their size.
        """
        height, width = left.shape[:2]
        size = self._size(width, height)
        scale = min(1.0, size[0] / width, size[1] / height)
        small = max(round(width * scale), 1), max(round(height * scale), 1)
        views = [self._prepared(image, small, size) for image in (left, right)]
        found = self._run(views, size)[: small[1], : small[0]]
        if small == (width, height):
            return found
        return enlarge(np.ascontiguousarray(found), (width, height), width / small[0])

    @property
    def _channels(self) -> int:
        """Of one image."""
        inputs = self.session.get_inputs()
        channels = inputs[0].shape[1]
        if not isinstance(channels, int):
            return 3
        return channels if len(inputs) == 2 else channels // 2

    def _size(self, width: int, height: int) -> tuple[int, int]:
        """Of what the network takes, (width, height); the next multiples where it takes any."""
        fixed = self.session.get_inputs()[0].shape[:1:-1]
        return tuple(  # type: ignore[return-value]
            side if isinstance(side, int) else -(-own // MULTIPLE) * MULTIPLE
            for side, own in zip(fixed, (width, height), strict=True)
        )

    def _prepared(self, image: ByteImage, small: tuple[int, int], size: tuple[int, int]) -> NDArray[np.float32]:
        """(1, C, H, W), scaled as the network wants it."""
        if small != image.shape[1::-1]:
            image = np.asarray(cv2.resize(image, small, interpolation=cv2.INTER_AREA), np.uint8)
        image = np.atleast_3d(image)
        if self._channels == 1 and image.shape[2] == 3:
            image = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)[..., None]
        beyond = (0, size[1] - small[1]), (0, size[0] - small[0])
        values = np.pad(image, (*beyond, (0, 0)), mode="edge").astype(np.float32)
        values = np.broadcast_to(values, (*values.shape[:2], self._channels))
        return np.ascontiguousarray(_scaled(values, self.values).transpose(2, 0, 1)[None], np.float32)

    def _run(self, views: list[NDArray[np.float32]], size: tuple[int, int]) -> FloatImage:
        inputs = self.session.get_inputs()
        if len(inputs) == 1:
            views = [np.concatenate(views, axis=1)]
        elif "right" in inputs[0].name.lower() and "left" in inputs[1].name.lower():
            views = views[::-1]
        feed = {i.name: view.astype(_TYPES[i.type]) for i, view in zip(inputs, views, strict=True)}
        wanted = [self.output] if self.output else [o.name for o in self.session.get_outputs()]
        try:
            given = self.session.run(wanted, feed)
        except Exception as error:  # ONNX Runtime's errors have no base of their own
            raise _refused("a network that runs on these images", _first_line(error)) from error
        maps = {name: _as_map(array, size) for name, array in zip(wanted, given, strict=True)}
        fitting = [found for found in maps.values() if found is not None]
        if len(fitting) != 1:
            got = ", ".join(f"{n} {np.shape(a)}" for n, a in zip(wanted, given, strict=True))
            raise _refused(
                f"one output of {size[1]} x {size[0]} values, the disparity", f"{got}; name it: start_network_output"
            )
        return fitting[0]


def load_network(path: str, values: str, output: str, threads: int) -> StereoNetwork:
    """Read a network; the same file again only when it has changed.

    Parameters
    ----------
    path : str
        Of an ``.onnx`` file.
    values, output : str
        See `StereoNetwork`.
    threads : int
        That it may use. The result does not depend on it as far as ONNX Runtime holds to that.

    Raises
    ------
    EstimationError
        ONNX Runtime is not installed, the file is no network, or one that takes something else than two images.
    """
    try:
        state = Path(path).stat()
    except OSError as error:
        raise _refused("a file that can be read", f"{path}: {error.strerror}") from error
    session = _session(path, state.st_mtime_ns, state.st_size, threads)
    names = [o.name for o in session.get_outputs()]
    if output and output not in names:
        raise _refused(f"start_network_output one of {', '.join(names)}", repr(output))
    return StereoNetwork(session, values, output)


@lru_cache(maxsize=2)
def _session(path: str, modified_ns: int, size: int, threads: int) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise _refused("ONNX Runtime", "none; pip install '.[network]' in the sources' folder") from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.use_deterministic_compute = True
    options.log_severity_level = 4  # what fails is raised
    try:
        session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime's errors have no base of their own
        raise _refused("an ONNX network that ONNX Runtime can load", f"{path}: {_first_line(error)}") from error
    _require_images(session)
    return session


def _require_images(session: Any) -> None:
    """Two inputs (1, C, H, W) of 1 or 3 channels, or one of 2 or 6."""
    inputs = session.get_inputs()
    channels = {2: (1, 3), 1: (2, 6)}.get(len(inputs), ())
    good = all(
        len(i.shape) == 4
        and i.type in _TYPES
        and (not isinstance(i.shape[0], int) or i.shape[0] == 1)
        and (i.shape[1] in channels or not isinstance(i.shape[1], int))
        for i in inputs
    )
    if not good or not channels or any(i.shape != inputs[0].shape for i in inputs):
        got = ", ".join(f"{i.name} {i.type} {i.shape}" for i in inputs)
        raise _refused("two images (1, 1 or 3, H, W), or one (1, 2 or 6, H, W), of floats or bytes", got)


def _scaled(values: NDArray[np.float32], how: str) -> NDArray[np.float32]:
    """Gray levels of 0 to 255 as a network wants them, (H, W, C)."""
    if how == "0..255":
        return values
    if how == "-1..1":
        return np.asarray(values / 127.5 - 1, np.float32)
    values = np.asarray(values / 255, np.float32)
    if how == "0..1":
        return values
    mean, deviation = np.array(_MEAN, np.float32), np.array(_DEVIATION, np.float32)
    if values.shape[2] == 1:
        mean, deviation = mean.mean(keepdims=True), deviation.mean(keepdims=True)
    return np.asarray((values - mean) / deviation, np.float32)


def _as_map(array: Any, size: tuple[int, int]) -> FloatImage | None:
    """(H, W) of an output, the first of the two channels of a flow; None where it is something else.

    A flow to the right view is the disparity with its sign turned: no disparity here is less than 0.
    """
    shape = np.shape(array)
    if shape[-2:] != size[::-1] or len(shape) > 4 or any(n != 1 for n in shape[:-3]):
        return None
    if len(shape) >= 3 and shape[-3] not in (1, 2):
        return None
    found = np.asarray(array, np.float32).reshape(-1, *shape[-2:])[0]
    finite = found[np.isfinite(found)]
    return np.asarray(-found if finite.size and np.median(finite) < 0 else found, np.float32)


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0][:300]


def _refused(expected: str, got: str) -> EstimationError:
    return EstimationError(f"{_NAME}: expected {expected}, got {got}", Code.MATCH_NETWORK)
