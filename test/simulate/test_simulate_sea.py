"""What can be switched on to make a simulated dive more like the sea."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from uw_recon_ros.simulate import Dive, SimulateParams
from uw_recon_ros.simulate.backdrop import surface_from_below
from uw_recon_ros.simulate.render import _caustic
from uw_recon_ros.simulate.rig import distort, undistort
from uw_recon_ros.simulate.water import make_water

SMALL = SimulateParams(
    width=120, height=90, frames=3, rate_hz=1.0, water="II", snow_per_m3=0.0, noise=0.0, daylight=1.0, scene="reef"
)
STILL, MOVING = (dataclasses.replace(SMALL, speed_m_s=speed) for speed in (0.0, 0.5))


def _left(params: SimulateParams, index: int = 1, **choice: object) -> np.ndarray:
    return Dive(dataclasses.replace(params, **choice)).frame(index).left.astype(int)  # type: ignore[arg-type]


def test_looking_up_shows_open_water_above_the_scene() -> None:
    depth = Dive(dataclasses.replace(SMALL, look_up_deg=35.0)).frame(0).depth
    assert np.isnan(depth[:20]).mean() > 0.9
    assert np.isfinite(depth[-20:]).mean() > 0.9


def test_caustics_take_and_give_the_same_light() -> None:
    """The mean over a wide floor is what it was; the picture is more uneven."""
    places = np.random.default_rng(0).uniform(-20, 20, (20_000, 2))
    light = np.array([_caustic(x, y, 3.0, 1.0) for x, y in places])
    assert light.mean() == pytest.approx(1.0, abs=0.03)
    assert light.min() >= 0
    assert _caustic(1.0, 2.0, 3.0, 0.0) == 1.0
    day = dataclasses.replace(SMALL, lamp=0.0)
    assert _left(day, caustics=0.8)[..., 1].std() > 1.5 * _left(day)[..., 1].std()


def test_a_dead_channel_is_0_and_the_others_are_as_they_were() -> None:
    whole, dead = _left(SMALL), _left(SMALL, dead_channel="red")
    assert not dead[..., 0].any()
    assert (dead[..., 1:] == whole[..., 1:]).all()


def test_a_letterbox_is_black_above_and_below() -> None:
    whole, boxed = _left(SMALL), _left(SMALL, letterbox_share=0.1)
    assert not boxed[:9].any()
    assert not boxed[-9:].any()
    assert (boxed[9:-9] == whole[9:-9]).all()


@pytest.mark.parametrize("choice", [{"surface_above": True, "water_depth_m": 2.0}, {"other_lamps": 3}])
def test_what_shines_in_open_water_is_seen_there_and_is_no_surface(choice: dict[str, object]) -> None:
    """Pixels of the bottom and the truth are what they were."""
    up = dataclasses.replace(SMALL, look_up_deg=35.0, lens_blur_px=0.0, water="clear", water_depth_m=2.0)
    without, shining = (Dive(dataclasses.replace(up, **options)) for options in ({}, choice))  # type: ignore[arg-type]
    shining._exposure = without._exposure
    before, after = without.frame(0), shining.frame(0)
    np.testing.assert_array_equal(before.depth, after.depth)
    brighter = (after.left.astype(int) - before.left)[..., 1] > 20
    assert brighter[np.isnan(before.depth)].sum() > 20
    if "surface_above" in choice:
        assert not brighter[np.isfinite(before.depth)].any()
    else:
        assert after.left.max() == 255


def test_the_sky_is_seen_within_snells_window_only() -> None:
    angles = np.radians([0.0, 30.0, 70.0, 85.0, 120.0])
    rays = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=-1)[None]
    light = surface_from_below(rays, np.zeros(3), 0.0, 5.0, make_water("clear"))[0, :, 0]
    assert (light[:2] > 1.4).all()
    assert (light[2:4] < 0.3).all()
    assert light[4] == 0


def test_a_wreck_stands_before_open_water() -> None:
    params = dataclasses.replace(SMALL, scene="wreck", pitch_deg=15.0, distance_m=1.5, look_up_deg=12.0)
    depth = Dive(params).frame(0).depth
    assert np.isnan(depth[:10]).mean() > 0.5
    assert np.isfinite(depth[45:, 40:80]).all()
    assert np.median(depth[45:60, 50:70]) == pytest.approx(2.1, abs=0.5)


def test_a_rolling_shutter_sees_its_last_rows_later() -> None:
    """The first rows are the truth's moment; nothing changes for a rig at rest."""
    whole, rolled = _left(MOVING), _left(MOVING, readout_ms=400.0)
    assert np.abs(rolled - whole)[:3].mean() < 0.5
    assert np.abs(rolled - whole)[-10:].mean() > 3
    depths = [Dive(dataclasses.replace(STILL, readout_ms=r)).frame(1).depth for r in (0.0, 400.0)]
    np.testing.assert_array_equal(*depths)


def test_a_long_exposure_smears_what_moves_only() -> None:
    def crispness(image: np.ndarray) -> float:
        return float(np.abs(np.diff(image, axis=1)).mean())

    assert crispness(_left(MOVING, exposure_ms=100.0)) < 0.6 * crispness(_left(MOVING))
    assert np.abs(_left(STILL, exposure_ms=100.0) - _left(STILL)).max() <= 1


def test_fish_swim_before_the_scene_and_truth_knows_them() -> None:
    bare, fishy = (Dive(dataclasses.replace(STILL, fish=n)) for n in (0, 8))
    empty, *swum = (d.frame(i).depth for d, i in ((bare, 0), (fishy, 0), (fishy, 1)))
    there = [np.nan_to_num(empty, nan=99.0) - np.nan_to_num(depth, nan=99.0) > 0.1 for depth in swum]
    assert 0.005 < there[0].mean() < 0.4
    assert (there[0] != there[1]).mean() > 0.005


def test_dirt_on_the_port_stays_where_it_is() -> None:
    """The same pixels in two pairs, others in the other camera."""
    clean, dirty = (Dive(dataclasses.replace(STILL, port_dirt=d)) for d in (0.0, 1.0))
    lost = [
        np.abs(getattr(dirty.frame(i), side).astype(int) - getattr(clean.frame(i), side)).max(axis=-1) > 12
        for i, side in ((0, "left"), (1, "left"), (0, "right"))
    ]
    assert 0.01 < lost[0].mean() < 0.5
    assert (lost[0] != lost[1]).mean() < 0.1 * lost[0].mean() + 0.002
    assert (lost[0] & lost[2]).sum() < 0.7 * lost[0].sum()


@pytest.mark.parametrize("k1", [-0.3, 0.35, 0.7])
def test_strong_distortion_is_undone(k1: float) -> None:
    points = np.stack(np.meshgrid(np.linspace(-0.6, 0.6, 13), np.linspace(-0.45, 0.45, 9)), axis=-1)
    d = np.array([k1, 0.3 * k1 * k1, 0.004, -0.003, 0.0])
    np.testing.assert_allclose(undistort(distort(points, d), d), points, atol=1e-9)


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="dead_channel: expected none with mono"):
        SimulateParams.from_mapping({"mono": True, "dead_channel": "red"})
