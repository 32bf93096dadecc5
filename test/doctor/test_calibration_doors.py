"""One calibration, one answer: judge, `pair`, `info`, `survey`, rectify node and doctor tell the same code."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.sights import healthy, images, spoil
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from uw_recon_ros.bags import messages
from uw_recon_ros.bags.writer import BagWriter
from uw_recon_ros.calibration.judge import judge_calibration
from uw_recon_ros.cli import main
from uw_recon_ros.doctor.calibrations import check_calibration
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.files.calibrations import write_calibration
from uw_recon_ros.files.images import write_image
from uw_recon_ros.findings import Code, Severity
from uw_recon_ros.nodes.rectify_node import RigRectifier
from uw_recon_ros.pair import reconstruct_files
from uw_recon_ros.pipeline import PipelineParams
from uw_recon_ros.recordings.info import bag_info
from uw_recon_ros.recordings.listing import list_frames
from uw_recon_ros.recordings.options import Options
from uw_recon_ros.recordings.sources import find_sources
from uw_recon_ros.rectify import RectifyParams
from uw_recon_ros.rectify.tie_points import TiePoints
from uw_recon_ros.ros.messages import camera_info_message
from uw_recon_ros.ros.observer.recorder import camera_numbers
from uw_recon_ros.ros.pairs import calibration_from_infos
from uw_recon_ros.survey.rig_estimate import rectification_of
from uw_recon_ros.types import CameraModel, EnhancedPair, StereoCalibration

WIDTH, HEIGHT, FOCAL, BASELINE = 96, 72, 80.0, 0.12
SECOND = 1_000_000_000


def camera(tx: float, skew: float) -> CameraModel:
    k = np.array([[FOCAL + skew, 0, 47.5], [0, FOCAL + skew, 35.5], [0, 0, 1]])
    p = np.array([[FOCAL, 0, 47.5, tx], [0, FOCAL, 35.5, 0], [0, 0, 1, 0]])
    return CameraModel(WIDTH, HEIGHT, k, np.array([-0.1, 0.01, 0, 0, 0]), np.eye(3), p)


GOOD = StereoCalibration(camera(0.0, 0.0), camera(-FOCAL * BASELINE, 0.5))


def images_of() -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(5)
    left = np.kron(random.integers(20, 235, (HEIGHT // 2, WIDTH // 2)), np.ones((2, 2))).astype(np.uint8)
    return left, np.roll(left, -8, axis=1)


LEFT, RIGHT = images_of()


def p_of(camera: CameraModel, row: int, column: int, value: float) -> CameraModel:
    p = camera.p.copy()
    p[row, column] = value
    return replace(camera, p=p)


def both(change: Callable[[CameraModel], CameraModel]) -> StereoCalibration:
    return StereoCalibration(change(GOOD.left), change(GOOD.right))


def right(change: Callable[[CameraModel], CameraModel]) -> StereoCalibration:
    return StereoCalibration(GOOD.left, change(GOOD.right))


HALF, TWICE = np.diag([0.5, 0.5, 1.0]), np.diag([2.0, 2.0, 1.0])
TX = -FOCAL * BASELINE
REFUSED = {
    "millimetres": (right(lambda c: p_of(c, 0, 3, 1000 * TX)), Code.CALIBRATION_BASELINE_IMPLAUSIBLE),
    "metres, not px m": (right(lambda c: p_of(c, 0, 3, TX / 10_000)), Code.CALIBRATION_BASELINE_IMPLAUSIBLE),
    "sign": (right(lambda c: p_of(c, 0, 3, -TX)), Code.CALIBRATION_BASELINE_SIGN),
    "in both P": (both(lambda c: p_of(c, 0, 3, TX)), Code.CALIBRATION_BASELINE_LEFT),
    "oblique": (right(lambda c: p_of(c, 1, 3, 0.3 * TX)), Code.CALIBRATION_BASELINE_OBLIQUE),
    "P at half size": (both(lambda c: replace(c, p=HALF @ c.p)), Code.CALIBRATION_RESOLUTION),
    "K at half size": (both(lambda c: replace(c, k=HALF @ c.k)), Code.CALIBRATION_RESOLUTION),
    "of twice the size": (
        both(lambda c: replace(c, width=2 * WIDTH, height=2 * HEIGHT, k=TWICE @ c.k, p=TWICE @ c.p)),
        Code.CALIBRATION_SIZE_DIFFERS,
    ),
    "rows": (right(lambda c: p_of(c, 1, 2, 39.5)), Code.CALIBRATION_VIEWS_DIFFER),
    "focal lengths": (right(lambda c: p_of(c, 0, 0, 84.0)), Code.CALIBRATION_VIEWS_DIFFER),
    "a lens that folds": (
        both(lambda c: replace(c, d=np.array([-3.0, 0, 0, 0, 0]))), Code.CALIBRATION_DISTORTION_IMPLAUSIBLE,
    ),
}  # fmt: skip
MARKED = {
    "left's sent for right": (
        StereoCalibration(GOOD.left, replace(GOOD.left, p=GOOD.right.p)), Code.CALIBRATION_IDENTICAL,
    ),
    "D of one lost": (right(lambda c: replace(c, d=np.zeros(5))), Code.CALIBRATION_DISTORTION_LOST),
    "plumb_bob's numbers": (
        both(lambda c: replace(c, d=np.array([-0.3 + c.p[0, 3] / 1e4, 0.1, 0, 0]), distortion_model="equidistant")),
        Code.CALIBRATION_DISTORTION_IMPLAUSIBLE,
    ),
}  # fmt: skip
#: Of the cameras for themselves: no door gets as far as a rig.
CAMERAS = {
    "no rotation": (both(lambda c: replace(c, r=1.1 * np.eye(3))), Code.CALIBRATION_NOT_A_ROTATION),
    "not a number": (right(lambda c: replace(c, k=c.k * np.nan)), Code.CALIBRATION_NUMBERS),
    "unknown model": (right(lambda c: replace(c, distortion_model="fov")), Code.CALIBRATION_UNKNOWN_MODEL),
    "too few coefficients": (right(lambda c: replace(c, d=np.array([0.1, 0.2]))), Code.CALIBRATION_DISTORTION),
}


@dataclass(frozen=True)
class Case:
    """What a user has: files and a bag."""

    folder: Path
    calibration: StereoCalibration

    @property
    def bag(self) -> Path:
        path = self.folder / "bag"
        if not path.exists():
            with BagWriter(path) as writer:
                for side, image in (("left", LEFT), ("right", RIGHT)):
                    info = getattr(self.calibration, side)
                    writer.image(f"/{side}/image_raw", image, time_ns=SECOND, frame_id="l")
                    told = messages.camera_info_message(info, time_ns=SECOND, frame_id="l")
                    writer.message(f"/{side}/camera_info", told)
        return path

    @property
    def infos(self) -> tuple[CameraInfo, CameraInfo]:
        left, right = (camera_info_message(c, Header()) for c in (self.calibration.left, self.calibration.right))
        return left, right


Codes = set[Code]


def by_the_judge(case: Case) -> Codes:
    judgement = judge_calibration(case.calibration, (WIDTH, HEIGHT))
    return {finding.code for finding in judgement.findings}


def by_pair(case: Case) -> Codes:
    names = [str(case.folder / f"{side}.png") for side in ("left", "right")]
    for name, image in zip(names, (LEFT, RIGHT), strict=True):
        write_image(Path(name), image)
    write_calibration(case.calibration, case.folder / "rig.yaml")
    with pytest.raises(CalibrationError) as error:
        reconstruct_files(*names, case.folder / "out", PipelineParams(), case.folder / "rig.yaml")
    return {error.value.code}


def by_info(case: Case) -> Codes:
    found = bag_info(case.bag)
    assert found.reconstructable == (found.calibration == "metric")
    return {finding.code for finding in found.calibration_findings}


def by_survey(case: Case) -> Codes:
    listing = list_frames(find_sources([str(case.bag)]), Options())
    points = TiePoints(np.zeros((0, 2)), np.zeros((0, 2)), WIDTH, HEIGHT)
    try:
        found = rectification_of(points, listing.calibrations[0], RectifyParams())
    except CalibrationError as error:
        return {error.code}
    return {finding.code for finding in found.quality.warnings}


def by_node(case: Case) -> Codes:
    colors = [np.repeat(gray[..., None], 3, axis=2) for gray in (LEFT, RIGHT)]
    try:
        calibration = calibration_from_infos(*case.infos)
        pair = EnhancedPair(*colors, LEFT, RIGHT, calibration=calibration)
        found = RigRectifier.make(RectifyParams())(pair)
    except CalibrationError as error:
        return {error.code}
    return {finding.code for finding in found.quality.warnings}


def by_doctor(case: Case) -> Codes:
    seen = healthy()
    for side in ("left", "right"):
        seen = spoil(seen, f"{side}/image_raw", arrivals=images(width=WIDTH, height=HEIGHT))
    left, right = map(camera_numbers, case.infos)
    found = check_calibration(replace(seen, infos={"left": left, "right": right}))
    return {Code(finding.code) for finding in found if finding.code}


DOORS = {
    "judge": by_the_judge, "pair": by_pair, "info": by_info, "survey": by_survey, "node": by_node, "doctor": by_doctor,
}  # fmt: skip


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize("name", REFUSED)
def test_refused_with_one_code(tmp_path: Path, name: str, door: str) -> None:
    calibration, code = REFUSED[name]
    assert code in DOORS[door](Case(tmp_path, calibration))


@pytest.mark.parametrize("door", [door for door in DOORS if door != "pair"])
@pytest.mark.parametrize("name", MARKED)
def test_marked_with_one_code(tmp_path: Path, name: str, door: str) -> None:
    calibration, code = MARKED[name]
    assert code in DOORS[door](Case(tmp_path, calibration))
    found = judge_calibration(calibration).findings
    assert {f.severity for f in found if f.code == code} == {Severity.UNRELIABLE}


@pytest.mark.parametrize("door", ["pair", "info", "node", "doctor"])
@pytest.mark.parametrize("name", CAMERAS)
def test_cameras_that_cannot_be_are_refused_with_one_code(tmp_path: Path, name: str, door: str) -> None:
    calibration, code = CAMERAS[name]
    assert code in DOORS[door](Case(tmp_path, calibration))


@pytest.mark.parametrize("door", [door for door in DOORS if door != "pair"])
def test_a_good_calibration_passes_every_door(tmp_path: Path, door: str) -> None:
    found: Any = DOORS[door](Case(tmp_path, GOOD))
    assert not {code for code in found if code.value.startswith("calibration")}


def test_a_survey_ends_with_the_reason(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = Case(tmp_path, REFUSED["millimetres"][0]).bag
    assert main(["survey", str(bag), "-o", str(tmp_path / "out"), "--jobs", "1"]) == 1
    assert "millimetres" in capsys.readouterr().err
    assert main(["info", str(bag)]) == 1
