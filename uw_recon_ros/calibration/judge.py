"""Whether a calibration can be true: the one judge that commands, nodes, `info` and the doctor ask."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.types import Axis, CameraModel, DepthMap, Matrix, StereoCalibration

#: What a rig's baseline can be, m: camera modules do not stand closer, no vehicle carries a longer bar. Millimetres
#: taken for metres (60 m) and P[3] in metres instead of px m (0.2 mm) both lie far outside.
BASELINE_RANGE_M = (0.005, 5.0)
LONG_BASELINE_M = 2.0  #: beyond it a rig can be, yet hardly one is: a unit that was mistaken is more likely
#: Median depth over baseline. Nearer than 1, views hardly overlap; farther than 2000, disparities are under a pixel.
DEPTH_RANGE_BASELINES = (1.0, 2000.0)
#: Median depth, m, that no water is clear enough for; inches taken for metres put a metre at forty.
FARTHEST_SEEN_M = 30.0
#: Distortion models, and how many coefficients each may have.
DISTORTION_COUNTS = {"plumb_bob": (4, 5), "rational_polynomial": (8, 12, 14), "equidistant": (4,)}
SAME_FOCAL = 1e-3  #: relative difference of the focal lengths of both P that counts as equal
#: Difference of the principal points across the baseline that counts as equal: what roundings of P leave; what the
#: images make of it, the rows of tie points tell.
SAME_ROW_PX = 0.5

_SAME_PROPORTIONS = 0.01  # relative difference: what rounding to whole and even pixels leaves
_ROTATION = 1e-3  # largest element of R R^T - I
_SCALED = 1.25  # K and P whose focal length and centre differ by one factor beyond this are of two resolutions
_APART = 4.0  # focal lengths of K and P: what rectification may shrink or enlarge a view, and more
_OFF_CENTRE = 1.6  # principal point over image centre, or its inverse, in both directions alike
_ALIKE = 0.1  # relative difference of factors that counts as one factor
_ORTHOGRAPHIC = -1 / 6  # k1 of sin(theta), the strongest compression of a lens that images a half space


@dataclass(frozen=True)
class Judgement:
    """What a calibration is worth.

    Parameters
    ----------
    findings : tuple of Finding
        What is wrong, and what could not be checked.
    axis : {'horizontal', 'vertical'}
    baseline_m : float
        Signed, m, negative for a vertical rig whose second camera is above; NaN where P has none.
    """

    findings: tuple[Finding, ...]
    axis: Axis = "horizontal"
    baseline_m: float = float("nan")

    @property
    def refusal(self) -> Finding | None:
        """The first reason to refuse the calibration."""
        return next((f for f in self.findings if f.severity == Severity.REFUSED), None)

    def raise_refused(self) -> None:
        """Raise `CalibrationError`, with its code, where the calibration is refused."""
        if self.refusal is not None:
            raise CalibrationError(str(self.refusal), self.refusal.code)


def _refused(code: Code, text: str, advice: str = "") -> Finding:
    return Finding(code, text, Severity.REFUSED, advice)


@np.errstate(over="ignore", divide="ignore", invalid="ignore")  # numbers of strangers
def judge_calibration(calibration: StereoCalibration, image_size: tuple[int, int] | None = None) -> Judgement:
    """Judge the numbers of a stereo calibration.

    Parameters
    ----------
    calibration : StereoCalibration
    image_size : (width, height) or None
        Of the images it is for, px; None: not known here.

    Returns
    -------
    Judgement
        Rows (R lost, transposed or swapped; D lost) need tie points, and are measured where images are rectified.
    """
    left, right = calibration.left, calibration.right
    findings = [
        *_of_camera("left", left, image_size), *_of_camera("right", right, image_size), *_together(left, right),
    ]  # fmt: skip
    if not has_baseline(calibration):
        return Judgement((*findings, *_no_baseline()))
    axis, baseline = _axis_and_baseline(left.p, right.p)
    findings += [*_baseline(left.p, right.p, axis), *judge_baseline(baseline), *_across(left.p, right.p, axis)]
    return Judgement(tuple(findings), axis, baseline)


def has_baseline(calibration: StereoCalibration) -> bool:
    """Whether the cameras are calibrated to each other, and not each for itself."""
    return bool(calibration.left.p[:2, 3].any() or calibration.right.p[:2, 3].any())


def judge_baseline(baseline_m: float) -> tuple[Finding, ...]:
    """Hold a baseline, m, against what a rig can be."""
    low, high = BASELINE_RANGE_M
    if low <= abs(baseline_m) <= LONG_BASELINE_M:
        return ()
    if LONG_BASELINE_M < abs(baseline_m) <= high:
        text = f"right P: expected a baseline up to {LONG_BASELINE_M:g} m, as rigs have, got {abs(baseline_m):.4g} m"
        advice = "measure it with a ruler: is the unit right?"
        return (Finding(Code.CALIBRATION_BASELINE_IMPLAUSIBLE, text, advice=advice),)
    large = abs(baseline_m) > high
    cause = "millimetres instead of metres" if large else "P[3] in metres instead of px m (-fx B)"
    other = ", or uw_recon convert-calibration --unit mm (cm, in)" if large else ""
    text = f"right P: expected a baseline of {low:g} to {high:g} m, got {abs(baseline_m):.6g} m"
    return (
        _refused(Code.CALIBRATION_BASELINE_IMPLAUSIBLE, text, f"is it {cause}? write P[3] = -fx B, B in metres{other}"),
    )


def judge_depth(median_depth_m: float, baseline_m: float) -> tuple[Finding, ...]:
    """Hold a scene's median depth, m, against the baseline, m, that measured it."""
    low, high = (factor * abs(baseline_m) for factor in DEPTH_RANGE_BASELINES)
    high = max(low, min(high, FARTHEST_SEEN_M))
    if low <= median_depth_m <= high:
        return ()
    text = f"median depth: expected {low:g} to {high:g} m in water, with a baseline of {abs(baseline_m):g} m"
    got = f"{text}, got {median_depth_m:g} m"
    return (Finding(Code.CALIBRATION_DEPTH_IMPLAUSIBLE, got, Severity.UNRELIABLE, "check the calibration's units"),)


