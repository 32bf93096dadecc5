"""The front door for Python: the page's examples run, names agree, nothing heavy is loaded before it is needed."""

from __future__ import annotations

import ast
import doctest
import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import uw_recon_ros as uw
from uw_recon_ros.bags import open_bag
from uw_recon_ros.preprocess.stage import Preprocess
from uw_recon_ros.types import StereoPair

ROOT = Path(__file__).parent.parent
SCENE = np.random.default_rng(5).integers(0, 256, (60, 70), np.uint8).repeat(2, axis=0).repeat(2, axis=1)
ROOMS = ("match", "reconstruct", "rectify", "calibrate", "measure")  # packages that are verbs, too
FLAGS = doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL


def test_the_examples_of_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    page = ROOT / "docs" / "python.md"
    failed, tried = doctest.testfile(str(page), module_relative=False, optionflags=FLAGS)
    assert tried > 15
    assert not failed


def test_an_import_loads_nothing_and_knows_all_names() -> None:
    code = "import sys, uw_recon_ros; dir(uw_recon_ros); uw_recon_ros.ReconError; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert "uw_recon_ros" in loaded
    assert not loaded & {"numpy", "cv2", "numba", "scipy", "rosbags", "yaml", "rclpy"}


def test_what_is_typed_is_what_is_found() -> None:
    tree = ast.parse(Path(uw.__file__).read_text(encoding="utf-8"))
    [typed] = [n for n in tree.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"]
    places = {
        alias.name: node.module for node in typed.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert sorted(places) == sorted(uw.__all__)
    assert set(uw.__all__) <= set(dir(uw))
    for name, module in places.items():
        here = getattr(importlib.import_module(str(module)), name)
        assert getattr(uw, name) is (sys.modules[f"uw_recon_ros.{name}"] if name in ROOMS else here)
        assert inspect.getdoc(here), name
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = uw.nonsense  # type: ignore[attr-defined]


@pytest.mark.parametrize("before", ["", "import uw_recon_ros.match.stage, uw_recon_ros.rectify; "])
def test_a_room_is_a_verb_whatever_was_imported_before(before: str) -> None:
    code = (
        before + "import uw_recon_ros as uw; print(callable(uw.match), callable(uw.rectify), callable(uw.reconstruct))"
    )
    code += "; import uw_recon_ros.match as room; print(callable(room), room.stage.Match.__name__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True", "True", "True", "Match"]


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
@pytest.mark.parametrize("colour", [False, True])
def test_any_kind_of_image_is_matched(bits: int, colour: bool) -> None:
    image = np.dstack([SCENE] * 3) if colour else SCENE
    image = image if bits == 8 else image.astype(np.uint16) << (bits - 8)
    found = uw.match(image, np.roll(image, -5, axis=1), max_disparity=12)
    assert np.nanmedian(found.disparity) == pytest.approx(5, abs=0.1)
    assert found.disparity.shape == found.sigma.shape == found.status.shape == SCENE.shape
    assert found.density > 0.9
    assert (found.min_disparity, found.max_disparity) == (0, 12)


def test_doubts_are_told() -> None:
    tilted = np.roll(np.roll(SCENE, -5, axis=1), 3, axis=0)
    assert uw.Code.RECTIFY_ROWS_DISAGREE in [f.code for f in uw.match(SCENE, tilted, 12).findings]
    assert uw.match(SCENE, np.roll(SCENE, -5, axis=1), 12).findings == ()


@pytest.mark.parametrize(
    ("left", "right", "words"),
    [
        (SCENE, SCENE, "expected two different images"),
        (SCENE, SCENE[:-1], "expected two images of one size"),
        (SCENE.astype(np.float64), SCENE.astype(np.float64) + 1, "got .* float64"),
        (np.zeros((4, 5, 4), np.uint8), np.zeros((4, 5, 4), np.uint8), "expected \\(H, W\\)"),
        (np.zeros(4, np.uint8), np.zeros(4, np.uint8), "expected \\(H, W\\)"),
    ],
)
def test_what_is_no_pair_is_refused_by_every_verb(left: np.ndarray, right: np.ndarray, words: str) -> None:
    for verb in (uw.enhance, uw.rectify, uw.match, uw.reconstruct):
        with pytest.raises(uw.ImageError, match=words):
            verb(left, right)


def test_what_is_no_calibration_is_named() -> None:
    for verb in (uw.rectify, uw.reconstruct):
        with pytest.raises(TypeError, match=r"read_calibration\(\)"):
            verb(SCENE, np.roll(SCENE, -5, axis=1), "rig.yaml")  # type: ignore[arg-type]


def test_products_are_made_when_asked_for() -> None:
    right = np.roll(SCENE, -5, axis=1)
    products = uw.reconstruct(SCENE, right)
    assert not products.stages_seconds
    enhanced = products.enhanced
    assert set(products.stages_seconds) == {"preprocess"}
    assert products.enhanced is enhanced
    expected = Preprocess()(StereoPair(SCENE, right))
    np.testing.assert_array_equal(uw.enhance(SCENE, right).left, expected.left)


def test_damage_of_a_recording_is_warned_of(tmp_path: Path) -> None:
    data = (ROOT / "bags" / "amphora" / "amphora.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 6 // 10])
    with pytest.warns(UserWarning, match=r"cut\.mcap: "):
        found = list(uw.pairs(tmp_path / "cut.mcap"))
    with open_bag(ROOT / "bags" / "amphora") as bag:
        whole = list(bag.stereo_pairs(tolerance_ns=1_000_000))
    assert 0 < len(found) < len(whole)
    assert [pair.stamp_ns for pair in uw.pairs(ROOT / "bags" / "amphora")] == [pair.stamp_ns for pair in whole]
