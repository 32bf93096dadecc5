"""GeoTIFF as others read it: GDAL's library where it is installed, tifffile's tags always."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from uw_recon_ros.georeference.geotiff import Place, geotiff

CELLS = np.arange(12, dtype=np.float32).reshape(3, 4)
UTM = Place(500_000.5, 4_649_776.25, 0.01, 32633)


def tags(data: bytes) -> dict[int, Any]:
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        return {tag.code: tag.value for tag in file.pages[0].tags}  # type: ignore[union-attr]


def test_place_cell_nodata_and_system_stand_in_the_tags() -> None:
    found = tags(geotiff(CELLS, UTM, "nan"))
    assert found[33550] == (0.01, 0.01, 0.0)
    assert found[33922] == (0.0, 0.0, 0.0, 500_000.5, 4_649_776.25, 0.0)
    assert found[42113] == "nan"
    directory = np.array(found[34735]).reshape(-1, 4)
    assert directory[0, 3] == len(directory) - 1
    assert (np.diff(directory[1:, 0]) > 0).all()
    assert dict(directory[1:, [0, 3]].tolist())[3072] == 32633


def test_a_local_system_has_a_name_and_metres_only_where_it_is_metric() -> None:
    local = tags(geotiff(CELLS, Place(0.0, 0.0, 0.5)))
    assert "local engineering" in local[34737]
    assert 3076 in np.array(local[34735]).reshape(-1, 4)[:, 0]
    unscaled = tags(geotiff(CELLS, Place(0.0, 0.0, 0.5, local="baselines")))
    assert 3076 not in np.array(unscaled[34735]).reshape(-1, 4)[:, 0]


def test_the_same_raster_has_the_same_bytes() -> None:
    assert geotiff(CELLS, UTM) == geotiff(CELLS, UTM)


@pytest.mark.parametrize("place", [UTM, Place(-1.5, 2.25, 0.05)])
def test_gdal_finds_every_cell_where_it_is(tmp_path: Path, place: Place) -> None:
    rasterio = pytest.importorskip("rasterio", reason="checked by GDAL only where rasterio is installed")
    cells = CELLS.copy()
    cells[0, 0] = np.nan
    (tmp_path / "map.tif").write_bytes(geotiff(cells, place, "nan"))
    with rasterio.open(tmp_path / "map.tif") as raster:
        np.testing.assert_array_equal(raster.read(1), cells)
        assert np.isnan(raster.nodata)
        x, y = raster.xy(2, 3)
        assert x == pytest.approx(place.west + 3.5 * place.cell, abs=1e-6)
        assert y == pytest.approx(place.north - 2.5 * place.cell, abs=1e-6)
        assert raster.index(x, y) == (2, 3)
        if place.epsg:
            assert raster.crs.to_epsg() == place.epsg
        else:
            assert raster.crs.to_wkt().startswith(("LOCAL_CS", "ENGCRS"))


def test_gdal_takes_the_fourth_channel_for_alpha(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio", reason="checked by GDAL only where rasterio is installed")
    (tmp_path / "map.tif").write_bytes(geotiff(np.zeros((3, 4, 4), np.uint8), UTM))
    with rasterio.open(tmp_path / "map.tif") as raster:
        assert [c.name for c in raster.colorinterp] == ["red", "green", "blue", "alpha"]
