"""A measuring chain: converts readings to torque with uncertainty and budget."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np

from torquebench.chain.acceleration import LEARNED, AccelerationBySpeed
from torquebench.chain.effect import EFFECTS, Effect
from torquebench.chain.effects import (
    SWITCHES,
    Counter,
    Dynamics,
    RecordedDynamics,
    Scatter,
    StaticCurve,
    SwitchedOff,
)
from torquebench.chain.readings import FloatArray, Readings, rows_of
from torquebench.chain.torque import Component, Torque, joined, not_corrected
from torquebench.compensation import CompensationModel, StoredModel, load_model
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import HOURS_PER_DAY

_Kind = TypeVar("_Kind", bound=Effect)
GAP_STEPS = 3.0  # in windows: a shorter gap can't hide a significant reversal


def effect_from(specification: Mapping[str, Any]) -> Effect:
    """Return the effect of a stored specification.

    Raises
    ------
    InputError
        An unknown kind, or fields that it doesn't have.
    """
    values = dict(specification)
    kind = values.pop("kind", None)
    if kind not in EFFECTS:
        raise InputError(
            Message("effect {kind!r} of a measuring chain", kind),
            ", ".join(sorted(EFFECTS)),
            "use the version of torquebench that the chain was made with",
        )
    try:
        return EFFECTS[kind].from_specification(values)
    except TypeError as problem:
        raise InputError(
            Message("effect {kind!r} with other fields ({problem})", kind, problem),
            ", ".join(item.name for item in fields(EFFECTS[kind])),
            "fit the chain again",
        ) from problem


@dataclass(frozen=True, eq=False)
class MeasuringChain:
    """One calibrated transducer with its counter and module: a sum of effects.

    Parameters
    ----------
    model : CompensationModel
        Fitted model, which gives the static curve and the scatter.
    stored : tuple of Effect
        Further effects of the chain.
    calibrated_on : datetime.date, optional
        Day of the calibration. If it is unknown, U contains the drift of a whole interval.

    Examples
    --------
    >>> from torquebench.chain import Reference
    >>> from torquebench.compensation import features, make_model
    >>> from torquebench.uncertainty import CertifiedUncertainty
    >>> generator = np.random.default_rng(2)
    >>> standard = np.linspace(-2000.0, 2000.0, 50)
    >>> reading = standard / 1.003 + 0.3 * generator.standard_normal(50)
    >>> model = make_model("polynomial").fit(features(reading), standard)
    >>> certified = CertifiedUncertainty.flat(0.4, 40.0, 2000.0)
    >>> chain = MeasuringChain(model, (Reference("certificate 17", certified),))
    >>> torque = chain.torque(Readings(np.array([1500.0])))
    >>> 0.6 < float(torque.expanded_uncertainty_nm[0]) < 0.9
    True
    """

    model: CompensationModel
    stored: tuple[Effect, ...] = ()
    calibrated_on: date | None = None

    @classmethod
    def of(cls, stored: StoredModel) -> Self:
        """Return the chain of a model file."""
        made = stored.provenance
        day = date.fromisoformat(made.calibrated_on) if made.calibrated_on else None
        return cls(stored.model, tuple(map(effect_from, made.effects)), day)

    def age_h(self, day: date | None) -> float | None:
        """Return the time from the calibration to a day, h; None if either is unknown."""
        if day is None or self.calibrated_on is None:
            return None
        return HOURS_PER_DAY * abs((day - self.calibrated_on).days)

    def dated(self, readings: Readings) -> Readings:
        """Return the readings with the age of the calibration, if their day is known."""
        age_h = self.age_h(readings.measured_on)
        if age_h is None or readings.calibration_age_h is not None:
            return readings
        return replace(readings, calibration_age_h=age_h)

    @cached_property
    def curve(self) -> StaticCurve:
        """The static curve."""
        return StaticCurve("calibration in place", self.model)

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """All effects in the order in which they add to a reading."""
        scatter = Scatter("residuals of the calibration", self.model)
        own = tuple(effect for effect in self.counted if effect.corrects_reading)
        after = tuple(effect for effect in self.counted if not effect.corrects_reading)
        noise = () if self.find(Counter) else (Counter("the readings' own"),)
        return (*own, self.curve, scatter, *after, *noise)

    @cached_property
    def counted(self) -> tuple[Effect, ...]:
        """Effects that count in U: stored effects, without limits that measured effects replace."""
        measured = {effect.influence: effect for effect in self.stored if effect.influence}
        left = (
            measured[effect.kind].left_of(effect) if effect.kind in measured else effect
            for effect in self.stored
        )
        return tuple(effect for effect in left if effect is not None)

    @cached_property
    def dynamics(self) -> Dynamics | None:
        """Filter for quick changes, if the chain has one."""
        return self.find(Dynamics)

    def find(self, kind: type[_Kind]) -> _Kind | None:
        """Return the stored effect of a class; None if there is none."""
        return next((effect for effect in self.stored if isinstance(effect, kind)), None)

    @property
    def steps_nm(self) -> float:
        """Standard error of the calibration's step means, which the scatter contains, N·m."""
        counter = self.find(Counter)
        return 0.0 if counter is None else counter.steps_nm

    @cached_property
    def switched_off(self) -> frozenset[str]:
        """Names of components that aren't corrected; their possible size is in U."""
        return frozenset(
            name
            for effect in self.stored
            if isinstance(effect, SwitchedOff)
            for name in effect.names
        )

    def with_effects(self, effects: Iterable[Effect]) -> MeasuringChain:
        """Return the chain with added effects, which replace those of the same kind."""
        changed = {effect.kind: effect for effect in (*self.stored, *effects)}
        return replace(self, stored=tuple(changed.values()))

    def with_limits(self, limits: Iterable[Effect]) -> MeasuringChain:
        """Return the chain with limits for influences without a record.

        Effects of the chain are kept. An effect whose limit is unknown gets it from `limits`, with
        the interval that belongs to it.
        """
        own = {effect.kind: effect for effect in self.stored}
        partly = {effect.influence for effect in self.stored if effect.gaps()} - set(own)
        lacking, added = {*self._lacking(), *partly}, list[Effect]()
        for limit in limits:
            if limit.kind in lacking:
                added.append(limit)
            elif limit.kind in own and own[limit.kind].gaps():
                added.append(_completed(own[limit.kind], limit))
        return self.with_effects(added)

    @cached_property
    def switches(self) -> tuple[str, ...]:
        """Names in `SWITCHES` of the corrections that are switched off."""
        return tuple(
            switch for switch, names in SWITCHES.items() if self.switched_off.issuperset(names)
        )

    def switched(self, record: str, off: Iterable[str]) -> MeasuringChain:
        """Return the chain with exactly these corrections switched off.

        Raises
        ------
        InputError
            A name that isn't one of `SWITCHES`.
        """
        return self.with_effects([SwitchedOff.of(record, *off)])

    def specification(self) -> tuple[Mapping[str, Any], ...]:
        """Return the chain's effects as entries of a model file."""
        return tuple(effect.specification() for effect in self.stored)

    def missing(self) -> tuple[str, ...]:
        """Return the influences without any record, which U doesn't contain."""
        limited = {effect.kind for effect in self.counted}
        open_ = (effect for effect in self.counted if effect.influence not in limited)
        return (
            *sorted(EFFECTS[kind].title for kind in self._lacking()),
            *(gap for effect in open_ for gap in effect.gaps()),
        )

    def _lacking(self) -> tuple[str, ...]:
        """Return the kinds of effects without any record."""
        recorded = {effect.kind for effect in self.stored}
        recorded |= {effect.influence for effect in self.stored}
        return tuple(
            kind
            for kind, effect in EFFECTS.items()
            if kind not in recorded and not effect.influence and effect.expected
        )

    def torque(self, readings: Readings, place: Callable[[int], str] = "row {}".format) -> Torque:
        """Return torque and uncertainty for the rows of a table.

        Rows with times are one record in time order: see `RecordedStream`. Rows without times are
        independent.

        Parameters
        ----------
        place : callable, optional
            Function from a row's number to its name in messages.

        Raises
        ------
        InputError
            A reading outside the calibrated range, or conditions outside the range of an effect.
        """
        torque = self.compensated(readings)
        if not np.isfinite(torque.value_nm).all():
            self.refuse(readings, place)
        return torque

    def compensated(self, readings: Readings) -> Torque:
        """Return the torques like `torque`, but NaN for refused readings."""
        if readings.time_s is None:
            return self.independent(self.dated(readings))
        return RecordedStream(self).torque(readings, None)

    def independent(self, readings: Readings) -> Torque:
        """Return the torques of independent readings."""
        return _sum(self.effects, readings, self.switched_off)

    @property
    def turns(self) -> bool:
        """Whether effects of speed, temperature or acceleration were measured on this chain."""
        return any(effect.of_turning for effect in self.stored)

    def unmeasured(self, readings: Readings) -> tuple[str, ...]:
        """Return the quantities that measured effects need and the readings lack."""
        needed = [name for effect in self.stored if effect.of_turning for name in effect.needs]
        return tuple(
            name
            for name in dict.fromkeys(needed)
            if getattr(readings, name) is None and name != "zero_temperature_c"
        )

    def refuse(self, readings: Readings, place: Callable[[int], str]) -> None:
        """Raise an error if an effect refuses a reading, with its name and the reason."""
        for effect in self.effects:
            refusal = effect.outside(readings)
            if refusal is not None:
                row = int(np.argmax(refusal.rows))
                raise InputError(
                    Message("{place}: {title}: {found}", place(row), effect.title, refusal.found),
                    refusal.allowed,
                    "measure the effect over a larger range, or leave such readings out",
                )
        before = [effect for effect in self.effects if effect.corrects_reading]
        reading = _sum(before, readings, self.switched_off).value_nm
        outside = ~self.curve.inside(reading)
        by_state = {"speed_rpm", "temperature_c"}.intersection(self.model.used_features)
        if outside.any() or not by_state:
            row = int(np.argmax(outside))
            raise InputError(
                Message(
                    "{place}: {title}: reading {reading_nm:.6g} N·m is outside the "
                    "calibrated range",
                    place(row),
                    self.curve.title,
                    readings.reading_nm[row],
                ),
                Message(
                    "{low_nm:.6g} to {high_nm:.6g} N·m, margin included",
                    self.curve.low_nm,
                    self.curve.high_nm,
                ),
                "calibrate over the whole range that is measured",
            )
        raise InputError(
            Message(
                "{title}: the model refuses a reading's speed or temperature", self.curve.title
            ),
            Message(
                "the columns {used_features} within the calibrated range",
                ", ".join(self.model.used_features),
            ),
            "give them in the readings' file",
        )

    def recorded(self) -> tuple[MeasuringChain, RecordedDynamics | None]:
        """Return the chain for a record in blocks, and its dynamics, which get the blocks first."""
        dynamics = self.dynamics
        if dynamics is None:
            return self, None
        follows = dynamics.recorded()
        effects = tuple(follows if effect is dynamics else effect for effect in self.stored)
        return replace(self, stored=effects), follows

    def stream(self) -> ChainStream:
        """Return a compensator for one stream of readings, which takes them block by block."""
        return ChainStream(self)


