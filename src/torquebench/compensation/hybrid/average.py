"""Average over the possible structures of a chain, weighted by their evidence."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.hybrid.member import Layout, Member, Problem, Structure, Weighting
from torquebench.units import TURN

_WHOLE = Structure("odd", ("lag", "loop", "offset", "sides", "smooth", "step"))
STRUCTURES = (
    _WHOLE,
    replace(_WHOLE, growing=True),
    _WHOLE.with_parts("ripple"),
    replace(_WHOLE.with_parts("ripple"), growing=True),
    _WHOLE.with_parts("ripple", "rough"),
    _WHOLE.with_parts("rough", "branch"),
    replace(_WHOLE.with_parts("ripple", "rough", "branch"), growing=True),
)
"""Structures of chains whose directions differ."""
_ALIKE = Structure("cubic", ("lag", "loop", "offset", "step"))
ALIKE = (_ALIKE, _ALIKE.with_parts("ripple"))
"""Structures of chains whose directions have the same trend, because the same parts carry the
torque."""
PLAIN = (
    Structure("line", ("offset",)),
    Structure("quadratic", ("offset",)),
    Structure("cubic", ("offset",)),
    Structure("odd", ("offset", "sides")),
)
"""Plain forms of the source papers, without any other part."""
_PLAIN_CHANCE, _ALIKE_CHANCE = 0.1, 0.15
_GROWING_CHANCE = 0.3  # if a plain form's noise grows
_DRIFT_CHANCE, _TAILED_CHANCE = 0.5, 0.4
_LIKELIEST = 4  # structures that are also tried with a drift and with heavy tails
_TAILS_LAG = 1.0  # log evidence by which the best member with tails may be below the best without
_FREQUENCIES = np.arange(2.0, 14.0, 0.1)  # cycles per full scale
_HIGHEST_FREQUENCY = 0.1875  # cycles per point
_APART = 0.5  # between the frequencies of two starts
_KEPT_SHARE = 0.01
_UNLIKELY = -float(np.log(_KEPT_SHARE))  # log evidence below the best of a member that isn't kept


class _Average:
    """Members and their prior probabilities."""

    def __init__(self, problem: Problem, weights: FloatArray) -> None:
        self.problem, self.weighting = problem, Weighting(weights, weights)
        self.members: dict[Structure, Member] = {}
        self.log_prior: dict[Structure, float] = {}

    def score(self, member: Member) -> float:
        """Return the log posterior probability of a member, up to a constant."""
        return member.log_evidence + self.log_prior[member.structure]

    @property
    def best(self) -> Member:
        return max(self.members.values(), key=self.score)

    def likeliest(self, structures: Iterable[Structure]) -> list[Structure]:
        """Return the structures with the highest scores."""
        by_score = sorted(structures, key=lambda each: -self.score(self.members[each]))
        return by_score[:_LIKELIEST]

    def add(self, structure: Structure, chance: float, parent: Member | None = None) -> Member:
        """Fit a structure, starting from another member's hyperparameters if there is one."""
        layout = Layout(structure, self.problem.parts)
        starts = [None] if parent is None else self._starts(layout, parent)
        fits = [Member.fitted(self.problem, layout, self.weighting, start) for start in starts]
        member = max(fits, key=lambda fit: fit.log_posterior)
        self.log_prior[structure] = float(np.log(chance))
        return self.keep(member)

    def keep(self, member: Member) -> Member:
        """Integrate a member if its probability can matter, and store it."""
        limit = member.log_posterior + member.weighting.correction
        scores = [self.score(other) for other in self.members.values()]
        if limit + self.log_prior[member.structure] > max(scores, default=-np.inf) - _UNLIKELY:
            member = member.integrated()
        else:
            member = replace(member, log_evidence=limit - _UNLIKELY)
        self.members[member.structure] = member
        return member

    def _starts(self, layout: Layout, parent: Member) -> list[FloatArray | None]:
        """Return parameters to start from: the parent's; a new ripple has likely frequencies."""
        start = parent.start_for(layout)
        if "ripple" not in layout.parts or "ripple" in parent.layout.parts:
            return [start]
        starts: list[FloatArray | None] = []
        for frequency in self._frequencies(parent):
            moved = start.copy()
            moved[layout.shape["ripple"]] = np.log(frequency)
            starts.append(moved)
        return starts

    def _frequencies(self, parent: Member) -> list[float]:
        """Return the two likeliest ripple frequencies, beside a member without ripple."""
        points, part = self.problem.points, self.problem.parts["ripple"]
        highest = max(_HIGHEST_FREQUENCY * len(points), _FREQUENCIES[0])
        frequencies = _FREQUENCIES[highest + 1e-9 >= _FREQUENCIES]
        angle = TURN * np.outer(points.u, frequencies)
        columns = np.exp(part.amplitude.mean) * np.hstack([np.cos(angle), np.sin(angle)])
        prior = part.shape[0]
        chances = -0.5 * ((np.log(frequencies) - prior.mean) / prior.sd) ** 2 - np.log(frequencies)
        gain = parent.gain_of(columns, 2) + chances
        best: list[float] = []
        for k in np.argsort(-gain):
            if all(abs(frequencies[k] - other) > _APART for other in best):
                best.append(float(frequencies[k]))
            if len(best) == 2:
                break
        return best


