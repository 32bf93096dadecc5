"""Whole surveys of small dives: what is written, that it is the same however it was computed, and what is refused."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import laspy
import numpy as np
import pytest
import trimesh
from helpers.bag_makers import cut, write_mcap
from helpers.dives import FRAMES, PARAMS, digests, make_dive, recorded, table, with_half_a_camera
from helpers.process_watch import unmeasured

from uw_recon_ros.bags import open_bag, write_bag
from uw_recon_ros.cli import main
from uw_recon_ros.files.disparities import read_disparity
from uw_recon_ros.pipeline import Pipeline, PipelineParams, read_values
from uw_recon_ros.types import StereoPair

ROOT = Path(__file__).parent.parent.parent


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("surveys")
    (folder / "small.yaml").write_text(PARAMS)
    make_dive(folder / "dive")
    return folder


def arguments(room: Path, output: Path, *more: str, dive: str = "dive", jobs: int = 1) -> list[str]:
    return ["survey", str(room / dive), "-o", str(output), "--params", str(room / "small.yaml"), "--quiet",
            "--jobs", str(jobs), *more]  # fmt: skip


def command(*args: str) -> list[str]:
    return [sys.executable, "-m", "uw_recon_ros.cli", *args]


@pytest.fixture(scope="module")
def undisturbed(room: Path) -> Path:
    """The dive surveyed once, by one process."""
    assert main(arguments(room, room / "undisturbed")) == 0
    return room / "undisturbed"


def pairs_of(path: Path) -> list[StereoPair]:
    with open_bag(path) as bag:
        return list(bag.stereo_pairs())


def test_every_frame_has_every_file(undisturbed: Path) -> None:
    kinds = {"disparity": "pfm", "depth": "tiff", "clouds": "ply", "meshes": "glb", "views": "html", "previews": "jpg"}
    for folder, suffix in kinds.items():
        assert [p.name for p in sorted((undisturbed / folder).iterdir())] == [
            f"{i:06d}.{suffix}" for i in range(FRAMES)
        ]
    assert not list((undisturbed / "state" / "staging").iterdir())
    assert not (undisturbed / "state" / "bag").exists()


def test_frames_are_what_the_pipeline_makes_of_them(room: Path, undisturbed: Path) -> None:
    pipeline = Pipeline(PipelineParams.from_mapping(read_values(room / "small.yaml")))
    for number, pair in list(enumerate(pairs_of(room / "dive")))[::3]:
        result = pipeline(pair)
        disparity = read_disparity(undisturbed / "disparity" / f"{number:06d}.pfm")
        np.testing.assert_array_equal(disparity, result.disparity.disparity)
        depth = cv2.imread(str(undisturbed / "depth" / f"{number:06d}.tiff"), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(depth, result.depth.depth)
        cloud = trimesh.load(undisturbed / "clouds" / f"{number:06d}.ply")
        np.testing.assert_array_equal(cloud.vertices, result.cloud.points[np.isfinite(result.cloud.points[..., 2])])
        mesh = trimesh.load(undisturbed / "meshes" / f"{number:06d}.glb", force="mesh")
        assert len(mesh.faces) == len(result.surface.faces) > 0


def test_the_table_has_a_row_a_pair(room: Path, undisturbed: Path) -> None:
    rows = table(undisturbed / "frames.csv")
    stamps = [pair.stamp_ns for pair in pairs_of(room / "dive")]
    assert [int(row["stamp_ns"]) for row in rows] == stamps
    for number, row in enumerate(rows):
        disparity = read_disparity(undisturbed / "disparity" / f"{number:06d}.pfm")
        assert float(row["density"]) == pytest.approx(np.isfinite(disparity).mean(), rel=1e-5)
        depth = cv2.imread(str(undisturbed / "depth" / f"{number:06d}.tiff"), cv2.IMREAD_UNCHANGED)
        assert float(row["depth_p50"]) == pytest.approx(np.nanmedian(depth), rel=1e-5)
        assert (row["frame"], row["status"], row["reason"], row["scale"]) == (str(number), "ok", "", "metric")
        assert float(row["seconds"]) > 0


def test_the_output_bag_has_the_nodes_topics(room: Path, undisturbed: Path) -> None:
    with open_bag(undisturbed / "bag") as bag:
        counts = {topic.name: topic.count for topic in bag.topics}
        assert set(counts.values()) == {FRAMES}
        assert {"/disparity", "/depth/image_rect", "/points2", "/points2_filtered", "/surface"} <= set(counts)
        stamps = [decoded.header.stamp.sec for _, decoded in bag.messages(["/disparity"])]
        surface = next(topic for topic in bag.topics if topic.name == "/surface")
        assert surface.qos[0].durability == "transient_local"
    assert stamps == sorted(stamps)


def test_the_report_says_what_was_made_from_what(room: Path, undisturbed: Path) -> None:
    made = json.loads((undisturbed / "report.json").read_text())
    assert set(made["input"]["dive"]) == {"dive.mcap", "metadata.yaml"}
    assert made["parameters"]["kz2_sweeps"] == 1
    assert made["versions"]["numpy"] == np.__version__
    assert "match_seed" in made["seed"]
    assert made["frames"] == {
        "pairs_in_input": FRAMES,
        "chosen": FRAMES,
        "ok": FRAMES,
        "unreliable": 0,
        "failed": 0,
        "reasons": {},
    }
    assert made["rigs"]["0"]["method"] == "calibrated"
    page = (undisturbed / "report.html").read_text()
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "https://" not in page
    assert page.count('<svg class="chart wide"') == page.count('<svg class="chart narrow"') == 4


@pytest.mark.parametrize("jobs", [2, 3])
def test_the_number_of_processes_changes_no_byte(room: Path, undisturbed: Path, jobs: int, tmp_path: Path) -> None:
    assert main(arguments(room, tmp_path / "out", jobs=jobs)) == 0
    assert digests(tmp_path / "out") == digests(undisturbed)


def moments(out: Path) -> list[Callable[[], bool]]:
    """What can be seen from outside when a survey is at a certain point, in the order in which it gets there."""
    state = out / "state"

    def rows(count: int) -> Callable[[], bool]:
        journal = state / "journal.jsonl"
        return lambda: journal.is_file() and journal.read_bytes().count(b"\n") >= count

    return [
        (state / "lock").exists,
        (state / "plan.npz").exists,
        lambda: any((state / "staging").glob("*/*/*")),  # a file half-written
        rows(1),
        lambda: rows(2)() and any((state / "staging").glob("*/3/*")),
        rows(4),
        lambda: rows(FRAMES)() and any(out.glob(".bag.*")),  # the bag half-written
        (out / "bag").exists,
        (out / "frames.csv").exists,
    ]


def kill_when(condition: Callable[[], bool], survey: subprocess.Popen[bytes], delay_s: float) -> bool:
    """Whether it was killed; else it came to its end before."""
    while survey.poll() is None:
        if condition():
            time.sleep(delay_s)
            os.kill(survey.pid, signal.SIGKILL)  # the main process alone: its worker must notice
            break
        time.sleep(0.001)
    return survey.wait() == -signal.SIGKILL


@pytest.mark.slow
def test_killed_again_and_again_it_ends_with_the_same_bytes(room: Path, undisturbed: Path, tmp_path: Path) -> None:
    chance = random.Random(5)
    args = arguments(room, tmp_path / "out")
    kills, whole = 0, digests(undisturbed)
    for moment in moments(tmp_path / "out"):
        kills += kill_when(moment, subprocess.Popen(command(*args)), chance.uniform(0, 0.02))
        assert digests(tmp_path / "out").items() <= whole.items()  # each file whole or not there
    assert kills >= 5
    assert main(args) == 0
    assert digests(tmp_path / "out") == digests(undisturbed)
    assert not list((tmp_path / "out" / "state" / "staging").iterdir())
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == sorted(p.name for p in undisturbed.iterdir())


def test_a_finished_survey_is_left_as_it_is(room: Path, undisturbed: Path) -> None:
    before = {p: (p.stat().st_mtime_ns, p.stat().st_size) for p in undisturbed.rglob("*") if "state" not in p.parts}
    assert main(arguments(room, undisturbed)) == 0
    assert {p: (p.stat().st_mtime_ns, p.stat().st_size) for p in before} == before


def test_a_file_taken_away_is_made_again(room: Path, undisturbed: Path) -> None:
    before = digests(undisturbed)
    (undisturbed / "depth" / "000002.tiff").unlink()
    assert main(arguments(room, undisturbed)) == 0
    assert digests(undisturbed) == before


@pytest.mark.parametrize(
    ("more", "difference"),
    [
        (["--every", "2"], "survey.every: 1 then, 2 now"),
        (["--depth-format", "png"], 'survey.depth_format: "tiff" then, "png" now'),
    ],
)
def test_other_parameters_are_refused(
    room: Path, undisturbed: Path, more: list[str], difference: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments(room, undisturbed, *more)) == 1
    assert difference in capsys.readouterr().err


def test_another_input_is_refused_and_overwritten_when_asked(
    room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make_dive(tmp_path / "dive", frames=2)
    (tmp_path / "small.yaml").write_text(PARAMS)
    few = ["--write", "disparity"]
    assert main(arguments(tmp_path, tmp_path / "out", *few)) == 0
    for file in (tmp_path / "dive").iterdir():
        file.unlink()
    (tmp_path / "dive").rmdir()
    make_dive(tmp_path / "dive", frames=3)
    assert main(arguments(tmp_path, tmp_path / "out", *few)) == 1
    assert "input.dive.dive.mcap" in capsys.readouterr().err
    assert len(list((tmp_path / "out" / "disparity").iterdir())) == 2
    assert main(arguments(tmp_path, tmp_path / "out", *few, "--overwrite")) == 0
    assert len(list((tmp_path / "out" / "disparity").iterdir())) == 3


def test_bad_frames_are_rows_and_the_rest_goes_on(room: Path, tmp_path: Path) -> None:
    messages = recorded(room / "dive")
    lefts = [i for i, m in enumerate(messages) if m.topic == "/left/image_raw"]
    messages[lefts[1]] = replace(messages[lefts[1]], data=messages[lefts[1]].data[:99])
    black = bytearray(messages[lefts[3]].data)
    black[-96 * 72 * 3 :] = bytes(96 * 72 * 3)
    messages[lefts[3]] = replace(messages[lefts[3]], data=bytes(black))
    (tmp_path / "small.yaml").write_text(PARAMS.replace("min_disparity: 2", "").replace("max_disparity: 18", ""))
    write_mcap(tmp_path / "bad.mcap", messages)
    assert main(arguments(tmp_path, tmp_path / "out", dive="bad.mcap", jobs=2)) == 1
    rows = table(tmp_path / "out" / "frames.csv")
    assert [row["status"] for row in rows] == ["ok", "failed", "ok", "failed", "ok", "ok"]
    assert "/left/image_raw: 99 bytes are no sensor_msgs/msg/Image" in rows[1]["reason"]
    assert "the others show nothing" in rows[3]["reason"]
    assert [rows[i]["warnings"] for i in (1, 3)] == ["bag", "match.nothing_seen"]
    assert sorted(p.stem for p in (tmp_path / "out" / "depth").iterdir()) == [f"{i:06d}" for i in (0, 2, 4, 5)]
    assert (tmp_path / "out" / "previews" / "000003.jpg").is_file()  # what the failure looked like
    page = (tmp_path / "out" / "report.html").read_text()
    assert "<h2>Failures</h2>" in page
    assert "99 bytes are no" in page


def test_half_a_camera_is_told_on_every_door(room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The last frame alone is chosen: that it is frozen shows the frame before it, which is not."""
    broken = with_half_a_camera(recorded(room / "dive"))
    write_bag(room / "half", broken)
    arguments_ = [word for word in arguments(room, tmp_path / "out", dive="half") if word != "--quiet"]
    assert main(arguments_) == 0
    rows = table(tmp_path / "out" / "frames.csv")
    regions = [[code for code in row["warnings"].split() if code.startswith("region.")] for row in rows]
    assert regions == [[], ["region.dead"], *[[]] * (FRAMES - 3), ["region.frozen"]]
    assert not any("rectify.rows_disagree" in row["warnings"] for row in rows)
    made = json.loads((tmp_path / "out" / "report.json").read_text())
    of_regions = [w for w in made["warnings"] if w["code"].startswith("region.")]
    assert [(w["code"], w["frames"], w["first_frame"]) for w in of_regions] == [
        ("region.dead", 1, 1), ("region.frozen", 1, FRAMES - 1)
    ]  # fmt: skip
    said = capsys.readouterr().err
    for number, text in ((1, "shows nothing"), (FRAMES - 1, "is that of the frame before")):
        assert f"frame {number}: right camera: " in said
        assert text in said
        assert text in (tmp_path / "out" / "report.html").read_text()
    valid = np.isfinite(read_disparity(tmp_path / "out" / "disparity" / "000001.pfm"))
    assert valid[:28].mean() > 0.3
    assert not valid[40:].any()
    last = ["--start", str((broken[-1].log_ns - broken[0].log_ns) / 1e9 - 0.01)]
    assert main([*arguments(room, tmp_path / "last", dive="half"), *last]) == 0
    assert all(row["warnings"].startswith("region.frozen") for row in table(tmp_path / "last" / "frames.csv"))


