"""From a registered calibration to the record of its certificate, and what is refused."""

import json
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path

import numpy as np
import pytest
from tests.support.draws import nightly
from tests.unit.reports.calibrated_bench import calibrated_bench, points
from tests.unit.reports.certificate_records import read_back

from torquebench.bench import default_bench
from torquebench.calibration import load_profile, verify
from torquebench.campaign.bench_chains import check_standard, used_chain
from torquebench.campaign.checking import judge_check
from torquebench.chain import MeasuringChain, load_chain
from torquebench.compensation import make_model
from torquebench.errors import InputError, RecordError
from torquebench.records import Registry, RunFolder, RunSummary
from torquebench.reports.certificate import (
    Issue,
    build_record,
    calibration_of,
    kept_letterhead,
    read_letterhead,
)
from torquebench.reports.certificate.building import missing_statements
from torquebench.reports.certificate.content import certificate_content
from torquebench.reports.certificate.dcc import certificate_xml
from torquebench.reports.certificate.labels import labels_of
from torquebench.reports.certificate.record import Party, Reference
from torquebench.reports.certificate.results import evaluate_results
from torquebench.uncertainty import Verdict

ISSUE = Issue(["A. Boss"], issued=date(2026, 3, 5), refuse_unreviewed=False)


@pytest.fixture
def registry(tmp_path: Path) -> Iterator[Registry]:
    with Registry.open(tmp_path) as opened:
        yield opened


def test_record_states_item_method_people_dates_and_hashes(registry: Registry) -> None:
    bench = calibrated_bench(registry, due=date(2027, 1, 15))
    registry.review("calibrations", bench.calibration.calibration_id, checked_by="K. Sommer")

    record = build_record(registry, bench.calibration, ISSUE)

    assert (record.item.serial, record.item.manufacturer, record.item.range_nm) == (
        "T-7",
        "HBK",
        2000.0,
    )
    assert (record.method.name, record.method.verified) == ("rapid-in-situ", False)
    assert record.method.sha256 == bench.calibration.profile_sha256
    assert (record.reference.certificate_number, record.reference.due) == (
        "PTB-12345",
        date(2027, 1, 15),
    )
    assert (record.measured_by, record.checked_by, record.authorised_by) == (
        "M. Weber",
        "K. Sommer",
        ("A. Boss",),
    )
    assert (record.calibrated_from, record.issued) == (date(2026, 3, 2), date(2026, 3, 5))
    assert record.simulated
    assert record.temperature_c == pytest.approx((23.0, 23.2))
    manifest = json.loads((bench.folder / "manifest.json").read_text())
    assert record.files["events.jsonl"] == manifest["files"]["events.jsonl"]["sha256"]
    assert record.files["calibration points"] == bench.calibration.data_sha256
    # The standard's values are the requested ones to the last digit: nobody compared them.
    assert record.loading_accuracy == ""


def test_influences_that_u_does_not_contain_are_stated(registry: Registry) -> None:
    bench = calibrated_bench(registry)
    record = build_record(registry, bench.calibration, ISSUE)
    (model,) = registry.models(bench.calibration.transducer_serial)
    missing = set(load_chain(model.file).missing())  # a table's model, which states no standard
    assert set(record.not_in_u) == missing - {"reference standard"} | {
        "temperature of standard",
        "drift of standard",
    }
    facts = dict(certificate_content(record, "de")["facts"])
    said = facts["In U nicht enthalten, weil nichts darüber vorliegt"]
    assert "Kriechen unter Last" in said[0]
    german = replace(record, languages=("de",))
    assert "Kriechen unter Last" in certificate_xml(german).decode()


@pytest.mark.parametrize(("up_to", "said"), [(100.0, False), (40.0, True)])
def test_how_far_a_part_of_the_range_was_calibrated_is_stated(
    registry: Registry, up_to: float, said: bool
) -> None:
    part = load_profile("rapid-in-situ").with_options(up_to_percent=up_to)
    record = build_record(registry, calibrated_bench(registry, profile=part).calibration, ISSUE)
    for language, full_scale in (("en", "full scale"), ("de", "Messbereichsendwerts")):
        words = " ".join(str(certificate_content(record, language)["facts"]).split())
        assert ("±800" in words and full_scale in words) is said


def test_compensation_shows_beside_the_raw_error_at_every_step(registry: Registry) -> None:
    record = build_record(registry, calibrated_bench(registry).calibration, ISSUE)
    before = max(abs(row.error_before_nm) for row in record.results)
    after = max(abs(row.error_after_nm) for row in record.results)
    assert len(record.results) == 20
    assert before > 10.0
    assert after < 2.0
    torques = [row.torque_nm for row in record.results]
    assert torques == sorted(torques)
    # The zeros after either direction lie on different loops and stay apart.
    assert [np.signbit(torque) for torque in torques if torque == 0.0] == [True, False]


