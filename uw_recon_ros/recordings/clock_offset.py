"""How two cameras that ran for themselves stand in time: their images' common motion and light tell.

The cameras of a rig are fixed to each other, so their images move alike. The motion of each video from frame to frame
(phase correlation) and its change of brightness (lamp, flash) are signals of time; pieces of the left video's are
looked for in the right one's, and the lags of those that agree are fitted by an offset and a drift. Which of several
offsets it is, and its last hundredths of a second, the rows tell (`row_lag`). Where both videos have sound, it is
asked too (`clock_sound`): it agrees, contradicts, does not tell, or stands in where the images do not.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.errors import BagError, ImageError
from uw_recon_ros.findings import Code
from uw_recon_ros.recordings.clock_sound import SoundLag, find_sound_lag, has_sound
from uw_recon_ros.recordings.row_lag import RowLag, find_row_lag, refine_row_lag
from uw_recon_ros.recordings.video import Video
from uw_recon_ros.types import Matrix

Marks = list[tuple[int, int]]
_Line = tuple[float, float]  # offset, s, and slope
_Piece = tuple[float, list[tuple[float, float]]]  # middle, s; lags, s, and their correlations

_WIDTH = 160  # px, to which frames are reduced
_PIECES = 7  # of the left video that are looked for
_PIECE_S = 16.0  # their length
_REACH_S = 60.0  # how far clocks may be apart
_SHORTEST_S = 6.0  # a video that is shorter tells nothing
_ALIKE = 0.6  # correlation of a piece that counts; what it has beyond _CHANCE is its weight
_CHANCE = 0.5
_ENOUGH = 0.5  # weight of all pieces that agree
_PEAKS = 4  # lags of a piece that are kept
_AGREE_S = 0.08  # lags of two pieces that agree, after drift
_MOST_DRIFT = 2e-3  # of time: 30 for 29.97 Hz is 1e-3
_TELLS_DRIFT_S = 0.02  # what the largest drift makes over the pieces, for it to be looked for
_LONG_S = 40.0  # a piece for slow motion, of which short ones hold too little
_LIKE_S = 0.25  # offsets that are no other
_MOST_LINES = 4  # that are held against the rows
_ROWS_S = 0.02  # what lenses and misaligned cameras feign in the rows (test/benchmark/filmed_model.py: 0.025 s)
_REFINED_S = 0.003  # what is left of that once rows' motion was looked at (there: 0.001 to 0.002)
_DRIFT_SIGMAS = 4.0  # a drift that is less is none: quartzes run alike to 1e-4
_KNOWN_S = 0.05  # uncertainty beyond which an offset is not known


@dataclass(frozen=True)
class Clock:
    """The right camera's time of a left one's: ``t + offset + drift t``.

    Parameters
    ----------
    offset_ns : int
        What the right clock is ahead by, at the left video's first frame.
    drift : float
        s a second.
    sigma_s : float
        Standard deviation of the offset; NaN where it was told, or assumed.
    told : tuple of str
        What to know of it.
    """

    offset_ns: int
    drift: float = 0.0
    sigma_s: float = float("nan")
    told: tuple[str, ...] = ()

    def right_of(self, stamp_ns: int) -> int:
        """The right clock's time of a left stamp, ns."""
        return stamp_ns + self.offset_ns + round(self.drift * stamp_ns)


def find_clock(left: Video, right: Video, ours: Marks, theirs: Marks, offset_ns: int | None) -> Clock:
    """The clock told, or found in the images.

    Raises
    ------
    BagError
        The images do not tell it.
    """
    if offset_ns is not None:
        return Clock(offset_ns, told=(f"right clock ahead by {offset_ns / 1e9:.3f} s, as given",))
    seconds = min(marks[-1][0] for marks in (ours, theirs)) / 1e9
    if seconds < _SHORTEST_S:
        return Clock(0, told=(f"{seconds:.1f} s tell no clock offset: taken as 0 (--clock-offset SECONDS)",))
    both_heard = has_sound(left.path) and has_sound(right.path)
    heard = find_sound_lag(left.path, right.path, _REACH_S) if both_heard else None
    try:
        return _with_sound(_by_images(left, right, ours, theirs, heard), heard, both_heard)
    except BagError:
        if heard is None:
            raise
        return _by_sound(heard)


