"""One judge: calibrations that cannot be true are refused or marked by code, good ones never refused."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from uw_recon_ros.calibration import camera_from_info, make_camera
from uw_recon_ros.calibration.judge import judge_calibration, judge_depth, judge_depths
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.findings import Code, Severity, worst
from uw_recon_ros.rectify import RectifyParams
from uw_recon_ros.rectify.calibrated import rectification_from_calibration
from uw_recon_ros.types import CameraModel, StereoCalibration, StereoGeometry

K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
D = [-0.25, 0.08, 0.0, 0.0, 0.0]
HALF = np.diag([0.5, 0.5, 1.0])
LONG = np.array([[5000.0, 0, 320], [0, 5000, 240], [0, 0, 1]])


def camera(tx: float = 0.0, **change: Any) -> CameraModel:
    p = np.hstack([K, [[tx], [0], [0]]])
    return make_camera(**({"width": 640, "height": 480, "k": K, "d": D, "r": np.eye(3), "p": p} | change))


def projection(scale: np.ndarray[Any, Any], tx: float = 0.0) -> np.ndarray[Any, Any]:
    return scale @ np.hstack([K, [[tx], [0], [0]]])


BAD = {
    "millimetres": (camera(), camera(-60_000.0), Code.CALIBRATION_BASELINE_IMPLAUSIBLE),
    "metres, not px m": (camera(), camera(-0.12), Code.CALIBRATION_BASELINE_IMPLAUSIBLE),
    "sign": (camera(), camera(60.0), Code.CALIBRATION_BASELINE_SIGN),
    "both P": (camera(-60.0), camera(-60.0), Code.CALIBRATION_BASELINE_LEFT),
    "P of another size": (
        camera(p=projection(HALF)), camera(p=projection(HALF, -60)), Code.CALIBRATION_RESOLUTION,
    ),
    "K of ten times the focal length": (camera(k=LONG), camera(-60.0, k=LONG), Code.CALIBRATION_RESOLUTION),
    "K of another size": (camera(k=HALF @ K), camera(-60.0, k=HALF @ K), Code.CALIBRATION_RESOLUTION),
    "two sizes": (camera(), camera(-60.0, width=800), Code.CALIBRATION_SIZE_DIFFERS),
    "D negated": (camera(d=[-1.5, 0, 0, 0, 0]), camera(-60.0), Code.CALIBRATION_DISTORTION_IMPLAUSIBLE),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_true_is_refused(name: str) -> None:
    left, right, code = BAD[name]
    refusal = judge_calibration(StereoCalibration(left, right)).refusal
    assert refusal is not None
    assert refusal.code == code
    with pytest.raises(CalibrationError) as error:
        rectification_from_calibration(StereoCalibration(left, right), RectifyParams())
    assert error.value.code == code


def test_left_info_sent_for_right_is_named() -> None:
    assert Code.CALIBRATION_IDENTICAL in {
        f.code for f in judge_calibration(StereoCalibration(camera(), camera())).findings
    }


def test_plumb_bob_numbers_called_equidistant_are_marked() -> None:
    lens = {"d": [-0.25, 0.08, 0.0, 0.0], "distortion_model": "equidistant"}
    rig = StereoCalibration(camera(**lens), camera(-60.0, **lens))
    assert worst(judge_calibration(rig).findings) >= Severity.UNRELIABLE


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"r": np.diag([1.0, 1, -1])}, Code.CALIBRATION_NOT_A_ROTATION),
        ({"k": K * np.nan}, Code.CALIBRATION_NUMBERS),
        ({"d": [1.0], "distortion_model": "fancy"}, Code.CALIBRATION_UNKNOWN_MODEL),
        ({"d": [0.1, 0.0, 0.0, 0.0], "distortion_model": ""}, Code.CALIBRATION_UNKNOWN_MODEL),
    ],
)
def test_numbers_of_one_camera(change: dict[str, Any], code: Code) -> None:
    with pytest.raises(CalibrationError) as error:
        camera(**change)
    assert error.value.code == code


def test_sizes_are_held_against_the_images() -> None:
    refusal = judge_calibration(StereoCalibration(camera(), camera(-60.0)), (320, 240)).refusal
    assert refusal is not None
    assert refusal.code == Code.CALIBRATION_SIZE_DIFFERS
    assert "binning" not in refusal.text


@pytest.mark.parametrize(("images", "scaled"), [((320, 240), True), ((1280, 961), True), ((1280, 720), False)])
def test_a_size_of_the_same_proportions_is_said_to_be_scalable(images: tuple[int, int], scaled: bool) -> None:
    refusal = judge_calibration(StereoCalibration(camera(), camera(-60.0)), images).refusal
    assert refusal is not None
    assert (f"convert-calibration --size {images[0]}x{images[1]}" in refusal.advice) is scaled


def test_binning_is_named_where_a_binned_size_does_not_fit() -> None:
    binned = camera_from_info(message(2, (0, 0, 0, 0)))
    refusal = judge_calibration(StereoCalibration(binned, binned), (640, 480)).refusal
    assert refusal is not None
    assert refusal.code == Code.CALIBRATION_SIZE_DIFFERS
    assert "binning_x 2" in refusal.text


def test_nothing_is_said_of_a_sound_calibration() -> None:
    assert (
        judge_calibration(StereoCalibration(camera(), camera(-60.0, d=[-0.24, 0.07, 0, 0, 0])), (640, 480)).findings
        == ()
    )


def test_depth_is_held_against_the_baseline() -> None:
    assert not judge_depth(2.0, 0.12)
    assert judge_depth(1256.0, 0.12)[0].code == Code.CALIBRATION_DEPTH_IMPLAUSIBLE


@pytest.mark.parametrize(("baseline_m", "expected"), [(0.12, 0), (0.0006, 1), (None, 0)])
def test_a_depth_map_is_held_against_its_baseline(baseline_m: float | None, expected: int) -> None:
    depth: Any = SimpleNamespace(
        depth=np.array([[np.nan, 2.0, 3.0]]), geometry=StereoGeometry(100.0, 1.0, 1.0, 0.0, baseline_m=baseline_m)
    )
    found = judge_depths(depth)
    assert [f.severity for f in found] == [Severity.UNRELIABLE] * expected


def message(binning: int, roi: tuple[int, int, int, int]) -> SimpleNamespace:
    names = ("x_offset", "y_offset", "width", "height")
    return SimpleNamespace(
        width=640, height=480, k=K.ravel(), d=D, r=np.eye(3).ravel(), p=projection(np.eye(3), -60).ravel(),
        distortion_model="plumb_bob", header=SimpleNamespace(frame_id=""), binning_x=binning, binning_y=binning,
        roi=SimpleNamespace(**dict(zip(names, roi, strict=True))),
    )  # fmt: skip


def test_binning_and_roi_move_pixels_as_the_sensor_does() -> None:
    got = camera_from_info(message(2, (100, 40, 400, 200)))
    point = np.array([0.2, -0.1, 2.0, 1.0])
    full, binned = (p @ point for p in (projection(np.eye(3), -60), got.p))
    np.testing.assert_allclose((full[:2] / full[2] - (100, 40)) / 2, binned[:2] / binned[2])
    assert (got.width, got.height) == (200, 100)


def test_a_region_outside_the_sensor_is_refused() -> None:
    with pytest.raises(CalibrationError) as error:
        camera_from_info(message(1, (600, 0, 100, 100)))
    assert error.value.code == Code.CALIBRATION_BINNING


@given(
    width=st.integers(160, 4000), aspect=st.floats(0.5, 1.0), focal=st.floats(0.5, 2.0), baseline=st.floats(0.006, 4.9),
    centre=st.tuples(st.floats(0.45, 0.55), st.floats(0.45, 0.55)), k1=st.floats(-0.05, 0.2),
    degrees=st.floats(-5, 5), vertical=st.booleans(), binning=st.sampled_from([1, 2, 4]), crop=st.floats(0.3, 1.0),
)  # fmt: skip
@settings(derandomize=True, max_examples=200, deadline=None)
def test_good_calibrations_are_never_refused(
    width: int, aspect: float, focal: float, baseline: float, centre: tuple[float, float], k1: float, degrees: float,
    vertical: bool, binning: int, crop: float,
) -> None:  # fmt: skip
    height, f = int(width * aspect), width * focal
    k = np.array([[f, 0, width * centre[0]], [0, f, height * centre[1]], [0, 0, 1]])
    cameras = []
    for shift in (0.0, -f * baseline):
        info = message(binning, (0, 0, int(width * crop), int(height * crop)))
        p = np.hstack([k, [[0.0 if vertical else shift], [shift if vertical else 0.0], [0]]])
        r = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
        info.width, info.height, info.k, info.p, info.r, info.d = width, height, k, p, r, [k1, 0, 0, 0, 0]
        cameras.append(camera_from_info(info))
    judgement = judge_calibration(StereoCalibration(*cameras))
    assert judgement.refusal is None
    assert abs(judgement.baseline_m) == pytest.approx(baseline)
    assert judgement.axis == ("vertical" if vertical else "horizontal")


def test_a_baseline_in_inches_is_told_by_depths_that_no_water_shows() -> None:
    inches = 0.12 / 0.0254
    assert judge_depth(1.25 / 0.0254, inches)[0].severity == Severity.UNRELIABLE
    assert not judge_depth(1.25, 0.12)
