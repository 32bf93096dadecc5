"""What was found, by a stable code: programs, inside and outside, go by codes; only people read the text."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum


class Severity(IntEnum):
    """How bad a finding is."""

    OK = 0  #: worth a line, nothing is wrong
    WARN = 1  #: the result stands, and somebody should know
    UNRELIABLE = 2  #: a check failed: the result is marked, and not to be steered or measured by
    REFUSED = 3  #: no result


class Code(str, Enum):
    """Stable names of findings and errors, ``room.what``. A text may change, a code may not."""

    # errors that no closer code describes
    CALIBRATION = "calibration"
    BAG = "bag"
    DATA = "data"
    ESTIMATION = "estimation"
    IMAGE = "image"
    IMAGE_DEPTHS_DIFFER = "image.depths_differ"
    IMAGE_IDENTICAL = "image.identical"
    IMAGE_KINDS_DIFFER = "image.kinds_differ"
    IMAGE_SIZES_DIFFER = "image.sizes_differ"
    INTERNAL = "internal"  #: a bug, not a fault of the data
    MESSAGE = "message"
    TRAJECTORY = "trajectory"
    YAML = "yaml"
    # calibrations
    CALIBRATION_BASELINE_IMPLAUSIBLE = "calibration.baseline_implausible"
    CALIBRATION_BASELINE_LEFT = "calibration.baseline_left"
    CALIBRATION_BASELINE_OBLIQUE = "calibration.baseline_oblique"
    CALIBRATION_BASELINE_SIGN = "calibration.baseline_sign"
    CALIBRATION_BINNING = "calibration.binning"
    CALIBRATION_DEPTH_IMPLAUSIBLE = "calibration.depth_implausible"
    CALIBRATION_DISTORTION = "calibration.distortion"
    CALIBRATION_DISTORTION_LOST = "calibration.distortion_lost"
    CALIBRATION_DISTORTION_IMPLAUSIBLE = "calibration.distortion_implausible"
    CALIBRATION_IDENTICAL = "calibration.identical"
    CALIBRATION_INTRINSICS = "calibration.intrinsics"
    CALIBRATION_MADE_IN_AIR = "calibration.made_in_air"
    CALIBRATION_NONE = "calibration.none"
    CALIBRATION_ONE_CAMERA = "calibration.one_camera"
    CALIBRATION_NOT_A_ROTATION = "calibration.not_a_rotation"
    CALIBRATION_NOT_CALIBRATED = "calibration.not_calibrated"
    CALIBRATION_NO_BASELINE = "calibration.no_baseline"
    CALIBRATION_NOT_WRITTEN = "calibration.not_written"
    CALIBRATION_NUMBERS = "calibration.numbers"
    CALIBRATION_PROJECTION = "calibration.projection"
    CALIBRATION_RESOLUTION = "calibration.resolution"
    CALIBRATION_SIZE_DIFFERS = "calibration.size_differs"
    CALIBRATION_SIZE_UNKNOWN = "calibration.size_unknown"
    CALIBRATION_UNKNOWN_FORM = "calibration.unknown_form"
    CALIBRATION_UNKNOWN_MODEL = "calibration.unknown_model"
    CALIBRATION_VIEWS_DIFFER = "calibration.views_differ"
    # calibrating with a board
    CALIBRATE_BLURRED = "calibrate.blurred"
    CALIBRATE_BOARD = "calibrate.board"
    CALIBRATE_COVERAGE = "calibrate.coverage"
    CALIBRATE_DEPTH_ERROR = "calibrate.depth_error"
    CALIBRATE_DUPLICATE = "calibrate.duplicate"
    CALIBRATE_EXCHANGED = "calibrate.exchanged"
    CALIBRATE_FEW_PAIRS = "calibrate.few_pairs"
    CALIBRATE_FLAT = "calibrate.flat"
    CALIBRATE_HELD_OUT = "calibrate.held_out"
    CALIBRATE_MEDIUM = "calibrate.medium"
    CALIBRATE_MIRRORED = "calibrate.mirrored"
    CALIBRATE_NOT_SEEN = "calibrate.not_seen"
    CALIBRATE_OUTLIER = "calibrate.outlier"
    CALIBRATE_PORT = "calibrate.port"
    CALIBRATE_RESIDUALS = "calibrate.residuals"
    CALIBRATE_SIZE_DIFFERS = "calibrate.size_differs"
    CALIBRATE_SQUARE_UNKNOWN = "calibrate.square_unknown"
    CALIBRATE_TOO_FEW = "calibrate.too_few"
    CALIBRATE_UNSYNCHRONISED = "calibrate.unsynchronised"
    # matching
    MATCH_EXCHANGED = "match.exchanged"
    MATCH_NETWORK = "match.network"
    MATCH_NOTHING = "match.nothing"
    MATCH_NO_RANGE = "match.no_range"
    MATCH_NOTHING_SEEN = "match.nothing_seen"
    # recordings
    RECORDING_BY_ORDER = "recording.by_order"
    RECORDING_CLOCKS = "recording.clocks"
    RECORDING_EXTRA = "recording.extra"
    RECORDING_LAYOUT = "recording.layout"
    RECORDING_ONE_CAMERA = "recording.one_camera"
    RECORDING_PARTNERS_APART = "recording.partners_apart"
    RECORDING_SEVERAL_RIGS = "recording.several_rigs"
    RECORDING_VIDEO_TOPICS = "recording.video_topics"
    # rectification
    RECTIFY_CALIBRATED_IN_AIR = "rectify.calibrated_in_air"
    RECTIFY_DISTORTED = "rectify.distorted"
    RECTIFY_EXCHANGED = "rectify.exchanged"
    RECTIFY_FLAT_SCENE = "rectify.flat_scene"
    RECTIFY_FORWARD_MOTION = "rectify.forward_motion"
    RECTIFY_INFINITY_MOVED = "rectify.infinity_moved"
    RECTIFY_INFINITY_VAGUE = "rectify.infinity_vague"
    RECTIFY_NO_BASELINE = "rectify.no_baseline"
    RECTIFY_NO_PARALLAX = "rectify.no_parallax"
    RECTIFY_NOT_CHECKED = "rectify.not_checked"
    RECTIFY_ORDER_UNKNOWN = "rectify.order_unknown"
    RECTIFY_NOTHING_IN_COMMON = "rectify.nothing_in_common"
    RECTIFY_PROJECTIVE = "rectify.projective"
    RECTIFY_PORT = "rectify.port"
    RECTIFY_ROWS_DISAGREE = "rectify.rows_disagree"
    RECTIFY_SCALE_WITHHELD = "rectify.scale_withheld"
    RECTIFY_TIE_POINTS = "rectify.tie_points"
    RECTIFY_UPSIDE_DOWN = "rectify.upside_down"
    # measuring
    MEASURE_INPUT = "measure.input"
    MEASURE_NO_DEPTH = "measure.no_depth"
    MEASURE_NO_PLANE = "measure.no_plane"
    MEASURE_NO_SCALE = "measure.no_scale"
    MEASURE_UNRELIABLE = "measure.unreliable"
    # models of a dive
    MODEL = "model"
    MODEL_COARSENED = "model.coarsened"
    MODEL_DISK = "model.disk"
    MODEL_EXISTS = "model.exists"
    MODEL_EXTRA_ABSENT = "model.extra_absent"
    MODEL_FRAMES_DROPPED = "model.frames_dropped"
    MODEL_NOTHING = "model.nothing"
    MODEL_NOT_KEPT = "model.not_kept"
    MODEL_NOT_METRIC = "model.not_metric"
    MODEL_NO_OVERLAP = "model.no_overlap"
    MODEL_NO_SURVEY = "model.no_survey"
    MODEL_POSES = "model.poses"
    MODEL_TOO_LARGE = "model.too_large"
    # the way while the dive goes on
    ODOMETRY_LOST = "odometry.lost"
    ODOMETRY_NOT_METRIC = "odometry.not_metric"
    ODOMETRY_RESUMED = "odometry.resumed"
    # parts of an image that show no scene
    REGION_BLANK = "region.blank"
    REGION_BORDER = "region.border"
    REGION_DEAD = "region.dead"
    REGION_FROZEN = "region.frozen"
    REGION_NOISE = "region.noise"
    REGION_TORN = "region.torn"

    # the trajectory of a dive
    TRACK_AMBIGUOUS = "track.ambiguous"
    TRACK_BRIDGED = "track.bridged"
    TRACK_GRAVITY_UNKNOWN = "track.gravity_unknown"
    TRACK_LOOPS_DROPPED = "track.loops_dropped"
    TRACK_PREDICTED = "track.predicted"
    TRACK_PRIORS_DISAGREE = "track.priors_disagree"
    TRACK_PRIORS_LEFT_OUT = "track.priors_left_out"
    TRACK_RIG_OFF = "track.rig_off"
    TRACK_SEGMENTS = "track.segments"
    TRACK_STILL = "track.still"
    # packets of video
    VIDEO_AWAITS_KEY_FRAME = "video.awaits_key_frame"
    VIDEO_DECODE = "video.decode"
    VIDEO_FORMAT = "video.format"

    def __str__(self) -> str:
        """The name as it stands in files and on topics."""
        return self.value


@dataclass(frozen=True)
class Finding:
    """One thing found.

    Parameters
    ----------
    code : Code
    text : str
        What, got and expected, with the numbers; one line.
    severity : Severity
    advice : str
        What to do; empty where there is nothing to do.
    """

    code: Code
    text: str
    severity: Severity = Severity.WARN
    advice: str = ""

    def __post_init__(self) -> None:
        """Take the names that files hold as well."""
        object.__setattr__(self, "code", Code(self.code))
        object.__setattr__(self, "severity", Severity(self.severity))

    def __str__(self) -> str:
        """What is read: the text, and what to do."""
        return f"{self.text}: {self.advice}" if self.advice else self.text

    def as_dict(self) -> dict[str, str]:
        """``code``, ``severity`` and ``text`` (advice included), for JSON."""
        return {"code": self.code.value, "severity": self.severity.name.lower(), "text": str(self)}


def worst(findings: tuple[Finding, ...]) -> Severity:
    """The severity of the worst of them; OK where there is none."""
    return max((finding.severity for finding in findings), default=Severity.OK)


def severe(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Those that somebody should be told of: warnings and worse."""
    return tuple(finding for finding in findings if finding.severity >= Severity.WARN)
