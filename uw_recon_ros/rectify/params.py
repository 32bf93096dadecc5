"""What of rectification can be set."""

from __future__ import annotations

from dataclasses import dataclass

from uw_recon_ros.params import Params, param


@dataclass(frozen=True)
class RectifyParams(Params):
    """Parameters of tie points, rectification and the watch over a rig."""

    calibration_use: str = param(
        "auto",
        "Use the CameraInfo of the pair where it describes a stereo rig, require it, or ignore it.",
        choices=("auto", "require", "ignore"),
    )
    images_rectified: str = param(
        "auto",
        "Whether the images come rectified, so that P alone describes them; auto: by the name of their topic "
        "(image_rect, image_rect_color, ...), and no for files.",
        choices=("auto", "yes", "no"),
    )
    medium: str = param(
        "unknown",
        "What the calibration was made in: the medium it is used in (as_used), air for a dive in water (air: no metres "
        "are given out), or not known: where the rows say air, metres are withheld.",
        choices=("unknown", "as_used", "air"),
    )
    rig_axis: str = param(
        "auto",
        "How the cameras of an uncalibrated rig stand: side by side, one above the other, or found from the images.",
        choices=("auto", "horizontal", "vertical"),
    )
    baseline_m: float = param(
        0.0,
        "Distance between the cameras of an uncalibrated rig, 0 = unknown; metres need focal_px as well.",
        unit="m",
        low=0.0,
        high=100.0,
    )
    focal_px: float = param(
        0.0,
        "In-water focal length of an uncalibrated rig's cameras, 0 = unknown and estimated.",
        unit="px",
        low=0.0,
        high=100_000.0,
    )
    port: str = param(
        "none",
        "What stands before cameras that were calibrated in air; calibrated in water behind their ports: none.",
        choices=("none", "flat"),
    )
    port_distance_mm: float = param(
        10.0, "From a lens's centre of projection to the inner face of its flat port.", unit="mm", low=0.0, high=1000.0
    )
    port_thickness_mm: float = param(6.0, "Of the flat port.", unit="mm", low=0.0, high=200.0)
    port_index: float = param(1.49, "Refractive index of the port: acrylic 1.49, glass 1.52.", low=1.0, high=2.5)
    water_index: float = param(1.333, "Refractive index of the water: fresh 1.333, sea 1.342.", low=1.0, high=1.5)
    port_range_m: float = param(
        1.0, "Depth at which rectification behind a flat port is exact.", unit="m", low=0.05, high=100.0
    )
    rectify_crop: bool = param(True, "Crop to what both rectified views show; else keep the size and mark the windows.")
    rectify_min_area: float = param(
        0.2, "Smallest share of the image that may remain after rectification.", low=0.01, high=1.0
    )
    rectify_interpolation: str = param(
        "cubic", "How the warp reads between pixels.", choices=("linear", "cubic", "lanczos")
    )
    image_frame: str = param(
        "optical",
        "Frame in the headers of rectified images, disparity, depth: the left camera's own, or that with _rectified.",
        choices=("optical", "rectified"),
    )
    rectify_seed: int = param(0, "Seed of everything random in rectification.", low=0, high=2**31 - 1)
    tie_image_side: int = param(
        1280, "Longer side to which larger images are reduced for finding tie points.", unit="px", low=160, high=8192
    )
    tie_contrast: float = param(0.02, "Contrast threshold of SIFT: lower finds more in haze.", low=0.001, high=0.2)
    tie_features: int = param(
        6000, "Features kept a camera, the strongest of each part of the image.", low=100, high=20_000
    )
    tie_ratio: float = param(
        0.85, "Largest ratio of the best to the second best descriptor distance.", low=0.5, high=0.99
    )
    tie_threshold_px: float = param(
        1.0, "Distance from the epipolar line at which a match becomes an outlier.", unit="px", low=0.1, high=10.0
    )
    tie_points_min: int = param(25, "Fewest tie points from which a rectification is estimated.", low=12, high=10_000)
    tie_points_max: int = param(2000, "Most tie points an estimate uses, spread over the image.", low=50, high=20_000)
    tie_held_out: float = param(
        0.25, "Share of the tie points held out of the fit, to measure the epipolar error.", low=0.05, high=0.5
    )
    rig_prior_weight: float = param(
        1.0,
        "How much parallel cameras of ordinary focal length are preferred where tie points leave it open; 0 = not.",
        low=0.0,
        high=100.0,
    )
    given_limit_px: float = param(
        0.5,
        "Median vertical (epipolar) error up to which uncalibrated images may count as rectified already; "
        "0 = always rectify.",
        unit="px",
        low=0.0,
        high=5.0,
    )
    row_error_limit_permille: float = param(
        2.5,
        "Largest 95th percentile of an estimate's vertical (epipolar) error, in thousandths of the diagonal "
        "(2 px at 640x480); above, "
        "above 2 px and above what the tie points' noise explains, it is refused.",
        low=0.05,
        high=100.0,
    )
    shape_limit_percent: float = param(
        40.0,
        "Uncertainty of an uncalibrated shape's relative depths over which it is called projective.",
        unit="percent",
        low=1.0,
        high=1000.0,
    )
    row_unreliable_permille: float = param(
        0.4,
        "Median vertical (epipolar) error of a calibrated pair, in thousandths of the image's diagonal, over which "
        "it is marked "
        "unreliable (0.32 px at 640x480); never less than row_unreliable_noise allows.",
        low=0.05,
        high=20.0,
    )
    row_unreliable_noise: float = param(
        3.0,
        "The same limit as a multiple of the tie points' own noise, so that noisy tie points do not accuse the rig.",
        low=1.0,
        high=20.0,
    )
    row_withhold_permille: float = param(
        2.5,
        "Median vertical (epipolar) error, in thousandths of the diagonal, over which no metres are given out "
        "(2 px at 640x480).",
        low=0.05,
        high=100.0,
    )
    aspect_limit: float = param(
        1.4, "Largest change of the aspect ratio by a rectifying homography; its inverse is the smallest.",
        low=1.01, high=10.0,
    )  # fmt: skip
    angle_limit_deg: float = param(
        15.0, "Largest departure from a right angle under a rectifying homography.", unit="deg", low=0.5, high=80.0
    )
    flat_share_limit: float = param(
        0.9, "Share of tie points explained by one homography over which the scene is called flat.", low=0.3, high=1.0
    )
    lock_frames: int = param(10, "Frames of tie points gathered before the rig's geometry is locked.", low=1, high=1000)
    lock_points: int = param(600, "Tie points gathered before the rig's geometry is locked.", low=25, high=100_000)
    watch_interval: int = param(
        5,
        "Every which frame the vertical (epipolar) error is watched once the geometry is locked, or every 5 s.",
        low=1,
        high=10_000,
    )
    drift_limit_px: float = param(
        1.0, "Median vertical (epipolar) error over which a locked rig counts as moved.", unit="px", low=0.1, high=20.0
    )
    drift_patience: int = param(3, "Watched frames in a row that must show the drift.", low=1, high=1000)
