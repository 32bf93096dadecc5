"""How two cameras' clocks stand by what both heard: claps, knocks, bubbles, voices.

Of each sound track the onsets are taken (where the energy of a band rises), and the lag is looked for at which both
tracks' onsets go together. One event alone may be chance, so at least a few have to agree.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.ndimage import gaussian_filter1d

from uw_recon_ros.files.video_packets import library
from uw_recon_ros.types import Matrix

_RATE_HZ = 8000
_HOP_S = 0.005
_BANDS_HZ = ((150, 600), (600, 1500), (1500, 3800))
_LONGEST_S = 900.0  # of sound that is listened to
_SHORTEST_S = 5.0
_CLIP = 6.0  # spreads beyond which an onset is no louder: none outvotes all others
_SURE = 8.0  # standard deviations of all other lags that the best has to reach
_RIVAL = 0.7  # of the best: what another lag may reach
_ASIDE_S = 0.3  # lags that are no other
_ONE_EVENT = 0.5  # share of the agreement that one quarter of a second may have
_SYNC_S = 0.01  # sound against picture within one file
_DRIFT_S = 60.0  # a recording so long tells a drift
_PIECES = 8
_PIECE_S = 20.0
_BLUR = 2.0  # samples of the onsets: what a drift of a thousandth makes over half a piece
_MOST_DRIFT = 2e-3


@dataclass(frozen=True)
class SoundLag:
    """What the sound says of the right clock.

    Parameters
    ----------
    offset_s : float
        What it is ahead by at the left video's first frame.
    sigma_s : float
    drift : float
        s a second; 0 where it was not looked for.
    """

    offset_s: float
    sigma_s: float
    drift: float = 0.0


def has_sound(path: Path) -> bool:
    """Whether a video has a sound track."""
    try:
        with library().open(str(path)) as file:
            return bool(file.streams.audio)
    except Exception:  # a file of strangers; what it is worth is seen when it is decoded
        return False


def find_sound_lag(left: Path, right: Path, reach_s: float) -> SoundLag | None:
    """The lag at which both tracks' onsets go together.

    Parameters
    ----------
    left, right : path
        Videos with sound.
    reach_s : float
        How far the clocks may be apart, s.

    Returns
    -------
    SoundLag or None
        None: no lag is clearly better than all others.
    """
    ours, theirs = onsets(left), onsets(right)
    if min(len(ours), len(theirs)) * _HOP_S < _SHORTEST_S:
        return None
    seconds, sigma = len(ours) * _HOP_S, float(np.hypot(_HOP_S / 2, _SYNC_S))
    if seconds >= _DRIFT_S:
        return _drifting(ours, theirs, reach_s, sigma)
    whole = _lag(ours, theirs, reach_s)
    return None if whole is None else SoundLag(whole, sigma)


def _drifting(ours: Matrix, theirs: Matrix, reach_s: float, sigma: float) -> SoundLag | None:
    """The line that the lags of most pieces of the left track lie on: pieces so short that a drift blurs none."""
    length, found = round(_PIECE_S / _HOP_S), list[tuple[float, float]]()
    for begin in np.linspace(0, len(ours) - length, _PIECES).astype(int):
        lag = _lag(ours[begin : begin + length], theirs, reach_s, int(begin))
        if lag is not None:
            found.append(((begin + length / 2) * _HOP_S, lag))
    if not found:
        return None
    times, lags = np.array(found).T
    near = np.abs(lags - np.median(lags)) <= _ASIDE_S
    if near.sum() < max(2, len(lags) / 2):
        return None
    drift, offset = np.polyfit(times[near], lags[near], 1) if near.sum() > 2 else (0.0, float(np.median(lags[near])))
    return SoundLag(float(offset), sigma, float(drift)) if abs(drift) <= _MOST_DRIFT else None


def onsets(path: Path) -> Matrix:
    """(N, 3) rises of energy in each band, by spreads, every 5 ms from the first frame of the picture on."""
    samples, begin_s = _samples(path)
    hop = int(_HOP_S * _RATE_HZ)
    if len(samples) < 4 * hop:
        return np.zeros((0, len(_BANDS_HZ)))
    bands = []
    for low, high in _BANDS_HZ:
        sections = signal.butter(2, (low, high), "bandpass", fs=_RATE_HZ, output="sos")
        power = signal.sosfilt(sections, samples).astype(np.float32) ** 2
        energy = np.log(power[: len(power) // hop * hop].reshape(-1, hop).mean(axis=1) + 1e-9)
        rise = np.maximum(np.diff(energy, prepend=energy[0]), 0)
        bands.append(_standard(rise))
    found = gaussian_filter1d(np.stack(bands, axis=1), _BLUR, axis=0)
    shift = round(begin_s / _HOP_S)
    quiet = np.zeros((max(shift, 0), found.shape[1]))
    whole: Matrix = np.concatenate([quiet, found[max(-shift, 0) :]])
    return whole


def _standard(rise: Matrix) -> Matrix:
    """About zero, by its spread, loud ones cut."""
    spread = max(float(rise.std()), 1e-6)
    cut = np.minimum(rise / spread, _CLIP)
    centred: Matrix = cut - cut.mean()
    return centred


def _samples(path: Path) -> tuple[NDArray[np.float32], float]:
    """Mono sound at 8 kHz, and when it begins, s after the first frame of the picture; none where it is damaged."""
    av = library()
    pieces: list[NDArray[np.float32]] = []
    begin: float | None = None
    try:
        with av.open(str(path)) as file:
            track, picture = file.streams.audio[0], file.streams.video[0]
            first = float((picture.start_time or 0) * picture.time_base)
            resampler = av.AudioResampler(format="flt", layout="mono", rate=_RATE_HZ)
            for frame in _decoded(file, track, av):
                if begin is None:
                    begin = float(frame.time or 0.0) - first
                pieces += [piece.to_ndarray().ravel() for piece in resampler.resample(frame)]
                heard = float(frame.time or 0.0) - first
                if heard > _LONGEST_S:
                    break
    except Exception:  # sound is only a help: what cannot be decoded tells nothing
        pass
    return (np.concatenate(pieces) if pieces else np.zeros(0, np.float32)), begin or 0.0


def _decoded(file: Any, track: Any, av: Any) -> Any:
    try:
        yield from file.decode(track)
    except av.FFmpegError:  # cut short: what came before counts
        return


def _lag(ours: Matrix, theirs: Matrix, reach_s: float, begin: int = 0) -> float | None:
    """Right time less left time, s, where one lag is clearly the best; `begin`: where ours begins."""
    bands = [signal.correlate(a, b, mode="full", method="fft") for a, b in zip(theirs.T, ours.T, strict=True)]
    agreement = np.sum(bands, axis=0)
    places = np.arange(len(agreement)) - (len(ours) - 1)
    lags = (places - begin) * _HOP_S
    within = np.flatnonzero(np.abs(lags) <= reach_s)
    if len(within) < 10:
        return None
    overlap = np.minimum(len(ours), np.minimum(len(theirs) - places, len(ours) + places)).clip(1)
    enough = overlap[within] * _HOP_S >= min(_SHORTEST_S, len(ours) * _HOP_S / 2)
    within = within[enough]
    scores = agreement[within] / np.sqrt(overlap[within])
    best = int(np.argmax(scores))
    others = scores[np.abs(lags[within] - lags[within[best]]) > _ASIDE_S]
    if len(others) < 10 or scores[best] < _SURE * float(others.std()) + float(others.mean()):
        return None
    if others.max() > _RIVAL * scores[best] or _one_event(ours, theirs, int(places[within[best]])):
        return None
    return float(lags[within[best]] + _between(scores, best) * _HOP_S)


def _between(scores: Matrix, best: int) -> float:
    if not 0 < best < len(scores) - 1:
        return 0.0
    below, here, above = scores[best - 1 : best + 2]
    bend = below - 2 * here + above
    return float(0.5 * (below - above) / bend) if bend < 0 else 0.0


def _one_event(ours: Matrix, theirs: Matrix, place: int) -> bool:
    """Whether a quarter of a second makes most of the agreement."""
    first, second = max(0, -place), max(0, place)
    length = min(len(ours) - first, len(theirs) - second)
    product = (ours[first : first + length] * theirs[second : second + length]).sum(axis=1)
    block = round(0.25 / _HOP_S)
    summed = np.convolve(product, np.ones(block), mode="same")
    return bool(summed.max() > _ONE_EVENT * product.sum())
