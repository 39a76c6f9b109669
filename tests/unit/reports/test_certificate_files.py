"""The files of a certificate: reproducible, readable, valid, and told from others."""

import io
import sys
import types
from collections.abc import Iterator
from dataclasses import replace
from datetime import date
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pypdf
import pytest
import typst
from tests.support.draws import nightly
from tests.unit.reports.calibrated_bench import calibrated_bench
from tests.unit.reports.certificate_records import read_back

from torquebench.calibration import CalibrationData
from torquebench.chain import (
    SWITCHES,
    Inertia,
    MeasuredRotation,
    MeasuredTemperature,
    MeasuringChain,
)
from torquebench.compensation import features, make_model
from torquebench.errors import InputError, RecordError
from torquebench.records import Registry
from torquebench.reports.certificate import (
    CertificateRecord,
    Issue,
    archive_folder,
    build_record,
    certificate_pdf,
    certificate_xml,
    check_certificate,
    issue_certificate,
    schema_findings,
)
from torquebench.reports.certificate.fonts import fonts_for
from torquebench.reports.certificate.record import Act
from torquebench.reports.certificate.results import turning_budget, turning_range
from torquebench.translations import templates

DCC = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}


@pytest.fixture
def registry(tmp_path: Path) -> Iterator[Registry]:
    with Registry.open(tmp_path / "data") as opened:
        yield opened


@pytest.fixture
def short(record: CertificateRecord) -> CertificateRecord:
    """The same in one language."""
    return replace(record, languages=("en",))


@pytest.fixture
def record(registry: Registry) -> CertificateRecord:
    issue = Issue(
        ["A. Boss", "B. Boss"],
        languages=("de", "en", "zh"),
        issued=date(2026, 3, 5),
        refuse_unreviewed=False,
    )
    return build_record(registry, calibrated_bench(registry).calibration, issue)


def pages(pdf: bytes) -> list[str]:
    return [page.extract_text() for page in pypdf.PdfReader(io.BytesIO(pdf)).pages]


@pytest.mark.parametrize(
    ("language", "title", "counted", "warned"),
    [
        ("en", "Calibration certificate", "Page {} of {}", ("SIMULATED", "NOT REVIEWED")),
        nightly("de", "Kalibrierschein", "Seite {} von {}", ("SIMULIERT", "NICHT GEPRÜFT")),
        ("zh", "校准证书", "第 {} 页，共 {} 页", ("模拟数据", "未经审核")),
    ],
)
def test_pdf_says_on_every_page_what_it_is(
    record: CertificateRecord, language: str, title: str, counted: str, warned: tuple[str, ...]
) -> None:
    text = pages(certificate_pdf(record, language))
    assert len(text) == 4
    for number, page in enumerate(text, start=1):
        assert record.number in page
        assert all(warning in page for warning in warned)
        assert counted.format(number, len(text)).replace(" ", "") in page.replace(" ", "")
    assert title in text[0]
    whole = "".join(text)
    for stated in ("T-7", "CAL-3", "PTB-12345", "rapid-in-situ", "M. Weber", "A. Boss, B. Boss"):
        assert stated in whole
    assert record.registry_head.replace(":", "")[-20:] in "".join(whole.split()).replace(
        "\u200b", ""
    )


def test_same_record_gives_the_same_bytes(record: CertificateRecord) -> None:
    again = read_back(record.to_json())
    assert certificate_pdf(record, "de") == certificate_pdf(again, "de")
    assert certificate_xml(record) == certificate_xml(again)
    other = replace(record, issued=date(2026, 3, 6))
    assert certificate_pdf(other, "de") != certificate_pdf(record, "de")


