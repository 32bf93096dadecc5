"""One frame, in whatever process: read, reconstructed, written, described. What `Executor.run` calls."""

from __future__ import annotations

import os
import resource
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import cv2

from uw_recon_ros.errors import CalibrationError, ReconError
from uw_recon_ros.files.atomic import publish
from uw_recon_ros.files.images import write_image
from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.images import as_gray
from uw_recon_ros.recordings.pair_index import Frame
from uw_recon_ros.recordings.read import Reader
from uw_recon_ros.rectify.late_right import Moments
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.rectify.tie_points import TiePoints, find_tie_points
from uw_recon_ros.report.figures import as_byte_rgb
from uw_recon_ros.stopwatch import Stopwatch
from uw_recon_ros.survey.plan import FrameTask, Plan, load_plan
from uw_recon_ros.survey.products import FramePipeline, FrameProducts, describe
from uw_recon_ros.survey.store import FAILED, PREVIEWS, Row, SurveyError, frame_name
from uw_recon_ros.survey.write import frame_files, side_by_side
from uw_recon_ros.system_errors import our_fault
from uw_recon_ros.types import StereoPair

_AT_ONCE_NS = 200_000  # what moves 0.2 m/s comes 0.04 mm far


class Workshop:
    """What a process keeps from frame to frame."""

    def __init__(self, plan: Plan) -> None:
        cv2.setNumThreads(1)  # the cores are shared out by frames
        self.plan = plan
        self.pipeline = FramePipeline(plan.pipeline)
        self.reader = Reader(plan.sources, plan.calibrations)
        self.staging = Path(plan.root) / "state" / "staging"

    def rectification(self, frame: Frame) -> Rectification:
        """The rig's.

        Raises
        ------
        CalibrationError
            It is not known.
        """
        if frame.rig not in self.plan.rectifications:
            raise CalibrationError("rectification: expected the rig to be known, got a frame of another one")
        return self.plan.rectifications[frame.rig]


_lock = threading.Lock()
_workshops: dict[str, Workshop] = {}  # by the plan's digest; a Dask worker may serve two surveys at once
_MOST_WORKSHOPS = 2


def _enter(task: FrameTask) -> Workshop:
    """This process's workshop for a plan; the oldest is given up, and closes its bags once no thread is in it."""
    with _lock:
        if task.digest not in _workshops:
            if len(_workshops) >= _MOST_WORKSHOPS:
                del _workshops[next(iter(_workshops))]
            _workshops[task.digest] = Workshop(load_plan(task))
        return _workshops[task.digest]


def tie_points_of(task: FrameTask) -> TiePoints | str:
    """Tie points of one frame, or why there are none."""
    shop = _enter(task)
    try:
        before = shop.reader.read_before(task.frame)  # first: videos are decoded forwards
        enhanced = shop.pipeline.enhance(shop.reader.read(task.frame), before)
        return find_tie_points(enhanced, shop.plan.pipeline.rectify)
    except (OSError, MemoryError, SurveyError):
        raise
    except Exception as error:  # whatever it is, other frames may do
        return _found(error).text


def reconstruct_frame(task: FrameTask) -> Row:
    """Reconstruct one frame and write its files.

    Returns
    -------
    dict
        The frame's row. What the data does not allow gives a row with the reason.

    Raises
    ------
    OSError, MemoryError
        This machine cannot go on: a full disk, no memory.
    """
    shop, started, timed = _enter(task), time.perf_counter(), Stopwatch()
    frame = task.frame
    row: Row = {"frame": frame.number, "source": shop.plan.sources[frame.source].name, "stamp_ns": frame.stamp_ns}
    pair: StereoPair | None = None
    try:
        with timed("read"):
            before = shop.reader.read_before(frame)  # first: videos are decoded forwards
            pair = shop.reader.read(frame)
            moments = _moments(shop, frame, pair)
        products = shop.pipeline(pair, shop.rectification(frame), timed, before, moments)
        row |= describe(products)
        files = _write_products(shop, frame, products, row)
    except (OSError, MemoryError, SurveyError):
        raise
    except Exception as error:  # one frame's trouble, whatever it is, is not the survey's end
        found = _found(error)
        row |= {"status": FAILED, "reason": found.text, "findings": [found.as_dict()]}
        files = _write_raw(shop, frame, pair)
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    seconds = time.perf_counter() - started
    return row | {"files": files, "seconds": seconds, "stages_seconds": timed.seconds, "peak_mb": peak_mb}


def _moments(shop: Workshop, frame: Frame, pair: StereoPair) -> Moments | None:
    """Of a pair whose images are not of one moment; None where they are."""
    if abs(frame.lag_ns) < _AT_ONCE_NS:
        return None
    return Moments(frame.lag_ns / 1e9, as_gray(pair.left), shop.reader.read_around(frame))


def _write_products(shop: Workshop, frame: Frame, products: FrameProducts, row: Row) -> dict[str, int]:
    files = frame_files(frame.number, frame.left.log_ns, products, shop.plan.survey)
    with products.timed("write"):
        written = _write(shop, files)
    row["points"] = int((products.depth.status == 0).sum())
    row["triangles"] = len(products.surface.faces) if shop.plan.survey.products & {"meshes", "views"} else None
    return written


def _write_raw(shop: Workshop, frame: Frame, pair: StereoPair | None) -> dict[str, int]:
    """Show at least what the failure looked like."""
    if pair is None:
        return {}
    images = as_byte_rgb(pair.left), as_byte_rgb(pair.right)
    name = f"{PREVIEWS}/{frame_name(frame.number)}.jpg"
    return _write(shop, {name: lambda path: write_image(path, side_by_side(*images))})


def _write(shop: Workshop, files: Mapping[str, Callable[[Path], None]]) -> dict[str, int]:
    """Write all files of a frame under temporary names, then move them to their places; return their sizes."""
    folder = Path(tempfile.mkdtemp(prefix=f"{os.getpid()}-", dir=shop.staging))
    try:
        staged = {}
        for number, (name, write) in enumerate(files.items()):
            temporary = folder / str(number) / Path(name).name
            temporary.parent.mkdir()
            write(temporary)
            staged[temporary] = Path(shop.plan.root) / name
        sizes = {name: path.stat().st_size for name, path in zip(files, staged, strict=True)}
        publish(staged)
        return sizes
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _found(error: Exception) -> Finding:
    if isinstance(error, ReconError):
        return Finding(error.code, " ".join(str(error).split()), Severity.REFUSED)
    return Finding(Code.INTERNAL, our_fault(error), Severity.REFUSED)
