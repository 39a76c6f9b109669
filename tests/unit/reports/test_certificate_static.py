"""What a certificate states of the static evaluation, and what it leaves out where it may."""

import io
from collections.abc import Iterator
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pypdf
import pytest
from tests.unit.reports.calibrated_bench import calibrated_bench, points
from tests.unit.reports.certificate_records import read_back

from torquebench.calibration import calibration_results, load_profile
from torquebench.message import Message
from torquebench.records import Registry
from torquebench.reports.certificate import (
    CertificateRecord,
    Issue,
    build_record,
    certificate_pdf,
    certificate_xml,
    schema_findings,
)
from torquebench.reports.certificate.content import certificate_content
from torquebench.reports.certificate.labels import LANGUAGES, labels_of
from torquebench.reports.certificate.record import DeviationStatement
from torquebench.reports.certificate.static_content import class_words
from torquebench.uncertainty import CertifiedUncertainty

STAIRCASE = load_profile("staircase")
ISSUE = Issue(["A. Boss"], issued=date(2026, 3, 5), languages=LANGUAGES, refuse_unreviewed=False)


@pytest.fixture
def registry(tmp_path: Path) -> Iterator[Registry]:
    with Registry.open(tmp_path) as opened:
        yield opened


@pytest.fixture
def record(registry: Registry) -> CertificateRecord:
    bench = calibrated_bench(registry, profile=STAIRCASE, temperature_drift_k=1.5)
    return build_record(registry, bench.calibration, ISSUE)


def text_of(record: CertificateRecord, language: str) -> str:
    reader = pypdf.PdfReader(io.BytesIO(certificate_pdf(record, language)))
    return " ".join(" ".join(page.extract_text() for page in reader.pages).split())


def test_the_static_evaluation_is_that_of_the_points(record: CertificateRecord) -> None:
    data = points(STAIRCASE, simulated=True, temperature_drift_k=1.5)
    results = calibration_results(
        data, resolution_nm=0.0, reference=CertifiedUncertainty.of_range(2e-4, 2000.0)
    )
    first = record.static[0]
    evaluation = results.directions[0].before.evaluation
    assert [(each.direction, each.compensated) for each in record.static] == [
        (1, False), (1, True), (-1, False), (-1, True)
    ]  # fmt: skip
    assert [row.torque_nm for row in first.rows] == evaluation.torque_nm.tolist()
    for name, values in (
        ("repeatability", evaluation.repeatability_percent),
        ("reproducibility", evaluation.reproducibility_range_percent),
        ("reversibility", evaluation.reversibility_percent),
        ("indication", evaluation.indication_deviation_percent),
        ("expanded", evaluation.uncertainty_percent(3, "range", decreasing=True)),
    ):
        assert values is not None
        np.testing.assert_allclose([getattr(row, name) for row in first.rows], values)
    assert first.zero_residual == evaluation.zero_residual_percent
    # The standard's uncertainty is in % of its range: at a tenth of it, ten times as much.
    reference = np.asarray(evaluation.reference_uncertainty_percent)
    np.testing.assert_allclose(reference[[0, -1]], [0.2, 0.02])


def test_each_class_is_stated_over_its_largest_range(record: CertificateRecord) -> None:
    for table in record.static:
        starts = [each.from_nm for each in table.classes]
        assert starts == sorted(starts, reverse=True)
        assert [each.accuracy_class for each in table.classes] == sorted(
            each.accuracy_class for each in table.classes
        )
    kept = class_words(record.static[1], labels_of("de"))
    assert kept.startswith("Klasse ")
    assert kept.endswith(" ab 200 N·m.")


def test_a_quantity_that_was_not_measured_gives_no_class(registry: Registry) -> None:
    record = build_record(registry, calibrated_bench(registry).calibration, ISSUE)
    assert {table.missing for table in record.static} == {("b′", "b")}
    assert "b′, b" in text_of(record, "zh")


@pytest.mark.parametrize(
    ("language", "words"),
    [
        (
            "en",
            [
                "Static evaluation",
                "the temperature drifted by 1.5 K",
                "Compensation, fitted to these points: polynomial, degree 2.",
            ],
        ),
        ("de", ["Statische Auswertung", "die Temperatur driftete um 1,5 K", "Polynom 2. Grades"]),
        ("zh", ["静态评定", "温度漂移 1.5 K", "2 次多项式"]),
    ],
)
def test_everything_is_said_in_the_language(
    record: CertificateRecord, language: str, words: list[str]
) -> None:
    text = text_of(record, language)
    for each in words:
        assert each in text
    if language != "en":
        assert "the temperature drifted" not in text


