"""Columns of files, exports, documents, panel and API: name, unit and description of each.

A name ends in its unit (`torquebench.units`). Quantities of `Readings` are described in that class,
all others in this module.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, cast

from torquebench.chain.readings import QUANTITIES
from torquebench.message import Message
from torquebench.units import unit_of_name

Side = Literal["", "input", "output"]


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table or a live signal.

    Parameters
    ----------
    name : str
        Name in files, with side and device.
    description : str
        In English, without the side: the key of its translations. Empty if unknown.
    note : str
        Note for readers of files: the meaning of codes, or a definition.
    side : str
        ``"input"``, ``"output"`` or empty.
    stated_unit : str
        Unit of an unknown column, as its document states it.
    """

    name: str
    description: str
    note: str = ""
    side: Side = ""
    stated_unit: str = ""

    @property
    def unit(self) -> str:
        """Unit at the end of the name; "1" for other numbers and codes."""
        return unit_of_name(self.name) or ("1" if self.description else self.stated_unit)

    @property
    def title(self) -> str:
        """Description with the side.

        Examples
        --------
        >>> column_of("output-steady-speed_rpm").title
        'output, speed'
        """
        if not self.side:
            return self.description
        return Message("{side}, {what}", self.side, self.description)

    @property
    def attributes(self) -> dict[str, str]:
        """Unit and description with note, as the metadata of a column in a file.

        Examples
        --------
        >>> column_of("zero_nm").attributes
        {'unit': 'N·m', 'description': "zero of the readings; by the transducer's nominal zero"}
        """
        words = [text for text in (self.description, self.note) if text]
        return {"unit": self.unit, "description": "; ".join(words)}

    @property
    def sentence(self) -> str:
        """Title, unit and note as a sentence, for readers of a file and users of the API.

        Examples
        --------
        >>> column_of("output_standard_nm").sentence, column_of("load").sentence
        ('Output, torque of the standard, in N·m.', 'As its name says.')
        """
        said = self.title or "as its name says"
        unit = "" if self.unit in ("", "1", "counts") else f", in {self.unit}"
        note = f"; {self.note}" if self.note else ""
        return f"{said[0].upper()}{said[1:]}{unit}{note}."


