"""Coordinate systems of a model, and UTM from latitude and longitude."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from uw_recon_ros.types import Matrix

# WGS 84
_A, _F = 6_378_137.0, 1 / 298.257223563
_SCALE, _EAST = 0.9996, 500_000.0
#: Codes people give for latitude and longitude, or for coordinates about the Earth's centre: the common ones.
NOT_PROJECTED = frozenset((
    4152, 4167, 4171, 4190, 4202, 4203, 4230, 4258, 4267, 4269, 4277, 4283, 4289, 4312, 4313, 4314, 4322, 4326, 4490,
    4612, 4617, 4618, 4674, 4936, 4937, 4978, 4979, 6318, 6668, 7789, 7843, 7844, 9000, 9057, 9755,
))  # fmt: skip
_NORTH_UTM, _SOUTH_UTM = 32_600, 32_700  # EPSG codes of zone 0
_UTM_WKT = (
    'PROJCS["WGS 84 / UTM zone {zone}",'
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],'
    'AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433],AUTHORITY["EPSG","4326"]],'
    'PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",{meridian}],'
    'PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],PARAMETER["false_northing",{north}],'
    'UNIT["metre",1],AXIS["Easting",EAST],AXIS["Northing",NORTH],AUTHORITY["EPSG","{epsg}"]]'
)


@dataclass(frozen=True)
class Crs:
    """What the axes of a model are: x east, y north, z up, m.

    Parameters
    ----------
    epsg : int or None
        Of a projected system in metres; None: a local one, whose place on Earth is not known.
    name : str
        Of a local system.
    metric : bool
        Whether its unit is the metre; it is not known of a local system of a rig without a scale.
    """

    epsg: int | None = None
    name: str = "uw_recon_ros local"
    metric: bool = True

    @property
    def text(self) -> str:
        """For people and JSON: ``EPSG:32631`` or the name."""
        return self.name if self.epsg is None else f"EPSG:{self.epsg}"

    @property
    def is_utm(self) -> bool:
        """Whether it is a zone of UTM on WGS 84."""
        zone = (self.epsg or 0) % 100
        return 1 <= zone <= 60 and (self.epsg or 0) - zone in (_NORTH_UTM, _SOUTH_UTM)

    @property
    def wkt(self) -> str | None:
        """Well-known text, version 1, as LAS wants it, of a zone of UTM or a local system; None of any other."""
        if self.epsg is None:
            unit = "metre" if self.metric else "unknown"
            return f'LOCAL_CS["{self.name}",UNIT["{unit}",1],AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
        if not self.is_utm:
            return None
        zone, south = zone_of(self)
        return _UTM_WKT.format(
            zone=f"{zone}{'S' if south else 'N'}",
            meridian=6 * zone - 183,
            north=10_000_000 if south else 0,
            epsg=self.epsg,
        )


LOCAL = Crs()
#: Of a model whose scale is not known.
WITHOUT_SCALE = Crs(name="uw_recon_ros local, unit unknown", metric=False)


def zone_of(crs: Crs) -> tuple[int, bool]:
    """Number of a zone of UTM, and whether it is south of the equator.

    Raises
    ------
    ValueError
        No zone of UTM.
    """
    if not crs.is_utm:
        raise ValueError(f"crs: expected a zone of UTM on WGS 84, got {crs.text}")
    zone = (crs.epsg or 0) % 100
    return zone, (crs.epsg or 0) - zone == _SOUTH_UTM


def utm_zone(latitude: float, longitude: float) -> Crs:
    """The zone a place in degrees lies in, without the exceptions of Norway and Svalbard.

    Raises
    ------
    ValueError
        No such place, or one near a pole that UTM does not cover.
    """
    if not (-80 <= latitude <= 84 and -180 <= longitude <= 180):
        raise ValueError(
            f"latitude, longitude: expected -80 to 84 and -180 to 180 degrees, got {latitude}, {longitude}"
        )
    zone = min(int((longitude + 180) // 6) + 1, 60)
    return Crs((_NORTH_UTM if latitude >= 0 else _SOUTH_UTM) + zone)


def utm_from_geographic(latitude: Matrix, longitude: Matrix, crs: Crs) -> Matrix:
    """(N, 2) easting and northing, m, of latitudes and longitudes (N,) in degrees on WGS 84.

    Kruger's series to the fourth power of the third flattening (Karney 2011): exact to well below a millimetre.

    Parameters
    ----------
    latitude, longitude : (N,) float64
    crs : Crs
        From `utm_zone`, the same for a whole dive.

    Raises
    ------
    ValueError
        No zone of UTM.
    """
    zone, south = zone_of(crs)
    phi, away = np.radians(latitude), np.radians(np.asarray(longitude) - (6 * zone - 183))
    xi, eta = _gauss(phi, away)
    n = _F / (2 - _F)
    radius = _A / (1 + n) * (1 + n**2 / 4 + n**4 / 64 + n**6 / 256)
    x, y = eta.copy(), xi.copy()
    for k, a in enumerate(_kruger(n), 1):
        x += a * np.cos(2 * k * xi) * np.sinh(2 * k * eta)
        y += a * np.sin(2 * k * xi) * np.cosh(2 * k * eta)
    return np.stack([_EAST + _SCALE * radius * x, (10e6 if south else 0.0) + _SCALE * radius * y], axis=1)


def _gauss(phi: Matrix, away: Matrix) -> tuple[Matrix, Matrix]:
    """Spherical transverse Mercator of the conformal latitude."""
    e = math.sqrt(_F * (2 - _F))
    sine = np.sin(phi)
    t = np.sinh(np.arctanh(sine) - e * np.arctanh(e * sine))
    return np.arctan2(t, np.cos(away)), np.arcsinh(np.sin(away) / np.hypot(t, np.cos(away)))


def _kruger(n: float) -> list[float]:
    """Coefficients alpha of Kruger's series (Karney 2011, eq. 35), to n^4."""
    return [
        n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16 + 41 * n**4 / 180,
        13 * n**2 / 48 - 3 * n**3 / 5 + 557 * n**4 / 1440,
        61 * n**3 / 240 - 103 * n**4 / 140,
        49561 * n**4 / 161280,
    ]
