"""Descriptions of an exported run's files, for readers without the software."""

_FILES = {
    "README.txt": "This text.",
    "SHA256SUMS.txt": "SHA-256 of every other file; `sha256sum -c SHA256SUMS.txt` compares them.",
    "annotations.csv": "What people noted while it was recorded, at which bench time.",
    "calibration.csv": "The points of the calibration in measuring order.",
    "original": (
        "The run's files, unchanged since they were sealed; manifest.json lists their "
        "SHA-256. events.jsonl contains one JSON document per line (format: event-model); "
        "the raw samples are in Apache Parquet."
    ),
    "raw_samples.csv": "All data of the counters and probes, one line per window.",
    "registry.json": (
        "The registry's records about this run: calibrations, models, verifications, "
        "certificates, reviews, amendments. chain_end is the end of the registry's hash "
        "chain at the time of the export."
    ),
    "results.json": "Results of the run, as they were sealed.",
    "run.json": "Metadata from the start of the run: bench, instruments, profile, operator.",
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
            "xml": "The certificate for machines: PTB's digital calibration certificate 3.3.0.",
            "json": "The record that PDF and XML were written from.",
        }
        return kinds[name.rpartition(".")[2]]
    if name.startswith("model-"):
        return "A compensation model that was fitted to the calibration, with all its parameters."
    if name.endswith(".csv"):
        return "Every recorded value of this kind of event, one line each."
    return "Written by the run; see its content."
