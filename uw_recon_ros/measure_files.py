"""Measuring in what `pair` and `survey` left, and on the model of a dive: the work of ``uw_recon measure``."""

from __future__ import annotations

import base64
import csv
import io
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from uw_recon_ros.errors import EstimationError, ReconError
from uw_recon_ros.files.atomic import finite, write_bytes, write_json
from uw_recon_ros.files.disparities import read_disparity
from uw_recon_ros.files.images import read_image
from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.measure.on_model import ModelMeasurement, Spots, measure_off_plane, measure_way, on_surface
from uw_recon_ros.measure.quantities import (
    CalibrationError,
    Measurement,
    measure_patch,
    measure_polyline,
    measure_to_plane,
    unit_of,
)
from uw_recon_ros.survey.kept_frame import KEPT, kept_name, read_kept
from uw_recon_ros.survey.store import UNRELIABLE
from uw_recon_ros.survey.tables import depth_sigmas
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import Matrix, StereoGeometry

Points = Sequence[tuple[float, float]]
Places = Sequence[tuple[float, float, float]]
_MODEL, _SUMMARY = "measure.json", "model.json"
_SAME_BASELINE = 0.02  # rigs whose baselines differ by more are not one
_ASSUMED = "quasi-euclidean"  # rectified without a calibration: the focal length is assumed


@dataclass(frozen=True, eq=False)
class Opened:
    """A frame to measure in.

    Parameters
    ----------
    name : str
    frame : DisparityFrame
    findings : tuple of Finding
        What is to be known before its numbers are used.
    assumed : bool
        Whether the focal length is only assumed, so that shapes are too.
    calibration : callable or None
        What its calibration leaves unknown of depth; None: not told.
    """

    name: str
    frame: DisparityFrame
    findings: tuple[Finding, ...] = ()
    assumed: bool = False
    calibration: CalibrationError | None = None

    @property
    def unit(self) -> str:
        """Of its lengths."""
        return unit_of(self.frame.geometry)


def open_frame(path: str | Path, name: str = "") -> Opened:
    """Open a folder of `pair`, a survey's folder (with a frame's name), or a kept frame.

    Raises
    ------
    ReconError
        It is none of it, or its depth was not kept.
    """
    path = Path(path)
    if (path / KEPT).is_dir():
        return _of_survey(path, name)
    if name:
        text = f"--frame: expected with a survey, got {name} for {path}, which is one frame"
        raise ReconError(text, Code.MEASURE_INPUT)
    if path.is_file():
        return Opened(path.name, read_kept(path))
    if (path / "report.json").is_file() and (path / "disparity.pfm").is_file():
        return _of_pair(path)
    raise ReconError(
        f"{path}: expected a folder of `uw_recon pair`, or of `uw_recon survey --write model`, or a kept frame",
        Code.MEASURE_INPUT,
    )


def _of_survey(path: Path, name: str) -> Opened:
    names = sorted(file.stem for file in (path / KEPT).iterdir() if file.suffix == ".frame")
    name = name.zfill(len(names[0])) if names and name.isdecimal() else name  # 3 for 000003, as frames.csv counts
    if name not in names:
        some = ", ".join(names[:4])
        text = f"--frame: expected one of the {len(names)} frames kept ({some}, ...), got {name or 'nothing'}"
        raise ReconError(text, Code.MEASURE_INPUT)
    return Opened(
        name, read_kept(path / kept_name(name)), _told_of_frame(path / "frames.csv", name),
        calibration=error_between(depth_sigmas(path / "report.json")),
    )  # fmt: skip


def _told_of_frame(table: Path, name: str) -> tuple[Finding, ...]:
    """Why the survey does not rely on a frame, where it does not."""
    if not table.is_file():
        return ()
    with table.open(newline="", encoding="utf-8") as stream:
        rows = [row for row in csv.DictReader(stream) if row["frame"] == (name.lstrip("0") or "0")]
    return tuple(
        Finding(Code.MEASURE_UNRELIABLE, row["reason"], Severity.UNRELIABLE)
        for row in rows
        if row["status"] == UNRELIABLE
    )