def test_a_bag_cut_short_is_surveyed_as_far_as_it_goes(room: Path, tmp_path: Path) -> None:
    path = cut(write_mcap(tmp_path / "cut.mcap", recorded(room / "dive")), 0.7)
    (tmp_path / "small.yaml").write_text(PARAMS)
    assert main(arguments(tmp_path, tmp_path / "out", "--write", "depth", dive=path.name)) == 0
    made = json.loads((tmp_path / "out" / "report.json").read_text())
    assert 2 <= made["frames"]["ok"] < FRAMES
    assert any("cut short" in note for note in made["notes"])


def test_without_calibration_the_rig_is_estimated_once(tmp_path: Path) -> None:
    make_dive(tmp_path / "dive", frames=3, width=240, height=180, calibrated=False, water="clear", noise=0.3)
    (tmp_path / "small.yaml").write_text(PARAMS.replace("min_disparity: 2", "").replace("max_disparity: 18", ""))
    assert main(arguments(tmp_path, tmp_path / "one", "--write", "disparity,clouds,depth")) == 0
    assert main(arguments(tmp_path, tmp_path / "two", "--write", "disparity,clouds,depth", jobs=2)) == 0
    assert digests(tmp_path / "one") == digests(tmp_path / "two")
    made = json.loads((tmp_path / "one" / "report.json").read_text())
    assert made["rigs"]["-1"]["method"] != "calibrated"
    assert made["rigs"]["-1"]["row_error_median_px"] < 1
    assert made["scale"] == ["unknown"]
    assert not (tmp_path / "one" / "depth").exists()  # no metres where there is no scale


