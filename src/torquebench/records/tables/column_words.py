"""Units and descriptions of columns of recorded and exported files, by the columns' endings."""

import re

__all__ = ["column_unit", "column_words", "short_names"]

_COLUMNS = {
    "angle_counts": ("counts", "Angle in counts of the encoder, unwrapped, clockwise positive"),
    "angle_deg": ("deg", "Angle of the shaft in the middle of the window"),
    "branch": (
        "1",
        "Whether the magnitude of the torque rises (up, 1) or falls (down, -1); 0 or unknown: "
        "neither is known",
    ),
    "c": ("°C", "Temperature"),
    "commanded_nm": ("N·m", "Torque that the drive was told"),
    "compensated_nm": ("N·m", "Compensated torque"),
    "counter_identity": ("", "The clock that timed the pulses"),
    "drift_nm_per_s": ("N·m/s", "How fast the torque still changed within the window"),
    "fault": (
        "1",
        "0: the value counts; 255: the channel was not in use; any other number: no pulses, pulses "
        "outside the valid range or irregular ones, so the value beside it doesn't count",
    ),
    "group": ("1", "Number of the group of points"),
    "hz": ("Hz", "Frequency of the transducer, as counted"),
    "nm": ("N·m", "Torque by the zero in use; a standard's by its certificate too"),
    "nominal_nm": ("N·m", "Torque that the step aims at"),
    "position_deg": ("deg", "Mounting position of the transducer about its axis"),
    "rad_s": ("rad/s", "Mean speed over the acquired block"),
    "reading_nm": ("N·m", "Torque as the calibrated chain reads it, zero subtracted"),
    "s": ("s", "Time of the bench's clock"),
    "samples": ("1", "How many samples the steady value is the mean of"),
    "series": ("1", "Number of the loading series"),
    "settled": ("1", "Whether the torque stood still when the value was taken"),
    "speed_rpm": ("rpm", "Speed"),
    "standard_error_nm": ("N·m", "Standard error of the mean"),
    "standard_frequency_hz": ("Hz", "Frequency of the standard's transducer"),
    "standard_nm": ("N·m", "Torque of the standard"),
    "standard_uncertainty_nm": ("N·m", "Standard uncertainty of the standard's steady value"),
    "step": ("1", "Number of the step within its series"),
    "target_nm": ("N·m", "Torque that the step aims at"),
    "temperature_c": ("°C", "Temperature of the transducer"),
    "time_s": ("s", "Time of the bench's clock; of samples the centre of the counter's window"),
    "torque_uncertainty_nm": ("N·m", "Standard uncertainty of the compensated torque (k = 1)"),
    "true_torque_nm": ("N·m", "True torque, which only a simulated bench knows"),
    "zero_nm": ("N·m", "Zero that the reading counts from, by the transducer's nominal zero"),
    "zero_temperature_c": ("°C", "Temperature of the transducer when its zero was taken"),
    "standard_temperature_c": ("°C", "Temperature of the standard"),
    "unix_time_s": ("s", "Time since 1970-01-01 UTC by the computer's clock"),
}
_LONGEST_FIRST = sorted(_COLUMNS, key=len, reverse=True)
_PLACES = {"reference": "the standard", "torque": "the module's transducer"}
_OF_A_CHANNEL = ("hz", "fault")


def _ending(column: str) -> str:
    return next((each for each in _LONGEST_FIRST if re.search(rf"(^|[-_]){each}$", column)), "")


def column_unit(column: str) -> tuple[str, str]:
    """Return unit and description of a column; both are empty if it is unknown.

    Examples
    --------
    >>> column_unit("output_torque_hz")
    ('Hz', 'Frequency of the transducer, as counted')
    """
    return _COLUMNS.get(_ending(column), ("", ""))


def column_words(column: str, unit: str = "") -> str:
    """Return a sentence with a column's meaning, side and unit.

    Examples
    --------
    >>> column_words("output-steady-standard_nm")
    'Torque of the standard, in N·m. (output side)'
    >>> column_words("reducer_c")
    'Temperature of the probe reducer, in °C.'
    """
    side = re.search(r"\b(input|output)(?=[-_])", column)
    where = f" ({side[1]} side)" if side else ""
    ending = _ending(column)
    known, said = column_unit(column)
    if ending == "c":
        said = f"Temperature of the probe {column.removesuffix('_c')}"
    shown = known or unit
    in_unit = f", in {shown}" if shown not in ("", "1", "counts") else ""
    place = next((words for key, words in _PLACES.items() if f"_{key}_" in column), "")
    of_place = f" Of {place}." if place and ending in _OF_A_CHANNEL else ""
    return f"{said or 'As its name says'}{in_unit}.{of_place}{where}"


def short_names(keys: list[str]) -> dict[str, str]:
    """Return column names without devices where that is unambiguous.

    Examples
    --------
    >>> short_names(["input-steady-speed_rpm", "output-steady-speed_rpm", "point-series"])
    {'input-steady-speed_rpm': 'input_speed_rpm', 'output-steady-speed_rpm': 'output_speed_rpm',
     'point-series': 'series'}
    """
    names = [key.rpartition("-")[2] for key in keys]
    found = {
        key: name if names.count(name) == 1 else f"{key.partition('-')[0]}_{name}"
        for key, name in zip(keys, names, strict=True)
    }
    return found if len(set(found.values())) == len(found) else {key: key for key in keys}
