"""What can be chosen about the way from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass

from uw_recon_ros.params import Params, param


@dataclass(frozen=True)
class TrackParams(Params):
    """Key points and relations."""

    keypoints: int = param(1500, "Key points a frame.", low=50, high=20_000)
    clahe_clip: float = param(3.0, "Limit of the contrast that is equalised before key points are sought.", low=0.0,
                              high=40.0)  # fmt: skip
    match_ratio: float = param(0.85, "Distance of the best match over that of the second.", low=0.1, high=1.0)
    keypoint_sigma_px: float = param(0.35, "Standard deviation of a key point's place.", unit="px", low=0.01, high=10.0)
    track_inliers: int = param(15, "Matches that make a relation of neighbours.", low=6, high=1000)
    search_px: float = param(60.0, "How far from its predicted place a key point is sought first.", unit="px", low=5.0,
                             high=2000.0)  # fmt: skip
    rival_share: float = param(0.15, "Inliers of another relation, relative to the best, from which it is ambiguous.",
                               low=0.05, high=1.0)  # fmt: skip


@dataclass(frozen=True)
class OdometryParams(Params):
    """The way from frame to frame while the dive goes on. Defaults: ``test/benchmark/odometry_features.py``."""

    odometry_corners: int = param(300, "Corners followed from frame to frame.", low=30, high=5000)
    odometry_window_px: int = param(21, "Side of the patch about a corner.", unit="px", low=7, high=101)
    odometry_clahe_clip: float = param(
        3.0, "Limit of the contrast that is equalised before corners are sought; 0 = not at all.", low=0.0, high=40.0
    )
    odometry_inliers: int = param(20, "Corners that have to agree on a motion.", low=6, high=1000)
    odometry_max_speed_m_s: float = param(
        1.0, "What the vehicle can do: on a bottom that repeats itself, a motion is believed where the next that would "
        "fit is faster.", unit="m/s", low=0.01, high=20.0,
    )  # fmt: skip
    odometry_lost_s: float = param(
        2.0, "Time without a motion after which the way goes on from where it was lost, less sure.", unit="s", low=0.1,
        high=600.0,
    )  # fmt: skip
