"""Answers of a plant about transducers, specimens and benches, from the benches' records."""

from datetime import date
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet as pq
import pytest
from plugins.plant.tests.plant_bench import add_calibration, add_run, backlash_results
from sqlalchemy.engine import URL
from tests import postgresql_server
from tests.support.draws import nightly

from torquebench.errors import InputError
from torquebench.records import Equipment, Registry, Report
from torquebench_plant import (
    Answer,
    Plant,
    SpecimenFilter,
    capability,
    charts,
    compare,
    drift,
    drift_of_kind,
    due,
    forward,
    outliers,
    specimens,
)
from torquebench_plant.statistics import capability as capability_of

BACKLASH = SpecimenFilter("RV-40E", "backlash")


def transducer(serial: str = "T-1") -> Equipment:
    return Equipment("transducer", serial, "HBK", "T40B", 1000.0)


def life_of_a_transducer(plant: Plant, tmp_path: Path) -> list[URL]:
    """T-1 drifts by 0.01 % a month, first on one bench, then on another bench of the same name."""
    urls = []
    for number, months in ((1, range(6)), (2, range(6, 12))):
        _, url = plant.register_bench("Bench", f"Hall {number}")
        with Registry.open(tmp_path / f"bench-{number}") as registry:
            registry.add_equipment(transducer())
            for month in months:
                run_id = f"2026-{month:02d}-calibrate"
                add_calibration(registry, run_id, "T-1", 0.01 * month, days=30.0 * month)
            if number == 2:
                registry.add_equipment(transducer("T-2"))
                registry.add_equipment(Equipment("calibrator", "CAL-1"))
                registry.add_report(
                    Report("calibrator", "CAL-1", "2025-17", "PTB", due=date(2026, 12, 1))
                )
            assert forward(registry, url).problems == []
        urls.append(url)
    return urls


def test_what_is_due_is_listed_with_its_bench(plant: Plant, tmp_path: Path) -> None:
    life_of_a_transducer(plant, tmp_path)
    found = due(plant, 30, today=date(2026, 11, 20))
    assert [(row["serial"], row["state"], row["days_left"]) for row in found.rows()] == [
        ("CAL-1", "due", 11),
        ("T-2", "never calibrated", None),
    ]
    later = due(plant, 30, today=date(2027, 12, 20)).rows()
    assert [(row["serial"], row["state"], row["bench"], row["place"]) for row in later[:2]] == [
        ("CAL-1", "overdue", "2 Bench", "Hall 2"),
        ("T-1", "overdue", "2 Bench", "Hall 2"),
    ]


def test_due_and_drift_name_the_same_day(plant: Plant, tmp_path: Path) -> None:
    """A drift of 0.12 % a year leaves ±0.1 % about the last calibration within a year.

    Version 0.2.0 compared with the first value of all, and `due` ignored the drift.
    """
    life_of_a_transducer(plant, tmp_path)
    for tolerance, drifts in ((0.1, True), (0.5, False)):
        by = date.fromisoformat(drift(plant, "T-1", tolerance).facts["calibrate again by"])
        found = due(plant, 10_000, tolerance_percent=tolerance).rows()
        (row,) = [each for each in found if each["serial"] == "T-1"]
        assert row["due"] == by
        assert row["remark"] == ("by its drift" if drifts else "")
        stated = date(2027, 12, 1)
        assert (by < stated) == drifts
    last = date(2026, 12, 1)
    leaves = date.fromisoformat(
        drift(plant, "T-1", 0.1).facts["Span error clockwise leaves ±0.1 %"]
    )
    assert (leaves - last).days == pytest.approx(0.1 / 0.12175 * 365.25, rel=0.02)


