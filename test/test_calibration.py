"""Calibrations as YAML files and messages."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from uw_recon_ros.calibration import camera_from_info, make_camera
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.files.calibrations import read_calibration, write_calibration
from uw_recon_ros.types import StereoCalibration

FIELDS = {
    "width": 640, "height": 480, "k": [500, 0, 320, 0, 510, 240, 0, 0, 1], "d": [0.1, -0.2, 0.001, 0.002, 0.05],
    "r": np.eye(3).ravel(), "p": [500, 0, 320, -60, 0, 500, 240, 0, 0, 0, 1, 0], "distortion_model": "plumb_bob",
}  # fmt: skip


def test_file_round_trip(tmp_path: Path) -> None:
    left = make_camera(**FIELDS, frame_id="rig_left_optical_frame")  # type: ignore[arg-type]
    write_calibration(StereoCalibration(left, left), tmp_path / "rig.yaml")
    back = read_calibration(tmp_path / "rig.yaml").right
    for name in ("k", "d", "r", "p"):
        assert np.array_equal(getattr(back, name), getattr(left, name))
    assert (back.width, back.height, back.frame_id) == (640, 480, "rig_left_optical_frame")


def test_message_without_rectification_gets_identity_and_k() -> None:
    info = SimpleNamespace(**(FIELDS | {"r": np.zeros(9), "p": np.zeros(12)}), header=SimpleNamespace(frame_id="cam"))
    camera = camera_from_info(info)
    assert np.array_equal(camera.r, np.eye(3))
    assert np.array_equal(camera.p[:, :3], camera.k)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"k": np.zeros(9)}, "not calibrated"),
        ({"k": [1, 2]}, "K: expected 9"),
        ({"d": [1.0, 2.0]}, "D: expected 4 or 5"),
        ({"d": [1.0, 2.0], "distortion_model": "fancy"}, "distortion_model"),
        ({"r": np.ones(9)}, "R: expected a rotation"),
        ({"p": np.full(12, np.nan)}, "P: expected 12 finite"),
        ({"width": 0}, "image size"),
    ],
)
def test_nonsense_is_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(CalibrationError, match=words):
        make_camera(**(FIELDS | change))  # type: ignore[arg-type]


@pytest.mark.parametrize("text", ["", "a: 1", "a: [", "1\n---\n2", "a: 1\n---\nb: 2"])
def test_wrong_files_are_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(CalibrationError, match=r"bad\.yaml"):
        read_calibration(tmp_path / "bad.yaml")