def _by_images(left: Video, right: Video, ours: Marks, theirs: Marks, heard: SoundLag | None) -> Clock:
    """The clock that motion, light and rows tell; the sound's is tried as one more.

    Raises
    ------
    BagError
        They do not tell it.
    """
    pieces = _pieces(ours[-1][0] / 1e9)
    lags = [_lags_of(left, right, ours, theirs, piece) for piece in pieces]
    timed = [((a + b) / 2, found) for (a, b), found in zip(pieces, lags, strict=True)]
    rated = _candidates(timed)
    whole = ours[-1][0] / 1e9
    long = _lags_of(left, right, ours, theirs, (0.1 * whole, min(0.9 * whole, 0.1 * whole + _LONG_S)))
    fitted = [_fitted(line, timed) for _, line in rated] + [Clock(round(lag * 1e9)) for lag, _ in long]
    more = [_of_sound(heard)] if heard is not None else []
    by_rows = _by_rows(left, right, ours, theirs, _different([*more, *fitted]))
    if by_rows is None:
        return _refined(left, right, ours, theirs, _by_motion(rated, timed))
    return _refined(left, right, ours, theirs, _mended(*by_rows))


def _refined(left: Video, right: Video, ours: Marks, theirs: Marks, clock: Clock) -> Clock:
    """A clock known to a frame, made better by how fast the rows move; as it was where that does not tell."""
    seconds = ours[-1][0] / 1e9
    refine = partial(refine_row_lag, left, right, ours, theirs)
    found, drift_sigma = clock, 0.0
    if seconds * _MOST_DRIFT > _TELLS_DRIFT_S:
        lag = refine(found.right_of, drifts=True)
        if lag is not None and lag.sigma_s <= _KNOWN_S / 2 and abs(clock.drift + lag.drift) <= _MOST_DRIFT:
            found, drift_sigma = _straightened(found, lag, seconds)
    for _ in range(2):  # the second time with the frames that are nearest now
        lag = refine(found.right_of, drifts=False)
        if lag is None or lag.sigma_s > _KNOWN_S / 2 or abs(lag.shift_s) > _LIKE_S:
            return clock
        found = replace(found, offset_ns=found.offset_ns + round(lag.shift_s * 1e9))
        sigma = float(np.hypot(np.hypot(lag.sigma_s, _REFINED_S), lag.middle_s * drift_sigma))
    told = (
        f"right clock ahead by {found.offset_ns / 1e9:.4f} s at the first frame (sigma {sigma:.4f} s), found from "
        f"motion and light, and from vertical error against the rows' motion; drift {1e3 * found.drift:+.3f} ms/s"
    )
    return replace(found, sigma_s=sigma, told=(told,))


def _straightened(clock: Clock, lag: RowLag, seconds: float) -> tuple[Clock, float]:
    """A clock by what its rows say of its drift, and the drift's sigma; one that may be none is none."""
    drift, sigma = clock.drift + lag.drift, float(np.hypot(lag.drift_sigma, _REFINED_S / seconds))
    in_the_middle = clock.offset_ns / 1e9 + clock.drift * lag.middle_s + lag.shift_s + lag.drift * lag.middle_s
    if abs(drift) < _DRIFT_SIGMAS * sigma:
        drift, sigma = 0.0, 0.0
    return replace(clock, offset_ns=round((in_the_middle - drift * lag.middle_s) * 1e9), drift=drift), sigma


# ---- sound -----------------------------------------------------------------------------------------------------------


def _of_sound(heard: SoundLag) -> Clock:
    return Clock(round(heard.offset_s * 1e9), heard.drift, heard.sigma_s)


def _by_sound(heard: SoundLag) -> Clock:
    """Where the images do not tell."""
    told = (
        f"right clock ahead by {heard.offset_s:.3f} s at the first frame (sigma {heard.sigma_s:.3f} s), found from the "
        f"sound alone, the images do not tell; drift {1e3 * heard.drift:+.3f} ms/s"
    )
    return replace(_of_sound(heard), told=(told,))


def _with_sound(clock: Clock, heard: SoundLag | None, both_heard: bool) -> Clock:
    """What the images found, and whether the sound says so too."""
    if heard is None:
        return replace(clock, told=(*clock.told, "the sound does not tell the clock offset")) if both_heard else clock
    apart = heard.offset_s - clock.offset_ns / 1e9
    unsure = float(np.hypot(heard.sigma_s, np.nan_to_num(clock.sigma_s, nan=_KNOWN_S)))
    if abs(apart) <= 3 * unsure:
        told = f"the sound agrees: {heard.offset_s:.3f} s (sigma {heard.sigma_s:.3f} s)"
    else:
        told = (
            f"the sound CONTRADICTS: it says {heard.offset_s:.3f} s (sigma {heard.sigma_s:.3f} s), {abs(apart):.3f} s "
            "from what the images say, which is taken: check one pair by eye, or say --clock-offset SECONDS"
        )
    return replace(clock, told=(*clock.told, told))