def test_budget_adds_up_to_the_stated_uncertainty(registry: Registry) -> None:
    record = build_record(registry, calibrated_bench(registry).calibration, ISSUE)
    combined = np.sqrt(sum(line.standard_uncertainty_nm**2 for line in record.budget))
    row = record.results[record.budget_step]
    assert row.expanded_after_nm == pytest.approx(row.factor_after * combined)
    assert row.expanded_after_nm == max(each.expanded_after_nm for each in record.results)
    assert sum(line.share for line in record.budget) == pytest.approx(1.0)
    reference = next(line for line in record.budget if line.name == "reference standard")
    assert reference.standard_uncertainty_nm == pytest.approx(
        0.2, rel=1e-3
    )  # 0.02 % of 2000 N·m, k = 2


def test_repeated_series_bring_their_scatter_and_average(registry: Registry) -> None:
    profile = load_profile("rapid-in-situ").with_options(step_percent=20.0, repeats=4)
    data = points(profile, simulated=True, temperature_drift_k=0.0)
    model = make_model("polynomial", degree=2, range_nm=2000.0)
    model.fit(data.features(2), data.standard_nm)
    chain, reference = MeasuringChain(model), Reference("CAL-3", "", "PTB-12345", "", 0.02)
    results = evaluate_results(data, chain, reference, tolerance_percent_fs=0.1)
    assert {row.readings for row in results.rows} == {4}
    scatter = next(line for line in results.budget if line.name == "scatter")
    assert scatter.standard_uncertainty_nm == pytest.approx(0.3 / 2.0, rel=0.3)
    raw = evaluate_results(data, None, reference, tolerance_percent_fs=0.1)
    repeatability = raw.budget[0]
    assert repeatability.degrees_of_freedom == pytest.approx(3 * 20)
    assert repeatability.standard_uncertainty_nm == pytest.approx(0.3 / 2.0, rel=0.3)


@pytest.mark.parametrize(
    ("tolerance", "verdict"),
    [(1.0, Verdict.PASS), (0.004, Verdict.CONDITIONAL_FAIL)],
    ids=["wide", "narrow"],
)
def test_verdict_is_the_worst_of_all_steps(
    registry: Registry, tolerance: float, verdict: Verdict
) -> None:
    bench = calibrated_bench(registry)
    issue = replace(ISSUE, tolerance_percent_fs=tolerance)
    record = build_record(registry, bench.calibration, issue)
    assert record.conformity.verdict is verdict
    assert sum(record.conformity.counts.values()) == len(record.results)
    assert any(row.verdict is verdict for row in record.results)


def test_record_is_read_back_as_it_was_written(registry: Registry) -> None:
    record = build_record(registry, calibrated_bench(registry).calibration, ISSUE)
    again = read_back(record.to_json())
    assert again == record
    assert again.sha256 == record.sha256
    assert record.payload.endswith(f";{record.number};{record.sha256}")


def test_verification_at_fresh_points_is_stated(registry: Registry) -> None:
    bench = calibrated_bench(registry, simulated=False, due=date(2027, 1, 15))
    issue = replace(ISSUE, laboratory=Party("Lab", city="Ulm", country="DE"))
    assert build_record(registry, bench.calibration, issue).verification is None

    entry = registry.models()[0]
    profile = load_profile("rapid-in-situ").with_options(step_percent=12.5, repeats=3)
    fresh = points(profile, simulated=False, temperature_drift_k=0.0)
    result = verify(fresh, {"polynomial": load_chain(entry.file)})
    registry.add_verification(entry.model_id, result, performed=datetime(2026, 3, 3, tzinfo=UTC))

    found = build_record(registry, bench.calibration, issue).verification
    assert found is not None
    assert (found.performed, found.points, found.groups) == (date(2026, 3, 3), len(fresh), 6)
    after = result.of("polynomial")
    assert found.worst_after_nm == after.against_standard.worst_nm < found.worst_before_nm
    assert after.averaged is not None
    assert found.averaged_after_nm == after.averaged.worst_nm


