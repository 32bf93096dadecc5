"""What the code may not do at all, where it may write, and what a bag may not make it do."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.bag_makers import MS, write_mcap

from uw_recon_ros.bags import RawMessage, messages, open_bag
from uw_recon_ros.cli import main
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.files.calibrations import read_calibration
from uw_recon_ros.params import read_parameter_file
from uw_recon_ros.report.page import Summary, render_page

ROOT = Path(__file__).parent.parent
SHIPPED = sorted(path for room in ("uw_recon_ros", "launch") for path in (ROOT / room).rglob("*.py"))
MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal", "dbm", "code", "pty", "commands"}
NAMES = {"eval", "exec", "compile", "__import__"}
METHODS = {
    "os": {"system", "popen", "execv", "execve", "execvp", "execl", "execlp", "spawnl", "spawnv", "startfile"},
    "yaml": {
        "load",
        "load_all",
        "full_load",
        "unsafe_load",
        "full_load_all",
        "unsafe_load_all",
        "Loader",
        "FullLoader",
    },
    "tempfile": {"mktemp"},
    "np": {"fromregex"},
}
EVIL = "../../../../tmp/<script>alert(1)</script>"


def offences(source: str) -> list[str]:
    """Lines that run what data says, or could."""
    found = []
    for node in ast.walk(ast.parse(source)):
        words = ""
        if isinstance(node, ast.Import):
            words = next((alias.name for alias in node.names if alias.name.split(".")[0] in MODULES), "")
        elif isinstance(node, ast.ImportFrom):
            words = node.module or "" if (node.module or "").split(".")[0] in MODULES else ""
        elif isinstance(node, ast.Name):
            words = node.id if node.id in NAMES else ""
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            words = node.attr if node.attr in METHODS.get(node.value.id, ()) else ""
        elif isinstance(node, ast.keyword) and isinstance(node.value, ast.Constant) and node.value.value:
            words = f"{node.arg}=" if node.arg in ("shell", "allow_pickle") else ""
        if words:
            found.append(f"{getattr(node, 'lineno', 0)}: {words}")
    return found


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_nothing_runs_what_data_says(path: Path) -> None:
    """No pickle, eval, exec or shell; YAML safely. Numba's cache and Dask's wire are theirs: docs/security.md."""
    assert offences(path.read_text(encoding="utf-8")) == []


def test_the_check_finds_offences() -> None:
    bad = (
        "import pickle", "from pickle import loads", "eval('1')", "exec('1')", "import os; os.system('x')",
        "import yaml; yaml.load('x')", "run('x', shell=True)", "np.load('x', allow_pickle=True)", "f = eval",
    )  # fmt: skip
    assert all(offences(line) for line in bad)
    assert not any(offences(line) for line in ("run('x', shell=False)", "yaml.safe_load('x')", "re.compile('x')"))


@pytest.mark.parametrize("reader", [read_calibration, lambda path: read_parameter_file(path, ["pipeline_node"])])
def test_yaml_makes_nothing_but_values(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reader: object) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "evil.yaml").write_text("!!python/object/apply:os.system ['touch owned']")
    with pytest.raises((CalibrationError, ValueError)):
        reader(tmp_path / "evil.yaml")  # type: ignore[operator]
    assert not (tmp_path / "owned").exists()


def texture(seed: int, width: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=(72, width, 3)).astype(np.float32)
    return np.clip(128 + 150 * cv2.GaussianBlur(noise, (0, 0), 1.5), 0, 255).astype(np.uint8)


def hostile_bag(path: Path) -> Path:
    """A rig whose topics and frame are paths and markup."""
    wide = texture(1, 100)
    recorded = []
    for i in range(2):
        for side, first in (("left", 0), ("right", 4)):
            image = wide[:, first : first + 96].copy()
            kind, data = messages.encode(messages.image_message(image, time_ns=i * 100 * MS, frame_id=EVIL))
            recorded.append(RawMessage(f"/../../<b>evil/{side}/image_raw", kind, i * 100 * MS + 1, data))
    return write_mcap(path, recorded)


def tree(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


def test_a_survey_writes_below_its_folder_whatever_a_bag_calls_things(tmp_path: Path) -> None:
    inside = tmp_path / "a" / "b" / "c"
    inside.mkdir(parents=True)
    bag = hostile_bag(inside / "<script>evil.mcap")
    with open_bag(bag) as opened:
        assert opened.stereo_topics().left == "/../../<b>evil/left/image_raw"
    (inside / "p.yaml").write_text(
        "/**:\n  ros__parameters: {min_disparity: 0, max_disparity: 8, effort: navigation, surface_max_vertices: 100}\n"
    )
    before = tree(tmp_path)
    arguments = ["survey", str(bag), "-o", str(inside / "out"), "--params", str(inside / "p.yaml"), "--quiet"]
    assert main([*arguments, "--jobs", "1"]) in (0, 1)
    new = tree(tmp_path) - before
    assert {name for name in new if not name.startswith("a/b/c/out")} == set()
    assert not [name for name in new if "evil" in name or "script" in name]
    for page in (inside / "out").rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert "<script>evil" not in text
        assert "<script>alert" not in text
        assert "<b>evil" not in text
    made = json.loads((inside / "out" / "report.json").read_text())
    assert list(made["input"]) == ["<script>evil.mcap"], "names stay data"


def test_pages_escape_every_text() -> None:
    evil = "</script><script>alert(1)</script>\"'&"
    summary = Summary(lead=evil, facts=[(evil, evil)], warnings=[evil])
    page = render_page(evil, summary, [], None)
    assert "<script>alert" not in page
    assert page.count("&lt;script&gt;alert(1)") >= 5


def test_packing_and_info_write_nothing_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    inside = tmp_path / "x" / "y"
    inside.mkdir(parents=True)
    monkeypatch.chdir(inside)
    for side, first in (("left", 0), ("right", 4)):
        (inside / side).mkdir()
        cv2.imwrite(str(inside / side / "..1.png"), texture(2, 100)[:, first : first + 96])
    assert main(["pack", "--left", "left/*.png", "--right", "right/*.png", "-o", "bag"]) in (0, 1)
    bag = hostile_bag(inside / "evil.mcap")
    assert main(["info", str(bag)]) in (0, 1)
    assert {name.split("/")[0] for name in tree(inside)} <= {"left", "right", "bag", "evil.mcap"}
    assert tree(tmp_path) - {f"x/y/{name}" for name in tree(inside)} == {"x", "x/y"}


def test_an_output_bag_never_leaves_its_folder(tmp_path: Path) -> None:
    """The metadata of a bag names files; only their last part counts."""
    folder = tmp_path / "in" / "bag"
    folder.mkdir(parents=True)
    hostile_bag(folder / "own.mcap")
    hostile_bag(tmp_path / "outside.mcap")
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: {relative_file_paths: [../../outside.mcap, own.mcap]}"
    )
    with open_bag(folder) as bag:
        assert bag.damage == ["outside.mcap: named in metadata.yaml, not there"]
        assert len(list(bag.raw_messages())) == 4
