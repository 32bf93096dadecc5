"""What a calibration session lacks, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from uw_recon_ros.calibrate.bundle import Bundle, SeenPair
from uw_recon_ros.calibrate.coverage import corners_covered, covered, emptiest, near_points
from uw_recon_ros.calibrate.depth_error import DepthError, HeldOut
from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.types import Mask, Matrix

_CELLS = (5, 4)  # of an image, across and down, in which residuals are averaged
_COVERED, _CORNER_COVERED = 0.75, 0.25  # of an image and of each of its corners: near points of the board
_TILTED_DEG = 15.0  # mean angle between board and image that tells focal length from distance
_PAIRS = 15
_GOOD_PERCENT, _POOR_PERCENT = 1.0, 5.0  # of depth, over the whole view
_JUDGED_M = (0.5, 3.0)
_SYSTEMATIC = 0.5  # share of a cell's residual that does not average out, px over noise
_WORSE = 1.5  # held-out over fitted error


@dataclass(frozen=True, eq=False)
class CalibrationSession:
    """What the pairs together show.

    Parameters
    ----------
    near : two of (rows, columns) bool
        What of the left and of the right image is near a point of the board, see `coverage`.
    tilt_deg, distance_m : (P,) float64
        Of every pair: between the board and the left image plane; of the board's middle.
    """

    near: tuple[Mask, Mask]
    tilt_deg: Matrix
    distance_m: Matrix


def describe(bundle: Bundle, pairs: Sequence[SeenPair], points: Matrix, size: tuple[int, int]) -> CalibrationSession:
    """Coverage, tilt and distance of a session."""
    turns = Rotation.from_rotvec(bundle.poses[:, :3])
    middles = turns.apply(points.mean(axis=0)) + bundle.poses[:, 3:]
    tilt = np.rad2deg(np.arccos(np.clip(np.abs(turns.as_matrix()[:, 2, 2]), 0, 1)))
    left, right = (near_points(sightings, size) for sightings in ([p.left for p in pairs], [p.right for p in pairs]))
    return CalibrationSession((left, right), tilt, np.linalg.norm(middles, axis=1))


def advise(
    session: CalibrationSession, bundle: Bundle, pairs: Sequence[SeenPair], errors: Sequence[DepthError],
    held: HeldOut | None,
    size: tuple[int, int], *, held_out: bool = True,
) -> tuple[Finding, ...]:  # fmt: skip
    """Everything worth saying, the depth error first; `held_out`: whether pairs were to be left out of the fit."""
    return tuple(
        finding
        for part in (
            _depth(errors, len(pairs)), _coverage(session), _tilt(session), _number(pairs),
            _held_out(bundle, held) if held_out else (), _residuals(bundle, pairs, size),
        )
        for finding in part
    )  # fmt: skip


def _depth(errors: Sequence[DepthError], pairs: int) -> Iterator[Finding]:
    judged = [e for e in errors if _JUDGED_M[0] <= e.range_m <= _JUDGED_M[1] and np.isfinite(e.mean_percent)]
    if not judged:
        return
    worst = max(judged, key=lambda e: e.mean_percent)
    if worst.mean_percent <= _GOOD_PERCENT:
        return
    more = int(np.ceil(pairs * ((worst.mean_percent / _GOOD_PERCENT) ** 2 - 1)))
    severity = Severity.WARN if worst.mean_percent <= _POOR_PERCENT else Severity.UNRELIABLE
    wanted = f"{more} more pairs like these" if more <= 100 else "a new session: many more pairs"
    got = f"{worst.mean_percent:.2g} % at {worst.range_m:g} m"
    text = f"depth error by the calibration: expected at most {_GOOD_PERCENT:g} %, got {got}"
    advice = f"take {wanted}, tilted, some near {min(worst.range_m, 2.0):g} m, and cover the corners of both images"
    yield Finding(Code.CALIBRATE_DEPTH_ERROR, text, severity, advice)


def _coverage(session: CalibrationSession) -> Iterator[Finding]:
    for side, near in zip(("left", "right"), session.near, strict=True):
        bare = lacking(near)
        if not bare:
            continue
        corners = ", ".join(f"{name} {share:.0%}" for name, share in corners_covered(near).items())
        text = (
            f"{side} image: {covered(near):.0%} of it lies near points of the board (its corners: {corners}), expected "
            f"at least {_COVERED:.0%} and {_CORNER_COVERED:.0%} of each corner"
        )
        yield Finding(Code.CALIBRATE_COVERAGE, text, Severity.WARN, f"hold the board towards the {bare}")


def lacking(near: Mask) -> str:
    """The corners of an image that the board should be held towards, in words; empty: it is covered."""
    bare = [name for name, share in corners_covered(near).items() if share < _CORNER_COVERED]
    if not bare and covered(near) < _COVERED:
        bare = [emptiest(near)]
    return " and the ".join(bare)


def _tilt(session: CalibrationSession) -> Iterator[Finding]:
    mean = float(session.tilt_deg.mean())
    if mean < _TILTED_DEG:
        text = (
            f"board nearly parallel to the cameras: expected a mean tilt of {_TILTED_DEG:.0f} degrees, got {mean:.1f}"
        )
        yield Finding(Code.CALIBRATE_FLAT, text, Severity.WARN, "tilt the board by 20 to 40 degrees, to all sides")


def _number(pairs: Sequence[SeenPair]) -> Iterator[Finding]:
    if len(pairs) < _PAIRS:
        text = f"expected at least {_PAIRS} pairs, got {len(pairs)}"
        yield Finding(
            Code.CALIBRATE_FEW_PAIRS, text, Severity.WARN, f"take {_PAIRS - len(pairs)} more, 30 together are good"
        )


def _held_out(bundle: Bundle, held: HeldOut | None) -> Iterator[Finding]:
    if held is None:
        text = "too few pairs to leave some out of the fit: how well the calibration predicts was not checked"
        yield Finding(Code.CALIBRATE_HELD_OUT, text, Severity.WARN, "take eight pairs or more")
    elif held.rms_px > _WORSE * bundle.rms_px:
        text = (
            f"reprojection error of pairs left out of the fit: {held.rms_px:.2f} px, of those in it: "
            f"{bundle.rms_px:.2f} px"
        )
        yield Finding(Code.CALIBRATE_HELD_OUT, text, Severity.WARN, "the fit follows its own noise: take more pairs")


def mean_residuals(
    bundle: Bundle, pairs: Sequence[SeenPair], side: int, size: tuple[int, int]
) -> tuple[Matrix, Matrix]:
    """Mean residual (rows, columns, 2) px in every cell of an image, NaN where there is none, and the counts."""
    pixels = np.concatenate([(pair.left, pair.right)[side].pixels for pair in pairs])
    misses = np.concatenate([residual[side] for residual in bundle.residuals])
    bins, limits = (_CELLS[1], _CELLS[0]), ((0, size[1]), (0, size[0]))
    counts, _, _ = np.histogram2d(pixels[:, 1], pixels[:, 0], bins=bins, range=limits)
    sums = [
        np.histogram2d(pixels[:, 1], pixels[:, 0], bins=bins, range=limits, weights=misses[:, k])[0] for k in (0, 1)
    ]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.stack([part / counts for part in sums], axis=-1), counts


def _residuals(bundle: Bundle, pairs: Sequence[SeenPair], size: tuple[int, int]) -> Iterator[Finding]:
    for side, name in enumerate(("left", "right")):
        means, counts = mean_residuals(bundle, pairs, side, size)
        known = counts >= 20
        if known.any():
            length = float(np.sqrt((means[known] ** 2).sum(axis=1).mean()))
            by_chance = bundle.noise_px * np.sqrt(2 * float((1 / counts[known]).mean()))
            if length > by_chance + _SYSTEMATIC * bundle.noise_px:
                text = (
                    f"{name} image: reprojection error of {length:.2f} px in the same direction over whole parts of "
                    "the "
                    f"image, by chance {by_chance:.2f}"
                )
                advice = "is the board flat, the lens as modelled, are both cameras triggered together?"
                yield Finding(Code.CALIBRATE_RESIDUALS, text, Severity.WARN, advice)