def judge_depths(depth: DepthMap) -> tuple[Finding, ...]:
    """Hold a depth map's median against its baseline; nothing where there are no metres."""
    baseline = depth.geometry.baseline_m
    valid = depth.depth[np.isfinite(depth.depth)]
    if baseline is None or not depth.geometry.metric or not valid.size:
        return ()
    return judge_depth(float(np.median(valid)), baseline)


def is_rotation(r: Matrix) -> bool:
    """Whether a (3, 3) matrix is a rotation, and no mirror; NaN is none."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.abs(r @ r.T - np.eye(3)).max() <= _ROTATION and np.linalg.det(r) > 0)


def same_proportions(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether images of two sizes may show the same view, in more or fewer pixels."""
    return abs(one[0] * other[1] / (one[1] * other[0]) - 1) <= _SAME_PROPORTIONS


def _of_camera(side: str, camera: CameraModel, image_size: tuple[int, int] | None) -> Iterator[Finding]:
    size = camera.width, camera.height
    if image_size is not None and size != image_size:
        text = f"{side} calibration: expected {image_size[0]}x{image_size[1]} px as the images, got {size[0]}x{size[1]}"
        yield _refused(Code.CALIBRATION_SIZE_DIFFERS, text + _binned(camera), _for_size(size, image_size))
    if not is_rotation(camera.r):
        yield _refused(Code.CALIBRATION_NOT_A_ROTATION, f"{side} R: expected a rotation, got {camera.r.tolist()}")
    if abs(camera.p[0, 1]) > 1e-6 * camera.p[0, 0] or camera.p[1, 0] or camera.p[2].tolist() != [0, 0, 1, 0]:
        text = f"{side} P: expected [fx 0 cx Tx; 0 fy cy Ty; 0 0 1 0], got {camera.p.tolist()}"
        yield _refused(Code.CALIBRATION_PROJECTION, text)
    yield from _resolution(side, camera)
    yield from _lens(side, camera)
    if not camera.d.any() and _turned(camera.r) and not np.allclose(camera.k, camera.p[:, :3]):
        text = f"{side} D: expected the lens of a camera that R turns, got zeros: a lens without distortion, or D lost"
        advice = "look into the calibration file; set images_rectified where the images come rectified"
        yield Finding(Code.CALIBRATION_DISTORTION_LOST, text, Severity.WARN, advice)


def _for_size(size: tuple[int, int], image_size: tuple[int, int]) -> str:
    """What to do about a calibration of another size: of other proportions a mode shows another part of the scene."""
    if not same_proportions(size, image_size):
        return "calibrate at the resolution used"
    return (
        f"where this mode shows the same view, uw_recon convert-calibration --size {image_size[0]}x{image_size[1]}; "
        "else calibrate at the resolution used"
    )


