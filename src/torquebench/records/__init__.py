"""What stays: tables in and out, the folder of each run, and the registry of all records.

Outputs are written whole or not at all, and nothing is overwritten or filled in.
"""

from torquebench.records.chain import ChainHead
from torquebench.records.database import REGISTRY_FILE, REGISTRY_URL
from torquebench.records.entries import (
    Activation,
    Adjustment,
    Amendment,
    CalibrationEntry,
    CertificateEntry,
    CheckEntry,
    Component,
    Equipment,
    EquipmentKind,
    ModelEntry,
    Report,
    Review,
    RunSummary,
    VerificationEntry,
    Zeroing,
)
from torquebench.records.files import json_text, sha256_of_file, write_atomically
from torquebench.records.integrity import (
    Finding,
    IntegrityReport,
    anchor_of,
    calibration_changes,
    check_records,
    folder_changes,
)
from torquebench.records.raw_stream import RawReading
from torquebench.records.registry import Registry
from torquebench.records.run_folder import MANIFEST, Recovery, RunFolder, RunWriter, new_run_id
from torquebench.records.tables import (
    ReadingsTable,
    calibration_csv,
    read_calibration_csv,
    read_readings_csv,
    write_calibration_csv,
    write_torque_csv,
)

__all__ = [
    "MANIFEST",
    "REGISTRY_FILE",
    "REGISTRY_URL",
    "Activation",
    "Adjustment",
    "Amendment",
    "CalibrationEntry",
    "CertificateEntry",
    "ChainHead",
    "CheckEntry",
    "Component",
    "Equipment",
    "EquipmentKind",
    "Finding",
    "IntegrityReport",
    "ModelEntry",
    "RawReading",
    "ReadingsTable",
    "Recovery",
    "Registry",
    "Report",
    "Review",
    "RunFolder",
    "RunSummary",
    "RunWriter",
    "VerificationEntry",
    "Zeroing",
    "anchor_of",
    "calibration_changes",
    "calibration_csv",
    "check_records",
    "folder_changes",
    "json_text",
    "new_run_id",
    "read_calibration_csv",
    "read_readings_csv",
    "sha256_of_file",
    "write_atomically",
    "write_calibration_csv",
    "write_torque_csv",
]
