"""Only what both rectified views show is matched, and it comes back where it was."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from test_match_stage import GEOMETRY
from test_planes_matcher import pair_of

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.match import stage
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.match.window import window_to_match
from uw_recon_ros.types import ByteImage, RectificationQuality, RectifiedPair, Status, Window

LEFT, RIGHT = Window(24, 10, 110, 60), Window(12, 16, 100, 64)


def extend_borders(axis: str, left: Window | None = LEFT, right: Window | None = RIGHT) -> RectifiedPair:
    """A wall at 5 px, black outside the valid windows."""
    sides = []
    for image, window in zip(pair_of(np.full((90, 150), 5.0)), (left, right), strict=True):
        shown = np.zeros_like(image)
        slices = window.slices if window else np.s_[:, :]
        shown[slices] = image[slices]
        sides.append(shown)
    if axis == "vertical":
        sides = [np.ascontiguousarray(np.swapaxes(side, 0, 1)) for side in sides]
        left, right = (w and Window(w.v, w.u, w.height, w.width) for w in (left, right))
    geometry = dataclasses.replace(GEOMETRY, axis=axis)
    return RectifiedPair(
        *sides, *sides, geometry, RectificationQuality("given"), valid_left=left, valid_right=right
    )  # fmt: skip


def upright(image: np.ndarray, axis: str) -> np.ndarray:
    return image.T if axis == "vertical" else image


@pytest.mark.parametrize("axis", ["horizontal", "vertical"])
@pytest.mark.parametrize("effort", ["navigation", "balanced"])
def test_result_lies_where_it_belongs(axis: str, effort: str) -> None:
    result = Match(MatchParams(max_disparity=15, effort=effort))(extend_borders(axis))
    status, disparity = upright(result.status, axis), upright(result.disparity, axis)
    unseen = np.ones(status.shape, bool)
    unseen[LEFT.slices] = False
    assert (status[unseen] == Status.UNSEEN).all()
    assert (status[10:16, 24:134] == Status.OUTSIDE).all()  # the right view has not these rows
    assert (status[16:70, 118:134] == Status.OUTSIDE).mean() > 0.9  # nor these columns
    both = disparity[16:70, 24:116]
    assert np.isfinite(both).mean() > 0.97
    assert np.nanmedian(np.abs(both - 5)) < 0.05


@pytest.mark.parametrize("axis", ["horizontal", "vertical"])
def test_no_work_outside_the_windows(axis: str, monkeypatch: pytest.MonkeyPatch) -> None:
    shapes: list[tuple[int, ...]] = []
    real = stage.graph_cut

    def spied(left: ByteImage, right: ByteImage, *args: int, **options: object) -> object:
        shapes.extend((left.shape, right.shape))
        return real(left, right, *args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(stage, "graph_cut", spied)
    Match(MatchParams(max_disparity=15, effort="navigation"))(extend_borders(axis))
    assert shapes == [(54, 122, 3)] * 2  # common rows 16 to 70, columns 12 to 134 of either


def test_whole_images_are_matched_where_no_window_is_given() -> None:
    assert window_to_match(extend_borders("horizontal", None, None).to_match) == Window(0, 0, 150, 90)
    assert window_to_match(extend_borders("horizontal", LEFT, None).to_match) == Window(0, 10, 150, 60)


def test_black_borders_do_not_widen_the_range_found() -> None:
    result = Match(MatchParams(effort="navigation"))(extend_borders("horizontal"))
    assert -8 <= result.min_disparity <= 5 <= result.max_disparity <= 15


def test_views_that_share_no_rows_are_refused() -> None:
    with pytest.raises(EstimationError, match="expected rows in common"):
        Match(MatchParams(max_disparity=9))(extend_borders("horizontal", Window(0, 0, 150, 30), Window(0, 40, 150, 30)))
    with pytest.raises(EstimationError, match="expected columns in common"):
        Match(MatchParams(max_disparity=9))(extend_borders("vertical", Window(0, 0, 150, 30), Window(0, 40, 150, 30)))
