"""What stays: tables in and out, the folder of each run, and the registry of all records.

Outputs are written whole or not at all, and nothing is overwritten or filled in. A name is
imported when somebody asks for it, so that a list of records doesn't wait for numerics.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from torquebench.records.chain import ChainHead
    from torquebench.records.csv_text import decode_csv
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
        parse_calibration_csv,
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
    "decode_csv",
    "folder_changes",
    "json_text",
    "new_run_id",
    "parse_calibration_csv",
    "read_calibration_csv",
    "read_readings_csv",
    "sha256_of_file",
    "write_atomically",
    "write_calibration_csv",
    "write_torque_csv",
]

_HOMES = {
    "ChainHead": "chain",
    "decode_csv": "csv_text",
    "REGISTRY_FILE": "database",
    "REGISTRY_URL": "database",
    "Activation": "entries",
    "Adjustment": "entries",
    "Amendment": "entries",
    "CalibrationEntry": "entries",
    "CertificateEntry": "entries",
    "CheckEntry": "entries",
    "Component": "entries",
    "Equipment": "entries",
    "EquipmentKind": "entries",
    "ModelEntry": "entries",
    "Report": "entries",
    "Review": "entries",
    "RunSummary": "entries",
    "VerificationEntry": "entries",
    "Zeroing": "entries",
    "json_text": "files",
    "sha256_of_file": "files",
    "write_atomically": "files",
    "Finding": "integrity",
    "IntegrityReport": "integrity",
    "anchor_of": "integrity",
    "calibration_changes": "integrity",
    "check_records": "integrity",
    "folder_changes": "integrity",
    "RawReading": "raw_stream",
    "Registry": "registry",
    "MANIFEST": "run_folder",
    "Recovery": "run_folder",
    "RunFolder": "run_folder",
    "RunWriter": "run_folder",
    "new_run_id": "run_folder",
    "ReadingsTable": "tables",
    "calibration_csv": "tables",
    "parse_calibration_csv": "tables",
    "read_calibration_csv": "tables",
    "read_readings_csv": "tables",
    "write_calibration_csv": "tables",
    "write_torque_csv": "tables",
}


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
