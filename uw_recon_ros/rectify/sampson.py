"""The Sampson error (paper eq. 13): to first order, how far a match lies from its epipolar lines."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from uw_recon_ros.types import Matrix


def homogeneous(points: Matrix) -> Matrix:
    """Append a 1 to each of (N, 2) points."""
    return np.column_stack([points, np.ones(len(points))])


def _terms(fundamental: Matrix, left: Matrix, right: Matrix) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Algebraic error, squared norm of its gradient, and both epipolar lines of homogeneous matches."""
    lines_right, lines_left = left @ fundamental.T, right @ fundamental
    algebraic = np.einsum("ni,ni->n", right, lines_right)
    gradient = np.square(lines_right[:, :2]).sum(axis=1) + np.square(lines_left[:, :2]).sum(axis=1)
    return algebraic, np.maximum(gradient, np.finfo(np.float64).tiny), lines_right, lines_left


def sampson_residuals(fundamental: Matrix, left: Matrix, right: Matrix) -> Matrix:
    """Signed Sampson distances of homogeneous matches; the private half of `sampson_distance`."""
    algebraic, gradient, _, _ = _terms(fundamental, left, right)
    return algebraic / np.sqrt(gradient)


def sampson_jacobian(fundamental: Matrix, left: Matrix, right: Matrix) -> Matrix:
    """Derivative of `sampson_residuals` by the nine entries of the fundamental matrix.

    Returns
    -------
    (N, 9) float64
        Columns in the order of ``fundamental.ravel()``.
    """
    algebraic, gradient, lines_right, lines_left = _terms(fundamental, left, right)
    first_two = np.array([1.0, 1.0, 0.0])
    outer = right[:, :, None] * left[:, None, :]
    half_gradient = (lines_right * first_two)[:, :, None] * left[:, None, :]
    half_gradient += right[:, :, None] * (lines_left * first_two)[:, None, :]
    slope = outer - (algebraic / gradient)[:, None, None] * half_gradient
    jacobian: Matrix = (slope / np.sqrt(gradient)[:, None, None]).reshape(len(left), 9)
    return jacobian


def sampson_distance(fundamental: ArrayLike, left: ArrayLike, right: ArrayLike) -> Matrix:
    """Signed Sampson distance of matches from an epipolar geometry.

    Parameters
    ----------
    fundamental : (3, 3)
        ``x_right^T F x_left = 0``, for points in px; any scale.
    left, right : (N, 2)
        Matching points, px.

    Returns
    -------
    (N,) float64
        px; the sign tells the side.

    Raises
    ------
    ValueError
        For other shapes.
    """
    matrix, points = np.asarray(fundamental, np.float64), [np.asarray(p, np.float64) for p in (left, right)]
    if matrix.shape != (3, 3):
        raise ValueError(f"fundamental: expected shape (3, 3), got {matrix.shape}")
    if points[0].shape != points[1].shape or points[0].ndim != 2 or points[0].shape[1] != 2:
        raise ValueError(f"left, right: expected shapes (N, 2), got {points[0].shape} and {points[1].shape}")
    return sampson_residuals(matrix, homogeneous(points[0]), homogeneous(points[1]))


def sampson_error(fundamental: ArrayLike, left: ArrayLike, right: ArrayLike) -> Matrix:
    """Squared Sampson error, paper eq. 13, px^2; see `sampson_distance`."""
    return np.square(sampson_distance(fundamental, left, right))
