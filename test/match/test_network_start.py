"""A network of the user's in the place of the semi-global start: shapes, sizes, signs, limits, and what it refuses."""

from __future__ import annotations

import builtins
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from test_planes_matcher import pair_of, step_pair

stereo_networks = pytest.importorskip("helpers.stereo_networks")
from uw_recon_ros.errors import EstimationError  # noqa: E402
from uw_recon_ros.findings import Code  # noqa: E402
from uw_recon_ros.match import stereo_network  # noqa: E402
from uw_recon_ros.match.methods import EFFORTS, NETWORK_VALUES  # noqa: E402
from uw_recon_ros.match.network_start import begin_with  # noqa: E402
from uw_recon_ros.match.planes.initial_disparity import Beginning, begin  # noqa: E402
from uw_recon_ros.match.planes.matcher import graph_cut  # noqa: E402
from uw_recon_ros.match.stage import Match, MatchParams  # noqa: E402
from uw_recon_ros.match.stereo_network import load_network  # noqa: E402
from uw_recon_ros.types import MatchingPair, Status  # noqa: E402

write_network = stereo_networks.write_network
H, W = 70, 110  # no multiples of anything
TRUTH = np.full((H, W), 4.0)
TRUTH[20:50, 40:80] = 9.0
PAIR = pair_of(TRUTH)


def start(path: Path, low: int = 0, high: int = 15, values: str = "0..255", output: str = "", pair: Any = PAIR) -> Any:
    return begin_with(load_network(str(path), values, output, 1), *pair, low, high, 1)


def wrong(found: Beginning, truth: NDArray[np.float64] = TRUTH) -> float:
    """Share of the pixels that the views agree about, over half a pixel off; most must be agreed about."""
    inner = found.usable & (np.arange(truth.shape[1]) >= 12)
    assert inner.mean() > 0.6
    return float((np.abs(found.disparity - truth)[inner] > 0.5).mean())


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"size": (128, 96)},
        {"channels": 1},
        {"one_input": True},
        {"one_input": True, "channels": 1, "size": (128, 96)},
        {"names": ("right", "left")},
        {"names": ("first", "second")},
        {"flow": True},
        {"rank": 3},
        {"rank": 2},
        {"kind": stereo_networks.TensorProto.UINT8},
        {"kind": stereo_networks.TensorProto.FLOAT16},
    ],
)
def test_networks_of_many_shapes_say_the_same(how: dict[str, Any], tmp_path: Path) -> None:
    found = start(write_network(tmp_path / "net.onnx", **how))
    assert wrong(found) < 0.04


def test_what_one_camera_alone_sees_is_told(tmp_path: Path) -> None:
    left, right, truth = step_pair()
    found = start(write_network(tmp_path / "net.onnx"), pair=(left, right))
    hidden = np.isnan(truth)
    assert found.usable[~hidden].mean() > 0.85
    assert np.isin(found.status[hidden], (Status.OCCLUDED, Status.OUTSIDE)).mean() > 0.7
    assert found.usable[hidden].mean() < 0.2


def test_of_a_smaller_size_disparities_are_scaled_back(tmp_path: Path) -> None:
    truth = np.full((2 * H, 2 * W), 8.0)
    truth[40:100, 80:160] = 18.0
    views = [np.kron(view, np.ones((2, 2, 1), np.uint8)) for view in PAIR]
    found = start(write_network(tmp_path / "net.onnx", size=(W, H)), 0, 30, pair=views)
    assert wrong(found, truth) < 0.06


@pytest.mark.parametrize("low", [-6, -20, 2])
def test_disparities_below_zero_and_ranges_that_begin_above_it(low: int, tmp_path: Path) -> None:
    """The network knows 0 to 15 alone: it is shown views that are moved apart."""
    views = pair_of(TRUTH + low)
    assert wrong(start(write_network(tmp_path / "net.onnx"), low, low + 15, pair=views), TRUTH + low) < 0.05


def test_what_lies_outside_the_limits_is_not_agreed_about(tmp_path: Path) -> None:
    found = start(write_network(tmp_path / "net.onnx"), 0, 6)
    assert found.disparity.max() <= 6
    assert not found.usable[22:48, 44:76].any()


def test_nothing_of_what_is_not_finite_is_used(tmp_path: Path) -> None:
    found = start(write_network(tmp_path / "net.onnx", scale=float("nan")))
    assert np.isfinite(found.disparity).all()
    assert not found.usable.any()


@pytest.mark.parametrize("effort", EFFORTS)
@pytest.mark.parametrize("axis", ["horizontal", "vertical"])
def test_every_effort_starts_from_it(effort: str, axis: str, tmp_path: Path) -> None:
    left, right = PAIR
    if axis == "vertical":
        left, right = (np.ascontiguousarray(view.swapaxes(0, 1)) for view in (left, right))
    net = str(write_network(tmp_path / "net.onnx"))
    params = MatchParams(effort=effort, max_disparity=15, start_network=net, start_network_values="0..255")
    found, _ = Match(params).images(MatchingPair(left, right, axis))  # type: ignore[arg-type]
    disparity = found.disparity if axis == "horizontal" else found.disparity.T
    known = np.isfinite(disparity)
    assert known.mean() > 0.7
    assert (np.abs(disparity - TRUTH)[known] > 1).mean() < 0.03


