"""The front door for Python: one short function each for what the stages, files and recordings give.

All of it is offered by the package itself, loaded when it is asked for: ``import uw_recon_ros as uw``. Images are
mono (H, W) or RGB (H, W, 3) arrays of uint8 or uint16; of the latter 10, 12 or all 16 bits may be in use.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import uw_recon_ros.calibrate  # noqa: F401  (the room, so that the name is one thing from the start)
from uw_recon_ros.bags.reader import BagReader, open_bag
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.measure.on_model import ModelMeasurement
from uw_recon_ros.measure.quantities import Measurement
from uw_recon_ros.pairing import PAIR_TOLERANCE_MS
from uw_recon_ros.pipeline import Pipeline, PipelineParams, Products, read_values
from uw_recon_ros.recordings.options import Options
from uw_recon_ros.recordings.recording import Recording
from uw_recon_ros.rectified_input import ready_to_match, stereo_pair
from uw_recon_ros.types import EnhancedPair, Matches, RawImage, RectifiedPair, StereoCalibration, StereoPair


def enhance(left: RawImage, right: RawImage, params: PipelineParams | None = None) -> EnhancedPair:
    """Enhance two raw images (paper 2.1), both by the same statistics.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8 or uint16
    params : PipelineParams or None
        None: the defaults.

    Returns
    -------
    EnhancedPair
        ``left`` and ``right`` to look at, (H, W, 3) uint8; ``left_matching`` and ``right_matching`` to match.

    Raises
    ------
    ImageError
        The images are not a pair.
    """
    return reconstruct(left, right, params=params).enhanced


def rectify(
    left: RawImage,
    right: RawImage,
    calibration: StereoCalibration | None = None,
    params: PipelineParams | None = None,
) -> RectifiedPair:
    """Enhance two raw images and bring matching pixels onto common rows (paper 2.2).

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8 or uint16
    calibration : StereoCalibration or None
        Of the rig, in water; None: the geometry is estimated from the images, and the scale stays unknown.
    params : PipelineParams or None

    Returns
    -------
    RectifiedPair
        ``quality.warnings`` says what to be careful about.

    Raises
    ------
    ImageError, CalibrationError, EstimationError
        What the images or the calibration did not allow, with the numbers.
    """
    return reconstruct(left, right, calibration, params).rectified


def match(
    left: RawImage,
    right: RawImage,
    max_disparity: int | None = None,
    *,
    min_disparity: int | None = None,
    params: MatchParams | None = None,
) -> Matches:
    """Match two images that are rectified already, side by side (paper 2.3); needs no cameras.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8 or uint16
    max_disparity, min_disparity : int or None
        Limits of ``u_left - u_right``, inclusive, px. None: what `params` say, by default found from the images.
    params : MatchParams or None

    Returns
    -------
    Matches
        Disparity, its standard deviation and status, each (H, W); ``findings`` says what is doubtful about the images.

    Raises
    ------
    ImageError
        The images are not a pair.
    EstimationError
        They are exchanged, show nothing, or do not show the limits.
    ValueError
        The limits leave nothing.
    """
    chosen = params or MatchParams()
    low = chosen.min_disparity if min_disparity is None else min_disparity
    high = chosen.max_disparity if max_disparity is None else max_disparity
    chosen = replace(chosen, min_disparity=low, max_disparity=high)
    ready, findings = ready_to_match(stereo_pair(left, right), chosen.min_disparity)
    found, _ = Match(chosen).images(ready)
    return replace(found, findings=findings)


def reconstruct(
    left: RawImage,
    right: RawImage,
    calibration: StereoCalibration | None = None,
    params: PipelineParams | None = None,
) -> Products:
    """Reconstruct one pair: each product is made when it is first asked for.

    For pairs of one rig in a row, `Pipeline` remembers what it has learnt of the rig.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8 or uint16
    calibration : StereoCalibration or None
        As in `rectify`.
    params : PipelineParams or None

    Returns
    -------
    Products
        ``enhanced``, ``rectified``, ``disparity``, ``depth``, ``cloud``, ``thinned``, ``surface``, ``findings``.

    Raises
    ------
    ImageError
        The images are not a pair. Products raise what else the images or the calibration did not allow.
    """
    return Pipeline(params or PipelineParams()).begin(stereo_pair(left, right, calibration))


def calibrate(
    source: str | Path, output: str | Path, *, square_mm: float, size: tuple[int, int] | None = None,
    board: str = "checkerboard", medium: str = "unknown", lens: str = "auto", overwrite: bool = False,
) -> StereoCalibration:  # fmt: skip
    """Calibrate a rig with pictures of a board, as ``uw_recon calibrate`` does; the folder has the page and the files.

    Parameters
    ----------
    source : path
        A folder of stills, a bag, a video.
    output : path
        Folder to fill; ``calibration.json`` says in ``warnings`` and ``depth_errors`` what it is worth.
    square_mm : float
        Side of the board's squares, over 0.
    size : (columns, rows) or None
        Of a checkerboard's inner corners; None: found.
    board : str
        ``checkerboard``, ``charuco``, ``aprilgrid`` or a kind of circles.
    medium : {'water', 'air', 'unknown'}
    lens : {'auto', 'plumb_bob', 'equidistant'}
        Model of both lenses; `auto`: the one that predicts held-out pairs better.
    overwrite : bool

    Raises
    ------
    ReconError
        What the pictures did not allow.
    ValueError
        The squares have no size, or there is no such lens.
    """
    from uw_recon_ros.calibrate_files import BoardAsked, calibrate_files
    from uw_recon_ros.files.calibrations import read_calibration
    from uw_recon_ros.lenses import LENSES

    if not square_mm > 0:
        raise ValueError(f"square_mm: expected over 0, got {square_mm:g}")
    if lens not in LENSES:
        raise ValueError(f"lens: expected one of {', '.join(LENSES)}, got {lens!r}")
    asked = BoardAsked(board, size, square_mm / 1e3)
    calibrate_files(source, output, asked, medium=medium, lens=lens, overwrite=overwrite)
    return read_calibration(Path(output) / "calibration.json")


def measure(
    folder: str | Path, quantity: str, points: Sequence[tuple[float, float]], *, frame: str = "",
    plane: Sequence[tuple[float, float]] | None = None, click_px: float = 1.0,
) -> list[Measurement]:  # fmt: skip
    """Measure in what `pair` or `survey` left, as ``uw_recon measure`` does; on a model with `measure_model`.

    Parameters
    ----------
    folder : path
        Of a pair, or of a survey with its kept frames.
    quantity : {'length', 'height', 'area'}
    points : sequence of (u, v)
        Rectified px, as in ``left_rect.png``.
    frame : str
        Of a survey, e.g. ``000012``.
    plane : sequence of (u, v) or None
        Corners of what heights are measured from; None: the bottom.
    click_px : float
        Standard deviation of each coordinate of a point, px.

    Raises
    ------
    ReconError
        There is nothing to measure in, or no depth there.
    ValueError
        Too few points.
    """
    from uw_recon_ros import measure_files

    opened = measure_files.open_frame(folder, frame)
    options = {"plane": plane, "click_px": click_px, "calibration": opened.calibration}
    return measure_files.measure(opened, quantity, points, **options)  # type: ignore[arg-type]


def measure_model(
    folder: str | Path, quantity: str, points: Sequence[tuple[float, float, float]], *,
    plane: Sequence[tuple[float, float, float]] | None = None, click_m: float | None = None,
) -> list[ModelMeasurement]:  # fmt: skip
    """Measure on the model of a dive, as ``uw_recon measure`` and the model's page do.

    Parameters
    ----------
    folder : path
        ``model/`` of a survey, or one of its segments.
    quantity : {'length', 'height'}
    points : sequence of (x, y, z)
        In the model's coordinate system, its origin included.
    plane : sequence of (x, y, z) or None
        For ``height``: corners of the plane to measure from.
    click_m : float or None
        Standard deviation of each coordinate of a point; None: a cell of the map.

    Raises
    ------
    ReconError
        It is no model to measure on, or there is no surface at a point.
    ValueError
        Too few points.
    """
    from uw_recon_ros import measure_files

    return measure_files.measure_on(measure_files.open_model(folder), quantity, points, plane=plane, click=click_m)


def read_parameters(path: str | Path) -> PipelineParams:
    """Read a ROS parameter file as the nodes would.

    Raises
    ------
    TypeError, ValueError
        The file cannot be read, is no parameter file, or a value or name is refused.
    """
    return PipelineParams.from_mapping(read_values(path))


def open_recording(path: str | Path) -> BagReader:
    """Open a bag: MCAP or sqlite3, file or folder, damaged ones as far as they can be read. A context manager.

    Raises
    ------
    BagError
        Nothing in it can be read.
    """
    return open_bag(path)


def pairs(
    recording: str | Path,
    left_topic: str | None = None,
    right_topic: str | None = None,
    *,
    tolerance_ms: float = PAIR_TOLERANCE_MS,
    calibration: StereoCalibration | None = None,
) -> Iterator[StereoPair]:
    """Stereo pairs of a bag, a folder of stills or a video, in the order of time; bags are paired as the nodes pair.

    Parameters
    ----------
    recording : path
    left_topic, right_topic : str or None
        Image topics; None: found by type and name.
    tolerance_ms : float
        Largest difference of stamps within a pair, ms.
    calibration : StereoCalibration or None
        Instead of what the bag's CameraInfo says.

    Yields
    ------
    StereoPair

    Warns
    -----
    UserWarning
        At the end, for each part of the bag that could not be read.

    Raises
    ------
    BagError
        Nothing in it can be read, or it has no two image topics that fit.
    """
    options = Options(left_topic or "", right_topic or "", tolerance_ms)
    with Recording(recording, options, calibration) as opened:
        yield from opened.pairs()
        for sentence in (*opened.listing.unreadable, *opened.listing.notes):
            warnings.warn(f"{recording}: {sentence}", stacklevel=2)
