"""Torque-angle loops: stiffness, backlash, lost motion and hysteresis loss, with uncertainties."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.loops.branches import (
    Drift,
    RawLoop,
    Recording,
    averaged,
    cut_loops,
    drift_of,
    steady_drift,
)
from torquebench.reducers.loops.features import features_of, key_points_of
from torquebench.reducers.loops.flange_torque import FlangeInertia, torque_at_flange
from torquebench.reducers.loops.results import (
    Feature,
    HysteresisResult,
    LoopFeatures,
    LoopSettings,
    LoopUncertainty,
    StiffnessRegions,
    check_closure,
    check_columns,
    loop_findings,
)
from torquebench.reducers.loops.ripple import (
    NOTHING_LEFT,
    RippleLeft,
    effect_of_ripple,
    without_ripple,
)
from torquebench.reducers.preparation import Samples, count_step
from torquebench.reducers.quantities import Finding, budget
from torquebench.reducers.repeatability import over_positions
from torquebench.reducers.saturation import torque_saturation
from torquebench.uncertainty import Budget, BudgetLine, Shared
from torquebench.units import ARCMIN, NM_PER_RAD_OF_NM_PER_ARCMIN

Floats = NDArray[np.float64]


def evaluate_hysteresis(
    torque_nm: ArrayLike,
    angle_rad: ArrayLike,
    settings: LoopSettings,
    *,
    position: ArrayLike | None = None,
    loop: ArrayLike | None = None,
    demanded_nm: ArrayLike | None = None,
    bench_compliance_rad_per_nm: float = 0.0,
    resolution_rad: float = 0.0,
    time_s: ArrayLike | None = None,
    flange: FlangeInertia | None = None,
    uncertainty: LoopUncertainty | None = None,
    row: ArrayLike | None = None,
    keep_outliers: bool = False,
) -> HysteresisResult:
    """Evaluate torque-angle loops, one side locked and torque at the output.

    Branches are fitted locally; stiffness is ΔT/Δθ by least squares over its interval on the
    branches that are being loaded. Values are means over the loops of a position and over positions
    (the worst position if the rule requires it); a torque uncertainty becomes an angle uncertainty
    through the local slope of the loop. A stepped torque is evaluated by its levels, a coarse angle
    where its count changes. Drift between loops is subtracted, and a finding states it. If the
    torque has a ripple, branches are evaluated at the outermost angles, and the torque that
    accelerates a known flange is subtracted (`torque_at_flange`).

    Parameters
    ----------
    torque_nm : array of float, shape (n,)
        Torque at the output in the order of measurement, N·m.
    angle_rad : array of float, shape (n,)
        Angle of the output against the locked input, rad; any zero.
    settings : LoopSettings
        Rated torque, rules and intervals.
    position : array of float, shape (n,), optional
        Label of the output position of each sample; one position by default.
    loop : array of int, shape (n,), optional
        Number of the loop at its position; found from the torque's reversals by default, and
        where labelled loops don't begin and end at their largest torque.
    demanded_nm : array of float, shape (n,), optional
        Commanded torque of the drive, only to detect saturation.
    bench_compliance_rad_per_nm : float
        The bench's own twist per torque between the encoder and the reducer, which is subtracted.
    resolution_rad : float
        Step of the angle's counts, where it is known; the visible one by default.
    time_s : array of float, shape (n,), optional
        Times, for the drift between loops; with `flange` at an even rate, gaps allowed.
    flange : FlangeInertia, optional
        Rotating parts between the transducer and the reducer.
    uncertainty : LoopUncertainty, optional
        Of torque, angle and compliance; by default none, so that U contains only the scatter that
        the recording shows.
    row : array of int, shape (n,), optional
        Number of each sample in its file, for messages.
    keep_outliers : bool
        Evaluate single samples far from their neighbours with the others.

    Raises
    ------
    InputError
        Where the data can't be used: no whole loop, a loop that doesn't close, swapped columns, a
        loop that never reaches the stiffness interval, a flange without times.
    """
    if flange is not None and time_s is None:
        raise InputError(
            Message("a flange of {flange}, but no times", flange),
            "the time of each sample: how fast the flange swings follows from it",
            "give the times, or leave the flange's inertia out",
        )
    samples = Samples.of(
        16,
        row=row,
        keep=keep_outliers,
        torque_nm=torque_nm,
        angle_rad=angle_rad,
        position=position,
        loop=loop,
        demand=demanded_nm,
        time_s=time_s,
    )
    place = samples.get("position", 0.0)
    for label in np.unique(place):
        here = place == label
        check_columns(
            samples["torque_nm"][here], samples["angle_rad"][here], settings.rated_torque_nm
        )
    samples = samples.screened(place, torque=samples["torque_nm"], angle=samples["angle_rad"])
    columns, torque = samples.columns, samples["torque_nm"]
    findings = [*samples.findings, *torque_saturation(torque, columns.get("demand"))]
    stated = uncertainty or LoopUncertainty()
    angle, subtracted = samples["angle_rad"], bench_compliance_rad_per_nm * torque
    step = resolution_rad or count_step(samples["angle_rad"])
    if flange is not None:
        torque, added = torque_at_flange(
            samples["time_s"],
            torque,
            angle - subtracted,
            flange,
            angle_uncertainty_rad=step / 12.0**0.5,
        )
        branch = float(np.hypot(stated.torque_branch_nm, np.sqrt(np.mean(added**2))))
        stated = replace(stated, torque_branch_nm=branch)
    where = samples.get("position", 0.0)
    times = columns.get("time_s")
    recording = Recording(torque, angle, where, subtracted, columns.get("loop"), times, step)
    steady, ripple = without_ripple(recording, step)
    evaluated = _evaluated(steady, settings)
    left = NOTHING_LEFT
    if ripple is not None:
        rippling = _evaluated(recording, settings).loops
        left, found = effect_of_ripple(
            ripple, evaluated.loops, rippling, at_reducer=flange is not None
        )
        findings.append(found)
    loops = evaluated.loops
    findings += [*evaluated.findings, *loop_findings(loops, settings)]
    quantity = _Quantities(evaluated, settings, stated, left)
    stiffness, positive, negative = quantity.stiffnesses()
    return HysteresisResult(
        settings=settings,
        stiffness=stiffness,
        stiffness_positive=positive,
        stiffness_negative=negative,
        backlash=quantity.backlash(),
        lost_motion=quantity.lost_motion(),
        energy=quantity.energy(),
        regions=quantity.regions(),
        loops=loops,
        key_points=key_points_of(loops[0], settings),
        findings=tuple(findings),
    )


NEGLIGIBLE = 1e-4
"""Drift from loop to loop, as a share of the loop's width, that isn't subtracted."""


@dataclass(frozen=True, eq=False)
class _Evaluated:
    """Loops without drift, the same loops with it, and the drift's relative uncertainty."""

    loops: tuple[LoopFeatures, ...]
    drifting: tuple[LoopFeatures, ...]
    share: Mapping[float, float]
    findings: tuple[Finding, ...]