_SIGNAL = "as its amplifier states it, in the unit that the bench's description gives"
_FAULT = (
    "0: the value counts; 255: the channel was not in use; other codes: no pulses, pulses outside "
    "the valid range or irregular ones"
)
COLUMNS: Mapping[str, Column] = {
    each.name: each
    for each in (
        *(Column(name, description) for name, description in QUANTITIES.items()),
        Column("acceleration_uncertainty_rad_s2", "standard uncertainty of the acceleration"),
        Column("additional_torque_nm", "additional torque", "compensated minus raw torque"),
        Column("ambient_c", "ambient temperature"),
        Column("angle_counts", "angle in counts", "of the encoder, unwrapped, clockwise positive"),
        Column("angle_deg", "shaft angle", "in the middle of the window"),
        Column(
            "branch",
            "branch (1: up, −1: down)",
            "whether the magnitude of the torque rises or falls; 0: neither is known; tables of "
            "calibrations have the words up, down and unknown",
        ),
        Column("calibrator_c", "temperature of the calibrator"),
        Column("commanded_nm", "commanded torque"),
        Column("compensated_nm", "compensated torque"),
        Column("counter_nm", "standard uncertainty of the counter"),
        Column("efficiency_percent", "efficiency"),
        Column("error_nm", "error"),
        Column("expanded_uncertainty_nm", "expanded uncertainty", "k = 2"),
        Column("fault", "fault code of the transducer", _FAULT),
        Column("frequency_hz", "frequency of the transducer"),
        Column("frequency_uncertainty_hz", "standard uncertainty of the frequency"),
        Column("group", "number of the group", "of points"),
        Column("limit_s", "longest wait for a steady value"),
        Column("nominal_nm", "nominal torque of the step"),
        Column("period_s", "period of the step torque"),
        Column("position_deg", "mounting position", "of the transducer about its axis"),
        Column("raw_nm", "raw torque", "relative to the zero in use"),
        Column("reading_drift_nm_per_s", "change of the torque", "slope over the window"),
        Column("reading_nm", "raw torque", "by the calibrated chain, zero subtracted"),
        Column("reading_standard_error_nm", "standard error of the mean"),
        Column("reducer_c", "temperature of the reducer"),
        Column("reference", "measured beside the standard (1: yes)"),
        Column("reference_fault", "fault code of the standard", _FAULT),
        Column("reference_hz", "frequency of the standard"),
        Column("reference_nm", "torque of the standard", "by its certificate"),
        Column(
            "samples", "number of samples", "windows of the counter that the mean is taken over"
        ),
        Column("segment", "number of the segment", "of one step torque"),
        Column("series", "number of the loading series"),
        Column("settled", "settled (1: yes)", "the drift was within its standard error"),
        Column("settle_s", "settling time of a step"),
        Column("speed_rad_s", "speed", "mean over the acquired block"),
        Column("standard_drift_nm_per_s", "change of the standard's torque"),
        Column("standard_error_nm", "standard error of the mean"),
        Column("signal", "signal of the transducer", _SIGNAL),
        Column("standard_frequency_hz", "frequency of the standard"),
        Column("standard_signal", "signal of the standard", _SIGNAL),
        Column("standard_nm", "torque of the standard"),
        Column("standard_temperature_c", "temperature of the standard"),
        Column("standard_uncertainty_nm", "standard error of the standard's mean"),
        Column("start_s", "start of the recording", "by the bench's clock"),
        Column("step", "number of the step", "within its series"),
        Column("stop_s", "end of the recording", "by the bench's clock"),
        Column("time_s", "bench time", "of samples the centre of the window"),
        Column("tick", "time of the edge", "ticks of the timebase since its start"),
        Column("timebase_hz", "frequency of the timebase"),
        Column("torque_fault", "fault code of the transducer", _FAULT),
        Column("reference_signal", "signal of the standard", _SIGNAL),
        Column("torque_hz", "frequency of the transducer"),
        Column("torque_signal", "signal of the transducer", _SIGNAL),
        Column("torque_nm", "compensated torque"),
        Column("torque_uncertainty_nm", "standard uncertainty of the compensated torque"),
        Column("transducer_c", "temperature of the transducer"),
        Column("true_torque_nm", "true torque (simulated)"),
        Column("unix_time_s", "time since 1970", "UTC by the computer's clock"),
        Column("window_s", "length of the averaging window"),
        Column("zero_nm", "zero of the readings", "by the transducer's nominal zero"),
    )
}
"""Columns by name, without side and device."""
_OF_SAMPLES = {"torque_nm": COLUMNS["raw_nm"]}
"""Names of raw samples, which contain their channel, such as ``output_torque``."""
_SIDE = re.compile(r"(?:(input|output)[-_])?(?:.*-)?(?:(input|output)_)?(.+)")


def column_of(name: str, *, samples: bool = False) -> Column:
    """Return the column of a name with or without side and device.

    Parameters
    ----------
    name : str
        Name such as ``output_torque_hz`` or ``output-steady-standard_nm``.
    samples : bool
        Whether it is a column of raw samples, where ``output_torque_nm`` isn't compensated.

    Examples
    --------
    >>> column_of("output-steady-standard_nm").description, column_of("output_torque_hz").unit
    ('torque of the standard', 'Hz')
    >>> column_of("oil_c").description, column_of("load").description
    ('temperature oil', '')
    """
    match = _SIDE.fullmatch(name)
    assert match is not None
    side, stem = cast("Side", match[1] or match[2] or ""), match[3]
    known = (_OF_SAMPLES if samples else {}).get(stem) or COLUMNS.get(stem)
    if known is not None:
        return replace(known, name=name, side=side)
    if stem.endswith("_c"):
        probe = stem.removesuffix("_c").replace("_", " ")
        return Column(name, Message("temperature {name}", probe), side=side)
    return Column(name, "")


def short_names(keys: list[str]) -> dict[str, str]:
    """Return column names without devices, if that is unambiguous.

    Examples
    --------
    >>> short_names(["input-steady-speed_rpm", "output-steady-speed_rpm", "point-series"])
    {'input-steady-speed_rpm': 'input_speed_rpm', 'output-steady-speed_rpm': 'output_speed_rpm',
     'point-series': 'series'}
    """
    names = [key.rpartition("-")[2] for key in keys]
    short = {
        key: name if names.count(name) == 1 else f"{key.partition('-')[0]}_{name}"
        for key, name in zip(keys, names, strict=True)
    }
    return short if len(set(short.values())) == len(short) else {key: key for key in keys}
