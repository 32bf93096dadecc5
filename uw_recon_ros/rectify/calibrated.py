"""Rectification of a rig whose ``CameraInfo`` describes it, distortion included."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from uw_recon_ros.errors import CalibrationError, EstimationError
from uw_recon_ros.findings import Code, Finding, Severity, worst
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.port import PortCamera, ports_of, through_flat_ports
from uw_recon_ros.rectify.rectification import Rectification, behind, exchanged
from uw_recon_ros.rectify.rectified_camera import RectifiedCamera, Views
from uw_recon_ros.rectify.refraction_check import PortIndex, port_index
from uw_recon_ros.rectify.row_error import RowAgreement, not_checked, scale_withheld
from uw_recon_ros.rectify.stereo_info import judged_rig
from uw_recon_ros.rectify.tie_points import TiePoints
from uw_recon_ros.rectify.upright import check_upright
from uw_recon_ros.rectify.warp import inner_windows, make_canvas
from uw_recon_ros.types import (
    Axis,
    RectificationQuality,
    StereoCalibration,
    StereoGeometry,
    Window,
)

_MADE_IN_AIR = Finding(
    Code.CALIBRATION_MADE_IN_AIR,
    "metres withheld: the calibration was made in air (medium: air, or by its file), where depth in water comes out a "
    "quarter short",
    Severity.UNRELIABLE,
    "calibrate in water, or describe the port (port: flat)",
)


def _geometry(left: RectifiedCamera, right: RectifiedCamera, axis: Axis, baseline_m: float) -> StereoGeometry:
    along, across = (0, 1) if axis == "horizontal" else (1, 0)
    return StereoGeometry(
        focal_px=float(left.k_new[along, along]),
        cx_left=float(left.k_new[along, 2]),
        cx_right=float(right.k_new[along, 2]),
        cy=float(left.k_new[across, 2]),
        baseline_m=baseline_m,
        axis=axis,
        baseline_sign=1 if baseline_m > 0 else -1,
        focal_across_px=float(left.k_new[across, across]),
        rect_from_raw_left=tuple(tuple(float(x) for x in row) for row in left.r),
    )


def _as_given(views: Views, size: tuple[int, int], geometry: StereoGeometry) -> Rectification:
    return Rectification(*views, *size, *size, geometry=geometry, quality=RectificationQuality("given"))


def _warped(
    views: Views, size: tuple[int, int], geometry: Callable[[RectifiedCamera, RectifiedCamera], StereoGeometry],
    params: RectifyParams,
) -> Rectification:  # fmt: skip
    """Both cameras keep the same columns, so that the offset stays what P says (0, most often)."""
    canvases = [make_canvas(view, *size, *size) for view in views]
    window, _ = inner_windows((canvases[0].shown, canvases[1].shown), same_columns=True)
    share = window.width * window.height / (size[0] * size[1])
    if share < params.rectify_min_area:
        raise CalibrationError(
            f"calibration: expected the rectified views to share at least {params.rectify_min_area:.0%} of the image, "
            f"got {share:.0%}"
        )
    kept, valid = (window, None) if params.rectify_crop else (Window(0, 0, *size), window)
    left, right = (view.moved(kept.u, kept.v) for view in views)
    return Rectification(
        left, right, *size, kept.width, kept.height, geometry=geometry(left, right),
        quality=RectificationQuality("calibrated"), left_map=canvases[0].part(kept), right_map=canvases[1].part(kept),
        valid_left=valid, valid_right=valid,
    )  # fmt: skip


def _check_sides(rectification: Rectification, tie_points: TiePoints) -> None:
    """Refuse images whose matches contradict the calibration: a camera upside down, swapped cameras."""
    check_upright(*rectification.rectified(tie_points))
    if exchanged(rectification, tie_points):
        found = behind(rectification, tie_points)
        parallax = np.nanmedian(rectification.parallax(tie_points)) * rectification.geometry.baseline_sign
        horizontal = rectification.geometry.axis == "horizontal"
        shown = "right camera on the left" if horizontal else "second camera on the other side"
        raise EstimationError(
            "left and right images are swapped: expected disparities of the calibration's sign, got "
            f"{found.mean():.0%} of {len(found)} "
            f"tie points behind the rig (median {parallax:.1f} px): the images show the {shown}; swap the images, "
            "or the calibrations",
            Code.RECTIFY_EXCHANGED,
        )


def judged(rectification: Rectification, tie_points: TiePoints, params: RectifyParams) -> Rectification:
    """Measure a calibrated rectification on tie points, none of which it was made from.

    Over `row_withhold_permille`, and where the rows say that it was made in air and is used in water (unless `medium`
    is ``as_used``), what comes back has no scale, so that no door gives out metres.

    Parameters
    ----------
    rectification : Rectification
        Made by `rectification_from_calibration`.
    tie_points : TiePoints
        Raw px.
    params : RectifyParams

    Raises
    ------
    EstimationError
        The cameras are swapped.
    """
    _check_sides(rectification, tie_points)
    rows = RowAgreement.measured(rectification, tie_points)
    medium, findings = _medium(rectification, tie_points, rows, params)
    quality = replace(
        rectification.quality,
        row_error_median_px=rows.median_px,
        row_error_p95_px=rows.p95_px,
        inliers=len(tie_points),
        warnings=_of_calibration(rectification) + findings,
        medium=medium,
    )
    return _with_what_is_told(rectification, quality)


def _with_what_is_told(rectification: Rectification, quality: RectificationQuality) -> Rectification:
    """The rectification with its quality; without metres where the warnings take them away."""
    geometry = rectification.geometry.unscaled if scale_withheld(quality.warnings) else rectification.geometry
    return replace(rectification, quality=quality, geometry=geometry)


def _told_origin(rectification: Rectification, calibration: StereoCalibration) -> Rectification:
    return rectification.with_quality(replace(rectification.quality, origin=calibration.origin))


def made_in(rectification: Rectification, params: RectifyParams) -> str:
    """What the calibration was made in, as `medium` has it: by the parameter, else by the calibration's file."""
    if params.medium != "unknown":
        return params.medium
    return {"water": "as_used", "air": "air"}.get(rectification.quality.origin.medium, "unknown")


