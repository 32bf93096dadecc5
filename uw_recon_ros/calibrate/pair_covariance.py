"""Covariance of a solution whose points do not err independently: those of one pair err alike.

A board that is not quite flat, rays that do not quite meet behind a port, cameras that were not quite triggered
together: they move all points of a pair by much the same. What the points' own noise says of the solution is then too
good, by as much as the points of a pair agree. So the spread is taken from whole pairs.
Sources: Bell, McCaffrey: Bias reduction in standard errors for linear regression with multi-stage samples (2002), which
makes up for residuals that are small because the pair took part in the fit; Ledoit, Wolf: A well-conditioned estimator
for large-dimensional covariance matrices (2004), which holds what few pairs say of many numbers.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from uw_recon_ros.types import Matrix

_LARGEST_SHARE = 0.95  # of what is known of a number, from one pair: beyond, its residuals tell nothing


def _inverse_root(information: Matrix) -> Matrix:
    """(n, n) R with R R^T the inverse of a symmetric matrix whose rows have very different units; what is not
    determined becomes very large."""
    scale = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(scale[:, None] * information * scale)
    root: Matrix = scale[:, None] * vectors / np.sqrt(np.maximum(values, 1e-14))
    return root


def pair_covariance(parts: Sequence[Matrix], pulls: Sequence[Matrix], prior: Matrix, noise: float) -> Matrix:
    """Covariance of numbers found from pairs.

    Parameters
    ----------
    parts : sequence of (n, n) float64
        What each pair tells of the numbers, its pose eliminated: information times the squared noise.
    pulls : sequence of (n,) float64
        By how much each pair pulls at the solution, in the same units: they add up to what the prior pulls back.
    prior : (n, n) float64
        Information known beforehand, in the same units.
    noise : float
        Standard deviation of a coordinate, px.

    Returns
    -------
    (n, n) float64
        Where points err independently, that of `noise` alone, but for chance.
    """
    root = _inverse_root(prior + np.sum(parts, axis=0))
    shares = [root.T @ part @ root for part in parts]
    moves = np.array([_made_up_for(share, root.T @ pull) for share, pull in zip(shares, pulls, strict=True)])
    of_pairs = _shrunk(moves, np.sum(shares, axis=0))
    covariance: Matrix = root @ (of_pairs + noise**2 * (root.T @ prior @ root)) @ root.T
    return covariance


def _made_up_for(share: Matrix, pull: Matrix) -> Matrix:
    """A pair's pull as large as it would be had the pair not drawn the solution towards itself."""
    values, vectors = np.linalg.eigh(share)
    left = np.sqrt(1 - np.clip(values, 0.0, _LARGEST_SHARE))
    move: Matrix = vectors @ ((vectors.T @ pull) / left)
    return move


def _shrunk(moves: Matrix, expected: Matrix) -> Matrix:
    """Sum of the squares of moves (P, n), drawn towards a multiple of what independent points would give."""
    found = moves.T @ moves
    target: Matrix = np.trace(found) / np.trace(expected) * expected
    aside = float(((found - target) ** 2).sum())
    by_chance = float(np.mean([((len(moves) * np.outer(move, move) - found) ** 2).sum() for move in moves]))
    share = min(1.0, by_chance / len(moves) / max(aside, 1e-300))
    shrunk: Matrix = share * target + (1 - share) * found
    return shrunk
