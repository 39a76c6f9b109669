"""The digital calibration certificate: XML by PTB's DCC schema, version 3.3.0."""

import re
from collections.abc import Callable, Sequence
from functools import partial
from xml.etree import ElementTree

from torquebench.reports.certificate.content import (
    act_words,
    chain_words,
    not_in_u_words,
    place_words,
    unreviewed_words,
    verification_words,
)
from torquebench.reports.certificate.labels import Labels, labels_of
from torquebench.reports.certificate.record import (
    CertificateRecord,
    Conformity,
    Party,
    ResultRow,
    StaticTable,
)
from torquebench.reports.certificate.static_content import (
    STATIC_QUANTITIES,
    class_words,
    zero_hysteresis_words,
)
from torquebench.uncertainty import rounded

SCHEMA_VERSION = "3.3.0"

_DCC = "https://ptb.de/dcc"
_SI = "https://ptb.de/si"
_NEWTON_METRE = r"\newton\metre"
_COVERAGE = 0.9545
_UNKNOWN_COUNTRY = "AQ"
"""Antarctica, for an unknown country: the schematron requires an existing one.
"""


def certificate_xml(record: CertificateRecord) -> bytes:
    """Return the digital calibration certificate.

    Parameters
    ----------
    record : CertificateRecord

    Returns
    -------
    bytes
        XML in UTF-8 with the words of all languages of the record; the same record gives the same
        bytes. Numbers are rounded as in the PDF: uncertainties to two significant digits.
    """
    root = _Writer(record).certificate()
    ElementTree.register_namespace("dcc", _DCC)
    ElementTree.register_namespace("si", _SI)
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


def _add(parent: ElementTree.Element, name: str, text: str | None = None) -> ElementTree.Element:
    namespace, _, local = name.rpartition(":")
    space = _SI if namespace == "si" else _DCC
    child = ElementTree.SubElement(parent, f"{{{space}}}{local}")
    if text is not None:
        child.text = " ".join(text.split())
    return child


