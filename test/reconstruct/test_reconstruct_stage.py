"""The stage as its callers see it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.reconstruct_scenes import ABOVE, GEOMETRIES, HORIZONTAL, disparity_map, picture, plane_depth, sphere_depth

from uw_recon_ros import connected_pieces
from uw_recon_ros.reconstruct import cloud, gaps, planes, rasters, speckles
from uw_recon_ros.reconstruct.stage import Reconstruct, ReconstructParams
from uw_recon_ros.types import Status


def scene(geometry):
    return np.minimum(sphere_depth(geometry, (0, 0, 2), 0.5), plane_depth(geometry, (0.3, 0.2, 1), 2.4))


def relative_error(estimate, truth):
    return np.abs(estimate / truth - 1)


@pytest.mark.parametrize("name", GEOMETRIES)
def test_depth_of_a_clean_scene_is_the_truth(name):
    truth = scene(GEOMETRIES[name])
    exact = Reconstruct(ReconstructParams(depth_filter_levels=0)).depth(disparity_map(truth, GEOMETRIES[name]))
    np.testing.assert_allclose(exact.depth, truth, rtol=1e-5)
    assert (exact.stamp_ns, exact.frame_id) == (123, "left_optical_frame")


@pytest.mark.parametrize("name", GEOMETRIES)
def test_the_filter_changes_a_clean_scene_by_less_than_its_sigma(name):
    truth = scene(GEOMETRIES[name])
    depth = Reconstruct().depth(disparity_map(truth, GEOMETRIES[name]))
    in_sigmas = np.abs(depth.depth - truth) / depth.sigma
    assert np.median(in_sigmas) < 0.05
    assert np.quantile(in_sigmas, 0.98) < 1
    assert in_sigmas.max() < 4.685


def test_depth_of_a_noisy_scene_is_better_than_unfiltered():
    truth = scene(HORIZONTAL)
    noisy = disparity_map(truth, HORIZONTAL, noise_px=0.25, sigma_px=0.25)
    with_filter = relative_error(Reconstruct().depth(noisy).depth, truth)
    without = relative_error(Reconstruct(ReconstructParams(depth_filter_levels=0)).depth(noisy).depth, truth)
    assert np.nanmedian(with_filter) < np.nanmedian(without) / 3


def test_status_says_why_and_agrees_with_nan():
    disparity = disparity_map(scene(HORIZONTAL), HORIZONTAL)
    image, status = disparity.disparity.copy(), disparity.status.copy()
    image[50:53, 50:53] = 40.0  # a speckle
    image[0:20, 0:20], status[0:20, 0:20] = np.nan, Status.OCCLUDED
    image[60:80, 100:120] = -3.45  # next to infinity: offset 3.5
    depth = Reconstruct().depth(replace(disparity, disparity=image, status=status))
    assert (depth.status[50:53, 50:53] == Status.FILTERED).all()
    assert (depth.status[0:20, 0:20] == Status.OCCLUDED).all()
    assert (depth.status[62:78, 102:118] == Status.OUT_OF_RANGE).all()
    assert np.array_equal(depth.status == 0, np.isfinite(depth.depth))
    assert np.array_equal(depth.status == 0, np.isfinite(depth.sigma))
    assert depth.status.dtype == np.uint8


def test_sigma_is_the_matchers_propagated():
    disparity = disparity_map(plane_depth(HORIZONTAL, (0, 0, 1), 2.0), HORIZONTAL, sigma_px=0.2)
    sigma = Reconstruct().depth(disparity).sigma
    np.testing.assert_allclose(sigma, 2.0**2 / (150 * 0.1) * 0.2, rtol=1e-3)


@pytest.mark.parametrize("name", GEOMETRIES)
def test_all_outputs_share_frame_scale_and_place(name):
    stage, truth = Reconstruct(), scene(GEOMETRIES[name])
    depth = stage.depth(disparity_map(truth, GEOMETRIES[name]))
    cloud, thin, surface = (make(depth, picture()) for make in (stage.cloud, stage.filtered_cloud, stage.surface))
    for output in (cloud, thin, surface):
        assert (output.stamp_ns, output.frame_id, output.metric) == (123, "left_optical_frame", True)
    for points in (thin.points, surface.vertices):
        low, high = np.nanmin(cloud.points, axis=(0, 1)), np.nanmax(cloud.points, axis=(0, 1))
        assert (points >= low - 1e-5).all()
        assert (points <= high + 1e-5).all()


def test_cloud_frame_reaches_cloud_and_surface():
    c, s = np.cos(0.3), np.sin(0.3)
    rotation = ((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0))
    geometry = replace(HORIZONTAL, rect_from_raw_left=rotation)
    results = {}
    for frame in ("optical", "rectified"):
        stage = Reconstruct(ReconstructParams(cloud_frame=frame))
        depth = stage.depth(disparity_map(scene(geometry), geometry))
        results[frame] = stage.cloud(depth, picture()), stage.surface(depth, picture())
    (cloud_o, surface_o), (cloud_r, surface_r) = results["optical"], results["rectified"]
    R = np.array(rotation)
    np.testing.assert_allclose(cloud_o.points @ R.T, cloud_r.points, atol=1e-5)
    np.testing.assert_allclose(surface_o.vertices @ R.T, surface_r.vertices, atol=1e-5)
    np.testing.assert_allclose(surface_o.normals @ R.T, surface_r.normals, atol=1e-4)


def test_unknown_scale_thins_in_median_depths():
    unknown = replace(ABOVE, baseline_m=None, baseline_sign=-1)
    stage = Reconstruct(ReconstructParams(cloud_max_range=1.1, cloud_voxel=0.05))
    depth = stage.depth(disparity_map(plane_depth(unknown, (0.0, 0.0, 1.0), 20.0), unknown))
    thin = stage.filtered_cloud(depth, picture())
    assert not thin.metric
    distance = np.linalg.norm(thin.points, axis=1)
    assert 20.0 - 0.01 < distance.min() <= distance.max() <= 22.0
    spacing = np.sort(np.linalg.norm(thin.points[None] - thin.points[:, None], axis=-1), axis=1)[:, 1]
    assert np.median(spacing) == pytest.approx(1.0, rel=0.3)


def test_same_input_same_bits():
    disparity = disparity_map(scene(HORIZONTAL), HORIZONTAL, noise_px=0.2)
    stage = Reconstruct()
    first, second = stage.depth(disparity), stage.depth(disparity)
    assert first.depth.tobytes() == second.depth.tobytes()
    for a, b in zip(*(vars(stage.surface(d, picture())).values() for d in (first, second)), strict=True):
        assert np.array_equal(a, b)


def test_input_is_left_alone():
    disparity = disparity_map(scene(HORIZONTAL), HORIZONTAL, noise_px=0.2)
    copies = disparity.disparity.copy(), disparity.sigma.copy(), disparity.status.copy()
    for array in (disparity.disparity, disparity.sigma, disparity.status):
        array.flags.writeable = False
    left = picture()
    left.flags.writeable = False
    stage = Reconstruct()
    depth = stage.depth(disparity)
    stage.filtered_cloud(depth, left)
    stage.surface(depth, left)
    for before, after in zip(copies, (disparity.disparity, disparity.sigma, disparity.status), strict=True):
        assert np.array_equal(before, after, equal_nan=before.dtype != np.uint8)


def test_a_map_without_any_disparity_gives_empty_outputs():
    stage = Reconstruct()
    depth = stage.depth(disparity_map(np.full((120, 160), np.inf) * np.nan, HORIZONTAL))
    assert np.isnan(depth.depth).all()
    assert len(stage.filtered_cloud(depth, picture()).points) == 0
    assert len(stage.surface(depth, picture()).faces) == 0


def test_a_mono_image_colours_grey():
    stage = Reconstruct()
    depth = stage.depth(disparity_map(scene(HORIZONTAL), HORIZONTAL))
    grey = picture()[..., 0]
    assert np.array_equal(stage.cloud(depth, grey).colors, np.repeat(grey[..., None], 3, axis=2))


def test_after_warming_up_nothing_is_left_to_compile():
    stage = Reconstruct()
    stage.warm_up()
    kernels = (
        planes._lay_out, planes._fit, connected_pieces._label, speckles._mark_small, cloud._number_cells, cloud._add_up,
        gaps._close, rasters.misfit, rasters.broken_triangles,
    )  # fmt: skip
    before = [len(kernel.signatures) for kernel in kernels]
    assert min(before) >= 1
    depth = stage.depth(disparity_map(scene(HORIZONTAL), HORIZONTAL, noise_px=0.2))
    stage.filtered_cloud(depth, picture())
    stage.surface(depth, picture())
    assert [len(kernel.signatures) for kernel in kernels] == before


def test_mistakes_are_named():
    stage = Reconstruct()
    disparity = disparity_map(scene(HORIZONTAL), HORIZONTAL)
    with pytest.raises(ValueError, match=r"one shape, got disparity \(120, 160\), sigma \(3, 4\), status"):
        stage.depth(replace(disparity, sigma=np.ones((3, 4), np.float32)))
    depth = stage.depth(disparity)
    with pytest.raises(ValueError, match=r"left: expected \(120, 160, 3\) as the depth map, got \(10, 160, 3\)"):
        stage.cloud(depth, picture(10, 160))
    with pytest.raises(ValueError, match=r"left: expected"):
        stage.surface(depth, np.zeros((120, 160, 4), np.uint8))
    with pytest.raises(TypeError, match="left: expected a uint8 image, got float64"):
        stage.filtered_cloud(depth, picture().astype(float))
    with pytest.raises(ValueError, match="cloud_min_range, cloud_max_range: expected the first below the second"):
        ReconstructParams(cloud_min_range=3.0, cloud_max_range=2.0)
    with pytest.raises(ValueError, match="cloud_frame: expected one of optical, rectified, got 'map'"):
        ReconstructParams(cloud_frame="map")
