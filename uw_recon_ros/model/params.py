"""What a model can be told."""

from __future__ import annotations

from dataclasses import dataclass

from uw_recon_ros.params import Params, param


@dataclass(frozen=True)
class DiveModelParams(Params):
    """How finely a dive is modelled, and what is left out."""

    voxel_m: float = param(
        0.0, "Side of a voxel; 0: two pixels on the bottom, rounded up to 1, 2 or 5.", unit="m", low=0.0, high=10.0
    )
    max_sigma_m: float = param(
        0.0,
        "Pixels whose depth has a larger standard deviation are left out; 0: 1.2 voxels, at least twice the "
        "dive's median.",
        unit="m",
        low=0.0,
        high=10.0,
    )
    truncation_sigmas: float = param(
        3.0, "Truncation distance of the signed distances, at least three, at most eight voxels.", low=1.0, high=10.0,
        unit="sigma of the depth",
    )  # fmt: skip
    min_views: int = param(
        2, "Views that have to see a piece of the surface; 1 keeps the rims that one view alone shows.", low=1, high=100
    )
    island_faces: int = param(200, "Loose parts of fewer triangles are left out.", low=1, high=1_000_000)
    cells_a_voxel: int = param(2, "Cells of the orthomosaic along a voxel's side.", low=1, high=4)
    most_cells: int = param(
        200_000_000, "Cells of the orthomosaic at most; where they were more, they are larger.", low=100,
        high=4_000_000_000,
    )  # fmt: skip
    terrain: str = param(
        "no", "Whether area, slope and rugosity of each cell are written as well.", choices=("no", "yes")
    )
    rugosity_window: int = param(51, "Side of the window that rugosity is of.", unit="voxels", low=3, high=2001)
    mesh_share: float = param(0.1, "Share of the triangles that simplification leaves.", low=0.001, high=1.0)
    mesh_faces: int = param(400_000, "Triangles that it leaves at most.", low=100, high=10_000_000)
    texture_faces: int = param(15_000, "Triangles of the textured mesh at most.", low=100, high=2_000_000)
    texture_px: int = param(4096, "Side of its texture at most.", unit="px", low=64, high=16_384)
    cloud_format: str = param(
        "ply", "Of the cloud: ply holds the mesh's vertices, laz all before simplification.", choices=("ply", "laz")
    )
    tiles: str = param(
        "auto", "3D Tiles: where the dive covers more than four tiles, always, or never.",
        choices=("auto", "always", "never"),
    )  # fmt: skip
    jobs: int = param(1, "Tiles worked on at the same time; what comes out does not depend on it.", low=1, high=256)
    epsg: int = param(0, "EPSG code of the projected system that the poses are in; 0: a local one.", low=0, high=32766)
    poses_sigma_m: float = param(0.1, "Standard deviation of the positions in --poses.", unit="m", low=1e-4, high=1e3)
    poses_sigma_deg: float = param(
        2.0, "Standard deviation of the attitudes in --poses.", unit="deg", low=0.01, high=180.0
    )
    poses_offset_s: float = param(0.0, "Added to the stamps in --poses.", unit="s", low=-1e9, high=1e9)
