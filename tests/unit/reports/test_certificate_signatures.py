"""What a certificate and its check state about how review, use and authorisation came about."""

from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from xml.etree import ElementTree

import pytest
from tests.unit.reports.calibrated_bench import CalibratedBench, calibrated_bench, points

from torquebench.calibration import load_profile, verify
from torquebench.chain import load_chain
from torquebench.errors import InputError, RecordError
from torquebench.panel.service import Actor
from torquebench.panel.service.access.people import People
from torquebench.records import CertificateEntry, Registry
from torquebench.records.accounts import Accounts
from torquebench.records.signatures import Signature, system_user
from torquebench.reports.certificate import (
    Issue,
    archive_folder,
    build_record,
    check_certificate,
    issue_certificate,
    kept_letterhead,
)
from torquebench.reports.certificate.content import certificate_content
from torquebench.reports.certificate.dcc import certificate_xml
from torquebench.testing.accounts import people_of

STRICT = Issue(["Boss"], require_signatures=True)
STATED = replace(STRICT, refuse_unreviewed=False)


@pytest.fixture
def registry(tmp_path: Path) -> Iterator[Registry]:
    with Registry.open(tmp_path) as opened:
        yield opened


@pytest.fixture
def accounts(registry: Registry) -> Iterator[tuple[People, Actor]]:
    with people_of(registry.root, "Kim", "Sommer", "Boss") as found:
        yield found


def verified(registry: Registry, operator: str = "M. Weber") -> CalibratedBench:
    """A calibration of the user of this computer, verified at fresh points."""
    bench = calibrated_bench(registry, operator=operator)
    (model,) = registry.models()
    profile = load_profile("rapid-in-situ").with_options(step_percent=12.5)
    fresh = points(profile, simulated=True, temperature_drift_k=0.0)
    result = verify(fresh, {"polynomial": load_chain(model.file)})
    performed = datetime(2026, 3, 3, tzinfo=UTC)
    registry.add_verification(model.model_id, result, performed=performed)
    return bench


def signed(name: str) -> Signature:
    return Signature("signed", name)


def review_and_use(registry: Registry, bench: CalibratedBench, reviewer: Signature) -> None:
    name, number = reviewer.account or "K. Typed", bench.calibration.calibration_id
    registry.review("calibrations", number, checked_by=name, signature=reviewer)
    (model,) = registry.models()
    registry.activate(model.model_id, operator=name, reason="checked", signature=reviewer)


def link_this_user(people: People, chief: Actor, name: str) -> None:
    people.change_user(chief, name, linked=["@".join(system_user())])


def test_a_typed_chain_is_named_act_by_act_and_refused_where_signatures_are_required(
    registry: Registry,
) -> None:
    bench = verified(registry)
    review_and_use(registry, bench, Signature.typed())
    loose = build_record(registry, bench.calibration, Issue(["A. Boss"]))
    assert loose.unreviewed == ()
    user, host = system_user()
    text = str(certificate_content(loose, "en")["facts"])
    assert text.count(f"typed by {user} on {host}, not signed") == 4  # as measured, too
    stated = build_record(registry, bench.calibration, replace(STATED, authorised_by=["A. Boss"]))
    assert stated.unreviewed == (
        "typed_check",
        "typed_use",
        "typed_authorisation",
        "unknown_person",
    )
    for language, words in (("de", "eingetippt"), ("zh", "未签署"), ("en", "typed")):
        banner = certificate_content(stated, language)["banner"]
        assert banner is not None
        assert words in banner
        assert "unreviewed_" not in banner
    with pytest.raises(RecordError, match="typed, not signed"):
        build_record(registry, bench.calibration, STRICT)


