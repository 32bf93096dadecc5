"""`calibration.json` where it is used: its medium, its ports, its part of every sigma."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.calibration_scenes import rig_of, truth_of

from uw_recon_ros.calibrate.optics import NAMES
from uw_recon_ros.calibration.model import scaled
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.files.calibrations import read_calibration
from uw_recon_ros.files.packed import pack, unpack
from uw_recon_ros.findings import Code
from uw_recon_ros.rectify.calibrated import made_in, rectification_from_calibration
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.port import PortCamera
from uw_recon_ros.survey import plan
from uw_recon_ros.types import CalibrationOrigin, FlatPorts

PORTS = {
    "distance_m": 0.02, "thickness_m": 0.006, "glass": 1.49, "water": 1.342,
    "normal_left": [0.0, 0.0, 1.0], "normal_right": [0.02, 0.0, float(np.sqrt(1 - 0.0004))],
}  # fmt: skip


def written(path: Path, **changes: Any) -> Path:
    numbers = dict(zip(NAMES, truth_of(rig_of(1)).tolist(), strict=True))
    told = {
        "format": 1, "medium": "water", "image_width": 640, "image_height": 480, "distortion_model": "plumb_bob",
        "parameters": numbers, "parameters_unit_of_length": "m",
        "depth_errors": [{"range_m": 1.0, "mean_percent": 0.5}, {"range_m": 3.0, "mean_percent": None}],
    }  # fmt: skip
    (path / "calibration.json").write_text(json.dumps(told | changes))
    return path / "calibration.json"


def test_the_rig_and_how_it_came_about(tmp_path: Path) -> None:
    found, true = read_calibration(written(tmp_path)), rig_of(1).calibration
    np.testing.assert_allclose(found.left.k, true.left.k)
    np.testing.assert_allclose(found.right.d, true.right.d)
    assert found.right.p[0, 3] == pytest.approx(true.right.p[0, 3], rel=0.01)
    assert found.origin == CalibrationOrigin("water", ((1.0, 0.005),))
    assert scaled(found, (320, 240)).origin == found.origin


def test_a_folder_of_calibrate_is_one_rig(tmp_path: Path) -> None:
    written(tmp_path)
    for name in ("left", "right", "calibration"):
        (tmp_path / f"{name}.yaml").write_text("not: read")
    assert read_calibration(tmp_path).origin.medium == "water"


@pytest.mark.parametrize(
    "changes",
    [
        {"format": 2}, {"medium": "oil"}, {"parameters_unit_of_length": "squares of the board"}, {"parameters": {}},
        {"parameters": []}, {"distortion_model": "fov"}, {"image_width": None}, {"ports": PORTS | {"distance_m": -1.0}},
        {"ports": {}}, {"ports": PORTS | {"normal_left": [0, 0, 2]}}, {"depth_errors": [{}]},
        {"depth_errors": [{"range_m": 3.0, "mean_percent": 1}, {"range_m": 1.0, "mean_percent": 1}]},
    ],
)  # fmt: skip
def test_what_cannot_be_is_one_line(changes: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(CalibrationError) as caught:
        read_calibration(written(tmp_path, **changes))
    assert "\n" not in str(caught.value)
    assert "calibration.json" in str(caught.value)


def test_made_in_air_withholds_metres_unless_the_parameter_says_otherwise(tmp_path: Path) -> None:
    air, water = read_calibration(written(tmp_path, medium="air")), read_calibration(written(tmp_path))
    made = rectification_from_calibration(air, RectifyParams())
    assert not made.geometry.metric
    assert Code.CALIBRATION_MADE_IN_AIR in {f.code for f in made.quality.warnings}
    assert rectification_from_calibration(air, RectifyParams(medium="as_used")).geometry.metric
    found = rectification_from_calibration(water, RectifyParams())
    assert found.geometry.metric
    assert made_in(found, RectifyParams()) == "as_used"
    assert made_in(found, RectifyParams(medium="air")) == "air"


def test_its_ports_stand_before_the_cameras(tmp_path: Path) -> None:
    found = read_calibration(written(tmp_path, medium="air", ports=PORTS))
    made = rectification_from_calibration(found, RectifyParams())
    assert made.geometry.metric
    assert isinstance(made.left, PortCamera)
    assert isinstance(made.right, PortCamera)
    assert made.left.port.distance_m == 0.02
    assert made.right.port.normal[0] == 0.02
    told = rectification_from_calibration(found, RectifyParams(port="flat", port_distance_mm=30.0))
    assert isinstance(told.left, PortCamera)
    assert told.left.port.distance_m == 0.03


def test_workers_of_a_survey_are_handed_ports(tmp_path: Path) -> None:
    found = read_calibration(written(tmp_path, medium="air", ports=PORTS))
    made = rectification_from_calibration(found, RectifyParams())
    back = unpack(pack(replace(made, left_map=None, right_map=None)), plan._CLASSES)
    assert back.left.port == made.left.port
    assert back.quality.origin == found.origin
    assert back.quality.origin.ports == FlatPorts(
        0.02, 0.006, 1.49, 1.342, (0.0, 0.0, 1.0), found.origin.ports.normal_right
    )
