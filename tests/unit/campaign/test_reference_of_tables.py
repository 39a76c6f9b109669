"""U of the standard in a calibration table's comments: written, read, joined and overridden."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.tables import parse_calibration

import torquebench as tb
from torquebench.bench import default_bench
from torquebench.calibration import CalibrationData
from torquebench.campaign.bench_chains import bench_effects, referenced
from torquebench.campaign.chains import reference_effect
from torquebench.campaign.turning import joined_tables
from torquebench.chain import Reference
from torquebench.errors import InputError
from torquebench.tables import calibration_csv
from torquebench.tables.remarks import reference_remarks
from torquebench.uncertainty import CertifiedUncertainty

RANGE_NM = 50.0
BENCH = {"bench": default_bench()}


def table(**changes: Any) -> CalibrationData:
    up = np.linspace(-RANGE_NM, RANGE_NM, 11)
    reading = np.concatenate([up, up[::-1]])
    found = CalibrationData(
        reading,
        1.001 * reading,
        np.ones(22),
        np.sign(np.repeat([1, -1], 11) * reading),
        RANGE_NM,
        side="input",
        standard_temperature_c=np.full(22, 25.0),
        simulated=True,
    )
    return replace(found, **changes)


def read(text: str) -> CalibrationData:
    return parse_calibration(text, "a.csv")


def test_a_table_of_the_bench_states_the_standard_of_its_chain() -> None:
    written = referenced(table(), BENCH)
    (effect,) = (
        each for each in bench_effects(BENCH["bench"], table()) if isinstance(each, Reference)
    )
    assert written.reference == effect
    assert effect.temperature_of_torque > 0.0
    text = calibration_csv(written)
    assert "# reference = certificate SIM-CERT-1 of SIM-CAL-1\n" in text
    found = read(text).reference
    assert found is not None
    assert (found.certified, found.record) == (effect.certified, effect.record)
    assert found.temperature_of_torque == pytest.approx(effect.temperature_of_torque)
    assert found.drift_of_torque == 0.0
    assert not found.gaps()
    assert read(text).sha256() == written.sha256() == table().sha256()


def test_a_verification_states_the_standard_that_was_mounted() -> None:
    found = referenced(table(), BENCH, "SIM-VER-1").reference
    assert found is not None
    assert found.record == "certificate SIM-CERT-2 of SIM-VER-1"
    assert found.certified.at(RANGE_NM) == pytest.approx(2e-5 * RANGE_NM)


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        ("0.02", CertifiedUncertainty.of_range(2e-4, RANGE_NM)),
        ("0.02 % of torque", CertifiedUncertainty.of_torque(2e-4)),
        ("1: 0.01, 50: 0.02", CertifiedUncertainty((1.0, 50.0), (0.01, 0.02))),
    ],
)
def test_a_person_states_it_in_words(stated: str, expected: CertifiedUncertainty) -> None:
    found = read(f"# reference_uncertainty = {stated}\n{calibration_csv(table())}").reference
    assert found is not None
    assert (found.certified, found.record) == (expected, "stated in a.csv")
    assert found.gaps() == ("temperature of standard", "drift of standard")
    assert reference_remarks(found).keys() == {"reference", "reference_uncertainty"}


@pytest.mark.parametrize(
    "comment",
    [
        "reference_uncertainty = a little",
        "reference_uncertainty = 1: 0.01: 3",
        "reference_uncertainty = -0.02",
        "reference_uncertainty = 0.02 of the moon",
        "reference_uncertainty = 0.02\n# reference_drift_percent = much",
    ],
)
def test_a_comment_that_is_no_uncertainty_is_refused(comment: str) -> None:
    with pytest.raises(InputError, match=r"a\.csv: the comment says reference_"):
        read(f"# {comment}\n{calibration_csv(table())}")


def test_of_several_standards_the_larger_uncertainty_counts_everywhere() -> None:
    one = Reference("A", CertifiedUncertainty((5.0, 50.0), (0.001, 0.03)), 1e-4, 0.0)
    two = Reference("B", CertifiedUncertainty((-50.0, 2.0, 50.0), (0.02, 0.01, 0.011)), 0.0, 2e-4)
    said: list[str] = []
    tables = {
        "a.csv": table(reference=one),
        "b.csv": table(reference=two),
        "again.csv": table(reference=one),
        "c.csv": table(),
    }
    joined = joined_tables(tables, said.append).reference
    assert joined is not None
    assert (joined.record, joined.temperature_of_torque, joined.drift_of_torque) == (
        "A; B", 1e-4, 2e-4,
    )  # fmt: skip
    torque = np.linspace(-60.0, 60.0, 241)
    larger = np.maximum(one.certified.at(torque), two.certified.at(torque))
    assert np.all(joined.certified.at(torque) >= larger * (1 - 1e-12))
    at = np.array([-50.0, -5.0, 2.0, 5.0, 50.0])
    np.testing.assert_allclose(
        joined.certified.at(at), np.maximum(one.certified.at(at), two.certified.at(at))
    )
    unstated, several = said
    assert unstated.startswith("c.csv without U of the standard")
    assert several.startswith("tables of several standards")
    assert joined_tables({"c.csv": table(), "d.csv": table()}, pytest.fail).reference is None
    undated = joined_tables(
        {**tables, "d.csv": table(reference=replace(one, drift_of_torque=None))}
    )
    assert undated.reference is not None
    assert undated.reference.gaps() == ("drift of standard",)
    same = {"a.csv": table(reference=one), "b.csv": table(reference=one)}
    assert joined_tables(same, pytest.fail).reference == one


def test_what_a_person_states_takes_precedence_with_a_note() -> None:
    own = Reference("A", CertifiedUncertainty.of_range(2e-4, RANGE_NM))
    given = CertifiedUncertainty.of_range(5e-4, RANGE_NM)
    said: list[str] = []
    (effect,) = reference_effect(table(reference=own), given, "a.csv", said.append)
    assert effect == Reference("stated with the fit", given)
    assert said == [
        "a.csv states U of the standard up to 0.01 N·m; "
        "the U that was entered, up to 0.025 N·m, is used instead"
    ]
    assert reference_effect(table(reference=own), None, "", pytest.fail) == (own,)
    (same,) = reference_effect(table(reference=own), own.certified, "", pytest.fail)
    assert same.record == "stated with the fit"


def test_a_fit_in_python_takes_the_standard_of_its_table(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text(calibration_csv(referenced(table(), BENCH, "SIM-VER-1")), encoding="utf-8")
    default = tb.fit(tb.read_calibration(path), "polynomial-1")
    (effect,) = (each for each in default.chain.stored if isinstance(each, Reference))
    assert effect.record == "certificate SIM-CERT-2 of SIM-VER-1"
    with pytest.warns(tb.FitWarning, match="the U that was entered"):
        stated = tb.fit(tb.read_calibration(path), "polynomial-1", reference="0.5 of range")
    assert stated.torque(40.0).expanded_uncertainty_nm > 0.2
    assert default.torque(40.0).expanded_uncertainty_nm < 0.1
