"""Adaptive calibration: a coarse series, then points where the uncertainty is largest."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from torquebench.calibration.data import CalibrationData
from torquebench.calibration.steps import Step
from torquebench.compensation import FEATURES
from torquebench.message import Message

COVERAGE_FACTOR = 2.0
"""k of the expanded uncertainties that a placement states."""

StopReason = Literal["target", "budget"]


class Adaptive(BaseModel):
    """Settings for points added to a coarse series.

    After each series a model is fitted to all points so far, and the next points are placed where
    they lower its worst uncertainty most. Measuring ends with the first round in which the
    model's largest expanded uncertainty (k = 2) is `target_percent` of full scale or less, or
    when `points` are measured, those of the coarse series included.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    points: Annotated[int, Field(ge=8, le=2000)]
    points_at_a_time: Annotated[int, Field(ge=1, le=150)]
    target_percent: Annotated[float, Field(gt=0, le=100)] | None = None
    model: str = "hybrid"
    criterion: Literal["worst", "integrated"] = "worst"


@dataclass(frozen=True)
class AdaptiveRound:
    """One decision: the model's uncertainty so far and the next points.

    Parameters
    ----------
    points : int
        Points measured before this decision.
    expanded_percent : float
        Largest expanded uncertainty (k = 2) of the model fitted to them, in % of full scale.
    proposed : int
        Points that it placed; 0 in the last round.
    predicted_percent : float
        Largest expanded uncertainty predicted with these points, in % of full scale.
    """

    points: int
    expanded_percent: float
    proposed: int
    predicted_percent: float


@dataclass(frozen=True, eq=False)
class Proposed:
    """Points to measure next, in the order in which they are loaded.

    Parameters
    ----------
    nominal_nm : array of float, shape (k,)
        In N·m; empty if the placement is complete.
    branch : array of int8, shape (k,)
        +1 on the way up, -1 on the way down.
    now_percent : float
        Largest expanded uncertainty (k = 2) of the model fitted so far, in % of full scale.
    predicted_percent : float
        Uncertainty that was predicted for the model with these points.
    """

    nominal_nm: NDArray[np.float64]
    branch: NDArray[np.int8]
    now_percent: float
    predicted_percent: float

    def round(self, points: int) -> AdaptiveRound:
        """Return this decision as a round, taken after a number of points, for the record."""
        count = int(self.nominal_nm.size)
        return AdaptiveRound(points, self.now_percent, count, self.predicted_percent)


@dataclass(frozen=True)
class Placement:
    """Number of points of an adaptive calibration, and the reason why it ended.

    Parameters
    ----------
    rounds : tuple of AdaptiveRound
        Rounds in order of measurement; the first one follows the coarse series.
    reason : {"target", "budget"}
        The target uncertainty was reached, or the points were used up.
    target_percent : float or None
        Target of the expanded uncertainty (k = 2), in % of full scale.
    budget : int
        Largest allowed number of points.
    model : str
        Kind of model that placed them.
    even : int or None
        Points of the coarse series; None if the first round follows it. After a later interruption,
        the first round doesn't.
    """

    rounds: tuple[AdaptiveRound, ...]
    reason: StopReason
    target_percent: float | None
    budget: int
    model: str
    even: int | None = None

    @classmethod
    def of(
        cls, rounds: Sequence[AdaptiveRound], settings: Adaptive, even: int | None = None
    ) -> Self:
        """Return the result by the decisions; `even` counts the points of the coarse series."""
        target = settings.target_percent
        reached = target is not None and rounds[-1].expanded_percent <= target
        reason: StopReason = "target" if reached else "budget"
        return cls(tuple(rounds), reason, target, settings.points, settings.model, even)

    @property
    def points(self) -> int:
        """Number of measured points, the coarse series included."""
        return self.rounds[-1].points

    @property
    def coarse(self) -> int:
        """Points of the coarse series."""
        return self.rounds[0].points if self.even is None else self.even

    @property
    def sentence(self) -> str:
        """Number of points and reason, as a sentence.

        Examples
        --------
        >>> rounds = (AdaptiveRound(24, 0.12, 12, 0.06), AdaptiveRound(36, 0.058, 0, 0.058))
        >>> Placement(rounds, "target", 0.06, 120, "hybrid").sentence.split("; ")[0]
        '36 points: 24 even ones and 12 placed in 1 round'
        """
        first, last = self.rounds[0], self.rounds[-1]
        rounds, before = len(self.rounds) - 1, first.points - self.coarse
        turns = "1 round" if rounds == 1 else Message("{rounds} rounds", rounds)
        target = (
            ""
            if self.target_percent is None
            else Message("{target_percent:g} % FS", self.target_percent)
        )
        if self.reason == "target":
            why = Message("target {target} reached", target)
        else:
            missed = Message(", target {target} not reached", target) if target else ""
            why = Message("budget of {budget} points used{missed}", self.budget, missed)
        placed, at_first = last.points - first.points, first.expanded_percent
        if before:
            return Message(
                "{points} points: {coarse} even ones, {before} placed before an interruption and "
                "{placed} placed in {turns} after it; largest U (k = 2) of the model "
                "{at_first:.2g} % FS after the first {first} points, {at_last:.2g} % FS at the "
                "end; {why}",
                last.points,
                self.coarse,
                before,
                placed,
                turns,
                at_first,
                first.points,
                last.expanded_percent,
                why,
            )
        return Message(
            "{points} points: {coarse} even ones and {placed} placed in {turns}; largest U "
            "(k = 2) of the model {at_first:.2g} % FS after the even ones, {at_last:.2g} % FS "
            "at the end; {why}",
            last.points,
            self.coarse,
            placed,
            turns,
            at_first,
            last.expanded_percent,
            why,
        )


