"""What `bag_info` says of bags whose faults are known."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from helpers.bag_makers import IMAGE, MS, camera, cut, image_bytes, recording, write_mcap

from uw_recon_ros.bags import BagWriter, RawMessage
from uw_recon_ros.cli import main
from uw_recon_ros.recordings.info import bag_info
from uw_recon_ros.types import CameraModel


def write(path: Path, recorded: list[RawMessage], left: CameraModel | None, right: CameraModel | None) -> Path:
    with BagWriter(path) as writer:
        for message in recorded:
            writer.raw(message)
        for side, model in (("left", left), ("right", right)):
            if model is not None:
                writer.camera_info(f"/{side}/camera_info", model, time_ns=5 * MS, frame_id=f"{side}_optical_frame")
    return path


def test_a_sound_calibrated_bag(tmp_path: Path) -> None:
    info = bag_info(write(tmp_path / "bag", recording(20), camera(), camera(tx=-0.1)))
    assert info.reconstructable
    assert (info.pairs, info.gaps, info.calibration) == (20, 0, "metric")
    assert info.baseline_m == pytest.approx(0.1)
    assert info.rate_hz == pytest.approx(10.0)
    assert info.largest_gap_s == pytest.approx(0.1)
    assert info.warnings == info.damage == ()
    assert info.left is not None
    assert (info.left.width, info.left.height, info.left.encoding) == (16, 12, "bgr8")
    text = str(info).splitlines()
    assert "pairs: 20 at 10.00 Hz, longest gap 0.10 s" in text
    assert text[-1] == "can be reconstructed"


def test_a_vertical_rig(tmp_path: Path) -> None:
    below = camera()
    below.p[1, 3] = -20.0 * 0.12
    info = bag_info(write(tmp_path / "bag", recording(3), camera(), below))
    assert info.calibration == "metric"
    assert info.baseline_m == pytest.approx(0.12)


def test_uncalibrated_is_no_obstacle_but_said(tmp_path: Path) -> None:
    info = bag_info(write_mcap(tmp_path / "a.mcap", recording(5)))
    assert info.reconstructable
    assert info.calibration == "none"
    assert info.warnings == ("the scale is unknown: no CameraInfo of the left and right camera",)
    assert str(info).endswith("can be reconstructed, scale unknown")


def test_zero_camera_info(tmp_path: Path) -> None:
    zero = dataclasses.replace(camera(), k=np.zeros((3, 3)), p=np.zeros((3, 4)), r=np.zeros((3, 3)))
    info = bag_info(write(tmp_path / "bag", recording(3), zero, zero))
    assert info.calibration == "zero"
    assert info.reconstructable
    assert "expected focal lengths > 0, got fx = 0" in info.warnings[0]


def test_calibration_without_baseline(tmp_path: Path) -> None:
    info = bag_info(write(tmp_path / "bag", recording(3), camera(), camera()))
    assert (info.calibration, info.reconstructable) == ("consistent", True)
    assert math.isnan(info.baseline_m)


@pytest.mark.parametrize(
    ("left", "right", "reason"),
    [
        (camera(32, 24), camera(32, 24, -0.1), "expected 16x12 px as the images, got 32x24"),
        (camera(), camera(tx=+0.1), "the right camera would stand on the left"),
        (camera(tx=-0.1), camera(), "left P: expected P[3] = P[7] = 0"),
        (
            camera(),
            dataclasses.replace(camera(), p=2 * camera().p),
            "right P: expected [fx 0 cx Tx",
        ),
        (dataclasses.replace(camera(), r=2 * np.eye(3)), camera(), "left CameraInfo: R: expected a rotation"),
    ],
)
def test_contradictory_calibration(tmp_path: Path, left: CameraModel, right: CameraModel, reason: str) -> None:
    info = bag_info(write(tmp_path / "bag", recording(3), left, right))
    assert info.calibration == "inconsistent"
    assert not info.reconstructable
    assert reason in info.reasons[0]
    assert f"cannot be reconstructed: {info.reasons[0]}" in str(info)


def test_millimetres_are_refused(tmp_path: Path) -> None:
    info = bag_info(write(tmp_path / "bag", recording(3), camera(), camera(tx=-100.0)))
    assert (info.calibration, info.reconstructable) == ("inconsistent", False)
    assert "millimetres" in info.reasons[0]


def test_one_camera_missing(tmp_path: Path) -> None:
    info = bag_info(write_mcap(tmp_path / "a.mcap", recording(3, topics=["/left/image_raw"])))
    assert not info.reconstructable
    (reason,) = info.reasons
    assert reason.startswith("no stereo pair: expected images of a left and a right camera, got /left/image_raw (3)")


def test_no_images_at_all(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.camera_info("/left/camera_info", camera(), time_ns=1, frame_id="x")
    assert "got no image topics" in bag_info(tmp_path / "bag").reasons[0]


def test_stamps_that_never_meet(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorded = [RawMessage("/left/image_raw", IMAGE, 100 * i * MS, image_bytes(i, 100 * i * MS)) for i in range(5)]
    recorded += [
        RawMessage("/right/image_raw", IMAGE, (100 * i + 7) * MS, image_bytes(i + 9, (100 * i + 7) * MS))
        for i in range(5)
    ]
    path = write_mcap(tmp_path / "a.mcap", recorded)
    info = bag_info(path)
    assert info.pairs == 0
    assert "the nearest differ by 7.0 ms" in info.reasons[0]
    assert bag_info(path, tolerance_ns=7 * MS).reconstructable
    assert main(["info", str(path), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["reconstructable"] is False
    assert main(["info", str(path), "--pair-tolerance-ms", "7"]) == 0


def test_gaps_backwards_and_partnerless(tmp_path: Path) -> None:
    recorded = recording(40)
    del recorded[60:72]  # six pairs
    del recorded[21:41:2]  # ten right images in a row
    recorded[3] = dataclasses.replace(recorded[3], data=recorded[1].data)  # an old right image again
    recorded[4] = dataclasses.replace(recorded[4], data=image_bytes(1, 50 * MS))
    info = bag_info(write_mcap(tmp_path / "a.mcap", recorded))
    assert info.gaps == 3  # 0 to 3, 9 to 20, 29 to 36
    assert info.largest_gap_s == pytest.approx(1.1)
    said = " ".join(info.warnings)
    assert "/left/image_raw: time goes backwards 1 times" in said
    assert "/left/image_raw: 12 of 34 images have no partner" in said


def test_zero_stamps(tmp_path: Path) -> None:
    recorded = [dataclasses.replace(m, data=image_bytes(i, 0)) for i, m in enumerate(recording(3))]
    info = bag_info(write_mcap(tmp_path / "a.mcap", recorded))
    assert info.pairs == 3
    assert "/left/image_raw: all stamps are zero" in info.warnings


def test_images_that_cannot_be_decoded(tmp_path: Path) -> None:
    recorded = [
        dataclasses.replace(m, data=m.data.replace(b"bgr8", b"xyz8")) if "right" in m.topic else m for m in recording(3)
    ]
    info = bag_info(write_mcap(tmp_path / "a.mcap", recorded))
    assert "/right/image_raw: images cannot be decoded: encoding: expected" in info.reasons[0]


def test_cameras_of_different_size(tmp_path: Path) -> None:
    recorded = [
        dataclasses.replace(m, data=image_bytes(i, 0, (6, 8, 3))) if "right" in m.topic else m
        for i, m in enumerate(recording(1))
    ]
    info = bag_info(write_mcap(tmp_path / "a.mcap", recorded))
    assert info.reasons == ("the cameras differ in size: 16x12 and 8x6 px",)


def test_a_damaged_bag_says_so(tmp_path: Path) -> None:
    info = bag_info(cut(write_mcap(tmp_path / "a.mcap", recording(40)), 0.5))
    assert info.reconstructable
    assert 15 <= info.pairs < 40
    assert "cut short" in info.damage[0]
    assert "damaged: 1 places could not be read" in info.warnings
