"""The nouns: what flows from stage to stage.

Conventions
-----------
- Pixel (0, 0) is the centre of the top-left pixel; arrays are indexed ``image[v, u]``; colour is RGB.
- Disparity ``d = u_left - u_right`` (``v_left - v_right`` for a vertical rig), in pixels.
- Optical frames are REP 103: x right, y down, z forward, metres.
- An invalid pixel is NaN in every float array, and a `Status` bit says why.
- Time is the header stamp of the left image in integer nanoseconds, handed through unchanged.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import IntFlag
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.findings import Finding

ByteImage = NDArray[np.uint8]
FloatImage = NDArray[np.float32]
Mask = NDArray[np.bool_]
Matrix = NDArray[np.float64]
RawImage = NDArray[Any]  # uint8 or uint16

Axis = Literal["horizontal", "vertical"]


_RECTIFIED = "_rectified"


def share_known(values: FloatImage) -> float:
    """Share of an image that is no NaN, 0 to 1."""
    return float(np.isfinite(values).mean()) if values.size else 0.0


def optical_frame(frame_id: str) -> str:
    """Name of a camera's own, unrotated optical frame, from that or from `rectified_frame` of it."""
    return frame_id.removesuffix(_RECTIFIED)


def rectified_frame(frame_id: str) -> str:
    """Name of the frame that the rectifying rotation turns a camera's optical frame into."""
    return optical_frame(frame_id) + _RECTIFIED


def named_frame(frame_id: str, which: str) -> str:
    """`optical_frame` or `rectified_frame` of `frame_id`, as `which` says: ``optical`` or ``rectified``."""
    return rectified_frame(frame_id) if which == "rectified" else optical_frame(frame_id)


