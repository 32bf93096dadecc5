"""Obstacles and range, on scenes whose distances are known by construction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from uw_recon_ros.camera_mount import MountParams
from uw_recon_ros.reconstruct.obstacles import (
    FindObstacles,
    ObstacleParams,
    ObstacleScan,
    nearest_agreed,
    nearest_with_neighbors,
)
from uw_recon_ros.types import DepthMap, DisparityMap, Status, StereoGeometry

WIDTH, HEIGHT, FOCAL = 160, 120, 100.0
GEOMETRY = StereoGeometry(FOCAL, WIDTH / 2, WIDTH / 2, HEIGHT / 2, 0.1)


def depth_map(depth: np.ndarray, sigma: float = 0.01, geometry: StereoGeometry = GEOMETRY) -> DepthMap:
    depth = depth.astype(np.float32)
    return DepthMap(
        depth, np.full_like(depth, sigma), np.zeros(depth.shape, np.uint8), geometry, 7, "left_optical_frame"
    )


def wall(distance: float) -> np.ndarray:
    return np.full((HEIGHT, WIDTH), distance)


def disparities(depth: DepthMap, **changes: object) -> DisparityMap:
    """What a depth map was made of."""
    values = FOCAL * 0.1 / depth.depth
    near = int(np.nanmax(np.nan_to_num(values))) + 50
    return replace(DisparityMap(values, values, depth.status, 0, near, depth.geometry), **changes)


class Finder(FindObstacles):
    def look(self, depth: DepthMap, disparity: DisparityMap | None = None) -> ObstacleScan:
        return super().look(depth, disparity or disparities(depth))


def finder(**params: object) -> Finder:
    mount = {name: params.pop(name) for name in list(params) if name.startswith("camera_")}
    return Finder(ObstacleParams(**params), MountParams(base_frame="base_link", **mount))


def direction(sectors, index: int) -> float:
    return sectors.first_rad + index * sectors.step_rad


def test_a_wall_ahead_is_as_far_in_each_sector_as_geometry_says() -> None:
    sectors = finder(obstacle_field_deg=60.0).look(depth_map(wall(2.0))).sectors()
    assert (sectors.frame_id, sectors.stamp_ns, len(sectors.ranges)) == ("base_link", 7, 12)
    for index, distance in enumerate(sectors.ranges):
        nearest = abs(direction(sectors, index)) - sectors.step_rad / 2
        assert distance == pytest.approx(2.0 / np.cos(nearest), rel=0.01)


def test_left_is_left_and_beside_it_is_unknown() -> None:
    depth = np.full((HEIGHT, WIDTH), np.nan)
    depth[:, :20] = 1.5
    sectors = finder(obstacle_field_deg=90.0).look(depth_map(depth)).sectors()
    seen = [direction(sectors, i) for i in np.flatnonzero(np.isfinite(sectors.ranges))]
    assert seen
    assert min(seen) > 0.5  # counterclockwise: to the left


def test_for_mavros_left_and_right_change_places_and_the_frame_says_so() -> None:
    depth = np.full((HEIGHT, WIDTH), np.nan)
    depth[:, :20] = 1.5
    ours, theirs = (finder(obstacle_axes=axes).look(depth_map(depth)).sectors() for axes in ("flu", "frd"))
    np.testing.assert_array_equal(ours.ranges, theirs.ranges[::-1])
    assert (ours.frame_id, theirs.frame_id) == ("base_link", "base_link_frd")


@pytest.mark.parametrize(
    ("params", "offset"),
    [({"camera_x_m": 0.4}, 0.4), ({"camera_x_m": -0.3}, -0.3)],
)
def test_distances_are_from_the_base(params: dict[str, float], offset: float) -> None:
    sectors = finder(obstacle_field_deg=10.0, obstacle_sector_deg=10.0, **params).look(depth_map(wall(2.0))).sectors()
    assert sectors.ranges[0] == pytest.approx(2.0 + offset, rel=0.01)


def test_what_lies_above_and_below_is_no_obstacle() -> None:
    depth = np.full((HEIGHT, WIDTH), np.nan)
    depth[-20:] = 1.0  # 0.4 to 0.6 m below the camera
    found = finder(obstacle_min_height_m=-0.3).look(depth_map(depth)).sectors().ranges
    assert np.isnan(found).all()
    assert np.isfinite(finder(obstacle_min_height_m=-0.7).look(depth_map(depth)).sectors().ranges).any()
    raised = finder(obstacle_min_height_m=-0.3, camera_z_m=0.5).look(depth_map(depth)).sectors().ranges
    assert np.isfinite(raised).any()


def test_uncertain_depths_and_a_few_pixels_tell_nothing() -> None:
    assert np.isnan(finder().look(depth_map(wall(2.0), sigma=0.2)).sectors().ranges).all()
    depth = np.full((HEIGHT, WIDTH), np.nan)
    depth[60, 80:83] = 1.0
    assert np.isnan(finder().look(depth_map(depth)).sectors().ranges).all()
    assert finder().look(depth_map(depth)).along_axis() is None


@pytest.mark.parametrize(("beside", "told"), [(2.0, True), (1.5, False), (np.nan, False)])
def test_a_corner_of_a_thing_is_told_with_the_rest_of_it_in_the_next_sector(beside: float, told: bool) -> None:
    """4 pixels in the sector straight ahead, many to its left: at the same distance they are one thing."""
    depth = np.full((HEIGHT, WIDTH), np.nan)
    depth[50:70, 60:76] = beside
    depth[58:62, 76] = 2.0
    edge = float(np.rad2deg(np.arctan(4.5 / FOCAL)))
    limits = {"obstacle_field_deg": 6 * edge, "obstacle_sector_deg": 2 * edge, "obstacle_min_share": 20 / depth.size}
    right, ahead, left = finder(**limits).look(depth_map(depth)).sectors().ranges
    assert np.isnan(right)
    assert np.isfinite(ahead) == told
    assert np.isfinite(left) == np.isfinite(beside)


Silent = tuple[DepthMap, DisparityMap | None, dict[str, object]]


def silent(cause: str) -> Silent:
    """A wall ahead that is silent for one cause alone."""
    depth, params = depth_map(wall(2.0)), dict[str, object]()
    given = disparities(depth)
    if cause == "open water":
        depth = replace(depth_map(wall(np.nan)), status=np.full((HEIGHT, WIDTH), Status.LOW_TEXTURE, np.uint8))
    elif cause == "disagree":
        depth = replace(depth_map(wall(np.nan)), status=np.full((HEIGHT, WIDTH), Status.INCONSISTENT, np.uint8))
    elif cause == "small things":
        params = {"obstacle_min_size_m": 1.0}
        depth = depth_map(wall(0.3))
        given = disparities(depth)
    elif cause == "low certainty":
        depth = depth_map(wall(2.0), sigma=0.2)
    elif cause == "near limit of the search":
        given = disparities(depth, max_disparity=6)
    elif cause == "low confidence":
        given = disparities(depth, confidence=np.full((HEIGHT, WIDTH), 0.5, np.float32))
    elif cause == "out of limits":
        depth = depth_map(wall(40.0), sigma=0.1)
    elif cause == "nothing in the":
        params = {"obstacle_min_height_m": 5.0, "obstacle_max_height_m": 6.0, "range_axis": "down"}
    else:
        rows = np.geomspace(1.0, 15.0, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)
        depth, params = depth_map(rows, sigma=0.001), {"obstacle_min_share": 0.1, "range_cone_deg": 60.0}
        assert cause == "no agreement"
    return depth, given, params


CAUSES = (
    "open water", "disagree", "small things", "low certainty", "near limit of the search", "low confidence",
    "out of limits", "nothing in the", "no agreement",
)  # fmt: skip


@pytest.mark.parametrize("cause", CAUSES)
def test_why_nothing_is_told_is_told(cause: str) -> None:
    depth, given, params = silent(cause)
    around = finder(**params).look(depth, given)
    assert np.isnan(around.sectors().ranges).all()
    assert around.along_axis() is None
    for text in (around.why_no_sector(), around.why_no_range()):
        assert [other for other in CAUSES if other in text] == [cause]
        assert "\n" not in text


@pytest.mark.parametrize(("distance", "told"), [(0.8, False), (1.0, False), (4.0, True)])
@pytest.mark.parametrize("corner", [False, True])
def test_a_particle_is_no_obstacle_but_a_corner_of_a_thing_is(distance: float, told: bool, corner: bool) -> None:
    """10 pixels to the side: 8 to 10 cm up close, 40 far away, where nothing under 12 cm counts."""
    depth = np.full((HEIGHT, WIDTH), np.nan)
    depth[55:65, 75:85] = distance
    if corner:  # below the slice and the cone, and one with it
        depth[65:, 75:85] = distance
    limits = {"obstacle_min_height_m": -0.02, "obstacle_sector_deg": 30.0, "range_cone_deg": 4.0}
    around = finder(obstacle_min_size_m=0.12, **limits).look(depth_map(depth))
    assert np.isfinite(around.sectors().ranges).any() == (told or corner)
    assert (around.along_axis() is not None) == (told or corner)
    assert told or corner or "small things" in around.why_no_range()
    assert np.isfinite(finder(obstacle_min_size_m=0.0, **limits).look(depth_map(depth)).sectors().ranges).any()


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(0.02, 30.0), st.floats(-60, 90))
def test_a_told_distance_is_within_the_limits_that_are_told(x: float, y: float, away: float, pitch: float) -> None:
    """A consumer throws away what is not, or takes it for free."""
    mount = {"camera_x_m": x, "camera_y_m": y, "camera_pitch_deg": pitch}
    field = {"obstacle_field_deg": 360.0, "obstacle_min_height_m": -50.0, "obstacle_max_height_m": 50.0}
    sectors = finder(**field, **mount).look(depth_map(wall(away), sigma=1e-4)).sectors()
    told = sectors.ranges[~np.isnan(sectors.ranges)]
    assert ((told >= sectors.min_range) & (told <= sectors.max_range)).all()


def test_what_is_unlikely_tells_nothing() -> None:
    depth = depth_map(wall(2.0))
    for share, told in ((0.95, True), (0.85, False)):
        unsure = disparities(depth, confidence=np.full(depth.depth.shape, share, np.float32))
        assert np.isfinite(finder().look(depth, unsure).sectors().ranges).any() == told
        assert (finder().look(depth, unsure).along_axis() is not None) == told


@pytest.mark.parametrize("sign", [1, -1])
def test_the_nearest_that_was_looked_for_is_no_obstacle(sign: int) -> None:
    """What is nearer than the search lands at its limit, and so does water without anything in it."""
    depth = depth_map(wall(1.0), geometry=replace(GEOMETRY, baseline_m=0.1 * sign))
    values = np.full(depth.depth.shape, np.float32(sign * 10.0))
    for limit, told in ((10, False), (13, False), (17, True)):
        low, high = sorted((0, sign * limit))
        found = disparities(depth, disparity=values, min_disparity=low, max_disparity=high)
        assert np.isfinite(finder().look(depth, found).sectors().ranges).any() == told
    unknown = disparities(depth, disparity=values, min_disparity=0, max_disparity=0)
    assert np.isfinite(finder().look(depth, unknown).sectors().ranges).any()


def test_range_ahead_and_down() -> None:
    ahead = finder().look(depth_map(wall(2.0), sigma=0.03)).along_axis()
    assert ahead is not None
    assert (ahead.distance, ahead.sigma) == (pytest.approx(2.0), pytest.approx(0.03, rel=0.02))
    assert finder(range_axis="down").look(depth_map(wall(2.0))).along_axis() is None
    down = finder(range_axis="down", camera_pitch_deg=90.0).look(depth_map(wall(2.0))).along_axis()
    assert down is not None
    assert down.distance == pytest.approx(2.0)


def test_a_slanted_camera_measures_the_height_over_a_level_floor() -> None:
    """Depth of the plane z = -1.2 m under a camera that looks down by 50 degrees, by a ray tracer of its own."""
    mount = MountParams(base_frame="base_link", camera_pitch_deg=50.0)
    params = ObstacleParams(range_axis="down", range_cone_deg=40.0)
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    rays = np.stack([(u - WIDTH / 2) / FOCAL, (v - HEIGHT / 2) / FOCAL, np.ones_like(u, float)], axis=-1)
    down = -(rays @ mount.base_from_optical.T)[..., 2]
    depth = np.where(down > 0.05, 1.2 / np.maximum(down, 0.05), np.nan)
    found = Finder(params, mount).look(depth_map(depth)).along_axis()
    assert found is not None
    assert found.distance == pytest.approx(1.2, rel=1e-3)


def test_the_mounting_turns_as_rep_103_says() -> None:
    ahead = np.array([0.0, 0.0, 1.0])
    right = np.array([1.0, 0.0, 0.0])
    assert MountParams().base_from_optical @ ahead == pytest.approx([1, 0, 0])
    assert MountParams(camera_pitch_deg=90.0).base_from_optical @ ahead == pytest.approx([0, 0, -1], abs=1e-12)
    assert MountParams(camera_yaw_deg=90.0).base_from_optical @ ahead == pytest.approx([0, 1, 0], abs=1e-12)
    assert MountParams(camera_roll_deg=90.0).base_from_optical @ right == pytest.approx([0, 0, -1], abs=1e-12)


def test_without_a_scale_there_is_nothing_to_tell() -> None:
    unscaled = depth_map(wall(2.0), geometry=GEOMETRY.unscaled)
    with pytest.raises(ValueError, match="expected a metric"):
        finder().look(unscaled)


@given(
    st.lists(st.tuples(st.floats(0.1, 20.0), st.integers(0, 3)), max_size=40),
    st.integers(1, 5),
)
def test_the_nearest_agreed_is_what_a_search_finds(pairs: list[tuple[float, int]], fewest: int) -> None:
    distances = np.array([d for d, _ in pairs])
    groups = np.array([g for _, g in pairs], np.int64)
    expected = []
    for group in range(4):
        own = [d for d, g in pairs if g == group]
        agreed = [d for d in own if sum(d <= other <= d * 1.1 for other in own) >= fewest]
        expected.append(min(agreed, default=np.nan))
    np.testing.assert_array_equal(nearest_agreed(distances, groups, 4, fewest), expected)


@given(
    st.lists(st.tuples(st.floats(0.1, 20.0), st.integers(-1, 4)), max_size=60),
    st.integers(1, 40),
)
def test_with_neighbors_the_nearest_is_what_a_search_finds(points: list[tuple[float, int]], fewest: int) -> None:
    least = max(1, round(0.05 * fewest))
    expected = []
    for sector in range(4):
        own = [d for d, s in points if s == sector]
        around = [d for d, s in points if abs(s - sector) <= 1]
        beyond = {d: sum(d <= other <= d * 1.1 for other in own) for d in own}
        beside = {d: sum(d / 1.1 <= other <= d * 1.1 for other in around) for d in own}
        told = [d for d in own if beyond[d] >= fewest or (beyond[d] >= least and beside[d] >= fewest)]
        expected.append(min(told, default=np.nan))
    distances, sectors = np.array([d for d, _ in points]), np.array([s for _, s in points], np.int64)
    np.testing.assert_array_equal(nearest_with_neighbors(distances, sectors, 4, fewest), expected)


@given(st.floats(-180, 180), st.floats(-90, 90), st.floats(-180, 180))
def test_mountings_are_rotations(roll: float, pitch: float, yaw: float) -> None:
    matrix = MountParams(camera_roll_deg=roll, camera_pitch_deg=pitch, camera_yaw_deg=yaw).base_from_optical
    assert Rotation.from_matrix(matrix).as_matrix() == pytest.approx(matrix, abs=1e-9)


def test_contradictory_parameters_are_refused() -> None:
    with pytest.raises(ValueError, match="obstacle_min_height_m"):
        ObstacleParams(obstacle_min_height_m=1.0, obstacle_max_height_m=0.0)
    with pytest.raises(ValueError, match="obstacle_sector_deg"):
        ObstacleParams(obstacle_sector_deg=20.0, obstacle_field_deg=10.0)
