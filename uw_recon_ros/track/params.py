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