def test_a_transducer_is_followed_over_its_life_and_benches(plant: Plant, tmp_path: Path) -> None:
    life_of_a_transducer(plant, tmp_path)
    found = drift(plant, "T-1", 0.5)
    spans = [row for row in found.rows() if row["quantity"] == "Span error clockwise"]
    assert [row["value"] for row in spans] == pytest.approx([0.01 * k for k in range(12)])
    assert [row["bench"] for row in spans] == ["1 Bench"] * 6 + ["2 Bench"] * 6
    per_year = found.facts["Span error clockwise, % a year"]
    assert float(per_year) == pytest.approx(0.01 * 365.25 / 30.0, rel=0.01)
    assert found.simulated
    with pytest.raises(InputError, match="T-1, T-2"):
        drift(plant, "T-9")


@pytest.mark.parametrize("kind", ["share", nightly("bucket")])
def test_a_kind_of_transducer_drifts_as_its_points_say(
    kind: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """DuckDB reads the Parquet files that the registry lists, on a share and in an object store."""
    share = f"file://{tmp_path}/share"
    url = share if kind == "share" else request.getfixturevalue("bucket") + "-drift"
    socket = request.getfixturevalue("plant_socket")
    database = postgresql_server.create_database(socket, f"kind_{kind}")
    with Plant.create(database, url) as plant:
        links = life_of_a_transducer(plant, tmp_path)
        found = drift_of_kind(plant, "T40B")
        assert found.facts["span drift, % a year"] == pytest.approx(0.12175, rel=1e-4)
        rows = [row for row in found.rows() if row["direction"] == "clockwise"]
        assert [row["span_error_percent"] for row in rows] == pytest.approx(
            [0.01 * k for k in range(12)], abs=1e-9
        )
        # A withdrawn run is in no answer any more.
        plant.withdraw(plant.run("2026-05-calibrate"), by="Boss", reason="wrong standard")
        assert len(drift_of_kind(plant, "T40B")) == 22
        assert (
            len([row for row in drift(plant, "T-1").rows() if "counter" in row["quantity"]]) == 11
        )
        with pytest.raises(InputError, match="T40B"):
            drift_of_kind(plant, "T10F")
        # Nor is a calibration that a second person rejected.
        with Registry.open(tmp_path / "bench-2") as registry:
            registry.review("calibrations", 1, checked_by="Boss", accepted=False)
            forward(registry, links[1])
        assert len(drift_of_kind(plant, "T40B")) == 20


def production(plant: Plant, tmp_path: Path) -> np.ndarray:
    """Three benches test 12 specimens each; one bench and one specimen deviate."""
    values = 0.8 + 0.02 * np.random.default_rng(5).normal(size=36)
    values[24:] += 0.05
    values[7] = 1.4
    for bench in range(3):
        _, url = plant.register_bench(f"Bench {bench + 1}")
        with Registry.open(tmp_path / f"bench-{bench}") as registry:
            for k in range(12 * bench, 12 * bench + 12):
                serial = f"S-{k}"
                batch = {"batch": f"B{k % 4}"}
                registry.add_equipment(Equipment("reducer", serial, details=batch))
                results = backlash_results(serial, float(values[k]))
                results["quantities"][0]["limit"] = "≤ 1 arcmin"
                add_run(registry, f"run-{k}", "test-hysteresis", results, hours=float(k))
            forward(registry, url)
    return values


def test_production_is_judged(plant: Plant, tmp_path: Path) -> None:
    values = production(plant, tmp_path)
    listed = specimens(plant, BACKLASH)
    assert listed.columns["value"] == pytest.approx(values.tolist())
    assert set(listed.columns["batch"]) == {"B0", "B1", "B2", "B3"}

    first, *benches = capability(plant, BACKLASH).rows()
    expected = capability_of(listed.columns["value"], upper=1.0, u_common=0.025)
    assert (first["cpk"], first["cpk_low"]) == pytest.approx(
        (expected.cpk, expected.cpk_interval[0])
    )
    assert [row["bench"] for row in benches] == ["1 Bench 1", "2 Bench 2", "3 Bench 3"]
    narrow = capability(plant, SpecimenFilter("RV-40E", "backlash", bench=2), lower=0.5)
    assert narrow.rows()[0]["specimens"] == 12
    assert narrow.rows()[0]["cp"] is None

    charted = charts(plant, BACKLASH, base=7)
    assert "outside" in charted.columns["remark"][7]
    assert all("EWMA" in each for each in charted.columns["remark"][28:36])

    odd = outliers(plant, BACKLASH).rows()
    assert ("bench", "3 Bench 3") in [(row["what"], row["name"]) for row in odd]
    assert ("specimen", "S-7") in [(row["what"], row["name"]) for row in odd]
    assert "batch" not in [row["what"] for row in odd]

    plant.withdraw(plant.run("run-7"), by="Boss", reason="slipped")
    assert len(specimens(plant, BACKLASH)) == 35


def test_benches_are_compared_by_a_travelling_specimen(plant: Plant, tmp_path: Path) -> None:
    for bench in range(3):
        _, url = plant.register_bench(f"Bench {bench + 1}")
        with Registry.open(tmp_path / f"bench-{bench}") as registry:
            for value in (0.8, 0.81):
                results = backlash_results("GOLD", value + 0.04 * (bench == 2))
                add_run(registry, f"gold-{value}", "test-hysteresis", results)
            forward(registry, url)
    found = compare(plant, "GOLD", "backlash", reference=1).rows()
    assert [row["runs"] for row in found] == [2, 2, 2]
    u = 2.0 * np.hypot(0.025, 0.005)  # of a run, and scatter of the mean of two
    assert found[2]["en"] == pytest.approx(0.04 / np.hypot(u, u))
    assert found[0]["en"] == found[1]["en"] == 0.0
    with pytest.raises(InputError, match="reference bench 9"):
        compare(plant, "GOLD", "backlash", reference=9)
    with pytest.raises(InputError, match="one of backlash"):
        compare(plant, "GOLD", "lost_motion")
    with pytest.raises(InputError, match="no backlash of RV-9"):
        specimens(plant, SpecimenFilter("RV-9", "backlash"))
    (last,) = specimens(plant, BACKLASH).rows()
    assert last["bench"] == "3 Bench 3"  # a specimen that is tested again counts once


def test_short_tests_are_no_production(plant: Plant, tmp_path: Path) -> None:
    _, url = plant.register_bench("Bench")
    with Registry.open(tmp_path / "bench") as registry:
        add_run(registry, "run-1", "test-hysteresis-short", backlash_results("S-1"))
        forward(registry, url)
    with pytest.raises(InputError, match=r"a tested specimen or type; .*short tests don't count"):
        specimens(plant, BACKLASH)


def test_benches_are_listed_by_their_numbers(plant: Plant, tmp_path: Path) -> None:
    for number in range(1, 11):
        _, url = plant.register_bench("Bench")
        if number in (2, 10):
            with Registry.open(tmp_path / f"bench-{number}") as registry:
                for k in range(10):
                    results = backlash_results(f"S-{number}-{k}", 0.8 + 0.01 * k)
                    add_run(registry, f"run-{number}-{k}", "test-hysteresis", results)
                forward(registry, url)
    rows = capability(plant, BACKLASH, upper=1.0).rows()
    assert [row["bench"] for row in rows] == ["all benches", "2 Bench", "10 Bench"]


def test_of_a_long_answer_the_most_urgent_or_the_newest_rows_are_shown() -> None:
    urgent = Answer("Due", {"serial": list("abc")})
    over_time = Answer("Values", {"when": [1, 2, 3], "value": [0.1, 0.2, 0.3]})
    assert [row["serial"] for row in urgent.shown(2)] == ["a", "b"]
    assert [row["when"] for row in over_time.shown(2)] == [2, 3]


def test_any_answer_is_written_as_csv_and_parquet(tmp_path: Path) -> None:
    answer = Answer("A", {"name": ["a", "µ"], "value_nm": [1.5, None]})
    answer.write(tmp_path / "a.csv")
    answer.write(tmp_path / "a.parquet")
    assert pq.read_table(tmp_path / "a.parquet").to_pylist() == answer.rows()
    assert pyarrow.csv.read_csv(tmp_path / "a.csv").to_pylist() == answer.rows()
    with pytest.raises(InputError, match="Parquet"):
        answer.write(tmp_path / "a.xyz")
