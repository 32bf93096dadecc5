"""What a model can be told."""

from __future__ import annotations

from dataclasses import dataclass

from uw_recon_ros.params import Params, param


@dataclass(frozen=True)
class DiveModelParams(Params):
    """How finely a dive is modelled, and what is left out."""

    voxel_m: float = param(
        0.0, "Side of a voxel; 0: one and a half pixels on the bottom, rounded up to 1, 2 or 5.", unit="m", low=0.0,
        high=10.0,
    )  # fmt: skip
    max_sigma_m: float = param(
        0.0, "Pixels less sure than this are left out; 0: three times the dive's median.", unit="m", low=0.0, high=10.0
    )
    truncation_m: float = param(
        0.0, "Reach of a depth before and behind it; 0: four voxels, at least three of the dive's median sigma.",
        unit="m", low=0.0, high=10.0,
    )  # fmt: skip
    cell_m: float = param(
        0.0, "Side of a cell of both maps; 0: a pixel on the bottom, rounded up to 1, 2 or 5.", unit="m", low=0.0,
        high=10.0,
    )  # fmt: skip
    most_cells: int = param(
        100_000_000, "Cells of a map at most; where they were more, cells are doubled.", low=100, high=1_000_000_000
    )
    tile_m: float = param(3.0, "Side of the tiles that are fused one after the other.", unit="m", low=0.01, high=1e4)
    min_views: int = param(1, "Views that have to see a piece of the surface.", low=1, high=100)
    island_faces: int = param(50, "Loose parts of fewer triangles are left out.", low=1, high=1_000_000)
    epsg: int = param(0, "EPSG code of the projected system that the poses are in; 0: a local one.", low=0, high=99999)
    poses_sigma_m: float = param(0.1, "How sure positions in --poses are.", unit="m", low=1e-4, high=1e3)
    poses_sigma_deg: float = param(2.0, "How sure attitudes in --poses are.", unit="deg", low=0.01, high=180.0)
    poses_offset_s: float = param(0.0, "Added to the stamps in --poses.", unit="s", low=-1e9, high=1e9)
