"""Reports of evaluated tables, and what every report keeps to: columns, maps, counts."""

from pathlib import Path

import numpy as np
import pytest

from torquebench.calibration import summarise_errors
from torquebench.campaign.reducers.quantities import result_quantities
from torquebench.cli.terminal.page import print_page
from torquebench.operations.evaluating import Friction, Hysteresis
from torquebench.reducers import (
    LoopSettings,
    NoLoadResult,
    OpenLoopError,
    evaluate_efficiency,
    evaluate_friction,
    evaluate_hysteresis,
    evaluate_no_load,
)
from torquebench.reports.errors_table import errors_table
from torquebench.reports.evaluation_report import evaluation_page, open_loop_page
from torquebench.reports.page import Page, Section, Table, render_page
from torquebench.reports.page_pdf import write_report
from torquebench.reports.reducers.report import tables_of

SETTINGS = LoopSettings(rated_torque_nm=400.0)


def loops(creep_arcmin: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    phase = np.linspace(0.0, 6.0 * np.pi, 901)
    torque = -400.0 * np.cos(phase)
    angle = torque / 110.0 - 0.3 * np.tanh(20.0 * np.sin(phase))
    return torque, np.radians((angle + np.linspace(0.0, creep_arcmin, phase.size)) / 60.0)


def test_loops_are_reported_with_their_figure(tmp_path: Path) -> None:
    result = evaluate_hysteresis(*loops(), SETTINGS)
    shown = Hysteresis(data=(Path("loops.csv"),), rated_torque_nm=400.0)
    quantities = result_quantities(result, ())
    page = evaluation_page(
        "hysteresis", "loops.csv", result, quantities, None, lambda: shown.figures(result)
    )
    text = render_page(page)
    assert text.count("<svg") == 1
    assert "torsional stiffness" in text
    assert write_report(page, tmp_path / "loops.pdf").read_bytes().startswith(b"%PDF")


def test_an_open_loop_names_its_gap_and_is_drawn() -> None:
    with pytest.raises(OpenLoopError, match=r"2\.\d+ arcmin off its start") as caught:
        evaluate_hysteresis(*loops(6.0), SETTINGS)
    gap = np.degrees(caught.value.loop.closure_rad) * 60.0
    assert gap == pytest.approx(2.0, rel=0.2)
    text = render_page(open_loop_page("open.csv", caught.value.loop, str(caught.value)))
    assert text.count("<svg") == 1
    assert "arcmin off its start" in text


def test_friction_is_reported_with_its_figure() -> None:
    speed = np.array([100.0, 300.0, 500.0, 700.0, 1000.0] * 2)
    torque = 0.1 + 1e-4 * speed + 1e-3 * np.cos(np.arange(10.0) ** 2)
    result = evaluate_friction(speed, torque)
    shown = Friction(data=(Path("f.csv"),))
    quantities = result_quantities(result, ())
    page = evaluation_page(
        "friction", "f.csv", result, quantities, None, lambda: shown.figures(result)
    )
    assert render_page(page).count("<svg") == 1


def test_an_efficiency_map_is_a_map_and_no_list_of_a_hundred_rows() -> None:
    grid = [
        (sign * torque, sign * speed, 1.0 + 0.002 * repeat)
        for torque in (80.0, 100.0, 200.0, 300.0, 400.0)
        for speed in (150.0, 300.0, 600.0, 900.0, 1200.0)
        for sign in (1.0, -1.0)
        for repeat in range(3)
    ]
    load, speed, more = (np.array(column) for column in zip(*grid, strict=True))
    result = evaluate_efficiency(load * more / 75.0, load, speed, 100.0)
    assert len(result.quantities()) == 75
    (table,) = tables_of(result, result_quantities(result, ()))
    assert table.header == ("N·m", "150 rpm", "300 rpm", "600 rpm", "900 rpm", "1200 rpm", "U, %")
    assert [row[0] for row in table.rows] == ["80", "100", "200", "300", "400"]
    values = [float(cell) for row in table.rows for cell in row[1:-1]]
    assert values == pytest.approx([74.9] * 25, abs=0.2)
    assert "mean of both directions" in table.caption


def no_load(repeats: int, speeds: tuple[float, ...], ways: tuple[float, ...]) -> NoLoadResult:
    """Evaluate friction; each repeat is 4 mN·m above the one before, the speed rises and falls."""
    grid = [
        (sign * speed, sign * (0.1 + 1e-4 * speed) + 4e-3 * number + 1e-3 * branch, number, branch)
        for sign in ways
        for number in range(1, repeats + 1)
        for branch in (1.0, -1.0)
        for speed in speeds
    ]
    speed, torque, repeat, branch = (np.array(column) for column in zip(*grid, strict=True))
    return evaluate_no_load(speed, torque, repeat=repeat, branch=branch)


def test_no_load_torque_is_a_table_by_speed_with_a_column_a_direction() -> None:
    speeds = (20.0, 50.0, 100.0, 300.0, 500.0, 700.0, 900.0, 1200.0)
    result = no_load(3, speeds, (1.0, -1.0))
    assert len(result.quantities()) > 3 * len(speeds)
    by_speed, rest = tables_of(result, result_quantities(result, ()))
    assert by_speed.header == (
        *("rpm", "clockwise, N·m", "range of repeats, N·m", "counter-clockwise, N·m"),
        *("range of repeats, N·m", "mean of both, N·m"),
    )
    assert [row[0] for row in by_speed.rows] == [f"{speed:g}" for speed in speeds]
    stated_of = {each.key: each.estimate for each in result.quantities()}
    for row, speed in zip(by_speed.rows, speeds, strict=True):
        for cell, key in ((1, f"+{speed:.0f}"), (3, f"-{speed:.0f}"), (5, f"{speed:.0f}")):
            value, whole = (float(each) for each in row[cell].split(" ± "))
            torque = stated_of[f"no_load_{key}_rpm"]
            assert whole == pytest.approx(torque.expanded_uncertainty(), rel=0.05)
            assert value == pytest.approx(torque.value, abs=0.051 * whole)
        # 8 mN·m between the repeats; the branches' difference cancels
        assert [row[2], row[4]] == ["0.0080", "0.0080"]
    assert not [row for row in rest.rows if "no-load" in row[0]]
    assert any("viscous" in row[0] for row in rest.rows)


def test_the_terminals_table_of_no_load_torque_fits_into_80_columns(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    result = no_load(3, (20.0, 50.0, 100.0, 300.0, 500.0, 1200.0), (1.0, -1.0))
    quantities = result_quantities(result, ())
    print_page(evaluation_page("no-load", "f.csv", result, quantities, None, tuple))
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert not any("…" in line for line in lines)
    assert sum(line.count(" ± ") == 3 for line in lines) == 6


def test_one_direction_and_one_repeat_have_no_empty_columns() -> None:
    result = no_load(1, (100.0, 300.0, 500.0, 700.0, 900.0), (-1.0,))
    by_speed, _ = tables_of(result, result_quantities(result, ()))
    assert by_speed.header == ("rpm", "counter-clockwise, N·m")
    assert [row[0] for row in by_speed.rows] == ["100", "300", "500", "700", "900"]


def test_speeds_of_one_direction_only_keep_their_row() -> None:
    speed = np.array([100.0, 300.0, 500.0, 700.0, -101.0, -400.0, -500.0, -700.0])
    torque = np.sign(speed) * (0.1 + 1e-4 * np.abs(speed)) + 1e-3 * np.cos(np.arange(8.0) ** 2)
    by_speed, _ = tables_of(
        result := evaluate_no_load(speed, torque), result_quantities(result, ())
    )
    empty = {row[0]: [cell == "–" for cell in row[1:3]] for row in by_speed.rows}
    assert empty == {
        **{"100": [False, False], "300": [False, True], "400": [True, False]},
        **{"500": [False, False], "700": [False, False]},
    }


def test_a_column_of_sentences_wraps_and_numbers_do_not() -> None:
    row = ("radial-basis", "0.1", "2.7 standard errors worse than x")
    table = Table(("model", "RMS", "verdict"), [row])
    assert table.sentences == (False, False, True)
    text = render_page(Page("A", "", [Section("", "", (table,))]))
    assert '<td class="sentence">2.7 standard' in text
    assert "<td>0.1</td>" in text


def test_numbers_in_columns_keep_a_space(capsys: pytest.CaptureFixture[str]) -> None:
    standard = np.array([0.0, 123.4, 1234.5])
    small = summarise_errors(standard + 1.23456e-4, standard, 2000.0)
    large = summarise_errors(standard + 1234.56, standard, 2000.0)
    table = errors_table([("raw reading", small), ("raw reading", large)], "")
    print_page(Page("A", "", [Section("", "", (table,))]))
    for line in capsys.readouterr().out.splitlines():
        if "raw" in line:
            assert len(line.split()) == 2 + 6
        assert len(line.rstrip()) <= 80
