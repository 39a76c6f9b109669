"""What stays: tables in and out, the folder of each run, and the registry of all records.

Outputs are written whole or not at all, and nothing is overwritten or filled in.
"""

from torquebench.records.entries import (
    Activation,
    CalibrationEntry,
    Instrument,
    ModelEntry,
    RunSummary,
    VerificationEntry,
)
from torquebench.records.files import json_text, sha256_of_file, write_atomically
from torquebench.records.raw_stream import RawReading
from torquebench.records.registry import Registry
from torquebench.records.run_folder import Recovery, RunFolder, RunWriter, new_run_id

__all__ = [
    "Activation",
    "CalibrationEntry",
    "Instrument",
    "ModelEntry",
    "RawReading",
    "Recovery",
    "Registry",
    "RunFolder",
    "RunSummary",
    "RunWriter",
    "VerificationEntry",
    "json_text",
    "new_run_id",
    "sha256_of_file",
    "write_atomically",
]