def _evaluated(recording: Recording, settings: LoopSettings) -> _Evaluated:
    """Cut a recording into loops, subtract the drift between them, and read their features."""
    recording, width = averaged(recording)
    findings: list[Finding] = []
    if width > 1:
        findings.append(
            Finding(
                "noisy torque",
                Message(
                    "torque and angle were averaged over {count} neighbouring samples, "
                    "because noise of the torque blurs the loop where it is steep",
                    width,
                ),
                "filter both channels alike, or ramp more slowly",
            )
        )
    cut: dict[float, list[RawLoop]] = {}
    for raw in cut_loops(recording):
        mine = cut.setdefault(raw.position, [])
        if raw.number > settings.settling_loops:
            mine.append(raw)
    for label, raws in cut.items():
        if not raws:
            raise InputError(
                Message(
                    "no loop at position {label:g} after {count} settling loops",
                    label,
                    settings.settling_loops,
                ),
                "at least one loop at each position",
                "leave fewer loops out, or record more",
            )
    features = {label: features_of(raws, recording, settings) for label, raws in cut.items()}
    drifting = tuple(chain.from_iterable(features.values()))
    check_closure(drifting, settings)
    subtracted, shares = recording.subtracted.copy(), {}
    for label, raws in cut.items():
        drift = _drift_at(recording, raws, features[label])
        width_rad = float(np.mean([feature.width_rad for feature in features[label]]))
        if abs(drift.per_loop_rad) * (1.0 + 3.0 * drift.share) <= NEGLIGIBLE * width_rad:
            continue
        rows = recording.position == label
        subtracted[rows] += drift.rad[rows]
        shares[label] = drift.share
        if drift.significant:
            findings.append(_drift_finding(drift, len(raws), width_rad))
    if not shares:
        return _Evaluated(drifting, drifting, {}, tuple(findings))
    recording = replace(recording, subtracted=subtracted)
    loops = tuple(
        chain.from_iterable(features_of(raws, recording, settings) for raws in cut.values())
    )
    return _Evaluated(loops, drifting, shares, tuple(findings))


def _drift_at(
    recording: Recording, loops: Sequence[RawLoop], features: Sequence[LoopFeatures]
) -> Drift:
    """Return the drift of the angle: between loops, or from the gap of a single loop."""
    if len(loops) > 1:
        return drift_of(recording, loops)
    loop = features[0]
    return steady_drift(recording, loops[0], loop.closure_rad, loop.closure_noise_rad)


