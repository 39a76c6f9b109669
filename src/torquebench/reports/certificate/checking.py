"""Check whether a certificate's file or QR code is that of an issued certificate."""

import hashlib
import re
from dataclasses import dataclass, replace
from pathlib import Path

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.records import CertificateEntry, Registry
from torquebench.records.signatures import Signature, how
from torquebench.reports.certificate.laboratory import kept_letterhead
from torquebench.reports.certificate.record import PAYLOAD_PREFIX
from torquebench.tables import DigitalCertificate, parse_dcc

_PAYLOAD = re.compile(rf"{PAYLOAD_PREFIX};([^;\s<>()]+);([0-9a-f]{{64}})")
_DCC_NAMESPACE = b"https://ptb.de/dcc"
_PLACE = re.compile(r"/Q\{[^}]*\}")
_SIGNATURE = "{http://www.w3.org/2000/09/xmldsig#}Signature"
MOST_BYTES = 64 << 20


@dataclass(frozen=True)
class CertificateCheck:
    """Result of a check.

    Parameters
    ----------
    number : str
        Number in the file or code; empty if there is none.
    entry : CertificateEntry or None
        The registered certificate with this number.
    findings : tuple of str
        Differences; empty for an unchanged certificate.
    acts : tuple of (role, name, Signature or None)
        How the persons who reviewed, activated and authorised were authenticated.
    unsigned : tuple of str
        Typed reviews, activations and authorisations, if the laboratory requires signatures.
    schema : {"valid", "invalid", "not checked", ""}
        Result of the schema's check of a digital certificate; empty for other files.
    replaced_by : str
        Number of the certificate that replaced this one.
    foreign : DigitalCertificate or None
        Content of another laboratory's digital certificate.
    """

    number: str
    entry: CertificateEntry | None
    findings: tuple[str, ...]
    schema: str = ""
    replaced_by: str = ""
    acts: tuple[tuple[str, str, Signature | None], ...] = ()
    unsigned: tuple[str, ...] = ()
    foreign: DigitalCertificate | None = None

    @property
    def matches(self) -> bool:
        """Whether there are no findings and no missing signatures."""
        return not self.findings and not self.unsigned


def check_certificate(registry: Registry | None, given: str) -> CertificateCheck:
    """Compare a certificate's file, or the text of its QR code, with the registry.

    A file must be identical to the issued one; a code must contain number and hash of an issued
    record; XML is also checked by schema and schematron. If the laboratory requires signatures,
    typed reviews and authorisations are listed. A digital certificate of another laboratory is only
    checked by the schema.

    Parameters
    ----------
    registry : Registry or None
        None checks certificates of other laboratories only.
    given : str
        Path of a PDF, XML or JSON file, or the text of the QR code.

    Raises
    ------
    InputError
        Where it is neither a file nor the text of a QR code.
    """
    code = _PAYLOAD.fullmatch(given.strip())
    path = Path(given)
    if code is None and not path.is_file():
        raise InputError(
            Message("{given!r} is neither a file nor the code of a certificate", given),
            Message(
                "a PDF, XML or JSON file, or a text like {payload_prefix};NUMBER;HASH",
                PAYLOAD_PREFIX,
            ),
        )
    certificates = [] if registry is None else registry.certificates()
    if code is not None:
        return _with_acts(registry, _checked(certificates, code[1], code[2], None))
    with path.open("rb") as file:
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        size = Message("{origin}: more than {size} MB", path, MOST_BYTES >> 20)
        raise InputError(size, "a smaller file")
    digest = hashlib.sha256(content).hexdigest()
    number, record_sha256 = _stated(content, digest, certificates)
    digital = _DCC_NAMESPACE in content
    faults = schema_findings(content) if digital else ()
    verdict = "invalid" if faults else "valid"
    schema = "not checked" if faults is None else verdict if digital else ""
    if digital and not number:
        foreign = parse_dcc(content, str(path))
        return CertificateCheck(foreign.number, None, faults or (), schema, foreign=foreign)
    found = _with_acts(registry, _checked(certificates, number, record_sha256, digest))
    return replace(found, findings=(*found.findings, *(faults or ())), schema=schema)


def _with_acts(registry: Registry | None, found: CertificateCheck) -> CertificateCheck:
    """Add the registered signatures to a check, and list the missing ones."""
    entry = found.entry
    if entry is None or registry is None:
        return found
    acts = entry.acts or (
        *(
            ("checked", review.checked_by, None)
            for review in registry.reviews("calibrations", entry.calibration_id)
            if review.accepted and review.checked <= entry.issued
        ),
        ("authorised", entry.authorised_by, None),
    )
    unsigned = []
    if kept_letterhead(registry.root).requires_signatures(registry.root):
        for role, name, signature in acts:
            accepted = bool(
                signature and (signature.account if role == "used" else signature.signed)
            )
            if not accepted:
                unsigned.append(f"typed, not signed: {role} by {name} ({how(signature)})")
    return replace(found, acts=acts, unsigned=tuple(unsigned))


def _stated(content: bytes, digest: str, issued: list[CertificateEntry]) -> tuple[str, str]:
    """Return number and record hash of a file, from its QR text or from the registry."""
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
        return CertificateCheck("", None, ("it contains no certificate number",))
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
    """List how a digital certificate violates PTB's schema and schematron.

    Parameters
    ----------
    content : bytes
        The XML file.

    Returns
    -------
    tuple of str or None
        Empty for a valid certificate; None if the optional package with both isn't installed or
        doesn't know the certificate's version.
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
    version = tree.get("schemaVersion", "")
    name = f"v{version}".replace(".", "_")
    known = next((each for each in SchemaVersion if each.name == name), None)
    if known is None:
        return None
    for signature in tree.findall(_SIGNATURE):  # not part of schemas before 3.2
        tree.remove(signature)
    schema = XsdValidator.from_version(known).validate_tree(tree)
    if not schema.is_valid:
        return tuple(f"schema, line {each.line}: {each.message}" for each in schema.errors)
    if known is not SchemaVersion.latest:  # dcclib has only this version's schematron
        return ()
    report = SchematronValidator.for_dcc().validate_tree(tree)
    # dcclib returns failed assertions only, but the schematron also reports forbidden content.
    return tuple(
        f"schematron, {_PLACE.sub('/', each.location)}: {' '.join(each.text.split())}"
        for each in (*report.failed_assertions, *report.successful_reports)
        if each.role == "error"
    )
