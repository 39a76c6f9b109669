"""Calibrations that break their profile: named with the clause, refused or stated, by command."""

import sqlite3
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support.draws import nightly
from tests.system.command_line import laboratory
from tests.unit.reports.calibrated_bench import points

from torquebench import cli
from torquebench.calibration import CalibrationData, load_profile
from torquebench.compensation import load_model
from torquebench.tables import write_calibration

Command = Callable[..., tuple[int, str]]


@pytest.fixture
def command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Command:
    """Run a command in this process; return its exit code and all that it prints, in one line."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "400")
    laboratory(tmp_path / "data", people='A. Kim", "A. Boss')

    def run(*arguments: object) -> tuple[int, str]:
        of_tables = arguments[0] in ("fit", "apply")
        data = () if of_tables else ("--data", "data")
        monkeypatch.setattr("sys.argv", ["torquebench", *map(str, arguments), *data])
        with pytest.raises(SystemExit) as end:
            cli.main()
        said = capsys.readouterr()
        return int(end.value.code or 0), " ".join((said.out + said.err).split())

    return run


def enter(
    command: Command, data: CalibrationData, profile: str = "staircase", **given: str
) -> tuple[int, str]:
    """Evaluate a table and enter it, as a laboratory does that measured it elsewhere."""
    write_calibration(Path("table.csv"), data)
    options = {
        "reference-due": "2027-01-31",
        "performed": "2026-03-02",
        "reference-serial": "R-9",
        "reference-certificate": "K-77",
        "transducer": "T-7",
        "indicator": "C-1",
        "measured-by": "A. Kim",
        **{name.replace("_", "-"): value for name, value in given.items()},
    }
    named = [part for name, value in options.items() if value for part in (f"--{name}", value)]
    return command(
        *("records", "import", "table.csv", "--profile", profile),
        *("--reference-uncertainty", "0.02 of torque", "--resolution", 0.02, *named),
    )


def certificate(command: Command, *more: object) -> tuple[int, str]:
    return command("certificate", "calibration-1", "--authorised-by", "A. Boss", *more)


def good(profile: str = "staircase") -> CalibrationData:
    return points(load_profile(profile), simulated=False, temperature_drift_k=0.2)


def without_series(data: CalibrationData) -> CalibrationData:
    return data.subset(data.series != 2)


def step_off(data: CalibrationData) -> CalibrationData:
    standard = np.array(data.standard_nm)
    standard[3] *= 1.006
    return replace(data, standard_nm=standard)


def zero_off(data: CalibrationData) -> CalibrationData:
    reading = np.array(data.reading_nm)
    reading[np.flatnonzero((data.nominal_nm == 0.0) & (data.branch < 0))[0]] = 5.0
    return replace(data, reading_nm=reading)


def drifting(data: CalibrationData) -> CalibrationData:
    return replace(data, temperature_c=22.0 + np.linspace(0.0, 1.4, len(data)))


def test_a_good_calibration_gets_its_certificate(command: Command) -> None:
    code, said = enter(command, good(), "staircase")
    assert code == 0, said
    assert "no deviation from the profile" in said
    code, said = certificate(command)
    assert code == 0, said


@pytest.mark.parametrize(
    ("profile", "spoil", "clause", "found", "refused"),
    [
        ("staircase", without_series, "positions[0].series[1]", "no series clockwise", True),
        nightly(
            "reversing", without_series, "positions[0].series[0]", "no series through both", True
        ),
        nightly(
            "adaptive", without_series, "positions[0].series[0]", "no series counter-clock", True
        ),
        ("staircase", step_off, "loading.step_tolerance_percent", "deviation 0.6 %", True),
        nightly("reversing", step_off, "loading.step_tolerance_percent", "deviation 0.6 %", True),
        ("staircase", zero_off, "zero.return_limit_percent", "to 5 N·m, 0.25 % of full", True),
        nightly(
            "rapid-in-situ", zero_off, "zero.return_limit_percent", "to 5 N·m, 0.25 % of", False
        ),
        ("staircase", drifting, "environment.temperature_drift_k", "drifted by 1.4 K", False),
        nightly(
            "reversing", drifting, "environment.temperature_drift_k", "drifted by 1.4 K", False
        ),
    ],
)
def test_every_departure_is_named_with_its_clause(
    command: Command,
    profile: str,
    spoil: Callable[[CalibrationData], CalibrationData],
    clause: str,
    found: str,
    refused: bool,
) -> None:
    code, said = enter(command, spoil(good(profile)), profile)
    assert code == int(refused), said
    assert f"clause {clause}" in said
    assert found in said
    assert ("refuses a certificate" in said) == refused
    code, said = certificate(command)
    assert code == int(refused), said
    assert f"clause {clause}" in said
    assert found in said
    assert bool(list(Path("data").glob("certificates/*/*.pdf"))) != refused


def test_who_measured_and_who_signs_are_people_of_the_laboratory(command: Command) -> None:
    code, said = enter(command, good(), measured_by="Somebody")
    assert code == 2
    assert "'Somebody', who isn't a person of the laboratory allowed one of A. Kim, A. Boss" in said
    assert "points" not in said, "refused before anything is read or evaluated"
    assert not list(Path("data").glob("runs/*"))
    assert enter(command, good(), measured_by="a. kim")[0] == 0
    code, said = command("certificate", "calibration-1", "--authorised-by", "Somebody else")
    assert code == 2
    assert "authorised by 'Somebody else', who isn't a person of the laboratory" in said
    code, said = certificate(command)
    assert code == 0, said


@pytest.mark.parametrize("with_nominal", [True, False])
def test_random_torques_are_not_evaluated_in_steps(command: Command, with_nominal: bool) -> None:
    data = good()
    code, said = enter(
        command, data if with_nominal else replace(data, nominal_nm=None), "verification"
    )
    assert code == 2, said
    assert "profile verification has no steps: it draws its torques at random" in said
    assert "adaptive, check, rapid-in-situ, reversing, small-torques, staircase" in said
    assert "torquebench verify MODEL TABLE" in said
    assert "points," not in said


def test_small_steps_are_held_against_the_range(command: Command) -> None:
    """A rapid calibration takes what the standard says: 0.6 % of a step is no departure."""
    data = good("rapid-in-situ")
    code, said = enter(command, step_off(data), "rapid-in-situ")
    assert code == 0, said
    assert "no deviation" in said
    standard = np.array(data.standard_nm)
    standard[3] += 0.006 * data.range_nm
    code, said = enter(command, replace(data, standard_nm=standard), "rapid-in-situ")
    assert code == 1
    assert "deviation 0.6 % of full scale" in said
    assert "clause loading.step_tolerance_percent" in said


@pytest.mark.parametrize(
    ("due", "found"),
    [
        ("2026-03-01", "the certificate K-77 of R-9 expired on 2026-03-01"),
        ("", "the due date of the certificate of R-9 isn't stated"),
    ],
    ids=["expired", "not stated"],
)
def test_a_reference_out_of_date_is_refused(command: Command, due: str, found: str) -> None:
    for code, said in (
        enter(command, good(), "staircase", reference_due=due),
        certificate(command),
    ):
        assert code == 1, said
        assert found in said
        assert "clause reference.in_date" in said


@pytest.mark.parametrize(("day", "stated"), [("", False), ("2026-01-15", True)])
def test_the_day_of_the_standards_calibration_is_stated_or_a_deviation(
    command: Command, day: str, stated: bool
) -> None:
    assert enter(command, good(), "staircase", reference_performed=day)[0] == 0
    code, said = certificate(command)
    assert code == 0, said
    assert ("the date of the standard's certificate isn't stated" in said) is not stated


def test_a_standard_calibrated_after_the_measurement_is_refused(command: Command) -> None:
    code, said = enter(command, good(), "staircase", reference_performed="2026-03-03")
    assert code == 2, said
    assert "on the day of the measurement, 2026-03-02, or before" in said
    assert not list(Path("data").glob("runs/*"))


def test_a_record_changed_after_the_fact_is_refused(command: Command) -> None:
    assert enter(command, good(), "staircase")[0] == 0
    (results,) = Path("data").glob("runs/*/results.json")
    kept = results.read_text()
    results.write_text(kept.replace('"unsettled": 0', '"unsettled": 7'))
    code, said = certificate(command)
    assert code == 1
    assert "results.json was changed after sealing (clause deviations.changed_record)" in said
    results.write_text(kept)

    with sqlite3.connect("data/registry.sqlite") as registry:
        names = registry.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall()
        for (name,) in names:
            registry.execute(f'DROP TRIGGER "{name}"')
        registry.execute("UPDATE calibrations SET measured_by = 'B. Lie'")
    registry.close()
    code, said = certificate(command)
    assert code == 1
    assert "measured_by" in said
    assert "clause deviations.changed_record" in said
    code, said = command("records", "verify")
    assert code == 1
    assert "B. Lie" in said


def test_a_deviation_is_stated_in_the_language_of_the_certificate(command: Command) -> None:
    assert enter(command, drifting(good()), "staircase")[0] == 0
    code, _ = certificate(command, "--language", "de", "--language", "en")
    assert code == 0
    (xml,) = Path("data").glob("certificates/*/*.xml")
    text = xml.read_text(encoding="utf-8")
    assert "die Temperatur driftete um 1,4 K" in text
    assert "the temperature drifted by 1.4 K" in text


def test_reversing_cycles_state_their_zero_hysteresis(command: Command) -> None:
    code, said = enter(command, good("reversing"), "reversing")
    assert code == 0, said
    assert "Zero hysteresis before " in said
    assert "over 3 cycles" in said
    assert certificate(command, "--language", "de")[0] == 0
    (xml,) = Path("data").glob("certificates/*/*.xml")
    assert "Null nach Rechts- minus Null nach Linksdrehmoment" in xml.read_text(encoding="utf-8")


def test_the_same_points_are_entered_once(command: Command) -> None:
    assert enter(command, good(), "staircase")[0] == 0
    code, said = enter(command, good(), "staircase")
    assert code == 2
    assert "entered as calibration-1" in said


@pytest.mark.parametrize("missing", ["transducer", "indicator", "reference_serial", "measured_by"])
def test_what_a_certificate_needs_is_asked_for_on_entry(command: Command, missing: str) -> None:
    unnamed = replace(good(), transducer_serial="", counter_identity="")
    code, said = enter(command, unnamed, "staircase", **{missing: ""})
    assert code == 2
    assert f"--{missing.replace('_', '-')}" in said
    assert "before compensation" not in said, "asked for before the evaluation"
    assert not list(Path("data").glob("runs/*"))


def test_a_table_that_contradicts_itself_gives_a_marked_model(
    command: Command, tmp_path: Path
) -> None:
    profile = load_profile("rapid-in-situ").with_options(step_percent=5.0)
    data = points(profile, simulated=False, temperature_drift_k=0.2)
    standard = np.where(np.arange(len(data)) < 4, data.standard_nm, 0.97 * data.standard_nm)
    write_calibration(tmp_path / "changed.csv", replace(data, standard_nm=standard))
    fit = ("fit", "--model", "polynomial-2", "--out")

    code, said = command(*fit, "changed.json", "changed.csv")
    assert code == 1, said
    assert "rows 12 to 87" in said, "as the file numbers them"
    assert "The scale of the reading or of the standard has changed there" in said
    assert "--accept REASON --by NAME" in said
    assert "outlier" not in said
    assert load_model("changed.json").provenance.contradictions
    code, said = command(*fit, "accepted.json", "changed.csv", "--accept", "known step")
    assert code == 2, said
    assert not Path("accepted.json").exists()
    code, said = command(
        *fit, "accepted.json", "changed.csv", "--accept", "known step", "--by", "A. Kim"
    )
    assert code == 0, said
    assert load_model("accepted.json").provenance.accepted == "A. Kim: known step"
    Path("readings.csv").write_text("reading_nm\n100\n")
    code, said = command("apply", "changed.json", "readings.csv", "--out", "torque.csv")
    assert "the calibration of this model contradicts itself" in said
