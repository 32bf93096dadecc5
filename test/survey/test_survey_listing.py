"""Whatever a recording looks like: the pairs listed, then read one by one, are those a reader of the whole finds."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import zstandard
from helpers.bag_makers import (
    MS,
    camera,
    chunk_offsets,
    cut,
    flip,
    image_bytes,
    recording,
    write_mcap,
    write_rosbags,
    write_split,
)
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from uw_recon_ros.bags import RawMessage, messages, open_bag
from uw_recon_ros.errors import BagError, ReconError
from uw_recon_ros.files.calibrations import write_calibration
from uw_recon_ros.files.images import write_image
from uw_recon_ros.recordings.listing import Listing, list_frames
from uw_recon_ros.recordings.read import Reader
from uw_recon_ros.recordings.sources import find_sources, fingerprint
from uw_recon_ros.survey.choose import choose, options_of
from uw_recon_ros.survey.params import SurveyParams
from uw_recon_ros.types import StereoCalibration, StereoPair

FEW = recording(12)


def survey_pairs(*paths: Path, **given: object) -> tuple[Listing, list[StereoPair]]:
    """List, then read in an order of its own, as workers do."""
    sources = find_sources(paths)
    params = SurveyParams(**given)  # type: ignore[arg-type]
    listing = list_frames(sources, options_of(params))
    listing.frames = choose(listing.frames, params)
    reader = Reader(sources, listing.calibrations)
    order = np.random.default_rng(0).permutation(len(listing.frames))
    read = {int(i): reader.read(listing.frames[i]) for i in order}
    reader.close()
    return listing, [read[i] for i in range(len(listing.frames))]


def assert_same_pairs(path: Path) -> Listing:
    listing, mine = survey_pairs(path, pair_tolerance_ms=0.0)
    with open_bag(path) as bag:
        theirs = list(bag.stereo_pairs())
    assert [p.stamp_ns for p in mine] == [p.stamp_ns for p in theirs]
    for a, b in zip(mine, theirs, strict=True):
        np.testing.assert_array_equal(a.left, b.left)
        np.testing.assert_array_equal(a.right, b.right)
        assert a.frame_id == b.frame_id
    return listing


def compressed(message: RawMessage) -> RawMessage:
    image = messages.image_from_message(messages.decode(message))
    png = cv2.imencode(".png", image[..., ::-1])[1].ravel()
    kind = messages.typestore().types[messages.COMPRESSED_IMAGE]
    header = messages.decode(message).header
    data = messages.encode(kind(header=header, format="png", data=png))[1]
    return RawMessage(f"{message.topic}/compressed", messages.COMPRESSED_IMAGE, message.log_ns, data)


def zstd_file(path: Path) -> Path:
    folder = write_rosbags(path, FEW, StoragePlugin.MCAP)
    for file in folder.glob("*.mcap"):
        packed = zstandard.ZstdCompressor().compress(file.read_bytes())
        file.with_name(file.name + ".zstd").write_bytes(packed)
        file.unlink()
    (folder / "metadata.yaml").unlink()
    return folder


FORMS: dict[str, Callable[[Path], Path]] = {
    "folder": lambda p: write_rosbags(p / "bag", FEW, StoragePlugin.MCAP),
    "sqlite": lambda p: write_rosbags(p / "bag", FEW),
    "zstd messages": lambda p: write_rosbags(p / "bag", FEW, mode=CompressionMode.MESSAGE),
    "zstd file": lambda p: zstd_file(p / "bag"),
    "bare": lambda p: write_mcap(p / "bag.mcap", FEW),
    "no index": lambda p: write_mcap(p / "bag.mcap", FEW, index=False),
    "no chunks": lambda p: write_mcap(p / "bag.mcap", FEW, chunked=False),
    "several files": lambda p: write_split(p / "bag", [FEW[:9], FEW[9:16], FEW[16:]]),
    "compressed images": lambda p: write_mcap(p / "bag.mcap", [compressed(m) for m in FEW]),
    "cut short": lambda p: cut(write_mcap(p / "bag.mcap", FEW), 0.6),
    "looped": lambda p: write_mcap(p / "bag.mcap", FEW + [replace(m, log_ns=m.log_ns + 1200 * MS) for m in FEW]),
    "recorded at one moment": lambda p: write_mcap(p / "bag.mcap", [replace(m, log_ns=5) for m in FEW]),
    "one camera stops": lambda p: write_mcap(
        p / "bag.mcap", [m for m in FEW if "left" in m.topic or m.log_ns < 600 * MS]
    ),
    "right at half the rate": lambda p: write_mcap(p / "bag.mcap", [m for i, m in enumerate(FEW) if i % 4 != 1]),
}


@pytest.mark.parametrize("form", FORMS)
def test_frames_are_those_of_the_whole_bag(form: str, tmp_path: Path) -> None:
    listing = assert_same_pairs(FORMS[form](tmp_path))
    assert listing.frames
    assert [frame.number for frame in listing.frames] == list(range(len(listing.frames)))


def test_a_damaged_chunk_costs_its_frames_and_is_named(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "bag.mcap", FEW)
    offset, length = chunk_offsets(path.read_bytes())[1]
    listing = assert_same_pairs(flip(path, [offset + length // 2]))
    assert 8 <= len(listing.frames) < 12
    assert any("bag.mcap" in note and "chunk" in note for note in listing.notes)


def test_a_bag_cut_short_says_so(tmp_path: Path) -> None:
    listing = assert_same_pairs(cut(write_mcap(tmp_path / "bag.mcap", FEW), 0.6))
    assert 3 <= len(listing.frames) < 12
    assert any("cut short" in note for note in listing.notes)


def test_a_camera_that_stops_is_named(tmp_path: Path) -> None:
    listing = assert_same_pairs(FORMS["one camera stops"](tmp_path))
    assert any("6 of 12 left images have no partner" in note for note in listing.notes), listing.notes


def test_stamps_that_go_back_are_named(tmp_path: Path) -> None:
    listing = assert_same_pairs(FORMS["looped"](tmp_path))
    assert len(listing.frames) == 24
    assert any("go back 1 times, first by 1.1 s" in note for note in listing.notes), listing.notes


def test_a_splice_that_begins_before_the_first_stamp_is_kept(tmp_path: Path) -> None:
    later = recording(16)[24:]
    spliced = later + [replace(m, log_ns=m.log_ns + 2000 * MS) for m in FEW]
    listing = assert_same_pairs(write_mcap(tmp_path / "bag.mcap", spliced))
    assert len(listing.frames) == 16


def test_undecodable_images_are_listed_and_refused_one_by_one(tmp_path: Path) -> None:
    broken = list(FEW)
    broken[6] = replace(broken[6], data=broken[6].data[:60])
    sources = find_sources([write_mcap(tmp_path / "bag.mcap", broken)])
    listing = list_frames(sources, options_of(SurveyParams()))
    assert len(listing.frames) == 12
    with closing(Reader(sources, [])) as reader:
        assert reader.read(listing.frames[2]).stamp_ns == 200 * MS
        with pytest.raises(ReconError, match="/left/image_raw"):
            reader.read(listing.frames[3])


def test_stamps_near_each_other_are_paired_within_the_tolerance_only(tmp_path: Path) -> None:
    shifted = [
        m if "left" in m.topic else replace(m, data=image_bytes(i, (100 * (i // 2) + 3) * MS))
        for i, m in enumerate(FEW)
    ]
    path = write_mcap(tmp_path / "bag.mcap", shifted)
    assert len(survey_pairs(path, pair_tolerance_ms=5.0)[1]) == 12
    with pytest.raises(BagError, match=r"12 left and 12 right images, the nearest stamps 3 ms apart: .*--pair-tol"):
        survey_pairs(path)


@pytest.mark.parametrize(
    ("given", "numbers"),
    [
        ({"every": 5}, [0, 5, 10]),
        ({"start": 0.3, "end": 0.6}, [3, 4, 5, 6]),
        ({"max_frames": 2}, [0, 1]),
        ({"start": 0.25, "every": 4, "max_frames": 2}, [3, 7]),
    ],
)
def test_frames_are_chosen_and_keep_their_numbers(given: dict[str, object], numbers: list[int], tmp_path: Path) -> None:
    listing, _ = survey_pairs(write_mcap(tmp_path / "bag.mcap", FEW), **given)
    assert [frame.number for frame in listing.frames] == numbers
    assert listing.pairs == 12


def test_a_start_beyond_the_end_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r"start 9 s: expected pairs there, the input lasts 1\.1 s"):
        survey_pairs(write_mcap(tmp_path / "bag.mcap", FEW), start=9.0)


def test_a_folder_of_bags_with_a_hopeless_one(tmp_path: Path) -> None:
    dives = tmp_path / "dives"
    dives.mkdir()
    for name in ("dive_10", "dive_9"):
        write_rosbags(dives / name, FEW, StoragePlugin.MCAP)
    (dives / "dive_11.mcap").touch()
    (dives / "notes.txt").write_text("cold")
    listing, pairs = survey_pairs(dives)
    assert [s.name for s in find_sources([dives])] == ["dive_9", "dive_10", "dive_11.mcap"]
    assert len(pairs) == 24
    assert [frame.source for frame in listing.frames] == [0] * 12 + [1] * 12
    assert len(listing.unreadable) == 1
    assert "dive_11.mcap" in listing.unreadable[0]


def test_nothing_but_a_bag_of_zero_length(tmp_path: Path) -> None:
    (tmp_path / "bag.mcap").touch()
    with pytest.raises(BagError, match="an empty file"):
        survey_pairs(tmp_path / "bag.mcap")


@pytest.mark.parametrize("name", ["missing", "empty"])
def test_paths_that_are_nothing(name: str, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(BagError, match=f"{name}: expected a bag"):
        find_sources([tmp_path / name])


def test_calibrations_follow_the_camera_infos(tmp_path: Path) -> None:
    """Two dives with different rigs, and one whose cameras say that they are not calibrated."""
    for name, tx in (("a", -0.1), ("b", -0.2)):
        infos = [
            RawMessage(f"/{side}/camera_info", messages.CAMERA_INFO, 4 * MS, _info(camera(tx=x)))
            for side, x in (("left", 0.0), ("right", tx))
        ]
        write_mcap(tmp_path / f"{name}.mcap", FEW + infos)
    zero = replace(camera(), k=np.zeros((3, 3)))
    infos = [
        RawMessage(f"/{side}/camera_info", messages.CAMERA_INFO, 4 * MS, _info(zero)) for side in ("left", "right")
    ]
    write_mcap(tmp_path / "c.mcap", FEW + infos)
    listing, pairs = survey_pairs(*(tmp_path / f"{name}.mcap" for name in "abc"))
    assert [frame.rig for frame in listing.frames] == [0] * 12 + [1] * 12 + [-1] * 12
    assert pairs[12].calibration.right.p[0, 3] == pytest.approx(-4.0)  # type: ignore[union-attr]
    assert pairs[30].calibration is None
    assert any("c.mcap: camera_info not used" in note for note in listing.notes)


def _info(model: object) -> bytes:
    message = messages.camera_info_message(model, time_ns=0, frame_id="left_optical_frame")  # type: ignore[arg-type]
    return messages.encode(message)[1]


def stills(folder: Path, left: list[str], right: list[str]) -> Path:
    for side, names in (("left", left), ("right", right)):
        (folder / side).mkdir(parents=True)
        for name in names:
            value = int(name[:4]) % 256 if name[:4].isdigit() else 7
            write_image(folder / side / name, np.full((12, 16), value + (side == "right"), np.uint8))
    return folder


def test_stills_are_paired_by_number_and_lone_ones_named(tmp_path: Path) -> None:
    folder = stills(tmp_path / "dive", ["0001.png", "0002.png", "0010.png"], ["0001.png", "0010.png", "0011.png"])
    listing, pairs = survey_pairs(folder)
    assert [(p.left[0, 0], p.right[0, 0]) for p in pairs] == [(1, 2), (10, 11)]
    assert [p.stamp_ns for p in pairs] == [1_000_000_000, 2_000_000_000]  # time goes on over the lone ones
    assert sorted(note.split(": ")[1] for note in listing.notes) == [
        "1 left stills have no partner, first 0002.png",
        "1 right stills have no partner, first 0011.png",
    ]


def test_stills_bring_their_calibration(tmp_path: Path) -> None:
    folder = stills(tmp_path / "dive", ["0001.png"], ["0001.png"])
    write_calibration(StereoCalibration(camera(), camera(tx=-0.1)), folder / "calibration.yaml")
    assert survey_pairs(folder)[1][0].calibration.right.p[0, 3] == pytest.approx(-2.0)  # type: ignore[union-attr]
    assert set(fingerprint(find_sources([folder])[0])) == {"left/0001.png", "right/0001.png", "calibration.yaml"}


def test_stills_that_do_not_go_together(tmp_path: Path) -> None:
    folder = stills(tmp_path / "dive", ["a.png", "b.png"], ["a.png"])
    with pytest.raises(BagError, match="as many left as right stills, got 2 and 1"):
        survey_pairs(folder)


def test_a_fingerprint_sees_one_bit(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "bag.mcap", FEW)
    shutil.copy(path, tmp_path / "copy.mcap")
    before, same = (fingerprint(find_sources([p])[0]) for p in (path, tmp_path / "copy.mcap"))
    assert list(before.values()) == list(same.values())
    flip(path, [2000])
    assert fingerprint(find_sources([path])[0]) != before


def test_copies_of_a_pair_of_stills_are_told(tmp_path: Path) -> None:
    names = [f"{k:04}.png" for k in range(1, 6)]
    folder = stills(tmp_path / "dive", names, names)
    for side in ("left", "right"):
        for name in names[2:]:
            shutil.copy(folder / side / names[1], folder / side / name)
    notes = list_frames(find_sources([folder]), options_of(SurveyParams())).notes
    assert any("3 of 5 pairs are copies of earlier ones, the first, 0003.png, of 0002.png" in note for note in notes)


def test_pairs_that_share_one_picture_are_no_copies(tmp_path: Path) -> None:
    names = ["0001.png", "0002.png"]
    folder = stills(tmp_path / "dive", names, names)
    shutil.copy(folder / "left" / names[0], folder / "left" / names[1])
    assert not list_frames(find_sources([folder]), options_of(SurveyParams())).notes
