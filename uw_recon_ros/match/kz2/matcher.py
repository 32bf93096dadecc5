"""The reference matcher: graph cuts with occlusions after Kolmogorov and Zabih (2002), "kz2" for short.

The paper's own, and the oracle for everything faster. `energy` defines what it minimises.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from uw_recon_ros.match.kz2.constants import Constants, automatic_occlusion_cost, make_constants
from uw_recon_ros.match.kz2.data_cost import make_interval_image
from uw_recon_ros.match.kz2.energy import OCCLUDED, Labels
from uw_recon_ros.match.kz2.expansion import Expansion
from uw_recon_ros.types import ByteImage, FloatImage, Mask

SMOOTHNESS_OF_OCCLUSION = 0.2  #: lambda / K, where lambda is not given
_WIDEST = 16384  # px: labels are 16-bit integers
_DEAREST = 1e4  # squared gray levels: capacities are 32-bit integers


@dataclass(frozen=True, eq=False)
class Kz2Result:
    """What `kz2` found.

    Parameters
    ----------
    labels : (H, W) int16
        Disparities of the left pixels, px; `energy.OCCLUDED` = no match.
    constants : Constants
        Of the energy, with their common denominator.
    energies : tuple of int
        After each sweep, multiplied by the denominator.
    """

    labels: Labels
    constants: Constants
    energies: tuple[int, ...]

    @property
    def energy(self) -> int:
        """Of the result, multiplied by ``constants.denominator``."""
        return self.energies[-1] if self.energies else 0

    @property
    def occluded(self) -> Mask:
        """(H, W) bool: left pixels without a match."""
        return np.asarray(self.labels == OCCLUDED)

    @property
    def disparity(self) -> FloatImage:
        """(H, W) float32, left view, px; NaN = no match."""
        return _as_float(self.labels)

    @property
    def disparity_right(self) -> FloatImage:
        """(H, W) float32, right view, px; NaN = no match. The same matches as in `disparity`: they are unique."""
        right = np.full_like(self.labels, OCCLUDED)
        rows, columns = np.nonzero(~self.occluded)
        labels = self.labels[rows, columns]
        right[rows, columns - labels] = labels
        return _as_float(right)


def _as_float(labels: Labels) -> FloatImage:
    return np.where(labels == OCCLUDED, np.nan, labels).astype(np.float32)


def kz2(
    left: ByteImage,
    right: ByteImage,
    min_disparity: int,
    max_disparity: int,
    *,
    sweeps: int = 4,
    seed: int = 0,
    occlusion_cost: float = 0.0,
    smoothness: float = 0.0,
    threads: int = 1,
) -> Kz2Result:
    """Match a rectified pair by alpha-expansions over all labels, in random order, sweep after sweep.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8
        Mono or RGB, rows of one matching rows of the other.
    min_disparity, max_disparity : int
        Labels, inclusive, px; d = u_left - u_right.
    sweeps : int
        At most so many; fewer when one changes nothing.
    seed : int
        Of the order of the labels.
    occlusion_cost, smoothness : float
        K and lambda, squared gray levels (lambda_1 = 3 lambda, lambda_2 = lambda); 0: from the images.
    threads : int
        They share the work; the result does not depend on their number.

    Returns
    -------
    Kz2Result

    Raises
    ------
    ValueError
        Images of different shape or not uint8, an empty range, numbers out of range.

    References
    ----------
    V. Kolmogorov and R. Zabih, "Computing visual correspondence with occlusions using graph cuts", ICCV 2001;
    "Multi-camera scene reconstruction via graph cuts", ECCV 2002.
    """
    _check_images(left, right)
    _check_numbers(min_disparity, max_disparity, sweeps, occlusion_cost, smoothness, threads)
    left_view, right_view = make_interval_image(left), make_interval_image(right)
    if occlusion_cost == 0:
        occlusion_cost = automatic_occlusion_cost(left_view, right_view, min_disparity, max_disparity)
    constants = make_constants(occlusion_cost, smoothness or SMOOTHNESS_OF_OCCLUSION * occlusion_cost)
    expansion = Expansion(left_view, right_view, min_disparity, max_disparity, constants, threads)
    energies: list[int] = []
    order = np.random.RandomState(seed)  # its numbers stay the same in every numpy
    with ThreadPoolExecutor(threads) as executor:
        for _ in range(sweeps):
            falls = [expansion.expand(alpha, executor) for alpha in _labels(order, min_disparity, max_disparity)]
            energies.append(expansion.energy)
            if not any(falls):
                break
    return Kz2Result(expansion.labels, constants, tuple(energies))


def _labels(order: np.random.RandomState, min_disparity: int, max_disparity: int) -> list[int]:
    labels: list[int] = (min_disparity + order.permutation(max_disparity - min_disparity + 1)).tolist()
    return labels


def _check_images(left: ByteImage, right: ByteImage) -> None:
    if left.shape != right.shape:
        raise ValueError(f"right: expected the left image's shape {left.shape}, got {right.shape}")
    if left.dtype != np.uint8 or right.dtype != np.uint8:
        raise ValueError(f"left, right: expected uint8, got {left.dtype}, {right.dtype}")
    if left.ndim not in (2, 3) or (left.ndim == 3 and left.shape[2] != 3) or left.size == 0:
        raise ValueError(f"left, right: expected (H, W) or (H, W, 3), got {left.shape}")


def _check_numbers(
    min_disparity: int, max_disparity: int, sweeps: int, occlusion_cost: float, smoothness: float, threads: int
) -> None:
    if not -_WIDEST <= min_disparity <= max_disparity <= _WIDEST:
        raise ValueError(
            f"min_disparity, max_disparity: expected an ascending range within {_WIDEST} px of zero,"
            f" got {min_disparity} to {max_disparity}"
        )
    for name, count in (("sweeps", sweeps), ("threads", threads)):
        if count < 1:
            raise ValueError(f"{name}: expected at least 1, got {count}")
    for name, cost in (("occlusion_cost", occlusion_cost), ("smoothness", smoothness)):
        if not 0 <= cost <= _DEAREST:
            raise ValueError(f"{name}: expected 0 to {_DEAREST:g}, got {cost}")
