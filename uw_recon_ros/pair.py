"""One stereo pair from files to files: the work of ``uw_recon pair`` and ``uw_recon disparity``."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from uw_recon_ros.calibration import read_calibration
from uw_recon_ros.errors import EstimationError, ImageError, ReconError
from uw_recon_ros.evaluate import check_disparity_format, write_disparity, write_pfm
from uw_recon_ros.findings import Code, Finding, Severity, severe, worst
from uw_recon_ros.images import read_image, to_gray, write_bytes, write_image
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.pipeline import Pipeline, PipelineParams, Products
from uw_recon_ros.preprocess.regions import find_regions
from uw_recon_ros.progress import say
from uw_recon_ros.reconstruct.export import write_glb, write_ply
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.rows import not_checked
from uw_recon_ros.rectify.tie_points import find_tie_points
from uw_recon_ros.report.figures import as_byte_rgb, colorize_disparity
from uw_recon_ros.report.pair import write_pair_page
from uw_recon_ros.types import DepthMap, EnhancedPair, RectificationQuality, RectifiedPair, StereoGeometry, StereoPair
from uw_recon_ros.unseen import blackened
from uw_recon_ros.warm import tell_if_cold

Report = dict[str, Any]
_BEHIND_PX = 1.0
_NEARLY_ALL = 0.95
_ROWS_PX = 1.0


def read_pair(left: str | Path, right: str | Path, calibration: str | Path | None = None) -> StereoPair:
    """Read two image files, and the rig's calibration if there is one.

    Raises
    ------
    ImageError, CalibrationError
        Naming the file.
    """
    images = read_image(left), read_image(right)
    if images[0].shape != images[1].shape or images[0].dtype != images[1].dtype:
        described = [f"{i.shape[1]}x{i.shape[0]} {'colour' if i.ndim == 3 else 'mono'} {i.dtype}" for i in images]
        raise ImageError(f"{left}, {right}: expected two images of one size and kind, got {' and '.join(described)}")
    if np.array_equal(*images):
        raise ImageError(f"{left}, {right}: expected two different images, got the same twice", Code.IMAGE_IDENTICAL)
    rig = read_calibration(calibration) if calibration else None
    return StereoPair(*images, frame_id=(rig.left.frame_id if rig else "") or "left_optical_frame", calibration=rig)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _report(result: Products) -> Report:
    quality, disparity = result.rectified.quality, result.disparity
    findings = severe(result.enhanced.findings) + quality.warnings
    return {
        "rectification": {
            "method": quality.method,
            "row_error_median_px": _finite(quality.row_error_median_px),
            "row_error_p95_px": _finite(quality.row_error_p95_px),
            "inliers": quality.inliers,
            "refused": None,
            "warnings": [str(finding) for finding in quality.warnings],
        },
        "matching": {
            "method": disparity.method,
            "energy": _finite(disparity.energy),
            "seconds": result.stages_seconds["match"],
            "density": disparity.density,
            "min_disparity": disparity.min_disparity,
            "max_disparity": disparity.max_disparity,
        },
        "scale": "metric" if disparity.geometry.metric else "unknown",
        "geometry": _geometry(result.depth),
        "warnings": [finding.as_dict() for finding in findings],
        "reliable": worst(findings) < Severity.UNRELIABLE,
        "failed": None,
        "stages_seconds": result.stages_seconds,
    }


def _geometry(depth: DepthMap) -> Report:
    """All that turns ``disparity.pfm`` into points in `frame_id`."""
    geometry = depth.geometry
    height, width = depth.depth.shape
    return {
        "width": width,
        "height": height,
        "focal_px": geometry.focal_px,
        "focal_across_px": geometry.focal_across_px or geometry.focal_px,
        "cx_left": geometry.cx_left,
        "cx_right": geometry.cx_right,
        "cy": geometry.cy,
        "offset_px": geometry.offset_px,
        "baseline_m": geometry.baseline_m,
        "baseline_sign": geometry.baseline_sign,
        "axis": geometry.axis,
        "frame_id": depth.frame_id,
        "rect_from_raw_left": geometry.rect_from_raw_left,
    }


def _failure(stage: str, error: ReconError) -> Report:
    """A report of the same form for a pair that did not come through."""
    nothing = dict.fromkeys(["method", "row_error_median_px", "row_error_p95_px", "inliers"])
    matching = dict.fromkeys(["method", "energy", "seconds", "density", "min_disparity", "max_disparity"])
    return {
        "rectification": {**nothing, "refused": str(error) if stage == "rectify" else None, "warnings": []},
        "matching": matching,
        "scale": "unknown",
        "geometry": None,
        "warnings": [],
        "reliable": False,
        "failed": {"stage": stage, "code": error.code.value, "text": str(error)},
        "stages_seconds": {},
    }


def _write_json(path: Path, report: Mapping[str, Any]) -> None:
    write_bytes(path, (json.dumps(report, indent=2) + "\n").encode())


def _write_enhanced(output: Path, enhanced: EnhancedPair) -> None:
    write_image(output / "left_enhanced.png", enhanced.left)
    write_image(output / "right_enhanced.png", enhanced.right)


def _write_result(output: Path, result: Products, report: Report) -> None:
    _write_enhanced(output, result.enhanced)
    write_image(output / "left_rect.png", result.rectified.left)
    write_image(output / "right_rect.png", result.rectified.right)
    write_pfm(output / "disparity.pfm", result.disparity.disparity)
    write_image(output / "disparity.png", colorize_disparity(result.disparity))
    if result.depth.geometry.metric:
        write_image(output / "depth.tiff", result.depth.depth)
    write_ply(output / "cloud.ply", result.cloud)
    write_glb(output / "mesh.glb", result.surface)
    write_pair_page(output / "index.html", result.raw, result.enhanced, result.rectified, result.disparity,
                    result.depth, result.surface, report)  # fmt: skip
    _write_json(output / "report.json", report)


def _claim(output: Path, overwrite: bool) -> None:
    if output.exists() and not output.is_dir():
        raise ReconError(f"{output}: expected a folder to write to, got a file")
    if output.is_dir() and any(output.iterdir()) and not overwrite:
        raise ReconError(
            f"{output}: expected an empty or new folder, got one with files in it; --overwrite replaces them"
        )
    output.mkdir(parents=True, exist_ok=True)


def _expect_surface(result: Products, left: str | Path, right: str | Path) -> None:
    """Refuse what would be files without content."""
    if not len(result.surface.faces):
        points = int(np.isfinite(result.cloud.points).all(axis=-1).sum())
        raise EstimationError(
            f"{left}, {right}: expected depth on many pixels, got {points} points and no surface: do both show the "
            "same scene, sharp and lit, left and right not exchanged? The enhanced images show what was matched",
            Code.MATCH_NOTHING,
        )


def reconstruct_files(
    left: str | Path,
    right: str | Path,
    output: str | Path,
    params: PipelineParams,
    calibration: str | Path | None = None,
    *,
    overwrite: bool = False,
) -> Report:
    """Reconstruct two image files into a folder; return what ``report.json`` holds.

    Raises
    ------
    ReconError
        What the files did not allow. When the pair was read but did not come through, the folder holds a report with
        the reason, and the enhanced images where there are any.
    """
    output = Path(output)
    pair = read_pair(left, right, calibration)
    _claim(output, overwrite)
    tell_if_cold(say)
    stages: list[str] = []

    def announce(stage: str) -> None:
        stages.append(stage)
        say(f"{stage} ...")

    result = Pipeline(params).begin(pair, announce)
    try:
        _ = result.cloud
        _expect_surface(result, left, right)
    except ReconError as error:
        _write_json(output / "report.json", _failure(stages[-1], error))
        if stages[-1] != "preprocess":
            _write_enhanced(output, result.enhanced)
        raise
    report = _report(result)
    say("writing ...")
    _write_result(output, result, report)
    return report


def _claim_file(output: Path, overwrite: bool) -> None:
    """Refuse what could not be written, before any work is done for it."""
    check_disparity_format(output)
    if output.is_dir():
        raise ReconError(f"{output}: expected a file to write to, got a folder")
    if output.exists() and not overwrite:
        raise ReconError(f"{output}: expected a new file, got one that is there; --overwrite replaces it")
    if not (output.parent.is_dir() and os.access(output.parent, os.W_OK)):
        raise ReconError(f"{output}: expected a folder that can be written to, got {output.parent}")


def _as_bytes(pair: StereoPair) -> StereoPair:
    """8 bits a channel: the highest that either image uses, so that both are dimmed alike."""
    if pair.left.dtype == np.uint8:
        return pair
    bits = max(int(max(pair.left.max(), pair.right.max())).bit_length(), 8)
    left, right = ((image >> (bits - 8)).astype(np.uint8) for image in (pair.left, pair.right))
    return replace(pair, left=left, right=right)


def _suspicions(pair: StereoPair, min_disparity: int) -> tuple[Finding, ...]:
    """Whether images said to be rectified look like it: rows that agree, the left camera on the left.

    Raises
    ------
    EstimationError
        The images are exchanged.
    """
    gray = to_gray(pair.left), to_gray(pair.right)
    try:
        found = find_tie_points(EnhancedPair(as_byte_rgb(pair.left), as_byte_rgb(pair.right), *gray), RectifyParams())
    except EstimationError as error:
        return (not_checked(str(error)),)
    u, v = (found.left - found.right).T
    if np.mean(u < -_BEHIND_PX) > _NEARLY_ALL and min_disparity >= 0:
        raise EstimationError(
            f"exchanged images: expected disparities over 0, got {np.mean(u < 0):.0%} of {len(found)} tie points under "
            f"it (median {np.median(u):.1f} px): exchange the images, or give a --min-disparity under 0",
            Code.MATCH_EXCHANGED,
        )
    median = float(np.median(np.abs(v)))
    if median <= _ROWS_PX:
        return ()
    text = f"not rectified? rows disagree by {median:.1f} px (median of {len(found)} tie points)"
    return (Finding(Code.RECTIFY_ROWS_DISAGREE, text, Severity.UNRELIABLE, "rectify them, as `pair` does"),)


def match_files(
    left: str | Path, right: str | Path, output: str | Path, params: MatchParams, *, overwrite: bool = False
) -> Report:
    """Match two rectified image files into a file of the format its name says; return the numbers.

    Raises
    ------
    ReconError
    """
    _claim_file(Path(output), overwrite)
    pair = _as_bytes(read_pair(left, right))
    suspicions = _suspicions(pair, params.min_disparity)
    height, width = pair.left.shape[:2]
    geometry = StereoGeometry(float(width), (width - 1) / 2, (width - 1) / 2, (height - 1) / 2)
    shown = np.zeros((height, width, 3), np.uint8)  # texture, which matching does without
    regions = find_regions(pair)
    scenes = blackened(pair.left.copy(), regions.left), blackened(pair.right.copy(), regions.right)
    rectified = RectifiedPair(shown, shown, *scenes, geometry, RectificationQuality("given"))
    match = Match(params)
    tell_if_cold(say)
    match.warm_up()
    started = time.perf_counter()
    result = match(rectified)
    seconds = time.perf_counter() - started
    write_disparity(output, result.disparity)
    return {
        "method": result.method,
        "effort": params.effort if params.method == "graph_cut" else None,
        "energy": _finite(result.energy),
        "seconds": seconds,
        "density": result.density,
        "min_disparity": result.min_disparity,
        "max_disparity": result.max_disparity,
        "warnings": [finding.as_dict() for finding in severe(regions.findings) + suspicions],
    }