@dataclass(frozen=True)
class Window:
    """A rectangle of pixels, the part of a rectified image that shows something.

    Parameters
    ----------
    u, v : int
        Top-left pixel.
    width, height : int
        px.
    """

    u: int
    v: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Rows and columns, to index an image with."""
        return slice(self.v, self.v + self.height), slice(self.u, self.u + self.width)


class Status(IntFlag):
    """Why a pixel has no disparity: a bit mask kept in a ``uint8`` image, 0 = valid."""

    VALID = 0
    OCCLUDED = 1  #: seen by the left camera only
    OUTSIDE = 2  #: its match would lie outside the other view
    INCONSISTENT = 4  #: the two cameras disagree
    LOW_TEXTURE = 8  #: nothing to match
    OUT_OF_RANGE = 16  #: disparity or depth outside the given limits
    UNSEEN = 32  #: outside the rectified image's valid region, or in a part of it that shows no scene
    FILTERED = 64  #: removed by the depth filter as an isolated speckle


@dataclass(frozen=True, eq=False)
class CameraModel:
    """One calibrated camera, as a ``sensor_msgs/CameraInfo`` describes it.

    Parameters
    ----------
    width, height : int
        Image size, px.
    k : (3, 3) float64
        Intrinsic matrix of the raw image.
    d : (N,) float64
        Distortion coefficients of `distortion_model`.
    r : (3, 3) float64
        Rectifying rotation, ``x_rect = r @ x_raw`` (identity when not rectified).
    p : (3, 4) float64
        Projection matrix of the rectified image; ``p[0, 3] = -fx * B`` for the right camera of a horizontal pair,
        ``p[1, 3] = -fy * B`` of a vertical one.
    distortion_model : str
        ``plumb_bob``, ``rational_polynomial`` or ``equidistant``.
    frame_id : str
        Optical frame of the raw camera.
    binning : (x, y)
        Already applied to the numbers above; worth saying where they do not fit the images.
    """

    width: int
    height: int
    k: Matrix
    d: Matrix
    r: Matrix
    p: Matrix
    distortion_model: str = "plumb_bob"
    frame_id: str = ""
    binning: tuple[int, int] = (1, 1)


@dataclass(frozen=True)
class FlatPorts:
    """Flat panes of one kind before both cameras of a rig.

    Parameters
    ----------
    distance_m : float
        From either camera's centre of projection to the inner face, along the normal.
    thickness_m : float
    glass, water : float
        Refractive indices.
    normal_left, normal_right : (x, y, z)
        Unit vectors outwards, each in its raw camera's frame.
    """

    distance_m: float
    thickness_m: float
    glass: float
    water: float
    normal_left: tuple[float, float, float] = (0.0, 0.0, 1.0)
    normal_right: tuple[float, float, float] = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class CalibrationOrigin:
    """How a calibration came about, as far as its file tells.

    Parameters
    ----------
    medium : {'water', 'air', 'unknown'}
        In which the pictures of the board were taken, behind the ports if there are any.
    depth_sigmas : tuple of (range_m, fraction)
        Relative standard deviation of depth by the calibration, by range; empty: not known.
    ports : FlatPorts or None
        Of a calibration in air: what stands before the cameras in water.
    """

    medium: str = "unknown"
    depth_sigmas: tuple[tuple[float, float], ...] = ()
    ports: FlatPorts | None = None


@dataclass(frozen=True, eq=False)
class StereoCalibration:
    """The two cameras of a rig. Extrinsics follow from ``r`` and ``p`` of both."""

    left: CameraModel
    right: CameraModel
    origin: CalibrationOrigin = CalibrationOrigin()


@dataclass(frozen=True)
class StereoGeometry:
    """Rectified geometry: the one place where depth and disparity are turned into each other.

    Parameters
    ----------
    focal_px : float
        Focal length along the baseline of the rectified views, px (fx, or fy for a vertical rig).
    cx_left, cx_right : float
        Principal point along the baseline of either rectified view, px.
    cy : float
        Principal point across the baseline, common to both views, px.
    baseline_m : float or None
        Signed distance from left to right camera along the rig's axis, m; negative when the second camera lies on the
        other side (above, in a vertical rig). None: the scale is not known.
    axis : {'horizontal', 'vertical'}
        Direction of the baseline in the image.
    baseline_sign : {1, -1}
        Side of the second camera when `baseline_m` is None.
    focal_across_px : float or None
        Focal length across the baseline, px; None: the same.
    rect_from_raw_left : (3, 3) tuple of tuples
        Rotation from the unrotated left optical frame to the rectified one.
    """

    focal_px: float
    cx_left: float
    cx_right: float
    cy: float
    baseline_m: float | None = None
    axis: Axis = "horizontal"
    baseline_sign: int = 1
    focal_across_px: float | None = None
    rect_from_raw_left: tuple[tuple[float, ...], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    @property
    def metric(self) -> bool:
        """Whether depths are metres. Otherwise they are in units of the baseline, focal length assumed."""
        return self.baseline_m is not None

    @property
    def unscaled(self) -> StereoGeometry:
        """The same geometry without metres."""
        return replace(self, baseline_m=None)

    @property
    def offset_px(self) -> float:
        """``cx_right - cx_left``: what is added to a disparity before it is inverted, px."""
        return self.cx_right - self.cx_left

    @property
    def focal_times_baseline(self) -> float:
        """``f B`` in px m (px times baselines where the scale is unknown); carries the baseline's sign."""
        baseline = float(self.baseline_sign) if self.baseline_m is None else self.baseline_m
        return self.focal_px * baseline

    @property
    def intrinsics_left(self) -> Matrix:
        """(3, 3) intrinsic matrix of the left rectified view."""
        along, across = self.focal_px, self.focal_across_px or self.focal_px
        if self.axis == "horizontal":
            return np.array([[along, 0.0, self.cx_left], [0.0, across, self.cy], [0.0, 0.0, 1.0]])
        return np.array([[across, 0.0, self.cy], [0.0, along, self.cx_left], [0.0, 0.0, 1.0]])

    def depth_from_disparity(self, disparity: FloatImage) -> FloatImage:
        """``Z = f B / (d + offset)`` (paper eq. 18), NaN where the point is not in front of the rig.

        Parameters
        ----------
        disparity : float32, any shape
            px; NaN = invalid.

        Returns
        -------
        float32, same shape
            Depth along the optical axis, m (baselines when the scale is unknown).
        """
        shifted = np.asarray(disparity, np.float32) + np.float32(self.offset_px)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = np.float32(self.focal_times_baseline) / shifted
        front: FloatImage = np.where((depth > 0) & np.isfinite(depth), depth, np.float32(np.nan)).astype(np.float32)
        return front

    def disparity_from_depth(self, depth: FloatImage) -> FloatImage:
        """``d = f B / Z - offset``: the inverse of `depth_from_disparity`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            disparity: FloatImage = np.float32(self.focal_times_baseline) / depth - np.float32(self.offset_px)
        return disparity

    def depth_sigma(self, depth: FloatImage, sigma_px: FloatImage) -> FloatImage:
        """``sigma_Z = Z^2 / |f B| sigma_d``, m, for `depth` in m and `sigma_px` in px."""
        scale = np.float32(1.0 / abs(self.focal_times_baseline))
        sigma: FloatImage = np.square(depth) * scale * sigma_px
        return sigma


@dataclass(frozen=True, eq=False)
class StereoPair:
    """Two raw images taken at one moment.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8 or uint16
        Mono or RGB; both of one shape and dtype.
    stamp_ns : int
        Header stamp of the left image, ns.
    frame_id : str
        Left camera's optical frame.
    calibration : StereoCalibration or None
    findings : tuple of Finding
        What was done to make them of one kind.
    """

    left: RawImage
    right: RawImage
    stamp_ns: int = 0
    frame_id: str = ""
    calibration: StereoCalibration | None = None
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False)
class EnhancedPair:
    """A preprocessed pair: one image to look at, one to match.

    Parameters
    ----------
    left, right : (H, W, 3) uint8
        RGB, enhanced: texture. Where nobody asked for a picture, what the matcher sees: the same array, (H, W).
    left_matching, right_matching : (H, W) uint8
        What the matcher sees, chosen by the `profile` parameter; 0 where nothing is seen, see `unseen`.
    stamp_ns, frame_id, calibration
        As in `StereoPair`.
    findings : tuple of Finding
        Parts of either image that show no scene, and what was told of the raw pair.
    """

    left: ByteImage
    right: ByteImage
    left_matching: ByteImage
    right_matching: ByteImage
    stamp_ns: int = 0
    frame_id: str = ""
    calibration: StereoCalibration | None = None
    findings: tuple[Finding, ...] = ()

    @property
    def pictures(self) -> dict[str, ByteImage]:
        """Images to look at, by side: those that are there."""
        return _pictures(self)


@dataclass(frozen=True)
class RectificationQuality:
    """How well rows agree after rectification, on tie points left out of the fit.

    Parameters
    ----------
    method : {'calibrated', 'quasi-euclidean', 'given'}
        ``given``: the images came rectified.
    row_error_median_px, row_error_p95_px : float
        NaN where no tie points were available.
    inliers : int
        Tie points that the epipolar geometry explains.
    warnings : tuple of Finding
        E.g. a flat scene, a rig calibrated in air and used in water.
    medium : str
        What the rows of a calibrated pair say: it works in ``water`` though calibrated in air, ``as calibrated``, or
        ``cannot tell``; empty where nobody looked.
    shape_sigma_percent : float
        Of an uncalibrated shape: standard deviation of relative depths, by focal length and plane at infinity; NaN for
        a calibrated one.
    lens_k1 : float
        Of an uncalibrated rig: radial distortion estimated from the tie points, of both lenses, as ``plumb_bob`` has
        it; 0: none that is significant; NaN for a calibrated one.
    origin : CalibrationOrigin
        Of the calibration.
    """

    method: str
    row_error_median_px: float = float("nan")
    row_error_p95_px: float = float("nan")
    inliers: int = 0
    warnings: tuple[Finding, ...] = ()
    medium: str = ""
    shape_sigma_percent: float = float("nan")
    lens_k1: float = float("nan")
    origin: CalibrationOrigin = CalibrationOrigin()


@dataclass(frozen=True, eq=False)
class MatchingPair:
    """What the matcher needs of a rectified pair.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8
        0 where nothing is seen, see `unseen`; RGB where colour is to be matched.
    axis : {'horizontal', 'vertical'}
        Whether matching pixels share a row or a column.
    valid_left, valid_right : Window or None
        Where the image shows something; None: everywhere.
    """

    left: ByteImage
    right: ByteImage
    axis: Axis = "horizontal"
    valid_left: Window | None = None
    valid_right: Window | None = None


@dataclass(frozen=True, eq=False)
class RectifiedPair:
    """A pair whose matching pixels share a row (a column, for a vertical rig).

    Parameters
    ----------
    left, right : (H, W, 3) uint8
        RGB, enhanced: texture; or as in `EnhancedPair`.
    left_matching, right_matching : (H, W) or (H, W, 3) uint8
        What the matcher sees; RGB where colour is to be matched.
    geometry : StereoGeometry
    quality : RectificationQuality
    valid_left, valid_right : Window or None
        Where the rectified image shows something; None: everywhere.
    stamp_ns, frame_id
        As in `StereoPair`.
    """

    left: ByteImage
    right: ByteImage
    left_matching: ByteImage
    right_matching: ByteImage
    geometry: StereoGeometry
    quality: RectificationQuality
    valid_left: Window | None = None
    valid_right: Window | None = None
    stamp_ns: int = 0
    frame_id: str = ""

    @property
    def pictures(self) -> dict[str, ByteImage]:
        """Images to look at, by side: those that are there."""
        return _pictures(self)

    @property
    def to_match(self) -> MatchingPair:
        """What the matcher needs of it."""
        return MatchingPair(
            self.left_matching, self.right_matching, self.geometry.axis, self.valid_left, self.valid_right
        )


def _pictures(pair: EnhancedPair | RectifiedPair) -> dict[str, ByteImage]:
    sides = (("left", pair.left, pair.left_matching), ("right", pair.right, pair.right_matching))
    return {side: picture for side, picture, matching in sides if picture is not matching}


@dataclass(frozen=True)
class RowOffset:
    """How far rows that should agree were still apart when they were to be matched.

    Parameters
    ----------
    median_px, p90_px : float
        Magnitude of the smooth field that tie points show, px; NaN where there were too few.
    points : int
        Tie points it was measured on.
    mended : bool
        Whether the right view was bent by it before matching.
    """

    median_px: float = float("nan")
    p90_px: float = float("nan")
    points: int = 0
    mended: bool = False

    def __str__(self) -> str:
        if math.isnan(self.median_px):
            return f"not measured: {self.points} tie points"
        done = "mended" if self.mended else "left as they are"
        return f"{self.median_px:.2f} px (a tenth over {self.p90_px:.2f}; {self.points} tie points), rows {done}"


@dataclass(frozen=True, eq=False)
class Matches:
    """Dense correspondence of two images, whatever the cameras.

    Parameters
    ----------
    disparity, sigma, status, min_disparity, max_disparity, method, energy, confidence, rows
        As in `DisparityMap`.
    findings : tuple of Finding
        What is to be known of the images.
    """

    disparity: FloatImage
    sigma: FloatImage
    status: ByteImage
    min_disparity: int
    max_disparity: int
    method: str
    energy: float
    findings: tuple[Finding, ...] = ()
    confidence: FloatImage | None = None
    rows: RowOffset = RowOffset()

    @property
    def density(self) -> float:
        """Share of pixels with a disparity, 0 to 1."""
        return share_known(self.disparity)


@dataclass(frozen=True, eq=False)
class DisparityMap:
    """Dense correspondence of a rectified pair, in the left view.

    Parameters
    ----------
    disparity : (H, W) float32
        px; NaN = invalid.
    sigma : (H, W) float32
        Standard deviation of `disparity`, px; NaN where that is.
    status : (H, W) uint8
        `Status` bits; 0 exactly where `disparity` is finite.
    min_disparity, max_disparity : int
        Limits that were searched, inclusive, px.
    geometry : StereoGeometry
    method : str
    energy : float
        Of the labelling, in the units of the method; NaN where it has none.
    stamp_ns, frame_id
        As in `StereoPair`.
    confidence : (H, W) float32 or None
        Probability that `disparity` is less than a pixel off, 0 to 1; NaN where that is. None: not known, as of
        disparities that another node found.
    rows : RowOffset
        What was left of the rows' offset when they were matched.
    """

    disparity: FloatImage
    sigma: FloatImage
    status: ByteImage
    min_disparity: int
    max_disparity: int
    geometry: StereoGeometry
    method: str = ""
    energy: float = float("nan")
    stamp_ns: int = 0
    frame_id: str = ""
    confidence: FloatImage | None = None
    rows: RowOffset = RowOffset()

    @property
    def density(self) -> float:
        """Share of pixels with a disparity, 0 to 1."""
        return share_known(self.disparity)


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Depth along the optical axis of the left rectified view.

    Parameters
    ----------
    depth : (H, W) float32
        m, or baselines where ``geometry.metric`` is false; NaN = invalid.
    sigma : (H, W) float32
        Standard deviation of `depth`, same unit.
    status : (H, W) uint8
        `Status` bits, those of the disparity and of the depth filter.
    geometry : StereoGeometry
    stamp_ns, frame_id
        As in `StereoPair`.
    """

    depth: FloatImage
    sigma: FloatImage
    status: ByteImage
    geometry: StereoGeometry
    stamp_ns: int = 0
    frame_id: str = ""


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Coloured points.

    Parameters
    ----------
    points : (H, W, 3) float32 organised, or (N, 3) float32
        x, y, z; NaN where invalid (organised clouds only).
    colors : uint8, same shape
        RGB.
    normals : float32, same shape, or None
        Unit length, towards the camera.
    metric : bool
        Whether the unit is the metre.
    stamp_ns, frame_id
        As in `StereoPair`; the frame the points are expressed in.
    """

    points: FloatImage
    colors: ByteImage
    normals: FloatImage | None = None
    metric: bool = False
    stamp_ns: int = 0
    frame_id: str = ""


@dataclass(frozen=True, eq=False)
class Surface:
    """A textured triangle mesh.

    Parameters
    ----------
    vertices : (N, 3) float32
        In the frame of the cloud it was made from.
    faces : (M, 3) int32
        Counter-clockwise seen from the camera.
    normals : (N, 3) float32
        Unit length, towards the camera.
    uv : (N, 2) float32
        Texture coordinates, 0 to 1, origin at the texture's lower left (glTF viewers via trimesh).
    colors : (N, 3) uint8
        RGB at the vertices.
    texture : (H, W, 3) uint8
        The enhanced left rectified image, RGB.
    metric : bool
    stamp_ns, frame_id
        As in `StereoPair`.
    """

    vertices: FloatImage
    faces: NDArray[np.int32]
    normals: FloatImage
    uv: FloatImage
    colors: ByteImage
    texture: ByteImage = field(repr=False)
    metric: bool = False
    stamp_ns: int = 0
    frame_id: str = ""


@dataclass(frozen=True, eq=False)
class Sectors:
    """The nearest trusted surface in each sector of a horizontal fan.

    Parameters
    ----------
    ranges : (N,) float64
        Horizontal distance from the origin of `frame_id`, m; NaN: nothing trusted was seen there, which is not free.
    first_rad, step_rad : float
        Direction of the middle of the first sector, and between neighbours: about z, from x to y.
    min_range, max_range : float
        m; what may be told.
    stamp_ns : int
    frame_id : str
    """

    ranges: NDArray[np.float64]
    first_rad: float
    step_rad: float
    min_range: float
    max_range: float
    stamp_ns: int
    frame_id: str


@dataclass(frozen=True)
class AxisRange:
    """The distance along one axis.

    Parameters
    ----------
    distance, sigma : float
        m, from the left camera along the axis, and its standard deviation.
    cone_rad : float
        Full angle of the cone that was looked at.
    min_range, max_range : float
        m; what may be told.
    stamp_ns : int
    frame_id : str
    """

    distance: float
    sigma: float
    cone_rad: float
    min_range: float
    max_range: float
    stamp_ns: int
    frame_id: str