def test_pdf_embeds_its_fonts_and_carries_the_records_date(record: CertificateRecord) -> None:
    reader = pypdf.PdfReader(io.BytesIO(certificate_pdf(record, "zh")))
    assert reader.metadata is not None
    assert reader.metadata.creation_date is not None
    assert reader.metadata.creation_date.date() == record.issued
    assert record.payload in str(reader.metadata.get("/Keywords"))
    descendants = [
        font["/DescendantFonts"][0]["/FontDescriptor"]
        for page in reader.pages
        for font in (each.get_object() for each in page["/Resources"]["/Font"].values())
    ]
    assert descendants
    assert all({"/FontFile2", "/FontFile3"} & set(each) for each in descendants)
    names = {str(each["/FontName"]) for each in descendants}
    assert any("Libertinus" in name for name in names)
    assert any("CJK" in name for name in names)


def test_missing_chinese_font_names_the_debian_package(record: CertificateRecord) -> None:
    bare = typst.Fonts(include_system_fonts=False)
    with pytest.raises(InputError, match="fonts-noto-cjk"):
        certificate_pdf(record, "zh", bare)
    # A Chinese name needs the font in a German certificate too; German alone needs none.
    named = replace(record, acts=(Act("measured", "王伟", None, None),))
    with pytest.raises(InputError, match="fonts-noto-cjk"):
        certificate_pdf(named, "de", bare)
    assert fonts_for(["Drehmoment"], bare)[1] == ["Libertinus Serif"]


def test_xml_passes_schema_and_schematron(record: CertificateRecord) -> None:
    assert schema_findings(certificate_xml(record)) == ()
    draft = replace(record, draft=True, authorised_by=(), temperature_c=None, languages=("zh",))
    assert schema_findings(certificate_xml(draft)) == ()
    followed = replace(record, supersedes="TB-1", software_version="1.2.dev3", checked_by="K. S")
    assert schema_findings(certificate_xml(followed)) == ()


