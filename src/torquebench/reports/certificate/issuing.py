"""Write the files of a certificate and enter them in the registry."""

import hashlib
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from torquebench.atomic_write import atomic_write
from torquebench.errors import InputError, RecordError
from torquebench.records import CertificateEntry, Registry
from torquebench.reports.certificate.dcc import certificate_xml
from torquebench.reports.certificate.record import CertificateRecord
from torquebench.reports.certificate.typesetting import certificate_pdf

__all__ = ["IssuedCertificate", "archive_folder", "certificate_files", "issue_certificate"]


@dataclass(frozen=True)
class IssuedCertificate:
    """A certificate with its files and its entry in the registry."""

    record: CertificateRecord
    files: tuple[Path, ...]
    entry: CertificateEntry


def certificate_files(record: CertificateRecord) -> dict[str, bytes]:
    """Return the files of a certificate by their names: a PDF per language, XML and JSON.

    Raises
    ------
    InputError
        Where a font is missing.
    """
    files = {
        f"{record.number}-{language}.pdf": certificate_pdf(record, language)
        for language in record.languages
    }
    files[f"{record.number}.xml"] = certificate_xml(record)
    files[f"{record.number}.json"] = record.to_json().encode()
    return files


def archive_folder(registry: Registry, number: str) -> Path:
    """Return where the data directory keeps the files of a certificate."""
    return registry.root / "certificates" / number


def issue_certificate(
    registry: Registry, record: CertificateRecord, folder: Path | None = None
) -> IssuedCertificate:
    """Write the files of a certificate and register it.

    The data directory keeps one copy in ``certificates/NUMBER``.

    Parameters
    ----------
    registry : Registry
    record : CertificateRecord
        As `build_record` returns it.
    folder : pathlib.Path, optional
        Where a second copy goes; it is created. Nothing in it is overwritten.

    Raises
    ------
    InputError
        Where a file is there already, the folder can't be written, or a font is missing.
    RecordError
        Where the record is a draft or its number is taken; nothing is written then.
    """
    if record.draft:
        raise RecordError("a draft", "a record that somebody authorises")
    if any(entry.number == record.number for entry in registry.certificates()):
        raise RecordError(
            f"certificate {record.number} is issued", "a new number", "give another --number"
        )
    contents = certificate_files(record)
    folders = [archive_folder(registry, record.number), *([] if folder is None else [folder])]
    for place in folders:
        for name in contents:
            if (place / name).exists():
                raise InputError(
                    f"{place / name} exists", "files that aren't there yet", "give another --out"
                )
    for place in folders:
        place.mkdir(parents=True, exist_ok=True)
        for name, content in contents.items():
            atomic_write(place / name, content)
    files = tuple(folders[-1] / name for name in contents)
    conformity = record.conformity
    entry = registry.add_certificate(
        record.number,
        record.calibration_id,
        authorised_by=", ".join(record.authorised_by),
        files={name: hashlib.sha256(content).hexdigest() for name, content in contents.items()},
        summary={
            "record_sha256": record.sha256,
            "languages": list(record.languages),
            "simulated": record.simulated,
            "verdict": None if conformity is None else conformity.verdict.value,
            "tolerance_percent_fs": None if conformity is None else conformity.tolerance_percent_fs,
            "archive": registry.stored(folders[0]),
            "profile": record.method.name,
            "profile_sha256": record.method.sha256,
            "deviations": [each.clause for each in record.deviations],
        },
        supersedes=record.supersedes,
        issued=datetime.now(UTC),
    )
    return IssuedCertificate(record, files, entry)