def _medium(
    rectification: Rectification, tie_points: TiePoints, rows: RowAgreement, params: RectifyParams
) -> tuple[str, tuple[Finding, ...]]:
    """In what the rig works, by its rows, and what is to be told of them."""
    findings = rows.findings(params)
    if isinstance(rectification.left, PortCamera):
        return "water", findings  # by what was told of the ports
    if worst(_of_calibration(rectification)) >= Severity.UNRELIABLE:  # a wrong resolution looks like water
        return "", findings
    found = port_index(tie_points, rectification.left, rectification.right, rectification.geometry.axis)
    if found is None or found.medium != "water":
        return "cannot tell" if found is None else found.medium, findings
    others = (f for f in findings if f.code not in (Code.RECTIFY_ROWS_DISAGREE, Code.RECTIFY_SCALE_WITHHELD))
    in_water = made_in(rectification, params) == "as_used"
    withheld = () if in_water else (_metres_of_air(found.index),)
    return found.medium, (_in_air(found, told=in_water), *withheld, *others)


def _in_air(found: PortIndex, *, told: bool) -> Finding:
    text = (
        f"calibrated in air, used in water? "
        f"vertical (epipolar) error is {found.row_error_at_one_px:.1f} px (median, their common "
        f"shift apart); a focal length {found.index:.2f} times as long, as water behind flat ports makes it, leaves "
        f"{found.row_error_px:.1f} px: depth would be about {1 - 1 / found.index:.0%} short"
    )
    contrary = " (medium: as_used, or the calibration's file, says that it was made in water)" if told else ""
    return Finding(Code.RECTIFY_CALIBRATED_IN_AIR, text + contrary, Severity.UNRELIABLE, "calibrate in water")


def _metres_of_air(index: float) -> Finding:
    return Finding(
        Code.RECTIFY_SCALE_WITHHELD,
        f"metres withheld: by the vertical (epipolar) error the calibration was made in air, depth in water is "
        f"{1 - 1 / index:.0%} short",
        Severity.UNRELIABLE,
        "calibrate in water, or say medium: as_used if that was done",
    )


def unjudged(rectification: Rectification, why: str, code: Code | None = None) -> Rectification:
    """The same rectification, marked as one that nothing could be measured on; `code` is of what stood against it.

    Without metres where both images are rich and share nothing.
    """
    findings = not_checked(why, code)
    quality = replace(rectification.quality, warnings=_of_calibration(rectification) + findings)
    return _with_what_is_told(rectification, quality)


def _marked(rectification: Rectification, findings: tuple[Finding, ...]) -> Rectification:
    """The rectification with what the judge of calibrations found."""
    quality = rectification.quality
    return rectification.with_quality(replace(quality, warnings=quality.warnings + findings))


def _of_calibration(rectification: Rectification) -> tuple[Finding, ...]:
    """What stays true of every pair: the calibration's findings."""
    return tuple(
        f
        for f in rectification.quality.warnings
        if f.code == Code.RECTIFY_PORT or f.code.value.startswith("calibration.")
    )


def rectification_from_calibration(
    calibration: StereoCalibration,
    params: RectifyParams,
    tie_points: TiePoints | None = None,
    image_size: tuple[int, int] | None = None,
) -> Rectification:
    """Rectify as ``CameraInfo`` says: R and P of both cameras, distortion included.

    Parameters
    ----------
    calibration : StereoCalibration
        Extrinsics are those of R and P; a rig whose D = 0, R = I and P = [K | ...] came rectified and stays as it is.
    params : RectifyParams
    tie_points : TiePoints or None
        To measure the row error on, and to notice swapped cameras or a calibration made in air.
    image_size : (width, height) or None
        Of the images, px, which the calibration must be for; None: not known here.

    Returns
    -------
    Rectification
        Metric.

    Raises
    ------
    CalibrationError
        The numbers do not describe a stereo rig.
    EstimationError
        The tie points say that left and right are swapped.
    """
    judgement = judged_rig(calibration, image_size)
    axis, baseline = judgement.axis, judgement.baseline_m
    size = calibration.left.width, calibration.left.height
    left, right = RectifiedCamera.of_camera(calibration.left), RectifiedCamera.of_camera(calibration.right)
    told = judgement.findings
    ports = ports_of(params) if params.port == "flat" else calibration.origin.ports
    if ports is not None:
        views = through_flat_ports((left, right), baseline, axis, size, ports, params.port_range_m)
        left, right, baseline, told = *views[:3], (*told, views[3])
    if left.identity and right.identity:
        rectification = _as_given((left, right), size, _geometry(left, right, axis, baseline))
    else:
        rectification = _warped((left, right), size, lambda le, ri: _geometry(le, ri, axis, baseline), params)
    rectification = _marked(_told_origin(rectification, calibration), told)
    if made_in(rectification, params) == "air" and ports is None:
        rectification = _marked(replace(rectification, geometry=rectification.geometry.unscaled), (_MADE_IN_AIR,))
    return rectification if tie_points is None else judged(rectification, tie_points, params)