def test_a_second_public_reader_finds_every_value_with_its_uncertainty(
    record: CertificateRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """pydcc of other authors: only its signatures and its download of schemas are left out."""
    unused = types.ModuleType("certvalidator")  # doesn't start with OpenSSL 3
    for name in ("CertificateValidator", "ValidationContext", "errors"):
        setattr(unused, name, None)
    monkeypatch.setitem(sys.modules, "certvalidator", unused)
    from dcc import dcc as pydcc

    monkeypatch.setattr(pydcc, "DCCXMLValidator", lambda: None)
    path = tmp_path / "certificate.xml"
    path.write_bytes(certificate_xml(record))
    reader = pydcc.DCC(str(path))
    assert (reader.uid(), reader.version()) == (record.number, "3.3.0")
    assert reader.calibration_date().date() == record.calibrated_to
    assert "'value': 'T-7'" in str(reader.item_id())
    columns: list[list[float]] = [[], [], [], [], []]
    for words, value in reader.get_calibration_results("name", "en"):
        for place, name in enumerate(("torque of the standard", "error before", "error after")):
            if f" {name}" in words:
                stated = value["realListXMLList"]
                columns[place] += map(float, stated["valueXMLList"].split())
                if place:
                    u = stated["measurementUncertaintyUnivariateXMLList"]["expandedMUXMLList"]
                    columns[2 + place] += map(float, u["valueExpandedMUXMLList"].split())
    rows = np.array(sorted(zip(*columns, strict=True)))
    expected = np.array(
        sorted(
            (row.standard_nm, row.error_before_nm, row.judged[0], row.expanded_before_nm,
             row.judged[1])
            for row in record.results
        )
    )  # fmt: skip
    np.testing.assert_allclose(rows[:, 0], expected[:, 0], rtol=1e-6)
    np.testing.assert_allclose(rows[:, 1:3], expected[:, 1:3], atol=0.051)
    np.testing.assert_allclose(rows[:, 3:], expected[:, 3:], rtol=0.06)  # two digits, upwards


def test_xml_names_place_people_validity_model_and_verification(record: CertificateRecord) -> None:
    root = ElementTree.fromstring(certificate_xml(record))

    def texts(path: str) -> list[str]:
        return [" ".join("".join(each.itertext()).split()) for each in root.findall(path, DCC)]

    assert texts(".//dcc:performanceLocation") == ["other"]
    people = {
        (
            person.findtext(".//dcc:name/dcc:content", namespaces=DCC),
            person.findtext("dcc:role", namespaces=DCC),
        )
        for person in root.findall(".//dcc:respPerson", DCC)
    }
    assert people == {
        ("A. Boss", "authorised"),
        ("B. Boss", "authorised"),
        ("M. Weber", "measured"),
    }
    statements = texts(".//dcc:statement")
    for stated in (
        "in place, in the bench Bench 4",
        "am Einsatzort, im Prüfstand Bench 4",
        "relate only to the item calibrated",
        f"SHA-256 {record.files[record.model_file]}",
    ):
        assert any(stated in each for each in statements), stated
    for column in root.findall(".//si:realListXMLList", DCC):
        values = str(column.findtext("si:valueXMLList", namespaces=DCC)).split()
        expanded = column.findtext(".//si:valueExpandedMUXMLList", namespaces=DCC)
        if expanded is not None:  # every error with its own uncertainty
            assert len(expanded.split()) == len(values)


def test_schema_check_finds_what_is_wrong(record: CertificateRecord) -> None:
    xml = certificate_xml(record)
    assert "schema, line" in str(schema_findings(xml.replace(b"coreData", b"coreDatum")))
    assert "schematron" in str(schema_findings(xml.replace(b">AQ<", b">XX<")))
    assert "no XML" in str(schema_findings(xml[: len(xml) // 2]))


def test_xml_states_the_numbers_of_the_record(record: CertificateRecord) -> None:
    root = ElementTree.fromstring(certificate_xml(record))
    assert root.findtext(".//dcc:uniqueIdentifier", namespaces=DCC) == record.number
    conformities = root.findall(".//dcc:conformityXMLList", DCC)
    verdicts = [verdict for each in conformities for verdict in str(each.text).split()]
    assert len(verdicts) == len(record.results)
    stated = root.findall(".//si:valueExpandedMUXMLList", DCC)
    digits = [
        text.replace(".", "").strip("0") for each in stated for text in str(each.text).split()
    ]
    assert len(digits) == 2 * len(record.results)
    assert max(map(len, digits)) <= 2
    tables = root.findall(".//dcc:measurementResult", DCC)
    assert len(tables) == 4 + 4  # rising and falling; the static evaluation before and after


# Issued and checked


def test_issued_files_match_and_others_do_not(
    registry: Registry, record: CertificateRecord, tmp_path: Path
) -> None:
    issued = issue_certificate(registry, record, tmp_path / "out")
    assert len(issued.files) == 5
    for path in issued.files:
        found = check_certificate(registry, str(path))
        assert found.matches, found.findings
        assert found.number == record.number
        assert found.schema == ("valid" if path.suffix == ".xml" else "")
    assert check_certificate(registry, record.payload).matches
    for suffix in (".pdf", ".xml", ".json"):
        path = next(each for each in issued.files if each.suffix == suffix)
        path.write_bytes(path.read_bytes() + b" ")
        assert not check_certificate(registry, str(path)).matches


def test_forged_code_and_foreign_file_do_not_match(
    registry: Registry, short: CertificateRecord, tmp_path: Path
) -> None:
    issue_certificate(registry, short)
    forged = short.payload[:-1] + ("0" if short.payload[-1] != "0" else "1")
    assert "record has SHA-256" in str(check_certificate(registry, forged).findings)
    unknown = short.payload.replace(short.number, "TB-0")
    assert "no certificate TB-0" in str(check_certificate(registry, unknown).findings)
    foreign = tmp_path / "foreign.pdf"
    foreign.write_bytes(b"%PDF-1.7")
    assert "contains no certificate number" in str(
        check_certificate(registry, str(foreign)).findings
    )
    with pytest.raises(InputError, match="neither a file nor the code"):
        check_certificate(registry, "nowhere.pdf")


def test_second_certificate_replaces_the_first(
    registry: Registry, short: CertificateRecord
) -> None:
    first = issue_certificate(registry, short)
    files = list(archive_folder(registry, short.number).iterdir())
    before = {file: file.read_bytes() for file in files}
    calibration = registry.calibration(short.calibration_id)
    second = build_record(registry, calibration, Issue(["A. Boss"], refuse_unreviewed=False))
    assert second.supersedes == first.record.number
    assert second.number != first.record.number
    issue_certificate(registry, second)
    assert check_certificate(registry, short.payload).replaced_by == second.number
    after = {file: file.read_bytes() for file in files}
    assert after == before, "a signature of any other program stays valid"


def test_number_is_given_once_and_files_are_never_overwritten(
    registry: Registry, short: CertificateRecord, tmp_path: Path
) -> None:
    (tmp_path / f"{short.number}.xml").write_text("mine")
    with pytest.raises(InputError, match="exists"):
        issue_certificate(registry, short, tmp_path)
    assert registry.certificates() == []
    issue_certificate(registry, short)
    with pytest.raises(RecordError, match="is already issued"):
        issue_certificate(registry, short, tmp_path / "other")
    with pytest.raises(RecordError, match="draft"):
        issue_certificate(registry, replace(short, draft=True, number="D-1"))


def test_a_chain_that_turns_states_its_ranges_and_its_budget_while_it_turns(
    record: CertificateRecord,
) -> None:
    torque = np.linspace(-50.0, 50.0, 30)
    model = make_model("polynomial", range_nm=50.0).fit(features(torque), torque)
    tables = [((0.0, 0.0), (size, size)) for size in (0.02, 0.001, 0.05, 0.002)]
    chain = MeasuringChain(
        model,
        (
            MeasuredTemperature("runs", 23.0, 12.0, 38.0, (0.0, 50.0), (-0.1, 0.1), (0.01, 0.01)),
            MeasuredRotation("runs", 23.0, -1200.0, 1200.0, 12.0, 38.0, (0.0, 1200.0), (0.0, 50.0),
                             *tables, running_in_s=60.0, running_in_nm=(0.0, 0.01),
                             running_in_uncertainty_nm=(0.0, 0.001)),
            Inertia("ramps", 0.0025, 1e-5, 31.4),
        ),
    )  # fmt: skip
    data = CalibrationData(torque, torque, np.ones(30), np.ones(30), 50.0)
    found = turning_budget(data, chain, record.reference)
    assert found is not None
    assert (found.speed_rpm, found.temperature_c) == (-1200.0, 38.0)
    assert {"bearing drag", "running-in", "temperature of zero"} <= {r.name for r in found.rows}
    said = turning_range(chain)
    assert said == (
        "temperatures of 12 to 38 °C, speeds of -1200 to 1200 rpm, changes of speed up to 300 rpm/s"
    )

    turning = replace(record, turning=said, turning_budget=found)
    assert read_back(turning.to_json()) == turning
    for language, title in (
        ("en", "Uncertainty budget while it turns"),
        ("de", "Messunsicherheitsbudget bei Drehung"),
        ("zh", "转动时的不确定度预算"),
    ):
        text = "".join(pages(certificate_pdf(turning, language)))
        assert title in text
        speeds = {"de": "−1200 bis 1200 1/min", "zh": "−1200 至 1200 r/min"}
        wanted = speeds.get(language, "−1200 to 1200 rpm")
        assert wanted.replace(" ", "") in "".join(text.split())
        assert "rad/s" not in text
    assert not schema_findings(certificate_xml(turning))
    assert "up to 300 rpm/s" in certificate_xml(turning).decode()


def test_every_component_of_a_chain_has_its_words_in_every_language() -> None:
    names = ("static curve", "scatter", "mounting", "noise of the reading", "time base", "zero",
             "zero drift", "drift", "reference standard", "dynamics", "noise of the dynamic filter",
             *(name for names in SWITCHES.values() for name in names))  # fmt: skip
    for language in ("de", "zh"):
        assert [name for name in names if name not in templates(language)] == []
