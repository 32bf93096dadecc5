"""How two frames lie to each other: right within its own sigma, refused where it is not known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helpers.track_scenes import GEOMETRY, bottom, descriptors, motion, seen

from uw_recon_ros import rigid
from uw_recon_ros.track.bridge import bridge, make_relief
from uw_recon_ros.track.keypoints import Keypoints, RigError, find_keypoints, packed, points_of, thinned
from uw_recon_ros.track.params import TrackParams
from uw_recon_ros.track.relate import KeyPointMatches, linearise, projected, relate, repeats_itself, rig_slopes, rival
from uw_recon_ros.types import Matrix

PARAMS = TrackParams()
STEP = motion(0.02, -0.15, 0.01, 0.02, -0.01, 0.05)


def two(seed: int, step: Matrix = STEP) -> tuple[Keypoints, Keypoints]:
    rng = np.random.default_rng(seed)
    points, names = bottom(rng), descriptors(rng, 600)
    return seen(points, np.eye(4), names, rng), seen(points, step, names, rng)


def test_rigid_motions_and_their_logarithms() -> None:
    rng = np.random.default_rng(0)
    twists = rng.standard_normal((50, 6)) * ([1] * 3 + [0.7] * 3)
    assert rigid.log(rigid.exp(twists)) == pytest.approx(twists, abs=1e-12)
    a, x = rigid.exp(twists), rng.standard_normal((50, 6)) * 0.1
    moved = a @ rigid.exp(x) @ rigid.inverse(a)
    assert rigid.exp((rigid.adjoint(a) @ x[..., None])[..., 0]) == pytest.approx(moved, abs=1e-12)
    assert rigid.exp(np.zeros((1, 6)))[0] == pytest.approx(np.eye(4))


@pytest.mark.parametrize("vertical", [False, True])
def test_projection_is_the_inverse_of_points(vertical: bool) -> None:
    geometry = dataclasses.replace(GEOMETRY, axis="vertical", focal_across_px=480.0) if vertical else GEOMETRY
    points = bottom(np.random.default_rng(1))
    for error in (RigError(), RigError(0.4, -0.01)):
        assert points_of(projected(points, geometry, error), geometry, error) == pytest.approx(points)


def test_the_error_is_as_large_as_the_covariance_says() -> None:
    squares, chi2 = [], []
    for seed in range(40):
        found = relate(*two(seed), GEOMETRY, PARAMS)
        assert found is not None
        missed = rigid.log(rigid.inverse(found.motion) @ STEP)
        squares.append(missed @ np.linalg.solve(found.covariance, missed) / 6)
        chi2.append(found.chi2)
    assert 1 / 4.5 < np.mean(squares) < 1.3, "the shared errors of a real matcher, 2.5 in variance, are absent here"
    assert np.mean(chi2) == pytest.approx(1.0, abs=0.12)


def test_packed_key_points_relate_as_the_whole_ones_and_take_a_quarter() -> None:
    first, second = two(5)
    small = packed(first, 400), packed(second, 400)
    whole = relate(first, second, GEOMETRY, PARAMS)
    found = relate(small[0].unpacked(), small[1].unpacked(), GEOMETRY, PARAMS)
    assert whole is not None
    assert found is not None
    assert found.inliers > 0.9 * min(400 / len(first), 1) * whole.inliers
    assert rigid.log(rigid.inverse(found.motion) @ whole.motion) == pytest.approx(np.zeros(6), abs=0.004)
    size = sum(getattr(small[0], name).nbytes for name in ("measured", "sigma", "descriptors"))
    assert size == 400 * (128 + 16)


def test_wrong_matches_do_not_matter_and_too_few_are_refused() -> None:
    first, second = two(3)
    mixed = dataclasses.replace(second, measured=second.measured.copy())
    mixed.measured[::2, :2] = np.random.default_rng(1).uniform(0, 600, (300, 2))
    found = relate(first, mixed, GEOMETRY, PARAMS)
    assert found is not None
    assert np.abs(rigid.log(rigid.inverse(found.motion) @ STEP)[:3]).max() < 0.003
    nothing = dataclasses.replace(second, measured=np.random.default_rng(2).uniform(10, 400, (600, 3)))
    assert relate(first, nothing, GEOMETRY, PARAMS) is None
    empty = Keypoints(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 128), np.float32))
    assert relate(first, empty, GEOMETRY, PARAMS) is None


def test_the_relation_does_not_care_which_frame_is_first() -> None:
    first, second = two(4)
    there, back = relate(first, second, GEOMETRY, PARAMS), relate(second, first, GEOMETRY, PARAMS)
    assert there is not None
    assert back is not None
    closed = rigid.log(there.motion @ back.motion)
    assert np.abs(closed).max() < 1e-3


def test_derivatives_are_those_of_differences() -> None:
    rng = np.random.default_rng(7)
    points = bottom(rng, 5)
    there = rigid.inverse(STEP)
    a = projected(points, GEOMETRY, RigError())
    b = projected(points @ there[:3, :3].T + there[:3, 3], GEOMETRY, RigError()) + rng.normal(size=(5, 3))
    matches = KeyPointMatches(a, b, np.full(5, 1e6), np.full(5, 0.1))  # so that whitening hardly depends on the motion

    matches = KeyPointMatches(a, b, np.full(5, 0.1), np.full(5, 0.1))
    white = linearise(there, matches, GEOMETRY, RigError(), 1e-9 + 0.35)
    rows = np.linalg.inv(np.linalg.cholesky(_covariances(there, matches)))
    e = 1e-6
    for k in range(6):
        twist = np.zeros(6)
        twist[k] = e
        changed = rigid.exp(twist) @ there
        before = projected(points @ there[:3, :3].T + there[:3, 3], GEOMETRY, RigError())
        after = projected(points @ changed[:3, :3].T + changed[:3, 3], GEOMETRY, RigError())
        expected = (rows @ ((after - before) / e)[..., None])[..., 0]
        assert white.slopes[..., k] == pytest.approx(expected, rel=1e-3, abs=1e-2)
    for k, error in enumerate((RigError(e, 0.0), RigError(0.0, e))):
        values = []
        for rig in (RigError(), error):
            world = points_of(a, GEOMETRY, rig) @ there[:3, :3].T + there[:3, 3]
            values.append(projected(world, GEOMETRY, rig))
        expected = (rows @ ((values[1] - values[0]) / e)[..., None])[..., 0]
        found = white.white @ rig_slopes(there, matches, GEOMETRY, RigError())
        assert found[..., k] == pytest.approx(expected, rel=1e-3, abs=1e-2)


def _covariances(there: Matrix, matches: KeyPointMatches) -> Matrix:
    """By differences: what u, v, d of the first do to u, v, d of the second."""
    variances = np.array([0.35**2, 0.35**2, 0.1**2])
    found = np.tile(np.diag(variances), (len(matches.first), 1, 1))
    for k in range(3):
        moved = matches.first.copy()
        moved[:, k] += 1e-5
        views = [
            projected(points_of(m, GEOMETRY) @ there[:3, :3].T + there[:3, 3], GEOMETRY, RigError())
            for m in (matches.first, moved)
        ]
        slope = (views[1] - views[0]) / 1e-5
        found += variances[k] * slope[:, :, None] * slope[:, None, :]
    return found


def test_a_floor_of_equal_tiles_has_a_rival_and_a_bottom_has_none() -> None:
    rng = np.random.default_rng(5)
    tile = np.column_stack([rng.uniform(0, 0.25, (25, 2)), np.full(25, 1.25)])
    shifts = [(0.25 * x, 0.25 * y, 0) for x in range(-3, 3) for y in range(-3, 3)]
    points = np.concatenate([tile + np.array(shift) for shift in shifts])
    names = np.tile(descriptors(rng, 25), (len(shifts), 1))
    noise = 0.002 * rng.standard_normal((2, *names.shape)).astype(np.float32)
    first = seen(points, np.eye(4), names + noise[0], rng)
    second = seen(points, motion(0, 0.15, 0, 0, 0, 0), names + noise[1], rng)
    free = TrackParams(match_ratio=1.0)
    found = relate(first, second, GEOMETRY, free)
    if found is not None:  # then somebody has to notice
        assert rival(first, second, GEOMETRY, free, found)[0] >= free.rival_share * found.inliers
    clear = relate(*two(6), GEOMETRY, PARAMS)
    assert clear is not None
    assert rival(*two(6), GEOMETRY, PARAMS, clear)[0] < 0.1 * clear.inliers


def test_a_guess_tells_tiles_apart() -> None:
    rng = np.random.default_rng(5)
    tile = np.column_stack([rng.uniform(0, 0.25, (25, 2)), np.full(25, 1.25)])
    shifts = [(0.25 * x, 0.25 * y, 0) for x in range(-3, 3) for y in range(-3, 3)]
    points = np.concatenate([tile + np.array(shift) for shift in shifts])
    names = np.tile(descriptors(rng, 25), (len(shifts), 1))
    step = motion(0, 0.15, 0, 0, 0, 0)
    first, second = seen(points, np.eye(4), names, rng), seen(points, step, names, rng)
    near = TrackParams(search_px=40.0)
    found = relate(first, second, GEOMETRY, near, guess=motion(0.02, 0.13, 0, 0, 0, 0.01))
    assert found is not None
    assert np.abs(rigid.log(rigid.inverse(found.motion) @ step)[:3]).max() < 0.003


def surface_disparity(pose: Matrix, flat: bool) -> np.ndarray:
    """Disparity of a bumpy bottom z(x, y), by fixed-point iteration along each ray."""
    v, u = np.mgrid[:240, :320].astype(float)
    rays = np.stack([(u - 160) / 250, (v - 120) / 250, np.ones_like(u)], axis=-1) @ pose[:3, :3].T
    depth = np.full(u.shape, 1.25)
    for _ in range(60):
        p = pose[:3, 3] + depth[..., None] * rays
        z = 1.25 + (0 if flat else 0.08 * np.sin(7 * p[..., 0]) * np.cos(5 * p[..., 1]) + 0.05 * np.sin(9 * p[..., 1]))
        depth += 0.7 * (z - p[..., 2])
    return (250 * 0.12 / depth).astype(np.float32)


def test_shape_bridges_what_features_lost_and_refuses_a_flat_bottom() -> None:
    geometry = dataclasses.replace(GEOMETRY, focal_px=250.0, cx_left=160.0, cx_right=160.0, cy=120.0)
    step = motion(0.03, 0.12, -0.01, 0.01, -0.02, 0.03)
    guess = motion(0.02, 0.10, 0, 0, 0, 0)
    for flat in (False, True):
        reliefs = []
        for k, pose in enumerate((np.eye(4), step)):
            noise = 0.05 * np.random.default_rng(k).standard_normal((240, 320)).astype(np.float32)
            reliefs.append(make_relief(surface_disparity(pose, flat) + noise, np.full((240, 320), 0.05, np.float32),
                                       geometry))  # fmt: skip
        found = bridge(reliefs[0], reliefs[1], geometry, guess, known_m=0.02)
        if flat:
            assert found is None, "nothing tells the way along a plane"
        else:
            assert found is not None
            missed = rigid.log(rigid.inverse(found.motion) @ step)
            assert np.abs(missed[:3]).max() < 0.006
            assert missed @ np.linalg.solve(found.covariance, missed) / 6 < 4


def test_keypoints_take_their_disparity_and_leave_holes_out() -> None:
    rng = np.random.default_rng(0)
    picture = np.kron(rng.integers(0, 255, (24, 32)), np.ones((8, 8))).astype(np.uint8)
    v, u = np.mgrid[:192, :256]
    disparity = (20 + 0.02 * u + 0.01 * v).astype(np.float32)
    disparity[:, 100:140] = np.nan
    found = find_keypoints(picture, disparity, np.full_like(disparity, 0.1), PARAMS)
    assert len(found) > 100
    x, y, d = found.measured.T
    assert d == pytest.approx(20 + 0.02 * x + 0.01 * y, abs=0.02)
    assert not ((x > 101) & (x < 138)).any()
    assert np.linalg.norm(found.descriptors, axis=1) == pytest.approx(1.0, abs=1e-3)
    dull = np.full((192, 256, 3), 90, np.uint8)
    assert len(find_keypoints(dull, disparity, np.full_like(disparity, 0.1), PARAMS)) == 0


def test_a_floor_whose_places_look_alike_is_told_from_one_whose_do_not() -> None:
    rng = np.random.default_rng(11)
    points, names = bottom(rng, 300), descriptors(rng, 300)
    assert not repeats_itself(seen(points, motion(0, 0, 0, 0, 0, 0), names, rng))
    tiled = np.tile(names[:30], (10, 1))
    assert repeats_itself(seen(points, motion(0, 0, 0, 0, 0, 0), tiled, rng))
    assert not repeats_itself(thinned(seen(points, motion(0, 0, 0, 0, 0, 0), names, rng), 0))
