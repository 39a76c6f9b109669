"""Write the files of a certificate and register it."""

import hashlib
import json
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from torquebench.atomic_write import atomic_write, private_folder
from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.records import CertificateEntry, Registry, Review
from torquebench.reports.certificate.dcc import certificate_xml
from torquebench.reports.certificate.record import CertificateRecord
from torquebench.reports.certificate.typesetting import certificate_pdf

UNREGISTERED = ".unregistered-"
"""Part of the name of a folder with the files of a certificate that was never registered."""


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
    """Return the folder of a certificate's files in the data directory."""
    return registry.root / "certificates" / number


def issue_certificate(
    registry: Registry,
    record: CertificateRecord,
    folder: Path | None = None,
    review: Review | None = None,
) -> IssuedCertificate:
    """Write the files of a certificate and register it.

    The data directory keeps a copy in ``certificates/NUMBER``. If an earlier attempt was
    interrupted before the registration, its folder is renamed.

    Parameters
    ----------
    registry : Registry
    record : CertificateRecord
        The record from `build_record`.
    folder : pathlib.Path, optional
        Folder for a second copy; it is created. Nothing in it is overwritten.
    review : Review, optional
        A review to register in the same transaction.

    Raises
    ------
    InputError
        Where a file exists already, the folder can't be written, or a font is missing.
    RecordError
        Where the record is a draft or its number exists already; then nothing is written.
    """
    if record.draft:
        raise RecordError("a draft", "a record with an authorising person")
    if any(entry.number == record.number for entry in registry.certificates()):
        raise RecordError(
            Message("certificate {number} is already issued", record.number),
            "a new number",
            "give another --number",
        )
    contents = certificate_files(record)
    archive = archive_folder(registry, record.number)
    for name in contents:
        if folder is not None and (folder / name).exists():
            raise InputError(
                Message("{path} exists", folder / name),
                "files that don't exist yet",
                "give another --out",
            )
    _set_aside(archive)
    private_folder(archive)
    _write(archive, contents, private=True)
    entry = CertificateEntry.of_record(
        json.loads(record.to_json()),
        {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()},
        registry.stored(archive),
        issued=datetime.now(UTC),
        calibration_id=record.calibration_id,
    )

    def register() -> None:
        known = registry.certificates(record.calibration_id)
        if not any(each.number == entry.number and each.files == entry.files for each in known):
            # if it is registered, the server failed after it had stored the entry
            with registry.writing():
                if review is not None:
                    registry.add(review)
                registry.add_certificate(entry)

    registry.patiently(register)
    if folder is not None:  # the second copy is written only after registration
        _write(folder, contents)
    files = tuple((folder or archive) / name for name in contents)
    return IssuedCertificate(record, files, entry)


def _set_aside(archive: Path) -> None:
    """Rename files that were written under a number that was never registered."""
    if archive.exists():
        archive.rename(archive.with_name(f"{archive.name}{UNREGISTERED}{secrets.token_hex(4)}"))


def _write(folder: Path, contents: Mapping[str, bytes], *, private: bool = False) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        atomic_write(folder / name, content, private=private)


def unregistered_certificates(registry: Registry) -> tuple[Path, ...]:
    """Return folders of certificates whose files were written but that weren't registered."""
    known = {entry.number for entry in registry.certificates()}
    folder = registry.root / "certificates"
    found = sorted(folder.iterdir()) if folder.is_dir() else []
    return tuple(path for path in found if path.name not in known and UNREGISTERED not in path.name)
