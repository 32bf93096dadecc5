"""How far a disparity map is from the truth, counted as the Middlebury benchmark counts."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from uw_recon_ros.types import FloatImage, Mask

THRESHOLDS = (0.5, 1.0, 2.0, 4.0)


@dataclass(frozen=True)
class Errors:
    """Errors over one set of pixels.

    Parameters
    ----------
    bad_percent : dict of str to float
        ``bad-x``: share of pixels with an error over x px, %.
    rms_px, median_px : float
        Root mean square and median of the absolute error, px.
    pixels : int
        How many were counted.
    """

    bad_percent: dict[str, float]
    rms_px: float
    median_px: float
    pixels: int


@dataclass(frozen=True)
class Evaluation:
    """Result of `evaluate`.

    Parameters
    ----------
    density_percent : float
        Share of counted pixels with an estimate, %.
    unfilled : Errors
        Over the pixels that have an estimate.
    filled : Errors
        Over all counted pixels, holes filled by `fill_rows`.
    """

    density_percent: float
    unfilled: Errors
    filled: Errors

    def as_dict(self) -> dict[str, object]:
        """As nested dictionaries, for JSON."""
        return asdict(self)


def fill_rows(disparity: FloatImage) -> FloatImage:
    """Give each invalid pixel the smaller of its nearest valid neighbours left and right on its row.

    Parameters
    ----------
    disparity : (H, W) float32
        NaN = invalid.

    Returns
    -------
    (H, W) float32
        NaN only in rows without any valid pixel.
    """
    valid = np.isfinite(disparity)
    columns = np.arange(disparity.shape[1])
    rows = np.arange(disparity.shape[0])[:, None]
    left = np.maximum.accumulate(np.where(valid, columns, -1), axis=1)
    right = np.minimum.accumulate(np.where(valid, columns, columns.size)[:, ::-1], axis=1)[:, ::-1]
    from_left = np.where(left >= 0, disparity[rows, left.clip(0)], np.inf)
    from_right = np.where(right < columns.size, disparity[rows, right.clip(max=columns.size - 1)], np.inf)
    nearest = np.minimum(from_left, from_right)
    filled: FloatImage = np.where(valid, disparity, np.where(np.isfinite(nearest), nearest, np.nan)).astype(np.float32)
    return filled


def _errors(error: FloatImage) -> Errors:
    if not error.size:
        nan = float("nan")
        return Errors({f"bad-{x:g}": nan for x in THRESHOLDS}, nan, nan, 0)
    # A pixel that could not even be filled counts as wrong by any measure.
    size = np.abs(np.nan_to_num(error.astype(np.float64), nan=np.inf))
    bad = {f"bad-{x:g}": float(100 * (size > x).mean()) for x in THRESHOLDS}
    return Errors(bad, float(np.sqrt((size**2).mean())), float(np.median(size)), int(size.size))


def evaluate(estimate: FloatImage, truth: FloatImage, mask: Mask | None = None) -> Evaluation:
    """Compare a disparity map with the truth.

    Parameters
    ----------
    estimate, truth : (H, W) float32
        px; not finite = invalid, or truth unknown.
    mask : (H, W) bool, optional
        Pixels to count; all where the truth is known by default.

    Raises
    ------
    ValueError
        Shapes differ, or nothing is left to count.
    """
    if estimate.shape != truth.shape or (mask is not None and mask.shape != truth.shape):
        shapes = [a.shape for a in (estimate, truth, mask) if a is not None]
        raise ValueError(f"estimate, truth and mask: expected one shape, got {shapes}")
    counted = np.isfinite(truth) if mask is None else np.isfinite(truth) & mask
    if not counted.any():
        raise ValueError("mask: expected at least one pixel with known truth, got none")
    estimate = np.where(np.isfinite(estimate), estimate, np.float32(np.nan)).astype(np.float32)
    valid = counted & np.isfinite(estimate)
    return Evaluation(
        density_percent=float(100 * valid.sum() / counted.sum()),
        unfilled=_errors(estimate[valid] - truth[valid]),
        filled=_errors(fill_rows(estimate)[counted] - truth[counted]),
    )


def as_table(result: Evaluation) -> str:
    """The numbers as a text table."""
    names = [f"bad-{x:g}" for x in THRESHOLDS]
    lines = ["          " + "".join(f"{n:>9}" for n in names) + "      RMS   median   pixels"]
    for label, errors in (("unfilled", result.unfilled), ("filled", result.filled)):
        bad = "".join(f"{errors.bad_percent[n]:8.2f}%" for n in names)
        lines.append(f"{label:10}{bad} {errors.rms_px:8.3f} {errors.median_px:8.3f} {errors.pixels:8d}")
    return "\n".join([*lines, f"density   {result.density_percent:8.2f}%"])