class ChainStream:
    """Compensator of a stream: consecutive blocks of readings in time order.

    After the start, a gap or a fault the past is unknown: the uncertainty is larger until the
    readings have reversed often enough. The result doesn't depend on how the stream is divided into
    blocks.
    """

    def __init__(self, chain: MeasuringChain) -> None:
        self.chain = chain
        self._effects = tuple(effect.stream() for effect in chain.effects)
        self._last_s = float("nan")

    def push(self, readings: Readings, step_s: float | None = None) -> Torque:
        """Compensate the next readings; a fault (NaN) or a reading outside the range gets NaN.

        Parameters
        ----------
        step_s : float, optional
            Interval between readings, to recognise a gap; by default that of the first two.
        """
        if readings.time_s is not None and self._has_gap(readings.time_s, step_s):
            self._forget()
        return _sum(self._effects, readings, self.chain.switched_off)

    def copy(self) -> ChainStream:
        """Return a second stream in the same state."""
        other = ChainStream.__new__(ChainStream)
        other.chain, other._last_s = self.chain, self._last_s
        other._effects = tuple(effect.copy() for effect in self._effects)
        return other

    def forget(self) -> None:
        """Discard the history."""
        self._last_s = float("nan")
        self._forget()

    def take_zero(self) -> None:
        """Let the next readings count from a zero that was just taken without load."""
        for effect in self._effects:
            effect.take_zero()

    def _forget(self) -> None:
        for effect in self._effects:
            effect.forget()

    def _has_gap(self, time_s: FloatArray, step_s: float | None) -> bool:
        """Return whether windows are missing since the last block; False for the first block."""
        if time_s.size == 0:
            return False
        before, self._last_s = self._last_s, float(time_s[-1])
        if step_s is None:
            since = time_s[1] - time_s[0] if time_s.size > 1 else time_s[0] - before
            step_s = float(since)
        return bool(time_s[0] - before > GAP_STEPS * step_s or time_s[0] < before)


