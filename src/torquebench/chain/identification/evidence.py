"""Linear model with blocks of columns; their scales follow from the evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from torquebench.chain.readings import FloatArray
from torquebench.compensation.base import single_blas_thread

_BOUND = 3.0
_STEP = 0.05
_ROUNDING = 1e-13
_LARGEST = 1.5


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations of rows that have a common noise.

    Parameters
    ----------
    matrix, vector : float64 array of shape (p, p), (p,)
        Products of the columns with each other, and with the target.
    square : float
        Sum of squares of the target.
    rows : float
        Effective number of independent rows.
    """

    matrix: FloatArray
    vector: FloatArray
    square: float
    rows: float

    @classmethod
    def of(cls, columns: FloatArray, target: FloatArray) -> Normal:
        """Return the normal equations of rows."""
        return cls(columns.T @ columns, columns.T @ target, float(target @ target), target.size)

    def widened(self, columns: FloatArray, more: FloatArray, target: FloatArray) -> Normal:
        """Return the normal equations of the same rows with additional columns."""
        across = columns.T @ more
        return Normal(
            np.block([[self.matrix, across], [across.T, more.T @ more]]),
            np.concatenate([self.vector, more.T @ target]),
            self.square,
            self.rows,
        )

    def __add__(self, other: Normal) -> Normal:
        return Normal(
            self.matrix + other.matrix,
            self.vector + other.vector,
            self.square + other.square,
            self.rows + other.rows,
        )

    def thinned(self, by: float) -> Normal:
        """Return the normal equations with only every `by`-th row counted as independent."""
        return Normal(self.matrix / by, self.vector / by, self.square / by, self.rows / by)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Weights of all columns at the most probable scales and at neighbouring scales.

    Parameters
    ----------
    mean : float64 array of shape (p,)
    covariance : float64 array of shape (p, p)
    shifts : float64 array of shape (m, p)
        Change of the mean by one standard deviation along each axis of the scales' posterior.
    spreads : list of float64 array of shape (p, p)
        Mean of the covariances at both ends of each axis.
    noise : float64 array of shape (g,)
        Standard deviation of the rows of each group.
    theta : float64 array
        Logarithms of scales and noise.
    """

    mean: FloatArray
    covariance: FloatArray
    shifts: FloatArray
    spreads: list[FloatArray]
    noise: FloatArray
    log_evidence: float
    theta: FloatArray

    def at(self, columns: FloatArray, members: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        """Return value and standard uncertainty of a function of some columns.

        Parameters
        ----------
        columns : float64 array of shape (n, k)
        members : int array of shape (k,)
            Indices of the weights of these columns.
        """
        chosen = np.ix_(members, members)

        def variance(matrix: FloatArray) -> FloatArray:
            return np.asarray(np.einsum("ij,ij->i", columns @ matrix[chosen], columns))

        plain = variance(self.covariance)
        total = plain + np.sum((columns @ self.shifts[:, members].T) ** 2, axis=1)
        for spread in self.spreads:
            total += np.maximum(variance(spread) - plain, 0.0)
        return columns @ self.mean[members], np.sqrt(np.maximum(total, 0.0))


def explore(
    groups: Sequence[Normal],
    sizes: Sequence[int],
    centres: FloatArray,
    widths: FloatArray,
    start: FloatArray | None = None,
    *,
    doubtful: bool = True,
) -> Posterior:
    """Find the scales of the blocks, the noise of the groups, and the weights.

    Parameters
    ----------
    groups : sequence of Normal
        Rows, grouped by their noise.
    sizes : sequence of int
        Columns of each block, in order.
    centres, widths : float64 array of shape (blocks + groups,)
        Prior mean and standard deviation of the logarithms of scales and noise.
    start : float64 array, optional
        Start values of these logarithms.
    doubtful : bool
        Whether to average over scales around the most probable ones.
    """
    from scipy.optimize import minimize  # imported late: only empty runs need SciPy's optimiser

    owner = np.repeat(np.arange(len(sizes)), sizes)
    problem = _Problem(tuple(groups), owner, centres, widths)
    with single_blas_thread():
        result = minimize(
            problem.loss,
            centres if start is None else start,
            jac=True,
            method="L-BFGS-B",
            bounds=[(c - _BOUND * w, c + _BOUND * w) for c, w in zip(centres, widths, strict=True)],
            options={"maxiter": 200},
        )
        theta = result.x
        mean, covariance, _ = problem.solve(theta)
        shifts, spreads = [], []
        if doubtful:
            for axis in problem.axes(theta):
                above, below = problem.solve(theta + axis), problem.solve(theta - axis)
                shifts.append(0.5 * (above[0] - below[0]))
                spreads.append(0.5 * (above[1] + below[1]))
    return Posterior(
        mean,
        covariance,
        np.array(shifts).reshape(-1, mean.size),
        spreads,
        np.exp(theta[len(sizes) :]),
        -float(result.fun),
        theta,
    )


def gain(
    groups: Sequence[Normal],
    sizes: Sequence[int],
    prior: tuple[FloatArray, FloatArray],
    fit: Posterior,
    scale: float,
) -> float:
    """Return the gain in log evidence by an additional last block.

    Parameters
    ----------
    groups, sizes
        As for `explore`, the additional block included.
    prior : tuple of float64 array
        Centres and widths without the block.
    fit : Posterior
        Posterior without the block; its scales aren't changed.
    scale : float
        Logarithm of the block's scale.
    """
    owner = np.repeat(np.arange(len(sizes)), sizes)
    at = len(sizes) - 1
    centres, widths = np.insert(prior[0], at, scale), np.insert(prior[1], at, 1.5)
    problem = _Problem(tuple(groups), owner, centres, widths)
    with single_blas_thread():
        return -problem.loss(np.insert(fit.theta, at, scale))[0] - fit.log_evidence


@dataclass(frozen=True, eq=False)
class _Problem:
    groups: tuple[Normal, ...]
    owner: NDArray[np.intp]
    centres: FloatArray
    widths: FloatArray

    @property
    def _blocks(self) -> int:
        return self.centres.size - len(self.groups)

    def solve(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Return mean and covariance of the weights, and half the log determinant."""
        scale = np.exp(theta[self.owner])
        precision = np.exp(-2.0 * theta[self._blocks :])
        matrix = sum(w * g.matrix for w, g in zip(precision, self.groups, strict=True))
        vector = sum(w * g.vector for w, g in zip(precision, self.groups, strict=True))
        scaled = scale[:, None] * matrix * scale
        scaled[np.diag_indices_from(scaled)] += 1.0 + _ROUNDING * float(np.max(np.diag(scaled)))
        factor = cho_factor(scaled, lower=True, check_finite=False)
        inverse = cho_solve(factor, np.eye(scale.size), check_finite=False)
        covariance = scale[:, None] * inverse * scale
        return covariance @ vector, covariance, float(np.sum(np.log(np.diag(factor[0]))))

    def loss(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Return the negative log posterior of scales and noise, and its gradient."""
        mean, covariance, half_determinant = self.solve(theta)
        value, gradient = half_determinant, np.zeros(theta.size)
        second = mean**2 + np.diag(covariance)
        for block in range(self._blocks):
            own = self.owner == block
            gradient[block] = np.sum(own) - np.sum(second[own]) * np.exp(-2.0 * theta[block])
        for number, group in enumerate(self.groups, self._blocks):
            precision = np.exp(-2.0 * theta[number])
            residual = group.square - 2.0 * mean @ group.vector + mean @ group.matrix @ mean
            value += group.rows * theta[number] + 0.5 * precision * residual
            spread = np.sum(covariance * group.matrix)
            gradient[number] = group.rows - precision * (residual + spread)
        value += 0.5 * np.sum(mean**2 * np.exp(-2.0 * theta[self.owner]))
        deviation = (theta - self.centres) / self.widths
        value += 0.5 * float(deviation @ deviation)
        return float(value), gradient + deviation / self.widths

    def axes(self, theta: FloatArray) -> list[FloatArray]:
        """Return one standard deviation along each axis of the posterior of scales and noise."""
        curvature = np.empty((theta.size, theta.size))
        for number in range(theta.size):
            step = np.zeros(theta.size)
            step[number] = _STEP
            change = self.loss(theta + step)[1] - self.loss(theta - step)[1]
            curvature[number] = change / (2.0 * _STEP)
        values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T))
        lengths = np.minimum(1.0 / np.sqrt(np.maximum(values, 1e-3)), _LARGEST)
        return [length * vector for length, vector in zip(lengths, vectors.T, strict=True)]