def _pieces(seconds: float) -> list[tuple[float, float]]:
    length = min(_PIECE_S, max(3.0, seconds / 4))
    starts = np.linspace(0.0, seconds - length, _PIECES)
    return [(float(start), float(start) + length) for start in starts]


# ---- signals ---------------------------------------------------------------------------------------------------------


def _signals(video: Video, marks: Marks, begin_s: float, end_s: float) -> tuple[Matrix, Matrix] | None:
    """Moments (N,), s, and signals (N, 3): motion right and down, widths a second, and change of log brightness."""
    within = [(stamp / 1e9, mark) for stamp, mark in marks if begin_s <= stamp / 1e9 <= end_s]
    moments, found = [], []
    before: tuple[float, NDArray[np.float32]] | None = None
    window: NDArray[Any] | None = None
    for time, mark in within:
        try:
            image = video.small(mark, _WIDTH).astype(np.float32)
        except ImageError:
            before = None
            continue
        if window is None:
            window = cv2.createHanningWindow(image.shape[::-1], cv2.CV_32F)
        if before is not None and time > before[0]:
            (dx, dy), _ = cv2.phaseCorrelate(before[1], image, window)
            light = np.log((image.mean() + 1) / (before[1].mean() + 1))
            moments.append((time + before[0]) / 2)
            found.append(np.array([dx / _WIDTH, dy / _WIDTH, light]) / (time - before[0]))
        before = time, image
    return (np.array(moments), np.array(found)) if len(moments) >= 8 else None


def _even(moments: Matrix, signals: Matrix, step: float) -> Matrix:
    """(M, 3) at even moments from the first on, each component by its own spread, extremes cut."""
    at = np.arange(moments[0], moments[-1], step)
    even = np.stack([np.interp(at, moments, column) for column in signals.T], axis=1)
    spread = np.maximum(1.4826 * np.median(np.abs(even - np.median(even, axis=0)), axis=0), 1e-4)
    cut: Matrix = np.clip((even - np.median(even, axis=0)) / spread, -6, 6)
    return cut


def _lags_of(
    left: Video, right: Video, ours: Marks, theirs: Marks, piece: tuple[float, float]
) -> list[tuple[float, float]]:
    """Lag, s, and correlation of the best places of a left piece in the right video."""
    mine = _signals(left, ours, *piece)
    other = _signals(right, theirs, piece[0] - _REACH_S, piece[1] + _REACH_S)
    if mine is None or other is None:
        return []
    step = float(min(np.median(np.diff(mine[0])), np.median(np.diff(other[0])))) / 4
    template, searched = _even(*mine, step), _even(*other, step)
    if len(searched) <= len(template):
        return []
    rows = [(searched[None, :, n].astype(np.float32), template[None, :, n].astype(np.float32)) for n in range(3)]
    right, down, light = (cv2.matchTemplate(*row, cv2.TM_CCOEFF_NORMED)[0] for row in rows)
    scores = np.maximum((right + down) / 2, light)  # lamps and flashes tell where nothing moves
    return [(other[0][0] + place * step - mine[0][0], score) for place, score in _peaks(scores)]


def _peaks(scores: Matrix) -> list[tuple[float, float]]:
    """Places, between samples, and heights of the highest maxima, best first."""
    inner = np.flatnonzero((scores[1:-1] >= scores[:-2]) & (scores[1:-1] > scores[2:]) & (scores[1:-1] > _ALIKE)) + 1
    best = sorted(inner, key=lambda place: -scores[place])[:_PEAKS]
    found = []
    for place in best:
        below, here, above = scores[place - 1 : place + 2]
        bend = below - 2 * here + above
        found.append((place + (0.5 * (below - above) / bend if bend < 0 else 0.0), float(here)))
    return found


# ---- agreement -------------------------------------------------------------------------------------------------------


def _candidates(pieces: list[_Piece]) -> list[tuple[float, _Line]]:
    """Lines that the lags of pieces lie on and their support, best first, none like a better one."""
    points = [(time, lag, score) for time, found in pieces for lag, score in found]
    lines = [_line(a, b) for a, b in itertools.combinations(points, 2) if a[0] != b[0]]
    rated = sorted(((_support(line, pieces), line) for line in lines if abs(line[1]) <= _MOST_DRIFT), reverse=True)
    kept: list[tuple[float, _Line]] = []
    for support, line in rated:
        if support >= 0.4 * _ENOUGH and all(abs(line[0] - other[0]) > _LIKE_S for _, other in kept):
            kept.append((support, line))
        if len(kept) == _MOST_LINES:
            break
    return kept