def _of_pair(path: Path) -> Opened:
    report = json.loads((path / "report.json").read_text())
    if report.get("geometry") is None:
        raise ReconError(f"{path}: expected a pair that came through, got {report.get('failed')}", Code.MEASURE_INPUT)
    geometry = _geometry(report["geometry"])
    disparity = read_disparity(path / "disparity.pfm")
    sigma_file = path / "disparity_sigma.pfm"
    sigma = read_disparity(sigma_file) if sigma_file.is_file() else np.full_like(disparity, 0.5)
    depth_file = path / "depth.tiff"
    if depth_file.is_file():  # what the depth filter took away is not measured
        disparity = np.where(np.isfinite(read_disparity(depth_file)), disparity, np.float32(np.nan))
    told = [w["text"] for w in report["warnings"] if w["severity"] == "unreliable"]
    findings = tuple(Finding(Code.MEASURE_UNRELIABLE, text, Severity.UNRELIABLE) for text in told)
    frame = DisparityFrame(0, np.asarray(read_image(path / "left_rect.png"), np.uint8), disparity, sigma, geometry)
    rectification = report["rectification"]
    sigmas = rectification.get("calibration_depth_sigmas", ())
    return Opened(path.resolve().name, frame, findings, rectification["method"] == _ASSUMED, error_between(sigmas))


def _geometry(told: dict[str, Any]) -> StereoGeometry:
    return StereoGeometry(
        told["focal_px"], told["cx_left"], told["cx_right"], told["cy"], told["baseline_m"], told["axis"],
        told["baseline_sign"], told["focal_across_px"], tuple(tuple(row) for row in told["rect_from_raw_left"]),
    )  # fmt: skip


def calibration_error(path: str | Path, opened: Opened) -> CalibrationError:
    """Relative sigma of depth at a depth, from the table of a ``calibration.json`` of the frame's own rig.

    Raises
    ------
    ReconError
        It is none, or made without the size of the squares, or of another rig.
    """
    try:
        report = json.loads(Path(path).read_text())
        rows = [
            (e["range_m"], e["mean_percent"] / 100) for e in report["depth_errors"] if e["mean_percent"] is not None
        ]
        baseline_m = float(report["baseline_m"]) if rows else 0.0  # without the size of the squares there is neither
    except (OSError, ValueError, KeyError, TypeError) as error:
        text = f"{path}: expected a calibration.json of `uw_recon calibrate`, got {error!r}"
        raise ReconError(text, Code.MEASURE_INPUT) from error
    found = error_between(rows)
    if found is None:
        raise ReconError(f"{path}: expected depth errors, got none: was --square-mm given?", Code.MEASURE_INPUT)
    _expect_same_rig(path, baseline_m, opened.frame.geometry)
    return found


def _expect_same_rig(path: str | Path, baseline_m: float, geometry: StereoGeometry) -> None:
    own_m = abs(geometry.baseline_m or 0.0)
    if own_m and abs(baseline_m - own_m) > _SAME_BASELINE * baseline_m:
        raise ReconError(
            f"{path}: expected that of this frame's rig, whose baseline is {own_m:.4g} m, "
            f"got one of {baseline_m:.4g} m",
            Code.MEASURE_INPUT,
        )


def error_between(table: Sequence[Sequence[float]]) -> CalibrationError | None:
    """Relative sigma of depth at any depth, from rows of range, m, and fraction; None for no rows."""
    if not table:
        return None
    ranges, errors = zip(*table, strict=True)
    logs = [math.log(range_m) for range_m in ranges]
    return lambda depth: float(np.interp(math.log(max(depth, 1e-6)), logs, errors))


def scaled(
    opened: Opened, bar: Points, length_m: float, sigma_m: float, click_px: float
) -> tuple[Opened, CalibrationError]:
    """Metres from a known length in the picture.

    Parameters
    ----------
    opened : Opened
    bar : two of (u, v)
        Ends of what is known.
    length_m, sigma_m : float

    Returns
    -------
    Opened, callable
        The frame in metres, and its relative uncertainty, the same at all depths.

    Raises
    ------
    EstimationError
        The bar has no depth.
    """
    seen = measure_polyline(replace(opened.frame, geometry=opened.frame.geometry.unscaled), bar, click_px=click_px)
    if not seen.value > 0:
        raise EstimationError(f"known length: expected one in the picture, got {seen.value:g}", Code.MEASURE_NO_SCALE)
    relative = math.hypot(sigma_m / length_m, seen.sigma / seen.value)
    geometry = opened.frame.geometry
    metric = replace(geometry, baseline_m=geometry.baseline_sign * length_m / seen.value)
    findings = opened.findings
    calibrated_m = seen.value * abs(geometry.baseline_m or 0.0)
    if calibrated_m and abs(length_m / calibrated_m - 1) > max(3 * relative, _SAME_BASELINE):
        text = f"known length: told {length_m:g} m, by calibration it is {calibrated_m:.4g} m: one of them is wrong"
        advice = "check the length, the two pixels, and in which medium the rig was calibrated"
        findings = (*findings, Finding(Code.MEASURE_NO_SCALE, text, Severity.UNRELIABLE, advice))
    if opened.assumed:
        text = (
            "scale from a known length, focal length only assumed: lengths beside the known one and parallel to it are "
            "in metres, those in depth are not"
        )
        findings = (*findings, Finding(Code.MEASURE_NO_SCALE, text, Severity.UNRELIABLE, "give the in-water focal_px"))
    return replace(opened, frame=replace(opened.frame, geometry=metric), findings=findings), lambda depth: relative