def test_cuts_correct_what_it_makes_up_or_doubt_it(tmp_path: Path) -> None:
    """A network that says two and a half times the disparity: nothing of that comes out as sure."""
    net = str(write_network(tmp_path / "net.onnx", scale=2.5))
    found, _ = Match(MatchParams(max_disparity=24, start_network=net)).images(MatchingPair(*PAIR))
    assert found.sigma is not None
    sure = np.isfinite(found.disparity) & (found.sigma < 1)
    assert (np.abs(found.disparity - TRUTH)[sure] > 1).mean() < 0.1 if sure.any() else True


@pytest.mark.parametrize("values", NETWORK_VALUES)
def test_gray_levels_are_scaled_as_asked(values: str) -> None:
    levels = np.broadcast_to(np.array([0, 255], np.float32)[:, None, None], (2, 1, 3))
    black, white = stereo_network._scaled(levels, values)[:, 0]
    expected = {
        "0..1": ([0] * 3, [1] * 3),
        "0..255": ([0] * 3, [255] * 3),
        "-1..1": ([-1] * 3, [1] * 3),
        "imagenet": ([-2.1179, -2.0357, -1.8044], [2.2489, 2.4286, 2.64]),
    }[values]
    np.testing.assert_allclose(black, expected[0], atol=1e-3)
    np.testing.assert_allclose(white, expected[1], atol=1e-3)


def test_of_two_outputs_one_must_be_named(tmp_path: Path) -> None:
    net = write_network(tmp_path / "net.onnx", also=True)
    with pytest.raises(EstimationError, match=r"disparity .*certainty .*start_network_output"):
        start(net)
    assert wrong(start(net, output="disparity")) < 0.04
    with pytest.raises(EstimationError, match=r"one of disparity, certainty, got 'depth'"):
        start(net, output="depth")


def test_what_fails_when_run_is_told_in_a_line(tmp_path: Path) -> None:
    with pytest.raises(EstimationError, match="start_network: expected a network that runs") as caught:
        start(write_network(tmp_path / "net.onnx", broken=True))
    assert caught.value.code == Code.MATCH_NETWORK
    assert "\n" not in str(caught.value)


def test_a_file_that_is_no_network(tmp_path: Path) -> None:
    (tmp_path / "net.onnx").write_bytes(b"weights")
    with pytest.raises(EstimationError, match="an ONNX network that ONNX Runtime can load") as caught:
        start(tmp_path / "net.onnx")
    assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="expected an ONNX file"):
        MatchParams(start_network=str(tmp_path / "other.onnx"))
    with pytest.raises(ValueError, match="expected method graph_cut"):
        MatchParams(start_network=str(tmp_path / "net.onnx"), method="kz2")


def test_a_network_of_something_else(tmp_path: Path) -> None:
    with pytest.raises(EstimationError, match=r"two images .* got left tensor\(float\)"):
        start(write_network(tmp_path / "net.onnx", channels=4))


def test_warming_up_tells_before_the_first_pair_comes(tmp_path: Path) -> None:
    (tmp_path / "net.onnx").write_bytes(b"weights")
    with pytest.raises(EstimationError, match="start_network"):
        Match(MatchParams(start_network=str(tmp_path / "net.onnx"))).warm_up()


def test_a_file_that_changes_is_read_again(tmp_path: Path) -> None:
    assert start(write_network(tmp_path / "net.onnx")).disparity.max() > 8
    assert start(write_network(tmp_path / "net.onnx", scale=0.25)).disparity.max() < 5


def test_without_the_extra_a_line_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def missing(name: str, *args: Any, **kwargs: Any) -> Any:
        if name == "onnxruntime":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(EstimationError, match=r"pip install '\.\[network\]'"):
        start(write_network(tmp_path / "net.onnx"))


def test_threads_change_no_bit(tmp_path: Path) -> None:
    path = str(write_network(tmp_path / "net.onnx"))
    one, two = (load_network(path, "0..1", "", threads)(*(np.atleast_3d(v) for v in PAIR)) for threads in (1, 2))
    assert one.tobytes() == two.tobytes()


def test_the_own_start_holds_planes_and_a_network_s_does_not(tmp_path: Path) -> None:
    """Where rows are mended the start is made before the cuts: it counts as if they had made it."""
    left, right = PAIR
    own = begin(left, right, 0, 15, 1)
    alone, given = (graph_cut(left, right, 0, 15, effort="balanced", start=begun) for begun in (None, own))
    assert given.disparity.tobytes() == alone.disparity.tobytes()
    assert start(write_network(tmp_path / "net.onnx")).learned
    assert not own.learned
