"""The state of every effect of a chain at one reading: its correction, or why there is none."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from torquebench.chain.effects import SWITCHES
from torquebench.chain.effects.static_curve import StaticCurve
from torquebench.chain.readings import QUANTITIES
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.chain.effect import Effect
    from torquebench.chain.measuring_chain import MeasuringChain
    from torquebench.chain.readings import Readings
    from torquebench.chain.torque import Torque

RECORDS = (
    "certificate {number} of {item}",
    "certificate {number}, {laboratory}",
    "counter {identity}",
    "description of the flange",
    "description of transducer {serial}",
    "calibration in place",
    "residuals of the calibration",
    "the readings' own",
    "standard errors of the calibration's points",
    "stated on the command line",
    "stated with the fit",
    "identified from {tables}",
    "empty run {run}",
    "empty runs {runs}",
    "{size} points of the calibration",
    "{count} zeros of {tables}",
    "drag multiplied by {factor} by {run}",
)
"""Templates of the parts of effects' records, which model files keep as text."""
_PATTERNS = {
    template: re.compile(re.sub(r"\\{\w+\\}", "(.+?)", re.escape(template))) for template in RECORDS
}

Standing = Literal["holds", "outside", "unmeasured", "off", "missing"]


@dataclass(frozen=True)
class EffectState:
    """Contribution of one effect to the torque and its budget.

    Parameters
    ----------
    name : str
        Name in budgets.
    record : str
        Record from which the effect's values come.
    contribution_nm : float or None
        Correction of the torque, N·m; None without a correction, or if it has no number.
    uncertainty_nm : float or None
        Its standard uncertainty, N·m; None if U doesn't contain it.
    state : {"holds", "outside", "unmeasured", "off", "missing"}
        Whether the effect is valid for the reading. Outside its range there is no torque; effects
        that aren't measured, or are switched off, are in U. Missing ones have no record and aren't
        in U.
    detail : str
        The value and its allowed range, or the missing quantity.
    switch : str
        Name in `SWITCHES` that switches it; empty if it can't be switched.
    """

    name: str
    record: str
    contribution_nm: float | None
    uncertainty_nm: float | None
    state: Standing
    detail: str = ""
    switch: str = ""


def effect_states(chain: MeasuringChain, readings: Readings, torque: Torque) -> list[EffectState]:
    """Return the state of every effect of a chain, and finally the influences without an effect.

    Parameters
    ----------
    readings : Readings
        A single reading.
    torque : Torque
        The chain's torque for this reading.
    """
    switch_of = {name: switch for switch, names in SWITCHES.items() for name in names}
    states = []
    for effect in chain.effects:
        state, detail = _standing(effect, readings, torque)
        for name in (
            component.name for component in effect.components(readings, readings.reading_nm)
        ):
            added, switch = float(torque.added(name)[0]), switch_of.get(name, "")
            off = name in chain.switched_off
            corrects = effect.corrects_reading or isinstance(effect, StaticCurve)
            says = corrects and np.isfinite(added) and not off and state != "outside"
            states.append(
                EffectState(
                    name,
                    record_message(effect.record),
                    added if says else None,
                    float(torque.component(name)[0]),
                    "off" if off else state,
                    "" if off else detail,
                    switch if corrects else "",
                )
            )
    missing = chain.missing()
    held = [each for each in states if each.name not in missing]
    return held + [EffectState(name, "", None, None, "missing") for name in missing]


def record_message(record: str) -> Message:
    """Return an effect's record as a message, so that a panel can translate its parts.

    Examples
    --------
    >>> record_message("certificate 17 of SIM-CAL-1; counter C-1").values["1"].template
    'counter {identity}'
    """
    return Message.joined(map(_part, record.split("; ")), "; ")


def _part(text: str) -> Message:
    for template, pattern in _PATTERNS.items():
        if found := pattern.fullmatch(text):
            return Message(template, *found.groups())
    return Message("{record}", text)


def not_in_u(missing: Sequence[str]) -> Message | None:
    """Return a sentence about influences that U doesn't contain; None if there are none.

    Parameters
    ----------
    missing : sequence of str
        As `MeasuringChain.missing` names them.

    Examples
    --------
    >>> not_in_u(["creep under load", "rotation"])
    'not in U, because no record exists: creep under load, rotation'
    """
    if not missing:
        return None
    return Message("not in U, because no record exists: {influences}", Message.joined(missing))


def _standing(effect: Effect, readings: Readings, torque: Torque) -> tuple[Standing, str]:
    """Return whether an effect holds for a reading, and why not."""
    refused = effect.outside(readings)
    if refused is not None:
        return "outside", Message("{found}, allowed {allowed}", refused.found, refused.allowed)
    if isinstance(effect, StaticCurve) and np.isfinite(readings.reading_nm[0]):
        beyond = not np.isfinite(torque.value_nm[0]) and np.isnan(torque.added("static curve")[0])
        if beyond or not effect.inside(readings.reading_nm)[0]:
            return "outside", (
                Message(
                    "reading {reading:.6g} N·m, allowed {low:.6g} to {high:.6g} N·m",
                    readings.reading_nm[0],
                    effect.low_nm,
                    effect.high_nm,
                )
            )
    missing = [
        description
        for name, description in QUANTITIES.items()
        if name in effect.needs and _unknown(getattr(readings, name))
    ]
    return ("unmeasured", ", ".join(missing)) if missing else ("holds", "")


def _unknown(value: object) -> bool:
    return value is None or bool(np.isnan(np.asarray(value, dtype=np.float64)).all())