class _Writer:
    """Builds the XML tree of one record."""

    def __init__(self, record: CertificateRecord) -> None:
        self.record = record
        self.words: dict[str, Labels] = {name: labels_of(name) for name in record.languages}

    def certificate(self) -> ElementTree.Element:
        root = ElementTree.Element(
            f"{{{_DCC}}}digitalCalibrationCertificate", {"schemaVersion": SCHEMA_VERSION}
        )
        self._administrative(_add(root, "administrativeData"))
        self._results(_add(root, "measurementResults"))
        return root

    # Texts in every language of the certificate

    def _spoken(
        self, parent: ElementTree.Element, name: str, said: Callable[[Labels], str | None]
    ) -> None:
        """Add an element with a text in each language of the certificate."""
        element = _add(parent, name)
        for language, words in self.words.items():
            _add(element, "content", said(words)).set("lang", language)

    def _words(self, parent: ElementTree.Element, name: str, *keys: str, **values: object) -> None:
        """Add an element with the text of labels in each language."""
        self._spoken(
            parent, name, lambda words: " ".join(words[key].format(**values) for key in keys)
        )

    def _text(self, parent: ElementTree.Element, name: str, text: str) -> None:
        """Add an element without a language: a name, a serial number, a recorded text."""
        _add(_add(parent, name), "content", text)

    # Administrative data

    def _administrative(self, parent: ElementTree.Element) -> None:
        record = self.record
        self._software(_add(parent, "dccSoftware"))
        self._core(_add(parent, "coreData"))
        self._item(_add(_add(parent, "items"), "item"))
        laboratory = _add(parent, "calibrationLaboratory")
        self._contact(_add(laboratory, "contact"), record.laboratory)
        persons = _add(parent, "respPersons")
        roles = [
            (name, "authorised", place == 0) for place, name in enumerate(record.authorised_by)
        ]
        # The schema requires a responsible person even in a draft that nobody has authorised.
        roles = roles or [("-", "authorised", True)]
        acts = {act.role: act for act in record.acts}
        roles += [(act.name, act.role, False) for act in record.acts if act.role != "authorised"]
        for name, role, main in roles:
            if name:
                person = _add(persons, "respPerson")
                self._text(_add(person, "person"), "name", name)
                if role in acts:
                    self._spoken(person, "description", partial(act_words, acts[role]))
                _add(person, "role", role)
                _add(person, "mainSigner", "true" if main else "false")
        self._contact(_add(parent, "customer"), record.customer)
        self._statements(_add(parent, "statements"))

    def _software(self, parent: ElementTree.Element) -> None:
        software = _add(parent, "software")
        self._text(software, "name", "torquebench")
        numbers = re.match(r"\d+(\.\d+){0,2}", self.record.software_version)
        _add(software, "release", f"v{numbers[0] if numbers else 0}")  # the schema allows no suffix

    def _core(self, parent: ElementTree.Element) -> None:
        record = self.record
        _add(parent, "countryCodeISO3166_1", record.laboratory.country or _UNKNOWN_COUNTRY)
        for language in record.languages:
            _add(parent, "usedLangCodeISO639_1", language)
        _add(parent, "mandatoryLangCodeISO639_1", record.languages[0])
        _add(parent, "uniqueIdentifier", record.number)
        identification = _add(_add(parent, "identifications"), "identification")
        _add(identification, "issuer", "calibrationLaboratory")
        _add(identification, "value", record.payload)
        self._words(identification, "name", "record_hash")
        _add(parent, "beginPerformanceDate", record.calibrated_from.isoformat())
        _add(parent, "endPerformanceDate", record.calibrated_to.isoformat())
        _add(parent, "performanceLocation", "other" if record.item.in_place else "laboratory")
        _add(parent, "issueDate", record.issued.isoformat())
        if record.supersedes:
            replaced = _add(parent, "reportAmendedSubstituted")
            _add(replaced, "typeOfChange", "substituted")
            _add(replaced, "replacedUniqueIdentifier", record.supersedes)

    def _item(self, parent: ElementTree.Element) -> None:
        item = self.record.item
        self._spoken(parent, "name", partial(chain_words, self.record))
        if item.manufacturer:
            self._text(_add(parent, "manufacturer"), "name", item.manufacturer)
        if item.model:
            _add(parent, "model", item.model)
        identifications = _add(parent, "identifications")
        self._identification(
            identifications, "manufacturer", item.serial, "serial", "basic_serialNumber"
        )
        self._identification(identifications, "owner", item.counter_identity, "counter")
        if item.bench:
            self._identification(identifications, "owner", item.bench, "bench")

    def _identification(
        self, parent: ElementTree.Element, issuer: str, value: str, label: str, kind: str = ""
    ) -> None:
        identification = _add(parent, "identification")
        if kind:
            identification.set("refType", kind)
        _add(identification, "issuer", issuer)
        _add(identification, "value", value)
        self._words(identification, "name", label)

    def _contact(self, parent: ElementTree.Element, party: Party) -> None:
        if party.name:
            self._text(parent, "name", party.name)
        else:
            self._words(parent, "name", "not_stated")
        if party.email:
            _add(parent, "eMail", party.email)
        location = _add(parent, "location")
        _add(location, "countryCode", party.country or _UNKNOWN_COUNTRY)
        for name, value in (
            ("city", party.city),
            ("postCode", party.post_code),
            ("street", party.street),
        ):
            if value:
                _add(location, name, value)

    def _statements(self, parent: ElementTree.Element) -> None:
        record = self.record
        if record.conformity is not None:
            self._conformity(_add(parent, "statement"), record.conformity)
        for warning in ("draft", "simulated"):
            if getattr(record, warning):
                self._words(_add(parent, "statement"), "declaration", warning)
        if record.unreviewed:
            statement = _add(parent, "statement")
            self._spoken(statement, "declaration", partial(unreviewed_words, record))
        if record.not_in_u:
            statement = _add(parent, "statement")
            self._words(statement, "name", "not_in_u")
            self._spoken(statement, "declaration", partial(not_in_u_words, record))
        if record.compensation and record.verification is None:
            statement = _add(parent, "statement")
            self._words(statement, "name", "verification")
            self._words(statement, "declaration", "verification_none")
        for each in record.deviations:
            statement = _add(parent, "statement")
            self._words(statement, "name", "deviations")
            _add(statement, "reference", f"{record.method.name}: {each.clause}")
            self._spoken(statement, "declaration", partial(Labels.said, message=str(each)))
        statement = _add(parent, "statement")
        self._words(statement, "name", "place")
        self._spoken(statement, "declaration", partial(place_words, record))
        statement = _add(parent, "statement")
        self._words(statement, "name", "validity")
        self._words(statement, "declaration", "validity_text")
        _add(statement, "date", record.calibrated_to.isoformat())
        self._model(parent)
        statement = _add(parent, "statement")
        self._words(statement, "name", "signatures")
        self._words(statement, "declaration", "signatures_text")
        for label, text in record.stated():
            statement = _add(parent, "statement")
            self._words(statement, "name", label)
            self._spoken(statement, "declaration", partial(Labels.said, message=text))
        self._static_statements(parent)

    def _model(self, parent: ElementTree.Element) -> None:
        """Add the hash of the model's file, and the model's verification."""
        record = self.record
        if not record.compensation:
            return
        statement = _add(parent, "statement")
        self._words(statement, "name", "compensation")
        for name, digest in record.files.items():
            if name == record.model_file:
                _add(statement, "reference", f"{name}: SHA-256 {digest}")
        self._spoken(statement, "declaration", partial(Labels.said, message=record.compensation))
        if record.verification is not None:
            statement = _add(parent, "statement")
            self._words(statement, "name", "verification")
            _add(statement, "reference", f"SHA-256 {record.verification.data_sha256}")
            self._spoken(statement, "declaration", partial(verification_words, record))
            _add(statement, "date", record.verification.performed.isoformat())

    def _conformity(self, parent: ElementTree.Element, found: Conformity) -> None:
        parent.set("refType", "basic_conformity")
        self._words(parent, "name", "conformity")
        self._words(
            parent,
            "declaration",
            "conformity_text" if self.record.compensation else "conformity_text_raw",
            "rule",
            tolerance=f"{found.tolerance_percent_fs:g}",
            limit=f"{found.tolerance_percent_fs / 100.0 * self.record.item.range_nm:g}",
        )
        _add(parent, "conformity", found.verdict.value)

    def _static_statements(self, parent: ElementTree.Element) -> None:
        """Add the classes of the static evaluation, and the zero hysteresis."""
        for table in self.record.static:
            statement = _add(parent, "statement")
            self._words(statement, "name", "static", *_static_labels(table, self.record))
            self._spoken(statement, "declaration", partial(class_words, table))
        if self.record.zero_hysteresis is not None:
            statement = _add(parent, "statement")
            self._spoken(statement, "declaration", partial(zero_hysteresis_words, self.record))

    # Results

    def _results(self, parent: ElementTree.Element) -> None:
        record = self.record
        for sign, branch, rows in _tables(record.results):
            result = _add(parent, "measurementResult")
            self._words(result, "name", "results", sign, branch)
            self._circumstances(result)
            table = _add(_add(result, "results"), "result")
            self._words(table, "name", "results")
            content = _add(_add(table, "data"), "list")
            content.set("refType", "basic_tableIndex0")
            self._columns(content, rows)
        for static in record.static:
            self._static(parent, static)

    def _circumstances(self, result: ElementTree.Element) -> None:
        """Add method, software, standard and environment, which every result must state."""
        self._method(_add(_add(result, "usedMethods"), "usedMethod"))
        self._software(_add(result, "usedSoftware"))
        self._standard(_add(_add(result, "measuringEquipments"), "measuringEquipment"))
        self._environment(_add(result, "influenceConditions"))

    def _static(self, parent: ElementTree.Element, static: StaticTable) -> None:
        """Add the quantities of the static evaluation of one direction."""
        result = _add(parent, "measurementResult")
        self._words(result, "name", "static", *_static_labels(static, self.record))
        self._circumstances(result)
        table = _add(_add(result, "results"), "result")
        self._words(table, "name", "static")
        content = _add(_add(table, "data"), "list")
        torque = self._column(content, "basic_nominalValue", "torque")
        _add(torque, "si:valueXMLList", " ".join(f"{row.torque_nm:.7g}" for row in static.rows))
        _add(torque, "si:unitXMLList", _NEWTON_METRE)
        for name, symbol in STATIC_QUANTITIES.items():
            values = [getattr(row, name) for row in static.rows]
            if any(value is None for value in values):
                continue
            quantity = _add(content, "quantity")
            self._text(quantity, "name", symbol)
            column = _add(quantity, "si:realListXMLList")
            _add(column, "si:valueXMLList", " ".join(f"{value:.4f}" for value in values))
            _add(column, "si:unitXMLList", r"\percent")

    def _method(self, parent: ElementTree.Element) -> None:
        method = self.record.method
        self._words(parent, "name", "method_text", series=method.series, points=method.points)
        self._words(
            parent, "description", "profile_verified" if method.verified else "profile_unverified"
        )
        _add(parent, "reference", f"{method.name}: {method.title}")
        _add(parent, "reference", f"SHA-256 {method.sha256}")

    def _standard(self, parent: ElementTree.Element) -> None:
        reference = self.record.reference
        self._words(parent, "name", "reference")
        percent = f"{reference.expanded_uncertainty_percent:g}"
        self._words(
            parent,
            "description",
            reference.label,
            model=reference.model,
            serial=reference.serial,
            certificate=reference.certificate_number,
            percent=percent,
        )
        if reference.model:
            _add(parent, "model", reference.model)
        identifications = _add(parent, "identifications")
        self._identification(
            identifications, "manufacturer", reference.serial, "serial", "basic_serialNumber"
        )
        if reference.certificate_number:
            self._identification(identifications, "other", reference.certificate_number, "number")

    def _environment(self, parent: ElementTree.Element) -> None:
        condition = _add(parent, "influenceCondition")
        self._words(condition, "name", "environment")
        condition.set("refType", "basic_temperature")
        data = _add(condition, "data")
        temperature = self.record.temperature_c
        if temperature is None:
            quantity = _add(data, "quantity")
            self._words(quantity, "noQuantity", "temperature_unknown")
            return
        for kind, value in zip(("Min", "Max"), temperature, strict=True):
            quantity = _add(data, "quantity")
            quantity.set("refType", f"basic_temperature{kind}")
            real = _add(quantity, "si:real")
            _add(real, "si:value", f"{value:.1f}")
            _add(real, "si:unit", r"\degreecelsius")

    def _columns(self, parent: ElementTree.Element, rows: Sequence[ResultRow]) -> None:
        standard = self._column(parent, "basic_referenceValue", "standard_torque")
        _add(standard, "si:valueXMLList", " ".join(f"{row.standard_nm:.7g}" for row in rows))
        _add(standard, "si:unitXMLList", _NEWTON_METRE)
        before = [(row.error_before_nm, row.expanded_before_nm, row.factor_before) for row in rows]
        labels = ("error", "before") if self.record.compensation else ("error",)
        self._errors(self._column(parent, "basic_measurementError", *labels), before)
        if self.record.compensation:
            column = self._column(parent, "basic_measurementError", "error", "after")
            self._errors(column, [row.judged for row in rows])
        verdicts = [row.verdict.value for row in rows if row.verdict is not None]
        if not verdicts:
            return
        quantity = parent[-1]
        judged = _add(_add(quantity, "measurementMetaData"), "metaData")
        judged.set("refType", "basic_conformity")
        self._words(judged, "declaration", "rule")
        _add(judged, "conformityXMLList", " ".join(verdicts))

    def _column(self, parent: ElementTree.Element, kind: str, *labels: str) -> ElementTree.Element:
        quantity = _add(parent, "quantity")
        quantity.set("refType", kind)
        self._words(quantity, "name", *labels)
        return _add(quantity, "si:realListXMLList")

    def _errors(
        self, parent: ElementTree.Element, values: Sequence[tuple[float, float, float]]
    ) -> None:
        places = [rounded(expanded) for _, expanded, _ in values]
        errors = [
            f"{error:.{decimals}f}"
            for (error, _, _), (_, decimals) in zip(values, places, strict=True)
        ]
        expanded = [f"{value:.{decimals}f}" for value, decimals in places]
        _add(parent, "si:valueXMLList", " ".join(errors))
        _add(parent, "si:unitXMLList", _NEWTON_METRE)
        uncertainty = _add(
            _add(parent, "si:measurementUncertaintyUnivariateXMLList"), "si:expandedMUXMLList"
        )
        _add(uncertainty, "si:valueExpandedMUXMLList", " ".join(expanded))
        factors = " ".join(f"{factor:.2f}" for _, _, factor in values)
        _add(uncertainty, "si:coverageFactorXMLList", factors)
        _add(uncertainty, "si:coverageProbabilityXMLList", f"{_COVERAGE}")


def _static_labels(table: StaticTable, record: CertificateRecord) -> tuple[str, ...]:
    direction = "clockwise" if table.direction > 0 else "counter-clockwise"
    if not record.compensation:
        return (direction,)
    return (direction, "after" if table.compensated else "before")


def _tables(rows: Sequence[ResultRow]) -> list[tuple[str, str, list[ResultRow]]]:
    """Group the rows by direction and branch, with the keys of the groups' labels."""
    tables: dict[tuple[str, str], list[ResultRow]] = {}
    for row in rows:
        counter_clockwise = f"{row.torque_nm:g}".startswith("-")  # distinguishes -0.0, too
        sign = "counter-clockwise" if counter_clockwise else "clockwise"
        branch = {1: "rising", -1: "falling"}.get(row.branch, "branch_unknown")
        tables.setdefault((sign, branch), []).append(row)
    return [(sign, branch, found) for (sign, branch), found in tables.items()]