def test_no_conformity_is_stated_where_none_is_wanted(registry: Registry) -> None:
    bench = calibrated_bench(registry, profile=STAIRCASE)
    record = build_record(registry, bench.calibration, replace(ISSUE, tolerance_percent_fs=None))
    assert record.conformity is None
    assert all(row.verdict is None for row in record.results)
    xml = certificate_xml(record)
    assert b"conformity>" not in xml
    assert schema_findings(xml) == ()
    text = text_of(record, "de")
    assert "Konformitätsaussage" not in text
    assert "Urteil" not in text
    assert read_back(record.to_json()) == record


def test_a_calibration_without_a_model_states_the_reading_alone(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = calibrated_bench(registry, profile=STAIRCASE)
    monkeypatch.setattr(type(registry), "models", lambda *_args, **_named: [])
    record = build_record(registry, bench.calibration, ISSUE)
    assert record.compensation == ""
    assert all(row.error_after_nm is None for row in record.results)
    assert record.conformity is not None
    assert record.conformity.worst_error_nm == pytest.approx(14.0, abs=1.0)
    assert {line.name for line in record.budget} == {
        "repeatability and noise", "reference standard", "zero return",
        "temperature drift during the calibration",
    }  # fmt: skip
    assert schema_findings(certificate_xml(record)) == ()
    text = text_of(record, "en")
    assert "after compensation" not in text
    assert "No compensation." in text
    assert read_back(record.to_json()) == record


def test_reversing_cycles_state_their_zero_hysteresis(registry: Registry) -> None:
    bench = calibrated_bench(registry, profile=load_profile("reversing"))
    record = build_record(registry, bench.calibration, ISSUE)
    found = record.zero_hysteresis
    assert found is not None
    assert found.cycles == 3
    assert found.before_percent_fs == pytest.approx(found.before_nm / 20.0)
    assert "largest of 3 cycles" in text_of(record, "en")
    assert schema_findings(certificate_xml(record)) == ()


def test_a_record_of_the_older_format_is_still_read(record: CertificateRecord) -> None:
    import json

    older = json.loads(record.to_json())
    for name in ("static", "zero_hysteresis"):
        del older[name]
    for name in ("placement", "table"):
        del older["method"][name]
    again = read_back(json.dumps(older))
    assert again.static == ()
    assert again.results == record.results


def test_a_deviation_is_said_with_the_marks_of_the_language() -> None:
    found = Message("the temperature drifted by {drift:.2g} K ({low:.1f} °C to {high:.1f} °C)",
                    1.5, -0.5, 1.0)  # fmt: skip
    stated = str(DeviationStatement("environment", found, Message("at most {limit:g} K", 1.0)))
    assert labels_of("en").said(stated) == (
        "the temperature drifted by 1.5 K (−0.5 °C to 1.0 °C); allowed: at most 1 K "
        "(clause environment)"
    )
    assert labels_of("de").said(stated) == (
        "die Temperatur driftete um 1,5 K (−0,5 °C bis 1,0 °C); zulässig: höchstens 1 K "
        "(Klausel environment)"
    )


@pytest.mark.nightly
def test_many_steps_list_the_usual_ones_and_an_annex_all(registry: Registry) -> None:
    many = STAIRCASE.with_options(step_percent=4.0)
    bench = calibrated_bench(registry, profile=many, temperature_drift_k=0.5)
    record = build_record(registry, bench.calibration, ISSUE)
    content = certificate_content(record, "en")
    table, static = record.static[0], content["static"]["tables"][0]
    assert len(table.rows) == 25 > len(static["rows"])
    *listed, largest, steps = static["rows"]
    assert {"400", "800", "1200", "1600", "2000"} <= {row[0] for row in listed}
    assert len(static["all"]) == len(table.rows)
    assert largest[0] == "largest of 25"
    worst = max(table.rows, key=lambda row: abs(row.indication or 0.0))
    assert largest[1] == f"{abs(worst.indication or 0.0):.3f}"
    assert steps[:2] == ["at N·m", f"{worst.torque_nm:g}"]  # the largest value names its step
    results = content["results"]
    assert len(results["all"]) == len(record.results) > 4 * 20
    assert {"2000", "−2000", "0", "−0"} <= {row[0] for row in results["rows"]}
    assert record.conformity is not None
    deciding = labels_of("en").short(record.conformity.at_nm)
    assert deciding in {row[0] for row in results["rows"]}
    for language, annex in (("en", "Annex"), ("de", "Anhang"), ("zh", "附录")):
        assert annex in text_of(record, language)
    assert schema_findings(certificate_xml(record)) == ()


def test_few_steps_need_no_annex(record: CertificateRecord) -> None:
    assert "Annex" not in text_of(record, "en")
    assert certificate_content(record, "en")["results"]["left_out"] is None
