"""Pictures of a board to the calibration of a rig, from files to files: the work of ``uw_recon calibrate``."""

from __future__ import annotations

import json
import platform
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from uw_recon_ros.board_kinds import APRILGRID, CHARUCO, CHECKERBOARD
from uw_recon_ros.boards import Board
from uw_recon_ros.calibrate.advice import CalibrationSession, advise, describe
from uw_recon_ros.calibrate.bundle import SeenPair
from uw_recon_ros.calibrate.coverage import corners_covered, covered
from uw_recon_ros.calibrate.depth_error import DepthError, HeldOut, depth_errors_by_range, held_out
from uw_recon_ros.calibrate.detect import Sighting, find_board, find_checkerboard_size
from uw_recon_ros.calibrate.fit import LEAST_PAIRS, Fit, LeftOut, baseline_sigma, solve, turned_over
from uw_recon_ros.calibrate.markers import APRILTAGS, find_dictionary
from uw_recon_ros.calibrate.moments import do_not_belong, find_shift
from uw_recon_ros.calibrate.optics import NAMES, names_of
from uw_recon_ros.calibrate.pair_selection import different_ones, mirrored, sharp_ones, unseen_reason
from uw_recon_ros.calibrate.ports import ALL_NAMES, AirRig, PortGlass, PortRig, port_findings, solve_ports
from uw_recon_ros.calibrate.rig import RigNumbers
from uw_recon_ros.calibration.judge import judge_calibration
from uw_recon_ros.errors import CalibrationError, ReconError
from uw_recon_ros.files.atomic import claim_folder, finite, write_json
from uw_recon_ros.files.bounded import read_bounded
from uw_recon_ros.files.calibrations.document import LARGEST_BYTES
from uw_recon_ros.files.calibrations.write import write_calibration, write_camera
from uw_recon_ros.findings import Code, Finding, Severity, worst
from uw_recon_ros.images import as_gray
from uw_recon_ros.lenses import AUTO, PLUMB_BOB
from uw_recon_ros.recordings.listing import list_frames
from uw_recon_ros.recordings.options import Options
from uw_recon_ros.recordings.pair_index import Frame
from uw_recon_ros.recordings.read import Reader
from uw_recon_ros.recordings.sources import find_sources
from uw_recon_ros.types import ByteImage, Matrix, StereoCalibration

MEDIA = ("water", "air", "unknown")
_OTHER_MOMENTS = (Code.CALIBRATE_UNSYNCHRONISED, Code.CALIBRATE_TOO_FEW)  # where a shift is looked for
_LOOKED_AT = 12  # pairs, to find a board's size or dictionary


@dataclass(frozen=True)
class BoardAsked:
    """What was told of the board; None and 0: to be found.

    Parameters
    ----------
    kind : str
    size : (columns, rows) or None
    square_m, marker_m : float
        m; a square of 0: not known, so that nothing is in metres.
    dictionary : str
    """

    kind: str = CHECKERBOARD
    size: tuple[int, int] | None = None
    square_m: float = 0.0
    marker_m: float = 0.0
    dictionary: str = ""


class PortsAsked(NamedTuple):
    """What ports are looked for with."""

    air: AirRig
    told: PortGlass


