"""Tables of other laboratories that are fitted: the right torque, or what is wrong by row.

The tables in `calibration/field` are shaped after public reports; their right answers are known.
"""

from pathlib import Path

import numpy as np
import pytest
from tests.support.draws import drawn
from tests.support.tables import parse_calibration

from torquebench.calibration import CalibrationData
from torquebench.campaign.fitting import fit_table
from torquebench.campaign.results import FitResult
from torquebench.compensation import RECOMMENDED
from torquebench.errors import InputError
from torquebench.tables import read_calibration

FIELD = Path(__file__).parents[1] / "calibration" / "field"
INCH_POUND = 0.1129848290276167
"""N·m in 1 lbf·in: 0.0254 m times 4.4482216152605 N."""


def table(name: str) -> CalibrationData:
    (path,) = FIELD.glob(f"{name}_*.csv")
    return read_calibration(path)


def predicted(
    fit: FitResult, reading_nm: list[float], branch: int
) -> tuple[list[float], list[float]]:
    count = fit.model.n_features_in_
    columns = [[value, branch, 1.0][:count] for value in reading_nm]
    torque, uncertainty = fit.model.predict(columns, return_std=True)
    return torque.tolist(), (2.0 * uncertainty).tolist()


@pytest.mark.parametrize(("name", "unit"), [("f3", INCH_POUND), ("f4", 1e6)])
def test_units_of_headers_are_converted_with_their_prefixes(name: str, unit: float) -> None:
    data = table(name)
    cells = [line.split(",") for line in next(FIELD.glob(f"{name}_*")).read_text().splitlines()]
    standard, reading = (np.array(column, dtype=float) for column in zip(*cells[1:], strict=True))
    assert data.standard_nm == pytest.approx(unit * standard)
    assert data.reading_nm == pytest.approx(unit * reading)
    fit = fit_table(data, name, "polynomial-2")
    assert fit.contradictions == ()
    assert fit.fitted.rms_nm < fit.raw.rms_nm


def test_a_title_block_stands_above_the_header() -> None:
    data = table("f8")
    assert data.standard_nm.tolist() == [0.0, 50.0, 100.0, 50.0, 0.0]
    assert data.reading_nm.tolist() == [0.1, 50.1, 100.2, 50.2, 0.1]
    assert fit_table(data, "f8", "polynomial-1").contradictions == ()


@pytest.mark.parametrize("kind", [RECOMMENDED, "polynomial-2"])
def test_the_zero_of_an_untared_table_is_named_and_no_contradiction(kind: str) -> None:
    fit = fit_table(table("f6"), "f6", kind)
    assert fit.contradictions == ()
    assert [each for each in fit.remarks if "without load the reading is +1 N·m" in each]
    torque, expanded = predicted(fit, [1.0, 101.05, -99.05], 1)
    for value, expected, u in zip(torque, [0.0, 100.0, -100.0], expanded, strict=True):
        assert value == pytest.approx(expected, abs=max(u, 0.03))


@pytest.mark.parametrize("kind", [RECOMMENDED, "polynomial-2"])
def test_an_offset_of_rising_points_is_not_mirrored_onto_the_falling_branch(kind: str) -> None:
    fit = fit_table(table("f11"), "f11", kind)
    for branch in (1, -1):
        torque, expanded = predicted(fit, [20.5, 50.5, 80.5], branch)
        for value, expected, u in zip(torque, [20.0, 50.0, 80.0], expanded, strict=True):
            assert value == pytest.approx(expected, abs=u)


@pytest.mark.parametrize("kind", [RECOMMENDED, "polynomial-2"])
def test_a_wrong_row_is_left_out_by_the_number_of_the_file_and_causes_nothing_else(
    kind: str,
) -> None:
    fit = fit_table(table("f10"), "f10", kind)
    assert fit.contradictions == ()
    named = [each for each in fit.remarks if "row " in each]
    assert len(named) == 1
    assert named[0].startswith("outlier, left out: row 5: reading 2.1 N·m, standard 60 N·m")
    assert predicted(fit, [60.05], 1)[0] == pytest.approx([60.0], abs=0.03)


