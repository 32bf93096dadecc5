"""Light in water: the formulas, on scenes where every number is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from uw_recon_ros.simulate.image_sensor import expose, exposure_of, to_light
from uw_recon_ros.simulate.lamp import glow_at, glow_table, lamp_glow, lamp_in_rig, lamp_in_world
from uw_recon_ros.simulate.render import lamp_irradiance
from uw_recon_ros.simulate.rig import Pose, rotation_about
from uw_recon_ros.simulate.water import DOWNWELLING, Water, attenuate, daylight_veil, forward_scatter, make_water

MURKY = Water(np.array([0.9, 0.5, 0.3]), np.array([1.1, 0.6, 0.4]), np.ones(3), np.array([0.05, 0.2, 0.3]), 0.0)


def even(value: float, shape: tuple[int, ...] = (20, 30)) -> np.ndarray:
    return np.full(shape, value, np.float32)


@pytest.mark.parametrize("z", [0.0, 0.5, 2.0, 7.0])
def test_image_formation_on_an_even_scene(z: float) -> None:
    """I = J exp(-c z) + B (1 - exp(-b z))."""
    radiance = np.broadcast_to(np.float32([0.8, 0.6, 0.4]), (20, 30, 3))
    image = attenuate(radiance, even(z), MURKY) + daylight_veil(even(z), MURKY, 0.5)
    expected = np.array([0.8, 0.6, 0.4]) * np.exp(-MURKY.attenuation * z)
    expected += 0.5 * MURKY.veil * (1 - np.exp(-MURKY.backscatter * z))
    assert image == pytest.approx(np.broadcast_to(expected, image.shape), rel=2e-6, abs=1e-7)


def test_endless_water_is_the_veil_alone() -> None:
    for nothing in (np.inf, np.nan):
        assert not attenuate(np.ones((2, 2, 3), np.float32), even(nothing, (2, 2)), MURKY).any()
        assert daylight_veil(even(nothing, (2, 2)), MURKY, 1.0)[0, 0] == pytest.approx(MURKY.veil)


def test_clear_water_changes_nothing() -> None:
    clear = make_water("clear")
    image = np.random.default_rng(1).random((8, 9, 3), dtype=np.float32)
    assert np.array_equal(attenuate(image, even(9.0, (8, 9)), clear), image)
    assert not daylight_veil(even(np.inf, (8, 9)), clear, 1.0).any()
    assert forward_scatter(image, even(9.0, (8, 9)), clear) is image


def test_jerlov_types() -> None:
    for name, kd in DOWNWELLING.items():
        water = make_water(name, water_depth_m=3.0)
        assert water.daylight == pytest.approx(np.exp(-3.0 * np.array(kd)))
        assert (water.attenuation >= kd).all(), "the beam loses more than the daylight"
        assert (water.attenuation > 0).all() == (name != "clear")
    ocean, harbour = make_water("I"), make_water("9C")
    assert ocean.attenuation[0] > ocean.attenuation[1] > ocean.attenuation[2], "red goes first in the open sea"
    assert harbour.attenuation[2] > harbour.attenuation[1] > harbour.attenuation[0], "blue first in a harbour"
    assert make_water("3C", turbidity=2.0).attenuation == pytest.approx(2.0 * make_water("3C").attenuation)
    with pytest.raises(ValueError, match=r"water: expected one of clear, I, .*, got '4C'"):
        make_water("4C")


@pytest.mark.parametrize("z", [1.0, 2.0, 3.3, 6.0])
def test_forward_scatter_is_a_blur_that_grows_with_range(z: float) -> None:
    water = Water(MURKY.attenuation, MURKY.backscatter, MURKY.daylight, MURKY.veil, 0.5)
    point = np.zeros((81, 81, 3), np.float32)
    point[40, 40] = 1.0
    spread = forward_scatter(point, even(z, (81, 81)), water)[..., 1].astype(np.float64)
    offsets = np.arange(81) - 40
    assert spread.sum() == pytest.approx(1.0, rel=1e-4)
    assert np.sqrt((spread.sum(axis=0) * offsets**2).sum()) == pytest.approx(0.5 * z, rel=0.1)
    assert forward_scatter(even(0.7, (9, 9, 3)), even(z, (9, 9)), water) == pytest.approx(0.7, rel=1e-5)


def test_forward_scatter_leaves_the_near_sharp() -> None:
    water = Water(MURKY.attenuation, MURKY.backscatter, MURKY.daylight, MURKY.veil, 0.5)
    stripes = np.zeros((40, 80, 3), np.float32)
    stripes[:, ::2] = 1.0
    ranges = np.full((40, 80), 0.0, np.float32)
    ranges[:, 40:] = 6.0
    blurred = forward_scatter(stripes, ranges, water)[20, :, 0]
    assert np.ptp(blurred[10:30]) == pytest.approx(1.0)
    assert np.ptp(blurred[50:70]) < 0.01


def lamp(power: float = 2.0) -> np.ndarray:
    return lamp_in_rig(power, MURKY)


def test_lamp_falls_with_the_square_and_the_water() -> None:
    light = lamp()
    place, aim = light[:3], light[3:6]
    for r in (0.5, 1.0, 2.0):
        for channel in range(3):
            expected = 2.0 * np.exp(-MURKY.attenuation[channel] * r) / r**2
            assert lamp_irradiance(light, channel, *(place + r * aim)) == pytest.approx(expected)
    assert lamp_irradiance(light, 1, *(place - aim)) == 0.0


def test_lamp_is_uneven() -> None:
    light = lamp()
    aside = np.cross(light[3:6], [0.0, 1.0, 0.0])
    on_rim = light[:3] + light[7] * light[3:6] + np.sqrt(1 - light[7] ** 2) * aside / np.linalg.norm(aside)
    share = lamp_irradiance(light, 0, *on_rim) / lamp_irradiance(light, 0, *(light[:3] + light[3:6]))
    assert share == pytest.approx(np.exp(-1.0))


def test_lamp_moves_with_the_rig() -> None:
    pose = Pose(rotation_about(np.array([0.3, -0.2, 0.1])), np.array([1.0, 2.0, 3.0]))
    point = np.array([0.2, 0.1, 1.4])
    in_rig, in_world = lamp(), lamp_in_world(lamp(), pose)
    there = pose.rotation @ point + pose.position
    assert lamp_irradiance(in_world, 2, *there) == pytest.approx(lamp_irradiance(in_rig, 2, *point))


def test_lamps_glow_is_the_integral_along_the_ray() -> None:
    """Single scattering: cone exp(-c r) / r^2 exp(-c s) summed over s."""
    rays = np.zeros((33, 49, 3))
    rays[..., 0] = np.linspace(-0.05, 0.10, 49)
    rays[..., 1] = np.linspace(-0.08, 0.08, 33)[:, None]
    rays[..., 2] = 1.0
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    view = np.array([0.1, 0.02, 0.0])
    table = glow_table(lamp(), MURKY, view, rays)
    for u, reach in ((0, 0.8), (21, 1.5), (37, 3.0), (48, 7.0)):
        glow = lamp_glow(table, np.full((33, 49), reach))
        for channel in range(3):
            expected = quad(
                lambda s, u=u, channel=channel: lamp_irradiance(lamp(), channel, *(view + s * rays[23, u]))
                * np.exp(-MURKY.attenuation[channel] * s),
                0.0, reach, limit=200,
            )[0]  # fmt: skip
            expected *= 0.035 * MURKY.attenuation.mean()
            assert glow[23, u, channel] == pytest.approx(expected, rel=0.01)
    single = glow_at(table, np.array([[16.0, 16.0]]), np.array([1.5]))
    assert single[0] == pytest.approx(lamp_glow(table, np.full((33, 49), 1.5))[16, 16], rel=0.1)


def test_no_lamp_no_glow() -> None:
    assert not glow_table(lamp(0.0), MURKY, np.zeros(3), np.ones((20, 20, 3))).any()


def test_sensor_noise_is_shot_and_read_noise() -> None:
    light = np.full((200, 200, 3), 0.3, np.float32)
    taken = expose(light, 1.0, np.random.default_rng(1), bits=16)
    linear = to_light(taken)
    assert linear.mean() == pytest.approx(0.3, rel=1e-3)
    assert linear.std() == pytest.approx(np.sqrt(0.3 / 5000 + 0.002**2), rel=0.02)
    quiet = expose(light, 1.0, np.random.default_rng(1), noise=0.0, bits=16)
    assert np.ptp(quiet) == 0
    assert to_light(expose(light, 1.0, np.random.default_rng(1), noise=2.0, bits=16)).std() == pytest.approx(
        2 * linear.std(), rel=0.03
    )


@pytest.mark.parametrize(("bits", "dtype"), [(8, np.uint8), (16, np.uint16)])
@pytest.mark.parametrize("mono", [False, True])
def test_sensor_formats(bits: int, dtype: type, mono: bool) -> None:
    light = np.zeros((4, 5, 3), np.float32)
    light[0] = 1.0
    light[1] = 5.0
    light[2] = 0.5
    taken = expose(light, 1.0, np.random.default_rng(1), noise=0.0, bits=bits, mono=mono)
    full = np.iinfo(dtype).max
    assert taken.dtype == dtype
    assert taken.shape == ((4, 5) if mono else (4, 5, 3))
    assert (taken[0] == full).all()
    assert (taken[1] == full).all()
    assert taken[2] == pytest.approx(full * 0.5 ** (1 / 2.2), abs=0.51)
    assert (taken[3] == 0).all()


def test_exposure_puts_the_brightest_twentieth_below_white() -> None:
    light = np.random.default_rng(1).random((100, 100, 3), dtype=np.float32) * 7
    gained = light.max(axis=-1) * exposure_of(light)
    assert (gained > 0.62).mean() == pytest.approx(0.05, abs=0.002)
    assert exposure_of(np.zeros((4, 4, 3), np.float32)) == 1.0
