"""Whether a certificate is the issued one."""

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.records import CertificateEntry, Registry
from torquebench.reports.certificate.record import PAYLOAD_PREFIX

__all__ = ["CertificateCheck", "check_certificate", "schema_findings"]

_PAYLOAD = re.compile(rf"{PAYLOAD_PREFIX};([^;\s<>()]+);([0-9a-f]{{64}})")
_DCC_NAMESPACE = b"https://ptb.de/dcc"


@dataclass(frozen=True)
class CertificateCheck:
    """Result of a check.

    Parameters
    ----------
    number : str
        Number that file or code states; empty where it states none.
    entry : CertificateEntry or None
        The certificate of this number in the registry.
    findings : tuple of str
        Differences; empty for an unchanged certificate.
    schema : {"valid", "invalid", "not checked", ""}
        Of a digital certificate; empty for other files.
    replaced_by : str
        Number of the certificate that has replaced this one.
    """

    number: str
    entry: CertificateEntry | None
    findings: tuple[str, ...]
    schema: str = ""
    replaced_by: str = ""

    @property
    def matches(self) -> bool:
        """Whether there are no findings."""
        return not self.findings


def check_certificate(registry: Registry, given: str) -> CertificateCheck:
    """Compare a certificate's file, or the text of its QR code, with the registry.

    A file must have the very bytes that were issued; a code must have number and hash of an
    issued record; XML is compared with schema and schematron too.

    Parameters
    ----------
    registry : Registry
    given : str
        Path of a PDF, XML or JSON file, or the text that a scanner reads from the code.

    Raises
    ------
    InputError
        Where it is neither a file nor such a text.
    """
    code = _PAYLOAD.fullmatch(given.strip())
    path = Path(given)
    if code is None and not path.is_file():
        raise InputError(
            Message("{given!r} is no file and no code of a certificate", given),
            Message(
                "a PDF, XML or JSON file, or a text like {payload_prefix};NUMBER;HASH",
                PAYLOAD_PREFIX,
            ),
        )
    certificates = registry.certificates()
    if code is not None:
        return _checked(certificates, code[1], code[2], None)
    content = path.read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    number, record_sha256 = _stated(content, digest, certificates)
    found = _checked(certificates, number, record_sha256, digest)
    if _DCC_NAMESPACE not in content:
        return found
    faults = schema_findings(content)
    verdict = "invalid" if faults else "valid"
    schema = "not checked" if faults is None else verdict
    return CertificateCheck(
        found.number, found.entry, (*found.findings, *(faults or ())), schema, found.replaced_by
    )


def _stated(content: bytes, digest: str, issued: list[CertificateEntry]) -> tuple[str, str]:
    """Return number and record hash of a file, by its code or by its registration."""
    stated = _PAYLOAD.search(content.decode("utf-8", "replace"))
    if stated is not None:
        return stated[1], stated[2]
    for entry in issued:
        if digest in entry.files.values():
            return entry.number, str(entry.summary.get("record_sha256", ""))
    return "", ""


def _checked(
    issued: list[CertificateEntry], number: str, record_sha256: str, digest: str | None
) -> CertificateCheck:
    if not number:
        return CertificateCheck("", None, ("it states no number of a certificate",))
    entry = next((each for each in issued if each.number == number), None)
    if entry is None:
        return CertificateCheck(number, None, (f"no certificate {number} is registered here",))
    findings = []
    if record_sha256 != entry.summary.get("record_sha256"):
        findings.append(
            f"its record has SHA-256 {record_sha256}; registered for {number}: "
            f"{entry.summary.get('record_sha256')}"
        )
    if digest is not None and digest not in entry.files.values():
        findings.append(
            f"the file has SHA-256 {digest}, which is none of the files issued as {number}"
        )
    return CertificateCheck(number, entry, tuple(findings), replaced_by=entry.superseded_by)


def schema_findings(content: bytes) -> tuple[str, ...] | None:
    """Return the violations of PTB's schema and schematron by a digital certificate.

    Parameters
    ----------
    content : bytes
        The XML file.

    Returns
    -------
    tuple of str or None
        Empty for a valid one; None where the optional package that bundles both isn't installed.
    """
    try:
        from dcclib.validation import SchematronValidator, XsdValidator
        from dcclib.validation.xsd import SchemaVersion
        from lxml import etree
    except ImportError:
        return None
    try:
        tree = etree.fromstring(content, etree.XMLParser(resolve_entities=False, no_network=True))
    except etree.XMLSyntaxError as error:
        return (f"no XML: {error}",)
    schema = XsdValidator.from_version(SchemaVersion.v3_3_0).validate_tree(tree)
    if not schema.is_valid:
        return tuple(f"schema, line {each.line}: {each.message}" for each in schema.errors)
    report = SchematronValidator.for_dcc().validate_tree(tree)
    # dcclib counts failed assertions only; the schematron also reports forbidden content.
    return tuple(
        f"schematron, {each.location}: {' '.join(each.text.split())}"
        for each in (*report.failed_assertions, *report.successful_reports)
        if each.role == "error"
    )