def measure(
    opened: Opened, quantity: str, points: Points, *, plane: Points | None = None, click_px: float = 1.0,
    calibration: CalibrationError | None = None,
) -> list[Measurement]:  # fmt: skip
    """Measure; see `measure.quantities`.

    Parameters
    ----------
    opened : Opened
    quantity : {'length', 'height', 'area'}
    points : sequence of (u, v)
        Rectified px.
    plane : sequence of (u, v) or None
        For ``height``: corners of the plane to measure from; None: the bottom.

    Raises
    ------
    EstimationError
        There is no depth there.
    ValueError
        Too few points.
    """
    height, width = opened.frame.disparity.shape
    for u, v in points:
        if not (0 <= u <= width - 1 and 0 <= v <= height - 1):
            text = f"point: expected within the rectified image of {width}x{height} px, got ({u:g}, {v:g})"
            raise EstimationError(text, Code.MEASURE_NO_DEPTH)
    options: dict[str, Any] = {"click_px": click_px, "calibration": calibration}
    made: dict[str, Callable[[], list[Measurement]]] = {
        "length": lambda: [measure_polyline(opened.frame, points, **options)],
        "height": lambda: [measure_to_plane(opened.frame, point, plane, **options) for point in points],
        "area": lambda: list(measure_patch(opened.frame, points, **options)),
    }
    return made[quantity]()


@dataclass(frozen=True, eq=False)
class OpenedModel:
    """A model to measure on.

    Parameters
    ----------
    name : str
    spots : Spots
    origin : (3,) float64
        What points of `crs` have more than those of the model.
    crs, unit : str
    click : float
        Standard deviation of a click where none is told: a cell of the map.
    findings : tuple of Finding
        What is to be known before its numbers are used.
    """

    name: str
    spots: Spots
    origin: Matrix
    crs: str
    unit: str
    click: float
    findings: tuple[Finding, ...] = ()


def is_model(path: str | Path) -> bool:
    """Whether a folder holds a model of a dive."""
    return (Path(path) / _MODEL).is_file() or (Path(path) / _SUMMARY).is_file()


def open_model(path: str | Path) -> OpenedModel:
    """Open the ``model/`` of a survey, or one of its segments.

    Raises
    ------
    ReconError
        It was made without what is needed to measure.
    """
    place = Path(path)
    try:
        told = json.loads((place / _MODEL).read_text())
    except (OSError, ValueError) as error:
        text = (
            f"{place}: expected a model with {_MODEL}, got none: make it anew with uw_recon model SURVEY --overwrite "
            "(models of live nodes have none)"
        )
        raise ReconError(text, Code.MEASURE_INPUT) from error
    rows = _numbers(told["spots"]).reshape(-1, 8)
    side = 6 * len(told["centres"])
    spots = Spots(
        rows[:, :3], rows[:, 3], rows[:, 4:7], rows[:, 7], np.array(told["centres"], np.float64).reshape(-1, 3),
        _numbers(told["covariance"]).reshape(side, side), [(a, b) for a, b in told["calibration"]], told["spacing"],
    )  # fmt: skip
    text = "metres are not earned" if told["unit"] != "m" else "the model is marked unreliable"
    findings = () if told["reliable"] else (
        Finding(Code.MEASURE_UNRELIABLE, text, Severity.UNRELIABLE, "see the red lines of its report.html"),
    )  # fmt: skip
    name = f"segment {told['segment']}"
    return OpenedModel(name, spots, np.array(told["origin"]), told["crs"], told["unit"], told["click"], findings)


