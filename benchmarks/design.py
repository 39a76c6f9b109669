"""How many well-placed calibration points are worth 200 evenly spaced ones.

On chains with a known truth, a coarse calibration of 24 points is extended a dozen points at a
time, at the torques that `propose_points` proposes, and after every extension compared with evenly
spaced calibrations: worst and root mean square error against the truth, and the largest standard
uncertainty that the model itself states, each the median over the chains, with the recommended
model.
"""

from __future__ import annotations

import argparse
import os
import warnings
from collections.abc import Sequence

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy starts its threads

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from tests.support.chains import LOADING_ACCURACY, Chain, make_chain

from benchmarks.reporting import judge, show
from torquebench.compensation import RECOMMENDED, CompensationModel, make_model
from torquebench.compensation.design import Criterion, Proposal, propose_points

FloatArray = NDArray[np.float64]

FAMILIES = ("reference", "power-law", "skewed-hysteresis", "drifting", "kinked", "rippled")
COARSE, EVEN = 24, (50, 100, 150, 200)


def fit(chain: Chain, X: FloatArray, y: FloatArray) -> CompensationModel:
    """Fit the recommended model."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # random noise may contain outliers
        return make_model(RECOMMENDED, range_nm=chain.range_nm).fit(X, y)


def errors(chain: Chain, model: CompensationModel) -> tuple[float, float, float]:
    """Return worst and RMS error and the largest stated uncertainty, in % of full scale."""
    dense = chain.dense()
    torque, deviation = model.predict(dense.X, return_std=True)
    error = 100.0 / chain.range_nm * (torque - dense.torque_nm)
    largest = 100.0 / chain.range_nm * float(np.max(deviation))
    return float(np.max(np.abs(error))), float(np.sqrt(np.mean(error**2))), largest


def load(
    chain: Chain, proposal: Proposal, generator: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return readings and torques of proposed points, with a bench's loading error and noise."""
    missed = LOADING_ACCURACY * chain.range_nm * generator.uniform(-1, 1, proposal.branch.size)
    torque = np.clip(proposal.nominal_nm + missed, -chain.range_nm, chain.range_nm)
    torque = np.where(torque * proposal.nominal_nm < 0, -torque, torque)
    branch = proposal.branch.astype(np.float64)
    noise = chain.range_nm * chain.noise.draw(torque.size, generator)
    reading = chain.reading(torque, branch) + noise
    return np.column_stack([reading, branch, np.where(torque > 0, 1.0, 2.0)]), torque


def extend(
    chain: Chain, criterion: Criterion, step: int, most: int
) -> dict[int, tuple[float, float, float]]:
    """Extend a coarse calibration step by step; return the errors by number of points."""
    data = chain.calibration(COARSE)
    X, y = data.X, data.standard_nm
    generator = np.random.default_rng([chain.seed, 99])
    results = {}
    model = fit(chain, X, y)
    while y.size + step <= most:
        more_X, more_y = load(
            chain, propose_points(model, X, y, step, criterion=criterion), generator
        )
        X, y = np.vstack([X, more_X]), np.concatenate([y, more_y])
        model = fit(chain, X, y)
        results[y.size] = errors(chain, model)
    return results


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; return 1 unless fewer points reach the errors of 200 even points."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two chains a family, larger steps")
    parser.add_argument("--criterion", choices=("worst", "integrated"), default="worst")
    options = parser.parse_args(arguments)
    seeds, step = (range(2), 36) if options.quick else (range(10), 12)
    chains = [make_chain(family, seed) for family in FAMILIES for seed in seeds]
    collected: dict[tuple[str, int], list[tuple[float, float, float]]] = {}
    for chain in chains:
        for points in EVEN:
            data = chain.calibration(points)
            result = errors(chain, fit(chain, data.X, data.standard_nm))
            collected.setdefault(("even", points), []).append(result)
        for points, result in extend(chain, options.criterion, step, EVEN[-1]).items():
            collected.setdefault(("placed", points), []).append(result)
    median = {key: np.median(rows, axis=0) for key, rows in collected.items()}
    console = Console()
    rows = [
        [f"{points} {way}", *(f"{value:.4f}" for value in row)]
        for (way, points), row in sorted(median.items())
    ]
    title = f"{len(chains)} chains, {RECOMMENDED} model, medians in % FS"
    show(console, title, ["points", "worst error", "RMS error", "largest u of the model"], rows)
    goal = median["even", EVEN[-1]]
    placed = {points: row for (way, points), row in median.items() if way == "placed"}
    reached = [points for points, row in placed.items() if np.all(row <= goal)]
    figures = {"points that do what 200 even ones do": min(reached, default=np.inf)}
    return int(not judge(console, "design", figures)[1])