def _turned(r: Matrix) -> bool:
    return bool(np.abs(r - np.eye(3)).max() > _ROTATION)


def _binned(camera: CameraModel) -> str:
    if camera.binning == (1, 1):
        return ""
    x, y = camera.binning
    return f" (width and height of the full sensor, by REP 104, divided by its binning_x {x} and binning_y {y})"


def _resolution(side: str, camera: CameraModel) -> Iterator[Finding]:
    """K, P and the image are of one resolution."""
    k, p = _scales(camera.k), _scales(camera.p)
    factors = p / np.where(k > 0, k, np.nan)
    if _one_factor(factors, _SCALED):
        text = f"{side} P: expected the resolution of K, got focal length and centre {factors.mean():.2f} times K's"
        yield _refused(Code.CALIBRATION_RESOLUTION, text, "scale K and P to the image's resolution")
    elif camera.distortion_model != "equidistant" and not 1 / _APART <= factors[0] <= _APART:
        text = f"{side} P: expected a focal length like K's, got {p[0]:g} px, {factors[0]:.3g} times K's {k[0]:g} px"
        yield _refused(Code.CALIBRATION_RESOLUTION, text, "one of the two is wrong: look into the calibration file")
    centre = k[1:] / (camera.width / 2, camera.height / 2)
    if _one_factor(centre, _OFF_CENTRE):
        text = (
            f"{side} K: expected the principal point near the middle of {camera.width}x{camera.height} px, got "
            f"{k[1]:g}, {k[2]:g}, {centre.mean():.2f} times the middle in both directions"
        )
        yield Finding(
            Code.CALIBRATION_RESOLUTION, text, Severity.UNRELIABLE, "is K of another resolution than the image?"
        )


def _scales(matrix: Matrix) -> Matrix:
    """Focal length and principal point, what a change of resolution multiplies alike."""
    scales: Matrix = np.array([matrix[0, 0], matrix[0, 2], matrix[1, 2]])
    return scales


def _one_factor(factors: Matrix, beyond: float) -> bool:
    mean = float(factors.mean())  # NaN compares as false
    return bool(mean > 0 and np.abs(factors / mean - 1).max() < _ALIKE and max(mean, 1 / mean) > beyond)


def _lens(side: str, camera: CameraModel) -> Iterator[Finding]:
    if camera.distortion_model not in DISTORTION_COUNTS:
        if camera.d.any():
            text = f"{side} distortion_model: expected one of {', '.join(DISTORTION_COUNTS)}"
            yield _refused(Code.CALIBRATION_UNKNOWN_MODEL, f"{text}, got {ascii(camera.distortion_model)[:100]}")
        return
    if camera.distortion_model == "equidistant" and camera.d[0] < _ORTHOGRAPHIC:
        text = f"{side} D: expected k1 > {_ORTHOGRAPHIC:.2f} of an equidistant lens, got {camera.d[0]:g}"
        advice = "are these plumb_bob's numbers?"
        yield Finding(Code.CALIBRATION_DISTORTION_IMPLAUSIBLE, text, Severity.UNRELIABLE, advice)
    reach = _reach(camera)
    if reach < 1:
        text = f"{side} D: expected a lens that images every pixel once, got one that folds at {reach:.0%} of the way"
        yield _refused(
            Code.CALIBRATION_DISTORTION_IMPLAUSIBLE, f"{text} to the nearest edge",
            "check D and distortion_model, and the sign of D",
        )  # fmt: skip


def _reach(camera: CameraModel) -> float:
    """How far the lens maps one to one: its largest image radius over that of the nearest edge; at most 1."""
    fx, cx, cy = _scales(camera.k)
    edges = np.array([cx, camera.width - 1 - cx]) / fx, np.array([cy, camera.height - 1 - cy]) / camera.k[1, 1]
    edge = float(np.concatenate(edges).min())
    if edge <= 0:  # the principal point is outside the image: nothing to say about its edge
        return 1.0
    image = _image_radius(camera)
    folds = np.flatnonzero(~(np.diff(image) > 0))  # NaN counts as a fold
    return min(1.0, float(image[folds[0] if len(folds) else -1]) / edge)