def _drift_finding(drift: Drift, loops: int, width_rad: float) -> Finding:
    """Report the drift that was subtracted from the loops."""
    size, share = drift.per_loop_rad / ARCMIN, 100.0 * abs(drift.per_loop_rad) / width_rad
    if loops == 1:
        return Finding(
            "gap of a single loop",
            Message(
                "the loop's end is {gap:.3g} arcmin off its start ({share:.2g} % of its width): "
                "half of it is subtracted as drift, and U covers none and all of it",
                size,
                share,
            ),
            "record three loops, after a preload to the rated torque",
        )
    return Finding(
        "drift",
        Message(
            "the angle drifts by {drift:.3g} arcmin from loop to loop ({share:.2g} % of the "
            "width): subtracted",
            size,
            share,
        ),
        "let the temperature settle, check clamps and encoder for creep",
    )


# -- budgets ----------------------------------------------------------------------------------


def _scaled(parts: list[BudgetLine], factor: float) -> list[BudgetLine]:
    return [
        replace(part, standard_uncertainty=factor * part.standard_uncertainty) for part in parts
    ]


@dataclass(frozen=True, eq=False)
class _Quantities:
    """Values of all loops with their budgets."""

    evaluated: _Evaluated
    settings: LoopSettings
    known: LoopUncertainty
    left: RippleLeft

    def _over(
        self, choose: Callable[[LoopFeatures], Feature], position: float | None = None
    ) -> tuple[float, list[BudgetLine]]:
        """Return the mean of a feature over loops and positions, and its uncertainty's lines.

        The lines are scatter between loops and positions, noise, resolution and drift.
        """
        pairs = [
            (loop, other)
            for loop, other in zip(self.evaluated.loops, self.evaluated.drifting, strict=True)
            if position is None or loop.position == position
        ]
        features = [choose(loop) for loop, _ in pairs]
        value, parts = over_positions(
            np.array([feature.value for feature in features]),
            np.array([loop.position for loop, _ in pairs]),
            noise=float(np.sqrt(np.mean([feature.noise**2 for feature in features]))),
        )
        drift = np.mean(
            [
                self.evaluated.share.get(loop.position, 0.0) * (of.value - choose(other).value)
                for of, (loop, other) in zip(features, pairs, strict=True)
            ]
        )
        common = (
            ("resolution", float(np.mean([feature.step for feature in features]))),
            ("between samples", float(np.mean([feature.between for feature in features]))),
            ("drift", abs(float(drift))),
        )
        return value, [*parts, *(BudgetLine(name, size) for name, size in common)]

    def _mean(self, value: Callable[[LoopFeatures], float]) -> float:
        return float(np.mean([value(loop) for loop in self.evaluated.loops]))

    @property
    def _positions(self) -> list[float]:
        return list(dict.fromkeys(loop.position for loop in self.evaluated.loops))

    def _scale(self, factor: float) -> list[BudgetLine]:
        """Return the contributions of errors in proportion to the torque."""
        uncertainty = self.known
        return [
            BudgetLine(
                "torque scale", uncertainty.torque_relative * factor, shared=Shared.CALIBRATION
            ),
            BudgetLine("mounting", uncertainty.torque_mounting * factor, shared=Shared.MOUNTING),
        ]

    def _branch(self, factor: float) -> list[BudgetLine]:
        """Return the contribution of a torque error of one branch against the other."""
        uncertainty = self.known
        return [
            BudgetLine(
                "torque branch", uncertainty.torque_branch_nm * factor, shared=Shared.CALIBRATION
            ),
            BudgetLine(
                "loading effects", uncertainty.torque_loading_nm * factor, shared=Shared.LOADING
            ),
        ]

    def _angle(self, value: float, factor: float) -> list[BudgetLine]:
        """Return the contributions of the encoder's errors at single angles, and of its scale."""
        uncertainty = self.known
        return [
            BudgetLine("angle", uncertainty.angle_rad * factor, shared=Shared.MOUNTING),
            BudgetLine(
                "angle scale", uncertainty.angle_relative * abs(value), shared=Shared.CALIBRATION
            ),
        ]

    def _zero(self, slope: float, positions: int) -> BudgetLine:
        size = self.known.torque_zero_nm * slope / positions**0.5
        return BudgetLine("torque zero", size, shared=Shared.ZEROING)

    def backlash(self) -> Budget:
        """Loop width at zero torque, arcmin."""
        value, parts = self._over(lambda each: each.backlash)
        tilt = self._mean(lambda each: each.slope_difference_at_zero)
        parts += [
            *self._branch(2.0**0.5 * self._mean(lambda each: each.slope_at_zero)),
            self._zero(tilt, len(self._positions)),
            *self._angle(value, 2.0**0.5),
            BudgetLine("torque ripple", self.left.backlash_rad),
        ]
        return budget(value / ARCMIN, "arcmin", _scaled(parts, 1.0 / ARCMIN))

    def lost_motion(self) -> Budget:
        """Lost motion by the rule, arcmin."""
        rule = self.settings.lost_motion_rule
        positions, worst = self._positions, None
        if rule.positions == "worst":
            worst = max(positions, key=lambda label: self._over(_lost_motion, label)[0])
        value, parts = self._over(_lost_motion, worst)
        slope = self._mean(lambda each: each.slope_at_lost_motion)
        reach = 2.0 * rule.share * self.settings.rated_torque_nm
        twist = self.known.bench_compliance_rad_per_nm * reach
        parts += [
            # A hysteresis step at reversal that is compensated incompletely is equal on both
            # branches and has the sign of the torque: the errors at both ends add.
            *self._branch(2.0 * slope),
            self._zero(slope, len(positions) if worst is None else 1),
            *self._scale(reach * slope),
            *self._angle(value, 1.0),
            BudgetLine("bench compliance", twist, inf, -1.0, Shared.CALIBRATION),
            BudgetLine("torque ripple", self.left.lost_motion_rad),
        ]
        return budget(value / ARCMIN, "arcmin", _scaled(parts, 1.0 / ARCMIN))

    def energy(self) -> Budget:
        """Hysteresis loss of a cycle, J."""
        value, parts = self._over(lambda each: each.energy)
        load = self._mean(lambda each: 2.0 * each.largest_torque_nm)
        parts += [
            *self._scale(abs(value)),
            *self._branch(2.0**0.5 * self._mean(lambda each: each.width_rad)),
            *self._angle(value, 2.0**0.5 * load),
            BudgetLine("torque ripple", self.left.energy_j),
        ]
        return budget(value, "J", parts)

    def _stiffness(
        self,
        choose: Callable[[LoopFeatures], Feature],
        reach_nm: float,
        *,
        per: float = NM_PER_RAD_OF_NM_PER_ARCMIN,
        unit: str = "N·m/arcmin",
    ) -> Budget:
        """Return the stiffness: the inverse of the mean compliance of the loops."""
        compliance, estimate = self._over(choose)
        value = 1.0 / compliance
        uncertainty, angle_range = self.known, reach_nm * abs(compliance)
        parts = [
            *_scaled(estimate, value**2),
            *self._scale(abs(value)),
            *self._branch(2.0**0.5 / reach_nm * abs(value)),
            BudgetLine(
                "angle",
                2.0**0.5 * uncertainty.angle_rad / angle_range * abs(value),
                inf,
                -1.0,
                Shared.MOUNTING,
            ),
            BudgetLine(
                "angle scale",
                uncertainty.angle_relative * abs(value),
                inf,
                -1.0,
                Shared.CALIBRATION,
            ),
            BudgetLine(
                "bench compliance",
                uncertainty.bench_compliance_rad_per_nm * value**2,
                shared=Shared.CALIBRATION,
            ),
        ]
        return budget(value / per, unit, _scaled(parts, 1.0 / per))

    def stiffnesses(self) -> tuple[Budget, Budget, Budget]:
        """Stiffness over the interval: mean of both torque directions, positive, negative."""
        low, high = self.settings.stiffness_interval
        reach = (high - low) * self.settings.rated_torque_nm
        return (
            self._stiffness(lambda each: each.compliance, reach),
            self._stiffness(lambda each: each.compliance_positive, reach),
            self._stiffness(lambda each: each.compliance_negative, reach),
        )

    def regions(self) -> StiffnessRegions | None:
        """Stiffness in three regions, if requested."""
        if self.settings.region_torques_nm is None:
            return None
        first, second = self.settings.region_torques_nm
        largest = min(loop.largest_torque_nm for loop in self.evaluated.loops)
        budgets: list[Budget | None] = []
        for k, reach in enumerate((first, second - first, largest - second)):
            if any(loop.regions[k] is None for loop in self.evaluated.loops):
                budgets.append(None)
                continue
            budgets.append(self._stiffness(_region(k), reach, per=1.0, unit="N·m/rad"))
        return StiffnessRegions(first, second, *budgets)


def _lost_motion(loop: LoopFeatures) -> Feature:
    return loop.lost_motion


def _region(number: int) -> Callable[[LoopFeatures], Feature]:
    """Return a function that picks one region's stiffness of a loop."""

    def choose(loop: LoopFeatures) -> Feature:
        region = loop.regions[number]
        assert region is not None
        return region

    return choose