@pytest.mark.parametrize("wanted", [Verdict.PASS, nightly(Verdict.CONDITIONAL_PASS), Verdict.FAIL])
def test_the_certificates_verdict_is_that_of_the_verification(
    registry: Registry, wanted: Verdict
) -> None:
    bench, entry = calibrated_bench(registry), registry.models()[0]
    profile = load_profile("rapid-in-situ").with_options(step_percent=12.5)
    fresh = points(profile, simulated=True, temperature_drift_k=0.0)
    if wanted is not Verdict.PASS:  # one point off, by more than its U
        off = np.array(fresh.reading_nm)
        off[3] += 2.5
        fresh = replace(fresh, reading_nm=off)
    run = {"bench": default_bench()}
    with RunFolder.create(registry.root / "runs", run, kind="verify") as writer:
        writer.write_results({"data": fresh})
        run_id = writer.seal().run_id
    started = datetime(2026, 3, 3, tzinfo=UTC)
    registry.add_run(
        RunSummary(
            run_id=run_id,
            kind="verify",
            started=started,
            simulated=True,
            software_version="0.1.0",
            folder=registry.root / "runs" / run_id,
        )
    )
    chain = load_chain(entry.file)
    result = verify(fresh, {"polynomial": chain})
    registry.add_verification(entry.model_id, result, performed=started, run_id=run_id)
    worst = result.of("polynomial").against_standard.worst_percent_fs
    tolerance = {Verdict.PASS: 1.0, Verdict.CONDITIONAL_PASS: 1.01 * worst}.get(wanted, 0.05)
    judged = judge_check(
        fresh,
        used_chain(entry, run, fresh),
        standard=check_standard(run, fresh),
        tolerance_percent_fs=tolerance,
    )  # as the panel judges it
    assert judged.verdict is wanted

    issue = replace(ISSUE, tolerance_percent_fs=tolerance)
    record = build_record(registry, bench.calibration, issue)
    assert record.conformity.fresh
    assert record.conformity.verdict is wanted
    assert sum(record.conformity.counts.values()) == len(fresh)
    assert record.conformity == record.verification.conformity
    assert read_back(record.to_json()) == record
    assert "point of the verification" in certificate_content(record, "en")["conformity"]["decides"]


def test_a_standard_without_number_or_date_is_a_stated_deviation(registry: Registry) -> None:
    bench = calibrated_bench(registry)
    record = build_record(registry, bench.calibration, ISSUE)
    assert not any("17025" in each.clause for each in record.deviations)
    unstated = replace(record.reference, certificate_number="", performed=None)
    found = [str(each) for each in missing_statements(unstated)]
    assert len(found) == 2
    assert all("ISO/IEC 17025 7.8.4.1 c" in each for each in found)
    for language in ("de", "zh"):
        assert all(labels_of(language).said(each) != each for each in found)


def test_place_and_turning_are_stated_in_words(registry: Registry) -> None:
    record = build_record(registry, calibrated_bench(registry).calibration, ISSUE)
    facts = str(certificate_content(record, "en")["facts"])
    assert "in place, in the bench Bench 4" in facts
    assert "relate only to the item calibrated" in facts
    elsewhere = replace(record, item=replace(record.item, in_place=False, bench="Lab 3"))
    facts = str(certificate_content(elsewhere, "zh")["facts"])
    assert "原位" not in facts
    assert "Lab 3" in facts


def test_what_nobody_has_confirmed_is_stated_or_refused(registry: Registry) -> None:
    bench = calibrated_bench(registry)  # its model went into use at once
    calibration, model_id = bench.calibration, registry.models()[0].model_id

    def unreviewed(*names: str, tolerance: float = 0.1) -> tuple[str, ...]:
        return build_record(
            registry,
            calibration,
            replace(ISSUE, authorised_by=names, tolerance_percent_fs=tolerance),
        ).unreviewed

    assert unreviewed("A. Boss") == ("unverified", "unchecked")
    assert unreviewed("a. boss", " m. weber ") == ("unverified", "unchecked", "self_signed")
    profile = load_profile("rapid-in-situ").with_options(step_percent=12.5)
    fresh = points(profile, simulated=True, temperature_drift_k=0.0)
    result = verify(fresh, {"polynomial": load_chain(registry.models()[0].file)})
    registry.add_verification(model_id, result, performed=datetime(2026, 3, 3, tzinfo=UTC))
    assert unreviewed("A. Boss") == ("unchecked",)
    assert unreviewed("A. Boss", tolerance=1e-6) == ("outside", "unchecked")
    registry.review("calibrations", calibration.calibration_id, checked_by="A. Boss")
    assert unreviewed("A. Boss") == ("unchecked",)  # it was in use before
    strict = Issue(["A. Boss"])
    with pytest.raises(RecordError, match="no second person checked it"):
        build_record(registry, calibration, strict)
    registry.activate(model_id, operator="A. Boss", reason="checked now")
    assert build_record(registry, calibration, strict).unreviewed == ()


# Refusals


