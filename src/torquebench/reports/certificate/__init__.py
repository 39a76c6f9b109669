"""Certificates of calibrations: one record, and from it a PDF per language and a digital XML.

`build_record` gathers what a calibration in the registry allows to state, `issue_certificate`
writes and registers the files, and `check_certificate` tells whether a file is one of them.
"""

from torquebench.reports.certificate.building import (
    DEFAULT_TOLERANCE_PERCENT_FS,
    Issue,
    build_record,
    calibration_of,
    run_data,
)
from torquebench.reports.certificate.checking import (
    CertificateCheck,
    check_certificate,
    schema_findings,
)
from torquebench.reports.certificate.dcc import certificate_xml
from torquebench.reports.certificate.issuing import (
    IssuedCertificate,
    archive_folder,
    certificate_files,
    issue_certificate,
)
from torquebench.reports.certificate.labels import LANGUAGES
from torquebench.reports.certificate.laboratory import (
    LABORATORY_FILE,
    Letterhead,
    read_letterhead,
)
from torquebench.reports.certificate.record import CertificateRecord
from torquebench.reports.certificate.typesetting import certificate_pdf

__all__ = [
    "DEFAULT_TOLERANCE_PERCENT_FS",
    "LABORATORY_FILE",
    "LANGUAGES",
    "CertificateCheck",
    "CertificateRecord",
    "Issue",
    "IssuedCertificate",
    "Letterhead",
    "archive_folder",
    "build_record",
    "calibration_of",
    "certificate_files",
    "certificate_pdf",
    "certificate_xml",
    "check_certificate",
    "issue_certificate",
    "read_letterhead",
    "run_data",
    "schema_findings",
]