def average(problem: Problem, weights: FloatArray) -> tuple[list[Member], FloatArray]:
    """Return the averaged members and their posterior probabilities, the likeliest first.

    Parameters
    ----------
    weights : float64 array of shape (n,)
        Weights of the points.
    """
    search = _Average(problem, weights)
    drifts = bool(problem.points.elapsed.size)
    rest = 1.0 - _PLAIN_CHANCE - _ALIKE_CHANCE
    chances = dict.fromkeys(STRUCTURES, rest / len(STRUCTURES))
    chances |= dict.fromkeys(ALIKE, _ALIKE_CHANCE / len(ALIKE))
    chances = {key.limited_to(problem.parts): value for key, value in chances.items()}
    steady = {key: value * (1.0 - _DRIFT_CHANCE * drifts) for key, value in chances.items()}
    unrestricted = _WHOLE.limited_to(problem.parts)
    parent = search.add(unrestricted, steady.pop(unrestricted))
    for structure, chance in steady.items():
        search.add(structure, chance, parent)
    if drifts:
        for structure in search.likeliest(chances):
            chance = _DRIFT_CHANCE * chances[structure]
            search.add(structure.with_parts("drift"), chance, search.members[structure])
    for structure in PLAIN:
        chance = _PLAIN_CHANCE / len(PLAIN)
        search.add(structure, (1.0 - _GROWING_CHANCE) * chance)
        search.add(replace(structure, growing=True), _GROWING_CHANCE * chance)
    _add_tails(search)
    members = list(search.members.values())
    scores = np.array([search.score(member) for member in members])
    shares = np.exp(scores - scores.max())
    shares /= shares.sum()
    chosen = [k for k in np.argsort(-shares) if shares[k] > _KEPT_SHARE]
    return [members[k] for k in chosen], np.asarray(shares[chosen] / shares[chosen].sum())


def _add_tails(search: _Average) -> None:
    """Add members with heavy tails, if heavy tails suit the likeliest member."""
    best, even = search.best, list(search.members)
    for structure in even:
        search.log_prior[structure] += float(np.log(1.0 - _TAILED_CHANCE))

    def tailed_prior(structure: Structure) -> float:
        """Return the prior probability of a structure with heavy tails, from that without."""
        return float(np.exp(search.log_prior[structure])) * _TAILED_CHANCE / (1.0 - _TAILED_CHANCE)

    search.log_prior[replace(best.structure, tailed=True)] = np.log(tailed_prior(best.structure))
    tailed = search.keep(best.tailed())
    if search.score(tailed) < search.score(best) - _TAILS_LAG:
        return
    search.weighting = tailed.weighting
    likeliest = search.likeliest(s for s in even if s not in PLAIN)
    for structure in dict.fromkeys([*likeliest, *PLAIN]):
        if structure != best.structure:
            parent = search.members[structure]
            search.add(replace(structure, tailed=True), tailed_prior(structure), parent)
