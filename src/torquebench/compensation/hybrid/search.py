"""The settings of noise, deviation and drift over which the hybrid averages.

Settings around the noise of best evidence are averaged by their evidence. Two more are searched
only where the residuals indicate them: noise that grows with the load, and heavy tails.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import lgamma

import numpy as np

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.hybrid.inference import (
    GROWTHS,
    LEAST_NOISE,
    PLAIN_FORMS,
    Member,
    Problem,
    Setting,
)

__all__ = ["explore"]

_DEVIATIONS = (3e-5, 1.5e-4, 7e-4)
_LARGEST_DEVIATION = 4e-2
_UNLIKELY = 2.5  # settings this far below the best, in log evidence, are not refined
_FREEDOM = 4.0
_TAILED_KURTOSIS = 3.3
_TAILS_ODDS = 4.0  # prior odds where residuals indicate it: few real readings scatter normally
_TAILS_ROUNDS = 12
# threshold for the correlation of squared residual and squared load, in standard deviations
_GROWING = 1.5
# limit of a squared residual over the mean in that correlation: heavy tails aren't growth
_LARGEST_POWER = 6.0


@dataclass(frozen=True)
class _Start:
    """Start of a grid of settings."""

    member: Member
    tailed: bool = False


def explore(problem: Problem, start_noise: float) -> tuple[Problem, list[Member]]:
    """Find the noise of best evidence, then evaluate a grid of settings around it.

    Parameters
    ----------
    problem : Problem
    start_noise : float
        Start of the search, as a fraction of full scale.

    Returns
    -------
    problem : Problem
        With the candidates that matter.
    members : list of Member
        To be averaged by their evidence.
    """
    drift = problem.settings_of_drift()[: 2 if problem.drifts else 1][-1]
    coarse = problem.with_even_ripple()
    settled = coarse.settle_noise(coarse.solve(Setting(start_noise, _DEVIATIONS[1], *drift)))
    if coarse.alike().solve(settled.setting).log_evidence > settled.log_evidence:
        problem = problem.alike()
    best = problem.solve(settled.setting)
    starts = _starts(problem, best)
    problem = problem.narrowed([start.member for start in starts])
    members = [member for start in starts for member in _grid(problem, start)]
    return problem, members + _plain_members(problem, starts)


def _starts(problem: Problem, best: Member) -> list[_Start]:
    """Return the kinds of noise that the residuals indicate."""
    starts = [_Start(best)]
    if _looks_heavy_tailed(best):
        starts.append(_Start(_with_tails(problem, best), tailed=True))
    leader = max(starts, key=lambda start: _evidence(problem, start))
    if _looks_growing(problem, leader.member):
        weights = leader.member.weights / problem.load_weights(leader.member.setting.growth)
        for growth in GROWTHS:
            grown = problem.solve(replace(leader.member.setting, growth=growth), weights)
            if leader.tailed:
                starts.append(_Start(_with_tails(problem, grown), tailed=True))
            else:
                starts.append(_Start(problem.settle_noise(grown, rounds=2)))
    highest = max(_evidence(problem, start) for start in starts)
    return [start for start in starts if _evidence(problem, start) > highest - _UNLIKELY]


def _evidence(problem: Problem, start: _Start) -> float:
    if start.tailed:
        return _student_bound(problem, start.member) + float(np.log(_TAILS_ODDS))
    return start.member.log_evidence


def _grid(problem: Problem, start: _Start) -> list[Member]:
    """Solve for kinds and amplitudes of the drift, amplitudes of the deviation, and noises."""
    centre = start.member.setting
    weights = start.member.weights / problem.load_weights(centre.growth)

    def row(deviation: float, drifts: list[tuple[int, float]]) -> list[Member]:
        settings = [
            replace(centre, amplitude=deviation, drift=kind, drift_amplitude=size)
            for kind, size in drifts
        ]
        return [problem.solve(setting, weights) for setting in settings]

    members = row(_DEVIATIONS[1], problem.settings_of_drift())
    least = _best(members).log_evidence - _UNLIKELY
    likely = [m.setting for m in members if m.log_evidence > least]
    drifts = [(setting.drift, setting.drift_amplitude) for setting in likely]
    members += row(_DEVIATIONS[0], drifts) + row(_DEVIATIONS[2], drifts)
    largest = _DEVIATIONS[-1]
    while _best(members).setting.amplitude == largest < _LARGEST_DEVIATION:
        largest *= 4.0
        members += row(largest, drifts)
    best = _best(members)
    # Noise and the rest are nearly independent: its spread, found for the best of them, holds for
    # all.
    all_to_best = float(np.logaddexp.reduce([m.log_evidence for m in members])) - best.log_evidence
    step = 1.5 / np.sqrt(2 * max(problem.target.size - best.effective, 4.0))
    for factor in (np.exp(-step), np.exp(step)):
        beside = problem.solve(replace(best.setting, noise=centre.noise * float(factor)), weights)
        members.append(replace(beside, log_evidence=beside.log_evidence + all_to_best))
    if not start.tailed:
        return members
    return [replace(m, log_evidence=_evidence(problem, _Start(m, True))) for m in members]


def _plain_members(problem: Problem, starts: list[_Start]) -> list[Member]:
    """Solve for chains without any effect, deviation or drift.

    A drift beside a plain form would describe steps and loops.
    """
    members = [
        _plain_member(
            problem.plain(form),
            replace(start.member.setting, amplitude=0.0, drift=-1, drift_amplitude=0.0),
            start.tailed,
        )
        for start in starts
        for form in PLAIN_FORMS
    ]
    least = _best(members).log_evidence - _UNLIKELY
    return [member for member in members if member.log_evidence > least]


def _plain_member(problem: Problem, setting: Setting, tailed: bool) -> Member:
    if not tailed:
        return problem.settle_noise(problem.solve(setting))
    member = _with_tails(problem, problem.solve(setting))
    return replace(member, log_evidence=_evidence(problem, _Start(member, tailed=True)))


def _best(members: list[Member]) -> Member:
    return max(members, key=lambda member: member.log_evidence)


def _expected_squares(member: Member) -> FloatArray:
    """Return the posterior mean of every point's squared noise."""
    noise2 = member.point_noise
    return np.asarray(member.residual**2 + noise2 - noise2**2 * member.inverse_diagonal)