def _numbers(text: str) -> Matrix:
    return np.frombuffer(base64.b64decode(text), "<f4").astype(np.float64)


def _check_on_surface(opened: OpenedModel, place: tuple[float, float, float]) -> None:
    if on_surface(opened.spots, np.array(place) - opened.origin):
        return
    told, origin = (", ".join(f"{x:.10g}" for x in point) for point in (place, opened.origin))
    lacks = opened.origin.any() and on_surface(opened.spots, np.array(place))
    advice = f": add the model's origin ({origin}), which its meshes are stored without" if lacks else ""
    text = f"({told}): expected a point on the model's surface, got none there{advice}"
    raise EstimationError(text, Code.MEASURE_NO_DEPTH)


def measure_on(
    opened: OpenedModel, quantity: str, points: Places, *, plane: Places | None = None, click: float | None = None
) -> list[ModelMeasurement]:
    """Measure on a model; see `measure.on_model`.

    Parameters
    ----------
    opened : OpenedModel
    quantity : {'length', 'height'}
    points : sequence of (x, y, z)
        In the model's coordinate system, its origin included.
    plane : sequence of (x, y, z) or None
        For ``height``: corners of the plane to measure from.
    click : float or None
        Standard deviation of each coordinate of a point; None: a cell of the map.

    Raises
    ------
    EstimationError
        There is no surface there.
    ValueError
        Too few points, or a quantity that a model does not have.
    """
    for place in (*points, *(plane or ())):
        _check_on_surface(opened, place)
    at, sigma = np.array(points, np.float64) - opened.origin, opened.click if click is None else click
    if quantity == "length":
        return [measure_way(opened.spots, at, np.full(len(at), sigma))]
    if quantity != "height" or plane is None:
        raise ValueError("on a model: expected length, or height with the corners of a plane, got " + quantity)
    corners = np.array(plane, np.float64) - opened.origin
    return [measure_off_plane(opened.spots, p, corners, np.full(1 + len(corners), sigma)) for p in at]


def model_rows(opened: OpenedModel, results: Sequence[ModelMeasurement]) -> list[dict[str, Any]]:
    """Results as JSON holds them, each with the places it was measured between, in the model's coordinate system."""
    return [
        {
            "model": opened.name, "crs": opened.crs, "quantity": r.quantity, "value": finite(r.value),
            "sigma": finite(r.sigma), "unit": opened.unit, "sigma_surface": finite(r.sigma_surface),
            "sigma_trajectory": finite(r.sigma_trajectory), "sigma_calibration": finite(r.sigma_calibration),
            "sigma_click": finite(r.sigma_click), "distance": finite(r.distance), "clicks": list(r.clicks),
            "points": [[float(x) for x in np.array(point) + opened.origin] for point in r.points],
            "reliable": all(f.severity < Severity.UNRELIABLE for f in opened.findings),
        }
        for r in results
    ]  # fmt: skip


def rows_of(opened: Opened, results: Sequence[Measurement]) -> list[dict[str, Any]]:
    """Results as JSON holds them, each with its frame and pixels."""
    return [
        {
            "frame": opened.name, "stamp_ns": opened.frame.stamp_ns, "quantity": r.quantity, "value": finite(r.value),
            "sigma": finite(r.sigma), "unit": r.unit, "sigma_disparity": finite(r.sigma_disparity),
            "sigma_click": finite(r.sigma_click), "sigma_calibration": finite(r.sigma_calibration),
            "depth": finite(r.depth), "agreed": finite(r.agreed), "cell": finite(r.cell),
            "other": finite(r.other),
            "pixels": [list(point) for point in r.points],
            "reliable": all(f.severity < Severity.UNRELIABLE for f in opened.findings),
        }
        for r in results
    ]  # fmt: skip


def write_rows(path: str | Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write results as JSON or, where the name ends so, as CSV."""
    if Path(path).suffix.lower() != ".csv":
        write_json(path, list(rows), durable=False)
        return
    text = io.StringIO()
    table = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    table.writeheader()
    table.writerows({name: _cell(value) for name, value in row.items()} for row in rows)
    write_bytes(path, text.getvalue().encode())


def _cell(value: Any) -> Any:
    """Lists of a row in one cell: points apart by blanks, their coordinates by commas."""
    if not isinstance(value, list):
        return value
    return " ".join(",".join(f"{x:.12g}" for x in (part if isinstance(part, list) else [part])) for part in value)