def air_rig(path: str | Path) -> AirRig:
    """A rig's numbers with their covariance, from a ``calibration.json`` made in air.

    Raises
    ------
    CalibrationError
        It is none, not made in air, or not in metres.
    """
    try:
        told = json.loads(read_bounded(Path(path), LARGEST_BYTES, CalibrationError))
        medium, unit, lens = (told[name] for name in ("medium", "parameters_unit_of_length", "distortion_model"))
        numbers = np.array([float(told["parameters"].get(name, "nan")) for name in NAMES])
        covariance = np.array(told["covariance"], np.float64)[: len(NAMES), : len(NAMES)]
        size = int(told["image_width"]), int(told["image_height"])
        made = AirRig(numbers, covariance, float(told["noise_px"]), size)
    except (ValueError, KeyError, TypeError) as error:
        text = f"{path}: expected calibration.json of uw_recon calibrate, got {error!r}"
        raise CalibrationError(text, Code.CALIBRATION_UNKNOWN_FORM) from error
    if medium != "air" or unit != "m" or lens != PLUMB_BOB:
        text = (
            f"{path}: expected a calibration made in air (--medium air), in metres and with plumb_bob lenses (--lens), "
            f"got {medium}, {unit}, {lens}"
        )
        raise CalibrationError(text, Code.CALIBRATE_MEDIUM)
    if covariance.shape != (len(NAMES), len(NAMES)) or not (
        np.isfinite(covariance).all() and np.isfinite(numbers).all()
    ):
        raise CalibrationError(f"{path}: expected finite numbers with their covariance", Code.CALIBRATION_NUMBERS)
    return made


@dataclass(frozen=True, eq=False)
class Seen:
    """Two grey pictures of one moment, what people call them, and which pair of the recording they are."""

    name: str
    left: ByteImage
    right: ByteImage
    place: int | None = None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the left picture, px."""
        return self.left.shape[1], self.left.shape[0]


@dataclass(frozen=True, eq=False)
class Result:
    """All that comes of a session; see the parts."""

    board: Board
    metric: bool
    medium: str
    size: tuple[int, int]
    fit: Fit
    left_out: tuple[LeftOut, ...]
    rig: RigNumbers
    session: CalibrationSession
    errors: tuple[DepthError, ...]
    held: HeldOut | None
    findings: tuple[Finding, ...]
    behind: PortRig | None = None

    @property
    def calibration(self) -> StereoCalibration:
        """As ROS has it; without a baseline where the board's squares are not known."""
        found = self.rig.calibration
        if self.metric:
            return found
        single = np.hstack([found.right.p[:, :3], np.zeros((3, 1))])
        return replace(found, right=replace(found.right, p=single))