def test_the_other_formats(room: Path, undisturbed: Path, tmp_path: Path) -> None:
    more = ["--disparity-format", "tiff", "--depth-format", "png", "--cloud-format", "laz", "--cloud-points", "thinned"]
    more += ["--max-frames", "1", "--bag-topics", "disparity,/depth/image_rect"]
    assert main(arguments(room, tmp_path, *more)) == 0
    tiff = cv2.imread(str(tmp_path / "disparity" / "000000.tiff"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(tiff, read_disparity(undisturbed / "disparity" / "000000.pfm"))
    metres = cv2.imread(str(undisturbed / "depth" / "000000.tiff"), cv2.IMREAD_UNCHANGED)
    png = cv2.imread(str(tmp_path / "depth" / "000000.png"), cv2.IMREAD_UNCHANGED)
    assert png.dtype == np.uint16
    np.testing.assert_array_equal(png == 0, ~np.isfinite(metres))
    assert np.nanmax(np.abs(png / 1000.0 - metres)[png > 0]) <= 0.0005 + 1e-6
    las = laspy.read(tmp_path / "clouds" / "000000.laz")
    assert 10 < len(las.points) < (png > 0).sum()
    assert metres[np.isfinite(metres)].min() - 0.01 <= np.asarray(las.z).min()
    with open_bag(tmp_path / "bag") as bag:
        assert {topic.name for topic in bag.topics} == {"/disparity", "/depth/image_rect"}


@pytest.mark.parametrize("product", ["clouds", "bag"])
def test_a_full_disk_stops_it_and_it_goes_on_when_there_is_room(
    product: str, room: Path, undisturbed: Path, tmp_path: Path
) -> None:
    """A limit on the size of a file stands in for the disk: the write fails with an OSError as on a full one."""
    code = (
        "import resource, signal, sys\nfrom uw_recon_ros.cli import main\n"
        "if __name__ == '__main__':\n"
        "    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), -1))\n"
        "    sys.exit(main(sys.argv[2:]))\n"
    )
    script = tmp_path / "limited.py"
    script.write_text(code)
    share = sum(p.stat().st_size for p in (undisturbed / product).iterdir()) / FRAMES
    limit = (undisturbed / "state" / "plan.npz").stat().st_size + 500
    assert limit < 0.9 * share
    args = arguments(room, tmp_path / "out", "--write", product)
    done = subprocess.run(
        [sys.executable, str(script), str(limit), *args], capture_output=True, text=True, check=False, env=unmeasured()
    )
    assert done.returncode == 1
    assert "larger than this file system or a limit on this process allows" in done.stderr
    assert "the same command resumes there" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out" / "frames.csv").exists()
    assert main(args) == 0
    mine, whole = digests(tmp_path / "out"), digests(undisturbed)
    names = [name for name in whole if name.startswith(f"{product}/")]
    assert names
    assert [mine[name] for name in names] == [whole[name] for name in names]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["--start", "5", "--end", "2"], "start, end: expected the first below the second"),
        (["--write", "depth,meshs"], "write: expected some of disparity"),
        (["--every", "0"], "every: expected an int in [1"),
    ],
)
def test_wrong_usage(
    given: list[str], words: str, room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments(room, tmp_path / "out", *given)) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_json_for_programs(room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = [a for a in arguments(room, tmp_path / "out", "--max-frames", "2", "--write", "depth") if a != "--quiet"]
    assert main([*args, "--json"]) == 0
    out, err = capsys.readouterr()
    outcome = json.loads(out)
    assert (outcome["frames"], outcome["ok"], outcome["failed"]) == (2, 2, 0)
    events = [json.loads(line) for line in err.splitlines()]
    assert events[-1]["done"] == events[-1]["total"] == 2


def test_plain_lines_in_a_log(room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = [a for a in arguments(room, tmp_path / "out", "--max-frames", "2", "--write", "depth") if a != "--quiet"]
    assert main(args) == 0
    err = capsys.readouterr().err
    assert "frames: 2 of 2, " in err
    assert "0:00 left" in err
    assert "\r" not in err
    assert "2 of 2 frames reconstructed, 0 failed" in err


INTERRUPTED = """
import os, signal, sys
from uw_recon_ros.cli import main
from uw_recon_ros.survey.store import Store

append = Store.append

def append_and_interrupt(self, row):
    append(self, row)
    os.kill(os.getpid(), signal.SIGINT)

Store.append = append_and_interrupt
if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
"""


def test_ctrl_c_leaves_what_is_done(room: Path, undisturbed: Path, tmp_path: Path) -> None:
    """Ctrl-C at the moment when the first frame is noted, however fast the machine is."""
    args = [a for a in arguments(room, tmp_path / "out") if a != "--quiet"]
    (tmp_path / "interrupted.py").write_text(INTERRUPTED)
    survey = subprocess.run(
        [sys.executable, str(tmp_path / "interrupted.py"), *args], stderr=subprocess.PIPE, text=True, check=False
    )
    assert survey.returncode == 130
    assert "interrupted; the same command resumes there" in survey.stderr
    assert "Traceback" not in survey.stderr
    assert len((tmp_path / "out" / "state" / "journal.jsonl").read_text().splitlines()) < FRAMES
    assert main(arguments(room, tmp_path / "out")) == 0
    assert digests(tmp_path / "out") == digests(undisturbed)