@pytest.mark.parametrize("kind", [RECOMMENDED, "polynomial-2"])
def test_a_wrong_row_is_refused_or_kept_by_option(kind: str) -> None:
    with pytest.raises(InputError, match=r"row 5: reading 2\.1"):
        fit_table(table("f10"), "f10", kind, outliers="refuse")
    kept = fit_table(table("f10"), "f10", kind, outliers="keep")
    assert not [each for each in kept.remarks if "outlier" in each]
    assert kept.fitted.worst_nm > 1.0


def text(standard: np.ndarray, reading: np.ndarray, unit: str, blank: set[int]) -> tuple[str, dict]:
    """Return a table with a title and empty lines, and the line of each point."""
    lines, row = ["Report;1;2", f"Reference [{unit}];Indication [{unit}]"], {}
    for point, (s, r) in enumerate(zip(standard, reading, strict=True)):
        if point in blank:
            lines.append("")
        lines.append(f"{s:.6f};{r:.6f}")
        row[point] = len(lines)
    return "\n".join(lines) + "\n", row


@pytest.mark.usefixtures("curve_alone")
@pytest.mark.parametrize("seed", drawn(60, by_day=6))
def test_wrong_rows_of_random_tables_are_named_by_their_lines(seed: int) -> None:
    """Any unit, range and step; titles and empty lines; the error from 20 scatters on."""
    rng = np.random.default_rng([seed, 33])
    unit = ["N·m", "mN·m", "kN·m", "MN·m", "lbf·in"][seed % 5]
    largest = float(rng.choice([2.0, 50.0, 700.0]))
    leg = np.linspace(0.0, 1.0, int(rng.integers(7, 16)))
    torque = largest * np.concatenate([leg, leg[-2::-1], -leg[1:], -leg[-2::-1]])
    scatter = 1e-4 * largest
    error = rng.normal() * 0.01 * torque + rng.normal() * 2e-3 * torque * np.abs(torque) / largest
    reading = torque + error + scatter * rng.normal(size=torque.size)
    wrong = int(rng.integers(3, torque.size - 3))
    reading[wrong] += rng.choice([-1, 1]) * scatter * 20.0 * 20.0 ** rng.uniform()
    content, row = text(torque, reading, unit, set(rng.integers(0, torque.size, 3).tolist()))
    fit = fit_table(parse_calibration(content, "table.csv"), "table.csv", "polynomial-3")
    assert fit.contradictions == ()
    named = [each.split(":")[1].strip() for each in fit.remarks if each.startswith("outlier")]
    assert f"row {row[wrong]}" in named
    assert len(named) <= 2


@pytest.mark.usefixtures("curve_alone")
@pytest.mark.parametrize("seed", drawn(60, by_day=6))
def test_zeros_that_differ_between_series_are_subtracted_and_named(seed: int) -> None:
    """Of a table read without taring, whose zero moves by 1 to 5 % of full scale or not at all."""
    rng = np.random.default_rng([seed, 2])
    leg = np.linspace(0.0, 1.0, int(rng.integers(6, 12)))
    rise = np.concatenate([leg, leg[-2::-1]])
    cycles = int(rng.integers(2, 4))
    torque = 500.0 * np.tile(np.concatenate([rise, -rise]), cycles)
    series = np.repeat(np.arange(2 * cycles), rise.size)
    moved = seed % 3 > 0
    steps = rng.choice([-1, 1], 2 * cycles) * rng.uniform(5.0, 25.0, 2 * cycles)
    zeros = 12.0 + (np.cumsum(steps) if moved else 0.0 * steps)
    span = 1.0 + 0.01 * rng.normal()
    reading = span * torque + zeros[series] + 0.05 * rng.normal(size=torque.size)
    lines = [f"{n + 1};{s:.6g};{r:.6f}" for n, s, r in zip(series, torque, reading, strict=True)]
    content = "\n".join(["series;standard_nm;reading_nm", *lines]) + "\n"
    fit = fit_table(parse_calibration(content, "table.csv"), "table.csv", "polynomial-1")
    assert fit.contradictions == ()
    assert moved == any("the zero of each series was subtracted" in each for each in fit.remarks)
    tared = span * np.array([-400.0, 100.0, 450.0]) + (0.0 if moved else 12.0)
    value, _ = predicted(fit, tared.tolist(), 1)
    assert value == pytest.approx([-400.0, 100.0, 450.0], abs=0.2)