def _looks_heavy_tailed(member: Member) -> bool:
    scaled = member.residual / np.sqrt(member.point_noise)
    power = np.mean(scaled**2)
    return bool(np.mean(scaled**4) > _TAILED_KURTOSIS * power**2)


def _looks_growing(problem: Problem, member: Member) -> bool:
    power = member.weights * member.residual**2
    power = np.minimum(power, _LARGEST_POWER * np.mean(power))
    if np.ptp(power) == 0.0 or np.ptp(problem.points.u**2) == 0.0:
        return False  # nothing remains, or all points have one load
    correlation = np.corrcoef(power, problem.points.u**2)[0, 1]
    return bool(correlation * np.sqrt(power.size) > _GROWING)


def _with_tails(problem: Problem, normal: Member) -> Member:
    """Iterate the variational steps of Student noise from the normal member."""
    member, bound = normal, -np.inf
    for _ in range(_TAILS_ROUNDS):
        of_load = problem.load_weights(member.setting.growth)
        squares = problem.weights * of_load * _expected_squares(member)
        tails = (_FREEDOM + 1.0) / (_FREEDOM + squares / member.setting.noise**2)
        least = LEAST_NOISE * problem.prior_scale
        noise = max(float(np.sqrt(np.mean(tails * squares))), least)
        member = problem.solve(replace(member.setting, noise=noise), problem.weights * tails)
        before, bound = bound, _student_bound(problem, member)
        if bound - before < 0.1:
            break
    return member


def _student_bound(problem: Problem, member: Member) -> float:
    """Replace the normal likelihood in the evidence bound by Student's (Bishop, eq. 10.3)."""
    weights = problem.weights * problem.load_weights(member.setting.growth)
    scale2 = member.setting.noise**2 / weights
    squares = _expected_squares(member)
    normal = -0.5 * np.sum(np.log(member.point_noise) + squares / member.point_noise)
    shape = 0.5 * (_FREEDOM + 1.0)
    constant = 0.5 * _FREEDOM * np.log(0.5 * _FREEDOM) - lgamma(0.5 * _FREEDOM) + lgamma(shape)
    student = constant - 0.5 * np.log(scale2) - shape * np.log(0.5 * (_FREEDOM + squares / scale2))
    return float(member.log_evidence - normal + np.sum(student))