def _different(clocks: list[Clock]) -> list[Clock]:
    """Without those that are like one before."""
    kept: list[Clock] = []
    for clock in clocks:
        if all(abs(clock.offset_ns - other.offset_ns) > _LIKE_S * 1e9 for other in kept):
            kept.append(clock)
    return kept[:_MOST_LINES]


def _by_rows(left: Video, right: Video, ours: Marks, theirs: Marks, fitted: list[Clock]) -> tuple[Clock, RowLag] | None:
    """The clock at which the rows vary least, where they tell."""
    found = [(clock, find_row_lag(left, right, ours, theirs, clock.right_of)) for clock in fitted]
    told = [(clock, lag) for clock, lag in found if lag is not None]
    return min(told, key=lambda item: item[1].spread_px, default=None)


def _mended(clock: Clock, lag: RowLag) -> Clock:
    """A clock with what the rows say of its offset, each by its weight; where they contradict, the rows' alone."""
    rows = float(np.hypot(lag.sigma_s, _ROWS_S))
    both = abs(lag.shift_s) < 3 * float(np.hypot(rows, clock.sigma_s))  # False where the sigma is NaN
    share = clock.sigma_s**2 / (clock.sigma_s**2 + rows**2) if both else 1.0
    offset = clock.offset_ns / 1e9 + share * lag.shift_s
    sigma = rows * float(np.sqrt(share))
    told = (
        f"right clock ahead by {offset:.3f} s at the first frame (sigma {sigma:.3f} s), found from motion and light "
        f"and from vertical error against lag ({lag.spread_px:.2f} px of it are left at 320 px width); drift "
        f"{1e3 * clock.drift:+.3f} ms/s"
    )
    return Clock(round(offset * 1e9), clock.drift, sigma, (told,))


def _by_motion(rated: list[tuple[float, _Line]], pieces: list[_Piece]) -> Clock:
    """The line that the lags of most pieces lie on.

    Raises
    ------
    BagError
        Fewer than two agree, or another line does as well.
    """
    rival = rated[1][0] if len(rated) > 1 else 0.0
    if not rated or rated[0][0] < _ENOUGH or rival > 0.8 * rated[0][0]:
        raise BagError(
            "the cameras' clocks: expected motion or light that both videos show, got "
            f"{'several offsets that fit alike' if rated and rival else 'none that agrees'}: tell how far the "
            "right camera's clock is ahead, --clock-offset SECONDS (0: started together)", Code.RECORDING_CLOCKS,
        )  # fmt: skip
    return _fitted(rated[0][1], pieces)


def _line(a: tuple[float, float, float], b: tuple[float, float, float]) -> _Line:
    slope = (b[1] - a[1]) / (b[0] - a[0])
    return a[1] - slope * a[0], slope


def _near(line: _Line, time: float, found: list[tuple[float, float]]) -> tuple[float, float] | None:
    near = [(lag, score) for lag, score in found if abs(lag - line[0] - line[1] * time) <= _AGREE_S]
    return max(near, key=lambda peak: peak[1], default=None)


def _support(line: _Line, pieces: list[_Piece]) -> float:
    return sum(peak[1] - _CHANCE for time, found in pieces if (peak := _near(line, time, found)) is not None)


def _fitted(line: _Line, pieces: list[_Piece]) -> Clock:
    kept = [(time, peak[0]) for time, found in pieces if (peak := _near(line, time, found)) is not None]
    times, lags = (np.array(column) for column in zip(*kept, strict=True))
    drifts = len(kept) >= 4 and float(np.ptp(times)) * _MOST_DRIFT > _TELLS_DRIFT_S
    design = np.stack([np.ones_like(times), times], axis=1)[:, : 1 + drifts]
    solution, *_ = np.linalg.lstsq(design, lags, rcond=None)
    if drifts and abs(solution[1]) > _MOST_DRIFT:  # no clock runs so: what is left over is larger than told
        drifts, design = False, design[:, :1]
        solution, *_ = np.linalg.lstsq(design, lags, rcond=None)
    left_over = lags - design @ solution
    sigma = float(np.sqrt((left_over**2).sum() / max(1, len(kept) - design.shape[1])))
    spread = sigma * np.sqrt(np.linalg.inv(design.T @ design)[0, 0])
    drift = float(solution[1]) if drifts else 0.0
    told = [
        f"right clock ahead by {solution[0]:.3f} s at the first frame (sigma {spread:.3f} s), found from motion and "
        f"light in {len(kept)} of {len(pieces)} pieces; drift {1e3 * drift:+.3f} ms/s"
    ]
    if spread > _KNOWN_S:
        told.append(f"the clock offset is not known well: sigma {spread:.3f} s")
    return Clock(round(float(solution[0]) * 1e9), drift, float(spread), tuple(told))