class RecordedStream:
    """Compensator of a record with times: blocks in order, each with the following one.

    The acceleration comes from the speed if it isn't given, and the position in the hysteresis loop
    from earlier readings if no branch is given. After missing readings or a step back in time, the
    past is unknown. The result equals that of `ChainStream` for the same readings and
    accelerations, however the record is divided, with one difference: the torque by a dynamic
    filter, which is delayed in a live stream, belongs to the time of its row.

    Parameters
    ----------
    by_speed : AccelerationBySpeed, optional
        Evaluation of the acceleration; from the first block by default.

    Attributes
    ----------
    completed_last : Readings
        The last block with derived quantities.

    Examples
    --------
    >>> from torquebench.compensation import features, make_model
    >>> standard = np.linspace(-50.0, 50.0, 20)
    >>> model = make_model("polynomial").fit(features(standard), standard)
    >>> stream = RecordedStream(MeasuringChain(model))
    >>> block = Readings(np.array([1.0, 2.0]), time_s=np.array([0.0, 0.1]))
    >>> stream.torque(block, None).value_nm.round(9).tolist()
    [1.0, 2.0]
    """

    completed_last: Readings

    def __init__(self, chain: MeasuringChain, by_speed: AccelerationBySpeed | None = None) -> None:
        self.chain = chain
        self._rows, self._dynamics = chain.recorded()
        self._stream = self._rows.stream()
        self._by_speed = by_speed
        self._step_s: float | None = None
        self._before: tuple[FloatArray, FloatArray] = (np.zeros(0), np.zeros(0))

    def torque(self, readings: Readings, following: Readings | None) -> Torque:
        """Return the torques of the next block; NaN where an effect refuses a reading.

        Parameters
        ----------
        readings : Readings
            With times.
        following : Readings or None
            The following block, which the slope of the speed at the end depends on.
        """
        complete = self.completed_last = self.completed(readings, following)
        if self._dynamics is not None:
            self._dynamics.prepare(complete, following)
        if complete.branch is not None:
            return self._rows.independent(complete)
        assert complete.time_s is not None
        step = np.diff(complete.time_s)
        if self._step_s is None and step.size:
            self._step_s = float(np.median(step[:LEARNED]))
        cuts: list[int] = []
        if self._step_s is not None:
            cuts = (np.flatnonzero((step > GAP_STEPS * self._step_s) | (step < 0.0)) + 1).tolist()
        ends = [0, *cuts, len(complete)]
        return joined(
            [
                self._stream.push(rows_of(complete, slice(start, stop)), self._step_s)
                for start, stop in itertools.pairwise(ends)
            ]
        )

    def completed(self, readings: Readings, following: Readings | None) -> Readings:
        """Return the readings with the acceleration from their speed, and the calibration's age."""
        readings = self.chain.dated(readings)
        time_s, speed = readings.time_s, readings.speed_rpm
        if (
            readings.acceleration_rad_s2 is not None
            or time_s is None
            or not isinstance(speed, np.ndarray)
        ):
            return readings
        if self._by_speed is None:
            self._by_speed = AccelerationBySpeed.of(time_s, speed)
        reach = self._by_speed.context
        after_s, after = np.zeros(0), np.zeros(0)
        if following is not None and following.time_s is not None:
            after_s, after = following.time_s[:reach], np.asarray(following.speed_rpm)[:reach]
        before_s, before = self._before
        slope, uncertainty = self._by_speed(
            np.concatenate([before_s, time_s, after_s]), np.concatenate([before, speed, after])
        )
        self._before = time_s[-reach:], speed[-reach:]
        own = slice(before.size, before.size + speed.size)
        return replace(
            readings,
            acceleration_rad_s2=slope[own],
            acceleration_uncertainty_rad_s2=uncertainty[own],
        )


