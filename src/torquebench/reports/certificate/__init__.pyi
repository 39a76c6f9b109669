from .building import (
    DEFAULT_TOLERANCE_PERCENT_FS as DEFAULT_TOLERANCE_PERCENT_FS,
    UNREVIEWED as UNREVIEWED,
    Issue as Issue,
    build_record as build_record,
    calibration_of as calibration_of,
    run_data as run_data,
)
from .checking import (
    CertificateCheck as CertificateCheck,
    check_certificate as check_certificate,
    schema_findings as schema_findings,
)
from .dcc import (
    certificate_xml as certificate_xml,
)
from .issuing import (
    IssuedCertificate as IssuedCertificate,
    archive_folder as archive_folder,
    certificate_files as certificate_files,
    issue_certificate as issue_certificate,
    unregistered_certificates as unregistered_certificates,
)
from .labels import (
    LANGUAGES as LANGUAGES,
)
from .laboratory import (
    LABORATORY_FILE as LABORATORY_FILE,
    Letterhead as Letterhead,
    kept_letterhead as kept_letterhead,
    person_among as person_among,
    read_letterhead as read_letterhead,
)
from .record import (
    CertificateRecord as CertificateRecord,
)
from .typesetting import (
    certificate_pages as certificate_pages,
    certificate_pdf as certificate_pdf,
)
from .source import (
    run_profile as run_profile,
)