class Pictures:
    """Pairs of a recording, whatever it is: stills, bags, videos.

    Parameters
    ----------
    path : path
    most : int
        How many to take, evenly spread.

    Attributes
    ----------
    unusable : list of LeftOut
        Pairs that could not be read; grows while pictures are read.
    notes : list of str
        What else was wrong with the recording.

    Raises
    ------
    ReconError
        There are no pairs.
    """

    def __init__(self, path: str | Path, most: int) -> None:
        sources = find_sources([path])
        listing = list_frames(sources, Options())
        self.notes, self.unusable = [*listing.notes, *listing.unreadable], list[LeftOut]()
        self._kinds = [source.kind for source in sources]
        self._step = -(-len(listing.frames) // most)
        self._frames = listing.frames[:: self._step]
        self._reader = Reader(sources, listing.calibrations)

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[Seen]:
        try:
            for place, frame in enumerate(self._frames):
                name = self._name(frame)
                try:
                    pair = self._reader.read(frame)
                except ReconError as error:
                    self.unusable.append(LeftOut(name, str(error), error.code))
                else:
                    yield Seen(name, as_gray(pair.left), as_gray(pair.right), place * self._step)
        finally:
            self._reader.close()

    def _name(self, frame: Frame) -> str:
        """Of the left still; of a bag or a video the time."""
        if self._kinds[frame.source] == "stills":
            return Path(frame.left.name).name
        return f"pair at {frame.stamp_ns / 1e9:.3f} s"


def made_board(asked: BoardAsked, frames: Iterable[Seen]) -> Board:
    """The board as told, completed by what pictures show.

    Raises
    ------
    CalibrationError
        Something is missing that pictures do not tell.
    """
    shown = list(islice(frames, _LOOKED_AT))
    size, dictionary = asked.size, asked.dictionary
    if size is None:
        if asked.kind != CHECKERBOARD:
            raise CalibrationError(f"--size: expected columns and rows of the {asked.kind} board", Code.CALIBRATE_BOARD)
        size = _commonest(shown, find_checkerboard_size, "a checkerboard", "--size says how many inner corners it has")
    if asked.kind == CHARUCO and not dictionary:
        dictionary = _commonest(shown, find_dictionary, "markers", "--dictionary names theirs")
    if asked.kind == APRILGRID:
        dictionary = dictionary or APRILTAGS
    try:
        return Board(asked.kind, size[0], size[1], asked.square_m or 1.0, asked.marker_m, dictionary)
    except ValueError as error:
        raise CalibrationError(str(error), Code.CALIBRATE_BOARD) from error


def _commonest(frames: Sequence[Seen], look: Callable[[ByteImage], Any], what: str, advice: str) -> Any:
    found = Counter(seen for frame in frames for seen in [look(frame.left)] if seen is not None)
    if not found:
        raise CalibrationError(
            f"board: expected {what} in the first {len(frames)} left pictures, found none: {advice}",
            Code.CALIBRATE_BOARD,
        )
    return found.most_common(1)[0][0]


def see_boards(frames: Iterable[Seen], board: Board) -> tuple[list[SeenPair], list[LeftOut], tuple[int, int]]:
    """Look for the board in every pair; the size is the one that most pairs have.

    Raises
    ------
    CalibrationError
        The board is in no pair.
    """
    seen, left_out, sizes = list[SeenPair](), list[LeftOut](), dict[str, tuple[int, int]]()
    last: Seen | None = None
    blind: Seen | None = None
    with ThreadPoolExecutor(2) as pool:
        for last in frames:
            found = tuple(pool.map(lambda picture: find_board(picture, board), (last.left, last.right)))
            reason = unseen_reason(*found)
            if reason is not None:
                left_out.append(LeftOut(last.name, reason, Code.CALIBRATE_NOT_SEEN))
                blind = blind or last
            elif isinstance(found[0], Sighting) and isinstance(found[1], Sighting):
                seen.append(SeenPair(last.name, found[0], found[1], last.place))
                sizes[last.name] = last.size
    if len(seen) < LEAST_PAIRS and (not seen or len(left_out) > len(seen)):
        raise _hardly_seen(blind or last, board, left_out, len(seen))
    usual = Counter(sizes.values()).most_common(1)[0][0]
    other = [pair for pair in seen if sizes[pair.name] != usual]
    left_out += [
        LeftOut(p.name, f"{_size(sizes[p.name])} px, most pairs are {_size(usual)} px", Code.CALIBRATE_SIZE_DIFFERS)
        for p in other
    ]
    return [pair for pair in seen if sizes[pair.name] == usual], left_out, usual


def _size(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"


def _hardly_seen(blind: Seen | None, board: Board, left_out: Sequence[LeftOut], count: int) -> CalibrationError:
    """What to say of a recording in which the board is in no pair, or in hardly any."""
    if blind is None:
        return CalibrationError("input: expected pairs of images, got none", Code.CALIBRATE_NOT_SEEN)
    if mirrored(blind.left, board):
        return CalibrationError(
            "images are mirrored: markers are read only in their mirror image", Code.CALIBRATE_MIRRORED
        )
    other = find_checkerboard_size(blind.left) if board.kind == CHECKERBOARD else None
    hint = f": a checkerboard of {_size(other)} inner corners is there" if other else ""
    return CalibrationError(
        f"board: expected {board} in at least {LEAST_PAIRS} pairs, found it in {count or 'none'} of "
        f"{count + len(left_out)} ({left_out[-1].reason}){hint}",
        Code.CALIBRATE_NOT_SEEN,
    )


def calibrate_frames(
    frames: Iterable[Seen], board: Board, *, metric: bool = True, medium: str = "unknown",
    ports: PortsAsked | None = None, lens: str = AUTO,
) -> Result:  # fmt: skip
    """Look for the board in pictures, and calibrate; see `calibrate_seen`."""
    return calibrate_seen(see_boards(frames, board), board, metric=metric, medium=medium, ports=ports, lens=lens)


def calibrate_seen(
    boards: tuple[Sequence[SeenPair], Sequence[LeftOut], tuple[int, int]], board: Board, *, metric: bool = True,
    medium: str = "unknown", ports: PortsAsked | None = None, lens: str = AUTO, among: Sequence[SeenPair] = (),
) -> Result:  # fmt: skip
    """Calibrate a rig, or find the ports before one that was calibrated in air.

    Parameters
    ----------
    boards : pairs, those that show none, (width, height)
        As `see_boards` finds them.
    board : Board
    metric : bool
        Whether the board's squares are known.
    medium : {'water', 'air', 'unknown'}
        In which the pictures were taken, behind the ports if there are any.
    ports : PortsAsked or None
        The pictures were taken in water, and the ports are wanted.
    lens : {'auto', 'plumb_bob', 'equidistant'}
        See `calibrate.fit.solve`.
    among : sequence of SeenPair
        Not calibrated with: where pictures of another moment are looked for too.

    Raises
    ------
    CalibrationError
        No calibration comes of it; the text says why.
    """
    seen, unseen, size = boards
    sharp, blurred = sharp_ones(seen)
    different, same = different_ones(sharp, size)
    if ports is not None and ports.air.size != size:
        text = f"pictures: expected {_size(ports.air.size)} px as the calibration in air, got {_size(size)} px"
        raise CalibrationError(text, Code.CALIBRATE_SIZE_DIFFERS)
    try:
        result = _calibrated(different, board, size, metric, medium, ports, lens)
    except CalibrationError as error:
        _raise_if_turned(different, board, size)
        if error.code in _OTHER_MOMENTS:
            _raise_if_late(different, board, size, (*among, *seen))
        rest = Counter(out.reason for out in (*unseen, *blurred, *same)).most_common(1)
        raise CalibrationError(f"{error}{f'; {rest[0][1]} pairs: {rest[0][0]}' if rest else ''}", error.code) from error
    return replace(result, left_out=(*unseen, *blurred, *same, *result.left_out))


def _calibrated(
    pairs: Sequence[SeenPair], board: Board, size: tuple[int, int], metric: bool, medium: str,
    ports: PortsAsked | None, lens: str,
) -> Result:  # fmt: skip
    fit = solve_ports(pairs, board, *ports) if ports else solve(pairs, board, size, lens)
    if not ports and do_not_belong(fit, pairs, board, size):
        text = (
            f"left and right pictures do not belong together: each camera alone sees the board well, but only "
            f"{len(fit.pairs)} of {len(pairs)} pairs agree, by {fit.bundle.noise_px:.1f} px: trigger both cameras "
            "together, and let none of them move against the other"
        )
        raise CalibrationError(text, Code.CALIBRATE_UNSYNCHRONISED)
    rig = RigNumbers(fit.bundle.numbers[: len(NAMES)], size, fit.lens)
    behind = PortRig(fit.bundle.numbers, ports.told, size) if ports else None
    if rig.exchanged:
        raise CalibrationError(
            f"left and right are exchanged: the right camera was found {1000 * rig.baseline_m:.1f} mm to the left of "
            "the left one: exchange the folders or topics (or are both cameras' pictures mirrored?)",
            Code.CALIBRATE_EXCHANGED,
        )
    points = board.points()
    session = describe(fit.bundle, fit.pairs, points, size)
    errors = depth_errors_by_range(behind or rig, fit.bundle.covariance) if metric else ()
    held = None if ports else held_out(fit.bundle, fit.pairs, points, rig)
    of_ports = port_findings(fit.bundle, ports.air) if ports else tuple(_of_medium(medium))
    told = (*of_ports, *_of_scale(rig, metric, size))
    findings = (*advise(session, fit.bundle, fit.pairs, errors, held, size, held_out=not ports), *told)
    made_in = "air" if ports else medium
    return Result(board, metric, made_in, size, fit, fit.left_out, rig, session, errors, held, findings, behind)


def _raise_if_turned(pairs: Sequence[SeenPair], board: Board, size: tuple[int, int]) -> None:
    way = turned_over(pairs, board, size) if len(pairs) >= LEAST_PAIRS else None
    if way is not None:
        text = f"the pictures of one camera are {way}: turn them back, then {len(pairs)} pairs of the board agree"
        raise CalibrationError(text, Code.CALIBRATE_MIRRORED)


def _raise_if_late(pairs: Sequence[SeenPair], board: Board, size: tuple[int, int], among: Sequence[SeenPair]) -> None:
    """Say so where pairs agree once the pictures of one camera are shifted; see `find_shift`."""
    shift = find_shift(pairs, board, size, among)
    if shift is not None:
        count, late = abs(shift.pairs), "late" if shift.pairs > 0 else "early"
        text = (
            f"left and right are not of one moment: the right pictures are {count} pair{'s' * (count > 1)} {late} (the "
            f"left one of {shift.left} belongs to the right one of {shift.right}); paired so {shift.agreed} of "
            f"{shift.of} agree, by {shift.noise_px:.2f} px: pair them so and calibrate again"
        )
        raise CalibrationError(text, Code.CALIBRATE_UNSYNCHRONISED)


def _of_medium(medium: str) -> Iterator[Finding]:
    if medium == "unknown":
        text = "medium: not given; a calibration is valid only in the medium where its pictures were taken"
        yield Finding(Code.CALIBRATE_MEDIUM, text, Severity.WARN, "--medium water, or air")
    elif medium == "air":
        text = "calibrated in air: behind flat ports in water depths would come out a quarter short"
        yield Finding(
            Code.CALIBRATE_MEDIUM, text, Severity.WARN, "calibrate in water, or describe the port (port_distance_mm)"
        )


def _of_scale(rig: RigNumbers, metric: bool, size: tuple[int, int]) -> Iterator[Finding]:
    if not metric:
        text = "size of the squares not known: the baseline is not either, and nothing will be in metres"
        yield Finding(Code.CALIBRATE_SQUARE_UNKNOWN, text, Severity.WARN, "--square-mm")
        return
    judgement = judge_calibration(rig.calibration, size)
    if judgement.refusal is not None:
        raise CalibrationError(
            f"what came out cannot be: {judgement.refusal}; is --square-mm right?", judgement.refusal.code
        )
    yield from judgement.findings


def report_of(result: Result) -> dict[str, Any]:
    """What ``calibration.json`` holds."""
    import uw_recon_ros

    bundle, rig = result.fit.bundle, result.rig
    length = 1.0 if result.metric else float("nan")
    names = ALL_NAMES if result.behind else names_of(rig.lens)
    used = [k for k, name in enumerate(names) if name]
    told = [names[k] for k in used]
    return {
        "format": 1,
        "medium": result.medium,
        "image_width": result.size[0],
        "image_height": result.size[1],
        "distortion_model": rig.lens,
        "parameters": dict(zip(told, bundle.numbers[used].tolist(), strict=True)),
        "parameters_unit_of_length": "m" if result.metric else "squares of the board",
        "sigmas": dict(zip(told, np.sqrt(np.diag(bundle.covariance))[used].tolist(), strict=True)),
        "covariance": bundle.covariance[np.ix_(used, used)].tolist(),
        "free": bundle.free[used].tolist(),
        "baseline_m": finite(length * rig.baseline_m),
        "baseline_sigma_m": finite(length * baseline_sigma(bundle)),
        "ports": vars(result.behind.ports) if result.behind else None,
        "rms_px": bundle.rms_px,
        "noise_px": bundle.noise_px,
        "held_out": None if result.held is None else vars(result.held),
        "coverage": {
            side: {"image": covered(near), "corners": corners_covered(near)}
            for side, near in zip(("left", "right"), result.session.near, strict=True)
        },
        "depth_errors": [
            {name: finite(value) for name, value in vars(error).items()} for error in result.errors
        ],
        "board": {"text": str(result.board), **vars(result.board)},
        "pairs": [
            {
                "name": pair.name, "rms_px": float(rms), "points_left": len(pair.left.numbers),
                "points_right": len(pair.right.numbers), "tilt_deg": float(tilt),
                "distance_m": finite(length * float(distance)),
            }
            for pair, rms, tilt, distance in zip(
                result.fit.pairs, bundle.pair_rms_px, result.session.tilt_deg, result.session.distance_m, strict=True
            )
        ],
        "left_out": [{"name": out.name, "code": out.code.value, "text": out.reason} for out in result.left_out],
        "warnings": [finding.as_dict() for finding in result.findings],
        "reliable": worst(result.findings) < Severity.UNRELIABLE,
        "versions": {
            "uw_recon_ros": uw_recon_ros.__version__, "opencv": cv2.__version__, "numpy": np.__version__,
            "python": platform.python_version(),
        },
    }  # fmt: skip


def write_result(result: Result, output: Path, notes: Sequence[str] = ()) -> dict[str, Any]:
    """Write ``left.yaml``, ``right.yaml``, both as ``calibration.yaml``, ``calibration.json`` and ``index.html``."""
    from uw_recon_ros.report.calibration import write_calibration_page

    output.mkdir(parents=True, exist_ok=True)
    calibration, report = result.calibration, report_of(result) | {"notes": list(notes)}
    write_camera(calibration.left, "left", output / "left.yaml")
    write_camera(calibration.right, "right", output / "right.yaml")
    write_calibration(calibration, output / "calibration.yaml")
    write_json(output / "calibration.json", report)
    write_calibration_page(output / "index.html", report, drawn_points(result), notes)
    return report


def drawn_points(result: Result) -> tuple[list[tuple[Matrix, Matrix]], list[tuple[Matrix, Matrix]]]:
    """Pixels and residuals, (N, 2) each, of every pair in the left and in the right image."""
    misses = result.fit.bundle.residuals
    left = [(pair.left.pixels, miss[0]) for pair, miss in zip(result.fit.pairs, misses, strict=True)]
    right = [(pair.right.pixels, miss[1]) for pair, miss in zip(result.fit.pairs, misses, strict=True)]
    return left, right


def calibrate_files(
    source: str | Path, output: str | Path, asked: BoardAsked, *, medium: str = "unknown", most_pairs: int = 150,
    ports: PortsAsked | None = None, lens: str = AUTO, overwrite: bool = False,
    progress: Callable[[Pictures], Iterable[Seen]] = iter,
) -> dict[str, Any]:  # fmt: skip
    """Calibrate from files into a folder; return what ``calibration.json`` holds.

    Parameters
    ----------
    source : path
        A folder of stills, a bag, a video, or a folder of either.
    output : path
    asked : BoardAsked
    medium : {'water', 'air', 'unknown'}
    most_pairs : int
        Looked at, evenly spread over the input.
    ports : PortsAsked or None
        To find the ports, from pictures in water.
    lens : {'auto', 'plumb_bob', 'equidistant'}
        See `calibrate.fit.solve`.
    overwrite : bool
        Whether the folder may hold files already.
    progress : callable
        Given the pairs, yields them while it shows how far it is.

    Raises
    ------
    ReconError
        What the input did not allow.
    """
    output, pictures = Path(output), Pictures(source, most_pairs)
    claim_folder(output, overwrite)
    first = Pictures(source, _LOOKED_AT)
    try:
        board = made_board(asked, first)
        result = calibrate_frames(
            progress(pictures), board, metric=asked.square_m > 0, medium=medium, ports=ports, lens=lens
        )
    except CalibrationError as error:
        unread = pictures.unusable or first.unusable
        if not unread:
            raise
        text = f"{error}; {len(unread)} pairs could not be read, the first, {unread[0].name}: {unread[0].reason}"
        raise CalibrationError(text, error.code) from error
    result = replace(result, left_out=(*pictures.unusable, *result.left_out))
    return write_result(result, output, pictures.notes)