def test_signed_acts_of_other_people_pass_and_are_printed(
    registry: Registry, accounts: tuple[People, Actor]
) -> None:
    people, chief = accounts
    link_this_user(people, chief, "Kim")
    bench = verified(registry, operator="Kim")
    review_and_use(registry, bench, signed("Sommer"))
    authorised = replace(STRICT, signature=signed("Boss"))
    record = build_record(registry, bench.calibration, authorised)
    issue_certificate(registry, record)
    assert record.unreviewed == ()
    assert [act.role for act in record.acts if act.signed] == ["checked", "used", "authorised"]
    covered = {act.covers_sha256 for act in record.acts if act.role != "measured"}
    assert signed("x").about(registry.covered(bench.calibration.calibration_id)).sha256 in covered
    xml = ElementTree.fromstring(certificate_xml(record))
    people_named = [
        (each.findtext(".//{*}name/{*}content"), each.findtext("{*}description/{*}content") or "")
        for each in xml.iter("{https://ptb.de/dcc}respPerson")
    ]
    assert any(
        name == "Sommer" and "signed with the password of the account Sommer" in words
        for name, words in people_named
    )
    found = check_certificate(
        registry, str(archive_folder(registry, record.number) / f"{record.number}.json")
    )
    assert found.matches
    assert [(role, name) for role, name, signature in found.acts if signature] == [
        ("checked", "Sommer"),
        ("used", "Sommer"),
        ("authorised", "Boss"),
    ]


def test_a_certificate_says_what_its_signatures_prove_and_against_whom_nothing(
    registry: Registry,
) -> None:
    bench = verified(registry)
    review_and_use(registry, bench, Signature.typed())
    record = build_record(registry, bench.calibration, Issue(["A. Boss"]))
    stated = {
        "en": ("gave the password", "Neither proves anything against persons who can write"),
        "de": ("gab dafür das Passwort", "beweist nichts gegenüber Personen"),
        "zh": ("输入了账户密码", "不能防范可写入实验室记录的人员"),
    }
    xml = " ".join(ElementTree.fromstring(certificate_xml(record)).itertext())
    for language, words in stated.items():
        text = str(certificate_content(record, language))
        assert all(each in text for each in words)
        assert all(each in xml for each in words) == (language in record.languages)


@pytest.mark.parametrize("linked", ["", "Kim", "Sommer"])
def test_who_measured_by_command_is_recognised_only_where_the_user_is_linked(
    registry: Registry, accounts: tuple[People, Actor], linked: str
) -> None:
    people, chief = accounts
    if linked:
        link_this_user(people, chief, linked)
    bench = verified(registry, operator="bench user")
    if linked == "Sommer":  # who measured isn't who checks, although under another name
        with pytest.raises(RecordError, match="a person other than bench user"):
            review_and_use(registry, bench, signed("Sommer"))
        return
    review_and_use(registry, bench, signed("Sommer"))
    authorised = replace(STATED, signature=signed("Boss"))
    record = build_record(registry, bench.calibration, authorised)
    assert record.unreviewed == (() if linked else ("unknown_person",))


def test_a_review_counts_only_for_what_was_reviewed(registry: Registry) -> None:
    bench = verified(registry)
    review_and_use(registry, bench, Signature.typed())
    assert build_record(registry, bench.calibration, Issue(["A. Boss"])).unreviewed == ()
    (model,) = registry.models()
    profile = load_profile("rapid-in-situ").with_options(step_percent=12.5)
    fresh = points(profile, simulated=True, temperature_drift_k=0.1)
    again = verify(fresh, {"polynomial": load_chain(model.file)})
    performed = datetime(2026, 3, 4, tzinfo=UTC)
    registry.add_verification(model.model_id, again, performed=performed)
    later = Issue(["A. Boss"], refuse_unreviewed=False)
    assert build_record(registry, bench.calibration, later).unreviewed == ("unchecked",)


