"""What the files and columns of an exported run are, in words for somebody without the software."""

import re

__all__ = ["column_words", "file_words"]

_FILES = {
    "README.txt": "This text.",
    "SHA256SUMS.txt": "SHA-256 of every other file; `sha256sum -c SHA256SUMS.txt` compares them.",
    "calibration.csv": "The points of the calibration in measuring order.",
    "original": "The run's own files, byte by byte as they were sealed; manifest.json in it lists "
    "their SHA-256. events.jsonl holds one JSON document a line (format: event-model), the raw "
    "samples lie in Apache Parquet.",
    "raw_samples.csv": "What the counters and probes delivered all the time, one line a window.",
    "registry.json": "What the registry holds of this run: calibrations, models, verifications, "
    "certificates, reviews, amendments. chain_end is the end of its hash chain at the export.",
    "results.json": "What the run found, as it was sealed.",
    "run.json": "What was known before the run: bench, instruments, profile, operator.",
}

_COLUMNS = {
    "angle_counts": "Angle in counts of the encoder.",
    "branch": "Whether the magnitude of the torque rises (up, 1) or falls (down, -1); 0 or "
    "unknown: neither is known.",
    "commanded_nm": "Torque that the drive was told, in N·m.",
    "counter_identity": "The clock that timed the pulses.",
    "drift_nm_per_s": "How fast the torque still changed within the window, in N·m/s.",
    "fault": "0: the value counts; any other number: no pulses, pulses outside the valid range or "
    "irregular ones, so the value beside it doesn't count.",
    "frequency_hz": "Frequency of the transducer, in Hz.",
    "group": "Number of the group of points.",
    "hz": "Frequency of the transducer, in Hz.",
    "nominal_nm": "Torque that the step aims at, in N·m.",
    "position_deg": "Mounting position of the transducer about its axis, in degrees.",
    "reading_nm": "Torque as the calibrated chain reads it, zero subtracted, in N·m.",
    "samples": "How many samples the steady value is the mean of.",
    "series": "Number of the loading series.",
    "settled": "Whether the torque stood still when the value was taken.",
    "speed_rpm": "Speed, in revolutions a minute.",
    "standard_error_nm": "Standard error of the mean, in N·m.",
    "standard_frequency_hz": "Frequency of the standard's transducer, in Hz.",
    "standard_nm": "Torque of the standard, in N·m.",
    "standard_uncertainty_nm": "Standard uncertainty of the standard's steady value, in N·m.",
    "step": "Number of the step within its series.",
    "target_nm": "Torque that the step aims at, in N·m.",
    "temperature_c": "Temperature of the transducer, in °C.",
    "time_s": "Time of the bench's clock, in s.",
    "true_torque_nm": "True torque, which only a simulated bench knows, in N·m.",
    "unix_time_s": "Seconds since 1970-01-01 UTC, by the computer's clock.",
}

_PLACES = {"reference": "the standard", "torque": "the module's transducer", "angle": "the encoder"}


_OF_A_CHANNEL = ("hz", "fault")


def file_words(name: str) -> str:
    """Return what a file of an export is.

    Examples
    --------
    >>> file_words("points.csv")
    'Every recorded value of this kind of event, one line each.'
    """
    if name in _FILES:
        return _FILES[name]
    if name.startswith("certificate-"):
        kinds = {
            "pdf": "Certificate to read and print.",
            "xml": "The same for machines: PTB's digital calibration certificate 3.3.0.",
            "json": "The record that PDF and XML were written from.",
        }
        return kinds[name.rpartition(".")[2]]
    if name.startswith("model-"):
        return "A compensation model that was fitted to the calibration, with all its parameters."
    if name.endswith(".csv"):
        return "Every recorded value of this kind of event, one line each."
    return "Written by the run; see its content."


def column_words(column: str, unit: str = "") -> str:
    """Return what a column is; its unit where the words don't have it.

    Examples
    --------
    >>> column_words("output-steady-standard_nm")
    'Torque of the standard, in N·m. (output side)'
    >>> column_words("reducer_c")
    'Temperature of the probe reducer, in °C.'
    """
    side = re.search(r"\b(input|output)(?=[-_])", column)
    where = f" ({side[1]} side)" if side else ""
    for known in sorted(_COLUMNS, key=len, reverse=True):
        if re.search(rf"(^|[-_]){re.escape(known)}$", column):
            place = next((words for key, words in _PLACES.items() if f"_{key}_" in column), "")
            of_place = f" Of {place}." if place and known in _OF_A_CHANNEL else ""
            return _COLUMNS[known] + of_place + where
    if column.endswith("_c"):
        return f"Temperature of the probe {column.removesuffix('_c')}, in °C."
    return f"As its name says{f', in {unit}' if unit else ''}." + where