def _image_radius(camera: CameraModel) -> Matrix:
    """(N,) radii in the normalized image of ever larger field angles, by the radial part of D."""
    equidistant = camera.distortion_model == "equidistant"
    theta = np.linspace(0, np.pi if equidistant else 1.55, 4000)
    r = theta if equidistant else np.tan(theta)
    d = np.zeros(14)
    d[: camera.d.size] = camera.d
    k = d[:4] if equidistant else d[[0, 1, 4]]
    power = r[:, None] ** (2 * np.arange(1, len(k) + 1))
    below = 1.0 if equidistant else 1 + power @ d[5:8]
    with np.errstate(divide="ignore", invalid="ignore"):
        radius: Matrix = r * (1 + power @ k) / below
    return radius


def _together(left: CameraModel, right: CameraModel) -> Iterator[Finding]:
    if (left.width, left.height) != (right.width, right.height):
        text = (
            f"calibration: expected both cameras of one size, got {left.width}x{left.height} and "
            f"{right.width}x{right.height}"
        )
        yield _refused(Code.CALIBRATION_SIZE_DIFFERS, text)
    if left.d.any() and all(np.array_equal(getattr(left, name), getattr(right, name)) for name in ("k", "d", "r")):
        text = "left and right calibration: expected two cameras, got the same K, D and R twice"
        advice = "is the left camera_info sent for the right?"
        yield Finding(Code.CALIBRATION_IDENTICAL, text, Severity.UNRELIABLE, advice)
    if left.d.any() != right.d.any():
        lost = "right" if left.d.any() else "left"
        text = f"{lost} D: expected distortion as of the other camera, got zeros: D lost"
        yield Finding(Code.CALIBRATION_DISTORTION_LOST, text, Severity.UNRELIABLE, "look into the calibration file")
    focal = np.abs(np.diag(left.p)[:2] / np.diag(right.p)[:2] - 1).max()
    if focal > SAME_FOCAL:
        text = (
            f"P: expected one fx and fy for both rectified views, got fx {left.p[0, 0]:g} and {right.p[0, 0]:g}, "
            f"fy {left.p[1, 1]:g} and {right.p[1, 1]:g}"
        )
        yield _refused(Code.CALIBRATION_VIEWS_DIFFER, text)


def _no_baseline() -> Iterator[Finding]:
    text = "right P: expected P[3] = -fx B or P[7] = -fy B, got 0 and 0: two single cameras, not a stereo rig"
    yield Finding(Code.CALIBRATION_NO_BASELINE, text, Severity.WARN, "calibrate both cameras together")


def _axis_and_baseline(left: Matrix, right: Matrix) -> tuple[Axis, float]:
    metres = (right[:2, 3] - left[:2, 3]) / np.diag(right)[:2]
    along = int(np.argmax(np.abs(metres)))
    return ("horizontal", "vertical")[along], -float(metres[along])


def _baseline(left: Matrix, right: Matrix, axis: Axis) -> Iterator[Finding]:
    if np.abs(left[:2, 3]).max() > 1e-9:
        text = f"left P: expected P[3] = P[7] = 0, got {left[0, 3]:g} and {left[1, 3]:g}"
        advice = "are left and right swapped, or is the right camera's P sent for the left?"
        yield _refused(Code.CALIBRATION_BASELINE_LEFT, text, advice)
        return
    across, along = sorted(np.abs(right[:2, 3] / np.diag(right)[:2]))
    if across > 1e-6 * along:
        text = f"right P: expected either P[3] or P[7] to be 0, got {right[0, 3]:g} and {right[1, 3]:g}"
        yield _refused(Code.CALIBRATION_BASELINE_OBLIQUE, text)
    if axis == "horizontal" and right[0, 3] > 0:
        text = f"right P: expected P[3] = -fx B < 0, got {right[0, 3]:g}: the right camera would stand on the left"
        advice = "either the driver writes P[3] without its minus (mend P), or the cameras are swapped (swap them)"
        yield _refused(Code.CALIBRATION_BASELINE_SIGN, text, advice)


def _across(left: Matrix, right: Matrix, axis: Axis) -> Iterator[Finding]:
    row, name = (1, "cy") if axis == "horizontal" else (0, "cx")
    if abs(left[row, 2] - right[row, 2]) > SAME_ROW_PX:
        text = f"P: expected one {name} for both rectified views, got {left[row, 2]:g} and {right[row, 2]:g}"
        yield _refused(Code.CALIBRATION_VIEWS_DIFFER, text)
