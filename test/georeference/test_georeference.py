"""Maps lie where they say, judged by GDAL and PROJ."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from uw_recon_ros.georeference.crs import LOCAL, Crs, utm_from_geographic, utm_zone, zone_of
from uw_recon_ros.georeference.geotiff import Placement, write_geotiff

UTM = Crs(32631)
PLACES = [(43.1, 5.2), (-33.9, 18.4), (0.001, -179.999), (70.0, 25.0), (83.9, 3.0), (-79.9, 179.9), (10.0, 6.0)]


@pytest.mark.parametrize("place", PLACES)
def test_utm_is_projs(place: tuple[float, float]) -> None:
    pyproj = pytest.importorskip("pyproj")
    crs = utm_zone(*place)
    expected = pyproj.Transformer.from_crs(4326, crs.epsg, always_xy=True).transform(place[1], place[0])
    found = utm_from_geographic(np.array([place[0]]), np.array([place[1]]), crs)[0]
    np.testing.assert_allclose(found, expected, atol=1e-5)


@pytest.mark.parametrize("crs", [UTM, Crs(32734), Crs(32601)])
def test_well_known_text_is_the_code_s(crs: Crs) -> None:
    pyproj = pytest.importorskip("pyproj")
    read = pyproj.CRS.from_wkt(crs.wkt)
    assert read.to_epsg() == crs.epsg
    told = pyproj.CRS.from_epsg(crs.epsg).to_cf()
    for key in ("longitude_of_central_meridian", "false_northing", "scale_factor_at_central_meridian"):
        assert read.to_cf()[key] == told[key]


def test_local_text_is_an_engineering_system() -> None:
    pyproj = pytest.importorskip("pyproj")
    assert pyproj.CRS.from_wkt(LOCAL.wkt).type_name == "Engineering CRS"


def test_what_is_no_zone_is_refused() -> None:
    with pytest.raises(ValueError, match="-80 to 84"):
        utm_zone(85.0, 0.0)
    assert Crs(25832).wkt is None
    with pytest.raises(ValueError, match="expected a zone of UTM"):
        utm_from_geographic(np.zeros(1), np.zeros(1), LOCAL)
    assert zone_of(Crs(32701)) == (1, True)


def map_of(rng: np.random.Generator, kind: str) -> np.ndarray:
    if kind == "colour":
        return rng.integers(0, 255, (300, 137, 4)).astype(np.uint8)
    heights = rng.normal(-20, 1, (300, 137)).astype(np.float32)
    heights[:40] = np.nan
    return heights


@pytest.mark.parametrize("kind", ["colour", "heights"])
@pytest.mark.parametrize("crs", [LOCAL, UTM])
def test_gdal_reads_what_was_written_where_it_lies(tmp_path: Path, kind: str, crs: Crs) -> None:
    rasterio = pytest.importorskip("rasterio")
    pytest.importorskip("tifffile")
    raster = map_of(np.random.default_rng(0), kind)
    place = Placement(500_000.125, 4_800_000.5, 0.005, crs)
    nodata = float("nan") if kind == "heights" else None
    write_geotiff(tmp_path / "map.tif", raster, place, nodata=nodata, alpha=kind == "colour")
    with rasterio.open(tmp_path / "map.tif") as read:
        assert read.xy(0, 0) == pytest.approx((500_000.1275, 4_800_000.4975), abs=1e-6)
        assert read.xy(299, 136) == pytest.approx((500_000.125 + 136.5 * 0.005, 4_800_000.5 - 299.5 * 0.005), abs=1e-6)
        assert read.res == pytest.approx((0.005, 0.005))
        pixels = np.moveaxis(read.read(), 0, -1)
        np.testing.assert_array_equal(pixels if kind == "colour" else pixels[..., 0], raster)
        assert read.crs is not None
        assert read.crs.to_epsg() == crs.epsg
        assert 'UNIT["metre",1' in read.crs.to_wkt()
        if kind == "heights":
            assert np.isnan(read.nodata)
            assert (read.read_masks(1) == 0).sum() == 40 * 137
        else:
            assert read.colorinterp[3] == rasterio.enums.ColorInterp.alpha
    assert [path.name for path in tmp_path.iterdir()] == ["map.tif"]


def test_a_failed_write_leaves_nothing(tmp_path: Path) -> None:
    pytest.importorskip("tifffile")

    class Broken(np.ndarray):
        def __getitem__(self, key: object) -> np.ndarray:
            raise OSError("gone")

    with pytest.raises(OSError, match="gone"):
        write_geotiff(tmp_path / "map.tif", np.zeros((10, 10), np.float32).view(Broken), Placement(0, 0, 1, LOCAL))
    assert not list(tmp_path.iterdir())


def test_the_same_map_is_the_same_bytes(tmp_path: Path) -> None:
    pytest.importorskip("tifffile")
    for name in "ab":
        write_geotiff(tmp_path / name, map_of(np.random.default_rng(0), "heights"), Placement(0, 0, 1, UTM))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
