"""Descriptions of an exported run's files, for readers without the software."""

__all__ = ["file_words"]

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


def file_words(name: str) -> str:
    """Return the description of a file of an export.

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
