"""One stereo pair from files to files: the work of ``uw_recon pair`` and ``uw_recon disparity``."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from uw_recon_ros.calibration.judge import judge_depths
from uw_recon_ros.errors import EstimationError, ReconError
from uw_recon_ros.files.atomic import claim_folder, finite, write_bytes
from uw_recon_ros.files.calibrations import Paths, read_calibration
from uw_recon_ros.files.disparities import check_disparity_format, write_disparity, write_pfm
from uw_recon_ros.files.images import read_image, write_image
from uw_recon_ros.files.meshes import write_glb, write_ply
from uw_recon_ros.findings import Code, Severity, severe, worst
from uw_recon_ros.kernel_warmup import tell_if_cold
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.pipeline import Pipeline, PipelineParams, Products
from uw_recon_ros.progress import say
from uw_recon_ros.recordings.views import both_views
from uw_recon_ros.rectified_input import ready_to_match, stereo_pair
from uw_recon_ros.report.content import Clickable
from uw_recon_ros.report.figures import colorize_disparity
from uw_recon_ros.report.pair import write_pair_page
from uw_recon_ros.stopwatch import Stopwatch
from uw_recon_ros.types import DepthMap, EnhancedPair, StereoPair

PairReport = dict[str, Any]


def read_pair(left: str | Path, right: str | Path, calibration: Paths | None = None) -> StereoPair:
    """Read two image files (the same twice: it holds both views), and the rig's calibration if there is one.

    Raises
    ------
    ImageError, CalibrationError
        Naming the file.
    """
    images = both_views(left) if str(left) == str(right) else (read_image(left), read_image(right))
    size = images[0].shape[1], images[0].shape[0]
    return stereo_pair(*images, read_calibration(calibration, size) if calibration else None, f"{left}, {right}")


def _report(result: Products) -> PairReport:
    quality, disparity = result.rectified.quality, result.disparity
    findings = severe(result.enhanced.findings) + quality.warnings + judge_depths(result.depth)
    return {
        "rectification": {
            "method": quality.method,
            "row_error_median_px": finite(quality.row_error_median_px),
            "row_error_p95_px": finite(quality.row_error_p95_px),
            "inliers": quality.inliers,
            "medium": quality.medium or None,
            "shape_sigma_percent": finite(quality.shape_sigma_percent),
            "lens_k1": finite(quality.lens_k1),
            "calibration_depth_sigmas": quality.origin.depth_sigmas,
            "refused": None,
            "warnings": [str(finding) for finding in quality.warnings],
        },
        "matching": {
            "method": disparity.method,
            "energy": finite(disparity.energy),
            "seconds": result.stages_seconds["match"],
            "density": disparity.density,
            "min_disparity": disparity.min_disparity,
            "max_disparity": disparity.max_disparity,
            "residual_row_px": finite(disparity.rows.median_px),
        },
        "scale": "metric" if disparity.geometry.metric else "unknown",
        "depth": _depths(result.depth),
        "geometry": _geometry(result.depth),
        "warnings": [finding.as_dict() for finding in findings],
        "reliable": worst(findings) < Severity.UNRELIABLE,
        "failed": None,
        "stages_seconds": result.stages_seconds,
    }


def _depths(depth: DepthMap) -> dict[str, float] | None:
    """How far what was seen is, m; None without a scale, or where nothing was."""
    known = depth.depth[np.isfinite(depth.depth)]
    if not depth.geometry.metric or not known.size:
        return None
    return dict(zip(("p5_m", "median_m", "p95_m"), np.percentile(known, (5, 50, 95)).tolist(), strict=True))


def _geometry(depth: DepthMap) -> PairReport:
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


def _failure(stage: str, error: ReconError) -> PairReport:
    """A report of the same form for a pair that did not come through."""
    nothing = dict.fromkeys(
        ["method", "row_error_median_px", "row_error_p95_px", "inliers", "medium", "shape_sigma_percent", "lens_k1"]
    ) | {"calibration_depth_sigmas": ()}
    names = ("method", "energy", "seconds", "density", "min_disparity", "max_disparity", "residual_row_px")
    return {
        "rectification": {**nothing, "refused": str(error) if stage == "rectify" else None, "warnings": []},
        "matching": dict.fromkeys(names),
        "scale": "unknown",
        "depth": None,
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


def _write_result(output: Path, result: Products, report: PairReport) -> None:
    _write_enhanced(output, result.enhanced)
    write_image(output / "left_rect.png", result.rectified.left)
    write_image(output / "right_rect.png", result.rectified.right)
    write_pfm(output / "disparity.pfm", result.disparity.disparity)
    write_pfm(output / "disparity_sigma.pfm", result.disparity.sigma)
    write_image(output / "disparity.png", colorize_disparity(result.disparity))
    if result.depth.geometry.metric:
        write_image(output / "depth.tiff", result.depth.depth)
    write_ply(output / "cloud.ply", result.cloud)
    write_glb(output / "mesh.glb", result.surface)
    write_pair_page(
        output / "index.html", result.raw, result.enhanced, result.rectified, result.disparity, result.depth,
        result.surface, report, clickable=_clickable(output.resolve().name, result, report),
    )  # fmt: skip
    _write_json(output / "report.json", report)


def _clickable(name: str, result: Products, report: PairReport) -> Clickable:
    """What `uw_recon measure` reads of this folder: without metres no depth is written, and its filter not known."""
    kept = result.kept
    if not kept.geometry.metric:
        kept = replace(kept, disparity=result.disparity.disparity, sigma=result.disparity.sigma)
    sigmas = result.rectified.quality.origin.depth_sigmas
    return Clickable(replace(kept, stamp_ns=0), name, sigmas, report["reliable"])


def _expect_surface(result: Products, left: str | Path, right: str | Path) -> None:
    """Refuse what would be files without content."""
    if not len(result.surface.faces):
        points = int(np.isfinite(result.cloud.points).all(axis=-1).sum())
        raise EstimationError(
            f"{left}, {right}: expected depth on many pixels, got {points} points and no surface: do both show the "
            "same scene, sharp and lit, left and right not swapped? The enhanced images show what was matched",
            Code.MATCH_NOTHING,
        )


def reconstruct_files(
    left: str | Path,
    right: str | Path,
    output: str | Path,
    params: PipelineParams,
    calibration: Paths | None = None,
    *,
    overwrite: bool = False,
) -> PairReport:
    """Reconstruct two image files into a folder; return what ``report.json`` holds.

    Raises
    ------
    ReconError
        What the files did not allow. When the pair was read but did not come through, the folder holds a report with
        the reason, and the enhanced images where there are any.
    """
    output = Path(output)
    pair = read_pair(left, right, calibration)
    pipeline = Pipeline(params)  # refuses parameters before there is a folder
    claim_folder(output, overwrite)
    tell_if_cold(say, [params.match.method])
    stages: list[str] = []

    def announce(stage: str) -> None:
        stages.append(stage)
        say(f"{stage} ...")

    result = pipeline.begin(pair, announce)
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


def match_files(
    left: str | Path, right: str | Path, output: str | Path, params: MatchParams, *, overwrite: bool = False
) -> PairReport:
    """Match two rectified image files into a file of the format its name says; return the numbers.

    Raises
    ------
    ReconError
    """
    _claim_file(Path(output), overwrite)
    ready, findings = ready_to_match(read_pair(left, right), params.min_disparity)
    match, timed = Match(params), Stopwatch()
    tell_if_cold(say, [params.method])
    match.warm_up()
    with timed("match"):
        result, _ = match.images(ready)
    write_disparity(output, result.disparity)
    return {
        "method": result.method,
        "effort": params.effort if params.method == "graph_cut" else None,
        "energy": finite(result.energy),
        "seconds": timed.seconds["match"],
        "density": result.density,
        "min_disparity": result.min_disparity,
        "max_disparity": result.max_disparity,
        "residual_row_px": finite(result.rows.median_px),
        "warnings": [finding.as_dict() for finding in severe(findings)],
    }