def test_real_calibration_needs_a_laboratory_and_a_standard_in_date(registry: Registry) -> None:
    bench = calibrated_bench(registry, simulated=False, due=date(2026, 1, 31))
    with pytest.raises(InputError, match="without a laboratory"):
        build_record(registry, bench.calibration, ISSUE)
    named = Issue(["A. Boss"], laboratory=Party("Lab", city="Ulm", country="DE"))
    with pytest.raises(RecordError, match=r"expired on 2026-01-31 .*clause reference.in_date"):
        build_record(registry, bench.calibration, named)


def test_deviation_is_carried_where_the_profile_says_so(registry: Registry) -> None:
    bench = calibrated_bench(registry, temperature_drift_k=1.5)
    record = build_record(registry, bench.calibration, ISSUE)
    clauses = [each.clause for each in record.deviations]
    assert clauses == ["environment.temperature_drift_k"]


def test_changed_run_is_refused(registry: Registry) -> None:
    bench = calibrated_bench(registry)
    path = bench.folder / "results.json"
    path.write_text(path.read_text().replace('"unsettled": 0', '"unsettled": 1'))
    with pytest.raises(RecordError, match=r"results\.json was changed after sealing"):
        build_record(registry, bench.calibration, ISSUE)


def test_run_that_ended_before_it_began_is_refused(registry: Registry) -> None:
    bench = calibrated_bench(registry, ended_h=8)
    with pytest.raises(RecordError, match="08:30:00\\) before it began"):
        build_record(registry, bench.calibration, ISSUE)


def test_changed_model_is_refused(registry: Registry) -> None:
    bench = calibrated_bench(registry)
    next((registry.root / "models").iterdir()).write_text("{}")
    with pytest.raises(RecordError, match="was changed after it was registered"):
        build_record(registry, bench.calibration, ISSUE)


def test_unsealed_run_is_refused(registry: Registry) -> None:
    bench = calibrated_bench(registry, seal=False)
    with pytest.raises(RecordError, match="isn't sealed"):
        build_record(registry, bench.calibration, ISSUE)
    with pytest.raises(RecordError, match="isn't sealed"):
        calibration_of(registry, bench.run_id)


def test_nobody_authorising_is_refused(registry: Registry) -> None:
    bench = calibrated_bench(registry)
    with pytest.raises(InputError, match="without an authorising person"):
        build_record(registry, bench.calibration, Issue([" "]))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[laboratory]\nname = 'Lab'\ncity = 'Ulm'\ncountry = 'Germany'\n", "laboratory.country"),
        ("[laboratory]\ncity = 'Ulm'\ncountry = 'DE'\n", "laboratory.name"),
        ("name = ", "laboratory.toml"),
    ],
)
def test_letterhead_names_the_key(tmp_path: Path, text: str, named: str) -> None:
    path = tmp_path / "laboratory.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=named.replace(".", r"\.")):
        read_letterhead(path)


def test_a_laboratory_refuses_what_is_not_reviewed(tmp_path: Path) -> None:
    path = tmp_path / "laboratory.toml"
    laboratory = '[laboratory]\nname = "Lab"\ncity = "Ulm"\ncountry = "DE"\n'
    path.write_text(laboratory)
    assert read_letterhead(path).refuses_unreviewed
    for head in (laboratory, ""):  # the simulated bench needs no laboratory to have a policy
        path.write_text(head + '[policy]\nunreviewed = "state"\n')
        assert not read_letterhead(path).refuses_unreviewed
    path.unlink()
    assert kept_letterhead(tmp_path).refuses_unreviewed
    path.write_text(laboratory + '[policy]\nunreviewed = "hide"\n')
    with pytest.raises(InputError, match=r"policy\.unreviewed"):
        read_letterhead(path)


def test_laboratory_is_its_own_customer_where_none_is_named(tmp_path: Path) -> None:
    path = tmp_path / "laboratory.toml"
    path.write_text("[laboratory]\nname = '扭矩实验室'\ncity = '苏州'\ncountry = 'CN'\n")
    laboratory, customer = read_letterhead(path).parties
    assert laboratory == customer
    assert laboratory.name == "扭矩实验室"


# Numbers


def test_value_ends_at_the_place_of_its_uncertainty() -> None:
    assert labels_of("en").pair(12.3456, 0.0823) == ("12.346", "0.082")
    assert labels_of("de").pair(-12.3456, 1.26) == ("−12,3", "1,3")
    assert labels_of("zh").pair(-0.0004, 0.26) == ("0.00", "0.26")


def test_every_word_exists_in_every_language_with_the_same_gaps() -> None:
    import re
    import tomllib
    from importlib import resources

    text = (resources.files("torquebench.reports.certificate") / "labels.toml").read_text("utf-8")
    for key, words in tomllib.loads(text).items():
        assert set(words) == {"en", "de", "zh"}, key
        gaps = {frozenset(re.findall(r"{\w+}", word)) for word in words.values()}
        assert len(gaps) == 1, key