def load_chain(path: str | Path) -> MeasuringChain:
    """Read the measuring chain of a model file; raises `InputError` as `load_model` does."""
    return MeasuringChain.of(load_model(path))


def _completed(effect: Effect, limit: Effect) -> Effect:
    """Return an effect with its missing limits taken from another effect of its kind."""
    taken = {
        item.name: getattr(limit, item.name)
        for item in fields(effect)
        if getattr(effect, item.name) is None or item.name == "interval_h"
    }
    return replace(effect, record=f"{effect.record}; {limit.record}", **taken)


def _sum(effects: Iterable[Effect], readings: Readings, off: frozenset[str]) -> Torque:
    """Add the effects' corrections one after the other; a single reading is a float meanwhile."""
    alone = len(readings) == 1
    torque: FloatArray | float = readings.reading_nm.item() if alone else readings.reading_nm
    components = list[Component]()
    for effect in effects:
        for component in effect.components(readings, torque):
            part = not_corrected(component, 1.0) if component.name in off else component
            if alone:
                if type(part.value_nm) is not float or type(part.uncertainty_nm) is not float:
                    part = part.of_one()
                torque = torque + part.value_nm
            elif isinstance(part.value_nm, np.ndarray):
                torque = torque + part.value_nm
            components.append(part)
    return Torque(np.array([torque]) if alone else np.asarray(torque), tuple(components))
