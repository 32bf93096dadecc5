"""From tie points to a rectification, without any calibration (paper 2.2)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.rectify.camera_order import sided
from uw_recon_ros.rectify.lens_search import find_lens
from uw_recon_ros.rectify.model_selection import Candidate, choose_axis, rows_already_aligned
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.quality import flatness_warnings, forward_motion, refusals
from uw_recon_ros.rectify.rectification import Rectification, row_statistics
from uw_recon_ros.rectify.rectified_camera import RectifiedCamera, Views
from uw_recon_ros.rectify.row_error import row_noise
from uw_recon_ros.rectify.shape import USUAL_FOCAL, projective, shape_sigma, with_lens
from uw_recon_ros.rectify.tie_points import TiePoints, thinned
from uw_recon_ros.rectify.upright import check_upright
from uw_recon_ros.rectify.warp import inner_windows, make_canvas, swapped_map, swapped_window, warped_centre
from uw_recon_ros.types import Axis, Matrix, RectificationQuality, StereoGeometry, Window

_INFINITY_SIGMA_LIMIT_PX = 1.0


def _intrinsics(tie_points: TiePoints, focal_px: float) -> Matrix:
    u, v = (tie_points.width - 1) / 2, (tie_points.height - 1) / 2
    return np.array([[focal_px, 0.0, u], [0.0, focal_px, v], [0.0, 0.0, 1.0]])


def _rotation_rows(view: RectifiedCamera) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(x) for x in row) for row in view.r)


def _geometry(left: RectifiedCamera, right: RectifiedCamera, params: RectifyParams) -> StereoGeometry:
    """Of horizontal views; metres only where baseline and focal length are both given."""
    metric = params.baseline_m > 0 and params.focal_px > 0
    return StereoGeometry(
        focal_px=float(left.k_new[0, 0]),
        cx_left=float(left.k_new[0, 2]),
        cx_right=float(right.k_new[0, 2]),
        cy=float(left.k_new[1, 2]),
        baseline_m=params.baseline_m if metric else None,
        rect_from_raw_left=_rotation_rows(left),
    )


def _as_given(candidate: Candidate, params: RectifyParams) -> Rectification:
    """Leave the images as they are."""
    points = candidate.everything
    size = points.width, points.height
    k = _intrinsics(points, params.focal_px or USUAL_FOCAL * sum(size))
    view = RectifiedCamera(k, np.eye(3), k)
    return Rectification(
        view, view, *size, *size, geometry=_geometry(view, view, params), quality=RectificationQuality("given")
    )


def _refused(reasons: list[Finding]) -> EstimationError:
    return EstimationError("rectification refused: " + "; ".join(r.text for r in reasons), reasons[0].code)


def _distorted(text: str) -> Finding:
    return Finding(Code.RECTIFY_DISTORTED, text, Severity.REFUSED)


def _views(candidate: Candidate) -> Views | None:
    """Rotated views (eq. 14), ``K_new = K_old`` moved so that the images' centres stay near the middle, on one row.

    None where a centre would be behind its rectified camera.
    """
    points, fit = candidate.everything, candidate.fit
    k = _intrinsics(points, fit.focal_px)
    d = candidate.lens.distortion(fit.focal_px, points.width, points.height)
    views = [RectifiedCamera(k, rotation, k, d) for rotation in (fit.rotation_left, fit.rotation_right)]
    moves = np.array([warped_centre(view, points.width, points.height) for view in views]) - k[:2, 2]
    moves[:, 1] = moves[:, 1].mean()
    if not np.isfinite(moves).all():
        return None
    left, right = (view.moved(*move) for view, move in zip(views, moves, strict=True))
    return left, right


def _sound_views(candidate: Candidate, params: RectifyParams) -> Views:
    """The views, unless something speaks against them; said of the images as they were taken."""
    level, points = _views(candidate), candidate.everything
    upright = points if candidate.axis == "horizontal" else points.transposed()
    if level is None:
        raise _refused(forward_motion(upright) or [_distorted("the rectified cameras would look backwards")])
    left, right = level[0].rectified(candidate.held_out.left), level[1].rectified(candidate.held_out.right)
    errors = left[:, 1] - right[:, 1]
    noise = row_noise(errors, left, right, size=points.width)
    views = level if candidate.axis == "horizontal" else (level[0].transposed(), level[1].transposed())
    reasons = refusals(views, upright, row_statistics(errors), params, noise)
    if reasons:
        raise _refused(reasons)
    return level


def _warped(candidate: Candidate, views: Views, params: RectifyParams) -> Rectification:
    """Crop, or mark, what both horizontal views show, and make the maps."""
    size = candidate.everything.width, candidate.everything.height
    canvases = [make_canvas(view, *size, *size) for view in views]
    windows = inner_windows((canvases[0].shown, canvases[1].shown), same_columns=False)
    share = windows[0].width * windows[0].height / (size[0] * size[1])
    if share < params.rectify_min_area:
        text = f"expected at least {params.rectify_min_area:.0%} of the image to remain, got {share:.0%}"
        raise _refused(forward_motion(candidate.everything) or [_distorted(text)])
    kept = windows if params.rectify_crop else (Window(0, 0, *size),) * 2
    left, right = (view.moved(w.u, w.v) for view, w in zip(views, kept, strict=True))
    maps = [canvas.part(w) for canvas, w in zip(canvases, kept, strict=True)]
    valid = (None, None) if params.rectify_crop else windows
    return Rectification(
        left, right, *size, kept[0].width, kept[0].height,
        geometry=_geometry(left, right, params), quality=RectificationQuality("quasi-euclidean"),
        left_map=maps[0], right_map=maps[1], valid_left=valid[0], valid_right=valid[1],
        infinity_sigma_px=candidate.fit.infinity_sigma_px,
    )  # fmt: skip


def _shape_sigma(rectification: Rectification, candidate: Candidate, uncertain: tuple[float, float]) -> float:
    """Percent, of relative depths."""
    geometry = rectification.geometry
    moved = abs(geometry.offset_px - (rectification.right.k_new[0, 2] - rectification.left.k_new[0, 2]))
    infinity, focal = uncertain
    parallax = geometry.baseline_sign * rectification.parallax(candidate.everything)
    return shape_sigma(parallax, float(np.hypot(infinity, moved)), focal)


def _judged(
    rectification: Rectification, candidate: Candidate, warnings: tuple[Finding, ...], uncertain: tuple[float, float],
    params: RectifyParams,
) -> Rectification:  # fmt: skip
    """Row error on the held-out tie points, and what to beware of."""
    median, p95 = row_statistics(rectification.row_errors(candidate.held_out))
    sigma = rectification.infinity_sigma_px
    if rectification.geometry.metric and sigma > _INFINITY_SIGMA_LIMIT_PX:
        text = f"metres are vague: points at infinity may have a disparity of +-{sigma:.1f} px"
        warnings += (Finding(Code.RECTIFY_INFINITY_VAGUE, text),)
    flat = flatness_warnings(candidate.everything, params)
    shape = _shape_sigma(rectification, candidate, uncertain)
    quality = replace(
        rectification.quality,
        row_error_median_px=median,
        row_error_p95_px=p95,
        inliers=len(candidate.everything),
        warnings=warnings + flat + projective(shape, params),
        shape_sigma_percent=shape,
        lens_k1=float(rectification.left.d[0]),
    )
    return replace(rectification, quality=quality, flat=bool(flat))


def _upright(rectification: Rectification, axis: Axis) -> Rectification:
    """Back from the frame in which the axis is horizontal."""
    if axis == "horizontal":
        return rectification
    r = rectification
    left, right = r.left.transposed(), r.right.transposed()
    maps = [None if m is None else swapped_map(m) for m in (r.left_map, r.right_map)]
    valid = [None if w is None else swapped_window(w) for w in (r.valid_left, r.valid_right)]
    return Rectification(
        left, right, r.raw_height, r.raw_width, r.height, r.width,
        geometry=replace(r.geometry, axis=axis, rect_from_raw_left=_rotation_rows(left)), quality=r.quality,
        left_map=maps[0], right_map=maps[1], valid_left=valid[0], valid_right=valid[1],
        infinity_sigma_px=r.infinity_sigma_px, flat=r.flat,
    )  # fmt: skip


def estimate_rectification(tie_points: TiePoints, params: RectifyParams) -> Rectification:
    """Rectify a rig from tie points alone: quasi-Euclidean, or as given where the rows agree already.

    The disparity is honest, the scale is not known, and the focal length is a guess that makes rows agree: metres come
    only from ``baseline_m`` and ``focal_px`` given together. ``K_new`` equals ``K_old`` but for the principal points,
    which follow the crop; where infinity lies is approximated, see `uw_recon_ros.rectify.plane_at_infinity`.

    Parameters
    ----------
    tie_points : TiePoints
        Inliers of one epipolar geometry, from one frame or several.
    params : RectifyParams

    Returns
    -------
    Rectification
        Its quality is measured on tie points left out of the fit.

    Raises
    ------
    EstimationError
        Too few tie points, a camera upside down, forward motion, rows that disagree, distorted images, swapped cameras;
        with the numbers.
    """
    if len(tie_points) < params.tie_points_min:
        raise EstimationError(
            f"rectification: expected at least {params.tie_points_min} tie points, got {len(tie_points)}"
        )
    check_upright(tie_points.left, tie_points.right)
    candidate = choose_axis(thinned(tie_points, params.tie_points_max, params.rectify_seed), params)
    if rows_already_aligned(candidate, params):
        rectification = _as_given(candidate, params)
    else:
        candidate = find_lens(candidate, params)
        rectification = _warped(candidate, _sound_views(candidate, params), params)
    uncertain = with_lens(candidate, params)
    rectification, warnings = sided(rectification, candidate, uncertain[0])
    return _upright(_judged(rectification, candidate, warnings, uncertain, params), candidate.axis)