def place_points(data: CalibrationData, settings: Adaptive) -> Proposed:
    """Fit the model to the points so far, and place the next points.

    Parameters
    ----------
    data : CalibrationData
        All points so far.

    Returns
    -------
    Proposed
        The proposal; it has no points where the target is reached or the budget used up.

    Raises
    ------
    InputError
        Where the model refuses the points.
    """
    from torquebench.compensation import (
        make_model,  # imported late: the models take a second to import
        propose_points,  # models take a second to import
    )

    model = make_model(settings.model, range_nm=data.range_nm)
    X = data.features(1 + max(FEATURES.index(name) for name in model.used_features))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the final fit reports its outliers
        model.fit(X, data.standard_nm)
        count = min(settings.points_at_a_time, settings.points - len(data))
        proposal = propose_points(
            model, X, data.standard_nm, max(count, 1), criterion=settings.criterion
        )
    percent = 100.0 * COVERAGE_FACTOR / data.range_nm
    now = percent * proposal.before_nm
    reached = settings.target_percent is not None and now <= settings.target_percent
    if reached or count < 1:
        return Proposed(np.empty(0), np.empty(0, dtype=np.int8), now, now)
    return Proposed(proposal.nominal_nm, proposal.branch, now, percent * proposal.after_nm)


def even_points(
    range_nm: float, count: int, signs: Sequence[int]
) -> tuple[NDArray[np.float64], NDArray[np.int8]]:
    """Return evenly spread points, which a dry run uses in place of those of a model.

    Examples
    --------
    >>> target, branch = even_points(10.0, 4, (1, -1))
    >>> target.tolist(), branch.tolist()
    ([5.0, 5.0, -5.0, -5.0], [1, -1, 1, -1])
    """
    parts = 2 * len(signs)
    targets: list[float] = []
    branches: list[int] = []
    for number, (sign, branch) in enumerate((s, b) for s in signs for b in (1, -1)):
        size = (count + parts - 1 - number) // parts
        rising = (np.arange(size) + 0.5) / max(size, 1) * range_nm * sign
        targets += rising[::branch].tolist()
        branches += [branch] * size
    return np.array(targets), np.array(branches, dtype=np.int8)


def extension_steps(
    proposed: tuple[NDArray[np.float64], NDArray[np.int8]],
    template: Step,
    signs: Sequence[int],
    range_nm: float,
) -> list[Step]:
    """Return the steps that load proposed points on their branches.

    Every direction is loaded to full scale and unloaded again, even without points. As in the
    coarse series, a falling point then lies on the full loop, and the other direction begins after
    a full load. The reversal isn't recorded.

    Parameters
    ----------
    proposed : tuple of arrays, shape (k,)
        Torques in N·m, and branches.
    template : Step
        A point of the coarse series; new points are held as long as this one. Their series are
        numbered on from its series.
    signs : sequence of int
        Directions in the order in which they are loaded.
    range_nm : float
        Full scale in N·m.

    Examples
    --------
    >>> point = Step(kind="point", series=2, index=9, nominal_nm=1.0, branch=-1, duration_s=0.5)
    >>> steps = extension_steps((np.array([4.0, 7.0]), np.array([1, -1])), point, (1,), 10.0)
    >>> [(step.kind, step.series, step.nominal_nm) for step in steps]
    [('point', 3, 4.0), ('turn', 3, 10.0), ('point', 3, 7.0), ('turn', 3, 0.0)]
    """
    target, branch = proposed
    steps: list[Step] = []
    for number, sign in enumerate(signs, start=template.series + 1):
        here = (target < 0) == (sign < 0)
        index = 0
        for side, turn in ((1, sign * range_nm), (-1, 0.0)):
            for torque in sorted(target[here & (branch == side)], key=abs, reverse=side < 0):
                steps.append(
                    template.model_copy(
                        update={
                            "series": number,
                            "index": index,
                            "nominal_nm": float(torque),
                            "branch": side,
                        }
                    )
                )
                index += 1
            steps.append(
                Step(
                    kind="turn",
                    series=number,
                    index=-1,
                    nominal_nm=turn,
                    branch=side,
                    duration_s=0.0,
                    position_deg=template.position_deg,
                )
            )
    return steps