@pytest.mark.parametrize("days_ago", [3, 40])
def test_a_password_that_somebody_else_set_is_named_for_30_days(
    registry: Registry,
    accounts: tuple[People, Actor],
    monkeypatch: pytest.MonkeyPatch,
    days_ago: int,
) -> None:
    people, chief = accounts
    bench = verified(registry)
    changed = datetime.now(UTC) - timedelta(days=days_ago)
    monkeypatch.setattr(
        "torquebench.panel.service.access.people.utc_text", lambda: changed.isoformat()
    )
    people.change_user(chief, "Boss", password="another long password")
    authorised = replace(STATED, signature=signed("Boss"))
    record = build_record(registry, bench.calibration, authorised)
    (act,) = [each for each in record.acts if each.role == "authorised"]
    named = (changed.date(), "Chief")
    assert (named in act.password_set) == (days_ago < 30)
    text = str(certificate_content(record, "en")["facts"])
    line = f"password of the account set by Chief on {changed.date().isoformat()}"
    assert (line in text) == (days_ago < 30)


def test_the_check_tells_typed_from_signed_and_fails_where_signatures_are_required(
    registry: Registry,
) -> None:
    bench = verified(registry)
    review_and_use(registry, bench, Signature.typed())
    record = build_record(registry, bench.calibration, Issue(["A. Boss"]))
    issue_certificate(registry, record)
    file = str(archive_folder(registry, record.number) / f"{record.number}.json")
    assert check_certificate(registry, file).matches  # no accounts: nothing else is possible
    with people_of(registry.root):
        found = check_certificate(registry, file)
    assert not found.findings
    assert not found.matches
    assert len(found.unsigned) == 3
    assert all("typed, not signed" in each for each in found.unsigned)
    policy = registry.root / "laboratory.toml"
    policy.write_text('[policy]\nsignatures = "state"\n')
    assert check_certificate(registry, file).matches
    assert not kept_letterhead(registry.root).requires_signatures(registry.root)


def test_a_certificate_of_0_2_0_is_not_recorded_how(registry: Registry) -> None:
    bench = verified(registry)
    registry.add_certificate(
        CertificateEntry(
            number="TB-OLD",
            calibration_id=bench.calibration.calibration_id,
            issued=datetime(2026, 3, 5, tzinfo=UTC),
            authorised_by="A. Boss",
            files={"TB-OLD.pdf": "0" * 64},
            summary={"record_sha256": "1" * 64},
        )
    )
    with people_of(registry.root):
        found = check_certificate(registry, f"torquebench-certificate;TB-OLD;{'1' * 64}")
    assert found.unsigned == ("typed, not signed: authorised by A. Boss (not recorded how)",)


def test_the_names_of_accounts_are_their_owners_alone(
    registry: Registry, accounts: tuple[People, Actor]
) -> None:
    people, chief = accounts
    bench = verified(registry)
    (model,) = registry.models()
    number = bench.calibration.calibration_id

    def review(name: str) -> None:
        registry.review("calibrations", number, checked_by=name)

    acts = (
        review,
        lambda name: registry.activate(model.model_id, operator=name, reason="x"),
        lambda name: registry.amend(
            "calibrations", number, {"measured_by": "X"}, amended_by=name, reason="x"
        ),
        lambda name: registry.deactivate(
            model.transducer_serial, model.counter_identity, operator=name, reason="x"
        ),
    )
    for act in acts:
        for name in ("Sommer", " sommer ", "\uff33ommer"):
            with pytest.raises(InputError, match="entered by somebody else"):
                act(name)
    link_this_user(people, chief, "Sommer")
    for act in acts[1:3]:
        act("Sommer")
    with pytest.raises(InputError, match="entered by somebody else"):
        review("Boss")


def test_accounts_are_read_from_a_folder_of_0_2_0_or_none(tmp_path: Path) -> None:
    assert not Accounts.of(tmp_path)
    (tmp_path / "panel.sqlite").write_bytes(b"no database at all" * 100)
    with pytest.raises(RecordError, match="can't be read"):
        Accounts.of(tmp_path)


def test_a_refused_certificate_leaves_no_review(registry: Registry) -> None:
    bench = calibrated_bench(registry)  # not verified
    number = bench.calibration.calibration_id
    review = registry.prepare_review("calibrations", number, checked_by="K. Sommer")
    with pytest.raises(RecordError, match="isn't verified"):
        build_record(registry, bench.calibration, Issue(["A. Boss"], review=review))
    assert registry.reviews("calibrations", number) == []
